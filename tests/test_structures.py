"""The structures of pm.models: compared with closed forms, patch tests, and scikit-fem."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import models, structures

STEEL = {"E": 210.0, "nu": 0.3, "rho": 7.8}


def largest(A):
    """The largest absolute entry of a sparse or dense array."""
    return np.abs(A.data if sp.issparse(A) else A).max(initial=0.0)


def distorted_plate(**options):
    """4 x 3 elements on 2 x 1.5; inner points moved by up to a quarter of an edge."""
    grid = structures.plate(4, 3, 0.5, **STEEL)
    return structures.plate_on(moved_inside(grid), grid.elements["quad"], **{**STEEL, **options})


def distorted_solid(**options):
    """3 x 4 x 3 elements on 1.5 x 2 x 1.5; inner points moved by up to a quarter of an edge."""
    grid = structures.solid(3, 4, 3, 0.5, **STEEL)
    return structures.solid_on(
        moved_inside(grid), grid.elements["hexahedron"], **{**STEEL, **options}
    )


def moved_inside(grid):
    low, high = grid.points.min(axis=0), grid.points.max(axis=0)
    inside = np.all((grid.points > low) & (grid.points < high), axis=1)
    shift = np.random.default_rng(8).uniform(-0.125, 0.125, grid.points.shape)
    return grid.points + inside[:, None] * shift


def all_structures(mass):
    """One of each kind, none of them regular."""
    corners, members = [[0, 0], [0, 3], [4, 3], [4, 0]], [[0, 1], [1, 2], [3, 2]]
    frame = {"EA": [50.0, 60.0, 70.0], "EI": [3.0, 4.0, 5.0], "rhoA": [1.0, 2.0, 3.0]}
    return {
        "rod": structures.rod(5, 2.0, EA=[1.0, 2, 3, 4, 5], rhoA=[5.0, 4, 3, 2, 1], mass=mass),
        "frame": structures.beam_frame(corners, members, **frame, divisions=[2, 3, 1], mass=mass),
        "plate": distorted_plate(mass=mass, E=np.arange(1.0, 13.0), t=0.2),
        "solid": distorted_solid(mass=mass, E=np.arange(1.0, 37.0)),
    }


KINDS = ["rod", "frame", "plate", "solid"]


# ---- chains and rods ------------------------------------------------------------------------


def test_a_chain_on_the_ground_is_a_shear_frame():
    masses, springs = [3.0, 2.0, 1.0], [30.0, 20.0, 10.0]
    M, K = models.shear_frame(masses, springs)
    chain = structures.chain(3, masses, springs[1:], ground=(springs[0], 0.0))
    np.testing.assert_array_equal(chain.M.toarray(), M.toarray())  # whole numbers: no rounding
    np.testing.assert_array_equal(chain.K.toarray(), K.toarray())


def test_a_chain_between_two_walls_has_the_frequencies_of_the_textbook():
    n, m, k = 9, 2.0, 50.0
    chain = structures.chain(n, m, k, ground=(k, k))
    # omega_i = 2 sqrt(k/m) sin(i pi / (2 (n + 1)))
    expected = 10.0 * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    omegas, _ = structures.modes(chain.M, chain.K, n)
    np.testing.assert_allclose(omegas, expected, rtol=1e-13)  # rounding, condition number 40


def test_a_chain_of_one_mass_hangs_on_its_two_springs():
    chain = structures.chain(1, 2.0, 7.0, ground=(3.0, 5.0))
    assert chain.M.toarray().tolist() == [[2.0]]
    assert chain.K.toarray().tolist() == [[8.0]]
    assert chain.elements["line"].shape == (0, 2)


def rod_frequencies(mass, theta, c_over_h):
    """Of linear elements at a phase theta from node to node.

    -k (2 cos - 2) against m omega^2 lumped, or m (4 + 2 cos) / 6 omega^2 consistent.
    """
    squares = 2.0 * (1.0 - np.cos(theta))
    if mass == "consistent":
        squares /= (2.0 + np.cos(theta)) / 3.0
    return c_over_h * np.sqrt(squares)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize("fixed, half", [([0], 0.5), ([], 1.0)])
def test_a_rod_has_the_frequencies_of_its_difference_equation(mass, fixed, half):
    n = 20
    rod = structures.rod(n, 3.0, EA=8.0, rhoA=2.0, mass=mass)  # c = 2
    omegas, shapes = structures.modes(rod.M, rod.K, n, fixed=fixed)
    # fixed-free (i - 1/2) pi, free-free (i - 1) pi, over the length
    i = np.arange(1, n + 1)
    theta = (i - half) * np.pi / n
    # rounding, relative to the lowest square: 4 / theta_1^2 = 650 times eps, times a few
    np.testing.assert_allclose(
        omegas, rod_frequencies(mass, theta, 2.0 * n / 3.0), rtol=1e-12, atol=1e-12
    )
    if fixed:
        assert np.all(shapes[0] == 0.0)
    else:
        assert omegas[0] == 0.0


def test_a_rod_of_two_materials_stretches_like_springs_in_a_row():
    EA = np.array([1.0, 2.0, 4.0, 5.0])
    rod = structures.rod(4, 2.0, EA=EA, rhoA=1.0, origin=-1.0)
    np.testing.assert_array_equal(rod.points[:, 0], [-1.0, -0.5, 0.0, 0.5, 1.0])
    u = np.linalg.solve(rod.K[1:, 1:].toarray(), [0.0, 0.0, 0.0, 3.0])
    # u = sum F h / EA; rounding
    np.testing.assert_allclose(u, np.cumsum(3.0 * 0.5 / EA), rtol=1e-13)


def test_a_lumped_rod_carries_a_pulse_exactly_at_the_critical_step():
    n, steps = 40, 15
    rod = structures.rod(n, 4.0, EA=9.0, rhoA=1.0, mass="lumped")  # c = 3, h = 0.1
    pulse = np.zeros(n + 1)
    pulse[18:23] = [0.25, 0.75, 1.0, 0.75, 0.25]
    bar = rod.subdomain(scheme=pm.CentralDifference(), u0=pulse)
    u = pm.solve(bar, 0.1 / 3.0, steps * 0.1 / 3.0).u[-1]
    expected = 0.5 * (np.roll(pulse, steps) + np.roll(pulse, -steps))  # d'Alembert
    # rounding of 15 steps; at the critical step it grows linearly
    np.testing.assert_allclose(u, expected, rtol=0.0, atol=1e-13)


# ---- frames ---------------------------------------------------------------------------------


def beam(n, mass="consistent", slope=(1.0, 0.0), **options):
    """A straight beam of length 5 in n elements: EI = 3, rhoA = 2, and so stiff in tension that
    axial modes are far above."""
    end = 5.0 * np.array(slope) / np.hypot(*slope)
    properties = {"EA": 1e5, "EI": 3.0, "rhoA": 2.0}
    line = [[0.0, 0.0], end]
    return structures.beam_frame(line, [[0, 1]], **properties, divisions=n, mass=mass, **options)


# cos x cosh x = -1, and +1
CANTILEVER = np.array([1.8751040687, 4.6940911330, 7.8547574382])
FREE = np.array([4.7300407449, 7.8532046241])
SUPPORTED = np.pi * np.array([1.0, 2.0, 3.0])
SUPPORTS = {
    "cantilever": ([0, 1, 2], CANTILEVER),
    "simply supported": ([0, 1, 4], SUPPORTED),
    "free": ([], np.concatenate([np.zeros(3), FREE])),
}


def beam_frequencies(roots):
    return (roots / 5.0) ** 2 * np.sqrt(3.0 / 2.0)


@pytest.mark.parametrize("support", SUPPORTS)
def test_a_beam_has_the_frequencies_of_the_textbook_and_converges_with_order_four(support):
    fixed, roots = SUPPORTS[support]
    bending = roots > 0.0
    for n in (8, 16):
        frame = beam(n)
        omegas, _ = structures.modes(frame.M, frame.K, len(roots), fixed=fixed)
        assert np.all(omegas[~bending] == 0.0)
        error = omegas[bending] / beam_frequencies(roots[bending]) - 1.0
        # energy of the interpolation error of the mode, h^4/720 int u''''^2, over twice int u''^2;
        # the next term is (x h)^2 times smaller with x h <= 1, and a factor of about 0.1; 1e-8 is
        # axial softness: (EI / EA) / L^2 = 1e-6 enters the shapes squared
        leading = (roots[bending] / n) ** 4 / 1440.0
        np.testing.assert_allclose(error, leading, rtol=0.15, atol=1e-8)


def supported_frequency(theta, h, mass, rotary):
    """Of the beam above at u_j = U sin(j theta), rz_j = R cos(j theta): the lower frequency of the
    2 x 2 problem that the element matrices of two neighbours leave."""
    c, s = np.cos(theta), np.sin(theta)
    K = 3.0 / h**3 * np.array([[24 - 24 * c, -12 * h * s], [-12 * h * s, h**2 * (8 + 4 * c)]])
    if mass == "lumped":
        M = 2.0 * h * np.diag([1.0, 2.0 * rotary * h**2])
    else:
        M = np.array([[312 + 108 * c, 26 * h * s], [26 * h * s, h**2 * (8 - 6 * c)]]) * h / 210.0
    return 1.0 / np.sqrt(scipy.linalg.eigh(M, K, eigvals_only=True)[-1])


@pytest.mark.parametrize(
    "mass, rotary", [("consistent", 0.5), ("lumped", 1 / 78), ("lumped", 1 / 24), ("lumped", 0.0)]
)
def test_a_supported_beam_has_the_frequencies_of_its_difference_equation(mass, rotary):
    n = 10
    frame = beam(n, mass, slope=(3.0, 4.0), rotary=rotary)
    fixed = frame.dofs([0, 1], ["ux", "uy"])
    expected = [supported_frequency(i * np.pi / n, 5.0 / n, mass, rotary) for i in (1, 2, 3, 4)]
    omegas, _ = structures.modes(frame.M, frame.K, 4, fixed=fixed)
    # rounding: eps times EA h^2 / EI = 1e4 times (n / pi)^4 = 100
    np.testing.assert_allclose(omegas, expected, rtol=1e-9)


@pytest.mark.parametrize("slope", [(1.0, 0.0), (0.0, -1.0), (-2.0, 3.0)])
def test_a_beam_in_any_direction_bends_under_a_load_at_its_tip_as_in_the_textbook(slope):
    frame = beam(3, slope=slope)
    along = np.array(slope) / np.hypot(*slope)
    across = np.array([-along[1], along[0]])
    load = np.zeros(frame.n)
    load[frame.dofs(1)] = [*(7.0 * across + 11.0 * along), 0.0]
    free = np.setdiff1d(np.arange(frame.n), frame.dofs(0))
    u = np.zeros(frame.n)
    u[free] = np.linalg.solve(frame.K[free][:, free].toarray(), load[free])
    tip = u[frame.dofs(1, ["ux", "uy"])]
    # P L^3 / 3 EI, P L^2 / 2 EI, P L / EA; cubic elements are exact at nodes; rounding times a
    # condition number of EA L^2 / EI = 1e6
    np.testing.assert_allclose(tip @ across, 7.0 * 125.0 / 9.0, rtol=1e-9)
    np.testing.assert_allclose(u[frame.dofs(1, "rz")], 7.0 * 25.0 / 6.0, rtol=1e-9)
    np.testing.assert_allclose(tip @ along, 11.0 * 5.0 / 1e5, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_a_beam_is_a_rod_along_its_axis(mass):
    n = 4
    frame = beam(n, mass)
    rod = structures.rod(n, 5.0, EA=1e5, rhoA=2.0, mass=mass)
    along = frame.dofs([0, *range(2, n + 1), 1], "ux")  # the end given is node 1
    np.testing.assert_allclose(frame.points[along // 3, 0], rod.points[:, 0], rtol=1e-15)
    M = frame.M.toarray()[np.ix_(along, along)]
    np.testing.assert_allclose(M, rod.M.toarray(), rtol=1e-14)  # rounding
    K = frame.K.toarray()[np.ix_(along, along)]
    np.testing.assert_allclose(K, rod.K.toarray(), rtol=1e-14)


def test_the_consistent_mass_of_a_frame_has_its_moment_of_inertia():
    frame = all_structures("consistent")["frame"]
    x, y = frame.points.T
    turn = np.column_stack([-y, x, np.ones(len(x))]).ravel()
    # int rhoA (x^2 + y^2): rhoA L^3/3 + L d^2 of each member, about the origin
    expected = 1.0 * 9.0 + 2.0 * (64.0 / 3.0 + 4.0 * 9.0) + 3.0 * (9.0 + 3.0 * 16.0)
    assert turn @ frame.M @ turn == pytest.approx(expected, rel=1e-13)  # rounding of 100 terms


def test_the_lumped_masses_of_a_beam_have_the_ratios_of_the_consistent_diagonal():
    lumped, consistent = beam(1, "lumped").M.diagonal(), beam(1).M.diagonal()
    # rotation over transverse displacement of a node, which is half the mass
    assert lumped[2] / lumped[1] == pytest.approx(consistent[2] / consistent[1], rel=1e-15)
    assert lumped[:2].tolist() == [5.0, 5.0]
    assert beam(1, "lumped", rotary=1.0 / 24.0).M[2, 2] == pytest.approx(2.0 * 125.0 / 24.0)


def test_members_are_cut_into_equal_elements_in_their_own_direction():
    points = [[0.0, 0.0], [0.0, 3.0], [4.0, 3.0]]
    nodes, lines, member = structures.subdivide(points, [[1, 0], [1, 2]], [3, 1])
    assert nodes[3:].tolist() == [[0.0, 2.0], [0.0, 1.0]]
    assert lines.tolist() == [[1, 3], [3, 4], [4, 0], [1, 2]]
    assert member.tolist() == [0, 0, 0, 1]
    nodes, lines, member = structures.subdivide(points, [[0, 1], [2, 1]], 1)  # as they are
    assert (nodes.tolist(), lines.tolist()) == (points, [[0, 1], [2, 1]])
    assert member.tolist() == [0, 1]


# ---- common to all structures ---------------------------------------------------------------


def rigid_motions(structure):
    """(n, 1, 3 or 6): translations, and rotations about the origin."""
    x, names = structure.points, structure.components
    dim = x.shape[1]
    fields = [np.tile(row, (len(x), 1)) for row in np.eye(len(names))[:dim]]
    for i, j in [(0, 1), (1, 2), (2, 0)][: dim * (dim - 1) // 2]:
        turn = np.zeros((len(x), len(names)))
        turn[:, i], turn[:, j] = -x[:, j], x[:, i]
        if "rz" in names:
            turn[:, names.index("rz")] = 1.0
        fields.append(turn)
    return np.stack([f.ravel() for f in fields], axis=1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_rigid_motions_have_no_energy_and_are_all_that_have_none(kind, mass):
    structure = all_structures(mass)[kind]
    rigid = rigid_motions(structure)
    # rounding of a row: some 100 terms
    assert largest(structure.K @ rigid) < 1e-13 * largest(structure.K) * largest(rigid)
    count = rigid.shape[1]
    omegas, _ = structures.modes(structure.M, structure.K, count + 1)
    assert np.all(omegas[:count] == 0.0)
    # a spurious mode of no energy has omega^2 of eps times the highest one, not a thousandth of
    # the ratio of stiffness to mass
    assert omegas[count] ** 2 > 1e-6 * largest(structure.K) / largest(structure.M)


MASSES = {
    "rod": 0.4 * 15.0,  # h sum rhoA
    "frame": 3.0 * 1.0 + 4.0 * 2.0 + 3.0 * 3.0,
    "plate": 7.8 * 2.0 * 1.5 * 0.2,
    "solid": 7.8 * 1.5 * 2.0 * 1.5,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_the_mass_of_each_displacement_is_that_of_the_whole(kind, mass):
    structure = all_structures(mass)[kind]
    dim = structure.points.shape[1]
    translations = rigid_motions(structure)[:, :dim]
    found = translations.T @ (structure.M @ translations)
    # rounding of sums over some hundred entries; the distorted hexahedra have volumes of degree 2
    # in each coordinate, which two points integrate exactly
    np.testing.assert_allclose(found, MASSES[kind] * np.eye(dim), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_matrices_are_symmetric_and_lumped_masses_positive_and_diagonal(kind):
    lumped, consistent = (all_structures(mass)[kind] for mass in ("lumped", "consistent"))
    assert isinstance(lumped.M, sp.csr_array) and lumped.M.nnz == lumped.n
    assert np.all(lumped.M.diagonal() > 0.0)
    for A in (consistent.M, consistent.K):
        assert isinstance(A, sp.csr_array)
        # one rounding for each of up to eight elements at an entry
        assert largest(A - A.T) < 1e-15 * largest(A)


@pytest.mark.parametrize("kind", ["rod", "plate", "solid"])
def test_lumped_masses_are_the_row_sums_of_the_consistent_ones(kind):
    lumped, consistent = (all_structures(mass)[kind].M for mass in ("lumped", "consistent"))
    np.testing.assert_allclose(lumped.diagonal(), consistent.sum(axis=1), rtol=1e-13)  # rounding


@pytest.mark.parametrize("kind", KINDS)
def test_a_structure_moves_as_a_subdomain_of_the_coupler(kind):
    structure = all_structures("lumped")[kind]
    u0 = rigid_motions(structure)[:, 0]
    body = structure.subdomain(scheme=pm.GeneralizedAlpha(0.5), v0=u0, name=kind)
    history = pm.solve(body, 0.1, 1.0)
    # free flight; rounding of ten steps, of forces K u with u up to 1
    np.testing.assert_allclose(history.u[-1], u0, rtol=0.0, atol=1e-10)


# ---- plates and solids: numbers -------------------------------------------------------------


def test_nodes_and_elements_of_a_plate_are_where_the_docstring_states():
    nx, ny, h = 3, 2, (0.5, 0.25)
    plate = structures.plate(nx, ny, h, **STEEL, origin=(1.0, 2.0))
    for i, j in np.ndindex(nx + 1, ny + 1):
        place = plate.points[(ny + 1) * i + j]
        assert place.tolist() == [1.0 + 0.5 * i, 2.0 + 0.25 * j]
    centres = plate.points[plate.elements["quad"]].mean(axis=1)
    for i, j in np.ndindex(nx, ny):
        assert centres[ny * i + j].tolist() == [1.25 + 0.5 * i, 2.125 + 0.25 * j]


def test_nodes_and_elements_of_a_solid_are_where_the_docstring_states():
    nx, ny, nz = 2, 3, 4
    solid = structures.solid(nx, ny, nz, (1.0, 2.0, 4.0), **STEEL)
    for i, j, k in np.ndindex(nx + 1, ny + 1, nz + 1):
        place = solid.points[((ny + 1) * i + j) * (nz + 1) + k]
        assert place.tolist() == [i, 2.0 * j, 4.0 * k]
    centres = solid.points[solid.elements["hexahedron"]].mean(axis=1)
    for i, j, k in np.ndindex(nx, ny, nz):
        assert centres[(ny * i + j) * nz + k].tolist() == [i + 0.5, 2.0 * j + 1.0, 4.0 * k + 2.0]


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_a_regular_mesh_gives_what_the_general_function_gives_on_it(mass):
    E = np.arange(1.0, 7.0).reshape(3, 2)
    rho = 10.0 - E
    plate = structures.plate(3, 2, (0.5, 0.3), E=E, nu=0.3, rho=rho, mass=mass)
    same = structures.plate_on(
        plate.points, plate.elements["quad"], E=E.ravel(), nu=0.3, rho=rho.ravel(), mass=mass
    )
    E = np.arange(1.0, 13.0).reshape(3, 2, 2)
    solid = structures.solid(3, 2, 2, (0.5, 0.3, 0.2), E=E, nu=0.3, rho=1.0 / E, mass=mass)
    E = E.ravel()
    hexahedra = solid.elements["hexahedron"]
    alike = structures.solid_on(solid.points, hexahedra, E=E, nu=0.3, rho=1.0 / E, mass=mass)
    for ours, other in ((plate, same), (solid, alike)):
        for A, B in ((ours.K, other.K), (ours.M, other.M)):
            assert largest(A - B) < 1e-14 * largest(A)  # rounding of the Jacobians


def axial(structure, shape):
    """Displacements along x that depend on x only."""
    u = np.zeros((len(structure.points), structure.dofs_per_node))
    u[:, 0] = shape
    return u.ravel()


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize("kind", ["plate", "solid"])
def test_without_lateral_contraction_the_axial_modes_are_those_of_a_rod(kind, mass):
    n, material = 12, {"E": 4.0, "nu": 0.0, "rho": 1.0, "mass": mass}  # c = 2, h = 0.25
    if kind == "plate":
        bar = structures.plate(n, 2, (0.25, 0.3), **material, t=0.7)
    else:
        bar = structures.solid(n, 2, 3, (0.25, 0.3, 0.2), **material)
    for i in (1, 3, 7):
        theta = (i - 0.5) * np.pi / n  # fixed at x = 0
        mode = axial(bar, np.sin(theta * bar.points[:, 0] / 0.25))
        square = rod_frequencies(mass, theta, 8.0) ** 2
        free = bar.points[:, 0] > 0.0
        residual = (bar.K @ mode - square * (bar.M @ mode)).reshape(len(free), -1)[free]
        assert largest(residual) < 1e-14 * largest(bar.K)  # rounding of rows of K u, |u| <= 1


@pytest.mark.parametrize("nu", [-0.5, 0.3, 0.5])
def test_a_plate_that_is_stretched_gets_narrower_by_nu_also_where_it_is_incompressible(nu):
    """Plane stress, uniaxial: sigma_xx = E e on the ends, no force on the sides or inside."""
    E, t, e, height = 7.0, 0.2, 1e-3, 1.0
    plate = structures.plate(3, 2, 0.5, E=E, nu=nu, rho=1.0, t=t)
    x, y = plate.points.T
    u = np.column_stack([e * x, -nu * e * y]).ravel()
    forces = (plate.K @ u).reshape(-1, 2)
    ends = np.array([forces[at].sum(axis=0) for at in (x == 0.0, x == x.max())])
    pull = E * e * t * height
    rounding = 100 * np.finfo(float).eps * pull  # of sums of some ten products
    np.testing.assert_allclose(ends, [[-pull, 0.0], [pull, 0.0]], rtol=1e-13, atol=rounding)
    np.testing.assert_allclose(forces[(x > 0.0) & (x < x.max())], 0.0, atol=rounding)
    for component, stress in (("xx", E * e), ("yy", 0.0), ("xy", 0.0)):
        values = plate.stress(u, component)
        np.testing.assert_allclose(values, stress, rtol=1e-13, atol=rounding / t)


def test_two_plates_coupled_by_gc_have_the_displacements_of_another_program():
    nx, ny, h = 99, 24, 0.1
    material = {"E": 1000.0, "nu": 0.3, "rho": 100.0}
    left = structures.plate(nx, ny, h, **material)
    right = structures.plate(nx, ny, h, **material, mass="lumped", origin=(nx * h, 0.0))
    free = np.setdiff1d(np.arange(left.n), left.dofs(left.nodes_at(x=0.0)))
    lower = right.nodes_at(y=0.0)
    load = np.zeros(right.n)
    for component in ("ux", "uy"):
        load[right.dofs(lower, component)] = h / np.sqrt(2.0)
        load[right.dofs(lower[[0, -1]], component)] /= 2.0
    a = pm.Subdomain(left.M[free][:, free], left.K[free][:, free], scheme=pm.Newmark(), name="left")
    b = right.subdomain(scheme=pm.CentralDifference(), substeps=10, force=load, name="right")
    edge = nx * h
    face = np.searchsorted(free, left.dofs(left.nodes_at(x=edge)))
    tie = pm.tie(a, face, b, right.dofs(right.nodes_at(x=edge)))
    coupler = pm.Coupler([a, b], tie, dt=0.1, coupling="gc")
    coupler.step(6)
    # all nine digits of the other program
    expected = [1.31801162e-3, 4.11251227e-4]
    np.testing.assert_allclose(coupler.state("right").u[:2], expected, rtol=1e-8)


# ---- modes ----------------------------------------------------------------------------------


def test_modes_by_arpack_are_those_of_a_dense_solver():
    plate = structures.plate(16, 6, 0.1, **STEEL)  # 224 free dofs: above what is solved densely
    fixed = plate.dofs(plate.nodes_at(x=0.0))
    free = np.setdiff1d(np.arange(plate.n), fixed)
    squares = scipy.linalg.eigh(
        plate.K[free][:, free].toarray(), plate.M[free][:, free].toarray(), eigvals_only=True
    )
    omegas, _ = structures.modes(plate.M, plate.K, 8, fixed=fixed)
    # rounding of the dense solver: eps times the highest square, which is 1e5 times the lowest
    np.testing.assert_allclose(omegas**2, squares[:8], rtol=1e-10)


@pytest.mark.parametrize("nx", [6, 20])  # dense, ARPACK
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_modes_solve_the_eigenvalue_problem_and_are_mass_normalised(nx, mass):
    plate = structures.plate(nx, 6, 0.1, **STEEL, mass=mass)
    fixed = plate.dofs(plate.nodes_at(x=0.0), "ux")  # still free along y
    omegas, X = structures.modes(plate.M, plate.K, 6, fixed=fixed)
    M = plate.M
    np.testing.assert_allclose(X.T @ (M @ X), np.eye(6), rtol=0.0, atol=1e-12)  # rounding
    assert omegas[0] == 0.0 and np.all(np.diff(omegas) > 0.0)
    assert np.all(X[fixed] == 0.0)
    residual = np.delete(plate.K @ X - (M @ X) * omegas**2, fixed, axis=0)
    assert largest(residual) < 1e-11 * largest(plate.K) * largest(X)  # rounding of the solves
    assert np.all(X.max(axis=0) == np.abs(X).max(axis=0))


@pytest.mark.parametrize("n", [10, 120])  # dense, ARPACK
def test_dofs_without_mass_follow_the_others(n):
    frame = beam(n, "lumped", rotary=0.0)
    fixed = frame.dofs(0)
    rotations = np.setdiff1d(frame.dofs(np.arange(n + 1), "rz"), fixed)
    moving = np.setdiff1d(np.arange(frame.n), np.concatenate([fixed, rotations]))
    K = frame.K.toarray()
    # K rotations eliminated: K_mm - K_mr K_rr^-1 K_rm
    follow = -np.linalg.solve(K[np.ix_(rotations, rotations)], K[np.ix_(rotations, moving)])
    condensed = K[np.ix_(moving, moving)] + K[np.ix_(moving, rotations)] @ follow
    squares = scipy.linalg.eigh(condensed, np.diag(frame.M.diagonal()[moving]), eigvals_only=True)
    omegas, X = structures.modes(frame.M, frame.K, 3, fixed=fixed)
    # rounding: K is up to 12 EI / h^3, omega^2 m down to EI h / L^4: (n^4 = 2e8) times eps
    np.testing.assert_allclose(omegas**2, squares[:3], rtol=1e-6)
    np.testing.assert_allclose(X[rotations], follow @ X[moving], rtol=0.0, atol=1e-8)


def test_all_modes_of_a_small_structure_can_be_computed():
    plate = structures.plate(2, 1, 0.5, **STEEL)
    omegas, X = structures.modes(plate.M, plate.K, plate.n)
    # completeness: sum of x x^T is the inverse of M; rounding
    np.testing.assert_allclose(X @ X.T @ plate.M.toarray(), np.eye(plate.n), atol=1e-12)
    rebuilt = plate.M @ (X * omegas**2) @ (plate.M @ X).T
    np.testing.assert_allclose(rebuilt, plate.K.toarray(), rtol=0.0, atol=1e-11 * largest(plate.K))


def test_modes_accept_matrices_of_every_format():
    chain = structures.chain(4, 2.0, 5.0, ground=(1.0, 0.0))
    expected = structures.modes(chain.M, chain.K, 4)
    for M in (chain.M.toarray(), chain.M.diagonal(), sp.csr_matrix(chain.M)):
        for K in (chain.K.toarray(), chain.K.tocoo()):
            omegas, shapes = structures.modes(M, K, 4)
            np.testing.assert_allclose(omegas, expected[0], rtol=1e-13)  # rounding
            np.testing.assert_allclose(shapes, expected[1], atol=1e-13)


def test_modes_are_the_same_in_every_run():
    plate = structures.plate(20, 6, 0.1, **STEEL)
    first, second = (structures.modes(plate.M, plate.K, 5) for _ in range(2))
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.parametrize("n", [5, 300])  # dense, ARPACK
def test_an_indefinite_stiffness_and_a_dof_without_mass_and_stiffness_have_no_modes(n):
    chain = structures.chain(n, 1.0, 1.0)
    held = np.zeros(n)
    held[n // 2] = -0.1
    with pytest.raises(ValueError, match="K must be positive semidefinite"):
        structures.modes(chain.M, chain.K + sp.diags_array(held), 2)
    M, K = np.ones(n), np.ones(n)
    M[2] = K[2] = 0.0
    with pytest.raises(ValueError, match="every dof have mass or stiffness"):
        structures.modes(M, K, 2)


@pytest.mark.parametrize(
    "change, error, message",
    [
        ({"k": 0}, ValueError, "k must be at least 1, got 0"),
        ({"k": 3}, ValueError, "k must be at most 2, the free dofs with mass, got 3"),
        ({"k": 2.0}, TypeError, "k must be a whole number"),
        ({"k": 2, "fixed": [0]}, ValueError, "k must be at most 1"),
        ({"fixed": [3]}, ValueError, "fixed must lie in 0..2, got 3"),
        ({"fixed": [1, 1]}, ValueError, "fixed must not repeat"),
        ({"M": np.zeros(3)}, ValueError, "M must not be zero"),
        ({"K": np.ones(4)}, ValueError, "K must be of size 3"),
        ({"K": np.triu(np.ones((3, 3)))}, ValueError, "K must be symmetric"),
    ],
)
def test_invalid_arguments_of_modes_are_named(change, error, message):
    arguments = {"M": [1.0, 0.0, 1.0], "K": [1.0, 1.0, 1.0], "k": 1, **change}
    with pytest.raises(error, match=message):
        structures.modes(**arguments)


# ---- Structure ------------------------------------------------------------------------------


def test_nodes_are_found_by_a_condition_and_by_coordinates():
    plate = structures.plate(3, 2, 0.1, **STEEL, origin=(0.7, 0.0))
    # 0.7 + 3 * 0.1 is not 1.0 in floating point
    assert plate.nodes_at(x=1.0).tolist() == [9, 10, 11]
    assert plate.nodes_at(x=0.9, y=0.2).tolist() == [8]
    assert plate.nodes(lambda x, y: (x > 0.85) & (y < 0.05)).tolist() == [6, 9]


def test_dofs_come_node_by_node():
    plate = structures.plate(1, 1, 1.0, **STEEL)
    assert plate.dofs([3, 0]).tolist() == [6, 7, 0, 1]
    assert plate.dofs([3, 0], "uy").tolist() == [7, 1]
    assert plate.dofs(2, ("uy", "ux")).tolist() == [5, 4]


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_rayleigh_damping_gives_each_mode_its_ratio(mass):
    plate = structures.plate(5, 2, 0.5, **STEEL, mass=mass)
    fixed = plate.dofs(plate.nodes_at(x=0.0))
    omegas, X = structures.modes(plate.M, plate.K, 4, fixed=fixed)
    C = plate.damping(*models.rayleigh([omegas[0], omegas[3]], [0.02, 0.05]))
    ratios = np.diag(X.T @ (C @ X)) / (2.0 * omegas)
    np.testing.assert_allclose(ratios[[0, 3]], [0.02, 0.05], rtol=1e-9)  # rounding of the modes
    assert plate.damping(0.0, 0.0) is None


PLATE = {"nx": 2, "ny": 2, "h": 0.5, "E": 1.0, "nu": 0.3, "rho": 1.0}
SQUARE = {"points": [[0, 0], [1, 0], [1, 1], [0, 1]], "elements": [[0, 1, 2, 3]]}
QUADS = {**SQUARE, "E": 1.0, "nu": 0.3, "rho": 1.0}
FRAME = {"points": [[0, 0], [1, 0]], "members": [[0, 1]], "EA": 1.0, "EI": 1.0, "rhoA": 1.0}
CHAIN = {"n": 3, "mass": 1.0, "stiffness": 1.0}
ROD = {"n": 3, "length": 1.0, "EA": 1.0, "rhoA": 1.0}
BOX = {"nx": 1, "ny": 1, "nz": 1, "h": 1.0, "E": 1.0, "nu": 0.3, "rho": 1.0}


@pytest.mark.parametrize(
    "build, given, change, error, message",
    [
        ("plate", PLATE, {"nx": 0}, ValueError, "nx must be at least 1, got 0"),
        ("plate", PLATE, {"ny": 1.5}, TypeError, "ny must be a whole number, got 1.5"),
        ("plate", PLATE, {"h": 0.0}, ValueError, "h must be positive, got 0.0"),
        ("plate", PLATE, {"h": [1.0] * 3}, ValueError, r"h must be one number or 2, got .*\(3,\)"),
        ("plate", PLATE, {"E": -1.0}, ValueError, "E must be positive, got -1"),
        ("plate", PLATE, {"E": np.ones(3)}, ValueError, r"E must be a number or of shape \(2, 2\)"),
        ("plate", PLATE, {"E": "steel"}, TypeError, "E must hold real numbers"),
        ("plate", PLATE, {"rho": np.nan}, ValueError, "rho must be finite"),
        ("plate", PLATE, {"nu": 0.6}, ValueError, r"nu must lie in \(-1, 0.5\], got 0.6"),
        ("plate", PLATE, {"t": 0.0}, ValueError, "t must be positive, got 0"),
        ("plate", PLATE, {"mass": "diagonal"}, ValueError, "mass must be .* got 'diagonal'"),
        ("plate", PLATE, {"origin": [0.0]}, ValueError, r"origin must have shape \(2,\)"),
        ("solid", BOX, {"nu": 0.5}, ValueError, r"nu must lie in \(-1, 0.5\), got 0.5"),
        ("solid", BOX, {"nz": -1}, ValueError, "nz must be at least 1, got -1"),
        ("plate_on", QUADS, {"elements": [[0, 3, 2, 1]]}, ValueError, "counter-clockwise.* in 0"),
        ("plate_on", QUADS, {"elements": [[0, 1, 3, 2]]}, ValueError, "elements must be convex"),
        ("plate_on", QUADS, {"elements": [[0, 1, 2, 4]]}, ValueError, "elements must lie in 0..3,"),
        ("plate_on", QUADS, {"elements": [[0, 1]]}, ValueError, "with 3, 6, 4, 8, 9 nodes of each"),
        ("plate_on", QUADS, {"elements": {"tetra": [[0] * 4]}}, ValueError, "quad9, got .'tet"),
        ("plate_on", QUADS, {"elements": {}}, ValueError, "elements must be of .* got none"),
        ("plate_on", QUADS, {"plane": "flat"}, ValueError, "plane must be 'stress' or 'strain'"),
        ("plate_on", QUADS, {"elements": [[0.0, 1, 2, 3]]}, TypeError, "elements must be whole"),
        ("plate_on", QUADS, {"points": np.ones((4, 3))}, ValueError, r"points must have shape"),
        ("plate_on", QUADS, {"points": [*SQUARE["points"], [2, 2]]}, ValueError, "submesh.* not 4"),
        ("beam_frame", FRAME, {"points": [[0, 0]] * 2}, ValueError, "members must have a length"),
        ("beam_frame", FRAME, {"points": [[0, 0]]}, ValueError, "members must lie in 0..0, got 1"),
        ("beam_frame", FRAME, {"points": [[0] * 3] * 2}, ValueError, r"points must have shape"),
        ("beam_frame", FRAME, {"EI": [1.0, 2.0]}, ValueError, r"EI must be a number or of shape"),
        ("beam_frame", FRAME, {"divisions": 0}, ValueError, "divisions must be at least 1, got 0"),
        ("beam_frame", FRAME, {"divisions": [1, 2]}, ValueError, r"divisions must have shape \(\)"),
        ("beam_frame", FRAME, {"divisions": 2.0}, TypeError, "divisions must be whole numbers"),
        ("beam_frame", FRAME, {"rotary": -1.0}, ValueError, "rotary must be .* at least 0, got -1"),
        ("chain", CHAIN, {"mass": [1.0, 2.0]}, ValueError, r"mass must be a number or of shape"),
        ("chain", CHAIN, {"stiffness": -1.0}, ValueError, "stiffness must not be negative, got -1"),
        ("chain", CHAIN, {"ground": [1.0]}, ValueError, r"ground must have shape \(2,\)"),
        ("chain", CHAIN, {"ground": [1.0, -2.0]}, ValueError, "ground must not be negative"),
        ("chain", CHAIN, {"spacing": 0.0}, ValueError, "spacing must be positive, got 0.0"),
        ("rod", ROD, {"length": -1.0}, ValueError, "length must be positive, got -1.0"),
        ("rod", ROD, {"EA": 0.0}, ValueError, "EA must be positive, got 0"),
    ],
)
def test_invalid_arguments_of_structures_are_named(build, given, change, error, message):
    getattr(structures, build)(**given)
    with pytest.raises(error, match=message):
        getattr(structures, build)(**{**given, **change})


@pytest.mark.parametrize(
    "use",
    [
        lambda s, nodes: pm.reduce(s.M, s.K, fixed=nodes),
        lambda s, nodes: s.subdomain(scheme=pm.Newmark(), fixed=nodes[1:]),
        lambda s, nodes: pm.cut(s, [0, 1] * 2, scheme=pm.Newmark(), fixed=nodes),
        lambda s, nodes: structures.modes(s.M, s.K, 1, fixed=nodes),
        lambda s, nodes: pm.tie("a", [0], s.subdomain(scheme=pm.Newmark()), nodes),
        lambda s, nodes: pm.CubicSpring(nodes, k=1.0, k3=0.0),
    ],
)
@pytest.mark.parametrize(
    "find", [lambda s: s.nodes_at(x=0.0), lambda s: s.nodes(lambda x, y: x < 1)]
)
def test_nodes_with_several_dofs_are_refused_where_dofs_are_meant(use, find):
    plate = structures.plate(2, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    with pytest.raises(TypeError, match=r"must be dofs, got nodes .*structure\.dofs\(nodes\)"):
        use(plate, find(plate))


def test_dofs_computed_from_nodes_and_nodes_with_one_dof_are_dofs():
    plate = structures.plate(2, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    edge = plate.nodes_at(x=0.0)
    by_hand = pm.reduce(plate.M, plate.K, fixed=2 * edge)
    np.testing.assert_array_equal(by_hand.fixed, plate.dofs(edge, "ux"))
    assert edge.max() == 2 and not isinstance(edge.max(), type(edge))
    rod = structures.rod(4, 1.0, EA=1.0, rhoA=1.0)
    assert pm.reduce(rod.M, rod.K, fixed=rod.nodes_at(x=0.0)).fixed.tolist() == [0]


@pytest.mark.parametrize(
    "call, error, message",
    [
        (lambda s: s.nodes_at(x=7.0), ValueError, r"got {'x': 7.0}; .* \[1.0, 1.0\]"),
        (lambda s: s.nodes_at(z=0.0), ValueError, "needs one or more of x, y, got"),
        (lambda s: s.nodes_at(), ValueError, "needs one or more of x, y, got"),
        (lambda s: s.nodes(lambda x, y: x), ValueError, "where must return 9 truth values"),
        (lambda s: s.nodes(lambda x, y: x > 2.0), ValueError, "where must hold at one node"),
        (lambda s: s.dofs([9]), ValueError, "nodes must lie in 0..8, got 9"),
        (lambda s: s.dofs([1, 1]), ValueError, "nodes must not repeat"),
        (lambda s: s.dofs([1], "rz"), ValueError, r"component must be of \('ux', 'uy'\), got 'rz'"),
        (lambda s: s.damping(-1.0, 0.0), ValueError, "c_m must be .* at least 0"),
        (lambda s: s.subdomain(), TypeError, "scheme"),
    ],
)
def test_invalid_arguments_of_a_structure_are_named(call, error, message):
    with pytest.raises(error, match=message):
        call(structures.plate(**PLATE))


def test_matrices_and_points_of_a_structure_must_agree():
    with pytest.raises(ValueError, match="K must have 2 rows, 1 for each of 2 points, got 3"):
        structures.Structure(np.ones(2), sp.eye_array(3), np.zeros((2, 1)), {}, ("ux",))


def test_loads_and_initial_values_of_all_dofs_are_those_of_the_free_ones():
    bar = structures.rod(4, 2.0, EA=1.0, rhoA=1.0)
    free, record = np.array([1, 2, 3, 4]), np.arange(5.0)
    whole = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    loads = [
        (whole, whole[free]),
        (pm.BaseAcceleration(record, np.ones(5), bar.M, dt=0.1), None),
        (pm.SampledForce(np.outer(record, whole), 0.1), None),
        (lambda t: whole[free], whole[free]),
    ]
    for force, expected in loads:
        made = bar.subdomain(scheme=pm.Newmark(), fixed=[0], force=force, u0=whole, v0=whole[free])
        np.testing.assert_array_equal(made.u0, whole[free])
        np.testing.assert_array_equal(made.v0, whole[free])
        value = made.force(0.25) if callable(made.force) else made.force
        if expected is None:
            expected = force(0.25)[free]
        np.testing.assert_array_equal(value, expected)
    with pytest.raises(ValueError, match="u must be zero at the fixed dofs, got up to 1 at dofs 0"):
        bar.subdomain(scheme=pm.Newmark(), fixed=[0], u0=np.ones(5))


@pytest.mark.parametrize("name", ["M", "K"])
def test_a_matrix_of_the_users_beside_that_of_a_structure_is_refused_by_name(name):
    bar = structures.rod(2, 1.0, EA=1.0, rhoA=1.0)
    with pytest.raises(TypeError, match=f"^{name} must not be given: a structure has its own"):
        bar.subdomain(scheme=pm.Newmark(), **{name: np.eye(3)})
