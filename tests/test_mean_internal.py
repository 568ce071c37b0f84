"""Mean coupling with internal forces, and discrete gradients, against an oracle and the energy."""

from dataclasses import dataclass

import numpy as np
import pytest
from agreement import assert_close, assert_constant, assert_small
from pairwise import pairwise
from scipy.integrate import solve_ivp
from scipy.optimize import root

import pmalpha as pm

TIGHT = pm.Newton(tol=1e-13)


# coarse steps, growing ones and double steps of rho = 1 are meant
pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")


# ---- an oracle: all substeps of a macro step and the multipliers, as one system of equations ----


@dataclass
class Body:
    """A subdomain with diagonal M and a force f(u, v) that has everything in it."""

    subdomain: pm.Subdomain
    M: np.ndarray
    force: object
    L: np.ndarray
    double: bool = False


def step(body, old, y, h):
    """(K2) from (u, v, w, a), with the equilibrium of an implicit or an explicit step."""
    s, (u, v, w, a) = body.subdomain.scheme, old
    d = 1.0 - s.am
    ut = u + h * v + h**2 * ((0.5 - s.beta / d) * a + s.beta * s.af / d * w + 0.5 * y)
    vt = v + h * ((1.0 - s.gamma / d) * a + s.gamma * s.af / d * w + y)
    al1, al2 = h**2 * s.beta * (1.0 - s.af) / d, h * s.gamma * (1.0 - s.af) / d
    if s.explicit:
        w1 = -body.force(ut, v + h * (w + y)) / body.M
    else:
        found = root(lambda x: body.M * x + body.force(ut + al1 * x, vt + al2 * x), w, tol=1e-14)
        w1 = found.x
    a1 = ((1.0 - s.af) * w1 + s.af * w - s.am * a) / d
    return ut + al1 * w1, vt + al2 * w1, w1, a1


def oracle(bodies, dt, steps):
    """u at the macro time levels of each body, and the multipliers (K6)."""
    u = [[np.asarray(b.subdomain.u0, float)] for b in bodies]
    states = []
    for b in bodies:
        zero = np.zeros(b.M.size)
        w = -b.force(u[len(states)][0], zero) / b.M
        states.append([(u[len(states)][0], zero, w, w)])
    lams = []

    def ends(lam, n):
        out = []
        for b, past in zip(bodies, states, strict=True):
            twice = b.double and n > 0
            pushed = 0.5 * (lams[-1] + lam) if twice else lam
            at, ss = past[-2 if twice else -1], b.subdomain.substeps
            for _ in range(ss):
                at = step(b, at, b.L.T @ pushed / b.M, (2.0 if twice else 1.0) * dt / ss)
            out.append(at)
        return out

    for n in range(steps):
        gap = lambda lam, n=n: sum(  # noqa: E731
            b.L @ x[0] for b, x in zip(bodies, ends(lam, n), strict=True)
        )
        start = lams[-1] if lams else np.zeros(len(bodies[0].L))
        scale = np.linalg.norm(gap(start + 1.0) - gap(start))  # (K6) in the unit of multipliers
        lam = root(lambda lam, g=gap, s=scale: g(lam) / s, start, tol=1e-14).x
        for past, now, own in zip(states, ends(lam, n), u, strict=True):
            past.append(now)
            own.append(now[0])
        lams.append(lam)
    return [np.array(x) for x in u], np.array(lams)


def two_bodies(schemes, substeps, double=False):
    """Hardening chains of two masses that share a mass; A has cubic damping."""
    K = np.array([[3.0, -1.0], [-1.0, 2.0]])

    def force_a(u, v):
        return K @ u + 4.0 * u**3 + 0.3 * v**3

    def internal_a(t, u, v, q):
        return 4.0 * u**3 + 0.3 * v**3, 12.0 * u**2, 0.9 * v**2

    def force_b(u, v):
        return 2.0 * K @ u + 2.0 * u**3

    def internal_b(t, u, v, q):
        return 2.0 * u**3, 6.0 * u**2

    a = pm.Subdomain(
        [1.0, 0.5], K, scheme=schemes[0], substeps=substeps[0], u0=[1.0, 0.3],
        double_step=double, internal=internal_a, name="a",
    )  # fmt: skip
    b = pm.Subdomain(
        [2.0, 1.0], 2.0 * K, scheme=schemes[1], substeps=substeps[1], u0=[0.3, -0.5],
        internal=internal_b, name="b",
    )  # fmt: skip
    bodies = [
        Body(a, np.array([1.0, 0.5]), force_a, np.array([[0.0, 1.0]]), double),
        Body(b, np.array([2.0, 1.0]), force_b, np.array([[-1.0, 0.0]])),
    ]
    return a, b, bodies


TRAPEZOIDAL = pm.Newmark()
EXPLICIT = pm.GeneralizedAlpha(0.6, explicit=True)


@pytest.mark.parametrize(
    ("schemes", "substeps", "double"),
    [
        ((TRAPEZOIDAL, TRAPEZOIDAL), (1, 1), False),
        ((TRAPEZOIDAL, TRAPEZOIDAL), (2, 5), False),
        ((pm.GeneralizedAlpha(0.7), EXPLICIT), (1, 4), False),
        ((pm.GeneralizedAlpha(0.8), TRAPEZOIDAL), (1, 3), True),
    ],
)
def test_the_coupled_steps_are_those_of_one_system_of_equations(schemes, substeps, double):
    a, b, bodies = two_bodies(schemes, substeps, double)
    tie, dt, steps = pm.tie(a, 1, b, 0), 0.1, 6
    history = pm.Coupler([a, b], tie, dt=dt, coupling="mean", newton=TIGHT).run(steps=steps)
    u, lam = oracle(bodies, dt, steps)
    at = {"times": history.macro_times}
    for i, s in enumerate((a, b)):
        found = history[s].u[:: s.substeps]
        # both solve to 1e-13 of the motion; one per cent of a force shows at 1e-3
        assert_close(found, u[i], 1e-9, f"displacement of {s.name!r}", **at)
    # multipliers are displacements over H, which is of the size of dt^2
    at["column"] = "constraint"
    found, times = history.multipliers[1:], history.macro_times[1:]
    assert_close(found, lam, 1e-7, "multiplier", times=times, column="constraint")
    assert_small(history.displacement_jump, 1e-12, "displacement jump", **at)


def test_a_linear_force_given_as_internal_is_the_linear_subdomain():
    K = np.array([[3.0, -1.0], [-1.0, 2.0]])
    runs = []
    for explicit in (False, True):
        scheme = pm.CentralDifference() if explicit else TRAPEZOIDAL
        for stiffness, internal in ((K, None), (None, lambda t, u, v, q: (K @ u, K))):
            a = pm.Subdomain(
                [1.0, 0.5], stiffness, scheme=scheme, substeps=3, u0=[1.0, 0.3],
                internal=internal, name="a",
            )  # fmt: skip
            b = pm.Subdomain([2.0], [1.0], scheme=TRAPEZOIDAL, u0=[0.3], name="b")
            coupler = pm.Coupler([a, b], pm.tie(a, 1, b, 0), dt=0.2, coupling="mean", newton=TIGHT)
            runs.append(coupler.run(steps=40, energy=True))
    for linear, iterated in (runs[:2], runs[2:]):
        for name in "ab":
            # the ties hold to 1e-13 of the motion, an acceleration has 1 / dt^2 in it
            np.testing.assert_allclose(iterated[name].u, linear[name].u, atol=1e-10)
            np.testing.assert_allclose(iterated[name].a, linear[name].a, atol=1e-8)
        interface = [run.energy.interface[-1] for run in (linear, iterated)]
        np.testing.assert_allclose(*interface, atol=1e-10)


@pytest.mark.gate
@pytest.mark.parametrize(("coupling", "double"), [("mean", False), ("mean", True), ("macro", True)])
def test_a_change_of_steps_keeps_the_order_with_internal_forces(coupling, double):
    ends = []
    for n in (1, 2, 4):
        a, b, _ = two_bodies((TRAPEZOIDAL, TRAPEZOIDAL), (1, 3), double)
        ties, dt = pm.tie(a, 1, b, 0), 0.05 / n
        coupler = pm.Coupler([a, b], ties, dt=dt, coupling=coupling, newton=TIGHT)
        coupler.step(5 * n)
        coupler.change_steps(dt=0.5 * dt, substeps={"b": 2})
        coupler.step(10 * n)
        coupler.change_steps(dt=dt)
        history = coupler.run(steps=5 * n)
        ends.append(np.array([*history["a"].u[-1], history["b"].u[-1, 1]]))
        if coupling == "mean":
            assert np.abs(history.displacement_jump).max() < 1e-12
    errors = np.abs(np.diff(ends, axis=0)).max(axis=1)
    # 1.9 to 2.1; without the rule for changed steps it is of order 1
    assert abs(np.log2(errors[0] / errors[1]) - 2.0) < 0.3


# ---- discrete gradients -----------------------------------------------------------------------


def total_energy(history):
    energy = history.energy
    return (energy.kinetic + energy.strain).sum(axis=1)


def duffing_pair(dt, substeps, coupling, gap=False, kind=pm.DiscreteGradient, **options):
    springs = [pm.CubicSpring([(0, 1)], k=1.0, k3=4.0)]
    stops = [pm.Gap([(0, -1), (-1, 0)], k=400.0, gap=0.4)] if gap else []
    a = pm.Subdomain(
        [1.0, 1.0], [1.0, 0.5], scheme=TRAPEZOIDAL, u0=[1.5, 0.7] if not gap else [0.5, 0.3],
        v0=[0.0, 0.0], substeps=substeps[0], internal=kind(springs + stops), name="a",
    )  # fmt: skip
    b = pm.Subdomain(
        [2.0, 1.0], [3.0, 1.0], scheme=pm.GeneralizedAlpha(1.0),
        u0=[0.7, 0.2] if not gap else [0.3, 0.2], substeps=substeps[1],
        internal=kind([pm.CubicSpring([(0, -1), (0, 1)], k=1.0, k3=4.0)]), name="b",
    )  # fmt: skip
    ties = pm.tie(a, 1, b, 0)
    return pm.Coupler([a, b], ties, dt=dt, coupling=coupling, newton=TIGHT, **options)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("coupling", "substeps", "steps", "gap"),
    [
        ("mean", (1, 1), 60, False),
        ("mean", (1, 5), 15, False),
        ("mean", (2, 3), 30, True),
        ("gc", (1, 1), 60, True),
    ],
)
def test_energy_is_exact_however_long_the_run_is(coupling, substeps, steps, gap):
    history = duffing_pair(0.05, substeps, coupling, gap).run(steps=steps, energy=True)
    total = total_energy(history)
    # the runs are iterated to 1e-13 of the motion
    at = {"times": history.energy.t}
    assert_constant(total, 5e-13, "energy", **at)
    balance = history.energy.balance
    assert_small(balance, 1e-12, "balance", size=total[0], column="subdomain", **at)
    assert np.ptp(history.energy.strain) > 0.1 * total[0]
    if gap:  # it touches now and then
        assert 0.1 < np.mean(np.abs(history["a"].u[:, 0]) > 0.4) < 0.9


@pytest.mark.gate
def test_the_mean_of_the_ends_does_not_conserve_what_the_discrete_gradient_does():
    spread = [
        np.ptp(total_energy(duffing_pair(0.05, (1, 3), "mean", kind=kind).run(1.0, energy=True)))
        for kind in (list, pm.DiscreteGradient)
    ]
    assert spread[0] > 1e-4 and spread[1] < 1e-12


@pytest.mark.gate
@pytest.mark.parametrize("substeps", [(1, 1), (2, 3)])
def test_discrete_gradients_are_of_order_two(substeps):
    def rates(t, y):
        u, v = y[:3], y[3:]
        ground, left, right = (d + 4.0 * d**3 for d in (u[1], u[0] - u[1], u[1] - u[2]))
        return [
            *v,
            -(u[0] + left),
            -(3.5 * u[1] - left + ground + right) / 3.0,
            -(u[2] - right),
        ]

    exact = solve_ivp(
        rates, (0.0, 0.5), [1.5, 0.7, 0.2, 0.0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    errors = []
    for dt in (0.05, 0.025):
        history = duffing_pair(dt, substeps, "mean").run(0.5)
        u = np.array([*history["a"].u[-1], history["b"].u[-1, 1]])
        v = np.array([history["a"].v[-1, 0], history["b"].v[-1, 1]])
        errors.append([np.abs(u - exact[:3]).max(), np.abs(v - exact[[3, 5]]).max()])
    # 2.00 by the errors themselves; the next term is of order 4
    assert np.all(np.abs(np.log2(np.divide(*errors)) - 2.0) < 0.1)


@pytest.mark.gate
def test_one_subdomain_conserves_energy_where_the_step_does_not_resolve_the_contact():
    stops = pm.DiscreteGradient(pm.Gap([(0, -1), (-1, 0)], k=1e6, gap=0.1))
    ball = pm.Subdomain([1.0], None, scheme=TRAPEZOIDAL, v0=[1.0], internal=stops, name="ball")
    coupler = pm.Coupler([ball], dt=0.03, newton=TIGHT)  # 30 radians of the contact in a step
    total = total_energy(coupler.run(9.0, energy=True))
    # residuals of up to 100 eps of the forces, 2 / 0.03, count as rounding (N8); they work over
    # 0.03 in each of 45 impacts: 2e-12
    assert np.ptp(total) < 2e-12


@pytest.mark.parametrize("seed", range(4))
def test_the_work_of_a_discrete_gradient_is_the_change_of_its_potential(seed):
    rng = np.random.default_rng(seed)
    springs = [
        pm.CubicSpring([(0, 1), (2, -1)], k=[2.0, 1.0], k3=[3.0, -0.5]),
        pm.Gap([(1, 2), (-1, 0), (0, -1)], k=[50.0, 20.0, 30.0], gap=[0.1, 0.0, 0.2]),
    ]
    force = pm.DiscreteGradient(springs)
    u0, u1 = rng.normal(size=(2, 3)) * 0.5
    f0, _, _, q = force(0.0, u0, None, force.history)
    # the gradient of the potential, by differences with an error of 1e-10
    h = 1e-5
    e = h * np.eye(3)
    gradient = [(force.potential(u0 + x) - force.potential(u0 - x)) / (2.0 * h) for x in e]
    np.testing.assert_allclose(f0, gradient, atol=1e-7)
    f1 = force(0.0, u1, None, q)[0]
    work = 0.5 * (f0 + f1) @ (u1 - u0)
    assert abs(work - (force.potential(u1) - force.potential(u0))) < 1e-13
    assert pm.InternalForce(force, force.history).check(u1, q=q).error < 1e-6


def test_discrete_gradients_of_other_springs_and_schemes_are_refused():
    with pytest.raises(TypeError, match="CubicSpring or Gap without c"):
        pm.DiscreteGradient(pm.Bilinear(0, k=1.0, fy=1.0))
    with pytest.raises(ValueError, match="at least one"):
        pm.DiscreteGradient([])
    spring = pm.DiscreteGradient(pm.CubicSpring(0, k=1.0, k3=1.0))
    assert repr(spring) == "<DiscreteGradient of 1 spring>"
    for scheme in (pm.GeneralizedAlpha(0.9), pm.CentralDifference(), pm.Newmark(0.3, 0.6)):
        with pytest.raises(ValueError, match="scheme must be the trapezoidal rule"):
            pm.Subdomain([1.0], [1.0], scheme=scheme, internal=spring)
    far = pm.DiscreteGradient(pm.CubicSpring(3, k=1.0, k3=1.0))
    with pytest.raises(ValueError, match="dofs of a CubicSpring"):
        pm.Subdomain([1.0], [1.0], scheme=TRAPEZOIDAL, internal=far)


def test_contact_that_opens_and_closes_has_the_limits_of_the_discrete_gradient():
    stop = pm.DiscreteGradient(pm.Gap(0, k=8.0, gap=0.5))
    started = stop(0.0, np.array([0.75]), None, stop.history)[3]  # closed, force 2
    for u1, mean in ((0.75, 2.0), (1.0, 3.0), (0.25, 8.0 * 0.25**2 / (2.0 * 0.5))):
        f, K, _, _ = stop(0.0, np.array([u1]), None, started)
        assert f[0] == pytest.approx(2.0 * mean - 2.0, abs=1e-14)
        assert K.nnz == 1


@pytest.mark.parametrize(
    ("dt", "v0", "ss"), pairwise([1e-3, 1e-2, 1e-1], [0.0, 1e-12, 1e-9], [(3, 1), (1, 3)])
)
def test_a_spring_at_rest_under_a_load_converges(dt, v0, ss):
    # f = u = F = 1: what is left in the constraint is rounding of displacements
    how = dict(scheme=pm.Newmark(), force=[1.0], u0=[1.0], v0=[v0])
    law = pm.CubicSpring([0], 1.0, 0.0)
    a = pm.Subdomain([1.0], None, internal=law, substeps=ss[0], **how)
    b = pm.Subdomain([1.0], [1.0], substeps=ss[1], **how)
    history = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling="mean").run(steps=30)
    # 30 steps of 100 units in the last place of u, and the motion itself
    assert abs(history[0].u - 1.0).max() <= 30 * 2.3e-14 + v0 * 30 * dt
    assert abs(history.displacement_jump).max() <= 2.3e-14 * 4.0
