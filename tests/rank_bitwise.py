"""What each rank does in the tests against one process."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import relations
from known_relations import dense_of
from newton_coupled import Law
from problems import FEATURES
from rank_problems import (
    COUPLINGS,
    RANK,
    SIZE,
    WORLD,
    chain,
    plastic,
    report,
    same,
    same_energies,
    ties,
)

import pmalpha as pm
from pmalpha.setup.ranks import Ranks

REUSE = pm.Newton(tangent="reuse")


def own_part(count, rng):
    """The subdomains of this rank: consecutive ones, possibly none."""
    cuts = np.sort(rng.integers(0, count + 1, SIZE - 1))
    first = np.concatenate([[0], cuts, [count]])
    return slice(first[RANK], first[RANK + 1])


def changes_of_steps(rng, subdomains, coupling, dt):
    """Other steps in mid-run, twice: (dt, substeps by name) that every coupling can have."""
    fine = max(s.substeps for s in subdomains)
    for _ in range(2):
        dt = dt * rng.choice([0.5, 0.8, 1.0])
        by = int(rng.choice([1, 2, 3]))
        counts = {s.name: by * s.substeps for s in subdomains}
        if coupling in ("macro", "mean"):  # double steps are of one substep
            counts = {s.name: 1 if s.double_step else by * s.substeps for s in subdomains}
        elif rng.random() < 0.5:  # single steps of the last one, of the finest step
            counts[subdomains[-1].name] = by * fine
        yield dt, counts


def by_name(ties):
    """The constraints with subdomains by name, as each process has them."""
    return [
        pm.Constraint({s.name: dense_of(tie, s) for s in tie.matrices}, tie.velocity)
        for tie in ties
    ]


def is_refused(call, *arguments):
    try:
        return call(*arguments) is not None
    except (ValueError, pm.PmalphaError):
        return True


# What several processes do not take: one solves for impulses, and each knows its own forces alone.
ALONE = [name for name, f in FEATURES.items() if "contact" in name or "obstacle" in name]
ALONE += ["Bathe", "long step", "external specimen"]


def compare(seed):
    """Runs, steps, resets and snapshots of one problem. False where it cannot be distributed."""
    rng = np.random.default_rng([seed, 7])
    problem = relations.drawn(seed, without=ALONE)
    refusal = None
    try:
        alone = problem.couple(threads=1)
        alone.run(steps=14)
        alone.reset()
    except Exception as error:
        relations.require_refusal("one process", error)
        refusal = error
    if "parts" not in problem.space:
        return False
    subdomains, options = problem.space["parts"], problem.options()
    coupling, part = options.get("coupling", "gc"), own_part(len(subdomains), rng)
    names = [s.name for s in subdomains[part]]
    try:
        options |= dict(comm=WORLD, threads=int(rng.choice([1, 2])), coupling=coupling)
        shared = pm.Coupler(subdomains[part], by_name(problem.space["ties"]), **options)
    except (ValueError, pm.PmalphaError) as error:
        assert refusal is not None or "with mass" in str(error), error
        return False
    if refusal is not None:  # by the run
        return False
    every = [None, 2][int(rng.integers(2))]
    for length in (7, 4):
        chosen = dict(steps=length, every=every, energy=bool(rng.random() < 0.7))
        one, other = shared.run(**chosen), alone.run(**chosen)
        same(one, other, names)
        if chosen["energy"]:
            same_energies(one.energy, other.energy, part)
    changed = changes_of_steps(rng, subdomains, coupling, alone.dt)
    for dt, substeps in changed:
        own = {name: substeps[name] for name in names}
        refused = [is_refused(alone.change_steps, dt, substeps)]
        refused.append(is_refused(shared.change_steps, dt, own))
        assert refused[0] == refused[1], refused
        if refused[0]:
            continue
        one, other = (c.run(steps=3, energy=True) for c in (shared, alone))
        same(one, other, names)
        same_energies(one.energy, other.energy, part)
    present = shared.snapshot(), alone.snapshot()
    for c in (shared, alone):
        c.step(3)
    np.testing.assert_array_equal(shared.multipliers, alone.multipliers)
    for c, s in zip((shared, alone), present):
        c.restore(s)
    same(shared.run(steps=2), alone.run(steps=2), names)
    for c in (shared, alone):
        c.reset()
    same(shared.run(steps=3, record={}), alone.run(steps=3, record={}), [])
    for name in names:
        for x in "uva":
            a, b = (getattr(c.state(name), x) for c in (shared, alone))
            np.testing.assert_array_equal(a, b)
    return True


def bitwise(first=0, count=40):
    done = 0
    for seed in range(int(first), int(first) + int(count)):
        with suppress(pm.ConvergenceError, pm.InstabilityError):  # after the changes of steps
            done += compare(seed)
    assert done > int(count) // 3, done  # the others have interface dofs without mass
    report(f"{done} of {count} problems bitwise")


def explicit():
    """Internal forces of explicit subdomains: springs, a function, and both, with energies."""

    def force(t, u, v, q):
        f = 40.0 * u**3 + 0.3 * np.abs(v) * v
        return f, 120.0 * np.diag(u**2), 0.6 * np.diag(np.abs(v))

    kinds = pm.CubicSpring([0, 2], k=3.0, k3=50.0), force, [pm.Bilinear([1], 9.0, 0.1), force]
    scheme = pm.GeneralizedAlpha(0.6, explicit=True)
    subdomains = [
        chain(3, f"r{i}", substeps=substeps, internal=internal, scheme=scheme)
        for i, (internal, substeps) in enumerate(zip(kinds, (4, 2, 4)))
    ]
    subdomains.append(chain(3, "r3", force=np.ones(3)))
    first = np.linspace(0, 4, SIZE + 1).astype(int)
    own = subdomains[first[RANK] : first[RANK + 1]]
    for coupling in ("pm", "gc", "macro", "mean"):
        options = dict(dt=0.01, coupling=coupling)
        alone = pm.Coupler(subdomains, ties(4), **options)
        shared = pm.Coupler(own, ties(4), **options, comm=WORLD)
        one, other = (c.run(steps=40, energy=True) for c in (shared, alone))
        same(one, other, [s.name for s in own])
        same_energies(one.energy, other.energy, slice(first[RANK], first[RANK + 1]))
        assert np.abs(other["r1"].u).max() > 0.1
    report("explicit")


def fed():
    """Loads that depend on the motion, and means of a record over the steps of each subdomain."""
    record = np.random.default_rng(5).standard_normal(400)
    loads = [
        pm.SampledForce(record, 0.003, np.ones(3), average=True),
        lambda t, u, v: np.sin(9.0 * t) - 0.7 * v - 2.0 * u**3,
        lambda t, u, v: [-v[0], 0.0, 1.0],
    ]
    subdomains = [
        chain(3, f"r{i}", substeps=substeps, force=force)
        for i, (force, substeps) in enumerate(zip(loads, (1, 4, 2)))
    ]
    first = np.linspace(0, 3, SIZE + 1).astype(int)
    own = subdomains[first[RANK] : first[RANK + 1]]
    for coupling in ("pm", "gc", "macro"):
        options = dict(dt=0.01, coupling=coupling)
        alone = pm.Coupler(subdomains, ties(3), **options)
        shared = pm.Coupler(own, ties(3), **options, comm=WORLD)
        rest = alone.static()
        for name, u in shared.static().items():
            np.testing.assert_array_equal(u, rest[name])
        one, other = (c.run(steps=40, energy=True) for c in (shared, alone))
        same(one, other, [s.name for s in own])
        same_energies(one.energy, other.energy, slice(first[RANK], first[RANK + 1]))
        for c in (shared, alone):
            c.change_steps(dt=0.008)
        same(*(c.run(steps=10) for c in (shared, alone)), [s.name for s in own])
    report("fed")


VARIANTS = {  # double steps (None: the default), and Newton's method
    "gc": [(None, pm.Newton())],
    "pm": [(None, pm.Newton()), (None, REUSE), (True, REUSE), (False, REUSE)],
    "macro": [(None, pm.Newton()), (True, REUSE)],
    "mean": [(None, pm.Newton()), (True, REUSE)],
}


def iterated(folder, *couplings):
    """Internal forces of implicit subdomains, iterated with the interface, and all that keeps."""
    for coupling in couplings:
        for double, newton in VARIANTS[coupling]:
            iterate(Path(folder) / f"{coupling}.npz", coupling, newton, double)
    report("iterated")


def iterate(path, coupling, newton, double):
    first = np.linspace(0, 5, SIZE + 1).astype(int)
    part = slice(first[RANK], first[RANK + 1])
    names = [f"r{i}" for i in range(5)][part]
    shared = plastic(coupling, newton, double, WORLD, part)
    alone = plastic(coupling, newton, double)
    for steps in (6, 3):
        one, other = (c.run(steps=steps, energy=True) for c in (shared, alone))
        same(one, other, names)
        same_energies(one.energy, other.energy, part)
        for name in names:
            for x in ("q", "iterations"):
                a, b = (getattr(h[name], x) for h in (one, other))
                assert (a is None) == (b is None)
                np.testing.assert_array_equal(a, b)
    assert np.abs(other["r0"].q).max() > 0.0  # it has yielded
    assert max(other["r1"].iterations) > 2
    for c in (shared, alone):
        c.change_steps(0.015)
    same(shared.run(steps=2), alone.run(steps=2), names)
    present = shared.snapshot(), alone.snapshot()
    for c, kept in zip((shared, alone), present):
        c.step(1)
        c.restore(kept)
    same(shared.run(steps=2), alone.run(steps=2), names)
    shared.save(path)
    WORLD.Barrier()
    continued = plastic(coupling, newton, double)
    continued.load(path)
    same(continued.run(steps=2), alone.run(steps=2), [f"r{i}" for i in range(5)])
    WORLD.Barrier()


def resting(comm=None, own=slice(None)):
    """Four chains on springs, plastic and other internal forces, under dead load."""

    def cubic(t, u, v, q):
        return 500.0 * u**3, 1500.0 * np.diag(u**2), None

    given = dict(internal=cubic), {}, dict(restoring=pm.CubicSpring([1], 80.0, 3e4)), {}
    given[1]["internal"] = [pm.Bilinear([0], 60.0, 0.3), pm.InternalForce(Law(3), np.zeros(3))]
    subdomains = [
        chain(3, f"r{i}", force=10.0 * np.arange(i, i + 3), **forces)
        for i, forces in enumerate(given)
    ]
    return pm.Coupler(subdomains[own], ties(4), dt=0.01, coupling="gc", comm=comm)


def static():
    """Static equilibrium with springs and internal forces."""
    first = np.linspace(0, 4, SIZE + 1).astype(int)
    own = slice(first[RANK], first[RANK + 1])
    shared, alone = resting(WORLD, own), resting()
    for steps in (1, 3):
        expected, found = (c.static(steps=steps) for c in (alone, shared))
        assert list(found) == [f"r{i}" for i in range(4)][own]
        for name, u in found.items():
            np.testing.assert_array_equal(u, expected[name])
    shared.reset(u0=found)
    assert all(np.abs(s.v).max() < 1e-8 for s in shared.run(steps=9).subdomains)
    report("static")


def chosen(folder):
    """Substeps chosen by local errors, in macro steps that are repeated where they were too few."""

    def make(comm=None, own=slice(None)):
        pulse = pm.SampledForce(np.r_[0.0, 0.0, 40.0, 0.0][:, None] * np.ones(3), 0.05)
        subdomains = [
            chain(3, f"r{i}", k=100.0 * 10.0**i, u0=np.zeros(3), force=pulse) for i in range(4)
        ]
        return pm.Coupler(subdomains[own], ties(4), dt=0.02, coupling="gc", comm=comm)

    first = np.linspace(0, 4, SIZE + 1).astype(int)
    own = slice(first[RANK], first[RANK + 1])
    shared, alone = make(WORLD, own), make()
    names = [f"r{i}" for i in range(4)]
    options = dict(tolerance=0.001, energy=True)
    path = Path(folder) / "chosen.h5"
    one, other = shared.run(1.0, record_to=path, **options), alone.run(1.0, **options)
    same(one, other, names[own])
    same_energies(one.energy, other.energy, own)
    np.testing.assert_array_equal(one.substeps, other.substeps[:, own])
    assert len(np.unique(other.substeps)) > 2, np.unique(other.substeps, axis=0)
    WORLD.Barrier()
    same(pm.History.load(path), other, names)
    part = {name: 5e-4 for name in names[own] if name != "r1"}
    one = shared.run(1.4, tolerance=part, every=2)
    same(one, alone.run(1.4, tolerance={"r0": 5e-4, "r2": 5e-4, "r3": 5e-4}, every=2), names[own])
    report("chosen")


def by_callable(first, count):
    """The same with the exchange through Python, as where MPI cannot be called by address."""
    address = Ranks._address
    Ranks._address = lambda self: None
    bitwise(first, count)
    Ranks._address = address


def interpolated():
    """Ties of meshes that do not match, three subdomains on one interface, prescribed motion."""
    points = np.linspace(0.0, 1.0, 5)[:, None]
    y = np.linspace(0.0, 1.0, 9)[:, None]
    fine = np.hstack([0.0 * y, y])
    coarse = np.hstack([0.0 * points, points])
    K = {
        n: np.diag(np.r_[1.0, np.full(n - 2, 2.0), 1.0]) - np.eye(n, k=1) - np.eye(n, k=-1)
        for n in (5, 9)
    }
    rng = np.random.default_rng(3)
    a = [
        pm.Subdomain(
            np.ones(n),
            200.0 * K[n] + np.eye(n),
            scheme=pm.GeneralizedAlpha(0.5, explicit=explicit),
            substeps=substeps,
            force=pm.SampledForce(rng.normal(size=(40, n)), 0.03),
            name=name,
        )
        for n, name, explicit, substeps in (
            (9, "fine", True, 6),
            (5, "coarse", False, 1),
            (9, "other", False, 3),
        )
    ]
    edges = np.column_stack([np.arange(4), np.arange(1, 5)])
    constraints = [
        pm.interpolate("fine", fine, "coarse", coarse, edges),
        pm.tie("fine", [0, 8], "other", [0, 8]),
        pm.Constraint({"other": np.eye(1, 9, 4)}, lambda t: [np.sin(9.0 * t)]),
    ]
    for coupling in COUPLINGS:
        alone = pm.Coupler(a, constraints, dt=0.02, coupling=coupling)
        part = slice(
            *[[0, 3, 3], [0, 1, 3], [0, 1, 2, 3], [0, 1, 1, 2, 3]][SIZE - 1][RANK : RANK + 2]
        )
        shared = pm.Coupler(a[part], constraints, dt=0.02, coupling=coupling, comm=WORLD)
        one, other = shared.run(steps=30), alone.run(steps=30)
        same(one, other, [s.name for s in a[part]])
        expected, found = alone.static(), shared.static()
        assert list(found) == [s.name for s in a[part]]
        for name, u in found.items():
            np.testing.assert_array_equal(u, expected[name])
            assert np.abs(u).max() > 0.0
        assert np.abs(other.multipliers).max() > 0.1
    report("interpolated")
