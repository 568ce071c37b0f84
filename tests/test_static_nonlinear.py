"""Static equilibrium with springs and internal forces; a run from there stays at rest."""

import numpy as np
import pytest
from test_internal_input import compiled

import pmalpha as pm
from pmalpha import structures

IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.CentralDifference()


def held(structure, fixed, name, force, scheme=IMPLICIT, **options):
    """A subdomain of the dofs that are not fixed, under a load on all dofs."""
    reduction = pm.reduce(structure.M, structure.K, fixed=fixed)
    free = reduction.free
    internal = [f.reduced(free) for f in structure.internal]
    load = np.asarray(force)[free]
    return pm.Subdomain(
        reduction.M, None, scheme=scheme, internal=internal, force=load, name=name, **options
    ), free


def settled(structure, fixed, load, **options):
    """Displacements of all dofs of a structure in equilibrium."""
    s, free = held(structure, fixed, "structure", load)
    u = np.zeros(structure.n)
    u[free] = pm.Coupler([s], dt=0.01).static(**options)["structure"]
    return u


def require_rest(coupler, tolerance, steps=20):
    """Reset to the static solution and run; the motion is below the tolerance."""
    u0 = coupler.static()
    coupler.reset(u0=u0)
    history = coupler.run(steps=steps)
    size = max(np.abs(u).max() for u in u0.values())
    assert size > 0.0
    for x in history.subdomains:
        assert np.abs(x.u - u0[x.name]).max() <= tolerance * size
    return u0


# ---- closed forms and published numbers -----------------------------------------------------


def test_a_hardening_spring_carries_its_load():
    spring = pm.CubicSpring([0], 1.0, 1.0)
    for kind in ("internal", "restoring"):
        mass = pm.Subdomain([1.0], [2.0], scheme=IMPLICIT, force=[33.0], **{kind: spring})
        (u,) = pm.Coupler([mass], dt=0.1).static().values()
        np.testing.assert_allclose(u, [3.0 - 0.0], rtol=0.1)
        np.testing.assert_allclose(3.0 * u + u**3, [33.0], rtol=1e-14)


def cantilever(n, EI=1.0):
    beam = structures.corotational_frame(
        [[0, 0], [1, 0]], [[0, 1]], EA=1e6, EI=EI, rhoA=1.0, divisions=n
    )
    return beam, int(np.argmax(beam.points[:, 0]))


@pytest.mark.parametrize("turn", [0.5, 1.0])
def test_a_moment_bends_a_beam_into_a_circle(turn):
    """M = 2 pi turn EI / L, exactly a circle; a chord of n elements has the angle 2 pi turn / n."""
    n = 20
    beam, tip = cantilever(n)
    load = np.zeros(beam.n)
    load[beam.dofs(tip, "rz")] = 2.0 * np.pi * turn
    u = settled(beam, beam.dofs(0), load, steps=4)
    # corotational elements of constant curvature bend to 2 pi turn in the sum of rotations
    np.testing.assert_allclose(u[beam.dofs(tip, "rz")], 2.0 * np.pi * turn, rtol=1e-9)
    radius = 1.0 / (2.0 * np.pi * turn)
    x = beam.points[tip] + u[beam.dofs(tip)][:2]
    expected = radius * np.array([np.sin(2 * np.pi * turn), 1.0 - np.cos(2 * np.pi * turn)])
    # the chord of an element is L / n, the arc of the circle through its ends is longer by
    # (pi turn / n)^2 / 6: 0.4 per cent of the radius for a whole turn
    np.testing.assert_allclose(x, expected, atol=0.005 * radius)


@pytest.mark.gate
def test_the_elastica_under_a_tip_load():
    """P L^2 / EI = 10: Mattiasson (1981), by elliptic integrals, w/L = 0.81061, u/L = 0.55500."""
    beam, tip = cantilever(40)
    load = np.zeros(beam.n)
    load[beam.dofs(tip, "uy")] = 10.0
    u = settled(beam, beam.dofs(0), load)
    ux, uy, _ = u[beam.dofs(tip)]
    # 40 elements: error of order (1 / 40)^2 of the rotations
    np.testing.assert_allclose([uy, -ux], [0.81061, 0.55500], atol=5e-4)


def test_two_halves_of_a_beam_are_the_whole_beam():
    beam, tip = cantilever(8)
    load = np.zeros(beam.n)
    load[beam.dofs(tip, "uy")] = 5.0
    u = settled(beam, beam.dofs(0), load)
    options = {"EA": 1e6, "EI": 1.0, "rhoA": 1.0, "divisions": 4}
    left = structures.corotational_frame([[0, 0], [0.5, 0]], [[0, 1]], **options)
    right = structures.corotational_frame([[0.5, 0], [1, 0]], [[0, 1]], **options)
    load = np.zeros(right.n)
    load[right.dofs(1, "uy")] = 5.0
    a, own = held(left, left.dofs(0), "a", np.zeros(left.n))
    b = right.subdomain(scheme=IMPLICIT, force=load, substeps=2, name="b")
    joint = np.searchsorted(own, left.dofs(1))
    coupler = pm.Coupler([a, b], pm.tie(a, joint, b, right.dofs(0)), dt=1e-3, coupling="pm")
    halves = coupler.static()
    np.testing.assert_allclose(halves["b"][right.dofs(1)], u[beam.dofs(tip)], rtol=1e-10)
    np.testing.assert_allclose(halves["a"][joint], halves["b"][right.dofs(0)], atol=1e-14)


def cable(sag=0.0, **options):
    """A hanging cable of 8 pieces between (0, 0) and (2, 0), with its weight."""
    line = structures.truss(
        [[0, 0], [2, 0]], [[0, 1]], EA=1e3, rhoA=1.0, divisions=8, slack=True, mass="lumped",
        **options,
    )  # fmt: skip
    weight = np.zeros(line.n)
    weight[1::2] = -10.0 * line.M[1::2] if line.M.ndim == 1 else -10.0 * line.M.diagonal()[1::2]
    return held(line, line.dofs([0, 1]), "cable", weight), line


@pytest.mark.parametrize("options", [{"prestress": 5.0}, {"unstressed": 2.1}, {}])
def test_a_cable_hangs_so_that_its_force_carries_its_weight(options):
    """Also one that is longer than its span, or without force at first: a mechanism to begin."""
    (s, free), line = cable(**options)
    u = np.zeros(line.n)
    u[free] = pm.Coupler([s], dt=0.01).static()["cable"]
    f = line.internal[0].residual(u)
    # the weight of 2 rhoA g, less what the two ends carry themselves
    np.testing.assert_allclose(f[line.dofs([0, 1], "uy")].sum(), 10.0 * 2.0 * 7 / 8, rtol=1e-10)
    # the horizontal force is the same in all pieces, and the cable hangs by moment / H: parabola
    # in the nodes for equal weights per length of span, catenary else; symmetric in any case
    x = line.points + u.reshape(-1, 2)
    order = np.argsort(line.points[:, 0])
    np.testing.assert_allclose(x[order, 1], x[order[::-1], 1], atol=1e-10)
    H = abs(f[line.dofs(0, "ux")])
    moment = np.cumsum(10.0 * 0.25 * (3.5 - np.arange(8)) * np.diff(x[order, 0]))
    np.testing.assert_allclose(H * x[order, 1][1:], -moment, atol=1e-8)


def test_a_compiled_force_and_a_python_one_are_evaluated_together():
    """d + d^3 = 1 between the dofs, and u_1 + u_1^3 = 1 at the second one: both are the same."""

    def at_second(t, u, v, q):
        return np.array([0.0, u[1] + u[1] ** 3]), np.array([0.0, 1.0 + 3.0 * u[1] ** 2])

    internal = [compiled(history=[0.0]), at_second]
    a = pm.Subdomain(
        [1.0, 1.0], None, scheme=IMPLICIT, internal=internal, force=[1.0, 0.0], name="a"
    )
    u = pm.Coupler([a], dt=0.1).static()["a"]
    root = np.roots([1.0, 0.0, 1.0, -1.0])
    x = root[np.abs(root.imag) < 1e-12].real[0]
    np.testing.assert_allclose(u, [2.0 * x, x], rtol=1e-14)


# ---- at rest --------------------------------------------------------------------------------


def test_a_cable_stays_at_rest():
    (s, _), _ = cable(unstressed=2.05)
    # Newton's method leaves rounding; a displacement of 1 and weights of 1
    require_rest(pm.Coupler([s], dt=0.01), 1e-9)


@pytest.mark.gate
def test_a_bent_beam_of_two_subdomains_stays_at_rest():
    options = {"EA": 1e3, "EI": 1.0, "rhoA": 1.0, "divisions": 3}
    left = structures.corotational_frame([[0, 0], [0.5, 0]], [[0, 1]], **options)
    right = structures.corotational_frame([[0.5, 0], [1, 0]], [[0, 1]], **options)
    load = np.zeros(right.n)
    load[right.dofs(1, "uy")] = 3.0
    for coupling in ("pm", "gc", "macro"):
        a, own = held(left, left.dofs(0), "a", np.zeros(left.n))
        b = right.subdomain(scheme=IMPLICIT, force=load, substeps=2, name="b")
        joint = np.searchsorted(own, left.dofs(1))
        tie = pm.tie(a, joint, b, right.dofs(0))
        require_rest(pm.Coupler([a, b], tie, dt=0.01, coupling=coupling), 1e-9)


@pytest.mark.gate
@pytest.mark.parametrize("steps", [1, 5])
def test_a_plastic_solid_stays_at_rest(steps):
    """Pulled to beyond yield; load steps do not change which state it is."""
    steel = structures.J2Plasticity(200.0, 0.3, 0.3, isotropic=20.0)
    block = structures.nonlinear_solid(3, 2, 0.5, steel, rho=1.0, mass="lumped")
    load = np.zeros(block.n)
    load[block.dofs(block.nodes_at(x=1.5), "ux")] = 0.2
    s, _ = held(block, block.dofs(block.nodes_at(x=0.0)), "block", load)
    coupler = pm.Coupler([s], dt=0.05)
    u0 = coupler.static(steps=steps)
    np.testing.assert_allclose(u0["block"], coupler.static()["block"], atol=1e-13)
    require_rest(coupler, 1e-9)
    q = coupler.run(steps=1)["block"].q
    assert np.abs(q).max() > 1e-3  # it has yielded


LAWS = {
    "cubic": pm.CubicSpring([(0, 1)], 4.0, 30.0),
    "gap": pm.Gap([(0, 1)], 50.0, 0.05),
    "bilinear": pm.Bilinear([(0, 1)], 20.0, 0.5, 0.1),
    "Bouc-Wen": pm.BoucWen([(0, 1)], 20.0, 0.5, 0.1, n=2),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", ["internal", "restoring"])
@pytest.mark.parametrize("scheme", [IMPLICIT, EXPLICIT])
def test_springs_of_all_laws_stay_at_rest(law, kind, scheme):
    ends = dict(force=[2.0, 0.0], **{kind: LAWS[law]})
    a = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=scheme, name="a", **ends)
    b = pm.Subdomain([1.0], [3.0], scheme=IMPLICIT, name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=0.05, coupling="gc")
    u0 = require_rest(coupler, 1e-9)
    d = u0["a"][0] - u0["a"][1]
    # by hand: the spring carries 2 - u_0, which the other side takes with 1 + 3
    np.testing.assert_allclose(2.0 - u0["a"][0], 4.0 * u0["a"][1], rtol=1e-12)
    force = {
        "cubic": 4.0 * d + 30.0 * d**3,
        "gap": 50.0 * (d - 0.05),
        "bilinear": 2.0 * d + 18.0 * (0.5 / 20.0),
    }
    if law in force:
        np.testing.assert_allclose(2.0 - u0["a"][0], force[law], rtol=1e-12)


def test_an_equilibrium_is_found_again_from_itself():
    (s, _), _ = cable(prestress=5.0)
    coupler = pm.Coupler([s], dt=0.01)
    u0 = coupler.static()
    coupler.reset(u0=u0)
    np.testing.assert_allclose(coupler.static()["cable"], u0["cable"], atol=1e-13)


def test_a_prestressed_cable_without_load_stays_straight():
    line = structures.truss(
        [[0.1, 0.3], [2.0, 0.7]], [[0, 1]], EA=1e3, rhoA=1.0, divisions=7, prestress=5.0
    )
    s, _ = held(line, line.dofs([0, 1]), "cable", np.zeros(line.n))
    u = pm.Coupler([s], dt=0.01).static()["cable"]
    assert np.abs(u).max() < 1e-13  # rounding of the nodes over that of the prestress


def test_of_two_equilibria_the_one_near_to_the_initial_displacements_is_found():
    """A von Mises truss of two bars, before and after it has snapped through."""
    arch = structures.truss([[-1, 0], [0, 0.2], [1, 0]], [[0, 1], [1, 2]], EA=100.0, rhoA=1.0)
    fixed = arch.dofs([0, 2])
    for start, below in ((0.0, False), (-0.4, True)):
        s, _ = held(arch, fixed, "arch", np.zeros(arch.n), u0=[0.0, start + 0.01])
        u = pm.Coupler([s], dt=0.01).static()["arch"]
        np.testing.assert_allclose(u, [0.0, -0.4 if below else 0.0], atol=1e-9)


def test_units_of_force_do_not_matter():
    u = []
    for unit in (1.0, 2.0**40, 2.0**-60):
        spring = pm.CubicSpring([(0, 1)], 3.0 * unit, 50.0 * unit)
        stiff = unit * np.array([[1.0, 0.0], [0.0, 2.0]])
        a = pm.Subdomain(
            [1.0, 1.0], stiff, scheme=IMPLICIT, internal=spring, force=[unit, 0.0], name="a"
        )
        u.append(pm.Coupler([a], dt=1e-9 if unit > 1 else 0.1).static()["a"])
    np.testing.assert_array_equal(u[0], u[1])
    np.testing.assert_array_equal(u[0], u[2])


# ---- what has no equilibrium, and bad input -------------------------------------------------


@pytest.fixture
def few_load_steps(thresholds):
    """The search for an equilibrium is given up earlier."""
    thresholds(SMALLEST=0.5)


@pytest.mark.gate
@pytest.mark.usefixtures("few_load_steps")
def test_a_structure_that_only_an_open_stop_holds_is_floating():
    stop = pm.Gap([(-1, 0)], 100.0, 0.1)
    ball = pm.Subdomain([1.0], None, scheme=IMPLICIT, internal=stop, force=[1.0], name="ball")
    with pytest.raises(pm.FactorizationError, match="floating"):
        pm.Coupler([ball], dt=0.01).static()
    # pushed against it, it is held
    ball = pm.Subdomain([1.0], None, scheme=IMPLICIT, internal=stop, force=[-1.0], name="ball")
    u = pm.Coupler([ball], dt=0.01).static()["ball"]
    np.testing.assert_allclose(u, [-0.11], rtol=1e-12)


def test_an_equilibrium_that_is_not_stable_is_refused():
    """Exactly at the top of its snap-through a bar has no stiffness upwards."""
    arch = structures.truss([[-1, 0], [0, 0.2], [1, 0]], [[0, 1], [1, 2]], EA=100.0, rhoA=1.0)
    s, _ = held(arch, arch.dofs([0, 2]), "arch", np.zeros(arch.n), u0=[0.0, -0.2])
    with pytest.raises(pm.FactorizationError, match="indefinite"):
        pm.Coupler([s], dt=0.01).static()


@pytest.mark.gate
@pytest.mark.usefixtures("few_load_steps")
def test_a_load_above_the_strength_does_not_converge():
    joint = pm.Bilinear([0], 10.0, 1.0)
    mass = pm.Subdomain([1.0], None, scheme=IMPLICIT, internal=joint, force=[1.5], name="mass")
    with pytest.raises((pm.ConvergenceError, pm.FactorizationError)) as info:
        pm.Coupler([mass], dt=0.1).static()
    assert "mass" in str(info.value) or "floating" in str(info.value)


@pytest.mark.gate
def test_a_wrong_tangent_does_not_converge_and_the_subdomain_is_named():
    def wrong(t, u, v, q):
        return 50.0 * u + 50.0 * u**3, 1e-3 * np.ones(1)

    a = pm.Subdomain([1.0], None, scheme=IMPLICIT, internal=wrong, force=[5.0], name="wrong")
    b = pm.Subdomain([1.0], [1.0], scheme=IMPLICIT, name="b")
    coupler = pm.Coupler(
        [b, a], pm.tie(a, [0], b, [0]), dt=0.01, newton=pm.Newton(iterations=2), coupling="pm"
    )
    with pytest.raises(pm.ConvergenceError, match="of the static load") as info:
        coupler.static()
    assert info.value.subdomain == "wrong" and info.value.time == 0.0
    assert coupler.step_count == 0


def test_bad_arguments_and_exceptions_leave_the_coupler():
    def failing(t, u, v, q):
        if u[0] > 0.1:
            raise ZeroDivisionError
        return 4.0 * u, np.full(1, 4.0)

    mass = pm.Subdomain([1.0], None, scheme=IMPLICIT, internal=failing, force=[1.0], name="m")
    coupler = pm.Coupler([mass], dt=0.1)
    for bad, kind in ((0, ValueError), (1.5, TypeError), (-1, ValueError)):
        with pytest.raises(kind, match="steps"):
            coupler.static(steps=bad)
    with pytest.raises(ZeroDivisionError):
        coupler.static()
    coupler.step()


def test_the_coupler_is_unchanged():
    joint = pm.BoucWen([0], 20.0, 0.5)
    mass = pm.Subdomain([1.0], [1.0], scheme=IMPLICIT, internal=joint, force=[1.0], name="m")
    coupler, other = pm.Coupler([mass], dt=0.1), pm.Coupler([mass], dt=0.1)
    for c in (coupler, other):
        c.step(3)
    coupler.static()
    ours, theirs = coupler.run(steps=4), other.run(steps=4)
    assert ours["m"].u.tobytes() == theirs["m"].u.tobytes()


@pytest.mark.parametrize("seed", range(40))
def test_linear_structures_given_as_internal_forces_have_their_linear_equilibrium(seed):
    # also where constraints leave no motion, or where the first correction leaves but rounding
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    p = int(rng.integers(0, n + 1))
    A = rng.normal(size=(n, n))
    K = 10.0 ** rng.uniform(-3.0, 6.0) * (A @ A.T + 0.1 * np.eye(n))
    F = 10.0 ** rng.uniform(-3.0, 3.0) * rng.normal(size=n)
    L = np.eye(n)[rng.permutation(n)[:p]] if rng.integers(2) else rng.normal(size=(p, n))
    how = dict(scheme=pm.Newmark(), force=F, name="s")
    s = pm.Subdomain(np.ones(n), None, internal=lambda t, u, v, q: (K @ u, K), **how)
    u = pm.Coupler([s], [pm.Constraint({s: L})] if p else [], dt=0.01).static()["s"]
    saddle = np.block([[K, -L.T], [L, np.zeros((p, p))]])
    expected = np.linalg.solve(saddle, np.concatenate([F, np.zeros(p)]))[:n]
    # rounding of both solutions, of the displacement without constraints: condition numbers to 1e4
    free = np.abs(np.linalg.solve(K, F)).max()
    np.testing.assert_allclose(u, expected, rtol=0.0, atol=1e-11 * free)
