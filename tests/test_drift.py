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
