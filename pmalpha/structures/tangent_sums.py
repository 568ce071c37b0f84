"""Assembly of element forces and of symmetric element tangents, in a pattern made once."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp

from .element_force import in_pattern
from .pattern import Pattern, upper


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
            own, numbers = np.unique(pairs.pair[part], return_inverse=True)
            self._local.append((own, numbers.ravel()))
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
        own, numbers = self._local[number]
        for total, block in zip(sums, blocks):
            total[own] += np.bincount(numbers, block.ravel(), minlength=own.size)

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
