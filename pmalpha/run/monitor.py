"""`Coupler.monitor`: paced runs that another process looks at."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from .._checks import whole_number
from ..files import checked_path
from ..problem.dofs import dof_list
from ..results.keys import by_index
from ..results.monitored import MonitorFile
from ..results.pacing import due_times
from .session import Session

# Seconds between two writes.
INTERVAL = 0.05
# Fine steps in one write.
MOST_ROWS = 100_000
# Dofs of each subdomain, unless they are chosen.
MOST = 8


@dataclass(frozen=True)
class Monitor:
    """What later paced runs write: where, how many fine steps, and of which dofs.

    Attributes
    ----------
    path : path
    rows : int
    dofs : dict of (dofs,) arrays by index of the subdomain
    """

    path: Any
    rows: int
    dofs: Mapping[int, np.ndarray]


def monitor(
    session: Session, path: str | PathLike[str] | None, dofs: Mapping[Any, Any] | None, rows: int
) -> None:
    """`Coupler.monitor`."""
    with session.guard:
        if path is None:
            session.monitor = None
            return
        with_functions = {i: s for i, (_, s) in enumerate(session.keys) if s.has_functions}
        if dofs is None:
            chosen = {i: np.arange(min(s.n, MOST)) for i, s in with_functions.items()}
        else:
            chosen = {}
            for i, own in by_index(dofs, session.keys, "dofs").items():
                name, s = session.keys[i]
                if i not in with_functions:
                    raise ValueError(f"dofs[{name!r}] must be of a specimen, a restoring function")
                every = np.arange(s.n)
                chosen[i] = every if own is None else dof_list(own, s.n, f"dofs[{name!r}]")
        rows = whole_number(rows, "rows", low=1)
        session.monitor = Monitor(checked_path(path, "path"), rows, chosen)


class Watched:
    """The commands and forces of a paced run, and the thread that writes them."""

    def __init__(self, session: Session, period: float, times: np.ndarray):
        chosen: Monitor | None = session.monitor
        dofs = {} if chosen is None else chosen.dofs
        self.monitored = tuple(
            (part.position[dofs[i]].astype(np.int64), np.zeros((2, len(dofs[i]))))
            if i in dofs
            else None
            for i, part in enumerate(session.parts)
        )
        columns = sum(last.size for _, last in filter(None, self.monitored))
        self.values = np.full((times.shape[1], columns), np.nan)
        self.times, self.period, self.done = times, period, 0
        self.session, self.chosen = session, chosen

    @contextmanager
    def written(self) -> Iterator[None]:
        """A context in which the thread writes what the core has done."""
        if self.chosen is None:
            yield
            return
        clock, names = self.session.clock, [part.name for part in self.session.parts]
        about = {
            "period": 1e-9 * self.period,
            "t0": clock.time(self.session.core.step_count),
            "h": clock.dt / self.session.fine,
            "dofs": {names[i]: own.tolist() for i, own in sorted(self.chosen.dofs.items())},
        }
        file, over = MonitorFile(self.chosen.path, self.chosen.rows, about), threading.Event()
        due = due_times(self.period, self.times.shape[1])

        def write() -> None:
            while not over.wait(INTERVAL):
                self._write(file, due)

        writer = threading.Thread(target=write, name="pmalpha monitor")
        writer.start()
        try:
            yield
        finally:
            over.set()
            writer.join()
            self._write(file, due)
            file.close()

    def _write(self, file: MonitorFile, due: np.ndarray) -> None:
        # when they ended is written last
        left = np.isnan(self.times[3, self.done : self.done + MOST_ROWS])
        end = self.done + (int(np.argmax(left)) if left.any() else left.size)
        new = slice(self.done, end)
        if end > self.done:
            file.write(
                self.done, np.column_stack([due[new], *self.times[:, new], self.values[new]])
            )
            self.done = end
