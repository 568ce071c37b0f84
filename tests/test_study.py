"""Many cases of one problem on the executors that people have."""

import os
import pickle
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import studied
import waits

import pmalpha as pm

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def study():
    return pm.Study(studied.make, steps=5, result=studied.peaks)


def alone(count):
    """The cases one after another, each in a new coupler."""
    found = []
    for case in studied.cases(count):
        coupler = studied.make()
        coupler.reset(**case)
        found.append(studied.peaks(coupler.run(steps=5)))
    return found


def check(cases, count):
    for case, expected in zip(cases, alone(count), strict=True):
        assert case.error is None and case.traceback == ""
        np.testing.assert_array_equal(case.value["u"], expected["u"])
        assert case.value["last"] == expected["last"]
    assert len({case.value["last"] for case in cases}) == count  # each its own case


# ---- the engines --------------------------------------------------------------------------------


def test_the_built_in_map_makes_one_coupler(study):
    studied.made.clear()
    found = study.run(studied.cases(4))
    assert len(studied.made) == 1
    check(found, 4)


def test_threads_have_a_coupler_each(study):
    studied.made.clear()
    barrier = threading.Barrier(2)
    with ThreadPoolExecutor(2, initializer=barrier.wait) as pool:
        found = study.run(studied.cases(6), map=pool.map)
    threads = {thread for _, thread in studied.made}
    assert len(studied.made) == len(threads) <= 2
    check(found, 6)


def processes_have_a_coupler_each(study, start):
    with ProcessPoolExecutor(2, mp_context=get_context(start)) as pool:
        found = study.run(studied.cases(6), map=pool.map)
    check(found, 6)
    assert all(case.value["made"] == 1 for case in found)
    assert os.getpid() not in {case.value["process"] for case in found}


@pytest.mark.gate
def test_new_processes_have_a_coupler_each(study, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", waits.PATHS)
    processes_have_a_coupler_each(study, "spawn")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_processes_have_a_coupler_each():
    done = waits.program(
        """
        import pmalpha as pm, studied, test_study
        study = pm.Study(studied.make, steps=5, result=studied.peaks)
        test_study.processes_have_a_coupler_each(study, "fork")
        """
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.gate
def test_joblib(study):
    joblib = pytest.importorskip("joblib")

    def by_joblib(function, cases):
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            run = joblib.Parallel(n_jobs=2, return_as="generator")
            return run(joblib.delayed(function)(case) for case in cases)

    check(study.run(studied.cases(5), map=by_joblib), 5)


@pytest.mark.gate
@pytest.mark.filterwarnings("ignore")  # of dask and of what it starts
def test_dask(study):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        found = study.run(studied.cases(5), map=lambda f, x: client.gather(client.map(f, x)))
    check(found, 5)


@pytest.mark.gate
def test_mpi4py():
    pytest.importorskip("mpi4py")
    mpiexec = Path(sys.executable).with_name("mpiexec")
    if not mpiexec.exists() and shutil.which("mpiexec") is None:
        pytest.skip("no mpiexec")
    program = [mpiexec if mpiexec.exists() else "mpiexec", "-n", "3", sys.executable]
    program += ["-m", "mpi4py.futures", HERE / "studied.py", "mpi4py"]
    environment = {
        **os.environ,
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    done = subprocess.run(
        program, capture_output=True, text=True, timeout=waits.LIMIT, env=environment
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    for (u, last, _), expected in zip(rows, alone(6), strict=True):
        assert (u, last) == (expected["u"].tobytes().hex(), expected["last"].hex())


# ---- what can go wrong --------------------------------------------------------------------------


def test_a_failed_case_is_a_result_and_the_others_go_on(study):
    good = studied.cases(3)
    bad = [{"force": {"b": studied.fails}}, {"u": {}}, 3, {"v0": {"c": [1.0]}}]
    found = study.run([good[0], *bad, *good[1:]])
    check([found[0], *found[-2:]], 3)
    kinds = [type(case.error) for case in found[1:-2]]
    assert kinds == [pm.PmalphaError, TypeError, TypeError, ValueError]
    assert "Unpicklable: one and two" in str(found[1].error)  # which cannot be pickled itself
    assert "studied.py" in found[1].traceback and found[1].value is None
    assert "unexpected keyword argument 'u'" in str(found[2].error)
    assert "a case must be a dict of arguments of reset, got 3" in str(found[3].error)
    assert all(type(pickle.loads(pickle.dumps(case)).error) is type(case.error) for case in found)


@pytest.mark.parametrize(
    ("path", "error", "words"),
    [
        (3, TypeError, "save_to must be a str or a path, got 3"),
        ("a\0b", ValueError, "save_to must have no null character"),
        (".", OSError, "save_to must lead to a new file"),
        ("no/where", FileNotFoundError, "save_to must lead to a new file"),
        (256 * "x", OSError, "save_to must lead to a new file"),
    ],
)
def test_a_path_that_no_file_can_have_is_named(study, path, error, words, tmp_path, monkeypatch):
    pytest.importorskip("h5py")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=words):
        study.run([{}], save_to=path)
    assert not list(tmp_path.iterdir())


def test_an_instability_keeps_its_attributes():
    stiff = pm.Subdomain([1.0], [4.0], scheme=pm.CentralDifference(), name="stiff", v0=[1.0])
    study = pm.Study(lambda: pm.Coupler([stiff], dt=50.0), steps=1000)
    with pytest.warns(pm.StabilityWarning):
        case = study({})
    again = pickle.loads(pickle.dumps(case.error))
    assert isinstance(again, pm.InstabilityError) and again.subdomain == "stiff"


def test_a_new_study_replaces_the_coupler_of_the_old_one(study):
    studied.made.clear()
    other = pm.Study(studied.make, steps=2)
    again = pickle.loads(pickle.dumps(study))
    for each in (study, again, other, other, study):
        assert each({}).error is None
    assert len(studied.made) in (2, 3)  # study may have been the last one before
    assert other({}).value["a"].u.shape == (3, 2)  # the History, without `result`


def test_cases_that_are_run_together_are_bitwise_the_single_ones(study):
    together = pm.Study(studied.make, steps=5, result=studied.peaks, together=4)
    cases = studied.cases(7)
    cases.insert(2, {"force": {"b": studied.fails}})  # fails while it runs
    cases.insert(6, {"u": {}})  # ... and before
    reports = []
    found = together.run(cases, progress=lambda *done: reports.append(done))
    assert reports == [(4, 9), (8, 9), (9, 9)]
    assert [case.error is None for case in found] == [k not in (2, 6) for k in range(9)]
    for case, expected in zip((c for c in found if c.error is None), alone(7), strict=True):
        np.testing.assert_array_equal(case.value["u"], expected["u"])


def test_progress_is_reported():
    reports = []
    study = pm.Study(studied.make, 0.5, record={})
    study.run(studied.cases(3), progress=lambda *done: reports.append(done))
    assert reports == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: pm.Study(3), "make_coupler must be a callable, got 3"),
        (lambda: pm.Study(studied.make, 1.0, result=3), "result must be a callable, got 3"),
        (lambda: pm.Study(studied.make, 1.0).run([], map=3), "map must be a callable"),
    ],
)
def test_arguments_of_the_wrong_kind_are_refused(make, message):
    with pytest.raises(TypeError, match=message):
        make()


def test_a_file_of_one_run_is_refused():
    with pytest.raises(ValueError, match="record_to is of one run"):
        pm.Study(studied.make, 1.0, record_to="h.h5")


# ---- the file -----------------------------------------------------------------------------------


def test_results_are_in_the_file_as_they_arrive(study, tmp_path):
    h5py = pytest.importorskip("h5py")
    path, seen = tmp_path / "study.h5", []

    def look(done, total):  # another program, while the file is written
        program = (
            "import h5py, numpy as np\n"
            f"with h5py.File({str(path)!r}, 'r') as file:\n"
            "    print((file['error'][:].tolist(), np.isfinite(file['u'][:, 0]).tolist()))"
        )
        if done in (2, 3):
            seen.append((done, *eval(waits.program(program).stdout)))

    cases = studied.cases(3)
    cases.insert(1, {"u0": {"a": [np.nan, 0.0]}})
    found = study.run(cases, save_to=path, progress=look)
    assert [case.value for case in found] == [None] * 4
    assert "u0" in str(found[1].error)
    assert len(seen) == 2
    for done, texts, finite in seen:
        assert texts[done:] == [b"not run"] * (4 - done)
        assert [text == b"" for text in texts] == finite == [k < done and k != 1 for k in range(4)]
    with h5py.File(path, "r") as file:
        for k, expected in zip((0, 2, 3), alone(3)):
            np.testing.assert_array_equal(file["u"][k], expected["u"])
            assert file["last"][k] == expected["last"]
        assert file["error"][1] == f"ValueError: {found[1].error}".encode()
    with pytest.raises(OSError, match="exists"):
        study.run(cases, save_to=path)


@pytest.mark.parametrize(
    "result, message",
    [
        (None, "result must return a dict of numbers and arrays, got <History"),
        (lambda h: {"a/b": 1.0}, r"names that a file can have, got \['a/b'\]"),
        (lambda h: {"a": "text"}, r"result\['a'\] must hold real numbers"),
    ],
)
def test_a_result_that_no_file_can_have_is_a_failed_case(result, message, tmp_path):
    pytest.importorskip("h5py")
    study = pm.Study(studied.make, steps=1, result=result)
    (case,) = study.run([{}], save_to=tmp_path / "study.h5")
    assert isinstance(case.error, (TypeError, ValueError))
    with pytest.raises((TypeError, ValueError), match=message):
        raise case.error


def test_a_result_of_another_shape_is_a_failed_case(tmp_path):
    h5py = pytest.importorskip("h5py")
    shapes = iter([2, 3, 2])
    study = pm.Study(studied.make, steps=1, result=lambda h: {"x": np.ones(next(shapes))})
    found = study.run([{}] * 3, save_to=tmp_path / "study.h5")
    assert [type(case.error) for case in found] == [type(None), ValueError, type(None)]
    with h5py.File(tmp_path / "study.h5", "r") as file:
        assert file["x"].shape == (3, 2) and file["error"][1].startswith(b"ValueError: result must")


@pytest.mark.parametrize("how", ["truncated", "removed", "replaced"])
def test_a_file_that_another_program_spoils_ends_the_study(study, how, tmp_path):
    pytest.importorskip("h5py")
    path = tmp_path / "study.h5"

    def spoil(done, total):
        if done == 2 and how == "truncated":
            os.truncate(path, path.stat().st_size - 1)
        elif done == 2:
            path.unlink()
            if how == "replaced":
                path.write_bytes(b"")

    reason = "truncated" if how == "truncated" else "removed or replaced"
    with pytest.raises(OSError, match=f"save_to cannot be written: another program has {reason}"):
        study.run(studied.cases(4), save_to=path, progress=spoil)


def test_after_a_kill_the_file_has_what_had_arrived(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "study.h5"
    program = (
        "import os, signal, studied, pmalpha as pm\n"
        "study = pm.Study(studied.make, steps=5, result=studied.peaks)\n"
        "kill = lambda done, total: done < 3 or os.kill(os.getpid(), signal.SIGKILL)\n"
        f"study.run(studied.cases(5), save_to={str(path)!r}, progress=kill)\n"
    )
    assert waits.program(program, survives=False).returncode == -9
    with h5py.File(path, "r") as file:
        assert file["error"][:].tolist() == [b""] * 3 + [b"not run"] * 2
        for k, expected in enumerate(alone(3)):
            np.testing.assert_array_equal(file["u"][k], expected["u"])
