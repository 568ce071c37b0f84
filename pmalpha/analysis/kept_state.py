"""A coupler under analysis: its type is checked, and its state restored afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..results.clock import Clock
from ..run.coupler import Coupler
from ..run.session import take
from ..run.snapshot import restore_snapshot, snapshot_of
from ..run.transfer import Steps


def checked_coupler(coupler: Any) -> Coupler:
    if not isinstance(coupler, Coupler):
        raise TypeError(f"coupler must be a Coupler, got {coupler!r}")
    return coupler


@contextmanager
def state_kept(coupler: Coupler) -> Iterator[None]:
    """Restore the state of the coupler afterwards, bitwise identical.

    Meanwhile its steps are its present ones as if there had been no others.
    """
    session = coupler._session
    snapshot = snapshot_of(session)
    try:
        layout = session.steps.layout
        take(session, Steps(layout, Clock(layout.dt)), session.assemblies.of(layout))
        session.core.set_origin(0, 0.0)
        yield
    finally:
        restore_snapshot(session, snapshot)


@contextmanager
def unloaded(coupler: Coupler) -> Iterator[None]:
    """Without loads and prescribed motion within the block."""
    session = coupler._session
    for part in session.parts:
        part.core.set_load(None)
    for i in range(len(session.loads.motions)):
        session.core.set_motion(i, None)
    try:
        yield
    finally:
        session.loads.to_core()
