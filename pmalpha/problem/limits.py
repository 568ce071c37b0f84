"""Limits of what a test specimen may be commanded and may return."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from .._checks import plain_array, positive_number
from ..errors import LimitError
from .frozen import Frozen

__all__ = ["Limits"]


@dataclass(frozen=True)
class Limits(Frozen):
    """Limits of a specimen, for ``limits=`` of a `Subdomain` with a restoring force.

    A command is the displacement at which the restoring force is evaluated, once in a substep of
    length h, and what a `Compensated` specimen makes of it; behind a `Linkage`, what it makes of
    it as displacements of the dofs. Both are checked before it is given, and the force when it has
    come; the first one beyond its limit ends the run with a `LimitError`.
    The initial values are the first command, and the force that is evaluated there counts too.
    So the specimen stays at the last command, which was within the limits, and the coupler at its
    last whole macro step.

    Parameters
    ----------
    displacement : float or (n,) array, optional
        Largest absolute command of each dof. All limits are positive; ``inf`` for a dof without.
    velocity : float or (n,) array, optional
        Largest rate of the command, (d_k - d_{k-1}) / h, and of the velocity that the force is
        evaluated at.
    acceleration : float or (n,) array, optional
        Largest acceleration of the command, :math:`(d_k - 2 d_{k-1} + d_{k-2}) / h^2`.
    force : float or (n,) array, optional
        Largest absolute measured force.
    energy : float, optional
        Largest energy that the specimen may have returned beyond what it was given since the run
        began from given values (or the state was loaded), sum of (r_{k-1} + r_k) . (d_k - d_{k-1})
        / 2. A passive specimen returns at most what was stored in it then. A control loop that
        lags returns more and more before the motion grows visibly: an actuator with the delay tau
        before a spring k gives back pi k a^2 sin(omega tau) in each cycle of amplitude a.

    Raises
    ------
    TypeError, ValueError
        For values that are not positive numbers, or no limit at all.

    Examples
    --------
    >>> from pmalpha.rig import Limits
    >>> Limits(displacement=0.02, force=[5e3, 2e3])
    Limits(displacement=0.02, force=[5000.0, 2000.0])
    """

    _is_frozen: ClassVar[bool] = True  # the fields by the dataclass, others by Frozen

    displacement: Any = None
    velocity: Any = None
    acceleration: Any = None
    force: Any = None
    energy: float | None = None

    def __post_init__(self) -> None:
        for name in PER_DOF:
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _checked(value, name))
        if self.energy is not None:
            object.__setattr__(self, "energy", positive_number(self.energy, "energy"))
        if not self._given():
            raise TypeError(f"Limits needs one of {', '.join(x.name for x in fields(self))}")

    def _given(self) -> dict[str, Any]:
        values = {x.name: getattr(self, x.name) for x in fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def __repr__(self) -> str:
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in self._given().items()
        }
        return f"Limits({', '.join(f'{name}={value}' for name, value in values.items())})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Limits) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))


PER_DOF = ("displacement", "velocity", "acceleration", "force")


def _checked(value: Any, name: str) -> float | np.ndarray:
    if np.ndim(value) == 0:
        return positive_number(value, name)
    array = plain_array(value, name)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be a number or a 1-D array of numbers, got {value!r}")
    array = np.array(array, dtype=float)
    if not np.all(array > 0.0):
        raise ValueError(f"{name} must be positive, got {array[~(array > 0.0)][0]:g}")
    array.setflags(write=False)
    return array


def limits_of_dofs(limits: Limits, n: int) -> list[np.ndarray | None]:
    """The first four limits of each dof; None where there is none. ValueError for another n."""
    result: list[np.ndarray | None] = []
    for name in PER_DOF:
        value = getattr(limits, name)
        if isinstance(value, np.ndarray) and value.size != n:
            raise ValueError(
                f"limits: {name} must be a number or have the shape ({n},), got ({value.size},)"
            )
        result.append(None if value is None else np.full(n, value))
    return result


def check_first_command(limits: Limits, subdomain: str, u: np.ndarray, v: np.ndarray) -> None:
    """LimitError for initial values beyond the limits, which are the first command."""
    for name, x, limit in zip(PER_DOF, (u, v), limits_of_dofs(limits, u.size)):
        if limit is not None and (beyond := np.flatnonzero(~(np.abs(x) <= limit))).size:
            dof = int(beyond[0])
            raise LimitError(subdomain, name, dof, float(x[dof]), float(limit[dof]), 0.0)
