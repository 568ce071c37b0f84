"""Random histories of calls of a coupler of several processes, bitwise against one process.

Runs in memory and into files, steps, exceptions of a load on one rank, snapshots, checkpoints,
changes of steps and resets; every rank draws the same calls.

    mpiexec -n 3 python tests/on_ranks.py histories FOLDER FIRST COUNT
"""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from rank_bitwise import own_part
from rank_problems import COUPLINGS, RANK, SIZE, WORLD, chain, report, same, ties

import pmalpha as pm

HDF5 = find_spec("h5py") is not None
COUNT = 5


class Stop(Exception):
    """Raised by a load."""


class Fuse:
    """Called by all loads of a rank: raises at one of the calls."""

    calls = 0  # until it raises; 0: never

    def __call__(self):
        self.calls -= self.calls > 0
        if self.calls == 1:
            self.calls = 0
            raise Stop


def couplers(rng, fuse):
    """The coupler of all ranks, one of this process alone, and the names of this rank."""
    coupling = COUPLINGS[int(rng.integers(len(COUPLINGS)))]
    values = []
    for _ in range(COUNT):
        explicit = bool(rng.random() < 0.3)
        own = dict(substeps=int(rng.choice([1, 2, 4])), scheme=pm.GeneralizedAlpha(0.8, explicit))
        own["load"] = (rng.normal(size=3), float(rng.uniform(1.0, 9.0)))
        if not explicit and rng.random() < 0.4:
            own["internal"] = pm.CubicSpring([1], k=1.0, k3=float(rng.uniform(0.5, 5.0)))
        values.append(own)

    def made(before):
        subdomains = []
        for number, own in enumerate(values):
            f, omega = own["load"]
            options = {key: x for key, x in own.items() if key != "load"}

            def force(t, f=f, omega=omega):
                before()
                return f * np.sin(omega * t)

            subdomains.append(chain(3, f"r{number}", force=force, **options))
        return subdomains

    part = own_part(COUNT, rng)
    options = dict(dt=0.01, coupling=coupling)
    alone = pm.Coupler(made(lambda: None), ties(COUNT), **options)
    shared = pm.Coupler(made(fuse)[part], ties(COUNT), comm=WORLD, **options)
    return shared, alone, [s.name for s in shared.subdomains]


class Calls:
    """The calls, of both couplers at once."""

    def __init__(self, rng, folder):
        self.rng, self.folder, self.fuse, self.kept = rng, Path(folder), Fuse(), []
        self.shared, self.alone, self.names = couplers(rng, self.fuse)
        self.files = self.stops = 0

    def run(self):
        steps, every = int(self.rng.integers(1, 9)), [None, 2][int(self.rng.integers(2))]
        options, path = {}, self.folder / f"run{self.files}.h5"
        if HDF5 and self.rng.random() < 0.4:
            options["record_to"] = path
            self.files += 1
        begin, history = self.shared.step_count, None
        breaks, after = int(self.rng.integers(2 * SIZE)), int(self.rng.integers(2, 40))
        self.fuse.calls = after if breaks == RANK else 0
        try:
            history = self.shared.run(steps=steps, every=every, **options)
        except (Stop, pm.PmalphaError):
            history = self.shared.last_history
            self.stops += 1
        self.fuse.calls = 0
        done = self.shared.step_count - begin
        assert len(set(WORLD.allgather((done, history is None)))) == 1
        if history is None:  # it ended in the set-up of the run
            assert done == 0
            return
        expected = self.alone.run(steps=done, every=every)
        same(history, expected, self.names)
        if options and RANK == 0:
            same(pm.History.load(path), expected, [f"r{i}" for i in range(COUNT)])
        WORLD.Barrier()

    def step(self):
        for c in (self.shared, self.alone):
            c.step(3)

    def keep(self):
        path = None
        if self.rng.random() < 0.5:
            path = self.folder / f"state{len(self.kept)}.npz"
            self.shared.save(path)
            WORLD.Barrier()
        self.kept.append((self.shared.snapshot(), path, self.alone.snapshot()))

    def restore(self):
        if self.kept:
            snapshot, path, other = self.kept[int(self.rng.integers(len(self.kept)))]
            self.alone.restore(other)
            self.shared.restore(snapshot) if path is None else self.shared.load(path)

    def change_steps(self):
        values = dict(dt=float(self.rng.choice([0.01, 0.008, 0.005])))
        refused = []
        for c in (self.shared, self.alone):
            try:
                c.change_steps(**values)
            except ValueError:
                refused.append(c)
        assert len(refused) in (0, 2)

    def reset(self):
        for c in (self.shared, self.alone):
            c.reset()

    def compare(self):
        shared, alone = self.shared, self.alone
        assert (shared.time, shared.step_count) == (alone.time, alone.step_count)
        np.testing.assert_array_equal(shared.multipliers, alone.multipliers)
        for name in self.names:
            for x in "uva":
                found, expected = (getattr(c.state(name), x) for c in (shared, alone))
                np.testing.assert_array_equal(found, expected)


CALLS = ("run", "run", "run", "step", "keep", "restore", "change_steps", "reset")


def histories(folder, first=0, count=4, calls=15):
    """Prints how many calls there were."""
    done = stops = files = 0
    for seed in range(int(first), int(first) + int(count)):
        rng = np.random.default_rng([seed, 19])
        own = Path(folder, str(seed))
        if RANK == 0:
            own.mkdir()
        WORLD.Barrier()
        pair = Calls(rng, own)
        names = []
        for _ in range(calls):
            names.append(CALLS[int(rng.integers(len(CALLS)))])
            try:
                getattr(pair, names[-1])()
                pair.compare()
            except Exception as error:
                raise AssertionError(f"seed {seed}, after {', '.join(names)}") from error
            done += 1
        stops, files = stops + pair.stops, files + pair.files
    report(f"{done} calls, {stops} stops, {files} files")
