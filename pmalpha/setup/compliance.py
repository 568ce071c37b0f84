"""Blocks of the interface matrix: the compliance of one subdomain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._checks import counted
from ..blas import one_thread
from ..memory import require
from .factors import Factor, interface_block, sides
from .link import Link


@dataclass(frozen=True)
class Block:
    """A block of H.

    Attributes
    ----------
    rows : (k,) array of int
        Its constraints, the rows and columns of H.
    values : (k, k) or (entries,) array
    places : (row, column) or None
        Of each entry, in 0..k-1; None where all entries are stored.
    """

    rows: np.ndarray
    values: np.ndarray
    places: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def of_nonzero(cls, rows: np.ndarray, values: np.ndarray) -> Block:
        """Without the zeros of (k, k) values."""
        row, column = np.nonzero(values)
        return cls(rows, values[row, column], (row, column))

    @property
    def is_dense(self) -> bool:
        return self.places is None

    def times(self, factor: float) -> Block:
        return Block(self.rows, factor * self.values, self.places)

    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(values, rows, columns) of its entries in H."""
        rows = self.rows.astype(np.int32)
        if self.places is None:
            return self.values.ravel(), np.repeat(rows, rows.size), np.tile(rows, rows.size)
        return self.values, rows[self.places[0]], rows[self.places[1]]


def diagonal_compliances(inverses: Sequence[np.ndarray], links: Sequence[Link]) -> list[Block]:
    """L A^-1 L^T of diagonal matrices A, from the reciprocals of their entries, in one pass."""
    if not links:
        return []
    # the constraints of each subdomain numbered, one subdomain after the other
    starts = np.cumsum([0] + [L.rows.size for L in links])
    local = np.concatenate([L.local + start for L, start in zip(links, starts)])
    inverse, values = np.concatenate(inverses), np.concatenate([L.values for L in links])
    sizes = np.concatenate([np.diff(L.ptr) for L in links])
    ptr, column = np.cumsum(sizes) - sizes, np.repeat(np.arange(sizes.size), sizes)
    # the pairs of entries of one column: the second goes through that column for each first
    times = sizes[column]
    first = np.repeat(np.arange(column.size), times)
    begin = np.repeat(np.cumsum(times) - times, times)
    second = np.arange(first.size) - begin + ptr[column[first]]
    values = values[first] * inverse[column[first]] * values[second]
    k = int(starts[-1])
    places, where = np.unique(local[first] * k + local[second], return_inverse=True)
    sums = np.bincount(where.reshape(-1), weights=values, minlength=places.size)
    sums = sums.astype(float)  # without constraints bincount returns whole numbers
    row, column = places // max(k, 1), places % max(k, 1)
    ends = np.searchsorted(row, starts)
    return [
        Block(L.rows, sums[i:j], (row[i:j] - start, column[i:j] - start))
        for L, start, i, j in zip(links, starts, ends, ends[1:])
    ]


def compliance(factor: Factor, L: Link, nb: int, name: str) -> Block:
    """L A^-1 L^T = L_b S^-1 L_b^T on the constraints of L, from the factor of A."""
    rows = L.rows
    if not rows.size:
        return Block(rows, np.zeros((0, 0)))
    size = 8.0 * (3.0 * rows.size**2 + 4.0 * nb * max(nb, rows.size))
    require(size, f"the interface matrix of {counted(rows.size, 'constraint')} of {name!r}")
    inverse, _ = factor
    R_bb, *Q_bb = (interface_block(side, nb) for side in sides(factor))
    block = _compliance_of_last(inverse[inverse.size - nb :], R_bb, L, *Q_bb)
    if len(sides(factor)) > 1:
        return Block(rows, block)
    return Block(rows, 0.5 * (block + block.T))  # symmetric up to rounding


def _compliance_of_last(
    inverse: np.ndarray, R_bb: np.ndarray, L: Link, Q_bb: np.ndarray | None = None
) -> np.ndarray:
    """L_b S^-1 L_b^T, S = R_bb D_b Q_bb^T, (F6); Q_bb is R_bb if None.

    The whole inverse S^-1 takes a third of the work of nb solutions, if it is symmetric; few
    constraints need fewer solutions than that.
    """
    from scipy.linalg.lapack import dpotri

    few = Q_bb is not None or 3 * L.rows.size < inverse.size
    with one_thread():
        if few:
            X = Y = _solved(R_bb, L)
            if Q_bb is not None:
                Y = _solved(Q_bb, L)
            result: np.ndarray = Y.T @ (inverse[:, None] * X)
            return result
        root = 1.0 / np.sqrt(inverse)
        G = np.asfortranarray(R_bb * root)
        np.fill_diagonal(G, root)
        half, _ = dpotri(G, lower=True, overwrite_c=True)
    whole = np.tril(half)
    whole += np.tril(half, k=-1).T
    return L.times(np.ascontiguousarray(L.times(whole).T))


def _solved(R_bb: np.ndarray, L: Link) -> np.ndarray:
    """R_bb^-1 L_b^T"""
    from scipy.linalg import solve_triangular

    right = L.dense(len(R_bb)).T
    result: np.ndarray = solve_triangular(
        R_bb, right, lower=True, unit_diagonal=True, overwrite_b=True
    )
    return result
