"""The estimate (D1) of the error that each step adds, from recorded u, v and a."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._core import step_errors


def is_complete(history: Any) -> bool:
    """Whether every time level of the subdomain was recorded."""
    t, h = history.t, history.substep
    return h is not None and _farthest(t, h) <= 1e-6 * h


def _farthest(t: np.ndarray, h: float) -> float:
    """The largest difference of a distance of two levels from h; with `every` the first may be
    h, where a run begins just before a recorded level."""
    return float(np.max(np.abs(np.diff(t) - h), initial=0.0))


def previous_level(history: Any, steps: np.ndarray) -> np.ndarray:
    """The level at which the step to level ``steps + 1`` began; -1 where it was not recorded."""
    if history.double_after is None or history.substep is None:
        return steps
    result: np.ndarray = steps - (
        history.t[steps + 1] > history.double_after + 0.5 * history.substep
    )
    return result


def local_error(history: Any) -> np.ndarray:
    """The estimate (D1) for each step and recorded dof, (k - 1, dofs)."""
    if history.substep is None:
        raise ValueError(
            "local_error needs a History of a run with steps of constant length, not of a scheme "
            "of two stages, and no older file"
        )
    if not is_complete(history):
        raise ValueError(
            f"local_error needs all time levels of {history.name!r}, run(every=None): its substep "
            f"is {history.substep:g}, got levels up to {np.max(np.diff(history.t)):g} apart"
        )
    begin = previous_level(history, np.arange(history.t.size - 1))
    known = begin >= 0
    errors = np.full((begin.size, history.dofs.size), np.nan)
    errors[known] = errors_of(history, np.flatnonzero(known)).T
    return errors


def errors_of(history: Any, steps: np.ndarray) -> np.ndarray:
    """e of some of the steps of a subdomain, (D1), (dofs, steps)."""
    begin, end, h = previous_level(history, steps), steps + 1, history.substep or 0.0
    return step_errors((history.u, history.v, history.a), begin, end, h)
