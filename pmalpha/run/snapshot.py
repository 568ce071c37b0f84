"""The whole state of a coupler, in memory or in a file, to return to it."""

from __future__ import annotations

import secrets
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from .._checks import MOST
from ..files import NPZ, checked_path
from ..setup.assembly import Assembly
from ..setup.ranks import file_of, joined
from . import checkpoint, works
from .advance import steps_facts, steps_of
from .checkpoint import CoreState
from .checkpoint import restore as restore_state
from .loads import InitialValues, Loads
from .session import Session, begin, check_call, take, together
from .transfer import Steps
from .works import Works

__all__ = ["Snapshot"]


def __dir__() -> list[str]:
    return sorted(__all__)


class _Contents(NamedTuple):
    assemblies: Any
    step: int
    steps: Steps
    changed: bool
    assembly: Assembly
    state: CoreState
    initial: InitialValues
    loads: Loads
    works: Works


class Snapshot:
    """The state of a coupler at a macro time level, from `Coupler.snapshot`.

    Only `Coupler.restore` of the same coupler reads it. It can be restored any number of times.

    Examples
    --------
    >>> coupler = models.split_oscillator(10.0).coupler(0.05, coupling="pm")
    >>> coupler.step(7)
    >>> coupler.snapshot()
    <Snapshot at step_count = 7>
    """

    __slots__ = ("_contents",)

    def __init__(self) -> None:
        self._contents: _Contents | None = None  # only a coupler fills it

    def __repr__(self) -> str:
        if self._contents is None:
            return "<Snapshot of no coupler>"
        return f"<Snapshot at step_count = {self._contents.step}>"

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a Snapshot cannot be copied or pickled; Coupler.save writes a file")


def snapshot(session: Session) -> Snapshot:
    with session.guard:
        return snapshot_of(session)


def restore(session: Session, snapshot: Snapshot) -> None:
    if not isinstance(snapshot, Snapshot):
        raise TypeError(f"snapshot must be a Snapshot, got {snapshot!r}")
    if snapshot._contents is None or snapshot._contents.assemblies is not session.assemblies:
        raise ValueError(
            f"snapshot must be one of this coupler, got {snapshot!r} from elsewhere; save and "
            "load transfer a state between couplers of the same problem"
        )
    with session.guard:
        restore_snapshot(session, snapshot)
        session.last_history = None


def snapshot_of(session: Session) -> Snapshot:
    begin(session)
    core, members, snapshot = session.core, session.members, Snapshot()
    state = CoreState(
        [member.core.levels() for member in members],
        [member.core.iteration() for member in members],
        core.numbers(),
    )
    snapshot._contents = _Contents(
        session.assemblies,
        core.step_count,
        session.steps,
        session.changed,
        session.assembly,
        state,
        session.initial,
        session.loads,
        works.saved(members, session.works, session.clock.count(core.step_count)),
    )
    return snapshot


def restore_snapshot(session: Session, snapshot: Snapshot) -> None:
    contents = snapshot._contents
    assert contents is not None
    loads, assembly = contents.loads, contents.assembly
    if loads is not session.loads or loads.stored:
        # stored values of callables are of other times
        core, members, clock = assembly.core, assembly.members, contents.steps.clock
        loads = loads.with_steps(core, members, clock, begins=loads.begins)
        loads.to_core()
    # _was_reset stays: it is about the factor of M alone, which this coupler has or has not
    session.initial, session.started = contents.initial, True
    restore_state(
        contents.state, assembly.members, assembly.core, contents.steps.clock, contents.step
    )
    take(session, contents.steps, assembly)
    session.loads, session.changed, session.works = loads, contents.changed, contents.works
    count = contents.steps.clock.count(contents.step)
    works.restore_functions(assembly.members, session.works, count)


def save(session: Session, path: str | PathLike[str]) -> None:
    with together(session):
        check_call(session, "save")
        checked_path(path, suffixes=NPZ)
        begin(session)
        arrays = checkpoint.state_arrays(session.assembly, session.core_rows, session.options)
        arrays |= session.loads.begin_arrays(session.assembly.first)
        steps, done = steps_facts(session), session.core.step_count
        summed = session.works if session.works.step == done else Works()
        summed = works.saved(session.members, summed, session.clock.count(done))
        arrays |= works.to_arrays(session.members, summed, session.assembly.first)
        if session.ranks is None:
            checkpoint.write(path, problem_of(session), done, arrays, steps)
            return
        # names of this save alone: files of older ones survive until all of this are written
        token = session.ranks.share(secrets.token_hex(4))[0]
        name = f"{checked_path(path)}.{done}.{token}"
        files = [file_of(name, r) for r in range(session.ranks.size)]
        checkpoint.write(files[session.ranks.rank], problem_of(session), done, arrays, steps)
        session.ranks.share(None)
        if session.ranks.rank == 0:
            names, first = [Path(file).name for file in files], session.ranks.first.tolist()
            checkpoint.write_master(checked_path(path), names, first)


def load(session: Session, path: str | PathLike[str]) -> None:
    with together(session):
        check_call(session, "load")
        first = session.assembly.first
        numbers = range(first, first + len(session.members))
        step, arrays, facts = checkpoint.read(path, problem_of(session), numbers)
        if session.ranks is not None:
            session.ranks.require_equal("the macro step of the files", (step, facts))
        steps, assembly = steps_of(session, path, facts)
        most = MOST // max(steps.layout.substeps)
        if not steps.clock.origin <= step <= most:
            reason = f"step_count must be in {steps.clock.origin}..{most}, got {step}"
            raise checkpoint.damaged(path, reason)
        members, core = assembly.members, assembly.core
        rows, options = session.core_rows, session.options
        state = checkpoint.core_state(path, arrays, assembly, rows, options)
        try:
            begins = session.loads.begins_of(arrays, first, steps.clock.origin, step)
            summed = works.of_arrays(members, arrays, first, step)
        except ValueError as error:
            raise checkpoint.damaged(path, error) from None
        if session.ranks is not None:
            session.ranks.share(None)  # from here on nothing fails
        # stored values of callables are of other times
        loads = session.loads.with_steps(core, members, steps.clock, begins=begins)
        loads.to_core()
        checkpoint.restore(state, members, core, steps.clock, step)
        take(session, steps, assembly)
        session.loads, session.started, session.last_history = loads, True, None
        session.works = summed
        works.restore_functions(members, summed, steps.clock.count(step))


def problem_of(session: Session) -> dict[str, Any]:
    """The description of this problem for a checkpoint; the matrices are read once."""
    if session.constants is None:
        first = session.assemblies.first.members
        iterates = joined(session.ranks, [member.internal is not None for member in first])
        session.constants = checkpoint.constants(
            session.options,
            session.loads.names,
            session.rows.p,
            first,
            session.rows.matrices,
            iterates=any(iterates),
            contacts=session.rows.contacts,
        )
    loads = session.loads
    return session.constants | checkpoint.loads(session.members, loads.forces, loads.motions)
