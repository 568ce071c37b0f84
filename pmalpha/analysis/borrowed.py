"""A coupler under analysis: its type is checked, and its state restored afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..run.clock import Clock
from ..run.coupler import Coupler
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
    snapshot = coupler._snapshot()
    try:
        layout = coupler._steps.layout
        coupler._take(Steps(layout, Clock(layout.dt)), coupler._assemblies.of(layout))
        coupler._core.set_origin(0, 0.0)
        yield
    finally:
        coupler._restore(snapshot)


@contextmanager
def unloaded(coupler: Coupler) -> Iterator[None]:
    """Without loads and prescribed motion within the block."""
    for part in coupler._parts:
        part.core.set_load(None)
    for i in range(len(coupler._loads.motions)):
        coupler._core.set_motion(i, None)
    try:
        yield
    finally:
        coupler._loads.to_core()
