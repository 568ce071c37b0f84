"""The memory of this process, in MB."""

import platform
import resource
from pathlib import Path

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def peak():
    """Largest resident memory since the start of the process, or since `forget_peak`."""
    if STATUS.exists():
        return _entry("VmHWM") / 1e3
    unit = 1e-6 if platform.system() == "Darwin" else 1e-3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def present():
    """Resident memory now; the peak on systems that do not report it."""
    return _entry("VmRSS") / 1e3 if STATUS.exists() else peak()


def forget_peak():
    """Resets the value that `peak` returns, on systems that support it."""
    if FORGET.exists():
        FORGET.write_text("5")


def _entry(name):
    lines = [x for x in STATUS.read_text().splitlines() if x.startswith(name)]
    return float(lines[0].split()[1])
