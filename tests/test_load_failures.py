"""Loads and prescribed velocities that raise or return nonsense are named; what follows then."""

import math

import numpy as np
import pytest
from refusals import LOADS, PAIR, as_bytes, coupled, moved, refused, single, subdomain

import pmalpha as pm

BAD_VALUES = {
    "too short": ([1.0], ValueError, "(2,)"),
    "too long": ([1.0, 2.0, 3.0], ValueError, "(2,)"),
    "a column": ([[1.0], [2.0]], ValueError, "1-D"),
    "a row": ([[1.0, 2.0]], ValueError, "1-D"),
    "a number": (1.0, ValueError, "1-D"),
    "nothing": (None, TypeError, "real numbers"),
    "a string": ("x", TypeError, "real numbers"),
    "NaN": ([0.0, np.nan], ValueError, "[1]"),
    "inf": ([np.inf, 0.0], ValueError, "[0]"),
    "complex": ([1.0, 1j], TypeError, "complex"),
    "bool": ([True, False], TypeError, "bool"),
    "masked": (np.ma.array([1.0, 2.0], mask=[1, 0]), TypeError, "masked"),
    "ragged": ([[1.0], [1.0, 2.0]], ValueError, "value"),
}


def failing(when, fail):
    """A load that calls `fail` at this time and logs every time."""

    def load(t):
        load.times.append(t)
        if load.armed and t > when - 1e-9:
            return fail()
        return [math.sin(t), math.cos(t)]

    load.times, load.armed = [], True
    return load


@pytest.mark.parametrize("kind", BAD_VALUES)
def test_a_load_that_returns_nonsense_is_named_with_subdomain_and_time(kind):
    value, error, word = BAD_VALUES[kind]
    load = failing(0.3, lambda: value)
    coupler = coupled(force=load)
    message = refused(error, lambda: coupler.run(steps=9), "force", "'a'", "t = 0.3", word)
    assert "its value" in message
    load.armed = False
    assert_at_last_whole_step(coupler, load, 2)


def assert_at_last_whole_step(coupler, load, steps):
    """last_history ends at the last macro step, and a run continues as without the failure."""
    assert coupler.step_count == steps
    history = coupler.last_history
    assert history["a"].t.size == steps + 1 and history.multiplier_times.size == 3 * steps + 1
    reference = coupled(force=LOADS["a callable"]["force"])
    whole = reference.run(steps=steps)
    np.testing.assert_array_equal(history["a"].u, whole["a"].u)
    np.testing.assert_array_equal(history.multipliers, whole.multipliers)
    assert as_bytes(coupler) == as_bytes(reference)
    assert load.times == sorted(load.times)


class Breakdown(Exception):
    pass


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(3), GeneratorExit()])
def test_an_exit_from_a_load_is_immediate_and_no_time_is_evaluated_twice(error):
    # unlike an error it does not wait for the steps whose loads are already evaluated
    def fail():
        raise error

    load = failing(0.5, fail)
    coupler = coupled(force=load)
    with pytest.raises(type(error)):
        coupler.run(steps=9)
    load.armed = False
    assert coupler.step_count == 0
    assert as_bytes(coupler, 9) == as_bytes(coupled(force=LOADS["a callable"]["force"]), 9)
    assert load.times == sorted(load.times)
    assert len(load.times) - len(set(load.times)) == 1  # the interrupted one


def test_a_load_that_fails_at_the_start_fails_at_every_call_that_needs_it():
    def fail():
        raise Breakdown("at once")

    load = failing(0.0, fail)
    coupler = coupled(force=load)
    for call in (
        lambda: coupler.run(steps=1),
        lambda: coupler.step(),
        lambda: coupler.state("a"),
        lambda: coupler.multipliers,
    ):
        with pytest.raises(Breakdown):
            call()
    load.armed = False
    assert as_bytes(coupler) == as_bytes(coupled(force=LOADS["a callable"]["force"]))


def test_two_loads_that_fail_are_reported_by_the_earlier_failure():
    def fail_at(when):
        def load(t):
            if t > when - 1e-9:
                raise Breakdown(str(when))
            return [0.0]

        return load

    for first, second in ((0.3, 0.5), (0.5, 0.3)):
        subdomains = [single(force=fail_at(first)), single(force=fail_at(second))]
        coupler = pm.Coupler(subdomains, dt=0.1, coupling="pm")
        with pytest.raises(Breakdown, match="0.3"):
            coupler.run(steps=9)
        assert coupler.step_count == 2


def test_a_load_with_the_wrong_signature_is_refused_by_the_subdomain():
    with pytest.raises(TypeError, match="of t alone, or of t, u and v, got one with 0 required"):
        coupled(force=lambda: [0.0, 0.0])


def prescribed(velocity, v0=(0.0, 0.0)):
    a = subdomain(K=PAIR, v0=v0, name="a")
    return pm.Coupler([a], pm.Constraint({a: [[1.0, 0.0]]}, velocity=velocity), dt=0.1)


@pytest.mark.parametrize("value", [[1.0, 2.0], None, np.nan, [np.inf], "x", [1j], 1j, [[1.0]]])
def test_a_prescribed_velocity_of_nonsense_is_named_with_constraint_and_time(value):
    wrong = []

    def velocity(t):
        return value if wrong and t > 0.25 else [math.sin(t)]

    coupler = prescribed(velocity)
    wrong.append(True)
    with pytest.raises((TypeError, ValueError), match=r"velocity of constraint 0 at t = 0\.3"):
        coupler.run(steps=9)
    assert coupler.step_count == 2
    wrong.clear()
    expected = moved(prescribed(lambda t: [math.sin(t)]), 2)
    assert as_bytes(coupler) == as_bytes(expected)


def test_initial_velocities_must_fit_a_prescribed_one():
    steady = pm.SampledForce([1.0, 1.0], 0.1)
    for velocity in ([1.0], steady):
        refused(pm.ConstraintError, lambda v=velocity: prescribed(v), "velocities v0", "0 by -1")
        prescribed(velocity, v0=(1.0, 0.0))
    coupler = prescribed(lambda t: [1.0 + t])
    refused(pm.ConstraintError, lambda: coupler.run(steps=1), "velocities v0", "0 by -1")
    coupler = moved(prescribed(steady, v0=(1.0, 0.0)))
    with pytest.raises(pm.ConstraintError):
        coupler.reset(v0={"a": [0.5, 0.0]})
    assert as_bytes(coupler) == as_bytes(moved(prescribed(steady, v0=(1.0, 0.0))))


@pytest.mark.parametrize(
    ("velocity", "error"),
    [
        (pm.SampledForce(np.zeros((4, 2)), 0.1), ValueError),
        (pm.BaseAcceleration([0.0], [1.0], [1.0], dt=0.1), TypeError),
        ("fast", TypeError),
        ([1.0, 2.0], ValueError),
        ([np.nan], ValueError),
    ],
)
def test_a_velocity_that_does_not_fit_is_refused_where_it_is_given(velocity, error):
    refused(error, lambda: prescribed(velocity), "velocity")
