"""Equal subdomains of a coupler: what is made of their matrices is made once."""

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha._cached import Living, Once
from pmalpha.setup import factors, member

SCHEME = pm.GeneralizedAlpha(0.5)
K = sp.csr_array(sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(4, 4)))


def subdomain(A, i):
    v0 = np.zeros(4) if i else np.array([0.0, 1.0, 0.0, 0.0])
    return pm.Subdomain(np.ones(4), A, scheme=SCHEME, substeps=1 + i % 2, v0=v0, name=f"s{i}")


def row(count, coupling="gc"):
    """Chains of four dofs, each tied to the next."""
    chains = [subdomain(K.copy(), i) for i in range(count)]
    ties = [pm.tie(a, 3, b, 0) for a, b in zip(chains, chains[1:])]
    return pm.Coupler(chains, ties, dt=0.1, coupling=coupling)


@pytest.mark.parametrize("convert", [sp.csr_array, sp.csc_array, sp.csr_array.toarray])
def test_matrices_with_equal_contents_are_one_object(convert):
    a, b = (subdomain(convert(K.copy()), i) for i in range(2))
    assert a.K is b.K and a.M is b.M


def test_matrices_that_nobody_holds_are_forgotten_and_no_function_is_called_when_they_go():
    known = Living()
    held = [sp.csr_array(np.eye(2)) for _ in range(200)]
    for i, A in enumerate(held):
        known[i] = A
    assert [A for _, A in known.items()] == held and known.get(7) is held[7]
    del A, held[10:]
    for i in range(200, 600):
        known[i] = sp.csr_array(np.eye(2))
    # at most those that were added since it was cleared
    assert len(known._known) < 300 and [i for i, _ in known.items()] == list(range(10))
    assert known.get(11) is None and all(x.__callback__ is None for x in known._known.values())


def test_a_matrix_that_changed_in_between_is_another_one():
    A = K.copy()
    first = subdomain(A, 0)
    A.data *= 2.0
    second = subdomain(A, 1)
    np.testing.assert_array_equal(second.K.toarray(), 2.0 * first.K.toarray())
    assert first.K.diagonal()[0] == 2.0


def test_an_asymmetry_that_one_subdomain_admits_is_refused_by_another():
    A = K.toarray()
    A[0, 1] = -0.5
    pm.Subdomain(np.ones(4), A, scheme=SCHEME, symmetric=False)
    with pytest.raises(ValueError, match="K must be symmetric"):
        pm.Subdomain(np.ones(4), A, scheme=SCHEME)


def test_an_equal_matrix_of_the_wrong_size_is_refused():
    subdomain(K, 0)
    with pytest.raises(ValueError, match="K must be of size 3 like M"):
        pm.Subdomain(np.ones(3), K, scheme=SCHEME)


def test_the_number_of_factors_does_not_grow_with_the_number_of_equal_subdomains(monkeypatch):
    factorize, names = factors.factorize, []

    def counted(A, name, **options):
        names.append(name.what)
        return factorize(A, name, **options)

    monkeypatch.setattr(factors, "factorize", counted)
    counts = []
    for count in (5, 9):
        names.clear()
        row(count)
        counts.append(len(names))
    # of two lengths of steps at the left end, between and at the right end, at most, and of M
    assert counts[0] == counts[1] <= 9


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_runs_are_bitwise_those_in_which_nothing_is_shared(coupling, monkeypatch):
    shared = row(5, coupling).run(2.0)
    monkeypatch.setattr(Once, "__call__", lambda self, make, objects, *values: make())
    single = row(5, coupling).run(2.0)
    for name, _ in shared.keys:
        np.testing.assert_array_equal(shared[name].u, single[name].u)
    np.testing.assert_array_equal(shared.multipliers, single.multipliers)


def test_subdomains_with_other_constraints_have_their_own_blocks_of_the_interface_matrix(
    monkeypatch,
):
    """Two equal subdomains are tied by other dofs: to the middle one at dof 3, and at dof 1."""
    a, b, c = (subdomain(K, i) for i in (0, 2, 4))
    blocks = []
    compliance = member.compliance
    monkeypatch.setattr(
        member, "compliance", lambda *x: blocks.append(compliance(*x)) or blocks[-1]
    )
    pm.Coupler([a, b, c], [pm.tie(a, 3, b, 0), pm.tie(b, 3, c, 1)], dt=0.1, coupling="gc")
    A = np.eye(4) + SCHEME.coefficients(0.1)[0] * K.toarray()
    inverse = np.linalg.inv(A)
    computed = sorted(float(block.values[0, 0]) for block in blocks if block.rows.size == 1)
    np.testing.assert_allclose(computed, sorted([inverse[3, 3], inverse[1, 1]]), rtol=1e-13)
