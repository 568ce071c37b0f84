"""The order of elimination: interface dofs last, little fill before them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spilu

from . import _core
from .matrices import Matrix

# The natural order is taken without a look at others when it fills this little: a chain, a frame
# with its storeys in a row.
LITTLE_FILL = 1.5
# An order whose envelope is so many times the fill of another is not counted: that takes time in
# proportion to its own fill.
HOPELESS = 8.0


def elimination_order(n: int, terms: list[Matrix], last: np.ndarray) -> np.ndarray:
    """Dof at each place of the elimination order.

    Parameters
    ----------
    n : int
    terms : list of matrices in inner form
        Those that the matrix to be factored is a sum of.
    last : (nb,) sorted array of int
        Dofs that come last: the interface.

    Returns
    -------
    (n,) array of int
    """
    interior = np.setdiff1d(np.arange(n), last, assume_unique=True)
    natural = np.concatenate([interior, last])
    sparse = [A for A in terms if A is not None and sp.issparse(A)]
    if not sparse or len(sparse) < sum(A is not None and A.ndim == 2 for A in terms):
        return natural  # nothing but diagonals, or dense anyway
    pattern = _pattern(sum(abs(A).sign() for A in sparse))
    best, bound = natural, envelope(pattern, natural)
    if bound > LITTLE_FILL * (pattern.nnz + n) / 2:
        degree = interior[_minimum_degree(sp.csr_array(pattern[interior][:, interior]))]
        best = np.concatenate([degree, last])
        least = fill(pattern, best)
        if bound < HOPELESS * least and fill(pattern, natural) <= least:
            best = natural
    return best[_core.postorder(*_rows(pattern, best), last.size)]


def envelope(pattern: sp.csr_array, order: np.ndarray) -> int:
    """An upper bound of `fill` that costs one pass: all from the first entry of each row on."""
    ptr, index = _rows(pattern, order)
    n = order.size
    first = np.arange(n)
    filled = np.diff(ptr) > 0
    first[filled] = np.minimum(np.minimum.reduceat(index, ptr[:-1][filled]), first[filled])
    return int(np.sum(np.arange(n) - first)) + n


def fill(pattern: sp.csr_array, order: np.ndarray) -> int:
    """Entries of the factor in this order, with the diagonal."""
    return order.size + int(_core.count_factor(*_rows(pattern, order)).sum())


def _rows(pattern: sp.csr_array, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pattern in an order, as the core takes it."""
    B = sp.csr_array(pattern[order][:, order])
    return B.indptr.astype(np.int64), B.indices.astype(np.int32)


def _pattern(A: Matrix) -> sp.csr_array:
    """The graph of A: symmetric, without a diagonal, all entries one."""
    graph = sp.coo_array(A + A.T)
    off = graph.row != graph.col
    ones = np.ones(int(off.sum()))
    return sp.csr_array((ones, (graph.row[off], graph.col[off])), shape=A.shape)


def _minimum_degree(graph: sp.csr_array) -> np.ndarray:
    """Multiple minimum degree, as SuperLU does it; an incomplete factor that keeps nothing
    returns the order alone."""
    n = graph.shape[0]
    if n < 2 or graph.nnz == 0:
        return np.arange(n)
    degrees = graph.sum(axis=1)
    definite = sp.csc_array(sp.diags_array(degrees + 1.0) - graph)
    factor = spilu(
        definite,
        permc_spec="MMD_AT_PLUS_A",
        drop_tol=1.0,
        fill_factor=1.0,
        options=dict(SymmetricMode=True),
    )
    return np.argsort(factor.perm_c)
