"""Relations between runs of random problems (problems.py) that hold whatever the numbers.

Each relation is a function of a `Run`. It ends in runs that are equal, or in a refusal by name:
an error that the package raises in words of its own; `attempt` lets nothing else pass. Runs that
make the same operations are bitwise identical, also in other units, which are powers of two. Dofs
in another order and a structure uncut agree to rounding: a problem is run with all its numbers
changed by parts of `SHIFT`, and what that changes, per part, is what rounding may change.
test_relations.py tries a few problems, campaign_relations.py any number.
"""

import copy
import pickle
import tempfile
import traceback
import warnings
import zipfile
from collections import Counter
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from c_models import OK, Library
from fmus import Instance
from frozen_couplers import all_outputs, recorded
from frozen_inputs import Inputs
from problems import SHIFT, STEPS, TIME_STEP, draw, shrunk

import pmalpha as pm

ROOT = str(Path(pm.__file__).parent)
# relative errors of the operations of a run, that are magnified like changes of its numbers; with
# iterated forces those of their tolerance
ROUNDING, ITERATED = 200.0 * np.finfo(float).eps, 1e-9
WILD = 1e6  # a spread beyond it is an unstable problem, or one near a stop of a spring
RELATIONS = {}


def relation(function):
    RELATIONS[function.__name__] = function
    return function


# ---- runs and their comparison ------------------------------------------------------------------


class Run:
    """A problem, its coupler, and what a run records; random numbers of a relation."""

    def __init__(self, problem):
        self.problem, self.recording = problem, None
        self.coupler = problem.couple(threads=1)
        self.recording = problem.recording()
        self.history = self.coupler.run(steps=STEPS, **self.recording)
        self.results = results_of(self.history)

    def begin(self, name):
        """Random numbers of a relation of this name, whatever was tried before."""
        self.rng = np.random.default_rng([self.problem.seed, *name.encode()])
        self.coupler.reset()

    def run(self, problem=None, steps=STEPS, **options):
        """The results of another coupler of the problem, with other options of Coupler."""
        coupler = (problem or self.problem).couple(**options)
        return results_of(coupler.run(steps=steps, **self.recording))

    def equal(self, words, results, like=None):
        require_equal(words, self.results if like is None else like, results)

    @cached_property
    def whole(self):
        """The results without what ends a run or chooses its steps."""
        recording = once(self.recording)
        if recording == self.recording:
            return self.results
        return results_of(self.problem.couple().run(steps=STEPS, **recording))

    @cached_property
    def spread(self):
        """By quantity what rounding may change, for a part 1 of all numbers."""
        sizes, factors = Counter(), Counter()
        for k in range(2):
            other = self.run(self.problem.written(shift=k))
            for key, x in self.results.items():
                sizes[key[0]] = max(sizes[key[0]], float(np.max(np.abs(x), initial=0.0)))
                off = float(np.max(np.abs(other[key] - x), initial=0.0)) / SHIFT
                factors[key[0]] = max(factors[key[0]], off)
        h = TIME_STEP / max(self.problem.sketch.fine, 1)
        # masses are near 1; where all is held, the motion is rounding of the forces
        sizes["u"] = max(sizes["u"], h**2 * sizes["multipliers"])
        sizes["v"] = max(sizes["v"], sizes["u"], h * sizes["multipliers"])
        sizes["a"] = max(sizes["a"], sizes["v"] / h)
        force = max(sizes["a"] * 3.0, sizes["multipliers"])
        sizes["multipliers"] = sizes["impulse"] = sizes["force"] = force
        unit = ITERATED if "internal" in self.problem.setup else ROUNDING
        return {q: unit * (factors[q] + 20.0 * sizes[q]) for q in sizes}, max(
            factors[q] / max(sizes[q], 1e-9) for q in "uv"
        )


def results_of(history):
    """Arrays by (quantity, subdomain)."""
    names = "t u v a deformation force iterations q rig_command rig_sent rig_measured rig_force"
    found = {}
    for s in history.subdomains:
        if s is None:
            continue
        found |= {(q, s.name): getattr(s, q) for q in names.split()}
        found |= {(f"output {key}", s.name): x for key, x in s.outputs.items()}
    for q in ("multipliers", "multiplier_times", "velocity_jump", "displacement_jump"):
        found[q, "interface"] = getattr(history, q)
    if isinstance(history.energy, object) and hasattr(history.energy, "kinetic"):
        found |= {(f"energy {key}", ""): x for key, x in history.energy.arrays().items()}
    if history.contact_layout:
        for c in history.contacts:
            found |= {(q, c.name): getattr(c, q) for q in ("impulse", "friction", "gap")}
    return {key: np.asarray(x) for key, x in found.items() if x is not None}


def require_equal(words, one, two, bounds=None):
    """AssertionError with the place of the largest difference."""
    assert one.keys() == two.keys(), f"{words}: {sorted(one.keys() ^ two.keys())} are not in both"
    for key, x in one.items():
        y, bound = two[key], 0.0 if bounds is None else bounds.get(key[0], np.inf)
        assert x.shape == y.shape, f"{words}: {key} is {y.shape}, not {x.shape}"
        if x.size == 0 or np.array_equal(x, y, equal_nan=True):
            continue
        off = np.abs(y - x)
        if np.all(off <= bound):
            continue
        place = np.unravel_index(np.nanargmax(np.where(np.isnan(off), np.inf, off)), off.shape)
        raise AssertionError(
            f"{words}: {key[0]} of {key[1] or 'the energies'} at {tuple(map(int, place))} is "
            f"{y[place]!r} instead of {x[place]!r}: {off[place]:.2g} apart, {bound:.2g} allowed, "
            f"largest number {np.nanmax(np.abs(x)):.2g}"
        )


def states(coupler):
    """The present of all subdomains."""
    found = {("multipliers", ""): coupler.multipliers}
    for s in coupler.subdomains:
        state = coupler.state(s.name)
        found |= {(q, s.name): getattr(state, q) for q in "uva"}
    return found


def ends(coupler, done=0):
    """The state after the rest of the steps."""
    coupler.step(STEPS - done)
    return states(coupler)


# ---- in pieces, saved, copied -------------------------------------------------------------------


@relation
def pieces(r):
    """Steps, runs and resets in any pieces end in the state of one run."""
    k = int(r.rng.integers(1, STEPS))
    whole = ends(r.problem.couple())
    coupler = r.problem.couple()
    coupler.run(steps=k, energy=True)
    r.equal(f"{k} macro steps in a run, then steps", ends(coupler, k), whole)
    coupler.reset()
    r.equal("after a reset", ends(coupler), whole)
    coupler.reset()
    parts = [coupler.run(steps=n, **once(r.recording)) for n in (k, STEPS - k)]
    if "every" not in r.recording and "energy" not in r.recording:
        r.equal("two runs, joined", results_of(pm.History.join(parts)), r.whole)


def once(recording):
    """How to record a piece of a run."""
    return {key: x for key, x in recording.items() if key not in ("until", "tolerance")}


@relation
def saved(r):
    """A checkpoint and a snapshot go on as the run that they are of."""
    k = int(r.rng.integers(1, STEPS))
    coupler = r.problem.couple()
    coupler.step(k)
    snapshot = coupler.snapshot()
    with tempfile.TemporaryDirectory() as folder:
        coupler.save(Path(folder, "state.npz"))
        whole = ends(coupler, k)
        other = r.problem.couple(threads=2)
        other.load(Path(folder, "state.npz"))
    r.equal("from a checkpoint", ends(other, k), whole)
    coupler.restore(snapshot)
    r.equal("from a snapshot", ends(coupler, k), whole)


@relation
def copied(r):
    """Copies of subdomains and constraints, and pickled ones, make the same coupler."""
    space = r.problem.space
    pair = space["parts"], space["ties"]
    for words, change in (("copied", copy.deepcopy), ("pickled", pickled)):
        with functions_are_local():
            parts, ties = change(pair)
            coupler = pm.Coupler(parts, ties, **r.problem.options())
            r.equal(words, results_of(coupler.run(steps=STEPS, **r.recording)))


class functions_are_local:
    """A block that functions of a program may end, which no pickle has."""

    def __enter__(self):
        pass

    def __exit__(self, kind, error, trace):
        local = isinstance(error, (AttributeError, pickle.PicklingError, TypeError, ValueError))
        return local and any(x in str(error) for x in ("lambda", "friction", "ctypes", "Capsule"))


def pickled(x):
    return pickle.loads(pickle.dumps(x))


# ---- files and conversions ----------------------------------------------------------------------


@relation
def files(r):
    """A History in a file, written at the end, during the run or appended, is that in memory."""
    k, coupler = int(r.rng.integers(1, STEPS)), r.coupler
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".npz", ".h5"):
            path = Path(folder, "saved" + suffix)
            r.history.save(path)
            r.equal(f"saved as {suffix}", results_of(pm.History.load(path)))
        coupler.reset()
        path = Path(folder, "during.h5")
        coupler.run(steps=STEPS, record_to=path, **r.recording)
        r.equal("recorded to a file", results_of(pm.History.load(path)))
        if "until" in r.recording:
            return
        coupler.reset()
        path = Path(folder, "appended.h5")
        coupler.run(steps=k, record_to=path, **r.recording)
        coupler.run(steps=STEPS - k, record_to=path, append=True, **r.recording)
        r.equal(f"appended after {k}", results_of(pm.History.load(path)))


@relation
def converted(r):
    """xarray, pandas, copies and its own times have the numbers of the History."""
    with functions_are_local():
        r.equal("a deep copy", results_of(copy.deepcopy(r.history)))
    data, frames = r.history.to_xarray(), r.history.to_pandas()
    for s in r.history.subdomains:
        if s is None:
            continue
        for q in "uva":
            x = getattr(s, q)
            assert np.array_equal(data[f"{s.name}_{q}" if f"{s.name}_{q}" in data else q], x), q
        assert len(frames[s.name]) == len(s.t)
        own = s.resampled(s.t)
        r.equal("at its own times", {"u": own.u, "v": own.v}, {"u": s.u, "v": s.v})
        s.to_pandas(), s.to_xarray(), s.peak(), repr(s), s.local_error()
    r.history.peak(), repr(r.history)
    for look in (lambda h: repr(h.resolution()), lambda h: h.corrected_multipliers):
        with refused():
            look(r.history)
    with functions_are_local():
        r.equal("a pickled History", results_of(pickled(r.history)))


# ---- other executors ----------------------------------------------------------------------------


@relation
def threads(r):
    """Any number of threads."""
    for count in (2, 3):
        r.equal(f"{count} threads", r.run(threads=count))


@relation
def paced(r):
    """A run at the pace of a clock."""
    end = STEPS * r.coupler.dt
    coupler = r.problem.couple()
    with_clock = dict(rate=1e4, on_late="continue", **once(r.recording))
    history = coupler.run_paced(end, **with_clock)
    r.equal("paced", results_of(history), r.whole)


@relation
def cases(r):
    """`run_each` and a Study, against `reset` and `run`; and what reduces a History."""
    chosen, coupler = [{}], r.coupler
    for factor in (0.5, -2.0):
        loads = {s.name: factor * loaded(s, r.rng) for s in coupler.subdomains}
        chosen.append({"force": loads})
    recording = {key: x for key, x in once(r.recording).items() if key != "rig"}
    before = states(coupler)
    together = coupler.run_each(chosen, steps=STEPS, **recording)
    r.equal("the coupler after run_each", states(coupler), before)
    peaks = None
    if not recording.get("energy"):
        peaks = coupler.run_each(chosen, steps=STEPS, reduce="peak", **recording)
    for k, case in enumerate(chosen):
        coupler.reset(**case)
        alone = coupler.run(steps=STEPS, **recording)
        r.equal(f"case {k} of run_each", results_of(together[k]), results_of(alone))
        for s in alone.subdomains if peaks is not None else ():
            if s is not None:
                one, all_ = np.max(np.abs(s.u), axis=0, initial=0.0), peaks[s.name].u[k]
                r.equal(f"peak of case {k}", {("u", s.name): all_}, {("u", s.name): one})
    make = lambda: r.problem.couple(threads=1)  # noqa: E731
    study = pm.Study(make, steps=STEPS, result=results_of, **recording)
    for k, result in enumerate(study.run(chosen)):
        r.equal(f"case {k} of a Study", result.value, results_of(together[k]))


def loaded(s, rng):
    """A load on dofs with mass."""
    light = np.zeros(s.n, bool)
    light[s.massless] = True
    return np.where(light, 0.0, rng.normal(size=s.n))


@lru_cache
def library():
    return Library(pm.c_library() / "libpmalpha.so")


@relation
def frozen(r):
    """A frozen model moves as the run."""
    coupler = r.problem.couple()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "model.pma")
        coupler.freeze(path, None, all_outputs(coupler))
        model = library().model(path)
        fine = STEPS * model.substeps()
        rows = [model.values]
        for _ in range(fine):
            status = model.advance(1)
            assert status == OK, model.why
            rows.append(model.values)
    history = coupler.run(steps=STEPS)
    found, right = np.array(rows), recorded(coupler, history, fine)
    r.equal("frozen", {("rows", "outputs"): found}, {("rows", "outputs"): right})


@relation
def frozen_with_inputs(r):
    """Inputs that are set between the steps of a frozen model are functions of a run."""
    done = int(r.rng.choice([0, 0, 2]))
    inputs = Inputs(r.problem, r.rng, done)
    plain, coupler = inputs.coupler(outside=False), inputs.coupler(outside=True)
    plain.state(0)
    if done:
        coupler.step(done)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "model.pma")
        try:
            coupler.freeze(path, inputs.ports, all_outputs(coupler))
        except Exception:
            assert not path.exists(), "frozen: a file in spite of a refusal"
            raise
        model = library().model(path)
    fine, clock = model.substeps(), coupler._session.clock
    rows = [model.values]
    for k in range(done * fine, (done + STEPS) * fine):
        inputs.set(model, lambda lead, k=k: clock.level(k + lead, fine))
        assert model.advance(1) == OK, model.why
        rows.append(model.values)
    right = recorded(plain, plain.run(steps=done + STEPS), (done + STEPS) * fine)[done * fine :]
    found = {("rows", "outputs"): np.array(rows)}
    r.equal("frozen with inputs", found, {("rows", "outputs"): right})


@relation
def fmu(r):
    """An FMU, in a program that knows no other name than FMI's, moves as the run."""
    try:
        import fmpy  # not on every system
    except ImportError:
        return
    coupler = r.problem.couple()
    with tempfile.TemporaryDirectory() as folder:
        path, ports = Path(folder, "x.fmu"), all_outputs(coupler)
        coupler.export_fmu(path, outputs=ports, fmi=str(r.rng.choice(["2.0", "3.0"])))
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        model = Instance(fmpy, path, folder)
        rows = [model.get(*ports)]
        for _ in range(STEPS):
            model.step(coupler.dt)
            rows.append(model.get(*ports))
        model.close()
    right = recorded(coupler, coupler.run(steps=STEPS), STEPS)
    r.equal("FMU", {("rows", "outputs"): np.array(rows)}, {("rows", "outputs"): right})


# ---- what leaves the motion as it is ------------------------------------------------------------


@relation
def observers(r):
    """What is computed beside a run leaves the coupler bitwise as it was."""
    coupler, looks = r.problem.couple(), [repr, lambda c: c._repr_html_()]
    looks += [lambda c: c.modes(1), lambda c: c.assembled(), lambda c: c.static()]
    looks += [lambda c: c.harmonic([1.0], {c.subdomains[0].name: np.ones(c.subdomains[0].n)})]
    looks += [lambda c: c.growth(20), lambda c: [c.springs(s.name) for s in c.subdomains]]
    looks += [lambda c: c.estimate_error(steps=STEPS, halvings=2)]
    looks += [lambda c: c.gradient(pm.Misfit(measured(r)), steps=STEPS)]
    whole = ends(r.problem.couple())
    coupler.step(3)
    before = states(coupler)
    for look in looks:
        with refused():
            look(coupler)
        r.equal("after a look", states(coupler), before)
    coupler.run(steps=1, energy=True, every=1)
    r.equal("observed", ends(coupler, 4), whole)


def measured(r):
    """What a Misfit compares: one dof, at rest."""
    s = r.coupler.run_each([{}], steps=STEPS)[0].subdomains[0]
    return {s.name: dict(dofs=[0], u=np.zeros((len(s.t), 1)))}


class refused:
    """A block that may be refused by name."""

    def __enter__(self):
        pass

    def __exit__(self, kind, error, trace):
        return error is not None and is_refusal(error)


@relation
def steps_and_back(r):
    """Steps that are changed and changed back before the next one change nothing."""
    coupler, dt = r.problem.couple(), r.coupler.dt
    coupler.step(3)
    before = states(coupler)
    coupler.change_steps(dt=dt / 2.0)
    coupler.change_steps(dt=dt)
    r.equal("steps changed back", states(coupler), before)
    coupler.step(2)
    assert np.isclose(coupler.time, 5 * dt)


@relation
def other_steps_between(r):
    """A snapshot, a reset and a checkpoint lead back over a run with other steps."""
    k, rest = int(r.rng.integers(1, STEPS)), int(r.rng.integers(1, 4))
    one, two, whole = r.problem.couple(), r.problem.couple(threads=2), ends(r.problem.couple())
    one.step(k)
    before, dt = one.snapshot(), one.dt
    one.change_steps(dt=dt / 2.0)
    one.run(steps=rest, energy=True)
    one.change_steps(dt=dt)
    with tempfile.TemporaryDirectory() as folder:
        one.save(Path(folder, "state.npz"))
        two.load(Path(folder, "state.npz"))
    one.step(2), two.step(2)
    r.equal("two steps after a change and back, and from a checkpoint", states(two), states(one))
    one.restore(before)
    r.equal("after a snapshot", ends(one, k), whole)
    two.reset()
    r.equal("after a reset", ends(two), whole)


@relation
def records(r):
    """What is recorded has no influence on the motion."""
    name = r.coupler.subdomains[-1].name
    full = results_of(r.problem.couple(threads=2).run(steps=STEPS, energy=True))
    some = r.problem.couple().run(steps=STEPS, record={name: [0]}, every=2)
    one = {("u", name): full["u", name][-1, :1]}
    r.equal("one dof, every second", {("u", name): some[name].u[-1, :1]}, one)
    until = r.problem.couple().run(steps=STEPS, until=lambda now: now.t > 2.5 * r.coupler.dt)
    part = results_of(until)
    r.equal("until", part, {key: full[key][: len(x)] for key, x in part.items()})


# ---- the same problem, written otherwise --------------------------------------------------------


@relation
def units(r):
    """Other units of force, length and time, powers of two."""
    if r.problem.is_unscaled:
        return
    F, L, T = 4.0 ** r.rng.integers(-6, 7, 3)
    other = r.run(r.problem.written(units=(F, L, T)))
    of = {"u": L, "v": L / T, "a": L / T**2, "t": T, "multiplier_times": T, "multipliers": F}
    of |= {"velocity_jump": L / T, "displacement_jump": L, "deformation": L, "gap": L, "force": F}
    of |= {"impulse": F * T, "friction": F * T}
    results = {k: x for k, x in r.results.items() if k[0] in of}
    r.equal("units", {k: other[k] / of[k[0]] for k in results}, results)


@relation
def order(r):
    """Dofs in another order."""
    problem = r.problem.written(order=int(r.rng.integers(1000)))
    bounds, wild = r.spread
    fixed = any(x in r.problem.setup for x in ("noise=1", "arms="))  # by number, not by dof
    if not wild < WILD or r.recording.get("record") is not None or fixed:
        return
    other = r.run(problem)
    for part in problem.sketch.parts:
        if part.tied:
            return
        for q in "uva":
            x = other[q, part.name]
            other[q, part.name] = x[:, [part.dof(i) for i in range(x.shape[1])]]
    keys = [k for k in r.results if k[0] in ("u", "v", "a", "multipliers")]
    require_equal("order", {k: r.results[k] for k in keys}, {k: other[k] for k in keys}, bounds)


@relation
def order_of_subdomains(r):
    """Subdomains and their constraints in another order."""
    bounds, wild = r.spread
    if not wild < WILD:
        return
    r.problem.couple()
    parts, ties = (r.problem.space[key][::-1] for key in ("parts", "ties"))
    coupler = pm.Coupler(parts, ties, **r.problem.options())
    if doubles(coupler) != doubles(r.coupler):  # "pm" takes those of the first implicit ones
        return
    other = results_of(coupler.run(steps=STEPS, **r.recording))
    keys = [k for k in r.results if k[0] in ("u", "v", "a")]
    require_equal(
        "subdomains", {k: r.results[k] for k in keys}, {k: other[k] for k in keys}, bounds
    )


def doubles(coupler):
    return {member.name for member in coupler._session.members if member.double}


import known_relations  # noqa: E402, F401 - which adds its own

# ---- trying -------------------------------------------------------------------------------------

WORDS = ("must", "need", "cannot", "only", "not", "is", "are", "no ")


def is_refusal(error):
    """Whether the package has refused something in its own words.

    Its last line raises it, or it is an error of a run that did not converge or was not stable.
    """
    if isinstance(error, (pm.ConvergenceError, pm.InstabilityError, pm.LimitError)):
        return True
    if not isinstance(error, (TypeError, ValueError, pm.PmalphaError)):
        return False
    last = traceback.extract_tb(error.__traceback__)[-1]
    line = last.line or ""
    return last.filename.startswith(ROOT) and line.startswith("raise")


def attempt(problem, names=tuple(RELATIONS), counts=None):
    """One problem and all relations, or some; AssertionError for what is neither equal nor
    refused by name."""
    counts = Counter() if counts is None else counts
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            run = Run(problem)
        except Exception as error:
            require_refusal("run", error)
            counts["problems refused"] += 1
            return counts
        counts["problems"] += 1
        for name in names:
            try:
                run.begin(name)
                RELATIONS[name](run)
                counts[name] += 1
            except AssertionError:
                raise
            except Exception as error:
                require_refusal(name, error)
                counts[f"{name} refused"] += 1
    return counts


def require_refusal(name, error):
    if not is_refusal(error):
        last = traceback.extract_tb(error.__traceback__)[-1]
        words = f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"
        raise AssertionError(f"{name} is not refused by name, but {words}") from error


def drawn(seed, **chosen):
    return draw(np.random.default_rng([seed, 600]), **chosen)


def reported(problem, names=tuple(RELATIONS)):
    """AssertionError with the program of the smallest problem that fails as this one does."""
    try:
        return attempt(problem, names)
    except AssertionError as error:
        first = str(error)
        name = first.split(":")[0].split(" is not")[0]

    def fails(smaller):
        try:
            attempt(smaller, names)
        except AssertionError as error:
            return str(error).startswith(name[:12])
        return False

    small = shrunk(problem, fails)
    try:
        attempt(small, names)
    except AssertionError as error:
        first = str(error)
    raise AssertionError(f"{first}\n{small.choices} of {small.seed}\n{small.program}") from None
