"""Ties that part in the first steps: the stiff driven part of Bathe and Noh."""

import numpy as np
import pytest

import pmalpha as pm


def driven(coupling, *, v0=0.0, name=""):
    """A spring of 1e7 whose end follows sin 2t, beside one of 1, from rest or not."""
    K = 1e7 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiff = pm.Subdomain([1.0, 0.5], K, scheme=pm.GeneralizedAlpha(0.5), v0=[2.0, v0], name="stiff")
    soft = pm.Subdomain(
        [0.5, 1.0],
        [[1.0, -1.0], [-1.0, 1.0]],
        scheme=pm.CentralDifference(),
        v0=[v0, 0.0],
        name="soft",
    )
    end = pm.Constraint({stiff: [[1.0, 0.0]]}, velocity=lambda t: [2.0 * np.cos(2.0 * t)])
    return pm.Coupler(
        [stiff, soft], [end, pm.tie(stiff, [1], soft, [0])], dt=0.05, coupling=coupling
    )


def error(history):
    """Of the middle mass on the soft side, which moves as the end: sin 2t."""
    return np.abs(history["soft"].u[:, 0] - np.sin(2.0 * history["soft"].t)).max()


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_a_start_that_the_step_does_not_resolve_is_named_with_the_gap_it_leaves(coupling):
    text = r"'stiff' and 'soft' have parted by 0.\d+ .*row 1 .* coupling=\"mean\", which has no"
    with pytest.warns(pm.AccuracyWarning, match=text):
        history = driven(coupling).run(10.0)
    assert error(history) > 0.1


def test_mean_coupling_and_the_right_start_are_right_and_silent():
    for history in (driven("mean").run(10.0), driven("gc", v0=2.0).run(10.0)):
        # (omega dt)^2 / 12 of the motion, omega = 2, and the share of the scheme
        assert error(history) < 5e-3
        assert not history.warnings


def test_a_run_of_few_steps_or_not_from_the_start_is_not_judged():
    coupler = driven("gc")
    assert not coupler.run(2.0).warnings
    assert not coupler.run(12.0).warnings


@pytest.mark.parametrize("factor, amplitude", [(1e-3, 0.5), (1.0, 0.5), (1e3, 100.0)])
def test_a_gap_is_judged_by_the_whole_motion_and_not_by_the_factors_of_its_row(factor, amplitude):
    # beside two masses that are tied to each other alone; the gap is 0.3
    made = driven("gc")
    stiff, soft = made.subdomains
    scheme = pm.GeneralizedAlpha(0.9)
    far, away = (pm.Subdomain([1.0], [1.0], scheme=scheme, u0=[amplitude]) for _ in range(2))
    end = pm.Constraint({stiff: [[1.0, 0.0]]}, velocity=lambda t: [2.0 * np.cos(2.0 * t)])
    tie = pm.Constraint({stiff: [[0.0, factor]], soft: [[-factor, 0.0]]})
    constraints = [end, tie, pm.tie(far, [0], away, [0])]
    coupler = pm.Coupler([stiff, soft, far, away], constraints, dt=0.05, coupling="gc")
    if amplitude < 1.0:
        with pytest.warns(pm.AccuracyWarning, match="have parted"):
            coupler.run(10.0)
    else:  # 0.3 per cent of the motion
        assert not coupler.run(10.0).warnings


def test_a_run_of_which_not_all_is_recorded_is_not_judged():
    assert not driven("gc").run(10.0, record={"stiff": [1]}).warnings


def test_of_a_run_that_grows_only_its_step_is_named():
    def coupler(k):
        """A chain of highest frequency sqrt(2 k), which central difference takes to k = 800."""
        K = k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        scheme = pm.CentralDifference()
        chain = pm.Subdomain([1.0, 1.0], K, scheme=scheme, v0=[1.0, 0.0], name="chain")
        soft = pm.Subdomain([1.0], [1.0], scheme=pm.GeneralizedAlpha(0.9), name="soft")
        return pm.Coupler([chain, soft], pm.tie(chain, [1], soft, [0]), dt=0.05, coupling="pm")

    with pytest.warns(pm.AccuracyWarning, match="'chain' and 'soft' have parted"):
        coupler(790.0).run(steps=100)
    with pytest.warns(pm.StabilityWarning, match="'chain' is above its critical step"):
        growing = coupler(800.3)
    history = growing.run(steps=100)
    first = np.abs(history.displacement_jump[:11]).max()
    assert first > 0.1 * np.abs(history["chain"].u).max()  # the gap alone would have been named
    assert not history.warnings


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_the_jump_of_a_support_is_its_way_and_the_drift_is_what_its_integral_leaves(coupling):
    history = driven(coupling, v0=2.0).run(10.0)
    way = np.sin(2.0 * history.macro_times)
    jump = history.displacement_jump[:, 0]
    np.testing.assert_array_equal(jump, history["stiff"].u[:, 0])
    assert np.abs(jump).max() > 0.99
    # the way is 1: (omega dt)^2 / 12 of it, 1e-3, and the drift of "pm", 5e-3 in these 200 steps
    assert np.abs(jump - way).max() < 0.01
