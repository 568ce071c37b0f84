"""Available memory, checked before a large request instead of after the machine swaps."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path

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
