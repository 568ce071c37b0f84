"""Bad input raises the documented error in the call that brought it, and changes nothing.

In all of these tests the message names the argument, the rule and the value, and after a refusal a
run is bitwise identical to one without the refused call.
"""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import copy
import math
import pickle
import subprocess
import sys
import time
import warnings
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
import waits

import pmalpha as pm
from pmalpha import memory

IMPLICIT = pm.GeneralizedAlpha(0.5)
EXPLICIT = pm.GeneralizedAlpha(0.5, explicit=True)
PAIR = np.array([[2.0, -1.0], [-1.0, 2.0]])  # two unit masses between walls


def refused(error, call, *words):
    """The message of exactly this error, which must contain all of these words."""
    with pytest.raises(error) as caught:
        call()
    assert type(caught.value) is error, f"{type(caught.value).__name__}: {caught.value}"
    message = str(caught.value)
    for word in words:
        assert word in message, f"no {word!r} in: {message}"
    return message


def subdomain(M=(1.0, 1.0), K=(1.0, 1.0), C=None, *, scheme=IMPLICIT, **options):
    return pm.Subdomain(M, K, C, scheme=scheme, **options)


def single(n=1, **options):
    """A chain of n unit masses and springs without couplings."""
    return subdomain(np.ones(n), np.ones(n), **options)


def chain(n, fixed=True):
    """Stiffness of unit springs in a row, between two walls or floating."""
    d = np.full(n, 2.0)
    if not fixed:
        d[[0, -1]] = 1.0
    side = np.full(n - 1, -1.0)
    return sp.csr_array(sp.diags_array([d, side, side], offsets=[0, 1, -1]))


def two_subdomains(**of_a):
    """A coarse and a fine subdomain, tied, with motion in all of their dofs."""
    a = subdomain(K=PAIR, u0=[1.0, 0.5], v0=[0.0, 0.25], name="a", **of_a)
    b = subdomain([1.0], [9.0], scheme=EXPLICIT, substeps=3, u0=[0.5], v0=[0.25], name="b")
    return a, b, pm.tie(a, [1], b, [0])


def coupled(**of_a):
    a, b, tie = two_subdomains(**of_a)
    return pm.Coupler([a, b], tie, dt=0.1, coupling="pm")


def as_bytes(coupler, steps=4):
    """All results of some macro steps and the state at their end, as bytes."""
    history = coupler.run(steps=steps)
    arrays = [getattr(history[i], x) for i in range(len(history)) for x in "tuva"]
    end = [getattr(coupler.state(i), x) for i in range(len(history)) for x in "uva"]
    rest = [history.multipliers, history.velocity_jump, history.displacement_jump]
    return b"".join(x.tobytes() for x in [*arrays, *rest, *end, coupler.multipliers])


def moved(coupler, steps=3):
    coupler.step(steps)
    return coupler


# ---- arrays ---------------------------------------------------------------------------------

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
    "record": lambda x: pm.BaseAcceleration(x, 0.1, [1.0], [1.0]),
    "direction": lambda x: pm.BaseAcceleration([1.0], 0.1, x, [1.0, 1.0]),
    "u0 of 'a'": lambda x: coupled().reset(u0={"a": x}),
    "v0 of 'a'": lambda x: coupled().reset(v0={"a": x}),
}


@pytest.mark.parametrize("kind", NOT_REAL)
@pytest.mark.parametrize("name", ARGUMENTS)
def test_an_array_without_real_numbers_is_a_type_error(name, kind):
    refused(TypeError, lambda: ARGUMENTS[name](NOT_REAL[kind]), name)


@pytest.mark.parametrize("kind", NOT_FINITE)
@pytest.mark.parametrize("name", ARGUMENTS)
def test_the_first_entry_that_is_not_finite_is_named(name, kind):
    values, value, position = NOT_FINITE[kind]
    refused(ValueError, lambda: ARGUMENTS[name](values), name, "finite", value, position)


@pytest.mark.parametrize("kind", ["scalar", "three axes", "ragged", "empty"])
@pytest.mark.parametrize("name", ARGUMENTS)
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


# ---- numbers --------------------------------------------------------------------------------

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


@pytest.mark.parametrize("value", [True, np.True_, "0.5", [0.5], 0.5j, np.array([0.5, 0.5])])
@pytest.mark.parametrize("name", NUMBERS)
def test_a_bool_or_anything_but_a_number_is_a_type_error(name, value):
    refused(TypeError, lambda: NUMBERS[name](value), name, "real number", repr(value))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", NUMBERS)
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


@pytest.mark.parametrize("value", [True, False, np.True_, 1.0, 2.5, "2", [2], np.nan])
@pytest.mark.parametrize("name", WHOLE)
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


# ---- symmetry -------------------------------------------------------------------------------

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
        ValueError, lambda: pm.BaseAcceleration([1.0], 0.1, [1.0, 1.0], form(FOLLOWER)), "symmetric"
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


# ---- mass and Mbar --------------------------------------------------------------------------


@pytest.mark.parametrize("form", [np.diag, np.asarray, sp.csr_array])
def test_an_explicit_dof_without_mass_is_named(form):
    M = np.diag([1.0, 0.0, 2.0, 0.0])
    M = np.diag(M).copy() if form is np.diag else form(M)
    message = refused(
        pm.FactorizationError,
        lambda: subdomain(M, np.ones(4), scheme=EXPLICIT, name="rig"),
        "'rig'",
        "mass",
    )
    assert "1, 3" in message


@pytest.mark.parametrize("n", [2, 150, 300])  # dense and Lanczos way to the critical step
@pytest.mark.parametrize("M", [[[1.0, 1.0], [1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]]])
@pytest.mark.parametrize("form", [sp.csr_array, sp.csr_array.toarray])
def test_an_explicit_mass_singular_in_another_way_is_a_factorization_error(n, M, form):
    whole = sp.csr_array(sp.block_diag([np.array(M), sp.eye_array(n - 2)]))
    rig = subdomain(form(whole), chain(n), scheme=EXPLICIT, name="rig")
    refused(pm.FactorizationError, lambda: pm.Coupler([rig], dt=0.01), "'rig'", "dof 1")


@pytest.mark.parametrize("form", [np.diag, np.asarray, sp.csr_array])
def test_a_negative_mass_is_a_value_error_with_its_dof(form):
    M = np.diag([1.0, 1.0, -2.0])
    M = np.diag(M).copy() if form is np.diag else form(M)
    refused(ValueError, lambda: subdomain(M, np.ones(3)), "M", "semidefinite", "dof 2")


def test_a_massless_dof_that_is_coupled_by_mass_is_a_value_error():
    M = np.array([[1.0, 0.5], [0.5, 0.0]])
    for form in (np.asarray, sp.csr_array):
        refused(ValueError, lambda: subdomain(form(M)), "M", "semidefinite", "dof 1")


def indefinite(form):
    K = np.diag([4.0, 4.0, -2e4])
    if form == "diagonal":
        return np.diag(K).copy()
    K[0, 1] = K[1, 0] = -1.0
    return K if form == "dense" else sp.csr_array(K)


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse"])
@pytest.mark.parametrize("scheme", [pm.GeneralizedAlpha(0.5), pm.Newmark(), pm.HHT(0.1)])
def test_an_indefinite_mbar_is_named_with_subdomain_and_dof(form, scheme):
    # Mbar = M + al1 K, al1 about dt^2 / 4 and more: 1 - 0.25 * 2e4 < 0 at dof 2, positive elsewhere
    bad = subdomain(np.ones(3), indefinite(form), scheme=scheme, name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=1.0), "Mbar", "'bad'", "dof 2")
    with pytest.warns(pm.StabilityWarning, match="the motion itself grows"):
        pm.Coupler([bad], dt=1e-3)  # definite at that dof: the step makes it indefinite


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse"])
def test_negative_damping_that_makes_an_explicit_mbar_indefinite_is_named(form):
    bad = subdomain(np.ones(3), np.ones(3), indefinite(form), scheme=EXPLICIT, name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=1.0), "M + al2 C", "'bad'", "dof 2")


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse"])
def test_a_singular_mbar_is_named_with_subdomain_and_dof(form):
    K = np.zeros((3, 3))
    K[0, 0] = 1.0
    if form != "diagonal":
        K[:2, :2] = [[2.0, -1.0], [-1.0, 2.0]]
    shape = {"diagonal": np.diag, "dense": np.asarray, "sparse": sp.csr_array}[form]
    bad = subdomain(np.zeros(3), shape(K), name="bad")
    message = refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=0.1), "'bad'", "dof")
    assert ("dof 1" if form == "diagonal" else "dof 2") in message


def test_mbar_of_nothing_but_zeros_is_singular():
    bad = subdomain(np.zeros(2), np.zeros(2), name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=0.1), "'bad'", "singular", "dof 0")


def plate(m, fixed=False):
    """Stiffness of a square net of m x m nodes with unit springs."""
    line, unit = chain(m, fixed), sp.eye_array(m)
    return sp.csr_array(sp.kron(line, unit) + sp.kron(unit, line))


FLOATING = {f"net of {m} x {m}": plate(m) for m in (2, 5, 20, 40, 60)}
FLOATING |= {f"chain of {n}": chain(n, fixed=False) for n in (2, 3, 50, 1000)}
SMALL = [name for name, K in FLOATING.items() if K.shape[0] <= 1000]  # dense ones take time


def check_floating(K, scale):
    bad = subdomain(np.zeros(K.shape[0]), scale * K, name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=0.013), "'bad'", "dof")


@pytest.mark.parametrize("name", FLOATING)
@pytest.mark.parametrize("scale", [1.0, 3.7e9])
def test_a_floating_sparse_subdomain_without_mass_is_singular(name, scale):
    check_floating(FLOATING[name], scale)


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("scale", [1.0, 3.7e9])
def test_a_floating_dense_subdomain_without_mass_is_singular(name, scale):
    check_floating(FLOATING[name].toarray(), scale)


def test_a_supported_subdomain_without_mass_is_accepted():
    held = subdomain(np.zeros(1600), plate(40, fixed=True), name="held")
    pm.Coupler([held], dt=0.013)


def test_a_mbar_that_is_nearly_singular_but_definite_is_accepted():
    # a spring to ground of 1e-6 of the others: condition number 1e6 n^2, 8 digits are left
    K = chain(50, fixed=False).tolil()
    K[0, 0] += 1e-6
    pm.Coupler([subdomain(np.zeros(50), sp.csr_array(K))], dt=0.1)


def test_a_pivot_whose_reciprocal_overflows_is_refused():
    # 1 / 5e-324 is infinite: no step could be made
    tiny = subdomain([5e-324], [0.0], name="tiny")
    with pytest.raises((pm.FactorizationError, ValueError)) as caught:
        pm.Coupler([tiny], dt=0.1)
    assert "'tiny'" in str(caught.value)


# ---- massless dofs --------------------------------------------------------------------------

UNDAMPED = {
    "rho = 1": pm.GeneralizedAlpha(1.0),
    "trapezoidal": pm.Newmark(),
    "HHT(0)": pm.HHT(0.0),
    "WBZ(0)": pm.WBZ(0.0),
}


@pytest.mark.parametrize("kind", UNDAMPED)
def test_a_massless_dof_is_refused_where_nothing_damps_it(kind):
    message = refused(
        ValueError,
        lambda: subdomain([1.0, 0.0], PAIR, scheme=UNDAMPED[kind], name="frame"),
        "scheme must damp",
        "dof 1",
        "'frame'",
    )
    assert repr(UNDAMPED[kind]) in message


def test_massless_dofs_are_accepted_with_rho_below_one():
    for rho in (0.0, 0.5, 0.99):
        subdomain([1.0, 0.0], PAIR, scheme=pm.GeneralizedAlpha(rho))


# ---- ties and constraints -------------------------------------------------------------------


def test_dofs_of_a_tie_must_be_in_range_whole_and_different():
    a, b = single(3), single(4)
    for bad, word in (([3], "3"), ([-4], "-4"), ([0, 99, 100], "99, 100")):
        refused(ValueError, lambda: pm.tie(a, bad, b, range(len(bad))), "dofs_a", "0..2", word)
    refused(ValueError, lambda: pm.tie(a, [0], b, [4]), "dofs_b", "0..3", "4")
    refused(ValueError, lambda: pm.tie(a, [0, 1, 0], b, [0, 1, 2]), "dofs_a", "repeat", "0")
    refused(ValueError, lambda: pm.tie(a, [0, 1, 2], b, [3, 1, 3]), "dofs_b", "repeat", "3")


@pytest.mark.parametrize(
    "bad",
    [[0.0], [True], ["0"], [[0]], True, 0.0, None, {0}, [None], np.array([0j]), [[0], [0, 1]]],
)
def test_dofs_of_a_tie_must_be_whole_numbers(bad):
    a, b = single(3), single(4)
    with pytest.raises((TypeError, ValueError), match="dofs_a"):
        pm.tie(a, bad, b, [0])
    with pytest.raises((TypeError, ValueError), match="dofs_b"):
        pm.tie(a, [0], b, bad)


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
    for _ in range(40):
        L = general_rows(rng, int(rng.integers(spare + 5, 35)), 40, spare)
        message = dependent([a], pm.Constraint({a: L}))
        reported.append(int(message.split("; ")[1].split()[0]))
    assert reported == [spare] * 40


def test_general_rows_that_are_independent_are_accepted():
    rng = np.random.default_rng(0)
    a = single(40, scheme=EXPLICIT)
    for _ in range(40):
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


def test_a_hundred_thousand_independent_ties_are_accepted_in_seconds():
    a, b = single(MANY, scheme=EXPLICIT), single(MANY, scheme=EXPLICIT)
    tie = pm.tie(a, np.arange(MANY), b, np.arange(MANY)[::-1])
    assert seconds(lambda: pm.Coupler([a, b], tie, dt=0.1, coupling="pm")) < SOON


def test_a_hundred_thousand_ties_in_a_path_are_accepted_in_seconds():
    a = single(MANY + 1, scheme=EXPLICIT)
    path = pm.Constraint({a: path_of_ties(MANY)})
    assert seconds(lambda: pm.Coupler([a], path, dt=0.1)) < SOON


@pytest.mark.parametrize("ends", [(0, MANY), (40_000, 40_003)])
def test_one_dependent_row_among_a_hundred_thousand_is_found(ends):
    # a tie of two dofs of the path closes a cycle of the rows between them
    a = single(MANY + 1, scheme=EXPLICIT)
    closing = sp.csr_array(([1.0, -1.0], ([0, 0], ends)), shape=(1, MANY + 1))
    constraints = [pm.Constraint({a: path_of_ties(MANY)}), pm.Constraint({a: closing})]
    begin = time.process_time()
    message = dependent([a], constraints)
    assert time.process_time() - begin < SOON
    assert f"1 of {MANY + 1} rows" in message
    if ends[1] - ends[0] == 3:
        for row in (*range(*ends), MANY):
            assert str(row) in message
        assert "40004" not in message and "39999" not in message


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


# ---- initial values -------------------------------------------------------------------------


def test_initial_velocities_that_violate_a_constraint_are_named_with_row_and_amount():
    a = subdomain(v0=[0.5, 0.25])
    b = subdomain(v0=[0.5, -0.5])
    message = refused(
        pm.ConstraintError,
        lambda: pm.Coupler([a, b], pm.tie(a, [0, 1], b, [0, 1]), dt=0.1, coupling="pm"),
        "velocities v0",
    )
    assert "1 by 0.75" in message and "0 by" not in message
    split = [pm.tie(a, [0], b, [0]), pm.tie(a, [1], b, [1])]
    message = refused(
        pm.ConstraintError, lambda: pm.Coupler([a, b], split, dt=0.1, coupling="pm"), "0.75"
    )
    assert "row 0 of constraint 1" in message


def test_initial_velocities_that_agree_to_rounding_are_accepted():
    third = 1.0 / 3.0
    a, b = subdomain(v0=[third, 1.0]), subdomain(v0=[1.0 - 2.0 * third, 1.0])
    pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm")


@pytest.mark.parametrize("scale", [1e-150, 1e-12, 1e-6, 1e6, 1e12, 1e150])
def test_a_violated_constraint_is_detected_at_any_scale_of_its_row(scale):
    # a constraint times a number is the same constraint
    a, b = subdomain(v0=[1.0, 1.0]), subdomain(v0=[1.0, 0.5])
    L = np.diag([1.0, scale])
    refused(
        pm.ConstraintError,
        lambda: pm.Coupler([a, b], pm.Constraint({a: L, b: -L}), dt=0.1, coupling="pm"),
        "velocities v0",
    )


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_a_gap_is_detected_at_any_scale_of_its_row(scale):
    a, b = subdomain(u0=[1.0, 1.0]), subdomain(u0=[1.0, 0.5])
    L = np.diag([1.0, scale])
    with pytest.warns(pm.ConstraintWarning, match="row 1"):
        pm.Coupler([a, b], pm.Constraint({a: L, b: -L}), dt=0.1, coupling="pm")


def test_a_gap_of_the_displacements_is_a_warning_with_rows_and_amounts():
    a, b = subdomain(u0=[0.5, 0.25]), subdomain(u0=[0.5, -0.5])
    with pytest.warns(pm.ConstraintWarning, match=r"gap.* row 1: 0\.75$") as caught:
        pm.Coupler([a, b], pm.tie(a, [0, 1], b, [0, 1]), dt=0.1, coupling="pm")
    assert [w.filename for w in caught] == [__file__]


def test_a_gap_is_detected_at_once_also_under_a_load_that_is_evaluated_later():
    a, b = subdomain(u0=[0.5, 0.25], force=lambda t: np.zeros(2)), subdomain()
    with pytest.warns(pm.ConstraintWarning, match=r"row 0: 0\.5"):
        pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm")


def test_initial_values_whose_forces_overflow_are_an_error():
    # a(0) = -K u / M is infinite
    def run():
        coupler = pm.Coupler([subdomain([1.0], [1e200], u0=[1e200])], dt=0.1)
        coupler.step()

    with pytest.raises((pm.InstabilityError, ValueError)):
        run()


def test_a_first_load_that_gives_an_infinite_acceleration_is_an_error():
    # F(0) / M = 1e308 / 1e-5 is infinite, F is zero from the first step on
    push = pm.SampledForce([1e308, 0.0, 0.0], 0.01, shape=[1.0])
    with pytest.raises((pm.InstabilityError, ValueError)):
        pm.Coupler([subdomain([1e-5], [1.0], force=push)], dt=0.1).step()


# ---- the schedule ---------------------------------------------------------------------------


def test_substeps_must_divide_the_largest():
    subdomains = [single(substeps=ss) for ss in (6, 3, 4)]
    refused(
        ValueError,
        lambda: pm.Coupler(subdomains, dt=0.1, coupling="pm"),
        "substeps",
        "divide",
        "6",
        "got 4",
    )


def test_double_steps_of_all_finest_subdomains_are_a_value_error():
    subdomains = [
        single(double_step=True, substeps=2),
        single(double_step=True, substeps=2),
        single(),
    ]
    message = refused(
        ValueError, lambda: pm.Coupler(subdomains, dt=0.1, coupling="pm"), "double_step", "finest"
    )
    assert "substeps = 2" in message
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
    refused(TypeError, lambda: pm.Coupler(a, dt=0.1, coupling="pm"), "subdomains", "list")
    refused(TypeError, lambda: pm.Coupler(None, dt=0.1), "subdomains", "None")
    refused(TypeError, lambda: pm.Coupler([a, "b"], dt=0.1, coupling="pm"), "subdomains", "'b'")
    refused(ValueError, lambda: pm.Coupler([], dt=0.1, coupling="pm"), "subdomains", "empty")
    refused(ValueError, lambda: pm.Coupler([a, a], dt=0.1, coupling="pm"), "subdomains", "twice")


def test_names_must_differ_also_from_default_names():
    refused(
        ValueError,
        lambda: pm.Coupler([subdomain(name="x"), subdomain(name="x")], dt=0.1, coupling="pm"),
        "names",
        "x twice",
    )
    refused(
        ValueError,
        lambda: pm.Coupler([subdomain(name="subdomain 1"), subdomain()], dt=0.1, coupling="pm"),
        "names",
        "subdomain 1 twice",
    )


@pytest.mark.parametrize("name", ["", 5, b"a", True, ["a"]])
def test_a_name_is_a_string_that_is_not_empty(name):
    refused(TypeError, lambda: subdomain(name=name), "name", repr(name))


def test_a_constraint_on_a_subdomain_of_another_coupler_is_a_value_error():
    a, b, foreign = subdomain(), subdomain(), subdomain(name="foreign")
    ties = [pm.tie(a, [0], b, [0]), pm.tie(b, [1], foreign, [1])]
    refused(
        ValueError,
        lambda: pm.Coupler([a, b], ties, dt=0.1, coupling="pm"),
        "constraint 1",
        "'foreign'",
    )


def test_constraints_are_constraints():
    a = subdomain()
    refused(TypeError, lambda: pm.Coupler([a], [np.eye(2)], dt=0.1), "constraints")
    refused(TypeError, lambda: pm.Coupler([a], 5, dt=0.1), "constraints", "5")


# ---- running --------------------------------------------------------------------------------


def test_t_end_must_be_a_whole_number_of_macro_steps():
    coupler = coupled()
    for t_end in (0.05, 0.35, 0.1 + 2e-7, 0.3 - 2e-7):
        refused(ValueError, lambda: coupler.run(t_end), "t_end", "whole number", repr(t_end))
    assert coupler.run(0.1 + 0.9e-7).macro_times[-1] == 0.1  # to 1e-6 of a step
    assert coupler.run(0.3).macro_times[-1] == 3 * 0.1


def test_t_end_before_the_present_time_is_a_value_error():
    coupler = moved(coupled(), 5)
    refused(ValueError, lambda: coupler.run(0.4), "t_end", "behind", "0.5", "0.4")
    refused(ValueError, lambda: coupler.run(-0.1), "t_end", "behind", "-0.1")
    with pytest.warns(UserWarning, match="the time is 0.5 already"):
        assert coupler.run(0.5)["a"].t.size == 1


def test_t_end_or_steps_is_given_and_not_both():
    coupler = coupled()
    refused(TypeError, lambda: coupler.run(), "t_end", "steps")
    refused(TypeError, lambda: coupler.run(0.1, steps=1), "t_end", "steps")


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


# ---- after a refusal ------------------------------------------------------------------------

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
LOADS = {
    "no load": {},
    "a constant": {"force": [0.5, -0.5]},
    "a callable": {"force": lambda t: [math.sin(t), math.cos(t)]},
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


# ---- return values of loads --------------------------------------------------------------------

BAD_VALUES = {
    "too long": ([1.0, 2.0, 3.0], ValueError, "(2,)"),
    "a column": ([[1.0], [2.0]], ValueError, "1-D"),
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


@pytest.mark.parametrize(
    "error", [Breakdown("x"), StopIteration("x"), MemoryError("x"), RecursionError("x")]
)
@pytest.mark.parametrize("run", [lambda c: c.run(steps=9), lambda c: c.step(9)])
def test_what_a_load_raises_reaches_the_caller_itself(error, run):
    def fail():
        raise error

    load = failing(0.5, fail)
    coupler = coupled(force=load)
    with pytest.raises(type(error)) as caught:
        run(coupler)
    assert caught.value is error
    assert coupler.step_count == 4
    load.armed = False
    expected = moved(coupled(force=LOADS["a callable"]["force"]), 4)
    assert as_bytes(coupler) == as_bytes(expected)
    # each time once and in order, but for the one that failed
    assert load.times == sorted(load.times)
    assert len(load.times) - len(set(load.times)) == 1


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


def test_the_load_of_the_ground_is_no_velocity():
    quake = pm.BaseAcceleration([1.0], 0.1, [1.0], [1.0])
    refused(
        TypeError, lambda: pm.Constraint({subdomain(): [[1.0, 0.0]]}, velocity=quake), "velocity"
    )
    wide, row = pm.SampledForce([[1.0, 2.0]], 0.1), {subdomain(): [[1.0, 0.0]]}
    refused(ValueError, lambda: pm.Constraint(row, velocity=wide), "velocity", "1", "2")


# ---- unstable runs --------------------------------------------------------------------------

STIFF = {
    "diagonal": 1e4 * np.array([1.0, 2.0, 3.0]),
    "dense": 1e4 * chain(3).toarray(),
    "sparse": 1e4 * chain(3),
}


def unstable(form, names="ABC", tied=True):
    """Three tied subdomains, of which only B is unstable: h omega is 5 to 10, the limit 1.87."""
    given = {
        "A": subdomain(np.ones(3), chain(3), u0=[1.0, 0.5, 0.25], name="A"),
        "B": subdomain(
            np.ones(3), STIFF[form], u0=[0.25] * 3, scheme=EXPLICIT, substeps=2, name="B"
        ),
        "C": subdomain(np.ones(3), chain(3), u0=[0.25, 0.0, 0.0], scheme=EXPLICIT, name="C"),
    }
    ties = [pm.tie(given["A"], [2], given["B"], [0]), pm.tie(given["B"], [2], given["C"], [0])]
    with pytest.warns(pm.StabilityWarning, match="'B'"):
        return pm.Coupler(
            [given[name] for name in names], ties if tied else None, dt=0.1, coupling="pm"
        )


@pytest.mark.parametrize("form", STIFF)
@pytest.mark.parametrize("names", ["ABC", "CBA", "BAC"])
@pytest.mark.parametrize("tied", [True, False])
def test_an_unstable_run_is_named_with_step_time_and_subdomain(form, names, tied):
    coupler = unstable(form, names, tied)
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10_000)
    error = caught.value
    assert isinstance(error, pm.PmalphaError)
    assert error.subdomain == "B"
    # |w| grows by (h omega)^2 < 300 per substep: 1e308 is not reached within 60 macro steps
    assert 60 < error.step < 10_000
    assert error.step == coupler.step_count and error.time == coupler.time
    assert "'B'" in str(error) and f"step {error.step}" in str(error) and "unstable" in str(error)
    assert_last_good_state_is_kept(coupler, unstable(form, names, tied), error.step)


def assert_last_good_state_is_kept(coupler, other, step):
    history = coupler.last_history
    assert history.macro_times.size == step + 1
    expected = other.run(steps=step)
    for name in "ABC":
        for x in "uva":
            assert np.isfinite(getattr(history[name], x)).all()
            ours, theirs = getattr(coupler.state(name), x), getattr(other.state(name), x)
            np.testing.assert_array_equal(ours, theirs)
            np.testing.assert_array_equal(getattr(history[name], x), getattr(expected[name], x))
    with pytest.raises(pm.InstabilityError) as again:  # it is at that step, and fails there again
        coupler.step()
    assert again.value.step == step


def test_an_unstable_coupler_can_be_reset_and_run():
    coupler = unstable("dense")
    with pytest.raises(pm.InstabilityError):
        coupler.step(10_000)
    coupler.reset()
    assert as_bytes(coupler) == as_bytes(unstable("dense"))


def test_an_unstable_implicit_subdomain_is_named():
    # negative stiffness: u = cosh(30 t), w = 900 u
    falling = subdomain([1.0], [-900.0], u0=[1.0], name="falling")
    with pytest.warns(pm.StabilityWarning, match=r"'falling'.* grows as exp\(30 t\)"):
        coupler = pm.Coupler([falling, single(name="other", substeps=2)], dt=0.001, coupling="pm")
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=100_000, every=1000)
    assert caught.value.subdomain == "falling"
    # 450 exp(30 t) = 1.8e308 at t = 23.456; h omega = 0.06 with the double step: (h omega)^2 / 2 of
    # it for an error of order 2
    assert abs(caught.value.time - 23.456) < 0.05


def test_an_instability_error_survives_pickling():
    # parameter studies in several processes return it in this way
    error = pickle.loads(pickle.dumps(pm.InstabilityError(3, 0.5, "rig")))
    assert (error.step, error.time, error.subdomain) == (3, 0.5, "rig")
    assert str(error) == str(pm.InstabilityError(3, 0.5, "rig"))


def test_the_errors_are_those_of_the_contract():
    assert issubclass(pm.ConstraintError, pm.PmalphaError)
    assert issubclass(pm.ConstraintError, ValueError)
    assert issubclass(pm.FactorizationError, pm.PmalphaError)
    assert issubclass(pm.InstabilityError, pm.PmalphaError)
    for warning in (pm.StabilityWarning, pm.ConstraintWarning):
        assert issubclass(warning, Warning)


# ---- critical steps -------------------------------------------------------------------------


def limit(scheme):
    """Largest stable h omega, in closed form."""
    if isinstance(scheme, pm.GeneralizedAlpha):
        rho = scheme.rho
        return math.sqrt(12 * (1 + rho) * (2 - rho) / (10 - 5 * rho + rho**2))
    return 1.0 / math.sqrt(scheme.gamma / 2.0 - scheme.beta)  # Newmark


CONDITIONAL = [
    *(pm.GeneralizedAlpha(rho, explicit=True) for rho in (0.0, 0.3, 0.5, 0.8, 1.0)),
    pm.CentralDifference(),
    pm.Newmark(beta=0.0, gamma=0.6),
    pm.Newmark(beta=0.1),
    pm.Newmark(beta=1.0 / 6.0),
    pm.Newmark(beta=0.2, gamma=0.55),
]
# The limit comes from a bisection on spectral radii known to 1e-7, the dense frequency from LAPACK.
CLOSE = 1e-6
# Lanczos may stop 1e-4 short of the highest frequency squared and adds 1e-3 for it.
LANCZOS = 2e-3


def oscillators(n):
    """A chain of unit masses and springs, 4 sin^2(n pi / (2 (n + 1))) its highest omega^2."""
    return np.ones(n), chain(n), 2.0 * math.sin(math.pi * n / (2 * (n + 1)))


def bar(n):
    """A bar between walls with consistent mass; the highest mode in closed form."""
    side = np.full(n - 1, 1.0 / 6.0)
    M = sp.csr_array(sp.diags_array([np.full(n, 4.0 / 6.0), side, side], offsets=[0, 1, -1]))
    angle = math.pi * n / (n + 1)
    square = (2 - 2 * math.cos(angle)) / ((4 + 2 * math.cos(angle)) / 6)
    return M, chain(n), math.sqrt(square)


def dense(problem):
    M, K, omega = problem
    return (M if M.ndim == 1 else M.toarray()), K.toarray(), omega


PROBLEMS = {
    "one mass": (oscillators(1), CLOSE),
    "chain of 7": (oscillators(7), CLOSE),
    "chain of 7, dense": (dense(oscillators(7)), CLOSE),
    "bar of 50": (bar(50), CLOSE),
    "bar of 50, dense": (dense(bar(50)), CLOSE),
    "bar of 300, dense": (dense(bar(300)), CLOSE),
    "chain of 201": (oscillators(201), LANCZOS),
    "chain of 3000": (oscillators(3000), LANCZOS),
    "bar of 201": (bar(201), LANCZOS),
    "bar of 2000": (bar(2000), LANCZOS),
    "diagonal": ((np.array([1.0, 2.0, 0.5]), np.array([4.0, 2.0, 8.0]), 4.0), CLOSE),
    "long diagonal": ((np.full(300, 0.5), np.linspace(1.0, 8.0, 300), 4.0), CLOSE),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_step_just_above_the_critical_one_warns_and_one_just_below_does_not(name):
    (M, K, omega), margin = PROBLEMS[name]
    rig = subdomain(M, K, scheme=EXPLICIT, substeps=4, name="rig")
    critical = limit(EXPLICIT) / omega
    pm.Coupler([rig], dt=4 * critical * (1.0 - margin))  # a warning would be an error
    with pytest.warns(pm.StabilityWarning) as caught:
        pm.Coupler([rig], dt=4 * critical * (1.0 + margin))
    (warning,) = caught
    message = str(warning.message)
    assert "'rig'" in message and f"step {critical * (1.0 + margin):g} of" in message
    reported = float(message.split("critical step ")[1].split()[0].rstrip(":(,"))
    # printed with six digits; on the safe side where Lanczos guesses
    assert critical * (1.0 - margin) - 1e-5 * critical < reported < critical * (1.0 + 1e-5)


@pytest.mark.parametrize("scheme", CONDITIONAL, ids=repr)
def test_every_conditionally_stable_scheme_has_its_own_limit(scheme):
    rig = subdomain([1.0], [4.0], scheme=scheme, name="rig")
    critical = limit(scheme) / 2.0
    pm.Coupler([rig], dt=critical * (1.0 - CLOSE))
    with pytest.warns(pm.StabilityWarning, match="'rig'"):
        pm.Coupler([rig], dt=critical * (1.0 + CLOSE))


@pytest.mark.parametrize("scheme", CONDITIONAL, ids=repr)
def test_the_limit_is_where_runs_begin_to_grow(scheme):
    rig = subdomain([1.0], [4.0], scheme=scheme, u0=[1.0])
    critical = limit(scheme) / 2.0
    below = pm.Coupler([rig], dt=0.99 * critical).run(steps=1000)[0].u
    # the largest root has a modulus of at most one; it is 1 percent from a double one, which
    # makes the bounded motion some ten times as large as it begins
    assert np.max(np.abs(below)) < 50.0
    with pytest.warns(pm.StabilityWarning):
        coupler = pm.Coupler([rig], dt=1.02 * critical)
    # 2 per cent above, the largest root has a modulus of 1.15 to 1.49
    assert np.max(np.abs(coupler.run(steps=1000)[0].u[-10:])) > 1e4


@pytest.mark.parametrize("scheme", [pm.GeneralizedAlpha(0.0), pm.Newmark(), pm.HHT(0.3)], ids=repr)
def test_unconditionally_stable_schemes_never_warn(scheme):
    pm.Coupler([subdomain([1.0], [1e12], scheme=scheme)], dt=1e3)


def test_a_double_step_explicit_subdomain_has_half_the_limit():
    rig = subdomain([1.0], [4.0], scheme=EXPLICIT, double_step=True, name="rig")
    other = single(substeps=2)
    critical = limit(EXPLICIT) / 2.0
    pm.Coupler([rig, other], dt=0.5 * critical * (1.0 - CLOSE), coupling="pm")
    with pytest.warns(pm.StabilityWarning, match="'rig'") as caught:
        pm.Coupler([rig, other], dt=0.5 * critical * (1.0 + CLOSE), coupling="pm")
    # besides the one that no constraint reaches the two
    assert len([w for w in caught if w.category is pm.StabilityWarning]) == 1
    pm.Coupler([rig, other], dt=critical * (1.0 - CLOSE), coupling="gc")  # single there
    single_step = subdomain([1.0], [4.0], scheme=EXPLICIT)
    pm.Coupler([single_step, other], dt=critical * (1.0 - CLOSE), coupling="pm")


def test_the_row_sum_bound_alone_never_warns():
    # |K| has row sums of 2 + 2, the highest omega^2 is 3: a step between the two is stable
    K = np.array([[2.0, 1.0], [1.0, 2.0]])
    rig = subdomain(K=K, scheme=pm.CentralDifference())
    pm.Coupler([rig], dt=2.0 / math.sqrt(3.0) * (1.0 - CLOSE))
    skewed = subdomain([1.0, 100.0], PAIR, scheme=pm.CentralDifference())
    omega = math.sqrt(max(np.linalg.eigvals(PAIR / np.array([[1.0], [100.0]])).real))
    pm.Coupler([skewed], dt=2.0 / omega * (1.0 - CLOSE))
    with pytest.warns(pm.StabilityWarning):
        pm.Coupler([skewed], dt=2.0 / omega * (1.0 + CLOSE))


def test_one_stiff_pair_hidden_in_a_long_chain_is_found():
    # its mode is nearly orthogonal to a smooth first guess of Lanczos
    K = chain(1001).tolil()
    K[500, 500] += 100.0
    K[501, 501] += 100.0
    K[500, 501] -= 100.0
    K[501, 500] -= 100.0
    omega = math.sqrt(np.linalg.eigvalsh(K.toarray()[480:522, 480:522])[-1])
    rig = subdomain(np.ones(1001), sp.csr_array(K), scheme=pm.CentralDifference())
    pm.Coupler([rig], dt=2.0 / omega * (1.0 - LANCZOS))
    with pytest.warns(pm.StabilityWarning):
        pm.Coupler([rig], dt=2.0 / omega * (1.0 + LANCZOS))


def test_the_warning_points_at_the_line_that_made_the_coupler():
    rig = subdomain([1.0], [4.0], scheme=EXPLICIT)

    def make():
        return pm.Coupler([rig], dt=2.0)

    with pytest.warns(pm.StabilityWarning) as caught:
        make()
    line = make.__code__.co_firstlineno + 1
    assert [(w.filename, w.lineno) for w in caught] == [(__file__, line)]


def test_the_warning_points_out_of_the_package_where_a_model_made_the_coupler():
    with pytest.warns(pm.StabilityWarning) as caught:
        pm.models.split_oscillator(10.0).coupler(5.0, coupling="pm")
    assert {w.filename for w in caught} == {__file__}


# ---- memory ---------------------------------------------------------------------------------


@pytest.fixture
def megabyte(monkeypatch):
    """A machine with one MB of free memory."""
    monkeypatch.setattr(memory, "available", lambda: 1_000_000)


def out_of_memory(call, *words):
    message = refused(MemoryError, call, "1 MB are available", "needs about", *words)
    return message.split("needs about ")[1].split(",")[0]


def test_a_history_that_does_not_fit_is_refused_with_the_figures(megabyte):
    coupler = coupled()
    # u, v, w of 2 and of 3 x 1 numbers, multipliers and jumps of 3 x 2 + 1: 22 per macro step
    needed = out_of_memory(lambda: coupler.run(steps=10_000), "History", "record=", "every=")
    assert needed == "1.76 MB"
    assert coupler.step_count == 0
    assert coupler.run(steps=10_000, every=100)["a"].t.size == 101
    assert coupler.run(steps=10_000, record={"a": [0]}, every=10)["a"].t.size == 1001


def test_a_sparse_factor_that_does_not_fit_is_refused_with_the_figures(megabyte):
    K = plate(40, fixed=True)
    needed = out_of_memory(
        lambda: pm.Coupler([subdomain(np.ones(1600), K, name="p")], dt=0.1), "'p'"
    )
    assert needed.endswith("MB")


def test_a_dense_factor_that_does_not_fit_is_refused_with_the_figures(megabyte):
    K = plate(20, fixed=True).toarray()  # 1.28 MB, and the factor as much again
    out_of_memory(
        lambda: pm.Coupler([subdomain(np.ones(400), K, name="p")], dt=0.1), "'p'", "400 dofs"
    )


def test_an_interface_block_that_does_not_fit_is_refused_with_the_figures(megabyte):
    a, b = subdomain(np.ones(400), plate(20, fixed=True), name="a"), single(400, scheme=EXPLICIT)
    tie = pm.tie(a, np.arange(400), b, np.arange(400))
    needed = out_of_memory(
        lambda: pm.Coupler([a, b], tie, dt=0.1, coupling="pm"), "interface", "400 constraints"
    )
    assert needed.endswith("MB")


def test_constraints_that_all_share_a_dof_are_refused_before_they_fill_the_memory(megabyte):
    # L L^T and H are full: 8 MB for a thousand rows, 80 GB for a hundred thousand
    floor, columns = single(scheme=EXPLICIT), single(1000, scheme=EXPLICIT)
    rigid = pm.Constraint({floor: np.ones((1000, 1)), columns: -sp.eye_array(1000)})
    out_of_memory(
        lambda: pm.Coupler([floor, columns], rigid, dt=0.1, coupling="pm"), "1000 constraints"
    )


def test_where_the_free_memory_is_unknown_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: None)
    coupled().run(steps=10)


def test_the_free_memory_is_a_plausible_number_here():
    # /proc/meminfo or sysconf; above what this process has, below a petabyte
    free = memory.available()
    assert free is None or 1e6 < free < 1e15


# ---- misuse ---------------------------------------------------------------------------------


def in_a_process(code):
    """The output of another Python process; its death by a signal fails the test."""
    head = "import numpy as np, scipy.sparse as sp, pmalpha as pm\n"
    done = subprocess.run(
        [sys.executable, "-c", head + code], capture_output=True, text=True, timeout=waits.LIMIT
    )
    assert done.returncode >= 0, f"died by signal {-done.returncode}"
    return done.stdout + done.stderr


CORRUPT = """
bad = []
for form in (sp.csr_array, sp.csc_array, sp.coo_array):
    for value in (10**8, -5):
        K = form(np.diag([2.0, 2.0, 2.0]) - np.eye(3, k=1) - np.eye(3, k=-1))
        (K.coords[0] if form is sp.coo_array else K.indices)[3] = value
        try:
            {call}
        except ValueError:
            continue
        bad.append((form.__name__, value))
print("bad:", bad)
"""


@pytest.mark.parametrize(
    "call",
    [
        "pm.Subdomain(np.ones(3), K, scheme=pm.Newmark())",
        "pm.Constraint({pm.Subdomain(np.ones(3), np.ones(3), scheme=pm.Newmark()): K})",
    ],
    ids=["K", "L"],
)
def test_a_sparse_matrix_with_indices_outside_of_it_is_a_value_error_and_no_crash(call):
    assert "bad: []" in in_a_process(CORRUPT.replace("{call}", call))


@pytest.mark.parametrize("dt", [1e300, 1e160])
def test_a_step_whose_square_overflows_is_an_error_that_names_the_step_or_the_matrix(dt):
    for form in (np.asarray, sp.csr_array):
        with pytest.raises((ValueError, pm.FactorizationError)) as caught:
            pm.Coupler([subdomain(K=form(PAIR), name="a")], dt=dt)
        assert "dt" in str(caught.value) or "'a'" in str(caught.value)


@pytest.mark.parametrize("dt", [1e-160, 1e-300])
def test_tiny_steps_cause_no_motion_and_no_error(dt):
    coupler = pm.Coupler([subdomain(K=PAIR, u0=[1.0, 0.5])], dt=dt)
    history = coupler.run(steps=10)[0]
    assert np.all(history.u == [1.0, 0.5]) and np.all(np.isfinite(history.a))


def test_a_step_that_is_subnormal_is_an_error_and_no_infinity():
    # h / substeps underflows or H does: there is no way to solve for the multipliers
    a, b = single(), single(substeps=2)
    with pytest.raises((ValueError, pm.FactorizationError)):
        pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=5e-324, coupling="pm")


def test_a_million_substeps_in_a_macro_step_are_computed():
    coupler = pm.Coupler([single(scheme=EXPLICIT, substeps=10**6, u0=[1.0])], dt=1.0)
    coupler.step()
    # cos(1) by a second-order scheme with omega h = 1e-6: 1e6 roundings of 1e-16 remain
    assert coupler.state(0).u[0] == pytest.approx(math.cos(1.0), abs=1e-9)


def test_a_load_that_keeps_and_changes_its_array_does_no_harm():
    kept = np.zeros(2)

    def load(t):
        kept[:] = math.sin(t), math.cos(t)
        return kept

    assert as_bytes(coupled(force=load)) == as_bytes(coupled(force=LOADS["a callable"]["force"]))


def change(array, value):
    """Write into an array, or see that it is read-only."""
    try:
        array[...] = value
    except ValueError as error:
        assert "read-only" in str(error)


@pytest.mark.parametrize("name", ["M", "K", "C", "u0", "v0", "force"])
def test_what_is_written_into_a_subdomain_later_does_not_reach_a_coupler(name):
    # K in the right-hand side and another K in the factor would be silently wrong
    def bytes_of_run(spoil):
        s = subdomain(K=PAIR, C=0.1 * PAIR, force=[0.5, -0.5], u0=[1.0, 0.5], v0=[0.5, 0.25])
        coupler = pm.Coupler([s], dt=0.1)
        if spoil:
            change(getattr(s, name), 9.0)
        return as_bytes(coupler)

    assert bytes_of_run(True) == bytes_of_run(False)


@pytest.mark.parametrize("shape", [None, [[1.0], [0.5]]])
def test_what_is_written_into_a_sampled_force_later_does_not_reach_a_coupler(shape):
    def bytes_of_run(spoil):
        samples = np.ones((3, 2 if shape is None else 1))
        force = pm.SampledForce(samples, 0.1, shape=shape)
        coupler = pm.Coupler([subdomain(force=force)], dt=0.1)
        if spoil:
            change(samples, 9.0)
            change(force.values, 9.0)
            if shape is not None:
                change(force.shape, 9.0)
        return as_bytes(coupler)

    assert bytes_of_run(True) == bytes_of_run(False)


def test_states_and_histories_are_copies():
    coupler = moved(coupled())
    expected = as_bytes(moved(coupled()))
    history = coupler.run(steps=0)
    for x in "uva":
        getattr(coupler.state("a"), x)[:] = getattr(history["a"], x)[:] = 9.0
    coupler.multipliers[:] = history.multipliers[:] = 9.0
    history.velocity_jump[:] = history.displacement_jump[:] = 9.0
    assert as_bytes(coupler) == expected


def test_a_load_may_not_call_the_coupler_that_evaluates_it():
    for call in (
        lambda c: c.state("a"),
        lambda c: c.time,
        lambda c: c.multipliers,
        lambda c: c.step(),
        lambda c: c.run(steps=1),
        lambda c: c.reset(),
    ):

        def load(t, call=call):
            if t > 0.25:
                call(coupler)
            return [math.sin(t), math.cos(t)]

        coupler = coupled(force=load)
        with pytest.raises(RuntimeError, match="being stepped"):
            coupler.run(steps=5)
        assert coupler.step_count == 2


def test_a_load_may_run_another_coupler_of_the_same_subdomains():
    a, b, tie = two_subdomains()
    inner = pm.Coupler([a, b], tie, dt=0.1, coupling="pm")
    seen = []

    def load(t):
        inner.step()
        seen.append(inner.time)
        return [math.sin(t), math.cos(t)]

    coupler = coupled(force=load)
    expected = as_bytes(coupled(force=LOADS["a callable"]["force"]))
    assert as_bytes(coupler) == expected
    assert inner.step_count == len(seen) == 5


def test_a_load_that_makes_couplers_without_end_is_a_recursion_error():
    def load(t):
        return pm.Coupler([single(force=load)], dt=0.1).state(0).u

    limit_before = sys.getrecursionlimit()
    sys.setrecursionlimit(400)
    try:
        with pytest.raises(RecursionError):
            load(0.0)
    finally:
        sys.setrecursionlimit(limit_before)


def test_a_shallow_copy_of_a_coupler_does_not_share_its_state():
    # it may be refused, as a deep one and pickling are
    coupler = coupled()
    try:
        other = copy.copy(coupler)
    except TypeError:
        return
    other.step()
    assert coupler.step_count == 0


def test_pickling_a_coupler_is_a_type_error():
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="pickle"):
            copied(coupled())


def test_subdomains_schemes_and_histories_can_be_copied_and_pickled():
    for again in (copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))):
        a, b, tie = again(two_subdomains())
        coupler = pm.Coupler([a, b], tie, dt=0.1, coupling="pm")
        assert again(a.scheme) == a.scheme and repr(again(b.scheme)) == repr(b.scheme)
        history = coupler.run(steps=4)
        np.testing.assert_array_equal(again(history)["b"].u, history["b"].u)
        coupler.reset()
        assert as_bytes(coupler) == as_bytes(coupled())


class Loud(np.ndarray):
    """An array whose own methods return wrong values."""

    def __array_ufunc__(self, ufunc, method, *inputs, **options):
        return np.array(True)

    def copy(self, order="C"):
        raise AssertionError("copied")


def test_subclasses_of_ndarray_are_read_as_numbers():
    values = {"M": np.ones(2), "K": PAIR, "u0": np.array([1.0, 0.5])}
    ours = subdomain(**{name: x.view(Loud) for name, x in values.items()})
    theirs = subdomain(**values)
    assert as_bytes(pm.Coupler([ours], dt=0.1)) == as_bytes(pm.Coupler([theirs], dt=0.1))
    bad = np.array([1.0, np.nan]).view(Loud)
    refused(ValueError, lambda: subdomain(u0=bad), "u0", "finite")


def test_one_dof_and_no_constraints_is_the_smallest_problem():
    coupler = pm.Coupler([single(u0=[1.0])], dt=0.1)
    history = coupler.run(steps=3)
    assert history.multipliers.shape == history.velocity_jump.shape == (4, 0)
    assert coupler.multipliers.shape == (0,)
    assert pm.Coupler([single()], [], dt=0.1).run(steps=1)[0].u.shape == (2, 1)


def test_nothing_may_be_recorded():
    history = coupled().run(steps=2, record={})
    assert history.multipliers.shape == (7, 1)
    history = coupled().run(steps=2, record={"a": []})
    assert history["a"].u.shape == (3, 0)
    refused(MemoryError, lambda: coupled().run(steps=10**15, record={}), "History")
