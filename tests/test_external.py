"""`factorize=`: the choice of factorization, and what a function of the user must return."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from problems import random_problem

import pmalpha as pm
from pmalpha import structures


def plain(A, last, *, reverse=False):
    """The protocol in four lines: interface last, dense Cholesky."""
    interior = np.setdiff1d(np.arange(A.shape[0]), last)
    perm = np.concatenate([interior[::-1], last[::-1]] if reverse else [interior, last])
    G = np.linalg.cholesky(A.toarray()[np.ix_(perm, perm)])
    d = np.diagonal(G)
    return G / d, d**2, perm


def reversed_order(A, last):
    return plain(A, last, reverse=True)


def without_diagonal(A, last):
    L, D, perm = plain(A, last)
    return sp.csr_array(np.tril(L, k=-1)), D, perm.astype(np.uint16)


def superlu(A, last):
    n = A.shape[0]
    perm = np.concatenate([np.setdiff1d(np.arange(n), last), last])
    lu = sp.linalg.splu(
        sp.csc_array(A[perm][:, perm]),
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        options=dict(SymmetricMode=True),
    )
    return lu.L, lu.U.diagonal(), perm


@pytest.mark.parametrize("factorize", ["superlu", plain, reversed_order, without_diagonal, superlu])
@pytest.mark.parametrize("seed", range(12))
def test_a_run_is_the_same_with_an_external_factorization(seed, factorize):
    problem = random_problem(seed)
    ours = problem.coupler().run(steps=9)
    theirs = problem.coupler(factorize=factorize).run(steps=9)
    for mine, other in zip(ours, theirs):
        # rounding, as in test_against_reference
        assert np.max(np.abs(mine.u - other.u)) <= 1e-9 * np.max(np.abs(mine.u))


def halves(**options):
    """A plate in two halves, the left one with double steps; five nodes are tied."""
    material = dict(E=100.0, nu=0.3, rho=1.0)
    left = structures.plate(5, 4, 0.2, **material)
    right = structures.plate(5, 4, 0.2, origin=(1.0, 0.0), **material)
    edge = [s.dofs(s.nodes(lambda x, y: abs(x - 1.0) < 1e-9)) for s in (left, right)]
    force = np.ones(left.n)
    soft = pm.GeneralizedAlpha(0.5)
    a = left.subdomain(scheme=soft, force=force, name="left")
    b = right.subdomain(scheme=soft, substeps=5, name="right")
    return pm.Coupler([a, b], pm.tie(a, edge[0], b, edge[1]), dt=0.1, **options), edge[0]


def test_the_function_is_called_once_for_each_matrix_with_one_pattern_a_subdomain():
    calls = []

    def factorize(A, last):
        calls.append((A, last))
        return plain(A, last)

    coupler, edge = halves(factorize=factorize)
    # left: Mbar(h), Mbar(2 h), M; right: Mbar(h), M
    assert [A.shape[0] for A, _ in calls] == [60, 60, 60, 60, 60]
    for A, last in calls:
        assert isinstance(A, sp.csc_array)
        assert abs(A - A.T).max() == 0.0
        assert last.size == edge.size and np.all(np.diff(last) > 0)
    np.testing.assert_array_equal(calls[0][1], np.sort(edge))
    patterns = {(A.indptr.tobytes(), A.indices.tobytes()) for A, _ in calls}
    assert len(patterns) == 1  # two halves of one mesh
    s = coupler._session.parts[0].subdomain
    al1, _ = s.scheme.coefficients(0.1)
    assert any(abs(A - (s.M + al1 * s.K)).max() < 1e-14 for A, _ in calls)
    assert any(abs(A - s.M).max() == 0.0 for A, _ in calls)


def test_the_matrix_handed_in_is_a_copy():
    def factorize(A, last):
        factor = plain(A, last)
        A.data[:] = np.nan
        last[:] = 0
        return factor

    ours, theirs = halves()[0].run(steps=3), halves(factorize=factorize)[0].run(steps=3)
    # rounding of another order, at displacements up to 1
    np.testing.assert_allclose(theirs["right"].u, ours["right"].u, atol=1e-12)


def test_diagonal_and_dense_matrices_are_not_handed_in():
    def never(A, last):
        raise AssertionError

    spring = np.array([[2.0, -1.0], [-1.0, 2.0]])
    dense = pm.Subdomain(np.ones(2), spring, scheme=pm.Newmark())
    thin = pm.Subdomain(np.ones(2), sp.csr_array(spring), scheme=pm.CentralDifference())
    pm.Coupler([dense, thin], pm.tie(dense, [0], thin, [1]), dt=0.1, factorize=never).step()


@pytest.mark.parametrize("value", [3, 0.5, ["superlu"], True])
def test_a_factorize_that_is_neither_word_nor_function_is_a_type_error(value):
    with pytest.raises(TypeError, match="factorize must be None, 'superlu' or a callable, got"):
        halves(factorize=value)


def test_another_word_is_a_value_error():
    with pytest.raises(ValueError, match="factorize must be None, 'superlu'.*got 'cholmod'"):
        halves(factorize="cholmod")


def changed(**parts):
    """The correct result with L, D or perm replaced by a function of it."""

    def factorize(A, last):
        factor = dict(zip(("L", "D", "perm"), plain(A, last)))
        for name, change in parts.items():
            factor[name] = change(factor[name])
        return tuple(factor.values())

    return factorize


def swapped(perm):
    perm = perm.copy()
    perm[[0, -1]] = perm[[-1, 0]]
    return perm


def with_entry(i, j, value):
    def change(x):
        x = x.copy()
        x[(i, j) if x.ndim == 2 else i] = value
        return x

    return change


WRONG = {
    "no tuple": (lambda A, last: None, TypeError, r"factorize must return \(L, D, perm\), got"),
    "two": (lambda A, last: plain(A, last)[:2], TypeError, r"must return \(L, D, perm\)"),
    "small L": (changed(L=lambda L: L[1:, 1:]), ValueError, r"L of factorize.*\(60, 60\)"),
    "complex L": (changed(L=lambda L: sp.csr_array(1j * L)), TypeError, "L of factorize.*real"),
    "upper": (changed(L=with_entry(2, 7, 0.5)), ValueError, r"lower triangular.*\[2, 7\]"),
    "scaled L": (changed(L=lambda L: 2.0 * L), ValueError, "L of factorize.*ones on its diagonal"),
    "NaN in L": (changed(L=with_entry(7, 2, np.nan)), ValueError, "L of factorize.*finite"),
    "wrong L": (changed(L=with_entry(7, 2, 9.0)), ValueError, r"L D L\^T = A\[perm\].*differs"),
    "short D": (changed(D=lambda D: D[1:]), ValueError, r"D of factorize.*\(60,\)"),
    "NaN in D": (changed(D=with_entry(3, 0, np.nan)), ValueError, "D of factorize.*finite"),
    "wrong D": (changed(D=lambda D: 1.001 * D), ValueError, r"L D L\^T = A\[perm\].*differs"),
    "float perm": (changed(perm=lambda p: 1.0 * p), ValueError, "perm of factorize.*whole"),
    "short perm": (changed(perm=lambda p: p[1:]), ValueError, "perm of factorize.*60 whole"),
    "twice": (changed(perm=with_entry(0, 0, 1)), ValueError, "perm of factorize.*each of 0..59"),
    "interface": (changed(perm=swapped), ValueError, "perm of factorize must end with the 10 dofs"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_factor_is_refused_with_the_reason(case):
    factorize, error, text = WRONG[case]
    with pytest.raises(error, match=text):
        halves(factorize=factorize)


def test_another_order_for_the_second_matrix_is_refused():
    calls = []

    def factorize(A, last):
        calls.append(1)
        return plain(A, last, reverse=len(calls) == 3)

    with pytest.raises(ValueError, match="perm of factorize must be the same for all.*'left'"):
        halves(factorize=factorize)


def test_what_the_function_raises_reaches_the_caller():
    class Mine(Exception):
        pass

    def factorize(A, last):
        raise Mine

    with pytest.raises(Mine):
        halves(factorize=factorize)


def test_a_negative_pivot_of_the_function_is_a_factorization_error():
    def ldl(A, last):
        L, D, _ = scipy.linalg.ldl(A.toarray())
        return L, np.diagonal(D), np.arange(A.shape[0])

    K = sp.diags_array([-1.0, 3.0, -1.0], offsets=[-1, 0, 1], shape=(5, 5)).tolil()
    K[2, 2] = -1e4
    bad = pm.Subdomain(np.ones(5), K.tocsr(), scheme=pm.Newmark(), name="bad")
    with pytest.raises(pm.FactorizationError, match="'bad' is not positive definite") as caught:
        pm.Coupler([bad], dt=0.1, factorize=ldl)
    assert (caught.value.subdomain, caught.value.dof) == ("bad", 2)
    assert caught.value.inertia == (1, 0, 4)
