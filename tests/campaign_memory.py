"""Every allocation of the extension fails once, in the building, running and keeping of couplers.

Each failure is a MemoryError or passes without effect; what was there before the call is as it was,
not busy, and continues bitwise identically. A crash ends the process, with the number of the
allocation printed before.
"""

import ctypes
import os
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import pmalpha as pm
from pmalpha import _core

HERE = Path(__file__).parent


def made(kind):
    """A coupler of a small problem of this kind."""
    if kind in ("explicit", "tree"):
        return of_meshes(explicit=kind == "explicit")
    if kind == "ranks":
        return of_ranks()
    return small(kind)


def of_meshes(*, explicit):
    """Sparse subdomains: by two threads."""
    if explicit:
        plate = pm.structures.plate(60, 11, 1.0, E=100.0, nu=0.3, rho=1.0, mass="lumped")
        scheme = pm.CentralDifference()
    else:
        plate = pm.structures.solid(6, 6, 6, 1.0, E=100.0, nu=0.3, rho=1.0, mass="lumped")
        scheme = pm.GeneralizedAlpha(0.8)
    u0 = 1e-3 * np.cos(np.arange(plate.n))
    mesh = plate.subdomain(scheme=scheme, substeps=8 if explicit else 1, u0=u0, name="a")
    b = pm.Subdomain(np.ones(2), [3.0, 3.0], scheme=scheme, u0=u0[:2], name="b")
    return pm.Coupler(
        [mesh, b],
        pm.tie(mesh, [0], b, [0]),
        dt=0.04,
        coupling="macro" if explicit else "gc",
        threads=2,
    )


def of_ranks():
    """The exchange of several processes, of one here."""
    from mpi4py import MPI

    whole = small("linear")
    ties = [pm.tie("a", [2], "b", [0]), pm.tie("b", [1], "c", [0])]
    return pm.Coupler(whole.subdomains, ties, dt=0.05, threads=2, comm=MPI.COMM_SELF, coupling="pm")


def small(kind):
    """Three subdomains of a few dofs."""
    K = np.diag([4.0, 4.0, 2.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    scheme = pm.GeneralizedAlpha(0.5)
    force = {"callbacks": lambda t: np.full(3, np.sin(t))}.get(kind)
    internal = pm.CubicSpring([0], k=1.0, k3=0.5) if kind == "newton" else None
    restoring = [lambda t, u, v: 0.1 * u] if kind == "callbacks" else None
    a = pm.Subdomain(np.ones(3), K, scheme=scheme, u0=[1.0, 0.5, 0.2], force=force, name="a")
    b = pm.Subdomain(
        np.ones(2),
        [3.0, 3.0],
        C=0.1 * np.eye(2),
        scheme=scheme,
        substeps=1 if kind == "mean" else 4,
        u0=[0.2, 0.0],
        restoring=restoring,
        name="b",
    )
    c = pm.Subdomain(np.ones(1), [1.0], scheme=scheme, internal=internal, name="c")
    ties = [pm.tie(a, [2], b, [0]), pm.tie(b, [1], c, [0])]
    coupling = {"macro": "macro", "mean": "mean", "newton": "gc"}.get(kind, "pm")
    return pm.Coupler([a, b, c], ties, dt=0.05, coupling=coupling, threads=2)


KINDS = ("linear", "callbacks", "macro", "mean", "newton", "explicit", "tree")
KINDS += ("ranks",) if find_spec("mpi4py") else ()


def calls(kind, folder):
    """What is done with one coupler, each with its own number of allocations."""
    path = folder / "state.npz"

    def halved(c):
        return {s.name: 0.5 * s.u0 for s in c.subdomains}

    def cases(c):  # one more than the core computes side by side
        c.run_each(9 * [{"u0": halved(c)}], steps=2)

    rest = {"run_each": cases} if kind != "ranks" else {}
    return rest | {
        "change_steps": lambda c: c.change_steps(dt=0.03),
        "build": lambda c: made(kind),
        "run": lambda c: c.run(steps=5),
        "run with energies": lambda c: c.run(steps=5, energy=True, record={"a": [0]}),
        "run into a file": lambda c: c.run(steps=5, record_to=folder / "run.h5", overwrite=True),
        "step": lambda c: c.step(5),
        "state": lambda c: c.state("b"),
        "static": lambda c: c.static() if kind == "linear" else None,
        "save": lambda c: c.save(path),
        "load": lambda c: c.load(path),
        "snapshot": lambda c: c.restore(c.snapshot()),
        "reset": lambda c: c.reset(u0=halved(c)),
    }


def state(coupler):
    names = [s.name for s in coupler.subdomains]
    return np.concatenate([getattr(coupler.state(s), x) for s in names for x in "uva"])


def is_of_memory(error):
    """Threads whose stack or tables cannot be made are said to be too many by the C library."""
    return isinstance(error, MemoryError) or "makes no more threads" in str(error)


def attempt(kind, library, folder, stride, first=40):
    """Fails each allocation of each call in turn; behind the `first` ones every `stride`-th."""
    counts = Counter()
    twin = made(kind)
    twin.step(3)
    start = twin.snapshot()
    twin.save(folder / "state.npz")
    twin.step(4)
    expected = state(twin)
    for name, call in calls(kind, folder).items():
        k = 0
        while True:
            k += 1 if k < first else stride
            twin.restore(start)
            print(kind, name, k, flush=True)
            library.failing_allocations_arm(k)
            try:
                call(twin)
                error = None
            except (MemoryError, RuntimeError) as raised:
                assert is_of_memory(raised), raised
                error = raised
            except pm.CasesError as raised:
                assert all(map(is_of_memory, raised.failures.values())), raised.failures
                error = raised
            failed = library.failing_allocations_arm(0)
            counts["failures"] += failed >= k
            counts["MemoryError"] += error is not None
            assert error is None or failed >= k, "MemoryError though no allocation failed"
            twin.restore(start)  # not busy
            twin.step(4)
            np.testing.assert_array_equal(state(twin), expected)
            if failed < k:
                break
        counts["calls"] += 1
    return counts


def failing():
    """The functions of the library that was loaded first, for the allocations of the extension."""
    library = ctypes.CDLL(None)
    for tell, name in (
        (library.failing_allocations_of, _core.__file__),
        (library.failing_allocations_apart, "/libmpi.so"),  # which would end the process
    ):
        lines = [x for x in Path("/proc/self/maps").read_text().splitlines() if name in x]
        ends = [int(x, 16) for line in lines for x in line.split()[0].split("-")]
        tell.argtypes = [ctypes.c_size_t, ctypes.c_size_t]
        tell(min(ends, default=0), max(ends, default=0))
    library.failing_allocations_arm.argtypes = [ctypes.c_long]
    library.failing_allocations_arm.restype = ctypes.c_long
    return library


def run_in_this_process(kinds, stride, first):
    library = failing()
    warnings.simplefilter("ignore")
    total = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds:
            total += attempt(kind, library, Path(folder), stride, first)
    print(dict(total))


def preloaded(folder):
    """The environment of a process in which allocations can fail."""
    library = Path(folder, "failing_allocations.so")
    source = HERE / "failing_allocations.c"
    compiler = [os.environ.get("CC", "cc"), "-shared", "-fPIC", "-O1", "-o", str(library)]
    subprocess.run([*compiler, str(source)], check=True)
    return {"LD_PRELOAD": str(library), "PYTHONMALLOC": "malloc"}


def campaign(kinds=KINDS, stride=1, first=40, seconds=3600):
    """The output of a process in which allocations fail; an error of the process is raised."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | preloaded(folder)
        done = subprocess.run(
            [sys.executable, __file__, str(stride), str(first), *kinds],
            env=environment | {"IN_CAMPAIGN": "1"},
            capture_output=True,
            text=True,
            timeout=seconds,
        )
    last = done.stdout.splitlines()[-1:]
    assert done.returncode == 0, f"{done.returncode} after {last}: {done.stderr[-2000:]}"
    return last[0]


if __name__ == "__main__":
    if "IN_CAMPAIGN" in os.environ:
        run_in_this_process(sys.argv[3:], int(sys.argv[1]), int(sys.argv[2]))
    else:
        print(campaign(sys.argv[1:] or KINDS))
