"""Macro steps in chunks, for which the callables are evaluated ahead."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

from ..errors import CallbackError, InstabilityError
from .loads import Loads
from .progress import Report

# Loads of Python callables are evaluated ahead, at most this many bytes at a time; while a table is
# filled the last one still lives, so that they take 64 MB.
AHEAD = 32_000_000
# They are first evaluated for this number of macro steps at a time, then for twice as many while
# that and the steps take less than this time, so that Ctrl-C and reports need not wait long.
FIRST_CHUNK, CHUNK_SECONDS = 32, 0.03


def advance(
    core: Any, loads: Loads, end: int, record: tuple | None = None, report: Report | None = None
) -> None:
    """Advance to macro step `end`.

    Parameters
    ----------
    core : the coupler of the core
    loads : Loads
    end : int
    record : tuple, optional
        As the core takes it, from `Recording.core_record`.
    report : Report, optional

    Raises
    ------
    InstabilityError, CallbackError, and what a callable raises
        The core is then at the last whole macro step.
    """
    for chunk in _chunks(core, loads, end):
        ready, failure = loads.prepare(core.step_count, chunk)
        failed = core.advance(ready - core.step_count, record, report)
        if failed is not None:
            raise _error(failed, core.step_count, loads)
        if failure is not None:
            raise failure
        if report is not None:
            report.if_due(core.step_count)


def _chunks(core: Any, loads: Loads, end: int) -> Iterator[int]:
    """Ends of chunks of macro steps; with callables a chunk takes about 50 ms.

    A chunk ends before its loads are more than fits, and soon enough for Ctrl-C and for a report.
    """
    size = loads.bytes_per_macro_step
    most = max(1, AHEAD // size) if size else end
    steps = min(FIRST_CHUNK, most) if size else most
    while core.step_count < end:
        begin = perf_counter()
        yield min(end, core.step_count + steps)
        seconds = perf_counter() - begin
        steps = min(2 * steps, most) if seconds < CHUNK_SECONDS else max(1, steps // 2)


def _error(failed: int | tuple[int, int, str], step: int, loads: Loads) -> Exception:
    """The exception for a macro step that the core did not finish."""
    names, t = [part.name for part in loads.parts] + ["interface"], loads.clock.time(step)
    if isinstance(failed, tuple):
        place, code, what = failed
        return CallbackError(code, what, step, t, names[place])
    return InstabilityError(step, t, names[failed])
