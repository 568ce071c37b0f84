"""A History in an HDF5 file that a run writes while it goes on.

All arrays of the whole run are laid out before the first step, contiguous, in a file that HDF5 then
closes. From there on rows are written to their places without HDF5, and last the number of the
macro step up to which they are whole. So at every moment it is a whole file, which others read
meanwhile without a lock, and a kill leaves all that was counted before. Rows that are not written
yet take no room on disk.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..files import checked_path, mismatch, reading, replacing

# What a file says of itself, how one begins, and where the macro step is counted.
FORMAT, VERSION = "pmalpha History", 1
SIGNATURE = b"\x89HDF\r\n\x1a\n"
COUNTER = "step_count"
# At most so many bytes are written by one call of the system.
MOST = 1 << 30


def row_count(begin: int, end: int, every: int, nodes: int) -> int:
    """Rows from macro step `begin` to `end` of a grid with so many nodes in a macro step.

    The first row is that of `begin`. With `every` not zero, macro nodes whose number it divides.
    """
    if every == 0:
        return 1 + (end - begin) * nodes
    return 1 + end // every - begin // every


class HistoryFile:
    """The rows of a run on their way into a file.

    Parameters
    ----------
    path : str or path
        A file that stands there is replaced when the new one is laid out.
    header : dict
        As `History` keeps it, with "begin" and "every" of the run, and "nodes", the nodes in a
        macro step of each array that grows.
    arrays : dict
        The first rows of the arrays that grow, and those that stay as they are.
    end : int
        The macro step at which the run ends.

    Raises
    ------
    ImportError
        If h5py is missing.
    OSError
        When the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike,
        header: Mapping[str, Any],
        arrays: Mapping[str, np.ndarray],
        end: int,
    ):
        h5py = library()
        self.path, self.header = Path(os.path.abspath(checked_path(path))), dict(header)
        self.places: dict[str, int] = {}
        self.descriptor = -1
        with replacing(path) as file:
            layout = Layout()
            try:
                # in a thread no signal raises an exception, which HDF5 would not pass on
                with ThreadPoolExecutor(1) as pool:
                    pool.submit(self._lay_out, h5py, layout, arrays, end).result()
            except (OverflowError, RuntimeError, ValueError) as error:  # more than HDF5 can hold
                raise OSError(errno.EFBIG, str(error)) from error
            self.descriptor = os.dup(file.fileno())
            try:
                os.truncate(self.descriptor, layout.size)
                for place, piece in layout.pieces:
                    self._put(np.frombuffer(piece, np.uint8), place)
                self._put_rows({name: x[:1] for name, x in arrays.items()}, lambda name: 0)
                self._count(self.header["begin"])
            except BaseException:
                self.close()
                raise

    def _lay_out(self, h5py: ModuleType, layout: Layout, arrays: Mapping, end: int) -> None:
        with h5py.File(
            layout,
            "w",
            libver=("v110", "v110"),  # the first that is read while it is written
            alignment_threshold=1,
            alignment_interval=8,
        ) as whole:
            whole["header"] = json.dumps(self.header)
            self.counter = reserve(h5py, whole, COUNTER, (1,), h5py.h5t.STD_I64LE)
            for name, x in arrays.items():
                if name not in self.header["nodes"]:
                    whole[dataset(name)] = x
                    continue
                shape = (self.rows(name, end), *x.shape[1:])
                place = reserve(h5py, whole, dataset(name), shape, h5py.h5t.IEEE_F64LE)
                if place is not None:
                    self.places[name] = place

    def rows(self, name: str, end: int) -> int:
        """Rows of an array up to macro step `end`."""
        header = self.header
        return row_count(header["begin"], end, header["every"], header["nodes"][name])

    def write(self, arrays: Mapping[str, np.ndarray], begin: int, end: int) -> None:
        """The rows after macro step `begin` up to `end`. The first of each array is left out: it
        was the last of the stretch before."""
        try:
            later = {name: x[1:] for name, x in arrays.items()}
            self._put_rows(later, lambda name: self.rows(name, begin))
            self._count(end)
        except OSError as error:
            message = f"record_to cannot be written: {error.strerror}"
            raise OSError(error.errno, message, str(self.path)) from error

    def _put_rows(self, arrays: Mapping[str, np.ndarray], first: Callable[[str], int]) -> None:
        for name, place in self.places.items():
            rows = np.ascontiguousarray(arrays[name], dtype="<f8")
            self._put(rows, place + 8 * int(np.prod(rows.shape[1:])) * first(name))

    def _count(self, step: int) -> None:
        self._put(np.array([step], dtype="<i8"), self.counter)

    def _put(self, array: np.ndarray, place: int) -> None:
        left = memoryview(array.reshape(-1).view(np.uint8))
        while len(left):
            done = os.pwrite(self.descriptor, left[:MOST], place)
            left, place = left[done:], place + done

    def close(self) -> None:
        if self.descriptor >= 0:
            os.close(self.descriptor)
        self.descriptor = -1


class Layout:
    """A file in memory for HDF5 to lay out, which writes little and far apart.

    HDF5 itself would not survive a full disk: it fails when it closes the file.
    """

    def __init__(self) -> None:
        self.pieces: list[tuple[int, bytes]] = []  # later ones over earlier ones
        self.place = self.size = 0

    def seek(self, place: int, whence: int = os.SEEK_SET) -> int:
        self.place = (
            place + {os.SEEK_SET: 0, os.SEEK_CUR: self.place, os.SEEK_END: self.size}[whence]
        )
        return self.place

    def tell(self) -> int:
        return self.place

    def write(self, piece: Any) -> int:
        self.pieces.append((self.place, bytes(piece)))
        self.place += len(piece)
        self.size = max(self.size, self.place)
        return len(piece)

    def readinto(self, out: Any) -> int:
        first, last = self.place, self.place + len(out)
        out[:] = bytes(len(out))
        for place, piece in self.pieces:
            begin, end = max(place, first), min(place + len(piece), last)
            if begin < end:
                out[begin - first : end - first] = piece[begin - place : end - place]
        self.place = last
        return len(out)

    def read(self, size: int) -> bytes:
        out = bytearray(size)
        self.readinto(out)
        return bytes(out)

    def truncate(self, size: int | None = None) -> int:
        self.size = self.place if size is None else size
        return self.size

    def flush(self) -> None:
        pass


def reserve(h5py: ModuleType, whole: Any, name: str, shape: tuple, kind: Any) -> int | None:
    """Where a contiguous array is from now on, None where it is empty; nothing is written to it."""
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    how.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    link = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    link.set_create_intermediate_group(True)
    space = h5py.h5s.create_simple(shape)
    return h5py.h5d.create(whole.id, name.encode(), kind, space, how, link).get_offset()


def dataset(name: str) -> str:
    """Where HDF5 has an array: those of subdomain 0 in group "0"."""
    return name.replace(".", "/")


def library() -> ModuleType:
    try:
        import h5py
    except ImportError as error:
        raise ImportError("HDF5 files need h5py: pip install 'pmalpha[hdf5]'") from error
    return h5py


def write(
    path: str | os.PathLike, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """A History that is whole: arrays of which none grows any more. Raises as `HistoryFile`."""
    whole = {**header, "begin": 0, "every": 0, "nodes": {}, "fixed": sorted(arrays)}
    HistoryFile(path, whole, arrays, end=0).close()


def is_hdf5(path: str | os.PathLike) -> bool:
    with reading(path) as file:
        return file.read(len(SIGNATURE)) == SIGNATURE


def read(path: str | os.PathLike) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file, up to the macro step that was counted last.

    The arrays that grow are mapped, not read: what is looked at is read from the file.

    Raises
    ------
    ImportError
        If h5py is missing.
    ValueError
        For any other file, or a damaged one, saying why.
    """
    h5py, name = library(), str(checked_path(path))
    try:
        with h5py.File(name, "r", locking=False) as whole:
            header = json.loads(whole["header"][()]) if "header" in whole else None
            reason = mismatch(header, FORMAT, VERSION)
            if reason is None:
                content = np.asarray(np.memmap(name, np.uint8, "r"))
                return header, _arrays(whole, header, content)
    except MemoryError:
        raise
    except Exception as error:  # h5py raises a dozen kinds for damage
        reason = f"is damaged or cut off: {error}"
    raise ValueError(f"path must lead to a file of format {FORMAT!r}, but {name!r} {reason}")


def _arrays(whole: Any, header: Mapping[str, Any], content: np.ndarray) -> dict[str, np.ndarray]:
    step = int(whole[COUNTER][0])
    arrays = {}
    for name, nodes in header["nodes"].items():
        rows = row_count(header["begin"], step, header["every"], nodes)
        arrays[name] = _mapped(whole[dataset(name)], rows, content)
    for name in header["fixed"]:
        arrays[name] = whole[dataset(name)][...]
    return arrays


def _mapped(made: Any, rows: int, content: np.ndarray) -> np.ndarray:
    """The first rows of an array in the file; read where another program has packed them."""
    shape = (rows, *made.shape[1:])
    place = made.id.get_offset()
    if rows > made.shape[0]:
        raise ValueError(f"{made.name} has fewer rows than were counted")
    if place is None or made.dtype != np.dtype("<f8"):
        return made[:rows]
    size = 8 * int(np.prod(shape))
    return content[place : place + size].view("<f8").reshape(shape)
