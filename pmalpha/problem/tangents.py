"""Tangents of internal forces: what a user returns, as the values of one sparse pattern."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from .._checks import plain_array
from .matrices import ADMITTED, read_only, row_of_entries, shorten_indices
from .sparse_arrays import check_arrays

# A user's tangent after its check: zero, a diagonal, dense, or by rows.
Tangent: TypeAlias = np.ndarray | sp.csr_array | sp.csr_matrix | None

COMPRESSED = ("csr", "csc")

# Tolerance of the symmetry of the first tangents, relative to the largest entry: the rounding of an
# assembly, and far below what an unsymmetric law has.
SYMMETRY = 1e-9


def checked_tangent(value: Any, name: str, n: int) -> Tangent:
    """A user's tangent, checked for kind and shape; not copied, and it may have infinite
    entries."""
    if value is None:
        return None
    A: Any = value if sp.issparse(value) else plain_array(value, name)
    if A.dtype.kind not in "iuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {A.dtype}")
    if sp.issparse(A):
        if A.shape != (n, n):
            raise ValueError(f"{name} must have shape ({n}, {n}), got {A.shape}")
        check_arrays(A, name)
        return A if A.format == "csr" else by_rows(A, name)
    if A.shape == () and n == 1:
        A = A.reshape(1)
    if A.shape not in ((n,), (n, n)):
        raise ValueError(f"{name} must have shape ({n},) or ({n}, {n}), got {A.shape}")
    return np.asarray(A, dtype=np.float64)


def by_rows(value: Any, name: str) -> sp.csr_array:
    """A copy of a sparse matrix by rows, with sorted columns and its stored zeros."""
    check_arrays(value, name)
    if value.format == "dia":
        value = _with_zeros(value)  # SciPy leaves them out
    A = sp.csr_array(value if value.format in COMPRESSED else sp.coo_array(value), copy=True)
    A.sum_duplicates()
    return A


def _with_zeros(A: Any) -> sp.coo_array:
    """The entries of a matrix by diagonals, those that are zero included."""
    columns = np.broadcast_to(np.arange(A.data.shape[1]), A.data.shape)
    rows = columns - A.offsets[:, None]
    inside = (rows >= 0) & (rows < A.shape[0]) & (columns < A.shape[1])
    return sp.coo_array((A.data[inside], (rows[inside], columns[inside])), shape=A.shape)


# ---- patterns ----------------------------------------------------------------------------------


def entries_of(A: Tangent, n: int) -> sp.csr_array:
    """The pattern of a tangent, with values 1; all entries of a dense matrix are stored."""
    if A is None:
        return sp.csr_array((n, n))
    if isinstance(A, np.ndarray):
        return sp.csr_array(sp.eye_array(n) if A.ndim == 1 else np.ones((n, n)))
    end = A.indptr[-1]
    return sp.csr_array((np.ones(end), A.indices[:end], A.indptr), shape=A.shape)


def symmetric_union(patterns: Iterable[sp.csr_array], n: int) -> sp.csr_array:
    """The symmetric pattern that has these patterns and the diagonal; values 1, read-only."""
    total = sp.csr_array(sp.eye_array(n))
    for pattern in patterns:
        total = total + pattern + pattern.T  # positive values: a sum leaves none out
    total = sp.csr_array(total)
    total.sum_duplicates()  # sorts the columns
    total.data = np.ones(total.nnz)
    shorten_indices(total)
    read_only(total)
    return total


def keys_of(A: Any) -> np.ndarray:
    """n * row + column of each stored entry of a matrix by rows."""
    result: np.ndarray = row_of_entries(A) * A.shape[1] + A.indices[: A.indptr[-1]]
    return result


class Slots:
    """The values of a pattern: which of them an entry of a matrix belongs to.

    pattern: csr_array, of `symmetric_union`: sorted, symmetric, with the diagonal.
    """

    def __init__(self, pattern: sp.csr_array):
        self.n, self.nnz = pattern.shape[0], pattern.nnz
        self.rows, self.columns = row_of_entries(pattern), pattern.indices
        self.keys = keys_of(pattern)
        self.diagonal = np.searchsorted(self.keys, np.arange(self.n) * (self.n + 1))
        self.across, _ = self.of(self.columns.astype(np.int64) * self.n + self.rows)

    def of(self, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The index of the value of each key, and which keys are in the pattern."""
        where = np.minimum(np.searchsorted(self.keys, keys), self.nnz - 1)
        return where, self.keys[where] == keys

    def check_symmetry(self, values: np.ndarray, name: str) -> None:
        """ValueError that names the entry that differs most from the one across the diagonal."""
        across = values[self.across]
        if np.array_equal(values, across):
            return
        skew = np.abs(values - across)
        worst = int(np.argmax(skew))
        if skew[worst] > SYMMETRY * np.max(np.abs(values)):
            i, j = self.rows[worst], self.columns[worst]
            raise ValueError(
                f"{name} must be symmetric to {SYMMETRY:g} of its largest entry, got "
                f"{values[worst]:g} at [{i}, {j}] and {across[worst]:g} at [{j}, {i}]; {ADMITTED}"
            )


class Placement:
    """Adds one tangent of one force, evaluation after evaluation, to the values of a pattern.

    The index arrays of a matrix by rows are compared with those of the evaluation before; where
    they are equal, the places of the entries are known.
    """

    def __init__(self, slots: Slots, name: str):
        self.slots, self.name = slots, name
        self.known: tuple[np.ndarray, np.ndarray] | None = None  # indptr, indices
        self.where: Any = slice(0)  # a slice or an array
        self.repeated = False

    def add(self, A: Tangent, values: np.ndarray) -> None:
        """values += A; ValueError for an entry that is not zero outside the pattern."""
        if A is None:
            return
        if sp.issparse(A):
            self._add_sparse(A, values)
        elif A.ndim == 1:
            values[self.slots.diagonal] += A
        else:
            self._add_dense(A, values)

    def _add_dense(self, A: np.ndarray, values: np.ndarray) -> None:
        if self.slots.nnz == A.size:
            values += A.ravel()
            return
        inside = A[self.slots.rows, self.slots.columns]
        if np.count_nonzero(inside) != np.count_nonzero(A):
            outside = A.ravel().copy()
            outside[self.slots.keys] = 0.0
            self._refuse(np.arange(A.size), outside)
        values += inside

    def _add_sparse(self, A: Any, values: np.ndarray) -> None:
        known = self.known
        if known is None or not (
            np.array_equal(A.indptr, known[0]) and np.array_equal(A.indices, known[1])
        ):
            A = self._learned(A)
        data = A.data[: A.indptr[-1]]
        if self.repeated:
            values += np.bincount(self.where, data, minlength=values.size)
        else:
            values[self.where] += data

    def _learned(self, A: Any) -> Any:
        """Learn the places of the entries of A; the matrix whose entries have these places."""
        keys = keys_of(A)
        where, inside = self.slots.of(keys)
        if not inside.all():  # entries outside are zero, or refused
            self._refuse(keys, np.where(inside, 0.0, A.data[: keys.size]))
            rows = row_of_entries(A)[inside]
            triplets = (A.data[: keys.size][inside], (rows, A.indices[: keys.size][inside]))
            return self._learned(by_rows(sp.coo_array(triplets, shape=A.shape), self.name))
        self.known, self.where = (A.indptr.copy(), A.indices.copy()), where
        self.repeated = bool(np.any(np.bincount(where, minlength=1) > 1))
        if np.array_equal(where, np.arange(self.slots.nnz)):
            self.where = slice(None)  # the whole pattern in its order
        return A

    def _refuse(self, keys: np.ndarray, values: np.ndarray) -> None:
        """ValueError if one of these entries outside the pattern is not zero."""
        wrong = np.flatnonzero(values)
        if wrong.size:
            i, j = divmod(int(keys[wrong[0]]), self.slots.n)
            raise ValueError(
                f"{self.name} must be within the pattern of the first tangents, or of "
                f"InternalForce(pattern=), got {values[wrong[0]]:g} at [{i}, {j}]"
            )
