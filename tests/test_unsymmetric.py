"""Unsymmetric C, K and tangents: `symmetric=False`, equations (F10) and (F11) of method.md."""

import numpy as np
import pytest
import scipy.sparse as sp
from drawn_matrices import unsymmetric_matrix
from reference_problems import random_restored_problem, random_unsymmetric_problem
from scipy.sparse.linalg import splu
from test_against_reference import assert_agreement
from test_factors import solve
from test_macro import check_against_reference

import pmalpha as pm
from pmalpha.problem.matrices import permuted
from pmalpha.reduction.ordering import elimination_order, graph_of
from pmalpha.setup import factors
from pmalpha.setup.link import Link, compliance

# ---- against the reference -----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(12))
def test_core_and_reference_agree_on_a_random_unsymmetric_problem(seed):
    assert_agreement(random_unsymmetric_problem(seed))


@pytest.mark.parametrize("seed", range(12))
def test_core_and_reference_agree_with_unsymmetric_estimates_of_restoring_forces(seed):
    assert_agreement(random_unsymmetric_problem(seed, random_restored_problem))


@pytest.mark.parametrize("seed", range(12))
def test_core_and_reference_agree_under_macro_coupling(seed):
    check_against_reference(seed, random_unsymmetric_problem)


def test_the_random_problems_have_all_kinds_of_unsymmetric_matrices():
    drawn = [s for seed in range(60) for s in random_unsymmetric_problem(seed).subdomains]
    assert sum(not s.symmetric for s in drawn) > 100
    assert sum(not s.symmetric and s.scheme.explicit for s in drawn) > 30
    assert {type(f(np.eye(2))) for s in drawn for f in s.forms} >= {np.ndarray}


@pytest.mark.parametrize("seed", range(30, 42))
def test_core_and_reference_agree_with_panels(seed, thresholds):
    thresholds(WIDE=0)  # panels for the smallest sparse matrix
    assert_agreement(random_unsymmetric_problem(seed))


# ---- factors -------------------------------------------------------------------------------------


PATTERNS = {
    "one dof": (1, 1.0),
    "a forest": (60, 0.008),
    "thin": (150, 0.01),
    "filled": (90, 0.1),
    "large": (700, 0.004),
}


def as_is(n):
    return factors.Names("A", np.arange(n))


def all_factors(A, nb, monkeypatch):
    """The factor in columns or panels, whichever is chosen; in panels; of the dense matrix."""
    own = [factors.factorize(A, as_is(A.shape[0]), nb=nb, symmetric=False)]
    with monkeypatch.context() as patched:
        patched.setattr(factors, "WIDE", 0)
        own.append(factors.factorize(A, as_is(A.shape[0]), nb=nb, symmetric=False))
    if A.shape[0] > 1:
        own.append(factors.factorize(A.toarray(), as_is(A.shape[0]), nb=nb, symmetric=False))
    return own


@pytest.mark.parametrize("border", ["none", "some", "all"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_solutions_are_those_of_superlu_and_of_dense_lu(pattern, border, monkeypatch):
    n, density = PATTERNS[pattern]
    nb = {"none": 0, "some": (n + 2) // 3, "all": n}[border]
    for seed in range(1 if pattern == "large" else 3):
        rng = np.random.default_rng([seed, n])
        A = unsymmetric_matrix(rng, n, density)
        order = elimination_order(n, graph_of([A]), np.arange(n - nb, n))
        A, b = permuted(A, order), rng.normal(size=n)
        expected = splu(sp.csc_array(A)).solve(b)
        # both are exact up to the condition number of A, below 1e3, times rounding
        np.testing.assert_allclose(np.linalg.solve(A.toarray(), b), expected, rtol=0, atol=1e-11)
        for factor in all_factors(A, nb, monkeypatch):
            np.testing.assert_allclose(solve(factor, b, nb), expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_compliances_are_those_of_the_dense_inverse(pattern, monkeypatch):
    n, density = PATTERNS[pattern]
    rng = np.random.default_rng(n)
    nb = (n + 2) // 3
    A = unsymmetric_matrix(rng, n, density)
    A = permuted(A, elimination_order(n, graph_of([A]), np.arange(n - nb, n)))
    L = sp.csc_array(sp.hstack([sp.csc_array((3, n - nb)), rng.normal(size=(3, nb))]))
    expected = L @ np.linalg.inv(A.toarray()) @ L.T
    for factor in all_factors(A, nb, monkeypatch):
        np.testing.assert_allclose(
            compliance(factor, Link.of(L), nb, "A").values, expected, atol=1e-11
        )
    if n > 1:
        assert np.max(np.abs(expected - expected.T)) > 1e-4


def test_a_skew_matrix_is_ordered_like_any_other():
    """Its entries cancel in A + A^T."""
    S = sp.csr_array(np.array([[0.0, 2.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    ptr, index = graph_of([S])
    assert (ptr.tolist(), index.tolist()) == ([0, 1, 2, 2], [1, 0])


@pytest.mark.parametrize("kind", [np.asarray, sp.csr_array])
def test_singular_matrices_and_lost_digits_are_named(kind):
    """[[d, 1], [-1, 1]]: after the pivot d, 1 + 1/d, in which the 1 is lost."""
    lost = np.array([[1e-12, 1.0], [-1.0, 1.0]])
    with pytest.raises(
        pm.FactorizationError, match="constraint 1: more than 1e.08 times .* entry 1"
    ):
        factors.factorize(kind(lost), as_is(2), symmetric=False)
    singular = np.array([[1.0, 2.0], [3.0, 6.0]])
    with pytest.raises(
        pm.FactorizationError, match="first seen at constraint 1: a pivot of 0 where"
    ):
        factors.factorize(kind(singular), as_is(2), symmetric=False)
    # a mechanism whose last pivot is rounding: row sums are zero
    n = 60
    A = np.triu(np.random.default_rng(0).random((n, n)), 1) - np.eye(n, k=-1)
    A -= np.diag(A.sum(axis=1))
    with pytest.raises(pm.FactorizationError, match="is singular, or its pivots"):
        factors.factorize(kind(A), as_is(n), symmetric=False)


def test_the_error_names_the_subdomain_and_the_matrix():
    s = pm.Subdomain([1.0, 1.0], [[1.0, 2.0], [-2.0, 1.0]], scheme=pm.Newmark(), symmetric=False)
    h = 2.0  # al1 = 1: Mbar = [[2, 2], [-2, 2]], and [[1, 2], [0.5, 1]] of the other
    singular = pm.Subdomain(
        [1.0, 1.0], [[0.0, 2.0], [0.5, 0.0]], scheme=pm.Newmark(), symmetric=False, name="x"
    )
    assert np.all(np.isfinite(pm.solve(s, h, 10 * h).u))
    with pytest.raises(pm.FactorizationError, match=r"Mbar = .* of subdomain 'x' is singular, or"):
        pm.solve(singular, h, h)
