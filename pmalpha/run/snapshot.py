"""The whole state of a coupler in memory, to return to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..setup.part import Part
from .checkpoint import CoreState, restore
from .history import History
from .initial import InitialValues
from .loads import Loads

__all__ = ["Snapshot"]


class Snapshot:
    """The state of a coupler at a macro time level, from `Coupler.snapshot`.

    Only `Coupler.restore` of the same coupler reads it. It can be restored any number of times.

    Examples
    --------
    >>> coupler = models.split_oscillator(10.0).coupler(0.05)
    >>> coupler.step(7)
    >>> coupler.snapshot()
    <Snapshot at step_count = 7>
    """

    __slots__ = ("_core", "_initial", "_loads", "_state", "_step")

    def __init__(
        self, core: Any, step: int, state: CoreState, initial: InitialValues, loads: Loads
    ):
        self._core, self._step, self._state = core, step, state
        self._initial, self._loads = initial, loads

    def __repr__(self) -> str:
        return f"<Snapshot at step_count = {self._step}>"

    def __reduce__(self) -> tuple:
        raise TypeError("a Snapshot cannot be copied or pickled; Coupler.save writes a file")


class Snapshots:
    """The methods of `Coupler` that keep its state in memory and return to it."""

    _parts: Any
    _core: Any
    _initial: InitialValues
    _loads: Loads
    _started: bool
    _last_history: History | None
    _entered: Any
    _start: Any

    def snapshot(self) -> Snapshot:
        """The whole present state in memory, for `restore`.

        Displacements, velocities and accelerations, multipliers, the memory of springs and
        histories of internal forces, the previous time level of double steps, what iterations
        continue with, and the loads and initial values of the last `reset`. What a Python function
        of the user itself remembers is not part of it, nor is a file or a History.

        Returns
        -------
        Snapshot
            For this coupler only. It takes the memory of the state, without matrices and factors.

        Before the first step the initial accelerations are computed first, as by `state`; an
        exception of a callable load reaches the caller.

        Examples
        --------
        Two continuations of one run:

        >>> coupler = models.split_oscillator(10.0).coupler(0.05)
        >>> coupler.step(7)
        >>> present = coupler.snapshot()
        >>> first = coupler.run(steps=3)
        >>> coupler.restore(present)
        >>> second = coupler.run(steps=3)
        >>> coupler.step_count, bool(np.all(first["A"].u == second["A"].u))
        (10, True)
        """
        with self._entered():
            return self._snapshot()

    def restore(self, snapshot: Snapshot) -> None:
        """Return to the state of a snapshot of this coupler.

        The continued run is bitwise identical to the one that followed the snapshot, if callables
        return the same values: those of loads are evaluated again from the restored time on.
        `last_history` is None afterwards.

        Parameters
        ----------
        snapshot : Snapshot

        Raises
        ------
        TypeError
            For an object that is not a Snapshot.
        ValueError
            For a snapshot of another coupler, also one of the same problem: `save` and `load`
            transfer a state between those. The coupler is then unchanged.
        """
        if not isinstance(snapshot, Snapshot):
            raise TypeError(f"snapshot must be a Snapshot, got {snapshot!r}")
        if snapshot._core is not self._core:
            raise ValueError(
                f"snapshot must be one of this coupler, got {snapshot!r} of another one; save and "
                "load transfer a state between couplers of the same problem"
            )
        with self._entered():
            self._restore(snapshot)
            self._last_history = None

    def _snapshot(self) -> Snapshot:
        self._start()
        step = self._core.step_count
        return Snapshot(
            self._core, step, _present(self._parts, self._core), self._initial, self._loads
        )

    def _restore(self, snapshot: Snapshot) -> None:
        loads = snapshot._loads
        if loads is not self._loads or loads.has_callables:  # stored values are of other times
            self._loads = loads.renewed()
            self._loads.to_core()
        # _was_reset stays: it is about the factor of M alone, which this coupler has or has not
        self._initial, self._started = snapshot._initial, True
        restore(snapshot._state, self._parts, self._core, snapshot._step)


def _present(parts: Sequence[Part], core: Any) -> CoreState:
    """Copies of all that the core continues with."""
    shooting: np.ndarray = core.iteration()
    return CoreState(
        [part.core.levels() for part in parts],
        [part.core.iteration() for part in parts],
        shooting,
        core.multipliers,
        core.prescribed,
    )
