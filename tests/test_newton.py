"""Internal forces in the core against the reference in NumPy, closed forms and DOP853."""

from dataclasses import replace

import newton_reference
import numpy as np
import pytest
import reference
from agreement import assert_order
from newton_coupled import assert_agrees, coupler, oracle, package
from newton_problems import (
    bilinear,
    chain,
    contact,
    cubic,
    duffing,
    duffing_exact,
    duffing_pair,
    springs,
)
from newton_reference import Nonlinear
from pairwise import pairwise
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import pmalpha as pm

# The chains take random steps: long for their periods, explicit ones near their limits.
pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

TIGHT = pm.Newton(tol=1e-10)
N = 4
V0 = np.random.default_rng(1).normal(size=2 * N - 1)
LAWS = {
    "cubic": (cubic(1.0, 1e4), None),
    "plastic": (bilinear(1e4, 0.005, 0.01), 0.0),
    "contact": (contact(1e2, 0.01, 1e6), None),
}
SCHEDULES = [
    *[("gc", False, ss) for ss in ((1, 1), (1, 5), (5, 1), (2, 6))],
    *[("pm", True, ss) for ss in ((1, 1), (1, 5), (5, 1), (2, 6))],
    *[("macro", False, ss) for ss in ((1, 1), (1, 5), (5, 1), (2, 6))],
    *[("macro", True, ss) for ss in ((1, 1), (1, 5))],
]


def twins(newton):
    """The same parameters for the reference."""
    return newton_reference.Newton(newton.tol, newton.iterations, newton.tangent)


def doubled(subdomains, double, ss):
    """Double steps on the coarser side, the first where both are equal."""
    coarse = int(ss[1] < ss[0])
    return [replace(s, double=double and i == coarse) for i, s in enumerate(subdomains)]


def both(subdomains, L, dt, steps, coupling, newton, **options):
    """The History of the package, and the Result of the reference."""
    ours = coupler(subdomains, L, dt, coupling, newton=newton, **options).run(steps=steps)
    return ours, oracle(coupling)(subdomains, L, dt, steps, twins(newton))


def iterations_agree(ours, theirs):
    for x, y in zip(ours, theirs.subdomains, strict=True):
        np.testing.assert_array_equal(x.iterations, y.iterations)


# ---- against the reference ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("coupling", "double", "ss", "tangent", "law"),  # as many again: test_newton_springs.py
    [
        (*schedule, ("full", "reuse")[(i + k) % 2], list(LAWS)[(i + k) % 3])
        for k in (0, 1)
        for i, schedule in enumerate(SCHEDULES[:: k + 1])
    ],
)
def test_chains_move_and_iterate_as_in_the_reference(coupling, double, ss, tangent, law):
    force, q = LAWS[law]
    rho = 0.0 if law == "contact" else 0.5  # docs/method.md, "Which rho"
    subdomains, L = chain(N, force, history=q, ss=ss, v0=V0, rho=rho)
    subdomains = doubled(subdomains, double, ss)
    steps = 9 if law == "plastic" else 4  # of which some time levels may iterate otherwise
    ours, theirs = both(subdomains, L, 0.01, steps, coupling, pm.Newton(tangent=tangent))
    # rounding, which the contact magnifies (omega h = 14). Under "macro" it is magnified by the
    # Broyden matrix too, whose updates divide by differences of small residuals
    assert_agrees(ours, theirs, 1e-9 if coupling == "macro" else 1e-11)
    if law == "cubic" or (law == "contact" and tangent == "full" and coupling != "macro"):
        iterations_agree(ours, theirs)
    else:
        # on a law of straight pieces a correction is exact: the next one is rounding, and so is
        # its slope, which decides whether it is taken back, at a few time levels
        for x, y in zip(ours, theirs.subdomains, strict=True):
            assert (x.iterations != y.iterations).mean() <= 0.1
            assert abs(x.iterations.sum() / y.iterations.sum() - 1.0) < 0.05


def with_dampers(internal):
    """Cubic dampers to the ground beside an internal force."""

    def evaluate(t, u, v, q):
        f, K_t, C_t, q1 = internal(t, u, v, q)
        return f + 0.3 * v**3, K_t, C_t + np.diag(0.9 * v**2), q1

    return evaluate


@pytest.mark.parametrize(
    ("coupling", "double", "ss", "rho"),
    [  # all values of rho in each coupling
        *[(*SCHEDULES[i], rho) for i in (0, 4, 9) for rho in (0.0, 0.8)],
        *[(*SCHEDULES[i], rho) for i in (1, 7, 13) for rho in (0.5, 1.0)],
    ],
)
def test_all_rho_with_dampers_loads_and_a_restoring_force(coupling, double, ss, rho):
    # every term of (N1) on both sides, sparse tangents of u and v
    subdomains, L = chain(N, cubic(50.0, 1e4), ss=ss, rho=rho, v0=V0)
    subdomains = doubled(subdomains, double, ss)
    for i, s in enumerate(subdomains):
        s.K, s.C = 30.0 * np.eye(N), 0.4 * np.eye(N) - 0.1 * np.ones((N, N)) / N
        s.force = lambda t, i=i: (5.0 + i) * np.sin(20.0 * t) * np.arange(1.0, N + 1)
        if coupling != "macro":  # which repeats its substeps
            s.restoring = lambda t, u, v: 2.0 * u**3 + 0.1 * v + t
        s.internal = with_dampers(s.internal)
    ours, theirs = both(subdomains, L, 0.01, 3, coupling, TIGHT, form="sparse")
    # as above, without a contact
    assert_agrees(ours, theirs, 1e-10 if coupling == "macro" else 1e-12)
    iterations_agree(ours, theirs)


@pytest.mark.parametrize(
    ("coupling", "tangent", "form"),
    pairwise(["gc", "pm", "macro"], ["full", "reuse"], ["dense", "sparse", "diagonal"]),
)
def test_tangents_of_every_form(coupling, tangent, form):
    n, rng = 4, np.random.default_rng(3)
    k, k3, c3 = (rng.uniform(low, 2.0 * low, (2, n)) for low in (20.0, 500.0, 0.5))
    subdomains = []
    for i, ss in enumerate((1, 3)):
        how = dict(internal=duffing(k[i], k3[i], c3[i]), substeps=ss, **reference.alpha(0.6))
        how |= dict(double=coupling == "pm" and i == 0)
        how |= dict(force=lambda t: 30.0 * np.sin(5.0 * t) * np.arange(1.0, n + 1))
        M = np.diag(rng.uniform(0.5, 1.5, n))
        subdomains.append(Nonlinear(M=M, K=np.zeros((n, n)), **how))
    L = [np.array([[1.0, 0.5, 0, 0], [0, 0, 1.0, 0]])]  # two rows
    L.append(-np.array([[0, 1.0, 0, 0], [0.5, 0, 0, 1.0]]))
    newton = pm.Newton(tangent=tangent)
    ours, theirs = both(subdomains, L, 0.05, 3, coupling, newton, form=form)
    assert_agrees(ours, theirs, 1e-10 if coupling == "macro" else 1e-12)  # as above
    iterations_agree(ours, theirs)


def three(coupling):
    """A plastic chain, its continuation as a linear subdomain, and a cubic explicit end."""
    law, q = LAWS["plastic"]
    (A, B), _ = chain(N, law, history=q, v0=V0)
    B.internal, B.history = None, np.zeros(0)
    B.K = 3e3 * (np.diag([1.0, 2.0, 2.0, 1.0]) - np.eye(N, k=1) - np.eye(N, k=-1))
    end = springs([(0, 1), (1, -1)], cubic(1e3, 1e4))
    how = dict(u0=[0.0, 0.05], v0=[V0[-1], 0.0], **reference.alpha(0.5, explicit=True))
    C = Nonlinear(M=np.diag([0.5, 1.0]), K=np.zeros((2, 2)), internal=end, **how)
    B.M[-1, -1] = 0.5
    double = coupling == "pm"
    ss = (2, 1, 6) if coupling != "macro" else (3, 1, 7)
    both = zip((A, B, C), ss, (double, double, False), strict=True)
    subdomains = [replace(s, substeps=x, double=y) for s, x, y in both]
    L = [np.zeros((2, len(s.M))) for s in subdomains]
    L[0][0, -1], L[1][0, 0], L[1][1, -1], L[2][1, 0] = 1.0, -1.0, 1.0, -1.0
    return subdomains, L


@pytest.mark.gate
@pytest.mark.parametrize(
    ("coupling", "tangent"), [("gc", "reuse"), ("pm", "full"), ("macro", "reuse")]
)
@pytest.mark.parametrize("iterated", [1, 3])
def test_three_subdomains_in_a_row_of_which_one_or_all_iterate(coupling, tangent, iterated):
    subdomains, L = three(coupling)
    if iterated == 3:
        K, zero = subdomains[1].K, np.zeros((N, N))

        def hardening(t, u, v, q):
            return K @ u + 1e4 * u**3, K + np.diag(3e4 * u**2), zero, q

        subdomains[1] = replace(subdomains[1], K=zero, internal=hardening)
        subdomains[2] = replace(subdomains[2], **reference.alpha(0.8))
    newton = pm.Newton(tangent=tangent)
    ours, theirs = both(subdomains, L, 0.01, 9 - iterated, coupling, newton, form="sparse")
    assert abs(ours["0"].q).max() > 5e-4  # it has yielded
    assert_agrees(ours, theirs, 1e-9 if coupling == "macro" else 1e-11)  # as above
    for i, x in enumerate(ours):
        assert x.iterations[1:].min() >= 1 if i < iterated else x.iterations is None


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_a_prescribed_motion_moves_an_internal_force(coupling):
    subdomains, L = chain(3, cubic(50.0, 1e3), ss=(1, 3))
    subdomains = doubled(subdomains, coupling == "pm", (1, 3))
    end = np.array([[0.0, 0.0, 1.0]])
    L = [np.vstack([L[0], 0.0 * end]), np.vstack([L[1], end])]

    def g(t):
        # zero up to 0.01, since the package takes the slope at t = 0 from differences
        return np.array([0.0, 1.0 - np.cos(8.0 * max(t - 0.01, 0.0))])

    ours = [package(s, name=str(i)) for i, s in enumerate(subdomains)]
    constraint = pm.Constraint(dict(zip(ours, L)), velocity=g)
    c = pm.Coupler(ours, constraint, dt=0.03, coupling=coupling, newton=TIGHT)
    history = c.run(steps=12)
    theirs = oracle(coupling)(subdomains, L, 0.03, 12, twins(TIGHT), g=g)
    assert abs(history["1"].u).max() > 0.2  # it moves as far as its spring hardens: 5e1, 1e3 u^2
    assert_agrees(history, theirs, 1e-9 if coupling == "macro" else 1e-11)  # as above


@pytest.mark.parametrize("law", LAWS)
def test_one_subdomain_alone(law):
    force, q = LAWS[law]
    (s, _), _ = chain(N, force, history=q, v0=V0, rho=0.0 if law == "contact" else 0.5)
    theirs = newton_reference.run([s], [np.zeros((0, N))], 0.01, 40).subdomains[0]
    ours = pm.solve(package(s), dt=0.01, t_end=0.4)
    np.testing.assert_array_equal(ours.iterations, theirs.iterations)
    for x, y in ((ours.u, theirs.u), (ours.v, theirs.v), (ours.a, theirs.w)):
        # rounding of 40 steps, magnified by the contact as above
        assert abs(x - y).max() < 1e-11 * abs(y).max()


@pytest.mark.parametrize("history", [None, 0.0], ids=["elastic", "plastic"])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_explicit_subdomains_evaluate_once(coupling, history):
    law = cubic(1e3, 1e5) if history is None else LAWS["plastic"][0]
    subdomains, L = chain(N, law, history=history, ss=(1, 5), v0=V0)
    subdomains[0].double = coupling == "pm"
    subdomains[1] = replace(subdomains[1], **reference.alpha(0.5, explicit=True))
    ours, theirs = both(subdomains, L, 0.01, 8, coupling, pm.Newton())
    assert_agrees(ours, theirs, 1e-9 if coupling == "macro" else 1e-11)  # as above
    calls = []
    law = subdomains[1].internal
    subdomains[1].internal = lambda *args: calls.append(args[0]) or law(*args)
    c = coupler(subdomains, L, 0.01, coupling)
    c.run(steps=4)
    times = [t for t in calls if t > 0.0]
    passes = 1 if coupling != "macro" else len(times) // 20
    assert len(times) == 20 * passes
    if coupling != "macro":
        np.testing.assert_array_equal(times, np.arange(1, 21) / 5 * 0.01)  # (T1)


def test_an_explicit_internal_force_is_a_restoring_force():
    def motion(**how):
        scheme = pm.GeneralizedAlpha(0.6, explicit=True)
        K = [[3.0, -1.0], [-1.0, 2.0]]
        s = pm.Subdomain([1.0, 2.0], K, scheme=scheme, u0=[1.0, -0.5], **how)
        return pm.solve(s, dt=0.02, t_end=1.0)

    def r(t, u, v):
        return u**3 + 0.1 * v

    one = motion(internal=lambda t, u, v, q: (r(t, u, v), 3.0 * u**2, np.full(2, 0.1)))
    other = motion(restoring=r)
    np.testing.assert_array_equal(one.u, other.u)
    np.testing.assert_array_equal(one.a, other.a)


# ---- without the reference ------------------------------------------------------------------


@pytest.mark.parametrize("coupling, double, ss", SCHEDULES[::3])
def test_linear_forces_given_as_internal_equal_the_linear_run(coupling, double, ss):
    rng = np.random.default_rng(8)
    subdomains, L = chain(N, cubic(400.0, 0.0), ss=ss, v0=V0, force=None)
    subdomains = doubled(subdomains, double, ss)
    linear = []
    for s in subdomains:
        A = rng.normal(size=(N, N))
        s.K, s.C = 30.0 * np.eye(N), np.diag(rng.uniform(0.1, 0.3, N))
        s.force = lambda t: 10.0 * np.cos(30.0 * t) * np.ones(N)
        K = s.internal(0.0, s.u0, s.v0, s.history)[1]
        C = 0.05 * A @ A.T
        s.internal = lambda t, u, v, q, K=K, C=C: (K @ u + C @ v, K, C, q)
        linear.append(replace(s, internal=None, K=s.K + K, C=s.C + C))
    ours = coupler(subdomains, L, 0.02, coupling, newton=TIGHT).run(steps=12)
    theirs = coupler(linear, L, 0.02, coupling).run(steps=12)
    # rounding of 12 steps; under "macro" 10 tol s, (N16), in each of them
    limit = 1e-8 if coupling == "macro" else 1e-12
    for x, y in zip(ours, theirs):
        for name in "uva":
            one, other = getattr(x, name), getattr(y, name)
            assert abs(one - other).max() < limit * abs(other).max(), name
        # the second correction is rounding: one iteration, and one more where it is estimated
        assert x.iterations.max() <= (4 if coupling != "macro" else 8)


@pytest.mark.parametrize("tangent", ["full", "reuse"])
@pytest.mark.parametrize("coupling", ["gc", "pm"])
def test_the_velocity_jump_is_rounding_after_every_fine_step(coupling, tangent):
    subdomains, L = chain(N, cubic(100.0, 1e4), ss=(3, 3), u0=np.linspace(0.0, 1.0, 2 * N)[1:] ** 2)
    subdomains[0].double = coupling == "pm"
    newton = pm.Newton(tol=1e-3, tangent=tangent)  # loose: it is equilibrium that is iterated
    history = coupler(subdomains, L, 0.2, coupling, newton=newton).run(steps=30)
    speed = max(abs(x.v).max() for x in history)
    jumps = sum(x.v @ Li.T for x, Li in zip(history, L))
    assert len(jumps) == 91 and history["0"].iterations.max() > 3
    # Lam times H is added to velocities of this size, twice
    assert abs(jumps).max() < 1e-13 * speed


@pytest.mark.parametrize(
    "coupling, ss, double, explicit, low, high",
    [
        # second terms of the errors are below 5 per cent of the slope at these steps
        ("gc", 1, False, True, 1.9, 2.1),
        ("pm", 1, True, False, 1.9, 2.1),
        ("gc", 4, False, False, 0.9, 1.1),
        ("gc", 4, False, True, 0.9, 1.1),
        ("pm", 4, True, True, 0.9, 1.4),  # falling towards 1, as for linear subdomains
        ("macro", 1, False, False, 1.9, 2.1),
        ("macro", 4, False, True, 1.9, 2.1),
        ("macro", 7, False, False, 1.9, 2.1),
        ("macro", 1, True, True, 1.9, 2.1),
    ],
)
def test_duffing_oscillators_have_the_order_of_linear_ones(
    coupling, ss, double, explicit, low, high
):
    errors = []
    for n in (100, 200):
        subdomains, L = duffing_pair(ss=(1, ss), double=double, explicit=explicit)
        t_end = 1.0 if coupling == "pm" and ss > 1 else 0.3  # which comes near its order later
        history = coupler(subdomains, L, 1.0 / n, coupling, newton=TIGHT).run(t_end)
        u, v = duffing_exact(history["0"].t)
        x = history["0"]
        errors.append([abs(x.u[:, 0] - u).max(), abs(x.v[:, 0] - v).max()])
    assert_order(errors, low, high, ["u of subdomain 0", "v of subdomain 0"])


@pytest.mark.parametrize(
    ("coupling", "double", "ss", "k"),
    [(*schedule, (-60, 40)[i % 2]) for i, schedule in enumerate(SCHEDULES[1::3])],
)
def test_the_unit_of_force_changes_no_bit(coupling, double, ss, k):
    # even powers of two: the Cholesky factor of H has their roots
    def scaled(unit):
        law, q = LAWS["plastic"]
        subdomains, L = chain(N, law, history=q, ss=ss, v0=V0)
        for i, s in enumerate(doubled(subdomains, double, ss)):
            internal = s.internal

            def evaluate(t, u, v, q, internal=internal):
                f, K_t, C_t, q1 = internal(t, u, v, q)
                return unit * f, unit * K_t, unit * C_t, q1

            one = unit * np.eye(N)
            changes = dict(M=unit * s.M, K=20.0 * one, C=0.2 * one, internal=evaluate)
            changes["force"] = lambda t: unit * 3.0 * np.sin(9.0 * t) * np.ones(N)
            subdomains[i] = replace(s, **changes)
        return coupler(subdomains, L, 0.01, coupling).run(steps=8)

    one, other = scaled(1.0), scaled(2.0**k)
    for x, y in zip(one, other):
        np.testing.assert_array_equal(x.iterations, y.iterations)
        for name in "uvaq":
            np.testing.assert_array_equal(getattr(x, name), getattr(y, name))
    np.testing.assert_array_equal(2.0**k * one.multipliers, other.multipliers)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("ss", "double", "low", "high"),
    [
        ((1, 4, 2), (True, False, True), 0.95, 1.4),  # falling towards 1
        ((2, 4, 1), (True, False, False), 0.95, 1.4),
        ((1, 1, 1), (True, True, False), 1.95, 2.05),
    ],
)
def test_three_subdomains_with_double_steps_of_several_substeps(ss, double, low, high):
    errors = []
    for n in (120, 240):
        (A, B), _ = duffing_pair()
        half = {"M": 0.5 * B.M, "internal": duffing(15.0, 30.0)}  # B is cut into two
        both = zip((A, replace(B, **half), replace(B, **half)), ss, double, strict=True)
        subdomains = [replace(s, substeps=x, double=y) for s, x, y in both]
        L = [np.array([[1.0], [1.0]]), np.array([[-1.0], [0.0]]), np.array([[0.0], [-1.0]])]
        x = coupler(subdomains, L, 1.0 / n, "pm", newton=TIGHT).run(steps=n // 2)["0"]
        u, v = duffing_exact(x.t)
        errors.append([abs(x.u[:, 0] - u).max(), abs(x.v[:, 0] - v).max()])
    assert_order(errors, low, high, ["u of subdomain 0", "v of subdomain 0"])


@pytest.mark.gate
def test_a_massless_dof_between_two_springs_is_condensed():
    # mass 1 at u, then k d + k3 d^3 with d = u - x, massless x, then 40 x: DOP853 of u alone
    def middle(u):
        return brentq(lambda x: 40.0 * x - 30.0 * (u - x) - 500.0 * (u - x) ** 3, -2, 2, xtol=1e-15)

    def evaluate(t, u, v, q):
        d = u[0] - u[1]
        f, k = 30.0 * d + 500.0 * d**3, 30.0 + 1500.0 * d**2
        return np.array([f, -f]), k * np.array([[1.0, -1.0], [-1.0, 1.0]])

    options = dict(t_eval=np.linspace(0.0, 1.0, 11), method="DOP853", rtol=1e-11, atol=1e-12)
    rates = lambda t, y: [y[1], -40.0 * middle(y[0])]  # noqa: E731
    exact = solve_ivp(rates, (0.0, 1.0), [0.8, 0.0], **options).y[0]
    how = dict(scheme=pm.GeneralizedAlpha(0.5), internal=evaluate, u0=[0.8, middle(0.8)])
    s = pm.Subdomain([1.0, 0.0], np.diag([0.0, 40.0]), **how)
    errors = []
    for n in (40, 80):
        u = pm.solve(s, dt=0.1 / n, t_end=1.0).u
        assert abs(40.0 * u[1:, 1] + [evaluate(0.0, x, x, None)[0][1] for x in u[1:]]).max() < 1e-6
        errors.append(abs(u[::n, 0] - exact).max())
    assert errors[1] < 1e-3 and 1.9 < np.log2(errors[0] / errors[1]) < 2.1
