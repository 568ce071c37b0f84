"""The condition at which a run ends before its time: `Coupler.run` with ``until=``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..results.interpolated import Instant
from .advance import advance_to
from .progress import Report
from .session import Session, require_alone
from .state import multipliers_of, state_of

Until = Callable[[Instant], bool]


def checked_until(session: Session, until: Any) -> Until | None:
    if until is None:
        return None
    if not callable(until):
        raise TypeError(
            "until must be a function of an Instant, the present motion, that returns True or "
            f"False, got {until!r}"
        )
    require_alone(session, "until")
    return until  # type: ignore[no-any-return]


def advance_until(
    session: Session, end: int, recording: Any, report: Report | None, until: Until | None
) -> bool:
    """Advance to macro step `end`, or to the first one at which the condition is met: True."""
    if until is None:
        advance_to(session, end, recording, report)
        return False
    while session.core.step_count < end:
        advance_to(session, session.core.step_count + 1, recording, report)
        if is_met(session, until):
            return True
    return False


def is_met(session: Session, until: Until) -> bool:
    """The value of the condition for the present motion."""
    states = tuple(state_of(session, i) for i in range(len(session.keys)))
    time = session.clock.time(session.core.step_count)
    value = until(Instant(time, multipliers_of(session), states, session.keys))
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(
            f"until must return True or False, got {value!r} at t = {time:g}: a condition such as "
            'now["frame"].u[0] > 0.01, not the number that crosses zero'
        )
    return bool(value)
