"""The method in plain dense NumPy: the oracle of the C core, to be read beside docs/method.md.

The code follows the equations literally, not fast: Mbar is dense, the free and the link problem are
two solves, the free velocity is stored on all dofs, and the states at all time levels are kept.
pmalpha is never imported.

Numbers in comments are the paper's (ACOMEN 2008) where it has one:

    (1)(2)    coupled problem            (11)      equilibrium solved for w
    (5)(6)    predictors                 (12)      Mbar
    (7)/(10)  equilibrium, impl./expl.   (13)(14)  free and link problem
    (8)       correctors                 (15)      interpolation of the free velocity
    (9)       recursion for a            (18)      interface problem

and those of docs/method.md where it has none:

    (P1)  am, af, beta, gamma from rho           (S2)  free velocity stored at t = 0
    (P2)  al1, al2                               (S3)  free velocity re-based after the start
    (S1)  consistent initial w and Lam           (T1)  fine instants t = (k / max(ss)) dt
    (R1)  extrapolated velocity                  (R2) (R3) (R4)  restoring force, lagged damping
    (M1)  Lam linear over a macro step           (M4)  interface problem of a macro step
    (M2)  free macro run                         (M5)  free macro run plus link response
    (M3)  link response                          (G1)  prescribed motion

Symbols: u, v, w displacement, velocity, acceleration; a the acceleration-like variable of the
scheme; dt the macro step; ss the number of substeps in it; h the length of a step, dt / ss or twice
that for a double step; Lam the Lagrange multipliers, the interface forces.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

# ---- one subdomain --------------------------------------------------------------------------


def alpha(rho, explicit=False):
    """Parameters of the generalized-alpha scheme, as keywords for `Subdomain` (P1).

    Parameters
    ----------
    rho : float
        In [0, 1]: rho_inf of the implicit, rho_b of the explicit scheme.
    explicit : bool
        Explicit or implicit scheme.

    Returns
    -------
    dict
        am, af, beta, gamma, explicit.

    Examples
    --------
    >>> alpha(1.0)["gamma"]
    0.5
    """
    am = (2.0 * rho - 1.0) / (rho + 1.0)
    af = rho / (rho + 1.0)
    gamma = 0.5 - am + af
    beta = (0.5 + gamma) ** 2 / 4.0
    return {"am": am, "af": af, "beta": beta, "gamma": gamma, "explicit": explicit}


@dataclass
class Subdomain:
    """One subdomain, M w + C v + K u + r(t, u, v) = F(t) + L^T Lam, its scheme and its step (1).

    The default scheme is the trapezoidal rule; `Subdomain(M, K, **alpha(0.5), substeps=20)` is
    generalized-alpha, `beta=0.0, explicit=True` the central difference.

    Attributes
    ----------
    M, K : (n, n) ndarray
    C : (n, n) ndarray or None
        None: no damping.
    am, af, beta, gamma : float
        Parameters of the scheme; am and af weight the old end of the step.
    explicit : bool
        Equilibrium (10) instead of (7).
    substeps : int
        ss, number of substeps in a macro step.
    double : bool
        Double steps, from t_{n-1} to t_{n+1}, from the second macro step on.
    force : callable or None
        F(t) -> (n,).
    restoring : callable or None
        Restoring force r(t, u, v) -> (n,).
    K_r, D_r : (n, n) ndarray or None
        Estimates of the stiffness and the damping of r (R2).
    lagged : bool
        Lagged damping: C acts on vs and is not in Mbar (R4).
    u0, v0 : (n,) ndarray or None
        State at t = 0, zero if None.
    """

    M: np.ndarray
    K: np.ndarray
    C: np.ndarray | None = None
    am: float = 0.0
    af: float = 0.0
    beta: float = 0.25
    gamma: float = 0.5
    explicit: bool = False
    substeps: int = 1
    double: bool = False
    force: Callable[[float], np.ndarray] | None = None
    restoring: Callable[[float, np.ndarray, np.ndarray], np.ndarray] | None = None
    K_r: np.ndarray | None = None
    D_r: np.ndarray | None = None
    lagged: bool = False
    u0: np.ndarray | None = None
    v0: np.ndarray | None = None

    def __post_init__(self):
        n = len(self.M)
        self.C = np.zeros((n, n)) if self.C is None else self.C
        self.K_r = np.zeros((n, n)) if self.K_r is None else self.K_r
        self.D_r = np.zeros((n, n)) if self.D_r is None else self.D_r
        self.u0 = np.zeros(n) if self.u0 is None else np.array(self.u0, dtype=float)
        self.v0 = np.zeros(n) if self.v0 is None else np.array(self.v0, dtype=float)

    def load(self, t):
        """F(t), shape (n,)."""
        return np.zeros(len(self.M)) if self.force is None else self.force(t)

    def restore(self, t, u, v):
        """r(t, u, v), shape (n,)."""
        return np.zeros(len(self.M)) if self.restoring is None else self.restoring(t, u, v)

    def mbar(self, h):
        """Mbar of a step of length h, shape (n, n) (12) (R3) (R4)."""
        al1, al2 = coefficients(self, h)
        C = 0.0 * self.C if self.lagged else self.C
        if self.explicit:
            return self.M + al2 * (C + self.D_r)
        return self.M + al2 * (C + self.D_r) + al1 * (self.K + self.K_r)


def coefficients(subdomain, h):
    """al1 and al2 of a step of length h (P2)."""
    q = (1.0 - subdomain.af) / (1.0 - subdomain.am)
    return h**2 * subdomain.beta * q, h * subdomain.gamma * q


# ---- one step -------------------------------------------------------------------------------


@dataclass
class State:
    """State of one subdomain at a time level t, with the stored free velocity vf.

    All fields but t are (n,) arrays.
    """

    t: float
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    vf: np.ndarray


@dataclass
class Free:
    """Solution of the free problem of a step from the state `old` to t: the step without Lam."""

    old: State
    t: float
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray


def predictors(subdomain, old, h):
    """ut and vt from the state `old` (5) (6)."""
    am, af, beta, gamma = subdomain.am, subdomain.af, subdomain.beta, subdomain.gamma
    u, v, w, a = old.u, old.v, old.w, old.a
    # (5)  ut = u + h v + h^2 (1/2 - beta/(1-am)) a + h^2 beta af/(1-am) w
    ut = u + h * v + h**2 * (0.5 - beta / (1 - am)) * a + h**2 * beta * af / (1 - am) * w
    # (6)  vt = v + h (1 - gamma/(1-am)) a + h gamma af/(1-am) w
    vt = v + h * (1 - gamma / (1 - am)) * a + h * gamma * af / (1 - am) * w
    return ut, vt


class Step:
    """A step of length h of one subdomain: its free problem and its link problem.

    Parameters
    ----------
    subdomain : Subdomain
    L : (p, n) ndarray
    h : float
    """

    def __init__(self, subdomain, L, h):
        self.subdomain, self.L, self.h = subdomain, L, h
        self.al1, self.al2 = coefficients(subdomain, h)
        self.mbar = subdomain.mbar(h)

    def solve(self, g):
        """Mbar^-1 g, of the shape of g."""
        return np.linalg.solve(self.mbar, g)

    def right_side(self, old, t1):
        """Predictors ut, vt and the right-hand side g of (11), each (n,), for the step to t1."""
        s = self.subdomain
        ut, vt = predictors(s, old, self.h)
        # (R1)  vs = v + h w
        vs = old.v + self.h * old.w
        # (7) (10) (11) (R3)  g = F(t1) - C vt - K ut - r(t1, ut, vs) - D_r (vt - vs)
        damping = s.C @ (vs if s.lagged else vt)  # (R4)
        r = s.restore(t1, ut, vs) + s.D_r @ (vt - vs)
        return ut, vt, s.load(t1) - damping - s.K @ ut - r

    def free(self, old, t1):
        """Free problem of the step from the state `old` to t1 = old.t + h (13)."""
        ut, vt, g = self.right_side(old, t1)
        wf = self.solve(g)  # Mbar wf = g
        # (8)  uf = ut + al1 wf, vf = vt + al2 wf
        return Free(old, t1, u=ut + self.al1 * wf, v=vt + self.al2 * wf, w=wf)

    def link(self, Lam):
        """Solution ul, vl, wl of the link problem for the multipliers Lam, each (n,) (14)."""
        # Mbar wl = L^T Lam, ul = al1 wl, vl = al2 wl
        wl = self.solve(self.L.T @ Lam)
        return self.al1 * wl, self.al2 * wl, wl

    def close(self, free, Lam):
        """State at the end of the step: free plus link solution, then the recursion (9)."""
        am, af, old = self.subdomain.am, self.subdomain.af, free.old
        ul, vl, wl = self.link(Lam)
        w = free.w + wl
        # (9)  a1 = ((1-af) w1 + af w - am a) / (1-am), with the total w1 = wf + wl
        a = ((1 - af) * w + af * old.w - am * old.a) / (1 - am)
        return State(free.t, free.u + ul, free.v + vl, w, a, vf=free.v)

    def compliance(self):
        """Contribution of the subdomain to H, shape (p, p) (18)."""
        # al2 L Mbar^-1 L^T
        return self.al2 * self.L @ self.solve(self.L.T)


# ---- the start ------------------------------------------------------------------------------


def initial_accelerations(subdomains, L):
    """Consistent initial accelerations and multipliers (S1).

    M_i w_i - L_i^T Lam = F_i(0) - C_i v_i - K_i u_i - r_i(u_i, v_i, 0) and sum_i L_i w_i = 0, for
    all subdomains at once.
    The null space of the matrix of this system is {w: M w = 0, L w = 0}, and Lam is
    unique. So in the minimum-norm solution w = 0 on massless dofs where no equation determines it.
    The scaling (unit diagonal of M, unit rows of L) distinguishes small masses from zero mass; all
    massless dofs are scaled by the same number.

    Returns
    -------
    w : list of (n_i,) ndarray
    Lam : (p,) ndarray
    """
    M = scipy.linalg.block_diag(*(s.M for s in subdomains))
    Lall = np.hstack(L)
    p, n = Lall.shape
    g = np.concatenate(
        [s.load(0.0) - s.C @ s.v0 - s.K @ s.u0 - s.restore(0.0, s.u0, s.v0) for s in subdomains]
    )

    # unknowns z = d w and y = Lam / c
    mass = np.diag(M)
    d = np.sqrt(np.where(mass > 0.0, mass, mass.max() or 1.0))
    Ms, Ls = M / np.outer(d, d), Lall / d
    c = 1.0 / np.linalg.norm(Ls, axis=1)
    Ls = c[:, None] * Ls

    # [[Ms, -Ls^T], [Ls, 0]] [z; y] = [g / d; 0]
    kkt = np.block([[Ms, -Ls.T], [Ls, np.zeros((p, p))]])
    x = np.linalg.lstsq(kkt, np.concatenate([g / d, np.zeros(p)]), rcond=None)[0]
    x[~kkt.any(axis=0)] = 0.0  # a dof in no equation: exactly zero
    ends = np.cumsum([len(s.M) for s in subdomains])
    return np.split(x[:n] / d, ends[:-1]), c * x[n:]


# ---- the coupled schedule -------------------------------------------------------------------


class Stepper:
    """The steps of one subdomain under "gc" and "pm".

    Parameters
    ----------
    subdomain : Subdomain
    L : (p, n) ndarray
    dt : float
        Macro step.
    fine : int
        max(ss), number of fine steps in a macro step.
    """

    def __init__(self, subdomain, L, dt, fine):
        self.subdomain, self.dt, self.fine = subdomain, dt, fine
        self.stride = fine // subdomain.substeps  # fine steps in a substep
        h = dt / subdomain.substeps
        self.step = Step(subdomain, L, h)  # all subdomains take single steps in macro step 1
        self.later = Step(subdomain, L, 2.0 * h) if subdomain.double else self.step
        self.back = 0  # a step starts from states[n - back]: 0 single, 1 double step
        self.states = []  # states[n]: state at time level n of the subdomain
        self.opened = None  # free solution of the step that is open

    def position(self, k):
        """Last time level n at or before fine instant k, and the j fine steps from n to k."""
        return divmod(k, self.stride)

    def begin(self, w, Lam):
        """The state at t = 0."""
        # (S2)  vf_0 = v_0 - al2 Mbar^-1 L^T Lam_0;  (9)  a_0 = w_0
        u0, v0 = self.subdomain.u0, self.subdomain.v0
        self.states.append(State(0.0, u0, v0, w, w, vf=v0 - self.step.link(Lam)[1]))

    def open(self, k):
        """Open the step to t_{n+1} if instant k - 1 is a time level t_n (5) (6) (13)."""
        n, j = self.position(k - 1)
        if j == 0:
            t1 = instant((n + 1) * self.stride, self.fine, self.dt)
            self.opened = self.step.free(self.states[n - self.back], t1)

    def free_velocity(self, k):
        """vf at fine instant k, shape (n,) (15)."""
        n, j = self.position(k)
        if j == 0:
            return self.opened.v
        # vf(t_n + theta dt / ss) = (1 - theta) vf_n + theta vf_{n+1}
        theta = j / self.stride
        return (1.0 - theta) * self.states[n].vf + theta * self.opened.v

    def close(self, k, Lam):
        """Close the step that ends at instant k, if k is a time level (14) (8) (9)."""
        if self.position(k)[1] == 0:
            self.states.append(self.step.close(self.opened, Lam))

    def velocity(self, k, Lam):
        """Velocity at instant k: v at a time level, else interpolated vf plus vl of Lam."""
        n, j = self.position(k)
        if j == 0:
            return self.states[n].v
        return self.free_velocity(k) + self.step.link(Lam)[1]

    def begin_double_steps(self, Lam, start):
        """End of the first macro step: a double-step subdomain changes from h to 2 h."""
        if self.subdomain.double:
            self.step, self.back = self.later, 1
            if start == "rebased":
                # (S3)  vf_1 := v_1 - al2(2 h) Mbar(2 h)^-1 L^T Lam_1
                last = self.states[-1]
                self.states[-1] = replace(last, vf=last.v - self.step.link(Lam)[1])


@dataclass
class SubdomainResult:
    """States of one subdomain at its time levels, t = 0 included: t (k,), all others (k, n).

    w is the acceleration, a the acceleration-like variable, vf the stored free velocity (the
    re-based one after (S3)).
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    vf: np.ndarray


@dataclass
class Result:
    """Result of `run` and `run_macro`.

    Attributes
    ----------
    subdomains : list of SubdomainResult
    multipliers : (steps * max(ss) + 1, p) ndarray
        Lam at every fine instant, Lam_0 first.
    multiplier_times : (steps * max(ss) + 1,) ndarray
    velocity_jump : (steps * max(ss) + 1, p) ndarray
        sum_i L_i v_i at every fine instant; between time levels of a subdomain, v_i is its
        interpolated free velocity plus its link velocity.
    displacement_jump : (steps + 1, p) ndarray
        sum_i L_i u_i at the ends of the macro steps.
    """

    subdomains: list[SubdomainResult]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray


def run(subdomains, L, dt, steps, start="rebased"):
    """Coupled run from t = 0 under "pm", which without double steps is "gc".

    Parameters
    ----------
    subdomains : list of Subdomain
        Each `substeps` divides the largest one; at least one subdomain with the largest takes
        single steps.
    L : list of (p, n_i) ndarray
        The constraints sum_i L_i v_i = 0 (2); p = 0 leaves the subdomains uncoupled.
    dt : float
        Macro step.
    steps : int
        Number of macro steps.
    start : {"rebased", "plain"}
        With or without (S3) at the end of the first macro step.

    Returns
    -------
    Result

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> half = Subdomain(one, one, u0=[1.0])
    >>> result = run([half, half], [one, -one], 0.1, 10)
    >>> result.subdomains[0].u.shape
    (11, 1)
    """
    check(subdomains, L, start)
    fine = max(s.substeps for s in subdomains)
    steppers = [Stepper(s, Li, dt, fine) for s, Li in zip(subdomains, L, strict=True)]
    w0, Lam = initial_accelerations(subdomains, L)
    for x, w in zip(steppers, w0, strict=True):
        x.begin(w, Lam)

    multipliers, jumps = [Lam], [jump(L, [s.v0 for s in subdomains])]
    H = interface_matrix(steppers)
    for k in range(1, steps * fine + 1):
        Lam = fine_step(steppers, L, H, k)
        multipliers.append(Lam)
        jumps.append(jump(L, [x.velocity(k, Lam) for x in steppers]))
        if k == fine:
            for x in steppers:
                x.begin_double_steps(Lam, start)
            H = interface_matrix(steppers)

    macro = [[x.states[m * x.subdomain.substeps].u for x in steppers] for m in range(steps + 1)]
    return Result(
        subdomains=[collected(x.states) for x in steppers],
        multipliers=np.array(multipliers),
        multiplier_times=np.array([instant(k, fine, dt) for k in range(steps * fine + 1)]),
        velocity_jump=np.array(jumps),
        displacement_jump=np.array([jump(L, u) for u in macro]),
    )


def fine_step(steppers, L, H, k):
    """Step all subdomains to fine instant k; returns Lam at k, shape (p,)."""
    # free problems of the steps that begin at instant k - 1
    for x in steppers:
        x.open(k)
    # (18)  H Lam = - sum_i L_i vf_i
    Lam = np.linalg.solve(H, -jump(L, [x.free_velocity(k) for x in steppers]))
    # link problems of the steps that end at instant k
    for x in steppers:
        x.close(k, Lam)
    return Lam


def interface_matrix(steppers):
    """H = sum_i al2_i L_i Mbar_i^-1 L_i^T, shape (p, p) (18)."""
    return sum(x.step.compliance() for x in steppers)


def jump(L, x):
    """sum_i L_i x_i, shape (p,) (2)."""
    return sum(Li @ xi for Li, xi in zip(L, x, strict=True))


def instant(k, fine, dt):
    """Time of fine instant k, in this order of operations (T1)."""
    return (k / fine) * dt


def collected(states):
    """The states of one subdomain as one array per quantity."""
    names = ("t", "u", "v", "w", "a", "vf")
    return SubdomainResult(*(np.array([getattr(x, name) for x in states]) for name in names))


def check(subdomains, L, start):
    """Refuse what the schedule does not define."""
    fine = max(s.substeps for s in subdomains)
    if any(fine % s.substeps for s in subdomains):
        raise ValueError("every substeps must divide the largest one")
    if all(s.double for s in subdomains if s.substeps == fine):
        raise ValueError("at least one subdomain at the finest step must not be double")
    if any(Li.shape != (len(L[0]), len(s.M)) for Li, s in zip(L, subdomains, strict=True)):
        raise ValueError("L must be a list of (p, n_i) arrays, one for each subdomain")
    if start not in ("rebased", "plain"):
        raise ValueError(f'start must be "rebased" or "plain", got {start!r}')


# ---- macro coupling -------------------------------------------------------------------------


class MacroStepper:
    """The steps of one subdomain under "macro": free macro run and link response.

    Parameters
    ----------
    subdomain : Subdomain
        With double steps it has one substep.
    L : (p, n) ndarray
    dt : float
        Macro step.
    """

    def __init__(self, subdomain, L, dt):
        self.subdomain, self.L, self.dt = subdomain, L, dt
        h = dt / subdomain.substeps
        self.step = Step(subdomain, L, h)
        self.later = Step(subdomain, L, 2.0 * h) if subdomain.double else self.step
        self.back = 0  # a step starts from states[-1 - back]: 0 single, 1 double step
        self.states = []
        self.U = self.unit_responses()

    def unit_responses(self):
        """U[j]: states at the end of substep j + 1 for unit multipliers, each field (n, p) (M3)."""
        p, ss = len(self.L), self.subdomain.substeps
        zero = np.zeros(len(self.subdomain.M))
        rest = State(0.0, zero, zero, zero, zero, zero)
        step = without_load(self.step)
        units = [self.run(step, rest, 0, lambda j, e=e: j / ss * e) for e in np.eye(p)]
        return [
            {x: np.array([getattr(u[j], x) for u in units]).reshape(p, -1).T for x in "uvwa"}
            for j in range(ss)
        ]

    def run(self, step, state, first, Lam):
        """States at the ends of the substeps j = 1..ss after time level `first`, under Lam(j)."""
        ss, states = self.subdomain.substeps, []
        for j in range(1, ss + 1):
            free = step.free(state, instant(first + j, ss, self.dt))
            state = step.close(free, Lam(j))
            states.append(state)
        return states

    def free_macro_run(self, Lam):
        """The substeps of this macro step with the last multipliers Lam held constant (M2)."""
        first = len(self.states) - 1
        return self.run(self.step, self.states[-1 - self.back], first, lambda j: Lam)

    def add_link_response(self, free, dLam):
        """u, v, w, a of the free macro run plus U dLam, at the end of every substep (M5)."""
        for state, U in zip(free, self.U, strict=True):
            total = {x: getattr(state, x) + U[x] @ dLam for x in "uvwa"}
            self.states.append(replace(state, **total))

    def begin_double_steps(self):
        """End of the first macro step: a double-step subdomain changes from h to 2 h."""
        if self.subdomain.double:
            self.step, self.back = self.later, 1
            self.U = self.unit_responses()


def without_load(step):
    """The same step with F = 0 and r = K_r u + D_r v, for the link response (M3)."""
    K_r, D_r = step.subdomain.K_r, step.subdomain.D_r
    linear = replace(step.subdomain, force=None, restoring=lambda t, u, v: K_r @ u + D_r @ v)
    return Step(linear, step.L, step.h)


def run_macro(subdomains, L, dt, steps, g=None):
    """Coupled run from t = 0 under "macro".

    Parameters
    ----------
    subdomains : list of Subdomain
        Any numbers of substeps; one for a subdomain with double steps.
    L : list of (p, n_i) ndarray
        The constraints sum_i L_i v_i = g (2), (G1).
    dt : float
        Macro step.
    steps : int
        Number of macro steps.
    g : callable or None
        g(t) -> (p,), zero at t = 0 and with zero slope there; None is zero.

    Returns
    -------
    Result
        Multipliers and velocity jumps at the ends of the macro steps.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> coarse, fine = Subdomain(one, one, u0=[1.0]), Subdomain(one, one, u0=[1.0], substeps=3)
    >>> result = run_macro([coarse, fine], [one, -one], 0.1, 10)
    >>> result.subdomains[1].u.shape, result.multipliers.shape
    ((31, 1), (11, 1))
    """
    if any(s.double and s.substeps > 1 for s in subdomains):
        raise ValueError("a subdomain with double steps must have one substep")
    g = (lambda t: np.zeros(len(L[0]))) if g is None else g
    steppers = [MacroStepper(s, Li, dt) for s, Li in zip(subdomains, L, strict=True)]
    w0, Lam = initial_accelerations(subdomains, L)
    for x, w in zip(steppers, w0, strict=True):
        x.states.append(State(0.0, x.subdomain.u0, x.subdomain.v0, w, w, x.subdomain.v0))

    multipliers, jumps = [Lam], [jump(L, [s.v0 for s in subdomains])]
    for k in range(1, steps + 1):
        free = [x.free_macro_run(Lam) for x in steppers]
        # (M4)  H dLam = g - sum_i L_i v_i of the free macro run, H = sum_i L_i U_i^v
        H = sum(x.L @ x.U[-1]["v"] for x in steppers)
        t = instant(k, 1, dt)
        dLam = np.linalg.solve(H, g(t) - jump(L, [states[-1].v for states in free]))
        for x, states in zip(steppers, free, strict=True):
            x.add_link_response(states, dLam)
        Lam = Lam + dLam  # (M5)
        multipliers.append(Lam)
        jumps.append(jump(L, [x.states[-1].v for x in steppers]) - g(t))
        if k == 1:
            for x in steppers:
                x.begin_double_steps()

    macro = [[x.states[m * x.subdomain.substeps].u for x in steppers] for m in range(steps + 1)]
    return Result(
        subdomains=[collected(x.states) for x in steppers],
        multipliers=np.array(multipliers),
        multiplier_times=np.array([instant(k, 1, dt) for k in range(steps + 1)]),
        velocity_jump=np.array(jumps),
        displacement_jump=np.array([jump(L, u) for u in macro])
        - moved(g, [instant(k, 1, dt) for k in range(steps + 1)]),
    )


def moved(g, times):
    """Displacements (levels, p) of supports with the velocities g at time levels (G2)."""
    v = np.array([g(t) for t in times])
    steps = 0.5 * np.diff(times)[:, None] * (v[:-1] + v[1:])
    return np.vstack([np.zeros_like(v[:1]), np.cumsum(steps, axis=0)])


# ---- the exact solution ---------------------------------------------------------------------


def exact(M, C, K, u0, v0, t):
    """Free vibration M w + C v + K u = 0 of a system that is not partitioned, by expm.

    Parameters
    ----------
    M, K : (n, n) ndarray
        M non-singular.
    C : (n, n) ndarray or None
    u0, v0 : (n,) ndarray
        v0 may be None, for rest.
    t : float or (k,) ndarray

    Returns
    -------
    u, v, w : (n,) or (k, n) ndarray
    """
    n = len(M)
    C = np.zeros((n, n)) if C is None else C
    v0 = np.zeros(n) if v0 is None else v0
    # d/dt [u; v] = [[0, 1], [-M^-1 K, -M^-1 C]] [u; v]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.hstack([K, C]))]])
    x0 = np.concatenate([u0, v0])
    x = np.array([scipy.linalg.expm(A * ti) @ x0 for ti in np.atleast_1d(t)])
    x = x[0] if np.ndim(t) == 0 else x
    return x[..., :n], x[..., n:], (x @ A.T)[..., n:]
