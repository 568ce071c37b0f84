"""What the operating system does for a thread that has to be on time."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

# of sys/mman.h and linux/prctl.h
MCL_CURRENT, MCL_FUTURE = 1, 2
PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 29, 30


@contextmanager
def on_time(priority: int | None, lock_memory: bool) -> Iterator[None]:
    """SCHED_FIFO and the shortest timer slack for this thread, memory of the process locked.

    All is as before afterwards. Threads made meanwhile do not inherit the priority.

    Raises
    ------
    OSError
        Where the system does not allow it, with what it needs; nothing is changed then.
    """
    with _locked(lock_memory), _scheduled(priority), _without_slack():
        yield


def check_priority(priority: int | None) -> None:
    """ValueError for a priority that SCHED_FIFO does not have."""
    if priority is None or not hasattr(os, "sched_setscheduler"):
        return
    low, high = (f(os.SCHED_FIFO) for f in (os.sched_get_priority_min, os.sched_get_priority_max))
    if not low <= priority <= high:
        raise ValueError(f"priority must be in {low}..{high} or None, got {priority!r}")


@contextmanager
def _scheduled(priority: int | None) -> Iterator[None]:
    if priority is None:
        yield
        return
    if not hasattr(os, "sched_setscheduler"):
        raise OSError(f"priority must be None on {sys.platform}, which has no sched_setscheduler")
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:  # 0 is this thread, not the process
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        raise _refused(
            error,
            f"priority={priority} needs the right to SCHED_FIFO, which this process has not "
            "(root, CAP_SYS_NICE, or a limit 'rtprio' of at least that)",
        ) from None
    try:
        yield
    finally:
        policy, parameter = before
        with suppress(OSError):  # without the right to clear the flag the policy remains normal
            os.sched_setscheduler(0, policy & ~os.SCHED_RESET_ON_FORK, parameter)


@contextmanager
def _locked(lock_memory: bool) -> Iterator[None]:
    if not lock_memory:
        yield
        return
    library = ctypes.CDLL(None, use_errno=True)
    if not hasattr(library, "mlockall"):
        raise OSError(f"lock_memory must be False on {sys.platform}, which has no mlockall")
    if library.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
        number = ctypes.get_errno()
        library.munlockall()
        raise _refused(
            OSError(number, os.strerror(number)),
            "lock_memory=True needs the right to lock all memory of this process "
            "(root, CAP_IPC_LOCK, or a limit 'memlock' above its size)",
        )
    try:
        yield
    finally:
        library.munlockall()


def _refused(error: OSError, rule: str) -> OSError:
    """The same class, as PermissionError, with what would be needed."""
    return type(error)(error.errno, f"{rule}: {error.strerror}")


@contextmanager
def _without_slack() -> Iterator[None]:
    """Linux lets a sleep end up to 50 us late to join others, unless a thread has another slack."""
    if sys.platform != "linux":
        yield
        return
    prctl = ctypes.CDLL(None).prctl
    before = prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)
    prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)
    try:
        yield
    finally:
        if before > 0:
            prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(before), 0, 0, 0)


@contextmanager
def signals_written() -> Iterator[int]:
    """A file to which signals are written, so that they are seen without the GIL.

    -1 where this thread runs no handlers of signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield -1
        return
    read, write = os.pipe()
    try:
        os.set_blocking(read, False)
        os.set_blocking(write, False)
        before = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        try:
            yield read
        finally:
            signal.set_wakeup_fd(before)
    finally:
        os.close(read)
        os.close(write)
