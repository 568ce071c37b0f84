"""Restoring forces (R2) and lagged damping (R4): evaluation, order, critical step."""

import traceback
from contextlib import nullcontext

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import in_turn, pairwise
from scipy.integrate import solve_ivp

import pmalpha as pm
from pmalpha import analysis

CD = pm.CentralDifference()
IMPLICIT = [pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(1.0), pm.Newmark(), pm.HHT(0.1)]
EXPLICIT = [pm.GeneralizedAlpha(0.5, explicit=True), CD]
SCHEMES = IMPLICIT + EXPLICIT


def names(scheme):
    return repr(scheme)


# ---- evaluation -----------------------------------------------------------------------------


class LoggedSpring:
    """A soft spring that logs the times of its evaluations and may fail at one of them."""

    def __init__(self, fail_at=None):
        self.times, self.seen, self.fail_at = [], [], fail_at

    def __call__(self, t, u, v):
        self.times.append(t)
        self.seen.append((u, v))
        if len(self.times) == self.fail_at:
            raise ArithmeticError("the actuator is at its end")
        return 0.1 * u**3 + 0.02 * v * np.abs(v)


def three_subdomains(forces, substeps, doubles, coupling, threads=1, dt=0.1, **start):
    """A chain of three subdomains, each with a restoring force."""
    schemes = [pm.GeneralizedAlpha(0.6), pm.GeneralizedAlpha(0.6, explicit=True), pm.Newmark()]
    start = start or {"u0": [0.3, 0.4]}
    subdomains = [
        pm.Subdomain(
            [1.0, 2.0],
            np.array([[3.0, -1.0], [-1.0, 1.0]]),
            scheme=scheme,
            substeps=ss,
            double_step=double,
            restoring=force,
            name=name,
            **start,
        )
        for scheme, ss, double, force, name in zip(schemes, substeps, doubles, forces, "ABC")
    ]
    a, b, c = subdomains
    ties = [pm.tie(a, [1], b, [1]), pm.tie(b, [0], c, [0])]
    return pm.Coupler(subdomains, ties, dt=dt, coupling=coupling, threads=threads)


CASES = [
    ((1, 1, 1), (None, None, None), "gc"),
    ((1, 6, 3), (None, None, None), "gc"),
    ((1, 1, 1), (True, None, False), "pm"),
    ((1, 6, 3), (True, False, True), "pm"),
    ((2, 6, 3), (True, False, True), "pm"),
]


@pytest.mark.parametrize("substeps, doubles, coupling", CASES)
def test_it_is_evaluated_once_at_the_start_and_once_per_substep_in_order(
    substeps, doubles, coupling
):
    springs = [LoggedSpring() for _ in range(3)]
    coupler = three_subdomains(springs, substeps, doubles, coupling)
    assert not any(d.times for d in springs)  # not evaluated before the first step
    coupler.run(steps=5)
    coupler.step(2)
    for spring, ss in zip(springs, substeps):
        fine = max(substeps)
        k = np.arange(7 * ss + 1) * (fine // ss)
        np.testing.assert_array_equal(spring.times, (k / fine) * 0.1)  # (T1)


@pytest.mark.parametrize("failing", range(3))
@pytest.mark.parametrize("substeps, doubles, coupling", CASES)
def test_after_an_exception_in_a_macro_step_the_run_continues_as_without_it(
    substeps, doubles, coupling, failing
):
    whole = three_subdomains([LoggedSpring() for _ in range(3)], substeps, doubles, coupling).run(
        steps=6
    )
    springs = [LoggedSpring() for _ in range(3)]
    springs[failing].fail_at = (
        1 + 2 * substeps[failing] + (substeps[failing] + 1) // 2
    )  # in the third
    coupler = three_subdomains(springs, substeps, doubles, coupling, threads=1 + failing)
    with pytest.raises(ArithmeticError, match="at its end") as caught:
        coupler.run(steps=6)
    assert "__call__" in [f.name for f in traceback.extract_tb(caught.value.__traceback__)]
    assert coupler.step_count == 2
    first = coupler.last_history
    rest = coupler.run(steps=4)
    for name in "ABC":
        for x in "uva":
            joined = np.vstack([getattr(first[name], x), getattr(rest[name], x)[1:]])
            np.testing.assert_array_equal(joined, getattr(whole[name], x))
    # the calls of the interrupted macro step are repeated, and no others
    ss, fine, times = substeps[failing], max(substeps), springs[failing].times
    all_times = list(np.arange(6 * ss + 1) * (fine // ss) / fine * 0.1)
    assert times == all_times[: springs[failing].fail_at] + all_times[1 + 2 * ss :]


def test_an_exception_at_the_start_reaches_the_caller_and_the_run_can_begin_again():
    spring = LoggedSpring(fail_at=1)
    subdomain = pm.Subdomain([1.0], [1.0], scheme=CD, restoring=spring, v0=[1.0])
    coupler = pm.Coupler([subdomain], dt=0.1)
    with pytest.raises(ArithmeticError):
        coupler.run(steps=3)
    assert coupler.step_count == 0
    assert coupler.run(steps=3)[0].u.shape == (4, 1)
    assert spring.times[:2] == [0.0, 0.0]


def test_it_receives_copies():
    def spoiling(t, u, v):
        r = u**3 + v
        kept.append((u, v, u.copy(), v.copy()))
        return r

    def spoiler(t, u, v):
        r = spoiling(t, u, v)
        u[:], v[:] = np.nan, np.inf
        return r

    kept = []
    made = {}
    for restoring in (spoiling, spoiler):
        subdomain = pm.Subdomain([1.0], [1.0], scheme=CD, restoring=restoring, v0=[1.0], u0=[0.2])
        made[restoring] = pm.solve(subdomain, dt=0.1, t_end=1.0).u
    np.testing.assert_array_equal(made[spoiling], made[spoiler])
    for u, v, copied_u, copied_v in kept[:11]:  # the arrays kept from the first call are unchanged
        assert u == copied_u and v == copied_v


def test_reset_evaluates_anew_and_keeps_the_force():
    spring = LoggedSpring()
    coupler = three_subdomains(
        [spring, LoggedSpring(), LoggedSpring()], (1, 2, 1), (None,) * 3, "pm"
    )
    first = coupler.run(steps=3)["A"].u
    coupler.reset()
    calls = len(spring.times)
    np.testing.assert_array_equal(coupler.run(steps=3)["A"].u, first)
    assert spring.times[calls:] == spring.times[:calls]


# ---- order ----------------------------------------------------------------------------------


def duffing(t, u, v):
    return u + u**3


def damped(t, u, v):
    return u + (0.2 + u**2) * v


def truth(restoring, t):
    def slope(t, x):
        return [x[1], -restoring(t, x[0], x[1])]

    # 1e-12: three digits below the smallest error measured here
    return solve_ivp(slope, (0.0, t), [1.0, 0.5], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


def whole(restoring, scheme, dt):
    subdomain = pm.Subdomain([1.0], None, scheme=scheme, restoring=restoring, u0=[1.0], v0=[0.5])
    return pm.Coupler([subdomain], dt=dt)


def cut(restoring, scheme, dt, coupling):
    """A third of the mass and force in one subdomain, the rest in an explicit one."""
    subdomains = [
        pm.Subdomain(
            [share],
            None,
            scheme=s,
            restoring=lambda t, u, v, share=share: share * restoring(t, u, v),
            u0=[1.0],
            v0=[0.5],
        )
        for share, s in ((1.0 / 3.0, scheme), (2.0 / 3.0, pm.GeneralizedAlpha(0.7, explicit=True)))
    ]
    return pm.Coupler(
        subdomains, pm.tie(subdomains[0], [0], subdomains[1], [0]), dt=dt, coupling=coupling
    )


def orders(make, restoring):
    """Orders in u and v over one halving."""
    u, v = truth(restoring, 4.0)
    errors = []
    for dt in (0.01, 0.005):
        coupler = make(dt)
        coupler.step(round(4.0 / dt))
        state = coupler.state(0)
        errors.append([abs(state.u[0] - u), abs(state.v[0] - v)])
    return np.log2(np.divide(*errors))


# 0.1: effect of the next power of the step on the order at these steps
@pytest.mark.parametrize(("scheme", "restoring"), in_turn(SCHEMES, duffing, damped))
def test_uncoupled_it_is_of_order_two(scheme, restoring):
    order = orders(lambda dt: whole(restoring, scheme, dt), restoring)
    np.testing.assert_allclose(order, 2.0, atol=0.1 if scheme.gamma == 0.5 else 0.15)


@pytest.mark.parametrize(
    ("scheme", "restoring", "coupling"),
    pairwise([pm.GeneralizedAlpha(0.5), pm.Newmark(), CD], [duffing, damped], ["gc", "pm"]),
)
def test_coupled_with_equal_steps_it_is_of_order_two(scheme, restoring, coupling):
    order = orders(lambda dt: cut(restoring, scheme, dt, coupling), restoring)
    np.testing.assert_allclose(order, 2.0, atol=0.2)


# ---- estimates ------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", IMPLICIT, ids=names)
def test_with_exact_estimates_a_linear_force_is_the_implicit_step(scheme):
    K, C = np.array([[3.0, -1.0], [-1.0, 1.0]]), np.array([[0.4, 0.1], [0.1, 0.3]])
    common = dict(scheme=scheme, u0=[0.5, -0.2], v0=[0.1, 0.0])
    linear = pm.Subdomain([1.0, 2.0], K, C=C, **common)
    restored = pm.Subdomain(
        [1.0, 2.0],
        None,
        restoring=lambda t, u, v: K @ u + C @ v,
        restoring_stiffness=K,
        restoring_damping=C,
        **common,
    )
    expected = pm.solve(linear, dt=0.5, t_end=20.0)
    # the same step in another order of operations, forty times
    np.testing.assert_allclose(pm.solve(restored, dt=0.5, t_end=20.0).u, expected.u, atol=1e-13)


@pytest.mark.parametrize("scheme", EXPLICIT, ids=names)
def test_with_an_exact_estimate_linear_damping_is_the_implicit_one(scheme):
    C = np.array([[0.4, 0.1], [0.1, 0.3]])
    common = dict(scheme=scheme, u0=[0.5, -0.2], v0=[0.1, 0.0])
    linear = pm.Subdomain([1.0, 2.0], [1.0, 2.0], C=C, **common)
    restored = pm.Subdomain(
        [1.0, 2.0], [1.0, 2.0], restoring=lambda t, u, v: C @ v, restoring_damping=C, **common
    )
    expected = pm.solve(linear, dt=0.5, t_end=20.0)
    np.testing.assert_allclose(pm.solve(restored, dt=0.5, t_end=20.0).u, expected.u, atol=1e-13)


def test_a_stiff_force_in_an_implicit_subdomain_needs_an_estimate_and_is_stable_with_it():
    def stiff(t, u, v):
        return 1e4 * u

    def run(**estimate):
        subdomain = pm.Subdomain(
            [1.0], None, scheme=pm.GeneralizedAlpha(0.5), restoring=stiff, u0=[1.0], **estimate
        )
        return np.abs(pm.solve(subdomain, dt=0.1, t_end=5.0).u[-1, 0])

    with pytest.warns(pm.StabilityWarning, match="too stiff for it"):
        assert run() > 1e6
    assert run(restoring_stiffness=[1e4]) < 1.0
    with (
        pytest.warns(pm.StabilityWarning, match="have added energy"),  # it swings up to 16
        pytest.warns(pm.AccuracyWarning, match="above the stiffness that its forces have had"),
    ):
        assert run(restoring_stiffness=[2e4]) < 1.0


def test_the_estimated_stiffness_counts_in_the_critical_step():
    def subdomain(**more):
        return pm.Subdomain([1.0], [3.0], scheme=CD, restoring=duffing, **more)

    assert analysis.critical_step(subdomain()) == pytest.approx(2.0 / np.sqrt(3.0), rel=1e-11)
    stiffer = subdomain(restoring_stiffness=[13.0])
    assert analysis.critical_step(stiffer) == pytest.approx(0.5, rel=1e-11)
    with pytest.warns(pm.StabilityWarning, match="critical step 0.5"):
        pm.Coupler([stiffer], dt=0.51)


# ---- lagged damping -------------------------------------------------------------------------


def damped_chain(n, scheme, damping="lagged", rayleigh=0.01, **more):
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return pm.Subdomain(np.ones(n), K, C=rayleigh * K, scheme=scheme, damping=damping, **more)


@pytest.mark.parametrize("scheme", SCHEMES, ids=names)
def test_lagged_damping_is_of_order_two(scheme):
    u0 = np.array([1.0, 0.0, -0.5])

    def error(dt):
        subdomain = damped_chain(3, scheme, rayleigh=0.3, u0=u0, v0=[0.0, 1.0, 0.0])
        coupler = pm.Coupler([subdomain], dt=dt)
        exact = analysis.exact_solution(coupler)(2.0)[0]["subdomain 0"]
        coupler.step(round(2.0 / dt))
        return max(
            np.abs(coupler.state(0).u - exact[0]).max(), np.abs(coupler.state(0).v - exact[1]).max()
        )

    # 0.15: effect of the next power of the step on the order
    assert np.log2(error(0.02) / error(0.01)) == pytest.approx(2.0, abs=0.15)


def test_an_explicit_subdomain_with_lagged_damping_has_no_factor():
    part = damped_chain(50, CD)
    lagged = pm.Coupler([part], dt=0.1)
    assert lagged._session.members[0].factors[0][1] is None  # R is the unit matrix
    implicit = pm.Coupler([damped_chain(50, CD, damping="implicit")], dt=0.1)
    assert implicit._session.members[0].factors[0][1] is not None


def plate(n, **more):
    """A square grid of n x n springs with stiffness-proportional damping, explicit."""
    line = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    K = sp.csr_array(sp.kron(line, sp.eye_array(n)) + sp.kron(sp.eye_array(n), line))
    return pm.Subdomain(np.ones(n * n), K, C=0.01 * K, scheme=CD, name="plate", **more)


def test_a_factor_that_is_most_of_an_explicit_step_is_warned_of_with_its_size_and_a_remedy():
    with pytest.warns(pm.PerformanceWarning, match="are not diagonal: C of 'plate'") as caught:
        pm.Coupler([plate(80)], dt=0.1)
    text = str(caught[0].message)
    assert "entries" in text and "MB" in text and 'damping="lagged"' in text
    assert "lump" not in text
    pm.Coupler([plate(80, damping="lagged")], dt=0.1)  # warnings are errors here
    n = 500
    M = np.eye(n) + 0.01
    with pytest.warns(pm.PerformanceWarning, match="M of .*.125250 entries, 1 MB.*lump the mass"):
        pm.Coupler([pm.Subdomain(M, np.ones(n), scheme=CD)], dt=0.1)


def test_a_factor_that_costs_little_is_not_warned_of():
    pm.Coupler([plate(12)], dt=0.1)
    pm.Coupler([damped_chain(400, CD, damping="implicit")], dt=0.1)
    n = 30_000  # a long chain: its factor is no longer than its matrix
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    pm.Coupler([pm.Subdomain(np.ones(n), K, C=0.1 * K, scheme=CD)], dt=0.1)


def radius(subdomain, h):
    above = h > analysis.critical_step(subdomain)
    with pytest.warns(pm.StabilityWarning) if above else nullcontext():
        return analysis.spectral_radius(
            analysis.amplification_matrix(pm.Coupler([subdomain], dt=h))
        )


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("rayleigh", [0.01, 0.3, 3.0])
def test_the_critical_step_with_lagged_damping_is_where_stability_ends(rho, rayleigh):
    subdomain = damped_chain(5, pm.GeneralizedAlpha(rho, explicit=True), rayleigh=rayleigh)
    h = analysis.critical_step(subdomain)
    # 1e-7: eigenvalues on the unit circle, some of them double at rho = 1
    assert radius(subdomain, h * 0.999) <= 1.0 + 1e-7
    assert radius(subdomain, h * 1.001) > 1.0 + 1e-5


def test_the_critical_step_is_sharp_for_damping_that_is_not_modal():
    rng = np.random.default_rng(3)
    for _ in range(10):
        K, C = (A @ A.T for A in rng.normal(size=(2, 4, 4)))
        M = rng.uniform(0.5, 2.0, 4)
        subdomain = pm.Subdomain(
            M, K, C=C, scheme=pm.GeneralizedAlpha(0.6, explicit=True), damping="lagged"
        )
        h = analysis.critical_step(subdomain)
        assert radius(subdomain, h * 0.999) <= 1.0 + 1e-9
        assert radius(subdomain, h * 1.001) > 1.0 + 1e-5


def test_the_critical_step_of_a_damped_oscillator_is_the_closed_form():
    for xi in (0.01, 0.1, 1.0):
        subdomain = pm.Subdomain([2.0], [18.0], C=[2.0 * xi * 6.0], scheme=CD, damping="lagged")
        expected = (2.0 * np.sqrt(1.0 + 4.0 * xi**2) - 4.0 * xi) / 3.0  # (C2), omega = 3
        assert analysis.critical_step(subdomain) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("scheme", IMPLICIT, ids=names)
def test_an_implicit_subdomain_with_lagged_damping_has_a_critical_step_too(scheme):
    subdomain = pm.Subdomain([1.0], [1e-6], C=[2.0], scheme=scheme, damping="lagged")
    h = analysis.critical_step(subdomain)
    assert radius(subdomain, h * 0.999) <= 1.0 + 1e-9
    assert radius(subdomain, h * 1.001) > 1.0 + 1e-4


def test_a_long_chain_has_the_same_critical_step_by_lanczos():
    n = 400
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    subdomain = pm.Subdomain(np.ones(n), K, C=0.1 * K, scheme=CD, damping="lagged")
    top = 2.0 - 2.0 * np.cos(np.pi * n / (n + 1))  # largest eigenvalue of K
    exact = (-0.4 * top + np.sqrt(0.16 * top**2 + 16.0 * top)) / (2.0 * top)  # (C2): Z_s = 1
    assert 0.997 * exact < analysis.critical_step(subdomain) <= exact


def test_a_step_above_the_critical_one_of_lagged_damping_warns():
    subdomain = pm.Subdomain([1.0], [1.0], C=[0.9], scheme=CD, damping="lagged")
    with pytest.warns(pm.StabilityWarning, match="critical step"):
        pm.Coupler([subdomain], dt=1.0)  # 1 + 4 * 0.9 > 4
    pm.Coupler([subdomain], dt=0.8)


# ---- bad input ------------------------------------------------------------------------------


def failing_coupler(restoring):
    subdomain = pm.Subdomain(
        [1.0, 1.0], None, scheme=CD, restoring=restoring, u0=[1, 2], name="rig"
    )
    return pm.Coupler([subdomain], dt=0.25)


@pytest.mark.parametrize(
    "value, error, text",
    [
        (np.zeros(3), ValueError, r"must have shape \(2,\), got \(3,\)"),
        (np.zeros((2, 1)), ValueError, "must be a 1-D array"),
        (1.0, ValueError, "must be a 1-D array"),
        ([1.0, np.nan], ValueError, r"must be finite, got nan at \[1\]"),
        ([np.inf, 1.0], ValueError, "must be finite"),
        (None, TypeError, "must hold real numbers"),
        ("ab", TypeError, "must hold real numbers"),
        ([1.0, 1j], TypeError, "must hold real numbers"),
        ([1.0, [2.0]], ValueError, "must be a regular array"),
    ],
)
def test_a_bad_value_is_an_error_that_names_subdomain_and_time(value, error, text):
    def bad_later(t, u, v):
        return u if t < 0.6 else value

    coupler = failing_coupler(bad_later)
    with pytest.raises(error, match=r"restoring of subdomain 'rig' at t = 0.75: .*" + text):
        coupler.run(steps=5)
    assert coupler.step_count == 2
    with pytest.raises(error, match=r"restoring of subdomain 'rig' at t = 0: .*" + text):
        failing_coupler(lambda t, u, v: value).step()


def test_a_force_that_calls_its_coupler_is_an_error_and_no_deadlock():
    calls = [
        lambda: coupler.step(),
        lambda: coupler.run(steps=1),
        lambda: coupler.state("rig"),
        lambda: coupler.reset(),
        lambda: coupler.multipliers,
    ]
    for call in calls:
        coupler = failing_coupler(lambda t, u, v: call())  # noqa: B023
        with pytest.raises(RuntimeError, match="being stepped"):
            coupler.step()
        assert coupler.step_count == 0


def test_a_force_may_step_another_coupler():
    inner = failing_coupler(duffing)

    def outer(t, u, v):
        inner.step()
        return inner.state(0).u

    expected = failing_coupler(duffing)
    expected.step(4)
    failing_coupler(outer).step(3)
    np.testing.assert_array_equal(inner.state(0).u, expected.state(0).u)


@pytest.mark.parametrize(
    "arguments, error, text",
    [
        (dict(restoring=3.0), TypeError, "must be callable or a list of springs, got 3.0"),
        (dict(restoring_stiffness=[1.0]), ValueError, "must come with a restoring force"),
        (dict(restoring_damping=[1.0]), ValueError, "must come with a restoring force"),
        (dict(restoring=duffing, restoring_stiffness=[1.0, 2.0]), ValueError, "must be of size 1"),
        (dict(restoring=duffing, restoring_damping=[np.nan]), ValueError, "must be finite"),
        (dict(damping="late"), ValueError, "damping must be 'implicit' or 'lagged', got 'late'"),
        (dict(damping=None), ValueError, "damping must be 'implicit' or 'lagged'"),
    ],
)
def test_bad_arguments_of_a_subdomain_are_errors(arguments, error, text):
    with pytest.raises(error, match=text):
        pm.Subdomain([1.0], [1.0], scheme=CD, **arguments)


def test_a_stiffness_may_be_missing_with_a_restoring_force_only():
    with pytest.raises(TypeError, match="K must be a matrix where there is no restoring force"):
        pm.Subdomain([1.0], None, scheme=CD)
    assert pm.Subdomain([1.0], None, scheme=CD, restoring=duffing).K is None


def test_lagged_damping_on_dofs_without_mass_is_refused():
    scheme = pm.GeneralizedAlpha(0.5)
    with pytest.raises(ValueError, match="damping must be 'implicit' where dofs have no mass"):
        pm.Subdomain([1.0, 0.0], [1.0, 1.0], C=[0.1, 0.1], scheme=scheme, damping="lagged")


def test_static_refuses_restoring_functions_which_may_be_specimens():
    with pytest.raises(ValueError, match="got a restoring function on 'rig'"):
        failing_coupler(duffing).static()


@pytest.mark.parametrize("call", [analysis.amplification_matrix, analysis.exact_solution])
def test_what_needs_a_linear_coupler_refuses_restoring_forces(call):
    with pytest.raises(ValueError, match="needs linear subdomains, got a restoring force on 'rig'"):
        call(failing_coupler(duffing))
