"""A Python callable that is evaluated ahead of the core."""

from __future__ import annotations

import numpy as np

from .._checks import vector


class CallbackLoad:
    """A Python callable asked ahead of the core, each own step once, in the order of time.

    Parameters
    ----------
    force : callable
        f(t) -> (n,)
    what : str
        For messages, such as "force of subdomain 'rig'".
    order : (n,) array
        Elimination order.
    substeps : int
        How often in a macro step it is asked.
    dt : float
        Macro step.
    """

    def __init__(self, force, what: str, order: np.ndarray, substeps: int, dt: float):
        self.force, self.what, self.order = force, what, order
        self.substeps, self.dt = substeps, dt
        self.first = 0
        self.rows = np.empty((0, order.size))
        self.near_start: dict[float, np.ndarray] = {}

    @property
    def bytes_per_macro_step(self) -> int:
        return 8 * self.substeps * self.order.size

    def ask(self, t: float) -> np.ndarray:
        """f(t) in elimination order, checked."""
        value = self.force(t)
        try:
            return vector(value, self.order.size, "its value")[self.order]
        except (TypeError, ValueError) as error:
            raise type(error)(f"{self.what} at t = {t:g}: {error}") from None

    def ask_near_start(self, t: float) -> np.ndarray:
        """f(t) as `ask`, for the initial values: once even if the start has to be repeated."""
        if t not in self.near_start:
            self.near_start[t] = self.ask(t)
        return self.near_start[t]

    def ask_again(self, node: int) -> np.ndarray:
        """f at an own node after the first, in elimination order.

        The value that was asked for the step to it; where that is not kept, as after `load`, the
        callable is asked.
        """
        row = node - 1 - self.first
        if 0 <= row < len(self.rows):
            return self.rows[row].copy()
        return self.ask(node / self.substeps * self.dt)  # (T1)

    def prepare(self, begin: int, end: int) -> tuple[int, Exception | None]:
        """Have the loads of the macro steps begin..end-1 ready.

        Values asked before and not used since an abort are kept. Returns the macro step up to
        which the loads are there, and what the callable raised where that is before `end`. What is
        no error of the callable's, such as Ctrl-C, is raised at once; no value is lost by it.
        """
        first, needed = begin * self.substeps, (end - begin) * self.substeps
        if self.first <= first and first + needed <= self.first + len(self.rows):
            return end, None
        kept = self.rows[max(first - self.first, 0) :] if self.first <= first else self.rows[:0]
        rows = np.empty((needed, self.order.size))
        rows[: len(kept)] = kept
        known, failure = len(kept), None
        try:
            while known < needed:
                k = first + known + 1
                rows[known] = self.ask(k / self.substeps * self.dt)  # (T1)
                known += 1
        except Exception as error:
            failure = error
        finally:
            self.first, self.rows = first, rows[:known]
        return begin + known // self.substeps, failure
