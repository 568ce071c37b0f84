"""Random coupled problems, each for the package and for the reference."""

from dataclasses import dataclass, field

import numpy as np
import reference
import scipy.sparse as sp

import pmalpha as pm

IMPLICIT = [
    pm.GeneralizedAlpha(0.0),
    pm.GeneralizedAlpha(0.5),
    pm.GeneralizedAlpha(0.8),
    pm.GeneralizedAlpha(1.0),
    pm.Newmark(),
    pm.Newmark(beta=0.3, gamma=0.6),
    pm.HHT(0.2),
    pm.WBZ(0.15),
]
EXPLICIT = [
    pm.GeneralizedAlpha(0.0, explicit=True),
    pm.GeneralizedAlpha(0.5, explicit=True),
    pm.GeneralizedAlpha(1.0, explicit=True),
    pm.CentralDifference(),
]
FORMATS = [
    np.asarray,
    np.asfortranarray,
    lambda A: np.repeat(np.repeat(A, 2, axis=0), 2, axis=1)[::2, ::2],  # not contiguous
    sp.csr_array,
    sp.csc_matrix,
    sp.coo_array,
    sp.lil_matrix,
    sp.dok_array,
    sp.bsr_array,
    sp.dia_array,
]


@dataclass
class SubdomainData:
    """Data of one subdomain, from which both programs construct theirs."""

    M: np.ndarray
    K: np.ndarray
    C: np.ndarray | None
    scheme: pm.Scheme
    substeps: int
    double: bool | None
    forms: list
    force: object = None
    reference_force: object = None
    u0: np.ndarray = field(default=None)
    v0: np.ndarray = field(default=None)
    restoring: object = None
    K_r: np.ndarray | None = None
    D_r: np.ndarray | None = None
    lagged: bool = False
    internal: object = None
    name: str | None = None

    @property
    def symmetric(self):
        return all(
            A is None or np.array_equal(A, A.T) for A in (self.K, self.C, self.K_r, self.D_r)
        )


@dataclass
class Problem:
    """A coupled problem for both programs."""

    subdomains: list
    L: list
    dt: float
    start: str
    coupling: str
    velocity: object = None

    def coupler(self, **options):
        subdomains = [_subdomain(s) for s in self.subdomains]
        touched = {s: Li for s, Li in zip(subdomains, self.L) if Li.any()}
        return pm.Coupler(
            subdomains,
            pm.Constraint(touched, velocity=self.velocity),
            dt=self.dt,
            start=self.start,
            coupling=self.coupling,
            **options,
        )

    def reference(self, steps, doubles):
        """A run of the reference; `doubles`: the subdomains that take double steps."""
        subdomains = [reference_subdomain(*pair) for pair in zip(self.subdomains, doubles)]
        return reference.run(subdomains, self.L, self.dt, steps, start=self.start)


def _subdomain(s):
    M, C, K = (None if A is None else f(A) for A, f in zip((s.M, s.C, s.K), s.forms))
    return pm.Subdomain(
        M,
        K,
        C=C,
        scheme=s.scheme,
        substeps=s.substeps,
        double_step=s.double,
        force=s.force,
        restoring=s.restoring,
        restoring_stiffness=s.K_r,
        restoring_damping=s.D_r,
        damping="lagged" if s.lagged else "implicit",
        internal=s.internal,
        name=s.name,
        symmetric=s.symmetric,
        u0=s.u0,
        v0=s.v0,
    )


def reference_subdomain(s, double):
    scheme = s.scheme
    return reference.Subdomain(
        s.M,
        s.K,
        C=s.C,
        am=scheme.am,
        af=scheme.af,
        beta=scheme.beta,
        gamma=scheme.gamma,
        explicit=scheme.explicit,
        substeps=s.substeps,
        double=double,
        force=s.reference_force,
        restoring=s.restoring,
        K_r=s.K_r,
        D_r=s.D_r,
        lagged=s.lagged,
        u0=s.u0,
        v0=s.v0,
    )


def random_problem(seed):
    """2 to 5 subdomains of 1 to 8 dofs: formats, schemes, damping, loads, massless dofs, ties."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    fine = int(rng.choice([1, 2, 3, 4, 6, 12]))
    divisors = [d for d in range(1, fine + 1) if fine % d == 0]
    substeps = [int(rng.choice(divisors)) for _ in range(count)]
    substeps[0] = fine
    doubles = [None] * count
    if rng.random() < 0.5:
        doubles = [bool(rng.random() < 0.5) for _ in range(count)]
        doubles[0] = False  # one subdomain at the finest step takes single steps
    subdomains = [_random_subdomain(rng, s, d) for s, d in zip(substeps, doubles)]
    L = _random_constraints(rng, [len(s.M) for s in subdomains])
    if not any(np.any(np.diag(s.M) == 0.0) for s in subdomains):
        _set_initial_state(rng, subdomains, L)
    start = "plain" if rng.random() < 0.3 else "rebased"
    return Problem(subdomains, L, 0.05, start, "gc" if rng.random() < 0.25 else "pm")


def random_restored_problem(seed):
    """`random_problem` with restoring forces, estimates for some of them, and lagged damping."""
    problem = random_problem(seed)
    rng = np.random.default_rng([seed, 1])
    for s in problem.subdomains:
        massless = np.diag(s.M) == 0.0
        s.lagged = bool(rng.random() < 0.5) and not massless.any()
        if rng.random() < 0.7:
            _set_random_restoring(rng, s, massless)
    return problem


def random_unsymmetric_problem(seed, draw=random_problem):
    """A random problem with gyroscopic C, circulatory K, and estimates of both kinds."""
    problem = draw(seed)
    rng = np.random.default_rng([seed, 3])
    for s in problem.subdomains:
        moving = np.diag(s.M) > 0.0  # the equations of massless dofs have to hold at t = 0
        if rng.random() < 0.8:
            s.C = (0.0 * s.M if s.C is None else s.C) + _skew(rng, moving, 4.0)
            s.lagged = s.lagged and s.scheme is EXPLICIT[0]
        if rng.random() < 0.5:
            s.K = s.K + _skew(rng, moving, 3.0)
        if s.K_r is not None:
            s.K_r = s.K_r + _skew(rng, moving, 1.0)
        if s.D_r is not None:
            s.D_r = s.D_r + _skew(rng, moving, 0.5)
    return problem


def _skew(rng, moving, size):
    """Of some pairs of dofs."""
    n = moving.size
    A = np.triu(rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5), k=1) * np.outer(
        moving, moving
    )
    return size * (A - A.T)


def _set_random_restoring(rng, s, massless):
    G = rng.normal(size=(len(s.M), 2))
    G[massless] = 0.0  # its equation must hold at t = 0
    # it takes energy at all times, and gives back no more than it has taken
    s.restoring = lambda t, u, v: G @ (4.0 * np.tanh(G.T @ u) + 0.2 * (1.0 + np.cos(t)) * (G.T @ v))
    if rng.random() < 0.5:
        s.K_r = 3.0 * G @ G.T
    if rng.random() < 0.5:
        s.D_r = 0.1 * G @ G.T


def _random_subdomain(rng, substeps, double):
    n = int(rng.integers(1, 9))
    explicit = rng.random() < 0.4
    scheme = (EXPLICIT if explicit else IMPLICIT)[int(rng.integers(4 if explicit else 8))]
    M = np.diag(rng.uniform(1.0, 3.0, n))
    if rng.random() < 0.5:
        M += 0.3 * _semidefinite(rng, n)
    K = 20.0 * _semidefinite(rng, n) + np.eye(n)
    C = None if rng.random() < 0.4 else 0.2 * M + 0.003 * K
    massless = None
    if not explicit and scheme.radius_at_infinity() < 0.9 and rng.random() < 0.5:
        massless = int(rng.integers(n))
        M[massless, :] = M[:, massless] = 0.0
    forms = [FORMATS[int(rng.integers(len(FORMATS)))] for _ in range(3)]
    if np.count_nonzero(M) <= n and rng.random() < 0.5:
        forms[0] = lambda A: np.diag(A).copy()
    s = SubdomainData(M, K, C, scheme, substeps, double, forms)
    _set_random_force(rng, s, massless)
    return s


def _semidefinite(rng, n):
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5)
    return A @ A.T / n


def _set_random_force(rng, s, massless):
    """A load in one of the documented forms, and the same load as a function of time."""
    n = len(s.M)
    direction = rng.normal(size=n)
    if massless is not None:
        direction[massless] = 0.0  # its equation must hold at t = 0
    samples = rng.normal(size=9)
    times = 0.07 * np.arange(9)  # not a multiple of the step; the record ends before the run

    def sampled(t, right=None):
        return np.interp(t, times, samples, right=right)

    kind = int(rng.integers(5))
    if kind == 1:
        s.force, s.reference_force = direction, lambda t: direction
    elif kind == 2:
        s.force = s.reference_force = lambda t: direction * np.cos(3.0 * t)
    elif kind == 3:
        s.force = pm.SampledForce(samples, 0.07, shape=direction)
        s.reference_force = lambda t: direction * sampled(t)
    elif kind == 4:
        s.force = pm.BaseAcceleration(samples, direction, s.M, dt=0.07)
        s.reference_force = lambda t: -s.M @ direction * sampled(t, right=0.0)


def _random_constraints(rng, sizes):
    """Ties and general constraints, independent; several may act on one dof."""
    p = int(rng.integers(1, 1 + min(4, sum(sizes) - 1)))
    while True:
        L = np.zeros((p, sum(sizes)))
        for row in L:
            if rng.random() < 0.7:
                row[rng.choice(row.size, 2, replace=False)] = 1.0, -1.0
            else:
                row[rng.choice(row.size, min(4, row.size), replace=False)] = rng.normal(
                    size=min(4, row.size)
                )
        if np.linalg.matrix_rank(L, tol=1e-3) == p:
            return np.split(L, np.cumsum(sizes)[:-1], axis=1)


def _set_initial_state(rng, subdomains, L):
    """Random displacements and velocities, projected onto those that satisfy the constraints."""
    sizes = [len(s.M) for s in subdomains]
    whole = np.hstack(L)
    for name in ("u0", "v0"):
        x = rng.normal(size=sum(sizes))
        x -= np.linalg.pinv(whole) @ (whole @ x)
        for s, xs in zip(subdomains, np.split(x, np.cumsum(sizes)[:-1])):
            setattr(s, name, xs)
