"""Problems with contact whose solution is known, for tests."""

import numpy as np

import pmalpha as pm

SCHEMES = {
    "TR": pm.Newmark(),
    "rho 0.8": pm.GeneralizedAlpha(0.8),
    "rho 0.5": pm.GeneralizedAlpha(0.5),
    "rho 0": pm.GeneralizedAlpha(0.0),
    "CD": pm.CentralDifference(),
    "explicit 0.8": pm.GeneralizedAlpha(0.8, explicit=True),
    "explicit 0.5": pm.GeneralizedAlpha(0.5, explicit=True),
    "explicit 0": pm.GeneralizedAlpha(0.0, explicit=True),
}
# Bar of Doyen, Ern and Piperno 2011: E, length, gap, velocity; density and cross section are 1.
E, LENGTH, GAP, SPEED = 900.0, 10.0, 5.0, 10.0
WAVE = E**0.5


def bar(n):
    """(lumped M, K) of n elements, free at both ends."""
    dx = LENGTH / n
    M = np.full(n + 1, dx)
    M[[0, -1]] /= 2.0
    K = np.diag(np.full(n + 1, 2.0)) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    return M, E / dx * K


def critical(n):
    """The critical step of central difference, of the whole free bar: dx / c."""
    return LENGTH / n / WAVE


def strain_energy(K, u):
    return 0.5 * np.einsum("ij,ij->i", u, u @ K)


def energy_star(s, h, u, v, w):
    """E* of (U10), which Newmark schemes with gamma = 1/2 change by the works alone, evaluated in
    long double."""
    M = np.diag(s.M) if s.M.ndim == 1 else s.M
    u, v, w = (np.asarray(x, dtype=np.longdouble) for x in (u, v, w))
    beta = s.scheme.beta
    kinetic = 0.5 * np.einsum("ij,ij->i", v, v @ M)
    inertia = 0.5 * h**2 * (beta - 0.25) * np.einsum("ij,ij->i", w, w @ M)
    K = s.K if isinstance(s.K, np.ndarray) else s.K.toarray()
    return kinetic + strain_energy(np.diag(K) if K.ndim == 1 else K, u) + inertia


def bar_on_wall(scheme, n, cfl, t_end=1.5):
    """The history of the bar that meets a wall at t = GAP / SPEED, and its step."""
    M, K = bar(n)
    h = cfl * critical(n)
    s = pm.Subdomain(M, K, scheme=scheme, v0=np.full(n + 1, -SPEED), name="bar")
    wall = pm.contact(s, [0], gap=GAP, name="wall")
    coupler = pm.Coupler([s], wall, dt=h, threads=1)
    return s, coupler.run(steps=round(t_end / h), energy=True), h
