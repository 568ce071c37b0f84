"""The state of a coupler for other steps: equations (Q1) and (Q2) of docs/method.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..results.times import Clock, clock_of
from ..setup.assembly import Assembly
from ..setup.member import Member
from ..setup.schedule import Layout

# What the arrays of the level before have in front of their names.
PREVIOUS = "previous_"


@dataclass(frozen=True)
class Steps:
    """The steps of a coupler since they changed."""

    layout: Layout
    clock: Clock
    # of the macro step after a change, if it is still to come and there are double steps: they span
    # the change, or begin anew. None from then on.
    first: Layout | None = None

    @property
    def present(self) -> Layout:
        """The layout of the next macro step."""
        return self.layout if self.first is None else self.first

    def changed(self, layout: Layout, step: int) -> Steps:
        """These steps, changed to others at a macro step; the double steps of both are known."""
        if step == 0:
            return Steps(layout, clock_of(layout))
        old = self.clock
        before = old.before if old.count(step) == 0 else old.dt
        clock = Clock(layout.dt, step, old.time(step), before)
        if not any(layout.doubles):
            return Steps(layout, clock)
        between = [self.lengths(i, step).between for i in range(len(layout.substeps))]
        overs = tuple(
            time + layout.dt if double and count == 1 and time is not None else None
            for time, double, count in zip(between, layout.doubles, layout.substeps)
        )
        spans = any(over is not None for over in overs)
        return Steps(layout, clock, replace(layout, overs=overs) if spans else layout)

    def lengths(self, i: int, step: int) -> Lengths:
        """The lengths that the variables a of subdomain i of all have at macro step `step`."""
        h, count, double, over = self.present.of(i)
        done = self.clock.count(step)
        if not double or done == 0:
            return Lengths(h, h, None) if over is None else Lengths(2.0 * h, over, over - h)
        if self.clock.origin == 0 and done == 1:
            return Lengths(h, h, h)
        if self.clock.origin == 0 and done == 2 and count == 1:
            return Lengths(2.0 * h, h, h)
        return Lengths(2.0 * h, 2.0 * h, h)

    def lengths_after_first(self, i: int) -> Lengths:
        """The same after the first macro step, before the regular steps are taken over."""
        h, _, _, over = self.present.of(i)
        return Lengths(h, h, h) if over is None else Lengths(over, 2.0 * h, h)


class Lengths(NamedTuple):
    """The steps that made the variables a of a subdomain, or for which (Q1) changed them."""

    # present, previous: at the present time level, and at the one before in a subdomain with double
    # steps
    present: float
    previous: float
    # time between these two; None where there is no previous level that a step can start from
    between: float | None


class Move(NamedTuple):
    """What a subdomain continues with, in the form of the core."""

    levels: dict[str, np.ndarray]
    rebased: bool  # the stored free velocity is made anew, (Q2)
    twice: bool  # ... with the operator of the double step
    scale: float | None  # of iterations


def moves(
    old: Assembly,
    new: Assembly,
    made: Callable[[int], Lengths],
    wanted: Callable[[int], Lengths],
    *,
    first: bool,
) -> list[Move]:
    """The state of each subdomain for other steps; nothing is changed yet.

    old, new: with the present state, and the one that continues.
    made, wanted: the lengths of the variables a, and those of the steps to come, by subdomain of
        all.
    first: the next macro step is the first after a change: double steps begin unless they span it.
    """
    states = []
    for i, (o, n) in enumerate(zip(old.members, new.members), new.first):
        levels = _levels(o, n, made(i), wanted(i))
        iteration = o.core.iteration()
        rebased = o.double or n.double or o.h != n.h
        scale = None if iteration is None else iteration["scale"]
        states.append(Move(levels, rebased, n.is_double(start=first), scale))
    return states


def _levels(o: Member, n: Member, made: Lengths, wanted: Lengths) -> dict[str, np.ndarray]:
    levels = o.core.levels()
    present = {name: x for name, x in levels.items() if not name.startswith(PREVIOUS)}
    result = _stretched(present, wanted.present / made.present)
    if not n.double:
        return result
    previous = present  # no step starts from it
    if o.double and made.between is not None:
        previous = {name: levels[PREVIOUS + name] for name in present}
    previous = _stretched(previous, wanted.previous / made.previous)
    return result | {PREVIOUS + name: x for name, x in previous.items()}


def _stretched(level: dict[str, np.ndarray], factor: float) -> dict[str, np.ndarray]:
    """(Q1)  a := w + (h_new / h_a)(a - w)"""
    if factor == 1.0:
        return level
    w, a = level["w"], level["a"]
    return level | {"a": w + factor * (a - w)}


def take_over(
    old: Assembly, new: Assembly, states: list[Move], clock: Clock, before: Clock
) -> None:
    """The present of `old` becomes that of `new`, whose steps are those of the clock; the old ones
    are those of the clock `before`."""
    lam, g, step = old.core.multipliers, old.core.prescribed, old.core.step_count
    numbers = old.core.numbers()
    for o, n, move in zip(old.members, new.members, states):
        functions = o.core.functions(before.count(step))
        n.core.set_levels(move.levels)
        if functions is not None:
            n.core.set_functions(clock.count(step), functions)
        if move.rebased:
            n.core.rebase(move.twice, lam)
        if move.scale is not None and (o is not n or move.rebased):
            n.core.set_iteration({"scale": move.scale, "entries": None, "twice": False})
    new.core.set_origin(clock.origin, clock.t0)
    new.core.start(step, lam, g)
    if "shooting" in numbers:
        shooting, begun = numbers["shooting"], new.core.numbers()["shooting"]
        begun[0] = shooting[0]
        ratio = clock.dt / clock.before if clock.count(step) == 0 and clock.before > 0.0 else 1.0
        begun[1 : 1 + lam.size] = ratio * shooting[1 : 1 + lam.size]  # the last increment of Lam
        numbers["shooting"] = begun
    new.core.set_numbers(numbers)


def follow_energies(old: Assembly, new: Assembly) -> None:
    """Works that are summed up go on."""
    replaced = [(o, n) for o, n in zip(old.members, new.members) if o is not n]
    for o, n in replaced:
        n.core.follow_energy(o.core)
    for o, _ in replaced:
        o.core.end_energy()
