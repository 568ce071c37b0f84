"""All loads of a coupler; sampled ones as its steps take them: values, means, what is skipped."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias, TypeGuard, TypeVar

import numpy as np

import pmalpha._core as _core

from .._checks import listing, vector
from ..errors import AccuracyWarning, CallbackError, InstabilityError, LimitError, warn
from ..problem import forms
from ..problem.device import check_first_command
from ..problem.forms import Newton
from ..problem.loads import (
    Force,
    Load,
    Samples,
    core_load,
    functions_of,
    loads_of,
    summed,
)
from ..problem.matrices import product
from ..problem.moving import MovingLoad
from ..problem.sampled import SampledForce
from ..problem.schemes import Scheme, require_generalized_alpha
from ..problem.subdomain import Subdomain
from ..results.quantities import by_index
from ..results.times import Clock
from ..setup.member import Member
from ..setup.ranks import Limited
from ..setup.rows import ConstraintRows, CoreRows
from ..setup.start import InitialAccelerations
from .motion import CallbackLoad, Motion, Obstacles, all_known, reached, values_at_start
from .transfer import Lengths

# ---- means --------------------------------------------------------------------------------------
# Means of a sampled force over the steps of a subdomain, which keep its impulse: (L2) to (L5).

# The mean over a step shorter than this share of the time between samples is its value in the
# middle: the impulse of a sample is then kept within 2 / (pi n)^2 = 1 / 1000, n such steps in it.
SHORT = 1.0 / 16.0


def is_averaged(force: Load) -> TypeGuard[SampledForce]:
    return force.average


def taken_from_start(member: Member, force: Force, clock: Clock) -> Force:
    """A force as the steps of a subdomain take it: averaged ones as means."""
    return tuple(
        Means(load, member, clock, None).force if is_averaged(load) else load._term
        for load in loads_of(force)
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


# ---- loads --------------------------------------------------------------------------------------

# Skipped samples are judged by the motion of an oscillator with a period of this number of
# steps, which a run with these steps is expected to follow, and this damping ratio.
STEPS_IN_PERIOD, DAMPING = 50, 0.05
# Relative change of this motion from which on a Coupler warns. Every second sample of El Centro
# changes it by 0.06, every third one by 0.18; white noise with the frequencies that the steps can
# follow, 1 / (2 h) at most, by 0.03 or less.
SKIPPED = 0.1
# Steps in which a moving load crosses its path: in fewer, most of what it does is not seen.
FEWEST = 4
# Series of a force, those of the largest energy, that are judged.
JUDGED_SERIES = 32
# Samples after the end of a record for which the motion is followed, which takes a period.
MOST_SAMPLES = 1_000_000
Values = TypeVar("Values")  # of a compiled function
# With what means go on, by subdomain and number of the load among those that act together.
Begins: TypeAlias = dict[tuple[int, int], Begin]


# ---- what steps skip ---------------------------------------------------------------------------


def _warn_of_crossings(taken: Sequence[tuple[str, Load, float]]) -> None:
    """AccuracyWarning for loads that cross their path in a few steps, or in none."""
    for name, load, step in taken:
        if isinstance(load, MovingLoad) and load.point.speed != 0.0:
            steps = load.point.length / abs(load.point.speed * step)
            if steps < FEWEST:
                warn(
                    f"{name} crosses its path in {steps:.3g} steps of {step:g}: it acts only where "
                    "it is at the ends of steps; take smaller ones",
                    AccuracyWarning,
                )


def warn_of_skipped(
    members: Sequence[Member],
    forces: Sequence[Force],
    motions: Sequence[Motion] = (),
    fine: float = 0.0,
) -> None:
    """One AccuracyWarning for all sampled loads of which the steps skip what matters.

    fine: time between two interface problems, at which those are evaluated.
    """
    taken: list[tuple[str, Load, float]] = [
        (f"the force on {member.name!r}", f, member.step)
        for member, force in zip(members, forces)
        for f in loads_of(force)
    ]
    taken += [(f"the {motion.what}", motion.load, fine) for motion in motions]
    _warn_of_crossings(taken)
    known: dict[tuple[object, ...], tuple[float, float]] = {}
    texts = []
    for name, force, step in taken:
        samples = force._samples
        if samples is None or force.average or step <= samples.dt:
            continue
        key = step, samples.dt, samples.values.tobytes(), samples.weights.tobytes()
        if key not in known:  # a record acts on many subdomains
            known[key] = skipped(samples, step)
        energy, change = known[key]
        if change > SKIPPED:
            every = f"step {step:g}, samples every {samples.dt:g}"
            texts.append(
                f"{name} ({every}: {energy:.2g} of its energy, {change:.2g} of the motion)"
            )
    if texts:
        warn(
            f"steps skip samples of {listing(texts)}: what the steps see differs from the samples "
            "by this part of their energy, which changes the motion of an oscillator with a period "
            f"of {STEPS_IN_PERIOD} steps by this part of itself; take smaller steps, or, for a "
            "force, average=True, which takes its means over the steps",
            AccuracyWarning,
        )


def skipped(force: Samples, step: float) -> tuple[float, float]:
    """What straight lines between the values at steps change of a sampled force, (L3).

    Returns the energy of the difference, relative to that of the force, and the root mean square
    of the difference of the responses, relative to that of the response.
    """
    f = force.values * (force.weights / (np.abs(force.values).max() or 1.0))
    if f.shape[1] > JUDGED_SERIES:
        f = f[:, np.argsort(np.sum(f * f, axis=0))[-JUDGED_SERIES:]]
    period = STEPS_IN_PERIOD * step
    rest = int(np.ceil(min(period / force.dt, MOST_SAMPLES)))  # the force is over, or held
    f = np.concatenate([f, np.repeat(f[-1:] if force.hold else 0.0 * f[-1:], rest, axis=0)])
    t = force.dt * np.arange(len(f))
    levels = step * np.arange(int(t[-1] / step) + 2)
    lines = np.stack([np.interp(t, levels, np.interp(levels, t, x)) for x in f.T], axis=1)
    both = np.concatenate([f, f - lines], axis=1)
    responses = _motions(both, math.pi * force.dt / period)
    (energy, lost), (response, change) = (
        [float(np.sum(half * half)) for half in np.split(values, 2, axis=1)]
        for values in (both[: len(force.values)], responses)
    )
    return (lost / energy, math.sqrt(change / response)) if energy and response else (0.0, 0.0)


def _motions(f: np.ndarray, x: float) -> np.ndarray:
    """The motion of an oscillator under each column of f, from rest; x = omega dt / 2.

    y'' + 2 zeta omega y' + omega^2 y = f by the trapezoidal rule, without the factor (dt / 2)^2.
    """
    from scipy.linalg.blas import dtbsv

    damping = 2.0 * DAMPING * x
    a = [1.0 + damping + x * x, 2.0 * x * x - 2.0, 1.0 - damping + x * x]
    rows = np.asfortranarray(np.tile(np.array(a)[:, None], len(f)))  # a lower triangle, as a band
    sums = f.copy()
    sums[1:] += 2.0 * f[:-1]
    sums[2:] += f[:-2]
    return np.stack([dtbsv(2, rows, column, lower=1) for column in sums.T], axis=1)


class Loads:
    """The loads of a coupled problem.

    The core evaluates constant and sampled loads and compiled functions. Python callables are
    evaluated ahead of the core and their values stored, so that other loads, or another present
    time, need a new object.

    names: the subdomains as the core numbers them. Default: those of the members.
    obstacles: of contacts.
    begins: with what the means of averaged forces go on; see `next_begins`.
    """

    def __init__(
        self,
        core: _core.Coupler,
        members: Sequence[Member],
        clock: Clock,
        forces: Sequence[Force],
        motions: Sequence[Motion],
        newton: Newton,
        names: Sequence[str] | None = None,
        obstacles: Obstacles | None = None,
        begins: Begins | None = None,
    ):
        self.newton = newton
        self.names = [member.name for member in members] if names is None else names
        self.core, self.members, self.clock = core, members, clock
        fine, self.forces = core.instants, forces
        self.means = {
            (i, k): Means(load, member, clock, (begins or {}).get((i, k)))
            for i, (member, force) in enumerate(zip(members, forces))
            for k, load in enumerate(loads_of(force))
            if is_averaged(load)
        }
        # the terms of the forces as the steps of the subdomains take them
        self.seen = [
            tuple(
                self.means[i, k].force if (i, k) in self.means else load._term
                for k, load in enumerate(loads_of(force))
            )
            for i, force in enumerate(forces)
        ]
        self.motions = [motion.renewed(fine, clock) for motion in motions]
        self.obstacles = None if obstacles is None else obstacles.renewed(fine, clock)
        self.callbacks = {}
        for i, (member, force) in enumerate(zip(members, forces)):
            what = f"force of subdomain {member.name!r}"
            of_time = summed(functions_of(force, "of t"), member.n, what)
            if of_time is not None:
                how = member.order, member.substeps, clock
                self.callbacks[i] = CallbackLoad(of_time, what, *how)
        moved = [motion.callback for motion in self.motions]
        moved += [] if self.obstacles is None else [self.obstacles.callback]
        self.stored = [*self.callbacks.values(), *(x for x in moved if x is not None)]

    def renewed(self, forces: Sequence[Force] | None = None) -> Loads:
        """These loads, or others, without stored values of callables."""
        return self.with_steps(self.core, self.members, self.clock, forces)

    def with_steps(
        self,
        core: _core.Coupler,
        members: Sequence[Member],
        clock: Clock,
        forces: Sequence[Force] | None = None,
        begins: Begins | None = None,
    ) -> Loads:
        """The same loads, or others, for other steps; without stored values of callables."""
        forces = self.forces if forces is None else forces
        constants = self.motions, self.newton, self.names, self.obstacles
        return Loads(core, members, clock, forces, *constants, begins)

    @property
    def begins(self) -> Begins:
        """With what the means of averaged forces went on where steps changed."""
        return {place: means.begin for place, means in self.means.items() if means.goes_on}

    def begin_arrays(self, first: int) -> dict[str, np.ndarray]:
        """The same for a checkpoint; `first` is the number of the first subdomain."""
        return {_means_array(first + i, k): begin.array() for (i, k), begin in self.begins.items()}

    def begins_of(
        self, arrays: Mapping[str, np.ndarray], first: int, low: int, high: int
    ) -> Begins:
        """The inverse; ValueError for wrong arrays, and for steps that did not change at one of the
        macro steps from `low` to `high`."""
        begins: Begins = {}
        for (i, k), means in self.means.items():
            name = _means_array(first + i, k)
            if name in arrays:
                begins[i, k] = Begin.of_array(arrays[name], means.original.values.shape[1])
                if not low <= begins[i, k].step <= high:
                    raise ValueError(f"{name} has steps that change at {begins[i, k].step}")
        return begins

    def next_begins(
        self, step: int, members: Sequence[Member], lengths: Callable[[int], Any]
    ) -> Begins:
        """The same for these members from a macro step on; `lengths` of their variables a."""
        begins = {
            (i, k): means.next(step, members[i], lengths(i)) for (i, k), means in self.means.items()
        }
        return {place: begin for place, begin in begins.items() if begin is not None}

    def moved_to(self, core: _core.Coupler, members: Sequence[Member]) -> Loads:
        """The same loads for other objects of the core, with the same steps and stored values."""
        moved = copy(self)
        moved.core, moved.members = core, members
        moved.to_core()
        return moved

    @property
    def has_functions(self) -> bool:
        """Whether there are functions of the user, which only `run` and `step` may evaluate."""
        return (
            any(x._kind != "known" for force in self.forces for x in loads_of(force))
            or not all_known(self.motions)
            or (self.obstacles is not None and not self.obstacles.known)
            or any(member.subdomain.has_functions for member in self.members)
            or any(
                member.internal is not None and member.internal.functions for member in self.members
            )
        )

    @property
    def iterates(self) -> bool:
        """Whether the core factors tangents, or the W of contacts, while it steps."""
        return self.obstacles is not None or any(
            member.tangent is not None for member in self.members
        )

    def to_core(self) -> None:
        """Give the core all loads but those of callables, which `prepare` gives it."""
        for member, force in zip(self.members, self.seen):
            if member.feedback is not None:
                functions = functions_of(force, "of t, u and v")
                member.feedback.function = summed(functions, member.n, member.feedback.what)
            member.core.set_load(core_load(force, member.order))
        for i, motion in enumerate(self.motions):
            if motion.known:
                self.core.set_motion(i, motion.core_load())
        if self.obstacles is not None and not self.obstacles.moves:
            self.core.set_obstacle(None)

    # ---- ahead of the core -------------------------------------------------------------------

    @property
    def bytes_per_macro_step(self) -> int:
        """Bytes of the values of all callables for one macro step."""
        return sum(callback.bytes_per_macro_step for callback in self.stored)

    def prepare(self, begin: int, end: int) -> tuple[int, BaseException | None]:
        """Evaluate the callables for the macro steps begin..end-1 and give the core the values.

        Returns the macro step up to which all loads are evaluated, and the exception of a callable
        if that is before `end`.
        """
        first_failure = None
        for callback in self.stored:
            end, failure = callback.prepare(begin, end)
            first_failure = failure if failure is not None else first_failure
        for i, callback in self.callbacks.items():
            table, order = forms.Table(callback.rows, callback.first), self.members[i].order
            self.members[i].core.set_load(core_load(self.seen[i], order, [table]))
        for i, motion in enumerate(self.motions):
            if motion.callback is not None:
                rows = motion.in_core(motion.callback.rows)
                self.core.set_motion(i, forms.Table(rows, motion.callback.first))
        if self.obstacles is not None and self.obstacles.callback is not None:
            callback = self.obstacles.callback
            self.core.set_obstacle(forms.Table(callback.rows, callback.first))
        return end, first_failure

    def motion_values(self, begin: int, end: int) -> list[bytes]:
        """The evaluated prescribed velocities of macro steps begin..end-1."""
        rows = [
            motion.callback.rows[begin * motion.fine - motion.callback.first :][
                : (end - begin) * motion.fine
            ]
            for motion in self.motions
            if motion.callback is not None
        ]
        return [values.tobytes() for values in rows]

    # ---- at one time, in elimination order ----------------------------------------------------

    def at_start(self, i: int, step: int = 0) -> np.ndarray:
        """F(0) of a subdomain; `step` is the present macro step, for errors.

        Without a force that depends on the motion, which is one of the terms of the motion.
        """
        of_time = self.callbacks[i].near_start_value(0.0) if i in self.callbacks else None
        return self._sum(i, 0.0, step, of_time)

    def static(self, i: int, motion: tuple[np.ndarray, np.ndarray], step: int) -> np.ndarray:
        """The same, with a force that depends on the motion at (u, v), in elimination order."""
        member = self.members[i]
        if member.feedback is None or member.feedback.function is None:
            return self.at_start(i, step)
        u, v = motion
        result: np.ndarray = member.feedback(0.0, u.copy(), v.copy())[member.order]
        return result

    def at_present(self, i: int) -> np.ndarray:
        """F of a subdomain at the present time."""
        step, member = self.core.step_count, self.members[i]
        if step == 0:
            return self.at_start(i)
        of_time = None
        if i in self.callbacks:
            of_time = self.callbacks[i].value_at(self.clock.count(step) * member.substeps)
        return self._sum(i, self.clock.time(step), step, of_time)

    def _sum(self, i: int, t: float, step: int, of_time: np.ndarray | None) -> np.ndarray:
        """All loads of a subdomain at one time, with the value of those that are callables of t."""
        member = self.members[i]
        values = [] if of_time is None else [of_time]
        loads = loads_of(self.seen[i])
        known = [x for x in loads if x._kind == "known"]
        values += [force_at(tuple(known), member, t)] if known else []
        if any(x._kind == "compiled" for x in loads):
            values.append(self._values(member.core.force(t), "force", i, step))
        return sum(values[1:], values[0]) if values else np.zeros(member.n)

    def evaluate_present(self, i: int) -> None:
        """Let the core evaluate the internal forces of a subdomain at the present time."""
        step, core = self.core.step_count, self.members[i].core
        self._values(core.evaluate_present(self.clock.time(step)), "internal force", i, step)

    def terms_of_motion(
        self, states: Sequence[tuple[np.ndarray, np.ndarray]]
    ) -> list[list[np.ndarray]]:
        """For each subdomain the terms of r in (S1) without F(0): -C v, -K u, -r(0, u, v)."""
        with np.errstate(over="ignore", invalid="ignore"):  # seen in the accelerations
            terms = [
                [-product(member.C, v), -product(member.K, u)]
                for member, (u, v) in zip(self.members, states)
            ]
        for i, (member, (u, v)) in enumerate(zip(self.members, states)):
            s = member.subdomain
            if s.limits is not None:
                check_first_command(s.limits, member.name, u[member.position], v[member.position])
            if (
                s.restoring is not None
                or member.internal is not None
                or member.feedback is not None
            ):
                r = self._values(first_answer(member, u, v), "restoring force", i, 0)
                terms[i].append(-r)
        return terms

    def _values(self, values: Values | int, what: str, i: int, step: int) -> Values:
        """The values of a compiled function; CallbackError if it returned a code."""
        if isinstance(values, int):
            raise CallbackError(values, what, step, self.clock.time(step), self.members[i].name)
        return values


def first_answer(member: Member, u: np.ndarray, v: np.ndarray) -> np.ndarray | int:
    """r(0, u, v), or the code that a function returned; LimitError for a force beyond its limit."""
    r = member.core.restoring(0.0, u, v)
    if isinstance(r, dict):
        raise limit_error(member, r)
    return r


def limit_error(member: Member, failed: Limited) -> LimitError:
    dof = None if failed["what"] == "energy" else int(member.order[failed["position"]])
    numbers = failed["value"], failed["limit"], failed["t"]
    return LimitError(member.name, failed["what"], dof, *numbers, failed["by_clock"])


def force_at(force: Force, member: Member, t: float) -> np.ndarray:
    """Loads that are no functions, at one time in elimination order."""
    values = [x(t)[member.order] for x in loads_of(force)]
    return sum(values[1:], values[0]) if values else np.zeros(member.n)


def _means_array(i: int, k: int) -> str:
    """The name in a checkpoint of the means of load k on subdomain i."""
    return f"{i}.means" + (f".{k}" if k else "")


# ---- initial values -----------------------------------------------------------------------------
# The initial values of a coupled problem, and the start from them.


class StartValues(NamedTuple):
    """What a run starts from."""

    states: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    # lam, g: (p,) arrays, multipliers and prescribed velocities
    lam: np.ndarray
    g: np.ndarray

    @property
    def end_multipliers(self) -> np.ndarray:
        """Those of the accelerations under mean coupling, twice, and two lengths of steps."""
        return np.concatenate([self.lam, self.lam, np.zeros(2)])


class AtStart(NamedTuple):
    """What acts at t = 0 beside the loads: forces in elimination order, velocities of all rows."""

    forces: list[np.ndarray]
    velocities: np.ndarray


class InitialValues:
    """Displacements and velocities of all subdomains at t = 0.

    u0, v0: values by subdomain that replace those of the `Subdomain`.
    values: list of (u, v), (n_i,) each, in the user's order.
    """

    def __init__(
        self,
        keys: Sequence[tuple[str, Subdomain]],
        rows: ConstraintRows,
        u0: Mapping[Any, Any] | None = None,
        v0: Mapping[Any, Any] | None = None,
    ):
        self.rows = rows
        u, v = (_chosen(values, keys, name) for name, values in (("u0", u0), ("v0", v0)))
        self.values = list(zip(u, v))

    def check(self, motions: Sequence[Motion], *, tied: bool = False) -> None:
        """Check against the constraints, except those with a callable velocity. With `tied` the
        displacements are constrained too."""
        if all_known(motions):
            self._check_velocities(motions)
        displacements = [u for u, _ in self.values]
        contacts = self.rows.contacts
        if contacts is not None and not contacts.move:
            contacts.check_gaps(displacements, np.zeros(contacts.count))
        if tied:
            self.rows.check_displacements(displacements, [motion.rows for motion in motions])
        else:
            self.rows.warn_of_displacements(displacements)

    def _check_velocities(self, motions: Sequence[Motion]) -> None:
        g, p = values_at_start(motions, self.rows.p), self.rows.p
        self.rows.check_velocities([v for _, v in self.values], g, lambda: reached(motions, p))

    def start(
        self,
        core: _core.Coupler,
        members: Sequence[Member],
        loads: Loads,
        rows: CoreRows,
        solver: InitialAccelerations | None,
        extra: AtStart | None = None,
    ) -> InitialAccelerations:
        """Set consistent initial values (S1) in the core, which changes in the last lines only.

        Returns the solver of the initial accelerations, created here if it is None.
        """
        ranks = self.rows.ranks
        solver = solver or InitialAccelerations(members, rows.p, rows.numbers, ranks)
        start = self.consistent(members, loads, rows, solver, extra)
        numbers = {"end_multipliers": start.end_multipliers} | self._contact(loads)
        for member, state in zip(members, start.states):
            member.core.start(*state, start.lam)
            member.reported = member.slowed = False
        core.start(0, start.lam, start.g)
        core.set_numbers(core.numbers() | numbers)
        return solver

    def _contact(self, loads: Loads) -> dict[str, np.ndarray]:
        """What the core has of contacts at t = 0; ConstraintError for gaps that are closed."""
        if loads.obstacles is None:
            return {}
        contacts, start = loads.obstacles.contacts, loads.obstacles.start()
        d = start[contacts.rows :][: contacts.count]
        contacts.check_gaps([u for u, _ in self.values], d)
        return {"contact": start}

    def consistent(
        self,
        members: Sequence[Member],
        loads: Loads,
        rows: CoreRows,
        solver: InitialAccelerations,
        extra: AtStart | None = None,
    ) -> StartValues:
        """Consistent initial values (S1), in elimination order."""
        states = self.in_order(members)
        forces = [loads.at_start(i) for i in range(len(members))]
        g = values_at_start(loads.motions, rows.p)
        if extra is not None:
            forces = [F + force for F, force in zip(forces, extra.forces)]
            g = g + extra.velocities
        terms = [[F, *parts] for F, parts in zip(forces, loads.terms_of_motion(states))]
        g = rows.jumps_in_core(g)
        slope = rows.jumps_in_core(values_at_start(loads.motions, rows.p, slopes=True))
        if not all_known(loads.motions):
            self._check_velocities(loads.motions)
        if self.rows.ranks is not None:
            self.rows.ranks.require_equal("a prescribed velocity", (g.tobytes(), slope.tobytes()))
        accelerations, lam = solver.solve(terms, slope)
        for member, w in zip(members, accelerations):
            if not np.all(np.isfinite(w)):
                raise InstabilityError(0, 0.0, member.name)
        # under mean coupling w is without the acceleration of the multipliers
        free = [
            w - member.core.accelerate(lam) if member.mean else w
            for member, w in zip(members, accelerations)
        ]
        return StartValues([(u, v, w) for (u, v), w in zip(states, free)], lam, g)

    def in_order(self, members: Sequence[Member]) -> list[tuple[np.ndarray, np.ndarray]]:
        """(u, v) of each subdomain in elimination order."""
        return [(u[member.order], v[member.order]) for member, (u, v) in zip(members, self.values)]


def consistent_in_lanes(
    initials: Sequence[InitialValues],
    forces: Sequence[Sequence[Force]],
    loads: Loads,
    rows: CoreRows,
    solver: InitialAccelerations,
) -> StartValues:
    """Consistent initial values (S1) of several cases without functions, in elimination order.

    Bitwise those of `InitialValues.consistent`, in a column for each case.

    initials: what is computed of one that several cases share is computed once.
    loads: with the prescribed velocities of all cases.
    """
    members, p = loads.members, rows.p
    states = {initial: initial.in_order(members) for initial in dict.fromkeys(initials)}
    moving = {initial: loads.terms_of_motion(state) for initial, state in states.items()}
    u, v = (
        [columns([states[initial][i][k] for initial in initials]) for i in range(len(members))]
        for k in range(2)
    )
    terms = []
    for i, member in enumerate(members):
        parts = zip(*(moving[initial][i] for initial in initials))
        F = columns([force_at(of_case[i], member, 0.0) for of_case in forces])
        terms.append([F, *map(columns, parts)])
    g = rows.jumps_in_core(values_at_start(loads.motions, p))
    slope = rows.jumps_in_core(values_at_start(loads.motions, p, slopes=True))
    w, lam = solver.solve_columns(terms, slope)
    for member, w_i in zip(members, w):
        if not np.all(np.isfinite(w_i)):
            raise InstabilityError(0, 0.0, member.name)
        if member.mean:
            w_i -= columns([member.core.accelerate(x) for x in np.ascontiguousarray(lam.T)])
    return StartValues(list(zip(u, v, w)), lam, columns([g] * len(initials)))


def columns(vectors: Sequence[np.ndarray]) -> np.ndarray:
    """(n, k) array of k vectors."""
    return np.ascontiguousarray(np.array(vectors).T)


def _chosen(argument: Any, keys: Sequence[tuple[str, Subdomain]], name: str) -> list[np.ndarray]:
    """`u0` or `v0` of each subdomain: the given values, else those of the `Subdomain`."""
    values = {} if argument is None else by_index(argument, keys, name)
    return [
        vector(values[i], s.n, f"{name} of {key!r}") if i in values else getattr(s, name)
        for i, (key, s) in enumerate(keys)
    ]
