"""The exceptions and warnings of pmalpha."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

__all__ = [
    "CallbackError",
    "ConstraintError",
    "ConstraintWarning",
    "FactorizationError",
    "InstabilityError",
    "PerformanceWarning",
    "PmalphaError",
    "StabilityWarning",
]


class PmalphaError(Exception):
    """Base of all errors that are not a plain ``ValueError`` or ``TypeError``."""


class ConstraintError(PmalphaError, ValueError):
    """Interface conditions depend on one another, or the initial velocities break one."""


class FactorizationError(PmalphaError):
    """A matrix that must be positive definite is singular or indefinite.

    Attributes
    ----------
    subdomain : str or None
        Its name; None where several take part.
    dof : int or None
        Where it was first seen, in the numbering of the subdomain.
    inertia : (int, int, int) or None
        Negative, zero and positive pivots, which is eigenvalues; None where they were not counted.
    """

    def __init__(
        self,
        message: str,
        *,
        subdomain: str | None = None,
        dof: int | None = None,
        inertia: tuple[int, int, int] | None = None,
    ):
        super().__init__(message)
        self.subdomain = subdomain
        self.dof = dof
        self.inertia = inertia


class InstabilityError(PmalphaError):
    """A value of the run is not finite; the coupler stands at the last whole macro step.

    Attributes
    ----------
    step : int
        Macro step, counted from 0, in which the value was seen.
    time : float
        The time at which that macro step begins: where the coupler stands now.
    subdomain : str
        Name of the subdomain where it was first seen, or ``"interface"``.
    """

    def __init__(self, step: int, time: float, subdomain: str):
        super().__init__(
            f"subdomain {subdomain!r} is not finite any more in macro step {step}, "
            f"which begins at t = {time:g}: the run is unstable"
        )
        self.step = step
        self.time = time
        self.subdomain = subdomain

    def __reduce__(self) -> tuple:
        return type(self), (self.step, self.time, self.subdomain)


class CallbackError(PmalphaError):
    """A compiled function of the user's did not return 0.

    Attributes
    ----------
    code : int
        What it returned.
    what : str
        Which one: "force" or "restoring force".
    step : int
        Macro step, counted from 0, in which it was asked.
    time : float
        The time at which that macro step begins: where the coupler stands now.
    subdomain : str
    """

    def __init__(self, code: int, what: str, step: int, time: float, subdomain: str):
        super().__init__(
            f"the {what} of subdomain {subdomain!r} returned {code} in macro step {step}, which "
            f"begins at t = {time:g}"
        )
        self.code = code
        self.what = what
        self.step = step
        self.time = time
        self.subdomain = subdomain

    def __reduce__(self) -> tuple:
        return type(self), (self.code, self.what, self.step, self.time, self.subdomain)


class StabilityWarning(UserWarning):
    """A run may grow, or keep an error for ever.

    The step of an explicit or conditionally stable scheme is above its critical step, or under
    macro coupling a part resonates with the macro step or a double step damps nothing.
    """


class ConstraintWarning(UserWarning):
    """Something about the interface is probably not meant.

    Initial displacements leave a gap, the equation of a dof without mass does not hold at t = 0, or
    nodes that are nearly at one place are not tied.
    """


class PerformanceWarning(UserWarning):
    """What was asked for is possible and slow."""


PACKAGE = f"{Path(__file__).parent}{os.sep}"


def warn(message: str, category: type[Warning]) -> None:
    """Warn with the line outside of the package that made the call, however deep it is inside."""
    frame, level = sys._getframe(1), 2
    while frame is not None and frame.f_code.co_filename.startswith(PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level - 1 if frame is None else level)
