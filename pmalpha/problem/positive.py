"""Factors of positive definite sparse matrices, and whether they are so beyond rounding."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from .ordering import elimination_order, graph_of

# A structure is floating when its stiffness for some motion is below the rounding of its entries,
# relative to the diagonal, which makes the test independent of scaling and units.
FLOATING = 64.0 * np.finfo(float).eps


class Factors:
    """SuperLU's factors in an order of little fill."""

    def __init__(self, S: sp.csc_array, order: np.ndarray):
        symmetric = {"SymmetricMode": True}
        permuted = sp.csc_array(sp.csr_array(S)[order][:, order])
        self._order = order
        self._factors = splu(permuted, "NATURAL", diag_pivot_thresh=0.0, options=symmetric)
        positive = np.all(self._factors.U.diagonal() > 0.0)
        if not (positive and np.array_equal(self._factors.perm_r, self._factors.perm_c)):
            raise RuntimeError("a pivot is not positive")

    def solve(self, b: np.ndarray) -> np.ndarray:
        """S^-1 b for b of shape (n,) or (n, k)."""
        x = np.empty_like(b)
        x[self._order] = self._factors.solve(b[self._order])
        return x


def positive_definite(S: sp.csc_array) -> Factors:
    """The factors of S, pivots on the diagonal; LinAlgError if one is not positive."""
    graph = graph_of([sp.csr_array(S)])
    order = elimination_order(S.shape[0], graph, np.empty(0, dtype=np.int64))
    try:
        return Factors(S, order)
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error


def scale_to_one(K: sp.csc_array) -> sp.dia_array:
    """Scales the diagonal to about one, by powers of two, so that units have no effect."""
    d = np.abs(K.diagonal())
    d[d == 0.0] = 1.0
    return sp.diags_array(2.0 ** np.round(-0.5 * np.log2(d)))


def softest(G: sp.csc_array, factors: Factors | None = None) -> float:
    """The smallest eigenvalue of G, approximately, or zero when a pivot is not positive."""
    if factors is None:
        try:
            factors = positive_definite(G)
        except np.linalg.LinAlgError:
            return 0.0
    x = np.cos(np.arange(G.shape[0]))
    for _ in range(4):
        x = factors.solve(x / np.max(np.abs(x)))
        if not np.all(np.isfinite(x)):
            return 0.0
    x /= np.max(np.abs(x))
    return float(x @ (G @ x) / (x @ x))
