"""Random coupled problems of all kinds, as plain data that can be given in another form.

`drawn` makes small ones, `varied` some that need more of the core: larger and unsymmetric matrices,
compiled functions, sampled prescribed velocities.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from compiled import FORCE, RESTORING
from reference_problems import (
    EXPLICIT,
    FORMATS,
    IMPLICIT,
    _random_constraints,
    _semidefinite,
    _skew,
)
from scipy import LowLevelCallable

import pmalpha as pm

# Tolerance of iterated forces: of an energy.
TOL = 1e-12
COUPLINGS = ["pm", "gc", "macro", "mean"]


def compiled(function, kind):
    """A load (FORCE) or a restoring force (RESTORING) as compiled code; 7 where it raises."""

    def called(t, n, *pointers):
        *given, value = (np.ctypeslib.as_array(x, (n,)) for x in pointers[:-1])
        try:
            value[:] = function(t, *given)
        except BaseException:
            return 7
        return 0

    return LowLevelCallable(kind(called))


def as_it_is(function, what):
    return function


# ---- a problem ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Load:
    """direction times a function of time: 1, cos(omega t), or samples; or a base acceleration."""

    kind: str
    direction: np.ndarray
    omega: float
    samples: np.ndarray
    step: float

    def given(self, M):
        if self.kind == "none":
            return None
        if self.kind == "constant":
            return self.direction
        if self.kind == "called":
            return lambda t: self.direction * np.cos(self.omega * t)
        if self.kind == "base":
            return pm.BaseAcceleration(self.samples, self.direction, M, dt=self.step)
        return pm.SampledForce(self.samples, self.step, shape=self.direction)


@dataclass(frozen=True)
class Springs:
    """Springs of one law, by pairs of dofs, -1 for the ground: stiffness, force and length."""

    law: str
    pairs: np.ndarray
    k: float
    fy: float
    gap: float
    k3: float

    def given(self):
        return {
            "cubic": lambda: pm.CubicSpring(self.pairs, self.k, self.k3),
            "gap": lambda: pm.Gap(self.pairs, self.k, self.gap),
            "bilinear": lambda: pm.Bilinear(self.pairs, self.k, self.fy, 0.1),
            "boucwen": lambda: pm.BoucWen(self.pairs, self.k, self.fy, 0.05, n=1.5),
        }[self.law]()


@dataclass(frozen=True)
class Function:
    """G (force tanh(G^T u / length) + c G^T v + pulse sin(omega t)), as a function."""

    G: np.ndarray
    force: float
    length: float
    c: float
    pulse: float
    omega: float

    def value(self, t, u, v):
        x = self.G.T @ u / self.length
        along = self.force * np.tanh(x) + self.c * (self.G.T @ v)
        return self.G @ (along + self.pulse * np.sin(self.omega * t))

    def iterated(self, t, u, v, q):
        slope = self.force / self.length / np.cosh(self.G.T @ u / self.length) ** 2
        return self.value(t, u, v), (self.G * slope) @ self.G.T, self.c * self.G @ self.G.T

    @property
    def stiffness(self):
        return self.force / self.length * self.G @ self.G.T

    @property
    def damping(self):
        return self.c * self.G @ self.G.T


@dataclass(frozen=True)
class Linear:
    """A u, as a function."""

    A: np.ndarray
    damping = None

    def value(self, t, u, v):
        return self.A @ u

    def iterated(self, t, u, v, q):
        return self.A @ u, self.A

    @property
    def stiffness(self):
        return self.A


@dataclass(frozen=True)
class Member:
    """A subdomain. `role`: what springs and function are, "restoring" or "internal".

    `compiled`: its load and its restoring force are compiled functions where they are functions.
    """

    name: str
    M: np.ndarray
    K: np.ndarray
    C: np.ndarray | None
    scheme: pm.Scheme
    substeps: int
    double: bool
    forms: tuple
    load: Load
    u0: np.ndarray
    v0: np.ndarray
    lagged: bool = False
    role: str = "restoring"
    springs: tuple = ()
    function: Function | Linear | None = None
    estimated: bool = False
    compiled: bool = False

    @property
    def n(self):
        return self.K.shape[0]

    @property
    def symmetric(self):
        return all(A is None or (abs(A - A.T)).max() == 0.0 for A in (self.K, self.C))

    def given(self, around=as_it_is):
        """The Subdomain; its functions are ``around(function, what)``."""
        M, C, K = (
            None if A is None else f(A) for A, f in zip((self.M, self.C, self.K), self.forms)
        )
        options = dict(scheme=self.scheme, substeps=self.substeps, double_step=self.double)
        options |= dict(u0=self.u0, v0=self.v0, name=self.name, symmetric=self.symmetric)
        options["force"] = self.load.given(self.M)
        if self.load.kind == "called":
            force = around(options["force"], f"load of {self.name}")
            options["force"] = compiled(force, FORCE) if self.compiled else force
        options["damping"] = "lagged" if self.lagged else "implicit"
        forces = [springs.given() for springs in self.springs]
        if self.function is not None:
            function = self.function
            value = function.value if self.role == "restoring" else function.iterated
            forces = [around(value, f"{self.role} of {self.name}")]
            if self.role == "restoring" and self.compiled:
                forces = [compiled(forces[0], RESTORING)]
            if self.role == "restoring" and self.estimated:
                options["restoring_stiffness"] = function.stiffness
                options["restoring_damping"] = function.damping
        if forces:
            options[self.role] = forces if self.springs else forces[0]
        return pm.Subdomain(M, K, C=C, **options)

    @property
    def stiffness(self):
        """K with the largest tangents of everything else."""
        K = self.K if self.function is None else self.K + self.function.stiffness
        return K + sum((spring_matrix(s.pairs, s.k, self.n) for s in self.springs), 0.0 * self.K)


def spring_matrix(pairs, k, n):
    B = np.zeros((len(pairs), n + 1))
    B[np.arange(len(pairs)), pairs[:, 0]] = 1.0
    B[np.arange(len(pairs)), pairs[:, 1]] -= 1.0  # the last column is the ground
    return k * B[:, :n].T @ B[:, :n]


@dataclass(frozen=True)
class Whole:
    """Subdomains, rows L (p, all dofs), and velocities g sin(omega t) of the rows, or samples."""

    members: tuple
    L: np.ndarray
    dt: float
    coupling: str
    start: str
    g: np.ndarray | None = None
    omega: float = 1.0
    sampled: bool = False

    @property
    def columns(self):
        """L of each subdomain."""
        ends = np.cumsum([0, *(p.n for p in self.members)])
        return [self.L[:, a:b] for a, b in pairwise(ends)]

    @property
    def is_iterated(self):
        return any(p.role == "internal" and (p.springs or p.function) for p in self.members)

    def coupler(self, threads=1, around=as_it_is):
        made = [p.given(around) for p in self.members]
        rows = {s: L for s, L in zip(made, self.columns) if abs(L).max()}
        return pm.Coupler(
            made,
            pm.Constraint(rows, velocity=self.velocity(around)) if rows else None,
            dt=self.dt,
            coupling=self.coupling,
            start=self.start,
            newton=pm.Newton(tol=TOL),
            threads=threads,
        )

    def velocity(self, around):
        if self.g is None:
            return None
        if self.sampled:
            return pm.SampledForce(np.sin(np.arange(12.0))[:, None] * self.g, 1.2 * self.dt)
        return around(lambda t: self.g * np.sin(self.omega * t), "velocity")

    def each(self, change):
        """The same with each subdomain changed."""
        return replace(self, members=tuple(change(p) for p in self.members))


# ---- random problems ----------------------------------------------------------------------------


def drawn(seed, large=()):
    """2 to 4 subdomains of 1 to 7 or `large` dofs, of all kinds that the coupling takes."""
    rng = np.random.default_rng([seed, 11])
    coupling = COUPLINGS[seed % len(COUPLINGS)]
    count = int(rng.integers(2, 5))
    sizes = [int(rng.integers(1, 8)) for _ in range(count)]
    sizes[: len(large)] = large[:count]
    L = np.hstack(_random_constraints(rng, sizes))
    steps = _substeps(rng, count, coupling)
    members = []
    for i, (n, (substeps, double)) in enumerate(zip(sizes, steps)):
        tied = np.split(L, np.cumsum(sizes)[:-1], axis=1)[i].any(axis=0)
        members.append(_member(rng, f"s{i}", n, substeps, double, tied, coupling))
    g = rng.normal(size=len(L)) if rng.random() < 0.3 else None
    start = "plain" if rng.random() < 0.2 else "rebased"
    whole = Whole(tuple(members), L, 1.0, coupling, start, g)
    if whole.is_iterated:
        whole = replace(whole, start="rebased")
    return _at_start(rng, _with_step(rng, whole))


def _substeps(rng, count, coupling):
    """(substeps, double step) of each subdomain."""
    fine = int(rng.choice([1, 2, 3, 4, 6]))
    free = [1, 2, 3, 5] if coupling in ("macro", "mean") else []
    choices = free or [d for d in range(1, fine + 1) if fine % d == 0]
    steps = [int(rng.choice(choices)) for _ in range(count)]
    steps[0] = fine
    doubles = [bool(rng.random() < 0.4) for _ in range(count)]
    if coupling == "gc":
        doubles = [False] * count
    if free:
        doubles = [double and s == 1 for double, s in zip(doubles, steps)]
    doubles[0] = False
    return list(zip(steps, doubles))


def _member(rng, name, n, substeps, double, tied, coupling):
    explicit = rng.random() < 0.4
    schemes = EXPLICIT if explicit else IMPLICIT
    if coupling == "mean":
        schemes = [s for s in schemes if not explicit or getattr(s, "rho", 1.0) >= 0.5]
    scheme = schemes[int(rng.integers(len(schemes)))]
    M = np.diag(rng.uniform(1.0, 3.0, n))
    if rng.random() < 0.5:
        M += 0.3 * _semidefinite(rng, n)
    K = 20.0 * _semidefinite(rng, n) + np.eye(n)
    if n > 8:
        M, K = np.diag(np.diag(M)), 10.0 * grid(n) + 0.1 * np.eye(n)
    C = 0.2 * M + 0.003 * K if rng.random() < 0.5 else None
    if coupling == "mean" and 2.0 * scheme.beta > (1.0 + 1e-9) * scheme.gamma:
        C = None  # it grows
    light = _massless(rng, scheme, tied if coupling == "mean" else np.zeros(n, bool))
    M[light, :] = M[:, light] = 0.0
    if C is not None and light.any():
        C = 0.2 * M
    lagged = bool(C is not None and not light.any() and rng.random() < 0.2)
    member = Member(
        name, M, K, C, scheme, substeps, double, _forms(rng, M), _load(rng, light),
        np.zeros(n), np.zeros(n), lagged,
    )  # fmt: skip
    return _with_forces(rng, member, ~light, coupling)


def _massless(rng, scheme, kept):
    light = np.zeros(kept.size, bool)
    if not scheme.explicit and scheme.radius_at_infinity() < 0.9 and rng.random() < 0.2:
        light[int(rng.integers(kept.size))] = True
    return light & ~kept


def _forms(rng, M):
    forms = [FORMATS[int(rng.integers(len(FORMATS)))] for _ in range(3)]
    if np.count_nonzero(M - np.diag(np.diag(M))) == 0 and rng.random() < 0.5:
        forms[0] = np.diag
    return tuple(forms)


def _load(rng, light):
    kinds = ["none", "constant", "called", "sampled", "base"]
    direction = np.where(light, 0.0, rng.normal(size=light.size))
    samples = rng.normal(size=9)
    return Load(kinds[int(rng.integers(5))], direction, 3.0, samples, rng.uniform(0.05, 0.2))


def roles_of(coupling):
    """The arguments in which a subdomain may have forces under this coupling."""
    return ["internal"] if coupling == "mean" else ["restoring", "internal"]


def _with_forces(rng, member, moving, coupling):
    """With springs or a function in some of the subdomains."""
    if rng.random() < 0.5 or not moving.any():
        return member
    roles = roles_of(coupling)
    role = roles[int(rng.integers(len(roles)))]
    if rng.random() < 0.4:
        G = np.where(moving[:, None], rng.normal(size=(member.n, 2)), 0.0)
        function = Function(G, 2.0, 0.5, 0.1 * rng.random(), 0.5, 2.0)
        return replace(member, role=role, function=function, estimated=bool(rng.random() < 0.7))
    laws = ["cubic"] if role == "internal" else ["cubic", "gap", "bilinear", "boucwen"]
    chosen = rng.permutation(laws)[: int(rng.integers(1, 3))]
    springs = [
        Springs(law, _pairs(rng, np.flatnonzero(moving)), 3.0, 0.6, 0.05, 5.0) for law in chosen
    ]
    return replace(member, role=role, springs=tuple(springs))


def _pairs(rng, dofs):
    first = rng.choice(dofs, int(rng.integers(1, 4)))
    second = rng.choice(np.append(dofs, -1), first.size)
    return np.column_stack([first, np.where(second == first, -1, second)])


def _with_step(rng, whole):
    """A macro step that resolves explicit subdomains and what is not known as K."""
    most = 0.1 * max(p.substeps for p in whole.members)
    for p in whole.members:
        if not p.scheme.explicit and not (p.springs or p.function):
            continue
        inverse = np.diag(1.0 / np.where(np.diag(p.M) > 0.0, np.diag(p.M), np.inf))
        omega = np.sqrt(np.max(np.abs(np.linalg.eigvals(inverse @ p.stiffness))))
        length = 1.0 / (omega * (1.0 + p.double))  # half the limit of most schemes
        most = min(most, p.substeps * length)
    return replace(whole, dt=float(most * rng.uniform(0.3, 1.0)))


def _at_start(rng, whole):
    """Random motions that satisfy the constraints, unless dofs have no mass."""
    if any(np.any(np.diag(p.M) == 0.0) for p in whole.members):
        return replace(whole, g=None)
    ends = np.cumsum([p.n for p in whole.members])[:-1]
    states = []
    for size in (0.3, 1.0):
        x = size * rng.normal(size=whole.L.shape[1])
        states.append(np.split(x - np.linalg.pinv(whole.L) @ (whole.L @ x), ends))
    members = [replace(p, u0=u, v0=v) for p, u, v in zip(whole.members, *states)]
    return replace(whole, members=tuple(members))


def grid(n):
    """Stiffness of a square net if n is a square, else of a chain, between walls."""

    def chain(m):
        return 2.0 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)

    side = math.isqrt(n)
    if side**2 != n:
        return chain(n)
    return np.kron(chain(side), np.eye(side)) + np.kron(np.eye(side), chain(side))


def varied(seed):
    """A problem that may have larger or unsymmetric matrices and functions of other kinds."""
    rng = np.random.default_rng([seed, 12])
    large = [int(rng.choice([20, 49, 100, 150])) for _ in range(int(rng.choice([0, 0, 0, 1, 2])))]
    unsymmetric = rng.random() < 0.25

    def change(p):
        load = replace(p.load, kind="called") if rng.random() < 0.3 else p.load
        p = replace(p, load=load, compiled=bool(rng.random() < 0.4))
        if not unsymmetric or p.lagged or rng.random() < 0.3:
            return p
        moving = np.diag(p.M) > 0.0
        C = 0.0 * p.M if p.C is None else p.C
        return replace(p, C=C + _skew(rng, moving, 0.5), K=p.K + _skew(rng, moving, 0.5))

    whole = drawn(seed, large)
    return replace(whole.each(change), sampled=bool(rng.random() < 0.5))
