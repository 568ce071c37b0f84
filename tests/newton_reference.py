"""The schedules with internal forces in plain dense NumPy: the oracle, beside docs/method.md.

It continues tests/reference.py with subdomains whose internal force is iterated
(tests/newton_step.py), under "gc" and "pm" (`run`) and under "macro" (`run_macro`). pmalpha is
never imported.

    (N11) (N12)  affine laws of the interface velocity, the interface problem of an iteration
    (N13)        a coarse subdomain within its substep
    (N14)        shooting for dLam
    (N15)        Broyden's update
    (N16)        acceptance of a pass
    (N17)        history at the start

All other numbers and symbols are those of tests/reference.py and tests/newton_step.py.
"""

from dataclasses import dataclass, replace

import numpy as np
from newton_step import (
    EPS,
    ConvergenceError,
    Iteration,
    Level,
    Newton,
    Nonlinear,
    Trial,
    with_force,
)
from reference import (
    State,
    Step,
    check,
    initial_accelerations,
    instant,
    jump,
    moved,
    predictors,
    without_load,
)

__all__ = ["ConvergenceError", "Newton", "Nonlinear", "Result", "run", "run_macro"]

# ---- one subdomain --------------------------------------------------------------------------


class Member:
    """The steps of one subdomain of any kind, single ones at first.

    Parameters
    ----------
    index : int
    subdomain : Subdomain
    L : (p, n) ndarray
    dt : float
        Macro step.
    newton : Newton
    """

    def __init__(self, index, subdomain, L, dt, newton):
        self.index, self.subdomain, self.L, self.dt, self.newton = index, subdomain, L, dt, newton
        self.iterated = getattr(subdomain, "internal", None) and not subdomain.explicit
        self.step = Step(subdomain, L, dt / subdomain.substeps)
        self.back = 0  # a step starts from levels[n - back]: 0 single, 1 double step
        self.levels = []
        self.tangent = None  # Mbar_t that solves, for the length of the present steps
        self.scale = 0.0  # s_i^2 (N6)

    def begin(self, w, Lam):
        """The state at t = 0, a_0 = w_0 (9)."""
        s = self.subdomain
        q = getattr(s, "history", np.zeros(0))
        q = s.internal(0.0, s.u0, s.v0, q)[3] if q.size else q  # (N17)
        self.levels.append(Level(0.0, s.u0, s.v0, w, w, s.v0, q, Lam, 0))

    def begin_double_steps(self):
        """End of the first macro step: a double-step subdomain changes from h to 2 h."""
        if self.subdomain.double:
            self.step, self.back = Step(self.subdomain, self.L, 2.0 * self.step.h), 1
            self.tangent = None

    def free(self, old, t1):
        """The free problem of a subdomain that is not iterated, and its history at t1."""
        s, step = self.subdomain, self.step
        if getattr(s, "internal", None) is None:
            return step.free(old, t1), old.q
        step = Step(with_force(s, old.q), self.L, step.h)
        free, q = step.free(old, t1), old.q
        if q.size:
            ut, vs = predictors(s, old, step.h)[0], old.v + step.h * old.w
            q = s.internal(t1, ut, vs, q)[3]
        return free, q

    def close(self, free, q, Lam):
        """The state at the end of a step that is not iterated."""
        return Level(**vars(self.step.close(free, Lam)), q=q, Lam=Lam, iterations=0)

    def under(self, old, t1, Lam):
        """The state after a step from `old` to t1 under known multipliers."""
        if not self.iterated:
            return self.close(*self.free(old, t1), Lam)
        trial = Trial(self, old, t1, Lam)
        Iteration([trial], self.newton).run()
        return trial.closed()


@dataclass
class SubdomainResult:
    """States of one subdomain at its time levels: t, iterations (k,), all others (k, n or m)."""

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    q: np.ndarray
    iterations: np.ndarray


@dataclass
class Result:
    """Result of `run` and `run_macro`; as in tests/reference.py, and

    Attributes
    ----------
    passes : (steps,) ndarray
        Under "macro" the number of passes of each macro step, else empty.
    """

    subdomains: list[SubdomainResult]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    passes: np.ndarray


def has_internal(subdomain):
    return getattr(subdomain, "internal", None) is not None


def start(members, L):
    """States at t = 0; returns Lam_0 (S1), with f(0, u_0, v_0; q) among the forces."""
    forces = [with_force(x.subdomain, getattr(x.subdomain, "history", None)) for x in members]
    w0, Lam = initial_accelerations(forces, L)
    for x, w in zip(members, w0, strict=True):
        x.begin(w, Lam)
    return Lam


def result(members, L, multipliers, times, jumps, g, passes=()):
    names = ("t", "u", "v", "w", "a", "q", "iterations")
    steps = (len(members[0].levels) - 1) // members[0].subdomain.substeps
    macro = [[x.levels[m * x.subdomain.substeps].u for x in members] for m in range(steps + 1)]
    way = moved(g, times)[:: (len(times) - 1) // steps]
    return Result(
        subdomains=[
            SubdomainResult(*(np.array([getattr(y, name) for y in x.levels]) for name in names))
            for x in members
        ],
        multipliers=np.array(multipliers),
        multiplier_times=np.array(times),
        velocity_jump=np.array(jumps),
        displacement_jump=np.array([jump(L, u) for u in macro]) - way,
        passes=np.array(passes),
    )


# ---- "gc" and "pm" --------------------------------------------------------------------------


class FineMember(Member):
    """A subdomain under "gc" and "pm": opened, and at every fine instant a law o + G Lam (N11).

    `fine` is max(ss); all other parameters are those of Member.
    """

    def __init__(self, index, subdomain, L, dt, newton, fine):
        super().__init__(index, subdomain, L, dt, newton)
        self.fine, self.stride = fine, fine // subdomain.substeps
        self.trial = self.opened = None  # the step that is open

    def open(self, k):
        """Open the step to t_{n+1} if instant k - 1 is a time level t_n."""
        n, j = divmod(k - 1, self.stride)
        if j:
            return
        old, level = self.levels[n - self.back], self.levels[n]
        t1 = instant((n + 1) * self.stride, self.fine, self.dt)
        if not self.iterated:
            self.opened = self.free(old, t1)
            o, G = self.L @ self.opened[0].v, self.step.compliance()
        else:
            self.trial = Trial(self, old, t1, level.Lam)
            if self.stride == 1:
                return
            # the free solution: Newton's iteration at fixed multipliers, then one fresh tangent
            Iteration([self.trial], self.newton).run()
            self.trial.evaluate()
            self.trial.refresh()
            o, G = self.trial.law()
        # (N13)  o_n = L v_n - G_{n+1} Lam_n
        self.compliance, self.ends = G, (self.L @ level.v - G @ level.Lam, o)

    def law(self, k):
        """o and G at instant k of a subdomain that is not iterated there (N11) (N13)."""
        theta = (k % self.stride or self.stride) / self.stride
        return (1.0 - theta) * self.ends[0] + theta * self.ends[1], self.compliance

    def closes(self, k):
        return k % self.stride == 0

    def take(self, k, Lam):
        """Close the step that ends at instant k, if there is one."""
        if self.closes(k):
            self.levels.append(
                self.trial.closed() if self.iterated else self.close(*self.opened, Lam)
            )

    def interface_velocity(self, k, Lam):
        """L v at a time level, else o + G Lam."""
        if self.closes(k):
            return self.L @ self.levels[-1].v
        o, G = self.law(k)
        return o + G @ Lam


def run(subdomains, L, dt, steps, newton=None, g=None):
    """Coupled run from t = 0 under "pm", which without double steps is "gc".

    Parameters
    ----------
    subdomains : list of Subdomain
        Linear ones and `Nonlinear` ones; rules as for `reference.run`.
    L : list of (p, n_i) ndarray
    dt : float
    steps : int
    newton : Newton or None
    g : callable or None
        g(t) -> (p,) (G1), zero at t = 0 and with zero slope there; None is zero.

    Returns
    -------
    Result
    """
    check(subdomains, L, "rebased")
    newton, g = newton or Newton(), g or (lambda t: np.zeros(len(L[0])))
    fine = max(s.substeps for s in subdomains)
    both = enumerate(zip(subdomains, L, strict=True))
    members = [FineMember(i, s, Li, dt, newton, fine) for i, (s, Li) in both]
    multipliers, times = [start(members, L)], [0.0]
    jumps = [jump(L, [s.v0 for s in subdomains])]
    for k in range(1, steps * fine + 1):
        t = instant(k, fine, dt)
        Lam = fine_step(members, k, g(t), newton)
        multipliers.append(Lam)
        times.append(t)
        jumps.append(sum(x.interface_velocity(k, Lam) for x in members) - g(t))
        if k == fine:
            for x in members:
                x.begin_double_steps()
    return result(members, L, multipliers, times, jumps, g)


def fine_step(members, k, g, newton):
    """Step all subdomains to fine instant k; returns Lam at k, shape (p,)."""
    for x in members:
        x.open(k)
    trials = [x.trial for x in members if x.iterated and x.closes(k)]
    laws = [x.law(k) for x in members if not (x.iterated and x.closes(k))]
    p = len(g)
    others = sum((o for o, _ in laws), -g), sum((G for _, G in laws), np.zeros((p, p)))
    if trials:
        Iteration(trials, newton, others).run()
        Lam = trials[0].Lam
    else:
        Lam = np.linalg.solve(others[1], -others[0])  # (18)
    for x in members:
        x.take(k, Lam)
    return Lam


# ---- "macro" --------------------------------------------------------------------------------


class MacroMember(Member):
    """A subdomain under "macro": its substeps under known multipliers (N14)."""

    def response(self):
        """Interface velocity for unit multipliers, linearized at t = 0, shape (p, p) (M3)."""
        s, p, ss = self.subdomain, len(self.L), self.subdomain.substeps
        if getattr(s, "internal", None) is not None:
            _, K_t, C_t, _ = s.internal(0.0, s.u0, s.v0, s.history)
            s = replace(s, K=s.K + K_t, C=s.C + C_t)
        step = without_load(Step(s, self.L, self.step.h))
        zero = np.zeros(len(s.M))
        columns = []
        for e in np.eye(p):
            state = State(0.0, zero, zero, zero, zero, zero)
            for j in range(1, ss + 1):
                state = step.close(step.free(state, 0.0), j / ss * e)
            columns.append(self.L @ state.v)
        return np.array(columns).reshape(p, p).T

    def run(self, Lam, d):
        """States at the ends of the substeps under Lam + (j / ss) d."""
        ss, first = self.subdomain.substeps, len(self.levels) - 1
        state, states = self.levels[first - self.back], []
        for j in range(1, ss + 1):
            t1 = instant(first + j, ss, self.dt)
            state = self.under(state, t1, Lam + (1.0 if ss == 1 else j / ss) * d)
            states.append(state)
        return states


class Shooting:
    """The increment dLam that closes the constraints at the ends of macro steps (N14) to (N16).

    Parameters
    ----------
    members : list of MacroMember
    newton : Newton
    dt : float
    """

    def __init__(self, members, newton, dt):
        self.members, self.newton, self.dt = members, newton, dt
        self.d = np.zeros(len(members[0].L))  # the last increment
        self.scale = self.kinetic([x.levels[-1] for x in members])
        self.begin()

    def begin(self):
        """B := H^-1, H of the tangents at t = 0 (M4)."""
        self.H = sum(x.response() for x in self.members)
        self.B = np.linalg.inv(self.H)

    def kinetic(self, ends):
        """sum_i v_i . M_i v_i over the subdomains with internal forces."""
        both = zip(self.members, ends, strict=True)
        return sum(y.v @ x.subdomain.M @ y.v for x, y in both if has_internal(x.subdomain))

    def solve(self, Lam, g, t):
        """The runs that satisfy the constraints, and the number of passes."""
        d, step, r_old = self.d, None, None
        work = [np.zeros(x.subdomain.substeps, dtype=int) for x in self.members]
        scales = [x.scale for x in self.members]
        for count in range(1, self.newton.iterations + 1):
            for x, scale in zip(self.members, scales, strict=True):
                x.scale = scale
            runs = [x.run(Lam, d) for x in self.members]
            ends = [levels[-1] for levels in runs]
            for sums, levels in zip(work, runs, strict=True):
                sums += [y.iterations for y in levels]
            # (N14)  r = sum_i L_i v_i - g
            r = jump([x.L for x in self.members], [y.v for y in ends]) - g
            if r_old is not None:
                self.update(step, r - r_old)
            step = -self.B @ r
            scale = max(self.scale, self.kinetic(ends))
            c = 0.1 if count == 1 else 10.0
            motion = scale + sum(max(x.scale, 0.0) for x in self.members)
            found = sum(max(-x.scale, 0.0) for x in self.members)  # rounding (N9)
            limit = c * max(self.newton.tol * np.sqrt(motion), 100.0 * np.sqrt(found))
            # what the multipliers moved, and what is summed in r
            ties = zip(self.members, ends, strict=True)
            terms = abs(self.H) @ abs(Lam + d) + abs(g) + sum(abs(x.L @ y.v) for x, y in ties)
            rounding = (abs(r) <= 100.0 * EPS * terms).all()
            if rounding or np.sqrt(abs(step @ r) * self.dt) <= limit:  # (N16)
                self.d, self.scale = d, scale
                return [counted(*x) for x in zip(runs, work, strict=True)], count
            d, r_old = d + step, r
        raise ConvergenceError(None, t, count)

    def update(self, step, y):
        """B += (step - B y) (step^T B) / (step^T B y) (N15)."""
        By = self.B @ y
        if step @ By != 0.0:
            self.B = self.B + np.outer(step - By, step @ self.B) / (step @ By)


def counted(levels, iterations):
    """The states with their iterations in all passes."""
    return [replace(y, iterations=n) for y, n in zip(levels, iterations, strict=True)]


def run_macro(subdomains, L, dt, steps, newton=None, g=None):
    """Coupled run from t = 0 under "macro"; parameters as for `run`, any numbers of substeps.

    Multipliers and jumps of the Result are those at the ends of the macro steps.
    """
    if any(s.double and s.substeps > 1 for s in subdomains):
        raise ValueError("a subdomain with double steps must have one substep")
    newton, g = newton or Newton(), g or (lambda t: np.zeros(len(L[0])))
    both = enumerate(zip(subdomains, L, strict=True))
    members = [MacroMember(i, s, Li, dt, newton) for i, (s, Li) in both]
    multipliers, times, passes = [start(members, L)], [0.0], []
    jumps = [jump(L, [s.v0 for s in subdomains])]
    shooting = Shooting(members, newton, dt)
    for k in range(1, steps + 1):
        t = instant(k, 1, dt)
        runs, count = shooting.solve(multipliers[-1], g(t), t)
        for x, levels in zip(members, runs, strict=True):
            x.levels.extend(levels)
        multipliers.append(multipliers[-1] + shooting.d)
        times.append(t)
        passes.append(count)
        jumps.append(jump(L, [x.levels[-1].v for x in members]) - g(t))
        if k == 1 and any(s.double for s in subdomains):
            for x in members:
                x.begin_double_steps()
            shooting.begin()
    return result(members, L, multipliers, times, jumps, g, passes)
