"""The C core against the method once more in plain NumPy, on random problems."""

import numpy as np
import pytest
from problems import random_problem, random_restored_problem

# The two programs do the same sums in another order, over some hundred steps of stable schemes:
# rounding, 2e-16, grows by the condition of Mbar and H (up to 1e4 here) and the number of steps.
AGREEMENT = 1e-9
STEPS = 17


def largest(x):
    return np.max(np.abs(x), initial=0.0)


@pytest.mark.parametrize("seed", range(120))
def test_core_and_reference_agree_on_a_random_problem(seed):
    assert_agreement(random_problem(seed))


@pytest.mark.parametrize("seed", range(60))
def test_core_and_reference_agree_on_a_random_problem_with_restoring_forces(seed):
    assert_agreement(random_restored_problem(seed))


def assert_agreement(problem):
    coupler = problem.coupler()
    expected = problem.reference(STEPS, [part.double for part in coupler._parts])
    history = coupler.run(steps=STEPS)
    scale = {x: max(largest(getattr(part, x)) for part in expected.parts) for x in "uvw"}
    for i, part in enumerate(expected.parts):
        ours = history[i]
        np.testing.assert_array_equal(ours.t, part.t)
        for ours_x, x in ((ours.u, "u"), (ours.v, "v"), (ours.a, "w")):
            assert largest(ours_x - getattr(part, x)) <= AGREEMENT * scale[x], (i, x)
    np.testing.assert_array_equal(history.multiplier_times, expected.multiplier_times)
    inertia = [largest(x.w @ part.M) for x, part in zip(expected.parts, problem.parts)]
    force = max(largest(expected.multipliers), *inertia)  # they may be zero but for rounding
    assert largest(history.multipliers - expected.multipliers) <= AGREEMENT * force
    drift = largest(history.displacement_jump - expected.displacement_jump)
    assert drift <= AGREEMENT * scale["u"]
    # velocities of the two sides agree to rounding, in both programs
    for jump in (history.velocity_jump, expected.velocity_jump):
        assert largest(jump) <= AGREEMENT * scale["v"]
