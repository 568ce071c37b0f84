"""Restoring functions that are too stiff for the step: seen from the pairs (u, r) of a run."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..errors import StabilityWarning, UnboundedMotion, warn
from ..problem.matrices import product
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .bounce import MOST, RESOLVED, bounce_gain
from .stability import INSTEAD, predicted_product

# Increments from which the stiffness is estimated.
WINDOW = 4
# Below this share of independent velocity increments they are left out of the estimate.
COLLINEAR = 1e-6
# Excess of the stiffness over the critical one from which on it is reported.
EXCESS = 1.1
# Contact: the stiffness rises by this factor between two increments, and the work of the rise is
# this multiple of the largest kinetic energy so far; friction and noise are below.
CLOSES, IMPACT = 10.0, 4.0
# A later contact is another one where it is stiffer by this factor, as in the core (balance.c).
STIFFER = 4.0
# Growth of the motion after the warning that ends the run; that of the kinetic energy by contact.
GROWTH = 1e6
# Evaluations that are kept at most, and their bytes.
SAMPLES, SAMPLED_BYTES = 512, 2**23
# Displacements that no motion has: this multiple of all before, or above the second one.
RUNAWAY, HUGE = 1e3, 1e50


def cause_of_contact(kind: str, name: str, step: float, omega: float, gain: float, t: float) -> str:
    """What is said of a contact of a function that closes at t: omega, and the gain of speed."""
    return (
        f"the {kind} of subdomain {name!r} closes a contact at t = {t:g} that the step {step:g} "
        f"does not resolve: its stiffness corresponds to a circular frequency of about {omega:.3g},"
        f" and what arrives with the speed 1 can leave with {gain:.3g}; take smaller steps (below "
        f"{RESOLVED / omega:.3g}), or give {INSTEAD}"
    )


def gain_of_contact(scheme: Scheme, step: float, omega: float, share: float) -> float:
    """(C5), 1 where the step resolves the contact; `share` of its stiffness is in K_r."""
    Omega = step * omega
    if not RESOLVED < Omega < np.inf:
        return 1.0
    return bounce_gain(scheme, Omega, round(min(max(share, 0.0), 1.0), 6))


class StiffnessWatch:
    """Estimates the stiffness of a restoring function and compares the step with its critical step.

    A restoring force without estimate K_r is evaluated at the predictor, so that it is stable up to
    the critical step of the explicit scheme with the same parameters, in an implicit subdomain too.
    The estimate is omega^2 in dr = omega^2 M du + c M dv, by least squares over the last
    increments, so that the force of a dashpot is not taken as stiffness. An estimate K_r raises the
    limit as in (C4). Contact, which lasts fewer increments, is seen by its first one, with the gain
    of speed of (C5).

    subdomain: without dofs that have no mass.
    step: the step really taken, 2 h if double.
    free: substeps of a free macro run, which does not go on from the last one.
    """

    def __init__(self, subdomain: Subdomain, name: str, step: float, free: int = 0):
        self.M, self.name, self.step = subdomain.M, name, step
        self.free, self.count = free, 0
        s = subdomain.scheme
        self.explicit, self.is_load = s.explicit, not subdomain.has_functions
        self.scheme, self.Omega = s, predicted_product(s)
        unknown = s.explicit or self.is_load or subdomain.has_unknown_stiffness
        self.K_r = None if unknown else subdomain.restoring_stiffness
        self.raised = s.coefficients(1.0)[0] * self.Omega**2  # b Omega_s^2 of (C4)
        self.last: tuple[np.ndarray, ...] | None = None
        self.increment: np.ndarray | None = None
        self.sums: deque[np.ndarray] = deque(maxlen=WINDOW)
        self.largest, self.cause = 0.0, ""
        self.kinetic, self.seen, self.impact = 0.0, np.inf, np.inf
        # of the run: the time and omega^2 of what is too stiff, the first or a much stiffer one
        self.found_at, self.stiffest = -np.inf, 0.0
        self.highest = 0.0  # omega^2 of the run so far
        # (u, v, r) of one in `every` evaluations of the run so far
        self.samples: list[np.ndarray] = []
        self.every, self.most = 1, min(SAMPLES, SAMPLED_BYTES // (24 * subdomain.n))

    def __call__(self, u: np.ndarray, v: np.ndarray, r: np.ndarray, t: float) -> None:
        """Take in an evaluation; StabilityWarning once, then UnboundedMotion."""
        if t == 0.0:  # a run begins, possibly after a reset: its motion is not that of the last one
            self.last = self.increment = None
            self.sums.clear()
            self.largest = self.kinetic = 0.0
            self.seen = self.impact = np.inf
            self.found_at, self.stiffest = -np.inf, 0.0
            self.highest, self.samples, self.every = 0.0, [], 1
            self.count = -1
        elif self.free and self.count % self.free == 0:
            self.last = self.increment = None
        self.count += 1
        self._sample(u, v, r)
        with np.errstate(over="ignore", invalid="ignore"):
            contact = self._take(u, v, r)
            omega2, is_resolved = self._estimate()
        self.highest = max(self.highest, omega2)
        is_stiff = omega2 * self.step**2 > EXCESS * self.Omega**2
        found = omega2 if is_stiff else 0.0 if contact is None else contact[0] ** 2
        if found > STIFFER * self.stiffest:
            self.found_at, self.stiffest = t, found
        if self.kinetic > GROWTH * self.impact:
            raise UnboundedMotion(self.name, self.cause)
        size = float(np.max(np.abs(u), initial=0.0))
        if not self.cause or len(self.sums) < WINDOW:
            self.largest = max(self.largest, size)
            if not self.cause and is_stiff:
                self._warn(np.sqrt(omega2))
            elif not self.cause and contact is not None:
                self.cause = cause_of_contact(self.kind, self.name, self.step, *contact, t)
                warn(self.cause, StabilityWarning)
                self.impact = self.kinetic
        elif size > GROWTH * self.largest and not is_resolved:
            raise UnboundedMotion(self.name, self.cause)

    def _sample(self, u: np.ndarray, v: np.ndarray, r: np.ndarray) -> None:
        if self.count % self.every == 0 and self.most > 1:
            self.samples.append(np.array([u, v, r]))
            if len(self.samples) == self.most:
                del self.samples[1::2]
                self.every *= 2

    def has_found(self, t: float) -> bool:
        """Whether the values at about this time were found too stiff by this watch itself."""
        return abs(t - self.found_at) <= WINDOW * self.step

    def runaway(self, u: np.ndarray) -> UnboundedMotion | None:
        """The error for a u beyond all that the motion before could reach in a step, or None."""
        size = float(np.max(np.abs(u), initial=0.0))
        reach = np.inf
        if self.last is not None:
            past = [float(np.max(np.abs(x), initial=0.0)) for x in self.last[:2]]
            reach = RUNAWAY * (max(self.largest, past[0]) + self.step * past[1])
        if self.cause and size > GROWTH * self.largest:
            return UnboundedMotion(self.name, self.cause)
        if size <= min(reach, HUGE):
            return None
        return UnboundedMotion(
            self.name,
            self.cause
            or f"the {self.kind} of subdomain {self.name!r} threw the motion to {size:.3g} "
            f"in a step: it is too stiff for the step {self.step:g}; give an estimate of it as "
            "restoring_stiffness=, take smaller steps, or give it as internal= of an implicit "
            "scheme",
        )

    def _take(self, u: np.ndarray, v: np.ndarray, r: np.ndarray) -> tuple[float, float] | None:
        """Sum up an increment; (omega, gain of speed) where it closes a contact."""
        contact = None
        kinetic = 0.5 * float(v @ product(self.M, v))
        if self.last is not None:
            du, dv, dr = (new - old for new, old in zip((u, v, r), self.last))
            Mdu = product(self.M, du)
            bend = du - self.increment if self.increment is not None else 0.0 * du
            bends = bend @ product(self.M, bend)
            Mdv = product(self.M, dv)
            K_r = 0.0 if self.K_r is None else float(du @ product(self.K_r, du))
            # dr without what K_r of (C4) admits
            xz, yz = du @ dr - self.raised * K_r, dv @ dr
            self.sums.append(np.array([du @ Mdu, du @ Mdv, dv @ Mdv, xz, yz, bends]))
            self.increment = du
            work = float(du @ dr)
            if not float(du @ self.last[2]) < -0.25 * work:  # friction that turns around
                contact = self._contact(float(du @ Mdu), work, K_r)
        self.kinetic = max(self.kinetic, kinetic)
        self.last = u, v, r
        return contact

    def _contact(self, m: float, work: float, K_r: float) -> tuple[float, float] | None:
        """(omega, gain of speed) where an increment closes a contact that the step is too long for.

        m and work are du . M du and du . dr.
        """
        omega2 = work / m if m > 0.0 else 0.0
        before, self.seen = self.seen, omega2
        sudden = omega2 > CLOSES * abs(before) and work > IMPACT * self.kinetic
        if not sudden:
            return None
        omega = float(np.sqrt(omega2))
        gain = gain_of_contact(self.scheme, self.step, omega, K_r / work)
        return (omega, gain) if gain > MOST else None

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

    @property
    def kind(self) -> str:
        return "force, a function of the motion," if self.is_load else "restoring function"

    def _warn(self, omega: float) -> None:
        what = "is stiff: its values"
        remedy = "take smaller steps, or an implicit scheme with an estimate restoring_stiffness="
        if not self.explicit:
            remedy = "give an estimate of it as restoring_stiffness=, or take smaller steps"
        if self.is_load:
            remedy = "take smaller steps"
        if self.K_r is not None:
            what = "is stiffer than restoring_stiffness= admits: the rest of its values"
            remedy = "give a larger restoring_stiffness=, or take smaller steps"
        self.cause = (
            f"the {self.kind} of subdomain {self.name!r} {what} correspond to a circular "
            f"frequency of about {omega:.3g}, for which the step {self.step:g} is above the "
            f"critical step {self.Omega / omega:.3g}; {remedy}"
        )
        warn(f"{self.cause}; otherwise the run will grow without bound", StabilityWarning)
