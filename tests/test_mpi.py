"""Couplers in several processes, by mpiexec; what each rank does is in on_ranks.py."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from functools import cache
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
        # MPICH: ranks that wait leave the processors to those that compute
        "MPIR_CVAR_ENABLE_HEAVY_YIELD": "1",
    }
    words = [mpiexec(), "-n", ranks, sys.executable, HERE / "on_ranks.py", *arguments]
    return [str(word) for word in words], environment


def printed(ranks, *calls, **variables):
    """The lines that the ranks have printed in each call, and the error of one that failed.

    The variables are of the environment.
    """
    arguments = [word for call in calls for word in ("+", *call)][1:]
    words, environment = command(ranks, *arguments)
    environment |= variables
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=LIMIT)
    found = [text.split("\n")[:-1] for text in re.split(r"end of \w+\n", done.stdout)]
    found, rest = found[:-1], found[-1]
    if done.returncode == 0:
        assert len(found) == len(calls) and not rest, done.stdout
        return found, None
    told = re.findall(rf"^{calls[len(found)][0]} on rank .*", done.stderr, re.M)
    return found, "\n".join([*told, done.stdout + done.stderr])


def run(ranks, *call, **variables):
    """The lines that the ranks have printed in this call."""
    found, error = printed(ranks, call, **variables)
    if error:
        pytest.fail(error, pytrace=False)
    return found[0]


# The calls of each number of ranks, which are started once for all of them: a start takes longer
# than most of the calls.
OTHERS = ["interpolated", "explicit", "static"]
TOGETHER = {
    1: ["bitwise 0 5", "iterated {} mean"],
    2: [
        *OTHERS, "fed", "bitwise 10 5", "by_callable 50 6", "iterated {} pm gc macro mean",
        "chosen {}", "failures pm gc macro mean", "memory", "files {}", "checkpoints {}",
    ],
    3: [
        *OTHERS, "bitwise 20 5", "histories {} 4", "iterated {} gc macro", "chosen {}",
        "arguments", "failures pm", "checkpoints {}",
    ],
    4: ["bitwise 30 5", "iterated {} gc"],
}  # fmt: skip


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    """What the ranks have printed in a call, by the number of ranks and the name of the call."""

    @cache
    def of_all(ranks):
        calls = [
            [tmp_path_factory.mktemp("ranks") if word == "{}" else word for word in call.split()]
            for call in TOGETHER[ranks]
        ]
        outcomes = []
        while len(outcomes) < len(calls):  # again behind one that failed
            found, error = printed(ranks, *calls[len(outcomes) :])
            outcomes += [*found, error] if error else found
        return {call[0]: outcome for call, outcome in zip(calls, outcomes)}

    def of_one(ranks, name):
        outcome = of_all(ranks)[name]
        if isinstance(outcome, str):
            pytest.fail(outcome, pytrace=False)
        return outcome

    return of_one


@needs_mpi
@pytest.mark.parametrize("ranks", [1, 2, 3, 4])
def test_any_number_of_ranks_is_bitwise_one_process(lines, ranks):
    found = lines(ranks, "bitwise")
    assert len(found) == ranks and all(re.fullmatch(r"\d of 5 .*", line) for line in found)


@needs_mpi
def test_any_sequence_of_calls_is_bitwise_one_process(lines):
    found = lines(3, "histories")
    assert len(set(found)) == 1 and re.fullmatch(r"60 calls, [1-9]\d* stops, \d+ files", found[0])


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


# Ties by interpolation, explicit subdomains, static equilibrium, the warning of drift, loads that
# are fed; internal forces; substeps that a tolerance chooses; a wrong argument, too little memory
# or another failure on one rank (8 kinds, on both ranks in 4 couplings, or on one of three in one);
# files of each rank; states that another number of ranks has saved.
EXPECTED = [
    *((ranks, name, name) for ranks in (2, 3) for name in [*OTHERS, "chosen", "checkpoints"]),
    *((ranks, "iterated", "iterated") for ranks in (1, 2, 3, 4)),
    *((2, name, name) for name in ("fed", "memory", "files")),
    (3, "arguments", "arguments"),
    *((2, "failures", "64 failures"), (3, "failures", "8 failures")),
]


@needs_mpi
@pytest.mark.parametrize("ranks, name, expected", EXPECTED)
def test_what_the_ranks_do_together_ends_on_all_as_in_one_process(lines, ranks, name, expected):
    if name in ("chosen", "files"):
        pytest.importorskip("h5py")
    assert lines(ranks, name) == [expected] * ranks


@needs_mpi
@pytest.mark.campaign
@pytest.mark.parametrize("ranks", [1, 3, 4])
def test_internal_forces_of_all_couplings_are_iterated_by_any_number_of_ranks(ranks, tmp_path):
    couplings = "pm", "gc", "macro", "mean"
    assert run(ranks, "iterated", tmp_path, *couplings) == ["iterated"] * ranks


@needs_mpi
@pytest.mark.skipif(sys.platform != "linux", reason="replaces malloc by the linker of Linux")
def test_an_allocation_that_fails_on_one_rank_raises_on_all(tmp_path):
    found = run(2, "allocations", tmp_path, 23, **campaign_memory.preloaded(tmp_path))
    assert found == ["allocations"] * 2


@needs_mpi
def test_the_callable_exchange_is_bitwise_too(lines):
    assert len(lines(2, "by_callable")) == 2


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
