"""Sparsity pattern of the matrices of a structure, and assembly of element matrices in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .element_force import in_pattern

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
            entries = np.asarray(pairs[elements[:, i].ravel(), elements[:, j].ravel()])
            entries = entries.reshape(count, i.size)
            pair[:, i, j] = entries
            pair[:, j, i] = mirror[entries]
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


class Assembly:
    """Elements with d dofs per node, cut into chunks.

    A tangent is summed by pairs of components (i, j) with i <= j and by pairs of nodes, chunk by
    chunk in the numbering of the chunk's own pairs, so that what is summed remains in the cache;
    then one gather brings the sums into the order of the compressed rows.
    """

    def __init__(
        self,
        elements: np.ndarray,
        nodes: int,
        d: int,
        chunk: int = 4096,
        pairs: Pattern | None = None,
    ):
        self.elements, self.nodes, self.d = elements, nodes, d
        self.components = upper(d)
        starts = range(0, len(elements), chunk)
        self.chunks = [slice(first, min(first + chunk, len(elements))) for first in starts]
        pairs = Pattern.of(elements, nodes) if pairs is None else pairs
        self._local = []
        for part in self.chunks:
            entries, numbers = np.unique(pairs.pair[part], return_inverse=True)
            self._local.append((entries, numbers.ravel()))
        self._count = pairs.indices.size
        self.pattern, self._order = _rows(pairs, self.components, d)

    def force(self, values: np.ndarray) -> np.ndarray:
        """(n,): element forces (E, a, d), summed."""
        corners = self.elements.ravel()
        columns = [
            np.bincount(corners, values[:, :, i].ravel(), minlength=self.nodes)
            for i in range(self.d)
        ]
        return np.stack(columns, axis=1).ravel()

    def sums(self) -> np.ndarray:
        """Zeros, to which `add` adds."""
        return np.zeros((len(self.components), self._count))

    def add(self, sums: np.ndarray, number: int, blocks: Iterable[np.ndarray]) -> None:
        """Add element tangents of one chunk: for each of `components` an (e, a, a) array."""
        entries, numbers = self._local[number]
        for total, block in zip(sums, blocks):
            total[entries] += np.bincount(numbers, block.ravel(), minlength=entries.size)

    def matrix(self, sums: np.ndarray) -> sp.csr_array:
        return in_pattern(sums.ravel()[self._order], self.pattern)

    def tangent(self, values: np.ndarray) -> sp.csr_array:
        """Symmetric element matrices (E, a, d, a, d) of all elements, assembled."""
        sums = self.sums()
        for number, part in enumerate(self.chunks):
            self.add(sums, number, (values[part, :, i, :, j] for i, j in self.components))
        return self.matrix(sums)


def _rows(
    pairs: Pattern, components: list[tuple[int, int]], d: int
) -> tuple[sp.csr_array, np.ndarray]:
    """The pattern of the dofs, and for each of its entries the number of the sum it is."""
    nodes, count = pairs.indptr.size - 1, pairs.indices.size
    blocks = np.empty((count, d, d), dtype=np.int64)
    for number, (i, j) in enumerate(components):
        blocks[:, j, i] = number * count + pairs.mirror
        blocks[:, i, j] = number * count + np.arange(count)
    shape = (d * nodes, d * nodes)
    numbered = sp.bsr_array((blocks, pairs.indices, pairs.indptr), shape=shape).tocsr()
    return in_pattern(np.ones(numbered.nnz), numbered), numbered.data
