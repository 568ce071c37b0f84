"""Runs with steps that change, in plain dense NumPy: section 16 of docs/method.md.

Beside `reference`, whose steps of constant length it uses. Each state carries the length of the
step that made its variable a, and every step takes from it what it needs:

    (Q1)  a := w + (h_new / h_a) (a - w)
    (Q2)  vf_n := v_n - al2 Mbar^-1 L^T Lam_n with the operator of the step at hand
    (Q3)  a double step over a change, from t_{n-1} to t_{n+1}

The first two can be left out, to see what happens then.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from reference import Free, State, Step, coefficients, initial_accelerations, jump, predictors


@dataclass
class Level:
    """A state and the length of the step that made its a; None where a = w."""

    state: State
    length: float | None


@dataclass
class Member:
    """One subdomain: its time levels, the last two of which a step may start from."""

    subdomain: object
    L: np.ndarray
    levels: list[Level] = field(default_factory=list)
    step: Step | None = None  # the one that is open
    opened: Free | None = None
    vf: np.ndarray | None = None  # stored free velocity for (15)


@dataclass
class Interval:
    """Macro steps of one kind: how many, of which length, with which substeps and double steps."""

    steps: int
    dt: float
    substeps: tuple
    doubles: tuple


@dataclass
class Rules:
    """What is done at a change."""

    stretch: bool = True  # (Q1)
    rebase: bool = True  # (Q2)


def start(subdomains, L):
    """The members at t = 0, and Lam_0 (S1)."""
    w0, Lam = initial_accelerations(subdomains, L)
    members = []
    for s, Li, w in zip(subdomains, L, w0):
        members.append(Member(s, Li, [Level(State(0.0, s.u0, s.v0, w, w, s.v0), None)]))
    return members, Lam


def stretched(level, h, rules, changed):
    """The state from which a step of length h starts (Q1)."""
    x = level.state
    if level.length is None or not (changed and rules.stretch):
        return x
    return replace(x, a=x.w + h / level.length * (x.a - x.w))


class Schedule:
    """The sequence of macro steps: number since the last change, its time, and its steps."""

    def __init__(self, intervals):
        self.intervals = intervals

    def __iter__(self):
        t0, changed = 0.0, False
        for interval in self.intervals:
            for k in range(interval.steps):
                yield interval, t0, k, changed
            t0, changed = t0 + interval.steps * interval.dt, True


def begins_anew(member, was_double, interval, i):
    """Whether double steps of a subdomain begin with a macro step of single steps."""
    return not was_double[i] or interval.substeps[i] > 1


def run(subdomains, L, intervals, rules=None):
    """A run under "gc" or "pm"; the states of all levels by subdomain, and the multipliers."""
    rules = Rules() if rules is None else rules
    members, Lam = start(subdomains, L)
    multipliers, was_double = [Lam], [False] * len(members)
    for interval, t0, k, changed in Schedule(intervals):
        fine = max(interval.substeps)
        if k == 0:
            anew = [begins_anew(m, was_double, interval, i) for i, m in enumerate(members)]
        for q in range(1, fine + 1):
            for i, m in enumerate(members):
                stride = fine // interval.substeps[i]
                if (q - 1) % stride == 0:
                    double = interval.doubles[i] and not (k == 0 and anew[i])
                    t1 = t0 + (k * fine + q - 1 + stride) / fine * interval.dt
                    open_step(
                        m, interval.dt / interval.substeps[i], t1, double, Lam, rules, changed
                    )
            Lam = solve(members, L, interval, fine, q)
            multipliers.append(Lam)
            for i, m in enumerate(members):
                if q % (fine // interval.substeps[i]) == 0:
                    m.levels.append(Level(m.step.close(m.opened, Lam), m.step.h))
        was_double = interval.doubles
    return members, np.array(multipliers)


def open_step(m, h, t1, double, Lam, rules, changed):
    before = m.step
    origin = m.levels[-2] if double else m.levels[-1]
    length = t1 - origin.state.t if double else h
    if abs(length - 2.0 * h) < 1e-9 * h:
        length = 2.0 * h
    known = before is not None and abs(before.h - length) < 1e-12 * length
    if not known:
        m.step = Step(m.subdomain, m.L, length)
    last = m.levels[-1].state
    if changed or before is None or not known:
        if before is None or rules.rebase or known or not changed:
            last = replace(last, vf=last.v - m.step.link(Lam)[1])  # (S2) (S3) (Q2)
    m.vf = last.vf
    m.opened = m.step.free(stretched(origin, length, rules, changed), t1)


def solve(members, L, interval, fine, q):
    """Lam of fine step q of a macro step (15) (18)."""
    vf = []
    for i, m in enumerate(members):
        stride = fine // interval.substeps[i]
        theta = (q % stride or stride) / stride
        vf.append((1.0 - theta) * m.vf + theta * m.opened.v)
    H = sum(m.step.compliance() for m in members)
    return np.linalg.solve(H, -jump(L, vf))


# ---- macro and mean coupling ---------------------------------------------------------------------


def substeps_of(m, i, interval, t0, k, double):
    """Lengths and end times of the substeps of a macro step; where they start."""
    count = interval.substeps[i]
    ends = [t0 + (k * count + j) / count * interval.dt for j in range(1, count + 1)]
    if double:
        origin = m.levels[-2]
        length = ends[0] - origin.state.t
        h = 2.0 * interval.dt if abs(length - 2.0 * interval.dt) < 1e-9 * length else length
        return origin, h, ends
    return m.levels[-1], interval.dt / count, ends


def run_macro(subdomains, L, intervals, rules=None):
    """A run under "macro", section 13."""
    rules = Rules() if rules is None else rules
    members, Lam = start(subdomains, L)
    multipliers, p = [Lam], len(L[0])
    first = True
    for interval, t0, k, changed in Schedule(intervals):
        runs, H = [], np.zeros((p, p))
        for i, m in enumerate(members):
            double = interval.doubles[i] and not first
            origin, h, ends = substeps_of(m, i, interval, t0, k, double)
            step = Step(m.subdomain, m.L, h)
            state = stretched(origin, h, rules, changed)
            known = chain(step, state, ends, [Lam] * len(ends))
            rest = Step(replace(m.subdomain, force=None), m.L, h)
            zero = State(0.0, *np.zeros((5, len(m.subdomain.M))))
            ramp = np.arange(1, len(ends) + 1) / len(ends)
            units = [chain(rest, zero, ends, np.outer(ramp, e)) for e in np.eye(p)]
            H += m.L @ np.array([unit[-1].v for unit in units]).T
            runs.append((step, known, units))
        dLam = np.linalg.solve(H, -jump(L, [known[-1].v for _, known, _ in runs]))
        for m, (step, known, units) in zip(members, runs):
            take(m, step.h, known, units, dLam)
        Lam = Lam + dLam
        multipliers.append(Lam)
        first = False
    return members, np.array(multipliers)


def chain(step, state, ends, Lam):
    states = []
    for t, lam in zip(ends, Lam):
        state = step.close(step.free(state, t), lam)
        states.append(state)
    return states


def take(m, h, known, units, Lam):
    """Known run plus unit responses: the new levels."""
    for j, state in enumerate(known):
        total = {
            x: getattr(state, x) + sum(c * getattr(u[j], x) for c, u in zip(Lam, units))
            for x in "uvwa"
        }
        m.levels.append(Level(replace(state, **total), h))


def run_mean(subdomains, L, intervals, rules=None):
    """A run under "mean", section 15, without damping."""
    rules = Rules() if rules is None else rules
    members, Lam0 = start(subdomains, L)
    for m in members:  # w_0 without multipliers
        x, y = m.levels[0].state, np.linalg.solve(m.subdomain.M, m.L.T @ Lam0)
        m.levels[0] = Level(replace(x, w=x.w - y, a=x.w - y), None)
    multipliers, p, before, dt_before = [], len(L[0]), np.zeros(len(Lam0)), 0.0
    for interval, t0, k, changed in Schedule(intervals):
        runs, H, dt = [], np.zeros((p, p)), interval.dt
        for i, m in enumerate(members):
            double = interval.doubles[i] and dt_before > 0.0
            origin, h, ends = substeps_of(m, i, interval, t0, k, double)
            share = dt / (dt_before + dt) if double else 1.0  # of the new multipliers (Q4)
            s = m.subdomain
            state = stretched(origin, h, rules, changed)
            held = (1.0 - share) * before
            known = mean_chain(s, h, state, ends, np.linalg.solve(s.M, m.L.T @ held))
            zero = State(0.0, *np.zeros((5, len(s.M))))
            rest = replace(s, force=None)
            units = [
                mean_chain(rest, h, zero, ends, share * np.linalg.solve(s.M, m.L.T @ e))
                for e in np.eye(p)
            ]
            H += m.L @ np.array([unit[-1].u for unit in units]).T
            runs.append((h, known, units))
        Lam = np.linalg.solve(H, -jump(L, [known[-1].u for _, known, _ in runs]))
        for m, (h, known, units) in zip(members, runs):
            take(m, h, known, units, Lam)
        multipliers.append(Lam)
        before, dt_before = Lam, dt
    return members, np.array(multipliers)


def mean_chain(s, h, state, ends, y):
    """Substeps under the constant acceleration y of the interface (K2)."""
    al1, al2 = coefficients(s, h)
    states = []
    for t in ends:
        ut, vt = predictors(s, state, h)
        ut, vt = ut + 0.5 * h * h * y, vt + h * y
        w = np.linalg.solve(s.mbar(h), s.load(t) - s.C @ vt - s.K @ ut)
        a = ((1 - s.af) * w + s.af * state.w - s.am * state.a) / (1 - s.am)
        state = State(t, ut + al1 * w, vt + al2 * w, w, a, vt)
        states.append(state)
    return states
