"""Runs that record: `Coupler.run` and `Coupler.step`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from weakref import ref

import numpy as np

from .._checks import flag, whole_number
from ..errors import noted, warn
from ..files import HDF5, checked_path
from ..problem.matrices import core_matrix, skew_part
from ..results.energy import Loads, conserved_quantity, stiffness_weight
from ..results.history import History
from ..results.history_file import write_master
from ..results.recording import FiledRecording, Recorded, Recording, Wanted, recording_class
from ..results.stored import target
from ..results.times import Instant
from ..setup.ranks import Elsewhere, file_of
from .advance import advance_to, require_inside
from .judging import warn_of_drift, warn_of_gains, warn_of_present_steps
from .progress import DeferredSignals, Report, reporting
from .session import Session, begin, check_call, require_alone, require_possible, together
from .snapshot import problem_of
from .state import multipliers_of, state_of
from .works import resume, works_of

# ---- until --------------------------------------------------------------------------------------
# The condition at which a run ends before its time: `Coupler.run` with ``until=``.

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


# ---- recorded run -------------------------------------------------------------------------------


def run(
    session: Session,
    end: tuple[float | None, int | None],
    wanted: Wanted,
    until: Any,
    progress: Any,
) -> History:
    """`Coupler.run` without tolerance; `end` is t_end and steps."""
    with together(session), DeferredSignals(session.guard) as signals:
        until = checked_until(session, until)
        done = session.done
        last = session.clock.end(*end, done)
        check_call(session, "run", last, wanted.every, wanted.energy)
        before = session.completed() if session.completed and last == done else None
        warn_of_nothing(session, end[0], last, before)
        recording = recording_of(session, done, last, wanted)
        with recording, reporting(progress, done, recording.end) as report:
            history = recorded(session, recording, report, signals, until=until)
    if session.done and last == done:
        session.last_history = before
    else:
        session.last_history, session.completed = None, ref(history)
    return history


def warn_of_nothing(
    session: Session, t_end: float | None, last: int, before: History | None
) -> None:
    """Warn of a run to the present time; `before` is the last one of steps, if it still exists."""
    if t_end is not None and last == session.done > 0:
        hint = "" if before is None else "; last_history has the run before"
        warn(
            f"the time is {session.clock.time(last):g} already: nothing is computed. reset() "
            f"begins again at t = 0{hint}",
            UserWarning,
        )


def step(session: Session, n: int) -> None:
    with together(session):
        n = whole_number(n, "n")
        check_call(session, "step", n)
        begin(session)
        advance_to(session, session.core.step_count + n, None)
        warn_of_gains(session.members)


def recording_of(
    session: Session,
    first: int,
    end: int,
    wanted: Wanted,
    *,
    kind: Callable[[Wanted], Callable[..., Recording]] = recording_class,
    checks_loads: bool = True,
) -> Recording:
    """The arrays of a run between two macro steps; `kind` makes what makes them. Without
    `checks_loads` the loads are not those of the run."""
    conserved = None
    require_inside(session.members)
    if flag(wanted.energy, "energy"):
        require_possible(session, "energy=True")
        conserved = conserved_quantity(session.members, session.options, session.ranks)
    # before the file, since all ranks describe the problem and one of them opens the file
    problem = problem_of(session) if wanted.record_to is not None and checks_loads else None
    make = kind(wanted.to(own_record(session, wanted)))
    of = recorded_of(session, wanted)
    loads = [Loads(*pair) for pair in zip(session.loads.forces, session.loads.seen)]
    if checks_loads:
        of.check_ground(loads)
    return make(
        of,
        coupling=session.coupling,
        begin=first,
        end=end,
        clock=session.clock,
        every=wanted.every,
        conserved=conserved,
        loads=loads,
        problem=problem,
        constraint_rows=session.rows.of_constraints,
    )


def recorded_of(session: Session, wanted: Wanted) -> Recorded:
    """What a run records of each subdomain."""
    if wanted.is_everything and session.full_record is not None:
        return session.full_record
    problem = session.members, session.keys, session.core_rows
    recorded = Recorded(*problem, fine=session.fine, wanted=wanted)
    if wanted.is_everything:
        session.full_record = recorded
    return recorded


def recorded(
    session: Session,
    recording: Recording,
    report: Report | None,
    signals: DeferredSignals,
    around: AbstractContextManager[None] = nullcontext(),  # noqa: B008  # has no state
    until: Until | None = None,
) -> History:
    """Run through an interval from the present on, the steps in a context, and judge the steps.

    `last_history` is the result too: the caller replaces it when the result is safe.
    """
    with noted() as messages:
        history = _recorded(session, recording, report, signals, around, until)
        signals.during(warn_of_gains, session.members)
        signals.during(warn_of_drift, session, history)
    return replace(history, warnings=tuple(messages)) if messages else history


def _recorded(
    session: Session,
    recording: Recording,
    report: Report | None,
    signals: DeferredSignals,
    around: AbstractContextManager[None],
    until: Until | None,
) -> History:
    session.last_history = None
    signals.during(begin, session)
    works: AbstractContextManager[None] = nullcontext()
    if recording.of.has_energy:
        works = summed_works(session, recording.conserved)
    with works, recording:
        record_present(session, recording)
        try:
            with around:
                advance_in_intervals(session, recording, report, signals, until)
        except BaseException:
            with suppress(MemoryError, OSError, ValueError):  # of a file that cannot be read
                session.last_history = recording.history(session.core.step_count)
            raise
        end = session.core.step_count
        session.last_history = history = recording.history(end)  # if a warning raises
    return history


def advance_in_intervals(
    session: Session,
    recording: Recording,
    report: Report | None,
    signals: DeferredSignals,
    until: Until | None,
) -> None:
    begin, end = recording.begin, recording.end
    warned = end == begin or not (begin or session.was_reset)  # the set-up has warned
    for pause in recording.pauses():  # the file exists before a function of the user can raise
        if isinstance(recording, FiledRecording) and recording.begin == begin:
            write_master_of(session, recording.path)
        if not warned:
            signals.during(warn_of_present_steps, session.members, session.clock.time(begin))
            warned = True
        is_end = signals.during(advance_until, session, pause, recording, report, until)
        recording.keep(session.core.step_count)
        if is_end:
            break
    if isinstance(recording, FiledRecording) and end == begin:
        write_master_of(session, recording.path)
    if report is not None:
        signals.during(report, session.core.step_count)


def record_present(session: Session, recording: Recording) -> None:
    record = recording.core_record()
    numbers = session.core.numbers()
    if session.ranks is not None:
        session.ranks.share(None)  # what allocates is behind all ranks
    elsewhere = session.core.record_present(record)
    if recording.continues:  # this row is no row of the file: impulses are summed on
        session.core.set_numbers(numbers)
    if elsewhere is not None:
        raise Elsewhere(elsewhere["rank"])


def own_record(session: Session, wanted: Wanted) -> Any:
    """`record_to` of this rank; rank 0 looks whether the master file can be written."""
    path = wanted.record_to
    if path is None:
        return None
    checked_path(path, "record_to", HDF5)
    if session.ranks is None:
        return path
    if session.ranks.rank == 0:
        target(path, may_exist=wanted.append or wanted.overwrite)
    return file_of(path, session.ranks.rank)


def write_master_of(session: Session, rank_path: Path) -> None:
    """The file that reads as one History, when those of the ranks are there; `rank_path` is
    that of this one."""
    if session.ranks is None or session.ranks.rank > 0:
        return
    path = rank_path.with_suffix("")  # without the rank
    files = [Path(file_of(path, rank)).name for rank in range(session.ranks.size)]
    write_master(path, files, session.ranks.first.tolist(), session.loads.names)


@contextmanager
def summed_works(session: Session, conserved: str | None) -> Iterator[None]:
    """Sum the works of each substep in the core; its memory for them is released afterwards."""
    try:
        lam, loads = session.core.multipliers, session.loads
        count = session.clock.count(session.core.step_count)
        for i, member in enumerate(session.members):
            loads.evaluate_present(i)
            scheme = member.subdomain.scheme
            weight = (stiffness_weight(scheme, member.h),) if conserved == "dual" else ()
            matrices = (core_matrix(member.M), core_matrix(skew_part(member.K), symmetric=False))
            functions = member.core.functions(count)
            member.core.begin_energy(*matrices, loads.at_present(i), lam, functions, *weight)
        resume(session.members, session.works, session.core.step_count)
        yield
    finally:
        session.works = works_of(session.members, session.core.step_count)
        for member in session.members:
            member.core.end_energy()
