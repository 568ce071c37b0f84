"""Means of a sampled force over the steps of a subdomain, which keep its impulse: (L2) to (L5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from ..problem.forces import Force, SampledForce, terms_of
from ..problem.schemes import Scheme, require_generalized_alpha
from ..results.clock import Clock
from ..setup.member import Member
from .transfer import Lengths

# The mean over a step shorter than this share of the time between samples is its value in the
# middle: the impulse of a sample is then kept within 2 / (pi n)^2 = 1 / 1000, n such steps in it.
SHORT = 1.0 / 16.0


def is_averaged(force: Any) -> TypeGuard[SampledForce]:
    return isinstance(force, SampledForce) and force.average


def taken_from_start(member: Member, force: Force, clock: Clock) -> Force:
    """A force as the steps of a subdomain take it: averaged ones as means."""
    return tuple(
        Means(x, member, clock, None).force if is_averaged(x) else x for x in terms_of(force)
    )


class FreeMass(NamedTuple):
    """A free unit mass under the means at a time level: its motion in each series, (k,) arrays."""

    w: np.ndarray  # its acceleration: the mean at this level
    delta: np.ndarray  # a - w
    v: np.ndarray
    made: float  # the length of the step to which a belongs, (Q1)

    def stretched(self, length: float) -> FreeMass:
        """(Q1)  a - w for steps of another length"""
        return self._replace(delta=length / self.made * self.delta, made=length)

    def final(self, scheme: Scheme, h: float) -> np.ndarray:
        """(L4)  v after further steps of length h without a force"""
        theta, rest = weights(scheme)
        result: np.ndarray = self.v + h * (theta * self.w + rest * self.delta)
        return result

    def after(self, scheme: Scheme, mean: np.ndarray, h: float) -> FreeMass:
        """The next time level: (9), and (6) and (8) for v."""
        am, af = scheme.am, scheme.af
        delta = ((am - af) * (mean - self.w) - am * self.delta) / (1.0 - am)
        old, new = self.w + self.delta, mean + delta
        v = self.v + h * ((1.0 - scheme.gamma) * old + scheme.gamma * new)
        return FreeMass(mean, delta, v, h)


def weights(scheme: Scheme) -> tuple[float, float]:
    """theta, which is 1/2 for schemes of second order, and theta - af, equation (L4)."""
    rest = 1.0 - scheme.gamma - scheme.am
    return scheme.af + rest, rest


@dataclass(frozen=True)
class Begin:
    """With what the means of a force go on where steps change."""

    step: int  # the macro step of the change
    over: float | None  # the length of a double step over it, (Q3)
    # the present and, where a double step begins there, the time level before
    levels: tuple[FreeMass, ...]

    def array(self) -> np.ndarray:
        """All of it in one array, for a checkpoint."""
        levels = [np.concatenate([*x[:3], [x.made]]) for x in self.levels]
        return np.concatenate([[self.step, self.over or 0.0], *levels])

    @classmethod
    def of_array(cls, x: np.ndarray, series: int) -> Begin:
        """The inverse; ValueError for another number of series."""
        levels = x[2:].reshape(-1, 3 * series + 1) if x.ndim == 1 else x
        if x.ndim != 1 or len(levels) not in (1, 2) or not np.all(np.isfinite(x)):
            raise ValueError(f"{x.size} numbers are not those of the means of {series} series")
        made = []
        for row in levels:
            w, delta, v = np.split(row[:-1], 3)
            made.append(FreeMass(w, delta, v, float(row[-1])))
        return cls(int(x[0]), float(x[1]) or None, tuple(made))


class Means:
    """The means that a subdomain takes at its time levels since the start, or a change of steps.

    begin: with what they go on; None at the start, and between steps that take values.
    """

    def __init__(self, force: SampledForce, member: Member, clock: Clock, begin: Begin | None):
        self.original, self.scheme = force, member.subdomain.scheme
        require_generalized_alpha(self.scheme, "a force with average=True", member.name)
        self.h, self.substeps = member.h, member.substeps
        self.double, self.step = member.double, member.step
        self.integral = Integral(force)
        self.values = begin is None and member.step < SHORT * force.dt
        self.from_rest = begin is None and clock.origin == 0
        self.begin = begin or Begin(clock.origin, member.over, ())
        self.t = clock.time(self.begin.step)
        self.levels = {} if self.values else self._first_levels()
        self.table = np.empty((0, 0)) if self.values else self._table()

    @property
    def force(self) -> SampledForce:
        """The means as a force that is linear between the time levels; or the force itself."""
        if self.values:
            return self.original
        return self.original._changed(values=self.table, dt=self.h, average=False, _begin=self.t)

    @property
    def goes_on(self) -> bool:
        """Whether there were other steps before."""
        return bool(self.begin.levels)

    def next(self, step: int, member: Member, lengths: Lengths) -> Begin | None:
        """With what the means for other steps of this subdomain go on from a macro step.

        lengths: to which the variables a will belong, (Q1).
        """
        if self.values and member.step < SHORT * self.original.dt:
            return None
        level = (step - self.begin.step) * self.substeps
        levels = [self._at(level).stretched(lengths.present)]
        if member.double and member.over is not None:
            levels.append(self._at(level - 1).stretched(lengths.previous))
        return Begin(step, member.over, tuple(levels))

    # ---- inside ------------------------------------------------------------------------------

    def _lengths(self, level: int) -> tuple[int, float, float]:
        """The level from which a step leads to this one, its length, and the length of the longest
        step that begins at this level."""
        h, twice = self.h, 2.0 * self.h
        if not self.double:
            return level - 1, h, h
        if self.begin.over is not None:
            return level - 2, self.begin.over if level == 1 else twice, twice
        if level > self.substeps:
            return level - 2, twice, twice
        return level - 1, h, twice if level >= self.substeps - 1 else h

    def _first_levels(self) -> dict[int, FreeMass]:
        """The levels up to those after which all steps are of one length, by (L5)."""
        theta, _ = weights(self.scheme)
        numbers = (0, -1) if self.begin.over is not None else (0,)
        levels = dict(zip(numbers, self.begin.levels or map(self._undisturbed, numbers)))
        for level in range(1, self.substeps + 3 if self.double else 2):
            origin, h, longest = self._lengths(level)
            before = levels[origin]
            if not self.from_rest:  # the first double steps from rest take a as it is
                before = before.stretched(h)
            lack = self.integral(self.t + level * self.h + theta * longest)
            lack = lack - before.final(self.scheme, h)
            levels[level] = before.after(self.scheme, lack / (h + theta * (longest - h)), h)
        return levels

    def _undisturbed(self, level: int) -> FreeMass:
        """A level among steps of one length, or the start."""
        theta, rest = weights(self.scheme)
        t, h = self.t + level * self.h, self.step
        if self.from_rest and level == 0:
            longest = self._lengths(0)[2]
            w = self._mean(0.0, max(theta * longest, 0.0))
            return FreeMass(w, 0.0 * w, 0.0 * w, longest)
        end = t + theta * h
        before, w = self._mean(end - 2.0 * h, end - h), self._mean(end - h, end)
        delta = (self.scheme.am - self.scheme.af) * (w - before)  # (9), where w is a line
        return FreeMass(w, delta, self.integral(end) - h * (theta * w + rest * delta), h)

    def _mean(self, begin: float, end: float) -> np.ndarray:
        """The mean of the samples, linear between them, over an interval; (k,)."""
        begin = max(begin, 0.0)
        if not end > begin:
            first: np.ndarray = self.original.values[0]
            return first
        result: np.ndarray = (self.integral(end) - self.integral(begin)) / (end - begin)
        return result

    def _table(self) -> np.ndarray:
        """The means at all time levels from `t` to one after the end of the record."""
        f, last = self.original, max(self.levels)
        end = (len(f.values) - 1) * f.dt + self.step - self.t
        count = max(last, int(np.ceil(max(end, 0.0) / self.h))) + 2
        theta, _ = weights(self.scheme)
        ends = self.t + self.h * np.arange(count) + theta * self.step
        table: np.ndarray = (self.integral(ends) - self.integral(ends - self.step)) / self.step
        for level in range(last + 1):
            table[level] = self.levels[level].w
        return table

    def _at(self, level: int) -> FreeMass:
        """The motion at any level."""
        if self.values:
            return self._undisturbed(level)
        last = max(self.levels)
        if level <= last:
            return self.levels[level]
        stride = 2 if self.double else 1
        start = last - (level - last) % stride
        theta, rest = weights(self.scheme)
        w, delta = self._after_first(self.levels[start], start, level, stride)
        v = self.integral(self.t + level * self.h + theta * self.step)
        return FreeMass(w, delta, v - self.step * (theta * w + rest * delta), self.step)

    def _after_first(
        self, start: FreeMass, first: int, level: int, stride: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """w and a - w at a level after steps of one length, by (9)."""
        from scipy.linalg.blas import dtbsv

        am, af = self.scheme.am, self.scheme.af
        rows = self.table[first : level + 1 : stride]
        decay = -am / (1.0 - am)
        jumps = (am - af) / (1.0 - am) * np.diff(rows, axis=0)
        delta = start.delta
        if len(jumps):
            jumps[0] += decay * delta
            band = np.asfortranarray(np.tile([[1.0], [-decay]], len(jumps)))  # a lower triangle
            delta = np.array([dtbsv(1, band, jump, lower=1)[-1] for jump in jumps.T])
        behind = (level - first) // stride - len(jumps)  # levels after the end of the table
        w = rows[-1] if behind == 0 or self.original.hold else 0.0 * rows[-1]
        return w, decay**behind * delta


class Integral:
    """The integral of all series of a force from 0 to t >= 0, exact but for rounding."""

    def __init__(self, force: SampledForce):
        self.f, self.dt, self.hold = force.values, force.dt, force.hold
        self.sums = np.zeros_like(self.f)
        self.sums[1:] = self.dt * np.cumsum(0.5 * (self.f[:-1] + self.f[1:]), axis=0)

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """At times (m,) or one: (m, k) or (k,); 0 before t = 0."""
        times = np.atleast_1d(np.maximum(t, 0.0))
        last = len(self.f) - 1
        x = np.minimum(times / self.dt, last)
        j = np.minimum(x.astype(np.int64), max(last - 1, 0))
        s = (x - j)[:, None]
        f, after = self.f[j], self.f[np.minimum(j + 1, last)]
        total = self.sums[j] + self.dt * s * (f + 0.5 * s * (after - f))
        if self.hold:
            total += np.maximum(times - last * self.dt, 0.0)[:, None] * self.f[last]
        result: np.ndarray = total if np.ndim(t) else total[0]
        return result
