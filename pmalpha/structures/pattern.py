"""Sparsity pattern of the matrices of a structure, and assembly of element matrices in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

# Pairs of corners that are looked up in one call, for the memory of their numbers.
LOOK_UPS = 100_000


@dataclass(frozen=True, eq=False)
class Pattern:
    """Pairs of nodes that share an element, as compressed rows, and the pairs of each element."""

    indptr: np.ndarray  # (N + 1,)
    indices: np.ndarray  # (pairs,)
    pair: np.ndarray  # (E, a, a): index of the pair of corners a, b of an element
    mirror: np.ndarray  # (pairs,): index of the pair b, a of each pair a, b

    @classmethod
    def of(cls, elements: np.ndarray, nodes: int) -> Pattern:
        count, a = elements.shape
        starts = a * np.arange(count + 1)
        corners = np.ones(elements.size, dtype=np.int8)
        has = sp.csr_array((corners, elements.ravel(), starts), shape=(count, nodes))
        pairs = sp.csr_array(has.T @ has)
        pairs.sort_indices()
        # with the pairs counted through, a pair of nodes finds its number by a look-up in its row
        pairs.data = np.arange(pairs.nnz)
        mirror = sp.csc_array(pairs).data
        pair = np.empty((count, a, a), dtype=np.int32 if pairs.nnz < 2**31 else np.int64)
        first, second = np.triu_indices(a)
        width = LOOK_UPS // max(count, 1) + 1
        for begin in range(0, first.size, width) if count else []:
            i, j = first[begin : begin + width], second[begin : begin + width]
            found = np.asarray(pairs[elements[:, i].ravel(), elements[:, j].ravel()])
            found = found.reshape(count, i.size)
            pair[:, i, j] = found
            pair[:, j, i] = mirror[found]
        return cls(pairs.indptr, pairs.indices, pair, mirror)

    def add(self, sums: np.ndarray, part: slice, values: Iterable[np.ndarray]) -> None:
        """Add arrays (e or 1, a, a) of the elements of a slice to the rows of `sums` (k, pairs).

        One element after the other, so that the sum does not depend on the slices.
        """
        pair = self.pair[part]
        if not pair.size:
            return
        first, last = int(pair.min()), int(pair.max()) + 1
        where = np.concatenate([np.arange(last - first), (pair - first).ravel()])
        for total, value in zip(sums, values):
            added = np.broadcast_to(value, pair.shape).ravel()
            total[first:last] = np.bincount(where, np.concatenate([total[first:last], added]))

    def matrix(self, values: np.ndarray) -> sp.csr_array:
        """Element matrices (E, a, a), or (E, a, d, a, d) with d dofs per node, assembled."""
        if values.ndim == 3:
            values = values[:, :, None, :, None]
        d = values.shape[2]
        sums = np.zeros((d * d, self.indices.size))
        everywhere = (values[:, :, i, :, j] for i, j in np.ndindex(d, d))
        self.add(sums, slice(None), everywhere)
        return self.of_blocks(np.ascontiguousarray(sums.T).reshape(-1, d, d))

    def symmetric(self, sums: np.ndarray, d: int) -> sp.csr_array:
        """The symmetric matrix of sums (d (d + 1) / 2, pairs) of the components i <= j."""
        blocks = np.empty((self.indices.size, d, d))
        for total, (i, j) in zip(sums, upper(d)):
            blocks[:, i, j] = total
            blocks[:, j, i] = total if i == j else total[self.mirror]
        return self.of_blocks(blocks)

    def of_blocks(self, blocks: np.ndarray) -> sp.csr_array:
        """The matrix with blocks (pairs, d, d)."""
        n = (self.indptr.size - 1) * blocks.shape[1]
        return sp.bsr_array((blocks, self.indices, self.indptr), shape=(n, n)).tocsr()


def upper(d: int) -> list[tuple[int, int]]:
    """Pairs i <= j of d numbers."""
    return [(i, j) for i in range(d) for j in range(i, d)]


def lumped_mass(elements: np.ndarray, masses: np.ndarray, nodes: int) -> np.ndarray:
    """(N,): masses (E or 1, a or 1) of the corners, assembled."""
    masses = np.broadcast_to(masses, elements.shape)
    return np.bincount(elements.ravel(), masses.ravel(), minlength=nodes)
