"""Obstacles that move: displacement and velocity of the other side of contacts, (U1)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..problem.forces import SampledForce
from ..problem.unilateral import on_rows
from ..results.clock import Clock
from ..setup.contact_rows import Contacts
from .callback import CallbackLoad

# A velocity that is not given is a difference over this part of a fine step.
SHARE = 0.01


class Obstacles:
    """d and d' of all contact rows at fine steps, evaluated ahead of the core.

    Parameters
    ----------
    contacts : Contacts
    fine : int
        Fine steps per macro step.
    clock : Clock
    apart : float, optional
        Time over which differences are taken. Default: a hundredth of a fine step.
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
        return all(
            c.motion is None or isinstance(c.motion, SampledForce) for c in self.contacts.contacts
        )

    def start(self) -> np.ndarray:
        """No impulses, and the obstacles at t = 0: contacts of the core at the start."""
        at = (
            np.zeros(2 * self.count)
            if self.callback is None
            else (self.callback.near_start_value(0.0))
        )
        return np.concatenate([np.zeros(self.contacts.rows), at])

    def _values(self, t: float) -> np.ndarray:
        d, velocity = np.zeros((2, self.count))
        for name, c, begin in zip(
            self.contacts.names, self.contacts.contacts, self.contacts.starts
        ):
            if c.motion is None:
                continue
            own, what = slice(begin, begin + c.rows), f"motion of {name!r} at t = {t:g}"
            if isinstance(c.motion, tuple):
                d[own], velocity[own] = (on_rows(f(t), c.rows, what) for f in c.motion)
            else:
                d[own] = on_rows(c.motion(t), c.rows, what)
                velocity[own] = self._slope(c.motion, t, c.rows, what)
        return np.concatenate([d, velocity])

    def _slope(self, motion: Any, t: float, rows: int, what: str) -> np.ndarray:
        """Difference of order 2; at t = 0 forward, before which a motion need not be defined."""
        h = self.apart
        at = [
            on_rows(motion(x), rows, what)
            for x in ((t, t + h, t + 2.0 * h) if t < h else (t - h, t + h))
        ]
        if t < h:
            result: np.ndarray = (4.0 * at[1] - 3.0 * at[0] - at[2]) / (2.0 * h)
            return result
        result = (at[1] - at[0]) / (2.0 * h)
        return result
