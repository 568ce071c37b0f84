"""Files by their descriptors: locks, names that others take, what is left after kills."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time

import campaign_disk
import numpy as np
import pytest
import waits
from agreement import assert_identical
from refusals import refused

import pmalpha as pm
from pmalpha import files, models
from pmalpha.results.ring import MonitorFile
from pmalpha.run import checkpoint

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="forks, limits, unnamed files of Linux")


def made():
    return models.four_dof().coupler(0.05, coupling="pm")


# ---- Ctrl-C --------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="a signal at an instant")
def test_a_call_that_is_not_to_be_interrupted_has_ended_or_never_begins():
    begun, ended, interrupts = [], [], 0

    def call():
        begun.append(None)
        time.sleep(2e-4)
        ended.append(None)

    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        for seconds in np.random.default_rng(5).uniform(2e-5, 6e-4, 200):
            try:
                signal.setitimer(signal.ITIMER_REAL, seconds)
                files.uninterrupted(call)
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            except KeyboardInterrupt:
                interrupts += 1
                assert len(begun) == len(ended)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert interrupts > 20  # some 120 where nothing else has the processor


# ---- two runs with one name ----------------------------------------------------------------------


@pytest.mark.parametrize("how", [{}, {"overwrite": True}, {"append": True}], ids=str)
def test_a_file_that_a_run_writes_is_refused_to_a_second_one_and_free_afterwards(tmp_path, how):
    pytest.importorskip("h5py")
    path, second, whole = tmp_path / "run.h5", made(), made().run(steps=5)
    with pytest.raises(FileExistsError if not how else OSError) as error:
        made().run(
            steps=10**7, record_to=path, progress=lambda *_: second.run(3, record_to=path, **how)
        )
    words = "another run that goes on" if how else "got one that exists"
    assert words in str(error.value) and second.step_count == 0
    made().run(steps=5, record_to=path, overwrite=True)  # although `error` keeps both runs
    assert_identical(pm.History.load(path), whole)


def test_a_name_that_another_run_takes_before_the_first_step_is_refused(tmp_path):
    pytest.importorskip("h5py")
    path, whole = tmp_path / "run.h5", made().run(steps=3)

    def force(t):
        if not path.exists():  # the first evaluation, after the name was found to be free
            made().run(steps=3, record_to=path)
        return [0.0]

    late = pm.Coupler([pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), force=force)], dt=0.1)
    with pytest.raises(FileExistsError, match="cannot be written: File exists"):
        late.run(steps=3, record_to=path)
    assert late.step_count == 0
    assert_identical(pm.History.load(path), whole)


def test_a_refused_file_is_not_locked_while_its_exception_is_kept(tmp_path):
    pytest.importorskip("h5py")
    path, coupler = tmp_path / "run.h5", made()
    coupler.run(steps=3, record_to=path)
    with pytest.raises(ValueError, match="must reach macro step 0") as error:
        made().run(steps=3, record_to=path, append=True)
    coupler.run(steps=3, record_to=path, append=True)
    assert pm.History.load(path).macro_times.size == 7 and error.value is not None


@pytest.mark.parametrize("how", ["replaced", "removed", "truncated"])
def test_a_run_whose_file_is_lost_raises_and_its_last_history_has_its_rows(tmp_path, how):
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"

    def lose(done, total):
        if how == "truncated":
            os.truncate(path, 100)
        else:
            path.unlink(missing_ok=True)
        if how == "replaced":
            path.write_bytes(b"of another program")

    coupler, words = made(), "truncated it" if how == "truncated" else "removed or replaced it"
    with pytest.raises(
        OSError, match=f"record_to cannot be written: another program has .*{words}"
    ):
        coupler.run(steps=10**6, record_to=path, progress=lose)
    history, done = coupler.last_history, coupler.step_count
    assert 0 < done < 10**6
    assert history.macro_times[-1] == pytest.approx(0.05 * done, rel=1e-14)
    if how != "truncated":  # by which the rows before are lost
        assert_identical(history, made().run(steps=done))


def test_locks_keep_other_descriptors_out_and_shared_ones_admit_each_other(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"")

    def opened():
        return files.Held(os.open(path, os.O_RDWR), path)

    first, second, third, fourth = (opened() for _ in range(4))
    assert first.lock(exclusive=False) and second.lock(exclusive=False)
    assert not third.lock(exclusive=True)
    first.close()
    assert not third.lock(exclusive=True)
    second.close()
    assert third.lock(exclusive=True) and not fourth.lock(exclusive=False)
    third.close()
    fourth.close()


# ---- new files -----------------------------------------------------------------------------------


@pytest.fixture(
    params=["as the system has them", "no unnamed files", "no links", "no open renames"]
)
def system(request, monkeypatch):
    """Systems that lack what Linux has."""
    if request.param != "as the system has them":
        monkeypatch.setattr(files, "DESCRIPTORS", "/no/where")
    if request.param == "no links":

        def link(*_, **__):
            raise PermissionError(1, "Operation not permitted")

        monkeypatch.setattr(os, "link", link)
    if request.param == "no open renames":

        def rename(old, new, rename=os.rename):
            if os.path.exists(new):  # as on Windows
                raise FileExistsError(17, "File exists")
            rename(old, new)

        monkeypatch.setattr(files, "RENAMES_OPEN", False)
        monkeypatch.setattr(os, "rename", rename)


def test_a_new_name_is_taken_once_and_an_old_one_replaced_on_any_system(tmp_path, system):
    path = tmp_path / "file"
    with files.writing(path) as first:
        first.write_at(b"first", 0)
        first.take_name(None)
    with pytest.raises(FileExistsError), files.writing(path) as second:
        second.take_name(None)
    assert path.read_bytes() == b"first"
    first.write_at(b"F", 0)  # under its name
    first.close()
    old = files.held(path, "path")
    with files.writing(path) as third:
        third.write_at(b"third", 0)
        third.take_name(old)
    third.close()
    old.close()
    assert path.read_bytes() == b"third" and os.listdir(tmp_path) == ["file"]


def test_a_file_that_is_another_by_now_is_not_replaced(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    old = files.held(path, "path")
    path.unlink()
    path.write_bytes(b"new")
    with pytest.raises(OSError, match="another program has replaced it"), files.writing(path) as x:
        x.take_name(old)
    old.close()
    assert path.read_bytes() == b"new" and os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("mode", [0o600, 0o640])
@pytest.mark.parametrize("name", ["state", "run.npz", "run.h5"])
def test_a_file_has_the_permissions_of_the_one_before(tmp_path, name, mode):
    if name == "run.h5":
        pytest.importorskip("h5py")
    path, coupler = tmp_path / name, made()
    save = coupler.save if name == "state" else coupler.run(steps=1).save
    save(path)
    path.chmod(mode)
    save(path)
    assert path.stat().st_mode & 0o777 == mode


@LINUX
def test_nothing_is_left_of_a_save_that_is_killed(tmp_path):
    program = f"""
        import os, signal
        from pmalpha import files, models
        files.NewFile.replace = lambda file: os.kill(os.getpid(), signal.SIGKILL)
        models.four_dof().coupler(0.05, coupling="pm").save({str(tmp_path / "state")!r})
    """
    assert waits.program(program, survives=False).returncode == -signal.SIGKILL
    assert os.listdir(tmp_path) == []


def test_ctrl_c_while_an_npz_file_is_written_is_a_keyboard_interrupt(tmp_path, monkeypatch):
    path, write, sent = tmp_path / "state", np.lib.format.write_array, []
    coupler = made()
    coupler.save(path)
    before = path.read_bytes()

    def interrupted(*arguments, **options):
        write(*arguments, **options)
        if not sent:
            sent.append(os.kill(os.getpid(), signal.SIGINT))

    monkeypatch.setattr(np.lib.format, "write_array", interrupted)
    coupler.step()
    with pytest.raises(KeyboardInterrupt):
        coupler.save(path)
    assert sent and path.read_bytes() == before and os.listdir(tmp_path) == ["state"]


@pytest.mark.gate
def test_a_history_is_saved_at_the_end_of_the_interpreter_too(tmp_path):
    path = tmp_path / "run.npz"
    program = f"""
        import atexit
        from pmalpha import models
        history = models.four_dof().coupler(0.05, coupling="pm").run(steps=3)
        atexit.register(history.save, {str(path)!r})
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        env={**os.environ, "PYTHONPATH": waits.PATHS},
        capture_output=True,
        text=True,
        timeout=waits.LIMIT,
    )
    assert done.stderr == ""
    assert pm.History.load(path).macro_times.size == 4


def test_a_checkpoint_of_a_stranger_makes_a_save_remove_no_other_files(tmp_path):
    path, backup = tmp_path / "state", tmp_path / "state.backup"
    backup.write_bytes(b"kept")
    checkpoint.write_master(path, ["state.backup"], [0, 1])
    (tmp_path / "state.7.0123abcd.0").write_bytes(b"of an older save")
    checkpoint.write_master(path, ["state.8.0123abcd.0"], [0, 1])
    assert sorted(os.listdir(tmp_path)) == ["state", "state.backup"]


# ---- files that are cut off ----------------------------------------------------------------------


def test_a_mapped_history_whose_file_was_truncated_is_refused(tmp_path, thresholds):
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    read = made().run(steps=50, record_to=path)
    thresholds(READ_BYTES=0)
    mapped, whole = pm.History.load(path), made().run(steps=50)
    assert_identical(mapped, whole)
    os.truncate(path, 5000)
    with pytest.raises(OSError, match="was truncated by another program"):
        mapped["A"]
    assert_identical(read, whole)


@LINUX
@pytest.mark.parametrize("how", ["truncated", "emptied", "replaced"])
def test_a_paced_run_goes_on_whatever_happens_to_its_monitor(tmp_path, how):
    found = campaign_disk.program(campaign_disk.monitor_spoiled, str(tmp_path / "live"), how)
    assert found == "goes on"


def test_a_monitor_is_read_without_rows_whose_writing_has_begun(tmp_path, monkeypatch):
    about = {"dofs": {"A": [0]}, "period": 1.0, "t0": 0.0, "h": 1.0}
    monitor = MonitorFile(tmp_path / "live", 5, about)
    monitor.write(0, np.tile(np.arange(5.0), (7, 1)).T)
    monkeypatch.setattr(files.Held, "write_at", stopped_at(files.Held.write_at, 2))
    with pytest.raises(ZeroDivisionError):
        monitor.write(5, np.full((2, 7), np.inf))  # takes the places of the first two
    last = pm.rig.read_monitor(tmp_path / "live")
    assert last.step.tolist() == [2, 3, 4] and last.due.tolist() == [2.0, 3.0, 4.0]
    monkeypatch.undo()
    monitor.close()


def stopped_at(write, count):
    """The first `count` writes, and an exception at the next one."""
    done = []

    def stopped(*arguments):
        if len(done) == count:
            raise ZeroDivisionError
        done.append(write(*arguments))

    return stopped


def test_a_monitor_that_is_cut_off_or_claims_other_sizes_is_refused(tmp_path):
    path = tmp_path / "live"
    about = {"dofs": {"A": [0]}, "period": 1.0, "t0": 0.0, "h": 1.0}
    MonitorFile(path, 5, about).close()
    whole = path.read_bytes()
    assert pm.rig.read_monitor(path).step.size == 0
    for length in (0, 100, len(whole) - 16, len(whole) - 1):
        path.write_bytes(whole[:length])
        refused(ValueError, lambda: pm.rig.read_monitor(path), "path must be a file of", "live")
    for change in ({"rows": 10**9}, {"rows": -1}, {"rows": "x"}, {"dofs": []}):
        text = json.dumps(json.loads(whole[: 1 << 13]) | change).encode()
        path.write_bytes(text.ljust((1 << 14) - 16) + whole[(1 << 14) - 16 :])
        refused(ValueError, lambda: pm.rig.read_monitor(path), "path must be a file of", "live")


# ---- full disks, power, strangers ----------------------------------------------------------------


@LINUX
@pytest.mark.parametrize("size", [500, 20_000, 300_000])
def test_a_study_on_a_full_disk_ends_with_an_error(tmp_path, size):
    pytest.importorskip("h5py")
    path = str(tmp_path / "study.h5")
    found = campaign_disk.program(campaign_disk.study_on_full, path, size, 20, 1000)
    assert found == "OSError"


@LINUX
def test_a_study_that_was_killed_before_its_first_result_is_replaced(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "study.h5"
    program = f"""
        import os, signal
        import pmalpha as pm
        kill = lambda: os.kill(os.getpid(), signal.SIGKILL)
        pm.Study(kill, steps=1, result=len).run([{{}}], save_to={str(path)!r})
    """
    assert waits.program(program, survives=False).returncode == -signal.SIGKILL
    with h5py.File(path) as file:
        assert file["error"][:].tolist() == [b"not run"]
    campaign_disk.study_of(path, 2, 1)
    with pytest.raises(FileExistsError, match="save_to must lead to a new file"):
        campaign_disk.study_of(path, 2, 1)
    with h5py.File(path) as file:
        assert file["error"][:].tolist() == [b"", b""]


@pytest.mark.gate
@pytest.mark.skipif(not hasattr(os, "pwrite"), reason="a layer over pwrite")
def test_after_a_power_failure_a_file_has_all_rows_that_it_counts(tmp_path):
    pytest.importorskip("h5py")
    found = campaign_disk.power_failure(np.random.default_rng(1), tmp_path)
    assert found == {"whole": 10}


@LINUX
@pytest.mark.parametrize("name", campaign_disk.STRANGE)
def test_small_files_take_no_large_memory_and_pipes_are_not_waited_for(tmp_path, name):
    pytest.importorskip("h5py")
    path = tmp_path / ("run.npz" if name == "npz" else "run.h5" if "HDF5" in name else "run")
    found = campaign_disk.program(campaign_disk.read_strange, str(path), name)
    assert found.startswith("refused") or (name, found) == ("monitor", "read")


def test_a_description_of_a_monitor_with_brackets_in_brackets_is_refused(tmp_path):
    (tmp_path / "live").write_bytes(b"[" * 4096)
    with pytest.raises(ValueError, match=r"path must be a file of Coupler.monitor.*brackets"):
        pm.rig.read_monitor(tmp_path / "live")
