"""The four laws of springs as internal forces: iterated, with consistent tangents and loops."""

from functools import partial

import numpy as np
import pytest
from agreement import assert_motion_agrees
from newton_problems import bilinear, chain, contact, cubic
from newton_reference import Newton, run, run_macro
from scipy.integrate import solve_ivp
from test_springs import bouc_wen_motion

import pmalpha as pm

# implicit chains in long steps on purpose
pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

N = 4
TRAPEZOIDAL = pm.Newmark()
LAWS = {"cubic": cubic(50.0, 1e4), "bilinear": bilinear(1e3, 0.05, 0.02)}
LAWS["gap"] = contact(1e2, 0.01, 1e4)


def springs(law, pairs):
    """The springs of the core with this law."""
    if law == "cubic":
        return pm.CubicSpring(pairs, k=50.0, k3=1e4)
    if law == "bilinear":
        return pm.Bilinear(pairs, k=1e3, fy=20.0, hardening=0.05)
    return [pm.CubicSpring(pairs, k=1e2, k3=0.0), pm.Gap(pairs, k=1e4, gap=0.01)]


SCHEDULES = {
    "gc": ("gc", False, (1, 1)),
    "gc, 5": ("gc", False, (1, 5)),
    "pm": ("pm", True, (1, 1)),
    "pm, 5": ("pm", True, (1, 5)),
    "macro": ("macro", False, (1, 1)),
    "macro, 2 and 6": ("macro", False, (2, 6)),
    "macro, double step": ("macro", True, (1, 5)),
}


def sides(springs, subdomains):
    """The package's twins of the two sides of `chain`, with springs in the core."""
    twins = []
    for side, s in enumerate(subdomains):
        # pairs of the chain, -1 the ground: d is that of the second dof less the first
        pairs = [(i, i - 1) for i in range(N)] if side == 0 else [(i + 1, i) for i in range(N - 1)]
        scheme = pm.GeneralizedAlpha(0.5)
        how = dict(substeps=s.substeps, double_step=s.double, v0=s.v0, force=s.force)
        how |= dict(internal=springs(pairs), name=str(side))
        twins.append(pm.Subdomain(s.M, None, scheme=scheme, **how))
    return twins


@pytest.mark.gate
@pytest.mark.parametrize(
    ("law", "tangent", "schedule"),
    [
        (list(LAWS)[(i + k) % 3], tangent, schedule)
        for i, schedule in enumerate(SCHEDULES)
        for k, tangent in enumerate(["full", "reuse"])
    ],
)
def test_springs_move_as_in_the_reference_and_record_their_loops(law, tangent, schedule):
    q = 0.0 if law == "bilinear" else None
    coupling, double, ss = SCHEDULES[schedule]
    v0 = 2.0 * np.random.default_rng(2).normal(size=2 * N - 1)
    subdomains, L = chain(N, LAWS[law], history=q, ss=ss, double=double, v0=v0)
    subdomains[1].force = lambda t: 5.0 * np.sin(20.0 * t) * np.ones(N)
    twins = sides(partial(springs, law), subdomains)
    constraint = pm.Constraint(dict(zip(twins, L)))
    newton = pm.Newton(tangent=tangent)
    c = pm.Coupler(twins, constraint, dt=0.02, coupling=coupling, newton=newton)
    history = c.run(steps=8, record_springs={"0": None, "1": None})

    oracle = run_macro if coupling == "macro" else run
    theirs = oracle(subdomains, L, 0.02, 8, Newton(tangent=tangent))
    # rounding, in another order of sums, magnified by contacts and Broyden's updates
    limit = 1e-8 if coupling == "macro" else 1e-10
    assert_motion_agrees(history, theirs, limit)
    # the recorded loops: deformation from u, force from the law and the plastic deformation
    x, y = history["0"], theirs.subdomains[0]
    d = np.diff(x.u, axis=1, prepend=0.0)
    np.testing.assert_allclose(x.deformation[:, :N], d, atol=1e-15)
    if law == "bilinear":
        f = 50.0 * d + 950.0 * (d - y.q)
        assert abs(y.q).max() > 1e-3  # it has yielded
    elif law == "cubic":
        f = 50.0 * d + 1e4 * d**3
    else:
        f = np.hstack([1e2 * d, 1e4 * np.maximum(d - 0.01, 0.0)])
    assert abs(x.force - f).max() < 10 * limit * abs(f).max()


def on_bouc_wen(share, scheme=TRAPEZOIDAL, **options):
    """A share of a mass on a Bouc-Wen spring under a load, as in test_springs.bouc_wen_motion."""
    spring = pm.BoucWen([0], k=share * 20.0, fy=share * 0.5, hardening=0.1, n=2.0)
    options["force"] = lambda t: [2.0 * share * np.sin(3.0 * t)]
    return pm.Subdomain([share], None, scheme=scheme, internal=spring, **options)


@pytest.mark.parametrize(
    "scheme", [TRAPEZOIDAL, pm.GeneralizedAlpha(0.6), pm.CentralDifference()], ids=repr
)
def test_a_mass_on_a_bouc_wen_spring_converges_with_order_two(scheme):
    times = np.linspace(0.0, 4.0, 41)
    exact = bouc_wen_motion(times)
    errors = []
    for n in (20, 40):
        history = pm.solve(on_bouc_wen(1.0, scheme), dt=0.1 / n, t_end=4.0)
        errors.append(abs(history.u[::n, 0] - exact).max())
        if history.iterations is not None:
            # the tangent is that of the integrated law: Newton's method is quadratic
            assert history.iterations.max() <= 4
    assert errors[1] < 1e-4
    # the law is not smooth where its velocity changes sign
    assert 1.7 < np.log2(errors[0] / errors[1]) < 2.3


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_bouc_wen_springs_in_two_subdomains_against_one(coupling):
    # halves of the mass and of the spring, tied: the springs see the same deformation
    whole = pm.solve(on_bouc_wen(1.0), dt=0.01, t_end=2.0)
    a, b = on_bouc_wen(0.25, double_step=False, name="a"), on_bouc_wen(0.75, name="b")
    c = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling=coupling)
    history = c.run(2.0, record_springs={"a": None, "b": None})
    # tol 1e-8 of the motion in each of 200 steps
    assert abs(history["a"].u - whole.u).max() < 1e-6 * abs(whole.u).max()
    three = 3.0 * history["a"].force
    assert abs(three - history["b"].force).max() < 1e-6 * abs(three).max()


def stop(**options):
    """A mass between two stops."""
    return pm.Subdomain([1.0], None, scheme=pm.GeneralizedAlpha(0.0), v0=[1.0], **options)


def test_a_ball_between_stiff_stops_in_steps_that_do_not_resolve_them():
    # omega h = 100; as a restoring force, evaluated once per step, it gains energy at once
    stops = pm.Gap([(0, -1), (-1, 0)], k=1e6, gap=0.1)
    v = pm.solve(stop(internal=stops), dt=0.1, t_end=20.0).v
    assert abs(v).max() <= 1.0 + 1e-12
    with pytest.raises(pm.InstabilityError):
        pm.solve(stop(restoring=stops), dt=0.1, t_end=20.0)


def test_a_stop_resolved_by_its_steps_is_half_a_period_of_its_spring():
    k, gap = 400.0, 0.1
    s = pm.Subdomain([1.0], None, scheme=pm.Newmark(), v0=[1.0], internal=pm.Gap([0], k=k, gap=gap))
    history = pm.solve(s, dt=5e-4, t_end=0.4)
    since, omega = history.t - gap, np.sqrt(k)
    inside = gap + np.sin(omega * since) / omega
    after = gap - (since - np.pi / omega)
    closed = (since > 0.0) & (omega * since < np.pi)
    exact = np.where(since <= 0.0, history.t, np.where(closed, inside, after))
    # (omega h)^2 / 12 = 8e-6 of pi for the period, and a part of a step, k h^2 / 8, of the momentum
    # at each end: 1e-5
    assert abs(history.u[:, 0] - exact).max() < 2e-5
    assert history.iterations.max() <= 4


@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_newton_is_quadratic_on_a_smooth_spring(dt):
    spring = pm.CubicSpring([0], k=20.0, k3=50.0)
    s = pm.Subdomain([1.0], None, scheme=pm.GeneralizedAlpha(0.8), internal=spring, u0=[1.0])
    history = pm.solve(s, dt=dt, t_end=3.0)
    assert 2 <= history.iterations[1:].max() <= 4

    def rates(t, y):
        return [y[1], -20.0 * y[0] - 50.0 * y[0] ** 3]

    options = dict(method="DOP853", rtol=1e-11, atol=1e-12, t_eval=history.t)
    exact = solve_ivp(rates, (0.0, history.t[-1]), [1.0, 0.0], **options).y[0]
    # order 2: (omega h)^2 of a phase of 30, omega up to 13
    assert abs(history.u[:, 0] - exact).max() < 0.5 * (13 * dt) ** 2 * 3.0
