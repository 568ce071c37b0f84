"""Waiting for events and programs, however slow the machine is, and Ctrl-C at an event."""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest

import pmalpha

LIMIT = 600.0  # s, which only ends what hangs


def until(happened, over=None):
    """Return when ``happened()`` is true, or the event `over` is set, or after `LIMIT`."""
    end = time.monotonic() + LIMIT
    while not happened() and time.monotonic() < end and not (over and over.is_set()):
        time.sleep(0.001)


def program(code):
    """A program in a process of its own that has ended; its death by a signal fails the test.

    It imports the modules of the tests, and the package that is tested.
    """
    folders = Path(__file__).parent, Path(pmalpha.__file__).parent.parent
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, folders))},
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.returncode >= 0, f"died by signal {-done.returncode}: {done.stderr[-500:]}"
    return done


def is_stepped(coupler):
    """Is the coupler in a call of any thread?"""
    return coupler._session.guard.turns % 2 == 1


@contextlib.contextmanager
def ctrl_c_when(happened, after=0.0):
    """A SIGINT for this process when ``happened()`` has become true, in another thread.

    `after` seconds later, where that makes an instant likely which nothing announces: no result may
    depend on it.
    """
    over = threading.Event()

    def send():
        until(happened, over)
        if not over.wait(after):
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        signal.signal(signal.SIGINT, before)


def interrupted_run(coupler, steps, **options):
    """A run that Ctrl-C ends in the core, when some macro steps are done."""
    done = []
    with pytest.raises(KeyboardInterrupt), ctrl_c_when(lambda: any(done)):
        coupler.run(steps=steps, progress=lambda count, total: done.append(count), **options)
