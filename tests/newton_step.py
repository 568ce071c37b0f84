"""Newton's method for internal forces in one or more steps, in plain dense NumPy.

It continues tests/reference.py with subdomains

    M w + C v + K u + r(t, u, v) + f(t, u, v; q) = F(t) + L^T Lam                      (N1)

whose internal force f is iterated with its tangents; q is the history of f, such as plastic
strains. The schedules are in tests/newton_reference.py. Numbers are those of docs/method.md:

    (N2)  residual of a step                (N7)   forces of each row, acceptance
    (N3)  tangent matrix and correction     (N8)   rounding by rows
    (N4)  first guess                       (N9)   corrections that are rounding
    (N5)  energy of a correction            (N10)  slope of the line search
    (N6)  energy scale                      (N11)  affine law of the interface velocity
                                            (N12)  interface problem of an iteration

All others, and the symbols, are those of tests/reference.py; s of (N6) is `scale`, its square.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from reference import State, Subdomain

EPS = np.finfo(float).eps
SHARE = 1e-3  # of the largest force, below which no row has to be balanced (N7)
UNKNOWN = 1e3  # what is left where the rate is not known
LEAP, BEGAN = 1e3, 1e-11  # a residual that has jumped, from what is no less than this (N9)

# ---- the problem ----------------------------------------------------------------------------


@dataclass
class Nonlinear(Subdomain):
    """A subdomain with an internal force f(t, u, v; q) (N1).

    Attributes
    ----------
    internal : callable
        evaluate(t, u, v, q) -> f (n,), K_t (n, n), C_t (n, n), q1 (m,): the force, its tangents
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
        Tolerance of (N7): of residuals and of the error that is left.
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
    return replace(s, restoring=lambda t, u, v: s.restore(t, u, v) + s.internal(t, u, v, q)[0])


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
        self.renews = True  # the tangent of the iterate is the one that will solve
        self.residual = None  # what the last correction began with, with its multipliers
        self.leapt = False  # the force has jumped within rounding (N9)
        # the forces at the beginning, with the load at the end
        self.forces = abs(self.s.load(t1)) + abs(self.L.T) @ abs(Lam) + abs(self.s.M) @ abs(old.w)
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
        f, K_t, C_t, _ = self.s.internal(self.t1, u, v, self.old.q)
        # (N2)  R = g + L^T Lam - Mbar w - f, g the right-hand side of (11)
        self.R = self.g + self.L.T @ self.Lam - self.step.mbar @ w - f
        # (N3)  Mbar_t = Mbar + al2 C_t + al1 K_t
        self.fresh = self.step.mbar + self.al2 * C_t + self.al1 * K_t
        self.measure(f)
        self.leapt = self.leapt or self.leap() > LEAP

    def measure(self, f):
        """The residual by rows, against its scale (N7) and its rounding (N8)."""
        s, mbar, pull = self.s, self.step.mbar, abs(self.L.T) @ abs(self.Lam)
        linear = s.C @ self.vt + s.K @ self.ut
        given = abs(self.g + linear) + pull
        inner = abs(f) + abs((mbar - s.M) @ self.w + linear)
        terms = inner + given + abs(s.M) @ abs(self.w)
        base = np.diag(mbar)
        tangent = self.fresh if self.renews else self.member.tangent
        root = np.sqrt(abs(base) + abs(np.diag(tangent) - base))
        s2 = self.member.scale / self.al1
        found = np.sqrt(max(0.0, -s2))  # (N9)
        whole = abs(np.diag(tangent) - base) / self.al1 * abs(self.displacement(self.w))
        self.rounding = root * max(EPS * max((100.0 * terms + 10.0 * whole) / root), found)
        forces = np.maximum(self.forces, terms)
        largest = max(max((forces - pull) / root), np.sqrt(max(0.0, s2)))
        self.scale = np.maximum(forces, SHARE * largest * root)

    def part(self, R):
        """The largest |R_j| in parts of its scale, of the rows in which it is not rounding."""
        return worst(np.where(abs(R) <= self.rounding, 0.0, R), self.scale)

    def leap(self):
        """The residual in parts of the one that the last correction began with (N9)."""
        return 0.0 if self.residual is None else self.part(self.R) / max(self.residual, BEGAN)

    def fixed(self, residual):
        """Whether the force has jumped, and this residual stands for rounding as well (N9)."""
        return self.leapt and residual <= BEGAN

    def left(self):
        """What the residual leaves to be balanced: nothing where the subdomain stays (N9)."""
        part = self.part(self.R)
        return 0.0 if self.fixed(part) else part

    def refresh(self):
        """Take the tangent of the iterate."""
        self.member.tangent = self.fresh

    def solve(self, g):
        return np.linalg.solve(self.member.tangent, g)

    def law(self):
        """o and G of the interface velocity o + G Lam, linearized at the iterate (N11)."""
        # G = al2 L Mbar_t^-1 L^T,  o = L (v + al2 Mbar_t^-1 R) - G Lam*
        G = self.al2 * self.L @ self.solve(self.L.T)
        return self.L @ (self.velocity(self.w) + self.al2 * self.solve(self.R)) - G @ self.Lam, G

    def correction(self, Lam):
        """dw, with its energy (N5) and the scale it leads to (N6)."""
        load = self.R + self.L.T @ (Lam - self.Lam)
        self.residual = self.part(load)
        dw = self.solve(load)  # (N3)
        if self.fixed(self.residual):
            dw = 0.0 * dw
        du = self.displacement(self.w + dw) - self.old.u
        return dw, abs(self.al1 * dw @ load), du @ self.member.tangent @ du / self.al1

    def closed(self):
        """The state at the end of the step; the history is taken over."""
        am, af, old = self.s.am, self.s.af, self.old
        u, v, w = self.displacement(self.w), self.velocity(self.w), self.w
        a = ((1 - af) * w + af * old.w - am * old.a) / (1 - am)  # (9)
        q = self.s.internal(self.t1, u, v, old.q)[3] if old.q.size else old.q
        return Level(self.t1, u, v, w, a, v, q, self.Lam, self.iterations)


def worst(R, scale):
    """max |R_j| / scale_j, where 0 / 0 is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(abs(R) / scale, nan=0.0, posinf=np.inf).max(initial=0.0)


# ---- Newton's iteration ---------------------------------------------------------------------


@dataclass
class Correction:
    """A correction of all trials: from where, by what, its slope there, a stale tangent or not."""

    start: list  # (w, Lam) of each trial
    change: list  # (dw, dLam) of each trial
    slope: float
    stale: bool

    def at(self, x):
        """The iterates at the fraction x of the correction, with the new multipliers."""
        pairs = zip(self.start, self.change, strict=True)
        return [(w + x * dw, Lam + dLam) for (w, Lam), (dw, dLam) in pairs]


class Iteration:
    """Newton's iteration of one or more trials together.

    Parameters
    ----------
    trials : list of Trial
    newton : Newton
    others : (o, H) or None
        Sum of the laws (N11) of all other subdomains, with -g in o; None: multipliers fixed.
    """

    def __init__(self, trials, newton, others=None):
        self.trials, self.newton, self.others = trials, newton, others
        self.first = [(x.w, x.Lam) for x in trials]
        self.scales = [x.member.scale for x in trials]
        self.always = newton.tangent == "full"  # fresh tangents in every iteration
        self.begin()

    def begin(self):
        """At the first guess."""
        self.move(self.first)
        for x in self.trials:
            x.residual = None
        self.due = any(x.member.tangent is None for x in self.trials)
        self.e = None  # root energy of the last correction
        self.tied = False  # the iterates satisfy the constraints
        self.parted = False  # ... but not with those that are not iterated
        self.close = False  # the last correction was small enough (N7)
        self.last = None  # the last correction, if its slope is to be tested

    def move(self, iterates):
        for x, (w, Lam) in zip(self.trials, iterates, strict=True):
            x.move(w, Lam)

    def run(self):
        """Iterate up to the accepted iterates."""
        for count in range(1, self.newton.iterations + 1):
            self.evaluate()
            if self.accepts(self.balanced()):
                count -= 1
                break
            self.count = count
            self.correct()
        else:
            for x in self.trials:
                x.evaluate()
            if not self.accepts(self.balanced()) and not self.rounding():
                self.fail()
        for x, scale in zip(self.trials, self.scales, strict=True):
            x.iterations += count
            x.member.scale = scale

    def balanced(self):
        """Whether the residual at the iterates is small enough (N7)."""
        left = max(x.left() for x in self.trials)
        return self.holds() and (left == 0.0 or (self.close and left <= self.newton.tol))

    def fail(self):
        worst = self.trials[int(np.argmax(self.energies))]
        raise ConvergenceError(worst.member.index, worst.t1, self.count)

    def rounding(self):
        """Whether corrections that do not shrink are rounding; they are then accepted (N9)."""
        if self.last is None or not max(y.leap() for y in self.trials) <= LEAP:
            return False
        ends = [(y.w, y.Lam) for y in self.trials]
        # the slope does not follow the tangent over 2^-20 of the last correction, but over 2^30
        if self.departure(2.0**-20) <= 0.1 or not self.departure(2.0**30) <= 0.1:
            return False
        self.move(ends)
        self.scales = [
            -100.0 * abs(scale) if y.residual > 1e-6 else scale
            for y, scale in zip(self.trials, self.scales, strict=True)
        ]
        return True

    def departure(self, x):
        """Departure of s(x) from (1 - x) s(0), that of the tangent, relative to x s(0)."""
        self.move(self.last.at(x))
        return abs(self.slope() - (1.0 - x) * self.last.slope) / abs(x * self.last.slope)

    def evaluate(self):
        """R and tangents at the iterates; the slope tests of the correction that led to them."""
        self.fresh = self.always or (self.due and not self.close)
        for x in self.trials:
            x.renews = self.fresh
        s_1 = self.slope() if self.last else None
        if self.last is None or self.balanced():
            pass
        elif self.last.stale:
            if not abs(s_1) <= 0.8 * abs(self.last.slope):
                # a stale tangent overshoots: back, and with fresh tangents from now on
                self.move(self.last.start)
                self.always, self.fresh, self.close, self.e = True, True, False, None
        elif self.last.slope > 0.0 and not s_1 >= -0.8 * self.last.slope:
            x = self.search(s_1)
            self.close, self.parted = self.small(x), True
            self.e *= x
        for x in self.trials:
            x.renews = self.fresh
            x.evaluate()

    def slope(self):
        """s = sum_i al2_i dw_i . R_i at the iterates, dw the last correction (N10)."""
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

    def holds(self):
        """Whether the constraints hold; those that are not iterated have all of a correction."""
        fixed = self.others is not None and self.others[1].any()
        return self.tied and not (self.parted and self.pulls and fixed)

    def accepts(self, good):
        return good

    def multipliers(self):
        """Lam of each trial after the correction (N12)."""
        if self.others is None:
            return [x.Lam for x in self.trials]
        laws = [self.others, *(x.law() for x in self.trials)]
        # H Lam = g - sum o,  H = sum G
        Lam = np.linalg.solve(sum(G for _, G in laws), -sum(o for o, _ in laws))
        return [Lam] * len(self.trials)

    def correct(self):
        """Correct the iterates (N3)."""
        trials, fresh = self.trials, self.fresh
        if fresh:
            for x in trials:
                x.refresh()
        Lam = self.multipliers()
        parts = [x.correction(y) for x, y in zip(trials, Lam, strict=True)]
        self.energies = [energy for _, energy, _ in parts]
        e = np.sqrt(sum(self.energies))
        theta = e / self.e if self.e else None
        if not fresh and not (e < np.inf and (theta is None or theta <= 1.0)):
            # a stale tangent does not converge: from the first guess with fresh ones
            self.always = True
            self.begin()
            return
        if not e < np.inf:
            self.fail()
        start = [(x.w, x.Lam) for x in trials]
        change = [(dw, y - x.Lam) for (dw, _, _), y, x in zip(parts, Lam, trials, strict=True)]
        last = Correction(start, change, 0.0, stale=not fresh)
        for x, (dw, dLam) in zip(trials, change, strict=True):
            last.slope += x.al2 * dw @ (x.R + x.L.T @ dLam)
        self.last, self.tied = (last if self.tied else None), True
        self.parted = False
        self.pulls = any(
            (abs(x.L.T @ dLam) > 100.0 * x.rounding).any()
            for x, (_, dLam) in zip(trials, change, strict=True)
        )
        self.move([(w + dw, y) for (w, _), (dw, _), y in zip(start, change, Lam, strict=True)])
        self.e, self.due = e, theta is not None and theta > 0.2
        motions = [max(x.member.scale, part[2]) for x, part in zip(trials, parts, strict=True)]
        motion = np.sqrt(sum(motions))
        self.scales = [  # what is found to be rounding stays so
            new if new > -100.0 * x.member.scale else x.member.scale
            for x, new in zip(trials, motions, strict=True)
        ]
        self.rate, self.allowed = rate_of(theta), self.newton.tol * motion
        self.close = self.small(1.0)

    def small(self, x):
        """Whether what is left is small after this part of the last correction (N7)."""
        return (self.rate + 1.0 - x) * self.e <= self.allowed


def rate_of(theta):
    """The error that is left after a correction, relative to the correction (N7)."""
    return UNKNOWN if theta is None or theta >= 1.0 else min(UNKNOWN, theta / (1.0 - theta))
