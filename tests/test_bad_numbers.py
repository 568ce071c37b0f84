"""Arrays, numbers and matrices that cannot be used are refused with argument, rule and value."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import warnings
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import in_turn
from refusals import (
    PAIR,
    chain,
    coupled,
    refused,
    subdomain,
)

import pmalpha as pm


def all_of_one(names, values):
    """One argument with all values, each other one with one: they are checked by one function."""
    first, *others = names
    return [*((first, value) for value in values), *in_turn(others, *values)]


# ---- arrays -------------------------------------------------------------------------------------


NOT_REAL = {
    "complex": np.array([1.0, 1.0j]),
    "objects": np.array([1.0, Fraction(1, 2)], dtype=object),
    "strings": np.array(["1", "2"]),
    "None": [1.0, None],
    "bool": np.array([True, False]),
    "masked": np.ma.array([1.0, 2.0], mask=[False, True]),
    "times": np.array([1, 2], dtype="timedelta64[s]"),
    "records": np.zeros(2, dtype=[("x", float)]),
}
NOT_FINITE = {
    "nan": ([np.nan, 1.0], "nan", "[0]"),
    "inf": ([1.0, np.inf], "inf", "[1]"),
    "minus inf": ([1.0, -np.inf], "-inf", "[1]"),
}
WRONG_SHAPE = {
    "scalar": np.float64(1.0),
    "three": np.ones(3),
    "empty": np.empty(0),
    "three axes": np.ones((2, 1, 1)),
    "ragged": [[1.0, 2.0], [1.0]],
}


def of_subdomain(name, value):
    return subdomain(**{"M": [1.0, 1.0], "K": [1.0, 1.0], name: value})


ARGUMENTS = {  # the name in the message, and the call that brings the value
    "M": lambda x: of_subdomain("M", x),
    "K": lambda x: of_subdomain("K", x),
    "C": lambda x: of_subdomain("C", x),
    "u0": lambda x: of_subdomain("u0", x),
    "v0": lambda x: of_subdomain("v0", x),
    "force": lambda x: of_subdomain("force", x),
    "velocity": lambda x: pm.Constraint({subdomain(): np.eye(2)}, velocity=x),
    "values": lambda x: pm.SampledForce(x, 0.1),
    "shape": lambda x: pm.SampledForce([1.0], 0.1, shape=x),
    "record": lambda x: pm.BaseAcceleration(x, [1.0], [1.0], dt=0.1),
    "direction": lambda x: pm.BaseAcceleration([1.0], x, [1.0, 1.0], dt=0.1),
    "u0 of 'a'": lambda x: coupled().reset(u0={"a": x}),
    "v0 of 'a'": lambda x: coupled().reset(v0={"a": x}),
}


@pytest.mark.parametrize(("name", "kind"), all_of_one(ARGUMENTS, NOT_REAL))
def test_an_array_without_real_numbers_is_a_type_error(name, kind):
    refused(TypeError, lambda: ARGUMENTS[name](NOT_REAL[kind]), name)


@pytest.mark.parametrize(("name", "kind"), all_of_one(ARGUMENTS, NOT_FINITE))
def test_the_first_entry_that_is_not_finite_is_named(name, kind):
    values, value, position = NOT_FINITE[kind]
    refused(ValueError, lambda: ARGUMENTS[name](values), name, "finite", value, position)


@pytest.mark.parametrize(
    ("name", "kind"), all_of_one(ARGUMENTS, ["scalar", "three axes", "ragged", "empty"])
)
def test_an_unusable_array_is_a_value_error_with_its_name(name, kind):
    refused(ValueError, lambda: ARGUMENTS[name](WRONG_SHAPE[kind]), name)


@pytest.mark.parametrize("name", ["u0", "v0", "force", "velocity", "u0 of 'a'", "v0 of 'a'"])
def test_a_vector_of_another_length_is_a_value_error_with_both_shapes(name):
    refused(ValueError, lambda: ARGUMENTS[name](np.ones(3)), name, "(2,)", "(3,)")
    refused(ValueError, lambda: ARGUMENTS[name](np.ones((2, 1))), name, "(2, 1)")


@pytest.mark.parametrize("name", "MKC")
def test_a_matrix_that_is_not_square_is_a_value_error(name):
    for A in (np.ones((2, 3)), np.ones((1, 2)), sp.csr_array(np.ones((2, 3)))):
        refused(ValueError, lambda: of_subdomain(name, A), name, "square", str(A.shape))


@pytest.mark.parametrize("name", "KC")
@pytest.mark.parametrize("form", [np.asarray, sp.csr_array, sp.coo_matrix, np.diag])
def test_matrices_of_different_size_are_a_value_error(name, form):
    refused(ValueError, lambda: of_subdomain(name, form(np.eye(3))), name, "2", "3")


@pytest.mark.parametrize("name", "MKC")
def test_a_sparse_matrix_is_checked_as_a_dense_one(name):
    def sparse(values):
        return sp.csr_array((values, (np.array([0, 1]), np.array([0, 1]))), shape=(2, 2))

    refused(TypeError, lambda: of_subdomain(name, sparse(np.array([1.0, 1.0j]))), name, "complex")
    refused(TypeError, lambda: of_subdomain(name, sparse(np.array([True, True]))), name, "bool")
    refused(ValueError, lambda: of_subdomain(name, sparse([1.0, np.nan])), name, "finite", "nan")
    refused(ValueError, lambda: of_subdomain(name, sparse([1.0, -np.inf])), name, "finite", "-inf")
    refused(ValueError, lambda: of_subdomain(name, sp.csr_array((0, 0))), name, "(0, 0)")
    refused(ValueError, lambda: of_subdomain(name, sp.coo_array(np.ones(2))), name, "2-D", "(2,)")


def test_a_sparse_matrix_in_place_of_a_vector_is_a_type_error():
    for name in ("u0", "v0", "force"):
        refused(TypeError, lambda: of_subdomain(name, sp.csr_array(np.ones((1, 2)))), name)


def test_a_sum_of_duplicates_that_overflows_is_not_finite():
    K = sp.coo_array(([1e308, 1e308], ([0, 0], [0, 0])), shape=(1, 1))
    refused(ValueError, lambda: subdomain([1.0], K), "K", "finite", "inf")


def test_a_matrix_is_required():
    refused(TypeError, lambda: subdomain(K=None), "K", "None")
    refused(TypeError, lambda: subdomain(M=None), "M")


def test_a_subdomain_without_dofs_is_a_value_error():
    for empty in ([], np.empty(0), np.empty((0, 0)), sp.csr_array((0, 0))):
        refused(ValueError, lambda: subdomain(empty, empty), "M", "empty")


class ArrayLike:
    """Converted to an array by NumPy, though it has no shape and no length."""

    def __array__(self, dtype=None, copy=None):
        return np.array([1.0, 2.0])


def test_anything_that_numpy_converts_to_an_array_is_accepted():
    assert subdomain(ArrayLike(), ArrayLike(), u0=ArrayLike()).n == 2


def test_a_long_double_too_large_for_a_double_is_not_finite():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of NumPy's cast, and meant
        large = np.array([np.longdouble("1e400"), 1.0])
        refused(ValueError, lambda: subdomain(u0=large), "u0", "finite", "inf")


# ---- numbers ------------------------------------------------------------------------------------


NUMBERS = {
    "rho": pm.GeneralizedAlpha,
    "beta": lambda x: pm.Newmark(beta=x),
    "gamma": lambda x: pm.Newmark(gamma=x),
    "alpha": pm.HHT,
    "am": lambda x: pm.Scheme(x, 0.0, 0.25, 0.5),
    "af": lambda x: pm.Scheme(0.0, x, 0.25, 0.5),
    "dt": lambda x: pm.Coupler([subdomain()], dt=x),
    "t_end": lambda x: pm.Coupler([subdomain()], dt=0.1).run(x),
}


@pytest.mark.parametrize(
    ("name", "value"),
    all_of_one(NUMBERS, [True, np.True_, "0.5", [0.5], 0.5j, np.array([0.5, 0.5])]),
)
def test_a_bool_or_anything_but_a_number_is_a_type_error(name, value):
    refused(TypeError, lambda: NUMBERS[name](value), name, "real number", repr(value))


@pytest.mark.parametrize(("name", "value"), all_of_one(NUMBERS, [np.nan, np.inf, -np.inf]))
def test_a_number_that_is_not_finite_is_a_value_error(name, value):
    refused(ValueError, lambda: NUMBERS[name](value), name, str(value))


@pytest.mark.parametrize("name", NUMBERS)
def test_a_whole_number_that_no_double_can_hold_is_a_value_error(name):
    refused(ValueError, lambda: NUMBERS[name](10**400), name)


@pytest.mark.parametrize("rho", [-1e-9, 1.0 + 1e-9, 1.5, -0.5, 1e300])
@pytest.mark.parametrize("explicit", [False, True])
def test_rho_outside_0_to_1_is_a_value_error(rho, explicit):
    refused(
        ValueError, lambda: pm.GeneralizedAlpha(rho, explicit), "rho must lie in [0, 1]", str(rho)
    )


def test_rho_at_the_ends_of_its_range_is_accepted():
    for rho in (0, 1, 0.0, 1.0, np.float32(0.5), Fraction(1, 2), np.array(0.5)):
        assert pm.GeneralizedAlpha(rho).rho == float(rho)


def test_parameters_of_the_other_schemes_have_their_ranges():
    refused(ValueError, lambda: pm.Newmark(beta=-0.1), "beta", "at least 0", "-0.1")
    refused(ValueError, lambda: pm.Newmark(gamma=0.4), "gamma", "at least 0.5", "0.4")
    refused(ValueError, lambda: pm.HHT(0.34), "alpha", "[0, 0.333333]", "0.34")
    refused(ValueError, lambda: pm.HHT(-0.1), "alpha", "-0.1")
    refused(ValueError, lambda: pm.WBZ(1.01), "alpha", "[0, 1]", "1.01")
    refused(ValueError, lambda: pm.Scheme(0.0, 0.0, 0.0, 0.5), "beta", "implicit")
    refused(ValueError, lambda: pm.Scheme(0.0, 1.0, 0.25, 0.5), "af", "1")
    refused(ValueError, lambda: pm.Scheme(0.0, 0.0, 0.25, 0.0), "gamma", "positive")
    refused(TypeError, lambda: pm.GeneralizedAlpha(0.5, explicit=1), "explicit", "1")
    refused(TypeError, lambda: pm.Scheme(0.0, 0.0, 0.25, 0.5, explicit="no"), "explicit", "no")


@pytest.mark.parametrize("dt", [0, 0.0, -0.0, -1.0, -1e-300])
def test_a_step_that_is_not_positive_is_a_value_error(dt):
    refused(ValueError, lambda: pm.Coupler([subdomain()], dt=dt), "dt must be positive", repr(dt))
    refused(ValueError, lambda: pm.SampledForce([1.0], dt), "dt must be positive", repr(dt))


WHOLE = {
    "substeps": lambda x: subdomain(substeps=x),
    "steps": lambda x: pm.Coupler([subdomain()], dt=0.1).run(steps=x),
    "n": lambda x: pm.Coupler([subdomain()], dt=0.1).step(x),
    "every": lambda x: pm.Coupler([subdomain()], dt=0.1).run(steps=1, every=x),
}


@pytest.mark.parametrize(
    ("name", "value"), all_of_one(WHOLE, [True, False, np.True_, 1.0, 2.5, "2", [2], np.nan])
)
def test_anything_but_a_whole_number_is_a_type_error(name, value):
    refused(TypeError, lambda: WHOLE[name](value), name, "whole number", repr(value))


@pytest.mark.parametrize("value", [-1, -(10**30)])
@pytest.mark.parametrize("name", WHOLE)
def test_a_negative_count_is_a_value_error(name, value):
    refused(ValueError, lambda: WHOLE[name](value), name, "at least", str(value))


def test_zero_counts_are_refused_where_they_mean_nothing():
    refused(ValueError, lambda: subdomain(substeps=0), "substeps must be at least 1", "got 0")
    refused(ValueError, lambda: WHOLE["every"](0), "every must be at least 1", "got 0")
    coupler = coupled()
    coupler.step(0)
    assert coupler.run(steps=0)["a"].t.size == 1


@pytest.mark.parametrize("name", ["substeps", "n", "every"])
def test_a_count_beyond_all_counters_is_a_value_error(name):
    # of `steps` the History does not fit, which is the MemoryError of another test
    if name == "substeps":
        refused(
            ValueError,
            lambda: pm.Coupler([subdomain(substeps=10**30)], dt=0.1),
            "substeps",
            "at most",
        )
    else:
        refused(ValueError, lambda: WHOLE[name](10**30), name, str(10**30))


@pytest.mark.parametrize("value", [1, 0, "yes", 2.0, np.array([True, False])])
def test_double_step_is_none_true_or_false_and_no_number(value):
    refused(TypeError, lambda: subdomain(double_step=value), "double_step", repr(value))


def test_a_scheme_is_required():
    for scheme in (None, 0.5, "newmark", pm.CentralDifference):
        refused(TypeError, lambda: subdomain(scheme=scheme), "scheme", repr(scheme))
    refused(TypeError, lambda: pm.Subdomain([1.0], [1.0]), "scheme")


# ---- symmetry -----------------------------------------------------------------------------------


GYROSCOPIC = np.array([[0.0, 0.5], [-0.5, 0.0]])
FOLLOWER = np.array([[2.0, -1.0], [-0.25, 2.0]])


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array, sp.csc_matrix, sp.coo_array])
def test_gyroscopic_damping_and_follower_stiffness_are_refused_with_the_entry(form):
    message = refused(ValueError, lambda: subdomain(C=form(GYROSCOPIC)), "C must be symmetric")
    assert "0.5 at [0, 1]" in message and "-0.5 at [1, 0]" in message
    message = refused(ValueError, lambda: subdomain(K=form(FOLLOWER)), "K must be symmetric")
    assert "-1 at [0, 1]" in message and "-0.25 at [1, 0]" in message
    refused(ValueError, lambda: subdomain(M=form(FOLLOWER)), "M must be symmetric")
    refused(
        ValueError,
        lambda: pm.BaseAcceleration([1.0], [1.0, 1.0], form(FOLLOWER), dt=0.1),
        "symmetric",
    )


def test_the_entry_named_is_the_one_that_is_not_symmetric():
    K = chain(50).toarray()
    K[31, 7] = 0.125
    message = refused(ValueError, lambda: subdomain(np.ones(50), K), "K must be symmetric", "0.125")
    assert "[31, 7]" in message and "[7, 31]" in message
    refused(ValueError, lambda: subdomain(np.ones(50), sp.csr_array(K)), "[31, 7]", "0.125")


def test_a_matrix_that_is_symmetric_but_for_the_rounding_of_its_assembly_is_accepted():
    K = np.array([[2.0, -1.0], [-1.0 * (1 + 4e-16), 2.0]])  # two units in the last place
    a, b = subdomain(K=K, u0=[1.0, 0.0]), subdomain(K=PAIR, u0=[1.0, 0.0])
    ours, theirs = (pm.Coupler([s], dt=0.1).run(steps=10)[0].u for s in (a, b))
    # K differs by 4e-16, u is of size 1 and bends by (omega t)^2 = 3 over the run
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("size", [1.0, 1e6, 1e12, 1e15])
@pytest.mark.parametrize("form", [np.asarray, sp.csr_array])
def test_gyroscopic_damping_is_not_lost_beside_a_large_entry_elsewhere(size, form):
    # a penalty dashpot on another dof does not affect the rounding of these entries
    C = np.zeros((3, 3))
    C[0, 0], C[1, 2], C[2, 1] = size, 1.0, -1.0
    refused(ValueError, lambda: subdomain(np.ones(3), np.ones(3), form(C)), "C must be symmetric")
