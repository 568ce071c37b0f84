"""Blocks of the interface matrix: the compliance of one subdomain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotri

from .._checks import counted
from ..blas import one_thread
from ..memory import require
from ..problem.matrices import row_of_entries
from .factors import Factor, interface_block, sides
from .paths import compliance_along_paths


def constraints_of(L: sp.csc_array) -> np.ndarray:
    """The constraints of one subdomain: the rows of L that have an entry."""
    return np.unique(L.indices).astype(np.int64)


def own_rows(L: sp.csc_array, nb: int | None = None) -> tuple[np.ndarray, sp.csr_array]:
    """The rows of L that have an entry, and L without the others; of its last nb columns."""
    before = 0 if nb is None else L.shape[1] - nb
    rows, local = np.unique(L.indices, return_inverse=True)
    by_rows = np.argsort(local.reshape(-1), kind="stable")
    ptr = np.concatenate([[0], np.cumsum(np.bincount(local.reshape(-1)))])
    columns = (row_of_entries(L) - before)[by_rows]
    own = sp.csr_array((L.data[by_rows], columns, ptr), shape=(rows.size, L.shape[1] - before))
    return rows.astype(np.int64), own


@dataclass(frozen=True)
class Block:
    """A block of H.

    Attributes
    ----------
    rows : (k,) array of int
        Its constraints, the rows and columns of H.
    values : (k, k) array or sparse array
    """

    rows: np.ndarray
    values: np.ndarray | sp.sparray

    @property
    def is_dense(self) -> bool:
        return not sp.issparse(self.values)

    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(values, rows, columns) of its entries in H."""
        rows = self.rows.astype(np.int32)
        if isinstance(self.values, np.ndarray):
            return self.values.ravel(), np.repeat(rows, rows.size), np.tile(rows, rows.size)
        own = self.values.tocoo()
        return own.data, rows[own.row], rows[own.col]


def diagonal_compliance(inverse: np.ndarray, L: sp.csc_array) -> Block:
    """L A^-1 L^T of a diagonal A, from the reciprocals of its entries."""
    rows, local = np.unique(L.indices, return_inverse=True)
    local, k = local.reshape(-1), rows.size
    column = row_of_entries(L)
    # the pairs of entries of one column: the second goes through that column for each first
    times = np.diff(L.indptr)[column]
    first = np.repeat(np.arange(column.size), times)
    begin = np.repeat(np.cumsum(times) - times, times)
    second = np.arange(first.size) - begin + L.indptr[column[first]]
    values = L.data[first] * inverse[column[first]] * L.data[second]
    places, where = np.unique(local[first] * k + local[second], return_inverse=True)
    sums = np.bincount(where.reshape(-1), weights=values, minlength=places.size)
    sums = sums.astype(float)  # without constraints bincount returns whole numbers
    own = sp.coo_array((sums, (places // k, places % k)), shape=(k, k))
    return Block(rows.astype(np.int64), own)


def compliance(factor: Factor, L: sp.csc_array, nb: int, name: str) -> Block:
    """L A^-1 L^T = L_b S^-1 L_b^T on the constraints of L, from the factor of A."""
    rows, own = own_rows(L, nb)
    if not rows.size:
        return Block(rows, np.zeros((0, 0)))
    size = 8.0 * (3.0 * rows.size**2 + 4.0 * nb * max(nb, rows.size))
    require(size, f"the interface matrix of {counted(rows.size, 'constraint')} of {name!r}")
    inverse, R = factor
    if isinstance(R, tuple) and len(R) == 7:
        block = compliance_along_paths(factor, own)
    else:
        R_bb, *Q_bb = (interface_block(side, nb) for side in sides(factor))
        block = _compliance_of_last(inverse[inverse.size - nb :], R_bb, own, *Q_bb)
    if len(sides(factor)) > 1:
        return Block(rows, block)
    return Block(rows, 0.5 * (block + block.T))  # symmetric up to rounding


def _compliance_of_last(
    inverse: np.ndarray, R_bb: np.ndarray, L_b: sp.csr_array, Q_bb: np.ndarray | None = None
) -> np.ndarray:
    """L_b S^-1 L_b^T, S = R_bb D_b Q_bb^T, (F6); Q_bb is R_bb if None.

    The whole inverse S^-1 takes a third of the work of nb solutions, if it is symmetric; few
    constraints need fewer solutions than that.
    """
    few = Q_bb is not None or 3 * L_b.shape[0] < inverse.size
    with one_thread():
        if few:
            X = Y = _solved(R_bb, L_b)
            if Q_bb is not None:
                Y = _solved(Q_bb, L_b)
            return Y.T @ (inverse[:, None] * X)
        root = 1.0 / np.sqrt(inverse)
        G = np.asfortranarray(R_bb * root)
        np.fill_diagonal(G, root)
        half, _ = dpotri(G, lower=True, overwrite_c=True)
    whole = np.tril(half)
    whole += np.tril(half, k=-1).T
    return L_b @ np.ascontiguousarray((L_b @ whole).T)


def _solved(R_bb: np.ndarray, L_b: sp.csr_array) -> np.ndarray:
    """R_bb^-1 L_b^T"""
    right = L_b.toarray().T
    return solve_triangular(R_bb, right, lower=True, unit_diagonal=True, overwrite_b=True)
