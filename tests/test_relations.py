"""Relations between runs that hold whatever the numbers, on random problems of everything.

problems.py draws them, relations.py has the relations; campaign_relations.py tries other seeds.
"""

import re
from collections import Counter

import numpy as np
import pytest
import relations
from problems import FEATURES, Problem

import pmalpha as pm

# The first problems of the campaign, which has as many as one likes.
SEEDS = [*range(6), *(pytest.param(seed, marks=pytest.mark.gate) for seed in range(6, 12))]
SIMPLE = Problem(3, 2, (("cubic springs", 0), ("initial motion", 0)))


@pytest.mark.parametrize("seed", SEEDS)
def test_runs_of_a_random_problem_are_equal_or_refused_by_name(seed):
    relations.reported(relations.drawn(seed))


def test_a_relation_that_is_broken_names_the_place():
    run = relations.Run(SIMPLE)
    wrong = {key: x.copy() for key, x in run.results.items()}
    wrong["v", "b"][3, 0] += 1e-12
    with pytest.raises(AssertionError, match=r"^order: v of b at \(3, 0\) is "):
        run.equal("order", wrong)


@pytest.mark.parametrize("name", ["pieces", "saved", "threads", "cases", "files", "units", "order"])
def test_every_relation_is_tried_on_a_simple_problem_and_holds(name):
    counts = relations.attempt(SIMPLE, [name])
    assert counts == Counter({"problems": 1, name: 1})


@pytest.mark.parametrize("relation", ["order", "units"])
def test_a_number_that_is_another_is_seen(relation, monkeypatch):
    """Another mass where the problem is written otherwise."""
    changed = Problem.written

    def other(self, **changes):
        problem = changed(self, **changes)
        if relation in changes:
            first = re.compile(r"Subdomain\(\s*\[\[([0-9.]+)")
            x = first.search(problem.setup)[1]
            problem.__dict__["setup"] = problem.setup.replace(x, str(1.001 * float(x)), 1)
        return problem

    monkeypatch.setattr(Problem, "written", other)
    with pytest.raises(AssertionError, match=f"^{relation}: "):
        relations.attempt(SIMPLE, [relation])


def test_words_of_numpy_and_of_a_parser_are_no_refusal():
    for broken in (lambda: np.zeros(2) @ np.zeros(3), lambda: {}["a"]):
        try:
            broken()
        except Exception as error:
            assert not relations.is_refusal(error)
    with pytest.raises(ValueError) as refused:
        pm.GeneralizedAlpha(1.5)
    assert relations.is_refusal(refused.value)


def test_a_failure_is_reported_with_the_smallest_program(monkeypatch):
    def broken(run):
        assert "cubic springs" not in run.problem.features(), "broken: cubic"

    monkeypatch.setitem(relations.RELATIONS, "broken", broken)
    problem = Problem(3, 3, (("cubic springs", 1), ("damping", 0), ("initial motion", 0)))
    with pytest.raises(AssertionError, match="broken: cubic") as failed:
        relations.reported(problem, ["broken"])
    words = str(failed.value)
    assert "CubicSpring" in words and "C=" not in words and "v0" not in words


def test_the_drawings_have_every_feature():
    chosen = Counter(name for seed in range(600) for name in relations.drawn(seed).features())
    assert set(FEATURES) - {"tie"} <= set(chosen) | {"tie"}
