"""Runs whose fine steps begin at times of a clock: `Coupler.run_paced`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .._checks import check_word, flag, positive_number, whole_number
from ..results.history import History
from ..results.pacing import Pacing, due_times
from ..results.recording import Recording, recording_class
from ..results.ring import RingRecording
from .interrupts import HeldSignals
from .monitor import Watched
from .progress import reporting
from .realtime import check_priority, on_time, signals_written
from .recorded_run import recorded, recording_of
from .session import Session, require_alone

# Numbers of the largest period and the largest number of periods, in ns: below 2^63.
LONGEST = 1e18


class Pace(NamedTuple):
    """How a run is paced: arguments of `Coupler.run_paced`."""

    rate: float
    on_late: str
    priority: int | None
    lock_memory: bool


def run_paced(
    session: Session, t_end: float, pace: Pace, record_to: Any, progress: Any, **chosen: Any
) -> History:
    """`Coupler.run_paced`; `chosen` is what is recorded."""
    with session.guard, HeldSignals(session.guard) as held:
        pace = checked_pace(session, pace)
        done = session.done
        last = session.clock.end(t_end, None, done)
        times = Times(session, pace, last - done)
        kind = partial(paced_recording, session.core)
        recording = recording_of(session, done, last, *record_to, kind=kind, **chosen)
        recording.block[:] = 0.0  # no page is touched for the first time in the run
        try:
            with reporting(progress, done, recording.end) as report:
                around = times.kept(session, pace)
                history = recorded(session, recording, report, held, around)
        except BaseException:
            if session.last_history is not None:
                session.last_history = replace(session.last_history, pacing=times.pacing(recording))
            raise
        session.last_history = None
        return replace(history, pacing=times.pacing(recording))


def checked_pace(session: Session, pace: Pace) -> Pace:
    """The arguments, for a coupler that has fine steps."""
    require_alone(session, "run_paced")
    if session.coupling in ("macro", "mean"):
        raise ValueError(
            "run_paced needs coupling 'pm' or 'gc', whose interface problem is solved in every "
            f"fine step: under {session.coupling!r} the substeps of a macro step are a free run "
            "ahead of the interface force, so that commands have no times of their own"
        )
    if session.steps.first is not None and session.done == session.clock.origin:
        raise ValueError(
            "run_paced must begin at least one macro step after change_steps, which takes steps "
            "of other lengths: call step() first"
        )
    check_word(pace.on_late, "on_late", ("continue", "stop"))
    rate = positive_number(pace.rate, "rate")
    priority = pace.priority
    if priority is not None:
        priority = whole_number(priority, "priority")
    check_priority(priority)
    return Pace(rate, pace.on_late, priority, flag(pace.lock_memory, "lock_memory"))


def paced_recording(
    core: Any, record_to: Any, *, append: bool, overwrite: bool
) -> Callable[..., Recording]:
    """What makes the recording: a file is written by a thread of its own."""
    make = recording_class(record_to, append=append, overwrite=overwrite)
    if record_to is None:
        return make
    return partial(RingRecording, core, record_to, append=append, overwrite=overwrite)


class Times:
    """The arrays in which the core writes the times of a run of so many macro steps."""

    def __init__(self, session: Session, pace: Pace, steps: int):
        self.period = 1e9 * session.clock.dt / session.fine / pace.rate
        count = steps * session.fine
        if not 0.0 < self.period <= LONGEST / max(1, count):
            raise ValueError(
                "rate must give a run of at most thirty years, got "
                f"{pace.rate!r} with periods of {1e-9 * self.period:g} s"
            )
        self.state = np.zeros(2, dtype=np.int64)  # ns at which the run began, fine steps done
        self.times = np.full((4, count), np.nan)
        self.watched = Watched(session, self.period, self.times)

    @contextmanager
    def kept(self, session: Session, pace: Pace) -> Iterator[None]:
        """A context in which the core keeps the pace."""
        watched, stops = self.watched, pace.on_late == "stop"
        with (
            watched.written(),
            on_time(pace.priority, pace.lock_memory),
            signals_written() as signals,
        ):
            given = (self.period, stops, signals, self.state, self.times)
            session.core.set_pace((*given, watched.monitored, watched.values))
            try:
                yield
            finally:
                session.core.set_pace(None)

    def pacing(self, recording: Recording) -> Pacing:
        done = int(self.state[1])
        begun, commanded, returned, ended = self.times[:, :done].copy()
        due = due_times(self.period, done)
        lost = recording.lost if isinstance(recording, RingRecording) else 0
        return Pacing(1e-9 * self.period, due, begun, commanded, returned, ended, lost)
