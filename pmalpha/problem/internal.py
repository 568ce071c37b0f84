"""Internal forces: the values that ``internal`` of a subdomain can have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

from .._cached import Frozen
from .._checks import counted, positive_number, real_array, real_number, vector
from .arguments import (
    OF_INTERNAL,
    SparseLike,
    VectorLike,
    check_order,
    check_signature,
    evaluate_compiled,
)
from .dofs import GROUND
from .matrices import read_only, shorten_indices
from .restoring import labelled
from .schemes import Scheme
from .springs import CubicSpring, Gap, Spring
from .tangents import TangentCheck, by_rows, check_tangents

__all__ = ["InternalForce"]

Evaluate: TypeAlias = Callable[[float, np.ndarray, np.ndarray, np.ndarray], Any] | LowLevelCallable


class InternalForce(Frozen):
    """A force :math:`f(t, u, v; q)` with tangents and history, for ``internal=`` of a `Subdomain`.

    It is on the left-hand side, added to K u + C v. An implicit subdomain iterates it by Newton's
    method. A callable without a history and without a pattern needs no InternalForce: it can be
    given as it is.

    Parameters
    ----------
    evaluate : callable or LowLevelCallable
        ``evaluate(t, u, v, q)`` returns the tuple ``(f, K_t)``, ``(f, K_t, C_t)`` or
        ``(f, K_t, C_t, q1)``: the force f (n,); the tangents K_t = df/du and C_t = df/dv, symmetric
        in any format of the matrices of `Subdomain`, or None for zero; and the history q1 (m,) at
        the end of the substep. u, v and q (m,) are copies; q is the history at the beginning of the
        substep. A pure function of its arguments: it is evaluated any number of times, and q1 is
        taken over only when the substep is complete. That is not checked: it would take another
        evaluation in every step.
        If it has a method ``residual(t, u, v, q) -> f``, and the force no history, that is called
        where no tangent is needed. A method ``potential(u) -> float`` is its energy, see `Energy`.
        A method ``largest_tangent() -> K_t`` is the stiffest tangent, of contact that is closed,
        for the critical step of an explicit subdomain.
        A ``scipy.LowLevelCallable`` ``int (double t, intptr_t n, double *u, double *v, double *q,
        double *f, double *K, double *C, double *q1, void *user)`` is evaluated without the GIL. K
        and C are the values of `pattern` by rows, or NULL where no tangent is needed; f, K, C and
        q1 are zero on entry. A return value other than 0 stops the run with a `CallbackError`.
    history : (m,) array, optional
        The history at t = 0, such as plastic strains. Default: none, m = 0.
    pattern : (n, n) sparse matrix or array, optional
        Its stored entries, zeros included, contain those of all K_t and C_t. Required for a
        LowLevelCallable. Default: the entries of the first K_t and C_t; all entries of a dense
        one. The values are not used.

    Attributes
    ----------
    evaluate : callable or LowLevelCallable
    history : (m,) array
    pattern : csr_array or None
        With sorted columns in each row.

    Raises
    ------
    TypeError, ValueError
        For a wrong kind of evaluate, a history that is not finite, a pattern that is not square, a
        LowLevelCallable of another signature, without a pattern, or with one by rows whose columns
        are not sorted. What evaluate returns is checked when it is evaluated.

    Examples
    --------
    A hardening spring on one dof, and a check of its tangent:

    >>> spring = InternalForce(lambda t, u, v, q: (u + u**3, 1.0 + 3.0 * u**2))
    >>> spring.check([0.5]).error < 1e-8
    True

    A friction element with the slip as history:

    >>> def friction(t, u, v, q):
    ...     f = np.clip(100.0 * (u - q), -1.0, 1.0)
    ...     return f, np.where(np.abs(f) < 1.0, 100.0, 0.0), None, u - f / 100.0
    >>> InternalForce(friction, history=[0.0])
    <InternalForce friction: 1 number of history>
    """

    def __init__(
        self,
        evaluate: Evaluate,
        history: VectorLike | None = None,
        pattern: SparseLike | None = None,
    ):
        if not isinstance(evaluate, LowLevelCallable) and not callable(evaluate):
            raise TypeError(f"evaluate must be callable, got {evaluate!r}")
        self.evaluate = evaluate
        self.history = real_array(() if history is None else history, "history")
        self.pattern = None if pattern is None else _checked_pattern(pattern)
        if isinstance(evaluate, LowLevelCallable):
            check_signature(evaluate, "internal")
            _check_order(pattern)
        else:
            check_order(evaluate, OF_INTERNAL, "internal")
            if self.residual is not None:
                check_order(self.residual, OF_INTERNAL, "residual of internal")
        self._freeze()

    def __repr__(self) -> str:
        name = getattr(self.evaluate, "__name__", type(self.evaluate).__name__)
        facts = [counted(self.history.size, "number") + " of history"] if self.history.size else []
        if self.pattern is not None:
            facts.append(f"pattern of {counted(self.pattern.nnz, 'value')}")
        return f"<InternalForce {name}{': ' if facts else ''}{', '.join(facts)}>"

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray) -> Any:
        """What evaluate returns, unchecked; of a LowLevelCallable (f, K_t, C_t, q1)."""
        if not isinstance(self.evaluate, LowLevelCallable):
            return self.evaluate(t, u, v, q)
        A = self.pattern
        assert A is not None
        f, K, C, q1 = evaluate_compiled(self.evaluate, t, u, v, q, A.nnz)
        tangents = [sp.csr_array((x, A.indices, A.indptr), shape=A.shape) for x in (K, C)]
        return f, *tangents, q1

    @property
    def residual(self) -> Callable[..., Any] | None:
        """The method ``residual(t, u, v, q) -> f`` of evaluate, or None."""
        return _method(self.evaluate, "residual")

    @property
    def potential(self) -> Callable[..., Any] | None:
        """The method ``potential(u) -> float`` of evaluate, or None."""
        return _method(self.evaluate, "potential")

    @property
    def largest_tangent(self) -> Callable[[], Any] | None:
        """The method ``largest_tangent() -> K_t`` of evaluate, or None."""
        return _method(self.evaluate, "largest_tangent")

    def check(
        self,
        t: Any = None,
        u: VectorLike | None = None,
        v: VectorLike | None = None,
        q: VectorLike | None = None,
        step: float = 6e-6,
    ) -> TangentCheck:
        """Compare K_t and C_t with central differences of f.

        Wrong tangents do not make results wrong, but iterations slow or divergent. The force is
        evaluated 8 n + 1 times.

        Parameters
        ----------
        t : float, optional
            Time. Left out, as in ``check(u)``, it is 0.
        u : (n,) array, or a number for one dof
            Displacement at which the tangents are compared, away from kinks of f.
        v : (n,) array, optional
            Velocity. Default: zero.
        q : (m,) array, optional
            History at the beginning of the substep. Default: `history`.
        step : float, default 6e-6
            Displacement of a dof on both sides, relative to the largest abs(u) for K_t and to the
            largest abs(v) for C_t, absolute where these are zero. The default, the cubic root of
            the rounding unit, gives about ten digits of a smooth f.

        Returns
        -------
        TangentCheck
            The largest error relative to the largest entry (`error`), and where it is: `matrix`,
            `row`, `column`, the value `given` and the one by `difference`.

        Raises
        ------
        TypeError, ValueError
            For arguments and values of evaluate of the wrong kind or shape.

        Examples
        --------
        >>> wrong = InternalForce(lambda t, u, v, q: (u**3, 2.0 * u**2))
        >>> print(wrong.check([0.5]))
        K_t and C_t differ from differences of f by up to 0.33 of the largest entry, in K_t in the \
column of dof 0: 0.5 given at [0, 0], 0.75 by differences
        """
        if u is None:  # the time was left out
            t, u = None, t
        displacement = real_array(u, "u", (0, 1)).reshape(-1)
        n = displacement.size
        if n == 0 or (self.pattern is not None and self.pattern.shape != (n, n)):
            size = "n > 0" if self.pattern is None else str(self.pattern.shape[0])
            raise ValueError(f"u must have shape ({size},), got ({n},)")
        velocity = vector(np.zeros(n) if v is None else [v] if np.ndim(v) == 0 else v, n, "v")
        past = self.history if q is None else vector(q, self.history.size, "q")
        return check_tangents(
            self,
            0.0 if t is None else real_number(t, "t"),
            displacement,
            velocity,
            past,
            positive_number(step, "step"),
        )


def _method(owner: Any, name: str) -> Callable[..., Any] | None:
    method = getattr(owner, name, None)
    return method if callable(method) else None


def _checked_pattern(value: Any) -> sp.csr_array:
    """A user's pattern by rows, with sorted columns and values 1, read-only."""
    if not sp.issparse(value):
        raise TypeError(f"pattern must be a scipy.sparse matrix or array, got {value!r}")
    if value.ndim != 2 or value.shape[0] != value.shape[1] or value.shape[0] == 0:
        raise ValueError(f"pattern must be square and not empty, got shape {value.shape}")
    if value.dtype.kind not in "biuf":
        raise TypeError(f"pattern must hold real numbers, got dtype {value.dtype}")
    A = by_rows(value, "pattern")
    pattern = sp.csr_array((np.ones(A.nnz), A.indices, A.indptr), shape=A.shape)
    shorten_indices(pattern)
    read_only(pattern)
    return pattern


def _check_order(pattern: Any) -> None:
    """The order of K and C of a compiled function is that of its pattern by rows."""
    if pattern is None:
        raise ValueError(
            "pattern must be a sparse matrix for a LowLevelCallable, whose K and C are its values "
            "by rows, got None"
        )
    if pattern.format == "csr" and not pattern.has_canonical_format:
        raise ValueError(
            "pattern must have sorted columns without duplicates in each row for a "
            "LowLevelCallable, whose K and C are its values; see sum_duplicates of the matrix"
        )


# ---- for a subdomain ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Internal:
    """The internal forces of a subdomain: springs for the core, and forces with tangents.

    `labels` are the names of the forces in messages, their places in the list they came in.
    """

    springs: tuple[Spring, ...]
    forces: tuple[InternalForce, ...]
    labels: tuple[str, ...] = ()


def checked_internal(internal: Any, n: int, names: Sequence[str] | None = None) -> Internal | None:
    """A user's internal forces, checked as far as possible without evaluating them.

    None where there are none: an empty list is the sum of no forces.
    """
    if isinstance(internal, Internal):  # of another subdomain
        internal = [*internal.springs, *internal.forces]
    items = labelled(internal, "internal")
    springs, forces, labels = [], [], []
    for item, label in items:
        if hasattr(item, "_placed"):  # springs, or forces made of some
            item = item._placed(n, names, label)
        if isinstance(item, Spring):
            springs.append(item)
        else:
            forces.append(_force(item, label, n))
            labels.append(label)
    return Internal(tuple(springs), tuple(forces), tuple(labels)) if items else None


def _force(value: Any, label: str, n: int) -> InternalForce:
    """An internal force that is not a spring, as InternalForce."""
    if isinstance(value, LowLevelCallable):
        raise TypeError(
            f"{label} must be InternalForce(function, pattern=...) for a LowLevelCallable, got the "
            "function alone"
        )
    if not callable(value):
        rule = "callable, an InternalForce, springs, or a list of them"
        raise TypeError(f"{label} must be {rule}, got {value!r}")
    force = value
    if not isinstance(value, InternalForce):
        both = hasattr(value, "history") and hasattr(value, "pattern")
        force = InternalForce(value, *((value.history, value.pattern) if both else ()))
    if force.pattern is not None and force.pattern.shape != (n, n):
        raise ValueError(
            f"{label} must have a pattern of shape ({n}, {n}), got {force.pattern.shape}"
        )
    result: InternalForce = force
    return result


# ---- discrete gradient --------------------------------------------------------------------------
# Springs with a potential as internal forces that conserve the energy, (H6) to (H8).

__all__ = ["DiscreteGradient"]


class DiscreteGradient(Frozen):
    """Springs whose force does exactly the work of their energy, for ``internal=`` of a subdomain.

    With the trapezoidal rule the force of a step is the mean of its ends, and its work is the
    change of a quadratic energy only. Here the mean is replaced by the difference of the potentials
    divided by that of the deformations, so that the energy of springs of any stiffness is conserved
    exactly, up to the tolerance of Newton's method: the discrete gradient of equations (H6) to (H8)
    of docs/method.md.

    Parameters
    ----------
    springs : CubicSpring, Gap, or a list of them
        Springs with a potential.

    Attributes
    ----------
    springs : tuple of springs
    history : (1 + 2 m,) array
        At t = 0, for m springs: zero. Later 1, the deformations of the springs and their forces.
    pattern : None
        The tangent of the first evaluation has all entries.

    Raises
    ------
    TypeError
        For other springs: those of `Bilinear` and `BoucWen` dissipate.
    ValueError
        For no springs; at `Subdomain` for a scheme that is not the trapezoidal rule (``Newmark()``,
        ``GeneralizedAlpha(1)``) and for dofs that it has not.

    Examples
    --------
    A mass between stops:

    >>> stops = DiscreteGradient(Gap([(0, -1), (-1, 0)], k=1e3, gap=0.1))
    >>> ball = Subdomain([1.0], None, scheme=Newmark(), v0=[1.0], internal=stops)
    >>> coupler = Coupler([ball], dt=0.001, newton=Newton(tol=1e-12))
    >>> energy = coupler.run(0.5, energy=True).energy
    >>> total = (energy.kinetic + energy.strain).sum(axis=1)
    >>> bool(np.ptp(total) < 1e-12)
    True
    """

    def __init__(self, springs: Spring | Sequence[Spring]):
        items = list(springs) if isinstance(springs, Iterable) else [springs]
        for item in items:
            if isinstance(item, Spring):
                item._require_still("springs")
            if not isinstance(item, CubicSpring | Gap) or item.largest_damping is not None:
                raise TypeError(
                    "springs must be CubicSpring or Gap without c, which have a potential, "
                    f"got {item!r}"
                )
        if not items:
            raise ValueError("springs must have at least one, got none")
        self.springs = tuple(items)
        self.history = np.zeros(1 + 2 * sum(len(item) for item in items))
        self.history.flags.writeable = False
        self.pattern = None
        if all(item.dofs.dtype != object for item in items):
            self._prepare(items)
        self._freeze()

    def _prepare(self, items: Sequence[Spring]) -> None:
        # where forces and tangents are added: at both ends of each spring that are not the ground
        first, second = np.concatenate([item.dofs for item in items]).T
        self._dofs = np.concatenate([first, second])
        self._tied = self._dofs != GROUND
        rows = np.concatenate([first, second, first, second])
        columns = np.concatenate([first, second, second, first])
        self._used = (rows != GROUND) & (columns != GROUND)
        pairs = np.column_stack([rows, columns])[self._used]
        places, self._slots = np.unique(pairs, axis=0, return_inverse=True)
        self._slots = self._slots.reshape(-1)
        self._rows, self._columns = places.T.copy()

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> DiscreteGradient:
        """The same with numbers of dofs of a subdomain; `label` is that of the argument."""
        return DiscreteGradient([item._placed(n, names, label) for item in self.springs])

    def __repr__(self) -> str:
        return f"<DiscreteGradient of {counted((self.history.size - 1) // 2, 'spring')}>"

    def __call__(
        self, t: float, u: np.ndarray, v: np.ndarray, q: np.ndarray
    ) -> tuple[np.ndarray, sp.csr_array, None, np.ndarray]:
        """(f, K_t, None, q1): from q, or the forces at u where nothing was evaluated before."""
        d0, f0 = np.split(q[1:], 2)
        d, force, slope = np.empty((3, d0.size))
        last = np.cumsum([len(spring) for spring in self.springs])
        for spring, end in zip(self.springs, last):
            at = slice(end - len(spring), end)
            d[at] = _deformation(spring, u)
            if q[0] == 0.0:
                force[at], slope[at] = _spring_force(spring, d[at])
            else:
                mean, slope_of_mean = _mean_force(spring, d0[at], d[at])
                force[at], slope[at] = 2.0 * mean - f0[at], 2.0 * slope_of_mean
        q1 = np.concatenate([[1.0], d, force])
        ends = np.concatenate([force, -force])[self._tied]
        f = np.bincount(self._dofs[self._tied], ends, minlength=u.size)
        return f, self._tangent(slope, u.size), None, q1

    def potential(self, u: np.ndarray) -> float:
        """The energy of the springs, equation (H5).

        Parameters
        ----------
        u : (n,) array
            Displacements.

        Returns
        -------
        float
            The sum of the energies of the springs.

        Examples
        --------
        >>> DiscreteGradient(CubicSpring(0, k=2.0, k3=4.0)).potential(np.array([1.0]))
        2.0
        """
        return float(sum(_energy(spring, _deformation(spring, u)) for spring in self.springs))

    def _tangent(self, slope: np.ndarray, n: int) -> sp.csr_array:
        values = np.concatenate([slope, slope, -slope, -slope])[self._used]
        data = np.bincount(self._slots, values, minlength=self._columns.size)
        starts = np.searchsorted(self._rows, np.arange(n + 1))
        return sp.csr_array((data, self._columns, starts), shape=(n, n))


def internal_for(
    internal: Any, scheme: Scheme, n: int, names: Sequence[str] | None = None
) -> Internal | None:
    """A user's internal forces, checked, discrete gradients for the trapezoidal rule alone."""
    result = checked_internal(internal, n, names)
    for force in [] if result is None else [force.evaluate for force in result.forces]:
        if not isinstance(force, DiscreteGradient):
            continue
        if not scheme.is_trapezoidal:
            raise ValueError(
                "scheme must be the trapezoidal rule, Newmark() or GeneralizedAlpha(1), where "
                f"internal has a DiscreteGradient, got {scheme!r}"
            )
    return result


def _deformation(spring: Spring, u: np.ndarray) -> np.ndarray:
    extended = np.append(u, 0.0)  # the ground is dof -1
    first, second = spring.dofs.T
    result: np.ndarray = extended[first] - extended[second]
    return result


def _energy(spring: Any, d: np.ndarray) -> float:
    """(H5)"""
    if isinstance(spring, Gap):
        return float(np.sum(0.5 * spring.k * np.maximum(d - spring.gap, 0.0) ** 2))
    return float(np.sum(0.5 * spring.k * d**2 + 0.25 * spring.k3 * d**4))


def _spring_force(spring: Any, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(H1), (H2) and their slopes."""
    if isinstance(spring, Gap):
        closed = d > spring.gap
        return np.where(closed, spring.k * (d - spring.gap), 0.0), np.where(closed, spring.k, 0.0)
    return spring.k * d + spring.k3 * d**3, spring.k + 3.0 * spring.k3 * d**2


def _mean_force(spring: Any, d0: np.ndarray, d1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(H7), (H8) and their derivatives by d1."""
    if isinstance(spring, Gap):
        p0, p1 = (np.maximum(d - spring.gap, 0.0) for d in (d0, d1))
        both = (p0 > 0.0) & (p1 > 0.0)
        apart = np.where((p0 > 0.0) == (p1 > 0.0), 1.0, d1 - d0)
        ratio = np.where(both, 1.0, (p1 - p0) / apart)  # of the step, in contact
        slope = np.where(p1 > 0.0, np.where(both, 0.5, ratio * (1.0 - 0.5 * ratio)), 0.5 * ratio**2)
        return 0.5 * spring.k * (p0 + p1) * ratio, spring.k * slope
    total, squares = d0 + d1, d0**2 + d1**2
    mean = 0.5 * spring.k * total + 0.25 * spring.k3 * squares * total
    return mean, 0.5 * spring.k + 0.25 * spring.k3 * (squares + 2.0 * d1 * total)
