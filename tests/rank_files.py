"""What each rank does in the tests of files."""

import os
import signal
from pathlib import Path

import numpy as np
from rank_arguments import one_of
from rank_problems import COUPLINGS, RANK, SIZE, WORLD, chain, four, report, same, ties

import pmalpha as pm
from pmalpha.results import array_file
from pmalpha.run import checkpoint


def files(folder):
    """Checkpoints and files of a run, of which each rank has its own."""
    folder = Path(folder)

    def make():
        return pm.Coupler(
            [chain(3, f"r{RANK}", force=np.ones(3))], ties(), dt=0.01, coupling="pm", comm=WORLD
        )

    coupler, other = make(), make()
    coupler.step(11)
    coupler.save(folder / "state.npz")
    other.load(folder / "state.npz")
    assert other.step_count == 11
    same(coupler.run(steps=9), other.run(steps=9), [f"r{RANK}"])
    if RANK == SIZE - 1:
        next(folder.glob(f"state.npz.11.*.{RANK}")).write_bytes(b"damaged")
    WORLD.Barrier()
    before = other.multipliers
    one_of(ValueError, lambda bad: other.load(folder / "state.npz"), "state.npz")
    assert other.step_count == 20 and np.array_equal(before, other.multipliers)

    coupler, alone = make(), make()
    recorded = coupler.run(steps=30, record_to=folder / "run.h5", energy=True)
    expected = alone.run(steps=30, energy=True)
    same(recorded, expected, [f"r{RANK}"])
    energies = {name: WORLD.allgather(x) for name, x in expected.energy.arrays().items()}
    WORLD.Barrier()
    if RANK == 0:
        whole = pm.History.load(folder / "run.h5")
        assert whole.substeps.shape == (31, SIZE)
        for name, x in whole.energy.arrays().items():
            np.testing.assert_array_equal(x, np.hstack(energies[name]))
        assert [s.name for s in whole.subdomains] == [f"r{r}" for r in range(SIZE)]
        np.testing.assert_array_equal(whole.multipliers, expected.multipliers)
        np.testing.assert_array_equal(whole.displacement_jump, expected.displacement_jump)
    for r, u in enumerate(WORLD.allgather(expected[f"r{RANK}"].u)):
        if RANK == 0:
            np.testing.assert_array_equal(whole[f"r{r}"].u, u)
    one_of(
        FileExistsError,
        lambda bad: make().run(steps=3, record_to=folder / "run.h5"),
        "exist",
        everywhere=True,
    )

    # all subdomains on the last rank
    names = [f"r{r}" for r in range(SIZE)]
    own = [chain(3, name) for name in names] if RANK == SIZE - 1 else []
    coupler = pm.Coupler(own, ties(), dt=0.01, comm=WORLD, coupling="pm")
    coupler.run(steps=3, record_to=folder / "one.h5", energy=True)
    WORLD.Barrier()
    whole = pm.History.load(folder / "one.h5")
    assert [s.name for s in whole.subdomains] == names
    assert whole.energy.balance.shape == (4, SIZE)
    report("files")


def killed(folder):
    """A rank that is killed while a file is written; test_mpi.py reads what is left."""
    array_file.SYNC_SECONDS = 0.0  # rows are counted at once

    def progress(done, total):
        if RANK == SIZE - 1 and done > 2000:
            os.kill(os.getpid(), signal.SIGKILL)

    coupler = pm.Coupler([chain(3, f"r{RANK}")], ties(), dt=0.01, coupling="pm", comm=WORLD)
    coupler.run(steps=10_000_000, record_to=Path(folder) / "run.h5", every=100, progress=progress)


def checkpoints(folder):
    """A state saved by one number of ranks is loaded by another."""
    folder = Path(folder)
    names = [f"r{i}" for i in range(4)]
    fewer = WORLD.Split(RANK > 0)  # rank 0, and all others

    def part(comm):
        first = np.linspace(0, 4, comm.size + 1).astype(int)
        return slice(*first[comm.rank : comm.rank + 2])

    def last(comm):
        return slice(None) if comm.rank == comm.size - 1 else slice(0, 0)

    for coupling in COUPLINGS:
        shared, alone = four(WORLD, part(WORLD), coupling), four(coupling=coupling)
        for c in (shared, alone):
            c.step(7)
            own = names[part(WORLD)] if c is shared else names
            c.change_steps(0.008, {name: 2 * (name == "r1") or 1 for name in own})
            c.step(3)
        path = folder / f"{coupling}.npz"
        shared.save(path)
        if RANK == 0:
            alone.save(folder / f"{coupling}-alone")
        WORLD.Barrier()
        expected = alone.run(steps=5)
        for source in (path, folder / f"{coupling}-alone"):
            for comm, own in ((WORLD, last(WORLD)), (fewer, part(fewer)), (None, slice(None))):
                other = four(comm, own, coupling)
                other.load(source)
                assert (other.step_count, other.dt) == (10, 0.008)
                same(other.run(steps=5), expected, names[own])
        files = sorted(file.name for file in folder.glob(f"{path.name}*"))
        WORLD.Barrier()
        shared.step(1)
        shared.save(path)  # the files of the older state are removed
        WORLD.Barrier()
        later = sorted(file.name for file in folder.glob(f"{path.name}*"))
        assert len(later) == len(files) and not set(later) & set(files) - {path.name}
        assert all(name == path.name or ".11." in name for name in later), later
    report("checkpoints")


def killed_in_save(folder, where):
    """Two states of the same macro step; a rank is killed while the second one is saved, when
    another has written its file, or rank 0 when all have. `left` loads the first one."""

    def write(*arguments):
        if RANK == SIZE - 1:
            WORLD.recv()
            os.kill(os.getpid(), signal.SIGKILL)
        written(*arguments)
        if RANK == 0:
            WORLD.send(None, SIZE - 1)

    first = np.linspace(0, 4, SIZE + 1).astype(int)
    coupler = four(WORLD, slice(first[RANK], first[RANK + 1]))
    coupler.step(4)
    coupler.save(Path(folder) / "state.npz")
    coupler.reset(u0={s.name: np.zeros(3) for s in coupler.subdomains})
    coupler.step(4)
    written = checkpoint.write
    if where == "master":
        checkpoint.write_master = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    else:
        checkpoint.write = write
    coupler.save(Path(folder) / "state.npz")


def left(folder):
    coupler, other = four(), four()
    coupler.load(Path(folder) / "state.npz")
    other.step(4)
    coupler.save(Path(folder) / "one.npz")
    same(coupler.run(steps=3), other.run(steps=3), [f"r{i}" for i in range(4)])
    report("left")
    shared = four(WORLD)  # the next save removes what the interrupted one has left
    shared.load(Path(folder) / "one.npz")
    shared.save(Path(folder) / "state.npz")
    assert len(list(Path(folder).glob("state.npz.*"))) == 1
