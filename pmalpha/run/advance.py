"""Macro steps in chunks, callables evaluated ahead of them, and other steps in mid-run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from typing import Any

import pmalpha._core as _core

from .._checks import real_number, time_step, whole_number
from .._core import MOST_SWEEPS
from ..errors import (
    CallbackError,
    ConvergenceError,
    InstabilityError,
    PacingError,
)
from ..memory import one_thread, reserve_buffers
from ..problem.device import OUTSIDE
from ..problem.matrices import ADMITTED
from ..problem.restoring import devices_of, external_of, items_of
from ..problem.tangents import SYMMETRY
from ..results.quantities import CoreRecord, by_index
from ..results.recording import Recording
from ..results.times import Clock, clock_of
from ..setup.assembly import Assembly
from ..setup.member import Member
from ..setup.ranks import Elsewhere, Failure, NotConverged, Ranks, joined
from .checkpoint import damaged
from .judging import cause_of
from .loads import Loads, limit_error, warn_of_skipped
from .progress import Report
from .session import Session, check_call, layout_of, require_possible, take, together
from .transfer import Steps, follow_energies, moves, take_over

# Bytes of load values evaluated ahead of the core at a time. While a table is filled the previous
# one still exists: 64 MB together.
AHEAD = 32_000_000
# Macro steps of a chunk. Not by the clock: a callable that reads what another function wrote, which
# it should not, would then return something else in every run.
CHUNK = 32


def advance(
    core: _core.Coupler,
    loads: Loads,
    end: int,
    record: CoreRecord | None = None,
    report: Report | None = None,
    ranks: Ranks | None = None,
) -> None:
    """Advance to macro step `end`; after any exception the core is at the last completed one."""
    require_inside(loads.members)
    reserve_buffers()  # the limit may be newer than the coupler
    iterates = loads.iterates or ranks is not None  # subdomains of any process
    with one_thread() if iterates else nullcontext():  # the core calls BLAS
        _advance(core, loads, end, record, report, ranks)


def require_inside(members: Sequence[Member]) -> None:
    """ValueError for a specimen that is not in this program."""
    for member in members:
        for item in items_of(member.subdomain.restoring):
            if external_of(item) is not None:
                raise ValueError(f"restoring of subdomain {member.name!r}: {OUTSIDE}")


def _advance(
    core: _core.Coupler,
    loads: Loads,
    end: int,
    record: CoreRecord | None,
    report: Report | None,
    ranks: Ranks | None,
) -> None:
    call = report if ranks is None else ranks.report(report)
    for chunk in _chunks(core, loads, end):
        ready, failure = loads.prepare(core.step_count, chunk)
        if ranks is not None:
            ready, failure = _ready_on_all(ranks, loads, core.step_count, ready, failure)
        failed = core.advance(ready - core.step_count, record, call)
        if failed is not None:
            raise _error(failed, core.step_count, loads, 0 if ranks is None else ranks.part.start)
        if failure is not None:
            raise failure
        if report is not None:
            report.if_due(core.step_count)


def _ready_on_all(
    ranks: Ranks, loads: Loads, begin: int, ready: int, failure: BaseException | None
) -> tuple[int, BaseException | None]:
    """The macro step up to which the loads are evaluated on all ranks; what failed here there."""
    least = min(ranks.share(ready))
    if any(motion.callback is not None for motion in loads.motions):
        ranks.require_equal("a prescribed velocity", loads.motion_values(begin, least))
    return least, failure if ready == least else None


def _chunks(core: _core.Coupler, loads: Loads, end: int) -> Iterator[int]:
    """Last macro steps of the chunks; one without callables.

    The load values of a chunk take at most `AHEAD` bytes.
    """
    size = loads.bytes_per_macro_step
    most = end if core.paced else CHUNK  # nothing is evaluated between two paced steps
    steps = max(1, min(most, AHEAD // size)) if size else end
    while core.step_count < end:
        yield min(end, core.step_count + steps)


def _error(failed: Failure, step: int, loads: Loads, first: int) -> Exception:
    """The exception for a macro step that the core did not complete; `first` is the number of the
    first subdomain of this process."""
    names, t, end = [*loads.names, "interface"], loads.clock.time(step), loads.clock.time(step + 1)
    if failed["kind"] == "late":
        return PacingError(step, t)
    if failed["kind"] == "elsewhere":
        return Elsewhere(f"rank {failed['rank']} has failed")
    if failed["kind"] == "contact":
        assert loads.obstacles is not None
        row = loads.obstacles.contacts.name_of_core_row(failed["row"])
        cause = f"the impulses of contacts do not come to an end, furthest in {row}"
        return ConvergenceError("interface", end, MOST_SWEEPS, cause)
    if failed["kind"] == "interface":
        cause = "the interface matrix of the tangents is singular" if failed["singular"] else ""
        return ConvergenceError("interface", end, loads.newton.iterations, cause)
    i = failed["subdomain"]
    if failed["kind"] == "unsymmetric":
        return ValueError(
            f"the tangents of internal of subdomain {names[i]!r} must be symmetric to "
            f"{SYMMETRY:g} of their largest entry, got one at t = {failed['t']:g} that is not; "
            f"{ADMITTED}"
        )
    if failed["kind"] == "function":
        return CallbackError(failed["code"], failed["what"], step, t, names[i])
    if not 0 <= i - first < len(loads.members):
        return InstabilityError(step, t, names[i])
    member = loads.members[i - first]
    if failed["kind"] == "limit":
        return limit_error(member, failed)
    if failed["kind"] == "iteration":
        return _convergence_error(member, failed)
    return InstabilityError(step, t, names[i], cause_of(member))


def _convergence_error(member: Member, failed: NotConverged) -> ConvergenceError:
    t = failed["t"]
    cause = _value_not_finite(member, t, failed["spoiled"], failed["finite"])
    if failed["singular"] is not None:
        dof = member.order[failed["singular"]]
        cause = (
            f"its tangent Mbar is singular but for rounding, first seen at dof {dof}, as at a "
            "load that buckles it, or after an iterate far away: take other steps"
        )
    return ConvergenceError(member.name, t, failed["corrections"], cause)


def _value_not_finite(member: Member, t: float, spoiled: int | None, finite: bool) -> str:
    """What is known of a value that is not finite in the last evaluation at t, or empty.

    Of Python functions the value; of compiled ones the dof, whose position is `spoiled`, or None.
    """
    functions = () if member.internal is None else member.internal.functions
    for function, *_ in functions:
        record = getattr(function, "not_finite", None)
        if record is not None and record[0] == t:
            return str(record[1])
    if spoiled is not None:
        dof, force = member.order[spoiled], "the force that its compiled functions returned"
        return f"{force} for dof {dof} at t = {t:g} is not finite"
    return "" if finite else f"a value at t = {t:g} is not finite"


def change_steps(session: Session, dt: float | None, substeps: Mapping[Any, int] | None) -> None:
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
    require_possible(session, "a change of steps")
    for i, member in enumerate(session.members, session.assembly.first):
        h = layout.of(i)[0]
        if member.h != h and devices_of(member.subdomain.restoring):
            raise ValueError(
                f"steps of subdomain {member.name!r} must stay {member.h:g}, got {h:g}: its "
                "actuators and compensators remember commands step by step; make another coupler"
            )
    steps = session.steps.changed(layout, step) if clock is None else Steps(layout, clock)
    session.assemblies.of(layout)  # what it lacks is found now, not after the first macro step
    new, old, before = session.assemblies.of(steps.present), session.assembly, session.steps
    states, begins = None, None
    if session.started:
        begins = session.loads.next_begins(
            step, new.members, lambda i: steps.lengths(new.first + i, step)
        )
        states = moves(
            old,
            new,
            lambda i: before.lengths(i, step),
            lambda i: steps.lengths(i, step),
            first=True,
        )
    loads = session.loads.with_steps(new.core, new.members, steps.clock, begins=begins)
    if clock is None:
        fine = layout.dt / new.core.instants
        warn_of_skipped(new.members, loads.forces, loads.motions, fine)
    if session.ranks is not None:
        session.ranks.share(None)  # from here on nothing fails
    loads.to_core()
    if states is not None:
        take_over(old, new, states, steps.clock, before.clock)
    else:  # an assembly of earlier steps has the time of theirs
        new.core.set_origin(steps.clock.origin, steps.clock.t0)
    take(session, steps, new)
    session.loads, session.last_history = loads, None


# ---- chosen steps ------------------------------------------------------------------------


def choose(session: Session, counts: Sequence[int]) -> None:
    """Other substeps in macro steps that are counted on, under "gc"."""
    substeps = tuple(joined(session.ranks, counts))
    steps, last = session.steps, session.last_history
    if substeps != steps.layout.substeps:
        change(session, steps.layout.dt, substeps, steps.clock)
        session.last_history = last


# ---- checkpoints -------------------------------------------------------------------------


def steps_facts(session: Session) -> dict[str, Any] | None:
    """What a checkpoint says of the steps; None if they are those of the beginning."""
    steps = session.steps
    layout = session.assemblies.first_layout
    if steps == Steps(layout, clock_of(layout)):
        return None
    overs = None if steps.first is None else list(steps.first.overs)
    facts = {"substeps": list(steps.layout.substeps), "first": overs}
    clock = asdict(steps.clock)
    del clock["staged"]  # steps of two stages do not change
    return facts | clock


def steps_of(
    session: Session, path: Any, facts: Mapping[str, Any] | None
) -> tuple[Steps, Assembly]:
    """The inverse, with the assembly of the next macro step."""
    if facts is None:
        layout = session.assemblies.first_layout
        return Steps(layout, clock_of(layout)), session.assemblies.first
    try:
        clock = Clock(
            time_step(facts["dt"], "dt"),
            whole_number(facts["origin"], "origin"),
            real_number(facts["t0"], "t0", low=0.0),
            real_number(facts["before"], "before", low=0.0),
        )
        substeps = tuple(whole_number(k, "substeps", low=1) for k in facts["substeps"])
        if len(substeps) != len(session.everything):
            raise ValueError(
                f"substeps of {len(session.everything)} subdomains, got {len(substeps)}"
            )
        layout = layout_of(session.everything, session.coupling, clock.dt, substeps)
        first = facts["first"]
        if first is not None:  # the steps of the next macro step alone
            overs = tuple(None if x is None else time_step(x, "first") for x in first)
            if len(overs) not in (0, len(substeps)):
                raise ValueError(f"first of {len(substeps)} subdomains, got {len(overs)}")
            first = replace(layout, overs=overs)
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
    states = moves(
        old,
        new,
        steps.lengths_after_first,
        lambda i: regular.lengths(i, steps.clock.origin + 1),
        first=False,
    )
    loads = session.loads.moved_to(new.core, new.members)
    follow_energies(old, new)
    take_over(old, new, states, steps.clock, steps.clock)
    take(session, regular, new)
    session.loads = loads
