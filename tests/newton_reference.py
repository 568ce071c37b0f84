"""Newton's method for internal forces in plain dense NumPy: the oracle, beside docs/method.md.

It continues tests/reference.py, whose pieces it uses, with subdomains

    M w + C v + K u + r(u, v, t) + f(u, v, t; q) = F(t) + L^T Lam                      (N1)

whose internal force f is iterated with its tangents, under "gc" and "pm" (`run`) and under "macro"
(`run_macro`). q is the history of f, such as plastic strains. pmalpha is never imported.

    (N2)  residual of a step                    (N9)         slope of the line search
    (N3)  tangent matrix and correction         (N10) (N11)  affine law of the interface velocity
    (N4)  first guess                           (N12)        coarse subdomain within its substep
    (N5)  energy of a correction                (N13)        shooting for dLam
    (N6)  energy scale                          (N14)        Broyden's update
    (N7)  acceptance                            (N15)        acceptance of a pass
    (N8)  rounding floor                        (N16)        history at the start

All other numbers and symbols are those of tests/reference.py; s in (N6) is `scale` here.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from reference import (
    State,
    Step,
    Subdomain,
    check,
    initial_accelerations,
    instant,
    jump,
    without_load,
)

EPS = np.finfo(float).eps

# ---- the problem ----------------------------------------------------------------------------


@dataclass
class Nonlinear(Subdomain):
    """A subdomain with an internal force f(u, v, t; q) (N1).

    Attributes
    ----------
    internal : callable
        evaluate(u, v, t, q) -> f (n,), K_t (n, n), C_t (n, n), q1 (m,): the force, its tangents
        df/du and df/dv, and the history at the end of a step that began with q. An implicit
        subdomain iterates it; an explicit one evaluates it once per step, at ut and v + h w.
    history : (m,) ndarray or None
        q with which the evaluation at t = 0 begins; None: no history.
    """

    internal: Callable | None = None
    history: np.ndarray | None = None

    def __post_init__(self):
        super().__post_init__()
        self.history = np.array([] if self.history is None else self.history, dtype=float)


@dataclass
class Newton:
    """Parameters of the iteration.

    Attributes
    ----------
    tol : float
        Tolerance of (N7), relative to the energy scale (N6).
    iterations : int
        Largest number of iterations of one solution, and of passes of a macro step.
    tangent : {"full", "reuse"}
        Tangents evaluated anew in every iteration, or kept as long as they converge.
    """

    tol: float = 1e-8
    iterations: int = 40
    tangent: str = "full"


class ConvergenceError(RuntimeError):
    """No convergence of `subdomain` (an index) at `time`, after `iterations`."""

    def __init__(self, subdomain, time, iterations):
        super().__init__(f"subdomain {subdomain} at t = {time:g}: {iterations} iterations")
        self.subdomain, self.time, self.iterations = subdomain, time, iterations


def with_force(s, q):
    """A subdomain with f among its restoring forces, for the history q."""
    if getattr(s, "internal", None) is None:
        return s
    return replace(s, restoring=lambda u, v, t: s.restore(u, v, t) + s.internal(u, v, t, q)[0])


# ---- one step of one subdomain --------------------------------------------------------------


@dataclass
class Level(State):
    """State at a time level with the history q, the multipliers and the number of iterations."""

    q: np.ndarray
    Lam: np.ndarray
    iterations: int


class Trial:
    """A step from the state `old` to t1 that is being iterated: the iterate w and its multipliers.

    Parameters
    ----------
    member : Member
        Of an implicit subdomain with an internal force.
    old : Level
        Where the step begins.
    t1 : float
    Lam : (p,) ndarray
        Multipliers of the first iterate.
    """

    def __init__(self, member, old, t1, Lam):
        self.member, self.old, self.t1 = member, old, t1
        self.step, self.s, self.L = member.step, member.subdomain, member.L
        self.al1, self.al2 = self.step.al1, self.step.al2
        self.ut, self.vt, self.g = self.step.right_side(old, t1)
        self.guess = (old.v - self.vt) / self.al2  # (N4)  v_1 = v_n
        self.iterations = 0
        self.move(self.guess, Lam)

    def move(self, w, Lam):
        """Take the iterate w with the multipliers Lam; it is not yet evaluated."""
        self.w, self.Lam, self.R = w, Lam, None

    def displacement(self, w):
        return self.ut + self.al1 * w  # (8)

    def velocity(self, w):
        return self.vt + self.al2 * w  # (8)

    def evaluate(self):
        """R and the tangent matrix at the iterate (N2) (N3)."""
        if self.R is not None:
            return
        u, v, w = self.displacement(self.w), self.velocity(self.w), self.w
        f, K_t, C_t, _ = self.s.internal(u, v, self.t1, self.old.q)
        # (N2)  R = g + L^T Lam - Mbar w - f, g the right-hand side of (11)
        self.R = self.g + self.L.T @ self.Lam - self.step.mbar @ w - f
        # (N3)  Mbar_t = Mbar + al2 C_t + al1 K_t
        self.fresh = self.step.mbar + self.al2 * C_t + self.al1 * K_t
        # (N8)  |u| . (|f| + |C v + K u + r| + |F| + |L^T Lam|) + al1 |w| . |M| |w|
        F = self.s.load(self.t1)
        others = (self.step.mbar - self.s.M) @ w - self.g + F
        forces = abs(f) + abs(others) + abs(F) + abs(self.L.T @ self.Lam)
        self.rounding = abs(u) @ forces + self.al1 * abs(w) @ abs(self.s.M) @ abs(w)

    def refresh(self):
        """Take the tangent of the iterate."""
        self.member.tangent = self.fresh

    def solve(self, g):
        return np.linalg.solve(self.member.tangent, g)

    def law(self):
        """o and G of the interface velocity o + G Lam, linearized at the iterate (N10)."""
        # G = al2 L Mbar_t^-1 L^T,  o = L (v + al2 Mbar_t^-1 R) - G Lam*
        G = self.al2 * self.L @ self.solve(self.L.T)
        return self.L @ (self.velocity(self.w) + self.al2 * self.solve(self.R)) - G @ self.Lam, G

    def correction(self, Lam):
        """dw, with its energy (N5) and the scale it leads to (N6)."""
        load = self.R + self.L.T @ (Lam - self.Lam)
        dw = self.solve(load)  # (N3)
        du = self.displacement(self.w + dw) - self.old.u
        return dw, abs(self.al1 * dw @ load), du @ self.member.tangent @ du / self.al1

    def closed(self):
        """The state at the end of the step; the history is taken over."""
        am, af, old = self.s.am, self.s.af, self.old
        u, v, w = self.displacement(self.w), self.velocity(self.w), self.w
        a = ((1 - af) * w + af * old.w - am * old.a) / (1 - am)  # (9)
        q = self.s.internal(u, v, self.t1, old.q)[3] if old.q.size else old.q
        return Level(self.t1, u, v, w, a, v, q, self.Lam, self.iterations)


# ---- Newton's iteration ---------------------------------------------------------------------


@dataclass
class Correction:
    """A correction of all trials: from where, by what, its slope there, a stale tangent or not."""

    start: list  # (w, Lam) of each trial
    change: list  # (dw, dLam) of each trial
    slope: float
    stale: bool

    def at(self, x):
        """The iterates at the fraction x of the correction."""
        pairs = zip(self.start, self.change, strict=True)
        return [(w + x * dw, Lam + x * dLam) for (w, Lam), (dw, dLam) in pairs]


class Iteration:
    """Newton's iteration of one or more trials together.

    Parameters
    ----------
    trials : list of Trial
    newton : Newton
    others : (o, H) or None
        Sum of the laws (N10) of all other subdomains, with -g in o; None: multipliers fixed.
    """

    def __init__(self, trials, newton, others=None):
        self.trials, self.newton, self.others = trials, newton, others
        self.first = [(x.w, x.Lam) for x in trials]
        self.always = newton.tangent == "full"  # fresh tangents in every iteration
        self.begin()

    def begin(self):
        """At the first guess."""
        self.move(self.first)
        self.due = any(x.member.tangent is None for x in self.trials)
        self.e = None  # root energy of the last correction
        self.tied = False  # the iterates satisfy the constraints
        self.last = None  # the last correction, if its slope is to be tested

    def move(self, iterates):
        for x, (w, Lam) in zip(self.trials, iterates, strict=True):
            x.move(w, Lam)

    def run(self):
        """Iterate up to the accepted iterates."""
        for count in range(1, self.newton.iterations + 1):
            self.evaluate()
            if self.correct():
                for x in self.trials:
                    x.iterations += count
                return
        if not self.rounding():
            self.fail(count)
        for x in self.trials:
            x.iterations += count

    def fail(self, count):
        worst = self.trials[int(np.argmax(self.energies))]
        raise ConvergenceError(worst.member.index, worst.t1, count)

    def rounding(self):
        """Whether corrections that do not shrink are rounding; they are then accepted (N9)."""
        if self.last is None:
            return False
        # f is linear, with the tangent used, over 2^20 times the last correction
        x, ends = 2.0**20, [(y.w, y.Lam) for y in self.trials]
        self.move(self.last.at(x))
        expected = (1.0 - x) * self.last.slope
        if not abs(self.slope() - expected) <= 0.1 * abs(expected):
            return False
        self.move(ends)
        for y, energy in zip(self.trials, self.energies, strict=True):
            y.member.scale = max(y.member.scale, 1e6 * energy / self.newton.tol**2)
        return True

    def evaluate(self):
        """R and tangents at the iterates; the slope tests of the correction that led to them."""
        s_1 = self.slope() if self.last else None
        if self.last is None:
            pass
        elif self.last.stale:
            if not abs(s_1) <= 0.8 * abs(self.last.slope):
                # a stale tangent overshoots: back, and with fresh tangents from now on
                self.move(self.last.start)
                self.always, self.e = True, None
        elif self.last.slope > 0.0 and not s_1 >= -0.8 * self.last.slope:
            self.e *= self.search(s_1)
        for x in self.trials:
            x.evaluate()

    def slope(self):
        """s = sum_i al2_i dw_i . R_i at the iterates, dw the last correction (N9)."""
        for x in self.trials:
            x.evaluate()
        change = zip(self.trials, self.last.change, strict=True)
        return sum(x.al2 * dw @ x.R for x, (dw, _) in change)

    def search(self, s_1):
        """Line search along the last correction, with the slope s_1 at its end; the fraction x."""
        low, s_low, high, s_high = 0.0, self.last.slope, 1.0, s_1
        for _ in range(8):
            x = 0.5 * (low + high)
            if np.isfinite(s_high):
                secant = low + (high - low) * s_low / (s_low - s_high)
                x = np.clip(secant, 0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
            self.move(self.last.at(x))
            s = self.slope()
            if abs(s) <= 0.5 * self.last.slope:
                break
            if s > 0.0:
                low, s_low = x, s
            else:
                high, s_high = x, s
        return x

    def multipliers(self):
        """Lam of each trial after the correction (N11)."""
        if self.others is None:
            return [x.Lam for x in self.trials]
        laws = [self.others, *(x.law() for x in self.trials)]
        # H Lam = g - sum o,  H = sum G
        Lam = np.linalg.solve(sum(G for _, G in laws), -sum(o for o, _ in laws))
        return [Lam] * len(self.trials)

    def correct(self):
        """Correct the iterates (N3); True if they are then accepted (N7)."""
        trials = self.trials
        fresh = self.always or self.due
        if fresh:
            for x in trials:
                x.member.tangent = x.fresh
        floor = 100.0 * EPS * np.sqrt(sum(x.rounding for x in trials))  # (N8)
        Lam = self.multipliers()
        parts = [x.correction(y) for x, y in zip(trials, Lam, strict=True)]
        self.energies = [energy for _, energy, _ in parts]
        e = np.sqrt(sum(self.energies))
        theta = None if self.e is None else e / self.e
        if not fresh and not (e < np.inf and (theta is None or theta <= 1.0)):
            # a stale tangent does not converge: from the first guess with fresh ones
            self.always = True
            self.begin()
            return False
        if not e < np.inf:
            self.fail(0)
        start = [(x.w, x.Lam) for x in trials]
        change = [(dw, y - x.Lam) for (dw, _, _), y, x in zip(parts, Lam, trials, strict=True)]
        last = Correction(start, change, 0.0, stale=not fresh)
        last.slope = sum(x.al2 * dw @ x.R for x, (dw, _) in zip(trials, change, strict=True))
        self.last, self.tied = (last if self.tied else None), True
        self.move([(w + dw, y) for (w, _), (dw, _), y in zip(start, change, Lam, strict=True)])
        self.e, self.due = e, theta is not None and theta > 0.2
        scales = [max(x.member.scale, part[2]) for x, part in zip(trials, parts, strict=True)]
        if accepted(e, theta, self.newton.tol * np.sqrt(sum(scales)), floor):
            for x, scale in zip(trials, scales, strict=True):
                x.member.scale = scale
            return True
        return False


def accepted(e, theta, limit, floor):
    """Whether a correction of the root energy e was the last one (N7)."""
    converged = theta is not None and theta < 1.0 and theta / (1.0 - theta) * e <= limit
    return converged or e <= 1e-3 * limit or e <= floor


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
        q = s.internal(s.u0, s.v0, 0.0, q)[3] if q.size else q  # (N16)
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
        ut, vs = step.right_side(old, t1)[0], old.v + step.h * old.w
        q = s.internal(ut, vs, t1, old.q)[3] if old.q.size else old.q
        return step.free(old, t1), q

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


def start(members, L):
    """States at t = 0; returns Lam_0 (S1), with f(u_0, v_0, 0; q) among the forces."""
    forces = [with_force(x.subdomain, getattr(x.subdomain, "history", None)) for x in members]
    w0, Lam = initial_accelerations(forces, L)
    for x, w in zip(members, w0, strict=True):
        x.begin(w, Lam)
    return Lam


def result(members, L, multipliers, times, jumps, passes=()):
    names = ("t", "u", "v", "w", "a", "q", "iterations")
    steps = (len(members[0].levels) - 1) // members[0].subdomain.substeps
    macro = [[x.levels[m * x.subdomain.substeps].u for x in members] for m in range(steps + 1)]
    return Result(
        subdomains=[
            SubdomainResult(*(np.array([getattr(y, name) for y in x.levels]) for name in names))
            for x in members
        ],
        multipliers=np.array(multipliers),
        multiplier_times=np.array(times),
        velocity_jump=np.array(jumps),
        displacement_jump=np.array([jump(L, u) for u in macro]),
        passes=np.array(passes),
    )


# ---- "gc" and "pm" --------------------------------------------------------------------------


class FineMember(Member):
    """A subdomain under "gc" and "pm": opened, and at every fine instant a law o + G Lam (N10).

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
            self.trial = Trial(self, old, t1, old.Lam)
            if self.stride == 1:
                return
            # the free solution: Newton's iteration at fixed multipliers, then one fresh tangent
            Iteration([self.trial], self.newton).run()
            self.trial.evaluate()
            self.tangent = self.trial.fresh
            o, G = self.trial.law()
        # (N12)  o_n = L v_n - G_{n+1} Lam_n
        self.compliance, self.ends = G, (self.L @ level.v - G @ level.Lam, o)

    def law(self, k):
        """o and G at instant k of a subdomain that is not iterated there (N10) (N12)."""
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
    return result(members, L, multipliers, times, jumps)


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
    """A subdomain under "macro": its substeps under known multipliers (N13)."""

    def response(self):
        """Interface velocity for unit multipliers, linearized at t = 0, shape (p, p) (M3)."""
        s, p, ss = self.subdomain, len(self.L), self.subdomain.substeps
        if getattr(s, "internal", None) is not None:
            _, K_t, C_t, _ = s.internal(s.u0, s.v0, 0.0, s.history)
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
    """The increment dLam that closes the constraints at the ends of macro steps (N13) to (N15).

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
        """sum_i v_i . M_i v_i, twice the kinetic energy."""
        return sum(y.v @ x.subdomain.M @ y.v for x, y in zip(self.members, ends, strict=True))

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
            # (N13)  r = sum_i L_i v_i - g
            r = jump([x.L for x in self.members], [y.v for y in ends]) - g
            if r_old is not None:
                self.update(step, r - r_old)
            step = -self.B @ r
            scale = max(self.scale, self.kinetic(ends))
            limit = (0.1 if count == 1 else 10.0) * self.newton.tol * np.sqrt(scale)
            floor = 100.0 * EPS * np.sqrt(self.dt * abs(Lam + d) @ abs(self.H) @ abs(Lam + d))
            if np.sqrt(abs(step @ r) * self.dt) <= max(limit, floor):  # (N15)
                self.d, self.scale = d, scale
                return [counted(*x) for x in zip(runs, work, strict=True)], count
            d, r_old = d + step, r
        raise ConvergenceError(None, t, count)

    def update(self, step, y):
        """B += (step - B y) (step^T B) / (step^T B y) (N14)."""
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
    return result(members, L, multipliers, times, jumps, passes)
