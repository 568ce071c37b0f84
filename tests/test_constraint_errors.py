"""Ties and constraints that cannot be used; rows that depend on others; initial values."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import time

import numpy as np
import pytest
import scipy.sparse as sp
from refusals import (
    EXPLICIT,
    refused,
    single,
    subdomain,
)
from test_bad_numbers import NOT_REAL

import pmalpha as pm

# ---- ties and constraints -----------------------------------------------------------------------


def test_dofs_of_a_tie_must_be_in_range_whole_and_different():
    a, b = single(3), single(4)
    for bad, *words in (
        ([3], "0..2", "3"),
        ([-4], "-3..2", "-4"),
        ([0, 99, 100], "0..2", "99, 100"),
    ):
        refused(ValueError, lambda: pm.tie(a, bad, b, range(len(bad))), "dofs_a", *words)
    refused(ValueError, lambda: pm.tie(a, [0], b, [4]), "dofs_b", "0..3", "4")
    refused(ValueError, lambda: pm.tie(a, [0, 1, 0], b, [0, 1, 2]), "dofs_a", "repeat", "0")
    refused(ValueError, lambda: pm.tie(a, [0, 1, 2], b, [3, 1, 3]), "dofs_b", "repeat", "3")


def test_masked_dofs_are_refused():
    a, b = single(3), single(3)
    masked = np.ma.array([0, 1], mask=[False, True])
    refused(TypeError, lambda: pm.tie(a, masked, b, [0, 1]), "dofs_a", "masked")


def test_both_sides_of_a_tie_have_equally_many_dofs():
    a, b = single(3), single(4)
    refused(ValueError, lambda: pm.tie(a, [0, 1], b, [0]), "the same length", "2 and 1")
    refused(ValueError, lambda: pm.tie(a, [], b, []), "at least one", "0 and 0")


def test_a_tie_needs_two_different_subdomains():
    a = single(3)
    refused(ValueError, lambda: pm.tie(a, [0], a, [1]), "different")
    refused(TypeError, lambda: pm.tie(a, [0], 3, [1]), "Subdomain", "3")
    refused(TypeError, lambda: pm.tie(None, [0], a, [1]), "Subdomain", "None")


@pytest.mark.parametrize("kind", NOT_REAL)
def test_a_constraint_without_real_numbers_is_a_type_error(kind):
    row = np.ma.atleast_2d(NOT_REAL[kind]) if kind == "masked" else np.atleast_2d(NOT_REAL[kind])
    refused(TypeError, lambda: pm.Constraint({subdomain(): row}), "L of")


def test_a_constraint_must_be_finite_and_fit_its_subdomain():
    a = subdomain(name="a")
    for form in (np.asarray, sp.csr_array):
        refused(ValueError, lambda: pm.Constraint({a: form([[1.0, np.nan]])}), "'a'", "nan")
        refused(ValueError, lambda: pm.Constraint({a: form([[1.0, 0.0, 0.0]])}), "'a'", "2 columns")
        refused(ValueError, lambda: pm.Constraint({a: form([[1.0, 0.0], [0.0, 0.0]])}), "row 1")
    refused(ValueError, lambda: pm.Constraint({a: [1.0, 0.0]}), "'a'", "2-D", "(2,)")
    refused(ValueError, lambda: pm.Constraint({a: sp.coo_array([1.0, 0.0])}), "'a'", "2-D", "(2,)")
    refused(ValueError, lambda: pm.Constraint({a: np.empty((0, 2))}), "at least one")


def test_constraints_have_equally_many_rows_on_all_subdomains():
    a, b = subdomain(), subdomain()
    refused(ValueError, lambda: pm.Constraint({a: np.eye(2), b: -np.eye(2)[:1]}), "rows", "[1, 2]")


@pytest.mark.parametrize("bad", [{}, None, [1.0], np.eye(2), 5])
def test_a_constraint_takes_a_dict(bad):
    refused(TypeError, lambda: pm.Constraint(bad), "matrices", "dict")


def test_a_constraint_is_keyed_by_subdomains():
    refused(TypeError, lambda: pm.Constraint({3: np.eye(2)}), "Subdomain", "3")


# ---- dependent constraints ----------------------------------------------------------------------


def dependent(subdomains, constraints):
    return refused(
        pm.ConstraintError,
        lambda: pm.Coupler(subdomains, constraints, dt=0.1, coupling="pm"),
        "must be linearly independent",
    )


def test_a_ring_of_ties_at_a_cross_point_has_one_redundant_tie():
    a, b, c, d = (single(2) for _ in range(4))
    ring = [pm.tie(a, [0], b, [0]), pm.tie(b, [0], c, [0]), pm.tie(c, [0], d, [0])]
    pm.Coupler([a, b, c, d], ring, dt=0.1, coupling="pm")
    message = dependent([a, b, c, d], [*ring, pm.tie(d, [0], a, [0])])
    assert "1 of 4 rows" in message
    assert all(f"(row 0 of constraint {i})" in message for i in range(4))


def test_ties_of_all_pairs_at_a_cross_point_have_one_redundant_row_per_cycle():
    subdomains = [single() for _ in range(5)]
    pairs = [pm.tie(a, [0], b, [0]) for i, a in enumerate(subdomains) for b in subdomains[:i]]
    assert "6 of 10 rows" in dependent(subdomains, pairs)  # 10 edges, 4 in a tree


def test_the_same_row_in_two_constraints_is_named_in_both():
    a, b = single(3), single(3)
    rows = pm.Constraint({a: [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0]], b: [[0, 0, -2.0], [0, -1.0, 0]]})
    message = dependent([a, b], [rows, pm.tie(a, [1, 2], b, [0, 2])])
    assert "row 0 of constraint 0" in message and "row 1 of constraint 1" in message
    assert "1 of 4 rows" in message


def test_a_row_that_is_a_multiple_of_another_is_dependent_whatever_its_scale():
    a, b = single(3), single(3)
    for scale in (1.0, -1.0, 1e-8, 1e12):
        L = np.array([[1.0, 2.0, 0.5], [scale, 2.0 * scale, 0.5 * scale]])
        message = dependent([a, b], pm.Constraint({a: L, b: L}))
        assert "row 0" in message and "1" in message


def test_the_rows_of_a_linear_combination_are_named_and_no_others():
    rng = np.random.default_rng(5)
    a, b = single(9), single(8)
    L = rng.normal(size=(8, 17))
    L[5] = 3.0 * L[1] - 0.5 * L[2] + 0.01 * L[7]
    message = dependent([a, b], pm.Constraint({a: L[:, :9], b: L[:, 9:]}))
    named = message.split("row ", 1)[1].split(";")[0]
    numbers = {int(x) for x in named.replace(",", " ").split() if x.isdigit()}
    assert numbers == {1, 2, 5, 7}


def test_more_constraints_than_dofs_are_dependent():
    a = single(2)
    assert "1 of 3 rows" in dependent([a], pm.Constraint({a: [[1.0, 0], [0, 1.0], [1.0, 1.0]]}))


def test_nearly_dependent_rows_are_accepted():
    a = single(2)
    pm.Coupler([a], pm.Constraint({a: [[1.0, 0.0], [1.0, 1e-3]]}), dt=0.1)


def test_a_dependent_row_is_found_where_the_others_are_nearly_parallel_in_pairs():
    # row 4 = 50 (row 1 - row 0 + row 3 - row 2), and 5 rows in 4 dofs are dependent anyway
    a = single(4, scheme=EXPLICIT)
    rows = [[1, 0, 0, 0], [1, 0.02, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0.02], [0, 1, 0, 1]]
    pm.Coupler([a], pm.Constraint({a: rows[:4]}), dt=0.1)
    assert "1 of 5 rows" in dependent([a], pm.Constraint({a: rows}))


def levers(trains, length, ratio):
    """Trains of levers v_i + ratio v_{i+1} = 0, one end held, and the sum of the other ends.

    A train with one end held cannot move, so the last row is redundant: it is a combination of the
    others with weights up to (1 / ratio)^length.
    """
    n = length + 1
    L = np.zeros((trains * n + 1, trains * n))
    for first in range(0, trains * n, n):
        L[first, first] = 1.0
        for i in range(first + 1, first + n):
            L[i, i - 1 : i + 1] = 1.0, ratio
        L[-1, first + length] = 1.0
    return L


@pytest.mark.gate
@pytest.mark.parametrize(
    "trains, length, ratio", [(2, 3, 0.05), (2, 4, 0.1), (3, 5, 0.1), (2, 8, 0.2), (300, 3, 0.05)]
)
def test_more_rows_than_dofs_are_dependent_also_at_the_end_of_long_levers(trains, length, ratio):
    # the least singular value of the other rows, at length one, is about ratio^length: 2e-6 to 1e-4
    L = levers(trains, length, ratio)
    a = single(L.shape[1], scheme=EXPLICIT)
    assert f"1 of {len(L)} rows" in dependent([a], pm.Constraint({a: sp.csr_array(L)}))


def general_rows(rng, p, n, spare):
    """p rows of one to three random entries, of which the last `spare` are combinations."""
    while True:
        L = np.zeros((p, n))
        for row in L[: p - spare]:
            row[rng.choice(n, 3, replace=False)] = rng.normal(size=3) * (rng.random(3) < 0.7)
        for row in L[p - spare :]:
            row[:] = rng.normal(size=p - spare) * (rng.random(p - spare) < 0.3) @ L[: p - spare]
        lengths = np.linalg.norm(L, axis=1)
        if lengths.min() > 0.0:
            scaled = L[: p - spare] / lengths[: p - spare, None]
            if np.linalg.svd(scaled, compute_uv=False)[-1] > 1e-3:  # clearly independent
                return rng.permutation(L)


@pytest.mark.parametrize("spare", [1, 2, 5])
def test_the_number_of_dependent_general_rows_is_found(spare):
    rng = np.random.default_rng(spare)
    a = single(40, scheme=EXPLICIT)
    reported = []
    for _ in range(12):
        L = general_rows(rng, int(rng.integers(spare + 5, 35)), 40, spare)
        message = dependent([a], pm.Constraint({a: L}))
        reported.append(int(message.split("; ")[1].split()[0]))
    assert reported == [spare] * 12


def test_general_rows_that_are_independent_are_accepted():
    rng = np.random.default_rng(0)
    a = single(40, scheme=EXPLICIT)
    for _ in range(12):
        pm.Coupler([a], pm.Constraint({a: general_rows(rng, 30, 40, 0)}), dt=0.1)


def seconds(call):
    """Of this process, whatever else the machine does."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


MANY = 100_000
# It takes 0.2 to 0.6 s; a dense matrix of this size would take 80 GB, and a quadratic way minutes.
SOON = 10.0


def path_of_ties(p):
    """v_i = v_{i+1}: a tree without branches, the least well-conditioned set of ties."""
    rows = np.arange(p)
    values = np.concatenate([np.ones(p), -np.ones(p)])
    where = (np.concatenate([rows, rows]), np.concatenate([rows, rows + 1]))
    return sp.csr_array((values, where), shape=(p, p + 1))


@pytest.mark.gate
def test_a_hundred_thousand_independent_ties_are_accepted_in_seconds():
    a, b = single(MANY, scheme=EXPLICIT), single(MANY, scheme=EXPLICIT)
    tie = pm.tie(a, np.arange(MANY), b, np.arange(MANY)[::-1])
    assert seconds(lambda: pm.Coupler([a, b], tie, dt=0.1, coupling="pm")) < SOON


@pytest.mark.gate
def test_a_hundred_thousand_ties_in_a_path_are_accepted_in_seconds():
    a = single(MANY + 1, scheme=EXPLICIT)
    path = pm.Constraint({a: path_of_ties(MANY)})
    assert seconds(lambda: pm.Coupler([a], path, dt=0.1)) < SOON


@pytest.mark.gate
@pytest.mark.parametrize("many, ends", [(MANY, (0, MANY)), (8000, (4000, 4003))])
def test_one_dependent_row_among_a_hundred_thousand_is_found(many, ends):
    # a tie of two dofs of the path closes a cycle of the rows between them
    a = single(many + 1, scheme=EXPLICIT)
    closing = sp.csr_array(([1.0, -1.0], ([0, 0], ends)), shape=(1, many + 1))
    constraints = [pm.Constraint({a: path_of_ties(many)}), pm.Constraint({a: closing})]
    begin = time.process_time()
    message = dependent([a], constraints)
    assert time.process_time() - begin < SOON
    assert f"1 of {many + 1} rows" in message
    if ends[1] - ends[0] == 3:
        for row in (*range(*ends), many):
            assert str(row) in message
        assert "4004" not in message and "3999" not in message


@pytest.mark.gate
def test_a_row_given_twice_among_a_hundred_thousand_is_found():
    a, b = single(MANY, scheme=EXPLICIT), single(MANY, scheme=EXPLICIT)
    constraints = [pm.tie(a, np.arange(MANY), b, np.arange(MANY)), pm.tie(b, [77_777], a, [77_777])]
    message = dependent([a, b], constraints)
    assert "row 77777 of constraint 0" in message and "row 0 of constraint 1" in message


@pytest.mark.parametrize("scale", [1e-160, 1e-300, 1e160, 1e300])
def test_independent_rows_of_extreme_scale_are_not_reported_as_dependent(scale):
    # another error (H under- or overflows) may be reported, but not this one
    a, b = single(2), single(2)
    L = np.diag([1.0, scale])
    try:
        pm.Coupler([a, b], pm.Constraint({a: L, b: -L}), dt=0.1, coupling="pm")
    except (pm.PmalphaError, ValueError) as error:
        assert "linearly independent" not in str(error)


# ---- initial values -----------------------------------------------------------------------------


def test_initial_values_whose_forces_overflow_are_an_error():
    # a(0) = -K u / M is infinite
    def run():
        coupler = pm.Coupler([subdomain([1.0], [1e200], u0=[1e200])], dt=0.1)
        coupler.step()

    # h^2 K / M = 1e198, warned of beforehand
    warned = pytest.warns(pm.StabilityWarning, match=r"down to 1 with h\^2 K / M = 1e\+198")
    with warned, pytest.raises((pm.InstabilityError, ValueError)):
        run()


def test_a_first_load_that_gives_an_infinite_acceleration_is_an_error():
    # F(0) / M = 1e308 / 1e-5 is infinite, F is zero from the first step on
    push = pm.SampledForce([1e308, 0.0, 0.0], 0.01, shape=[1.0])
    with pytest.raises((pm.InstabilityError, ValueError)):
        pm.Coupler([subdomain([1e-5], [1.0], force=push)], dt=0.1).step()


def gaussian(t):
    return [np.exp(-(((t - 0.5) / 0.05) ** 2))]


def test_a_pulse_may_begin_with_the_rounding_of_zero():
    driven = subdomain([1.0, 1.0], np.array([[1.0, -1.0], [-1.0, 1.0]]))
    coupler = pm.Coupler(
        [driven], pm.Constraint({driven: [[1.0, 0.0]]}, velocity=gaussian), dt=0.01
    )
    assert 0.0 < gaussian(0.0)[0] < 1e-40
    assert coupler.run(1.0)[0].v[50, 0] == 1.0  # at its peak, t = 0.5


@pytest.mark.parametrize("share", [1e-8, 1.0])
def test_a_velocity_that_begins_with_more_than_rounding_of_what_it_reaches_is_refused(share):
    def velocity(t):
        return [share if t == 0.0 else 1.0]

    driven = subdomain()
    coupler = pm.Coupler([driven], pm.Constraint({driven: [[1.0, 0.0]]}, velocity=velocity), dt=0.1)
    with pytest.raises(pm.ConstraintError, match=f"violated in row 0 by -{share:g}$"):
        coupler.step()


def test_a_pulse_that_is_not_defined_for_ever_is_judged_by_what_it_is_before():
    def velocity(t):
        if t > 0.2:
            raise ValueError("beyond the end of the record")
        return [1e-30 if t == 0.0 else t]

    driven = subdomain()
    coupler = pm.Coupler([driven], pm.Constraint({driven: [[1.0, 0.0]]}, velocity=velocity), dt=0.1)
    coupler.step(2)
    assert coupler.state(0).v[0] == pytest.approx(0.2, rel=1e-14)  # rounding of a step


@pytest.mark.filterwarnings("error::pmalpha.ConstraintWarning")
def test_a_dof_that_is_held_where_it_was_displaced_leaves_no_gap():
    held = subdomain(u0=[0.5, 0.0])
    coupler = pm.Coupler([held], pm.Constraint({held: [[1.0, 0.0]]}), dt=0.1)
    coupler.step(5)
    assert coupler.state(0).u[0] == 0.5
