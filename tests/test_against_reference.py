"""The C core against the reference in plain NumPy, on random problems."""

from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_run_agrees, largest
from reference_problems import Problem, random_problem, random_restored_problem

import pmalpha as pm

# The two programs compute the same sums in another order, in some hundred steps of stable schemes:
# rounding, 2e-16, is magnified by the condition number of Mbar and H (up to 1e4 here) and the
# number of steps.
AGREEMENT = 1e-9
STEPS = 9


@pytest.mark.parametrize("seed", range(16))
def test_core_and_reference_agree_on_a_random_problem(seed):
    assert_agreement(random_problem(seed))


@pytest.mark.parametrize("seed", range(12))
def test_core_and_reference_agree_on_a_random_problem_with_restoring_forces(seed):
    assert_agreement(random_restored_problem(seed))


class SprungProblem(Problem):
    """Springs for the package, the same force as a function for the reference."""

    def coupler(self, **options):
        with_springs = [
            replace(s, restoring=s.restoring.springs, K_r=None) if s.restoring else s
            for s in self.subdomains
        ]
        return Problem(**{**vars(self), "subdomains": with_springs}).coupler(**options)


class Pull:
    """A cubic spring and a stop between two dofs, or a dof and the ground."""

    def __init__(self, rng, massless):
        n = massless.size
        self.B, dofs = np.zeros(n), np.array([[-1, -1]])
        ends = rng.permutation(np.flatnonzero(~massless))[
            :2
        ]  # the row of a massless dof must hold at t = 0
        dofs[0, : ends.size] = ends
        self.B[ends] = np.array([1.0, -1.0])[: ends.size]
        self.springs = [pm.CubicSpring(dofs, 2.0, 5.0), pm.Gap(dofs, 8.0, 0.3)]

    def __call__(self, t, u, v):
        d = self.B @ u
        return self.B * (2.0 * d + 5.0 * d**3 + 8.0 * max(d - 0.3, 0.0))


@pytest.mark.parametrize("seed", range(500, 510))
def test_core_and_reference_agree_on_a_random_problem_with_springs(seed):
    problem, rng = random_problem(seed), np.random.default_rng([seed, 2])
    for s in problem.subdomains:
        massless = np.diag(s.M) == 0.0
        s.lagged = bool(rng.random() < 0.5) and not massless.any()
        if massless.all():
            continue
        s.restoring = Pull(rng, massless)
        s.K_r = 2.0 * np.outer(s.restoring.B, s.restoring.B)  # the initial tangent
        if rng.random() < 0.3:
            s.D_r = 0.1 * s.K_r
    assert_agreement(SprungProblem(**vars(problem)))


def assert_agreement(problem):
    coupler = problem.coupler()
    expected = problem.reference(STEPS, [part.double for part in coupler._session.members])
    inertia = largest(*(x.w @ s.M for x, s in zip(expected.subdomains, problem.subdomains)))
    assert_run_agrees(coupler.run(steps=STEPS), expected, AGREEMENT, force=inertia)
