"""Ctrl-C at any bytecode, and BLAS that several threads limit at once."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier, Event

import numpy as np
import pytest
import threadpoolctl
import waits

import pmalpha as pm
from pmalpha._core import Guard
from pmalpha.memory import one_thread
from pmalpha.results.times import Clock
from pmalpha.run.motion import CallbackLoad
from pmalpha.run.progress import DeferredSignals

STEPS = 100


def blas_threads():
    """Number of threads of each BLAS library."""
    libraries = threadpoolctl.ThreadpoolController().select(user_api="blas").info()
    return [library["num_threads"] for library in libraries]


@pytest.fixture
def two_blas_threads():
    """BLAS with two threads, also where the machine has one processor."""
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        if set(blas_threads()) != {2}:
            pytest.skip("a BLAS library without a choice of threads")
        yield


@pytest.mark.gate
def test_ctrl_c_at_any_bytecode_loses_one_value_of_a_load_at_most(interrupt):
    rng = np.random.default_rng(16)
    times, interrupted = [], 0
    load = CallbackLoad(lambda t: times.append(t) or [t], "a load", np.arange(1), 1, Clock(1.0))
    done = 0
    for _ in range(300):
        while True:
            try:
                interrupt(rng.uniform(2e-5, 1e-3))
                load.prepare(done, done + STEPS)
                interrupt(0.0)
            except KeyboardInterrupt:
                interrupted += 1
                continue
            break
        np.testing.assert_array_equal(load.rows[:, 0], np.arange(done + 1.0, done + STEPS + 1.0))
        done += STEPS
    # an interrupt between an evaluation and the row in which it is stored repeats that evaluation;
    # 50 interrupts hit the jump at the end of the loop several times
    assert interrupted > 50
    assert set(np.diff(times)) <= {0.0, 1.0}


def test_a_run_that_ctrl_c_ends_continues_bitwise_identically(interrupt):
    def made(force):
        mass = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), force=force, name="m")
        return pm.Coupler([mass], dt=0.01)

    def load(t):
        return np.array([np.sin(3.0 * t)])

    whole = made(load).run(steps=3000)["m"].u
    coupler, rng = made(load), np.random.default_rng(3)
    pieces, interrupted = [], 0
    while coupler.step_count < 3000:
        begin, history = coupler.step_count, None
        try:
            interrupt(rng.uniform(1e-4, 5e-3) * (1 + interrupted))  # on a slow machine too
            history = coupler.run(steps=3000 - begin)
            interrupt(0.0)
        except KeyboardInterrupt:
            interrupted += 1
            if history is None:  # else it came after the last run, before the timer was stopped
                history = coupler.last_history
        if coupler.step_count == begin:  # before the first step of this call
            continue
        pieces.append(history["m"].u[1 if pieces else 0 :])
        if interrupted > 200:
            break
    assert interrupted > 0
    u = np.concatenate(pieces)
    np.testing.assert_array_equal(u, whole[: len(u)])


def test_blas_has_its_threads_again_after_two_threads_limited_it_at_once(two_blas_threads):
    both, first_left = Barrier(2, timeout=waits.LIMIT), Event()

    def first():
        with one_thread():
            both.wait()
        first_left.set()

    def second():
        with one_thread():
            both.wait()
            assert first_left.wait(waits.LIMIT)
            return blas_threads()  # another thread has left the context, this one has not

    with ThreadPoolExecutor(2) as pool:
        a, b = pool.submit(first), pool.submit(second)
        a.result()
        assert set(b.result()) == {1}
    assert set(blas_threads()) == {2}


def test_every_blas_library_that_is_loaded_has_one_thread():
    """Older versions of threadpoolctl do not find the one of SciPy's wheels."""
    maps = Path("/proc/self/maps")
    if not maps.exists():
        pytest.skip("a system without a list of what a process has loaded")
    with one_thread():
        found = threadpoolctl.ThreadpoolController().select(user_api="blas").info()
    loaded = {line.split(maxsplit=5)[-1] for line in maps.read_text().splitlines()}
    openblas = {Path(name).resolve() for name in loaded if "openblas" in Path(name).name}
    assert openblas <= {Path(library["filepath"]).resolve() for library in found}
    assert {library["num_threads"] for library in found} <= {1}


def test_blas_has_its_threads_again_after_an_exception(two_blas_threads):
    with pytest.raises(ZeroDivisionError), one_thread(), one_thread():
        raise ZeroDivisionError
    assert set(blas_threads()) == {2}


@pytest.mark.gate
def test_ctrl_c_at_any_bytecode_leaves_blas_its_threads(two_blas_threads, interrupt):
    rng, interrupted = np.random.default_rng(4), 0
    while interrupted < 300:
        try:
            interrupt(rng.uniform(1e-6, 1e-4))
            while True:
                with one_thread(), one_thread():
                    pass
        except KeyboardInterrupt:
            interrupted += 1
        assert set(blas_threads()) == {2}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_process_forked_off_while_blas_is_limited_has_its_threads(two_blas_threads):
    inside, over = Event(), Event()

    def limit():
        with one_thread():
            inside.set()
            over.wait(waits.LIMIT)

    with ThreadPoolExecutor(1) as pool:
        pool.submit(limit)
        assert inside.wait(waits.LIMIT)
        assert set(blas_threads()) == {1}
        child = os.fork()
        if child == 0:  # without the thread that has limited it
            outside = set(blas_threads()) == {2}
            with one_thread():
                within = set(blas_threads()) == {1}
            os._exit(0 if outside and within and set(blas_threads()) == {2} else 1)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        over.set()
    assert status == 0 and set(blas_threads()) == {2}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_thread_that_forks_while_it_limits_blas_is_still_within(two_blas_threads):
    with one_thread():
        child = os.fork()
        if child == 0:
            within = set(blas_threads()) == {1}
            one_thread().__exit__(None, None, None)
            os._exit(0 if within and set(blas_threads()) == {2} else 1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_blas_has_its_threads_again_after_couplers_of_two_threads(two_blas_threads):
    def make(_):
        rng = np.random.default_rng(0)
        A = rng.normal(size=(60, 60))
        mass = pm.Subdomain(np.ones(60), A @ A.T, scheme=pm.GeneralizedAlpha(0.5))
        return pm.solve(mass, dt=0.1, steps=1).u

    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(make, range(20)))
    for u in results:
        np.testing.assert_array_equal(u, results[0])
    assert set(blas_threads()) == {2}


def test_signals_held_by_a_context_that_was_never_left_are_passed_on_after_its_guard(interrupt):
    guard = Guard()
    with guard:
        signals = DeferredSignals(guard)
        signals.__enter__()
        signal.raise_signal(signal.SIGALRM)
        assert len(signals._arrived) == 1
    # as after an exception on entering its __exit__: the guard alone has been left
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGALRM)
    with guard, pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGALRM)


def test_signals_wait_until_the_context_is_left(interrupt):
    guard = Guard()
    reached = False
    with guard, pytest.raises(KeyboardInterrupt), DeferredSignals(guard):
        signal.raise_signal(signal.SIGALRM)
        reached = True
    assert reached


def stop_as_ctrl_c(number, frame):
    raise KeyboardInterrupt


def stop_by_a_limit_of_time(number, frame):
    raise TimeoutError("of a handler")


@pytest.mark.parametrize(
    ("handler", "raised"),
    [(stop_as_ctrl_c, KeyboardInterrupt), (stop_by_a_limit_of_time, TimeoutError)],
)
@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
@pytest.mark.parametrize("where", ["force", "restoring", "internal"])
def test_an_exception_of_a_handler_in_a_function_of_the_user_ends_the_run(
    where, coupling, fails, handler, raised, interrupt
):
    """Also where the function fails at that moment; the run continues bitwise identically."""
    arrival = np.inf  # from this time on a signal arrives in the function, once

    def meet(t):
        nonlocal arrival
        if t < arrival:
            return
        arrival = np.inf
        try:
            if fails:
                raise ValueError("of the function")
        finally:
            signal.raise_signal(signal.SIGALRM)

    def force(t):
        meet(t)
        return [np.sin(t)]

    def restoring(t, u, v):
        meet(t)
        return 0.1 * u

    def internal(t, u, v, q):
        meet(t)
        return 0.1 * u, 0.1 * np.eye(1)

    functions = {"force": force, "restoring": restoring, "internal": internal}

    def made():
        scheme = pm.GeneralizedAlpha(0.5)
        function = {where: functions[where]}
        a = pm.Subdomain([1.0], [4.0], scheme=scheme, u0=[1.0], name="a", **function)
        b = pm.Subdomain([1.0], [9.0], scheme=scheme, substeps=2, u0=[1.0], name="b")
        return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling=coupling)

    whole = made().run(steps=10)["b"].u
    coupler = made()
    signal.signal(signal.SIGALRM, handler)  # the fixture puts back the one before
    arrival = 0.045
    with pytest.raises(raised) as error:
        coupler.run(steps=10)
    assert error.traceback[-1].name == handler.__name__
    # loads are evaluated ahead of the steps; what is no Exception ends a run before them
    done = 0 if where == "force" and raised is KeyboardInterrupt else 4
    assert coupler.step_count == done
    if done:
        np.testing.assert_array_equal(coupler.last_history["b"].u, whole[: 2 * done + 1])
    np.testing.assert_array_equal(coupler.run(steps=10 - done)["b"].u, whole[2 * done :])
