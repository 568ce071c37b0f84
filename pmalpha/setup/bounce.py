"""Bounces against stops that are evaluated once a step: how much speed they add."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from ..errors import StabilityWarning, warn
from ..problem.matrices import Matrix, canonical, combination, dense, diagonal
from ..problem.schemes import Scheme
from ..problem.springs import Gap, stiffness
from ..problem.subdomain import Subdomain
from .stability import INSTEAD, StepRatio, at_springs, largest_eigenvalue

# Gain of speed that is reported: up to RESOLVED = Omega it is at most 1.25, whatever the estimate.
MOST, RESOLVED = 1.3, 1.5
# Positions of the stop between two time levels, and steps in which the mass is free again.
PHASES, STEPS = 64, 64


def warn_of_bounces(steps: Iterable[tuple[str, Subdomain, float, StepRatio]]) -> None:
    """StabilityWarning for stops whose contact the step does not resolve, though it is stable.

    Closed contact is stable up to the critical step, with an estimate K_r up to that of (C4) or at
    any step; but a stop that opens within a step goes on to push.
    """
    for name, subdomain, step, ratio in steps:
        gain, Omega = bounce_of(subdomain, step)
        if gain > MOST and not ratio.value > 1.0:
            warn(
                f"the step {step:g} of subdomain {name!r} does not resolve the contact of its "
                f"stops, of circular frequency {Omega / step:.3g}: it is stable while it is closed,"
                f" but what arrives with the speed 1 can leave with {gain:.3g}; take smaller steps "
                f"(below {RESOLVED * step / Omega:.3g}), or give {INSTEAD}; of springs, "
                "internal=DiscreteGradient(...) with the trapezoidal rule adds no energy",
                StabilityWarning,
            )


def bounce_of(s: Subdomain, step: float) -> tuple[float, float]:
    """The largest gain of speed at a stop that is evaluated once a step, and omega h of its
    contact; (1, 0) without stops or without mass at them."""
    whole = _of_stops(s)
    if whole is None:
        return 1.0, 0.0
    dofs = np.flatnonzero(diagonal(whole))
    K, M = at_springs(s, whole, dofs)
    if not np.all(diagonal(M) > 0.0):
        return 1.0, 0.0
    omega2, x = largest_eigenvalue(K, M)
    Kx = dense(K) @ x
    if not omega2 > 0.0:
        return 1.0, 0.0
    share, Omega = 0.0, float(np.sqrt(omega2)) * step
    if not s.scheme.explicit and s.restoring_stiffness is not None:
        K_r = at_springs(s, s.restoring_stiffness, dofs)[0]
        share = min(max(float(x @ (dense(K_r) @ x) / (x @ Kx)), 0.0), 1.0)
    return bounce_gain(s.scheme, Omega, round(share, 6)), Omega


def _of_stops(s: Subdomain) -> Matrix | None:
    """The stiffness of all stops and contact that are evaluated once a step, closed."""
    springs = s.restoring_springs if s.iterates else s.springs
    stops = tuple(spring for spring in springs if isinstance(spring, Gap))
    terms: list[tuple[float, Matrix | None]] = []
    if stops:
        terms = [(1.0, canonical(stiffness(stops, "largest_tangent", s.n), "stops", s.n)[0])]
    if s.scheme.explicit and s.internal is not None:
        found = [f.largest_tangent() for f in s.internal.forces if f.largest_tangent is not None]
        terms += [(1.0, canonical(K, "contact", s.n)[0]) for K in found if K is not None]
    return combination(terms)


@lru_cache(maxsize=256)
def bounce_gain(scheme: Scheme, Omega: float, share: float) -> float:
    """The largest speed, over all positions of the stop between two time levels, with which a free
    mass of speed 1 leaves a stop of stiffness (Omega / h)^2, with K_r = share of that. (C5)"""
    am, af, beta = scheme.am, scheme.af, scheme.beta
    al1, al2 = scheme.coefficients(1.0)
    b, g = beta / (1.0 - am), scheme.gamma / (1.0 - am)
    u = -np.linspace(0.0, 1.0, PHASES, endpoint=False) - 0.5 / PHASES
    v, w, a = np.ones(PHASES), np.zeros(PHASES), np.zeros(PHASES)
    k, mass = Omega**2, 1.0 + al1 * share * Omega**2
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(STEPS):
            ut = u + v + (0.5 - b) * a + af * b * w
            vt = v + (1.0 - g) * a + af * g * w
            new = -k * np.maximum(ut, 0.0) / mass
            a = ((1.0 - af) * new + af * w - am * a) / (1.0 - am)
            u, v, w = ut + al1 * new, vt + al2 * new, new
    return float(np.max(np.abs(v)))
