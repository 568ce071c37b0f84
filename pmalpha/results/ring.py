"""Files of a paced run: its record, written by a thread, and what other processes read of it."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from typing import Any

import numpy as np

import pmalpha._core as _core

from ..files import reading, writing
from ..memory import require
from .history import History
from .quantities import OF_SUBDOMAIN, CoreRecord
from .recording import FiledRecording, Recording

__all__ = ["Monitored", "read_monitor"]

# Seconds between two looks for rows to write.
INTERVAL = 0.1
FORMAT, VERSION = "pmalpha monitor", 2
# Bytes before the table: the header, and in the last 16 two numbers of rows.
HEADER = 1 << 14
BEGUN, DONE = HEADER - 16, HEADER - 8
TIMES = ("due", "begun", "commanded", "returned", "ended")


class RingRecording(FiledRecording):
    """A FiledRecording whose rows are written while the core goes on.

    The core records into `ring`, a second set of the arrays whose rows are used in turn; a thread
    copies what is complete from there to the arrays of this one and writes it. What finds no free
    rows is lost, and NaN in the file.
    """

    def __init__(self, core: _core.Coupler, *args: Any, **options: Any):
        super().__init__(*args, **options)
        self.core = core
        block = np.empty(self.block.size)
        self.ring: Recording = self.again(self.loads, block)  # whose `begin` stays the first
        size = self.steps_in_memory if self.every is None else self.steps_in_memory // self.every
        self.in_slots = np.full(max(1, size), -1, dtype=np.int64)
        self.read = self.lost = 0
        self.over = threading.Event()
        self.writer: threading.Thread | None = None
        self.failure: BaseException | None = None
        self.wake: Callable[[], object] = lambda: None  # the run looks for `failure`
        self.ring.block[:] = 0.0  # no page is touched for the first time in the run

    def core_record(self) -> CoreRecord:
        return Recording.core_record(self.ring)

    def pauses(self) -> Iterator[int]:
        self.block[: self.ring.block.size] = self.ring.block  # the present, in row 0
        next(super().pauses(), None)  # makes the file
        self.core.set_ring(self.in_slots)
        self.writer = threading.Thread(target=self._write_all, name="pmalpha record_to")
        self.writer.start()
        yield self.end
        self.finish()
        if self.failure is not None:
            raise self.failure

    def release(self) -> None:
        self.finish()
        super().release()

    def finish(self) -> None:
        """All that the core has recorded is written, and the thread at its end."""
        if self.writer is not None:
            self.over.set()
            self.writer.join()
            self.writer = None
            self.core.set_ring(None)

    def keep(self, end: int) -> None:
        """The thread has written all."""

    def history(self, end: int) -> History:
        self.finish()
        if self.file is None:
            return Recording.history(self.ring, end)
        return super().history(end)

    def _write_all(self) -> None:
        while not self.over.wait(INTERVAL):
            self._write_or_fail()
        self._write_or_fail()

    def _write_or_fail(self) -> None:
        """An exception ends the run; of a file that cannot be written, the rows are in memory."""
        try:
            self._write()
        except BaseException as error:
            self.failure = self.failure or error
            self.wake()

    def _write(self) -> None:
        """Write what the core has recorded so far."""
        written, self.lost = self.core.ring(self.read)
        while self.begin < written:
            end = min(written, self.begin + self.steps_in_memory)
            self._copy(end)
            self.read = self._recorded(end)
            self.core.ring(self.read)
            FiledRecording.keep(self, end)  # once: it raises for the first rows alone

    def _recorded(self, step: int) -> int:
        """The number of recorded macro steps from the beginning of the run up to this one."""
        first = self.ring.begin
        return step - first if self.every is None else step // self.every - first // self.every

    def _copy(self, end: int) -> None:
        """The rows of the macro steps from `begin` to `end`."""
        units = np.arange(self._recorded(self.begin), self._recorded(end))
        slots = units % self.in_slots.size
        lost = self.in_slots[slots] != units
        for i, (member, arrays) in enumerate(zip(self.of.members, self.arrays)):
            for name, x in arrays.items():
                empty = 0.0 if OF_SUBDOMAIN[name].is_count else np.nan
                self._take(x, self.ring.arrays[i][name], member.substeps, slots, lost, empty)
            outputs, source = self.output_values[i], self.ring.output_values[i]
            if outputs is not None and source is not None:
                self._take(outputs, source, member.substeps, slots, lost)
        for name, x in self.interface.items():
            self._take(x, self.ring.interface[name], self.of.levels_of(name), slots, lost)
        self._take(self.energy, self.ring.energy, 1, slots, lost)

    def _take(
        self,
        to: np.ndarray,
        ring: np.ndarray,
        levels: int,
        slots: np.ndarray,
        lost: np.ndarray,
        empty: float = np.nan,
    ) -> None:
        levels = levels if self.every is None else 1
        rows = (1 + slots[:, None] * levels + np.arange(levels)).reshape(-1)
        to[1 : 1 + rows.size] = ring[rows]
        to[1 : 1 + rows.size][np.repeat(lost, levels)] = empty


@dataclass(frozen=True)
class Monitored:
    """The last fine steps of a run with `Coupler.monitor`, from `read_monitor`.

    Attributes
    ----------
    step : (k,) array of int
        Numbers of the fine steps, from 0 in each run.
    t : (k,) array
        Time levels at their ends, in the time of the problem.
    due, begun, commanded, returned, ended : (k,) arrays
        As of `Pacing`, in s.
    period : float
        As of `Pacing`.
    command, force : dict of (k, dofs) arrays by name
        What the specimens were commanded and have returned; NaN where they were not evaluated.
    dofs : dict of (dofs,) arrays of int by name
        The dofs of the columns.
    """

    step: np.ndarray
    t: np.ndarray
    due: np.ndarray
    begun: np.ndarray
    commanded: np.ndarray
    returned: np.ndarray
    ended: np.ndarray
    period: float
    command: Mapping[str, np.ndarray]
    force: Mapping[str, np.ndarray]
    dofs: Mapping[str, np.ndarray]

    @property
    def lateness(self) -> np.ndarray:
        """How late each fine step began, (k,), in s."""
        late: np.ndarray = self.begun - self.due
        return late


class MonitorFile:
    """The file, written by one process: a table whose rows are used in turn.

    Before the table are the header and two numbers: of the rows whose writing has begun, and of
    those that are complete.

    path: a new file takes the place of one that is there, which its readers keep.
    about: "period", "t0" and "h" of the fine steps, "dofs" by name of the subdomain.
    """

    def __init__(self, path: str | os.PathLike[str], rows: int, about: Mapping[str, Any]):
        self.rows = rows
        self.columns = columns_of(about["dofs"])
        header = {"format": FORMAT, "version": VERSION, "rows": rows, "columns": self.columns}
        text = json.dumps(header | dict(about)).encode()
        if len(text) > BEGUN:
            raise ValueError(f"a monitor has names and dofs in {HEADER} bytes, got {len(text)}")
        with writing(path) as self.file:
            self.file.write_at(text.ljust(BEGUN), 0)
            self.file.write_at(bytes(HEADER - BEGUN + 8 * rows * self.columns), BEGUN)
            self.file.replace()

    def write(self, first: int, values: np.ndarray) -> None:
        """Fine steps from number `first` on, a row for each."""
        end, last = first + len(values), values[-self.rows :]
        self._write_number(end, BEGUN)
        place = (end - len(last)) % self.rows
        for part, at in ((last[: self.rows - place], place), (last[self.rows - place :], 0)):
            rows = np.ascontiguousarray(part, dtype="<f8")
            self.file.write_at(rows.reshape(-1).view(np.uint8), HEADER + 8 * self.columns * at)
        self._write_number(end, DONE)

    def _write_number(self, number: int, offset: int) -> None:
        self.file.write_at(np.array([number], dtype="<i8"), offset)

    def close(self) -> None:
        self.file.close()


def columns_of(dofs: Mapping[str, Sequence[int]]) -> int:
    return len(TIMES) + 2 * sum(map(len, dofs.values()))


def read_monitor(path: str | os.PathLike[str]) -> Monitored:
    """The last fine steps of a run that is going on, or was the last one.

    Parameters
    ----------
    path : str or path
        That of `Coupler.monitor`.

    Returns
    -------
    Monitored
        Copies; without steps before the first ones were written.

    Raises
    ------
    OSError, ValueError
        For a file that cannot be read, or is another one.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import pmalpha as pm
    >>> rig = pm.rig.SimulatedActuator(pm.CubicSpring([0], k=4.0, k3=0.0))
    >>> mass = pm.Subdomain([1.0], None, scheme=pm.CentralDifference(), restoring=rig, v0=[1.0],
    ...                     name="mass")
    >>> coupler = pm.Coupler([mass], dt=0.001, coupling="gc")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     coupler.monitor(pathlib.Path(folder, "live"))
    ...     history = coupler.run_paced(0.1, on_late="continue")
    ...     last = pm.rig.read_monitor(pathlib.Path(folder, "live"))
    >>> last.force["mass"].shape, bool(np.all(last.due == history.pacing.due))
    ((100, 1), True)
    """
    with reading(path) as buffered:
        try:
            return _read(buffered.raw)  # type: ignore[attr-defined]
        except (AttributeError, ValueError, LookupError, TypeError, ArithmeticError) as error:
            raise ValueError(
                f"path must be a file of Coupler.monitor, {str(path)!r}: {error}"
            ) from None


def _read(file: FileIO) -> Monitored:
    try:
        about = json.loads(file.read(BEGUN))
    except RecursionError:
        raise ValueError("its description has too many brackets in each other") from None
    if about["format"] != FORMAT or about["version"] != VERSION:
        raise ValueError("another format or version")
    rows, dofs = about["rows"], about["dofs"]
    columns = columns_of(dofs)
    size = 8 * rows * columns
    if rows < 1 or HEADER + size > os.fstat(file.fileno()).st_size:
        raise ValueError(f"it is cut off, it must have {rows} rows of {columns} numbers")
    require(size, "the table")
    count = _number(file, DONE)
    file.seek(HEADER)
    table = np.frombuffer(file.read(size), dtype="<f8").reshape(rows, columns)
    # what was begun meanwhile takes the places of the first rows
    begun = max(count, _number(file, BEGUN))
    step = np.arange(max(0, begun - rows), count)
    return _monitored(about, step, table[step % rows].copy(), dofs)


def _number(file: FileIO, offset: int) -> int:
    """A number of the file, as it is now."""
    file.seek(offset)
    return int(np.frombuffer(file.read(8), dtype="<i8")[0])


def _monitored(
    about: Mapping[str, Any], step: np.ndarray, x: np.ndarray, dofs: Mapping[str, Sequence[int]]
) -> Monitored:
    command, force, at = {}, {}, len(TIMES)
    for name, numbers in dofs.items():
        command[name] = x[:, at : at + len(numbers)]
        force[name] = x[:, at + len(numbers) : at + 2 * len(numbers)]
        at += 2 * len(numbers)
    return Monitored(
        step=step,
        t=about["t0"] + (step + 1) * about["h"],
        **{name: x[:, i] for i, name in enumerate(TIMES)},
        period=about["period"],
        command=command,
        force=force,
        dofs={name: np.array(numbers) for name, numbers in dofs.items()},
    )
