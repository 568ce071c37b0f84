"""The C extension beside threads and signals."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import signal
import sys
import threading
import time
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import waits
from agreement import assert_same_levels
from core_objects import coupler, i64, record, started
from pairwise import in_turn

import pmalpha as pm

# ---- threads ------------------------------------------------------------------------------------


def long_run(n=1000, force=None):
    """A coupler that needs minutes for its steps, and their number."""
    K = sp.diags_array(
        [np.full(n, 2.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], offsets=[0, 1, -1]
    )
    a = pm.Subdomain(
        np.ones(n), sp.csr_array(K), scheme=pm.GeneralizedAlpha(0.5), u0=np.sin(np.arange(n)),
        substeps=2, force=force, name="a",
    )  # fmt: skip
    b = pm.Subdomain([1.0], [1.0], scheme=pm.GeneralizedAlpha(0.5), u0=[0.0], name="b")
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm"), 10_000_000


def test_one_of_two_threads_in_the_same_core_object_gets_a_runtime_error():
    errors, within, meddled = [], threading.Event(), threading.Event()

    def force(t, u, v):  # holds this thread in the core until the other one has tried everything
        within.set()
        meddled.wait(waits.LIMIT)
        return np.zeros(2)

    c, s = started(restoring=((force,), i64(0, 1), None))

    def meddle():
        within.wait(waits.LIMIT)
        none = np.zeros(1)
        for call in (
            lambda: c.advance(1, None),
            lambda: c.multipliers,
            lambda: c.prescribed,
            lambda: c.start(0, none, none),
            lambda: c.record_present(record(rows=1)),
            lambda: s.state(),
            lambda: s.levels(),
            lambda: s.set_levels(s.levels()),
            lambda: s.set_load(None),
            lambda: s.start(np.zeros(2), np.zeros(2), np.zeros(2), none),
            lambda: s.compliance(False, i64(0)),
            lambda: coupler(subdomains=(s,)).start(0, none, none),
        ):
            try:
                call()
            except Exception as error:
                errors.append(error)
        meddled.set()

    thread = threading.Thread(target=meddle)
    thread.start()
    c.advance(3, None)
    thread.join()
    assert c.step_count == 3
    assert [type(error) for error in errors] == [RuntimeError] * 12
    assert all("being stepped" in str(error) for error in errors)
    assert c.advance(1, None) is None


def test_many_threads_at_one_coupler_leave_it_as_one_would():
    c, _ = long_run(n=20)
    counts = {"done": 0, "refused": 0}
    other, _ = long_run(n=20)
    end = time.monotonic() + waits.LIMIT

    def work():
        while min(counts.values()) < 100 and time.monotonic() < end:
            for call in (lambda: c.run(steps=3), lambda: c.step(2), lambda: c.state("a")):
                try:
                    call()
                    counts["done"] += 1
                except RuntimeError:
                    counts["refused"] += 1

    switch = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(switch)
    assert min(counts.values()) >= 100
    other.step(c.step_count)
    for name in "ab":
        np.testing.assert_array_equal(c.state(name).u, other.state(name).u)


def test_couplers_of_the_same_subdomains_run_in_threads_at_once():
    first, _ = long_run(n=50)
    subdomains = [first.run(steps=0).keys[i][1] for i in range(2)]
    tie = pm.tie(subdomains[0], [0], subdomains[1], [0])
    couplers = [pm.Coupler(subdomains, tie, dt=0.1, coupling="pm") for _ in range(4)]
    threads = [threading.Thread(target=c.step, args=(2000,)) for c in couplers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    first.step(2000)
    for c in couplers:
        np.testing.assert_array_equal(c.state("a").u, first.state("a").u)


# ---- signals ------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 1000])
def test_ctrl_c_ends_a_run_at_a_whole_macro_step(n):
    c, steps = long_run(n) if n > 1 else (one_dof(), 10**9)
    waits.interrupted_run(c, steps, every=1_000_000)
    done = c.step_count
    assert 0 < done < steps
    assert c.time == done * 0.1
    history = c.last_history
    assert history is not None and history[0].u.shape[0] == 1 + done // 1_000_000
    other = long_run(n)[0] if n > 1 else one_dof()
    other.step(done)
    for _ in range(2):
        assert_same_levels(c, other)
        c.step(5)
        other.step(5)
    assert_same_levels(c, other)


def one_dof():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), u0=[1.0])
    return pm.Coupler([a], dt=0.1)


def test_ctrl_c_ends_a_single_macro_step_of_many_substeps():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), u0=[1.0], substeps=2**31)
    c = pm.Coupler([a], dt=0.1)
    with pytest.raises(KeyboardInterrupt), waits.ctrl_c_when(lambda: waits.is_stepped(c), 0.1):
        c.step()
    assert c.step_count == 0 and c.state(0).u[0] == 1.0


@pytest.mark.gate
def test_ctrl_c_under_a_callable_load_evaluates_only_the_interrupted_time_twice():
    times_of_load = []

    def force(t):
        times_of_load.append(t)
        return np.full(20, np.sin(t))

    c, steps = long_run(20, force=force)
    other, _ = long_run(20, force=lambda t: np.full(20, np.sin(t)))
    times = 10  # the signal comes in the load, around it, or in the core
    for k in range(times):
        with pytest.raises(KeyboardInterrupt):
            with waits.ctrl_c_when(lambda: waits.is_stepped(c), 0.01 + 4e-4 * k):
                c.run(steps=steps, every=1_000_000)
    other.step(c.step_count)
    assert_same_levels(c, other)
    c.step(3)
    other.step(3)
    assert_same_levels(c, other)
    assert times_of_load == sorted(times_of_load)
    assert len(times_of_load) - len(set(times_of_load)) <= times


def test_few_steps_are_evaluated_ahead_under_a_slow_load_for_which_ctrl_c_waits():
    # a chunk is 32 macro steps, however long they take
    times, ahead = [], []

    def force(t):
        time.sleep(0.002)
        times.append(t)
        ahead.append(round(t / 0.1) - c._session.core.step_count)
        return [np.sin(t)]

    a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), force=force)
    c = pm.Coupler([a], dt=0.1)
    c.run(steps=100)
    assert len(times) == 101 and max(ahead) <= 32


@pytest.mark.gate
def test_a_handler_that_does_not_raise_does_not_stop_the_run():
    seen = []
    c, _ = long_run(10)
    old = signal.signal(signal.SIGALRM, lambda *args: seen.append(args))
    signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)
    try:
        c.step(300_000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, old)
    other, _ = long_run(10)
    other.step(300_000)
    assert_same_levels(c, other)
    assert seen


def test_a_handler_may_not_call_the_coupler_that_is_being_stepped():
    c, steps = long_run(10)

    def call(*args):
        c.state("a")

    with waits.ctrl_c_when(lambda: waits.is_stepped(c)):
        signal.signal(signal.SIGINT, call)  # restored by the context
        with pytest.raises(RuntimeError, match="being stepped"):
            c.step(steps)
    other, _ = long_run(10)
    other.step(c.step_count)
    assert_same_levels(c, other)


# one in 13 entries in turn, of each call with or without a callable load; all of them in campaigns
CALLS = "run", "step", "load", "reset", "state"
LOADS = None, lambda t: np.full(5, np.sin(t))
ENTERED = [(*pair, 13) for pair in in_turn(CALLS, *LOADS)]
ALL = [pytest.param(*pair, 1, marks=pytest.mark.campaign) for pair in product(CALLS, LOADS)]


@pytest.mark.gate
@pytest.mark.parametrize(("call", "force", "stride"), ENTERED + ALL)
def test_an_interrupt_on_entering_a_function_of_the_package_leaves_all_or_nothing(
    tmp_path, call, force, stride
):
    # CPython checks for signals when a Python function is entered
    calls = {
        "run": lambda c: c.run(steps=4),
        "step": lambda c: c.step(4),
        "reset": lambda c: c.reset(u0={"b": [0.0]}),
        "state": lambda c: c.state("a"),
        "load": lambda c: c.load(tmp_path / "state"),
    }
    states = reference_states(force)
    saved, _ = long_run(5, force=force)
    saved.step(6)
    saved.save(tmp_path / "state")
    k, finished = 0, False
    while not finished:
        c, _ = long_run(5, force=force)
        if call != "state":
            c.step(2)
        finished = interrupt_at_entry(k, lambda c=c: calls[call](c))
        done = c.step_count
        possible = {"run": range(2, 7), "step": range(2, 7), "reset": (0, 2), "state": (0,)}
        assert done in (possible | {"load": (2, 6)})[call]
        for ahead in (0, 3):
            c.step(ahead)
            assert c.step_count == done + ahead, f"interrupted at entry {k}"
            for x in "uva":
                np.testing.assert_array_equal(
                    getattr(c.state("a"), x), getattr(states[done + ahead], x), f"entry {k}"
                )
        k += stride
    assert k > 3  # functions of the package that the shortest call enters


def reference_states(force):
    c, _ = long_run(5, force=force)
    states = []
    for _ in range(12):
        states.append(c.state("a"))
        c.step()
    return states


def interrupt_at_entry(k, call):
    """KeyboardInterrupt at the k-th entry of a function of the package; False if it came."""
    package, count = str(Path(pm.__file__).parent), 0

    def trace(frame, event, argument):
        nonlocal count
        if event == "call" and frame.f_code.co_filename.startswith(package):
            count += 1
            if count == k + 1:
                sys.settrace(None)
                raise KeyboardInterrupt
        return None

    old = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return False
    finally:
        sys.settrace(old)
    return True
