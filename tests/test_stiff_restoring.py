"""A restoring function that is too stiff for the step is named as the cause, early."""

import pickle
import warnings

import numpy as np
import pytest

import pmalpha as pm


def coupler(restoring, dt, M=(1.0,), K=None, scheme=None, **options):
    scheme = scheme or pm.GeneralizedAlpha(0.8)
    part = pm.Subdomain(M, K, scheme=scheme, restoring=restoring, name="specimen", **options)
    return pm.Coupler([part], dt=dt)


def stiff(u, v, t):
    return 1e4 * u


@pytest.mark.parametrize("explicit", [False, True])
def test_the_warning_and_the_error_name_cause_and_remedy(explicit):
    scheme = pm.GeneralizedAlpha(0.8, explicit=explicit)
    run = coupler(stiff, 0.05, scheme=scheme, u0=[1.0])
    with pytest.warns(pm.StabilityWarning) as caught, pytest.raises(pm.InstabilityError) as error:
        run.run(20.0)
    (warning,) = caught
    words = str(warning.message)
    # omega = sqrt(1e4 / 1) = 100
    assert "subdomain 'specimen'" in words and "frequency of about 100" in words
    assert "restoring_stiffness=" in words and "smaller steps" in words
    assert warning.filename == __file__
    assert words.startswith(error.value.cause) and error.value.cause in str(error.value)
    assert error.value.subdomain == "specimen" and error.value.step == run.step_count
    # long before an overflow: each step multiplies the motion by less than (omega h)^2 = 25
    assert np.max(np.abs(run.last_history[0].u)) < 25.0**10


def test_the_critical_step_in_the_words_is_the_one_of_the_runs():
    # with K_r = 0 an implicit scheme has the limit of the explicit one with the same parameters;
    # omega h = 2 for the predictor of the trapezoidal rule, as for central difference
    omega, limit = 100.0, 2.0
    for scheme in (pm.Newmark(), pm.CentralDifference()):
        quiet = coupler(stiff, 0.97 * limit / omega, scheme=scheme, u0=[1.0])
        with warnings.catch_warnings():
            warnings.simplefilter("error", pm.StabilityWarning)
            quiet.step(2000)
        with pytest.warns(pm.StabilityWarning, match="critical step 0.02;"):
            with pytest.raises(pm.InstabilityError):
                coupler(stiff, 1.1 * limit / omega, scheme=scheme, u0=[1.0]).step(2000)


def test_the_remedy_helps():
    coupler(stiff, 0.05, u0=[1.0], restoring_stiffness=[1e4]).step(1000)  # warnings are errors


def test_after_the_error_the_coupler_is_at_the_last_whole_macro_step():
    run = coupler(stiff, 0.05, u0=[1.0])
    with pytest.warns(pm.StabilityWarning), pytest.raises(pm.InstabilityError) as error:
        run.run(20.0)
    assert run.time == error.value.time
    assert np.isfinite(run.state("specimen").u).all()


def test_the_error_can_be_pickled():
    error = pm.InstabilityError(3, 0.15, "specimen", "too stiff")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.cause) == (str(error), "too stiff")


# ---- what must not be taken for it ---------------------------------------------------------------


def test_a_stiff_spring_in_many_dofs_is_found():
    # a chain with one stiff spring to the ground; the softer ones are stable
    def r(u, v, t):
        return np.array([4.0, 4.0, 1e6, 4.0]) * u

    with pytest.warns(pm.StabilityWarning), pytest.raises(pm.InstabilityError):
        coupler(r, 0.05, M=np.ones(4), v0=[1.0, 1.0, 1e-6, 1.0]).step(1000)


@pytest.mark.parametrize(
    "restoring",
    [
        lambda u, v, t: u + u**3,  # Duffing
        lambda u, v, t: 4.0 * u + 0.4 * v,
        lambda u, v, t: np.cos(7.0 * t) * np.ones(1),  # a load
        lambda u, v, t: np.clip(30.0 * u, -1.0, 1.0),  # elastic, perfectly plastic
        lambda u, v, t: 4.0 * u + 1e-3 * np.sin(1e5 * t),  # measured with noise
    ],
)
def test_soft_restoring_forces_are_not_reported(restoring):
    coupler(restoring, 0.02, K=[1.0], u0=[1.0]).step(2000)


def test_a_dashpot_is_not_taken_as_stiffness():
    # c h / m = 0.4 is stable; alone against du it would look like c / h = 1000 at slow motion
    coupler(lambda u, v, t: 20.0 * v + 4.0 * u, 0.02, u0=[1.0]).step(500)


def test_growth_that_the_steps_resolve_does_not_end_a_run():
    # a load from 1e-12 to 1, while the stiff mode, damped at the interface of M, is at rest
    load = dict(force=lambda t: [1e-12 * np.exp(min(t, 27.0))])
    coupler(lambda u, v, t: 4.0 * u, 0.05, **load).run(30.0)


def test_a_function_that_changes_its_arguments_does_not_mislead_the_estimate():
    def r(u, v, t):
        value = 4.0 * u
        u[:] = 1e3
        return value

    coupler(r, 0.05, u0=[1.0]).step(200)


def test_a_reset_is_a_run_of_its_own_whatever_its_amplitude():
    # the growth that ends a run is counted from the motion of that run
    s = pm.Subdomain(
        [1.0], [0.0], scheme=pm.GeneralizedAlpha(0.5), u0=[1e-9], restoring=lambda u, v, t: 1e4 * u
    )
    coupler = pm.Coupler([s], dt=0.05)
    with pytest.warns(pm.StabilityWarning, match="is stiff"):
        coupler.step(6)
    coupler.reset(u0={0: [1.0]})
    coupler.step(3)  # no second warning, which would be an error here
    assert coupler.step_count == 3
    with pytest.raises(pm.InstabilityError, match="is stiff"):
        coupler.step(100)
