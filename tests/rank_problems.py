"""Problems of several processes, and how they are compared with one process."""

import numpy as np
from agreement import assert_close
from mpi4py import MPI
from newton_coupled import Law

import pmalpha as pm
from pmalpha.results.quantities import IN_INTERFACE

WORLD = MPI.COMM_WORLD
RANK, SIZE = WORLD.rank, WORLD.size

COUPLINGS = ("pm", "gc", "macro", "mean")


def report(*words):
    """One line of each rank, written by one of them."""
    lines = WORLD.gather(" ".join(map(str, words)))
    if RANK == 0:
        print("\n".join(lines), flush=True)


def same(one, other, names):
    for name in names:
        for x in ("t", "u", "v", "a"):
            ours, theirs = (getattr(run[name], x) for run in (one, other))
            assert_close(ours, theirs, 0.0, f"{x} of {name} on rank {RANK}", times=one[name].t)
    for x in IN_INTERFACE["constraints"] + IN_INTERFACE[""]:
        what = f"{x} on rank {RANK}"
        assert_close(getattr(one, x), getattr(other, x), 0.0, what, column="constraint")


def same_energies(own, whole, part):
    """The energies of the subdomains of this rank, and of all of them their sums."""
    assert own.arrays().keys() == whole.arrays().keys()
    for name, x in whole.arrays().items():
        np.testing.assert_array_equal(own.arrays()[name], x[:, part], err_msg=name)
    balance = np.hstack(WORLD.allgather(own.balance))
    np.testing.assert_array_equal(balance.sum(axis=1), whole.balance.sum(axis=1))


def chain(n, name, k=100.0, **options):
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    options = dict(scheme=pm.GeneralizedAlpha(0.8), u0=np.full(n, 0.1)) | options
    return pm.Subdomain(np.ones(n), k * K, name=name, **options)


def ties(count=SIZE):
    return [pm.tie(f"r{r}", 2, f"r{r + 1}", 0) for r in range(count - 1)]


def four(comm=None, own=slice(None), coupling="pm"):
    """Four subdomains, of which this rank has its own."""
    subdomains = [
        chain(3, f"r{i}", substeps=substeps, force=np.ones(3))
        for i, substeps in enumerate((1, 2, 1, 1))
    ]
    return pm.Coupler(subdomains[own], ties(4), dt=0.01, comm=comm, coupling=coupling)


def plastic(coupling, newton, double, comm=None, own=slice(None)):
    """Five chains in a row: plastic, plastic with substeps, linear, stiffening, linear."""
    n, subdomains = 4, []
    for i, substeps in enumerate((1, 4, 8, 2, 8)):
        values = dict(force=lambda t, i=i: (20.0 + i) * np.sin(15.0 * t) * np.ones(n))
        if i < 2:
            law = Law(n, k=(2e3, 3e3)[i])
            values |= dict(internal=pm.InternalForce(law, history=np.zeros(n)))
        elif i == 3:
            values |= dict(internal=[pm.CubicSpring([1], 80.0, 3e4), pm.Bilinear([0], 60.0, 0.3)])
        K = None if i < 2 else 500.0 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
        scheme = pm.GeneralizedAlpha(0.5, explicit=i == 2)
        values |= dict(scheme=scheme, substeps=substeps, name=f"r{i}")
        if double is not None:
            one = coupling in ("macro", "mean")  # where double steps have no substeps
            values |= dict(double_step=double and i in ((0,) if one else (0, 3)))
        subdomains.append(pm.Subdomain(np.ones(n), K, **values))
    pulled = pm.Constraint({"r0": np.eye(1, n, 1)}, lambda t: [0.3 * np.sin(9.0 * t)])
    options = dict(dt=0.02, coupling=coupling, newton=newton, comm=comm)
    joints = [pm.tie(f"r{i}", [n - 1], f"r{i + 1}", [0]) for i in range(4)]
    return pm.Coupler(subdomains[own], [*joints, pulled], **options)
