"""The HDF5 file of a study: one row for each case, written as it arrives.

All rows of a dataset exist from the first result on, so that a later one changes no structure of
the file: it can be read meanwhile, and after a kill.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..files import PACKAGE_VERSION, checked_path
from .history_file import hdf5_library

FORMAT = "pmalpha Study"
NOT_RUN = b"not run"
# Bytes of the text of an error that are kept.
TEXT = 400


class StudyFile:
    """A file with one dataset of (cases, ...) for each name of the results.

    Parameters
    ----------
    path : str or path
        An existing file is refused.
    count : int
        Number of cases.
    """

    def __init__(self, path: str | os.PathLike[str], count: int):
        h5py = hdf5_library()
        self.count = count
        whole = checked_path(path, "save_to")
        try:
            self.file = h5py.File(whole, "x", locking=False)
        except OSError as error:
            reason = os.strerror(error.errno) if error.errno else str(error)
            message = f"save_to must lead to a new file: {reason}"
            raise OSError(error.errno or errno.EIO, message, str(whole)) from error
        self.file.attrs.update({"format": FORMAT, "pmalpha_version": PACKAGE_VERSION})
        text = np.full(count, NOT_RUN, dtype=f"S{TEXT}")
        self.errors = self.file.create_dataset("error", data=text)
        self.datasets: dict[str, Any] | None = None

    def __enter__(self) -> StudyFile:
        return self

    def __exit__(self, *exception: Any) -> None:
        self.file.close()

    def write(self, k: int, value: Any) -> None:
        """Row k, all or nothing. TypeError, ValueError when it does not fit the other rows."""
        arrays = _arrays(value)
        if self.datasets is None:
            self._create(arrays)
        assert self.datasets is not None
        shapes = {name: x.shape for name, x in arrays.items()}
        expected = {name: x.shape[1:] for name, x in self.datasets.items()}
        if shapes != expected:
            raise ValueError(f"result must have the shapes of the first, {expected}, got {shapes}")
        for name, x in arrays.items():
            self.datasets[name][k] = x
        self.errors[k] = b""
        self.file.flush()

    def fail(self, k: int, error: Exception) -> None:
        """Row k has failed."""
        self.errors[k] = f"{type(error).__name__}: {error}".encode("ascii", "replace")[:TEXT]
        self.file.flush()

    def _create(self, arrays: Mapping[str, np.ndarray]) -> None:
        self.datasets = {
            name: self.file.create_dataset(name, data=np.full((self.count, *x.shape), np.nan))
            for name, x in arrays.items()
        }


def _arrays(value: Any) -> dict[str, np.ndarray]:
    """The result of a case as arrays by name."""
    if not isinstance(value, Mapping) or not value:
        raise TypeError(f"result must return a dict of numbers and arrays, got {value!r}")
    arrays = {}
    for name, given in value.items():
        if not isinstance(name, str) or name == "error" or "/" in name:
            raise ValueError(f"result must have names that a file can have, got {name!r}")
        x = np.asarray(given)
        if x.dtype.kind not in "biuf":
            raise TypeError(f"result[{name!r}] must hold real numbers, got dtype {x.dtype}")
        arrays[name] = x.astype(np.float64)
    return arrays
