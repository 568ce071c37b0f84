"""What memory is left, asked before a large request instead of after the machine swaps."""

from __future__ import annotations

import os
from pathlib import Path

# Requests below this many bytes are not worth the time it takes to ask.
SMALL = 100_000


def available() -> int | None:
    """Bytes that can be had without swapping, or None where the system does not say."""
    limits = [_free_of_machine(), _free_of_group()]
    known = [limit for limit in limits if limit is not None]
    return min(known) if known else None


def require(count: float, what: str, advice: str = "") -> None:
    """MemoryError with the figures when `count` bytes for `what` are not to be had."""
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
    try:  # macOS: no figure of what is free, so what there is
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError):
        return None


def _free_of_group() -> int | None:
    """What a container of Linux (cgroup 2) has left."""
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
