"""The methods of a coupler that write its state to a file and read it again."""

from __future__ import annotations

from os import PathLike
from typing import Any

from ..setup.constraint_rows import ConstraintRows
from . import checkpoint
from .history import History


class Saving:
    """`Coupler.save` and `Coupler.load`."""

    _parts: Any
    _core: Any
    _rows: ConstraintRows
    _row_position: Any
    _options: dict[str, Any]
    _constants: dict[str, Any] | None
    _loads: Any
    _ranks: Any
    _started: bool
    _last_history: History | None
    _start: Any
    _together: Any
    _check_call: Any
    _own_path: Any
    _assemblies: Any
    _steps_facts: Any
    _steps_of: Any
    _take: Any

    def save(self, path: str | PathLike) -> None:
        """Write the present state to a file; a run continues from it bitwise identically.

        An npz file without pickled objects: the state and a description of the problem with
        checksums of its matrices, not the matrices themselves. Written atomically; an existing file
        survives an interrupted save.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added. With `comm` each rank writes a file of its own, with
            ``.0``, ``.1`` and so on added; `load` on as many ranks adds the same.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be written.

        Before the first step the initial accelerations are computed first, as by `state`; an
        exception of a callable load reaches the caller.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> coupler, other = (models.split_oscillator(10.0).coupler(0.05) for _ in range(2))
        >>> coupler.step(7)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     coupler.save(pathlib.Path(folder, "state.npz"))
        ...     other.load(pathlib.Path(folder, "state.npz"))
        >>> coupler.step(), other.step()
        (None, None)
        >>> other.step_count, bool(other.state("A").u == coupler.state("A").u)
        (8, True)
        """
        with self._together():
            self._check_call("save")
            self._start()
            arrays = checkpoint.state_arrays(self._parts, self._core, self._row_position)
            steps = self._steps_facts()
            path = self._own_path(path)
            checkpoint.write(path, self._problem(), self._core.step_count, arrays, steps)

    def load(self, path: str | PathLike) -> None:
        """Restore the state that a coupler of the same problem saved.

        The two couplers must be built the same way, in the same process or another. The continued
        run is bitwise identical to an uninterrupted one, with the same build, CPU and packages.
        Initial values may differ (with internal forces under "macro" the continued run then agrees
        to the tolerance of `Newton`, not bitwise). Constant and sampled loads are compared by their
        numbers; callables cannot be compared: the caller provides the same functions, which are
        evaluated from the restored time on.

        Parameters
        ----------
        path : str or path
            A file written by `save`.

        Raises
        ------
        TypeError, OSError
            For a wrong type of path, and for a file that cannot be read.
        ValueError
            For another problem, with a list of what differs, for any other file, or a damaged one.
            The coupler is then unchanged.
        """
        with self._together():
            self._check_call("load")
            path = self._own_path(path)
            step, arrays, facts = checkpoint.read(path, self._problem())
            steps, assembly = self._steps_of(path, facts)
            parts, core = assembly.parts, assembly.core
            state = checkpoint.core_state(path, arrays, parts, core, self._row_position)
            if self._ranks is not None:  # from here on nothing fails
                self._ranks.require_equal("the macro step of the files", step)
            # stored values of callables are of other times
            loads = self._loads.with_steps(core, parts, steps.clock)
            loads.to_core()
            checkpoint.restore(state, parts, core, steps.clock, step)
            self._take(steps, assembly)
            self._loads, self._started, self._last_history = loads, True, None

    def _problem(self) -> dict[str, Any]:
        """The description of this problem for a checkpoint; the matrices are read once."""
        if self._constants is None:
            matrices = self._rows.matrices
            first = self._assemblies.first.parts
            self._constants = checkpoint.constants(self._options, first, matrices)
        loads = self._loads
        return self._constants | checkpoint.loads(self._parts, loads.forces, loads.motions)
