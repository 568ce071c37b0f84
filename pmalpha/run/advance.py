"""Macro steps in chunks; callables are evaluated ahead of the core, chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from typing import Any

from ..blas import one_thread
from ..errors import (
    CallbackError,
    ConvergenceError,
    InstabilityError,
    LimitError,
    PacingError,
    UnboundedMotion,
)
from ..problem.matrices import ADMITTED
from ..problem.tangents import SYMMETRY
from ..setup.ranks import Elsewhere, Ranks
from .cause import cause_of
from .loads import Loads
from .progress import Report

# Bytes of load values evaluated ahead of the core at a time. While a table is filled the previous
# one still exists: 64 MB together.
AHEAD = 32_000_000
# Macro steps of a chunk. Not by the clock: a callable that reads what another function wrote, which
# it should not, would then return something else in every run.
CHUNK = 32
# Sweeps of the core over contacts with friction.
MOST_SWEEPS = 5000


def advance(
    core: Any,
    loads: Loads,
    end: int,
    record: tuple[Any, ...] | None = None,
    report: Report | None = None,
    ranks: Ranks | None = None,
) -> None:
    """Advance to macro step `end`.

    Parameters
    ----------
    core : _core.Coupler
    loads : Loads
    end : int
    record : tuple, optional
        From `Recording.core_record`.
    report : Report, optional
    ranks : Ranks, optional

    Raises
    ------
    InstabilityError, ConvergenceError, CallbackError, and any exception of a callable
        The core is then at the last completed macro step.
    """
    iterates = loads.iterates or ranks is not None  # subdomains of any process
    with one_thread() if iterates else nullcontext():  # the core calls BLAS
        _advance(core, loads, end, record, report, ranks)


def _advance(
    core: Any,
    loads: Loads,
    end: int,
    record: tuple[Any, ...] | None,
    report: Report | None,
    ranks: Ranks | None,
) -> None:
    call = report if ranks is None else ranks.report(report)
    for chunk in _chunks(core, loads, end):
        ready, failure = loads.prepare(core.step_count, chunk)
        if ranks is not None:
            ready, failure = _ready_on_all(ranks, loads, core.step_count, ready, failure)
        try:
            failed = core.advance(ready - core.step_count, record, call)
        except UnboundedMotion as error:
            step = core.step_count
            name, t = error.subdomain, loads.clock.time(step)
            raise InstabilityError(step, t, name, error.cause) from None
        if failed is not None:
            raise _error(failed, core.step_count, loads, 0 if ranks is None else ranks.own.start)
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


def _chunks(core: Any, loads: Loads, end: int) -> Iterator[int]:
    """Last macro steps of the chunks; one without callables.

    The load values of a chunk take at most `AHEAD` bytes.
    """
    size = loads.bytes_per_macro_step
    most = end if core.paced else CHUNK  # nothing is evaluated between two paced steps
    steps = max(1, min(most, AHEAD // size)) if size else end
    while core.step_count < end:
        yield min(end, core.step_count + steps)


def _error(failed: Any, step: int, loads: Loads, first: int) -> Exception:
    """The exception for a macro step that the core did not complete; `first` is the number of the
    first subdomain of this process."""
    names, t = [*loads.names, "interface"], loads.clock.time(step)
    if failed == ():
        return PacingError(step, t)
    if isinstance(failed, tuple) and len(failed) == 6:
        index, what, position, value, limit, end = failed
        part = loads.parts[index - first]
        dof = None if what == "energy" else int(part.order[position])
        return LimitError(part.name, what, dof, value, limit, end)
    if isinstance(failed, tuple) and len(failed) == 1:
        return Elsewhere(f"rank {failed[0]} has failed")
    if isinstance(failed, tuple) and failed[:1] == ("contact",):
        assert loads.obstacles is not None
        row = loads.obstacles.contacts.name_of_core_row(failed[1])
        cause = f"the impulses of contacts do not come to an end, furthest in {row}"
        return ConvergenceError("interface", loads.clock.time(step + 1), MOST_SWEEPS, cause)
    if isinstance(failed, tuple) and len(failed) == 4:
        return _convergence_error(failed, names, step, loads, first)
    if isinstance(failed, tuple) and len(failed) == 2:
        index, end = failed
        return ValueError(
            f"the tangents of internal of subdomain {names[index]!r} must be symmetric to "
            f"{SYMMETRY:g} of their largest entry, got one at t = {end:g} that is not; {ADMITTED}"
        )
    if isinstance(failed, tuple):
        index, code, what = failed
        return CallbackError(code, what, step, t, names[index])
    own = failed - first
    if not 0 <= own < len(loads.parts):
        return InstabilityError(step, t, names[failed])
    return InstabilityError(step, t, names[failed], cause_of(loads.parts[own]))


def _convergence_error(
    failed: tuple[int, float | None, int | None, int],
    names: list[str],
    step: int,
    loads: Loads,
    first: int,
) -> ConvergenceError:
    index, t, iterations, position = failed
    if t is None or iterations is None:  # the interface, at the end of the macro step
        end = loads.clock.time(step + 1)
        cause = "" if position < 0 else "the interface matrix of the tangents is singular"
        return ConvergenceError(names[index], end, loads.newton.iterations, cause)
    cause = ""
    if position >= 0:
        dof = loads.parts[index - first].order[position]
        cause = (
            f"its tangent Mbar is singular but for rounding, first seen at dof {dof}, as at a "
            "load that buckles it, or after an iterate far away: take other steps"
        )
    return ConvergenceError(names[index], t, iterations, cause)
