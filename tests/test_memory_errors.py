"""What does not fit into the free memory is refused with the figures."""

import subprocess
import sys

import numpy as np
import pytest
import scipy.sparse as sp
from refusals import EXPLICIT, coupled, plate, refused, single, subdomain

import pmalpha as pm
from pmalpha import memory


@pytest.fixture
def megabyte(monkeypatch, thresholds):
    """A machine with one MB of free memory, where small requests are checked too."""
    monkeypatch.setattr(memory, "available", lambda: 1_000_000)
    thresholds(ALLOCATION=100_000)


def out_of_memory(call, *words):
    message = refused(MemoryError, call, "1 MB are available", "needs about", *words)
    return message.split("needs about ")[1].split(",")[0]


def test_a_history_that_does_not_fit_is_refused_with_the_figures(megabyte):
    coupler = coupled()
    # u, v, w of 2 and of 3 x 1 numbers, multipliers and jumps of 3 x 2 + 1: 22 per macro step
    needed = out_of_memory(lambda: coupler.run(steps=10_000), "History", "record=", "every=")
    assert needed == "1.76 MB"
    assert coupler.step_count == 0
    assert coupler.run(steps=10_000, every=100)["a"].t.size == 101
    assert coupler.run(steps=10_000, record={"a": [0]}, every=10)["a"].t.size == 1001


def test_a_sparse_factor_that_does_not_fit_is_refused_with_the_figures(megabyte):
    K = plate(40, fixed=True)
    needed = out_of_memory(
        lambda: pm.Coupler([subdomain(np.ones(1600), K, name="p")], dt=0.1), "'p'"
    )
    assert needed.endswith("MB")


def test_a_dense_factor_that_does_not_fit_is_refused_with_the_figures(megabyte):
    K = plate(20, fixed=True).toarray()  # 1.28 MB, and the factor as much again
    out_of_memory(
        lambda: pm.Coupler([subdomain(np.ones(400), K, name="p")], dt=0.1), "'p'", "400 dofs"
    )


def test_an_interface_block_that_does_not_fit_is_refused_with_the_figures(megabyte):
    a, b = subdomain(np.ones(400), plate(20, fixed=True), name="a"), single(400, scheme=EXPLICIT)
    tie = pm.tie(a, np.arange(400), b, np.arange(400))
    needed = out_of_memory(
        lambda: pm.Coupler([a, b], tie, dt=0.1, coupling="pm"), "interface", "400 constraints"
    )
    assert needed.endswith("MB")


def test_constraints_that_all_share_a_dof_are_refused_before_they_fill_the_memory(megabyte):
    # L L^T and H are full: 8 MB for a thousand rows, 80 GB for a hundred thousand
    floor, columns = single(scheme=EXPLICIT), single(1000, scheme=EXPLICIT)
    rigid = pm.Constraint({floor: np.ones((1000, 1)), columns: -sp.eye_array(1000)})
    out_of_memory(
        lambda: pm.Coupler([floor, columns], rigid, dt=0.1, coupling="pm"), "1000 constraints"
    )


def test_where_the_free_memory_is_unknown_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: None)
    coupled().run(steps=10)


def test_the_free_memory_is_a_plausible_number_here():
    # /proc/meminfo or sysconf; above what this process has, below a petabyte
    free = memory.available()
    assert free is None or 1e6 < free < 1e15


# MB of address space that are left, and when the limit is set, before
# the coupler is made, or after. OpenBLAS would try for ever to have a buffer of 32 MB.
LIMITED = """
import resource, sys
import numpy as np
import pmalpha as pm

K = np.diag(2.0 * np.ones(300)) - np.diag(np.ones(299), 1) - np.diag(np.ones(299), -1)

def limit(left):
    used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, 2 * (used + left * 1_000_000,))

def ended(left, early):
    if early:
        limit(left)
    s = pm.Subdomain(np.ones(300), K, scheme=pm.Newmark(), name="s")
    coupler = pm.Coupler([s], dt=0.1)
    if not early:
        limit(left)
    coupler.run(steps=3)

try:
    ended(int(sys.argv[1]), sys.argv[2] == "early")
    print("done")
except MemoryError as error:
    print(error)
"""


@pytest.mark.gate
@pytest.mark.skipif(sys.platform != "linux", reason="limits address space")
@pytest.mark.parametrize(
    "left, when, word",
    [
        (60, "early", "SciPy with its BLAS needs about"),
        (120, "early", "SciPy with its BLAS needs about"),
        (2000, "early", "done"),
        (8, "late", "BLAS with threads=1 needs about"),
        (2000, "late", "done"),
    ],
)
def test_a_limit_of_address_space_ends_a_run_and_does_not_hang_it(left, when, word):
    """60 and 120 MB hung in the import of SciPy, and in the first large product."""
    words = [sys.executable, "-c", LIMITED, str(left), when]
    end = subprocess.run(words, capture_output=True, text=True, timeout=110)
    assert word in end.stdout, end.stdout + end.stderr[-2000:]
