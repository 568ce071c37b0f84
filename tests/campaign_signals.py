"""Signals at random instants of `run` and `step`, whose handlers raise an exception.

After each interrupt the coupler is at a completed macro step, not busy, and `last_history` is the
run up to that step; the continued run is bitwise identical to one without interrupts. What is
raised is the exception of the handler, or of a callable that fails now and then, and no other: no
SystemError, which Python raises for an error without an exception.
"""

import functools
import signal
import tempfile
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from campaign import arguments, seeds, tried

import pmalpha as pm

STEPS = 60
ALL, CALLS = 40 * STEPS, 400  # of one coupler at most


# what Python evaluates during a run, as arguments of the first subdomain or of the second
CALLABLES = {
    "nothing": ({}, {}),
    "load": ({"force": lambda t: np.full(3, np.sin(3.0 * t))}, {}),
    "restoring force": ({"restoring": lambda t, u, v: 0.1 * u}, {}),
    "internal force": ({}, {"internal": lambda t, u, v, q: (0.1 * u**3, np.diag(0.3 * u**2))}),
}


def failing(function, rng):
    """The callable, which raises an exception once in 500 calls."""

    @functools.wraps(function)
    def evaluate(*arguments):
        if rng.random() < 0.002:
            raise ArithmeticError("of a callable")
        return function(*arguments)

    return evaluate


def made(threads, what, coupling="pm", rng=None):
    """Two subdomains with substeps, one with a callable, which fails now and then given an rng."""
    of_a, of_b = CALLABLES[what]
    if rng is not None:
        of_a, of_b = ({k: failing(f, rng) for k, f in x.items()} for x in (of_a, of_b))
    K = np.diag([4.0, 4.0, 2.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    scheme = pm.GeneralizedAlpha(0.5)
    a = pm.Subdomain(np.ones(3), K, scheme=scheme, u0=[1.0, 0.5, 0.2], name="a", **of_a)
    b = pm.Subdomain(
        np.ones(2), [3.0, 3.0], scheme=scheme, substeps=4, u0=[0.2, 0.0], name="b", **of_b
    )
    return pm.Coupler([a, b], pm.tie(a, [2], b, [0]), dt=0.05, threads=threads, coupling=coupling)


def interrupting(number, frame):
    raise KeyboardInterrupt


def limiting(number, frame):
    raise TimeoutError("of a handler")


HANDLED = (KeyboardInterrupt, TimeoutError)
HANDLERS = (signal.default_int_handler, interrupting, limiting)


class Interrupts:
    """Raises an exception after a time, in the way Ctrl-C does."""

    def __init__(self, handler):
        self.handler = handler

    def __enter__(self):
        self.before = signal.signal(signal.SIGALRM, self.handler)
        return self

    def __exit__(self, *exception):
        self.after(0.0)
        signal.signal(signal.SIGALRM, self.before)

    def after(self, seconds):
        signal.setitimer(signal.ITIMER_REAL, seconds)
        for _ in range(3):  # a signal that has arrived already raises here, not behind the caller
            pass


def interrupted(interrupts, seconds, call):
    """Was the call ended by an exception? Its result is lost where one came on its return."""
    ended = False
    try:
        interrupts.after(seconds)
        try:
            call()
        except ArithmeticError:  # before the interrupt, which is taken back
            ended = True
        interrupts.after(0.0)
    except HANDLED:
        ended = True
    return ended


def check(coupler, begin, runs, u, counts):
    """After an interrupt of a run or of steps that began at macro step `begin`."""
    end, history = coupler.step_count, coupler.last_history  # also: not busy
    counts["moved" if end > begin else "not moved"] += 1
    np.testing.assert_array_equal(coupler.state("b").u, u[4 * end])
    if history is None:
        assert not runs or end in (begin, begin + STEPS)
        counts["returned already"] += bool(runs and end > begin)
        return
    if runs and end > begin:  # otherwise it may be that of an earlier run
        assert history.macro_times[0] == begin * 0.05
        assert history.macro_times[-1] == end * 0.05 == coupler.time
    first, last = (round(t / 0.05) for t in history.macro_times[[0, -1]])
    np.testing.assert_array_equal(history["b"].u, u[4 * first : 4 * last + 1])


def attempt(seed, counts):
    """One coupler that is interrupted in many calls, at most until it has done all its steps."""
    rng = np.random.default_rng(seed)
    what = list(CALLABLES)[rng.integers(len(CALLABLES))]
    coupling = ["pm", "gc", "macro"][rng.integers(3)]
    threads, filed = int(rng.integers(1, 3)), rng.random() < 0.2
    filed = filed and find_spec("h5py") is not None
    u = made(1, what, coupling).run(steps=ALL)["b"].u
    fails = rng if rng.random() < 0.3 else None
    coupler = made(threads, what, coupling, fails)
    mean = 10.0 ** rng.uniform(-4.0, -2.5)
    handler = HANDLERS[rng.integers(3)]
    with Interrupts(handler) as interrupts, tempfile.TemporaryDirectory() as folder:
        for call_number in range(CALLS):
            if coupler.step_count + STEPS > ALL:
                break
            begin, runs = coupler.step_count, bool(rng.integers(2))
            seconds = rng.exponential(mean)
            options = {"record_to": Path(folder, f"{rng.integers(2**60)}.h5")} if filed else {}

            def call(runs=runs, options=options):
                coupler.run(steps=STEPS, **options) if runs else coupler.step(STEPS)

            counts["calls"] += 1
            if interrupted(interrupts, seconds, call):
                counts["interrupts"] += 1
                check(coupler, begin, runs, u, counts)
            else:
                assert coupler.step_count == begin + STEPS
            if call_number % 7 == 0:
                with suppress(*HANDLED):
                    coupler.state("a")


if __name__ == "__main__":
    given = arguments(__doc__)
    print(dict(tried(attempt, seeds(given.seed, given.seconds))))
