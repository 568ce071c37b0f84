"""Chains are eliminated from both ends at once: the order, the factor and the motion."""

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha.problem.matrices import canonical, core_matrix, permuted
from pmalpha.problem.ordering import folded_order, graph_of
from pmalpha.setup import elimination, factors
from pmalpha.setup.factors import Names

ALPHA = pm.GeneralizedAlpha(0.8)
DT, STEPS = 0.1, 12
# Few steps of well conditioned matrices: some hundred roundings of numbers near one.
TOLERANCE = 1e-12


def chain(rng, n, *, symmetric=True, cuts=0, shuffled=False):
    """A dominant tridiagonal matrix, cut into chains, with its dofs numbered at random."""
    above = rng.uniform(0.1, 1.0, n - 1)
    above[rng.permutation(n - 1)[:cuts]] = 0.0
    below = above if symmetric else -0.5 * above
    A = sp.csr_array(sp.diags_array([below, rng.uniform(3, 4, n), above], offsets=[-1, 0, 1]))
    A.eliminate_zeros()
    order = rng.permutation(n) if shuffled else np.arange(n)
    return permuted(canonical(A, "A", symmetric=symmetric)[0], order)


def coupled(matrices, *, held=(), dt=DT, scheme=ALPHA, symmetric=True, dense=False):
    """A coupler of one subdomain, some dofs held by constraints; with dense matrices the core has
    LAPACK's factor of the whole."""
    M, K, *C = (A.toarray() if dense and sp.issparse(A) else A for A in matrices)
    n = K.shape[0]
    u0 = np.cos(np.arange(n))
    u0[list(held)] = 0.0
    s = pm.Subdomain(M, K, *C, scheme=scheme, u0=u0, symmetric=symmetric, name="s")
    constraints = [pm.Constraint({"s": np.eye(n)[list(held)]})] if held else None
    return pm.Coupler([s], constraints, dt=dt, threads=1)


def is_folded(coupler):
    structure = coupler._parts[0].elimination.structure
    return structure is not None and structure.folded


def check_motion(matrices, *, folded=True, **options):
    """Displacements and velocities are those with dense matrices."""
    ours = coupled(matrices, **options)
    dense = coupled(matrices, dense=True, **options)
    assert is_folded(ours) == folded and not is_folded(dense)
    ours.step(STEPS)
    dense.step(STEPS)
    for x in ("u", "v"):
        expected = getattr(dense.state(0), x)
        np.testing.assert_allclose(getattr(ours.state(0), x), expected, rtol=0, atol=TOLERANCE)


# ---- the order --------------------------------------------------------------------------------


@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize("n", [2, 3, 4, 5, 6, 7, 40, 41])
def test_ends_come_first_and_the_middle_last(n, shuffled):
    A = chain(np.random.default_rng(n), n, shuffled=shuffled)
    order = folded_order(graph_of([A]))
    assert sorted(order) == list(range(n))
    B = sp.coo_array(permuted(A, order))
    first, second = np.minimum(B.row, B.col), np.maximum(B.row, B.col)
    # each row couples with the second one after it, the last two with each other
    np.testing.assert_array_equal(
        second[first < second], np.minimum(first + 2, n - 1)[first < second]
    )
    if not shuffled:
        assert list(order[:2]) == [0, n - 1] and order[-1] == n // 2


def test_several_chains_in_one_matrix_are_folded_as_one():
    A = chain(np.random.default_rng(0), 60, cuts=7, shuffled=True)
    B = permuted(A, folded_order(graph_of([A])))
    _, folded = core_matrix(B)
    assert folded


def test_cycles_and_branches_are_not_chains():
    ring = sp.csr_array(sp.eye_array(9) * 3.0 + sp.csr_array(np.roll(np.eye(9), 1, axis=1)))
    ring = sp.csr_array(ring + ring.T)
    assert folded_order(graph_of([ring])) is None
    star = chain(np.random.default_rng(1), 9).tolil()
    star[2, 7] = star[7, 2] = 0.5
    assert folded_order(graph_of([sp.csr_array(star)])) is None


# ---- the factor -------------------------------------------------------------------------------


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 9, 127, 128, 129, 130, 1000])
def test_a_folded_factor_solves(n, symmetric):
    rng = np.random.default_rng(n)
    A = chain(rng, n, symmetric=symmetric) if n > 1 else sp.csr_array([[2.0]])
    B = permuted(A, folded_order(graph_of([A])))
    factor = factors.fold(B, Names("B", np.arange(n)), symmetric)
    b = rng.standard_normal(n)
    x = np.linalg.solve(B.toarray(), b)
    if n > 1:  # of one unknown alone there is no band
        # dominant rows: the condition is below ten, and an elimination of them is stable
        np.testing.assert_allclose(factors.solve(factor, b), x, rtol=0, atol=1e-14 * n)
    # relative errors of n pivots, added up
    of_pivots, whole = -np.sum(np.log(factor[0])), np.linalg.slogdet(B.toarray())[1]
    np.testing.assert_allclose(of_pivots, whole, rtol=0, atol=1e-14 * n)


@pytest.mark.parametrize("bad", [0, 1, 10, 19])
def test_an_indefinite_chain_is_refused_with_a_dof(bad):
    K = chain(np.random.default_rng(2), 20).tolil()
    K[bad, bad] = -5000.0
    with pytest.raises(pm.FactorizationError, match="pivots: 1 negative, 0 zero") as caught:
        coupled((np.ones(20), sp.csr_array(K)))
    assert caught.value.dof is not None and abs(caught.value.dof - bad) <= 1


def test_a_singular_unsymmetric_chain_is_refused():
    K = chain(np.random.default_rng(3), 20, symmetric=False).tolil()
    K[9, :] = 0.0
    M = np.ones(20)
    M[9] = 0.0
    A = sp.csr_array(K + sp.diags_array(M))
    order = folded_order(graph_of([sp.csr_array(abs(A) + abs(A).T)]))
    with pytest.raises(pm.FactorizationError, match="is singular"):
        factors.fold(permuted(A, order), Names("A", order), False)


# ---- the motion -------------------------------------------------------------------------------


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("n", [2, 3, 7, 8, 9, 127, 128, 129, 257, 300])
def test_a_chain_moves_as_with_dense_matrices(n, damped, symmetric):
    rng = np.random.default_rng(10 * n + damped)
    K, C = (chain(rng, n, symmetric=symmetric, shuffled=n % 2 == 1) for _ in range(2))
    matrices = (np.ones(n), K)
    if damped:  # a chain along the same dofs
        C = K.copy()
        C.data = K.data * rng.uniform(0.1, 0.2)
        matrices += (C,)
    folded = n >= elimination.WORTH_FOLDING
    check_motion(matrices, folded=folded, symmetric=symmetric)


@pytest.mark.parametrize("scheme", [ALPHA, pm.Newmark(), pm.GeneralizedAlpha(0.8, explicit=True)])
def test_a_consistent_mass_is_folded_too(scheme):
    n = 150
    M = sp.csr_array(sp.diags_array([1.0, 4.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)))
    check_motion((M, chain(np.random.default_rng(4), n)), scheme=scheme)


def test_forests_move_as_with_dense_matrices():
    rng = np.random.default_rng(5)
    for cuts in (1, 5, 100):
        check_motion((np.ones(200), chain(rng, 200, cuts=cuts, shuffled=True)))


@pytest.mark.parametrize("dofs", [[0], [39], [17], [20], [0, 39], [19, 20], [5, 6, 30]])
def test_a_chain_with_constraints_anywhere_moves_as_with_dense_matrices(dofs):
    """The interface is last in the order, so that one end is left to begin at, or none."""
    matrices = (np.ones(40), chain(np.random.default_rng(6), 40))
    check_motion(matrices, folded=False, held=dofs)


def test_a_stiffness_that_is_wider_than_what_is_factored_keeps_its_order():
    """An explicit step factors the mass alone, but multiplies with K."""
    n = 60
    M = chain(np.random.default_rng(7), n)
    K = sp.csr_array(M @ M)
    scheme = pm.GeneralizedAlpha(0.8, explicit=True)
    check_motion((M, K), folded=False, scheme=scheme, dt=0.02)


def test_a_chain_beside_a_coupled_one_is_folded():
    rng = np.random.default_rng(8)
    K = [chain(rng, 30) for _ in range(3)]
    parts = [pm.Subdomain(np.ones(30), k, scheme=ALPHA, name=x) for k, x in zip(K, "abc")]
    c = pm.Coupler(parts, pm.tie("a", [29], "b", [0]), dt=DT, threads=1)
    assert [part.elimination.structure.folded for part in c._parts] == [False, False, True]


@pytest.mark.parametrize("n", [8, 9, 300])
def test_load_cases_side_by_side_are_single_runs(n):
    matrices = (np.ones(n), chain(np.random.default_rng(9), n))
    c = coupled(matrices)
    assert is_folded(c)
    cases = [{"force": {"s": np.full(n, float(k))}} for k in range(8)]
    together = c.run_each(cases, steps=STEPS)
    for case, h in zip(cases, together):
        c.reset(**case)
        alone = c.run(steps=STEPS)
        # the sums have the same order in every lane
        np.testing.assert_array_equal(h["s"].u, alone["s"].u)


def test_a_saved_state_is_in_the_order_of_the_user(tmp_path):
    n = 50
    matrices = (np.ones(n), chain(np.random.default_rng(10), n))
    a, b = coupled(matrices), coupled(matrices)
    a.step(5)
    a.save(tmp_path / "state")
    b.load(tmp_path / "state")
    np.testing.assert_array_equal(b.state(0).u, a.state(0).u)
    a.step(5)
    b.step(5)
    np.testing.assert_array_equal(b.state(0).u, a.state(0).u)


def test_threads_do_not_change_a_bit():
    """Two chains, of which each thread has one: a chain alone has one thread."""
    rng, n = np.random.default_rng(11), 3000
    K = [chain(rng, n) for _ in range(2)]
    states = []
    for threads in (1, 2):
        parts = [
            pm.Subdomain(np.ones(n), k, scheme=ALPHA, u0=np.cos(np.arange(n)), name=x)
            for k, x in zip(K, "ab")
        ]
        with pytest.warns(pm.ConstraintWarning):
            c = pm.Coupler(parts, [], dt=DT, threads=threads)
        assert is_folded(c) and c.threads == threads
        c.step(STEPS)
        states.append(np.concatenate([c.state(x).u for x in "ab"]))
    np.testing.assert_array_equal(*states)
