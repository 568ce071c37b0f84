"""A History in an HDF5 file that is written during the run.

All arrays of the run are allocated before the first step, contiguous, in a file that HDF5 then
closes. After that, rows are written at their offsets without HDF5, followed by the number of the
macro step up to which they are complete. So the file is valid at any time: other programs read it
during the run without a lock, and after a kill it has all rows up to that number. Rows that are not
yet written take no space on disk.
"""

from __future__ import annotations

import errno
import io
import json
import mmap
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any, BinaryIO

import numpy as np

from ..files import (
    Held,
    checked_path,
    mismatch,
    package_version,
    reading,
    replacing,
    uninterrupted,
    writing,
)
from ..memory import require
from . import array_file
from .array_file import hdf5_library, lay_out, reserve
from .quantities import IN_INTERFACE, IN_SUBDOMAIN, OF_INTERFACE, OF_SUBDOMAIN, times_name

# By the last component of the HDF5 path: what the array is, and its unit.
TABLE = OF_SUBDOMAIN | OF_INTERFACE
ARRAYS = {name: (x.what, x.unit) for name, x in TABLE.items()}
ARRAYS["step_count"] = ("macro steps up to which all rows are written", "1")
ENERGY = ("a row for each macro time level, a column for each subdomain", "F u")
CONSERVED = (
    "a share in the conserved quantity, " + ENERGY[0],
    "F u / t^2; F u under mean coupling",
)

OUTPUT = "linear combinations of u, v and a, a row for each time level"
UNITS = "any consistent system, that of the matrices, u and dt; F is the unit of K u"
# In the header; the first bytes of an HDF5 file; the dataset with the last complete macro step.
FORMAT, VERSION = "pmalpha History", 1
SIGNATURE = b"\x89HDF\r\n\x1a\n"
COUNTER = "step_count"
# Bytes of growing arrays up to which they are read, not mapped: no more than a run to a file keeps.
READ_BYTES = 16e6
# Bytes that one byte of a packed array can hold, of which deflate makes at most 1032.
PACKED = 1032
# What is finite at every time level of a run.
STATES = {name for name, x in TABLE.items() if x.is_state}


def describe(root: Any, header: Mapping[str, Any]) -> None:
    """Write the attributes of a file whose datasets exist."""
    root.attrs.update(
        {
            "format": header["format"],
            "format_version": header["version"],
            "pmalpha_version": package_version(),
            "units": UNITS,
        }
    )
    numbers = {group: i for i, group in enumerate(header["groups"])}
    for key, item in root.items():
        if key in numbers:
            i = numbers[key]
            item.attrs["name"] = storable(header["names"][i])
            for k, array in item.get("outputs", {}).items():
                output = storable(header["outputs"][i][int(k)])
                array.attrs.update({"name": output, "description": OUTPUT})
            if names := header["dof_names"][i]:  # of the columns of u, v and a
                item["dof_names"] = np.array([storable(name).encode() for name in names])
                item["dof_names"].attrs["description"] = "names of the recorded dofs, utf-8"
        for name, array in item.items() if hasattr(item, "items") else [(key, item)]:
            of_energy = CONSERVED if name == "conserved" else ENERGY
            known = of_energy if key == "energy" else ARRAYS.get(name)
            if known is not None:
                array.attrs.update(zip(("description", "units"), known))
                times = "macro_times"
                if key != "energy" and name in TABLE:
                    times = times_name(TABLE[name], header["coupling"])
                if times:
                    array.attrs["times"] = times


def storable(name: str) -> str:
    """The name without what HDF5 cannot store in a string: lone surrogates and zeros."""
    return name.encode("utf-8", "replace").decode().replace("\0", "?")


def row_count(begin: int, end: int, every: int, levels: int) -> int:
    """Number of rows from macro step `begin` to `end`, with `levels` time levels per macro step.

    The first row is at `begin`. If `every` is not zero, the others are the macro time levels whose
    number is a multiple of it.
    """
    if every == 0:
        return 1 + (end - begin) * levels
    return 1 + end // every - begin // every


class HistoryFile:
    """A file to which a run writes the rows of its arrays, locked until it is closed.

    path: of the file.
    header: from `contents_of`, with "begin" and "every" of the run, and "nodes", the number of time
        levels per macro step of each growing array.
    arrays: the rows of the growing arrays up to `start`, and all rows of the others.
    start: the macro step up to which the arrays are complete. Default: "begin".
    old: the file that has the name, locked, which is replaced; without it the name must be new.
    saves: replace whatever has the name; nothing is written later.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        header: Mapping[str, Any],
        arrays: Mapping[str, np.ndarray],
        end: int,
        start: int | None = None,
        old: Held | None = None,
        saves: bool = False,
    ):
        start = header["begin"] if start is None else start
        with writing(path) as self.file:
            self._fill(header, arrays, end, start)
            if saves:
                self.file.replace()
            else:
                self.file.lock(exclusive=False)
                self.file.take_name(old)
        self.path, self.size = self.file.path, self.file.size
        self.written, self.synced = start, perf_counter()

    def _fill(
        self, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray], end: int, start: int
    ) -> None:
        self.header = {**header, "groups": group_names(header["names"])}
        self.offsets: dict[str, int] = {}  # in bytes, of the growing arrays
        lay_out(self.file, partial(self._allocate, arrays, end))
        self._write_rows(
            {name: arrays[name][: self.rows(name, start)] for name in self.offsets},
            lambda name: 0,
        )
        self._write_step(start)

    def _allocate(self, arrays: Mapping[Any, Any], end: int, h5py: ModuleType, root: Any) -> None:
        root["header"] = header_text(self.header)
        counter = reserve(h5py, root, COUNTER, (1,), h5py.h5t.STD_I64LE)
        assert counter is not None  # as for an array without numbers
        self.counter = counter
        for name, x in arrays.items():
            if name not in self.header["nodes"]:
                root[dataset(name, self.header)] = x
                continue
            shape = (self.rows(name, end), *x.shape[1:])
            path = dataset(name, self.header)
            offset = reserve(h5py, root, path, shape, h5py.h5t.IEEE_F64LE)
            if offset is not None:
                self.offsets[name] = offset
        describe(root, self.header)

    def rows(self, name: str, end: int) -> int:
        """Number of rows of an array up to macro step `end`."""
        header = self.header
        return row_count(header["begin"], end, header["every"], header["nodes"][name])

    def write(self, arrays: Mapping[str, np.ndarray], begin: int, end: int) -> None:
        """Write the rows after macro step `begin` up to `end`.

        The first row of each array is at `begin` and already written: it is skipped. OSError also
        where another program has truncated the file, or its name leads to another one.
        """
        try:
            self.file.check_has(self.size)
            later = {name: x[1:] for name, x in arrays.items()}
            self._write_rows(later, lambda name: self.rows(name, begin))
            self.written = end
            if perf_counter() - self.synced >= array_file.SYNC_SECONDS:
                self.count()
        except OSError as error:
            message = f"record_to cannot be written: {error.strerror}"
            raise OSError(error.errno, message, str(self.path)) from error

    def count(self) -> None:
        """Count what was written, after it is on the disk: a count never is there without rows."""
        self.file.sync()
        self._write_step(self.written)
        self.synced = perf_counter()

    def _write_rows(self, arrays: Mapping[str, np.ndarray], first: Callable[[str], int]) -> None:
        for name, offset in self.offsets.items():
            rows = np.ascontiguousarray(arrays[name], dtype="<f8")
            place = offset + 8 * int(np.prod(rows.shape[1:])) * first(name)
            self.file.write_at(rows.reshape(-1).view(np.uint8), place)

    def _write_step(self, step: int) -> None:
        self.file.write_at(np.array([step], dtype="<i8"), self.counter)

    def contents(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Header and arrays up to the last macro step that was written, as from `read`."""
        with self.file.reader() as file:
            return read_open(file, self.path, may_lead=False, last=self.written)

    def close(self) -> None:
        if self.file.is_open:
            with suppress(OSError):
                self.file.sync()
        self.file.close()


def output_array(i: int, k: int) -> str:
    """The name of the array of output k of subdomain i; the header has the user's name of it."""
    return f"{i}.outputs.{k}"


def dataset(name: str, header: Mapping[str, Any]) -> str:
    """The HDF5 path of an array: those of a subdomain are in the group of its name."""
    first, *rest = name.split(".")
    groups = header.get("groups")  # None in files of older versions, whose groups are numbers
    if first.isdecimal() and groups is not None:
        first = groups[int(first)]
    return "/".join([first, *rest])


def group_names(names: Sequence[str]) -> list[str]:
    """The names of subdomains as those of HDF5 groups: different, and without what these lack."""
    taken = {"header", COUNTER, "energy", *OF_INTERFACE}
    groups = []
    for i, name in enumerate(names):
        group = storable(name).replace("/", "_")
        if group in taken or not group.strip("."):
            group = f"{group} ({i})"
        while group in taken:
            group += "_"
        taken.add(group)
        groups.append(group)
    return groups


def write(
    path: str | os.PathLike[str],
    header: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    *,
    is_new: bool = False,
) -> None:
    """Write a complete History, without growing arrays, in place of what has the name; if it is to
    be new, FileExistsError where it is not."""
    header = {**header, "begin": 0, "every": 0, "nodes": {}, "fixed": sorted(arrays)}
    HistoryFile(path, header, arrays, end=0, saves=not is_new).file.close()


def is_hdf5(file: BinaryIO) -> bool:
    """Whether an open file is one of HDF5, from its beginning on."""
    file.seek(0)
    return file.read(len(SIGNATURE)) == SIGNATURE


def read(
    path: str | os.PathLike[str], *, may_lead: bool = True
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file, up to the last complete macro step. That is "step_count" in the
    header. Growing arrays beyond `READ_BYTES` are mapped and read on access. With `may_lead` it may
    be a file of `write_master`, which leads to others in its folder."""
    with reading(path) as file:
        return read_open(file, path, may_lead=may_lead)


def read_open(
    file: BinaryIO,
    path: str | os.PathLike[str],
    *,
    may_lead: bool = True,
    last: int | None = None,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The same of an open file, that of `path`; `last` instead of what it counts."""
    name = str(checked_path(path))
    try:
        reason, header, arrays = uninterrupted(_contents, hdf5_library(), file, last)
        if reason is None and "files" in header and may_lead:
            return _of_all_ranks(Path(name), header)
    except (ImportError, MemoryError):
        raise
    except Exception as error:  # of a dozen types, for damaged files
        if isinstance(error, OSError) and error.errno == errno.ENOMEM:
            raise MemoryError(f"{name!r} cannot be mapped: {error.strerror}") from error
        reason = f"is damaged or cut off: {error}"
    if reason is not None:
        raise ValueError(f"path must lead to a file of format {FORMAT!r}, but {name!r} {reason}")
    return header, arrays


def _contents(
    h5py: ModuleType, file: BinaryIO, last: int | None
) -> tuple[str | None, dict[str, Any], dict[str, np.ndarray]]:
    """The reason to refuse the file or None, its header and its arrays."""
    with h5py.File(file, "r") as root:
        header: Any = json.loads(own_array(root, "header")[()]) if "header" in root else None
        reason = mismatch(header, FORMAT, VERSION)
        if reason is not None or "files" in header:
            return reason, header, {}
        header["step_count"] = int(own_array(root, COUNTER)[0]) if last is None else last
        return None, header, _arrays(root, header, file)


def header_text(header: Mapping[str, Any]) -> np.bytes_:
    """A header as text of fixed length, which `own_array` demands."""
    return np.bytes_(json.dumps(header).encode())


def write_master(
    path: Path, files: Sequence[str], first: Sequence[int], names: Sequence[str]
) -> None:
    """Write the file that reads as one History of the files of several ranks beside it.

    first: the number of the first subdomain of each rank, and the number of all.
    """
    h5py, groups = hdf5_library(), group_names(names)
    content = io.BytesIO()
    with h5py.File(content, "w") as root:
        header = {"format": FORMAT, "version": VERSION, "files": list(files)}
        root["header"] = header_text(header)
        for rank, name in enumerate(files):
            span = slice(first[rank], first[rank + 1])
            for group, there in zip(groups[span], group_names(names[span])):
                root[group] = h5py.ExternalLink(name, f"/{there}")
        for array, quantity in OF_INTERFACE.items():
            if quantity.columns != "subdomains":
                root[array] = h5py.ExternalLink(files[0], f"/{array}")
    with replacing(path) as file:
        file.write(content.getvalue())


def _of_all_ranks(
    path: Path, master: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of the files of all ranks, up to the last step that is in all of them."""
    contents = [read(path.with_name(name), may_lead=False) for name in master["files"]]
    step = min(header["step_count"] for header, _ in contents)
    lists = ("names", "steps", "outputs", "sizes", "dof_names")  # not all in older versions
    by_subdomain = [key for key in lists if all(key in header for header, _ in contents)]
    result = dict(contents[0][0], step_count=step)
    result.pop("groups", None)  # of one file
    result["recorded"] = []
    for key in by_subdomain:
        result[key] = []
    arrays: dict[str, np.ndarray] = {}
    columns: dict[str, list[np.ndarray]] = {}  # of arrays with a column for each subdomain
    for header, rank_arrays in contents:
        count = len(result["names"])
        result["recorded"] += [count + i for i in header["recorded"]]
        for key in by_subdomain:
            result[key] += header[key]
        for name, x in rank_arrays.items():
            number, _, rest = name.partition(".")
            if name in header["nodes"]:
                levels = header["nodes"][name]
                x = x[: row_count(header["begin"], step, header["every"], levels)]
            if number == "energy" or name in IN_INTERFACE["subdomains"]:
                columns.setdefault(name, []).append(x)
            else:
                arrays.setdefault(f"{count + int(number)}.{rest}" if rest else name, x)
    return result, arrays | {name: np.hstack(blocks) for name, blocks in columns.items()}


def _arrays(root: Any, header: Mapping[str, Any], file: BinaryIO) -> dict[str, np.ndarray]:
    step, arrays = header["step_count"], {}
    growing = {}
    for name, levels in header["nodes"].items():
        rows = row_count(header["begin"], step, header["every"], levels)
        growing[name] = own_array(root, dataset(name, header)), rows
    size = sum(rows * 8 * int(np.prod(x.shape[1:])) for x, rows in growing.values())
    content = None if size <= READ_BYTES else _mapped(file)
    for name, (x, rows) in growing.items():
        arrays[name] = _rows(x, rows, file, content)
    fixed = {name: own_array(root, dataset(name, header)) for name in header["fixed"]}
    require(sum(x.nbytes for x in fixed.values()), "the History")
    return arrays | {name: x[...] for name, x in fixed.items()}


def _mapped(file: BinaryIO) -> np.ndarray:
    """The bytes of the file, of the size that it has now."""
    return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)


def check_contents(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """ValueError unless the arrays of a History are numbers, and have as many rows as times."""
    for name, x in arrays.items():
        if x.dtype.kind not in "iuf" or not x.ndim:
            raise ValueError(f"numbers in {name}, which has dtype {x.dtype}, shape {x.shape}")
    if not all(isinstance(name, str) for name in header["names"]):
        raise ValueError(f"names that are words, got {header['names']}")
    for i, names in enumerate(header.get("dof_names", [])):
        words = names is None or all(isinstance(name, str) for name in names)
        if not words or names is not None and len(names) != arrays[f"{i}.dofs"].size:
            raise ValueError(f"names of the dofs of subdomain {i}")
    for i, n in enumerate(header.get("sizes", [])):
        dofs = arrays[f"{i}.dofs"] if n is not None else np.empty(0)
        if n is not None and not (type(n) is int and n >= 0 and np.all(dofs < n)):
            raise ValueError(f"a number of dofs of subdomain {i} that fits them, got {n!r}")
    if not all(isinstance(x, str) for x in header.get("warnings", [])):
        raise ValueError(f"warnings that are texts, got {header['warnings']}")
    if not isinstance(header.get("coupling"), str | None):
        raise ValueError(f"the word of a coupling, got {header['coupling']}")
    _check_interface(header, arrays)
    for i in header["recorded"]:
        _check_shapes(i, arrays)
        for step in header["steps"][i] if "steps" in header else ():
            number = type(step) in (int, float) and abs(step) <= sys.float_info.max
            if not (number or step is None):
                raise ValueError(f"finite steps of subdomain {i}, got {step!r}")
    for name, quantity in OF_INTERFACE.items():
        if quantity.columns and name in arrays:
            rows = arrays[times_name(quantity, header.get("coupling"))].size
            if arrays[name].ndim != 2 or len(arrays[name]) != rows:
                raise ValueError(f"rows of {name}, which has not {rows} of them")


def _check_interface(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """The length of the macro steps and the rows of each constraint, which older files lack."""
    dt, rows = header.get("macro_step"), header.get("constraint_rows", [])
    if dt is not None and not (type(dt) in (int, float) and 0.0 < dt <= sys.float_info.max):
        raise ValueError(f"the length of macro steps, got {dt!r}")
    if not isinstance(rows, list) or not all(type(x) is int and x >= 0 for x in rows):
        raise ValueError(f"the rows of each constraint, got {rows!r}")
    if rows and sum(rows) != arrays["multipliers"].shape[1]:
        raise ValueError(f"rows of constraints as multipliers, got {rows!r}")


def _check_shapes(i: int, arrays: Mapping[str, np.ndarray]) -> None:
    """Those of the motion of subdomain i, and of its springs where there are any."""
    rows = arrays[f"{i}.t"].size
    for numbers in ("dofs", "springs"):
        names = IN_SUBDOMAIN[numbers]
        if numbers == "dofs" or any(f"{i}.{name}" in arrays for name in (numbers, *names)):
            shape = (rows, arrays[f"{i}.{numbers}"].size)
            for name in names:
                if arrays[f"{i}.{name}"].shape != shape:
                    raise ValueError(f"rows of {i}.{name}, which has not the shape {shape}")


def not_finite(arrays: Mapping[str, np.ndarray]) -> str | None:
    """The first array of a History with values that no run has: states, multipliers and times that
    are not finite. Jumps, energies, outputs and deformations of springs are sums of products, and
    may be."""
    for name, x in arrays.items():
        if name.rpartition(".")[2] in STATES and x.size:
            with np.errstate(invalid="ignore"):  # two numbers, not an array as isfinite(x) has
                ends = x.min(), x.max()
            if not np.isfinite(ends).all():
                return name
    return None


def whole_numbers(arrays: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """An array of counts as integers."""
    x = np.asarray(arrays[name])
    with np.errstate(invalid="ignore"):  # what is no integer differs, whatever comes of it
        counts = x.astype(np.int64)
    if not np.array_equal(counts, x):
        raise ValueError(f"whole numbers in {name}")
    return counts


def own_array(root: Any, name: str) -> Any:
    """A dataset that is in this file, and not larger than what the file holds of it.

    A link or storage could lead to any other file, a dataset that was never written could be of any
    size, and HDF5 never returns from some damaged texts of variable length.
    """
    h5py, item = hdf5_library(), root
    for part in name.split("/"):
        if not isinstance(item.get(part, getlink=True), h5py.HardLink):
            raise ValueError(f"{name} is missing or leads to another place")
        item = item[part]
    if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
        raise ValueError(f"{name} is no array of this file")
    if item.dtype.kind == "O":
        raise ValueError(f"{name} must be of fixed length")
    stored = item.id.get_storage_size()
    plist, stored = item.id.get_create_plist(), min(stored, root.file.id.get_filesize())
    packed = PACKED if plist.get_nfilters() else 1  # packed again by another program
    chunk = item.dtype.itemsize * int(np.prod(item.chunks)) if item.chunks else 0
    if max(item.nbytes, chunk) > packed * stored:
        raise ValueError(
            f"{name} must have {item.nbytes} bytes as its shape gives, it has {stored}"
        )
    if packed > 1:
        require(item.nbytes, name)
    return item


def check_mapping(x: np.ndarray) -> None:
    """OSError for a mapped array of a file that was truncated since: reading it would end the
    process."""
    base: Any = x
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    if isinstance(base, mmap.mmap) and base.size() < len(base):
        raise OSError(errno.EIO, "the file of the History was truncated by another program")


def _rows(x: Any, rows: int, file: BinaryIO, content: np.ndarray | None) -> np.ndarray:
    """The first rows of an array, from the bytes of the file unless another program has packed it
    again: those of `content`, or else they are read."""
    shape = (rows, *x.shape[1:])
    offset = x.id.get_offset()
    if not 0 < rows <= x.shape[0]:
        raise ValueError(f"{x.name} has {x.shape[0]} rows, {rows} were counted")
    if offset is None or x.dtype != np.dtype("<f8"):
        result: np.ndarray = x[:rows]
        return result
    size = 8 * int(np.prod(shape))
    if content is None:
        file.seek(offset)
        part = np.frombuffer(file.read(size), np.uint8)
    else:
        part = content[offset : offset + size]
    return part.view("<f8").reshape(shape)
