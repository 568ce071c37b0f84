"""Static equilibrium before a run."""

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha.setup.equilibrium import require_stiff

IMPLICIT = pm.GeneralizedAlpha(0.8)


def chain(n, k=1.0):
    """Stiffness of n springs in a row, not supported: (n + 1, n + 1)."""
    B = sp.diags_array([-np.ones(n), np.ones(n)], offsets=[0, 1], shape=(n, n + 1))
    return sp.csr_array(k * (B.T @ B))


def hanging(n_a, n_b, supported=True):
    """A chain of n_a + n_b springs split in two, unit weight in its last dof."""
    K = chain(n_a).tolil()
    if supported:
        K[0, 0] += 1e3
    a = pm.Subdomain(np.ones(n_a + 1), K, scheme=IMPLICIT, name="a")
    weight = np.zeros(n_b + 1)
    weight[-1] = 1.0
    b = pm.Subdomain(np.ones(n_b + 1), chain(n_b), scheme=IMPLICIT, force=weight, name="b")
    return pm.Coupler([a, b], pm.tie(a, [n_a], b, [0]), dt=0.1, coupling="pm")


@pytest.mark.parametrize("n", [1, 5, 4000])
def test_a_hanging_chain_stretches_by_one_per_spring(n):
    u = hanging(n, 2).static()
    # the support yields by 1e-3; rounding times the condition number n^2 of the chain
    np.testing.assert_allclose(u["a"], 1e-3 + np.arange(n + 1), rtol=1e-15 * (n + 10) ** 2)
    np.testing.assert_allclose(u["b"], u["a"][-1] + np.arange(3), rtol=1e-15 * (n + 10) ** 2)


@pytest.mark.parametrize("n", [1, 5, 4000])
def test_a_floating_chain_is_refused(n):
    with pytest.raises(pm.FactorizationError, match="floating"):
        hanging(n, 2, supported=False).static()


def test_a_constraint_on_one_subdomain_alone_supports_it():
    a = pm.Subdomain(np.ones(3), chain(2), scheme=IMPLICIT, force=[0.0, 0.0, 2.0], name="a")
    coupler = pm.Coupler([a], pm.Constraint({a: [[1.0, 0.0, 0.0]]}), dt=0.1)
    # by hand: both springs carry 2, stiffness 1
    np.testing.assert_allclose(coupler.static()["a"], [0.0, 2.0, 4.0], atol=1e-14)


def test_ties_add_their_stiffness_in_the_check_for_floating_structures():
    K, L = sp.csc_array(chain(1)), sp.csr_array([[1.0, 0.0]])  # a spring held at one end
    smallest = np.linalg.eigvalsh((K + L.T @ L).toarray()).min()  # 0.38; of K - L^T L: -0.62
    try:
        require_stiff(K, L)
    except pm.FactorizationError:
        pytest.fail(f"K + L^T L is refused, though its smallest eigenvalue is {smallest:.2f}")
    with pytest.raises(pm.FactorizationError, match="floating"):
        require_stiff(K, 0.0 * L)


def test_an_indefinite_stiffness_is_refused():
    a = pm.Subdomain([1.0, 1.0], [1.0, -0.5], scheme=IMPLICIT, force=[1.0, 1.0])
    with pytest.warns(pm.StabilityWarning, match="the motion itself grows"):
        coupler = pm.Coupler([a], dt=0.01)
    with pytest.raises(pm.FactorizationError, match="indefinite"):
        coupler.static()


def test_a_structure_in_static_equilibrium_stays_there():
    coupler = hanging(4, 3)
    coupler.reset(u0=coupler.static())
    history = coupler.run(steps=200)
    start = np.concatenate([history["a"].u[0], history["b"].u[0]])
    end = np.concatenate([history["a"].u[-1], history["b"].u[-1]])
    # forces balance to rounding, so nothing moves by more than rounding times the steps
    np.testing.assert_allclose(end, start, rtol=1e-11)
    assert np.max(np.abs(history["b"].a)) < 1e-11


def test_other_units_give_the_same_displacements():
    M, K, f = np.ones(2), np.array([[3.0, -1.0], [-1.0, 1.0]]), np.array([0.0, 1.0])
    for units in (1.0, 1e-20, 1e25):
        a = pm.Subdomain(M * units, K * units, scheme=IMPLICIT, force=f * units)
        u = pm.Coupler([a], dt=0.1).static()["subdomain 0"]
        np.testing.assert_allclose(u, np.linalg.solve(K, f), rtol=1e-14)  # by rounding
