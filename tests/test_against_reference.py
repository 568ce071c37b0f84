"""The C core against the method once more in plain NumPy, on random problems."""

from dataclasses import replace

import numpy as np
import pytest
from problems import Problem, random_problem, random_restored_problem

import pmalpha as pm

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


class SprungProblem(Problem):
    """For the package with springs, for the reference with what they are as a function."""

    def coupler(self, **options):
        with_springs = [
            replace(part, restoring=part.restoring and part.restoring.springs)
            for part in self.parts
        ]
        return Problem(**{**vars(self), "parts": with_springs}).coupler(**options)


class Pull:
    """A cubic spring and a stop between two dofs, or a dof and the ground."""

    def __init__(self, rng, massless):
        n = massless.size
        self.B, dofs = np.zeros(n), np.array([[-1, -1]])
        ends = rng.permutation(np.flatnonzero(~massless))[:2]  # else nothing may act at t = 0
        dofs[0, : ends.size] = ends
        self.B[ends] = np.array([1.0, -1.0])[: ends.size]
        self.springs = [pm.CubicSpring(dofs, 2.0, 5.0), pm.Gap(dofs, 8.0, 0.3)]

    def __call__(self, u, v, t):
        d = self.B @ u
        return self.B * (2.0 * d + 5.0 * d**3 + 8.0 * max(d - 0.3, 0.0))


@pytest.mark.parametrize("seed", range(500, 540))
def test_core_and_reference_agree_on_a_random_problem_with_springs(seed):
    problem, rng = random_problem(seed), np.random.default_rng([seed, 2])
    for part in problem.parts:
        massless = np.diag(part.M) == 0.0
        part.lagged = bool(rng.random() < 0.5) and not massless.any()
        if massless.all():
            continue
        part.restoring = Pull(rng, massless)
        part.K_r = 2.0 * np.outer(part.restoring.B, part.restoring.B)
        if rng.random() < 0.3:
            part.D_r = 0.1 * part.K_r
    assert_agreement(SprungProblem(**vars(problem)))


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
