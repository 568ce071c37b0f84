"""The HDF5 file of a `Study`: a dataset for each result, a row for each case."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..files import HDF5, Held, checked_path, held, package_version, uninterrupted, writing
from .array_file import hdf5_library, lay_out, reserve

FORMAT = "pmalpha Study"
# Of the dataset with the texts of errors: where a case has not run, and bytes that are kept.
ERRORS, NOT_RUN, TEXT = "error", b"not run", 400
# Bytes of NaN that are written at a time.
PIECE = 1 << 20


class StudyFile:
    """A file to which the results of `count` cases are written as they arrive.

    Its structure never changes: with the first result a file with all rows, NaN, takes the place of
    the one without results. So it can be read meanwhile, and after a kill.
    """

    def __init__(self, path: str | os.PathLike[str], count: int):
        hdf5_library()
        self.path = Path(os.path.realpath(checked_path(path, "save_to", HDF5)))
        self.texts = np.full(count, NOT_RUN, dtype=f"S{TEXT}")
        self.shapes: dict[str, tuple[int, ...]] = {}
        old = _without_results(self.path)
        try:
            self.file, self.offsets = self._made(old)
        finally:
            if old is not None:
                old.close()

    def __enter__(self) -> StudyFile:
        return self

    def __exit__(self, *exception: object) -> None:
        with suppress(OSError):
            self.file.sync()
        self.file.close()

    def _made(self, old: Held | None) -> tuple[Held, dict[str, int | None]]:
        """A file with the present shapes and texts, which takes the name of the old one, and the
        offsets of its datasets."""
        offsets: dict[str, int | None] = {}
        with writing(self.path, "save_to", "must lead to a new file that can be written") as new:
            lay_out(new, partial(self._describe, offsets))
            for name in self.shapes:
                self._write_nan(new, name, offsets[name])
            new.lock(exclusive=True)
            new.take_name(old)
        self.size = new.size
        return new, offsets

    def _describe(self, offsets: dict[str, int | None], h5py: ModuleType, root: Any) -> None:
        root.attrs.update({"format": FORMAT, "pmalpha_version": package_version()})
        errors = root.create_dataset(ERRORS, data=self.texts)
        offsets[ERRORS] = errors.id.get_offset()
        for name, shape in self.shapes.items():
            rows = (len(self.texts), *shape)
            offsets[name] = reserve(h5py, root, name, rows, h5py.h5t.IEEE_F64LE)

    def _write_nan(self, file: Held, name: str, offset: int | None) -> None:
        count = len(self.texts) * _numbers(self.shapes[name])
        nan = np.full(min(count, PIECE // 8), np.nan, dtype="<f8")
        for begin in range(0, count, PIECE // 8):
            if offset is not None:
                file.write_at(nan[: count - begin], offset + 8 * begin)

    def write(self, k: int, result: Any) -> None:
        """The result of case k; TypeError or ValueError for one that no file has, or of other
        shapes than the first one, and nothing is written."""
        arrays = checked_arrays(result, self.shapes)
        if not self.shapes:
            self.shapes, old = {name: x.shape for name, x in arrays.items()}, self.file
            try:
                self.file, self.offsets = self._made(old)
            except BaseException:
                self.shapes = {}
                raise
            old.close()
        for name, x in arrays.items():
            offset = self.offsets[name]
            if offset is not None:
                self._write_at(x.astype("<f8").reshape(-1), offset + 8 * x.size * k)

    def write_text(self, k: int, text: str) -> None:
        """The text of the error of case k, after its result; empty without one."""
        self.texts[k] = text.encode("ascii", "replace")[:TEXT]
        offset = self.offsets[ERRORS]
        assert offset is not None
        self._write_at(self.texts[k : k + 1], offset + TEXT * k)

    def _write_at(self, array: np.ndarray, offset: int) -> None:
        try:
            self.file.check_has(self.size)
            self.file.write_at(array.view(np.uint8), offset)
        except OSError as error:
            message = f"save_to cannot be written: {error.strerror}"
            raise OSError(error.errno, message, str(self.path)) from error


def _numbers(shape: tuple[int, ...]) -> int:
    return int(np.prod(shape, dtype=np.int64))


def _without_results(path: Path) -> Held | None:
    """The file of a study that ended before its first result, locked; None for any other."""
    try:
        file = held(path, "save_to")
    except OSError:
        return None
    try:
        if uninterrupted(_has_no_results, file):
            return file
    except Exception:  # of a dozen types, for files that are no HDF5
        pass
    file.close()
    return None


def _has_no_results(file: Held) -> bool:
    with file.reader() as content, hdf5_library().File(content, "r") as root:
        return root.attrs.get("format") == FORMAT and list(root) == [ERRORS]


def checked_arrays(value: Any, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """The result of a case as arrays by name; these shapes if there was one before."""
    if not isinstance(value, Mapping) or not value:
        raise TypeError(f"result must return a dict of numbers and arrays, got {value!r}")
    if any(not isinstance(name, str) or name in ("error", "") or "/" in name for name in value):
        raise ValueError(f"result must have names that a file can have, got {list(value)}")
    arrays = {name: np.asarray(x) for name, x in value.items()}
    wrong = [name for name, x in arrays.items() if x.dtype.kind not in "biuf"]
    if wrong:
        raise TypeError(f"result[{wrong[0]!r}] must hold real numbers, got {value[wrong[0]]!r}")
    got = {name: x.shape for name, x in arrays.items()}
    if shapes and got != shapes:
        raise ValueError(f"result must have the shapes of the first, {dict(shapes)}, got {got}")
    return {name: x.astype(np.float64) for name, x in arrays.items()}
