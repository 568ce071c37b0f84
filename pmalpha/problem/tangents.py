"""Internal forces for the core: values and tangents, checked and summed over one pattern."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from .._checks import called, not_real, plain_array, require_finite
from .matrices import (
    ADMITTED,
    check_arrays,
    dense,
    read_only,
    row_of_entries,
    shorten_indices,
    sparse,
)

# ---- tangents -----------------------------------------------------------------------------------
# Tangents of internal forces: what a user returns, as the values of one sparse pattern.

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


# ---- evaluation ---------------------------------------------------------------------------------

RETURNS = "(f, K_t), (f, K_t, C_t) or (f, K_t, C_t, q1)"

# Differences of two evaluations that are rounding, relative to the largest entry.
SAME = 1e-9
# t, u, v, q
Arguments = tuple[Any, ...]
# f, K_t, C_t, q1 of one force.
Values = tuple[np.ndarray, Tangent, Tangent, np.ndarray]


def evaluated(
    force: Any, what: str, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray
) -> Values:
    """One evaluation with copies of u, v (n,) and q (m,), checked but for values not finite."""
    value = called(what, force, t, u.copy(), v.copy(), q.copy())
    try:
        return _checked(value, u.size, q.size)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{what} at t = {t:g}: {error}") from None


def _checked(value: Any, n: int, m: int) -> Values:
    if not isinstance(value, tuple) or not 2 <= len(value) <= 4:
        got = f"{len(value)} values" if isinstance(value, tuple) else type(value).__name__
        raise TypeError(f"its value must be the tuple {RETURNS}, got {got}")
    f, K, C, q1 = value + (None,) * (4 - len(value))
    if q1 is None and m:
        raise ValueError(f"q1 must be returned where there is a history, of shape ({m},), got none")
    return (
        numbers(f, "f", n),
        checked_tangent(K, "K_t", n),
        checked_tangent(C, "C_t", n),
        numbers(() if q1 is None else q1, "q1", m),
    )


def numbers(value: Any, name: str, size: int) -> np.ndarray:
    """A float64 array of shape (size,), which may have values that are not finite."""
    array = plain_array(value, name)
    if array.dtype.kind not in "iuf":
        raise not_real(array, name)
    if array.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), got {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


class CheckedInternal:
    """The internal forces of a subdomain for the core, in the user's order of dofs.

    damped: whether a first tangent C_t was returned; later ones are refused otherwise.
    labels: what the forces are called in messages. Default: by their number.
    """

    def __init__(
        self,
        forces: Sequence[Any],
        name: str,
        pattern: sp.csr_array,
        damped: bool,
        labels: Sequence[str] = (),
        *,
        symmetric: bool = True,
    ):
        self.forces, self.damped, self.n = tuple(forces), damped, pattern.shape[0]
        self.name, self.symmetric = name, symmetric
        self.what = names(forces, name, labels)
        self.slots = Slots(pattern)
        self.places = [(Placement(self.slots, "K_t"), Placement(self.slots, "C_t")) for _ in forces]
        self.history, self.ranges = histories(forces)
        # of the last evaluation, where a value was not finite: the time, and which one at what u
        self.not_finite: tuple[float, str] | None = None
        # of the forces that are not repeated yet: arguments, f and q1 of the first evaluation
        self.first: dict[int, tuple[Arguments, np.ndarray, np.ndarray] | None]
        self.first = dict.fromkeys(range(len(self.forces)))

    def __call__(
        self, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray, wanted: bool
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None, np.ndarray]:
        """The sum of the forces, of their tangents, and their histories.

        q: (m,) array, history at the beginning of the substep.
        wanted: whether the tangents are. Without them a force that has no history is evaluated by
            its `residual`, if it has one.
        Returns K, C: (nnz,) array or None, values of the pattern; None where they are not wanted. C
            is None where no force is `damped`.
        """
        f, q1 = np.zeros(self.n), np.empty_like(self.history)
        self.not_finite = None
        K = np.zeros(self.slots.nnz) if wanted else None
        C = np.zeros(self.slots.nnz) if wanted and self.damped else None
        for i, (force, what, part, places) in enumerate(
            zip(self.forces, self.what, self.ranges, self.places)
        ):
            if not wanted and force.residual is not None and not force.history.size:
                residual = self._residual(force, what, t, u, v, q[part])
                self._look_at({"residual": residual}, what, u, t)
                f += residual
                continue
            values = evaluated(force, what, t, u, v, q[part])
            self._look_at({"f": values[0], "q1": values[3]}, what, u, t)
            if i in self.first and self.not_finite is None:
                self._repeat(i, (t, u, v, q[part]), values)
            f += values[0]
            q1[part] = values[3]
            if K is not None:
                self._place(values, what, t, places, K, C)
                self._look_at_tangents(K, C, what, t)
        self.check_symmetry(K, C, t)
        return f, K, C, q1

    def _repeat(self, i: int, arguments: Arguments, values: Values) -> None:
        """Evaluate a force once more as at its first evaluation, after one with other arguments;
        ValueError where it returns something else, by what it remembers outside of q."""
        first = self.first[i]
        if first is None:
            copies = tuple(np.copy(x) for x in arguments)
            self.first[i] = (copies, values[0].copy(), values[3].copy())
            return
        before, *results = first
        if all(np.array_equal(x, y) for x, y in zip(before, arguments)):
            return
        t, u, v, q = before
        again = evaluated(self.forces[i], self.what[i], float(t), u, v, q)
        for name, x, y in zip(("f", "q1"), results, (again[0], again[3])):
            wrong = np.abs(y - x) > SAME * np.max(np.abs(x), initial=0.0)
            if wrong.any():
                j = int(np.argmax(wrong))
                raise ValueError(
                    f"{self.what[i]} must be a function of t, u, v and q alone: evaluated again "
                    f"with the arguments of its first evaluation, at t = {float(t):g}, it returned "
                    f"{name}[{j}] = {y[j]:g}, before {x[j]:g}. An iteration evaluates it any "
                    "number of times; what it remembers of earlier steps is the history q, of "
                    "InternalForce(evaluate, history=...), whose q1 it returns"
                )
        del self.first[i]

    def _look_at(
        self, values: Mapping[str, np.ndarray], what: str, u: np.ndarray, t: float
    ) -> None:
        for name, x in values.items():
            wrong = ~np.isfinite(x)
            if wrong.any():
                i, j = int(np.argmax(wrong)), int(np.argmax(np.abs(u)))
                at = f"at t = {t:g}, with u up to u[{j}] = {u[j]:g}"
                self.not_finite = t, f"{what} returned {name}[{i}] = {x[i]:g} {at}"

    def _look_at_tangents(self, K: np.ndarray, C: np.ndarray | None, what: str, t: float) -> None:
        for name, x in (("K_t", K), ("C_t", C)):
            if x is not None and self.not_finite is None and not np.isfinite(x).all():
                value = x[~np.isfinite(x)][0]
                self.not_finite = t, f"{what} returned {name} with {value:g} at t = {t:g}"

    def check_symmetry(self, K: np.ndarray | None, C: np.ndarray | None, t: float) -> None:
        """ValueError for tangents that are not symmetric but have to be."""
        for symbol, values in (("K_t", K), ("C_t", C)):
            if self.symmetric and values is not None:
                label = f"{symbol} of internal of subdomain {self.name!r} at t = {t:g}"
                self.slots.check_symmetry(values, label)

    @property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """The sum of the potentials of the forces that have one; None where none has."""
        conservative = [
            (force, what)
            for force, what in zip(self.forces, self.what)
            if force.potential is not None
        ]
        if not conservative:
            return None
        return lambda u: sum(_energy(force, what, u.copy()) for force, what in conservative)

    def _residual(
        self, force: Any, what: str, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray
    ) -> np.ndarray:
        value = called(what, force.residual, t, u.copy(), v.copy(), q.copy())
        try:
            return numbers(value, "residual", self.n)
        except (TypeError, ValueError) as error:
            raise type(error)(f"{what} at t = {t:g}: {error}") from None

    def _place(
        self,
        values: Values,
        what: str,
        t: float,
        places: tuple[Placement, Placement],
        K: np.ndarray,
        C: np.ndarray | None,
    ) -> None:
        try:
            places[0].add(values[1], K)
            if C is not None:
                places[1].add(values[2], C)
            elif values[2] is not None:
                raise ValueError(
                    "C_t must be returned at t = 0 too where a later evaluation returns one, got "
                    "None at t = 0"
                )
        except (TypeError, ValueError) as error:
            raise type(error)(f"{what} at t = {t:g}: {error}") from None


def _energy(force: Any, what: str, u: np.ndarray) -> float:
    """potential(u) of a force, which may be infinite or NaN."""
    value = plain_array(force.potential(u), "potential")
    if value.shape != () or value.dtype.kind not in "iuf":
        raise TypeError(f"potential of {what} must return a real number, got {value!r}")
    return float(value)


def first_tangent(
    forces: Sequence[Any],
    n: int,
    u0: np.ndarray,
    v0: np.ndarray,
    q0: np.ndarray,
    name: str,
    labels: Sequence[str] = (),
    *,
    symmetric: bool = True,
) -> tuple[sp.csr_array, np.ndarray, np.ndarray | None]:
    """The pattern of all tangents of a subdomain, and their values at t = 0.

    Each force is evaluated once. The pattern is the union of those of the forces (`pattern`, or
    their first tangents) made symmetric, with the diagonal.

    u0, v0: (n,) array, initial values, in the user's order of dofs.
    Returns K, C: (nnz,) array, values of the pattern; C is None where no force returned a C_t.
    """
    ranges = histories(forces)[1]
    what = names(forces, name, labels)
    first = [evaluated(x, w, 0.0, u0, v0, q0[o]) for x, w, o in zip(forces, what, ranges)]
    patterns = [
        entries_of(A, n)
        for force, (_, K, C, _) in zip(forces, first)
        for A in ((K, C) if force.pattern is None else (force.pattern,))
    ]
    damped = any(values[2] is not None for values in first)
    pattern = symmetric_union(patterns, n)
    checked = CheckedInternal(forces, name, pattern, damped, labels, symmetric=symmetric)
    K = np.zeros(pattern.nnz)
    C = np.zeros(pattern.nnz) if damped else None
    for values, w, places in zip(first, what, checked.places):
        checked._place(values, w, 0.0, places, K, C)
        require_finite(values[0], f"f of {w} at t = 0")
    for symbol, entries in (("K_t", K), ("C_t", C)):
        if entries is not None:
            label = f"{symbol} of internal of subdomain {name!r}"
            require_finite(entries, f"the stored entries of {label} at t = 0")
    checked.check_symmetry(K, C, 0.0)
    return pattern, K, C


def names(forces: Sequence[Any], name: str, labels: Sequence[str] = ()) -> list[str]:
    """The name of each force in messages."""
    which = ["internal"] if len(forces) == 1 else [f"internal[{k}]" for k in range(len(forces))]
    return [f"{x} of subdomain {name!r}" for x in labels or which]


def histories(forces: Sequence[Any]) -> tuple[np.ndarray, list[slice]]:
    """The histories at t = 0, one after the other, and the range of each force."""
    ends = np.cumsum([0, *(force.history.size for force in forces)])
    ranges = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])]
    return np.concatenate([np.zeros(0), *(force.history for force in forces)]), ranges


# ---- tangent check ------------------------------------------------------------------------------
# Comparison of the tangents of an internal force with central differences of the force.

__all__ = ["TangentCheck"]


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True)
class TangentCheck:
    """How well the tangents of an `InternalForce` agree with central differences of its force.

    Attributes
    ----------
    error : float
        Largest disagreement over `scale`, less the estimated error of the difference itself; inf
        where a value is not finite. A consistent tangent has less than 1e-6.
    matrix : {"K_t", "C_t"}
        The tangent with the largest error.
    row, column : int
        Where it is: the force on dof `row`, and the dof `column` that was moved.
    given, difference : float
        The entry as returned, zero for a tangent that is None, and by central differences.
    scale : float
        Largest magnitude in that tangent, returned or by differences.
    """

    error: float
    matrix: str
    row: int
    column: int
    given: float
    difference: float
    scale: float

    def __str__(self) -> str:
        return (
            f"K_t and C_t differ from differences of f by up to {self.error:.2g} of the largest "
            f"entry, in {self.matrix} in the column of dof {self.column}: {self.given:g} given at "
            f"[{self.row}, {self.column}], {self.difference:g} by differences"
        )


def check_tangents(
    force: Any, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray, step: float
) -> TangentCheck:
    """The check of `InternalForce.check`; u, v (n,), q (m,)."""

    def f(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return evaluated(force, "evaluate", t, u, v, q)[0]

    _, K, C, _ = evaluated(force, "evaluate", t, u, v, q)
    of_u = _worst("K_t", K, lambda x: f(x, v), u, step)
    of_v = _worst("C_t", C, lambda x: f(u, x), v, step)
    return of_v if of_v.error > of_u.error else of_u


def _worst(
    name: str, A: Tangent, f: Callable[..., Any], x: np.ndarray, step: float
) -> TangentCheck:
    """The entry of A that differs most from differences of f, column by column."""
    h = step * (float(np.max(np.abs(x))) or 1.0)
    worst, scale = (-1.0, 0, 0, 0.0, 0.0), 0.0
    matrix = sparse(A, x.size)
    columns = sp.csc_array(matrix) if sp.issparse(A) else matrix.toarray()
    for j in range(x.size):
        values = dense(columns[:, [j]]).ravel()
        difference, doubt = _difference(f, x, j, h)
        with np.errstate(invalid="ignore"):
            apart = np.abs(difference - values) - doubt
        apart[np.isnan(apart)] = np.inf
        i = int(np.argmax(apart))
        if apart[i] > worst[0]:
            worst = (max(0.0, float(apart[i])), i, j, float(values[i]), float(difference[i]))
        scale = float(max(scale, np.max(np.abs(values)), np.max(np.abs(difference))))
    most, i, j, one, other = worst
    error = np.inf if not np.isfinite(most) else most / scale if scale else 0.0
    return TangentCheck(error, name, i, j, one, other, scale)


def _difference(
    f: Callable[..., Any], x: np.ndarray, j: int, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """df/dx_j by (f(x + h) - f(x - h)) / 2 h, and by how much twice the h changes it.

    The latter bounds the truncation error of laws such as abs(v) v at v = 0, where all entries are
    zero and those of a difference only small.
    """
    slopes = []
    for distance in (h, 2.0 * h):
        up, down = x.copy(), x.copy()
        up[j], down[j] = x[j] + distance, x[j] - distance
        slopes.append((f(up) - f(down)) / (up[j] - down[j]))
    return slopes[0], np.abs(slopes[1] - slopes[0])
