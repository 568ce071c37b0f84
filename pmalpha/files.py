"""Files by their descriptors: opened once, locked, written whole or not at all; npz files.

A name is not an identity: between two calls by one name another program may have replaced the file.
So a file is opened once, and what is asked of it later is asked of the descriptor.
"""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
import stat
import struct
import sys
import threading
import zipfile
from _thread import start_new_thread
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib import import_module
from io import FileIO
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from .memory import require

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

T = TypeVar("T")
HEADER = "header"
NO_FILE = "a folder or a device, not a file"
# Maximum number of bytes per system call.
LONGEST_WRITE = 1 << 30
# By a lock of this byte, far behind the end of any file, a run that writes is known. A lock of the
# file itself would keep readers out: HDF5 takes one.
LOCKED_BYTE = 1 << 62
# With which a lock is refused, where another process or descriptor has one.
HELD_BY_ANOTHER = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
BINARY, NONBLOCK = getattr(os, "O_BINARY", 0), getattr(os, "O_NONBLOCK", 0)
# Windows renames no file that is open.
RENAMES_OPEN = os.name != "nt"
DESCRIPTORS = "/proc/self/fd"
POLL = 1e-3  # s, between looks at whether a call has ended, after Ctrl-C


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
    except ModuleNotFoundError as error:  # others say why an installed one cannot be imported
        raise ImportError(f"{use} needs {name.split('.')[0]}: pip install {install}") from error


def checked_path(
    path: str | os.PathLike[str], name: str = "path", suffixes: Sequence[str] = ()
) -> Path:
    """The path as a Path; TypeError for other values, ValueError for what HDF5 would cut off.

    With `suffixes` ValueError for another one; none is right too.
    """
    try:
        file_path = Path(os.fsdecode(path))
    except TypeError:
        raise TypeError(f"{name} must be a str or a path, got {path!r}") from None
    if "\0" in str(file_path):
        raise ValueError(f"{name} must have no null character, got {path!r}")
    if suffixes and file_path.suffix.lower() not in ("", *suffixes):
        raise ValueError(f"{name} must end in {' or '.join(suffixes)}, got {str(file_path)!r}")
    return file_path


def uninterrupted(call: Callable[..., T], *arguments: Any) -> T:
    """What a call returns in a thread of its own, where no signal raises an exception.

    Ctrl-C is raised when it has ended, a second one at once. Libraries that are interrupted raise
    exceptions of their own instead (zipfile), or crash (HDF5). A `threading.Thread` would not do:
    Ctrl-C in its `start` or `join` can leave locks taken for which the thread waits for ever, or
    call it ended while it writes.
    """
    if threading.current_thread() is not threading.main_thread():
        return call(*arguments)
    outcome: list[tuple[Any, BaseException | None]] = []
    begun, ended = threading.Lock(), threading.Lock()  # the one who takes `begun` first decides
    ended.acquire()

    def run() -> None:
        if begun.acquire(False):
            try:
                outcome.append((call(*arguments), None))
            except BaseException as error:
                outcome.append((None, error))
            ended.release()

    try:
        start_new_thread(run, ())
        ended.acquire()
    except BaseException as error:
        is_begun = not begun.acquire(False)
        while is_begun and not outcome:
            ended.acquire(timeout=POLL)
        if is_begun or not isinstance(error, RuntimeError):
            raise
        return call(*arguments)  # no thread can be started, as at the end of the interpreter
    result, failure = outcome.pop()
    try:
        if failure is not None:
            raise failure
        return result  # type: ignore[no-any-return]
    finally:
        del failure  # and with it this frame, to which it leads


# ---- descriptors ---------------------------------------------------------------------------------


class Held:
    """A file that is open, whatever its name leads to meanwhile. It is closed with the object.

    path: its name, for messages and for `is_at`.
    """

    def __init__(self, number: int, path: Path):
        self.path = path
        self._own(number)

    def _own(self, number: int) -> None:
        # closed with the object by C: in a destructor in Python Ctrl-C would be lost
        self.number, self._owner = number, FileIO(number, "rb")
        self._process, self._is_locked = os.getpid(), False

    @property
    def is_open(self) -> bool:
        return self.number >= 0

    @property
    def size(self) -> int:
        """In bytes, at present."""
        return os.fstat(self.number).st_size

    def is_at(self, path: Path) -> bool:
        """Whether this name leads to the file."""
        try:
            return os.path.samestat(os.fstat(self.number), os.stat(path))
        except OSError:
            return False

    def check_has(self, size: int) -> None:
        """OSError where another program has cut the file off below this size in bytes, or its name
        leads to another file."""
        if self.size < size:
            raise OSError(errno.EIO, "another program has truncated it")
        if not self.is_at(self.path):
            raise OSError(errno.ENOENT, "another program has removed or replaced it")

    def lock(self, *, exclusive: bool) -> bool:
        """Lock the file until it is closed; False where another descriptor has a lock that does not
        admit it. Where a file system has no locks, it is not locked."""
        try:
            _lock(self.number, exclusive=exclusive)
            self._is_locked = True
        except OSError as error:
            return error.errno not in HELD_BY_ANOTHER
        return True

    def write_at(self, data: Any, offset: int) -> None:
        left = memoryview(data).cast("B")
        while len(left):
            done = self._write_some(left[:LONGEST_WRITE], offset)
            left, offset = left[done:], offset + done

    def _write_some(self, piece: Any, offset: int) -> int:
        if hasattr(os, "pwrite"):
            return os.pwrite(self.number, piece, offset)
        os.lseek(self.number, offset, os.SEEK_SET)  # one thread at a time writes
        return os.write(self.number, piece)

    def resize(self, size: int) -> None:
        os.ftruncate(self.number, size)

    def sync(self) -> None:
        """What was written is on the disk when this returns."""
        getattr(os, "fdatasync", os.fsync)(self.number)

    def reader(self) -> BinaryIO:
        """The same file to read from, whose position is that of all of them."""
        return os.fdopen(os.dup(self.number), "rb")

    def close(self) -> None:
        number, self.number = self.number, -1
        if number < 0:
            return
        try:
            if self._is_locked and os.getpid() == self._process:  # a child has the lock too
                _unlock(number)
        finally:
            self._owner.close()


def _lock(number: int, *, exclusive: bool) -> None:
    if fcntl is None:
        _lock_of_windows(number, "LK_NBLCK")
    elif sys.platform == "linux":  # of the descriptor; other systems have locks of the process only
        _lock_of_linux(number, fcntl.F_WRLCK if exclusive else fcntl.F_RDLCK)
    else:
        kind = fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH
        fcntl.lockf(number, kind | fcntl.LOCK_NB, 1, LOCKED_BYTE)


def _unlock(number: int) -> None:
    if fcntl is None:
        _lock_of_windows(number, "LK_UNLCK")
    elif sys.platform == "linux":
        _lock_of_linux(number, fcntl.F_UNLCK)
    else:
        fcntl.lockf(number, fcntl.LOCK_UN, 1, LOCKED_BYTE)


def _lock_of_linux(number: int, kind: int) -> None:
    fcntl.fcntl(  # struct flock: kind, whence, start, length, process
        number, fcntl.F_OFD_SETLK, struct.pack("hhqqi4x", kind, os.SEEK_SET, LOCKED_BYTE, 1, 0)
    )


def _lock_of_windows(number: int, kind: str) -> None:
    locking = import_module("msvcrt")
    position = os.lseek(number, 0, os.SEEK_CUR)
    os.lseek(number, LOCKED_BYTE, os.SEEK_SET)
    try:
        locking.locking(number, getattr(locking, kind), 1)
    finally:
        os.lseek(number, position, os.SEEK_SET)


def held(path: Path, name: str) -> Held:
    """An existing file that no other process writes, locked; OSError with the `name` of the
    argument where one does."""
    flags = BINARY | NONBLOCK
    try:
        file = Held(os.open(path, os.O_RDWR | flags), path)
    except PermissionError:  # which may be replaced nevertheless
        file = Held(os.open(path, os.O_RDONLY | flags), path)
    if not stat.S_ISREG(os.fstat(file.number).st_mode):
        file.close()
        raise OSError(errno.EINVAL, f"{name} cannot be written: {NO_FILE}", str(path))
    if not file.lock(exclusive=True):
        file.close()
        raise OSError(
            errno.EBUSY, f"{name} must not be the file of another run that goes on", str(path)
        )
    return file


# ---- new files -----------------------------------------------------------------------------------


class NewFile(Held):
    """A file without a name, or with a hidden one, until it is whole.

    Where the system can, it has none, so that nothing is left of a process that was killed, except
    in the instant of replacing, which takes a hidden name for the whole file. The permissions are
    those of the file that has the name.
    """

    def __init__(self, path: Path):
        try:
            before = os.stat(path)
        except OSError:
            before = None
        mode = 0o666 if before is None else stat.S_IMODE(before.st_mode) & 0o777
        number, self._hidden = _nameless(path, mode)
        self._is_nameless = self._hidden is None
        super().__init__(number, path)
        if before is not None and hasattr(os, "fchmod"):
            with suppress(OSError):
                os.fchmod(number, mode)

    def take_name(self, old: Held | None) -> None:
        """The name of the file `old`, which this process has locked, or else a new one.

        FileExistsError where there is a file without `old`, OSError where there is another.
        """
        self.sync()
        if old is None:
            self._take_new_name()
        elif old.is_at(self.path):
            self._replace(old)
        else:
            raise OSError(errno.EBUSY, "another program has replaced it meanwhile")

    def replace(self) -> None:
        """Take the name, whatever has it."""
        self.sync()
        self._replace(None)

    def discard(self) -> None:
        self.close()
        self._remove_hidden()

    def _take_new_name(self) -> None:
        if not RENAMES_OPEN:
            self._renamed_while_closed(os.rename)  # which replaces nothing there
            return
        try:
            self._link(self.path)
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
            try:
                self._replace(None)
            except BaseException:
                self.path.unlink()
                raise
        self._remove_hidden()
        _sync_folder(self.path.parent)

    def _replace(self, old: Held | None) -> None:
        if not RENAMES_OPEN:
            if old is not None:
                old.close()
            self._renamed_while_closed(os.replace)
            return
        if self._hidden is None:
            self._hidden = _hidden_name(self.path)  # first, so that Ctrl-C in between leaves none
            self._link(self._hidden)
        os.replace(self._hidden, self.path)
        self._hidden = None
        _sync_folder(self.path.parent)

    def _link(self, name: Path) -> None:
        if not self._is_nameless:
            assert self._hidden is not None
            os.link(self._hidden, name)
            return
        # with a folder it is linkat, which follows the link to the file
        folder = os.open(name.parent, os.O_RDONLY)
        try:
            os.link(f"{DESCRIPTORS}/{self.number}", name.name, dst_dir_fd=folder)
        finally:
            os.close(folder)

    def _renamed_while_closed(self, rename: Callable[[Any, Any], None]) -> None:
        before = os.fstat(self.number)
        self.close()
        rename(self._hidden, self.path)
        self._hidden = None
        self._own(os.open(self.path, os.O_RDWR | BINARY))
        if not os.path.samestat(before, os.fstat(self.number)):
            self.close()
            raise OSError(errno.EBUSY, "another program has replaced it meanwhile")
        self.lock(exclusive=False)

    def _remove_hidden(self) -> None:
        if self._hidden is not None:
            self._hidden.unlink(missing_ok=True)
            self._hidden = None


def _hidden_name(path: Path) -> Path:
    return path.with_name(f".{secrets.token_hex(8)}.part")


def _nameless(path: Path, mode: int) -> tuple[int, Path | None]:
    """A descriptor for a new file in the folder of `path`, and its name if it has one."""
    if RENAMES_OPEN and hasattr(os, "O_TMPFILE") and os.path.isdir(DESCRIPTORS):
        with suppress(OSError):  # a file system without
            return os.open(path.parent, os.O_TMPFILE | os.O_RDWR, mode), None
    hidden = _hidden_name(path)
    return os.open(hidden, os.O_RDWR | os.O_CREAT | os.O_EXCL | BINARY, mode), hidden


def _sync_folder(folder: Path) -> None:
    """The name of a file is on the disk too, where the system can."""
    with suppress(OSError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


@contextmanager
def writing(
    path: str | os.PathLike[str], name: str = "path", rule: str = "cannot be written"
) -> Iterator[NewFile]:
    """A new file, to which the block writes and which it gives its name.

    After an exception nothing is left of it, and OSErrors have the `name` of the argument and the
    rule.
    """
    file_path = checked_path(path, name)
    target = Path(os.path.realpath(file_path))  # of a link the target is replaced
    file = None
    try:
        if target.exists() and not target.is_file():
            raise OSError(errno.EINVAL, NO_FILE)
        file = NewFile(target)
        yield file
    except BaseException as error:
        if file is not None:
            file.discard()
        if not isinstance(error, OSError):
            raise
        message = f"{name} {rule}: {error.strerror or error}"
        raise OSError(error.errno, message, str(file_path)) from error


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A file to write to, which takes the name `path` when the block ends without exception.

    Written atomically: after an exception an existing file is unchanged, and nothing is left of the
    new one.
    """
    with writing(path) as new:
        with os.fdopen(os.dup(new.number), "w+b") as file:
            yield file
        new.replace()
        new.close()


def check_replaceable(path: str | os.PathLike[str], name: str) -> None:
    """OSError where `replacing` would fail, as far as can be checked without writing.

    Its message has the `name` of the argument.
    """
    file_path = checked_path(path, name)
    target = Path(os.path.realpath(file_path))
    number = 0
    if not target.parent.is_dir():
        number = errno.ENOENT
    elif not os.access(target.parent, os.W_OK | os.X_OK):
        number = errno.EACCES
    elif target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, f"{name} cannot be written: {NO_FILE}", str(file_path))
    if number:
        raise OSError(number, f"{name} cannot be written: {os.strerror(number)}", str(file_path))


def reading(path: str | os.PathLike[str]) -> BinaryIO:
    """An open file to read from. Devices and pipes, which may block or never end, raise OSError.

    It is the context: one made of a generator could be left open by Ctrl-C.
    """
    file_path = checked_path(path)
    refusal = OSError(errno.EINVAL, "path cannot be read: a device or a pipe", str(file_path))
    if file_path.exists() and not file_path.is_file() and not file_path.is_dir():
        raise refusal  # not even opened, which some devices take for an order
    file = open(file_path, "rb", opener=_opened_without_waiting)
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise refusal
    return file


def _opened_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | NONBLOCK)


# ---- npz -----------------------------------------------------------------------------------------


def write_npz(
    path: str | os.PathLike[str], header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write arrays of numbers, with a header of JSON that names format and version.

    The header also names the version of the package. No suffix is added to the path. The file
    contains numbers and text only, no pickle.
    """
    header = {**header, "pmalpha_version": package_version()}
    named: dict[str, Any] = {HEADER: np.array(json.dumps(header)), **arrays}
    with replacing(path) as file:
        uninterrupted(partial(np.savez, file, **named))


def read_npz(
    path: str | os.PathLike[str], format: str, version: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file that `write_npz` wrote with this format and version."""
    with reading(path) as file:
        return npz_contents(file, path, format, version)


def npz_contents(
    file: BinaryIO, path: str | os.PathLike[str], format: str, version: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The same of an open file, that of `path`."""
    name = str(checked_path(path))
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
            _check_sum(members)
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


def _check_sum(members: zipfile.ZipFile) -> None:
    """ValueError for members that are compressed, or together larger than the file, since they are
    in one place."""
    assert members.fp is not None
    for info in members.infolist():
        if info.compress_type != zipfile.ZIP_STORED:
            key = info.filename.removesuffix(".npy")
            raise ValueError(f"{key} is compressed, which no file of this package is")
    total = sum(info.file_size for info in members.infolist())
    if total > os.fstat(members.fp.fileno()).st_size:
        raise ValueError(f"its arrays are together {total} bytes, more than the file")
    require(total, "the content of the file")


def _check_size(members: zipfile.ZipFile, key: str) -> None:
    """ValueError for an array that is larger than what the file holds of it, before it is made."""
    assert members.fp is not None
    info, size = members.getinfo(f"{key}.npy"), os.fstat(members.fp.fileno()).st_size
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
