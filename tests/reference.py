"""The coupled method once more, in plain dense NumPy: the oracle of the C core.

Everything here follows the equations word by word and spends no thought on speed: Mbar is dense,
free and link are two separate solves, the free velocity is stored on all dofs, and all states of
all times are kept. It never imports pmalpha.

Numbers in comments are the paper's (ACOMEN 2008) where it has one:

    (1)(2)    coupled problem            (11)      equilibrium written for w
    (5)(6)    predictors                 (12)      Mbar
    (7)/(10)  equilibrium, impl./expl.   (13)(14)  free and link problem
    (8)       correctors                 (15)      interpolation of the free velocity
    (9)       recursion for a            (18)      interface problem

and our own labels where it has none:

    (P1)  am, af, beta, gamma from rho           (S2)  free velocity stored at t = 0
    (P2)  al1, al2                               (S3)  free velocity re-based after the start
    (S1)  consistent initial w and Lam           (T1)  instants t = (k / max(ss)) dt
    (R1)  extrapolated velocity                  (R2) (R3) (R4)  restoring force, lagged damping
    (M1)  Lam linear over a macro step           (M4)  interface problem of a macro step
    (M2)  known run                              (M5)  known run plus response
    (M3)  response to a ramp of Lam

Symbols: u, v, w displacement, velocity, acceleration; a the acceleration-like variable of the
scheme; h an own step; dt the macro step; ss own steps in it; Lam the interface forces.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

# ---- one subdomain --------------------------------------------------------------------------


def alpha(rho, explicit=False):
    """Parameters of the generalized-alpha scheme, as keywords for `Part` (P1).

    Parameters
    ----------
    rho : float
        In [0, 1]: rho_inf of the implicit, rho_b of the explicit scheme.
    explicit : bool
        Which of the two.

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
class Part:
    """One subdomain: M w + C v + K u + r(u, v, t) = F(t) + L^T Lam, and how it is stepped (1).

    The default scheme is the trapezoidal rule; `Part(M, K, **alpha(0.5), substeps=20)` is
    generalized-alpha, `beta=0.0, explicit=True` the central difference.

    Attributes
    ----------
    M, K : (n, n) ndarray
    C : (n, n) ndarray or None
        None is no damping.
    am, af, beta, gamma : float
        The scheme; am and af weight the old state.
    explicit : bool
        Equilibrium (10) instead of (7).
    substeps : int
        ss, own steps in a macro step.
    double : bool
        From the second macro step on, step from t_{n-1} to t_{n+1} with 2 h ("pm").
    force : callable or None
        F(t) -> (n,).
    restoring : callable or None
        r(u, v, t) -> (n,).
    K_r, D_r : (n, n) ndarray or None
        Estimates of its stiffness and damping (R2).
    lagged : bool
        C acts on vs, outside Mbar (R4).
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
    restoring: Callable[[np.ndarray, np.ndarray, float], np.ndarray] | None = None
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

    def restore(self, u, v, t):
        """r(u, v, t), shape (n,)."""
        return np.zeros(len(self.M)) if self.restoring is None else self.restoring(u, v, t)

    def mbar(self, h):
        """Matrix in front of w_1 for an own step h, shape (n, n) (12) (R3) (R4)."""
        al1, al2 = coefficients(self, h)
        C = 0.0 * self.C if self.lagged else self.C
        if self.explicit:
            return self.M + al2 * (C + self.D_r)
        return self.M + al2 * (C + self.D_r) + al1 * (self.K + self.K_r)


def coefficients(part, h):
    """al1 and al2 of an own step h (P2)."""
    q = (1.0 - part.af) / (1.0 - part.am)
    return h**2 * part.beta * q, h * part.gamma * q


# ---- one step -------------------------------------------------------------------------------


@dataclass
class Node:
    """State of one subdomain at one own node; vf is the free velocity stored with it.

    Everything but the time t is an (n,) array.
    """

    t: float
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    vf: np.ndarray


@dataclass
class Free:
    """Free solution of a step from the node `old` to t: the step without Lam."""

    old: Node
    t: float
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray


def predictors(part, old, h):
    """ut and vt from the state at the node `old` (5) (6)."""
    am, af, beta, gamma = part.am, part.af, part.beta, part.gamma
    u, v, w, a = old.u, old.v, old.w, old.a
    # (5)  ut = u + h v + h^2 (1/2 - beta/(1-am)) a + h^2 beta af/(1-am) w
    ut = u + h * v + h**2 * (0.5 - beta / (1 - am)) * a + h**2 * beta * af / (1 - am) * w
    # (6)  vt = v + h (1 - gamma/(1-am)) a + h gamma af/(1-am) w
    vt = v + h * (1 - gamma / (1 - am)) * a + h * gamma * af / (1 - am) * w
    return ut, vt


class Step:
    """An own step of length h of one part: its free problem and its link problem.

    Parameters
    ----------
    part : Part
    L : (p, n) ndarray
    h : float
    """

    def __init__(self, part, L, h):
        self.part, self.L, self.h = part, L, h
        self.al1, self.al2 = coefficients(part, h)
        self.mbar = part.mbar(h)

    def solve(self, g):
        """Mbar^-1 g, shape of g."""
        return np.linalg.solve(self.mbar, g)

    def free(self, old, t1):
        """Free problem from the node `old` to t1 = old.t + h (13)."""
        part = self.part
        ut, vt = predictors(part, old, self.h)
        # (R1)  vs = v + h w
        vs = old.v + self.h * old.w
        # (7) (10) (11) (R3)  Mbar wf = F(t1) - C vt - K ut - r(ut, vs, t1) - D_r (vt - vs)
        damped = part.C @ (vs if part.lagged else vt)  # (R4)
        r = part.restore(ut, vs, t1) + part.D_r @ (vt - vs)
        wf = self.solve(part.load(t1) - damped - part.K @ ut - r)
        # (8)  uf = ut + al1 wf, vf = vt + al2 wf
        return Free(old, t1, u=ut + self.al1 * wf, v=vt + self.al2 * wf, w=wf)

    def link(self, Lam):
        """Link problem: (ul, vl, wl), each (n,), for the interface forces Lam (14)."""
        # Mbar wl = L^T Lam, ul = al1 wl, vl = al2 wl
        wl = self.solve(self.L.T @ Lam)
        return self.al1 * wl, self.al2 * wl, wl

    def close(self, free, Lam):
        """Total state where the step ends: free plus link, then the recursion."""
        am, af, old = self.part.am, self.part.af, free.old
        ul, vl, wl = self.link(Lam)
        w = free.w + wl
        # (9)  a1 = ((1-af) w1 + af w - am a) / (1-am), with the total w1
        a = ((1 - af) * w + af * old.w - am * old.a) / (1 - am)
        return Node(free.t, free.u + ul, free.v + vl, w, a, vf=free.v)

    def compliance(self):
        """This part's share of H, shape (p, p) (18)."""
        # al2 L Mbar^-1 L^T
        return self.al2 * self.L @ self.solve(self.L.T)


# ---- the start ------------------------------------------------------------------------------


def initial_accelerations(parts, L):
    """Consistent initial accelerations and multipliers (S1).

    M_i w_i - L_i^T Lam = F_i(0) - C_i v_i - K_i u_i - r_i(u_i, v_i, 0) and sum_i L_i w_i = 0, all
    parts at once.
    Massless dofs of which no equation determines w get w = 0: the null space of the matrix is
    {w: M w = 0, L w = 0} (Lam is unique), so the minimum-norm solution leaves just that out.
    The scaling (unit diagonal of M, unit rows of L) keeps small masses apart from no mass; it
    multiplies all massless dofs by one and the same number.

    Returns
    -------
    w : list of (n_i,) ndarray
    Lam : (p,) ndarray
    """
    M = scipy.linalg.block_diag(*(part.M for part in parts))
    Lall = np.hstack(L)
    p, n = Lall.shape
    g = np.concatenate(
        [q.load(0.0) - q.C @ q.v0 - q.K @ q.u0 - q.restore(q.u0, q.v0, 0.0) for q in parts]
    )

    # z = d w and y = Lam / c are what is solved for
    mass = np.diag(M)
    d = np.sqrt(np.where(mass > 0.0, mass, mass.max() or 1.0))
    Ms, Ls = M / np.outer(d, d), Lall / d
    c = 1.0 / np.linalg.norm(Ls, axis=1)
    Ls = c[:, None] * Ls

    # [[Ms, -Ls^T], [Ls, 0]] [z; y] = [g / d; 0]
    kkt = np.block([[Ms, -Ls.T], [Ls, np.zeros((p, p))]])
    x = np.linalg.lstsq(kkt, np.concatenate([g / d, np.zeros(p)]), rcond=None)[0]
    x[~kkt.any(axis=0)] = 0.0  # a dof which no equation mentions: zero to the last bit
    ends = np.cumsum([len(part.M) for part in parts])
    return np.split(x[:n] / d, ends[:-1]), c * x[n:]


# ---- the coupled schedule -------------------------------------------------------------------


class Walker:
    """One part on its way through time.

    Parameters
    ----------
    part : Part
    L : (p, n) ndarray
    dt : float
        Macro step.
    fine : int
        max(ss), fine steps in a macro step.
    """

    def __init__(self, part, L, dt, fine):
        self.part, self.dt, self.fine = part, dt, fine
        self.stride = fine // part.substeps  # fine steps in an own step
        h = dt / part.substeps
        self.step = Step(part, L, h)  # in the first macro step everybody steps singly
        self.later = Step(part, L, 2.0 * h) if part.double else self.step
        self.back = 0  # own nodes that a step starts behind the last one
        self.nodes = []
        self.ahead = None  # free solution at the next own node

    def position(self, k):
        """Own node n at or before fine node k, and j fine steps beyond it."""
        return divmod(k, self.stride)

    def begin(self, w, Lam):
        """The node at t = 0."""
        # (S2)  vf_0 = v_0 - al2 Mbar^-1 L^T Lam_0;  (9)  a_0 = w_0
        vf = self.part.v0 - self.step.link(Lam)[1]
        self.nodes.append(Node(0.0, self.part.u0, self.part.v0, w, w, vf))

    def open(self, k):
        """Free problem of the own step to t_{n+1} in which fine step k is the first."""
        n, j = self.position(k - 1)
        if j == 0:
            t1 = instant((n + 1) * self.stride, self.fine, self.dt)
            self.ahead = self.step.free(self.nodes[n - self.back], t1)

    def free_velocity(self, k):
        """vf at fine node k, shape (n,) (15)."""
        n, j = self.position(k)
        if j == 0:
            return self.ahead.v
        # vf(t_n + theta h) = (1 - theta) vf_n + theta vf_{n+1}
        theta = j / self.stride
        return (1.0 - theta) * self.nodes[n].vf + theta * self.ahead.v

    def close(self, k, Lam):
        """At its own node the part takes Lam and has its new state."""
        if self.position(k)[1] == 0:
            self.nodes.append(self.step.close(self.ahead, Lam))

    def velocity(self, k, Lam):
        """Velocity at fine node k: total at an own node, else interpolated free plus link."""
        n, j = self.position(k)
        if j == 0:
            return self.nodes[n].v
        return self.free_velocity(k) + self.step.link(Lam)[1]

    def change_over(self, Lam, start):
        """End of the first macro step: from now on t_{n-1} to t_{n+1}, if the part is double."""
        if self.part.double:
            self.step, self.back = self.later, 1
            if start == "rebased":
                # (S3)  vf_1 := v_1 - al2(2 h) Mbar(2 h)^-1 L^T Lam_1
                last = self.nodes[-1]
                self.nodes[-1] = replace(last, vf=last.v - self.step.link(Lam)[1])


@dataclass
class PartResult:
    """One part at its own nodes, t = 0 included: t (k,), all others (k, n).

    w is the true acceleration, a the acceleration-like variable, vf the stored free velocity
    (the re-based one where it was re-based).
    """

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    vf: np.ndarray


@dataclass
class Result:
    """What `run` returns.

    Attributes
    ----------
    parts : list of PartResult
    multipliers : (steps * max(ss) + 1, p) ndarray
        Lam at every fine node, Lam_0 first.
    multiplier_times : (steps * max(ss) + 1,) ndarray
    velocity_jump : (steps * max(ss) + 1, p) ndarray
        sum_i L_i v_i at every fine node; of a part in mid-step, interpolated free velocity
        plus link velocity.
    displacement_jump : (steps + 1, p) ndarray
        sum_i L_i u_i at the macro nodes.
    """

    parts: list[PartResult]
    multipliers: np.ndarray
    multiplier_times: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray


def run(parts, L, dt, steps, start="rebased"):
    """Step coupled subdomains from t = 0 ("pm"; where no part is double, this is "gc").

    Parameters
    ----------
    parts : list of Part
        Every `substeps` divides the largest one; at least one part at the finest step is not
        double.
    L : list of (p, n_i) ndarray
        The conditions sum_i L_i v_i = 0 (2); p = 0 leaves the parts uncoupled.
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
    >>> half = Part(one, one, u0=[1.0])
    >>> result = run([half, half], [one, -one], 0.1, 10)
    >>> result.parts[0].u.shape
    (11, 1)
    """
    check(parts, L, start)
    fine = max(part.substeps for part in parts)
    walkers = [Walker(part, Li, dt, fine) for part, Li in zip(parts, L, strict=True)]
    w0, Lam = initial_accelerations(parts, L)
    for x, w in zip(walkers, w0, strict=True):
        x.begin(w, Lam)

    multipliers, jumps = [Lam], [jump(L, [part.v0 for part in parts])]
    H = interface_matrix(walkers)
    for k in range(1, steps * fine + 1):
        Lam = fine_step(walkers, L, H, k)
        multipliers.append(Lam)
        jumps.append(jump(L, [x.velocity(k, Lam) for x in walkers]))
        if k == fine:
            for x in walkers:
                x.change_over(Lam, start)
            H = interface_matrix(walkers)

    macro = [[x.nodes[m * x.part.substeps].u for x in walkers] for m in range(steps + 1)]
    return Result(
        parts=[collected(x.nodes) for x in walkers],
        multipliers=np.array(multipliers),
        multiplier_times=np.array([instant(k, fine, dt) for k in range(steps * fine + 1)]),
        velocity_jump=np.array(jumps),
        displacement_jump=np.array([jump(L, u) for u in macro]),
    )


def fine_step(walkers, L, H, k):
    """Take all parts to fine node k; returns Lam there, shape (p,)."""
    # free problems of the own steps that begin here
    for x in walkers:
        x.open(k)
    # (18)  H Lam = - sum_i L_i vf_i
    Lam = np.linalg.solve(H, -jump(L, [x.free_velocity(k) for x in walkers]))
    # link problems of the own steps that end here
    for x in walkers:
        x.close(k, Lam)
    return Lam


def interface_matrix(walkers):
    """H = sum_i al2_i L_i Mbar_i^-1 L_i^T, shape (p, p) (18)."""
    return sum(x.step.compliance() for x in walkers)


def jump(L, x):
    """sum_i L_i x_i, shape (p,) (2)."""
    return sum(Li @ xi for Li, xi in zip(L, x, strict=True))


def instant(k, fine, dt):
    """Time of fine node k, in this order of operations (T1)."""
    return (k / fine) * dt


def collected(nodes):
    """Nodes of one part as one array per quantity."""
    names = ("t", "u", "v", "w", "a", "vf")
    return PartResult(*(np.array([getattr(node, name) for node in nodes]) for name in names))


def check(parts, L, start):
    """Refuse what the schedule does not define."""
    fine = max(part.substeps for part in parts)
    if any(fine % part.substeps for part in parts):
        raise ValueError("every substeps must divide the largest one")
    if all(part.double for part in parts if part.substeps == fine):
        raise ValueError("at least one part at the finest step must not be double")
    if any(Li.shape != (len(L[0]), len(q.M)) for Li, q in zip(L, parts, strict=True)):
        raise ValueError("L must be a list of (p, n_i) arrays, one for each part")
    if start not in ("rebased", "plain"):
        raise ValueError(f'start must be "rebased" or "plain", got {start!r}')


# ---- macro coupling -------------------------------------------------------------------------


class Traveller:
    """One part from macro node to macro node: known run and response.

    Parameters
    ----------
    part : Part
        A double one has one substep.
    L : (p, n) ndarray
    dt : float
        Macro step.
    """

    def __init__(self, part, L, dt):
        self.part, self.L, self.dt = part, L, dt
        h = dt / part.substeps
        self.step = Step(part, L, h)
        self.later = Step(part, L, 2.0 * h) if part.double else self.step
        self.back = 0  # own nodes that a step starts behind the last one
        self.nodes = []
        self.respond()

    def respond(self):
        """U[j]: unit conditions' states at own node j + 1, each field (n, p) (M3)."""
        p = len(self.L)
        ss = self.part.substeps
        units = [self.run(self.rest(), 0, lambda j, e=e: j / ss * e, still=True) for e in np.eye(p)]
        self.U = [
            {x: np.array([getattr(u[j], x) for u in units]).reshape(p, -1).T for x in "uvwa"}
            for j in range(ss)
        ]

    def rest(self):
        zero = np.zeros(len(self.part.M))
        return Node(0.0, zero, zero, zero, zero, zero)

    def run(self, node, first, Lam, *, still=False):
        """The ss own steps after own node `first` under Lam(j) at own node j = 1..ss."""
        ss, nodes = self.part.substeps, []
        step = linearised(self.step) if still else self.step
        for j in range(1, ss + 1):
            free = step.free(node, instant(first + j, ss, self.dt))
            node = step.close(free, Lam(j))
            nodes.append(node)
        return nodes

    def known(self, Lam):
        """The own steps of this macro step, with Lam of its beginning held (M2)."""
        first = len(self.nodes) - 1
        return self.run(self.nodes[-1 - self.back], first, lambda j: Lam)

    def add(self, known, dLam):
        """known + U dLam at every own node, for u, v, w and a (M5)."""
        for node, U in zip(known, self.U, strict=True):
            total = {x: getattr(node, x) + U[x] @ dLam for x in "uvwa"}
            self.nodes.append(replace(node, **total))

    def change_over(self):
        """End of the first macro step: from now on t_{n-1} to t_{n+1}, if the part is double."""
        if self.part.double:
            self.step, self.back = self.later, 1
            self.respond()


def linearised(step):
    """The same step without load, its restoring force as the estimates have it (M3)."""
    K_r, D_r = step.part.K_r, step.part.D_r
    part = replace(step.part, force=None, restoring=lambda u, v, t: K_r @ u + D_r @ v)
    return Step(part, step.L, step.h)


def run_macro(parts, L, dt, steps, g=None):
    """Step coupled subdomains from t = 0 by macro coupling.

    Parameters
    ----------
    parts : list of Part
        Any substeps; a double part has one.
    L : list of (p, n_i) ndarray
        The conditions sum_i L_i v_i = g (2), (G1).
    dt : float
        Macro step.
    steps : int
        Number of macro steps.
    g : callable or None
        g(t) -> (p,), zero at t = 0 and with zero slope there; None is zero.

    Returns
    -------
    Result
        Multipliers and velocity jumps at macro nodes.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> slow, fast = Part(one, one, u0=[1.0]), Part(one, one, u0=[1.0], substeps=3)
    >>> result = run_macro([slow, fast], [one, -one], 0.1, 10)
    >>> result.parts[1].u.shape, result.multipliers.shape
    ((31, 1), (11, 1))
    """
    if any(part.double and part.substeps > 1 for part in parts):
        raise ValueError("a double part must have one substep")
    g = (lambda t: np.zeros(len(L[0]))) if g is None else g
    travellers = [Traveller(part, Li, dt) for part, Li in zip(parts, L, strict=True)]
    w0, Lam = initial_accelerations(parts, L)
    for x, w in zip(travellers, w0, strict=True):
        x.nodes.append(Node(0.0, x.part.u0, x.part.v0, w, w, x.part.v0))

    multipliers, jumps = [Lam], [jump(L, [part.v0 for part in parts])]
    for k in range(1, steps + 1):
        known = [x.known(Lam) for x in travellers]
        # (M4)  H dLam = g - sum_i L_i v_i(known), H = sum_i L_i U_i^v
        H = sum(x.L @ x.U[-1]["v"] for x in travellers)
        t = instant(k, 1, dt)
        dLam = np.linalg.solve(H, g(t) - jump(L, [nodes[-1].v for nodes in known]))
        for x, nodes in zip(travellers, known, strict=True):
            x.add(nodes, dLam)
        Lam = Lam + dLam  # (M1)
        multipliers.append(Lam)
        jumps.append(jump(L, [x.nodes[-1].v for x in travellers]) - g(t))
        if k == 1:
            for x in travellers:
                x.change_over()

    macro = [[x.nodes[m * x.part.substeps].u for x in travellers] for m in range(steps + 1)]
    return Result(
        parts=[collected(x.nodes) for x in travellers],
        multipliers=np.array(multipliers),
        multiplier_times=np.array([instant(k, 1, dt) for k in range(steps + 1)]),
        velocity_jump=np.array(jumps),
        displacement_jump=np.array([jump(L, u) for u in macro]),
    )


# ---- the truth ------------------------------------------------------------------------------


def exact(M, C, K, u0, v0, t):
    """Free vibration M w + C v + K u = 0 of an uncut system, by the matrix exponential.

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
