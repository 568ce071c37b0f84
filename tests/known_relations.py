"""Relations of relations.py in which a run is compared with what is known otherwise.

With a plain implementation, the structure uncut, static equilibrium, differences, finer steps and
the record of energies; of problems that are made simpler first, where the other side needs it.
"""

import warnings
from dataclasses import replace

import numpy as np
import reference
import scipy.sparse as sp
from frozen_inputs import listed
from problems import FEATURES, STEPS
from relations import measured, refused, relation, require_equal, results_of, states

import pmalpha as pm
from pmalpha.problem.loads import terms_of
from pmalpha.problem.restoring import functions_of


def simple(problem, *more):
    """The problem with linear features alone, and `more`, which are also possible."""
    kept = {"damping", "full mass", "initial motion", "general constraint", "gyroscopic"}
    kept |= {"unsymmetric K", "constant load", "samples", "substeps", "pm", "macro", "mean"}
    kept |= set(more)
    return replace(problem, choices=tuple(c for c in problem.choices if c[0] in kept))


def near(words, one, two, tolerance=1e-9):
    """Equal to a part of the largest number of each quantity: of small problems on soft springs
    that move for some steps, far above rounding and the tolerance of an iteration."""
    for key, x in one.items():
        size = max(np.max(np.abs(x), initial=0.0), np.max(np.abs(two[key]), initial=0.0))
        require_equal(words, {key: x}, {key: two[key]}, {key[0]: tolerance * max(size, 1e-3)})


@relation
def linear_force(r):
    """A linear force as a part of K, as springs and as a function, evaluated once or iterated."""
    problem, i = simple(r.problem), -1
    for way in ("K", "springs", "function"):
        for argument in ("restoring", "internal") if way != "K" else ("K",):
            if argument == "restoring" and '"mean"' in problem.program:
                continue

            def change(given, way=way, argument=argument):
                n, k = len(given["M"]), 1.5
                A = np.zeros((n, n))
                A[i, i] = k
                if given["name"] != "a":
                    return given
                if way == "K":
                    return given | {"K": np.array(given["K"]) + A}
                if way == "springs":
                    return given | {argument: pm.CubicSpring([n - 1], k, 0.0)}
                if argument == "internal":
                    return given | {argument: lambda t, u, v, q: (A @ u, A)}
                return given | {argument: lambda t, u, v: A @ u, "restoring_stiffness": A}

            newton = pm.Newton(tol=1e-13)
            history = problem.couple(change, newton=newton).run(steps=STEPS)
            results = {k: x for k, x in results_of(history).items() if k[0] in "uva"}
            if way == "K":
                right = results
            near(f"a linear force as {argument} {way}", right, results, 1e-7)


@relation
def uncut(r):
    """Subdomains with one scheme and one step are the structure that they are cut from."""
    problem = simple(r.problem, "function of time", "Rayleigh")
    problem = replace(problem, choices=tuple(c for c in problem.choices if c[0] != "substeps"))
    if '"mean"' in problem.program or "average=True" in problem.setup:
        return
    coupler = problem.couple(lambda given: given | {"double_step": False})
    M, C, K, maps = coupler.assembled()
    parts = coupler.subdomains
    T = {name: np.asarray(A.todense()) for name, A in maps.items()}
    every = np.vstack([T[s.name] for s in parts])
    u0, v0 = (
        np.linalg.lstsq(every, np.concatenate([getattr(s, x) for s in parts]), rcond=None)[0]
        for x in ("u0", "v0")
    )

    def force(t):
        return sum((T[s.name].T @ load_at(s, t) for s in parts), np.zeros(M.shape[0]))

    whole = pm.Subdomain(
        M, K, C=C, scheme=parts[0].scheme, u0=u0, v0=v0, force=force, symmetric=False
    )
    alone = pm.solve(whole, coupler.dt, steps=STEPS)
    found = results_of(coupler.run(steps=STEPS))
    right = {(q, s.name): getattr(alone, q) @ T[s.name].T for q in "uva" for s in parts}
    near("cut and uncut", right, {key: found[key] for key in right})


@relation
def numpy_reference(r):
    """The method once more in plain NumPy, under the couplings and with the forces that it has."""
    more = ["lagged damping", "function of time", "specimen", "estimated specimen", "plain start"]
    more += ["double steps", "some substeps", "Rayleigh", "ground motion", "massless dof"]
    more += [name for name, f in FEATURES.items() if f.group == "scheme" and name != "Bathe"]
    problem = simple(r.problem, *more)
    if "average=True" in problem.setup or '"mean"' in problem.program:
        return
    coupler = problem.couple()
    parts, ties = problem.space["parts"], problem.space["ties"]
    rows = [[dense_of(tie, s) for s in parts] for tie in ties]
    L = [np.vstack([own[i] for own in rows] or [np.zeros((0, s.n))]) for i, s in enumerate(parts)]
    doubles = [member.double for member in coupler._session.members]
    subdomains = [reference_of(s, double) for s, double in zip(parts, doubles)]
    if problem.sketch.coupler.get("coupling") == '"macro"':
        if not ties or any(s.restoring is not None for s in parts):
            return
        expected = reference.run_macro(subdomains, L, coupler.dt, STEPS)
    else:
        start = "plain" if "plain start" in problem.features() else "rebased"
        expected = reference.run(subdomains, L, coupler.dt, STEPS, start=start)
    found = results_of(coupler.run(steps=STEPS))
    right = {(q, s.name): getattr(x, q) for q in "uv" for s, x in zip(parts, expected.subdomains)}
    near("the reference in NumPy", right, {key: found[key] for key in right})


def load_at(s, t):
    return sum((f(t) if callable(f) else f for f in terms_of(s.force)), np.zeros(s.n))


def dense_of(tie, s):
    entry = tie.matrices.get(s)
    if entry is None:
        return np.zeros((tie.p, s.n))
    return (entry.matrix(s.n, s.dof_names) if hasattr(entry, "matrix") else entry).toarray()


def reference_of(s, double):
    """A subdomain for the reference."""

    def dense(A):
        if A is None:
            return None
        return np.diag(A) if A.ndim == 1 else np.asarray(A.todense() if sp.issparse(A) else A)

    functions = functions_of(s.restoring)
    restoring = None
    if functions:

        def restoring(t, u, v):
            return sum(f(t, u, v) for f in functions)

    return reference.Subdomain(
        np.zeros((s.n, s.n)) if s.M is None else dense(s.M),
        dense(s.K),
        dense(s.C),
        am=s.scheme.am,
        af=s.scheme.af,
        beta=s.scheme.beta,
        gamma=s.scheme.gamma,
        explicit=s.scheme.explicit,
        substeps=s.substeps,
        double=double,
        force=lambda t: load_at(s, t),
        restoring=restoring,
        K_r=dense(s.restoring_stiffness),
        D_r=dense(s.restoring_damping),
        lagged=s.damping == "lagged",
        u0=s.u0,
        v0=s.v0,
    )


@relation
def rest(r):
    """The static equilibrium under constant loads stays as it is."""
    problem = simple(r.problem, "iterated cubic springs", "cubic springs")
    kept = tuple(c for c in problem.choices if c[0] not in ("samples", "initial motion"))
    problem = replace(problem, choices=kept)
    u = problem.couple().static()
    newton = pm.Newton(tol=1e-13)
    coupler = problem.couple(lambda given: given | {"u0": u[given["name"]]}, newton=newton)
    found = results_of(coupler.run(steps=STEPS))
    for name, x in u.items():
        bounds = dict.fromkeys("uva", 1e-7 * (1e-3 + max(abs(y).max() for y in u.values())))
        still = {(q, name): np.zeros_like(found[q, name]) for q in "va"}
        still["u", name] = np.zeros_like(found["u", name]) + x
        require_equal("rest", still, {key: found[key] for key in still}, bounds)


# ---- numbers that are known otherwise -----------------------------------------------------------


@relation
def gradient(r):
    """A derivative of a run by a parameter, against a central difference."""
    s = r.coupler.subdomains[0]
    K = np.diag(np.where(np.arange(s.n) == s.n - 1, 1.0, 0.0))
    misfit, by = pm.Misfit(measured(r)), [pm.Parameters(s.name, K=[K])]
    found = r.coupler.gradient(misfit, steps=STEPS, parameters=by)
    near = r.coupler.gradient(misfit, steps=STEPS, parameters=by, differences=1e-4)
    size = max(abs(found.parameters[0][0]), 1e-6 * found.value, 1e-12)
    off = abs(found.parameters[0][0] - near.parameters[0][0])
    assert off <= 1e-5 * size + 1e-9 * found.value, (
        f"gradient: {found.parameters} {near.parameters}"
    )


@relation
def budget(r):
    """The value of an error budget is that of its run, and its parts are its total."""
    s, end = r.coupler.subdomains[0], STEPS * r.coupler.dt
    for goal in (pm.Goal(s.name, 0, at=end), pm.Goal(s.name, [0.5] * s.n, weight=np.cos, what="v")):
        found = r.coupler.error_budget(goal, end, weights="half")
        parts = sum(found.own.values()) + found.coupling
        size = found.bound + abs(found.total) + 1e-12 * abs(found.value)
        assert abs(parts - found.total) <= 1e-9 * size, f"budget: {parts} is not {found.total}"
        if goal.weight is None:
            u = r.coupler.run_each([{}], steps=STEPS)[0][s.name].u[-1, 0]
            assert abs(found.value - u) <= 1e-12 * abs(u), f"budget: {found.value} is not {u}"
        repr(found)
        with refused():  # "macro" and "mean" alone
            found.steps(found.bound + 1.0)


# ---- finer steps --------------------------------------------------------------------------------

FINER = 16


@relation
def budget_of_steps(r):
    """The total of an error budget is near the error where the steps resolve the motion."""
    coupler = (problem := resolved(r.problem)).couple()
    s, end = coupler.subdomains[0].name, STEPS * coupler.dt
    found = coupler.error_budget(pm.Goal(s, 0, at=4 * end), 4 * end)
    error = finer(problem, 4 * STEPS)[s].u[-1, 0] - found.value
    assert abs(error - found.total) <= 0.5 * found.bound + 1e-9, (
        f"error budget: {found.total:.3g} of {found.bound:.3g}, the error is {error:.3g}"
    )


def resolved(problem):
    """The problem with linear features and smooth loads, whose steps resolve them."""
    simpler = simple(problem, "function of time", "Rayleigh", "damping ratio", "double steps")
    return replace(simpler, choices=tuple(c for c in simpler.choices if c[0] != "samples"))


def finer(problem, steps):
    """The History of finer steps, whose error is a part FINER ** -2."""
    dt = problem.couple().dt
    return problem.couple(dt=dt / FINER).run(steps=FINER * steps, every=FINER)


@relation
def estimated(r):
    """An estimate of the error leaves the coupler bitwise as it was, has the History of the run,
    and is near the error where the steps resolve the motion."""
    coupler, other = r.problem.couple(), r.problem.couple()
    coupler.step(3), other.step(3)
    found = coupler.estimate_error(steps=STEPS)
    assert states(coupler).keys() == states(other).keys()
    require_equal("after an estimate", states(other), states(coupler))
    coupler.step(2), other.step(2)
    require_equal("steps after an estimate", states(other), states(coupler))
    other.reset()
    run = results_of(other.run(steps=STEPS))
    history = results_of(found.history)
    require_equal("the History of an estimate", run, {key: history[key] for key in run})
    problem, steps = resolved(r.problem), 4 * STEPS
    found = problem.couple().estimate_error(steps=steps)
    one, two = problem.couple().run(steps=steps, every=1), finer(problem, steps)
    pairs = [(x.u, y.u) for x, y in zip(one.subdomains, two.subdomains)]
    size = max(np.max(np.abs(y)) for _, y in pairs)
    error = max(np.max(np.abs(x - y)) for x, y in pairs) / max(size, 1e-12)
    if 1e-7 < error < 0.1:
        assert error / 3.0 < found.relative < 3.0 * error, (
            f"estimate: {found.relative:.3g}, the error is {error:.3g}"
        )


@relation
def energies(r):
    """Works and energies of what conserves close; balances are finite."""
    energy = r.problem.couple().run(steps=STEPS, energy=True).energy
    assert np.all(np.isfinite(energy.balance)), "energies: a balance is not finite"
    total = energy.kinetic + energy.strain - (energy.kinetic + energy.strain)[0]
    works = energy.external + energy.interface - energy.dissipated
    if energy.contact is not None:
        works = works + energy.contact
    size = 1e-12 + np.max(np.abs(energy.kinetic) + np.abs(energy.strain)) + np.max(np.abs(works))
    assert np.max(np.abs(total - works - energy.balance)) < 1e-12 * size, "energies do not close"


# ---- energy that forces add ---------------------------------------------------------------------

LOADS = {"constant load", "function of time", "controller", "samples", "ground motion"}
LOADS |= {"compiled load", "prescribed velocity", "sampled velocity", "shaken support"}
LOADS |= {"moving obstacle", "beam with a moving load", "beam with springs that move"}
LOADS |= {"ground motion by component"}
DAMPING = {"damping", "lagged damping", "Rayleigh", "damping ratio", "gyroscopic", "graded damping"}
# of the largest energy, from which on a gain is announced: a tenth, and a third through ties
TENTH, THIRD = 0.1, 0.35
ADDED = "have added energy"


@relation
def announced(r):
    """Energy that forces add is announced, and what is announced was added, by the record of
    energies: with a stop that the steps may not resolve, without damping, and without loads where
    the energy at the start is known."""
    loads = set() if r.rng.random() < 0.3 else LOADS
    kept = [c for c in r.problem.choices if c[0] not in DAMPING | loads | {"initial motion"}]
    problem = replace(r.problem, choices=(*kept, ("initial motion", 0)))
    Omega, dof = 10.0 ** r.rng.uniform(-0.5, 0.6), int(r.rng.integers(3))

    def change(given):
        if given["name"] == "b" or not isinstance(given["M"], list):
            return given
        m, i = np.max(given["M"]), dof % len(given["M"])
        k = m * (Omega / r.coupler.dt * given.get("substeps", 1)) ** 2
        key = "internal" if "internal" in given else "restoring"
        forces = [*listed(given.get(key)), pm.Gap([i], k, 0.02)]
        return {x: y for x, y in given.items() if x != "u0"} | {key: forces}

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        history = problem.couple(change).run(steps=5 * STEPS, energy=True)
    words = [str(x.message) for x in caught]
    energy = history.energy
    for i, s in enumerate(history.subdomains):
        added = any(ADDED in x and f"{s.name!r}" in x for x in words)
        work = -energy.dissipated[:, i]  # what forces gave since any time counts
        gave = np.maximum.accumulate(work - np.minimum.accumulate(work))
        T = np.maximum.accumulate(energy.kinetic[:, i])
        assert not added or np.any(gave > TENTH * T), (
            f"announced: {gave[-1]:.3g} of {T[-1]:.3g} for {s.name}"
        )
    if loads and "truss" not in problem.features():  # whose prestress is energy that is released
        T, U = (np.sum(x, axis=1) for x in (energy.kinetic, energy.strain))
        fastest = np.maximum.accumulate(T) <= T
        gain = (np.max(T) - T[0] - U[0]) / max(np.max((T + U)[fastest]), 1e-12)
        assert words or gain < THIRD, f"announced: nothing, and {gain:.3g} of the energy was added"
