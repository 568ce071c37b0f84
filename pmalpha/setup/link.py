"""The constraints of one subdomain, L_i, as the core stores them, and its block of H."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._cached import cached_property
from .._checks import counted
from ..memory import one_thread, require
from ..problem.forms import Columns, Factor
from ..problem.matrices import core_sparse
from .factors import interface_block, sides

# Multiplications from which on LAPACK is faster than sweeps for the constraints one by one.
SWEPT = 128 * 64 * 48


@dataclass(frozen=True, eq=False)
class Link:
    """L (p, n) by columns, since most of its rows are empty."""

    p: int  # number of constraints
    # (n + 1,) array of int64, the entries of column j are those from ptr[j] to ptr[j + 1]
    ptr: np.ndarray
    # (entries,) array of int32, the constraint of each entry, ascending in each column
    index: np.ndarray
    values: np.ndarray  # (entries,) array

    @classmethod
    def of(cls, L: sp.csc_array) -> Link:
        """The same matrix; indices of `L` are sorted."""
        return cls(L.shape[0], *core_sparse(L))

    @classmethod
    def of_entries(
        cls, p: int, n: int, values: np.ndarray, rows: np.ndarray, columns: np.ndarray
    ) -> Link:
        """The matrix (p, n) with these entries, of which no two are at one place."""
        order = np.lexsort((rows, columns))
        ptr = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=n))])
        return cls(p, ptr.astype(np.int64), rows[order].astype(np.int32), values[order])

    @classmethod
    def empty(cls, n: int) -> Link:
        """No constraints of n dofs."""
        return cls(0, np.zeros(n + 1, np.int64), np.empty(0, np.int32), np.empty(0))

    @property
    def n(self) -> int:
        """Number of dofs."""
        return self.ptr.size - 1

    @property
    def counts(self) -> np.ndarray:
        """The number of entries of each column."""
        result: np.ndarray = self.ptr[1:] - self.ptr[:-1]
        return result

    @property
    def dofs(self) -> np.ndarray:
        """The dofs with an entry, ascending."""
        return self.counts.nonzero()[0]

    @cached_property
    def rows(self) -> np.ndarray:
        """The constraints with an entry, ascending."""
        return self._numbered[0].astype(np.int64)

    @property
    def local(self) -> np.ndarray:
        """The number in `rows` of the constraint of each entry."""
        return self._numbered[1]

    @cached_property
    def _numbered(self) -> tuple[np.ndarray, np.ndarray]:
        order = self.index.argsort(kind="stable")
        ascending = self.index[order]
        is_new = np.ones(ascending.size, dtype=bool)
        is_new[1:] = ascending[1:] != ascending[:-1]
        local = np.empty(ascending.size, dtype=np.int64)
        local[order] = is_new.cumsum() - 1
        return ascending[is_new], local

    @property
    def columns(self) -> np.ndarray:
        """The dof of each entry."""
        return np.arange(self.n).repeat(self.counts)

    @property
    def pattern(self) -> Link:
        """The same with ones as entries."""
        return replace(self, values=np.ones(self.values.size))

    @property
    def shares_dofs(self) -> bool:
        """Whether two constraints have a dof in common; those that have none are independent."""
        return bool(np.any(self.counts > 1))

    def products(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """L x and |L| |x| on the constraints of `rows`, of (n,) values."""
        terms = self.values * x[self.columns]
        sums = [np.bincount(self.local, y, self.rows.size) for y in (terms, np.abs(terms))]
        return sums[0], sums[1]

    @cached_property
    def matrix(self) -> sp.csc_array:
        """For products with vectors."""
        return sp.csc_array((self.values, self.index, self.ptr), shape=(self.p, self.n))

    def sparse(self, nb: int | None = None) -> sp.csr_array:
        """The constraints of `rows` by rows; of the last nb dofs, if given: others have none."""
        before = 0 if nb is None else self.n - nb
        order = np.argsort(self.local, kind="stable")
        ptr = np.concatenate([[0], np.cumsum(np.bincount(self.local))])
        arrays = self.values[order], (self.columns - before)[order], ptr
        return sp.csr_array(arrays, shape=(self.rows.size, self.n - before))

    def times(self, X: np.ndarray) -> np.ndarray:
        """The constraints of `rows` times X, (nb, k), of the last nb dofs."""
        nb = len(X)
        if self.rows.size < self.index.size:
            result: np.ndarray = self.sparse(nb) @ X
            return result
        order = np.argsort(self.local)  # one entry in each, as in ties
        values, column = self.values[order], self.columns[order] - (self.n - nb)
        result = values[:, None] * X[column] + 0.0  # a sum that begins with zero has no -0.0
        return result

    def dense(self, nb: int | None = None) -> np.ndarray:
        """The same as an array."""
        before = 0 if nb is None else self.n - nb
        array = np.zeros((self.rows.size, self.n - before))
        array[self.local, self.columns - before] = self.values
        return array

    def in_order(self, order: np.ndarray) -> Link:
        """Column k is that of dof order[k]."""
        begin, counts = self.ptr[order], self.counts[order]
        ptr = np.zeros_like(self.ptr)
        counts.cumsum(out=ptr[1:])
        entries = np.arange(ptr[-1]) + (begin - ptr[:-1]).repeat(counts)
        return Link(self.p, ptr, self.index[entries], self.values[entries])

    def with_rows(self, position: np.ndarray) -> Link:
        """Row k becomes row position[k]."""
        index = position[self.index].astype(np.int32)
        if not self.shares_dofs:  # one entry in a column
            return Link(self.p, self.ptr, index, self.values)
        entries = np.lexsort((index, self.columns))
        return Link(self.p, self.ptr, index[entries], self.values[entries])

    def with_rows_divided(self, scale: np.ndarray) -> Link:
        """Row k is divided by scale[k]."""
        if np.all(scale == 1.0):
            return self
        return replace(self, values=self.values / scale[self.index])

    def of_dofs(self, begin: int, end: int) -> Link:
        """The columns from begin to end."""
        ptr = self.ptr[begin : end + 1]
        entries = slice(ptr[0], ptr[-1])
        return Link(self.p, ptr - ptr[0], self.index[entries], self.values[entries])

    def core(self, begin: int) -> Columns:
        """The columns from begin on, in the form of the core."""
        part = self.of_dofs(begin, self.n)
        return Columns(part.p, part.ptr, part.index, part.values)

    def local_columns(self, nb: int) -> Columns:
        """The last nb columns in the form of the core, with the constraints of `rows` alone."""
        ptr = self.ptr[self.n - nb :]
        local = self.local[ptr[0] :].astype(np.int32, copy=False)
        return Columns(self.rows.size, ptr - ptr[0], local, self.values[ptr[0] :])

    def without(self, dofs: np.ndarray) -> Link:
        """The columns of these dofs are emptied."""
        counts = np.diff(self.ptr)
        mask = np.ones(self.n, dtype=bool)
        mask[dofs] = False
        entries = np.repeat(mask, counts)
        ptr = np.concatenate([[0], np.cumsum(counts * mask)])
        return Link(self.p, ptr, self.index[entries], self.values[entries])


@dataclass(frozen=True)
class Block:
    """A block of H."""

    rows: np.ndarray  # (k,) array of int, its constraints, the rows and columns of H
    values: np.ndarray
    # of each entry, in 0..k-1; None where all entries are stored
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
            k = rows.size
            return self.values.ravel(), rows.repeat(k), rows[None].repeat(k, axis=0).ravel()
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
    k = int(starts[-1])
    if not np.any(sizes > 1):  # constraints share no dofs: the blocks are diagonal
        sums = np.bincount(local, values * inverse[column] * values, k).astype(float)
        numbers = [np.arange(L.rows.size) for L in links]
        pieces = zip(links, numbers, starts, starts[1:])
        return [Block(L.rows, sums[i:j], (x, x)) for L, x, i, j in pieces]
    # the pairs of entries of one column: the second goes through that column for each first
    times = sizes[column]
    first = np.repeat(np.arange(column.size), times)
    begin = np.repeat(np.cumsum(times) - times, times)
    second = np.arange(first.size) - begin + ptr[column[first]]
    values = values[first] * inverse[column[first]] * values[second]
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
    if rows.size * nb**2 < SWEPT:
        block = _core.compliance(factor, L.local_columns(nb), inverse.size, nb)
        return Block(rows, block if len(sides(factor)) > 1 else 0.5 * (block + block.T))
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
    S_inv = np.tril(half)
    S_inv += np.tril(half, k=-1).T
    return L.times(np.ascontiguousarray(L.times(S_inv).T))


def _solved(R_bb: np.ndarray, L: Link) -> np.ndarray:
    """R_bb^-1 L_b^T"""
    from scipy.linalg import solve_triangular

    right = L.dense(len(R_bb)).T
    result: np.ndarray = solve_triangular(
        R_bb, right, lower=True, unit_diagonal=True, overwrite_b=True
    )
    return result
