"""Relations between runs that hold whatever the numbers, on random problems of all kinds.

relations.py has the problems, the relations and what rounding may change; campaign_relations.py
tries other seeds.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import relations
import wholes

# All couplings and forces of all kinds; small ones among many.
SEEDS = (14, 16, 23, 28, 32, 45)


@pytest.mark.parametrize("name", relations.RELATIONS)
def test_it_holds_for_random_problems(name):
    counts = Counter()
    for seed in SEEDS:
        try:
            relations.attempt(seed, counts, [name])
        except AssertionError as error:
            raise AssertionError(f"seed {seed}, {error}") from None
    assert counts[name] >= len(SEEDS) - 1  # few are refused or unstable


# Of wholes.varied, one for each coupling: unsymmetric, with compiled functions.
VARIED = (13, 16, 19, 22)


@pytest.mark.parametrize("name", ["pieces", "records", "cases"])
def test_bitwise_ones_hold_for_unsymmetric_matrices_and_compiled_functions(name):
    counts = Counter()
    for seed in VARIED:
        try:
            relations.attempt(seed, counts, [name], wholes.varied)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}, {error}") from None
    assert counts[name] == len(VARIED)
    members = [p for seed in VARIED for p in wholes.varied(seed).members]
    assert any(not p.symmetric for p in members) and any(p.compiled for p in members)


def test_the_problems_are_of_all_kinds():
    drawn = [wholes.drawn(seed) for seed in SEEDS]
    members = [p for whole in drawn for p in whole.members]
    assert {whole.coupling for whole in drawn} == set(wholes.COUPLINGS)
    assert {p.load.kind for p in members} == {"none", "constant", "called", "sampled", "base"}
    assert {p.role for p in members if p.springs or p.function} == {"restoring", "internal"}
    assert any(p.function for p in members) and any(p.springs for p in members)
    assert any(p.double for p in members) and any(p.substeps > 1 for p in members)
    assert any(p.scheme.explicit for p in members) and any(p.lagged for p in members)
    assert any(whole.g is not None for whole in drawn)
    assert any(np.any(np.diag(p.M) == 0.0) for p in members)


@pytest.mark.parametrize("quantity", ["u", "v", "a", "multipliers"])
def test_a_relation_that_is_broken_names_the_place(quantity):
    run = relations.run_of(1)
    name = "interface" if quantity == "multipliers" else run.whole.members[1].name
    wrong = {key: x.copy() for key, x in run.results.items()}
    wrong[quantity, name][3, 0] += 1e-7 * run.spread.sizes[quantity]
    kind = "row" if name == "interface" else "dof"
    with pytest.raises(AssertionError, match=rf"^order: {quantity} of {name} at .* 3, {kind} 0 is"):
        relations.require_equal("order", run.results, wrong, run.spread)


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
def test_a_problem_that_differs_by_a_millionth_of_one_number_is_another():
    run = relations.run_of(1)
    first, *others = run.whole.members
    heavier = replace(first, M=first.M * (1.0 + 1e-6))
    other = relations.computed(replace(run.whole, members=(heavier, *others)))
    with pytest.raises(AssertionError, match="heavier"):
        relations.require_equal("heavier", run.results, other, run.spread)
