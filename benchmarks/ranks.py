"""Several processes: a row of explicit solids on 1, 2 and 4 ranks, and a model for more of them.

The model of a macro step of S equal subdomains on R ranks is

    S / R (a + b n) + c p + d numbers + (latency log2 R + bytes / bandwidth)  of the exchange, R > 1

with n dofs a subdomain, p constraints and the numbers that all subdomains send, 8 bytes each;
there are two exchanges in a macro step. a and b are fitted to uncoupled solids, c and d to one
process with and without the exchange, the latency to a step of two masses on one and two ranks,
the bandwidth to MPI_Allgatherv between two. The predictions for 64 and 1000 ranks take one
subdomain a rank, with these constants or with those of NETWORK, which are assumed. More ranks than
processors share them: those rows show what that costs.

Also: a step of two masses, with MPI_Allgatherv called by its address and by a Python callable; and
what p constraints cost a rank that has no subdomain itself.
"""

import importlib.util
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from memory import forget_peak, peak, present
from timing import run

import pmalpha as pm

EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)
IMPLICIT = pm.GeneralizedAlpha(0.8)
COUNT = 4  # subdomains that are measured
SIZES = 2, 4, 6, 8, 12  # of cubes
CONSTRAINTS = (1000, 10_000, 100_000), (507, 972, 1875, 3072)  # diagonal and dense H
NETWORK = 1.5e-6, 1e10  # s, bytes / s: of a cluster, assumed
SECONDS, FEWEST, MOST = 1e-3, 10, 500  # of a batch of steps, and their numbers
INNER = "--inner"  # the argument of what each rank does


def row_of_boxes(n, count, own=slice(None), comm=None, coupled=True, scheme=EXPLICIT):
    """Cubes of n hex8 a side one after the other, tied at their faces."""
    box = pm.structures.solid(n, n, n, 1.0, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    x = np.repeat(box.points[:, 0], 3)
    left, right = np.flatnonzero(x == x.min()), np.flatnonzero(x == x.max())
    names = [str(i) for i in range(count)]
    ties = [pm.tie(a, right, b, left) for a, b in zip(names, names[1:])] if coupled else None
    boxes = [box.subdomain(scheme=scheme, force=np.ones(box.n), name=name) for name in names[own]]
    return pm.Coupler(boxes, ties, dt=0.1, coupling="gc", comm=comm, threads=1)


def least(coupler, batches, comm=None):
    """Least wall-clock seconds of a macro step, in batches so short that some are not disturbed."""

    def once(steps):
        if comm is not None:
            comm.Barrier()
        begin = time.perf_counter()
        coupler.step(steps)
        return (time.perf_counter() - begin) / steps

    trial = min(once(FEWEST) for _ in range(5))
    trial = trial if comm is None else comm.bcast(trial)
    steps = int(np.clip(SECONDS / trial, FEWEST, MOST))
    times = min(once(steps) for _ in range(batches))
    return times if comm is None else comm.allreduce(times, max_of())


def max_of():
    from mpi4py import MPI

    return MPI.MAX


# ---- what each rank does ------------------------------------------------------------------------


def inner(sizes, batches):
    """Seconds of everything that needs several processes, printed by rank 0."""
    from mpi4py import MPI

    from pmalpha.setup.ranks import Ranks

    comm = MPI.COMM_WORLD
    first = np.linspace(0, COUNT, comm.size + 1).astype(int)
    own = slice(first[comm.rank], first[comm.rank + 1])
    found = {"boxes": [least(row_of_boxes(n, COUNT, own, comm), batches, comm) for n in sizes]}
    address = Ranks._address
    for name, how in (("address", address), ("callable", lambda self: None)):
        Ranks._address = how
        masses = [pm.Subdomain([1.0], [1.0], scheme=EXPLICIT, name=str(i)) for i in range(2)]
        part = masses if comm.size == 1 else masses[comm.rank : comm.rank + 1]
        coupler = pm.Coupler(part, pm.tie("0", [0], "1", [0]), dt=0.1, coupling="gc", comm=comm)
        found[name] = least(coupler, batches, comm)
    found["gathers"] = [(size, gather(comm, size, batches)) for size in (8_000, 800_000)]
    if comm.rank == 0:
        print(json.dumps(found))


def gather(comm, size, batches):
    """Least seconds of an MPI_Allgatherv in place, of `size` bytes from each rank."""
    from mpi4py import MPI

    numbers = size // 8
    values = np.zeros(numbers * comm.size)
    counts = np.full(comm.size, numbers)
    received = [values, counts, np.arange(comm.size) * numbers, MPI.DOUBLE]
    repeats = max(10, 2_000_000 // (size + 1000))
    times = []
    for _ in range(batches):
        comm.Barrier()
        begin = time.perf_counter()
        for _ in range(repeats):
            comm.Allgatherv(MPI.IN_PLACE, received)
        times.append((time.perf_counter() - begin) / repeats)
    return comm.allreduce(min(times), MPI.MAX)


def on_ranks(ranks, sizes, what):
    """`inner` on so many ranks, with a number of batches, or `inner_interface` of a kind."""
    own = Path(sys.executable).with_name("mpiexec")
    mpiexec = str(own) if own.exists() else shutil.which("mpiexec")
    words = [mpiexec, "-n", ranks, sys.executable, __file__, INNER, what, *sizes]
    done = subprocess.run([str(x) for x in words], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


# ---- the model ----------------------------------------------------------------------------------


def without_ranks(sizes, batches):
    """Seconds of one solid without constraints, and of all in one process."""
    alone = [least(row_of_boxes(n, 1, coupled=False), batches) for n in sizes]
    return alone, [least(row_of_boxes(n, COUNT), batches) for n in sizes]


def fitted(sizes, alone, serial, one, two):
    """(a, b, c, d, latency, bandwidth) from what was measured without ranks, on one and on two."""
    alone, serial = np.array(alone), np.array(serial)
    dofs = np.array([3.0 * (n + 1) ** 3 for n in sizes])
    b, a = np.polyfit(dofs, alone, 1, w=1.0 / alone)
    p = np.array([3.0 * (COUNT - 1) * (n + 1) ** 2 for n in sizes])
    c = max(0.0, np.median((serial - COUNT * alone) / p))
    d = max(0.0, np.median((np.array(one["boxes"]) - serial) / (2.0 * p)))
    latency = max(0.0, two["address"] - one["address"]) / 2.0
    (size, shorter), (longer_size, longer) = two["gathers"]
    bandwidth = 2.0 * (longer_size - size) / (longer - shorter)
    return max(a, 0.0), b, c, d, latency, bandwidth


def predicted(model, n, count, ranks, network=None):
    """Seconds of a macro step, and those of one process without the exchange."""
    a, b, c, d, latency, bandwidth = model
    latency, bandwidth = network or (latency, bandwidth)
    dofs, p = 3.0 * (n + 1) ** 3, 3.0 * (count - 1) * (n + 1) ** 2
    own = a + b * dofs
    exchange = d * 2.0 * p
    if ranks > 1:
        exchange += latency * 2.0 * np.log2(ranks) + 16.0 * p / bandwidth  # with the vote
    return count / ranks * own + c * p + exchange, count * own + c * p


def rows_of_ranks(sizes, alone, serial, measured):
    """The table, from what `without_ranks` and `on_ranks` have measured."""
    model, rows = fitted(sizes, alone, serial, measured[1], measured[2]), []
    for ranks, found in measured.items():
        for name in ("address", "callable") if ranks < COUNT else ():
            rows.append(row(f"two masses, by {name}", ranks, 1, 1, found[name]))
        for k, n in enumerate(sizes):
            ours, one = found["boxes"][k], serial[k]
            theirs, _ = predicted(model, n, COUNT, ranks)
            rows.append(row("4 boxes", ranks, n, COUNT, ours, theirs, one / ours, one / theirs))
    names = "us a subdomain", "ns a dof", "ns a constraint", "ns a number", "us latency", "GB/s"
    units = 1e6, 1e9, 1e9, 1e9, 1e6, 1e-9
    for name, x, unit in zip(names, model, units):
        rows.append(row(f"model: {name}", "", "", "", "", x * unit / 1e6))
    for ranks in (64, 1000):
        for n in (*sizes, 100):
            for name, network in (("these constants", None), ("a network", NETWORK)):
                time_, one = predicted(model, n, ranks, ranks, network)
                rows.append(
                    row(f"a box a rank, {name}", ranks, n, ranks, "", time_, "", one / time_)
                )
    return rows


def row(problem, ranks, n, count, seconds, model="", gain="", gain_predicted="", **sizes):
    return {
        "problem": problem,
        "ranks": ranks,
        "dofs a subdomain": 3 * (n + 1) ** 3 if n != "" and "box" in problem else n,
        "constraints": 3 * (count - 1) * (n + 1) ** 2 if "box" in problem else "",
        "us a step": seconds if seconds == "" else seconds * 1e6,
        "us predicted": model if model == "" else model * 1e6,
        "gain": gain,
        "gain predicted": gain_predicted,
        "ms set-up": sizes.get("setup", ""),
        "MB": sizes.get("kept", ""),
        "MB in set-up": sizes.get("most", ""),
    }


# ---- what every rank keeps ----------------------------------------------------------------------


def masses(p, own, comm):
    """Twice p explicit masses, tied one by one."""
    pair = [pm.Subdomain(np.ones(p), np.ones(p), scheme=EXPLICIT, name=name) for name in "ab"]
    ties = pm.tie("a", np.arange(p), "b", np.arange(p))
    return pm.Coupler(pair[own], ties, dt=0.1, comm=comm, coupling="pm")


def plates(p, own, comm):
    """Two layers of hex8, tied at a face with p dofs, which are in one matrix."""
    n = round((p / 3) ** 0.5) - 1
    layer = pm.structures.solid(n, n, 1, 1.0, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    z = np.repeat(layer.points[:, 2], 3)
    top, bottom = np.flatnonzero(z == z.max()), np.flatnonzero(z == z.min())
    pair = [layer.subdomain(scheme=IMPLICIT, name=name) for name in "ab"]
    return pm.Coupler(
        pair[own], pm.tie("a", top, "b", bottom), dt=0.1, threads=1, comm=comm, coupling="pm"
    )


KINDS = {"diagonal H": masses, "dense H": plates}


def inner_interface(kind, sizes):
    """Memory of rank 1, which has no subdomain, and times, printed by it."""
    from mpi4py import MPI

    comm, found = MPI.COMM_WORLD, []
    KINDS[kind](12, slice(0, 2 * (comm.rank == 0)), comm)  # imports what set-up needs
    for p in sizes:
        before = present()
        forget_peak()
        comm.Barrier()
        begin = time.perf_counter()
        coupler = KINDS[kind](p, slice(0, 2 * (comm.rank == 0)), comm)
        setup = 1e3 * (time.perf_counter() - begin)
        size = dict(kept=present() - before, most=peak() - before)
        found.append(dict(setup=setup, **size, step=least(coupler, 5, comm)))
        del coupler
    if comm.rank == 1:
        print(json.dumps(found))


def rows_of_interface(found):
    """From (kind, numbers of constraints, what `inner_interface` has found), in turn."""
    return [
        row(f"{kind}, rank without subdomains", 2, "", "", x.pop("step"), **x) | {"constraints": p}
        for kind, sizes, each in found
        for p, x in zip(sizes, each)
    ]


def measure(quick):
    if importlib.util.find_spec("mpi4py") is None:
        print("mpi4py is not installed")
        return []
    sizes, batches = ((2, 3), 2) if quick else (SIZES, 80)
    constraints = ((100,), (27,)) if quick else CONSTRAINTS
    # 4 ranks share the processors, where a batch takes long
    measured = {
        ranks: on_ranks(ranks, sizes, batches if ranks < COUNT else min(batches, 5))
        for ranks in (1, 2, 4)
    }
    rows = rows_of_ranks(sizes, *without_ranks(sizes, batches), measured)
    found = [(kind, some, on_ranks(2, some, kind)) for kind, some in zip(KINDS, constraints)]
    return rows + rows_of_interface(found)


if __name__ == "__main__":
    if sys.argv[1:2] == [INNER]:
        what, sizes = sys.argv[2], [int(n) for n in sys.argv[3:]]
        if what in KINDS:
            inner_interface(what, sizes)
        else:
            inner(sizes, int(what))
    else:
        run("ranks", measure, about=__doc__)
