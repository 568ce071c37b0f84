"""Runs whose fine steps begin at times of a clock: `Coupler.run_paced`, `Coupler.monitor`."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

import pmalpha._core as _core

from .._checks import check_word, flag, positive_number, whole_number
from ..errors import warn
from ..files import checked_path
from ..problem import forms
from ..problem.dofs import dof_list
from ..results.history import History
from ..results.pacing import Pacing, due_times
from ..results.quantities import by_index
from ..results.recording import Recording, Wanted, recording_class
from ..results.ring import MonitorFile, RingRecording
from .progress import DeferredSignals, reporting
from .recorded_run import recorded, recording_of
from .session import Session, require_alone, require_possible

# of sys/mman.h and linux/prctl.h
MCL_CURRENT, MCL_FUTURE = 1, 2
PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 29, 30
# Seconds between two writes.
INTERVAL = 0.05
# Fine steps in one write.
MOST_ROWS = 100_000
# Dofs of each subdomain, unless they are chosen.
MOST = 8
# Numbers of the largest period and the largest number of periods, in ns: below 2^63.
LONGEST = 1e18


def check_priority(priority: int | None) -> None:
    """ValueError for a priority that SCHED_FIFO does not have."""
    if priority is None or not hasattr(os, "sched_setscheduler"):
        return
    low, high = (f(os.SCHED_FIFO) for f in (os.sched_get_priority_min, os.sched_get_priority_max))
    if not low <= priority <= high:
        raise ValueError(f"priority must be in {low}..{high} or None, got {priority!r}")


@contextmanager
def _scheduled(priority: int | None) -> Iterator[None]:
    if priority is None:
        yield
        return
    if not hasattr(os, "sched_setscheduler"):
        raise OSError(f"priority must be None on {sys.platform}, which has no sched_setscheduler")
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:  # 0 is this thread, not the process
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        raise _refused(
            error,
            f"priority={priority} needs the right to SCHED_FIFO, which this process has not "
            "(root, CAP_SYS_NICE, or a limit 'rtprio' of at least that)",
        ) from None
    try:
        yield
    finally:
        policy, parameter = before
        with suppress(OSError):  # without the right to clear the flag the policy remains normal
            os.sched_setscheduler(0, policy & ~os.SCHED_RESET_ON_FORK, parameter)


@contextmanager
def _locked(lock_memory: bool) -> Iterator[None]:
    if not lock_memory:
        yield
        return
    library = None if sys.platform == "win32" else ctypes.CDLL(None, use_errno=True)
    if library is None or not hasattr(library, "mlockall"):
        raise OSError(f"lock_memory must be False on {sys.platform}, which has no mlockall")
    if library.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
        number = ctypes.get_errno()
        library.munlockall()
        raise _refused(
            OSError(number, os.strerror(number)),
            "lock_memory=True needs the right to lock all memory of this process "
            "(root, CAP_IPC_LOCK, or a limit 'memlock' above its size)",
        )
    try:
        yield
    finally:
        library.munlockall()


def _refused(error: OSError, rule: str) -> OSError:
    """The same class, as PermissionError, with what would be needed."""
    return type(error)(error.errno, f"{rule}: {error.strerror}")


@contextmanager
def _without_slack() -> Iterator[None]:
    """Linux lets a sleep end up to 50 us late to join others, unless a thread has another slack."""
    if sys.platform != "linux":
        yield
        return
    prctl = ctypes.CDLL(None).prctl
    before = prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)
    prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)
    try:
        yield
    finally:
        if before > 0:
            prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(before), 0, 0, 0)


@contextmanager
def signals_written() -> Iterator[tuple[int, int]]:
    """Two ends of a pipe to which signals are written, so that they are seen without the GIL, if
    this thread runs handlers of signals."""
    read, write = os.pipe()
    try:
        if sys.platform != "win32":  # where the core looks whether anything has arrived
            os.set_blocking(read, False)
            os.set_blocking(write, False)
        if threading.current_thread() is not threading.main_thread():
            yield read, write
            return
        before = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        try:
            yield read, write
        finally:
            signal.set_wakeup_fd(before)
    finally:
        os.close(read)
        os.close(write)


@dataclass(frozen=True)
class Monitor:
    """What later paced runs write: where, how many fine steps, and of which dofs."""

    path: Any
    rows: int
    dofs: Mapping[int, np.ndarray]


def monitor(
    session: Session, path: str | PathLike[str] | None, dofs: Mapping[Any, Any] | None, rows: int
) -> None:
    with session.guard:
        if path is None:
            session.monitor = None
            return
        with_functions = {i: s for i, (_, s) in enumerate(session.keys) if s.has_functions}
        if dofs is None:
            chosen = {i: np.arange(min(s.n, MOST)) for i, s in with_functions.items()}
        else:
            chosen = {}
            for i, value in by_index(dofs, session.keys, "dofs").items():
                name, s = session.keys[i]
                if i not in with_functions:
                    raise ValueError(f"dofs[{name!r}] must be of a specimen, a restoring function")
                every = np.arange(s.n)
                chosen[i] = every if value is None else dof_list(value, s.n, f"dofs[{name!r}]")
        rows = whole_number(rows, "rows", low=1)
        session.monitor = Monitor(checked_path(path, "path"), rows, chosen)


class Watched:
    """The commands and forces of a paced run, and the thread that writes them."""

    def __init__(self, session: Session, period: float, times: np.ndarray):
        chosen: Monitor | None = session.monitor
        dofs = {} if chosen is None else chosen.dofs
        self.monitored = tuple(
            forms.Monitored(member.position[dofs[i]].astype(np.int64), np.zeros((2, len(dofs[i]))))
            if i in dofs
            else None
            for i, member in enumerate(session.members)
        )
        columns = sum(last.size for _, last in filter(None, self.monitored))
        self.values = np.full((times.shape[1], columns), np.nan)
        self.times, self.period, self.done = times, period, 0
        self.session, self.chosen = session, chosen
        self.failure: OSError | None = None

    @contextmanager
    def written(self) -> Iterator[None]:
        """A context in which the thread writes what the core has done."""
        if self.chosen is None:
            yield
            return
        clock, names = self.session.clock, [member.name for member in self.session.members]
        about = {
            "period": 1e-9 * self.period,
            "t0": clock.time(self.session.core.step_count),
            "h": clock.dt / self.session.fine,
            "dofs": {names[i]: numbers.tolist() for i, numbers in sorted(self.chosen.dofs.items())},
        }
        file, over = MonitorFile(self.chosen.path, self.chosen.rows, about), threading.Event()
        due = due_times(self.period, self.times.shape[1])

        def write() -> None:
            while not over.wait(INTERVAL):
                self._write(file, due)

        writer = threading.Thread(target=write, name="pmalpha monitor")
        writer.start()
        try:
            yield
        finally:
            over.set()
            writer.join()
            self._write(file, due)
            file.close()
        if self.failure is not None:
            warn(f"the monitor could not be written to its end: {self.failure}", UserWarning)

    def _write(self, file: MonitorFile, due: np.ndarray) -> None:
        # when they ended is written last
        left = np.isnan(self.times[3, self.done : self.done + MOST_ROWS])
        end = self.done + (int(np.argmax(left)) if left.any() else left.size)
        new = slice(self.done, end)
        if end > self.done and self.failure is None:
            begun, commanded, returned, ended, shift = self.times[:, new]
            times = due[new] + shift, begun, commanded, returned, ended
            try:
                file.write(self.done, np.column_stack([*times, self.values[new]]))
            except OSError as error:  # the test is worth more than what shows it
                self.failure = error
            self.done = end


class Pace(NamedTuple):
    """How a run is paced: arguments of `Coupler.run_paced`."""

    rate: float
    on_late: str
    priority: int | None
    lock_memory: bool


def run_paced(session: Session, t_end: float, pace: Pace, wanted: Wanted, progress: Any) -> History:
    with session.guard, DeferredSignals(session.guard) as signals:
        pace = checked_pace(session, pace)
        done = session.done
        last = session.clock.end(t_end, None, done)
        times = Times(session, pace, last - done)
        kind = partial(paced_recording, session.core)
        recording = recording_of(session, done, last, wanted, kind=kind)
        recording.block[:] = 0.0  # no page is touched for the first time in the run
        try:
            with recording, reporting(progress, done, recording.end) as report:
                around = times.context(session, pace, recording)
                history = recorded(session, recording, report, signals, around)
        except BaseException:
            if session.last_history is not None:
                session.last_history = replace(session.last_history, pacing=times.pacing(recording))
            raise
        session.last_history = None
        return replace(history, pacing=times.pacing(recording))


def checked_pace(session: Session, pace: Pace) -> Pace:
    """The arguments, for a coupler that has fine steps."""
    require_alone(session, "run_paced")
    require_possible(session, "run_paced")
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


def paced_recording(core: _core.Coupler, wanted: Wanted) -> Callable[..., Recording]:
    """What makes the recording: a file is written by a thread of its own."""
    make = recording_class(wanted)
    return make if wanted.record_to is None else partial(RingRecording, core, wanted)


def _wake(pipe: int) -> None:
    with suppress(OSError):  # it is full: the run will look
        os.write(pipe, b"\0")


def _raise_failure(recording: Recording) -> None:
    """The exception of the thread that writes the record, as soon as the run looks."""
    if isinstance(recording, RingRecording) and recording.failure is not None:
        raise recording.failure


class Times:
    """The arrays in which the core writes the times of a run of `steps` macro steps."""

    def __init__(self, session: Session, pace: Pace, steps: int):
        self.period = 1e9 * session.clock.dt / session.fine / pace.rate
        count = steps * session.fine
        if not 0.0 < self.period <= LONGEST / max(1, count):
            raise ValueError(
                "rate must give a run of at most thirty years, got "
                f"{pace.rate!r} with periods of {1e-9 * self.period:g} s"
            )
        # ns at which the run began, fine steps done, ns by which later ones are due later
        self.state = np.zeros(3, dtype=np.int64)
        self.times = np.full((5, count), np.nan)
        self.watched = Watched(session, self.period, self.times)

    @contextmanager
    def context(self, session: Session, pace: Pace, recording: Recording) -> Iterator[None]:
        """A context in which the core keeps the pace: SCHED_FIFO and the shortest timer slack for
        this thread, memory of the process locked. OSError, with what is needed, and nothing is
        changed, without the right to these; threads made meanwhile do not inherit the priority."""
        watched, stops = self.watched, pace.on_late == "stop"
        with (
            watched.written(),
            _locked(pace.lock_memory),
            _scheduled(pace.priority),
            _without_slack(),
            signals_written() as (signals, write),
        ):
            if isinstance(recording, RingRecording):
                recording.wake = partial(_wake, write)
            woken = partial(_raise_failure, recording)
            arrays = self.state, self.times, watched.monitored, watched.values
            session.core.set_pace(forms.CorePace(self.period, stops, signals, woken, *arrays))
            try:
                yield
            finally:
                if isinstance(recording, RingRecording):
                    recording.finish()  # its thread writes to the pipe
                session.core.set_pace(None)

    def pacing(self, recording: Recording) -> Pacing:
        done = int(self.state[1])
        begun, commanded, returned, ended, shift = self.times[:, :done].copy()
        due = due_times(self.period, done) + shift
        lost = recording.lost if isinstance(recording, RingRecording) else 0
        return Pacing(1e-9 * self.period, due, begun, commanded, returned, ended, shift, lost)
