"""Assembly of element matrices in the dofs of one subdomain."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..problem.internal import InternalForce
from ..structures.pattern import Pattern
from .elements import Elements

# Possible numbers of dofs per node.
NODE_SIZES = (6, 3, 2)


def assembled(dofs: np.ndarray, values: np.ndarray, n: int) -> sp.csr_array:
    """The (n, n) matrix of element matrices (e or 1, k, k); negative dofs are left out.

    Where dofs come in nodes, the pairs of nodes are sorted instead of the pairs of dofs, of which
    there are up to 36 times as many.
    """
    e, k = dofs.shape
    b = _node_size(dofs, n)
    if b > 1:
        nodes = dofs[:, ::b] // b
        whole = np.broadcast_to(values, (e, k, k)).reshape(e, k // b, b, k // b, b)
        return Pattern.of(nodes, n // b).matrix(whole)
    rows, columns = (np.broadcast_to(x, (e, k, k)) for x in (dofs[:, :, None], dofs[:, None, :]))
    kept = (rows >= 0) & (columns >= 0)
    entries = np.broadcast_to(values, (e, k, k))[kept]
    return sp.coo_array((entries, (rows[kept], columns[kept])), shape=(n, n)).tocsr()


def assembled_mass(dofs: np.ndarray, values: np.ndarray, n: int) -> Any:
    """The (n, n) matrix, or its diagonal (n,) of lumped masses (e or 1, k)."""
    if values.ndim == 3:
        return assembled(dofs, values, n)
    kept = dofs >= 0
    return np.bincount(dofs[kept], np.broadcast_to(values, dofs.shape)[kept], minlength=n)


def _node_size(dofs: np.ndarray, n: int) -> int:
    """b, where the dofs of each element are blocks of b in a row, beginning at multiples of b."""
    e, k = dofs.shape
    for b in NODE_SIZES:
        if k % b == 0 and n % b == 0:
            blocks = dofs.reshape(e, k // b, b)
            first = blocks[:, :, :1]
            if np.all(first >= 0) and np.all(first % b == 0):
                if np.array_equal(blocks, first + np.arange(b)):
                    return b
    return 1


class GroupForce:
    """The internal force of some elements of a group in the dofs of a subdomain."""

    def __init__(self, elements: Elements, numbers: np.ndarray, dofs: np.ndarray, n: int):
        e, k = dofs.shape
        self._internal, self._numbers, self._dofs, self._n = elements.internal, numbers, dofs, n
        self._kept = dofs >= 0
        pairs = self._kept[:, :, None] & self._kept[:, None, :]
        keys = (dofs[:, :, None] * n + dofs[:, None, :])[pairs]
        entries, self._slot = np.unique(keys, return_inverse=True)
        self._pairs = pairs
        row, self._column = np.divmod(entries, n)
        self._start = np.searchsorted(row, np.arange(n + 1))
        self._shape = elements.history[numbers].shape

    def force(self, history: np.ndarray) -> InternalForce:
        ones = np.ones(self._column.size)
        return InternalForce(self, history=history.ravel(), pattern=self._matrix_of(ones))

    def __call__(self, u: np.ndarray, v: np.ndarray, t: float, q: np.ndarray) -> tuple[Any, ...]:
        assert self._internal is not None
        # the dof -1 is the zero at the end
        at = [np.append(x, 0.0)[self._dofs] for x in (u, v)]
        f, *tangents = self._internal(*at, t, q.reshape(self._shape), self._numbers)
        q1 = [np.asarray(tangents.pop()).ravel()] if len(tangents) == 3 else []
        values = self._checked(f, self._dofs.shape, "f")
        total = np.bincount(self._dofs[self._kept], values[self._kept], minlength=self._n)
        matrices = [self._tangent(A, name) for A, name in zip(tangents, ("K_t", "C_t"))]
        return (total, *matrices, *q1)

    def _tangent(self, values: Any, name: str) -> sp.csr_array | None:
        if values is None:
            return None
        e, k = self._dofs.shape
        whole = self._checked(values, (e, k, k), name)
        return self._matrix_of(
            np.bincount(self._slot, whole[self._pairs], minlength=self._column.size)
        )

    def _matrix_of(self, values: np.ndarray) -> sp.csr_array:
        return sp.csr_array((values, self._column, self._start), shape=(self._n, self._n))

    @staticmethod
    def _checked(values: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
        array = np.asarray(values, dtype=np.float64)
        if array.shape != shape:
            raise ValueError(f"internal must return {name} of shape {shape}, got {array.shape}")
        return array
