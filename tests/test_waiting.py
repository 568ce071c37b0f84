"""While a worker computes, the caller waits: signals, progress and faults are not lost meanwhile.

The compiled functions wait for what the caller is to do meanwhile, or fail on purpose.
"""

import sys
import textwrap

import pytest
import waits

PRELUDE = """
import ctypes, faulthandler, signal, sys, threading, time
import waits
from compiled import RESTORING
from scipy import LowLevelCallable
import pmalpha as pm

calls = []

def quick(t, n, u, v, r, user):
    return 0

seen = threading.Event()  # the caller has done what a worker waits for

def waiting(t, n, u, v, r, user):
    if t > 0.0 and threading.get_ident() != threading.main_thread().ident:
        calls.append(t)
        seen.wait(waits.LIMIT)
    return 0

def two(function, substeps, coupling="pm"):
    # equal sizes: worker 0 has the first subdomain, worker 1 the second
    a, b = (
        pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), substeps=substeps, u0=[1.0], name=name,
                     restoring=LowLevelCallable(RESTORING(f)))
        for name, f in (("a", quick), ("b", function))
    )
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, threads=2, coupling=coupling)
"""


def run(code, survives=True):
    return waits.program(PRELUDE + textwrap.dedent(code), survives)


@pytest.mark.parametrize("coupling", ["macro", "pm"])
def test_ctrl_c_is_answered_while_another_worker_evaluates_a_slow_force(coupling):
    # the handler, in the first evaluation of 100, releases the worker: without it that would last
    done = run(f"""
    def handler(number, frame):
        print(len(calls))
        seen.set()
        raise KeyboardInterrupt

    coupler = two(waiting, substeps=100, coupling={coupling!r})
    try:
        with waits.ctrl_c_when(lambda: calls):
            signal.signal(signal.SIGINT, handler)
            coupler.step(1)
    except KeyboardInterrupt:
        print("interrupted", coupler.step_count)
    """)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["1", "interrupted", "0"]


def test_progress_is_reported_while_another_worker_evaluates_a_slow_force():
    done = run("""
    def report(done, total):
        reports.append((done, len(calls)))
        if calls:
            seen.set()

    reports = []
    coupler = two(waiting, substeps=50, coupling="macro")
    coupler.run(steps=1, progress=report)
    print(*reports[0], len(calls))
    """)
    assert done.returncode == 0, done.stderr
    # the first report is in the first evaluation; without one the worker would wait
    assert done.stdout.split() == ["0", "1", "50"]


@pytest.mark.skipif(sys.platform != "linux", reason="the words of the report are those of Linux")
def test_a_fault_in_a_compiled_force_leaves_a_traceback_whatever_thread_it_is_in():
    done = run(
        """
    def faulty(t, n, u, v, r, user):
        if threading.get_ident() != threading.main_thread().ident:
            print("in a worker", flush=True)
            ctypes.string_at(0)
        return 0

    faulthandler.enable()
    two(faulty, substeps=3).step(1)
    """,
        survives=False,
    )
    assert "in a worker" in done.stdout
    assert done.returncode < 0
    assert "Segmentation fault" in done.stderr and "faulty" in done.stderr


def test_a_compiled_force_may_take_the_gil_and_run_another_coupler():
    done = run("""
    inner = two(quick, substeps=2)

    def nested(t, n, u, v, r, user):
        inner.step(1)
        return 0

    outer = two(nested, substeps=3)
    outer.step(2)
    print(outer.step_count, inner.step_count)
    """)
    assert done.returncode == 0, done.stderr
    # 3 substeps in each of 2 macro steps, and one evaluation for the initial accelerations
    assert done.stdout.split() == ["2", "7"]


def test_an_exception_of_a_restoring_force_survives_the_wait_for_another_worker():
    # the report of progress and the handler of signals must not run on top of it
    done = run("""
    evaluated = []

    def long(t, n, u, v, r, user):
        time.sleep(0.12)  # reports are due every 50 ms
        return 0

    def bad(t, u, v):
        evaluated.append(t)
        if len(evaluated) > 4:
            raise ValueError("of the user")
        return 0.0 * u

    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="a", restoring=bad,
                     restoring_stiffness=[0.0])
    b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="b",
                     restoring=LowLevelCallable(RESTORING(long)))
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, threads=2, coupling="gc")
    try:
        coupler.run(steps=20, progress=lambda done, total: None)
    except ValueError as error:
        print(error)
    """)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "of the user"


def test_an_exception_of_progress_in_a_wait_is_not_replaced_by_what_fails_afterwards():
    done = run("""
    def failing(t, n, u, v, r, user):
        waiting(t, n, u, v, r, user)
        return 7 if t > 0.0 else 0

    def report(done, total):
        seen.set()
        raise KeyError("of progress")

    coupler = two(failing, substeps=1, coupling="gc")
    try:
        coupler.run(steps=3, progress=report)
    except KeyError as error:
        print(error, coupler.step_count)
    """)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "'of progress' 0"
