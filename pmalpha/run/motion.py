"""What is evaluated ahead of the core: callables, prescribed velocities (G1), obstacles (U1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._checks import called, vector
from ..problem import forms
from ..problem.contacts import on_rows
from ..problem.loads import Load, Term, as_load
from ..results.times import Clock
from ..setup.contact_rows import Contacts
from ..setup.rows import ConstraintRows
from ..setup.schedule import Rows

# A velocity that is not given is a difference over this part of a fine step.
SHARE = 0.01
# Where a callable is evaluated for what it reaches: from 1/16 of a fine step to 65536 of them.
DOUBLINGS = 21


class CallbackLoad:
    """A Python callable, evaluated ahead of the core: once per substep, in the order of time.

    what: its name in messages, such as "force of subdomain 'rig'".
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
        value = called(self.what, self.force, t)
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
        values = self.rows[max(first - self.first, 0) :] if self.first <= first else self.rows[:0]
        table = np.empty((needed, self.order.size))
        table[: len(values)] = values
        self.first, self.table, self.count = first, table, len(values)
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


class Motion:
    """The prescribed velocity of one constraint.

    what: its name in messages, such as "velocity of constraint 0".
    scale: array, of these rows, by which the core has them divided.
    fine: interface problems per macro step.
    apart: time between the values of a callable of which g'(0) is made. Default: 1/16 of a fine
        step.
    """

    def __init__(
        self,
        velocity: Term,
        what: str,
        rows: np.ndarray,
        scale: np.ndarray,
        fine: int,
        clock: Clock,
        apart: float | None = None,
    ):
        self.velocity, self.what, self.rows = velocity, what, rows
        self.scale, self.fine = scale, fine
        self.apart = clock.dt / fine / 16.0 if apart is None else apart
        self.callback: CallbackLoad | None = None
        self.load = as_load(velocity)
        if self.load._kind != "known":
            self.callback = CallbackLoad(
                self.load.function, what, np.arange(rows.size), fine, clock
            )

    def renewed(self, fine: int, clock: Clock) -> Motion:
        """The same motion for other steps, with the same g'(0); without values of a callable."""
        return Motion(self.velocity, self.what, self.rows, self.scale, fine, clock, self.apart)

    @property
    def known(self) -> bool:
        """Whether it is no Python callable."""
        return self.callback is None

    def in_core(self, values: np.ndarray) -> np.ndarray:
        """Values (..., rows) of g for the rows as the core has them."""
        return values if np.all(self.scale == 1.0) else values / self.scale

    def core_load(self) -> forms.Load:
        """g that is no Python callable, in a form of the core."""
        scale = None if np.all(self.scale == 1.0) else self.scale
        return self.load._core(np.arange(self.rows.size), scale)

    def at(self, t: float) -> np.ndarray:
        """g(t) for the initial values."""
        if self.callback is not None:
            return self.callback.near_start_value(t)
        return self.load(t)

    def reached(self) -> np.ndarray:
        """The largest |g| later: of all samples; of a callable at times that double."""
        if self.callback is None:
            return self.load._largest()
        largest: np.ndarray = np.zeros(self.rows.size)
        for k in range(DOUBLINGS):
            try:
                values = self.callback.evaluate(self.apart * 2.0**k)
            except Exception:  # a function that is not defined as late as that
                break
            largest = np.fmax(largest, np.where(np.isfinite(values), np.abs(values), 0.0))
        return largest

    def slope(self) -> np.ndarray:
        if self.known:
            return self.load._slope()
        d = self.apart
        result: np.ndarray = (4.0 * self.at(d) - 3.0 * self.at(0.0) - self.at(2.0 * d)) / (2.0 * d)
        return result


def reached(motions: Sequence[Motion], p: int) -> np.ndarray:
    """The largest |g| (p,) of prescribed velocities at later times, in the user's order."""
    largest = np.zeros(p)
    for motion in motions:
        largest[motion.rows] = motion.reached()
    return largest


def motions_of(
    constraints: Sequence[Rows], rows: ConstraintRows, fine: int, clock: Clock
) -> list[Motion]:
    """The prescribed velocities of the constraints that have one."""
    return [
        Motion(c.velocity, f"velocity of constraint {i}", numbers, rows.scale[numbers], fine, clock)
        for i, (c, numbers) in enumerate(zip(constraints, map(rows.of, range(len(constraints)))))
        if c.velocity is not None
    ]


def all_known(motions: Sequence[Motion]) -> bool:
    """Whether no prescribed velocity is a callable, which only `run` and `step` may evaluate."""
    return all(motion.known for motion in motions)


def values_at_start(motions: Sequence[Motion], p: int, *, slopes: bool = False) -> np.ndarray:
    """g(0) or g'(0), (p,), in the user's order; 0 in rows without prescribed velocity."""
    g = np.zeros(p)
    for motion in motions:
        g[motion.rows] = motion.slope() if slopes else motion.at(0.0)
    return g


class Obstacles:
    """d and d' of all contact rows at fine steps, evaluated ahead of the core.

    apart: time over which differences are taken. Default: a hundredth of a fine step.
    """

    def __init__(self, contacts: Contacts, fine: int, clock: Clock, apart: float | None = None):
        self.contacts = contacts
        self.apart = SHARE * clock.dt / fine if apart is None else apart
        self.moves = contacts.move
        self.count = contacts.count
        self.callback: CallbackLoad | None = None
        if self.moves:
            columns = np.arange(2 * self.count)
            self.callback = CallbackLoad(self._values, "motion of contacts", columns, fine, clock)

    def renewed(self, fine: int, clock: Clock) -> Obstacles:
        """The same for other steps; without values of callables."""
        return Obstacles(self.contacts, fine, clock, self.apart)

    @property
    def known(self) -> bool:
        """Whether no motion is a function of the user."""
        return all(c.motion is None or isinstance(c.motion, Load) for c in self.contacts.contacts)

    def start(self) -> np.ndarray:
        """No impulses and no sums of them, and the obstacles at t = 0: contacts of the core at the
        start."""
        at = np.zeros(2 * self.count)
        if self.callback is not None:
            at = self.callback.near_start_value(0.0)
        none = np.zeros(self.contacts.rows)
        return np.concatenate([none, at, none])

    def _values(self, t: float) -> np.ndarray:
        d, velocity = np.zeros((2, self.count))
        for name, c, begin in zip(
            self.contacts.names, self.contacts.contacts, self.contacts.starts
        ):
            if c.motion is None:
                continue
            part, what = slice(begin, begin + c.rows), f"motion of {name!r} at t = {t:g}"
            if isinstance(c.motion, tuple):
                d[part], velocity[part] = (on_rows(f(t), c.rows, what) for f in c.motion)
            else:
                d[part] = on_rows(c.motion(t), c.rows, what)
                velocity[part] = self._slope(c.motion, t, c.rows, what)
        return np.concatenate([d, velocity])

    def _slope(self, motion: Any, t: float, rows: int, what: str) -> np.ndarray:
        """Difference of order 2; at t = 0 forward, before which a motion need not be defined."""
        h = self.apart
        times = (t, t + h, t + 2.0 * h) if t < h else (t - h, t + h)
        first, second, *third = (on_rows(motion(x), rows, what) for x in times)
        change: np.ndarray = second - first
        if third:
            change = 4.0 * second - 3.0 * first - third[0]
        return change / (2.0 * h)
