"""Atomic writing of files, and npz files with a header of format and version."""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

HEADER = "header"
NO_FILE = "a folder or a device, not a file"


@cache
def package_version() -> str:
    from importlib.metadata import version

    return version("pmalpha")


# Suffixes of files of NumPy and of HDF5.
NPZ, HDF5 = (".npz",), (".h5", ".hdf5")


def library(name: str, use: str, install: str) -> Any:
    """A library that the package does not require; ImportError with what needs it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(f"{use} needs {name.split('.')[0]}: pip install {install}") from error


def checked_path(
    path: str | os.PathLike[str], name: str = "path", suffixes: Sequence[str] = ()
) -> Path:
    """The path as a Path; TypeError for other values, ValueError for what HDF5 would cut off.

    With `suffixes` ValueError for another one; none is right too.
    """
    try:
        whole = Path(os.fsdecode(path))
    except TypeError:
        raise TypeError(f"{name} must be a str or a path, got {path!r}") from None
    if "\0" in str(whole):
        raise ValueError(f"{name} must have no null character, got {path!r}")
    if suffixes and whole.suffix.lower() not in ("", *suffixes):
        raise ValueError(f"{name} must end in {' or '.join(suffixes)}, got {str(whole)!r}")
    return whole


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A temporary file to write to, renamed to `path` when the block ends without exception.

    Written atomically: after an exception an existing file is unchanged, and the temporary file is
    removed.
    """
    whole = checked_path(path)
    target = Path(os.path.realpath(whole))  # of a link the target is replaced
    temporary = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        if target.exists() and not target.is_file():
            raise OSError(errno.EINVAL, NO_FILE)
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        message = f"path cannot be written: {error.strerror or error}"
        raise OSError(error.errno, message, str(whole)) from error
    finally:
        temporary.unlink(missing_ok=True)


def check_replaceable(path: str | os.PathLike[str], name: str) -> None:
    """OSError where `replacing` would fail, as far as can be checked without writing.

    Its message has the `name` of the argument.
    """
    whole = checked_path(path, name)
    target = Path(os.path.realpath(whole))
    number = 0
    if not target.parent.is_dir():
        number = errno.ENOENT
    elif not os.access(target.parent, os.W_OK | os.X_OK):
        number = errno.EACCES
    elif target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, f"{name} cannot be written: {NO_FILE}", str(whole))
    if number:
        raise OSError(number, f"{name} cannot be written: {os.strerror(number)}", str(whole))


def reading(path: str | os.PathLike[str]) -> BinaryIO:
    """An open file to read from. Devices and pipes, which may block or never end, raise OSError.

    It is the context: one made of a generator could be left open by Ctrl-C.
    """
    whole = checked_path(path)
    if whole.exists() and not whole.is_file() and not whole.is_dir():
        raise OSError(errno.EINVAL, "path cannot be read: a device or a pipe", str(whole))
    return open(whole, "rb")


def write_npz(
    path: str | os.PathLike[str], header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write arrays of numbers, with a header of JSON that names format and version.

    The header also names the version of the package. No suffix is added to the path. The file
    contains numbers and text only, no pickle.
    """
    header = {**header, "pmalpha_version": package_version()}
    with replacing(path) as file:
        np.savez(file, **{HEADER: np.array(json.dumps(header))}, **arrays)  # type: ignore[arg-type]


def read_npz(
    path: str | os.PathLike[str], format: str, version: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file that `write_npz` wrote with this format and version."""
    name = str(checked_path(path))
    with reading(path) as file:
        reason, header, arrays = _contents(file, format, version)
    if reason is not None:
        raise ValueError(f"path must lead to a file of format {format!r}, but {name!r} {reason}")
    return header, arrays


def _contents(file: BinaryIO, format: str, version: int) -> tuple[str | None, Any, dict[str, Any]]:
    """The reason to refuse the file or None, its header and its arrays."""
    if not zipfile.is_zipfile(file):
        return "is no npz file, or is cut off", None, {}
    try:
        with zipfile.ZipFile(file) as members:
            keys = [name.removesuffix(".npy") for name in members.namelist()]
            header = json.loads(_text(_member(members, HEADER))) if HEADER in keys else None
            reason = mismatch(header, format, version)
            wanted = [] if reason else [key for key in keys if key != HEADER]
            return reason, header, {key: _member(members, key) for key in wanted}
    except MemoryError:
        raise
    except Exception as error:  # damaged files raise a dozen classes in zipfile and NumPy
        return f"is damaged: {error}", None, {}


def _member(members: zipfile.ZipFile, key: str) -> np.ndarray:
    """One array, read to the end of its member, so that the checksum is compared."""
    _check_size(members, key)
    with members.open(f"{key}.npy") as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
        if file.read(1):
            raise ValueError(f"{key} is longer than its header gives")
        return array


def _text(array: np.ndarray) -> str:
    """What a header says. NumPy makes strings of any numbers, also of those that are no characters,
    with which functions of Python fail later."""
    if array.dtype.kind != "U" or array.ndim:
        raise ValueError(f"its header is no text, but {array.dtype} of shape {array.shape}")
    return array.astype(array.dtype.newbyteorder("<")).tobytes().decode("utf-32-le").rstrip("\0")


def _check_size(members: zipfile.ZipFile, key: str) -> None:
    """ValueError for an array that is larger than what the file holds of it, before it is made."""
    assert members.fp is not None
    info, size = members.getinfo(f"{key}.npy"), os.fstat(members.fp.fileno()).st_size
    if info.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{key} is compressed, which no file of this package is")
    if not info.file_size == info.compress_size <= size:
        raise ValueError(f"{key} is larger than the file")
    with members.open(info) as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError(f"{key} is of another version of npy")
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        if dtype.hasobject:
            raise ValueError("Object arrays cannot be loaded, they are pickled")
        size, stored = math.prod(shape) * dtype.itemsize, info.file_size - file.tell()
    if size != stored or min(shape, default=0) < 0:
        raise ValueError(f"{key} must have {size} bytes as its header gives, it has {stored}")


def mismatch(header: Any, format: str, version: int) -> str | None:
    """The reason to refuse a file with this header, or None."""
    if not isinstance(header, dict) or "format" not in header:
        return "has no header with a format"
    if header["format"] != format:
        return f"is of format {header['format']!r}"
    if header.get("version") != version:
        return f"is of version {header.get('version')!r} of it, not {version}"
    return None
