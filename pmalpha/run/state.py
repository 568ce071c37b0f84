"""The present motion of a subdomain: `Coupler.state` and `Coupler.springs`."""

from __future__ import annotations

from ..problem.springs import SpringState
from ..problem.subdomain import Subdomain
from ..results.dof_motion import State
from ..results.keys import position
from .session import Session, begin

__all__ = ["State"]


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
    u, v, w = (x[part.position] for x in (u, v, w))
    return State(u, v, w, n=part.n, dof_names=part.subdomain.dof_names)


def springs(session: Session, key: str | int | Subdomain) -> SpringState:
    """`Coupler.springs`."""
    i = position(key, session.keys)
    with session.guard:
        begin(session)
        deformation, force = session.parts[i].core.springs()[:2]
    return SpringState(deformation, force)
