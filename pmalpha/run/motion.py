"""Prescribed velocities of interface constraints, equation (G1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..problem.forces import Force, SampledForce, core_load, is_callback
from ..results.clock import Clock
from ..setup.constraint_rows import ConstraintRows
from ..setup.schedule import Rows
from .callback import CallbackLoad


class Motion:
    """The prescribed velocity of one constraint.

    Parameters
    ----------
    velocity : array, SampledForce or callable
    what : str
        Its name in messages, such as "velocity of constraint 0".
    rows : array of int
        Its rows among all constraints.
    scale : array
        Of these rows, by which the core has them divided.
    fine : int
        Interface problems per macro step.
    clock : Clock
    apart : float, optional
        Time between the values of a callable of which g'(0) is made. Default: 1/16 of a fine step.
    """

    def __init__(
        self,
        velocity: Force,
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
        if is_callback(velocity):
            self.callback = CallbackLoad(velocity, what, np.arange(rows.size), fine, clock)

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

    def core_load(self) -> Any:
        """g that is no Python callable, in a form of the core."""
        load = core_load(self.velocity, np.arange(self.rows.size))
        if isinstance(load, np.ndarray):
            return self.in_core(load)
        values, shape, *how = load
        if shape is None:
            return (self.in_core(values), None, *how)
        return (values, self.in_core(shape), *how)

    def at(self, t: float) -> np.ndarray:
        """g(t) for the initial values."""
        if self.callback is not None:
            return self.callback.near_start_value(t)
        if isinstance(self.velocity, np.ndarray):
            return self.velocity
        assert isinstance(self.velocity, SampledForce)
        return self.velocity(t)

    def value(self) -> np.ndarray:
        """g(0)"""
        return self.at(0.0)

    def slope(self) -> np.ndarray:
        """g'(0)"""
        if isinstance(self.velocity, SampledForce):
            dt = self.velocity.dt
            result: np.ndarray = (self.velocity(dt) - self.velocity(0.0)) / dt
            return result
        if self.known:
            return np.zeros(self.rows.size)
        d = self.apart
        result = (4.0 * self.at(d) - 3.0 * self.at(0.0) - self.at(2.0 * d)) / (2.0 * d)
        return result


def motions_of(
    constraints: Sequence[Rows], rows: ConstraintRows, fine: int, clock: Clock
) -> list[Motion]:
    """The prescribed velocities of the constraints that have one."""
    return [
        Motion(c.velocity, f"velocity of constraint {i}", own, rows.scale[own], fine, clock)
        for i, (c, own) in enumerate(zip(constraints, map(rows.of, range(len(constraints)))))
        if c.velocity is not None
    ]


def all_known(motions: Sequence[Motion]) -> bool:
    """Whether no prescribed velocity is a callable, which only `run` and `step` may evaluate."""
    return all(motion.known for motion in motions)


def values_at_start(motions: Sequence[Motion], p: int) -> np.ndarray:
    """g(0), (p,), in the user's order of rows; 0 in rows without prescribed velocity."""
    g = np.zeros(p)
    for motion in motions:
        g[motion.rows] = motion.value()
    return g


def slopes_at_start(motions: Sequence[Motion], p: int) -> np.ndarray:
    """g'(0), (p,), in the same order."""
    slopes = np.zeros(p)
    for motion in motions:
        slopes[motion.rows] = motion.slope()
    return slopes
