"""The exceptions and warnings of pmalpha."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from inspect import signature
from pathlib import Path
from threading import local
from types import FrameType
from typing import Any, TypeAlias

__all__ = [
    "AccuracyWarning",
    "BucklingError",
    "CallbackError",
    "CasesError",
    "ConstraintError",
    "ConstraintWarning",
    "ConvergenceError",
    "FactorizationError",
    "InstabilityError",
    "LimitError",
    "PacingError",
    "PerformanceWarning",
    "PmalphaError",
    "StabilityWarning",
]


def __dir__() -> list[str]:
    return sorted(__all__)


class PmalphaError(Exception):
    """Base class of the errors of pmalpha, other than plain ``ValueError`` and ``TypeError``."""


class _Made(PmalphaError):
    """An error that is pickled as its attributes, which have the names of its arguments."""

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), tuple(getattr(self, name) for name in signature(type(self)).parameters)


class ConstraintError(PmalphaError, ValueError):
    """Constraints are linearly dependent, or the initial velocities violate one."""


class FactorizationError(PmalphaError):
    """A matrix that must be positive definite is singular or indefinite.

    Attributes
    ----------
    subdomain : str or None
        Its name; None where the matrix is of several subdomains.
    dof : int or None
        Dof of the first pivot that is not positive, in the numbering of the subdomain.
    inertia : (int, int, int) or None
        Numbers of negative, zero and positive eigenvalues; None where they were not counted.
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
        self.subdomain, self.dof, self.inertia = subdomain, dof, inertia


class BucklingError(PmalphaError, ValueError):
    """The stiffness of a structure in its present state is negative for some motion.

    Attributes
    ----------
    growth : float
        The rate at which the motion grows from this state without damping, sqrt(-omega^2).
    mode : dict of (n_i,) arrays by name
        The motion that grows fastest, mass-normalised.
    """

    def __init__(self, message: str, growth: float, mode: Mapping[str, Any]):
        super().__init__(message)
        self.growth, self.mode = growth, mode

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), (str(self), self.growth, self.mode)


class InstabilityError(_Made):
    """A value of the run is not finite, or the motion is beyond 1e100 of its beginning.

    The coupler has the state of the last whole macro step.

    Attributes
    ----------
    step : int
        Macro step, counted from 0, in which the value occurred.
    time : float
        The time at which that macro step begins, which is the present time of the coupler.
    subdomain : str
        Name of the subdomain with the value, or ``"interface"``.
    cause : str
        Why the motion grew, where it is known, or empty.
    """

    def __init__(self, step: int, time: float, subdomain: str, cause: str = ""):
        what = "exceeds all bounds" if cause else "is not finite any more"
        super().__init__(
            f"subdomain {subdomain!r} {what} in macro step {step}, "
            f"which begins at t = {time:g}: {cause or 'the run is unstable'}"
        )
        self.step, self.time = step, time
        self.subdomain, self.cause = subdomain, cause


class ConvergenceError(_Made):
    """The iteration of internal forces did not converge.

    Or a value in it is not finite, or a tangent is singular but for rounding; one that is
    indefinite, as in buckling, is no error.
    The coupler has the state of the last whole macro step. `InternalForce.check` compares a tangent
    with differences of its force.

    Attributes
    ----------
    subdomain : str
        Name of the subdomain, or ``"interface"`` for the multipliers of several.
    time : float
        The time level that was not reached.
    iterations : int
        Number of iterations that were done for it.
    cause : str
        Why the iteration ended, where it is known, or empty.
    """

    def __init__(self, subdomain: str, time: float, iterations: int, cause: str = ""):
        why = f": {cause}" if cause else ""
        if subdomain == "interface":
            passes = f"{iterations} pass{'' if iterations == 1 else 'es'}"
            text = (
                f"the multipliers at the end of the macro step to t = {time:g} did not converge in "
                f"{passes}{why}; take a smaller macro step, or coupling 'pm' or 'gc'"
            )
        elif cause:
            text = (
                f"Newton's method for subdomain {subdomain!r} ended in iteration "
                f"{iterations + 1} at t = {time:g}{why}"
            )
        else:
            done = f"{iterations} iteration{'' if iterations == 1 else 's'}"
            text = (
                f"Newton's method for subdomain {subdomain!r} did not converge in {done} at "
                f"t = {time:g}; InternalForce.check compares the tangents with differences of f, "
                "and smaller steps converge faster"
            )
        super().__init__(text)
        self.subdomain, self.time = subdomain, time
        self.iterations, self.cause = iterations, cause


class LimitError(_Made):
    """A specimen would have been commanded beyond its limits, or has returned too large a force.

    The last command that was given is within the limits; the coupler has the state of the last
    whole macro step.

    Attributes
    ----------
    subdomain : str
        Name of the subdomain with the specimen.
    quantity : str
        "displacement", "velocity", "acceleration", "force" or "energy".
    dof : int or None
        Of the subdomain; None for the energy, which is that of all.
    value, limit : float
        What was found, with its sign, and its largest absolute value.
    time : float
        The time level of the command.
    by_clock : bool
        Whether `value` is a rate by the clock of `Coupler.run_paced`, not by the time of the
        problem.
    """

    def __init__(
        self,
        subdomain: str,
        quantity: str,
        dof: int | None,
        value: float,
        limit: float,
        time: float,
        by_clock: bool = False,
    ):
        if quantity == "energy":
            what = "has returned more energy than it was given, by"
        elif quantity == "force":
            what = f"returns the force at dof {dof}"
        else:
            clock = ", by the clock," if by_clock else ""
            what = f"would be commanded the {quantity} at dof {dof}{clock}"
        end = (
            "the control loop is going unstable" if quantity == "energy" else "the command is held"
        )
        super().__init__(
            f"the specimen of subdomain {subdomain!r} {what} {value:g} at t = {time:g}, beyond its "
            f"limit {limit:g}: {end}"
        )
        self.subdomain, self.quantity, self.dof = subdomain, quantity, dof
        self.value, self.limit, self.time, self.by_clock = value, limit, time, by_clock


class PacingError(_Made):
    """A fine step of `Coupler.run_paced` ended after the next one was due.

    The specimen remains at the command of the late step. The coupler has the state of the last
    whole macro step; ``coupler.last_history.pacing`` has the times of all fine steps up to the late
    one.

    Attributes
    ----------
    step : int
        Macro step, counted from 0, with the late fine step.
    time : float
        The time at which that macro step begins, which is the present time of the coupler.
    """

    def __init__(self, step: int, time: float):
        super().__init__(
            f"a fine step of macro step {step}, which begins at t = {time:g}, ended after the next "
            "one was due; coupler.last_history.pacing has the times"
        )
        self.step, self.time = step, time


class CallbackError(_Made):
    """A compiled function of the user did not return 0.

    Attributes
    ----------
    code : int
        Its return value.
    what : str
        Kind of the function: "force", "restoring force" or "internal force".
    step : int
        Macro step, counted from 0, in which it was called.
    time : float
        The time at which that macro step begins, which is the present time of the coupler.
    subdomain : str
        Name of the subdomain that has the function.
    """

    def __init__(self, code: int, what: str, step: int, time: float, subdomain: str):
        super().__init__(
            f"the {what} of subdomain {subdomain!r} returned {code} in macro step {step}, which "
            f"begins at t = {time:g}"
        )
        self.code, self.what, self.step = code, what, step
        self.time, self.subdomain = time, subdomain


class CasesError(_Made):
    """Some of the cases of `Coupler.run_each` failed; the others were completed.

    Attributes
    ----------
    failures : dict
        The exception of each case that failed, by its index.
    histories : list of History
        One for each case: of those that failed, the History up to the last whole macro step, or
        None where the initial values could not be computed. With ``reduce`` a None for each.
    values : CaseValues or None
        With ``reduce`` those of the cases that were completed; NaN for the others.
    """

    def __init__(self, failures: dict[int, Exception], histories: list[Any], values: Any = None):
        first = min(failures)
        error = failures[first]
        super().__init__(
            f"{len(failures)} of {len(histories)} cases failed, first cases[{first}]: "
            f"{type(error).__name__}: {error}"
        )
        self.failures, self.histories, self.values = failures, histories, values


class StabilityWarning(UserWarning):
    """A run may grow, or may not damp an error.

    The step of an explicit or conditionally stable scheme is above its critical step, and nothing
    shows that ties or damping make it stable (see `analysis.critical_step`). Or under macro
    coupling a subdomain resonates with the macro step or a double step has no damping. Or a mass is
    so small that its accelerations take all digits of the displacements. Or evaluated forces have
    added more than a tenth of its energy to a motion, equation (B10).
    """


class ConstraintWarning(UserWarning):
    """The description of the interface probably has an error.

    Initial displacements violate a constraint, the equation of a dof without mass does not hold at
    t = 0, nearly coincident nodes are not tied, no constraint reaches a subdomain, or a floating
    subdomain is not held by its constraints. Or a mass matrix is indefinite within the digits of
    exported files.
    """


class AccuracyWarning(UserWarning):
    """The steps of a run do not see all of its load, or move another mass.

    The reasons: steps skip samples of a record that change the motion; substeps that were chosen by
    a tolerance reached their largest number; an estimate of the stiffness of restoring functions
    above it has acted as more than a tenth of the mass, equation (B13); a `SupportMotion` of
    displacements begins with a slope, while the structure is at rest; tied displacements have
    parted in the first steps of a run. No run estimates its own error: `Coupler.estimate_error`
    does.
    """


class PerformanceWarning(UserWarning):
    """A set-up or a run is possible but slow."""


PACKAGE = f"{Path(__file__).parent}{os.sep}"


# Messages of the warnings of a run, for its History.
_NOTED: ContextVar[list[str] | None] = ContextVar("_NOTED", default=None)


@contextmanager
def noted() -> Iterator[list[str]]:
    """A list to which the messages of all warnings of this package are added meanwhile."""
    messages: list[str] = []
    token = _NOTED.set(messages)
    try:
        yield messages
    finally:
        _NOTED.reset(token)


# Whether warnings of this package are not shown.
_SILENT: ContextVar[bool] = ContextVar("_SILENT", default=False)


@contextmanager
def silent() -> Iterator[None]:
    """No warnings of this package are shown meanwhile: those of runs within a call of the user."""
    token = _SILENT.set(True)
    try:
        yield
    finally:
        _SILENT.reset(token)


# A line of the user: file, number, name of the module.
Line: TypeAlias = tuple[str, int, str]
_registry: dict[Any, Any] = {}  # of warnings for lines of other threads


class _Worker(local):
    """For what line a worker works, and the frame in which its work for it begins."""

    line: Line | None = None
    begin: FrameType | None = None


_worker = _Worker()


def users_line() -> Line:
    """The line outside of the package that made the call."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith(PACKAGE):
        if frame is _worker.begin and _worker.line is not None:
            return _worker.line
        frame = frame.f_back
    if frame is None:
        return "pmalpha", 1, "pmalpha"
    return frame.f_code.co_filename, frame.f_lineno, frame.f_globals.get("__name__", "?")


def for_line(line: Line, function: Callable[..., Any], *arguments: Any) -> Any:
    """function(*arguments), perhaps in another thread or process; warnings point at the line."""
    before = _worker.line, _worker.begin
    _worker.line, _worker.begin = line, sys._getframe()
    try:
        return function(*arguments)
    finally:
        _worker.line, _worker.begin = before


def warn(message: str, category: type[Warning]) -> None:
    """Warn with the line outside of the package that made the call."""
    messages = _NOTED.get()
    if messages is not None:
        messages.append(f"{category.__name__}: {message}")
    if _SILENT.get():
        return
    frame: FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_code.co_filename.startswith(PACKAGE):
        if frame is _worker.begin and _worker.line is not None:
            file, number, module = _worker.line
            warnings.warn_explicit(message, category, file, number, module, _registry)
            return
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level - 1 if frame is None else level)
