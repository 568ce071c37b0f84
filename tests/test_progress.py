"""Long runs: reports of progress, and the end by an exception or a signal."""

import os
import sys
import time

import numpy as np
import pytest
import waits

import pmalpha as pm


def oscillator(**options):
    return pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), u0=[1.0], **options)


def pair(force=None):
    """A long run of 1e7 macro steps takes seconds; every=STEPS keeps two time levels of it."""
    a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), force=force, name="a")
    b = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), substeps=2, name="b")
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling="pm")


# ---- a callable -----------------------------------------------------------------------------


@pytest.mark.gate
def test_progress_is_reported_in_macro_steps_of_this_call_about_every_50_ms():
    c, reports = pair(), []
    c.step(7)
    begin = time.perf_counter()
    c.run(
        steps=1_000_000,
        every=1_000_000,
        progress=lambda *x: reports.append((*x, time.perf_counter())),
    )
    seconds = time.perf_counter() - begin
    done, totals, times = np.array(reports).T
    assert (totals == 1_000_000).all() and done[-1] == 1_000_000
    assert (np.diff(done) > 0).all() and done[0] > 0
    # at most once in 50 ms of a clock that counts whole milliseconds, and the end
    assert len(reports) <= seconds / 0.049 + 1
    assert (np.diff(times)[:-1] >= 0.049).all()


def test_the_end_is_reported_once_also_where_a_report_is_due(thresholds):
    thresholds(PROGRESS_INTERVAL=0.0)
    reports = []
    pair().run(steps=3, progress=lambda *x: reports.append(x))
    assert reports == [(3, 3)]
    for count in (1, 9):  # on the coupler itself; eight beside each other and one
        pair().run_each([{}] * count, steps=3, progress=lambda *x: reports.append(x))
        assert reports.count((3 * count, 3 * count)) == (2 if count == 1 else 1)


def test_progress_of_a_short_run_is_reported_at_the_end_only():
    reports = []
    pair().run(steps=3, progress=lambda *x: reports.append(x))
    pair().run(steps=0, progress=lambda *x: reports.append(x))
    assert reports == [(3, 3), (0, 0)]


def test_progress_is_reported_while_a_slow_load_is_evaluated():
    # four chunks of 32 macro steps, whose loads take 64 ms; reports are 50 ms apart
    def force(t):
        time.sleep(0.002)
        return [np.sin(t)]

    reports = []
    c = pair(force)
    c.run(steps=128, progress=lambda *x: reports.append(x[0]))
    assert len(reports) >= 4 and reports == sorted(reports) and reports[-1] == 128


def test_a_run_with_progress_is_the_same_run():
    c, other = pair(), pair()
    ours = c.run(steps=200_000, every=1000, progress=lambda *x: None)
    theirs = other.run(steps=200_000, every=1000)
    assert ours["b"].u.tobytes() == theirs["b"].u.tobytes()


def test_an_exception_in_progress_ends_the_run_at_a_whole_macro_step():
    class Enough(Exception):
        pass

    def tell(done, total):
        raise Enough(done)

    c, other = pair(), pair()
    with pytest.raises(Enough) as caught:
        c.run(steps=10_000_000, every=1_000, progress=tell)
    done = c.step_count
    assert 0 < caught.value.args[0] == done < 10_000_000
    assert c.last_history.macro_times[-1] == done // 1000 * 1000 * 0.01
    other.step(done)
    assert c.state("b").u == other.state("b").u
    c.step(3)
    other.step(3)
    assert c.state("b").u == other.state("b").u


def test_an_exception_in_the_last_report_leaves_the_whole_history():
    def tell(done, total):
        raise ZeroDivisionError

    c = pair()
    with pytest.raises(ZeroDivisionError):
        c.run(steps=5, progress=tell)
    assert c.step_count == 5 and c.last_history["a"].t.size == 6


def test_progress_may_not_call_the_coupler():
    c = pair()
    with pytest.raises(RuntimeError, match="the coupler is being stepped"):
        c.run(steps=5, progress=lambda done, total: c.time)


@pytest.mark.parametrize("progress", ["bar", 1, 0, [print]])
def test_progress_is_true_or_a_callable(progress):
    c = pair()
    with pytest.raises(TypeError, match=r"progress must be True or a callable\(done, total\), got"):
        c.run(steps=3, progress=progress)
    assert c.step_count == 0


@pytest.mark.parametrize("progress", [None, False])
def test_progress_is_silent_by_default(progress, capsys):
    pair().run(steps=3, progress=progress)
    assert capsys.readouterr() == ("", "")


# ---- a bar ----------------------------------------------------------------------------------


def test_a_bar_counts_to_the_end(capsys):
    pytest.importorskip("tqdm")
    pm.solve(oscillator(), dt=0.1, steps=1234, progress=True)
    assert "1234/1234" in capsys.readouterr().err


def test_without_tqdm_the_error_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    c = pair()
    with pytest.raises(ImportError, match=r"pip install 'pmalpha\[progress\]'"):
        c.run(steps=3, progress=True)
    assert c.step_count == 0
    c.run(steps=3, progress=print)


# ---- kill -INT ------------------------------------------------------------------------------

PROGRAM = """
    import os
    import signal
    import numpy as np
    from agreement import assert_identical
    import pmalpha as pm
    from test_threads import row_of_subdomains

    def pair(threads=1):
        n = 300  # in one call of the core for many macro steps
        a = pm.Subdomain(np.ones(n), np.eye(n) * 4.0 + 1e-3, scheme=pm.Newmark(), u0=np.ones(n))
        b = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), u0=[1.0], substeps=2)
        return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling="pm")

    c, other = {make}(threads={threads}), {make}(threads=1)
    for each in (c, other):
        each.step(1)
    there, here = os.pipe()
    if os.fork() == 0:  # another process sends it, while this one goes on
        os.read(there, 1)
        os.kill(os.getppid(), signal.SIGINT)
        os._exit(0)
    begun = []

    def report(done, total):
        if not begun:
            os.write(here, b"!")
        begun.append(done)

    record = dict(record={{1: None}}, every=100)
    try:
        c.run(steps=10**8, progress=report, **record)
    except KeyboardInterrupt:
        print(c.step_count)
    assert_identical(c.last_history, other.run(steps=c.step_count - 1, **record))
    assert_identical(c.run(steps=3), other.run(steps=3))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="another process sends the signal")
@pytest.mark.parametrize(
    ("make", "threads"), [("pair", 1), ("row_of_subdomains", 1), ("row_of_subdomains", 3)]
)
def test_kill_int_ends_a_run_at_a_whole_macro_step_from_which_it_continues(make, threads):
    done = waits.program(PROGRAM.format(make=make, threads=threads))
    assert done.returncode == 0, done.stderr
    assert 1 < int(done.stdout) < 10**8
