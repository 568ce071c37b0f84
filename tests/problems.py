"""Random coupled problems, once for the package and once for the reference."""

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
class Part:
    """What one subdomain is, before it is written down for either program."""

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


@dataclass
class Problem:
    """A coupled problem for both programs."""

    parts: list
    L: list
    dt: float
    start: str
    coupling: str

    def coupler(self, **options):
        subdomains = [_subdomain(part) for part in self.parts]
        touched = {s: Li for s, Li in zip(subdomains, self.L) if Li.any()}
        return pm.Coupler(
            subdomains,
            pm.Constraint(touched),
            dt=self.dt,
            start=self.start,
            coupling=self.coupling,
            **options,
        )

    def reference(self, steps, doubles):
        """`doubles`: who takes double steps, as the package decided."""
        parts = [_reference_part(part, double) for part, double in zip(self.parts, doubles)]
        return reference.run(parts, self.L, self.dt, steps, start=self.start)


def _subdomain(part):
    M, C, K = (None if A is None else f(A) for A, f in zip((part.M, part.C, part.K), part.forms))
    return pm.Subdomain(
        M,
        K,
        C,
        scheme=part.scheme,
        substeps=part.substeps,
        double_step=part.double,
        force=part.force,
        restoring=part.restoring,
        restoring_stiffness=part.K_r,
        restoring_damping=part.D_r,
        damping="lagged" if part.lagged else "implicit",
        u0=part.u0,
        v0=part.v0,
    )


def _reference_part(part, double):
    s = part.scheme
    return reference.Part(
        part.M,
        part.K,
        part.C,
        am=s.am,
        af=s.af,
        beta=s.beta,
        gamma=s.gamma,
        explicit=s.explicit,
        substeps=part.substeps,
        double=double,
        force=part.reference_force,
        restoring=part.restoring,
        K_r=part.K_r,
        D_r=part.D_r,
        lagged=part.lagged,
        u0=part.u0,
        v0=part.v0,
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
        doubles[0] = False  # somebody at the finest step is single
    parts = [_random_part(rng, s, d) for s, d in zip(substeps, doubles)]
    L = _random_conditions(rng, [len(part.M) for part in parts])
    if not any(np.any(np.diag(part.M) == 0.0) for part in parts):
        _set_initial_state(rng, parts, L)
    start = "plain" if rng.random() < 0.3 else "rebased"
    return Problem(parts, L, 0.05, start, "gc" if rng.random() < 0.25 else "pm")


def random_restored_problem(seed):
    """The same, with restoring forces, estimates for some of them, and lagged damping."""
    problem = random_problem(seed)
    rng = np.random.default_rng([seed, 1])
    for part in problem.parts:
        massless = np.diag(part.M) == 0.0
        part.lagged = bool(rng.random() < 0.5) and not massless.any()
        if rng.random() < 0.7:
            _set_random_restoring(rng, part, massless)
    return problem


def _set_random_restoring(rng, part, massless):
    G = rng.normal(size=(len(part.M), 2))
    G[massless] = 0.0  # its equation must hold at t = 0
    part.restoring = lambda u, v, t: (
        G @ (4.0 * np.tanh(G.T @ u) + 0.2 * np.cos(t) * (G.T @ v) + 0.5 * np.sin(t))
    )
    if rng.random() < 0.5:
        part.K_r = 3.0 * G @ G.T
    if rng.random() < 0.5:
        part.D_r = 0.1 * G @ G.T


def _random_part(rng, substeps, double):
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
    part = Part(M, K, C, scheme, substeps, double, forms)
    _set_random_force(rng, part, massless)
    return part


def _semidefinite(rng, n):
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5)
    return A @ A.T / n


def _set_random_force(rng, part, massless):
    """A load in one of the forms of the contract, and the same as a function of time alone."""
    n = len(part.M)
    direction = rng.normal(size=n)
    if massless is not None:
        direction[massless] = 0.0  # its equation must hold at t = 0
    samples = rng.normal(size=9)
    times = 0.07 * np.arange(9)  # no multiple of the step, and it ends before the run

    def sampled(t, right=None):
        return np.interp(t, times, samples, right=right)

    kind = int(rng.integers(5))
    if kind == 1:
        part.force, part.reference_force = direction, lambda t: direction
    elif kind == 2:
        part.force = part.reference_force = lambda t: direction * np.cos(3.0 * t)
    elif kind == 3:
        part.force = pm.SampledForce(samples, 0.07, shape=direction)
        part.reference_force = lambda t: direction * sampled(t)
    elif kind == 4:
        part.force = pm.BaseAcceleration(samples, 0.07, direction, part.M)
        part.reference_force = lambda t: -part.M @ direction * sampled(t, right=0.0)


def _random_conditions(rng, sizes):
    """Ties and general conditions, independent; several may meet in a dof."""
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


def _set_initial_state(rng, parts, L):
    """Random displacements and velocities without the part that would break the conditions."""
    sizes = [len(part.M) for part in parts]
    whole = np.hstack(L)
    for name in ("u0", "v0"):
        x = rng.normal(size=sum(sizes))
        x -= np.linalg.pinv(whole) @ (whole @ x)
        for part, own in zip(parts, np.split(x, np.cumsum(sizes)[:-1])):
            setattr(part, name, own)
