"""What holds for all tests: Ctrl-C is possible, a build is present; libraries that read meshes."""

import gc
import signal
import sys
import time

import kernels
import pytest


def pytest_configure(config):
    # a script that starts the tests by `&` ignores it, which all processes of tests would inherit
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        import pmalpha  # noqa: F401
    except ImportError as error:  # not in a traceback for each file
        pytest.exit(str(error), returncode=pytest.ExitCode.USAGE_ERROR)
    # Records are sampled more finely than the steps on purpose; test_sampled.py makes it an error
    # again. In pyproject.toml pytest would import the package.
    config.addinivalue_line("filterwarnings", "ignore:steps skip:pmalpha.AccuracyWarning")


def pytest_report_header():
    return kernels.header()


def pytest_ignore_collect(collection_path, config):
    """Where the tests of the gate are left out, modules of these alone are not imported.

    Some start programs when they are.
    """
    if collection_path.suffix == ".py" and "not gate" in config.option.markexpr:
        return "\npytestmark = pytest.mark.gate\n" in collection_path.read_text("utf-8") or None
    return None


def pytest_collection_finish(session):
    # the tests stay to the end: without this each collection of garbage looks through all of them
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def as_many_threads_as_asked_for(monkeypatch):
    """Three and four threads are tested on machines with fewer processors too."""
    schedule = sys.modules.get("pmalpha.setup.schedule")
    if schedule is not None:  # else a test of a package of its own
        monkeypatch.setattr(schedule, "useful_threads", lambda threads: threads)


# Sizes at which the program changes its way, by a name for tests.
THRESHOLDS = {
    "ABSURD": "pmalpha.setup.interface.ABSURD",
    "ADVANTAGE": "pmalpha.gradients.gradient.ADVANTAGE",
    "AHEAD": "pmalpha.run.advance.AHEAD",
    "ALLOCATION": "pmalpha.memory.SMALL",
    "CACHE": "pmalpha.problem.matrices.CACHE",
    "FACTOR_ENTRIES": "pmalpha.setup.factors.MOST",
    "FACTOR_SHARE": "pmalpha.setup.factors.SHARE",
    "FEW_DENSE": "pmalpha.setup.factors.FEW_DENSE",
    "FILED_BYTES": "pmalpha.results.recording.FILED_BYTES",
    "LONG": "pmalpha.setup.interface.LONG",
    "MONITOR_INTERVAL": "pmalpha.results.ring.INTERVAL",
    "MOST_FILES": "pmalpha.export.MOST_FILES",
    "MOST_STEPS": "pmalpha.run.tolerance.MOST",
    "NOTABLE_FACTORIZATION": "pmalpha.setup.judging.NOTABLE_FACTORIZATION",
    "NUMBERS": "pmalpha.structures.elasticity.NUMBERS",
    "PIECE": "pmalpha.run.estimate.PIECE",
    "POINTS": "pmalpha.structures.nonlinear.POINTS",
    "PROGRESS_INTERVAL": "pmalpha.run.progress.INTERVAL",
    "READ_BYTES": "pmalpha.results.history_file.READ_BYTES",
    "RESPONSE_SHARE": "pmalpha.setup.interface.SHARE",
    "SHARES": "pmalpha.frozen.model.SHARES",
    "SMALLEST": "pmalpha.setup.equilibrium.SMALLEST",
    "STORED": "pmalpha.setup.interface.STORED",
    "SYNC_SECONDS": "pmalpha.results.array_file.SYNC_SECONDS",
    "WIDE": "pmalpha.setup.factors.WIDE",
}


@pytest.fixture
def thresholds(monkeypatch):
    """A function that gives sizes of `THRESHOLDS` other values for a test."""

    def change(**values):
        for name, value in values.items():
            monkeypatch.setattr(THRESHOLDS[name], value)

    return change


@pytest.fixture(params=["meshlane", "meshio"])
def mesh_library(request, monkeypatch):
    """One of the libraries that from_mesh may read files by, and it does."""
    library = pytest.importorskip(request.param)
    if request.param == "meshio":
        monkeypatch.setitem(sys.modules, "meshlane", None)
    return library


@pytest.fixture
def interrupt():
    """A function that raises KeyboardInterrupt after a time in seconds, as Ctrl-C does; 0: never.

    What has arrived before is raised by its call, not behind the caller: to sleep takes the GIL
    again, upon which Python looks whether a signal is pending.
    """

    def stop(number, frame):
        raise KeyboardInterrupt

    def after(seconds):
        signal.setitimer(signal.ITIMER_REAL, seconds)
        time.sleep(0)

    before = signal.signal(signal.SIGALRM, stop)
    yield after
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)
