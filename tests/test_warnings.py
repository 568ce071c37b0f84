"""A warning points at the line of the user, and one cause has one warning."""

import inspect

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import analysis, models

FAST = pm.CentralDifference()
SOFT = pm.GeneralizedAlpha(0.5)


def stiff(name, k=1e4, **options):
    """Explicit, with a critical step of 2 / sqrt(k)."""
    return pm.Subdomain(1.0, k, scheme=FAST, name=name, **options)


def apart():
    """Two tied masses with a gap at the start."""
    a = pm.Subdomain([1.0], [1.0], scheme=SOFT, u0=[1.0], name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=SOFT, name="b")
    return [a, b], pm.tie(a, 0, b, 0)


def closed():
    subdomains, tie = apart()
    a = pm.Subdomain([1.0], [1.0], scheme=SOFT, name="a")
    return pm.Coupler([a, subdomains[1]], pm.tie(a, 0, subdomains[1], 0), dt=0.1, coupling="pm")


def massless():
    """A dof without mass under a load that nothing balances at t = 0."""
    K = [[1.0, -1.0], [-1.0, 2.0]]
    return pm.Subdomain([1.0, 0.0], K, scheme=SOFT, force=[0.0, 1.0], name="m")


CALLS = {
    "coupler": lambda: pm.Coupler([stiff("a")], dt=1.0),
    "solve": lambda: pm.solve(stiff("a"), dt=1.0, steps=0),
    "gap": lambda: pm.Coupler(*apart(), dt=0.1, coupling="pm"),
    "reset": lambda: closed().reset(u0={"a": [1.0]}),
    "start": lambda: pm.Coupler([massless()], dt=0.1).run(steps=1),
    "state": lambda: pm.Coupler([massless()], dt=0.1).state("m"),
    "model": lambda: models.split_oscillator(0.5).coupler(100.0, coupling="pm"),
    "amplification": lambda: analysis.amplification_matrix(pm.Coupler([stiff("a")], dt=1.0)),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_warning_points_at_the_line_that_made_the_call_and_comes_once(name):
    with pytest.warns() as caught:
        CALLS[name]()
    (warning,) = caught
    line = inspect.getsourcelines(CALLS[name])[1]
    assert (warning.filename, warning.lineno) == (__file__, line)


def of_stability(caught):
    """The stability warnings; that no constraint reaches these subdomains is another one."""
    return [warning for warning in caught if warning.category is pm.StabilityWarning]


def test_steps_above_the_critical_ones_are_one_warning_that_names_them():
    subdomains = [stiff("a"), stiff("b", 4e4), stiff("soft", 1.0), stiff("c", 1e4, substeps=2)]
    with pytest.warns(pm.StabilityWarning) as caught:
        pm.Coupler(subdomains, dt=0.1, coupling="gc")
    (warning,) = of_stability(caught)
    # central difference: 2 / omega
    assert "'a' (0.1 above 0.02), 'b' (0.1 above 0.01), 'c' (0.05 above 0.02)" in str(
        warning.message
    )
    assert "soft" not in str(warning.message)


def test_many_steps_above_the_critical_ones_are_counted():
    with pytest.warns(pm.StabilityWarning, match=r"\.\.\. \(20 in all\)") as caught:
        pm.Coupler([stiff(f"s{i}") for i in range(20)], dt=0.1, coupling="gc")
    assert len(of_stability(caught)) == 1


def alike(names, **options):
    """Subdomains of two dofs with substeps, the first dof of each tied to that of the next."""
    common = {"M": [1.0, 1.0], "K": [[2.0, -1.0], [-1.0, 1.0]]} | options
    made = []
    for name in names:
        made.append(pm.Subdomain(**common, name=name))
    return made, [pm.tie(a, 0, b, 0) for a, b in zip(made, made[1:])]


def only(caught, category):
    (warning,) = [w for w in caught if w.category is category]
    return str(warning.message)


MACRO = [
    (
        {"scheme": SOFT, "substeps": 2, "restoring": lambda t, u, v: 0.1 * u},
        pm.StabilityWarning,
        "the restoring forces of subdomains 'a', 'b' are combined with substeps",
    ),
    (
        {"scheme": SOFT, "substeps": 2, "M": [0.0, 1.0]},
        pm.ConstraintWarning,
        "interface dofs without mass: dof 0 of 'a', dof 0 of 'b'; with substeps",
    ),
]


@pytest.mark.parametrize(("options", "category", "text"), MACRO)
def test_a_cause_under_macro_coupling_is_one_warning_that_names_all(options, category, text):
    with pytest.warns(category) as caught:
        pm.Coupler(*alike("ab", **options), dt=0.1, coupling="macro")
    assert only(caught, category).startswith(text)


def test_what_couples_nothing_is_not_warned_of():
    pm.Coupler(*alike("a", **MACRO[0][0]), dt=0.1, coupling="macro")


def test_loose_subdomains_are_one_warning():
    floating = [[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    made, ties = alike("abc", scheme=SOFT, M=[1.0, 1.0, 1.0], K=floating)
    held = pm.Subdomain([1.0], [1.0], scheme=SOFT, name="held")
    difference = pm.Constraint({s: [[1.0, -1.0, 0.0]] for s in made})
    with pytest.warns(pm.ConstraintWarning) as caught:
        pm.Coupler([*made, held], [difference, pm.tie(made[0], 2, held, 0)], dt=0.1, coupling="pm")
    text = only(caught, pm.ConstraintWarning)
    assert text.startswith(
        "subdomains 'b' (1 constraint), 'c' (1 constraint) are floating, and their constraints do "
        "not hold them: each can move as a rigid body"
    )


def test_equations_without_mass_are_one_warning():
    K = [[1.0, -1.0], [-1.0, 2.0]]
    made = [pm.Subdomain([1.0, 0.0], K, scheme=SOFT, force=[0.0, 1.0], name=x) for x in "ab"]
    with pytest.warns(pm.ConstraintWarning) as caught:
        pm.Coupler(made, pm.tie(made[0], 0, made[1], 0), dt=0.1, coupling="pm").run(steps=1)
    text = only(caught, pm.ConstraintWarning)
    assert text.startswith(
        "the equations of dofs without mass do not hold at t = 0, those of dof 1 of 'a', dof 1 of "
        "'b': "
    )


def test_large_factors_of_explicit_subdomains_are_one_warning():
    n = 500  # a dense M has 125 250 entries in its factor
    M = np.eye(n) + np.full((n, n), 1e-3)
    made = [pm.Subdomain(M, np.ones(n), scheme=FAST, name=name) for name in "ab"]
    with pytest.warns(pm.PerformanceWarning) as caught:
        pm.Coupler(made, pm.tie(made[0], 0, made[1], 0), dt=0.1, coupling="pm")
    assert only(caught, pm.PerformanceWarning).startswith(
        "matrices of explicit subdomains are not diagonal: M of 'a' (125250 entries, 1 MB), M of "
        "'b' (125250 entries, 1 MB); every step sweeps factors of this size"
    )


@pytest.mark.parametrize(("u0", "words"), [([1, 0], "row 0:"), ([1, 2], "rows 0: 1, 1:")])
def test_one_row_is_singular(u0, words):
    a = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=SOFT, u0=u0)
    b = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=SOFT)
    with pytest.warns(pm.ConstraintWarning, match=f"the gaps in {words}"):
        pm.Coupler([a, b], pm.tie(a, [0, 1], b, [0, 1]), dt=0.1, coupling="pm")


@pytest.mark.parametrize(("M", "words"), [([0, 1, 1], "dof 0;"), ([0, 1, 0], "dofs 0, 2;")])
def test_one_dof_is_singular(M, words):
    with pytest.raises(pm.FactorizationError, match=f"no mass at {words}"):
        pm.Subdomain(M, [1.0, 1.0, 1.0], scheme=FAST)
