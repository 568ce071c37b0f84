"""What each rank does in the tests of couplers in several processes (test_mpi.py).

    mpiexec -n 3 python tests/on_ranks.py NAME

Every rank asserts by itself and prints one line at the end; an assertion that fails ends all.
"""

import sys
import traceback
import warnings
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent))
import problems  # noqa: E402
from newton_coupled import Law  # noqa: E402

import pmalpha as pm  # noqa: E402
from pmalpha.run import checkpoint  # noqa: E402

WORLD = MPI.COMM_WORLD
RANK, SIZE = WORLD.rank, WORLD.size

# by the names in which test_mpi.py gives them
COUPLINGS = {name: dict(coupling=name) for name in ("pm", "gc", "macro", "mean")}
COUPLINGS["tied"] = dict(coupling="gc", drift="removed")


def report(*words):
    """One line of each rank, written by one of them."""
    lines = WORLD.gather(" ".join(map(str, words)))
    if RANK == 0:
        print("\n".join(lines), flush=True)


# ---- bitwise against one process ----------------------------------------------------------------


def named(problem):
    """The subdomains of a random problem with names, their constraints in names, and g."""
    subdomains = []
    for i, s in enumerate(problem.subdomains):
        M, C, K = (None if A is None else f(A) for A, f in zip((s.M, s.C, s.K), s.forms))
        arguments = dict(scheme=s.scheme, substeps=s.substeps, double_step=s.double)
        arguments |= dict(force=s.force, restoring=s.restoring, u0=s.u0, v0=s.v0)
        arguments |= dict(restoring_stiffness=s.K_r, restoring_damping=s.D_r)
        arguments |= dict(damping="lagged" if s.lagged else "implicit", name=f"s{i}")
        arguments |= dict(symmetric=s.symmetric)
        subdomains.append(pm.Subdomain(M, K, C, **arguments))
    matrices = {f"s{i}": L for i, L in enumerate(problem.L) if L.any()}
    return subdomains, matrices


def own_part(count, rng):
    """The subdomains of this rank: consecutive ones, possibly none."""
    cuts = np.sort(rng.integers(0, count + 1, SIZE - 1))
    first = np.concatenate([[0], cuts, [count]])
    return slice(first[RANK], first[RANK + 1])


def same(one, other, names):
    for name in names:
        for x in ("t", "u", "v", "a"):
            np.testing.assert_array_equal(getattr(one[name], x), getattr(other[name], x))
    arrays = "multipliers", "multiplier_times", "velocity_jump", "displacement_jump", "macro_times"
    for x in arrays:
        np.testing.assert_array_equal(getattr(one, x), getattr(other, x), err_msg=x)


def same_energies(own, whole, part):
    """The energies of the subdomains of this rank, and of all of them their sums."""
    assert own.arrays().keys() == whole.arrays().keys()
    for name, x in whole.arrays().items():
        np.testing.assert_array_equal(own.arrays()[name], x[:, part], err_msg=name)
    balance = np.hstack(WORLD.allgather(own.balance))
    np.testing.assert_array_equal(balance.sum(axis=1), whole.balance.sum(axis=1))


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


def compare(seed):
    """Runs, steps, resets and snapshots of one problem. False where it cannot be distributed."""
    rng = np.random.default_rng([seed, 7])
    draw = problems.random_restored_problem
    if rng.random() < 0.3:
        problem = problems.random_unsymmetric_problem(seed, draw)
    else:
        problem = draw(seed)
    subdomains, matrices = named(problem)
    moved = rng.random() < 0.3 and all(np.all(np.diag(s.M) > 0) for s in problem.subdomains)
    velocity = None
    if moved:
        w = rng.normal(size=len(problem.L[0]))
        kinds = [
            lambda t: w * np.sin(3.0 * t),
            pm.SampledForce(np.vstack([0.0 * w, w, -w]), 0.11),
        ]
        velocity = kinds[int(rng.integers(2))]
    constraint = pm.Constraint(matrices, velocity)
    coupling = ("pm", "gc", "macro", "mean")[int(rng.integers(4))]
    linear = all(s.restoring is None for s in problem.subdomains)
    if coupling == "mean" and not linear:
        coupling = "pm"
    for s in problem.subdomains:
        if coupling in ("macro", "mean") and s.substeps > 1:
            s.double = None
    if coupling in ("macro", "mean"):
        subdomains = named(problem)[0]
    drift = "removed" if coupling == "gc" and rng.random() < 0.7 else "kept"
    options = dict(dt=problem.dt, coupling=coupling, start=problem.start, drift=drift)
    threads = int(rng.choice([1, 2]))
    part = own_part(len(subdomains), rng)
    names = [s.name for s in subdomains[part]]
    refusal = None
    try:
        alone = pm.Coupler(subdomains, constraint, **options)
    except ValueError as error:
        refusal = error
    try:
        shared = pm.Coupler(subdomains[part], constraint, **options, comm=WORLD, threads=threads)
    except (ValueError, pm.PmalphaError) as error:
        assert refusal is not None or "with mass" in str(error), error
        return False
    assert refusal is None, refusal
    every = [None, 2][int(rng.integers(2))]
    for length in (7, 4):
        chosen = dict(steps=length, every=every, energy=bool(rng.random() < 0.7))
        one, other = shared.run(**chosen), alone.run(**chosen)
        same(one, other, names)
        if chosen["energy"]:
            same_energies(one.energy, other.energy, part)
    changed = changes_of_steps(rng, subdomains, coupling, problem.dt)
    for dt, substeps in changed:
        alone.change_steps(dt, substeps)
        shared.change_steps(dt, {name: substeps[name] for name in names})
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
    done = sum(compare(seed) for seed in range(int(first), int(first) + int(count)))
    assert done > int(count) // 3, done  # the others have interface dofs without mass
    report(f"{done} of {count} problems bitwise")


def explicit():
    """Internal forces of explicit subdomains: springs, a function, and both, with energies."""

    def force(u, v, t, q):
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
    for coupling in ("pm", "gc"):
        options = dict(dt=0.01, coupling=coupling)
        alone = pm.Coupler(subdomains, ties(4), **options)
        shared = pm.Coupler(own, ties(4), **options, comm=WORLD)
        one, other = (c.run(steps=40, energy=True) for c in (shared, alone))
        same(one, other, [s.name for s in own])
        same_energies(one.energy, other.energy, slice(first[RANK], first[RANK + 1]))
        assert np.abs(other["r1"].u).max() > 0.1
    report("explicit")


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
            values |= dict(double_step=double and i in (0, 3))
        subdomains.append(pm.Subdomain(np.ones(n), K, **values))
    pulled = pm.Constraint({"r0": np.eye(1, n, 1)}, lambda t: [0.3 * np.sin(9.0 * t)])
    options = dict(dt=0.02, coupling=coupling, newton=newton, comm=comm)
    joints = [pm.tie(f"r{i}", [n - 1], f"r{i + 1}", [0]) for i in range(4)]
    return pm.Coupler(subdomains[own], [*joints, pulled], **options)


def iterated(folder):
    """Internal forces of implicit subdomains, iterated with the interface, and all that keeps."""
    first = np.linspace(0, 5, SIZE + 1).astype(int)
    part = slice(first[RANK], first[RANK + 1])
    names = [f"r{i}" for i in range(5)][part]
    variants = ("gc", None), ("pm", None), ("pm", True), ("pm", False)
    kinds = pm.Newton(), pm.Newton(tangent="reuse")
    for k, (coupling, double) in enumerate(variants):
        for newton in kinds if k == 1 else kinds[k // 2 : k // 2 + 1]:
            shared = plastic(coupling, newton, double, WORLD, part)
            alone = plastic(coupling, newton, double)
            for steps in (10, 5):
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
            same(shared.run(steps=5), alone.run(steps=5), names)
            present = shared.snapshot(), alone.snapshot()
            for c, kept in zip((shared, alone), present):
                c.step(3)
                c.restore(kept)
            same(shared.run(steps=5), alone.run(steps=5), names)
            shared.save(Path(folder) / "state.npz")
            WORLD.Barrier()
            continued = plastic(coupling, newton, double)
            continued.load(Path(folder) / "state.npz")
            same(continued.run(steps=5), alone.run(steps=5), [f"r{i}" for i in range(5)])
            WORLD.Barrier()
    report("iterated")


def by_callable(first, count):
    """The same with the exchange through Python, as where MPI cannot be called by address."""
    from pmalpha.setup.ranks import Ranks

    Ranks._address = lambda self: None
    bitwise(first, count)


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
        alone = pm.Coupler(a, constraints, dt=0.02, **COUPLINGS[coupling])
        part = slice(
            *[[0, 3, 3], [0, 1, 3], [0, 1, 2, 3], [0, 1, 1, 2, 3]][SIZE - 1][RANK : RANK + 2]
        )
        shared = pm.Coupler(a[part], constraints, dt=0.02, **COUPLINGS[coupling], comm=WORLD)
        one, other = shared.run(steps=30), alone.run(steps=30)
        same(one, other, [s.name for s in a[part]])
        expected, found = alone.static(), shared.static()
        assert list(found) == [s.name for s in a[part]]
        for name, u in found.items():
            np.testing.assert_array_equal(u, expected[name])
            assert np.abs(u).max() > 0.0
        assert np.abs(other.multipliers).max() > 0.1
    report("interpolated")


def files(folder):
    """Checkpoints and files of a run, of which each rank has its own."""
    folder = Path(folder)

    def make():
        return pm.Coupler([chain(3, f"r{RANK}", force=np.ones(3))], ties(), dt=0.01, comm=WORLD)

    coupler, other = make(), make()
    coupler.step(11)
    coupler.save(folder / "state.npz")
    other.load(folder / "state.npz")
    assert other.step_count == 11
    same(coupler.run(steps=9), other.run(steps=9), [f"r{RANK}"])
    if RANK == SIZE - 1:
        (folder / f"state.npz.11.{RANK}").write_bytes(b"damaged")
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
    coupler = pm.Coupler(own, ties(), dt=0.01, comm=WORLD)
    coupler.run(steps=3, record_to=folder / "one.h5", energy=True)
    WORLD.Barrier()
    whole = pm.History.load(folder / "one.h5")
    assert [s.name for s in whole.subdomains] == names
    assert whole.energy.balance.shape == (4, SIZE)
    report("files")


def killed(folder):
    """A rank that is killed while a file is written; test_mpi.py reads what is left."""
    import os
    import signal

    def progress(done, total):
        if RANK == SIZE - 1 and done > 2000:
            os.kill(os.getpid(), signal.SIGKILL)

    coupler = pm.Coupler([chain(3, f"r{RANK}")], ties(), dt=0.01, comm=WORLD)
    coupler.run(steps=10_000_000, record_to=Path(folder) / "run.h5", every=100, progress=progress)


def four(comm=None, own=slice(None), coupling="pm"):
    """Four subdomains, of which this rank has its own."""
    subdomains = [
        chain(3, f"r{i}", substeps=substeps, force=np.ones(3))
        for i, substeps in enumerate((1, 2, 1, 1))
    ]
    return pm.Coupler(subdomains[own], ties(4), dt=0.01, comm=comm, **COUPLINGS[coupling])


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
            alone.save(folder / f"{coupling}.alone")
        WORLD.Barrier()
        expected = alone.run(steps=5)
        for source in (path, folder / f"{coupling}.alone"):
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
        assert later == [name.replace(".10.", ".11.") for name in files], (files, later)
    report("checkpoints")


def killed_in_save(folder):
    """A rank that is killed while a state is saved; `left` loads the one before."""
    import os
    import signal

    coupler = four(WORLD, slice(None) if RANK == 0 else slice(0, 0))
    coupler.step(4)
    coupler.save(Path(folder) / "state.npz")
    coupler.step(4)
    if RANK == SIZE - 1:
        checkpoint.write = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    coupler.save(Path(folder) / "state.npz")


def left(folder):
    coupler, other = four(), four()
    coupler.load(Path(folder) / "state.npz")
    other.step(4)
    same(coupler.run(steps=3), other.run(steps=3), [f"r{i}" for i in range(4)])
    report("left")


# ---- errors of arguments ------------------------------------------------------------------------


def one_of(kind, call, *words, failed=SIZE - 1, everywhere=False):
    """An error of a call: of one rank, named on the others, or the same everywhere."""
    try:
        call(RANK == failed)
    except (ValueError, TypeError, pm.PmalphaError, OSError) as error:
        others = kind if everywhere or issubclass(kind, pm.PmalphaError) else pm.PmalphaError
        assert type(error) is (kind if RANK == failed else others), repr(error)
        assert all(word in str(error) for word in words), str(error)
        assert everywhere or RANK == failed or f"rank {failed}: " in str(error), str(error)
    else:
        raise AssertionError(f"no error: {words}")


def arguments():
    """Wrong arguments on one rank raise on all, and nothing waits for ever."""

    def make(dt=0.01, constraints=None, own=None, name=f"r{RANK}", **options):
        own = [chain(3, name)] if own is None else own
        return pm.Coupler(own, constraints or ties(), dt=dt, comm=WORLD, **options)

    singular = pm.Subdomain([[1.0, 2], [2, 1]], np.eye(2), scheme=pm.Newmark(), name=f"r{RANK}")
    one_of(ValueError, lambda bad: make(dt=-1.0 if bad else 0.01), "dt must be positive")
    one_of(ValueError, lambda bad: make(coupling="pn" if bad else "pm"), "coupling must be")
    one_of(TypeError, lambda bad: make(own=3 if bad else None), "subdomains must be a list")
    one_of(ValueError, lambda bad: make(dt=0.02 if bad else 0.01), "dt, ", everywhere=True)
    one_of(ValueError, lambda bad: make(name="x"), "names of subdomains", everywhere=True)
    one_of(
        ValueError, lambda bad: make(name="x" if bad else f"r{RANK}"), "must name", everywhere=True
    )
    one_of(
        ValueError,
        lambda bad: make(constraints=[pm.tie("r0", 2, "r1", int(bad))]),
        "constraints must be the same on all ranks",
        everywhere=True,
    )
    one_of(
        pm.FactorizationError,
        lambda bad: make(own=[singular] if bad else None, constraints=[pm.tie("r0", 0, "r1", 0)]),
        f"'r{SIZE - 1}'",
    )
    internal = dict(internal=pm.CubicSpring([0], k=1.0, k3=1.0))
    one_of(
        ValueError,
        lambda bad: make(own=[chain(3, f"r{RANK}", **(internal if bad else {}))], coupling="macro"),
        'internal forces with comm need coupling="pm" or "gc"',
    )
    spring = dict(restoring=pm.Bilinear([0], k=1.0, fy=1.0, hardening=0.1))
    with_spring = make(own=[chain(3, f"r{RANK}", **(spring if RANK == 0 else {}))])
    one_of(ValueError, lambda bad: with_spring.static(), "springs", "without comm", failed=0)
    coupler = make()
    one_of(ValueError, lambda bad: coupler.static(steps=1 + bad), "the call", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(steps=3 + bad), "the call must be", everywhere=True)
    one_of(ValueError, lambda bad: coupler.step(3 + bad), "the call must be", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(steps=3, every=2 + bad), "the call", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(1.0, energy=bad), "the call", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(1.0, record={"x": None} if bad else None), "record")
    one_of(ValueError, lambda bad: coupler.reset(u0={f"r{RANK}": [0.0] * (3 + bad)}), "u0")
    one_of(
        ValueError,
        lambda bad: coupler.reset() if bad else coupler.step(),
        "the call",
        everywhere=True,
    )
    for refused in (coupler.assembled, lambda: coupler.modes(1)):
        one_of(ValueError, lambda bad, f=refused: f(), "without comm", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run_each([{}], 1.0), "without comm", everywhere=True)
    assert coupler.step_count == 0
    noise = pm.Constraint({"r0": [[1.0, 0.0, 0.0]]}, lambda t: [(t > 0.05) * float(RANK)])
    driven = make(constraints=[*ties(), noise])
    one_of(
        ValueError,
        lambda bad: driven.run(1.0),
        "a prescribed velocity must be the same on all ranks",
        everywhere=True,
    )
    one_of(ValueError, lambda bad: coupler.change_steps(0.01 + bad), "the call", everywhere=True)
    one_of(
        ValueError,
        lambda bad: coupler.change_steps(0.02, {f"r{RANK}": 1 - bad}),
        "substeps of",
    )
    one_of(
        ValueError,
        lambda bad: coupler.change_steps(0.02, {f"r{RANK}": 3 if bad else 2}),
        "must divide",
        everywhere=True,
    )
    assert coupler.dt == 0.01
    coupler.run(steps=2)
    repr(coupler)
    report("arguments")


# ---- failures -----------------------------------------------------------------------------------


class Broken(Exception):
    """Raised by a function of the user's."""


def chain(n, name, k=100.0, **options):
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    options = dict(scheme=pm.GeneralizedAlpha(0.8), u0=np.full(n, 0.1)) | options
    return pm.Subdomain(np.ones(n), k * K, name=name, **options)


def ties(count=SIZE):
    return [pm.tie(f"r{r}", 2, f"r{r + 1}", 0) for r in range(count - 1)]


def expect(kind, *words):
    """What the rank that failed raises, and what the others do."""

    def check(error, failed):
        if RANK != failed and not issubclass(kind, pm.PmalphaError):
            assert type(error) is pm.PmalphaError, repr(error)
        else:
            assert type(error) is kind, repr(error)
        if RANK != failed:
            assert f"rank {failed}" in str(error), str(error)
        assert all(word in str(error) for word in words if RANK == failed or word[0] != "-"), error

    return check


def on_all(kind):
    """What all ranks find and raise by themselves."""

    def check(error, failed):
        assert type(error) is kind and f"'r{failed}'" in str(error), repr(error)

    return check


def fails_in(make, check, failed, coupling, step=None, runs=True):
    """A run of 40 steps that `make(failed)` ends; all ranks are at the same step, and go on."""
    options = dict(dt=0.01, **COUPLINGS[coupling], comm=WORLD)
    fine = {r: 4 if r == 0 else 1 for r in range(SIZE)}[RANK]
    broken = make(RANK == failed)
    coupler = pm.Coupler([chain(3, f"r{RANK}", substeps=fine, **broken)], ties(), **options)
    try:
        coupler.run(steps=400)
    except BaseException as error:
        check(error, failed)
    else:
        raise AssertionError("no error")
    done = WORLD.allgather(coupler.step_count)
    assert len(set(done)) == 1, done
    if step is not None:
        assert done[0] == step, done
    history = coupler.last_history
    assert history.macro_times.size == done[0] + 1, (history.macro_times.size, done)
    everyone = WORLD.allgather(history.multipliers)
    assert all(np.array_equal(everyone[0], other) for other in everyone)
    return coupler, done[0]


class Counted:
    """A function of the user's that fails in one of its calls, or from then on."""

    def __init__(self, active, last, happens, value, once=True):
        self.active, self.last, self.happens, self.value = active, last, happens, value
        self.calls, self.once = 0, once

    @staticmethod
    def time(*arguments):
        """Of F(t), r(u, v, t) and f(u, v, t, q)."""
        return arguments[min(len(arguments), 3) - 1]

    def __call__(self, *arguments):
        self.calls += 1
        if self.active and self.time(*arguments) > self.last:
            self.active = not self.once
            return self.happens()
        return self.value


def broken():
    raise Broken("the load is missing")


def interrupt():
    import os
    import signal

    os.kill(os.getpid(), signal.SIGINT)
    return np.zeros(3)


def load(failed, coupling):
    """An exception of a load, which is evaluated ahead."""

    def make(active):
        return {"force": Counted(active, 0.1234, broken, np.ones(3))}

    # times of the failure: the first substep that ends after 0.1234
    fails_in(make, expect(Broken, "the load is missing"), failed, coupling, step=12)


def restoring(failed, coupling):
    """An exception in the middle of a step."""
    if coupling == "mean":
        return

    def make(active):
        return {"restoring": Counted(active, 0.1234, broken, np.zeros(3))}

    coupler, step = fails_in(make, expect(Broken, "the load is missing"), failed, coupling, step=12)
    rest = coupler.run(steps=28)  # it goes on, and bitwise as without the failure
    alone = pm.Coupler(
        [
            chain(3, f"r{r}", substeps=4 if r == 0 else 1, restoring=lambda u, v, t: np.zeros(3))
            for r in range(SIZE)
        ],
        ties(),
        dt=0.01,
        **COUPLINGS[coupling],
    )
    alone.step(step)
    same(rest, alone.run(steps=28), [f"r{RANK}"])


def internal(failed, coupling):
    """The same of internal forces, which are iterated or not, and of what they return."""
    if coupling not in ("pm", "gc"):
        return
    zero = np.zeros((3, 3))

    def wrong(active):
        def force(u, v, t, q):  # with a tangent that is far too small
            k = 1e9 if active and t > 0.1234 else 0.0
            return k * u, zero, zero

        return {"internal": force}

    def fails(happens, check, explicit=False):
        def make(active):
            force = Counted(active, 0.1234, happens, (np.zeros(3), zero, zero), once=False)
            return {"internal": force, "scheme": pm.GeneralizedAlpha(0.8, explicit=explicit)}

        fails_in(make, check, failed, coupling, step=12)

    for explicit in (True, False):
        fails(broken, expect(Broken, "the load is missing"), explicit)
        nan = np.full(3, np.nan), zero, zero
        kind = pm.InstabilityError
        # of explicit ones all ranks find it in the interface problem
        fails(lambda nan=nan: nan, on_all(kind) if explicit else expect(kind), explicit)
    softening = np.zeros(3), -1e9 * np.eye(3), zero
    fails(lambda: softening, expect(pm.ConvergenceError, "is not positive definite"))

    def check(error, failed):  # names the subdomain with the largest correction, as one process
        assert type(error) is pm.ConvergenceError, repr(error)
        texts = WORLD.allgather(str(error).rpartition("Newton's")[2])
        assert len(set(texts)) == 1 and "did not converge" in texts[0], texts

    fails_in(wrong, check, failed, coupling, step=12)


def ctrl_c(failed, coupling):
    def make(active):
        return {"force": Counted(active, 0.1234, interrupt, np.ones(3))}

    fails_in(make, expect(KeyboardInterrupt), failed, coupling)


def not_a_number(failed, coupling):
    def make(active):
        def nan():
            return np.full(3, np.nan)

        return {"force": Counted(active, 0.1234, nan, np.ones(3))}

    fails_in(make, expect(ValueError, "must be finite"), failed, coupling, step=12)


def unstable(failed, coupling):
    """A subdomain that explodes at one rank."""
    if coupling in ("macro", "mean"):
        return  # its interface matrix is then indefinite from the beginning

    def make(active):
        scheme = pm.GeneralizedAlpha(0.8, explicit=True)
        return {"scheme": scheme, "k": 1e7 if active else 100.0}

    coupler, step = fails_in(make, on_all(pm.InstabilityError), failed, coupling)
    assert 1 < step < 400


FAILURES = (load, restoring, internal, ctrl_c, not_a_number, unstable)


def failures(*options):
    count = 0
    for coupling in options or COUPLINGS:
        for failure in FAILURES:
            for failed in range(SIZE) if SIZE < 3 else [1]:
                failure(failed, coupling)
                WORLD.Barrier()
                count += 1
    report(count, "failures")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    try:
        globals()[sys.argv[1]](*sys.argv[2:])
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        WORLD.Abort(1)
