"""Runs that end at a condition: closed forms, events of SciPy, and runs to that time."""

import numpy as np
import pytest
from agreement import assert_identical, assert_same_levels
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import pmalpha as pm
from pmalpha import models


def pair(coupling):
    soft = pm.GeneralizedAlpha(0.8)
    frame = pm.Subdomain(
        *models.shear_frame([1.0, 1.0], [90.0, 90.0]), scheme=soft, u0=[0.0, 0.1], name="frame"
    )
    base = pm.Subdomain([1.0], [4e3], scheme=soft, substeps=4, name="base")
    return pm.Coupler([frame, base], pm.tie(frame, 0, base, 0), dt=0.01, coupling=coupling)


def roof_returns(now):
    return now.t > 0.1 and now["frame"].u[1] < 0.0


@pytest.mark.parametrize("level", [0.1, 0.3, 0.45])
def test_a_run_ends_at_the_macro_step_in_which_the_closed_form_crosses_a_level(level):
    oscillator, dt = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), v0=[1.0], name="m"), 0.001
    coupler = pm.Coupler([oscillator], dt=dt)
    history = coupler.run(10.0, until=lambda now: now["m"].u[0] > level)
    crossing = np.arcsin(2.0 * level) / 2.0  # u = sin(2 t) / 2
    # the error of the trapezoidal rule, (omega dt)^2 / 12 of the time, is below 1e-6
    assert coupler.time - dt - 1e-6 < crossing < coupler.time + 1e-6
    assert history["m"].t[-1] == coupler.time
    assert history["m"].u[-2] <= level < history["m"].u[-1]


def test_the_condition_of_the_history_locates_an_event_as_scipy_does():
    k, k3, limit, dt = 4.0, 30.0, 0.2, 0.01
    spring = pm.CubicSpring([0], k=k, k3=k3)
    mass = pm.Subdomain(
        [1.0], None, scheme=pm.CentralDifference(), v0=[1.0], name="m", restoring=spring
    )

    def excess(now):
        return now["m"].u[0] - limit

    def event(t, y):
        return y[0] - limit

    event.terminal, event.direction = True, 1.0

    def motion(t, y):
        return y[1], -k * y[0] - k3 * y[0] ** 3

    exact = solve_ivp(
        motion, (0.0, 9.0), [0.0, 1.0], "DOP853", events=event, rtol=1e-10, atol=1e-12
    )
    theirs = exact.t_events[0][0]

    def located(dt):
        coupler = pm.Coupler([mass], dt=dt)
        history = coupler.run(10.0, until=lambda now: excess(now) > 0.0)
        return brentq(lambda t: excess(history.at(t)), coupler.time - dt, coupler.time)

    errors = [abs(located(dt / 2**k) - theirs) for k in range(3)]
    # central difference has order 2, the interpolation a higher one; omega^2 <= k + 3 k3 limit^2
    assert errors[0] < 7.6 * dt**2 * theirs
    assert 3.5 < errors[0] / errors[1] < 4.5 and 3.5 < errors[1] / errors[2] < 4.5


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_it_is_bitwise_the_run_to_that_time_and_so_is_what_follows(coupling, tmp_path):
    pytest.importorskip("h5py")
    coupler, whole = pair(coupling), pair(coupling)
    path = tmp_path / "run.h5"
    history = coupler.run(5.0, until=roof_returns, energy=True, record_to=path)
    assert 0.1 < coupler.time < 4.0  # else nothing has been ended
    assert_identical(history, whole.run(coupler.time, energy=True))
    assert_identical(history, pm.History.load(path))
    assert_same_levels(coupler, whole)
    assert_identical(coupler.run(2.0), whole.run(2.0))


def test_it_is_evaluated_once_after_each_macro_step_also_of_those_that_are_not_recorded():
    times = []
    coupler = pair("pm")
    history = coupler.run(steps=23, every=10, until=lambda now: bool(times.append(now.t)))
    # dt is 0.01, but not in binary
    np.testing.assert_allclose(times, 0.01 * np.arange(1, 24), rtol=1e-14)
    np.testing.assert_allclose(history.macro_times, [0.0, 0.1, 0.2], rtol=1e-14)
    # met before the first step: a run that goes on takes a step
    coupler.run(5.0, until=lambda now: True)
    assert coupler.step_count == 24


def test_it_is_given_what_the_coupler_has_at_that_time():
    seen = []
    coupler = pair("pm")
    coupler.run(steps=7, until=lambda now: bool(seen.append(now)))
    now = seen[-1]
    assert now.t == coupler.time
    np.testing.assert_array_equal(now.multipliers, coupler.multipliers)
    for name in ("frame", "base"):
        state = coupler.state(name)
        for x in "uva":
            np.testing.assert_array_equal(getattr(now[name], x), getattr(state, x))


def test_a_run_with_a_tolerance_ends_so_too():
    coupler = pair("gc")
    history = coupler.run(5.0, until=roof_returns, tolerance=1e-3)
    assert 0.1 < coupler.time < 4.0
    assert history["frame"].u[-1, 1] < 0.0 <= history.at(coupler.time - 0.01)["frame"].u[1]
    assert_identical(history, pair("gc").run(coupler.time, tolerance=1e-3))


def test_an_error_of_the_condition_ends_the_run_at_the_last_macro_step():
    coupler = pair("pm")

    def failing(now):
        if now.t > 0.055:
            raise ZeroDivisionError
        return False

    with pytest.raises(ZeroDivisionError):
        coupler.run(1.0, until=failing)
    assert coupler.step_count == 6
    assert coupler.last_history.macro_times.size == 7
    with pytest.raises(RuntimeError):  # the coupler is in a call
        coupler.run(1.0, until=lambda now: bool(coupler.state("frame").u[0] > 1.0))


@pytest.mark.parametrize("value", [0.05, 1, None, np.array([True]), "yes"])
def test_a_value_that_is_no_bool_is_refused_with_the_rule(value):
    coupler = pair("pm")
    with pytest.raises(TypeError, match=r"until must return True or False, got .* at t = 0\.01"):
        coupler.run(1.0, until=lambda now: value)
    assert coupler.step_count == 1


def test_what_is_no_function_is_refused_before_the_first_step():
    coupler = pair("pm")
    with pytest.raises(TypeError, match=r"until must be a function .*, got 0\.5"):
        coupler.run(1.0, until=0.5)
    assert coupler.step_count == 0
