"""The memory of this process, in MB."""

import platform
import resource
from pathlib import Path

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def peak():
    """The most that was resident since the process began, or since `forget_peak`."""
    if STATUS.exists():
        return _entry("VmHWM") / 1e3
    unit = 1e-6 if platform.system() == "Darwin" else 1e-3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def present():
    """What is resident now; the peak where the system does not say."""
    return _entry("VmRSS") / 1e3 if STATUS.exists() else peak()


def forget_peak():
    """From now on `peak` is that of what follows, where the system can do that."""
    if FORGET.exists():
        FORGET.write_text("5")


def _entry(name):
    lines = [x for x in STATUS.read_text().splitlines() if x.startswith(name)]
    return float(lines[0].split()[1])
