"""The methods of a coupler that write its state to a file and read it again."""

from __future__ import annotations

import secrets
from os import PathLike
from pathlib import Path
from typing import Any

from .._checks import MOST
from ..files import checked_path
from ..setup.assembly import Assembly
from ..setup.constraint_rows import ConstraintRows
from ..setup.ranks import file_of, joined
from . import checkpoint
from .history import History


class Saving:
    """`Coupler.save` and `Coupler.load`."""

    _parts: Any
    _core: Any
    _rows: ConstraintRows
    _core_rows: Any
    _options: dict[str, Any]
    _constants: dict[str, Any] | None
    _loads: Any
    _ranks: Any
    _started: bool
    _last_history: History | None
    _start: Any
    _together: Any
    _check_call: Any
    _assembly: Assembly
    _assemblies: Any
    _steps_facts: Any
    _steps_of: Any
    _take: Any

    def save(self, path: str | PathLike[str]) -> None:
        """Write the present state to a file; a run continues from it bitwise identically.

        An npz file without pickled objects: the state and a description of the problem with
        checksums of its matrices, not the matrices themselves. Written atomically; an existing file
        survives an interrupted save.

        Parameters
        ----------
        path : str or path
            Used as given; no suffix is added. With `comm` each rank writes a file of its own, with
            the number of the macro step, a token of this save and the number of the rank added, and
            this one, written last, leads to them: keep them together. The files of states that were
            saved there before, whole or not, are removed.

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
            arrays = checkpoint.state_arrays(self._assembly, self._core_rows, self._options)
            steps, done = self._steps_facts(), self._core.step_count
            if self._ranks is None:
                checkpoint.write(path, self._problem(), done, arrays, steps)
                return
            # names of this save alone: files of older ones survive until all of this are written
            token = self._ranks.share(secrets.token_hex(4))[0]
            name = f"{checked_path(path)}.{done}.{token}"
            files = [file_of(name, r) for r in range(self._ranks.size)]
            checkpoint.write(files[self._ranks.rank], self._problem(), done, arrays, steps)
            self._ranks.share(None)
            if self._ranks.rank == 0:
                names, first = [Path(file).name for file in files], self._ranks.first.tolist()
                checkpoint.write_master(checked_path(path), names, first)

    def load(self, path: str | PathLike[str]) -> None:
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
            A file written by `save`, by any number of ranks, or by a coupler without `comm`.

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
            first = self._assembly.first
            own = range(first, first + len(self._parts))
            step, arrays, facts = checkpoint.read(path, self._problem(), own)
            if self._ranks is not None:
                self._ranks.require_equal("the macro step of the files", (step, facts))
            steps, assembly = self._steps_of(path, facts)
            most = MOST // max(steps.layout.substeps)
            if not steps.clock.origin <= step <= most:
                reason = f"step_count must be in {steps.clock.origin}..{most}, got {step}"
                raise checkpoint.damaged(path, reason)
            parts, core = assembly.parts, assembly.core
            rows, options = self._core_rows, self._options
            state = checkpoint.core_state(path, arrays, assembly, rows, options)
            if self._ranks is not None:
                self._ranks.share(None)  # from here on nothing fails
            # stored values of callables are of other times
            loads = self._loads.with_steps(core, parts, steps.clock)
            loads.to_core()
            checkpoint.restore(state, parts, core, steps.clock, step)
            self._take(steps, assembly)
            self._loads, self._started, self._last_history = loads, True, None

    def _problem(self) -> dict[str, Any]:
        """The description of this problem for a checkpoint; the matrices are read once."""
        if self._constants is None:
            first = self._assemblies.first.parts
            iterates = joined(self._ranks, [part.internal is not None for part in first])
            self._constants = checkpoint.constants(
                self._options,
                self._loads.names,
                self._rows.p,
                first,
                self._rows.matrices,
                iterates=any(iterates),
            )
        loads = self._loads
        return self._constants | checkpoint.loads(self._parts, loads.forces, loads.motions)
