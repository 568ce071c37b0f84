"""Available memory, checked before a large request instead of after the machine swaps."""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pmalpha._core as _core

# Requests below this number of bytes are not checked: the check reads a dozen files of the system,
# which takes as long as writing that much, and what is available changes by more at any time.
SMALL = 8_000_000


def available() -> int | None:
    """Bytes available without swapping, or None where the system does not report them."""
    limits = [_free_of_machine(), free_of_groups()]
    known = [limit for limit in limits if limit is not None]
    return min(known) if known else None


def fits(count: float) -> bool:
    """Whether `count` bytes are available, or nothing is known of them."""
    left = None if count < SMALL else available()
    return left is None or count <= left


def require(count: float, what: str, advice: str = "") -> None:
    """MemoryError with the numbers when `count` bytes for `what` are not available."""
    left = None if count < SMALL else available()
    if left is not None and count > left:
        text = f"{what} needs about {_size(count)}, {_size(left)} are available"
        raise MemoryError(f"{text}; {advice}" if advice else text)


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000.0:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} TB"


def _free_of_machine() -> int | None:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    if sys.platform == "win32":
        return _free_of_windows()
    try:  # macOS does not report free memory: the total
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError):
        return None


def _free_of_windows() -> int | None:
    """What GlobalMemoryStatusEx reports as free physical memory."""
    numbers = (ctypes.c_uint64 * 8)()  # length and load in the first, total, free, ...
    numbers[0] = ctypes.sizeof(numbers)
    library = getattr(ctypes, "windll").kernel32  # noqa: B009, for mypy on other systems
    return int(numbers[2]) if library.GlobalMemoryStatusEx(numbers) else None


def free_of_groups(
    root: Path = Path("/sys/fs/cgroup"), group_list: Path = Path("/proc/self/cgroup")
) -> int | None:
    """Available memory of the Linux containers of this process, one within the other.

    root: where the groups are mounted, version 1 or 2. group_list: the file with the groups of the
        process.
    """
    try:
        lines = group_list.read_text().splitlines()
    except OSError:
        return None
    free = [_free_of_group(folder, names) for folder, names in _groups(lines, root)]
    return min((count for count in free if count is not None), default=None)


# Files with limit and use, and what of the use can be given back, in memory.stat.
VERSION_1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
VERSION_2 = ("memory.max", "memory.current", "inactive_file")
# Version 1 has a number where there is no limit: the largest in pages.
NO_LIMIT = 1 << 60


def _groups(lines: list[str], root: Path) -> Iterator[tuple[Path, tuple[str, str, str]]]:
    """The folders of the groups that limit memory, with all that contain them."""
    for line in lines:
        number, controllers, path = line.split(":", 2)
        of_memory = "memory" in controllers.split(",")
        if not of_memory and number != "0":
            continue
        base, names = (root / "memory", VERSION_1) if of_memory else (root, VERSION_2)
        parts = [] if ".." in path.split("/") else [part for part in path.split("/") if part]
        for count in range(len(parts) + 1):
            yield base.joinpath(*parts[:count]), names


def _free_of_group(folder: Path, names: tuple[str, str, str]) -> int | None:
    """Available memory of one group; None where it has no limit."""
    try:
        limit = (folder / names[0]).read_text().strip()
        used = int((folder / names[1]).read_text())
        cache = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        count = NO_LIMIT if limit == "max" else int(limit)
        return None if count >= NO_LIMIT else max(0, count - used + int(cache.get(names[2], 0)))
    except (OSError, ValueError):
        return None


# ---- blas ---------------------------------------------------------------------------------------
# BLAS with one thread, so that results do not depend on its number of threads.

# Functions that set and return the number of threads, by what threadpoolctl calls the library.
SYMBOLS = {
    "openblas": [
        (f"{prefix}openblas_set_num_threads{suffix}", f"{prefix}openblas_get_num_threads{suffix}")
        for prefix in ("", "scipy_")
        for suffix in ("", "64_", "_64")
    ],
    "mkl": [("MKL_Set_Num_Threads", "MKL_Get_Max_Threads")],
    "blis": [("bli_thread_set_num_threads", "bli_thread_get_num_threads")],
    "flexiblas": [("flexiblas_set_num_threads", "flexiblas_get_num_threads")],
}
# ... of an OpenBLAS that is compiled with OpenMP, whose number belongs to each thread
OPENMP = [("omp_set_num_threads", "omp_get_max_threads")]

_found: dict[str, _core.OneThread] = {}

# Address space of the buffer that OpenBLAS takes for each call at the same time, and keeps, a bit
# above 32 MB; of the libraries of SciPy. Where there is none for a buffer, OpenBLAS tries for ever.
BUFFER, LOADED = 36_000_000, 128_000_000
_reserved = {"buffers": 0}


def gemm_and_trsm() -> tuple[Any, Any]:
    """The functions of SciPy's BLAS that the core calls."""
    from scipy.linalg import cython_blas

    return cython_blas.__pyx_capi__["dgemm"], cython_blas.__pyx_capi__["dtrsm"]


def one_thread() -> AbstractContextManager[None]:
    """A context in which BLAS uses one thread.

    The number of threads of BLAS belongs to the process: if several threads are in this context,
    the first sets it and the last restores it, also where Ctrl-C ends it. Within the same context
    it does nothing. In a process forked off only the thread that has forked is still in it.
    """
    return _found.get("one") or _search()


def _search() -> _core.OneThread:
    """The context of the libraries that NumPy and SciPy have loaded, which takes milliseconds.

    Without a lock, which a thread could hold while another one forks: of several the first counts.
    """
    if "scipy.linalg" not in sys.modules:
        require_space(LOADED + _buffers_at_load() * BUFFER, "SciPy with its BLAS")
    import scipy.linalg  # noqa: F401  so that its library is loaded before the search

    libraries = _libraries()
    context = _core.OneThread(tuple(pair for x in libraries for pair in _addresses(x)))
    one = _found.setdefault("one", context)
    if one is context and hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=one.after_fork)
    return one


def _libraries() -> list[Any]:
    from threadpoolctl import ThreadpoolController

    libraries: list[Any] = ThreadpoolController().select(user_api="blas").lib_controllers
    return libraries


def _addresses(library: Any) -> list[tuple[int, int]]:
    """The functions of a library that is found; none of one that threadpoolctl alone knows."""
    names = SYMBOLS.get(library.internal_api, [])
    if getattr(library, "threading_layer", "") == "openmp" and library.internal_api == "openblas":
        names = [*OPENMP, *names]
    for pair in names:
        if all(hasattr(library.dynlib, name) for name in pair):
            functions = [getattr(library.dynlib, name) for name in pair]
            set_threads, get_threads = (ctypes.cast(f, ctypes.c_void_p).value for f in functions)
            return [(set_threads or 0, get_threads or 0)]
    return []


def reserve_buffers(count: int = 1, *, fewer: bool = False) -> int:
    """Where address space has a limit (``ulimit -v``), the buffers of BLAS for `count` threads.

    Returns the number of threads that have one; MemoryError where these are less, unless `fewer`
    will do. Buffers last until the process ends.
    """
    if count <= _reserved["buffers"] or not _is_limited():
        return count
    if "scipy.linalg" not in sys.modules:
        one_thread()
    libraries = [x.dynlib for x in _libraries() if x.internal_api == "openblas"]
    libraries = [x for x in libraries if hasattr(x, ALLOCATE) and hasattr(x, RELEASE)]
    most, least = count, 1 if fewer else count
    while True:
        needed = (most - _reserved["buffers"]) * len(libraries) * BUFFER
        if most == least:
            require_space(needed, f"BLAS with threads={most}")
        if most == least or _has_space(needed):
            break
        most -= 1
    for library in libraries:
        _take_buffers(library, most)
    _reserved["buffers"] = most
    return most


ALLOCATE, RELEASE = "blas_memory_alloc", "blas_memory_free"


def _take_buffers(library: Any, count: int) -> None:
    """Have OpenBLAS make this number of buffers, which are free for its calls afterwards."""
    allocate, release = getattr(library, ALLOCATE), getattr(library, RELEASE)
    allocate.argtypes, allocate.restype = [ctypes.c_int], ctypes.c_void_p
    release.argtypes, release.restype = [ctypes.c_void_p], None
    for buffer in [allocate(0) for _ in range(count)]:
        release(buffer)


def _buffers_at_load() -> int:
    """OpenBLAS makes one for each of its threads when it is loaded, and the first call one."""
    chosen = os.environ.get("OPENBLAS_NUM_THREADS", os.environ.get("OMP_NUM_THREADS", ""))
    return 1 + (int(chosen) if chosen.isdigit() and int(chosen) > 0 else os.cpu_count() or 1)


def _is_limited() -> bool:
    try:
        import resource
    except ImportError:  # Windows
        return False
    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def _has_space(count: int) -> bool:
    """Whether the system gives this much address space at present."""
    try:
        mmap.mmap(-1, max(count, 1)).close()
    except (OSError, ValueError, OverflowError):
        return False
    return True


def require_space(count: int, what: str) -> None:
    """MemoryError where address space has a limit that leaves less than `count` bytes."""
    if _is_limited() and not _has_space(count):
        raise MemoryError(
            f"{what} needs about {_size(count)} of address space, of which `ulimit -v` leaves less"
        )
