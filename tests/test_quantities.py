"""The table of recorded quantities: what it says of each is all that there is to say."""

import re

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.results.quantities import OF_INTERFACE, OF_SUBDOMAIN, in_units
from pmalpha.setup.rows import CoreRows

SI = {"u": "m", "t": "s", "F": "N"}


@pytest.mark.parametrize(
    "name, expected",
    [("u", "m"), ("v", "m/s"), ("a", "m/s$^2$"), ("t", "s"), ("force", "N"), ("q", None)],
)
def test_a_unit_follows_from_those_of_length_time_and_force(name, expected):
    assert in_units(OF_SUBDOMAIN[name], SI) == expected


def test_a_unit_that_needs_another_one_than_those_given_is_none():
    assert in_units(OF_INTERFACE["contact_impulses"], SI) == "N s"
    assert in_units(OF_INTERFACE["contact_impulses"], {"F": "N"}) is None
    assert in_units(OF_SUBDOMAIN["a"], {"u": "m"}) is None
    assert in_units(OF_SUBDOMAIN["dofs"], SI) is None  # a number


def test_units_of_the_table_are_made_of_u_t_and_F():
    for name, quantity in (OF_SUBDOMAIN | OF_INTERFACE).items():
        symbols = set(re.findall("[A-Za-z]+", quantity.unit))
        assert symbols <= {"u", "t", "F"} or quantity.unit == "any", name


def test_what_has_a_column_for_each_constraint_says_how_it_comes_to_the_users_rows():
    # two constraints, in the other order in the core, the second eight times that of the core
    rows = CoreRows(np.array([1, 0]), np.array([1.0, 8.0]))
    x = np.array([[16.0, 2.0]])
    expected = {"forces": [[2.0, 2.0]], "jumps": [[2.0, 128.0]]}
    for name, quantity in OF_INTERFACE.items():
        if quantity.columns == "constraints" and quantity.made is None:
            np.testing.assert_array_equal(
                getattr(rows, quantity.rows)(x), expected[quantity.rows], name
            )
        else:
            assert not quantity.rows, name


def test_a_multiple_of_a_constraint_has_its_force_divided_and_its_jump_multiplied():
    def run(factor):
        mass = pm.Subdomain([2.0], [8.0], scheme=pm.Newmark(), name="mass", force=[1.0])
        held = pm.Constraint({"mass": [[factor]]}, velocity=lambda t: [0.0])
        return pm.Coupler([mass], held, dt=0.1).run(1.0)

    one, five = run(1.0), run(5.0)
    # The mass stays, so the multiplier balances the load of 1: -1 and -1/5, to rounding. Tolerance:
    # a few roundings of numbers of size 1.
    np.testing.assert_allclose(one.multipliers, -1.0, atol=1e-14)
    np.testing.assert_allclose(five.multipliers, -0.2, atol=1e-14)
