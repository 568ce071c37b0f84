"""The nine numbers of a step of one length, all that a step knows of its scheme."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class StepConstants(NamedTuple):
    """What a scheme does in a step of length h, as `pma_step` of the core has it.

    ::

        ut = u + h v + u_a a + u_w w     (5)
        vt = v + v_a a + v_w w           (6)
        u1 = ut + al1 w1                 (8)
        v1 = vt + al2 w1                 (8)
        a1 = a_a a + a_w w + a_w1 w1     (9)

    w1 follows from equilibrium at the end of the step, with K u1 or, in an explicit scheme, K ut.
    """

    h: float
    al1: float
    al2: float
    u_a: float
    u_w: float
    v_a: float
    v_w: float
    a_a: float
    a_w: float
    a_w1: float

    def predictors(self) -> np.ndarray:
        """ut and vt, the (2, 4) matrix that acts on (u, v, w, a)."""
        return np.array([[1.0, self.h, self.u_w, self.u_a], [0.0, 1.0, self.v_w, self.v_a]])

    def closed(self, w1: np.ndarray) -> np.ndarray:
        """The state (u, v, w, a) at the end, a (4, 4) matrix as `w1` is a row that acts on it."""
        ut, vt = self.predictors()
        a1 = np.array([0.0, 0.0, self.a_w, self.a_a]) + self.a_w1 * w1
        return np.array([ut + self.al1 * w1, vt + self.al2 * w1, w1, a1])

    def amplification(self, Omega: float, xi: float, explicit: bool) -> np.ndarray:
        """The (4, 4) matrix of a step of h = 1 of an oscillator, which acts on (u, v, w, a)."""
        ut, vt = self.predictors()
        c, k = 2.0 * xi * Omega, Omega**2
        mbar = 1.0 + self.al2 * c + (0.0 if explicit else self.al1 * k)  # (12)
        return self.closed(-(c * vt + k * ut) / mbar)  # (11)
