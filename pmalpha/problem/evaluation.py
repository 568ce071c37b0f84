"""Internal forces for the core: values and tangents, checked and summed over one pattern."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import called, not_real, plain_array, require_finite
from .tangents import Placement, Slots, Tangent, checked_tangent, entries_of, symmetric_union

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
