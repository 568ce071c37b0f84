"""Calls of a coupler that are refused leave it, bitwise, as it was."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import numpy as np
import pytest
from refusals import (
    LOADS,
    as_bytes,
    coupled,
    moved,
    refused,
    single,
    subdomain,
    two_subdomains,
)

import pmalpha as pm


def refused_coupler(error, subdomains, *words, constraints=None):
    def make():
        pm.Coupler(subdomains, constraints, dt=0.1, coupling="pm")

    return refused(error, make, *words)


# ---- the schedule -------------------------------------------------------------------------------


def test_substeps_must_divide_the_largest():
    subdomains = [single(substeps=ss) for ss in (6, 3, 4)]
    refused_coupler(ValueError, subdomains, "substeps", "divide", "6", "got 4")


def test_double_steps_of_all_finest_subdomains_are_a_value_error():
    finest = {"double_step": True, "substeps": 2}
    subdomains = [single(**finest), single(**finest), single()]
    refused_coupler(ValueError, subdomains, "double_step", "finest", "substeps = 2")
    pm.Coupler(subdomains, dt=0.1, coupling="gc")  # no double steps under "gc"
    pm.Coupler([single(double_step=True)], dt=0.1)  # nor for a single subdomain


@pytest.mark.parametrize("name, good", [("coupling", "'pm'"), ("start", "'rebased'")])
@pytest.mark.parametrize("value", ["PM", "", None, 1, np.array(["pm", "gc"])])
def test_an_unknown_word_is_a_value_error_with_the_known_ones(name, good, value):
    given = {"coupling": "gc", name: value}
    with pytest.raises((ValueError, TypeError)) as caught:
        pm.Coupler([subdomain(), subdomain()], dt=0.1, **given)
    assert name in str(caught.value) and good in str(caught.value)


def test_subdomains_are_a_list_of_different_subdomains():
    a = subdomain()
    refused_coupler(TypeError, a, "subdomains", "list")
    refused(TypeError, lambda: pm.Coupler(None, dt=0.1), "subdomains", "None")
    refused_coupler(TypeError, [a, "b"], "subdomains", "'b'")
    refused_coupler(ValueError, [], "subdomains", "empty")
    refused_coupler(ValueError, [a, a], "subdomains", "twice")


def test_names_must_differ_also_from_default_names():
    refused_coupler(ValueError, [subdomain(name="x"), subdomain(name="x")], "names", "x twice")
    pair = [subdomain(name="subdomain 1"), subdomain()]
    refused_coupler(ValueError, pair, "names", "subdomain 1 twice")


@pytest.mark.parametrize("name", ["", 5, b"a", True, ["a"]])
def test_a_name_is_a_string_that_is_not_empty(name):
    refused(TypeError, lambda: subdomain(name=name), "name", repr(name))


def test_a_constraint_on_a_subdomain_of_another_coupler_is_a_value_error():
    a, b, foreign = subdomain(), subdomain(), subdomain(name="foreign")
    ties = [pm.tie(a, [0], b, [0]), pm.tie(b, [1], foreign, [1])]
    refused_coupler(ValueError, [a, b], "constraint 1", "'foreign'", constraints=ties)


def test_constraints_are_constraints():
    a = subdomain()
    refused(TypeError, lambda: pm.Coupler([a], [np.eye(2)], dt=0.1), "constraints")
    refused(TypeError, lambda: pm.Coupler([a], 5, dt=0.1), "constraints", "5")


# ---- running ------------------------------------------------------------------------------------


def test_t_end_so_far_away_that_its_steps_cannot_be_counted_is_a_value_error():
    coupler = pm.Coupler([single()], dt=1e-300)
    refused(ValueError, lambda: coupler.run(1e300, record={}), "t_end", "1e+300")


def test_unknown_names_are_refused_with_the_known_ones():
    coupler = coupled()
    history = coupler.run(steps=1)
    foreign = subdomain(name="foreign")
    for key in ("c", foreign, 1.0, None, True):
        refused(KeyError, lambda: history[key], "'a', 'b'")
        refused(KeyError, lambda: coupler.state(key), "'a', 'b'")
        refused(ValueError, lambda: coupler.run(steps=1, record={key: None}), "record", "'a', 'b'")
    for key in (2, -3):
        refused(IndexError, lambda: history[key], "2 subdomains", str(key))
        refused(IndexError, lambda: coupler.state(key), "2 subdomains", str(key))
        refused(ValueError, lambda: coupler.run(steps=1, record={key: None}), "record", str(key))


@pytest.mark.parametrize("name", ["u0", "v0", "force"])
@pytest.mark.parametrize("key", ["c", 2, None])
def test_an_unknown_name_in_reset_is_a_value_error_with_the_argument(name, key):
    values = {key: np.zeros(2)}
    refused(ValueError, lambda: coupled().reset(**{name: values}), name)


@pytest.mark.parametrize("name", ["u0", "v0", "force"])
def test_reset_takes_dicts(name):
    refused(TypeError, lambda: coupled().reset(**{name: [0.0, 0.0]}), name, "dict")


@pytest.mark.parametrize("name", ["u0", "v0", "force"])
def test_a_subdomain_named_twice_in_reset_is_a_value_error(name):
    a, b, tie = two_subdomains()
    coupler = pm.Coupler([a, b], tie, dt=0.1, coupling="pm")
    same = {"u0": [1.0, 0.5], "v0": [0.0, 0.25], "force": [0.0, 0.0]}[name]
    values = {a: same, "a": same}
    refused(ValueError, lambda: coupler.reset(**{name: values}), name, "a", "twice")


def test_a_subdomain_named_twice_in_record_is_a_value_error():
    refused(
        ValueError, lambda: coupled().run(steps=1, record={"a": [0], 0: [1]}), "record", "twice"
    )


def test_record_is_a_dict_of_dofs():
    coupler = coupled()
    refused(TypeError, lambda: coupler.run(steps=1, record=["a"]), "record", "dict")
    refused(TypeError, lambda: coupler.run(steps=1, record={"a": [0.0]}), "record['a']")
    refused(TypeError, lambda: coupler.run(steps=1, record={"a": 0.0}), "record['a']")
    refused(ValueError, lambda: coupler.run(steps=1, record={"a": [2]}), "record['a']", "0..1", "2")
    refused(ValueError, lambda: coupler.run(steps=1, record={"a": [-3]}), "record['a']", "-3")
    refused(ValueError, lambda: coupler.run(steps=1, record={"a": [1, 1]}), "record['a']", "repeat")


def test_a_subdomain_that_was_not_recorded_is_a_key_error():
    history = coupled().run(steps=1, record={"b": None})
    refused(KeyError, lambda: history["a"], "'a' was not recorded")


# ---- after a refusal ----------------------------------------------------------------------------


REFUSALS = {
    "t_end between steps": lambda c: c.run(1.2345),
    "t_end behind": lambda c: c.run(0.0),
    "no end": lambda c: c.run(),
    "negative steps": lambda c: c.step(-1),
    "steps as bool": lambda c: c.run(steps=True),
    "every": lambda c: c.run(steps=2, every=0),
    "record of an unknown subdomain": lambda c: c.run(steps=2, record={"c": None}),
    "record out of range": lambda c: c.run(steps=2, record={"a": [5]}),
    "a History of a terabyte": lambda c: c.run(steps=10**12),
    "state of an unknown subdomain": lambda c: c.state("c"),
    "reset, u0 of an unknown subdomain": lambda c: c.reset(u0={"c": [0.0]}),
    "reset, u0 of wrong shape": lambda c: c.reset(u0={"a": [0.0]}),
    "reset, v0 that is NaN": lambda c: c.reset(u0={"a": [0.0, 0.0]}, v0={"b": [np.nan]}),
    "reset, v0 that breaks the tie": lambda c: c.reset(u0={"a": [0.0, 0.0]}, v0={"b": [9.0]}),
    "reset, force of wrong shape": lambda c: c.reset(u0={"a": [0.0, 0.0]}, force={"b": [1.0, 2.0]}),
    "reset, force of wrong size": lambda c: c.reset(
        force={"b": pm.SampledForce([[1.0, 2.0]], 0.1)}
    ),
    "reset, v0 no dict": lambda c: c.reset(u0={"a": [0.0, 0.0]}, v0=3.0),
    "a gap as an error": lambda c: c.reset(u0={"a": [0.0, 9.0]}),  # pytest makes it one
}


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("kind", REFUSALS)
def test_a_refused_call_leaves_a_coupler_as_it_was(kind, load):
    expected = moved(coupled(**LOADS[load]))
    coupler = moved(coupled(**LOADS[load]))
    with pytest.raises((TypeError, ValueError, LookupError, MemoryError, pm.ConstraintWarning)):
        REFUSALS[kind](coupler)
    assert coupler.step_count == 3 and coupler.time == expected.time
    assert as_bytes(coupler) == as_bytes(expected)


def test_a_refused_coupler_leaves_its_subdomains_as_they_were():
    expected = as_bytes(coupled())
    a, b, tie = two_subdomains()
    for bad in (
        lambda: pm.Coupler([a, b], tie, dt=-1.0, coupling="pm"),
        lambda: pm.Coupler([a, b], [tie, tie], dt=0.1, coupling="pm"),
        lambda: pm.Coupler(
            [a, b], tie, dt=10.0, coupling="pm"
        ),  # the explicit subdomain is above its critical step
        lambda: pm.Coupler([a, b, a], tie, dt=0.1, coupling="pm"),
    ):
        with pytest.raises((ValueError, pm.StabilityWarning)):
            bad()
    assert as_bytes(pm.Coupler([a, b], tie, dt=0.1, coupling="pm")) == expected


def test_solve_names_an_option_that_a_coupler_has():
    spring = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark())
    with pytest.raises(TypeError, match=r"has no 'coupling', got 'gc': .*Coupler\(\[subdomain\]"):
        pm.solve(spring, 0.1, 1.0, coupling="gc")


def test_a_mass_matrix_that_was_exchanged_with_the_stiffness_is_named():
    M, K = pm.models.shear_frame([2e3, 4e3, 4e3], [0.0, 8e6, 8e6])
    with pytest.warns(pm.ConstraintWarning, match="K is a diagonal .* are M and K exchanged"):
        pm.Coupler([pm.Subdomain(K, M, scheme=pm.Newmark())], dt=0.01)
