"""The whole state of a coupler in memory, to return to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..setup.assembly import Assembly
from ..setup.part import Part
from .checkpoint import CoreState
from .checkpoint import restore as restore_state
from .initial import InitialValues
from .loads import Loads
from .session import Session, begin, take
from .transfer import Steps

__all__ = ["Snapshot"]


class _Contents(NamedTuple):
    """What a snapshot keeps."""

    assemblies: Any
    step: int
    steps: Steps
    changed: bool
    assembly: Assembly
    state: CoreState
    initial: InitialValues
    loads: Loads


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
    """`Coupler.snapshot`."""
    with session.guard:
        return snapshot_of(session)


def restore(session: Session, snapshot: Snapshot) -> None:
    """`Coupler.restore`."""
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
    core, snapshot = session.core, Snapshot()
    snapshot._contents = _Contents(
        session.assemblies,
        core.step_count,
        session.steps,
        session.changed,
        session.assembly,
        _present(session.parts, core),
        session.initial,
        session.loads,
    )
    return snapshot


def restore_snapshot(session: Session, snapshot: Snapshot) -> None:
    kept = snapshot._contents
    assert kept is not None
    loads, assembly = kept.loads, kept.assembly
    if loads is not session.loads or loads.has_callables:
        # stored values of callables are of other times
        loads = loads.with_steps(assembly.core, assembly.parts, kept.steps.clock)
        loads.to_core()
    # _was_reset stays: it is about the factor of M alone, which this coupler has or has not
    session.initial, session.started = kept.initial, True
    restore_state(kept.state, assembly.parts, assembly.core, kept.steps.clock, kept.step)
    take(session, kept.steps, assembly)
    session.loads, session.changed = loads, kept.changed


def _present(parts: Sequence[Part], core: Any) -> CoreState:
    """Copies of all that the core continues with."""
    shooting: np.ndarray = core.iteration()
    return CoreState(
        [part.core.levels() for part in parts],
        [part.core.iteration() for part in parts],
        shooting,
        core.multipliers,
        core.prescribed,
        core.end_multipliers(),
        core.gap(),
        core.contact(),
    )
