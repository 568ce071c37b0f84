"""Prescribed motion: sum L_i v_i = g(t)."""

import numpy as np
import pytest
from agreement import assert_small
from scipy.integrate import solve_ivp

import pmalpha as pm

K_LINK = 4.0


def g(t):
    """A support at rest at t = 0 that starts with acceleration 1/2."""
    return np.array([np.cos(3.0 * t) - 1.0 + 0.5 * t])


def moved(t):
    """Its displacement, the integral of g."""
    return np.sin(3.0 * t) / 3.0 - t + 0.25 * t * t


def driven(velocity, dt, *, support_mass=1.0, scheme=None, coupling="pm"):
    """A driven end that pulls a unit mass by a spring."""
    a = pm.Subdomain(
        [support_mass, 1.0],
        [[K_LINK, -K_LINK], [-K_LINK, K_LINK]],
        scheme=scheme or pm.GeneralizedAlpha(0.5),
        name="a",
    )
    return pm.Coupler([a], pm.Constraint({a: [[1.0, 0.0]]}, velocity=velocity), dt=dt)


def exact(t_end):
    def rate(t, y):
        return [y[1], -K_LINK * (y[0] - moved(t))]

    return solve_ivp(rate, (0.0, t_end), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14).y


@pytest.mark.parametrize("mass", [1.0, 0.0])
@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_a_driven_mass_converges_with_order_two(mass, rho):
    u, v = exact(2.0)[:, -1]
    errors = []
    for n in (40, 80):
        scheme = pm.GeneralizedAlpha(rho)
        h = driven(g, 2.0 / n, support_mass=mass, scheme=scheme).run(2.0)["a"]
        errors.append([abs(h.u[-1, 1] - u), abs(h.v[-1, 1] - v)])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.1)  # the next term of the error is of relative size dt


def test_an_explicit_subdomain_with_substeps_follows_a_driven_end_too():
    u = exact(2.0)[0, -1]
    a = pm.Subdomain([1.0, 0.5], [0.0, 0.0], scheme=pm.GeneralizedAlpha(0.5), name="a")
    k = np.array([[K_LINK, -K_LINK], [-K_LINK, K_LINK]])
    b = pm.Subdomain(
        [1.0, 0.5], k, scheme=pm.GeneralizedAlpha(0.5, explicit=True), substeps=4, name="b"
    )
    errors = []
    for n in (200, 400, 800):
        drive = pm.Constraint({a: [[1.0, 0.0]]}, velocity=g)
        history = pm.Coupler(
            [a, b], [pm.tie(a, [0, 1], b, [0, 1]), drive], dt=2.0 / n, coupling="pm"
        ).run(2.0)
        errors.append(abs(history["b"].u[-1, 1] - u))
        # every row, prescribed or not, is satisfied to rounding at every fine step
        at = {"times": history.multiplier_times, "column": "constraint"}
        assert_small(history.velocity_jump, 1e-12, "velocity jump", **at)
    assert errors[0] > errors[1] > errors[2]
    # first order with substeps: at least 2 and at most 4 times less when the step is a quarter
    assert 3.0 < errors[0] / errors[2] < 18.0


def test_the_first_multiplier_and_acceleration_follow_from_the_derivative_of_g():
    coupler = driven(g, 0.05)
    # at rest only the driven mass accelerates: Lam_0 = m g'(0) = 1/2; g' by a difference of order 2
    # over 0.05 / 8: error (0.05/16)^2 * |g'''| * 2/3 with |g'''(0)| = 0, so the next term, 1e-6
    np.testing.assert_allclose(coupler.multipliers, [0.5], rtol=3e-6)
    np.testing.assert_allclose(coupler.state("a").a, [0.5, 0.0], rtol=3e-6)


def test_samples_and_a_function_of_the_same_motion_agree():
    times = 0.01 * np.arange(300)
    samples = np.array([g(t)[0] for t in times])
    by_samples = driven(pm.SampledForce(samples, 0.01), 0.01).run(2.0)
    by_function = driven(lambda t: [np.interp(t, times, samples)], 0.01).run(2.0)
    # they differ by the derivative at t = 0 only when the step is that of the samples: the
    # difference quotient has the same straight line, up to rounding over 0.01 / 8
    np.testing.assert_allclose(by_samples["a"].u, by_function["a"].u, atol=1e-12)


SAMPLES = 0.01 * np.arange(300)[:, None]
FACTOR = 1024.0  # a power of two: the quotients are exact


@pytest.mark.parametrize(
    "velocity",
    [
        lambda f: np.array([0.25 * f]),
        lambda f: pm.SampledForce(f * SAMPLES, 0.01),
        lambda f: pm.SampledForce(SAMPLES[:, 0], 0.01, np.array([f])),
        lambda f: lambda t: f * g(t),
    ],
    ids=["constant", "samples", "shape", "function"],
)
def test_a_row_times_a_factor_moves_with_the_velocity_times_that_factor(velocity):
    u0 = [0.0, 0.0]
    runs = []
    for factor in (1.0, FACTOR):
        v0 = [0.25 if isinstance(velocity(1.0), np.ndarray) else 0.0, 0.0]
        a = pm.Subdomain(
            [1.0, 1.0],
            [[K_LINK, -K_LINK], [-K_LINK, K_LINK]],
            scheme=pm.GeneralizedAlpha(0.5),
            u0=u0,
            v0=v0,
            name="a",
        )
        drive = pm.Constraint({a: [[factor, 0.0]]}, velocity=velocity(factor))
        runs.append(pm.Coupler([a], drive, dt=0.01).run(1.0))
    by_one, by_factor = runs
    assert abs(by_one["a"].u[-1, 0]) > 0.1  # it moves
    np.testing.assert_array_equal(by_one["a"].u, by_factor["a"].u)
    np.testing.assert_array_equal(by_one.multipliers, FACTOR * by_factor.multipliers)


def test_a_function_is_evaluated_once_at_every_fine_step_and_near_the_start():
    times = []

    def velocity(t):
        times.append(t)
        return g(t)

    a = pm.Subdomain([1.0, 1.0], np.eye(2), scheme=pm.GeneralizedAlpha(0.5))
    b = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), substeps=4)
    ties = [pm.tie(a, [1], b, [0]), pm.Constraint({a: [[1.0, 0.0]]}, velocity=velocity)]
    coupler = pm.Coupler([a, b], ties, dt=0.1, coupling="pm")
    assert not times  # creating a coupler calls no function of the user
    coupler.run(steps=3)
    later = [t for t in times if t > 0.1 / 4 / 8]
    np.testing.assert_array_equal(later, [(k / 4) * 0.1 for k in range(1, 13)])


def test_supports_that_move_apart_stretch_what_is_between_them():
    # by hand: two driven ends at +-v, the middle stays and both springs stretch by v t
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    a = pm.Subdomain(np.ones(3), K, scheme=pm.Newmark(), v0=[-0.5, 0.0, 0.5])
    ends = pm.Constraint({a: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}, velocity=[-0.5, 0.5])
    history = pm.Coupler([a], ends, dt=0.01).run(1.0)
    np.testing.assert_allclose(history[0].u[-1], [-0.5, 0.0, 0.5], atol=1e-13)
    np.testing.assert_allclose(history.multipliers[-1], [-0.5, 0.5], atol=1e-12)  # spring force
