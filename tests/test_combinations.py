"""All features at once: runs that are cut, recorded and threaded in any way are bitwise identical.

The expected values are those of one run on one thread that records everything. Random calls on
other couplers of the same problem are compared with its rows.
"""

import ctypes

import numpy as np
import problems
import pytest
import scipy.sparse as sp
from scipy import LowLevelCallable

import pmalpha as pm

pytestmark = [
    pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning"),
    pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning"),
]
DOUBLES = ctypes.POINTER(ctypes.c_double)
HEAD = (ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t)
FORCE = ctypes.CFUNCTYPE(*HEAD, DOUBLES, ctypes.c_void_p)
RESTORING = ctypes.CFUNCTYPE(*HEAD, DOUBLES, DOUBLES, DOUBLES, ctypes.c_void_p)
STEPS = 14
DT = 0.05


class Broken(Exception):
    """Raised by a load or a restoring force on request."""


class UserFunction:
    """A function of the user that counts its calls and fails at a given one."""

    def __init__(self, function):
        self.function, self.calls, self.fails_in = function, 0, None

    def fails(self):
        self.calls += 1
        if self.fails_in is not None:
            self.fails_in -= 1
            return self.fails_in < 0
        return False

    def __call__(self, *args):
        if self.fails():
            raise Broken
        return self.function(*args)

    def compiled_force(self):
        def force(t, n, f, user):
            if self.fails():
                return 7
            np.ctypeslib.as_array(f, (n,))[:] = self.function(t)
            return 0

        return LowLevelCallable(FORCE(force))

    def compiled_restoring(self):
        def restoring(t, n, u, v, r, user):
            if self.fails():
                return 8
            u, v, r = (np.ctypeslib.as_array(x, (n,)) for x in (u, v, r))
            r[:] = self.function(u, v, t)
            return 0

        return LowLevelCallable(RESTORING(restoring))


class Case:
    """A problem of 1 to 5 subdomains; each of its couplers has separate functions."""

    def __init__(self, seed):
        self.seed = seed
        rng = np.random.default_rng([seed, 7])
        self.coupling = str(rng.choice(["pm", "pm", "gc", "macro"]))
        drawn = problems.random_restored_problem(seed).subdomains
        self.subdomains = drawn[: int(rng.integers(1, 6))]
        self.subdomains = [larger(rng, x) if rng.random() < 0.25 else x for x in self.subdomains]
        if self.coupling == "macro":
            for s in self.subdomains:
                s.substeps = int(rng.integers(1, 7))
                s.double = True if s.substeps == 1 and rng.random() < 0.5 else None
            if all(s.double for s in self.subdomains):
                self.subdomains[0].double = None
        elif any(s.double for s in self.subdomains):
            finest = max(s.substeps for s in self.subdomains)
            self.subdomains[0].substeps, self.subdomains[0].double = finest, False
        for s in self.subdomains:
            s.restoring = None
        self.massless = [np.diag(s.M) == 0.0 for s in self.subdomains]
        sizes = [len(s.M) for s in self.subdomains]
        self.L = None
        if sum(sizes) > 1:
            self.L = problems._random_constraints(rng, sizes)
            if not any(x.any() for x in self.massless):
                problems._set_initial_state(rng, self.subdomains, self.L)
            else:
                for s in self.subdomains:
                    s.u0 = s.v0 = None
        self.kinds = [int(rng.integers(6)) for _ in self.subdomains]
        self.restored = [bool(rng.random() < 0.4) for _ in self.subdomains]
        self.springs = [
            [] if restored else self._springs(rng, i) for i, restored in enumerate(self.restored)
        ]
        self.motion = int(rng.integers(4)) if self.L and len(self.L[0]) > 1 else 0
        for s, massless, restored, springs in zip(
            self.subdomains, self.massless, self.restored, self.springs
        ):
            estimate = np.diag(np.where(massless, 0.0, 0.5))
            nonlinear = restored or springs
            s.K_r = estimate if nonlinear and rng.random() < 0.5 else None
            s.D_r = 0.1 * estimate if nonlinear and rng.random() < 0.5 else None

    def _springs(self, rng, i):
        dofs = np.flatnonzero(~self.massless[i])
        if dofs.size == 0 or rng.random() < 0.5:
            return []

        def some():
            first = rng.choice(dofs, int(rng.integers(1, 4)))
            second = rng.choice(np.append(dofs, -1), first.size)
            second[second == first] = -1
            return np.column_stack([first, second])

        made = [
            pm.CubicSpring(some(), 1.0, 5.0),
            pm.Gap(some(), 8.0, 0.1),
            pm.Bilinear(some(), 4.0, 0.2, 0.1),
            pm.BoucWen(some(), 3.0, 0.3, 0.05, n=1.5),
        ]
        return [x for x in made if rng.random() < 0.7]

    def coupler(self, threads, **options):
        """A coupler, its loads and its restoring forces, both as {subdomain: function}."""
        loads, forces = {}, {}
        subdomains = []
        for i, s in enumerate(self.subdomains):
            restoring = self.springs[i] or None
            if self.restored[i]:
                c = np.where(self.massless[i], 0.0, 1.0 + 0.1 * np.arange(len(s.M)))
                forces[i] = UserFunction(
                    lambda u, v, t, c=c: c * (u / (1.0 + u * u) + 0.1 * v + 0.2 * np.sin(t))
                )
                restoring = forces[i] if i % 2 else forces[i].compiled_restoring()
            M, C, K = (None if A is None else f(A) for A, f in zip((s.M, s.C, s.K), s.forms))
            subdomains.append(
                pm.Subdomain(
                    M,
                    K,
                    C,
                    scheme=s.scheme,
                    substeps=s.substeps,
                    double_step=s.double,
                    force=self._force(i, loads),
                    restoring=restoring,
                    restoring_stiffness=s.K_r,
                    restoring_damping=s.D_r,
                    damping="lagged" if s.lagged else "implicit",
                    u0=s.u0,
                    v0=s.v0,
                    name=f"s{i}",
                )
            )
        made = pm.Coupler(
            subdomains,
            self._constraints(subdomains),
            dt=DT,
            coupling=self.coupling,
            threads=threads,
            **options,
        )
        return made, loads, forces

    def _force(self, i, loads):
        s, kind = self.subdomains[i], self.kinds[i]
        n = len(s.M)
        rng = np.random.default_rng([self.seed, i])
        direction = np.where(self.massless[i], 0.0, rng.normal(size=n))
        if kind == 1:
            return direction
        if kind == 2:
            return pm.SampledForce(rng.normal(size=9), 0.07, shape=direction)
        if kind == 3:
            return pm.BaseAcceleration(rng.normal(size=9), 0.07, direction, s.M)
        if kind > 3:
            loads[i] = UserFunction(lambda t: direction * np.cos(3.0 * t))
            return loads[i].compiled_force() if kind == 5 else loads[i]
        return None

    def _constraints(self, subdomains):
        if self.L is None:
            return []
        held = slice(0, len(self.L[0]) - (self.motion > 0))
        made = [pm.Constraint({s: L[held] for s, L in zip(subdomains, self.L) if L[held].any()})]
        moved = {s: L[-1:] for s, L in zip(subdomains, self.L) if L[-1].any()}
        if self.motion == 1:
            made.append(pm.Constraint(moved, velocity=lambda t: [np.sin(5.0 * t)]))
        elif self.motion > 1:
            samples = np.sin(np.arange(12.0)).reshape(-1, 1)
            made.append(pm.Constraint(moved, velocity=pm.SampledForce(samples, 0.06)))
        return made

    def all_springs(self):
        return {f"s{i}": None for i, springs in enumerate(self.springs) if springs} or None


def larger(rng, s):
    """A chain or a grid for bands, strips, panels and slabs, in place of a small subdomain."""
    n = int(rng.integers(20, 200))
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    if rng.random() < 0.5:
        side = int(rng.integers(6, 12))
        one = 2.0 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
        K, n = np.kron(one, np.eye(side)) + np.kron(np.eye(side), one), side * side
    C = None if rng.random() < 0.5 else 0.02 * K
    forms = [np.diag if rng.random() < 0.5 else sp.csr_array, sp.csr_array, sp.csr_array]
    M = np.diag(rng.uniform(1.0, 2.0, n))
    return problems.SubdomainData(M, K, C, s.scheme, s.substeps, s.double, forms, lagged=s.lagged)


class Truth:
    """One run on one thread, and the energies of any interval of it."""

    def __init__(self, case):
        self.case = case
        self.coupler, _, _ = case.coupler(1)
        self.history = self.coupler.run(steps=STEPS, record_springs=case.all_springs())

    def energy(self, begin, end):
        self.coupler.reset()
        self.coupler.step(begin)
        return self.coupler.run(steps=end - begin, energy=True, record={}).energy

    def check_present(self, coupler):
        now = coupler.step_count
        for i, whole in enumerate(self.history.subdomains):
            row = now * self.case.subdomains[i].substeps
            x = coupler.state(i)
            for name in "uva":
                same(getattr(x, name), getattr(whole, name)[row])
            if self.case.springs[i]:
                springs = coupler.springs(i)
                same(springs.deformation, whole.deformation[row])
                same(springs.force, whole.force[row])
        same(coupler.multipliers, self.history.multipliers[now * self.fine])

    @property
    def fine(self):
        if self.case.coupling == "macro":
            return 1
        return max(s.substeps for s in self.case.subdomains)

    def check_rows(self, history, begin, end, every, energy):
        def rows(substeps):
            if every is None:
                return np.arange(begin * substeps, end * substeps + 1)
            later = [k for k in range(begin + 1, end + 1) if k % every == 0]
            return np.array([begin, *later]) * substeps

        for i, (ours, whole) in enumerate(zip(history.subdomains, self.history.subdomains)):
            names = ("t", "u", "v", "a") + ("deformation", "force") * bool(self.case.springs[i])
            for name in names:
                expected = getattr(whole, name)[rows(self.case.subdomains[i].substeps)]
                same(getattr(ours, name), expected)
        same(history.multipliers, self.history.multipliers[rows(self.fine)])
        same(history.velocity_jump, self.history.velocity_jump[rows(self.fine)])
        same(history.displacement_jump, self.history.displacement_jump[rows(1)])
        if energy:
            expected = self.energy(begin, end)
            for name in ("kinetic", "strain", "dissipated", "external", "interface"):
                same(getattr(history.energy, name), getattr(expected, name)[rows(1) - begin])


def same(a, b):
    np.testing.assert_array_equal(a, b, strict=True)


class Attack:
    """Random calls on couplers of a case; all results are compared after each call."""

    def __init__(self, case, rng, folder):
        self.case, self.rng, self.folder = case, rng, folder
        self.truth = Truth(case)
        self.files = 0
        self.renew()

    def renew(self):
        threads = int(self.rng.choice([1, 2, 2, 4]))
        self.coupler, self.loads, self.forces = self.case.coupler(threads)

    def options(self):
        every = self.rng.choice([None, None, 1, 2, 3])
        options = {"record_springs": self.case.all_springs(), "every": every}
        options["energy"] = bool(self.rng.random() < 0.3)
        if self.rng.random() < 0.2:
            self.files += 1
            options["record_to"] = self.folder / f"{self.files}.h5"
        return options

    def run(self, steps):
        begin, options = self.coupler.step_count, self.options()
        history = self.coupler.run(steps=steps, **options)
        self.truth.check_rows(history, begin, begin + steps, options["every"], options["energy"])

    def step(self, steps):
        self.coupler.step(steps)

    def save_and_load(self, steps):
        path = self.folder / "state.npz"
        self.coupler.save(path)
        self.renew()
        self.coupler.step(int(self.rng.integers(3)))
        self.coupler.load(path)

    def reset(self, steps):
        self.coupler.reset()

    def fail(self, steps):
        """A function fails within a run; completed steps are kept, the others are repeated."""
        functions = [*self.loads.values(), *self.forces.values()]
        if not functions:
            return
        chosen = functions[int(self.rng.integers(len(functions)))]
        self.coupler.state(0)
        chosen.fails_in = int(self.rng.integers(12))
        begin, options = self.coupler.step_count, self.options()
        try:
            history = self.coupler.run(steps=steps, **options)
        except (Broken, pm.CallbackError):
            history = self.coupler.last_history
        chosen.fails_in = None
        if history is not None:
            end = self.coupler.step_count
            self.truth.check_rows(history, begin, end, options["every"], options["energy"])

    def stop(self, steps):
        """Progress that raises ends a run as Ctrl-C does."""

        def progress(done, total):
            raise Broken

        begin, options = self.coupler.step_count, self.options()
        with pytest.raises(Broken):
            self.coupler.run(steps=steps, progress=progress, **options)
        end, history = self.coupler.step_count, self.coupler.last_history
        self.truth.check_rows(history, begin, end, options["every"], options["energy"])

    def go(self, rounds):
        names = ["run", "run", "step", "save_and_load", "reset", "fail", "fail", "stop"]
        for _ in range(rounds):
            left = STEPS - self.coupler.step_count
            name = str(self.rng.choice(names)) if left else "reset"
            before, begin = [f.calls for f in self._counted()], self.coupler.step_count
            steps = int(self.rng.integers(1, left + 1)) if left else 0
            getattr(self, name)(steps)
            self.truth.check_present(self.coupler)
            if name in ("run", "step") and self.started:
                self._check_calls(before, self.coupler.step_count - begin)
            self.started = True

    started = False

    def _counted(self):
        self.coupler.state(0)
        self.started = True
        return [self.forces[i] for i in sorted(self.forces)]

    def _check_calls(self, before, steps):
        for i, calls, f in zip(sorted(self.forces), before, self._counted()):
            assert f.calls - calls == steps * self.case.subdomains[i].substeps


@pytest.mark.parametrize("seed", range(40))
def test_any_combination_is_bitwise_identical_to_one_run_on_one_thread(seed, tmp_path):
    attack = Attack(Case(seed), np.random.default_rng([seed, 11]), tmp_path)
    attack.go(rounds=8)


def overflowing():
    """A double-step subdomain whose load passes all numbers from t = 0.5 on."""
    samples = np.where(np.arange(40) < 5, 0.0, 1e300).reshape(-1, 1)
    load = pm.SampledForce(samples, 0.1, shape=[[1.0], [0.0]])
    scheme = pm.GeneralizedAlpha(0.5)
    return pm.Subdomain([1e-20, 1.0], [1e-20, 1.0], scheme=scheme, force=load, name="a")


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_no_restoring_force_is_evaluated_beyond_a_macro_step_that_fails(threads):
    # "a" is not finite at the end of the macro step from 0.4 on; a thread beside it may not begin
    # the next one, for a rig cannot take back what it was commanded
    times = []

    def restoring(u, v, t):
        times.append(t)
        return 0.1 * u

    a = overflowing()
    explicit = dict(scheme=pm.GeneralizedAlpha(0.5, explicit=True), substeps=5)
    b = pm.Subdomain([1.0], [1.0], restoring=restoring, name="b", **explicit)
    c = pm.Subdomain([1.0], [1.0], name="c", **explicit)
    ties = [pm.tie(a, [1], b, [0]), pm.tie(b, [0], c, [0])]
    coupler = pm.Coupler([a, b, c], ties, dt=0.1, threads=threads, coupling="pm")
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10)
    assert (caught.value.subdomain, caught.value.step) == ("a", 4)
    assert times == [k / 5 * 0.1 for k in range(26)]  # (T1) up to t = 0.5


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_first_failure_is_raised_though_a_later_step_was_evaluated_meanwhile(coupling, threads):
    # from t = 0.5 on a load that overflows, in the substep of "a" that begins at 0.4 (double step)
    # or 0.45; another thread has evaluated "b" for later substeps
    samples = np.where(np.arange(40) < 5, 0.0, 1e300).reshape(-1, 1)
    load = pm.SampledForce(samples, 0.1, shape=[[1.0], [0.0]])
    a = pm.Subdomain(
        [1e-20, 1.0],
        [1e-20, 1.0],
        scheme=pm.GeneralizedAlpha(0.5),
        substeps=2,
        force=load,
        name="a",
    )

    def breaks(u, v, t):
        if t > 0.455:
            raise Broken
        return 0.1 * u

    explicit = dict(scheme=pm.GeneralizedAlpha(0.5, explicit=True), substeps=10)
    b = pm.Subdomain([1.0], [1.0], restoring=breaks, name="b", **explicit)
    c = pm.Subdomain([1.0], [1.0], name="c", **explicit)
    ties = [pm.tie(a, [1], b, [0]), pm.tie(b, [0], c, [0])]
    coupler = pm.Coupler([a, b, c], ties, dt=0.1, coupling=coupling, threads=threads)
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=10, every=2)
    assert (caught.value.subdomain, caught.value.step, coupler.step_count) == ("a", 4, 4)
