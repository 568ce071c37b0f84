"""The whole state of a coupler in memory, to return to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..setup.assembly import Assembly
from ..setup.part import Part
from .checkpoint import CoreState, restore
from .history import History
from .initial import InitialValues
from .loads import Loads
from .transfer import Steps

__all__ = ["Snapshot"]


class _Contents(NamedTuple):
    """What a snapshot keeps."""

    coupler: Any
    step: int
    steps: Steps
    assembly: Assembly
    state: CoreState
    initial: InitialValues
    loads: Loads


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

    __slots__ = ("_contents",)

    def __init__(self) -> None:
        self._contents: _Contents | None = None  # only a coupler fills it

    def __repr__(self) -> str:
        if self._contents is None:
            return "<Snapshot of no coupler>"
        return f"<Snapshot at step_count = {self._contents.step}>"

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a Snapshot cannot be copied or pickled; Coupler.save writes a file")


class Snapshots:
    """The methods of `Coupler` that keep its state in memory and return to it."""

    _parts: Any
    _core: Any
    _steps: Steps
    _assembly: Assembly
    _assemblies: Any
    _take: Any
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

        Notes
        -----
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
            Of `snapshot`.

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
        if snapshot._contents is None or snapshot._contents.coupler is not self._assemblies:
            raise ValueError(
                f"snapshot must be one of this coupler, got {snapshot!r} from elsewhere; save and "
                "load transfer a state between couplers of the same problem"
            )
        with self._entered():
            self._restore(snapshot)
            self._last_history = None

    def _snapshot(self) -> Snapshot:
        self._start()
        core, snapshot = self._core, Snapshot()
        snapshot._contents = _Contents(
            self._assemblies,
            core.step_count,
            self._steps,
            self._assembly,
            _present(self._parts, core),
            self._initial,
            self._loads,
        )
        return snapshot

    def _restore(self, snapshot: Snapshot) -> None:
        kept = snapshot._contents
        assert kept is not None
        loads, assembly = kept.loads, kept.assembly
        if loads is not self._loads or loads.has_callables:
            # stored values of callables are of other times
            loads = loads.with_steps(assembly.core, assembly.parts, kept.steps.clock)
            loads.to_core()
        # _was_reset stays: it is about the factor of M alone, which this coupler has or has not
        self._initial, self._started = kept.initial, True
        restore(kept.state, assembly.parts, assembly.core, kept.steps.clock, kept.step)
        self._take(kept.steps, assembly)
        self._loads = loads


def _present(parts: Sequence[Part], core: Any) -> CoreState:
    """Copies of all that the core continues with."""
    shooting: np.ndarray = core.iteration()
    return CoreState(
        [part.core.levels() for part in parts],
        [part.core.iteration() for part in parts],
        shooting,
        core.multipliers,
        core.prescribed,
        core.end_multipliers(),
        core.gap(),
    )
