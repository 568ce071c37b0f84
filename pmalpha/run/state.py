"""The present motion of a subdomain: `Coupler.state` and `Coupler.springs`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..results.keys import position
from .session import Session, begin

__all__ = ["State"]


@dataclass(frozen=True)
class State:
    """The motion of a subdomain at one time.

    Attributes
    ----------
    u, v, a : (n,) arrays
        Displacement, velocity and true acceleration (w of the equations).
    """

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray


def state(session: Session, key: str | int | Subdomain) -> State:
    """`Coupler.state`."""
    i = position(key, session.keys)
    with session.guard:  # another thread may change the steps, and with them the parts
        begin(session)
        part = session.parts[i]
        u, v, w = part.core.state()
        if part.mean:
            lam = session.core.end_multipliers()[: session.core_rows.p]
            w = w + part.core.accelerate(lam)
    return State(u[part.position], v[part.position], w[part.position])


def springs(session: Session, key: str | int | Subdomain) -> SpringState:
    """`Coupler.springs`."""
    i = position(key, session.keys)
    with session.guard:
        begin(session)
        deformation, force = session.parts[i].core.springs()[:2]
    return SpringState(deformation, force)
