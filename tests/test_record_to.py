"""A History written to an HDF5 file during the run."""

import json
import os
import sys
import tracemalloc
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import waits
from agreement import assert_identical, assert_same_bits
from reference_problems import random_problem
from test_binding_threads import interrupt_at_entry, long_run

import pmalpha as pm
from pmalpha import files, models
from pmalpha.results import history_file
from pmalpha.results.ring import MonitorFile

h5py = pytest.importorskip("h5py")
# ---- the same History -----------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize(
    ("ending", "options"),
    [("h5", {}), ("hdf5", {"record": {0: [0]}, "every": 2}), ("h5", {"energy": True})],
    ids=str,
)
def test_a_history_saved_as_hdf5_is_read_back_bitwise_identical(tmp_path, options, ending):
    path = tmp_path / f"saved.{ending}"
    for seed in range(2):
        coupler = random_problem(seed).coupler()
        coupler.step(3)
        history = coupler.run(steps=5, **options)
        history.save(path)  # over the one before
        loaded = pm.History.load(path)
        assert_identical(loaded, history)
        loaded.save(path)  # over the one it was read from
        assert_identical(pm.History.load(path), history)
        with h5py.File(path) as plain:
            assert np.array_equal(plain[f"{history[0].name}/u"], history[0].u)
    assert os.listdir(tmp_path) == [path.name]


def test_an_hdf5_file_that_cannot_be_saved_leaves_the_old_one(tmp_path):
    history = random_problem(0).coupler().run(steps=2)
    with pytest.raises(FileNotFoundError, match="path cannot be written.*nowhere/h.h5'"):
        history.save(tmp_path / "nowhere" / "h.h5")
    path = tmp_path / "h.h5"
    history.save(path)
    old = path.read_bytes()
    code = f"""
        import resource, signal
        from pmalpha import History
        history = History.load({str(path)!r})
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # a disk that is full
        try:
            history.save({str(path)!r})
        except OSError as error:
            print(error)
    """
    done = waits.program(code)
    assert done.returncode == 0, done.stderr
    assert "path cannot be written: File too large" in done.stdout
    assert path.read_bytes() == old and os.listdir(tmp_path) == ["h.h5"]


OPTIONS = [{}, {"every": 3}, {"record": {0: [0]}}, {"record": {}}, {"energy": True}]


@pytest.mark.parametrize(("seed", "options"), list(enumerate(OPTIONS)), ids=str)
def test_the_history_in_the_file_is_bitwise_identical_to_that_in_memory(tmp_path, seed, options):
    problem = random_problem(seed)
    ours, theirs = problem.coupler(), problem.coupler()
    for steps in (7, 0, 4):  # and in intervals that do not begin at a multiple of three
        whole = theirs.run(steps=steps, **options)
        history = ours.run(steps=steps, record_to=tmp_path / "run.h5", overwrite=True, **options)
        assert_identical(history, whole)
        assert history.keys == ours.run(steps=0).keys
        assert_identical(pm.History.load(tmp_path / "run.h5"), whole)


@pytest.mark.parametrize("size", [1.0, 5e3])
@pytest.mark.parametrize("every", [None, 1, 7])
def test_any_number_of_intervals_makes_the_same_file(tmp_path, thresholds, size, every):
    thresholds(FILED_BYTES=size)
    ours, theirs = (models.four_dof().coupler(0.05, coupling="pm") for _ in range(2))
    for c in (ours, theirs):
        c.step(5)
    options = {"every": every, "energy": True}
    history = ours.run(steps=83, record_to=tmp_path / "run.h5", overwrite=True, **options)
    assert_identical(history, theirs.run(steps=83, **options))


@pytest.mark.gate
def test_a_file_of_many_subdomains_and_any_names_is_a_file(tmp_path):
    names = ["Größe 塔", "b\0", "header", "step_count", "0/u", *(f"part {i}" for i in range(20))]
    subdomains = [pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), v0=[1.0], name=x) for x in names]
    coupler, other = (
        pm.Coupler(subdomains, dt=0.1, coupling="pm"),
        pm.Coupler(subdomains, dt=0.1, coupling="pm"),
    )
    history = coupler.run(steps=3, record_to=str(tmp_path / "run.h5"))
    assert_identical(history, other.run(steps=3))
    assert pm.History.load(tmp_path / "run.h5")["b\0"].u.shape == (4, 1)


def test_a_history_of_a_file_has_the_methods_of_a_history(tmp_path):
    coupler = models.four_dof().coupler(0.05, coupling="pm")
    history = coupler.run(steps=40, energy=True, record_to=tmp_path / "run.h5")
    history.save(tmp_path / "run.npz")
    assert_identical(pm.History.load(tmp_path / "run.npz"), history)
    assert abs(history["A"].u).max() > 0.5 and not history["A"].u.flags.writeable
    assert history["A"].u.flags.aligned


# ---- memory ---------------------------------------------------------------------------------


@pytest.mark.gate
def test_a_run_to_a_file_needs_memory_for_one_block_and_a_read_for_what_is_read(
    tmp_path, thresholds
):
    thresholds(FILED_BYTES=1e6, READ_BYTES=1e6)  # more than that is mapped
    n, path = 1000, tmp_path / "run.h5"

    def largest_memory(steps):
        s = pm.Subdomain(np.ones(n), np.ones(n), scheme=pm.CentralDifference(), u0=np.ones(n))
        coupler = pm.Coupler([s], dt=0.1)
        tracemalloc.start()
        try:
            history = coupler.run(steps=steps, record_to=path, overwrite=True)
            last = history[0].u[-1, 0] + pm.History.load(path)[0].a[:, 7].sum()
            largest = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert np.isfinite(last)
        assert path.stat().st_size > 3 * 8 * n * steps
        return largest

    largest_memory(10)  # modules that the first run to a file imports take 2 MB
    short, long = largest_memory(300), largest_memory(900)  # 7 MB and 22 MB in the file
    assert short < 6e6  # the block, and the samples of which the accuracy is judged
    assert long - short < 1e5  # of 15 MB; the times are among it, 8 bytes a step


def test_steps_that_were_not_run_take_no_room_on_disk(tmp_path):
    path, seen = tmp_path / "run.h5", []

    def tell(done, total):
        raise KeyboardInterrupt

    s = pm.Subdomain(np.ones(100), np.ones(100), scheme=pm.CentralDifference(), u0=np.ones(100))
    coupler = pm.Coupler([s], dt=0.1)
    with pytest.raises(KeyboardInterrupt):
        coupler.run(steps=10**8, record_to=path, progress=tell)  # 240 GB
    seen = coupler.last_history
    assert 0 < coupler.step_count == len(seen.macro_times) - 1 < 10**8
    stat = path.stat()
    if stat.st_blocks * 512 > 1e11:
        pytest.skip("a file system without holes")
    # the rows, the page at each end of an array, and what the system reserves ahead
    assert stat.st_blocks * 512 < 3e3 * coupler.step_count + 1e7


# ---- other readers --------------------------------------------------------------------------


STEPS = 10_000_000  # far more than are taken


class Enough(Exception):
    """Raised where a reader has seen what it should."""


@pytest.mark.gate
def test_others_read_while_the_run_goes_on(tmp_path):
    path, counts = tmp_path / "run.h5", []
    coupler, other = (models.four_dof().coupler(0.05, coupling="pm") for _ in range(2))

    def tell(done, total):
        for options in ({}, {"swmr": True}):
            read(options)
        if len(set(counts)) > 2:
            raise Enough

    def read(options):
        with h5py.File(path, "r", **options) as file:
            if not counts:  # the first report may come after the first rows
                assert pm.History.load(path).macro_times[-1] == file["step_count"][0] * 0.05
            counts.append(int(file["step_count"][0]))
            names = json.loads(file["header"][()])["names"]
            assert names == ["A", "B"] and file["A/u"].shape == (STEPS + 1, 3)
            if counts[-1] == 0:
                assert_identical(pm.History.load(path), other.run(steps=0, record={"A": None}))
            rows = file["A/t"][: counts[-1] + 1]
        np.testing.assert_array_equal(rows, np.arange(len(rows)) * 0.05)

    with pytest.raises(Enough):
        coupler.run(steps=STEPS, record={"A": None}, record_to=path, progress=tell)
    assert counts == sorted(counts)
    assert len(pm.History.load(path).macro_times) == coupler.step_count + 1


@pytest.mark.parametrize("options", [{}, {"swmr": True}, {"locking": False}, {"locking": True}])
def test_a_file_that_this_process_has_open_is_read(tmp_path, options):
    path = tmp_path / "run.h5"
    history = models.four_dof().coupler(0.05, coupling="pm").run(steps=9, record_to=path)
    with h5py.File(path, "r", **options) as file:
        assert_identical(pm.History.load(path), history)
        assert file["step_count"][0] == 9


def test_a_file_that_was_packed_again_is_read(tmp_path):
    history = (
        models.four_dof().coupler(0.05, coupling="pm").run(steps=9, record_to=tmp_path / "run.h5")
    )
    with h5py.File(tmp_path / "run.h5") as old, h5py.File(tmp_path / "packed.h5", "w") as new:

        def pack(name, x):
            if isinstance(x, h5py.Dataset):
                chunks = {"compression": "gzip"} if x.ndim > 1 else {}
                new.create_dataset(name, data=x[()], **chunks)

        old.visititems(pack)
    assert_identical(pm.History.load(tmp_path / "packed.h5"), history)


# ---- ends before the end --------------------------------------------------------------------


def test_an_exception_of_a_run_counts_where_its_file_is_replaced_and_its_rows_are_kept(tmp_path):
    coupler, path = models.four_dof().coupler(0.05, coupling="pm"), tmp_path / "run.h5"

    def damage(done, total):
        path.unlink()
        path.write_bytes(b"no file of HDF5")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        coupler.run(steps=100, record_to=path, progress=damage)
    assert len(coupler.last_history.macro_times) == coupler.step_count + 1  # of its own file


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ZeroDivisionError()])
@pytest.mark.parametrize("size", [1.0, 16e6])
def test_after_an_exception_the_last_history_is_the_file_up_to_the_last_macro_step(
    tmp_path, thresholds, error, size
):
    thresholds(FILED_BYTES=size)

    def coupler(breaks):
        def force(t):
            if t > 1.234 and breaks:
                raise error
            return [np.sin(t)]

        a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), force=force, name="a")
        b = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), substeps=3, name="b")
        return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.05, coupling="pm")

    broken, other = coupler(True), coupler(False)
    with pytest.raises(type(error)):
        broken.run(steps=100, record_to=tmp_path / "run.h5", energy=True)
    done = broken.step_count
    assert done == 24 if isinstance(error, ZeroDivisionError) else 0 <= done <= 24
    whole = other.run(steps=done, energy=True)
    assert_identical(broken.last_history, whole)
    assert_identical(pm.History.load(tmp_path / "run.h5"), whole)
    again = broken.last_history
    broken.reset(force={"a": lambda t: [0.0]})
    assert broken.last_history is None and again.energy


def test_an_exception_of_a_tangent_before_the_first_step_leaves_a_file_of_the_present(tmp_path):
    # a run that continues evaluates the tangents of an explicit subdomain for its critical step
    broken = []

    def internal(t, u, v, q):
        if broken:
            raise ZeroDivisionError
        return u**3, np.diag(3.0 * u**2)

    s = pm.Subdomain([1.0], [4.0], scheme=pm.CentralDifference(), v0=[1.0], internal=internal)
    coupler, path = pm.Coupler([s], dt=0.1), tmp_path / "run.h5"
    first = coupler.run(steps=5)
    broken.append(True)
    with pytest.raises(ZeroDivisionError):
        coupler.run(steps=5, record_to=path)
    assert_identical(pm.History.load(path), coupler.last_history)
    assert coupler.step_count == 5 and coupler.last_history.macro_times.size == 1
    broken.clear()
    coupler.run(steps=5, record_to=path, append=True)
    whole = pm.History.join([first, pm.History.load(path)])
    assert_identical(whole, pm.Coupler([s], dt=0.1).run(steps=10))


KILLED = """
    import os, signal, time
    import numpy as np
    import h5py
    from pmalpha import models
    from pmalpha.results import array_file, recording

    def recorded(name, steps):
        coupler = models.four_dof().coupler(0.05, coupling="pm")
        coupler.step(3)
        coupler.run(steps=steps, record_to=os.path.join({folder!r}, name), energy=True)

    recorded("imports", 1)
    begin = time.process_time()
    recorded("short", 1)
    until_file = time.process_time() - begin  # the work of a run of one step on this machine, now

    rng = np.random.default_rng(1)
    for kill in range({kills}):
        recording.FILED_SECONDS = 0.3 * (kill % 2)  # 0: a count for every macro step
        array_file.SYNC_SECONDS = 0.0
        seconds = until_file * 10.0 ** rng.uniform(-0.5, 1.7)
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_PROF, seconds)  # of its own work: it is killed
            recorded(str(kill), 10**7)
            os._exit(1)
        assert os.waitpid(child, 0)[1] == signal.SIGPROF
"""
LAST = 20_000  # macro steps that are compared


@pytest.mark.parametrize("kills", [4, pytest.param(20, marks=pytest.mark.campaign)])
def test_a_file_is_whole_up_to_its_count_after_a_kill_at_any_time(tmp_path, kills):
    # from before the file exists to after many blocks
    done = waits.program(KILLED.format(kills=kills, folder=str(tmp_path)))
    assert done.returncode == 0, done.stderr
    other = models.four_dof().coupler(0.05, coupling="pm")
    other.step(3)
    whole = other.run(steps=LAST, energy=True)
    counts = [count_after_kill(tmp_path / str(kill), whole) for kill in range(kills)]
    assert len(set(counts)) > kills // 4, counts


def count_after_kill(path, whole):
    """Macro steps in the file, all as in the run that was not killed; -1 for no file."""
    if not path.exists():
        return -1
    found = pm.History.load(path)
    count = min(len(found.macro_times) - 1, LAST)
    for ours, theirs in zip(found.subdomains, whole.subdomains):
        substeps = (len(theirs.t) - 1) // LAST
        for name in "tuva":
            assert_same_bits(cut(ours, name, count * substeps), cut(theirs, name, count * substeps))
    fine = (len(whole.multiplier_times) - 1) // LAST
    for name in ("multipliers", "multiplier_times", "velocity_jump"):
        assert_same_bits(cut(found, name, count * fine), cut(whole, name, count * fine))
    for name, x in whole.energy.arrays().items():
        assert_same_bits(found.energy.arrays()[name][: count + 1], x[: count + 1], name)
    return count


def cut(x, name, last):
    return getattr(x, name)[: last + 1]


# ---- files that cannot be written or read ---------------------------------------------------


def test_a_path_that_cannot_be_written_is_an_error_before_the_first_step(tmp_path):
    times = []

    def specimen(t, u, v):
        times.append(t)
        return u

    rig = pm.Subdomain([1.0], None, scheme=pm.CentralDifference(), restoring=specimen)
    coupler = pm.Coupler([rig], dt=0.1)
    missing, folder, device = tmp_path / "nowhere" / "run.h5", tmp_path, "/dev/full"
    for path, why in (
        (missing, "No such file or directory.*nowhere/run.h5'"),
        (folder, "a folder or a device"),
        (device, "a folder or a device"),
    ):
        with pytest.raises(OSError, match=f"record_to cannot be written: {why}"):
            coupler.run(steps=3, record_to=path)
    with pytest.raises(TypeError, match="record_to must be a str or a path, got 3"):
        coupler.run(steps=3, record_to=3)
    assert not times
    with pytest.raises(OSError, match="path cannot be written"):
        coupler.run(steps=2**52, record_to=tmp_path / "huge.h5")  # larger than any file system
    assert coupler.step_count == 0 and not list(tmp_path.iterdir())
    coupler.run(steps=2, record_to=tmp_path / "run.h5")
    assert times == [0.0, 0.1, 0.2]


def test_a_run_that_cannot_begin_leaves_the_old_file(tmp_path):
    def force(t):
        raise ZeroDivisionError

    path = tmp_path / "run.h5"
    models.four_dof().coupler(0.05, coupling="pm").run(steps=3, record_to=path)
    good = path.read_bytes()
    s = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), force=force)
    with pytest.raises(ZeroDivisionError):
        pm.Coupler([s], dt=0.1).run(steps=3, record_to=path, overwrite=True)
    with pytest.raises(TypeError, match="either t_end or steps"):
        models.four_dof().coupler(0.05, coupling="pm").run(record_to=path)
    assert path.read_bytes() == good


def test_a_history_keeps_its_numbers_when_its_file_is_replaced(tmp_path):
    coupler = models.four_dof().coupler(0.05, coupling="pm")
    first = coupler.run(steps=5, record_to=tmp_path / "run.h5")
    before = first["A"].u.copy()
    coupler.run(steps=50, record_to=tmp_path / "run.h5", overwrite=True)
    assert_same_bits(first["A"].u, before)


def test_a_full_disk_ends_the_run_and_memory_keeps_what_is_not_in_the_file(
    tmp_path, monkeypatch, thresholds
):
    thresholds(FILED_BYTES=1.0, SYNC_SECONDS=0.0)  # every macro step
    coupler, other = (models.four_dof().coupler(0.05, coupling="pm") for _ in range(2))
    written, pwrite = [], os.pwrite

    def full(descriptor, data, position):
        written.append(len(data))
        if sum(written) > 50_000:
            raise OSError(28, "No space left on device")
        return pwrite(descriptor, data[: max(1, len(data) // 2)], position)  # as the system may

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(OSError, match="record_to cannot be written: No space left.*run.h5'"):
        coupler.run(steps=1000, record_to=tmp_path / "run.h5", energy=True)
    monkeypatch.undo()
    done = coupler.step_count
    assert 3 < len(pm.History.load(tmp_path / "run.h5").macro_times) - 1 < done < 1000
    assert_identical(coupler.last_history, other.run(steps=done, energy=True))
    # and it continues from the present step
    assert_identical(coupler.run(steps=3), other.run(steps=3))


def test_a_disk_that_is_full_is_an_error_before_the_first_step(tmp_path):
    program = f"""
        import resource
        from pmalpha import models
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))
        coupler = models.four_dof().coupler(0.05, coupling="pm")
        try:
            coupler.run(steps=1000, record_to={str(tmp_path / "run.h5")!r})
        except OSError as error:
            print(coupler.step_count, error)
    """
    done = waits.program(program)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0 ") and "path cannot be written" in done.stdout
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_cut_off_or_another_is_refused(tmp_path):
    path = tmp_path / "run.h5"
    models.four_dof().coupler(0.05, coupling="pm").run(steps=30, record_to=path)
    whole = path.read_bytes()
    for length in np.linspace(8, len(whole) - 1, 30).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="path must lead to .*is damaged or cut off"):
            pm.History.load(path)
    with h5py.File(path, "w") as file:
        file["u"] = np.zeros(3)
    with pytest.raises(ValueError, match="has no header with a format"):
        pm.History.load(path)
    with h5py.File(path, "w") as file:
        file["header"] = np.bytes_(json.dumps({"format": "pmalpha History", "version": 7}))
    with pytest.raises(ValueError, match="is of version 7 of it, not 1"):
        pm.History.load(path)


def test_a_count_beyond_the_rows_is_refused(tmp_path):
    path = tmp_path / "run.h5"
    models.four_dof().coupler(0.05, coupling="pm").run(steps=30, record_to=path)
    with h5py.File(path, "r+") as file:
        file["step_count"][0] = 31
    with pytest.raises(ValueError, match="has 601 rows, 621 were counted"):
        pm.History.load(path)


def test_without_h5py_the_error_names_what_to_install(tmp_path, monkeypatch):
    coupler = models.four_dof().coupler(0.05, coupling="pm")
    coupler.run(steps=1, record_to=tmp_path / "run.h5")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match=r"pip install 'pmalpha\[hdf5\]'"):
        coupler.run(steps=1, record_to=tmp_path / "other.h5")
    with pytest.raises(ImportError, match=r"pip install 'pmalpha\[hdf5\]'"):
        pm.History.load(tmp_path / "run.h5")
    assert coupler.step_count == 1 and not (tmp_path / "other.h5").exists()


def test_the_descriptor_of_the_file_is_released(tmp_path):
    def open_files():
        return len(os.listdir("/dev/fd"))

    coupler = models.four_dof().coupler(0.05, coupling="pm")
    before = open_files()
    for _ in range(3):
        coupler.run(steps=3, record_to=tmp_path / "run.h5", overwrite=True)
        with pytest.raises(OSError):
            coupler.run(steps=3, record_to=tmp_path)
    assert open_files() == before


def test_a_system_without_pwrite_writes_the_same_file(tmp_path, monkeypatch, thresholds):
    monkeypatch.delattr(os, "pwrite")  # as on Windows
    thresholds(FILED_BYTES=1.0)  # every macro step
    ours, other = (models.four_dof().coupler(0.05, coupling="pm") for _ in range(2))
    ours.run(steps=20, record_to=tmp_path / "run.h5")
    assert_identical(pm.History.load(tmp_path / "run.h5"), other.run(steps=20))


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="counts the open files of Linux")
def test_no_file_is_open_or_mapped_when_it_is_renamed(tmp_path, monkeypatch):
    renamed, replace = [], os.replace  # Windows refuses to rename those that are

    def checked(old, new, call=replace):
        links = [os.path.join("/proc/self/fd", number) for number in os.listdir("/proc/self/fd")]
        there = {os.readlink(link) for link in links if os.path.islink(link)}
        mapped = Path("/proc/self/maps").read_text()
        assert str(old) not in there and str(old) not in mapped
        renamed.append(Path(new).name)
        call(old, new)

    monkeypatch.setattr(os, "replace", checked)
    monkeypatch.setattr(os, "rename", partial(checked, call=os.rename))
    monkeypatch.setattr(files, "RENAMES_OPEN", False)
    coupler = models.four_dof().coupler(0.05, coupling="pm")
    coupler.run(steps=3, record_to=tmp_path / "run.h5").save(tmp_path / "run.npz")
    monitor = MonitorFile(
        tmp_path / "live", 3, {"dofs": {"A": [0]}, "period": 1.0, "t0": 0.0, "h": 1.0}
    )
    monitor.close()
    assert renamed == ["run.h5", "run.npz", "live"]


def test_rows_are_counted_as_the_core_counts_them():
    assert history_file.row_count(3, 10, 0, 4) == 29
    assert history_file.row_count(3, 10, 5, 4) == 3  # 3, 5, 10
    assert history_file.row_count(5, 9, 5, 4) == 1


# a descriptor that no function closes any more is closed with its object, which Python tells
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.parametrize("stride", [61, pytest.param(2, marks=pytest.mark.campaign)])
def test_an_interrupt_on_entering_a_function_of_the_package_leaves_a_whole_file(tmp_path, stride):
    # CPython checks for signals when a Python function is entered: one in `stride` entries in turn
    path = tmp_path / "run.h5"
    whole = long_run(5)[0].run(steps=9)
    k, finished = 0, False
    while not finished:
        coupler, _ = long_run(5)
        finished = interrupt_at_entry(
            k, lambda c=coupler: c.run(steps=9, record_to=path, overwrite=True)
        )
        history, done = coupler.last_history, coupler.step_count
        assert [x.name for x in tmp_path.iterdir()] in ([], ["run.h5"]), k
        if history is not None:
            assert len(history.macro_times) - 1 == done, k
            assert_same_bits(history["a"].u, whole["a"].u[: len(history["a"].t)])
            assert_same_bits(history.velocity_jump, whole.velocity_jump[: len(history.multipliers)])
        coupler.step(9 - done)
        assert_same_bits(coupler.state("a").u, whole["a"].u[-1])
        k += stride
    assert k > 40
