"""The record of a run as the core takes it, by names: its one description in Python."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

# The arrays of a record with a column for each constraint.
OF_CONSTRAINTS = ("multipliers", "velocity_jump", "displacement_jump")


class SpringRows(NamedTuple):
    """Springs, and rows with a column for each."""

    number: np.ndarray
    deformation: np.ndarray
    force: np.ndarray


class Combination(NamedTuple):
    """Weights of dofs by rows: the first of each row, and one more."""

    start: np.ndarray
    position: np.ndarray
    weight: np.ndarray


class OutputRows(NamedTuple):
    """Rows with a column for each output, and the matrices that act on u, v and a."""

    values: np.ndarray
    of_u: Combination | None
    of_v: Combination | None
    of_a: Combination | None


class InternalRows(NamedTuple):
    """Numbers of iterations, and histories of internal forces."""

    iterations: np.ndarray | None
    q: np.ndarray | None


class RigRows(NamedTuple):
    """Rows with a column for each command of specimens behind filters."""

    command: np.ndarray
    sent: np.ndarray
    measured: np.ndarray
    force: np.ndarray


class ContactRows(NamedTuple):
    """Rows with a column for each row of contacts, and for each contact."""

    impulse: np.ndarray
    gap: np.ndarray


class CoreSelection(NamedTuple):
    """What is recorded of a subdomain; rows of arrays are its time levels."""

    position: np.ndarray  # of the recorded dofs, in the order of the core
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    springs: SpringRows | None
    outputs: OutputRows | None
    internal: InternalRows
    rig: RigRows | None = None


class CoreRecord(NamedTuple):
    """What is recorded of a coupler, in its order of constraints."""

    begin: int
    every: int
    selections: tuple[Any, ...]  # of each subdomain, None for none; in lanes a tuple of them
    multipliers: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    energy: np.ndarray | None = None
    contacts: ContactRows | None = None

    @property
    def interface(self) -> tuple[np.ndarray, ...]:
        """The arrays with a column for each constraint."""
        return tuple(getattr(self, name) for name in OF_CONSTRAINTS)
