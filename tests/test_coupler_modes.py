"""`Coupler.modes` and `Coupler.assembled` against the structure before it was cut."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from reference_problems import random_problem

import pmalpha as pm
from pmalpha import structures


def assert_satisfies(coupler, structure):
    """The map has full rank, and L T = 0."""
    T = sp.vstack(list(structure.map.values())).toarray()
    L = sp.hstack(coupler._session.rows.matrices).toarray()
    assert T.shape[1] == T.shape[0] - L.shape[0] == structure.n
    assert np.linalg.matrix_rank(T) == structure.n
    # rounding of the elimination, whose weights are at most some tens
    assert np.abs(L @ T).max(initial=0.0) < 1e-12


@pytest.mark.parametrize("seed", range(12))
def test_the_assembled_matrices_are_those_of_the_constrained_problem(seed):
    coupler = random_problem(seed).coupler()
    structure = coupler.assembled()
    assert_satisfies(coupler, structure)
    T = sp.vstack(list(structure.map.values())).toarray()
    for kind in ("M", "C", "K"):
        blocks = []
        for _, s in coupler._session.keys:
            A = getattr(s, kind)
            A = np.zeros((s.n, s.n)) if A is None else A.toarray() if sp.issparse(A) else A
            blocks.append(np.diag(A) if A.ndim == 1 else A)
        expected = T.T @ scipy.linalg.block_diag(*blocks) @ T
        found = getattr(structure, kind).toarray()
        # rounding of one product
        assert np.allclose(found, expected, rtol=0.0, atol=1e-13 * max(1.0, np.abs(expected).max()))


def cut_chain(n, at, **options):
    """A chain of n dofs, fixed at the left, of random masses and springs, cut at dof `at`."""
    rng = np.random.default_rng(n)
    m, k = rng.uniform(1.0, 2.0, n), rng.uniform(50.0, 90.0, n)
    M, K = np.diag(m), np.diag(k + np.append(k[1:], 0.0))
    K -= np.diag(k[1:], 1) + np.diag(k[1:], -1)
    left, right = K[: at + 1, : at + 1].copy(), K[at:, at:].copy()
    left[-1, -1], right[0, 0] = k[at], k[at + 1]
    m_left, m_right = m[: at + 1].copy(), m[at:].copy()
    m_left[-1], m_right[0] = 0.3 * m[at], 0.7 * m[at]
    scheme = pm.GeneralizedAlpha(0.5)
    a = pm.Subdomain(m_left, left, scheme=scheme, name="a", **options)
    b = pm.Subdomain(m_right, right, scheme=scheme, substeps=3, name="b")
    return M, K, pm.Coupler([a, b], pm.tie(a, [at], b, [0]), dt=0.01, coupling="pm")


def test_the_frequencies_and_modes_of_a_cut_chain_are_those_of_the_whole_one():
    M, K, coupler = cut_chain(9, 4)
    squares, shapes = scipy.linalg.eigh(K, M)
    omega, by_name = coupler.modes(5)
    assert np.allclose(omega, np.sqrt(squares[:5]), rtol=1e-10, atol=0.0)  # 200 x rounding
    found = np.vstack([by_name["a"], by_name["b"][1:]])
    assert np.array_equal(by_name["a"][-1], by_name["b"][0])  # eliminated exactly
    signs = np.sign(np.sum(found * shapes[:, :5], axis=0))
    assert np.allclose(found, shapes[:, :5] * signs, rtol=0.0, atol=1e-9)


def test_the_assembled_chain_has_the_entries_of_the_whole_one():
    M, K, coupler = cut_chain(7, 3)
    structure = coupler.assembled()
    # 0.3 m + 0.7 m and k + k' are rounded
    assert np.allclose(structure.M.toarray(), M, rtol=1e-15, atol=0.0)
    assert np.allclose(structure.K.toarray(), K, rtol=1e-15, atol=0.0)
    assert structure.C.nnz == 0
    assert structure.map["b"].toarray().tolist() == np.eye(7)[3:].tolist()
    assert repr(structure) == "<Assembled structure of 2 subdomains, 7 dofs>"


def test_a_long_cut_chain_has_the_frequencies_of_the_whole_one():
    n = 3000  # above the limit of the dense solver
    K = [structures.chain(m, 1.0, 1e4).K for m in (n // 2 + 1, n // 2)]
    first, second = np.ones(n // 2 + 1), np.ones(n // 2)
    first[-1] = second[0] = 0.5
    a = pm.Subdomain(first, K[0], scheme=pm.Newmark(), name="a")
    b = pm.Subdomain(second, K[1], scheme=pm.Newmark(), name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [n // 2], b, [0]), dt=1e-3, coupling="pm")
    omega, _ = coupler.modes(4)
    expected = 200.0 * np.sin(np.arange(4) * np.pi / (2 * n))  # 2 sqrt(k/m) sin(i pi / 2n)
    # ARPACK's shift and the conditioning (n / pi)^2 of the lowest mode
    assert np.allclose(omega, expected, rtol=1e-7, atol=1e-6)


@pytest.mark.gate
@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")  # loose, as meant here
def test_masses_without_springs_have_the_frequency_zero_exactly():
    # They move alone, but for rounding errors of their modes at the other dofs, which are all that
    # has a stiffness there: it must not count as that of the mode, nor make K indefinite.
    rng = np.random.default_rng(0)
    for _ in range(50):
        k = np.array([0.0, 0.0, 1.0, 20.0, 30.0])
        M = np.eye(5) + 0.3 * np.diag(rng.normal(size=4), 1)
        free = pm.Subdomain(M @ M.T, np.diag(k), scheme=pm.Newmark(), name="free")
        other = pm.Subdomain([1.0], [2.0], scheme=pm.Newmark(), name="other")
        coupler = pm.Coupler([free, other], pm.tie(free, 3, other, 0), dt=0.01, coupling="pm")
        omega, _ = coupler.modes(4)
        assert np.array_equal(omega > 0.0, [False, False, True, True])


def test_a_motion_of_the_assembled_structure_is_that_of_the_coupler():
    M, K, coupler = cut_chain(6, 2)
    structure = coupler.assembled()
    omega, by_name = coupler.modes(1)
    coupler.reset(u0={name: x[:, 0] for name, x in by_name.items()})
    t = 0.2
    coupler.step(20)
    for name, T in structure.map.items():
        # a natural mode oscillates with its frequency; error of the scheme, (omega dt)^2 / 12
        expected = by_name[name][:, 0] * np.cos(omega[0] * t)
        assert np.allclose(coupler.state(name).u, expected, rtol=0.0, atol=2e-4)
        assert T.shape == (expected.size, 6)


def test_general_constraints_are_eliminated():
    a = pm.Subdomain(np.ones(3), np.diag([3.0, 4.0, 5.0]), scheme=pm.Newmark(), name="a")
    b = pm.Subdomain(np.ones(4), np.diag([1.0, 2.0, 3.0, 4.0]), scheme=pm.Newmark(), name="b")
    mean = pm.Constraint({a: [[0.25, 0.75, 0.0]], b: [[-1.0, 0.0, 0.0, 0.0]]})
    lever = pm.Constraint({a: [[0.0, 0.0, 2.0]], b: [[0.0, 1.0, 0.0, 0.0]]})
    support = pm.Constraint({b: [[0.0, 0.0, 1.0, 0.0]]}, velocity=lambda t: [0.0])
    coupler = pm.Coupler([a, b], [mean, lever, support], dt=0.01, coupling="pm")
    structure = coupler.assembled()
    assert_satisfies(coupler, structure)
    L = sp.hstack(coupler._session.rows.matrices).toarray()
    N = scipy.linalg.null_space(L)
    K = np.diag([3.0, 4.0, 5.0, 1.0, 2.0, 3.0, 4.0])
    expected = np.sqrt(np.linalg.eigvalsh(N.T @ K @ N))  # M is the identity
    assert np.allclose(coupler.modes(4)[0], expected, rtol=1e-10, atol=0.0)


def test_two_ties_of_opposite_sign_hold_their_dofs():
    a = pm.Subdomain([1.0, 1.0], [1.0, 4.0], scheme=pm.Newmark(), name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="b")
    ties = [pm.tie(a, [0], b, [0]), pm.Constraint({a: [[1.0, 0.0]], b: [[1.0]]})]
    coupler = pm.Coupler([a, b], ties, dt=0.01, coupling="pm")
    assert coupler.assembled().map["a"].toarray().tolist() == [[0.0], [1.0]]
    assert coupler.modes(1)[0] == pytest.approx([2.0], rel=1e-12)


def test_a_dof_where_three_subdomains_meet_is_one_dof():
    parts = [pm.Subdomain([1.0], [3.0 * i + 1.0], scheme=pm.Newmark()) for i in range(3)]
    ties = [pm.tie(parts[0], [0], parts[1], [0]), pm.tie(parts[1], [0], parts[2], [0])]
    coupler = pm.Coupler(parts, ties, dt=0.01, coupling="pm")
    assert coupler.modes(1)[0] == pytest.approx([2.0], rel=1e-12)  # sqrt((1 + 4 + 7) / 3)
    assert coupler.assembled().n == 1


def test_springs_count_with_their_initial_tangent_and_callables_with_their_estimate():
    spring = pm.Bilinear([0], k=4.0, fy=1.0)
    yielding = pm.Subdomain([1.0], None, scheme=pm.Newmark(), restoring=spring, name="yielding")
    assert pm.Coupler([yielding], dt=0.01).modes(1)[0] == pytest.approx([2.0], rel=1e-12)
    estimated = pm.Subdomain(
        [1.0],
        [5.0],
        scheme=pm.Newmark(),
        restoring=lambda t, u, v: 4.0 * u,
        restoring_stiffness=[4.0],
        restoring_damping=[0.5],
    )
    coupler = pm.Coupler([estimated], dt=0.01)
    assert coupler.modes(1)[0] == pytest.approx([3.0], rel=1e-12)
    assert coupler.assembled().C.toarray().tolist() == [[0.5]]
    unknown = pm.Subdomain(
        [1.0], [5.0], scheme=pm.Newmark(), restoring=lambda t, u, v: 4.0 * u, name="rig"
    )
    with pytest.raises(ValueError, match="needs restoring_stiffness .* got none for 'rig'"):
        pm.Coupler([unknown], dt=0.01).modes(1)


def test_what_cannot_be_is_refused():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark())
    held = pm.Coupler([a], pm.Constraint({a: [[1.0]]}), dt=0.1)
    with pytest.raises(ValueError, match="must leave a motion, got all dofs fixed"):
        held.assembled()
    with pytest.raises(ValueError, match="k must be at most 1, .*, got 2"):
        pm.Coupler([a], dt=0.1).modes(2)
