"""What holds for all tests: Ctrl-C is possible; and the libraries that read meshes."""

import signal
import sys

import pytest


def pytest_configure(config):
    # a script that starts the tests by `&` ignores it, which all processes of tests would inherit
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(params=["meshlane", "meshio"])
def mesh_library(request, monkeypatch):
    """One of the libraries that from_mesh may read files by, and it does."""
    library = pytest.importorskip(request.param)
    if request.param == "meshio":
        monkeypatch.setitem(sys.modules, "meshlane", None)
    return library
