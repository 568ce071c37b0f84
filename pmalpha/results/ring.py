"""The record of a paced run, written to a file by a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np

from .history import History
from .quantities import OF_SUBDOMAIN
from .recording import FiledRecording, Recording

# Seconds between two looks for rows to write.
INTERVAL = 0.1


class RingRecording(FiledRecording):
    """A FiledRecording whose rows are written while the core goes on.

    The core records into `ring`, a second set of the arrays whose rows are used in turn; a thread
    copies what is complete from there to the arrays of this one and writes it. What finds no free
    rows is lost, and NaN in the file.

    Parameters
    ----------
    core : _core.Coupler
    path, append, overwrite, and others
        As for `FiledRecording`.
    """

    def __init__(self, core: Any, *args: Any, **options: Any):
        super().__init__(*args, **options)
        self.core = core
        self.ring: Recording = self.again()  # whose `begin` stays the first
        size = self.steps_in_memory if self.every is None else self.steps_in_memory // self.every
        self.held = np.full(max(1, size), -1, dtype=np.int64)
        self.read = self.lost = 0
        self.over = threading.Event()
        self.writer: threading.Thread | None = None
        self.failure: BaseException | None = None
        self.ring.block[:] = 0.0  # no page is touched for the first time in the run

    def core_record(self) -> tuple[Any, ...]:
        return Recording.core_record(self.ring)

    def pauses(self) -> Iterator[int]:
        self.block[: self.ring.block.size] = self.ring.block  # the present, in row 0
        next(super().pauses(), None)  # makes the file
        self.core.set_ring(self.held)
        self.writer = threading.Thread(target=self._write_all, name="pmalpha record_to")
        self.writer.start()
        yield self.end
        self._finish()
        if self.failure is not None:
            raise self.failure

    def __exit__(self, *exception: object) -> None:
        self._finish()
        super().__exit__(*exception)

    def _finish(self) -> None:
        """All that the core has recorded is written, and the thread at its end."""
        if self.writer is not None:
            self.over.set()
            self.writer.join()
            self.writer = None
            self.core.set_ring(None)

    def keep(self, end: int) -> None:
        """The thread has written all."""

    def history(self, end: int) -> History:
        self._finish()
        if self.file is None:
            return Recording.history(self.ring, end)
        return super().history(end)

    def _write_all(self) -> None:
        try:
            while not self.over.wait(INTERVAL):
                self._write()
            self._write()
        except BaseException as error:
            self.failure = error  # the run goes on, and raises it at its end

    def _write(self) -> None:
        """Write what the core has recorded so far."""
        written, self.lost = self.core.ring(self.read)
        while self.begin < written:
            end = min(written, self.begin + self.steps_in_memory)
            self._copy(end)
            self.read = self._recorded(end)
            self.core.ring(self.read)
            FiledRecording.keep(self, end)

    def _recorded(self, step: int) -> int:
        """The number of recorded macro steps from the beginning of the run up to this one."""
        first = self.ring.begin
        return step - first if self.every is None else step // self.every - first // self.every

    def _copy(self, end: int) -> None:
        """The rows of the macro steps from `begin` to `end`."""
        units = np.arange(self._recorded(self.begin), self._recorded(end))
        slots = units % self.held.size
        lost = self.held[slots] != units
        for i, (part, own) in enumerate(zip(self.parts, self.arrays)):
            for name, x in own.items():
                empty = 0.0 if OF_SUBDOMAIN[name].is_count else np.nan
                self._take(x, self.ring.arrays[i][name], part.substeps, slots, lost, empty)
            outputs, given = self.output_values[i], self.ring.output_values[i]
            if outputs is not None and given is not None:
                self._take(outputs, given, part.substeps, slots, lost)
        for name, x in self.interface.items():
            self._take(x, self.ring.interface[name], self._levels_of(name), slots, lost)
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
