"""Waiting for events and programs, however slow the machine is, and Ctrl-C at an event."""

import atexit
import contextlib
import functools
import json
import os
import signal
import subprocess
import sys
import tempfile
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


HERE = Path(__file__).parent
PATHS = os.pathsep.join(map(str, (HERE, Path(pmalpha.__file__).parent.parent)))


@functools.cache
def _programs():
    """The process of programs.py, which has imported the package: one for each process of tests."""
    server = subprocess.Popen(
        [sys.executable, HERE / "programs.py"],
        env={**os.environ, "PYTHONPATH": PATHS},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(server.communicate)
    return server


def program(code, survives=True):
    """A program in a process of its own that has ended; its death by a signal fails the test.

    It imports the modules of the tests, and the package that is tested.
    """
    code = textwrap.dedent(code)
    if hasattr(os, "fork"):
        done = _forked(code)
    else:
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONPATH": PATHS},
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
    assert done.returncode >= 0 or not survives, (
        f"died by signal {-done.returncode}: {done.stderr[-500:]}"
    )
    return done


def _forked(code):
    server = _programs()
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps([code, folder, LIMIT]), file=server.stdin, flush=True)
        status = int(server.stdout.readline())
        out, err = ((Path(folder) / name).read_text() for name in ("stdout", "stderr"))
    return subprocess.CompletedProcess(code, status, out, err)


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
