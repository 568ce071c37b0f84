"""Runs at the pace of a clock. No test depends on how fast the machine is."""

import importlib
import os
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import waits

import pmalpha as pm
from pmalpha.results import history_file, ring
from pmalpha.run import paced

EXAMPLES = Path(__file__).parents[1] / "examples"
FAST = 1e12  # a period of less than a nanosecond: every fine step is late
LATE = "continue"
SLOW = 1e-5  # one of a thousand seconds: none is, and the second one never begins


def made(coupling="gc", restoring=None, **options):
    a = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), v0=[1.0], name="a")
    b = pm.Subdomain(
        [1.0],
        None if restoring else [4.0],
        scheme=pm.CentralDifference(),
        substeps=2,
        restoring=restoring,
        v0=[1.0],
        name="b",
    )
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.02, coupling=coupling, **options)


def spring(t, u, v):
    return 4.0 * u


@pytest.mark.parametrize("coupling", ["gc", "pm"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_paced_run_is_bitwise_the_run(coupling, threads):
    run = made(coupling, spring, threads=threads).run(0.2, energy=True)
    coupler = made(coupling, spring, threads=threads)
    paced = coupler.run_paced(0.2, rate=FAST, on_late=LATE, energy=True)
    for name in "ab":
        for x in "uva":
            assert np.array_equal(getattr(paced[name], x), getattr(run[name], x))
    assert np.array_equal(paced.multipliers, run.multipliers)
    assert np.array_equal(paced.energy.strain, run.energy.strain)
    assert not run.pacing and coupler.last_history is None


def test_steps_begin_when_they_are_due_and_commands_come_in_between():
    pacing = made(restoring=spring).run_paced(0.1, rate=2.0, on_late=LATE).pacing
    assert pacing.period == pytest.approx(0.005, rel=1e-14)
    np.testing.assert_allclose(pacing.due - pacing.shift, 0.005 * np.arange(10), atol=1e-9)
    times = (pacing.due, pacing.begun, pacing.commanded, pacing.returned, pacing.ended)
    assert all(np.all(x <= y) for x, y in zip(times[:-1], times[1:]))
    assert np.array_equal(pacing.lateness, pacing.begun - pacing.due)
    assert pacing.percentile(100.0) == pacing.lateness.max()
    assert pacing.longest(3)[0] == np.argmax(pacing.duration)


def test_other_fine_steps_are_paced_too():
    internal = pm.CubicSpring([0], 2.0, 1.0)

    def coupler():
        a = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), internal=internal, v0=[1.0], name="a")
        b = pm.Subdomain(
            [1.0], [4.0], scheme=pm.CentralDifference(), substeps=2, v0=[1.0], name="b"
        )
        tie = pm.tie(a, [0], b, [0])
        return pm.Coupler([a, b], tie, dt=0.02, coupling="gc")

    paced = coupler().run_paced(0.2, rate=FAST, on_late=LATE)
    assert np.array_equal(paced["a"].u, coupler().run(0.2)["a"].u)
    assert paced.pacing.due.size == 20


def test_without_a_specimen_there_are_no_commands():
    pacing = made().run_paced(0.1, rate=FAST, on_late=LATE).pacing
    assert np.all(np.isnan(pacing.commanded)) and np.all(np.isnan(pacing.returned))


def test_late_steps_are_counted_and_none_is_left_out():
    pacing = made().run_paced(0.1, rate=FAST, on_late=LATE).pacing
    assert pacing.due.size == pacing.missed == 10


def test_a_late_specimen_shifts_the_schedule_by_as_much_as_it_was_late():
    calls, wait, period = [], 0.05, 0.01

    def late(t, u, v):
        calls.append(time.monotonic())
        if len(calls) == 4:  # the first one is at t = 0
            time.sleep(wait)
        return 4.0 * u

    pacing = made(restoring=late).run_paced(0.2, on_late=LATE).pacing
    assert np.all(np.diff(pacing.shift) >= 0.0) and np.all(pacing.shift[:3] >= 0.0)
    late = 2  # the fine step with that call, which ends `wait` after its command
    assert pacing.shift[late + 1] - pacing.shift[late] >= wait - period
    np.testing.assert_allclose(pacing.due - pacing.shift, period * np.arange(20), atol=1e-9)
    shifted = np.flatnonzero(np.diff(pacing.shift) > 0.0)
    gaps = np.diff(pacing.commanded)[shifted]
    assert np.all(gaps >= period * (1.0 - 1e-9))  # no missed command is made up for
    assert pacing.missed == shifted.size + (pacing.ended[-1] > pacing.due[-1] + period)
    assert f"shifted by {pacing.shift[-1]:.3g} s" in repr(pacing)


def test_a_run_that_is_faster_than_its_problem_is_limited_by_the_clock():
    limited = dict(restoring=spring, limits=pm.rig.Limits(velocity=2.0))
    mass = pm.Subdomain([1.0], None, scheme=pm.CentralDifference(), v0=[1.0], name="m", **limited)
    coupler = pm.Coupler([mass], dt=0.001, coupling="gc")
    with pytest.raises(pm.LimitError, match="velocity at dof 0, by the clock, 3") as caught:
        coupler.run_paced(0.1, rate=3.0, on_late=LATE)
    assert caught.value.by_clock and caught.value.value == pytest.approx(3.0, rel=1e-4)
    assert coupler.step_count == 0
    coupler.run(0.1)


def test_a_late_step_ends_a_run_that_stops():
    coupler = made(restoring=spring)
    coupler.step(2)
    with pytest.raises(pm.PacingError, match="macro step 2, which begins at t = 0.04") as caught:
        coupler.run_paced(0.2, rate=FAST)
    assert (caught.value.step, caught.value.time) == (2, 0.04)
    assert coupler.step_count == 2
    pacing = coupler.last_history.pacing
    assert pacing.due.size == pacing.missed == 1
    assert coupler.last_history.macro_times.tolist() == [0.04]


@pytest.mark.parametrize("restoring", [None, spring])
def test_ctrl_c_ends_a_long_wait(restoring):
    coupler = made(restoring=restoring)
    begun = lambda: waits.is_stepped(coupler)  # noqa: E731
    with pytest.raises(KeyboardInterrupt), waits.ctrl_c_when(begun, after=0.1):
        coupler.run_paced(0.2, rate=SLOW)
    assert coupler.step_count == 0
    assert coupler.last_history.pacing.missed == 0
    assert signal.set_wakeup_fd(-1) == -1
    coupler.run_paced(0.2, rate=FAST, on_late=LATE)


def test_the_gil_is_not_taken_while_paced_steps_are_compiled(monkeypatch):
    seen = []

    class Seen(paced.Times):
        def __init__(self, *args):
            super().__init__(*args)
            seen.append(self.times)

    def hold():
        waits.until(lambda: seen and not np.isnan(seen[0][0, 0]))
        end = time.monotonic() + waits.LIMIT
        while np.isnan(seen[0][3, -1]) and time.monotonic() < end:
            pass  # with the GIL, which nothing takes from a thread within the interval
        seen.append(time.monotonic() < end)

    monkeypatch.setattr(paced, "Times", Seen)
    coupler, interval = made(), sys.getswitchinterval()
    thread = threading.Thread(target=hold)
    thread.start()
    sys.setswitchinterval(1000.0)
    try:
        coupler.run_paced(
            0.2, on_late=LATE
        )  # longer than the 50 ms after which other runs look for signals
    finally:
        sys.setswitchinterval(interval)
        thread.join()
    assert seen[1]


def test_a_run_can_be_paced_outside_of_the_main_thread():
    found = []
    thread = threading.Thread(
        target=lambda: found.append(made().run_paced(0.1, rate=FAST, on_late=LATE))
    )
    thread.start()
    thread.join()
    assert found[0].pacing.due.size == 10


def test_loads_that_are_functions_are_evaluated_before_the_run():
    times = []
    mass = pm.Subdomain(
        [1.0], [4.0], scheme=pm.Newmark(), force=lambda t: times.append(t) or [np.sin(t)]
    )
    coupler = pm.Coupler([mass], dt=0.001, coupling="gc")
    seen = []
    coupler.run_paced(0.1, on_late=LATE, progress=lambda done, total: seen.append(len(times)))
    assert set(seen) == {101}  # at 0, and at each of the steps


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_couplings_without_fine_steps_are_refused(coupling):
    coupler = made(coupling)
    with pytest.raises(ValueError, match="needs coupling 'pm' or 'gc'.*free run"):
        coupler.run_paced(0.2)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        (dict(rate=0.0), ValueError, "rate must be positive, got 0.0"),
        (dict(rate=-1.0), ValueError, "rate must be positive"),
        (dict(rate="fast"), TypeError, "rate must be a real number"),
        (dict(rate=1e-12), ValueError, "at most thirty years"),
        (dict(on_late="wait"), ValueError, "on_late must be"),
        (dict(priority=0), ValueError, r"priority must be in 1\.\.99 or None, got 0"),
        (dict(priority=1.5), TypeError, "priority must be a whole number"),
        (dict(lock_memory="yes"), TypeError, "lock_memory must be"),
    ],
)
def test_wrong_arguments_are_refused_and_nothing_moves(options, error, match):
    coupler = made()
    if "priority" in options and not hasattr(os, "sched_setscheduler"):
        pytest.skip("no priorities here")
    with pytest.raises(error, match=match):
        coupler.run_paced(0.2, **options)
    assert coupler.step_count == 0


def test_steps_of_other_lengths_after_a_change_come_first():
    coupler = made("pm")
    coupler.step(3)
    coupler.change_steps(substeps={"b": 4})
    with pytest.raises(ValueError, match="after change_steps.*call step"):
        coupler.run_paced(0.2, rate=FAST, on_late=LATE)
    coupler.step()
    assert coupler.run_paced(0.2, rate=FAST, on_late=LATE).pacing.due.size == 4 * 6


# ---- what the system allows ----------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no priorities here")
def test_without_the_right_to_a_priority_nothing_moves(monkeypatch):
    def refuse(*args):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(paced.os, "sched_setscheduler", refuse)
    coupler = made()
    with pytest.raises(PermissionError, match="priority=5 needs the right to SCHED_FIFO.*rtprio"):
        coupler.run_paced(0.2, rate=FAST, on_late=LATE, priority=5)
    assert coupler.step_count == 0
    assert coupler.run_paced(0.2, rate=FAST, on_late=LATE).pacing.due.size == 20


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no priorities here")
def test_the_priority_is_that_of_the_steps_of_this_thread_alone():
    before, inside, other = os.sched_getscheduler(0), [], []

    def specimen(t, u, v):
        if t > 0.0:
            inside.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)
            thread = threading.Thread(target=lambda: other.append(os.sched_getscheduler(0)))
            thread.start()
            thread.join()
        return 4.0 * u

    try:
        made(restoring=specimen).run_paced(0.02, rate=FAST, on_late=LATE, priority=1)
    except PermissionError:
        pytest.skip("no right to SCHED_FIFO")
    assert set(inside) == {os.SCHED_FIFO} and os.SCHED_FIFO not in other
    assert os.sched_getscheduler(0) == before


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_locked_during_the_steps():
    def locked():
        with open("/proc/self/status") as status:
            return next(int(x.split()[1]) for x in status if x.startswith("VmLck"))

    seen = []
    coupler = made(restoring=lambda t, u, v: seen.append(locked()) or 4.0 * u)
    coupler.step()
    before = locked()
    try:
        coupler.run_paced(0.04, rate=FAST, on_late=LATE, lock_memory=True)
    except OSError as error:
        assert "lock_memory=True needs the right" in str(error)
        pytest.skip("no right to lock memory")
    assert seen[-1] > before == locked()


# ---- what is left of it --------------------------------------------------------------------------


def test_times_are_drawn_as_a_histogram():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pacing = made().run_paced(0.1, rate=FAST, on_late=LATE).pacing
    own = pyplot.subplots()[1]
    assert pacing.plot(own) is own and own.get_xscale() == "log"
    ax = pacing.plot()
    assert ax.figure.number in pyplot.get_fignums()
    pyplot.close("all")


def test_a_run_of_no_steps_has_no_times():
    pacing = made().run_paced(0.0).pacing
    assert repr(pacing) == "<Pacing: no fine steps>" and pacing.missed == 0
    assert np.isnan(pacing.percentile(50.0)) and np.isnan(pacing.percentile([1, 2])).all()


# ---- written by a thread of its own --------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["gc", "pm"])
@pytest.mark.parametrize("options", [{}, {"every": 3}, {"energy": True, "record": {"b": [0]}}])
def test_a_file_of_a_paced_run_is_that_of_a_run(
    coupling, options, tmp_path, monkeypatch, thresholds
):
    pytest.importorskip("h5py")
    recordings = []

    class Seen(ring.RingRecording):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            recordings.append(self)

    def patient(t, u, v):  # the ring is never full
        if recordings:
            waits.until(lambda: t / 0.02 - recordings[-1].begin < 5.0)
        return spring(t, u, v)

    # some thirty macro steps at a time
    thresholds(FILED_BYTES=4000, MONITOR_INTERVAL=0.001)
    monkeypatch.setattr(paced, "RingRecording", Seen)
    ends = (2.0,) if "energy" in options else (1.0, 2.0)  # which no file goes on with
    coupler, path = made(coupling, patient, threads=2), tmp_path / "paced.h5"
    for end in ends:
        how = dict(record_to=path, append=True, **options)
        kept = coupler.run_paced(end, rate=FAST, on_late=LATE, **how)
        assert kept.pacing.lost == 0 and coupler.last_history is None
    run = made(coupling, spring, threads=2).run(2.0, **options)
    for x in "uva":
        assert np.array_equal(getattr(kept["b"], x), getattr(run["b"], x))
    for x in ("multipliers", "velocity_jump", "displacement_jump", "macro_times"):
        assert np.array_equal(getattr(kept, x), getattr(run, x))
    if "energy" in options:
        assert np.array_equal(kept.energy.balance, run.energy.balance)


def test_a_full_ring_is_counted_and_never_waited_for(tmp_path, monkeypatch, thresholds):
    pytest.importorskip("h5py")
    thresholds(FILED_BYTES=4000, MONITOR_INTERVAL=0.001)
    over = []

    def specimen(t, u, v):
        over.append(t)
        return 4.0 * u

    write = history_file.HistoryFile.write

    def blocked(*args):  # until the last fine step was commanded
        waits.until(lambda: over[-1] >= 2.0)
        write(*args)

    monkeypatch.setattr(history_file.HistoryFile, "write", blocked)
    run = made(restoring=spring).run(2.0)
    path = tmp_path / "paced.h5"
    history = made(restoring=specimen).run_paced(2.0, rate=FAST, on_late=LATE, record_to=path)
    lost = history.pacing.lost
    there = ~np.isnan(history["b"].u[:, 0])
    assert 0 < lost == np.count_nonzero(np.isnan(history.displacement_jump)) < 100
    assert np.array_equal(history["b"].u[there], run["b"].u[there])
    assert np.count_nonzero(~there) == 2 * lost


def test_a_file_that_cannot_be_written_ends_the_run_at_once_and_memory_keeps_all(
    tmp_path, monkeypatch, thresholds
):
    pytest.importorskip("h5py")
    thresholds(MONITOR_INTERVAL=0.001)
    write, failed, calls = history_file.HistoryFile.write, threading.Event(), []

    def full(file, arrays, begin, end):
        if end > 5:
            failed.set()
            raise OSError(28, "no space left")
        write(file, arrays, begin, end)

    def specimen(t, u, v):
        calls.append(t)
        if len(calls) > 20:
            waits.until(failed.is_set)
            time.sleep(0.001)  # that the core looks, every 50 ms, long before the end
        return spring(t, u, v)

    monkeypatch.setattr(history_file.HistoryFile, "write", full)
    coupler = made(restoring=specimen)
    with pytest.raises(OSError, match="no space left"):
        coupler.run_paced(2000.0, rate=FAST, on_late=LATE, record_to=tmp_path / "paced.h5")
    history, done = coupler.last_history, coupler.step_count
    assert 10 <= done < 100_000 and len(history.macro_times) == done + 1
    assert np.array_equal(history["b"].u, made(restoring=spring).run(steps=done)["b"].u)


def test_a_paced_run_that_ends_early_has_its_file(tmp_path):
    pytest.importorskip("h5py")
    calls = []

    def specimen(t, u, v):
        calls.append(t)
        if t > 0.1:
            raise RuntimeError("enough")
        return 4.0 * u

    coupler = made(restoring=specimen)
    with pytest.raises(RuntimeError, match="enough"):
        coupler.run_paced(0.2, rate=FAST, on_late=LATE, record_to=tmp_path / "paced.h5")
    assert coupler.step_count == 5 and coupler.last_history.pacing.due.size == 10
    assert pm.History.load(tmp_path / "paced.h5").macro_times.size == 6
    coupler.reset()  # and no ring is left


# ---- another process looks at it -----------------------------------------------------------------


def test_a_monitor_has_commands_forces_and_times(tmp_path):
    coupler = made(restoring=spring)
    coupler.step()
    coupler.monitor(tmp_path / "live")
    history = coupler.run_paced(0.2, rate=FAST, on_late=LATE)
    last = pm.rig.read_monitor(tmp_path / "live")
    assert last.step.tolist() == list(range(18)) and last.period == history.pacing.period
    for name in ("due", "begun", "commanded", "returned", "ended", "lateness"):
        assert np.array_equal(getattr(last, name), getattr(history.pacing, name))
    np.testing.assert_allclose(last.t, history["b"].t[1:], rtol=1e-14)  # (T1) sums otherwise
    # under the central difference the displacement is the command
    assert np.array_equal(last.command["b"], history["b"].u[1:])
    assert np.array_equal(last.force["b"], 4.0 * history["b"].u[1:])
    assert list(last.dofs) == ["b"] and last.dofs["b"].tolist() == [0]


def test_a_monitor_keeps_the_last_rows_of_the_last_run(tmp_path):
    coupler = made(restoring=spring)
    coupler.monitor(tmp_path / "live", {"b": None}, rows=7)
    coupler.run_paced(0.2, rate=FAST, on_late=LATE)
    history = coupler.run_paced(0.4, rate=FAST, on_late=LATE)
    last = pm.rig.read_monitor(tmp_path / "live")
    assert last.step.tolist() == list(range(13, 20))
    assert np.array_equal(last.command["b"], history["b"].u[-7:])
    coupler.monitor(None)
    coupler.run_paced(0.6, rate=FAST, on_late=LATE)
    assert np.array_equal(pm.rig.read_monitor(tmp_path / "live").t, last.t)


def test_a_monitor_is_written_while_the_run_goes_on(tmp_path):
    seen = []

    def specimen(t, u, v):
        if t > 0.1:  # what came before is written some time
            waits.until(lambda: (tmp_path / "live").exists())
            waits.until(lambda: pm.rig.read_monitor(tmp_path / "live").step.size >= 10)
            seen.append(pm.rig.read_monitor(tmp_path / "live"))
        return 4.0 * u

    coupler = made(restoring=specimen)
    coupler.monitor(tmp_path / "live")
    coupler.run_paced(0.12, rate=FAST, on_late=LATE)
    assert seen[0].step.size == 10


def test_only_specimens_are_monitored(tmp_path):
    coupler = made(restoring=spring)
    with pytest.raises(ValueError, match=r"dofs\['a'\] must be of a specimen"):
        coupler.monitor(tmp_path / "live", {"a": [0]})
    with pytest.raises(ValueError, match="rows must be"):
        coupler.monitor(tmp_path / "live", rows=0)
    (tmp_path / "other").write_text("something else")
    with pytest.raises(ValueError, match="path must be a file of Coupler.monitor"):
        pm.rig.read_monitor(tmp_path / "other")


def test_the_example_draws_what_is_monitored(tmp_path, monkeypatch):
    figure = pytest.importorskip("matplotlib.figure")
    monkeypatch.syspath_prepend(EXAMPLES)
    live = importlib.import_module("live")
    coupler = live.test()
    coupler.monitor(tmp_path / "live")
    history = coupler.run_paced(0.5, rate=FAST, on_late=LATE)
    lines = live.panels(figure.Figure())
    live.update(lines, pm.rig.read_monitor(tmp_path / "live"))
    assert [len(line.get_xdata()) for line in lines] == 3 * [500]
    u, r, late = (line.get_ydata() for line in lines)
    assert np.array_equal(late, 1e6 * history.pacing.lateness)
    # a stiffness of 4e6 N/m, 2 ms late, compensated; if not, u, in mm, is by 4 % another one
    assert np.abs(r - 4.0 * u).max() < 0.3 * np.abs(r).max()
