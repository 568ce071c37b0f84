"""Other steps in mid-run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from .._checks import real_number, time_step, whole_number
from ..problem.restoring import devices_of
from ..results.clock import Clock
from ..results.keys import by_index
from ..results.recording import Recording
from ..setup.assembly import Assembly
from ..setup.ranks import joined
from .advance import advance
from .checkpoint import damaged
from .progress import Report
from .sampled import warn_of_skipped
from .session import Session, check_call, layout_of, take, together
from .transfer import Steps, follow_energies, moves, take_over


def change_steps(session: Session, dt: float | None, substeps: Mapping[Any, int] | None) -> None:
    """`Coupler.change_steps`."""
    with together(session):
        check_call(session, "change_steps", dt)
        change(session, *checked_steps(session, dt, substeps))
        session.changed = session.steps.layout != session.assemblies.first_layout


def checked_steps(session: Session, dt: Any, substeps: Any) -> tuple[float, tuple[int, ...]]:
    if dt is None and substeps is None:
        raise TypeError("give dt, substeps or both")
    present, first = session.steps.layout, session.assembly.first
    counts = list(present.substeps[first : first + len(session.keys)])
    for i, count in by_index(substeps, session.keys, "substeps").items():
        counts[i] = whole_number(count, f"substeps of {session.keys[i][0]!r}", low=1)
    all_counts = tuple(joined(session.ranks, counts))
    return present.dt if dt is None else time_step(dt, "dt"), all_counts


def change(
    session: Session, dt: float, substeps: tuple[int, ...], clock: Clock | None = None
) -> None:
    """Change to these steps at the present; nothing has changed after an error.

    With a clock, that of the present, time is counted on (without double steps).
    """
    layout = layout_of(session.everything, session.coupling, dt, substeps)
    step = session.done
    if layout == session.steps.layout:
        return
    for i, part in enumerate(session.parts, session.assembly.first):
        h = layout.of(i)[0]
        if part.h != h and devices_of(part.subdomain.restoring):
            raise ValueError(
                f"steps of subdomain {part.name!r} must stay {part.h:g}, got {h:g}: its actuators "
                "and compensators remember commands step by step; make another coupler"
            )
    steps = session.steps.changed(layout, step) if clock is None else Steps(layout, clock)
    session.assemblies.of(layout)  # what it lacks is found now, not after the first macro step
    new, old, before = session.assemblies.of(steps.present), session.assembly, session.steps
    loads = session.loads.with_steps(new.core, new.parts, steps.clock)
    found = None
    if session.started:
        found = moves(
            old,
            new,
            lambda i: before.lengths(i, step),
            lambda i: steps.lengths(i, step),
            first=True,
        )
    if clock is None:
        fine = layout.dt / new.core.instants
        warn_of_skipped(new.parts, loads.forces, loads.motions, fine)
    if session.ranks is not None:
        session.ranks.share(None)  # from here on nothing fails
    loads.to_core()
    if found is not None:
        take_over(old, new, found, steps.clock)
    else:  # an assembly of earlier steps has the time of theirs
        new.core.set_origin(steps.clock.origin, steps.clock.t0)
    take(session, steps, new)
    session.loads, session.last_history = loads, None


# ---- chosen steps ------------------------------------------------------------------------


def choose(session: Session, own: Sequence[int]) -> None:
    """Other substeps in macro steps that are counted on, under "gc"."""
    substeps = tuple(joined(session.ranks, own))
    steps, last = session.steps, session.last_history
    if substeps != steps.layout.substeps:
        change(session, steps.layout.dt, substeps, steps.clock)
        session.last_history = last


# ---- checkpoints -------------------------------------------------------------------------


def steps_facts(session: Session) -> dict[str, Any] | None:
    """What a checkpoint says of the steps; None if they are those of the beginning."""
    steps = session.steps
    if steps == Steps(session.assemblies.first_layout, Clock(session.assemblies.first_layout.dt)):
        return None
    overs = None if steps.first is None else list(steps.first.overs)
    facts = {"substeps": list(steps.layout.substeps), "first": overs}
    return facts | asdict(steps.clock)


def steps_of(
    session: Session, path: Any, facts: Mapping[str, Any] | None
) -> tuple[Steps, Assembly]:
    """The inverse, with the assembly of the next macro step."""
    if facts is None:
        layout = session.assemblies.first_layout
        return Steps(layout, Clock(layout.dt)), session.assemblies.first
    try:
        clock = Clock(
            time_step(facts["dt"], "dt"),
            whole_number(facts["origin"], "origin"),
            *(real_number(facts[name], name, low=0.0) for name in ("t0", "before")),
        )
        substeps = tuple(whole_number(k, "substeps", low=1) for k in facts["substeps"])
        if len(substeps) != len(session.everything):
            raise ValueError(
                f"substeps of {len(session.everything)} subdomains, got {len(substeps)}"
            )
        layout = layout_of(session.everything, session.coupling, clock.dt, substeps)
        first = None if facts["first"] is None else replace(layout, overs=_overs(facts["first"]))
        if first is not None and len(first.overs) not in (0, len(substeps)):
            raise ValueError(f"first of {len(substeps)} subdomains, got {len(first.overs)}")
    except (LookupError, TypeError, ValueError) as error:
        raise damaged(path, error) from None
    session.assemblies.of(layout)
    steps = Steps(layout, clock, first)
    return steps, session.assemblies.of(steps.present)


# ---- inside ------------------------------------------------------------------------------


def advance_to(
    session: Session, end: int, recording: Recording | None, report: Report | None = None
) -> None:
    record = None if recording is None else recording.core_record()
    if session.steps.first is not None and end > session.clock.origin:
        try:
            advance(
                session.core, session.loads, session.clock.origin + 1, record, report, session.ranks
            )
        finally:
            take_regular_steps(session)
    advance(session.core, session.loads, end, record, report, session.ranks)


def take_regular_steps(session: Session) -> None:
    """After the first macro step that follows a change, double steps are of length 2 h."""
    steps, old = session.steps, session.assembly
    if session.core.step_count == steps.clock.origin:
        return  # the macro step was not completed
    regular = Steps(steps.layout, steps.clock)
    new = session.assemblies.of(regular.layout)
    found = moves(
        old,
        new,
        steps.lengths_after_first,
        lambda i: regular.lengths(i, steps.clock.origin + 1),
        first=False,
    )
    loads = session.loads.moved_to(new.core, new.parts)
    follow_energies(old, new)
    take_over(old, new, found, steps.clock)
    take(session, regular, new)
    session.loads = loads


def _overs(given: Sequence[Any]) -> tuple[float | None, ...]:
    """The `overs` of a Layout from a file."""
    return tuple(None if x is None else time_step(x, "first") for x in given)
