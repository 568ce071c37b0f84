"""A coupler that is analysed: checked, and afterwards in the state in which it was."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..run.coupler import Coupler


def checked_coupler(coupler: Any) -> Coupler:
    if not isinstance(coupler, Coupler):
        raise TypeError(f"coupler must be a Coupler, got {coupler!r}")
    return coupler


@contextmanager
def state_kept(coupler: Coupler) -> Iterator[None]:
    """Afterwards the coupler stands where it stood, to the last bit."""
    coupler._start()
    core = coupler._core
    nodes = [part.core.levels() for part in coupler._parts]
    step_count, lam, g = core.step_count, core.multipliers, core.prescribed
    try:
        yield
    finally:
        for part, kept in zip(coupler._parts, nodes):
            part.core.set_levels(kept)
        core.start(step_count, lam, g)


@contextmanager
def unloaded(coupler: Coupler) -> Iterator[None]:
    """No loads and no prescribed motion meanwhile."""
    for part in coupler._parts:
        part.core.set_load(None)
    for i in range(len(coupler._loads.motions)):
        coupler._core.set_motion(i, None)
    try:
        yield
    finally:
        coupler._loads.to_core()
