"""The constraints of one subdomain, L_i, as the core stores them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import core_sparse


@dataclass(frozen=True, eq=False)
class Link:
    """L (p, n) by columns, since most of its rows are empty.

    Attributes
    ----------
    p : int
        Number of constraints.
    ptr : (n + 1,) array of int64
        The entries of column j are those from ptr[j] to ptr[j + 1].
    index : (entries,) array of int32
        The constraint of each entry, ascending in each column.
    values : (entries,) array
    """

    p: int
    ptr: np.ndarray
    index: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, L: sp.csc_array) -> Link:
        """The same matrix; indices of `L` are sorted."""
        return cls(L.shape[0], *core_sparse(L))

    @classmethod
    def empty(cls, n: int) -> Link:
        """No constraints of n dofs."""
        return cls(0, np.zeros(n + 1, np.int64), np.empty(0, np.int32), np.empty(0))

    @property
    def n(self) -> int:
        """Number of dofs."""
        return self.ptr.size - 1

    @property
    def dofs(self) -> np.ndarray:
        """The dofs with an entry, ascending."""
        return np.flatnonzero(np.diff(self.ptr))

    @cached_property
    def rows(self) -> np.ndarray:
        """The constraints with an entry, ascending."""
        return self._numbered[0].astype(np.int64)

    @property
    def local(self) -> np.ndarray:
        """The number in `rows` of the constraint of each entry."""
        return self._numbered[1].reshape(-1)

    @cached_property
    def _numbered(self) -> tuple[np.ndarray, np.ndarray]:
        return np.unique(self.index, return_inverse=True)

    @property
    def columns(self) -> np.ndarray:
        """The dof of each entry."""
        return np.repeat(np.arange(self.n), np.diff(self.ptr))

    @property
    def pattern(self) -> Link:
        """The same with ones as entries."""
        return replace(self, values=np.ones(self.values.size))

    @cached_property
    def matrix(self) -> sp.csc_array:
        """For products with vectors."""
        return sp.csc_array((self.values, self.index, self.ptr), shape=(self.p, self.n))

    def own(self, nb: int | None = None) -> sp.csr_array:
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
            result: np.ndarray = self.own(nb) @ X
            return result
        order = np.argsort(self.local)  # one entry in each, as in ties
        values, column = self.values[order], self.columns[order] - (self.n - nb)
        result = values[:, None] * X[column] + 0.0  # a sum that begins with zero has no -0.0
        return result

    def dense(self, nb: int | None = None) -> np.ndarray:
        """The same as an array."""
        before = 0 if nb is None else self.n - nb
        own = np.zeros((self.rows.size, self.n - before))
        own[self.local, self.columns - before] = self.values
        return own

    def in_order(self, order: np.ndarray) -> Link:
        """Column k is that of dof order[k]."""
        begin, counts = self.ptr[order], np.diff(self.ptr)[order]
        ptr = np.concatenate([[0], np.cumsum(counts)])
        entries = np.arange(ptr[-1]) + np.repeat(begin - ptr[:-1], counts)
        return Link(self.p, ptr, self.index[entries], self.values[entries])

    def with_rows(self, position: np.ndarray) -> Link:
        """Row k becomes row position[k]."""
        index = position[self.index].astype(np.int32)
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

    def without(self, dofs: np.ndarray) -> Link:
        """The columns of these dofs are emptied."""
        counts = np.diff(self.ptr)
        kept = np.ones(self.n, dtype=bool)
        kept[dofs] = False
        entries = np.repeat(kept, counts)
        ptr = np.concatenate([[0], np.cumsum(counts * kept)])
        return Link(self.p, ptr, self.index[entries], self.values[entries])
