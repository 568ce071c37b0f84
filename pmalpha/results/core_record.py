"""The record of a run as the core takes it, by names: its one description in Python."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

# The arrays of a record with a column for each constraint.
OF_CONSTRAINTS = ("multipliers", "velocity_jump", "displacement_jump")


class CoreSelection(NamedTuple):
    """What is recorded of a subdomain; rows of arrays are its time levels."""

    position: np.ndarray  # of the recorded dofs, in the order of the core
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    springs: tuple[np.ndarray, ...] | None  # numbers, deformation, force
    outputs: tuple[Any, ...] | None  # values, the matrices on u, v and a
    internal: tuple[np.ndarray | None, np.ndarray | None]  # iterations, q


class CoreRecord(NamedTuple):
    """What is recorded of a coupler, in its order of constraints."""

    begin: int
    every: int
    selections: tuple[Any, ...]  # of each subdomain, None for none; in lanes a tuple of them
    multipliers: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    energy: np.ndarray | None = None
    contacts: tuple[np.ndarray, np.ndarray] | None = None  # impulses, gaps

    @property
    def interface(self) -> tuple[np.ndarray, ...]:
        """The arrays with a column for each constraint."""
        return tuple(getattr(self, name) for name in OF_CONSTRAINTS)
