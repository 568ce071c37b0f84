"""The numbers of negative, zero and positive pivots, for the message about a refused matrix."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .. import _core
from ..blas import one_thread
from ..problem.matrices import Matrix, core_sparse, diagonal

Inertia = tuple[int, int, int]

# Below these sizes the eigenvalues of the dense matrix are counted.
FEW, FEW_DENSE = 200, 2000
# Largest number of entries of a factor that is made only to count pivots: some seconds.
MOST = 5_000_000
# An eigenvalue below this is zero, with the matrix scaled to a unit diagonal.
ZERO = 1e-12


def inertia(A: Matrix | None, n: int) -> Inertia | None:
    """Negative, zero and positive pivots of a symmetric matrix; None where that takes too long.

    Scaling to a unit diagonal and, by Sylvester's law, elimination change none of the signs. Of a
    sparse matrix the pivots of A + ZERO I and A - ZERO I are counted, since a zero pivot would stop
    the factorization of A.

    A: (n, n) matrix in inner form, if sparse, in elimination order.
    """
    from scipy.linalg import eigvalsh

    if A is None:
        return 0, n, 0
    values = A.data if sp.issparse(A) else A
    if not np.all(np.isfinite(values)):
        return None
    if A.ndim == 1:
        return int(np.sum(A < 0.0)), int(np.sum(A == 0.0)), int(np.sum(A > 0.0))
    S = _scaled(A)
    if n <= FEW or not sp.issparse(A) and n <= FEW_DENSE:
        with one_thread():
            values = eigvalsh(S if isinstance(S, np.ndarray) else S.toarray())
        negative, positive = int(np.sum(values < -ZERO)), int(np.sum(values > ZERO))
        return negative, n - negative - positive, positive
    if not sp.issparse(A):
        return None
    ptr, index, _ = core_sparse(S)
    if n + int(_core.count_factor(ptr, index).sum()) > MOST:
        return None
    shift = ZERO * sp.eye_array(n)
    above, below = _pivots(S + shift), _pivots(S - shift)
    if above is None or below is None:
        return None
    negative, positive = int(np.sum(above < 0.0)), int(np.sum(below > 0.0))
    return negative, n - negative - positive, positive


def _scaled(A: np.ndarray | sp.csr_array) -> np.ndarray | sp.csr_array:
    """A scaled to a diagonal of +-1; rows with a zero diagonal entry by their largest entry."""
    size, largest = np.abs(diagonal(A)), abs(A).max(axis=1)
    largest = largest.toarray().ravel() if sp.issparse(largest) else largest
    size = np.where(size > 0.0, size, np.where(largest > 0.0, largest, 1.0))
    root = 1.0 / np.sqrt(size)
    if sp.issparse(A):
        return sp.csr_array(sp.diags_array(root) @ A @ sp.diags_array(root))
    return root[:, None] * A * root


def _pivots(A: sp.csr_array) -> np.ndarray | None:
    """The pivots of A in the given order, None where SuperLU pivots off the diagonal."""
    from scipy.sparse.linalg import splu

    options = dict(SymmetricMode=True)
    try:
        with one_thread():
            lu = splu(sp.csc_array(A), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:  # exactly singular
        return None
    natural = np.arange(A.shape[0])
    if not (np.array_equal(lu.perm_r, natural) and np.array_equal(lu.perm_c, natural)):
        return None
    result: np.ndarray | None = lu.U.diagonal()
    return result
