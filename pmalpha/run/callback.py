"""A Python callable, evaluated ahead of the core."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._checks import vector
from ..results.clock import Clock


class CallbackLoad:
    """A Python callable, evaluated ahead of the core: once per substep, in the order of time.

    Parameters
    ----------
    force : callable
        f(t) -> (n,)
    what : str
        Its name in messages, such as "force of subdomain 'rig'".
    order : (n,) array
        Elimination order.
    substeps : int
        Evaluations per macro step.
    clock : Clock
    """

    def __init__(
        self,
        force: Callable[[float], Any],
        what: str,
        order: np.ndarray,
        substeps: int,
        clock: Clock,
    ):
        self.force, self.what, self.order = force, what, order
        self.substeps, self.clock = substeps, clock
        self.first = 0  # substep of the first row, counted from the origin of the clock
        self.table = np.empty((0, order.size))
        self.count = 0  # rows of the table that have been evaluated
        self.near_start: dict[float, np.ndarray] = {}

    @property
    def rows(self) -> np.ndarray:
        """The evaluated values, by substep."""
        return self.table[: self.count]

    @property
    def bytes_per_macro_step(self) -> int:
        return 8 * self.substeps * self.order.size

    def evaluate(self, t: float) -> np.ndarray:
        """f(t) in elimination order, checked."""
        value = self.force(t)
        try:
            result: np.ndarray = vector(value, self.order.size, "its value")[self.order]
            return result
        except (TypeError, ValueError) as error:
            raise type(error)(f"{self.what} at t = {t:g}: {error}") from None

    def near_start_value(self, t: float) -> np.ndarray:
        """f(t) for the initial values; evaluated once, also if the start is repeated."""
        if t not in self.near_start:
            self.near_start[t] = self.evaluate(t)
        return self.near_start[t]

    def value_at(self, level: int) -> np.ndarray:
        """f at a time level of the subdomain, counted from the origin, in elimination order.

        The value of the substep that ended there; evaluated again if it is not stored, as after
        `Coupler.load`.
        """
        row = level - 1 - self.first
        if 0 <= row < len(self.rows):
            result: np.ndarray = self.rows[row].copy()
            return result
        return self.evaluate(self.clock.level(level, self.substeps))

    def prepare(self, begin: int, end: int) -> tuple[int, Exception | None]:
        """Evaluate the loads of the macro steps begin..end-1.

        Values that an aborted run did not use are kept. Returns the macro step up to which the
        loads are evaluated, and the callable's exception if that is before `end`. A BaseException
        that is no Exception, such as Ctrl-C, is raised at once; no evaluated value is lost.
        """
        first = self.clock.count(begin) * self.substeps
        needed = (end - begin) * self.substeps
        if self.first <= first and first + needed <= self.first + len(self.rows):
            return end, None
        kept = self.rows[max(first - self.first, 0) :] if self.first <= first else self.rows[:0]
        table = np.empty((needed, self.order.size))
        table[: len(kept)] = kept
        self.first, self.table, self.count = first, table, len(kept)
        failure = self._fill()
        return begin + self.count // self.substeps, failure

    def _fill(self) -> Exception | None:
        """Evaluate the rows that are missing in the table; the callable's exception, if any.

        The count is kept row by row: a `finally` after the loop would not be executed for every
        Ctrl-C, since from Python 3.12 on the jump at the end of a loop directly under `try` is not
        covered by it.
        """
        try:
            while self.count < len(self.table):
                k = self.first + self.count + 1
                self.table[self.count] = self.evaluate(self.clock.level(k, self.substeps))
                self.count += 1
        except Exception as error:
            return error
        return None
