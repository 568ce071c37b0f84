"""Factors of positive definite matrices, and whether they are so beyond rounding."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .ordering import elimination_order, graph_of

# A structure is floating when its stiffness for some motion is below the rounding of its entries,
# relative to the diagonal, which makes the test independent of scaling and units.
FLOATING = 64.0 * np.finfo(float).eps


class DenseFactors:
    """LAPACK's Cholesky factor of a dense matrix; RuntimeError for a pivot that is not positive."""

    def __init__(self, S: np.ndarray):
        from scipy.linalg.lapack import dpotrf

        self._lower, failed = dpotrf(S, lower=True)
        if failed:
            raise RuntimeError("a pivot is not positive")

    def solve(self, b: np.ndarray) -> np.ndarray:
        """S^-1 b for b of shape (n,) or (n, k)."""
        from scipy.linalg.lapack import dpotrs

        result: np.ndarray = dpotrs(self._lower, b, lower=True)[0]
        return result


class Factors:
    """SuperLU's factors in an order of little fill."""

    def __init__(self, S: sp.csc_array, order: np.ndarray):
        from scipy.sparse.linalg import splu

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


def positive_definite(S: sp.csc_array | np.ndarray) -> Factors | DenseFactors:
    """The factors of S, pivots on the diagonal; LinAlgError if one is not positive."""
    try:
        if not sp.issparse(S):
            return DenseFactors(S)
        graph = graph_of([sp.csr_array(S)])
        return Factors(S, elimination_order(S.shape[0], graph, np.empty(0, dtype=np.int64)))
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error


def scale_to_one(K: sp.csc_array) -> sp.dia_array:
    """Scales the diagonal to about one, by powers of two, so that units have no effect."""
    return sp.diags_array(scales_to_one(K.diagonal()))


def scales_to_one(diagonal: np.ndarray) -> np.ndarray:
    """The factors of rows and columns in that, (n,)."""
    d = np.where(diagonal == 0.0, 1.0, np.abs(diagonal))
    return 2.0 ** np.round(-0.5 * np.log2(d))


def softest(G: sp.csc_array | np.ndarray, factors: Factors | DenseFactors | None = None) -> float:
    """The smallest eigenvalue of G, approximately, or zero when a pivot is not positive."""
    if factors is None:
        try:
            factors = positive_definite(G)
        except np.linalg.LinAlgError:
            return 0.0
    x = np.cos(np.arange(G.shape[0]))
    for _ in range(4):
        x = factors.solve(x / np.abs(x).max())
        if not np.isfinite(x).all():
            return 0.0
    x /= np.abs(x).max()
    return float(x @ (G @ x) / (x @ x))
