"""What does not go with what: each row of the table is met, in its words, by a drawn problem."""

import re

import pytest
from problems import FEATURES, Problem

import pmalpha as pm
from pmalpha.run.session import placed_of
from pmalpha.setup import combinations

# A problem for each row, by its features with their subdomains; contacts are between "a" and "b".
MET = [
    ("Bathe", "pm"),
    ("Bathe", "double steps"),
    ("Bathe", "bilinear springs"),
    ("Bathe", "iterated bilinear springs"),
    ("Bathe", "controller"),
    ("contact", "Bathe"),
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
ROWS = (*combinations.SCHEMES[1:], *combinations.REFUSALS)  # the first: of several processes
PAIRS = list(zip(ROWS, MET, strict=True))
# What has the feature of a row of `CALLS`, with the coupling where it is not "gc".
WITH = {
    "contact beside it": ("contact",),
    "internal forces": ("iterated bilinear springs",),
    "restoring forces": ("bilinear springs",),
    "a force of the motion": ("controller",),
    "other scheme": ("Bathe",),
    "scheme of two stages": ("Bathe",),
    '"mean" and not the trapezoidal rule': ("mean",),
    '"mean" and double steps': ("mean", "Newmark", ("Newmark", 1), ("Newmark", 2), "double steps"),
    '"mean" and a prescribed velocity': (
        "mean",
        "Newmark",
        ("Newmark", 1),
        ("Newmark", 2),
        "prescribed velocity",
    ),
    "plain start": ("plain start",),
    "lagged damping": ("lagged damping",),
    "no mass at a dof": ("massless dof",),
    "double steps": ("pm",),
    '"pm"': ("pm",),
    "a function of the motion": ("specimen",),
    '"macro" or "mean"': ("macro",),
}


def placed(names):
    return tuple(x if isinstance(x, tuple) else (x, 0) for x in names)


def called(what, c):
    """The call of this name of a coupler."""
    n, end = c.subdomains[0].name, 4 * c.dt
    goal = pm.Goal(n, 0, at=end)
    calls = {
        "tolerance": lambda: c.run(steps=2, tolerance=0.1),
        "static": c.static,
        "error_budget": lambda: c.error_budget(goal, end),
        combinations.GRADIENT: lambda: c.gradient(goal, steps=4),
        combinations.JACOBIAN: lambda: c.jacobian({n: [0]}, steps=4, parameters=[]),
        "growth": lambda: c.growth(16),
        "amplification_matrix": lambda: pm.analysis.amplification_matrix(c),
        "exact_solution": lambda: pm.analysis.exact_solution(c),
        "local_error": lambda: pm.analysis.local_error(c, lambda t: None),
        "energy=True": lambda: c.run(steps=2, energy=True),
        "a change of steps": lambda: c.change_steps(dt=c.dt / 2.0),
        "run_paced": lambda: c.run_paced(end, rate=1e4, on_late="continue"),
        "estimate_error": lambda: c.estimate_error(steps=2),
        "export_fmu": lambda: c.export_fmu("no folder/x.fmu"),
    }
    return calls[what]()


@pytest.mark.parametrize("calls, feature, words", combinations.CALLS)
def test_a_call_is_refused_in_the_words_of_its_row(calls, feature, words):
    words = words.format_map(Texts()).split("\0")[0]
    for what in calls:
        coupler = Problem(22, 3, placed(WITH[feature])).couple(threads=1)
        assert any(combinations.FEATURES[feature](x) for x in placed_of(coupler._session))
        with pytest.raises(ValueError, match=f"^{re.escape(f'{what} {words}')}"):
            called(what, coupler)


class Texts(dict):
    """Ends where something of the subdomain begins."""

    def __missing__(self, key):
        return Ended()


class Ended:
    __repr__ = __str__ = lambda self: "\0"
    __format__ = lambda self, spec: "\0"  # noqa: E731


@pytest.mark.parametrize("refusal, features", PAIRS)
def test_a_row_is_refused_in_its_words_and_each_of_its_features_alone_is_not(refusal, features):
    choices = placed(features)
    assert {refusal.one, refusal.other} <= set(combinations.FEATURES)
    words = re.escape(refusal.words.split("{")[0])
    with pytest.raises(ValueError, match=f"^{words}"):
        Problem(22, 3, choices).couple()
    for choice in choices:
        if choice[0] != "double steps":  # of one substep, under pm alone
            Problem(22, 3, (choice,)).couple()


def test_a_scheme_of_two_stages_is_refused_in_several_processes_in_the_process_that_has_it():
    s = pm.Subdomain([1.0], [1.0], scheme=pm.Bathe(), substeps=2)
    combinations.require_schemes([combinations.Placed("a", s, "gc")])
    with pytest.raises(ValueError, match="^comm needs a scheme of one stage, got Bathe"):
        combinations.require_schemes([combinations.Placed("a", s, "gc", is_shared=True)])


def test_each_feature_of_the_table_is_in_a_row_and_all_that_is_met_can_be_drawn():
    used = {name for refusal in (combinations.SCHEMES[0], *ROWS) for name in refusal[:2]}
    assert used | {feature for _, feature, _ in combinations.CALLS} == set(combinations.FEATURES)
    assert {x if isinstance(x, str) else x[0] for met in MET for x in met} <= set(FEATURES)
