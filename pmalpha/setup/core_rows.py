"""The constraints as the core has them: in another order than the user's, and of one size.

A multiple of a constraint is the same constraint, but pivots are compared with each other, and
Broyden's method compares multipliers. So each row is divided by the power of two below its largest
entry, which leaves all digits as they are; rows of ties keep their entries of 1 and -1.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np


class CoreRows:
    """Positions and scales of the user's constraints in the core, for results and given values.

    With L = s * (row of the core), a jump is s times that of the core, and a multiplier is that of
    the core divided by s.

    Parameters
    ----------
    position : (p,) array of int
        Position of each constraint in the core's order.
    scale : (p,) array
        s of each constraint.
    contacts : Contacts, optional
        Beside them, in the user's order.
    """

    def __init__(self, position: np.ndarray, scale: np.ndarray, contacts: Any = None):
        self.position, self.scale, self.contacts = position, scale, contacts
        self._in_order = np.array_equal(position, np.arange(position.size))
        self._of_size_one = bool(np.all(scale == 1.0))

    @property
    def p(self) -> int:
        """Number of constraints."""
        return self.position.size

    @cached_property
    def numbers(self) -> np.ndarray:
        """The user's number of each constraint, in the core's order."""
        return np.argsort(self.position)

    def forces(self, lam: np.ndarray) -> np.ndarray:
        """Multipliers of the core, (..., p), as the user's."""
        return self._divided(self._in_users_order(lam))

    def jumps(self, x: np.ndarray) -> np.ndarray:
        """Jumps or prescribed velocities of the core, (..., p), as the user's."""
        x = self._in_users_order(x)
        return x if self._of_size_one else x * self.scale

    def forces_in_core(self, lam: np.ndarray) -> np.ndarray:
        """Multipliers of the user's, (..., p), as the core has them."""
        lam = lam if self._of_size_one else lam * self.scale
        return lam[..., self.numbers]

    def jumps_in_core(self, x: np.ndarray) -> np.ndarray:
        """Jumps or prescribed velocities of the user's, (..., p), as the core has them."""
        return self._divided(x)[..., self.numbers]

    def _in_users_order(self, x: np.ndarray) -> np.ndarray:
        return x if self._in_order else x[..., self.position]

    def _divided(self, x: np.ndarray) -> np.ndarray:
        return x if self._of_size_one else x / self.scale


def scale_of_rows(sizes: np.ndarray) -> np.ndarray:
    """The powers of two at or below the largest entries of rows."""
    result: np.ndarray = np.ldexp(1.0, np.frexp(sizes)[1] - 1)
    return result
