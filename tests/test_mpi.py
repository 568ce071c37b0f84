"""Couplers in several processes, by mpiexec; what each rank does is in on_ranks.py."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import campaign_memory
import numpy as np
import pytest
import waits

import pmalpha as pm

pytestmark = pytest.mark.gate

HERE = Path(__file__).parent
LIMIT = waits.LIMIT


def mpiexec():
    """The one beside this Python, of a wheel, or that of the system."""
    own = Path(sys.executable).with_name("mpiexec")
    return str(own) if own.exists() else shutil.which("mpiexec")


needs_mpi = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None or mpiexec() is None,
    reason="needs mpi4py and mpiexec: pip install mpi4py mpich",
)


def command(ranks, *arguments):
    """Program and environment of a call of on_ranks.py, on as many ranks as are wanted."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")]),
        # Open MPI: more ranks than processors, and as root in a container
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    words = [mpiexec(), "-n", ranks, sys.executable, HERE / "on_ranks.py", *arguments]
    return [str(word) for word in words], environment


def run(ranks, *arguments, **variables):
    """The lines that the ranks have printed, with these variables of the environment."""
    words, environment = command(ranks, *arguments)
    environment |= variables
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=LIMIT)
    if done.returncode != 0:
        told = re.findall(rf"^(?:{arguments[0].replace(',', '|')}) on rank .*", done.stderr, re.M)
        pytest.fail("\n".join([*told, done.stdout + done.stderr]), pytrace=False)
    return done.stdout.split("\n")[:-1]


@needs_mpi
@pytest.mark.parametrize("ranks, first", [(1, 0), (2, 10), (3, 20), (4, 30)])
def test_any_number_of_ranks_is_bitwise_one_process(ranks, first):
    lines = run(ranks, "bitwise", first, 5)
    assert len(lines) == ranks and all(re.fullmatch(r"\d of 5 .*", line) for line in lines)


@needs_mpi
def test_any_sequence_of_calls_is_bitwise_one_process(tmp_path):
    lines = run(3, "histories", tmp_path)
    assert len(set(lines)) == 1 and re.fullmatch(r"60 calls, [1-9]\d* stops, \d+ files", lines[0])


@needs_mpi
def test_the_bridge_of_the_page_runs_on_two_ranks(tmp_path):
    pytest.importorskip("h5py")
    page = (HERE.parent / "docs" / "many.md").read_text()
    code = re.search(r"```python\n(# bridge\.py.*?)```", page, re.DOTALL)[1]
    (tmp_path / "bridge.py").write_text(code)
    words, environment = command(2)
    words[-1:] = ["-m", "mpi4py", "bridge.py"]
    done = subprocess.run(
        words, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=LIMIT
    )
    assert done.returncode == 0, done.stdout + done.stderr
    # the lines of two ranks may come in pieces
    assert done.stdout.count("(1001, 10)") == done.stdout.count("True") == 2, done.stdout
    whole = pm.History.load(tmp_path / "bridge.h5")
    assert whole["span 1"].u.shape == (1001, 10) and whole.multipliers.any()


OTHERS = "interpolated,explicit,static,drifting"


@needs_mpi
@pytest.mark.parametrize("ranks, names", [(2, OTHERS + ",fed"), (3, OTHERS)])
def test_other_ties_and_loads_static_equilibrium_and_the_warning_of_drift_too(ranks, names):
    assert sorted(run(ranks, names)) == sorted(names.split(",") * ranks)


@needs_mpi
@pytest.mark.parametrize(
    "ranks, couplings",
    [
        (1, ("macro", "mean")),
        (2, ("pm", "gc", "macro", "mean")),
        (3, ("pm", "gc", "macro", "mean")),
        (4, ("pm", "gc")),
    ],
)
def test_internal_forces_are_iterated_by_all_ranks(ranks, couplings, tmp_path):
    assert run(ranks, "iterated", tmp_path, *couplings) == ["iterated"] * ranks


@needs_mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_the_substeps_that_a_tolerance_chooses_are_those_of_one_process(ranks, tmp_path):
    pytest.importorskip("h5py")
    assert run(ranks, "chosen", tmp_path) == ["chosen"] * ranks


@needs_mpi
def test_a_wrong_argument_on_one_rank_raises_on_all():
    assert run(3, "arguments") == ["arguments"] * 3


@needs_mpi
@pytest.mark.parametrize(
    "ranks, couplings", [(2, ["pm", "gc", "tied", "macro", "mean"]), (3, ["pm"])]
)
def test_a_failure_on_any_rank_ends_the_run_on_all_at_the_same_step(ranks, couplings):
    # 8 kinds of failure, each on both ranks, or on one of three
    count = 8 * (2 if ranks == 2 else 1) * len(couplings)
    assert run(ranks, "failures", *couplings) == [f"{count} failures"] * ranks


@needs_mpi
def test_too_little_memory_on_one_rank_raises_on_all():
    assert run(2, "memory") == ["memory"] * 2


@needs_mpi
@pytest.mark.skipif(sys.platform != "linux", reason="replaces malloc by the linker of Linux")
def test_an_allocation_that_fails_on_one_rank_raises_on_all(tmp_path):
    found = run(2, "allocations", tmp_path, 23, **campaign_memory.preloaded(tmp_path))
    assert found == ["allocations"] * 2


@needs_mpi
def test_ranks_save_and_load_their_own_files(tmp_path):
    pytest.importorskip("h5py")
    assert run(2, "files", tmp_path) == ["files"] * 2


@needs_mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_a_state_is_loaded_by_another_number_of_ranks(ranks, tmp_path):
    assert run(ranks, "checkpoints", tmp_path) == ["checkpoints"] * ranks


@needs_mpi
def test_the_callable_exchange_is_bitwise_too():
    lines = run(2, "by_callable", 50, 6)
    assert len(lines) == 2


@needs_mpi
def test_after_a_kill_of_a_rank_the_files_can_be_read(tmp_path):
    pytest.importorskip("h5py")
    words, environment = command(2, "killed", tmp_path)
    done = subprocess.run(words, env=environment, capture_output=True, timeout=LIMIT)
    assert done.returncode != 0 and b"Traceback" not in done.stderr, done.stderr
    for rank in range(2):
        history = pm.History.load(tmp_path / f"run.h5.{rank}")
        assert history.macro_times.size > 1
        assert np.all(np.isfinite(history[f"r{rank}"].u))
    whole = pm.History.load(tmp_path / "run.h5")
    assert whole["r0"].t.size == whole["r1"].t.size == whole.macro_times.size


@needs_mpi
@pytest.mark.parametrize("where", ["rank", "master"])
def test_after_a_kill_in_save_the_state_saved_before_is_loaded(where, tmp_path):
    words, environment = command(2, "killed_in_save", tmp_path, where)
    done = subprocess.run(words, env=environment, capture_output=True, timeout=LIMIT)
    assert done.returncode != 0 and b"Traceback" not in done.stderr, done.stderr
    assert run(1, "left", tmp_path) == ["left"]


@needs_mpi
def test_the_benchmark_runs_and_writes_the_columns_of_its_committed_results(tmp_path):
    benchmarks = HERE.parent / "benchmarks"
    words = [sys.executable, benchmarks / "ranks.py", "--quick", "--results", tmp_path]
    environment = command(1)[1]
    subprocess.run(words, env=environment, check=True, capture_output=True, timeout=LIMIT)
    files = (x / "ranks.csv" for x in (tmp_path, benchmarks / "results"))
    written, committed = (file.read_text().partition("\n")[0] for file in files)
    assert written == committed


def test_a_communicator_is_one_of_mpi4py():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="a")
    with pytest.raises((TypeError, ImportError), match="mpi4py"):
        pm.Coupler([a], dt=0.1, comm="world")
