"""Nonlinear elements: closed forms, differences, rotations, scikit-fem, solved examples."""

import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp
import scipy.sparse.linalg
from meshes import moved_inside

import pmalpha as pm
from pmalpha import structures
from pmalpha.structures.pattern import Assembly

E, NU = 7.0, 0.3
EPS = np.finfo(float).eps


def sheet(material, **options):
    """3 x 3 distorted quadrilaterals."""
    grid = structures.plate(3, 3, 0.5, E=1.0, nu=0.3, rho=1.0)
    options = {"rho": 2.0, "t": 0.2, **options}
    return structures.nonlinear_solid_on(
        moved_inside(grid)[0], grid.elements["quad"], material, **options
    )


def block(material, **options):
    """2 x 3 x 2 distorted hexahedra."""
    grid = structures.solid(2, 3, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    cells, options = grid.elements["hexahedron"], {"rho": 2.0, **options}
    return structures.nonlinear_solid_on(moved_inside(grid)[0], cells, material, **options)


def varied(count):
    """E and nu of another size in each element."""
    rng = np.random.default_rng(3)
    return rng.uniform(2.0, 9.0, count), rng.uniform(0.1, 0.4, count)


def net(d, **options):
    """Five bars of several stiffnesses, in the plane or in space."""
    points = np.array([[0, 0, 0.2], [1, 0, 0], [1, 2, 0.5], [0, 1.5, 1]])[:, :d]
    members = [[0, 1], [1, 2], [3, 2], [0, 3], [0, 2]]
    EA = [3.0, 4.0, 5.0, 6.0, 7.0]
    return structures.truss(points, members, EA=EA, rhoA=2.0, divisions=[1, 2, 1, 1, 1], **options)


def frame(make=structures.corotational_frame, **options):
    points, members = [[0, 0], [0, 3], [4, 4], [4, 0]], [[0, 1], [1, 2], [3, 2]]
    options |= {"EA": [50.0, 60.0, 70.0], "EI": [3.0, 4.0, 5.0], "rhoA": [1.0, 2.0, 3.0]}
    return make(points, members, **options, divisions=[2, 3, 1])


# Structures without prestress, and the size of random displacements that their elements bear.
ELASTIC = {
    "bars 2d": (lambda: net(2), 0.3),
    "bars 3d green": (lambda: net(3, strain="green"), 0.3),
    "beams": (frame, 0.3),
    "sheet svk": (lambda: sheet(structures.StVenantKirchhoff(*varied(9))), 0.05),
    "sheet svk stress": (lambda: sheet(structures.StVenantKirchhoff(E, NU), plane="stress"), 0.05),
    "sheet rubber": (lambda: sheet(structures.NeoHookean(E, NU)), 0.05),
    "block svk": (lambda: block(structures.StVenantKirchhoff(E, NU)), 0.05),
    "block rubber": (lambda: block(structures.NeoHookean(*varied(12))), 0.05),
}
STRESSED = {
    "bars prestressed": (lambda: net(2, prestress=[1.0, -0.5, 0.0, 2.0, 1.0]), 0.3),
    "bars shortened": (lambda: net(3, unstressed=1.1, strain="green"), 0.3),
    "cables": (lambda: net(3, prestress=0.1, slack=True), 0.3),
}
CONTACTS = {
    "plane": (lambda: alone(floor(sheet(structures.StVenantKirchhoff(E, NU)))), 0.3),
    "plane under a frame": (lambda: alone(floor(frame())), 0.3),
    "sphere": (lambda: alone(ball(block(structures.NeoHookean(E, NU)))), 0.3),
    "bowl": (lambda: alone(ball(net(2), inside=True)), 0.3),
}
PLASTIC = {
    "sheet plastic": (lambda: sheet(structures.J2Plasticity(*varied(9), 0.2, 0.5, 0.3)), 0.05),
    "block plastic": (lambda: block(structures.J2Plasticity(E, NU, 0.2, 0.5)), 0.05),
}
ALL = ELASTIC | STRESSED | CONTACTS | PLASTIC


def floor(structure):
    nodes = np.arange(0, len(structure.points), 2)
    normal = [0.1, 1.0, 0.3][: structure.points.shape[1]]
    k = np.linspace(1.0, 2.0, len(nodes))
    middle = structure.points.mean(axis=0)
    return structure, structures.plane_contact(
        structure, nodes, point=middle, normal=normal, stiffness=k
    )


def ball(structure, inside=False):
    nodes = np.arange(0, len(structure.points), 2)
    options = {"center": structure.points.mean(axis=0) + 0.05, "radius": 0.9, "inside": inside}
    return structure, structures.sphere_contact(structure, nodes, **options, stiffness=2.0)


def alone(pair):
    """A structure whose only force is that of contact."""
    structure, contact = pair
    K = sp.csr_array((structure.n, structure.n))
    points, cells, components = structure.points, structure.elements, structure.components
    return structures.Structure(structure.M, K, points, cells, components, (contact,))


def case(name):
    """A structure, its only force, displacements, and the history after those by half."""
    make, size = ALL[name]
    structure = make()
    (force,) = structure.internal
    u = np.random.default_rng(11).uniform(-size, size, force.n)
    return structure, force, u, force(0.5 * u)[3]


def largest(A):
    return np.abs(A.data if sp.issparse(A) else A).max(initial=0.0)


def static(evaluate, u, load, free, *, tol=1e-12, iterations=30):
    """Newton's method for f(u) = load on the free dofs."""
    u = u.copy()
    for _ in range(iterations):
        f, K, _, _ = evaluate(u)
        rest = (load - f)[free]
        if np.abs(rest).max() <= tol * max(1.0, np.abs(load).max()):
            return u
        u[free] += sp.linalg.spsolve(sp.csc_array(K[free][:, free]), rest)
    raise AssertionError("Newton's method has not converged")


# ---- what holds for all ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_the_tangent_is_the_derivative_of_the_force(name):
    _, force, u, q = case(name)
    f, K, C, _ = force(0.0, u, np.zeros(force.n), q)
    h = 1e-5
    steps = h * np.eye(force.n)
    columns = [(force.residual(u + e, q=q) - force.residual(u - e, q=q)) / (2 * h) for e in steps]
    assert C is None and largest(f) > 0.0
    # central differences: h^2 = 1e-10 times the third derivative over the first, at most 100
    # (rubber), and the rounding of f over h, 1e-11
    np.testing.assert_allclose(K.toarray(), np.transpose(columns), atol=1e-8 * largest(K))


@pytest.mark.parametrize("name", [name for name in ALL if name not in PLASTIC])
def test_the_force_is_the_derivative_of_the_potential(name):
    _, force, u, _ = case(name)
    h = 1e-5
    steps = h * np.eye(force.n)
    slopes = [(force.potential(u + e) - force.potential(u - e)) / (2 * h) for e in steps]
    f = force.residual(u)
    # as above; the potential is not larger than the force by its order
    np.testing.assert_allclose(slopes, f, atol=1e-8 * largest(f))
    if name not in CONTACTS and name != "bars shortened":
        assert force.potential(np.zeros(force.n)) == 0.0


def test_a_force_that_depends_on_its_history_has_no_potential():
    for name in PLASTIC:
        assert not hasattr(case(name)[1], "potential")


@pytest.mark.parametrize("name", ALL)
def test_tangents_are_symmetric_and_share_the_entries_of_the_pattern(name):
    _, force, u, q = case(name)
    K = force(u, q=q)[1]
    # rounding of the sums over up to 8 Gauss points of 9 products
    assert largest(K - K.T) <= 20 * EPS * largest(K)
    assert np.shares_memory(K.indices, force.pattern.indices)
    np.testing.assert_array_equal(K.indptr, force.pattern.indptr)
    assert np.all(force.pattern.data == 1.0)
    rows = np.split(K.indices, K.indptr[1:-1])
    assert all(np.all(np.diff(row) > 0) for row in rows)


@pytest.mark.parametrize("name", ALL)
def test_a_call_changes_nothing_and_the_residual_is_its_first_value(name):
    _, force, u, q = case(name)
    kept = u.copy(), q.copy(), force.history.copy()
    u.setflags(write=False), q.setflags(write=False)
    f, K, _, q1 = force(u, q=q)
    again, K_again, _, q1_again = force(u, q=q)
    for one, other in ((f, again), (K.data, K_again.data), (q1, q1_again)):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(force.residual(0.0, u, np.zeros(force.n), q), f)
    for one, other in zip((u, q, force.history), kept, strict=True):
        np.testing.assert_array_equal(one, other)
    assert q1.shape == force.history.shape == q.shape


@pytest.mark.parametrize("name", ALL)
def test_a_reduced_force_is_the_whole_one_with_the_other_dofs_at_zero(name):
    structure, force, u, q = case(name)
    free = pm.reduce(structure.M, structure.K, fixed=np.arange(0, force.n, 3)).free
    u[::3] = 0.0
    reduced = force.reduced(free)
    f, K, _, q1 = force(u, q=q)
    few, K_few, C_few, q1_few = reduced(u[free], q=q)
    np.testing.assert_array_equal(few, f[free])
    np.testing.assert_array_equal(K_few.toarray(), K.toarray()[np.ix_(free, free)])
    np.testing.assert_array_equal(q1_few, q1)
    np.testing.assert_array_equal(reduced.residual(u[free], q=q), f[free])
    np.testing.assert_array_equal(reduced.pattern.toarray(), force.pattern.toarray()[free][:, free])
    assert C_few is None and hasattr(reduced, "potential") == hasattr(force, "potential")
    if hasattr(force, "potential"):
        assert reduced.potential(u[free]) == force.potential(u)


def test_chunks_of_a_mesh_give_its_whole_force(thresholds):
    whole = block(structures.NeoHookean(*varied(12)))
    thresholds(POINTS=40)  # 5 elements: 5 + 5 + 2
    cut = block(structures.NeoHookean(*varied(12)))
    assert len(cut.internal[0]._assembly.chunks) == 3
    u = np.random.default_rng(2).uniform(-0.05, 0.05, whole.n)
    (f, K, _, _), (f_cut, K_cut, _, _) = (s.internal[0](u) for s in (whole, cut))
    # sums of up to 8 elements in another order
    np.testing.assert_allclose(f_cut, f, atol=10 * EPS * largest(f))
    np.testing.assert_allclose(K_cut.toarray(), K.toarray(), atol=10 * EPS * largest(K))
    energies = [s.internal[0].potential(u) for s in (whole, cut)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-14)


# ---- rotations ------------------------------------------------------------------------------


def turn(d, angle):
    """A rotation, in space about an oblique axis."""
    c, s = np.cos(angle), np.sin(angle)
    if d == 2:
        return np.array([[c, -s], [s, c]])
    a = np.array([1.0, 2.0, -2.0]) / 3.0
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return c * np.eye(3) + s * cross + (1 - c) * np.outer(a, a)


def moved_rigidly(structure, u, angle, shift=0.0):
    """Displacements after a rotation of the displaced structure about the origin, and a shift."""
    d = structure.points.shape[1]
    values = u.reshape(len(structure.points), -1).copy()
    places = structure.points + values[:, :d]
    values[:, :d] = places @ turn(d, angle).T + shift - structure.points
    values[:, d:] += angle
    return values.ravel()


def rotated(structure, f, angle):
    d = structure.points.shape[1]
    values = f.reshape(len(structure.points), -1).copy()
    values[:, :d] = values[:, :d] @ turn(d, angle).T
    return values.ravel()


@pytest.mark.parametrize("angle", [0.7, 3.1, -9.0])
@pytest.mark.parametrize("name", ELASTIC)
def test_a_rigid_motion_has_no_force(name, angle):
    structure = ELASTIC[name][0]()
    (force,) = structure.internal
    u = moved_rigidly(structure, np.zeros(force.n), angle, shift=3.0)
    # rounding of coordinates up to 8 times the stiffness
    assert largest(force.residual(u)) < 100 * EPS * largest(structure.tangent())
    assert abs(force.potential(u)) < 100 * EPS * largest(structure.tangent())


@pytest.mark.parametrize("angle", [0.7, 3.1, -9.0])
@pytest.mark.parametrize("name", ELASTIC | STRESSED)
def test_the_force_turns_with_the_structure(name, angle):
    structure, force, u, _ = case(name)
    turned = force.residual(moved_rigidly(structure, u, angle, shift=3.0))
    f = force.residual(u)
    # rounding of coordinates up to 8 times the stiffness
    scale = 100 * EPS * largest(force(u)[1])
    np.testing.assert_allclose(turned, rotated(structure, f, angle), atol=scale)
    assert largest(f) > 1e3 * scale


# ---- small displacements --------------------------------------------------------------------

LAWS = [
    structures.StVenantKirchhoff,
    structures.NeoHookean,
    lambda E, nu: structures.J2Plasticity(E, nu, 0.1),
]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_at_rest_a_block_has_mass_and_stiffness_of_the_linear_solid(law, mass):
    young, nu = varied(12)
    ours = block(law(young, nu), mass=mass)
    cells = ours.elements["hexahedron"]
    linear = structures.solid_on(ours.points, cells, E=young, nu=nu, rho=2.0, mass=mass)
    # rounding: the same integrals over up to 8 elements in another order
    assert largest(ours.tangent() - linear.K) < 20 * EPS * largest(linear.K)
    assert largest(ours.M - linear.M) == 0.0
    assert ours.K.nnz == 0 and ours.components == linear.components


@pytest.mark.parametrize("law", LAWS)
def test_at_rest_a_sheet_in_plane_strain_is_a_plate_of_other_moduli(law):
    young, nu = varied(9)
    nu = nu / 2.0  # nu / (1 - nu) must be below 0.5
    ours = sheet(law(young, nu), t=np.linspace(0.1, 0.3, 9))
    # Timoshenko and Goodier: plane stress with E / (1 - nu^2), nu / (1 - nu) is plane strain
    moduli = {"E": young / (1 - nu**2), "nu": nu / (1 - nu)}
    options = {"rho": 2.0, "t": np.linspace(0.1, 0.3, 9)}
    linear = structures.plate_on(ours.points, ours.elements["quad"], **moduli, **options)
    assert largest(ours.tangent() - linear.K) < 20 * EPS * largest(linear.K)
    assert largest(ours.M - linear.M) < 4 * EPS * largest(linear.M)


@pytest.mark.parametrize("nu", [NU, 0.5])
def test_at_rest_a_sheet_in_plane_stress_is_the_plate(nu):
    ours = sheet(structures.StVenantKirchhoff(E, nu), plane="stress")
    cells = ours.elements["quad"]
    linear = structures.plate_on(ours.points, cells, E=E, nu=nu, rho=2.0, t=0.2)
    assert largest(ours.tangent() - linear.K) < 20 * EPS * largest(linear.K)


def test_a_regular_mesh_is_that_of_plate_and_solid():
    rubber = structures.NeoHookean(E, NU)
    flat = structures.nonlinear_solid(3, 2, (0.5, 0.4), rubber, rho=1.0, origin=(1.0, 2.0))
    plate = structures.plate(3, 2, (0.5, 0.4), E=E, nu=NU, rho=1.0, origin=(1.0, 2.0))
    cube = structures.nonlinear_solid(3, 2, 1, 0.5, rubber, rho=1.0)
    solid = structures.solid(3, 2, 1, 0.5, E=E, nu=NU, rho=1.0)
    for ours, linear in ((flat, plate), (cube, solid)):
        np.testing.assert_array_equal(ours.points, linear.points)
        for kind, elements in linear.elements.items():
            np.testing.assert_array_equal(ours.elements[kind], elements)
        # one element for all, and each by itself
        each = structures.nonlinear_solid_on(ours.points, *ours.elements.values(), rubber, rho=1.0)
        u = np.random.default_rng(1).uniform(-0.03, 0.03, ours.n)
        f, K, _, _ = ours.internal[0](u)
        f_each, K_each, _, _ = each.internal[0](u)
        np.testing.assert_allclose(f, f_each, atol=30 * EPS * largest(f))  # rounding of h
        assert largest(K - K_each) < 30 * EPS * largest(K)


def test_at_rest_bars_have_the_stiffness_of_rods_and_the_mass_of_theirs():
    rods = {"EA": [2.0, 3.0], "rhoA": 5.0}
    for mass in ("consistent", "lumped"):
        bars = structures.truss([[0, 1], [1, 1], [2, 1]], [[0, 1], [1, 2]], **rods, mass=mass)
        rod = structures.rod(2, 2.0, **rods, mass=mass)
        along = bars.dofs([0, 1, 2], "ux")
        across = bars.dofs([0, 1, 2], "uy")
        K, M = bars.tangent().toarray(), bars.M.toarray()
        np.testing.assert_array_equal(K[np.ix_(along, along)], rod.K.toarray())
        assert not K[across].any()
        for dofs in (along, across):
            np.testing.assert_array_equal(M[np.ix_(dofs, dofs)], rod.M.toarray())


def test_at_rest_a_frame_has_mass_and_stiffness_of_the_linear_one():
    ours, linear = frame(), frame(structures.beam_frame, mass="lumped")
    assert largest(ours.tangent() - linear.K) < 20 * EPS * largest(linear.K)
    assert largest(ours.M - linear.M) < 4 * EPS * largest(linear.M)


# ---- bars -----------------------------------------------------------------------------------


@pytest.mark.parametrize("strain", ["engineering", "green"])
def test_a_bar_has_the_force_of_its_law(strain):
    EA, L, L0, N0, stretched = 50.0, 5.0, 4.8, 2.0, 5.7
    bar = structures.truss(
        [[0, 0], [3, 4]], [[0, 1]], EA=EA, rhoA=1.0, strain=strain, prestress=N0, unstressed=L0
    )
    direction = np.array([0.6, 0.8])
    f = bar.internal[0].residual(np.append([0.0, 0.0], (stretched - L) * direction))
    if strain == "engineering":
        N = EA * (stretched - L0) / L0 + N0
    else:
        N = (EA * (stretched**2 - L0**2) / (2 * L0**2) + N0) * stretched / L0
    np.testing.assert_allclose(f, np.append(-N * direction, N * direction), rtol=1e-14)


def test_a_shallow_arch_snaps_through_where_its_closed_form_has_its_maximum():
    EA, height, half = 100.0, 0.2, 1.0
    arch = structures.truss([[-1, 0], [0, height], [1, 0]], [[0, 1], [1, 2]], EA=EA, rhoA=1.0)
    top = arch.dofs(1, "uy")

    def state(y):
        u = np.zeros(arch.n)
        u[top] = y - height
        f, K, _, _ = arch.internal[0](u)
        return f[top[0]], K[top[0], top[0]]

    L0 = np.hypot(half, height)
    for y in (0.2, 0.15, 0.07, 0.0, -0.1):
        # 2 EA (l - L0) / L0 y / l
        length = np.hypot(half, y)
        assert state(y)[0] == pytest.approx(2 * EA * (length - L0) / L0 * y / length, abs=1e-13)
    # d/dy (y / L0 - y / l) = 1 / L0 - half^2 / l^3 = 0
    limit = np.sqrt((half**2 * L0) ** (2 / 3) - half**2)
    assert state(limit)[1] == pytest.approx(0.0, abs=1e-12)
    assert state(1.05 * limit)[1] > 0.0 > state(0.95 * limit)[1]


def test_an_unstressed_length_is_a_prestress_of_the_bar_shortened_to_it():
    line = {"points": [[0, 0, 0], [2, 0, 0]], "members": [[0, 1]], "EA": 50.0, "rhoA": 3.0}
    short = structures.truss(**line, unstressed=1.9, divisions=4)
    (force,) = short.internal
    f, K, _, _ = force(np.zeros(force.n))
    # N = 50 (2.0 - 1.9) / 1.9 in each of 4 pieces; across, a string of tension N: K = 2 N / h
    N = 50.0 * 0.1 / 1.9
    inside = short.dofs([2, 3, 4])
    assert f[short.dofs(1, "ux")] == pytest.approx(N, rel=1e-14)
    np.testing.assert_allclose(f[inside], 0.0, atol=1e-14 * N)
    across = short.dofs(3, ["uy", "uz"])
    np.testing.assert_allclose(K.toarray()[across, across], 2 * N / 0.5, rtol=1e-14)
    # mass is by the length between the points
    assert short.M.sum() == pytest.approx(3 * 3.0 * 2.0, rel=1e-14)


def test_a_slack_cable_carries_nothing_and_a_tight_one_is_a_bar():
    ends = {"points": [[0, 0], [1, 0]], "members": [[0, 1]], "EA": 10.0, "rhoA": 1.0}
    bar, cable = (structures.truss(**ends, slack=slack).internal[0] for slack in (False, True))
    for shift, is_tight in ((0.1, True), (-0.1, False), (-0.9, False)):
        u = np.array([0.0, 0.0, shift, 0.0])
        f, K, _, _ = cable(u)
        if is_tight:
            np.testing.assert_array_equal(f, bar.residual(u))
            np.testing.assert_array_equal(K.toarray(), bar(u)[1].toarray())
            assert cable.potential(u) == bar.potential(u) > 0.0
        else:
            assert not f.any() and not K.data.any() and cable.potential(u) == 0.0
            assert bar.residual(u)[2] < 0.0


def test_a_hanging_cable_has_the_shape_of_the_elastic_catenary():
    # Irvine, Cable Structures: with H at the lowest point and the arc s from it,
    # x = H s / EA + H / w asinh(w s / H), y = w s^2 / (2 EA) + sqrt((H / w)^2 + s^2)
    EA, w, H, half = 200.0, 3.0, 4.0, 2.0

    def catenary(s):
        x = H * s / EA + H / w * np.arcsinh(w * s / H)
        return np.column_stack([x, w * s * s / (2 * EA) + np.sqrt((H / w) ** 2 + s * s)])

    def error(pieces):
        ends = catenary(np.array([-half, half]))
        cable = structures.truss(
            ends, [[0, 1]], EA=EA, rhoA=1.0, divisions=pieces, unstressed=2 * half, slack=True
        )
        arcs = np.append([-half, half], np.linspace(-half, half, pieces + 1)[1:-1])
        load = np.zeros((len(arcs), 2))
        load[2:, 1] = -w * 2 * half / pieces
        free = np.arange(4, cable.n)
        exact = catenary(arcs)
        # from near the solution: a cable that is slack has no tangent
        start = (exact - cable.points).ravel()
        start[free] += 0.001 * np.sin(free)
        u = static(cable.internal[0], start, load.ravel(), free)
        return largest(cable.points + u.reshape(-1, 2) - exact)

    coarse, fine = error(10), error(20)
    # order 2 in the length of a piece; of length 4 and sag 1
    assert coarse < 0.01
    assert coarse / fine == pytest.approx(4.0, rel=0.05)


# ---- beams ----------------------------------------------------------------------------------


def cantilever(n, EI=2.0):
    return structures.corotational_frame(
        [[0, 0], [3, 0]], [[0, 1]], EA=500.0, EI=EI, rhoA=1.0, divisions=n
    )


def test_an_end_moment_rolls_a_cantilever_up_to_a_circle():
    n, EI, L = 12, 2.0, 3.0
    beam = cantilever(n, EI)
    load, u = np.zeros(beam.n), np.zeros(beam.n)
    free = np.delete(np.arange(beam.n), beam.dofs(0))
    for step in range(1, 7):
        load[beam.dofs(1, "rz")] = 2.0 * np.pi * EI / L * step / 6.0
        u = static(beam.internal[0], u, load, free, tol=1e-11)
    # constant moment: each element bends by M h / EI, which its linear law has exactly, and keeps
    # its length, so that the nodes are a regular polygon. Rounding over the smallest stiffness.
    nodes = np.concatenate([[0], np.arange(2, n + 1), [1]])
    turns = 2.0 * np.pi * np.arange(n + 1) / n
    np.testing.assert_allclose(u[beam.dofs(nodes, "rz")], turns, atol=1e-9)
    middles = (turns[1:] + turns[:-1]) / 2.0
    x = np.append(0.0, np.cumsum(L / n * np.cos(middles)))
    y = np.append(0.0, np.cumsum(L / n * np.sin(middles)))
    places = (beam.points + u.reshape(-1, 3)[:, :2])[nodes]
    np.testing.assert_allclose(places, np.column_stack([x, y]), atol=1e-9)
    assert np.hypot(x[-1], y[-1]) < 1e-14  # closed


def test_a_beam_coiled_up_five_times_is_held_by_a_moment():
    n, EI, L, turns = 30, 2.0, 3.0, 5.0
    beam = cantilever(n, EI)
    nodes = np.concatenate([[0], np.arange(2, n + 1), [1]])
    angles = 2.0 * np.pi * turns * np.arange(n + 1) / n
    middles = (angles[1:] + angles[:-1]) / 2.0
    steps = L / n * np.column_stack([np.cos(middles), np.sin(middles)])
    u = np.zeros((n + 1, 3))
    u[nodes, :2] = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]) - beam.points[nodes]
    u[nodes, 2] = angles
    f = beam.internal[0].residual(u.ravel()).reshape(-1, 3)
    moment = EI * 2.0 * np.pi * turns / L
    expected = np.zeros_like(f)
    expected[1, 2], expected[0, 2] = moment, -moment
    # rounding of angles up to 30, times EI / h, and of lengths, times EA / h
    np.testing.assert_allclose(f, expected, atol=1e-10)


def test_a_cantilever_under_a_tip_load_approaches_the_elastica():
    P, EI, EA, L = 2.0, 2.0, 1000.0, 3.0  # P L^2 / EI = 9
    arc = np.linspace(0.0, L, 41)

    def slopes(s, y):
        # the extensible elastica: EI theta' = P (x(L) - x), x' = (1 + P sin(theta) / EA) cos(theta)
        along = 1.0 + P * np.sin(y[0]) / EA
        dx = along * np.cos(y[0])
        return np.stack([y[1], -P / EI * dx, dx, along * np.sin(y[0])])

    shape = scipy.integrate.solve_bvp(
        slopes,
        lambda a, b: np.array([a[0], b[1], a[2], a[3]]),
        arc,
        np.array([arc / L, np.ones(41) / L, arc, 0.3 * arc]),
        tol=1e-10,
        max_nodes=100000,
    )
    assert shape.success
    angle, _, x, y = shape.y[:, -1]

    def error(n):
        beam = structures.corotational_frame(
            [[0, 0], [L, 0]], [[0, 1]], EA=EA, EI=EI, rhoA=1.0, divisions=n
        )
        free = np.delete(np.arange(beam.n), beam.dofs(0))
        load, u = np.zeros(beam.n), np.zeros(beam.n)
        for step in range(1, 11):
            load[beam.dofs(1, "uy")] = P * step / 10.0
            # rounding of EA / h
            u = static(beam.internal[0], u, load, free, tol=1e-10)
        return u[beam.dofs(1)] - [x - L, y, angle]

    coarse, fine = error(8), error(16)
    assert np.abs(coarse).max() < 0.002 * L
    # order 2 in the length of an element; along x both are below 2e-4, where other orders show
    np.testing.assert_allclose((coarse / fine)[1:], 4.0, rtol=0.05)
    assert np.abs(coarse[0]) < 2e-4


# ---- contact --------------------------------------------------------------------------------


def test_only_nodes_beyond_the_plane_are_pushed_back():
    bars = net(3)
    contact = structures.plane_contact(
        bars, [0, 1, 3], point=[0, 0, 0.1], normal=[0, 0, 4], stiffness=[10.0, 20.0, 30.0]
    )
    u = np.zeros(bars.n)
    u[bars.dofs([0, 1, 2], "uz")] = [-0.05, -0.05, -9.0]
    # heights 0.15, -0.05, not in contact, 1.0 over a plane at 0.1
    expected = np.zeros(bars.n)
    expected[bars.dofs(1, "uz")] = 20.0 * -0.15
    np.testing.assert_allclose(contact.residual(u), expected, atol=1e-14)
    touching = contact(u)[1].toarray()
    dof = bars.dofs(1, "uz")[0]
    assert touching[dof, dof] == 20.0 and np.count_nonzero(touching) == 1


@pytest.mark.parametrize("inside", [False, True])
def test_a_sphere_pushes_along_its_radius(inside):
    bars = net(3)
    contact = structures.sphere_contact(
        bars, [1, 2], center=[1, 1, 0], radius=2.0, stiffness=5.0, inside=inside
    )
    u = np.zeros(bars.n)
    place = np.array([1.0, 1.0, 0.0]) + (2.5 if inside else 1.5) * np.array([2.0, 1.0, 2.0]) / 3.0
    u[bars.dofs(1)] = place - bars.points[1]
    u[bars.dofs(2)] = (1.0 if inside else 9.0) - bars.points[2]  # free
    f = contact.residual(u).reshape(-1, 3)
    # the resisting force: k times the penetration, towards it
    sign = 1.0 if inside else -1.0
    np.testing.assert_allclose(f[1], sign * 2.5 * np.array([2.0, 1.0, 2.0]) / 3.0, atol=1e-14)
    assert not f[[0, 2, 3]].any()


def test_a_block_on_a_floor_has_its_weight_as_contact_force():
    stiff = structures.nonlinear_solid(2, 2, 0.5, structures.NeoHookean(100.0, 0.3), rho=1.0)
    ground = stiff.nodes_at(y=0.0)
    contact = structures.plane_contact(
        stiff, ground, point=[0, 0], normal=[0, 1], stiffness=[50.0, 100.0, 50.0]
    )
    whole = stiff.with_internal(contact)
    assert whole.internal == (stiff.internal[0], contact) and stiff.internal != whole.internal

    def total(u):
        values = [force(u) for force in whole.internal]
        return sum(v[0] for v in values), sum(v[1] for v in values), None, None

    load = np.zeros((9, 2))
    load[stiff.nodes_at(y=1.0), 1] = [-0.5, -1.0, -0.5]
    # one node is held sideways: nothing else is, without friction
    free = np.delete(np.arange(18), whole.dofs(ground[1], "ux"))
    start = np.zeros(18)
    start[1::2] = -0.001  # in contact
    u = static(total, start, load.ravel(), free)
    carried = contact.residual(u).reshape(-1, 2)
    assert -carried[:, 1].sum() == pytest.approx(2.0, rel=1e-12)
    # penetration 2 / 200 on average
    assert u[whole.dofs(ground, "uy")] @ [0.25, 0.5, 0.25] == pytest.approx(-0.01, rel=1e-12)


# ---- structures -----------------------------------------------------------------------------


def test_a_structure_sums_the_tangents_of_its_forces_and_damps_by_them():
    bars = net(2, prestress=1.0)
    other = net(2).internal[0]
    both = bars.with_internal(other)
    u = np.random.default_rng(4).uniform(-0.1, 0.1, bars.n)
    expected = bars.internal[0](u)[1] + other(u)[1]
    assert largest(both.tangent(u) - expected) == 0.0
    at_rest = bars.tangent() + other(np.zeros(bars.n))[1]
    C = both.damping(0.3, 0.2)
    assert largest(C - (0.3 * bars.M + 0.2 * at_rest)) <= 2 * EPS * largest(C)
    assert "2 internal forces" in repr(both) and "internal" not in repr(
        structures.chain(2, 1.0, 1.0)
    )


def test_a_structure_hands_its_forces_to_the_subdomain():
    structure = floor(sheet(structures.J2Plasticity(E, NU, 0.2)))
    steel = structure[0].with_internal(structure[1])
    subdomain = steel.subdomain(scheme=pm.Newmark(), name="steel")
    assert subdomain.n == steel.n and subdomain.name == "steel"
    for given, force in zip(subdomain.internal.forces, steel.internal, strict=True):
        assert given.evaluate is force
        np.testing.assert_array_equal(given.history, force.history)
        np.testing.assert_array_equal(given.pattern.toarray(), force.pattern.toarray())
        assert given.residual == force.residual
        assert given.potential == getattr(force, "potential", None)
    assert structures.chain(2, 1.0, 1.0).subdomain(scheme=pm.Newmark()).internal is None


def test_an_internal_force_of_the_user_is_added_to_those_of_the_structure():
    bars, spring = net(2), pm.CubicSpring([0], k=2.0, k3=1.0)
    own = pm.InternalForce(lambda t, u, v, q: (u**3, np.diag(3.0 * u**2)))
    for given, expected in ((own, [own]), ([own, spring], [own]), (None, [])):
        internal = bars.subdomain(scheme=pm.Newmark(), internal=given).internal
        assert [force for force in internal.forces[1:]] == expected
        assert internal.forces[0].evaluate is bars.internal[0]
        assert internal.springs == ((spring,) if isinstance(given, list) else ())


def test_forces_name_themselves_and_their_sizes():
    steel = block(structures.J2Plasticity(E, NU, 0.2)).internal[0]
    assert repr(steel) == "<SolidForce of 108 dofs, 672 of history>"
    assert repr(steel.reduced([1, 2])) == "<SolidForce of 108 dofs reduced to 2, 672 of history>"
    assert repr(net(2).internal[0]) == "<BarForce of 10 dofs>"


@pytest.mark.parametrize("name", ["beams", "sheet plastic"])
def test_the_check_of_tangents_that_users_have_agrees(name):
    _, force, u, q = case(name)
    found = pm.InternalForce(force, force.history, force.pattern).check(u, q=q)
    # its differences have about ten digits where the force is smooth
    assert found.error < 1e-7


# ---- refusals -------------------------------------------------------------------------------

SVK = structures.StVenantKirchhoff(1.0, 0.3)
RUBBER = structures.NeoHookean(1.0, 0.3)
LINE = {"points": [[0, 0], [1, 0]], "members": [[0, 1]], "EA": 1.0, "rhoA": 1.0}
BAR = structures.truss(**LINE)


def bar(**options):
    return structures.truss(**LINE | options)


def beam(**options):
    return structures.corotational_frame(**LINE | {"EI": 1.0} | options)


def cell(material=SVK, *, nodes=(0, 1, 2, 3), **options):
    points = [[0, 0], [1, 0], [1, 1], [0, 1]]
    return structures.nonlinear_solid_on(points, [nodes], material, rho=1.0, **options)


def steel(**options):
    return structures.J2Plasticity(**{"E": 1.0, "nu": 0.3, "yield_stress": 1.0} | options)


def regular(*arguments, **options):
    return structures.nonlinear_solid(*arguments, rho=1.0, **options)


def plane(nodes=0, **options):
    options = {"point": [0, 0], "normal": [0, 1], "stiffness": 1.0} | options
    return structures.plane_contact(BAR, nodes, **options)


def sphere(**options):
    options = {"center": [0, 0], "radius": 1.0, "stiffness": 1.0} | options
    return structures.sphere_contact(BAR, 0, **options)


@pytest.mark.parametrize(
    "call, text",
    [
        (lambda: bar(EA=0.0), "EA must be positive, got 0"),
        (lambda: bar(strain="log"), "strain must be 'engineering' or"),
        (lambda: bar(unstressed=-1.0), "unstressed must be positive"),
        (lambda: bar(mass="none"), 'mass must be "consistent" or'),
        (lambda: bar(prestress=[1.0, 2.0]), "prestress must be a num"),
        (lambda: bar(points=[[0.0], [1.0]]), r"points must have shape \(N, 2\) .* got \(2, 1\)"),
        (lambda: beam(EI=-1.0), "EI must be positive, got -1"),
        (lambda: beam(rotary=-1.0), "rotary must be finite and at least 0"),
        (lambda: cell(structures.StVenantKirchhoff(1.0, 0.5)), r"nu must lie in \(-1, 0.5\), got"),
        (lambda: cell(structures.NeoHookean(1.0, 0.5)), r"nu must lie in \(-1, 0.5\), got 0.5"),
        (lambda: cell(RUBBER, plane="stress"), "must be 'strain' for NeoHookean, got 'stress'"),
        (lambda: cell(steel(), plane="stress"), "must be 'strain' for J2Plasticity, got 'stress'"),
        (lambda: cell(plane="flat"), "plane must be 'strain' or 'stress', got 'flat'"),
        (
            lambda: cell(nodes=(0, 3, 2, 1)),
            "elements must be convex with corners in meshio's order",
        ),
        (lambda: regular(1, 1, 1, 1.0, SVK, t=0.1), "t and plane must not be given in three dim"),
        (lambda: regular(2, 1.0, SVK), r"needs two or three numbers of elements, got \[2\]"),
        (lambda: regular(2, 0, 1.0, SVK), "ny must be at least 1, got 0"),
        (lambda: cell(steel(yield_stress=0.0)), "yield_stress must be positive, got 0"),
        (lambda: cell(steel(kinematic=-2.0)), "kinematic must not be negative, got -2"),
        (lambda: plane(normal=[0, 0]), "normal must not be zero"),
        (lambda: plane(2), "nodes must lie in 0..1, got 2"),
        (lambda: plane([]), "nodes must not be empty"),
        (lambda: plane(point=[0, 0, 0]), r"point must have shape \(2,\), got \(3,\)"),
        (lambda: sphere(radius=0.0), "radius must be positive, got 0"),
        (lambda: sphere(stiffness=0.0), "stiffness must be positive, got 0"),
        (lambda: BAR.internal[0](np.zeros(3)), r"u must have shape \(4,\), got \(3,\)"),
        (lambda: BAR.internal[0](np.zeros(4), q=np.zeros(1)), r"q must have shape \(0,\), got"),
        (lambda: BAR.internal[0].reduced([4]), r"free must lie in 0..3, got 4"),
        (lambda: BAR.with_internal(net(2).internal[0]), "must have 4 rows, 2 for each of 2 points"),
    ],
)
def test_bad_input_is_refused_by_name(call, text):
    with pytest.raises(ValueError, match=text):
        call()


@pytest.mark.parametrize(
    "call, text",
    [
        (lambda: bar(slack=1), "slack must be True or False, got 1"),
        (lambda: cell("steel"), "material must be StVenantKirchhoff, .* J2Plasticity, got 'steel'"),
        (lambda: BAR.with_internal(lambda u: u), "internal must hold forces of elements"),
        (lambda: structures.nonlinear_solid(2, 0.5, rho=1.0), "needs nx, ny, h and a material"),
    ],
)
def test_input_of_another_type_is_refused_by_name(call, text):
    with pytest.raises(TypeError, match=text):
        call()


def test_numbers_of_elements_come_one_by_one_and_the_rest_also_by_name():
    for counts in ((2, 1), (2, 1, 3)):
        block = structures.nonlinear_solid(*counts, 0.5, RUBBER, rho=1.0)
        named = structures.nonlinear_solid(*counts, h=0.5, material=RUBBER, rho=1.0)
        assert (named.points == block.points).all() and (named.M != block.M).nnz == 0
        with pytest.raises(ValueError, match="needs two or three numbers of elements"):
            structures.nonlinear_solid(counts, 0.5, RUBBER, rho=1.0)


def test_an_assembly_takes_nodes_before_components_in_forces_and_tangents():
    """Element forces (E, a, d) like the rows of element tangents (E, a, d, a, d)."""
    elements = np.array([[0, 2], [2, 1], [1, 3]])
    assembly = Assembly(elements, 4, 2)
    tangents = np.random.default_rng(3).normal(size=(3, 2, 2, 2, 2))
    tangents += tangents.transpose(0, 3, 4, 1, 2)
    u = np.random.default_rng(4).normal(size=8)
    forces = np.einsum("eaibj,ebj->eai", tangents, u.reshape(4, 2)[elements])
    # rounding of sums of a dozen products
    np.testing.assert_allclose(assembly.force(forces), assembly.tangent(tangents) @ u, atol=1e-13)
