"""The rows of an HDF5 file of an earlier run, which a run continues."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .history_file import read, row_count
from .quantities import OF_SUBDOMAIN, of_columns


def check_new(path: Path) -> None:
    """FileExistsError for a file that neither `append` nor `overwrite` allows to change."""
    if path.exists():
        why = (
            "record_to must lead to a new file, got one that exists; append=True continues it, "
            "overwrite=True replaces it"
        )
        raise FileExistsError(errno.EEXIST, why, str(path))


class EarlierRows:
    """The complete rows of a file of ``run(record_to=)`` up to the present macro step.

    Parameters
    ----------
    path : Path
    present : int
        The macro step at which the run continues. Rows after it are left out: those that were
        written after the checkpoint from which the run continues.

    Raises
    ------
    ValueError
        For any other file; for a file that ends before the present or begins at it or after it.
    """

    def __init__(self, path: Path, present: int):
        self.path, self.present = path, present
        self.header, self.all_rows = read(path)
        if not self.header["nodes"]:
            self._refuse("must be a file of run(record_to=), not of History.save")
        self.begin, last = self.header["begin"], self.header["step_count"]
        if present > last or (present <= self.begin and present != last):
            self._refuse(
                f"must reach macro step {present}, the present, from an earlier one; it has those "
                f"from {self.begin} to {last}"
            )
        self.arrays = {
            name: x[: self._rows(name)] if name in self.header["nodes"] else x
            for name, x in self.all_rows.items()
        }

    def _rows(self, name: str) -> int:
        levels = self.header["nodes"][name]
        return row_count(self.begin, self.present, self.header["every"], levels)

    @property
    def has_present(self) -> bool:
        """Whether the last rows are at the present."""
        every = self.header["every"]
        result: bool = every == 0 or self.present % every == 0 or self.present == self.begin
        return result

    def check(self, header: Mapping[str, Any], first: Mapping[str, np.ndarray]) -> None:
        """ValueError unless a run with this header and these first rows continues the file."""
        for name in ("names", "recorded", "every", "fixed", "dt", "outputs"):
            if name in self.header and name in header and self.header[name] != header[name]:
                self._refuse("must be of the same coupler, dt and recorded quantities")
        nodes = self.header["nodes"]
        if nodes.keys() != header["nodes"].keys():
            self._refuse("must be of the same coupler, dt and recorded quantities")
        if header["every"] == 0 and nodes != header["nodes"]:
            self._refuse(
                "must be of the present numbers of substeps, it has other numbers of substeps; "
                "record to a new file after a change, or with every"
            )
        for name, x in self.arrays.items():
            if name in header["fixed"]:
                same = np.array_equal(x, first[name])
            else:
                same = x.shape[1:] == first[name].shape[1:]
            if not same:
                self._refuse("must be of the same coupler, dt and recorded quantities")
        if not self.has_present:
            return
        motion = tuple(f".{name}" for name in ("t", *of_columns(OF_SUBDOMAIN, "dofs")))
        states = [x for x in header["nodes"] if x.endswith(motion) or ".outputs." in x]
        if any(not np.array_equal(self.arrays[x][-1], first[x][0]) for x in states):
            self._refuse("must have the present state of the coupler, it has another at this time")

    def _refuse(self, rule: str) -> None:
        raise ValueError(f"append: {str(self.path)!r} {rule}")
