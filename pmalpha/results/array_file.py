"""HDF5 files that are laid out first and then written by offsets, without HDF5.

HDF5 crashes where the disk is full, and a file that it has not closed is damaged. So it writes what
describes the arrays into memory (`Layout`), or to a file that keeps errors for later (`Output`).
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from types import ModuleType
from typing import Any, BinaryIO

from ..files import NewFile, library, uninterrupted
from ..memory import require_space

# Bytes of address space below which HDF5 is not called: without memory it ends the process.
SPACE = 32_000_000
# What was written is synchronised before it is counted, about every third of a second.
SYNC_SECONDS = 0.3


def hdf5_library() -> Any:
    return library("h5py", "an HDF5 file", "'pmalpha[hdf5]'")


def lay_out(file: NewFile, describe: Callable[[ModuleType, Any], None]) -> None:
    """Write an HDF5 file in which the function makes datasets and attributes.

    Arrays of `reserve` are holes, at the offsets that it returns.
    """
    require_space(SPACE, "an HDF5 file")
    layout = Layout()
    try:
        uninterrupted(_described, layout, describe)
    except (OverflowError, RuntimeError, ValueError) as error:  # too large for HDF5
        raise OSError(errno.EFBIG, str(error)) from error
    file.resize(layout.size)
    for offset, piece in layout.pieces:
        file.write_at(piece, offset)


def _described(layout: Layout, describe: Callable[[ModuleType, Any], None]) -> None:
    h5py = hdf5_library()
    with h5py.File(
        layout,
        "w",
        libver=("v110", "v110"),  # the first version that can be read during writing
        alignment_threshold=1,
        alignment_interval=8,
    ) as root:
        describe(h5py, root)


def reserve(
    h5py: ModuleType, root: Any, name: str, shape: tuple[Any, ...], kind: Any
) -> int | None:
    """Allocate a contiguous array, not written: its offset in the file, None if it is empty."""
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    how.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    link = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    link.set_create_intermediate_group(True)
    space = h5py.h5s.create_simple(shape)
    result: int | None = h5py.h5d.create(
        root.id, name.encode(), kind, space, how, link
    ).get_offset()
    return result


class Sequential:
    """The position in what HDF5 takes for a file."""

    def __init__(self) -> None:
        self.position = self.size = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        origin = {os.SEEK_SET: 0, os.SEEK_CUR: self.position, os.SEEK_END: self.size}[whence]
        self.position = origin + offset
        return self.position

    def tell(self) -> int:
        return self.position

    def write(self, piece: Any) -> int:
        self.take(piece)
        self.position += len(piece)
        self.size = max(self.size, self.position)
        return len(piece)

    def take(self, piece: Any) -> None:
        raise NotImplementedError

    def fill(self, out: Any) -> None:
        raise NotImplementedError

    def readinto(self, out: Any) -> int:
        out[:] = bytes(len(out))
        self.fill(out)
        self.position += len(out)
        return len(out)

    def read(self, size: int) -> bytes:
        out = bytearray(size)
        self.readinto(out)
        return bytes(out)

    def truncate(self, size: int | None = None) -> int:
        self.size = self.position if size is None else size
        return self.size

    def flush(self) -> None:
        pass


class Layout(Sequential):
    """A sparse file in memory, in which HDF5 allocates the arrays."""

    def __init__(self) -> None:
        super().__init__()
        self.pieces: list[tuple[int, bytes]] = []  # (offset, bytes), later ones overwrite

    def take(self, piece: Any) -> None:
        self.pieces.append((self.position, bytes(piece)))

    def fill(self, out: Any) -> None:
        first, last = self.position, self.position + len(out)
        for offset, piece in self.pieces:
            begin, end = max(offset, first), min(offset + len(piece), last)
            if begin < end:
                out[begin - first : end - first] = piece[begin - offset : end - offset]


class Output(Sequential):
    """A file on the disk, of whose errors HDF5 does not learn: `check` raises the first one."""

    def __init__(self, file: BinaryIO):
        super().__init__()
        self.file = file
        self.error: OSError | None = None

    def take(self, piece: Any) -> None:
        try:
            if self.error is None:
                self.file.seek(self.position)
                self.file.write(piece)
        except OSError as error:
            self.error = error

    def fill(self, out: Any) -> None:
        self.file.seek(self.position)
        piece = self.file.read(len(out))
        out[: len(piece)] = piece

    def check(self) -> None:
        if self.error is not None:
            raise self.error
