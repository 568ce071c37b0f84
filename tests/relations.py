"""Relations between runs of random problems (wholes.py) that hold whatever the numbers.

A problem is given in another order, in other units, in another form. Runs that make the same
operations are bitwise identical. Others agree to rounding: every problem is also run with its
numbers changed by parts of `SHIFT`, and what that changes, per part, is what rounding may change
(`Spread`). test_relations.py tries a few problems, campaign_relations.py any number.
"""

import tempfile
import warnings
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from wholes import (
    TOL,
    Linear,
    Springs,
    _at_start,
    _forms,
    _pairs,
    _with_step,
    drawn,
    roles_of,
    spring_matrix,
)

import pmalpha as pm

STEPS = 8
# Relative changes of all numbers of a problem, of which the spread is found.
SHIFT = 2.0**-36
# Relative errors of the operations of a run that are magnified like changes of its numbers: sums of
# some tens of terms. Iterated forces are converged to the tolerance `TOL` of an energy, the passes
# of macro and mean coupling to ten times that in each macro step.
ROUNDING = 200.0 * np.finfo(float).eps
ITERATED = 100.0 * TOL
# A spread beyond this is an unstable problem, or one near a stop of a spring: it shows nothing.
WILD = 1e6


# ---- results and their comparison ---------------------------------------------------------------


def results_of(history):
    """Arrays by (quantity, subdomain)."""
    found = {(q, s.name): getattr(s, q) for s in history.subdomains for q in "tuva"}
    for name in ("multipliers", "velocity_jump", "displacement_jump"):
        found[name, "interface"] = getattr(history, name)
    return found


def computed(whole):
    return results_of(whole.coupler().run(steps=STEPS))


LIKE = {"velocity_jump": "v", "displacement_jump": "u"}


def sizes_of(results, whole, still):
    """The numbers of each quantity whose rounding it has.

    They are its own and those of what is tied, of which a step of length h makes accelerations:
    velocities; displacements where they are tied, and where nothing moves.
    """
    sizes = {}
    for (quantity, _), x in results.items():
        sizes[quantity] = max(sizes.get(quantity, 0.0), float(np.max(np.abs(x), initial=0.0)))
    h = whole.dt / max(p.substeps for p in whole.members)
    if still or whole.coupling == "mean":
        sizes["v"] = max(sizes["v"], sizes["u"] / h)
    sizes["a"] = max(sizes["a"], sizes["v"] / h)
    mass = max(np.max(p.M) for p in whole.members)
    sizes["multipliers"] = max(sizes["multipliers"], mass * sizes["a"])
    row = np.max(np.sum(np.abs(whole.L), axis=1))
    return sizes | {jump: row * sizes[of] for jump, of in LIKE.items()}


def summed(results, whole):
    """The largest sum of |Mbar^-1 L^T| |Lam|: the terms of the accelerations of massless dofs.

    A tied dof without mass moves by its stiffness alone, so that H is badly conditioned, and
    multipliers that are many times what is left of them are added.
    """
    if not any(np.any(np.diag(p.M) == 0.0) for p in whole.members):
        return 0.0
    lam = np.max(np.abs(results["multipliers", "interface"]), axis=0, initial=0.0)
    most = 0.0
    for p, L in zip(whole.members, whole.columns):
        b, gamma = p.scheme.coefficients(whole.dt / p.substeps)[:2]
        C = 0.0 if p.C is None else p.C
        Mbar = p.M + (0.0 if p.scheme.explicit else gamma * C + b * p.K)
        most = max(most, float(np.max(np.abs(np.linalg.solve(Mbar, L.T)) @ lam, initial=0.0)))
    return most


class Spread:
    """How much results of a problem may differ where the operations of a run are others."""

    def __init__(self, whole, results, rng, still=False):
        self.sizes = sizes_of(results, whole, still)
        self.unit = ROUNDING + ITERATED * whole.is_iterated
        self.summed = summed(results, whole)
        self.factors = {quantity: 10.0 for quantity in self.sizes}
        for _ in range(2):
            other = computed(shifted(whole, rng))
            for (quantity, name), x in results.items():
                size = SHIFT * max(self.sizes[quantity], 1e-300)
                off = float(np.max(np.abs(other[quantity, name] - x), initial=0.0)) / size
                self.factors[quantity] = max(self.factors[quantity], off)

    @property
    def is_wild(self):
        return not max(self.factors[quantity] for quantity in "uv") < WILD

    def bound(self, quantity, factor):
        # one rounding of the sum, which is smaller than its terms
        sums = np.finfo(float).eps * self.summed if quantity == "a" else 0.0
        return factor * (self.unit * self.factors[quantity] * self.sizes[quantity] + sums)


def require_equal(relation, one, two, spread=None, factor=1.0):
    """AssertionError with the place of the largest difference; without `spread` for any."""
    for key, x in one.items():
        quantity, name = key
        y = two[key]
        assert x.shape == y.shape, f"{relation}: {quantity} of {name} is {y.shape}, not {x.shape}"
        bound = 0.0 if spread is None else spread.bound(quantity, factor)
        off = np.abs(y - x)
        if x.size == 0 or np.all(off <= bound):
            continue
        place = np.unravel_index(np.nanargmax(np.where(np.isnan(off), np.inf, off)), off.shape)
        which = f", {'row' if name == 'interface' else 'dof'} {place[1]}" if x.ndim > 1 else ""
        raise AssertionError(
            f"{relation}: {quantity} of {name} at time level {place[0]}{which} is {y[place]!r} "
            f"instead of {x[place]!r}: {off[place]:.2g} apart, {bound:.2g} allowed, largest number "
            f"{np.max(np.abs(x)):.2g}"
        )


def shifted(whole, rng):
    """The same with every number changed by a part of about `SHIFT`."""

    def noise(shape=()):
        return 1.0 + SHIFT * rng.uniform(-1.0, 1.0, shape)

    def symmetric(A):
        if A is None:
            return None
        N = np.tril(noise(A.shape))
        return A * (N + np.tril(N, -1).T)

    start = noise(2)

    def change(p):
        springs = tuple(
            replace(s, k=s.k * noise(), fy=s.fy * noise(), gap=s.gap * noise(), k3=s.k3 * noise())
            for s in p.springs
        )
        f = p.function
        if f is not None:
            f = replace(f, G=f.G * noise(f.G.shape), force=f.force * noise(), c=f.c * noise())
        load = replace(
            p.load,
            direction=p.load.direction * noise(p.n),
            samples=p.load.samples * noise(p.load.samples.size),
        )
        M, C, K = map(symmetric, (p.M, p.C, p.K))
        u0, v0 = p.u0 * start[0], p.v0 * start[1]
        return replace(p, M=M, C=C, K=K, springs=springs, function=f, load=load, u0=u0, v0=v0)

    g = None if whole.g is None else whole.g * noise(whole.g.size)
    return replace(whole.each(change), g=g, dt=whole.dt * noise())


# ---- relations ----------------------------------------------------------------------------------


class Run:
    """A problem, its results, and how much they may differ."""

    def __init__(self, seed, draw=drawn):
        self.seed = seed
        self.begin("spread")
        self.whole = draw(seed)
        self.results = computed(self.whole)
        self.spread = Spread(self.whole, self.results, self.rng)

    def begin(self, name):
        """Random numbers of a relation of this name, whatever was tried before."""
        self.rng = np.random.default_rng([self.seed, *name.encode()])


run_of = lru_cache(maxsize=16)(Run)


def order(run):
    """Dofs, subdomains and rows in another order; rows in other combinations and units."""
    rng, whole = run.rng, run.whole
    dofs = [rng.permutation(p.n) for p in whole.members]
    members = [_reordered(p, own) for p, own in zip(whole.members, dofs)]
    columns = [L[:, own] for L, own in zip(whole.columns, dofs)]
    p = len(whole.L)
    far = 10.0 ** rng.permutation(np.linspace(-5.0, 5.0, p))
    mix = np.diag(far)[rng.permutation(p)]
    if rng.random() < 0.5:
        mix = mix @ (np.eye(p) + 0.3 * rng.uniform(-1.0, 1.0, (p, p)))
    chosen = rng.permutation(len(members))
    g = None if whole.g is None else mix @ whole.g
    other = replace(
        whole,
        members=tuple(members[i] for i in chosen),
        L=mix @ np.hstack([columns[i] for i in chosen]),
        g=g,
    )
    found = computed(other)
    for member, own in zip(whole.members, dofs):
        for q in "uva":
            back = np.empty_like(found[q, member.name])
            back[:, own] = found[q, member.name]
            found[q, member.name] = back
    found["multipliers", "interface"] = found["multipliers", "interface"] @ mix
    for q in ("velocity_jump", "displacement_jump"):
        found[q, "interface"] = np.linalg.solve(mix, found[q, "interface"].T).T
    # rows of one size: what is left of the scale
    unit = mix / np.max(np.abs(mix), axis=1, keepdims=True)
    require_equal("order", run.results, found, run.spread, np.linalg.cond(unit))


def _reordered(p, dofs):
    """Dof k is what was dof dofs[k]."""
    place = np.append(np.argsort(dofs), -1)  # of the ground too
    both = np.ix_(dofs, dofs)
    M, C, K = (None if A is None else A[both] for A in (p.M, p.C, p.K))
    springs = tuple(replace(s, pairs=place[s.pairs]) for s in p.springs)
    f = None if p.function is None else replace(p.function, G=p.function.G[dofs])
    load = replace(p.load, direction=p.load.direction[dofs])
    return replace(
        p, M=M, C=C, K=K, springs=springs, function=f, load=load, u0=p.u0[dofs], v0=p.v0[dofs]
    )


def units(run):
    """Other units of length, time and force."""
    length, time, force = 10.0 ** run.rng.uniform(-3.0, 3.0, 3)
    k, c, m = force / length, force * time / length, force * time**2 / length

    def change(p):
        springs = tuple(
            replace(s, k=s.k * k, fy=s.fy * force, gap=s.gap * length, k3=s.k3 * k / length**2)
            for s in p.springs
        )
        f = p.function
        if f is not None:
            f = replace(f, force=f.force * force, length=f.length * length, c=f.c * c)
            f = replace(f, pulse=f.pulse * force, omega=f.omega / time)
        load = replace(p.load, omega=p.load.omega / time, step=p.load.step * time)
        if load.kind == "base":
            load = replace(load, samples=load.samples * length / time**2)
        else:
            load = replace(load, direction=load.direction * force)
        C = None if p.C is None else p.C * c
        u0, v0 = p.u0 * length, p.v0 * length / time
        changed = replace(p, M=p.M * m, C=C, K=p.K * k, springs=springs, function=f)
        return replace(changed, load=load, u0=u0, v0=v0)

    whole = run.whole
    g = None if whole.g is None else whole.g * length / time
    other = replace(whole.each(change), g=g, dt=whole.dt * time, omega=whole.omega / time)
    speed = length / time
    factors = {"t": time, "u": length, "v": speed, "a": speed / time, "multipliers": force}
    factors |= {"velocity_jump": speed, "displacement_jump": length}
    found = {key: x / factors[key[0]] for key, x in computed(other).items()}
    require_equal("units", run.results, found, run.spread)


def forms(run):
    """Matrices in another format."""
    other = run.whole.each(lambda p: replace(p, forms=_forms(run.rng, p.M)))
    require_equal("forms", run.results, computed(other), run.spread)


def linear_force(run):
    """A linear force as a part of K, as springs, and as a function with its stiffness."""
    rng, whole = run.rng, run.whole
    i = int(rng.integers(len(whole.members)))
    member = replace(whole.members[i], springs=(), function=None)
    moving = np.flatnonzero(np.diag(member.M) > 0.0)
    if not moving.size:
        return
    pairs, k = _pairs(rng, moving), 2.0
    A = spring_matrix(pairs, k, member.n)
    springs = (Springs("cubic", pairs, k, 0.0, 0.0, 0.0),)
    inside = replace(member, K=member.K + A)

    def with_member(other):
        members = [*whole.members[:i], other, *whole.members[i + 1 :]]
        return replace(whole, members=tuple(members), start="rebased")

    one = with_member(inside)
    first = computed(one)
    spread = Spread(one, first, rng)
    if spread.is_wild:
        return
    for role in roles_of(whole.coupling):
        if role == "internal":  # converged to the tolerance
            spread.unit = ROUNDING + ITERATED
        for as_function in (False, True):
            given = replace(member, role=role, springs=springs)
            if as_function:
                given = replace(member, role=role, function=Linear(A), estimated=True)
            kind = f"a linear force as {role} {'function' if as_function else 'springs'}"
            require_equal(f"{kind} of {member.name}", first, computed(with_member(given)), spread)


def pieces(run):
    """In one run and in pieces, recorded in a file and in two, saved and loaded, with threads."""
    rng, whole, one = run.rng, run.whole, run.results
    first, second = sorted(int(k) for k in rng.choice(np.arange(1, STEPS), 2, replace=False))

    coupler = whole.coupler()
    parts = [coupler.run(steps=k) for k in (first, second - first)]
    coupler.step(STEPS - second)
    states = {
        (q, s.name): getattr(coupler.state(s.name), q)[None] for s in whole.members for q in "uva"
    }
    ends = {key: one[key][-1:] for key in states}
    require_equal(f"runs of {first} and {second - first} macro steps, then steps", ends, states)
    for (q, name), x in results_of(parts[0]).items():
        require_equal(
            "the first of several runs", {(q, name): one[q, name][: len(x)]}, {(q, name): x}
        )

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.h5")
        coupler = whole.coupler()
        coupler.run(steps=second, record_to=path)
        coupler.run(steps=STEPS - second, record_to=path, append=True)
        require_equal("two runs into one file", one, results_of(pm.History.load(path)))

        coupler = whole.coupler()
        coupler.step(first)
        coupler.save(Path(folder, "state.npz"))
        other = whole.coupler(threads=2)
        other.load(Path(folder, "state.npz"))
        other.step(STEPS - first)
    states = {key: getattr(other.state(key[1]), key[0])[None] for key in ends}
    require_equal(f"saved after {first} macro steps and loaded, with two threads", ends, states)
    threads = whole.coupler(threads=3).run(steps=STEPS)
    require_equal("three threads", one, results_of(threads))


def records(run):
    """Other things recorded, before and after a snapshot: the motion is the same, and energies."""
    whole, one = run.whole, run.results
    name = whole.members[-1].name
    coupler = whole.coupler(threads=2)
    full = coupler.run(steps=STEPS, energy=True)
    require_equal("with energies", one, results_of(full))
    coupler.reset()
    coupler.step(2)
    before = coupler.snapshot()
    for _ in range(2):  # the second time from what was restored
        some = coupler.run(steps=STEPS - 2, record={name: [0]}, every=2)
        last = {("u", name): one["u", name][-1:, :1], ("v", name): one["v", name][-1:, :1]}
        found = {(q, name): getattr(some[name], q)[-1:] for q in "uv"}
        require_equal("one dof at the end, from a snapshot", last, found)
        coupler.restore(before)
    coupler.reset()
    ends = coupler.run(steps=STEPS, energy=True, every=STEPS, record={}).energy
    for kind in ("kinetic", "strain", "dissipated", "external", "interface", "balance"):
        sums, rest = ({(kind, "all"): getattr(x, kind)[-1:]} for x in (full.energy, ends))
        require_equal("energies at the end", sums, rest)


def cases(run):
    """Several cases by `run_each`, and each by `reset` and `run`."""
    rng, whole = run.rng, run.whole
    light = [np.diag(p.M) == 0.0 for p in whole.members]
    chosen = []
    for factor in (0.5, 2.0, -1.0):
        loads = {
            p.name: np.where(own, 0.0, factor * rng.normal(size=p.n))
            for p, own in zip(whole.members, light)
        }
        chosen.append({"force": loads})
        if whole.g is None:  # else v0 has to satisfy g(0)
            chosen[-1]["v0"] = {p.name: factor * p.v0 for p in whole.members}
    coupler = whole.coupler(threads=2)
    together = coupler.run_each(chosen, steps=STEPS)
    for k, case in enumerate(chosen):
        coupler.reset(**case)
        alone = coupler.run(steps=STEPS)
        require_equal(f"case {k} of run_each", results_of(alone), results_of(together[k]))


def uncut(run):
    """Subdomains with one scheme and one step, and the structure that they are cut from."""
    rng, whole = run.rng, run.whole
    if whole.coupling == "mean" or any(np.any(np.diag(p.M) == 0.0) for p in whole.members):
        return
    scheme = whole.members[0].scheme
    most = max(p.substeps for p in whole.members)
    substeps = 1 if whole.coupling == "macro" else most

    def change(p):
        plain = replace(p, springs=(), function=None, lagged=False, double=False)
        return replace(plain, scheme=scheme, substeps=substeps)

    whole = _with_step(rng, replace(whole.each(change), g=None))
    if whole.g is not None or np.any(
        whole.L @ np.concatenate([p.v0 for p in whole.members]) > 1e-9
    ):
        whole = _at_start(rng, whole)
    coupler = whole.coupler()
    first = results_of(coupler.run(steps=STEPS))
    spread = Spread(whole, first, rng)
    if spread.is_wild:
        return
    M, C, K, maps = coupler.assembled()
    dense = {name: T.toarray() for name, T in maps.items()}
    every = np.vstack([dense[p.name] for p in whole.members])
    u0, v0 = (
        np.linalg.lstsq(every, np.concatenate([getattr(p, x) for p in whole.members]), rcond=None)[
            0
        ]
        for x in ("u0", "v0")
    )
    loads = [(dense[p.name], value_of(p)) for p in whole.members]
    alone = pm.Subdomain(
        M, K, C, scheme=scheme, substeps=substeps, u0=u0, v0=v0, name="whole",
        force=lambda t: sum(T.T @ F(t) for T, F in loads),
    )  # fmt: skip
    history = pm.Coupler([alone], dt=whole.dt).run(steps=STEPS)["whole"]
    found = {
        (q, p.name): getattr(history, q) @ dense[p.name].T for p in whole.members for q in "uva"
    }
    motion = {key: first[key] for key in found}
    condition = np.linalg.cond(whole.L)
    require_equal("cut and uncut", found, motion, spread, condition)


def value_of(member):
    """Its load as a function of time."""
    load = member.load.given(member.M)
    if load is None:
        load = np.zeros(member.n)
    return load if callable(load) else lambda t: load


def rest(run):
    """The static equilibrium under constant loads stays as it is."""
    rng, whole = run.rng, run.whole

    def change(p):
        constant = replace(p.load, kind="constant")
        scheme = p.scheme
        if whole.coupling == "mean" and scheme.explicit:  # others rest beside it, (K9)
            scheme = pm.CentralDifference()
        function = p.function if p.role == "internal" else None
        if function is not None:
            function = replace(function, c=0.0, pulse=0.0)
        zero = np.zeros(p.n)
        return replace(p, load=constant, scheme=scheme, function=function, u0=zero, v0=zero)

    whole = replace(whole, g=None, start="rebased")  # a plain start moves, (S3)
    whole = _with_step(rng, whole.each(change))
    u = whole.coupler().static()
    whole = whole.each(lambda p: replace(p, u0=u[p.name]))
    first = computed(whole)
    spread = Spread(whole, first, rng, still=True)
    if spread.is_wild:
        return
    for p in whole.members:
        zero = np.zeros_like(first["u", p.name])
        require_equal("rest", {("u", p.name): zero + u[p.name]}, first, spread)
        require_equal("rest", {(x, p.name): zero for x in "va"}, first, spread)


RELATIONS = {
    x.__name__: x for x in (order, units, forms, linear_force, pieces, records, cases, uncut, rest)
}


def attempt(seed, counts, names=tuple(RELATIONS), draw=drawn):
    """One problem and all relations, or some."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            run = run_of(seed, draw)
        except (ValueError, pm.PmalphaError) as error:
            counts[f"refused, {type(error).__name__}"] += 1
            return
        if run.spread.is_wild:
            counts["unstable, left out"] += 1
            return
        for name in names:
            run.begin(name)
            RELATIONS[name](run)
            counts[name] += 1
        counts[f"coupling {run.whole.coupling}"] += 1
