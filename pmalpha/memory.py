"""Available memory, checked before a large request instead of after the machine swaps."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

# Requests below this number of bytes are not checked, which would take longer than they do.
SMALL = 100_000


def available() -> int | None:
    """Bytes available without swapping, or None where the system does not report them."""
    limits = [_free_of_machine(), _free_of_group()]
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


def _free_of_group() -> int | None:
    """Available memory of a Linux container (cgroup 2)."""
    group = Path("/sys/fs/cgroup")
    try:
        limit = (group / "memory.max").read_text().strip()
        used = int((group / "memory.current").read_text())
        cache = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
    except (OSError, ValueError):
        return None
    if limit == "max":
        return None
    return int(limit) - used + int(cache.get("inactive_file", 0))
