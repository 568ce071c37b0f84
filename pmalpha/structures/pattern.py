"""The pattern of a structure's matrices, and sums of element matrices in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True, eq=False)
class Pattern:
    """Which nodes share an element, as compressed rows, and where each element adds to them."""

    indptr: np.ndarray  # (N + 1,)
    indices: np.ndarray  # (pairs,)
    place: np.ndarray  # (E, a, a): of corners a, b of an element, among the pairs

    @classmethod
    def of(cls, elements: np.ndarray, nodes: int) -> Pattern:
        keys = elements[:, :, None].astype(np.int64) * nodes + elements[:, None, :]
        pairs, place = np.unique(keys, return_inverse=True)
        rows, columns = np.divmod(pairs, nodes)
        indptr = np.searchsorted(rows, np.arange(nodes + 1))
        return cls(indptr, columns, place.reshape(keys.shape))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(pairs,): values (E or 1, a, a) added up."""
        spread = np.broadcast_to(values, self.place.shape)
        return np.bincount(self.place.ravel(), spread.ravel(), minlength=self.indices.size)

    def matrix(self, values: np.ndarray) -> sp.csr_array:
        """The sum of element matrices (E, a, a), or (E, a, d, a, d) with d dofs for each node."""
        if values.ndim == 3:
            values = values[:, :, None, :, None]
        d = values.shape[2]
        blocks = np.empty((self.indices.size, d, d))
        for i, j in np.ndindex(d, d):
            blocks[:, i, j] = self.sums(values[:, :, i, :, j])
        return self.of_blocks(blocks)

    def of_blocks(self, blocks: np.ndarray) -> sp.csr_array:
        """The matrix with blocks (pairs, d, d)."""
        n = (self.indptr.size - 1) * blocks.shape[1]
        return sp.bsr_array((blocks, self.indices, self.indptr), shape=(n, n)).tocsr()


def lumped_mass(elements: np.ndarray, shares: np.ndarray, nodes: int) -> np.ndarray:
    """(N,): shares (E or 1, a or 1) of the corners added up."""
    spread = np.broadcast_to(shares, elements.shape)
    return np.bincount(elements.ravel(), spread.ravel(), minlength=nodes)
