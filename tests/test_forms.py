"""The forms in which the core stores matrices and factors: each gives the same motion."""

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import pairwise

import pmalpha as pm
from pmalpha.problem import matrices
from pmalpha.problem.matrices import canonical, core_matrix
from pmalpha.setup import factors

IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.GeneralizedAlpha(0.8, explicit=True)
# Three slabs of rows and a rest, and more dofs than the core would step in one piece.
LONG = 3 * 128 + 17


def banded(rng, n, width):
    """Symmetric and diagonally dominant, all diagonals up to `width` filled."""
    sides = [rng.uniform(-1.0, 1.0, n - d) for d in range(1, width + 1)]
    upper = sp.diags_array(sides, offsets=list(range(1, width + 1)), shape=(n, n))
    return sp.csr_array(upper + upper.T + sp.diags_array(np.full(n, 2.0 * width + 1.0)))


def dense_band(form, n):
    """The matrix of a band."""
    (band,) = form
    A = np.diag(band[0])
    for d in range(1, band.shape[0]):
        A += np.diag(band[d, : n - d], d) + np.diag(band[d, : n - d], -d)
    return A


@pytest.mark.parametrize("width", [1, 2, 5, 30])
def test_a_matrix_with_its_entries_near_the_diagonal_is_stored_as_a_band(width):
    A = banded(np.random.default_rng(width), 61, width)
    form = core_matrix(A)
    assert len(form) == 1 and form[0].shape == (width + 1, 61)
    np.testing.assert_array_equal(dense_band(form, 61), A.toarray())


def test_a_matrix_with_an_entry_far_from_the_diagonal_is_not_stored_as_a_band():
    A = banded(np.random.default_rng(0), 200, 2).tolil()
    A[0, 150] = A[150, 0] = 0.5
    assert len(core_matrix(sp.csr_array(A))) == 5


def test_rows_with_few_columns_in_common_are_stored_with_an_index_for_each_entry():
    sparse = sp.diags_array([np.ones(190), np.full(200, 3.0), np.ones(190)], offsets=[-10, 0, 10])
    assert len(core_matrix(sp.csr_array(sparse))) == 3


def test_strips_may_take_more_bytes_than_rows_unless_the_matrix_leaves_the_cache(thresholds):
    """Rows of a plate of squares have zeros, which strips store: 1.26 times the bytes of rows."""
    K = canonical(pm.structures.plate(20, 20, 1.0, E=1.0, nu=0.3, rho=1.0).K, "K")[0]
    first, _, index, _, values = core_matrix(K)
    over = (8 * values.size + 4 * index.size + 24 * first.size) / (12 * K.nnz + 8 * K.shape[0])
    assert matrices.STRIPS_OVER_ROWS < over < matrices.STRIPS_OVER_ROWS_IN_CACHE
    thresholds(CACHE=0)
    assert len(core_matrix(K)) == 3


@pytest.mark.parametrize("nb", [0, 1, 7])
@pytest.mark.parametrize("width", [1, 3])
def test_the_factor_of_a_band_is_a_band_with_the_same_interface(width, nb):
    A = banded(np.random.default_rng(1), 50, width)
    inverse, R = factors.factorize(A, factors.Names("A", np.arange(50), None), nb=nb)
    assert len(R) == 1 and R[0].shape == (50, width)
    whole = np.eye(50)
    for k in range(width):
        whole += np.diag(R[0][: 50 - k - 1, k], -k - 1)
    # backward error of a factorization: n eps for a well conditioned matrix
    np.testing.assert_allclose(whole @ np.diag(1.0 / inverse) @ whole.T, A.toarray(), atol=1e-13)
    block = factors.interface_block((inverse, R), nb)
    np.testing.assert_array_equal(np.tril(block, -1), np.tril(whole[50 - nb :, 50 - nb :], -1))


def test_a_solid_is_stored_in_strips_of_rows_with_fewer_bytes_than_by_rows():
    K = canonical(solid().K, "K")[0]
    first, ptr, index, start, values = core_matrix(K)
    assert K.shape[0] / 6 <= first.size - 1 <= K.shape[0] / 2.5
    assert 8 * values.size + 4 * index.size + 24 * first.size < 12 * K.nnz + 8 * K.shape[0]
    A = np.zeros(K.shape)
    for s in range(first.size - 1):
        rows = np.arange(first[s], first[s + 1])
        columns = index[ptr[s] : ptr[s + 1]].reshape(-1, 4)
        tiles = values[start[s] : start[s + 1]].reshape(-1, rows.size, 4)
        for column, tile in zip(columns, tiles):
            np.add.at(A, (rows[:, None], column[None]), tile)
    np.testing.assert_array_equal(A, K.toarray())


def solid():
    return pm.structures.solid(5, 4, 3, 0.5, E=2.0, nu=0.3, rho=1.0, mass="lumped")


@pytest.mark.parametrize("scheme", [IMPLICIT, EXPLICIT])
def test_a_solid_moves_the_same_in_strips_and_dense(scheme):
    """Clamped in one component of a face, so that some nodes have two dofs."""
    model = solid()
    free = np.setdiff1d(np.arange(model.n), model.dofs(model.nodes(lambda x, y, z: x == 0), "ux"))
    K, M = sp.csr_array(model.K)[free][:, free], model.M.diagonal()[free]
    u0 = np.random.default_rng(5).normal(size=free.size)
    C = sp.csr_array(0.01 * K + 0.1 * sp.diags_array(M))
    assert len(core_matrix(canonical(K, "K")[0])) == 5
    ours, theirs = (
        pm.solve(pm.Subdomain(M, A, C=B, scheme=scheme, u0=u0), 0.02, 0.4)
        for A, B in ((K, C), (K.toarray(), C.toarray()))
    )
    for x in "uva":
        a, b = getattr(ours, x), getattr(theirs, x)
        # the same sums in another order: rounding over 20 steps of a stable scheme
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.max(np.abs(b)))


def stepped(make, K, C, scheme, force):
    """The history of two coupled subdomains with these matrices."""
    n = K.shape[0]
    x = np.linspace(0.0, 3.0, n)
    subdomains = [
        pm.Subdomain(
            1.0 + 0.5 * np.cos(x) ** 2,
            make(K),
            C=None if C is None else make(C),
            scheme=scheme,
            substeps=substeps,
            u0=np.sin(x),
            force=force,
        )
        for substeps in (1, 2)
    ]
    # the last of one on the last of the other: in the first the order of elimination is natural
    return pm.Coupler(
        subdomains, pm.tie(subdomains[0], [n - 1], subdomains[1], [n - 1]), dt=0.1, coupling="pm"
    )


@pytest.mark.parametrize(
    ("scheme", "width", "damped"), pairwise([IMPLICIT, EXPLICIT], [1, 2, 6], [False, True])
)
def test_a_long_structure_moves_the_same_as_a_band_and_dense(scheme, width, damped):
    K = banded(np.random.default_rng(width), LONG, width)
    C = 0.05 * K if damped else None
    record = np.random.default_rng(2).normal(size=(40, LONG))
    force = pm.SampledForce(record, 0.05)
    thin = stepped(sp.csr_array, K, C, scheme, force).run(steps=20)
    full = stepped(lambda A: A.toarray(), K, C, scheme, force).run(steps=20)
    for ours, theirs in zip(thin, full):
        for x in "uva":
            a, b = getattr(ours, x), getattr(theirs, x)
            # the same sums in another order: rounding over 40 steps of a stable scheme
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.max(np.abs(b)))


def test_a_long_structure_is_bitwise_identical_recorded_or_not_in_one_run_or_in_steps():
    K = banded(np.random.default_rng(3), LONG, 1)
    force = np.linspace(-1.0, 1.0, LONG)
    run, step = (stepped(sp.csr_array, K, None, IMPLICIT, force) for _ in range(2))
    run.run(steps=10)
    for _ in range(10):
        step.step()
    for i in range(2):
        for x in "uva":
            name = f"subdomain {i}"
            np.testing.assert_array_equal(getattr(run.state(name), x), getattr(step.state(name), x))


@pytest.mark.parametrize("dof", [0, 127, 128, LONG - 1])
def test_a_value_that_is_not_finite_is_detected_wherever_it_arises(dof):
    K = banded(np.random.default_rng(4), LONG, 1)
    force = np.zeros(LONG)
    force[dof] = 1e305  # h^2 w is beyond the largest number, w itself is not
    coupler = pm.Coupler(
        [pm.Subdomain(np.ones(LONG), 1e-9 * K, scheme=IMPLICIT, force=force)], dt=1e3
    )
    with pytest.raises(pm.InstabilityError):
        coupler.step()
