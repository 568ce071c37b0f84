"""What the comparisons of whole runs say when they fail."""

from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_close, assert_constant, assert_run_agrees, assert_small
from reference_problems import random_problem


def test_a_difference_is_named_by_quantity_first_time_and_size():
    jump = np.zeros((4, 2))
    jump[2, 1], jump[3, 0] = 0.004, -0.5
    with pytest.raises(AssertionError) as error:
        assert_small(jump, 1e-9, "velocity jump", times=0.05 * np.arange(4), column="constraint")
    assert str(error.value) == (
        "velocity jump at time level 2 (t = 0.1), constraint 1 is 0.004 instead of 0: 0.004 apart, "
        "1e-09 allowed (1e-09 of 1); 2 of 8 numbers are apart, most 0.5 at time level 3 "
        "(t = 0.15), constraint 0"
    )


def test_numbers_that_are_missing_or_nan_are_apart():
    with pytest.raises(AssertionError, match=r"energy at time level 1 is nan instead of 2: nan"):
        assert_constant([2.0, np.nan, 2.0], 1e-9, "energy")
    with pytest.raises(AssertionError, match=r"u has the shape \(3,\), not \(2,\)"):
        assert_close(np.zeros(3), np.zeros(2), 1.0, "u")
    assert_close(np.zeros((0, 3)), 0.0, 1e-9, "nothing")
    assert_constant([2.0, 2.0 + 1e-9], 1e-9, "energy")  # relative to 2


def test_a_run_is_compared_in_all_quantities_and_the_first_in_time_is_named():
    problem = random_problem(3)
    coupler = problem.coupler()
    expected = problem.reference(9, [part.double for part in coupler._session.members])
    history = coupler.run(steps=9)
    assert_run_agrees(history, expected, 1e-9)
    wrong = [replace(s, v=s.v.copy()) for s in expected.subdomains]
    wrong[1].v[5:, 0] += 1e-3
    lam = np.where(np.arange(len(expected.multipliers))[:, None] < 7, 1.0, 1.01)
    wrong = replace(expected, subdomains=wrong, multipliers=lam * expected.multipliers)
    named = r"^velocity of subdomain 1 at time level 5 .* dof 0 is .*: 0.001 apart"
    with pytest.raises(AssertionError, match=named) as error:
        assert_run_agrees(history, wrong, 1e-9)
    assert "then apart: multiplier from" in str(error.value)
    wrong.multipliers[:] *= 1.01  # at one time: the motion follows from them
    wrong.subdomains[0].v[0] += 1.0
    with pytest.raises(AssertionError, match=r"^multiplier at time level 0"):
        assert_run_agrees(history, wrong, 1e-9)
    assert "agreeing: displacement of subdomain 0, " in str(error.value)
