"""Many Python threads, with couplers of their own and with one that they share.

On a Python without the GIL they run at the same time; with it they are switched as often as it can.
"""

import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Lock

import numpy as np
import pytest
from core_objects import started

import pmalpha as pm

THREADS = 6
BUSY = "being stepped"


@pytest.fixture(autouse=True)
def frequent_switches():
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(usual)


def at_once(work, count=THREADS):
    """[work(0), work(1), ...], each in a thread of its own, begun together."""
    barrier = Barrier(count)

    def begin(k):
        barrier.wait()
        return work(k)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(begin, range(count)))


def coupler(coupling="macro", **options):
    tower = pm.Subdomain(
        np.ones(3),
        np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]),
        scheme=pm.GeneralizedAlpha(0.8),
        u0=[0.0, 0.0, 0.1],
        name="tower",
        **options,
    )
    rig = pm.Subdomain(
        [1.0],
        [40.0],
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=5,
        force=lambda t: np.array([np.sin(t)]),
        name="rig",
    )
    return pm.Coupler([tower, rig], pm.tie(tower, [0], rig, [0]), dt=0.1, coupling=coupling)


def bits(c):
    """All that is known of the present, as bytes."""
    arrays = [getattr(c.state(s.name), name) for s in c.subdomains for name in "uva"]
    return b"".join(x.tobytes() for x in [*arrays, c.multipliers])


def bits_at(steps, coupling="macro"):
    """[bits after 0 macro steps, after 1, ...] in one thread."""
    c = coupler(coupling)
    found = [bits(c)]
    for _ in range(steps):
        c.step()
        found.append(bits(c))
    return found


def insist(call):
    """Calls until the coupler is not in use; the number of refusals."""
    refused = 0
    while True:
        try:
            call()
            return refused
        except RuntimeError as error:
            assert BUSY in str(error)
            refused += 1
            time.sleep(0)  # another thread's turn


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro", "mean"])
def test_threads_with_couplers_of_their_own_do_not_disturb_each_other(coupling):
    def work(k):
        c = coupler(coupling)
        for _ in range(1 + k):
            c.reset()
            c.step(40)
        return bits(c)

    assert set(at_once(work)) == {bits_at(40, coupling)[40]}


def test_threads_share_subdomains_and_a_callable_that_iterates():
    def spring(t, u, v, q):
        return u**3, np.diag(3 * u**2)

    shared = coupler(internal=spring).subdomains
    ties = pm.tie(shared[0], [0], shared[1], [0])

    def work(k):
        c = pm.Coupler(shared, ties, dt=0.1, coupling="macro")
        c.step(20)
        return bits(c)

    assert len(set(at_once(work))) == 1


def test_each_step_of_a_shared_coupler_is_done_once_or_refused():
    c = coupler()
    at_once(lambda k: [insist(c.step) for _ in range(50)])
    assert c.step_count == 50 * THREADS
    assert bits(c) == bits_at(50 * THREADS)[-1]


def test_a_state_read_while_others_step_is_that_of_a_whole_macro_step():
    c = coupler()
    whole = {x[: 9 * 8] for x in bits_at(50 * THREADS)}  # u, v and a of the tower

    def work(k):
        seen = []
        for _ in range(50):
            insist(c.step)
            insist(lambda: seen.append(c.state("tower")))
        return seen

    states = [s for seen in at_once(work) for s in seen]
    assert {b"".join((s.u.tobytes(), s.v.tobytes(), s.a.tobytes())) for s in states} <= whole


def test_a_state_is_of_the_present_assembly_where_another_thread_changes_the_steps():
    """While this thread looks up the name, another one changes the steps and advances."""
    c = coupler()
    c.step(3)

    class Name(str):
        def __eq__(self, other):
            if c.step_count == 3:
                at_once(lambda k: (c.change_steps(substeps={"rig": 10}), c.step(2)), 1)
            return str.__eq__(self, other)

        __hash__ = str.__hash__

    found = c.state(Name("rig"))
    np.testing.assert_array_equal(found.u, c.state("rig").u)


@pytest.mark.gate
def test_calls_of_all_kinds_on_a_shared_coupler_leave_it_as_one_thread_would(tmp_path):
    c = coupler()
    start = c.snapshot()
    calls = [
        c.step,
        lambda: c.run(steps=3, energy=True),
        c.snapshot,
        lambda: c.restore(start),
        lambda: c.reset(u0={"tower": np.zeros(3)}),
        lambda: c.reset(force={"rig": np.ones(1)}),
        lambda: c.save(tmp_path / "state.npz"),
        lambda: c.load(tmp_path / "state.npz"),
        lambda: c.change_steps(substeps={"rig": 5}),
        lambda: (c.time, c.multipliers, c.state("rig"), repr(c)),
    ]
    c.save(tmp_path / "state.npz")

    def work(k):
        for i in np.random.default_rng(k).integers(len(calls), size=40):
            try:
                insist(calls[i])
            except ValueError as error:  # load: another thread has given another force
                assert "force" in str(error)

    at_once(work)
    c.reset(force={"rig": coupler().subdomains[1].force})
    c.restore(start)
    c.step(7)
    assert bits(c) == bits_at(7)[7]


def test_couplers_of_the_core_that_share_a_subdomain_do_not_step_it_at_once():
    # Python's guards are one for each coupler: here the flags of the core alone decide
    inside = Lock()

    def spring(t, u, v):
        assert inside.acquire(blocking=False)
        inside.release()
        return np.zeros(2)

    first, s = started(restoring=((spring,), np.arange(2), None))
    couplers = [first, *(started(subdomains=(s,))[0] for _ in range(THREADS - 1))]

    def work(k):
        done = 0
        for _ in range(1000):
            try:
                done += couplers[k].advance(1, None) is None
            except RuntimeError as error:
                assert BUSY in str(error)
        return done

    assert at_once(work) == [c.step_count for c in couplers]
    assert np.isfinite(s.state()).all()


def test_the_core_leaves_the_gil_disabled_where_it_can_be():
    if getattr(sys, "_is_gil_enabled", lambda: True)():
        pytest.skip("this Python has a GIL")
    code = "import sys, pmalpha; sys.exit(sys._is_gil_enabled())"
    assert subprocess.run([sys.executable, "-W", "error", "-c", code]).returncode == 0


SUBINTERPRETER = """
import sys, warnings
code = "import sys; from pmalpha import _core"
try:
    import _interpreters
    failed = _interpreters.run_string(_interpreters.create("legacy"), code)
except ModuleNotFoundError:
    import _xxsubinterpreters
    try:
        failed = _xxsubinterpreters.run_string(_xxsubinterpreters.create(isolated=False), code)
    except _xxsubinterpreters.RunFailedError as error:
        failed = error
print(failed)
"""


@pytest.mark.gate
def test_a_subinterpreter_is_refused():
    words = [sys.executable, "-c", SUBINTERPRETER]
    done = subprocess.run(words, capture_output=True, text=True, timeout=110)
    # NumPy refuses it first, or warns and leaves it to the core
    assert "ImportError" in done.stdout, done.stderr
