"""Springs with a potential as internal forces that conserve the energy, (H6) to (H8)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted
from .dofs import GROUND
from .frozen import Frozen
from .internal import Internal, checked_internal
from .schemes import Scheme
from .springs import CubicSpring, Gap, Spring

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
            if not isinstance(item, CubicSpring | Gap) or item.largest_damping is not None:
                raise TypeError(
                    "springs must be CubicSpring, or Gap without c, which have a potential, "
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
                force[at], slope[at] = _force(spring, d[at])
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


def _force(spring: Any, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
