"""Problems and sequences of steps for the tests of changing steps."""

import numpy as np
from scipy.linalg import expm

import pmalpha as pm

# Two tied subdomains of two dofs each: M, K, and initial displacements that satisfy the tie.
M = [np.array([1.0, 0.6]), np.array([0.5, 0.8])]
K = [np.array([[30.0, -12.0], [-12.0, 14.0]]), np.array([[25.0, -9.0], [-9.0, 20.0]])]
U0 = [np.array([0.3, 1.0]), np.array([1.0, -0.4])]
RHO = 0.5


def pair(dt, substeps=(1, 1), *, explicit=False, double=None, scheme=None, force=None, **options):
    """The two subdomains: A with dof 1 tied to dof 0 of B; "gc" unless said otherwise."""
    a = pm.GeneralizedAlpha(RHO) if scheme is None else scheme
    b = pm.GeneralizedAlpha(RHO, explicit=explicit) if scheme is None else scheme
    of_a = dict(double_step=double, force=force, u0=U0[0], name="A")
    A = pm.Subdomain(M[0], K[0], scheme=a, substeps=substeps[0], **of_a)
    B = pm.Subdomain(M[1], K[1], scheme=b, substeps=substeps[1], u0=U0[1], name="B")
    return pm.Coupler([A, B], pm.tie(A, [1], B, [0]), dt=dt, **{"coupling": "gc", **options})


def exact(t):
    """u and v of the two subdomains, one after the other, of the uncut structure."""
    T = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mass = T.T @ np.diag(np.concatenate(M)) @ T
    stiffness = np.zeros((4, 4))
    stiffness[:2, :2], stiffness[2:, 2:] = K
    stiffness = T.T @ stiffness @ T
    n = len(mass)
    system = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, stiffness), np.zeros((n, n))]]
    )
    start = np.concatenate([U0[0], U0[1][1:], np.zeros(n)])
    x = expm(system * t) @ start
    return T @ x[:n], T @ x[n:]


# Lengths of consecutive macro steps, in units that refinement divides: their sum is T.
T = 2.0


def lengths(pattern, n, seed=0):
    """About n macro steps with the sum T: alternating 2:1, blocks of 8 of 2:1, or random."""
    if pattern == "alternating":
        units = np.tile([2.0, 1.0], n // 2)
    elif pattern == "blocks":
        units = np.tile(np.repeat([2.0, 1.0], 8), n // 16)
    elif pattern == "constant":
        units = np.ones(n)
    else:
        units = np.random.default_rng(seed).uniform(0.5, 1.5, n)
    return units * (T / units.sum())


def error(coupler, steps):
    """The largest error of u (and of v) at T after these macro steps."""
    for dt in steps:
        coupler.change_steps(dt=float(dt))
        coupler.step()
    u, v = exact(coupler.time)
    got = [np.concatenate([getattr(coupler.state(k), q) for k in "AB"]) for q in "uv"]
    return [float(np.max(np.abs(x - y))) for x, y in zip(got, (u, v))]


def order(make, pattern, n):
    """Observed orders of u and v between n and 2 n macro steps; of random lengths the mean of 3."""
    seeds, logs = range(3 if pattern == "random" else 1), []
    for count in (n, 2 * n):
        sequences = [lengths(pattern, count, seed) for seed in seeds]
        errors = [error(make(steps[0]), steps) for steps in sequences]
        logs.append(np.mean(np.log2(errors), axis=0))
    return logs[0] - logs[1]
