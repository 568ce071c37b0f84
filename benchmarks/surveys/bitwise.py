"""Random problems and a checksum of each result: are two versions bitwise identical?

    export PYTHONPATH=tests
    python benchmarks/surveys/bitwise.py 1000 > before.txt   # with one version installed
    python benchmarks/surveys/bitwise.py 1000 > after.txt    # with the other
    diff before.txt after.txt

A line is the seed, what was drawn, and a SHA-256 of every array, error and call of the user's
functions. Only what users may call is called, so one script serves both versions. Not a test: it
shows that two versions differ, not which one is right. `1 --first SEED --detail` prints a checksum
for each array of one problem, to find the first that differs. One problem in three is repeated with
another number of threads, and marked if that makes a difference.
"""

import argparse
import hashlib
import tempfile
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import wholes

import pmalpha as pm

# Cells of plates and solids that are tied by their faces.
SHAPES = [(2, 40), (10, 30), (30, 30), (25, 8), (1, 7, 7), (2, 8, 8), (3, 5, 5), (8, 8, 8)]
SCHEMES = [*wholes.IMPLICIT, *wholes.EXPLICIT, pm.GeneralizedAlpha(0.9, explicit=True)]


class Stop(Exception):
    """Raised by a function of the user's at a chosen call."""


class Seen:
    """A checksum of the arguments of all functions of a coupler, one of which may raise."""

    def __init__(self):
        self.digests, self.fails_in, self.error, self.which = {}, None, Stop, ""

    def around(self, function, what):
        seen = self.digests.setdefault(what, hashlib.sha256())

        def called(*values):
            for x in values[:3]:
                seen.update(np.asarray(x, dtype=float).tobytes())
            if self.fails_in is not None and what == self.which:
                self.fails_in -= 1
                if self.fails_in < 0:
                    raise self.error
            return function(*values)

        return called


# ---- what is drawn ------------------------------------------------------------------------------


def one_of(rng, items):
    return items[int(rng.integers(len(items)))]


def as_given(A):
    return A


def large(seed, rng):
    """Plates or solids in a row, tied by their faces."""
    shape, count = one_of(rng, SHAPES), int(rng.choice([1, 2, 3, 3, 4]))
    make = pm.structures.plate if len(shape) == 2 else pm.structures.solid
    fine, members, faces, base = int(rng.choice([1, 2, 4])), [], [], 0
    for i in range(count):
        origin = (float(i * shape[0]), *[0.0] * (len(shape) - 1))
        mass = one_of(rng, ["lumped", "consistent"])
        made = make(*shape, 1.0, origin=origin, E=4.0, nu=0.3, rho=1.0, mass=mass)
        K = sp.csr_array(made.K + 0.01 * sp.eye_array(made.n))
        C = sp.csr_array(0.003 * K) if rng.random() < 0.5 else None
        zero, samples = np.zeros(made.n), rng.normal(size=9)
        kind = one_of(rng, ["none", "constant", "called", "sampled"])
        load = wholes.Load(kind, rng.normal(size=made.n), 3.0, samples, 0.07)
        scheme, steps = one_of(rng, SCHEMES), fine if i == 0 else int(rng.choice([1, fine]))
        forms = 3 * (as_given,)
        member = wholes.Member(f"s{i}", made.M, K, C, scheme, steps, False, forms, load, zero, zero)
        members.append(replace(member, lagged=C is not None and rng.random() < 0.4))
        x = made.points[:, 0] - origin[0]
        faces.append([base + made.dofs(np.flatnonzero(np.isclose(x, k))) for k in (0, shape[0])])
        base += made.n
    ties = [pair for i in range(count - 1) for pair in zip(faces[i][1], faces[i + 1][0])]
    rows, columns = np.repeat(np.arange(len(ties)), 2), np.ravel(ties).astype(int)
    L = sp.csr_array((np.resize([1.0, -1.0], columns.size), (rows, columns)), (len(ties), base))
    coupling = one_of(rng, ["pm", "pm", "gc", "macro"])
    return wholes.Whole(tuple(members), L, 0.05, coupling, "rebased")


def lengthened(whole, n, rng):
    """Its first subdomain is an explicit chain of n dofs."""
    first, *others = whole.members
    diagonals = [-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)]
    K = sp.csr_array(sp.diags_array(diagonals, offsets=[-1, 0, 1]))
    u0, v0, direction = (
        np.pad(x, (0, n - first.n)) for x in (first.u0, first.v0, np.ones(first.n))
    )
    load = replace(first.load, direction=direction)
    if load.kind == "base":
        load = replace(load, kind="sampled")
    mass, forms = rng.uniform(1.0, 2.0, n), 3 * (as_given,)
    chain = wholes.Member(
        first.name, mass, K, None, pm.GeneralizedAlpha(0.5, explicit=True), first.substeps,
        first.double, forms, load, u0, v0,
    )  # fmt: skip
    columns = [sp.csr_array(L) for L in whole.columns]
    columns[0].resize((len(whole.L), n))
    return replace(whole, members=(chain, *others), L=sp.csr_array(sp.hstack(columns)))


class Problem:
    """All that a seed draws; every coupler of it has functions of its own."""

    def __init__(self, seed):
        self.seed = seed
        rng = np.random.default_rng([seed, 20])
        self.threads, self.unstable = int(rng.integers(1, 5)), "stable"
        size = str(rng.choice(["small", "large", "long"], p=[0.83, 0.15, 0.02]))
        if seed % 500 == 77:
            size = "longest"
        self.long = size.startswith("long")
        if size == "large":
            self.whole = large(seed, rng)
        elif self.long:
            n = 250_000 if size == "longest" else int(rng.integers(15_000, 40_000))
            turn = one_of(rng, [0, 1, 2])  # "pm", "gc", "macro"
            drawn = wholes.drawn(len(wholes.COUPLINGS) * seed + turn)
            self.whole = lengthened(drawn, n, rng)
        else:
            self.whole = wholes.varied(seed)
            self.draw_instability(rng)
        few = size != "small"
        verbs = ["run", "run", "step", "save", "reset", "stop", "stop"]
        self.pieces = [("run", int(rng.integers(1, 5 if few else 15)))]
        for _ in range(int(rng.integers(1, 3 if few else 5))):
            self.pieces.append((one_of(rng, verbs), int(rng.integers(1, 4 if few else 10))))
        self.size = size

    def draw_instability(self, rng):
        """An explicit subdomain far above its critical step, or a load beyond all numbers."""
        word, first = one_of(rng, ["stable"] * 12 + ["step", "load"]), self.whole.members[0]
        if word == "step" and first.scheme.explicit:
            first = replace(first, K=first.K * 1e20)
        elif word == "load" and np.all(np.diag(first.M) > 0.0):
            first = replace(first, load=replace(first.load, kind="sampled"))
            late = np.where(np.arange(40) < 5, 0.0, 1e300)
            first = replace(first, load=replace(first.load, samples=late))
        else:
            return
        self.unstable = word
        self.whole = replace(self.whole, members=(first, *self.whole.members[1:]))

    @property
    def words(self):
        whole = self.whole
        moved = "" if whole.g is None else ", moved by samples" if whole.sampled else ", moved"
        members = " | ".join(" ".join(words_of(p)) for p in whole.members)
        pieces = " ".join(f"{verb}:{n}" for verb, n in self.pieces)
        options = f"{self.size} {self.unstable} {whole.coupling} {whole.start}"
        rows = whole.L.shape[0]
        return f"{options} threads={self.threads}; {members}; {rows} rows{moved}; {pieces}"


def words_of(p):
    words = [repr(p.scheme), f"{p.n}/{p.substeps}" + "D" * p.double, f"f:{p.load.kind}"]
    words += [f"{p.role}:{s.law}" for s in p.springs] + [f"{p.role}:function"] * bool(p.function)
    flags = ("compiled", "lagged", "estimated")
    return words + ["damped"] * (p.C is not None) + [x for x in flags if getattr(p, x)]


# ---- what is done with it -----------------------------------------------------------------------


class Play:
    """Does the pieces with couplers of a problem, and keeps a checksum of all that is seen."""

    def __init__(self, problem, threads, folder, detail=None):
        self.problem, self.threads, self.folder = problem, threads, folder
        self.detail, self.digest = detail, hashlib.sha256()
        self.rng = np.random.default_rng([problem.seed, 22])
        self.stopped, self.forced, self.all_functions = False, None, []
        self.members = problem.whole.members
        self.springs = [p.name for p in self.members if p.springs and p.role == "restoring"]
        self.done = {verb for verb, _ in problem.pieces}  # for the counts alone

    def see(self, label, value):
        data = value.encode() if isinstance(value, str) else np.ascontiguousarray(value).tobytes()
        shape = "" if isinstance(value, str) else f"{value.dtype}{value.shape}"
        self.digest.update(f"{label} {shape} {len(data)} ".encode() + data)
        if self.detail is not None:
            word = value if isinstance(value, str) else hashlib.sha256(data).hexdigest()[:16]
            self.detail.append(f"{label} {shape} {word}")

    def all(self):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            if self.attempt("make", self.make):
                for i, (verb, steps) in enumerate(self.problem.pieces):
                    self.attempt(f"{i} {verb}", getattr(self, verb), steps)
                    self.attempt(f"{i} present", self.see_present)
        given = [w.category for w in caught if w.category.__module__.startswith("pmalpha")]
        self.see("warnings", " ".join(sorted({x.__name__ for x in given})))
        if not self.stopped:  # how many were evaluated before a stop depends on the threads
            for k, functions in enumerate(self.all_functions):
                for what, digest in functions.digests.items():
                    self.see(f"calls {k} {what}", digest.hexdigest())
        return self.digest.hexdigest()

    def attempt(self, label, do, *args):
        """Whether it went well; else the error is seen."""
        try:
            do(*args)
            return True
        except (pm.PmalphaError, ValueError, Stop, KeyboardInterrupt) as error:
            self.stopped = True
            names = ("step", "time", "subdomain", "code", "dof", "inertia")
            told = [f"{x}={getattr(error, x)!r}" for x in names if hasattr(error, x)]
            self.see(f"{label} error", f"{type(error).__name__} {' '.join(told)}")
            self.done.add(f"{label.split()[-1]} {type(error).__name__}")
            return False

    def make(self):
        self.functions = Seen()
        self.all_functions.append(self.functions)
        self.coupler = self.problem.whole.coupler(self.threads, self.functions.around)

    def see_present(self):
        self.see("step count", np.array(self.coupler.step_count))
        for p in self.members:
            state = self.coupler.state(p.name)
            for name in "uva":
                self.see(f"state {p.name}.{name}", getattr(state, name))
        for name in self.springs:
            springs = self.coupler.springs(name)
            self.see(f"springs {name}.d", springs.deformation)
            self.see(f"springs {name}.f", springs.force)
        self.see("multipliers", self.coupler.multipliers)

    def see_history(self, history):
        for i, own in enumerate(history.subdomains):
            for name in ("t", "u", "v", "a", "dofs", "deformation", "force", "springs"):
                value = None if own is None else getattr(own, name)
                self.see(f"{i}.{name}", "none" if value is None else value)
        for name in ("multipliers", "multiplier_times", "velocity_jump", "displacement_jump"):
            self.see(name, getattr(history, name))
        self.see("macro times", history.macro_times)
        energies = ("kinetic", "strain", "dissipated", "external", "interface", "balance")
        for name in energies if history.energy else ():
            self.see(f"energy.{name}", getattr(history.energy, name))

    def record(self):
        """Everything, or some dofs of some subdomains; all that a run takes besides."""
        rng, options = self.rng, {"every": one_of(self.rng, [None, None, 1, 2, 3])}
        if self.problem.long or rng.random() < 0.3:
            options["record"] = {
                p.name: np.sort(rng.choice(p.n, min(p.n, 3), replace=False))
                for p in self.members
                if rng.random() < 0.8
            }
        recorded = [x for x in self.springs if x in options.get("record", self.springs)]
        if recorded and rng.random() < 0.7:
            options["record_springs"] = {x: None for x in recorded}
        energy = rng.random() < 0.35 and self.problem.whole.coupling != "mean"
        # works summed up in an aborted macro step are no matter of this comparison
        return options | {"energy": bool(energy and self.problem.unstable == "stable")}

    def run(self, steps, **others):
        options = self.record() | others
        self.done |= {key for key, value in options.items() if value}
        try:
            self.see_history(self.coupler.run(steps=steps, **options))
        except BaseException:
            if self.coupler.last_history is not None:
                self.see_history(self.coupler.last_history)
            raise

    def step(self, steps):
        self.coupler.step(steps)

    def save(self, steps):
        """Goes on in another coupler."""
        path = self.folder / "state.npz"
        self.coupler.save(path)
        self.make()
        self.coupler.step(1)
        if self.forced is not None:
            self.coupler.reset(force=self.forced)
        self.coupler.load(path)
        self.see_present()

    def reset(self, steps):
        """With other initial values, which satisfy the constraints, and another load."""
        factor, p = float(self.rng.normal()), one_of(self.rng, self.members)
        values = {x: {q.name: factor * getattr(q, x) for q in self.members} for x in ("u0", "v0")}
        shape = self.rng.normal(size=p.n) * np.where(p.load.direction == 0.0, 0.0, 1.0)
        load = pm.SampledForce(self.rng.normal(size=7), 0.08, shape=shape)
        self.forced = {p.name: one_of(self.rng, [shape, load])}
        self.coupler.reset(**values, force=self.forced)
        self.run(steps)

    def stop(self, steps):
        """A function fails at some evaluation, the run ends there, and goes on."""
        seen, count = self.functions, int(self.rng.integers(12))
        interrupts, which = self.rng.random() < 0.3, self.rng.random()
        if seen.digests:
            seen.which = list(seen.digests)[int(which * len(seen.digests))]
            seen.fails_in, seen.error = count, KeyboardInterrupt if interrupts else Stop
            self.attempt("stopped", lambda: self.run(steps, energy=False))
            seen.fails_in = None
            self.see_present()
        self.run(steps)


def line(seed, folder):
    problem = Problem(seed)
    digest = Play(problem, problem.threads, folder).all()
    mark = ""
    if seed % 3 == 0:
        other = 1 if problem.threads > 1 else 3
        if Play(problem, other, folder).all() != digest:
            mark = "  THREADS DIFFER"
    return f"{seed} {problem.words} {digest}{mark}"


# ---- the command --------------------------------------------------------------------------------


def features(seed, folder):
    """What is drawn and done for a seed, as words."""
    problem = Problem(seed)
    play = Play(problem, problem.threads, folder)
    play.all()
    words = {word for p in problem.whole.members for word in words_of(p) if "/" not in word}
    options = {problem.size, problem.unstable, problem.whole.coupling, problem.whole.start}
    return words | options | play.done


def main():
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("number", type=int, nargs="?", default=100, help="of problems")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--detail", action="store_true", help="a line for each array")
    parser.add_argument("--count", action="store_true", help="only count what the seeds draw")
    options = parser.parse_args()
    seeds, counts = range(options.first, options.first + options.number), Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            if options.count:
                counts.update(features(seed, Path(folder)))
                continue
            print(line(seed, Path(folder)), flush=True)
            if options.detail:
                problem, seen = Problem(seed), []
                Play(problem, problem.threads, Path(folder), seen).all()
                print(*(f"    {entry}" for entry in seen), sep="\n")
    for word in sorted(counts):
        print(f"{counts[word]:6} {word}")


if __name__ == "__main__":
    main()
