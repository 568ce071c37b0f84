"""Prescribed velocities of interface conditions, equation (G1)."""

from __future__ import annotations

import numpy as np

from ..problem.constraints import Constraint
from ..problem.forces import CallbackLoad, SampledForce, is_callback


class Motion:
    """The prescribed velocity of one constraint."""

    def __init__(self, i: int, constraint: Constraint, rows: np.ndarray, fine: int, dt: float):
        self.velocity, self.rows, self.fine, self.dt = constraint.velocity, rows, fine, dt
        self.what = f"velocity of constraint {i}"
        self.known = not is_callback(self.velocity)
        self.callback: CallbackLoad | None = None

    def new_callback(self) -> CallbackLoad:
        order = np.arange(self.rows.size)
        return CallbackLoad(self.velocity, self.what, order, self.fine, self.dt)

    def at(self, t: float) -> np.ndarray:
        if isinstance(self.velocity, np.ndarray):
            return self.velocity
        if self.callback is not None:
            return self.callback.ask_near_start(t)
        return self.velocity(t)

    def value(self) -> np.ndarray:
        """g(0)"""
        return self.at(0.0)

    def slope(self) -> np.ndarray:
        """g'(0)"""
        if isinstance(self.velocity, SampledForce):
            dt = self.velocity.dt
            return (self.velocity(dt) - self.velocity(0.0)) / dt
        if self.known:
            return np.zeros(self.rows.size)
        d = self.dt / self.fine / 16.0
        return (4.0 * self.at(d) - 3.0 * self.at(0.0) - self.at(2.0 * d)) / (2.0 * d)
