"""Random histories of calls of a coupler, against a twin with one thread that nothing disturbs.

Runs, steps, exceptions and Ctrl-C in callbacks, files of runs that go on from earlier ones, resets,
checkpoints, snapshots, also of another coupler, changes of steps, runs of several cases, studies
with their file. After each call the state is bitwise that of the twin, which makes only the macro
steps that were completed, and what was recorded is bitwise what the twin records. rank_histories.py
has the same of several processes.
"""

import signal
import tempfile
import warnings
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import problems
from campaign import arguments, seeds, tried

import pmalpha as pm

HDF5 = find_spec("h5py") is not None
COUPLINGS = ("pm", "gc", "macro", "mean")
LENGTHS = (0.05, 0.04, 0.025)
DRAWS = (
    problems.random_problem,
    problems.random_restored_problem,
    problems.random_unsymmetric_problem,
)


class Stop(Exception):
    """Raised in a callback."""


@dataclass
class Fuse:
    """Called by all callbacks of a coupler: raises at one of the calls."""

    calls: int = 0  # until it raises; 0: never
    by_signal: bool = False

    def __call__(self):
        self.calls -= self.calls > 0
        if self.calls == 1:
            self.calls = 0
            if not self.by_signal:
                raise Stop
            signal.raise_signal(signal.SIGINT)

    def around(self, function):
        """The function, which raises with the fuse; anything else is returned as it is."""
        if not callable(function) or isinstance(function, pm.SampledForce | pm.BaseAcceleration):
            return function

        def called(*values):
            self()
            return function(*values)

        return called


@dataclass(frozen=True)
class Branch:
    """What a coupler has done since it was made, apart from what was undone again."""

    reset: dict = field(default_factory=dict)
    changed: bool = False  # by a reset
    calls: tuple = ()  # (name of a method, its arguments)

    def then(self, name, **values):
        return replace(self, calls=(*self.calls, (name, values)))

    @property
    def steps(self):
        return sum(values["steps"] for name, values in self.calls if name == "run")


class Twin:
    """A coupler with one thread, brought to where a branch ends."""

    def __init__(self, make):
        self.make = make
        self.at(Branch())

    def at(self, branch):
        self.coupler, self.branch = self.make(), Branch()
        if branch.changed:
            self.coupler.reset(**branch.reset)
        for name, values in branch.calls:
            getattr(self.coupler, name)(**values)
        self.branch = branch
        return self

    def then(self, name, **values):
        self.branch = self.branch.then(name, **values)
        return getattr(self.coupler, name)(**values)


def random_maker(seed, rng):
    """make(fuse, threads) of a random problem, and the names of its subdomains."""
    problem = DRAWS[int(rng.integers(3))](seed)
    options = {"coupling": COUPLINGS[int(rng.integers(4))]}
    if options["coupling"] == "gc" and rng.random() < 0.3:
        options["drift"] = "removed"
    elif rng.random() < 0.4:
        add_internal(rng, problem)
    if rng.random() < 0.3 and not any(np.any(np.diag(s.M) == 0.0) for s in problem.subdomains):
        g = rng.normal(size=problem.L[0].shape[0])
        problem.velocity = lambda t: g * np.sin(t)

    def make(fuse=None, threads=1):
        fuse = fuse or Fuse()
        made = [
            replace(s, name=name, force=fuse.around(s.force), restoring=fuse.around(s.restoring))
            for name, s in zip("abcde", problem.subdomains)
        ]
        fused = replace(
            problem,
            subdomains=made,
            velocity=fuse.around(problem.velocity),
            coupling=options["coupling"],
        )
        rest = {name: value for name, value in options.items() if name != "coupling"}
        return fused.coupler(threads=threads, **rest)

    return make


def add_internal(rng, problem):
    """A cubic spring or the same as a function, in some of the subdomains."""
    for s in problem.subdomains:
        if rng.random() < 0.6 and np.diag(s.M).all():
            k3 = rng.uniform(0.5, 5.0)
            s.internal = pm.CubicSpring([0], k=1.0, k3=k3) if rng.random() < 0.5 else cubic(k3)


def cubic(k3):
    def evaluate(u, v, t, q):
        first = np.eye(1, u.size)[0]
        return (u[0] + k3 * u[0] ** 3) * first, np.diag((1.0 + 3.0 * k3 * u[0] ** 2) * first)

    return evaluate


# ---- equality --------------------------------------------------------------------------------


def same(x, y, what):
    np.testing.assert_array_equal(x, y, err_msg=what)


def compare_states(coupler, twin):
    assert coupler.step_count == twin.step_count and coupler.time == twin.time
    same(coupler.multipliers, twin.multipliers, "multipliers")
    for name in (s.name for s in coupler.subdomains):
        for quantity in "uva":
            x, y = (getattr(c.state(name), quantity) for c in (coupler, twin))
            same(x, y, f"{quantity} of {name}")


def rows_of(times, all_times):
    """Where some time levels are among all."""
    rows = np.searchsorted(all_times, times)
    same(all_times[rows], times, "times")
    return rows


def compare_histories(part, whole):
    """A History with some of the dofs and time levels, and one of the same run with all."""
    assert part.macro_times[0] == whole.macro_times[0]
    rows_of(part.macro_times, whole.macro_times)
    for own in filter(None, part.subdomains):
        full = whole[own.name]
        rows = rows_of(own.t, full.t)
        for quantity in "uva":
            x = getattr(full, quantity)[rows][:, own.dofs]
            same(getattr(own, quantity), x, f"recorded {quantity} of {own.name}")
    rows = rows_of(part.multiplier_times, whole.multiplier_times)
    same(part.multipliers, whole.multipliers[rows], "recorded multipliers")
    same(part.velocity_jump, whole.velocity_jump[rows], "recorded jumps")
    if part.energy is not None:
        rows = rows_of(part.energy.t, whole.energy.t)
        for quantity in ("kinetic", "strain", "dissipated", "external", "interface", "balance"):
            x, y = (getattr(h.energy, quantity) for h in (part, whole))
            same(x, y[rows], quantity)


# ---- calls -----------------------------------------------------------------------------------


class Pair:
    """A coupler, its twin, and what was kept of both."""

    def __init__(self, make, rng, counts, folder):
        self.make, self.rng, self.counts, self.folder = make, rng, counts, Path(folder)
        self.fuse = Fuse()
        self.coupler = make(self.fuse, int(rng.integers(1, 4)))
        self.twin, self.branch = Twin(make), Branch()
        self.snapshots, self.files = [], []

    def disturbed(self, call):
        """The result of a call, or the exception that ended it."""
        if self.rng.random() < 0.4:
            self.fuse.calls = int(self.rng.integers(2, 60))
            self.fuse.by_signal = bool(self.rng.integers(2))
        try:
            return call()
        except (Stop, KeyboardInterrupt, pm.PmalphaError) as error:
            self.counts[type(error).__name__] += 1
            return error
        finally:
            self.fuse.calls = 0

    def advanced(self, history=None, failure=None, energy=False):
        """The twin follows; what was recorded and the error of a problem are its own too."""
        done = self.coupler.step_count - self.branch.steps
        whole = self.twin.then("run", steps=done, **({"energy": True} if energy else {}))
        self.branch = self.twin.branch
        if history is not None:
            compare_histories(history, whole)
            self.counts["histories"] += 1
        if isinstance(failure, pm.PmalphaError):
            self.fails_too(type(failure))

    def fails_too(self, kind):
        kept = self.twin.coupler.snapshot()
        try:
            self.twin.coupler.step()
        except kind:
            self.twin.coupler.restore(kept)
        else:
            raise AssertionError(f"{kind.__name__} in the coupler, and not in its twin")

    def run(self):
        """In memory, or into a file: a new one, or that of an earlier run."""
        rng, options = self.rng, {}
        names = [s.name for s in self.coupler.subdomains]
        if rng.random() < 0.5:
            options["every"] = int(rng.integers(1, 4))
        if rng.random() < 0.3:
            options["record"] = {name: [0] for name in names if rng.random() < 0.7}
        if rng.random() < 0.2:
            options["energy"] = True
        if rng.random() < 0.3:
            options["progress"] = lambda done, total: self.fuse()
        if HDF5 and rng.random() < 0.3:
            options["record_to"] = self.folder / f"{rng.integers(2**60)}.h5"
        result = self.disturbed(lambda: self.coupler.run(steps=int(rng.integers(0, 9)), **options))
        failed = isinstance(result, BaseException)
        history = self.coupler.last_history if failed else result
        assert failed or self.coupler.last_history is None
        self.advanced(history, result if failed else None, "energy" in options)
        if history is not None and "record_to" in options:
            self.compare_file(options["record_to"], history)

    def compare_file(self, path, history):
        """A file holds what the History of its run has, also after an exception."""
        compare_histories(pm.History.load(path), history)
        compare_histories(history, pm.History.load(path))
        self.counts["files"] += 1

    def append(self):
        """Two runs into one file, with what may happen between them; of one run without a pause."""
        if not HDF5:
            return
        path = self.folder / f"{self.rng.integers(2**60)}.h5"
        options = {"every": int(self.rng.integers(1, 4))} if self.rng.random() < 0.5 else {}
        kept = self.coupler.snapshot()
        whole = self.coupler.run(steps=5, **options)
        self.coupler.restore(kept)
        self.coupler.run(steps=3, record_to=path, **options)
        if self.rng.random() < 0.5:  # rows that were written after the state that is restored
            after = self.coupler.snapshot()
            self.coupler.run(steps=2, record_to=path, append=True, **options)
            self.coupler.restore(after)
        self.coupler.run(steps=2, record_to=path, append=True, **options)
        self.compare_file(path, whole)
        self.advanced()

    def step(self):
        result = self.disturbed(lambda: self.coupler.step(int(self.rng.integers(0, 9))))
        self.advanced(None, result)

    def reset(self):
        values, s = {}, self.coupler.subdomains[0]
        if self.rng.random() < 0.5:
            values = {"force": {s.name: self.rng.normal(size=s.n) * (diagonal_mass(s) > 0.0)}}
        branch = Branch(values, True)
        result = self.disturbed(lambda: self.coupler.reset(**values))
        if not isinstance(result, BaseException):
            self.to(branch)

    def to(self, branch):
        self.branch = branch
        self.twin.at(branch)

    def keep(self):
        if self.rng.random() < 0.5:
            self.snapshots.append((self.coupler.snapshot(), self.branch))
        else:
            path = self.folder / f"{len(self.files)}.npz"
            self.coupler.save(path)
            self.files.append((path, self.branch))

    def restore(self):
        if self.snapshots:
            snapshot, branch = self.snapshots[int(self.rng.integers(len(self.snapshots)))]
            self.coupler.restore(snapshot)
            self.to(branch)

    def load(self):
        """In the same coupler, or in a new one with another number of threads."""
        if not self.files:
            return
        path, branch = self.files[int(self.rng.integers(len(self.files)))]
        if self.rng.random() < 0.5:
            self.fuse = Fuse()
            self.coupler, self.snapshots = self.make(self.fuse, int(self.rng.integers(1, 4))), []
        if branch.changed or self.branch.changed:
            self.coupler.reset(**branch.reset)  # the loads are part of the problem
        self.coupler.load(path)
        self.to(branch)

    def change_steps(self):
        dt = LENGTHS[int(self.rng.integers(3))]
        finest = max(s.substeps for s in self.coupler.subdomains)
        counts = {s.name: finest for s in self.coupler.subdomains[1:] if self.rng.random() < 0.3}
        try:
            self.coupler.change_steps(dt=dt, substeps=counts)
        except ValueError:  # double steps everywhere, for example
            self.counts["refused"] += 1
            return
        self.twin.then("change_steps", dt=dt, substeps=counts)
        self.branch = self.twin.branch

    def tolerance(self):
        if self.coupler.coupling != "gc":
            return
        kept, values = self.coupler.snapshot(), {"steps": 3, "tolerance": 0.02}
        try:
            history = self.coupler.run(**values)
        except (ValueError, pm.PmalphaError):  # with the drift removed, for example
            self.coupler.restore(kept)
            self.counts["refused"] += 1
            return
        compare_histories(history, self.twin.then("run", **values))
        self.branch = self.twin.branch

    def random_cases(self):
        """One case, some, or more than the core has lanes; their loads of any kind."""
        rng, s = self.rng, self.coupler.subdomains[0]
        mass = 1.0 * (diagonal_mass(s) > 0.0)

        def load():
            shape = rng.normal(size=s.n) * mass
            kind = int(rng.integers(4))
            if kind == 0:
                return lambda t: shape * np.cos(t)
            if kind == 1:
                return pm.SampledForce(rng.normal(size=7), 0.03, shape=shape)
            return shape

        return [{"force": {s.name: load()}} for _ in range(int(rng.choice([1, 2, 3, 9])))]

    def run_each(self):
        """Of new values on the coupler, which stays as it is, and of single runs."""
        rng, options, cases = self.rng, {}, self.random_cases()
        if rng.random() < 0.3:
            options["every"] = int(rng.integers(1, 4))
        if rng.random() < 0.3:
            options["record"] = {self.coupler.subdomains[0].name: [0]}
        if rng.random() < 0.2:
            options["energy"] = True
        result = self.disturbed(lambda: self.coupler.run_each(cases, steps=4, **options))
        if isinstance(result, BaseException):
            return
        for case, history in zip(cases, result):
            alone = self.make()
            alone.reset(**case)
            compare_histories(history, alone.run(steps=4, energy="energy" in options))
            self.counts["histories"] += 1

    def study(self):
        """Several cases into one file; rows of cases that fail are NaN and have the error."""
        if not HDF5:
            return
        import h5py

        cases, name = self.random_cases(), self.coupler.subdomains[0].name
        path = self.folder / f"{self.rng.integers(2**60)}.h5"
        study = pm.Study(
            self.make,
            steps=4,
            together=int(self.rng.integers(1, 5)),
            result=lambda history: {"u": history[name].u, "end": history.macro_times[-1]},
        )
        found = study.run(cases, save_to=path)
        with h5py.File(path) as file:
            for k, (case, result) in enumerate(zip(cases, found, strict=True)):
                alone = self.make()
                try:
                    alone.reset(**case)
                    expected = alone.run(steps=4)
                except pm.PmalphaError as error:
                    assert type(result.error) is type(error)
                    assert file["error"][k].decode().startswith(type(error).__name__)
                    continue
                assert result.error is None and file["error"][k] == b""
                same(file["u"][k], expected[name].u, "u of a study")
                assert file["end"][k] == expected.macro_times[-1]
                self.counts["studied"] += 1

    def foreign(self):
        """The snapshot of another coupler is refused, also one of the same problem."""
        for other in (self.make(), self.twin.coupler):
            try:
                self.coupler.restore(other.snapshot())
            except ValueError:
                continue
            raise AssertionError("a snapshot of another coupler is restored")


def diagonal_mass(s):
    if s.M is None:
        return np.zeros(s.n)
    return s.M if s.M.ndim == 1 else s.M.diagonal()


CALLS = ("run",) * 4 + ("step",) * 3 + ("keep",) * 2
CALLS += ("append", "reset", "restore", "load", "change_steps", "tolerance", "run_each")
CALLS += ("study", "foreign")


def attempt(seed, counts, calls=25):
    """One coupler and a number of calls."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    try:
        _attempt(seed, counts, calls)
    finally:
        signal.signal(signal.SIGINT, before)


def _attempt(seed, counts, calls):
    rng = np.random.default_rng([seed, 7])
    make = random_maker(seed, rng)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            make()
        except (ValueError, pm.PmalphaError):  # this coupling cannot be had with these subdomains
            counts["problems refused"] += 1
            return
        pair = Pair(make, rng, counts, folder)
        done = []
        for _ in range(calls):
            name = CALLS[int(rng.integers(len(CALLS)))]
            if name == "change_steps" and getattr(pair.coupler, "drift", "kept") == "removed":
                continue
            done.append(name)
            counts[name] += 1
            try:
                getattr(pair, name)()
                compare_states(pair.coupler, pair.twin.coupler)
            except Exception as error:
                raise AssertionError(f"after {', '.join(done)}") from error
        counts[f"coupling {pair.coupler.coupling}, {pair.coupler.threads} threads"] += 1


if __name__ == "__main__":
    given = arguments(__doc__)
    print(dict(sorted(tried(attempt, seeds(given.seed, given.seconds)).items())))
