"""Files that are whole or not there, and npz files that say what they hold."""

from __future__ import annotations

import errno
import json
import os
import secrets
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

HEADER = "header"
NO_FILE = "a folder or a device, not a file"


def checked_path(path: str | os.PathLike) -> Path:
    """The path as a Path; TypeError for what is none."""
    try:
        return Path(os.fsdecode(path))
    except TypeError:
        raise TypeError(f"path must be a str or a path, got {path!r}") from None


@contextmanager
def replacing(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """A file to write to, which takes the place of `path` when the block ends without exception.

    Until then a file that stands there is untouched, and after an exception nothing is left.

    Raises
    ------
    OSError
        When it cannot be written.
    """
    whole = checked_path(path)
    target = Path(os.path.realpath(whole))  # a link stays, what it leads to is replaced
    part = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        if target.exists() and not target.is_file():
            raise OSError(errno.EINVAL, NO_FILE)
        with open(part, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, target)
    except OSError as error:
        message = f"path cannot be written: {error.strerror or error}"
        raise OSError(error.errno, message, str(whole)) from error
    finally:
        part.unlink(missing_ok=True)


def check_replaceable(path: str | os.PathLike) -> None:
    """OSError where `replacing` could not begin, as far as one sees without writing."""
    whole = checked_path(path)
    target = Path(os.path.realpath(whole))
    number = 0
    if not target.parent.is_dir():
        number = errno.ENOENT
    elif not os.access(target.parent, os.W_OK | os.X_OK):
        number = errno.EACCES
    elif target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, f"path cannot be written: {NO_FILE}", str(whole))
    if number:
        raise OSError(number, f"path cannot be written: {os.strerror(number)}", str(whole))


@contextmanager
def reading(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """A file to read from. A device may never end, and a pipe never begin: neither is opened.

    Raises
    ------
    OSError
        When there is no such file.
    """
    whole = checked_path(path)
    if whole.exists() and not whole.is_file() and not whole.is_dir():
        raise OSError(errno.EINVAL, "path cannot be read: a device or a pipe", str(whole))
    with open(whole, "rb") as file:
        yield file


def write_npz(
    path: str | os.PathLike, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write arrays of numbers, with a header of JSON that names format and version.

    The path is taken as it is, without an ending being added. No pickle: the file holds numbers
    and text only.
    """
    with replacing(path) as file:
        np.savez(file, **{HEADER: np.array(json.dumps(header))}, **arrays)  # type: ignore[arg-type]


def read_npz(
    path: str | os.PathLike, format: str, version: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file that `write_npz` wrote with this format and version.

    Raises
    ------
    OSError
        When there is no such file.
    ValueError
        For any other file, saying why.
    """
    name = str(checked_path(path))
    with reading(path) as file:
        reason, header, arrays = _contents(file, format, version)
    if reason is not None:
        raise ValueError(f"path must lead to a file of format {format!r}, but {name!r} {reason}")
    return header, arrays


def _contents(file: BinaryIO, format: str, version: int) -> tuple[str | None, Any, dict]:
    """Why the file is refused or None, its header and its arrays."""
    if not zipfile.is_zipfile(file):
        return "is no npz file, or is cut off", None, {}
    try:
        with zipfile.ZipFile(file) as members:
            keys = [name.removesuffix(".npy") for name in members.namelist()]
            header = json.loads(_member(members, HEADER).item()) if HEADER in keys else None
            reason = mismatch(header, format, version)
            wanted = [] if reason else [key for key in keys if key != HEADER]
            return reason, header, {key: _member(members, key) for key in wanted}
    except MemoryError:
        raise
    except Exception as error:  # zipfile and NumPy raise a dozen kinds for damage
        return f"is damaged: {error}", None, {}


def _member(members: zipfile.ZipFile, key: str) -> np.ndarray:
    """One array, read to the end, where its check sum is compared."""
    with members.open(f"{key}.npy") as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
        if file.read(1):
            raise ValueError(f"{key} is longer than it says")
        return array


def mismatch(header: Any, format: str, version: int) -> str | None:
    """Why a file with this header is refused, or None."""
    if not isinstance(header, dict) or "format" not in header:
        return "does not say what it holds"
    if header["format"] != format:
        return f"is of format {header['format']!r}"
    if header.get("version") != version:
        return f"is of version {header.get('version')!r} of it, not {version}"
    return None
