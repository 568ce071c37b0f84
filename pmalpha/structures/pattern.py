"""Sparsity pattern of the matrices of a structure, and assembly of element matrices in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


@dataclass(frozen=True, eq=False)
class Pattern:
    """Pairs of nodes that share an element, as compressed rows, and the pairs of each element."""

    indptr: np.ndarray  # (N + 1,)
    indices: np.ndarray  # (pairs,)
    pair: np.ndarray  # (E, a, a): index of the pair of corners a, b of an element

    @classmethod
    def of(cls, elements: np.ndarray, nodes: int) -> Pattern:
        keys = elements[:, :, None].astype(np.int64) * nodes + elements[:, None, :]
        pairs, pair = np.unique(keys, return_inverse=True)
        rows, columns = np.divmod(pairs, nodes)
        indptr = np.searchsorted(rows, np.arange(nodes + 1))
        return cls(indptr, columns, pair.reshape(keys.shape))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(pairs,): element values (E or 1, a, a), assembled."""
        values = np.broadcast_to(values, self.pair.shape)
        return np.bincount(self.pair.ravel(), values.ravel(), minlength=self.indices.size)

    def matrix(self, values: np.ndarray) -> sp.csr_array:
        """Element matrices (E, a, a), or (E, a, d, a, d) with d dofs per node, assembled."""
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


def lumped_mass(elements: np.ndarray, masses: np.ndarray, nodes: int) -> np.ndarray:
    """(N,): masses (E or 1, a or 1) of the corners, assembled."""
    masses = np.broadcast_to(masses, elements.shape)
    return np.bincount(elements.ravel(), masses.ravel(), minlength=nodes)
