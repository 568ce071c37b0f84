"""Restoring functions that are too stiff for the step: seen from the pairs (u, r) of a run."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..errors import StabilityWarning, UnboundedMotion, warn
from ..problem.matrices import product
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .stability import critical_product

# Increments from which the stiffness is estimated.
WINDOW = 4
# Below this share of independent velocity increments they are left out of the estimate.
COLLINEAR = 1e-6
# Excess of the stiffness over the critical one from which on it is reported.
EXCESS = 1.1
# Growth of the motion after the warning that ends the run.
GROWTH = 1e6


class StiffnessWatch:
    """Estimates the stiffness of a restoring function and compares the step with its critical step.

    A restoring force without estimate K_r is evaluated at the predictor, so that it is stable up to
    the critical step of the explicit scheme with the same parameters, in an implicit subdomain too.
    The estimate is omega^2 in dr = omega^2 M du + c M dv, by least squares over the last
    increments, so that the force of a dashpot is not taken as stiffness.

    Parameters
    ----------
    subdomain : Subdomain
        Without dofs that have no mass.
    name : str
    step : float
        The step really taken, 2 h if double.
    """

    def __init__(self, subdomain: Subdomain, name: str, step: float):
        self.M, self.name, self.step = subdomain.M, name, step
        s = subdomain.scheme
        self.explicit, self.is_load = s.explicit, not subdomain.has_functions
        self.Omega = critical_product(Scheme(s.am, s.af, s.beta, s.gamma, explicit=True))
        self.last: tuple[np.ndarray, ...] | None = None
        self.increment: np.ndarray | None = None
        self.sums: deque[np.ndarray] = deque(maxlen=WINDOW)
        self.largest, self.cause = 0.0, ""

    def __call__(self, u: np.ndarray, v: np.ndarray, r: np.ndarray, t: float) -> None:
        """Take in an evaluation; StabilityWarning once, then UnboundedMotion."""
        if t == 0.0:  # a run begins, possibly after a reset: its motion is not that of the last one
            self.last = self.increment = None
            self.sums.clear()
            self.largest = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            self._take(u, v, r)
            omega2, is_resolved = self._estimate()
        size = float(np.max(np.abs(u), initial=0.0))
        if not self.cause or len(self.sums) < WINDOW:
            self.largest = max(self.largest, size)
            if not self.cause and omega2 * self.step**2 > EXCESS * self.Omega**2:
                self._warn(np.sqrt(omega2))
        elif size > GROWTH * self.largest and not is_resolved:
            raise UnboundedMotion(self.name, self.cause)

    def _take(self, u: np.ndarray, v: np.ndarray, r: np.ndarray) -> None:
        if self.last is not None:
            du, dv, dr = (new - old for new, old in zip((u, v, r), self.last))
            Mdu = product(self.M, du)
            bend = du - self.increment if self.increment is not None else 0.0 * du
            bends = bend @ product(self.M, bend)
            Mdv = product(self.M, dv)
            self.sums.append(np.array([du @ Mdu, du @ Mdv, dv @ Mdv, du @ dr, dv @ dr, bends]))
            self.increment = du
        self.last = u, v, r

    def _estimate(self) -> tuple[float, bool]:
        """omega^2 of the window, 0 while it is not full; whether the steps resolve the motion."""
        if len(self.sums) < WINDOW:
            return 0.0, True
        xx, xy, yy, xz, yz, bends = np.sum(self.sums, axis=0)
        determinant = xx * yy - xy * xy
        if determinant > COLLINEAR * xx * yy:
            omega2 = (xz * yy - yz * xy) / determinant
        else:  # growth with alternating signs, or no velocities
            omega2 = xz / xx if xx > 0.0 else 0.0
        return float(omega2) if np.isfinite(omega2) else 0.0, not bends > xx

    def _warn(self, omega: float) -> None:
        remedy = "take smaller steps, or an implicit scheme with an estimate restoring_stiffness="
        if not self.explicit:
            remedy = "give an estimate of it as restoring_stiffness=, or take smaller steps"
        if self.is_load:
            remedy = "take smaller steps"
        kind = "force, a function of the motion," if self.is_load else "restoring function"
        self.cause = (
            f"the {kind} of subdomain {self.name!r} is stiff: its values correspond to "
            f"a circular frequency of about {omega:.3g}, for which the step {self.step:g} is above "
            f"the critical step {self.Omega / omega:.3g}; {remedy}"
        )
        warn(f"{self.cause}; otherwise the run will grow without bound", StabilityWarning)
