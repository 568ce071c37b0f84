"""What a process and its threads have only for a while: one thread of BLAS, locks, no denormals.

Processes are forked off while another thread sets couplers up, and set up and run couplers too;
Ctrl-C comes at any instant of a set-up; motions decay below 2.2e-308 in runs that end, are ended by
an exception or call functions. Afterwards BLAS has its threads, no process waits for ever, and
denormal numbers are what they were for the caller. What else happens is counted as "wrong".
"""

import os
import signal
import sys
import threading
import time
import warnings
from collections import Counter
from contextlib import suppress
from functools import cache

import numpy as np
import threadpoolctl
from campaign import arguments, seeds

import pmalpha as pm
from pmalpha.memory import one_thread

SLOW = 60  # s, in which a process that was forked off is done
SMALLEST = np.finfo(float).tiny
SCHEMES = (pm.GeneralizedAlpha(0.5), pm.Newmark(), pm.CentralDifference())


def blas_threads():
    with one_thread():  # what it loads is found below
        found = threadpoolctl.ThreadpoolController().select(user_api="blas")
    return {library["num_threads"] for library in found.info()}


def two_threads_of_blas():
    blas_threads()
    return threadpoolctl.threadpool_limits(2, user_api="blas")


@cache
def stiffness(n):
    A = np.random.default_rng(n).normal(size=(n, n))
    return A @ A.T + n * np.eye(n)


def coupler(n=60, coupling="gc"):
    """Dense and sparse subdomains, one of them iterated: all that a set-up has."""
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    spring = pm.CubicSpring([0], k=1.0, k3=0.5) if coupling == "gc" else None
    how = dict(scheme=pm.GeneralizedAlpha(0.5))
    a = pm.Subdomain(np.ones(n), stiffness(n), u0=np.ones(n), name="a", **how)
    b = pm.Subdomain(np.ones(n), K, internal=spring, name="b", substeps=2, **how)
    return pm.Coupler([a, b], pm.tie(a, [0, 1], b, [0, 1]), dt=0.1, coupling=coupling)


# ---- forks ---------------------------------------------------------------------------------------


def child(coupling):
    """The status of a process that was forked off: 0, or 1 where BLAS has other threads."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(SLOW)  # which ends it
    coupler(coupling=coupling).run(steps=2)
    return 0 if blas_threads() == {2} else 1


def forked(rng, times=10):
    """Forks at random instants of a set-up by another thread."""
    over, found = threading.Event(), Counter()
    coupling = ("pm", "gc", "macro")[int(rng.integers(3))]
    coupler(coupling=coupling)

    def work():
        while not over.is_set():
            coupler(coupling=coupling)

    with two_threads_of_blas():
        thread = threading.Thread(target=work)
        thread.start()
        for seconds in rng.uniform(0.0, 0.02, times):
            time.sleep(seconds)
            number = os.fork()
            if number == 0:
                with suppress(BaseException):
                    os._exit(child(coupling))
                os._exit(2)
            status = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
            found["done" if status == 0 else f"wrong: status {status}"] += 1
        over.set()
        thread.join()
        found["parent" if blas_threads() == {2} else "wrong: BLAS of the parent"] += 1
    return found


# ---- Ctrl-C --------------------------------------------------------------------------------------


def interrupted(rng, times=40):
    """Ctrl-C at random instants of a set-up, many times.

    Python loses one that arrives in a callback of its own, such as that of an import's lock, so a
    second follows, as from somebody who waits; few may be lost, and no function of the package is
    called where they are.
    """
    found, lost = Counter(), []
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    told, sys.unraisablehook = sys.unraisablehook, lambda x: lost.append(str(x.object))
    with two_threads_of_blas():
        for _ in range(times):
            try:
                signal.setitimer(signal.ITIMER_REAL, rng.exponential(5e-3), 2.0)
                while True:
                    coupler()
            except KeyboardInterrupt:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                found["interrupts"] += 1
            except Exception as error:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                found[f"wrong: {type(error).__name__}"] += 1
            if blas_threads() != {2}:
                found["wrong: BLAS is limited"] += 1
    signal.signal(signal.SIGALRM, before)
    sys.unraisablehook = told
    for where in lost:
        of_python = "importlib" in where or "_get_module_lock" in where
        found["lost by Python" if of_python else f"wrong: lost in {where}"] += 1
    return found


# ---- denormal numbers ----------------------------------------------------------------------------


def has_denormals():
    return bool(np.array([SMALLEST])[0] * np.array([0.5])[0] > 0.0)


def decaying(rng, evaluated):
    """Two subdomains whose motion decays below the smallest normal number, and what is called."""
    n, fails = int(rng.integers(2, 8)), rng.random() < 0.3
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    scale = 10.0 ** rng.uniform(-315.0, -290.0)
    end = rng.uniform(10.0, 60.0)

    def load(t):
        evaluated.append(has_denormals())
        if fails and t > end:
            raise ArithmeticError
        return np.zeros(n)

    def restoring(t, u, v):
        evaluated.append(has_denormals())
        return 0.1 * u

    called = [{}, {"force": load}, {"force": load, "restoring": restoring}][int(rng.integers(3))]
    how = dict(v0=scale * np.ones(n), scheme=SCHEMES[int(rng.integers(len(SCHEMES)))])
    a = pm.Subdomain(np.ones(n), K, C=2.0 * np.eye(n), name="a", **how, **called)
    b = pm.Subdomain(np.ones(n), K, C=2.0 * np.eye(n), name="b", substeps=3, **how)
    coupling = ("pm", "gc", "macro", "mean")[int(rng.integers(4))]
    if "restoring" in called and coupling in ("macro", "mean"):
        coupling = "pm"
    tie = pm.tie(a, [n - 1], b, [0])
    threads = int(rng.integers(1, 3))
    return pm.Coupler([a, b], tie, dt=0.2, coupling=coupling, threads=threads)


def decayed(rng):
    """No recorded motion is denormal; functions and the caller have denormal numbers."""
    evaluated, found = [], Counter()
    made = decaying(rng, evaluated)
    try:
        history = made.run(100.0, energy=rng.random() < 0.3)
        found["ran"] += 1
    except ArithmeticError:
        history = made.last_history
        found["ended by an exception"] += 1
    if not has_denormals():
        found["wrong: the caller has none"] += 1
    if not all(evaluated):
        found["wrong: a function has none"] += 1
    for s in history.subdomains:
        for x in (s.u[1:], s.v[1:], s.a[1:]):
            if np.any((x != 0.0) & (np.abs(x) < SMALLEST)):
                found["wrong: denormal"] += 1
    return found


TRIALS = (forked, interrupted, decayed, decayed)


def attempt(seed, counts, trials=TRIALS):
    """One trial, the seed's."""
    trial, rng = trials[seed % len(trials)], np.random.default_rng([seed, 19])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = trial(rng)
    for what, times in found.items():
        counts[f"{trial.__name__}: {what}"] += times


def faults(counts):
    return {what: times for what, times in counts.items() if "wrong" in what}


if __name__ == "__main__":
    given, counts = arguments(__doc__, only=str), Counter()
    chosen = [trial for trial in TRIALS if given.only in (None, trial.__name__)]
    for seed in seeds(given.seed, given.seconds):
        attempt(seed, counts, chosen)
    for what, times in sorted(counts.items()):
        print(f"{times:6} {what}")
    sys.stdout.flush()
    assert not faults(counts)
