"""Point masses, springs, dampers, viscous boundaries and light nodes of structures."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import expm, inv

import pmalpha as pm
from pmalpha import structures

SCHEME = pm.GeneralizedAlpha(0.5)


def bar(n=4, **options):
    return structures.rod(n, float(n), EA=3.0, rhoA=2.0, **options)


def full(A):
    return np.diag(A) if A.ndim == 1 else A.toarray() if sp.issparse(A) else A


def test_masses_springs_and_dampers_are_added_to_the_matrices():
    plain = bar()
    made = plain.with_mass([1, 4], [5.0, 7.0]).with_spring([("ux 0", "ux 3")], k=2.0, c=0.5)
    made = made.with_damper(["ux 4"], 0.25)
    B = np.zeros((2, 5))
    B[0, [0, 3]], B[1, 4] = [1.0, -1.0], 1.0
    assert np.array_equal((made.M - plain.M).toarray(), np.diag([0.0, 5.0, 0.0, 0.0, 7.0]))
    assert np.array_equal((made.K - plain.K).toarray(), 2.0 * np.outer(B[0], B[0]))
    assert np.array_equal(made.C.toarray(), B.T @ np.diag([0.5, 0.25]) @ B)
    held = made.subdomain(scheme=SCHEME, fixed=[2])
    free = [0, 1, 3, 4]
    assert np.array_equal(held.C.toarray(), made.C.toarray()[np.ix_(free, free)])
    with_more = made.subdomain(scheme=SCHEME, C=np.ones(5))
    assert np.array_equal(with_more.C.toarray(), made.C.toarray() + np.eye(5))
    assert np.array_equal(made.element_forces().toarray(), plain.element_forces().toarray())


def test_the_rotation_of_a_node_gets_an_inertia():
    frame = structures.beam_frame([[0, 0], [2, 0]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0)
    added = (frame.with_mass(1, 3.0, inertia=0.5).M - frame.M).toarray()
    assert np.allclose(added, np.diag([0.0, 0.0, 0.0, 3.0, 3.0, 0.5]), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("labels", [[0, 0, 1, 1], [0, 1, 1, 2]])
def test_a_cut_structure_with_attachments_is_the_uncut_one(labels):
    made = bar(mass="lumped").with_mass([1, 2, 4], 5.0).with_spring([("ux 1", "ux 2")], 2.0, 0.3)
    made = made.with_spring(["ux 0", "ux 2"], 1.5).with_damper(["ux 4"], 0.25)
    cut = pm.cut(made, labels, scheme=SCHEME, dt=0.1)
    rng = np.random.default_rng(0)
    for name in ("M", "C", "K"):
        u, w = rng.normal(size=(2, 5))
        mine, others = cut.scatter(u), cut.scatter(w)
        got = sum(
            mine[s.name] @ full(getattr(s, name)) @ others[s.name]
            for s in cut.subdomains
            if getattr(s, name) is not None
        )
        assert got == pytest.approx(u @ getattr(made, name) @ w, rel=1e-12), name


def test_a_spring_between_two_subdomains_of_a_cut_is_refused_with_its_dof():
    made = bar().with_spring([("ux 0", "ux 4")], 2.0)
    with pytest.raises(ValueError, match="both ends in one subdomain, got one with dof 4"):
        pm.cut(made, [0, 0, 1, 1], scheme=SCHEME, dt=0.1)


@pytest.mark.parametrize("coupling, substeps", [("gc", 4), ("pm", 4), ("macro", 1)])
def test_a_spring_between_two_structures_ends_in_a_dof_without_mass(coupling, substeps):
    """It belongs to one of them, implicit, and its end is tied to the other one."""
    k, c = 300.0, 2.0
    spring, damper = k * np.array([[1.0, -1.0], [-1.0, 1.0]]), c * np.array([[1.0, -1.0], [-1, 1]])
    M, K = np.diag([2.0, 1.0]), spring + np.diag([80.0, 50.0])
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-inv(M) @ K, -inv(M) @ damper]])
    exact = (expm(state) @ [0.0, 0.0, 0.0, 1.0])[:2]
    scheme, errors = pm.GeneralizedAlpha(0.9), []
    for dt in (4e-3, 2e-3):
        one = pm.Subdomain(
            [2.0, 0.0],
            spring + np.diag([80.0, 0.0]),
            C=damper,
            scheme=scheme,
            substeps=substeps,
            v0=[0.0, 1.0],
        )
        other = pm.Subdomain([1.0], [50.0], scheme=scheme, v0=[1.0])
        tie = pm.tie(other, [0], one, [1])
        history = pm.Coupler([one, other], tie, dt=dt, coupling=coupling).run(1.0)
        errors.append(np.array([history[0].u[-1, 0], history[1].u[-1, 0]]) - exact)
    assert np.abs(exact).min() > 0.01
    # of order 2, the next term of relative size omega dt = 0.04 or less
    assert np.all(np.abs(np.log2(errors[0] / errors[1]) - 2.0) < 0.1)
    assert np.abs(errors[1]).max() < 1e-4


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.with_mass(0, -1.0), "mass must not be negative"),
        (lambda s: s.with_mass([0, 1], [1.0] * 3), r"mass must be a number or of shape \(2,\)"),
        (lambda s: s.with_mass(0, 1.0, inertia=1.0), "inertia needs nodes with 'rz'"),
        (lambda s: s.with_spring([9], 1.0), "dofs must lie in 0..4"),
        (lambda s: s.with_spring([0], 1.0, -1.0), "c must not be negative"),
        (lambda s: s.with_damping(np.ones((2, 2))), r"C must have shape \(5, 5\)"),
        (lambda s: s.with_damping(np.ones((5, 5))), "no entries between two nodes"),
        (lambda s: s.absorbing(0), "absorbing needs linear plates or solids"),
        (lambda s: s.lump(away_from=0), "lump needs a lumped mass"),
    ],
)
def test_what_cannot_be_attached_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call(bar())


# ---- viscous boundaries -------------------------------------------------------------------------


def soil(kind):
    if kind == "plate":
        return structures.plate(2, 3, [0.5, 1.0], E=2.0, nu=0.2, rho=1.5, t=0.7, plane="strain")
    return structures.solid(2, 2, 3, 0.5, E=2.0, nu=0.2, rho=1.5)


@pytest.mark.parametrize(("kind", "area"), [("plate", 0.7), ("solid", 1.0)])
def test_a_boundary_has_the_impedance_of_its_area(kind, area):
    s = soil(kind)
    base = s.nodes_at(**{"y" if kind == "plate" else "z": 0.0})
    C = s.absorbing(base).C
    mu, lam = 2.0 / 2.4, 2.0 * 0.2 / (1.2 * 0.6)
    c_p, c_s = np.sqrt((lam + 2.0 * mu) / 1.5), np.sqrt(mu / 1.5)
    for axis, speed in zip(s.components, [c_s] * (len(s.components) - 1) + [c_p]):
        motion = np.zeros(s.n)
        motion[s.dofs(np.arange(len(s.points)), axis)] = 1.0
        assert motion @ C @ motion == pytest.approx(area * 1.5 * speed, rel=1e-12)
    beyond = s.absorbing(base, rho=1.0, c_p=7.0, c_s=3.0).C
    assert beyond.diagonal().sum() == pytest.approx(
        area * (7.0 + 3.0 * (len(s.components) - 1)), rel=1e-12
    )


def test_on_an_inclined_side_the_impedance_turns_with_the_normal():
    points = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    s = structures.plate_on(points, [[0, 1, 2]], E=2.0, nu=0.0, rho=1.0, plane="strain")
    C = s.absorbing([0, 1], rho=1.0, c_p=4.0, c_s=2.0).C.toarray()
    normal, along = np.array([1.0, -1.0]) / 2.0**0.5, np.array([1.0, 1.0]) / 2.0**0.5
    half = 2.0**0.5 / 2.0
    expected = half * (4.0 * np.outer(normal, normal) + 2.0 * np.outer(along, along))
    assert np.allclose(C[:2, :2], expected, rtol=1e-14) and np.allclose(C[2:4, 2:4], expected)


def test_sides_between_elements_are_no_boundary():
    s = structures.plate(2, 1, 1.0, E=2.0, nu=0.0, rho=1.0)
    with pytest.raises(ValueError, match="nodes must be those of a boundary"):
        s.absorbing(s.nodes_at(x=1.0))


def test_a_side_between_elements_of_two_kinds_is_no_boundary():
    points = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    cells = {"quad": [[0, 1, 4, 3]], "triangle": [[1, 2, 4]]}
    mesh = SimpleNamespace(
        points=np.array(points),
        cells=[SimpleNamespace(type=kind, data=np.array(x)) for kind, x in cells.items()],
        cell_data={},
        cell_sets={},
        field_data={},
        point_data={},
        point_sets={},
    )
    s = structures.from_mesh(mesh, {"E": 2.0, "nu": 0.0, "rho": 1.0}, plane="strain")
    with pytest.raises(ValueError, match="nodes must be those of a boundary"):
        s.absorbing([1, 4])
    # all nodes: the circumference alone
    C = s.absorbing(range(5), c_p=1.0, c_s=1.0).C
    assert C.diagonal().sum() == pytest.approx(2.0 * (4.0 + 2.0**0.5), rel=1e-14)


@pytest.mark.parametrize("direction", [[1.0, 0.0], [0.0, 1.0]])
def test_a_wave_comes_in_is_doubled_at_the_free_end_and_leaves(direction):
    column = structures.plate(1, 40, 0.5, E=2.0, nu=0.3, rho=1.0, plane="strain", mass="lumped")
    across = "uy" if direction[0] else "ux"
    base = column.absorbing(column.nodes_at(y=0.0))
    h = 0.05
    t = h * np.arange(2000)
    pulse = np.exp(-(((t - 12.0) / 3.0) ** 2))  # three units of time: 8 elements or more
    made = column.with_damping(base.C).subdomain(
        scheme=pm.Newmark(),
        fixed=column.dofs(np.arange(len(column.points)), across),
        force=base.incident(pulse, direction, dt=h),
    )
    v = pm.solve(made, dt=h, t_end=95.0).v
    # dispersion of a mesh of 5 elements a pulse, of the shear wave: some per mille
    assert v.max() == pytest.approx(2.0, rel=5e-3)
    assert np.abs(v[-1]).max() < 5e-3


# ---- light nodes --------------------------------------------------------------------------------


def test_light_nodes_give_their_mass_to_their_neighbours():
    s = structures.plate(3, 2, 1.0, E=1.0, nu=0.0, rho=1.0, mass="lumped")
    nodes = s.nodes_at(y=0.0)
    light = s.lump(away_from=nodes, left=0.1)
    before, after = (x.M.diagonal().reshape(-1, 2) for x in (s, light))
    assert np.allclose(after[nodes], 0.1 * before[nodes], rtol=1e-14)
    assert after.sum() == pytest.approx(before.sum(), rel=1e-14)
    far = s.nodes_at(y=2.0)
    assert np.array_equal(after[far], before[far])
    with pytest.raises(ValueError, match="away_from must leave a neighbour"):
        s.lump(away_from=np.arange(len(s.points)))
    with pytest.raises(ValueError, match="left must be above 0 and below 1, got 1"):
        s.lump(away_from=nodes, left=1.0)


# ---- Timoshenko beams ---------------------------------------------------------------------------


def test_a_short_cantilever_has_the_deflection_of_bending_and_shear():
    L, EI, GA = 2.0, 3.0, 5.0
    for make in (structures.beam_frame, structures.corotational_frame):
        beam = make([[0, 0], [L, 0]], [[0, 1]], EA=1e3, EI=EI, rhoA=1.0, GA=GA)
        K = beam.tangent().toarray()[3:, 3:]
        u = np.linalg.solve(K, [0.0, 1.0, 0.0])
        assert u[1] == pytest.approx(L**3 / (3.0 * EI) + L / GA, rel=1e-12)
        assert u[2] == pytest.approx(L**2 / (2.0 * EI), rel=1e-12)


def test_without_shear_deformation_the_matrices_are_those_of_euler_and_bernoulli():
    points, members = [[0, 0], [3, 4], [6, 4]], [[0, 1], [1, 2]]
    options = dict(EA=50.0, EI=3.0, rhoA=2.0, divisions=2)
    plain = structures.beam_frame(points, members, **options)
    rigid = structures.beam_frame(points, members, GA=np.inf, **options)
    assert np.array_equal(plain.K.toarray(), rigid.K.toarray())
    assert np.array_equal(plain.M.toarray(), rigid.M.toarray())
    mixed = structures.beam_frame(points, members, GA=[np.inf, 7.0], **options)
    first = plain.dofs([0, 3])
    assert np.array_equal(
        mixed.K.toarray()[np.ix_(first, first)], plain.K.toarray()[np.ix_(first, first)]
    )


def test_the_mass_of_a_thick_beam_is_that_of_rigid_motions():
    EA, EI, rhoA, L = 20.0, 3.0, 2.0, 3.0
    beam = structures.beam_frame([[0, 0], [L, 0]], [[0, 1]], EA=EA, EI=EI, rhoA=rhoA, GA=4.0)
    moved, turned = np.array([0, 1, 0, 0, 1, 0.0]), np.array([0, 0, 1, 0, L, 1.0])
    M = beam.M.toarray()
    assert moved @ M @ moved == pytest.approx(rhoA * L, rel=1e-13)
    assert moved @ M @ turned == pytest.approx(rhoA * L**2 / 2.0, rel=1e-13)
    inertia = rhoA * L**3 / 3.0 + rhoA * EI / EA * L  # with that of the cross sections
    assert turned @ M @ turned == pytest.approx(inertia, rel=1e-13)


def test_frequencies_of_a_thick_beam_converge_to_those_of_timoshenko():
    # simply supported: rho^2 I / (k G) w^4 - (rho A + (rho I + E I rho / (k G)) a^2) w^2 + E I a^4
    L, EA, EI, rhoA, GA = 10.0, 8.0, 2.667, 3.2, 2.6
    rhoI = rhoA * EI / EA
    errors = []
    for n in (10, 20):
        beam = structures.beam_frame(
            [[0, 0], [L, 0]], [[0, 1]], EA=EA, EI=EI, rhoA=rhoA, GA=GA, divisions=n
        )
        fixed = [*beam.dofs(np.arange(n + 1), "ux"), *beam.dofs([0, 1], "uy")]
        held = pm.reduce(beam.M, beam.K, fixed=fixed)
        omega, _ = structures.modes(held.M, held.K, 3)
        a2 = (np.arange(1, 4) * np.pi / L) ** 2
        p = np.array([rhoI * rhoA / GA * np.ones(3), -(rhoA + (rhoI + EI * rhoA / GA) * a2)])
        square = (-p[1] - np.sqrt(p[1] ** 2 - 4.0 * p[0] * EI * a2**2)) / (2.0 * p[0])
        errors.append(abs(omega / np.sqrt(square) - 1.0))
    assert np.all(errors[1] < 5e-3)  # about (3 pi / 20)^2 / 60, of the third
    assert np.all(errors[1] < 0.3 * errors[0])  # order 2: shear and rotation of linear fields


@pytest.mark.parametrize("GA", [0.0, -1.0, [1.0, 2.0], np.nan])
def test_a_wrong_shear_stiffness_is_refused_by_name(GA):
    with pytest.raises(ValueError, match="GA must be positive numbers of shape"):
        structures.beam_frame([[0, 0], [1, 0]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0, GA=GA)


# ---- harmonic forces ----------------------------------------------------------------------------


def pair():
    a = pm.Subdomain([1.0, 0.5], [[3.0, -2.0], [-2.0, 2.0]], C=[0.1, 0.0], scheme=SCHEME, name="a")
    b = pm.Subdomain([1.0], [1.0], C=[0.2], scheme=SCHEME, name="b")
    return pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=0.1, coupling="gc")


def test_the_harmonic_motion_solves_the_equations_of_the_uncut_structure():
    f, omega = np.array([1.0, 0.5j]), np.array([0.0, 0.7, 2.0])
    x = pair().harmonic(omega, {"a": f})
    M, C = np.diag([1.0, 1.5]), np.diag([0.1, 0.2])
    K = np.array([[3.0, -2.0], [-2.0, 3.0]])
    for k, w in enumerate(omega):
        exact = np.linalg.solve(K + 1j * w * C - w**2 * M, f)
        assert np.allclose(x["a"][k], exact, rtol=1e-12)
        assert np.allclose(x["b"][k], exact[1:], rtol=1e-12)


def test_a_run_comes_to_the_harmonic_motion():
    force = lambda t: [np.cos(0.7 * t), 0.0]  # noqa: E731
    a = pm.Subdomain(
        [1.0, 0.5], [[3.0, -2.0], [-2.0, 2.0]], C=[0.1, 0.0], scheme=SCHEME, name="a", force=force
    )
    b = pm.Subdomain([1.0], [1.0], C=[0.2], scheme=SCHEME, name="b")
    history = pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=0.02, coupling="gc").run(200.0)
    amplitude = np.abs(history["b"].u[-1000:]).max()
    # 450 steps a period; what is left of the start: exp(-0.07 * 180)
    assert amplitude == pytest.approx(
        abs(pair().harmonic(0.7, {"a": [1.0, 0.0]})["b"][0, 0]), rel=2e-3
    )


@pytest.mark.parametrize(
    ("omega", "force", "error", "message"),
    [
        (-1.0, {"a": [1.0, 0.0]}, ValueError, "omega must not be negative"),
        (1.0, {"a": [1.0]}, ValueError, "force of 'a' must have"),
        (1.0, {"c": [1.0]}, (KeyError, ValueError), "'c'"),
    ],
)
def test_wrong_arguments_of_harmonic_are_refused_by_name(omega, force, error, message):
    with pytest.raises(error, match=message):
        pair().harmonic(omega, force)


def test_an_undamped_structure_at_resonance_is_refused():
    mass = pm.Subdomain([1.0], [4.0], scheme=SCHEME, name="mass")
    with pytest.raises(ValueError, match="omega must be no natural frequency .*, got 2"):
        pm.Coupler([mass], dt=0.1).harmonic(2.0, {"mass": [1.0]})
