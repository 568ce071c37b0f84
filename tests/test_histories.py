"""Histories of calls of a coupler, against a twin with one thread that nothing disturbs.

Runs, steps, exceptions and Ctrl-C in the user's functions, files of runs that go on from earlier
ones, resets, checkpoints, snapshots, changes of steps, runs of several cases, studies with their
file. After each call the state is bitwise that of the twin, which makes only the macro steps that
were completed, and what was recorded is bitwise what the twin records. campaign_histories.py tries
other histories; rank_histories.py has some of several processes.
"""

import signal
import tempfile
import warnings
from collections import Counter
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from itertools import count
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
import relations
from hypothesis import stateful
from problems import TIME_STEP

import pmalpha as pm

HDF5 = find_spec("h5py") is not None


class Stop(Exception):
    """Raised in a function of the user's."""


@dataclass
class Fuse:
    """Called by all functions of a coupler: counts, and raises at one of the calls."""

    left: int = 0  # calls until it raises; 0: never
    by_signal: bool = False
    calls: Counter = field(default_factory=Counter)

    def __call__(self, what):
        self.calls[what] += 1
        self.left -= self.left > 0
        if self.left == 1:
            self.left = 0
            if not self.by_signal:
                raise Stop
            signal.raise_signal(signal.SIGINT)

    def around(self, function, what):
        def called(*values):
            self(what)
            return function(*values)

        return called


@dataclass(frozen=True)
class Branch:
    """What a coupler has done since it was made, apart from what was undone again."""

    reset: dict | None = None
    calls: tuple = ()  # (name of a method, its arguments)

    @property
    def steps(self):
        return sum(values["steps"] for name, values in self.calls if name == "run")

    @property
    def changed(self):
        return any(name == "change_steps" for name, _ in self.calls)


class Twin:
    """A coupler with one thread, brought to where a branch ends."""

    def __init__(self, make):
        self.make = make
        self.at(Branch())

    def at(self, branch):
        self.coupler, self.branch = self.make(), branch
        if branch.reset is not None:
            self.coupler.reset(**branch.reset)
        for name, values in branch.calls:
            getattr(self.coupler, name)(**values)

    def then(self, name, **values):
        self.branch = replace(self.branch, calls=(*self.branch.calls, (name, values)))
        return getattr(self.coupler, name)(**values)


# ---- equality --------------------------------------------------------------------------------


def same(x, y, what):
    np.testing.assert_array_equal(x, y, err_msg=what)


def with_springs(parts):
    return [s.name for s in parts if s.restoring_springs and not s.dampers]


def compare_states(coupler, twin, springs):
    assert coupler.step_count == twin.step_count and coupler.time == twin.time
    same(coupler.multipliers, twin.multipliers, "multipliers")
    for name in (s.name for s in coupler.subdomains):
        for quantity in "uva":
            x, y = (getattr(c.state(name), quantity) for c in (coupler, twin))
            same(x, y, f"{quantity} of {name}")
    for name in springs:
        for quantity in ("deformation", "force"):
            x, y = (getattr(c.springs(name), quantity) for c in (coupler, twin))
            same(x, y, f"{quantity} of {name}")


def rows_of(times, all_times):
    """Where some time levels are among all."""
    rows = np.searchsorted(all_times, times)
    same(all_times[rows], times, "times")
    return rows


def compare_histories(part, whole):
    """A History with some of the dofs and time levels, and one of the same run with all."""
    assert part.macro_times[0] == whole.macro_times[0]
    same(part.displacement_jump, whole.displacement_jump[rows_of(part.macro_times,
        whole.macro_times)], "displacement jumps")  # fmt: skip
    for own in filter(None, part.subdomains):
        full = whole[own.name]
        rows = rows_of(own.t, full.t)
        for quantity in "uva":
            x = getattr(full, quantity)[rows][:, own.dofs]
            same(getattr(own, quantity), x, f"recorded {quantity} of {own.name}")
        for quantity in ("deformation", "force") if own.force is not None else ():
            x = getattr(full, quantity)[rows]
            same(getattr(own, quantity), x, f"recorded {quantity} of springs of {own.name}")
    rows = rows_of(part.multiplier_times, whole.multiplier_times)
    same(part.multipliers, whole.multipliers[rows], "recorded multipliers")
    same(part.velocity_jump, whole.velocity_jump[rows], "recorded jumps")
    if part.energy:
        rows = rows_of(part.energy.t, whole.energy.t)
        for quantity in ("kinetic", "strain", "dissipated", "external", "interface", "balance"):
            x, y = (getattr(h.energy, quantity) for h in (part, whole))
            same(x, y[rows], quantity)


# ---- calls -----------------------------------------------------------------------------------

SEEDS, STEPS = st.integers(0, 2**20), st.integers(0, 8)
THREADS, FLAG = st.integers(1, 4), st.booleans()
# the number of the call that raises, and whether by Ctrl-C
FUSES = st.none() | st.tuples(st.integers(1, 30), FLAG) | st.tuples(st.integers(1, 9), FLAG)
RECORDED = st.fixed_dictionaries(
    {}, optional={"every": st.integers(1, 3), "energy": st.just(True), "record": st.booleans()}
)


# What has a memory outside of the coupler, or is compared in pieces of its own.
NO_TWIN = (
    *("contact", "contact with friction", "contact of coincident nodes", "obstacle"),
    *("moving obstacle", "external specimen", "controller", "compiled load"),
)


def fused(given, around):
    """Arguments of a subdomain whose functions are burned down by a fuse."""
    for what in ("force", "restoring", "internal"):
        if what in given and callable(given[what]) and type(given[what]).__name__ == "function":
            given = given | {what: around(given[what], f"{what} of {given['name']}")}
    return given


class Histories(stateful.RuleBasedStateMachine):
    """A coupler, its twin, and what was kept of both."""

    @stateful.initialize(seed=SEEDS, threads=THREADS)
    def begin(self, seed, threads):
        self.problem = relations.drawn(seed, without=NO_TWIN)
        hypothesis.note(self.problem.program)
        try:
            self.make_anew(threads)
        except (TypeError, ValueError, pm.PmalphaError):  # what does not go together
            hypothesis.reject()
        self.parts = self.coupler.subdomains
        self.springs = with_springs(self.parts)
        self.twin = Twin(self.make)
        self.kept = []

    def make(self, fuse=None, threads=1):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            around = (fuse or Fuse()).around
            return self.problem.couple(lambda given: fused(given, around), threads=threads)

    def make_anew(self, threads):
        self.fuse = Fuse()
        self.coupler = self.make(self.fuse, threads)

    def path(self, ending="h5"):
        if not hasattr(self, "folder"):
            self.folder, self.files = tempfile.TemporaryDirectory(), count()
        return Path(self.folder.name, f"{next(self.files)}.{ending}")

    def teardown(self):
        if hasattr(self, "folder"):
            self.folder.cleanup()

    def disturbed(self, fuse, call):
        """The result of a call, or the exception that ended it."""
        self.fuse.left, self.fuse.by_signal = fuse or (0, False)
        try:
            return call()
        except (Stop, KeyboardInterrupt, pm.PmalphaError) as error:
            hypothesis.event(type(error).__name__)
            return error
        finally:
            self.fuse.left = 0

    def advanced(self, steps, history=None, failure=None, all_reported=False):
        """The twin follows; what was recorded and the error of a problem are its own too.

        all_reported: whether `progress` was called after the last step, and may have raised then.
        """
        done = self.coupler.step_count - self.twin.branch.steps
        assert done == steps if failure is None or all_reported else done < max(steps, 1)
        energy = history is not None and bool(history.energy)
        springs = {name: None for name in self.springs} or None
        whole = self.twin.then("run", steps=done, energy=energy, record_springs=springs)
        if history is not None:
            compare_histories(history, whole)
        if isinstance(failure, pm.PmalphaError) and not isinstance(failure, pm.CallbackError):
            kept = self.twin.coupler.snapshot()
            with np.testing.assert_raises(type(failure)):
                self.twin.coupler.step()
            self.twin.coupler.restore(kept)

    def options(self, given):
        names = [p.name for p in self.parts]
        options = given | {"record_springs": {name: None for name in self.springs}}
        if "record" in given:  # of every second subdomain, or of none
            options["record"] = {name: [0] for name in names[:: 2 if given["record"] else 9][1:]}
            options["record_springs"] = None
        return options

    @stateful.rule(
        steps=STEPS, given=RECORDED, to_file=st.booleans(), stops=st.booleans(), fuse=FUSES
    )
    def run(self, steps, given, to_file, stops, fuse):
        """In memory or into a file; `stops`: progress may raise too."""
        options, reports = self.options(given), []

        def progress(done, total):
            reports.append(done)
            self.fuse("progress")

        if stops:
            options["progress"] = progress
        if to_file and HDF5:
            options["record_to"] = self.path()
        result = self.disturbed(fuse, lambda: self.coupler.run(steps=steps, **options))
        failed = isinstance(result, BaseException)
        history = self.coupler.last_history if failed else result
        assert failed or self.coupler.last_history is None
        self.advanced(steps, history, result if failed else None, steps in reports)
        if history is not None and "record_to" in options:
            self.compare_file(options["record_to"], history)

    def compare_file(self, path, history):
        """A file holds what the History of its run has, also after an exception."""
        compare_histories(pm.History.load(path), history)
        compare_histories(history, pm.History.load(path))

    @stateful.rule(every=st.none() | st.integers(1, 3), undone=FLAG)
    @stateful.precondition(lambda self: HDF5)
    def append(self, every, undone):
        """Two runs into one file, with what may happen between them; of one run without a pause."""
        path, options = self.path(), {"every": every}
        kept = self.coupler.snapshot()
        whole = self.disturbed(None, lambda: self.coupler.run(steps=5, **options))
        self.coupler.restore(kept)
        if isinstance(whole, BaseException):
            return
        self.coupler.run(steps=3, record_to=path, **options)
        if undone:  # rows that were written after the state that is restored
            after = self.coupler.snapshot()
            self.coupler.run(steps=2, record_to=path, append=True, **options)
            self.coupler.restore(after)
        self.coupler.run(steps=2, record_to=path, append=True, **options)
        self.compare_file(path, whole)
        self.advanced(5)

    @stateful.rule(steps=STEPS, fuse=FUSES)
    def step(self, steps, fuse):
        self.disturbed(None, lambda: self.coupler.state(0))  # the forces at the present time
        before = self.fuse.calls.copy()
        result = self.disturbed(fuse, lambda: self.coupler.step(steps))
        self.advanced(steps, failure=result)
        if result is not None or self.twin.branch.changed:
            return
        for p in self.parts:  # each force once in a substep
            what = f"restoring of {p.name}"
            if self.fuse.calls[what]:
                assert self.fuse.calls[what] - before[what] == steps * p.substeps, what

    @stateful.rule(seed=st.none() | SEEDS)
    def reset(self, seed):
        values, (p, *_) = {}, self.parts
        if seed is not None:
            values["force"] = {p.name: loads(p, seed)[0]}
        self.coupler.reset(**values)
        self.twin.at(Branch(values))

    def keep(self):
        """The snapshot of another coupler is refused, also one of the same problem."""
        with np.testing.assert_raises(ValueError):
            self.coupler.restore(self.twin.coupler.snapshot())
        path = self.path("npz")
        self.kept.append((self.coupler, self.coupler.snapshot(), path, self.twin.branch))
        self.coupler.save(path)

    @stateful.rule(index=st.integers(0, 3), from_file=FLAG, threads=st.none() | THREADS)
    def go_back(self, index, from_file, threads):
        """In the same coupler, or in a new one with another number of threads."""
        if index >= len(self.kept):
            self.keep()
            return
        of, snapshot, path, branch = self.kept[index]
        if threads is not None:
            self.make_anew(threads)
        if of is self.coupler and not from_file:
            self.coupler.restore(snapshot)
        else:
            # the loads are part of the problem
            if branch.reset is not None or self.twin.branch.reset is not None:
                self.coupler.reset(**branch.reset or {})
            self.coupler.load(path)
        self.twin.at(branch)

    @stateful.rule(factor=st.sampled_from([1.0, 0.8, 0.5]), finer=st.sets(st.integers(1, 3)))
    def change_steps(self, factor, finer):
        members = self.parts
        finest = max(p.substeps for p in members)
        values = {p.name: finest for i, p in enumerate(members) if i in finer}
        values = {"dt": factor * TIME_STEP, "substeps": values}
        try:
            self.coupler.change_steps(**values)
        except ValueError:  # double steps everywhere, for example
            return
        self.twin.then("change_steps", **values)

    @stateful.rule()
    @stateful.precondition(lambda self: self.coupler.coupling == "gc")
    def tolerance(self):
        kept, values = self.coupler.snapshot(), {"steps": 3, "tolerance": 0.02}
        try:
            history = self.coupler.run(**values)
        except (ValueError, pm.PmalphaError):
            self.coupler.restore(kept)
            return
        compare_histories(history, self.twin.then("run", **values))

    @stateful.rule(count=st.sampled_from([2, 9]), seed=SEEDS, given=RECORDED, fuse=FUSES)
    def run_each(self, count, seed, given, fuse):
        """Of new values on the coupler, which stays as it is, and of single runs."""
        cases, options = self.cases(count, seed), self.options(given)
        result = self.disturbed(fuse, lambda: self.coupler.run_each(cases, steps=4, **options))
        if isinstance(result, BaseException):
            return
        springs = {name: None for name in self.springs}
        for case, history in zip(cases, result):
            alone = self.make()
            alone.reset(**case)
            energy = bool(history.energy)
            compare_histories(history, alone.run(steps=4, energy=energy, record_springs=springs))

    def cases(self, count, seed):
        """One, some, or more than the core has lanes; their loads of any kind."""
        first = self.parts[0]
        return [{"force": {first.name: load}} for load in loads(first, seed, count)]

    @stateful.rule(count=st.sampled_from([1, 2, 9]), seed=SEEDS, together=st.integers(1, 4))
    @stateful.precondition(lambda self: HDF5)
    def study(self, count, seed, together):
        """Several cases into one file; rows of cases that fail are NaN and have the error."""
        import h5py

        cases, name, path = self.cases(count, seed), self.parts[0].name, self.path()

        def result(history):
            return {"u": history[name].u, "end": history.macro_times[-1]}

        found = pm.Study(self.make, steps=4, together=together, result=result).run(
            cases, save_to=path
        )
        with h5py.File(path) as file:
            for k, (case, one) in enumerate(zip(cases, found, strict=True)):
                alone = self.make()
                try:
                    alone.reset(**case)
                    expected = alone.run(steps=4)
                except pm.PmalphaError as error:
                    assert type(one.error) is type(error)
                    assert file["error"][k].decode().startswith(type(error).__name__)
                    continue
                assert one.error is None and file["error"][k] == b""
                same(file["u"][k], expected[name].u, "u of a study")
                assert file["end"][k] == expected.macro_times[-1]

    @stateful.invariant()
    def states_agree(self):
        compare_states(self.coupler, self.twin.coupler, self.springs)


def loads(member, seed, number=1):
    """Functions, samples and constants, of dofs with mass."""
    rng = np.random.default_rng(seed)
    moving = np.ones(member.n, bool)
    moving[member.massless] = False
    kinds = rng.integers(4, size=number)
    shapes = rng.normal(size=(number, member.n)) * moving
    return [
        (lambda t, shape=shape: shape * np.cos(t))
        if kind == 0
        else pm.SampledForce(rng.normal(size=7), 0.03, shape=shape)
        if kind == 1
        else shape
        for kind, shape in zip(kinds, shapes)
    ]


SETTINGS = hypothesis.settings(
    max_examples=3,
    stateful_step_count=12,
    derandomize=True,
    database=None,
    report_multiple_bugs=False,
    deadline=None,
    suppress_health_check=list(hypothesis.HealthCheck),
)


def attempt(seed, counts):
    """Other histories than those of the test."""
    tried = hypothesis.seed(seed)(type("Histories", (Histories,), {}))
    settings = hypothesis.settings(SETTINGS, derandomize=False, max_examples=20)
    stateful.run_state_machine_as_test(tried, settings=settings)
    counts["histories of up to 12 calls"] += 20


@pytest.mark.gate
def test_any_history_of_calls_leaves_the_state_of_the_steps_that_were_completed():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stateful.run_state_machine_as_test(Histories, settings=SETTINGS)
