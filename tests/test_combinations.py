"""What does not go with what: each row of the table is met, in its words, by a drawn problem."""

import re

import pytest
from problems import FEATURES, Problem

from pmalpha.setup import combinations

# A problem for each row, by its features with their subdomains; contacts are between "a" and "b".
MET = [
    ("contact", "macro"),
    ("contact", "iterated bilinear springs"),
    ("contact", ("iterated bilinear springs", 2)),
    ("contact", "unsymmetric K"),
    ("specimen", "mean"),
    ("controller", "mean"),
    ("explicit with rho 0.3", "mean"),
    ("specimen", "iterated bilinear springs", "macro"),
    ("controller", "iterated bilinear springs", "macro"),
    ("iterated bilinear springs", "plain start", "double steps", "pm"),
]
PAIRS = list(zip(combinations.REFUSALS, MET, strict=True))


@pytest.mark.parametrize("refusal, features", PAIRS)
def test_a_row_is_refused_in_its_words_and_each_of_its_features_alone_is_not(refusal, features):
    choices = [x if isinstance(x, tuple) else (x, 0) for x in features]
    assert {refusal.one, refusal.other} <= set(combinations.FEATURES)
    words = re.escape(refusal.words.split("{")[0])
    with pytest.raises(ValueError, match=f"^{words}"):
        Problem(22, 3, tuple(choices)).couple()
    for choice in choices:
        if choice[0] != "double steps":  # of one substep, under pm alone
            Problem(22, 3, (choice,)).couple()


def test_each_feature_of_the_table_is_in_a_row_and_all_that_is_met_can_be_drawn():
    used = {name for refusal in combinations.REFUSALS for name in refusal[:2]}
    assert used == set(combinations.FEATURES)
    assert {x if isinstance(x, str) else x[0] for met in MET for x in met} <= set(FEATURES)
