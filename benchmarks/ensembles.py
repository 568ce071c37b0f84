"""Two hundred records on nine dofs: `Coupler.run_each` against a loop of NumPy over all records.

The loop advances all records at once, one column each, by the trapezoidal rule with dense K and C,
and keeps the largest displacements alone. pmalpha records one dof, all dofs, or nothing but the
same peaks; and takes the structure in two subdomains, one with ten substeps. The springs of the
storeys are evaluated by both in the same way. The last rows are the same with two threads, in
elapsed time.
"""

import time

import numpy as np
from timing import in_turn, run

import pmalpha as pm

N, DT, SUBSTEPS = 9, 0.005, 10
RECORDS, STEPS = 200, 4000
RULE = pm.Newmark(0.25, 0.5)
STOREYS = [0], [(i, i - 1) for i in range(1, N)]  # the first spring is to the ground
STIFFNESS, YIELD = 4000.0, 12.0


def matrices():
    """Masses, and dense K and C, as static condensation and modal damping leave them."""
    rng = np.random.default_rng(7)
    Q = np.linalg.qr(rng.standard_normal((N, N)))[0]
    omega = 2.0 * np.pi * np.linspace(0.7, 12.0, N)
    return np.ones(N), (Q * omega**2) @ Q.T, (Q * (0.1 * omega)) @ Q.T


def records(count, steps):
    """White noise, smoothed a little; one row for each record."""
    noise = np.random.default_rng(1).standard_normal((count, steps + 1))
    noise[:, 1:] = 0.5 * (noise[:, 1:] + noise[:, :-1])
    return 3.0 * noise


# ---- NumPy -----------------------------------------------------------------------------------


def differences():
    """Deformations of the storeys: B @ u."""
    return np.eye(N) - np.eye(N, k=-1)


class Cubic:
    def __init__(self, count):
        self.k, self.k3 = STIFFNESS, 1e6

    def __call__(self, d):
        return d * (self.k + self.k3 * d * d)

    def springs(self):
        return [pm.CubicSpring(at, self.k, self.k3) for at in STOREYS]


class Bilinear:
    def __init__(self, count):
        self.hard, self.soft = 0.05 * STIFFNESS, 0.95 * STIFFNESS
        self.d_y, self.p = YIELD / STIFFNESS, np.zeros((N, count))

    def __call__(self, d):
        np.minimum(np.maximum(self.p, d - self.d_y), d + self.d_y, out=self.p)
        return self.hard * d + self.soft * (d - self.p)

    def springs(self):
        return [pm.Bilinear(at, STIFFNESS, YIELD, 0.05) for at in STOREYS]


class BoucWen:
    """By the classical Runge-Kutta rule along d, in steps of at most half the yield deformation."""

    def __init__(self, count):
        self.z, self.d = np.zeros((N, count)), np.zeros((N, count))

    def __call__(self, d):
        x = (d - self.d) * (STIFFNESS / YIELD)
        sign, length = np.where(x < 0.0, -1.0, 1.0), abs(x)
        steps = 1.0 + np.floor(2.0 * length)
        h = length / steps
        for done in range(int(steps.max())):
            z = self.z
            a = self.slope(z, sign)
            b = self.slope(z + 0.5 * h * a, sign)
            c = self.slope(z + 0.5 * h * b, sign)
            e = self.slope(z + h * c, sign)
            after = z + h / 6.0 * (a + 2.0 * b + 2.0 * c + e)
            self.z = np.where(done < steps, after, z)
        self.d = d
        return 0.05 * STIFFNESS * d + 0.95 * YIELD * self.z

    @staticmethod
    def slope(z, sign):
        return sign * (1.0 - abs(z) * (0.5 + 0.5 * np.sign(sign * z)))

    def springs(self):
        return [pm.BoucWen(at, STIFFNESS, YIELD, 0.05) for at in STOREYS]


def newmark(M, K, C, excitation, law=None):
    """Largest displacements (N, records); excitation (steps + 1, records), as base acceleration.

    The rows of x are u, v, the excitation, and the forces of springs: one product a step.
    """
    B, h = differences(), DT
    K_law = np.zeros((N, N)) if law is None else STIFFNESS * B.T @ B
    S = np.linalg.inv(np.diag(M) + 0.5 * h * C + 0.25 * h**2 * (K + K_law))
    G = -S @ np.hstack([K, C, M[:, None], *([] if law is None else [B.T])])
    x, (a, step) = np.zeros((G.shape[1], excitation.shape[1])), np.zeros((2, *excitation[:N].shape))
    u, v, ground, forces = x[:N], x[N : 2 * N], x[2 * N], x[2 * N + 1 :]
    a[:], peak = -excitation[0], np.zeros_like(a)
    for row in excitation[1:]:
        np.multiply(v, h, out=step)
        u += step
        np.multiply(a, 0.25 * h**2, out=step)
        u += step
        a *= 0.5 * h
        v += a
        ground[:] = row
        if law is not None:
            forces[:] = law(B @ u)
        np.matmul(G, x, out=a)
        np.multiply(a, 0.25 * h**2, out=step)
        u += step
        np.multiply(a, 0.5 * h, out=step)
        v += step
        np.maximum(peak, np.abs(u, out=step), out=peak)
    return peak


# ---- pmalpha ---------------------------------------------------------------------------------


def whole(M, K, C, restoring=None):
    one = pm.Subdomain(M, K, C, scheme=RULE, restoring=restoring, name="frame")
    return pm.Coupler([one], dt=DT, threads=1)


def cut(M, K, C):
    """The same with its lower four dofs in a subdomain of their own: the stiffness between both
    is left to the upper one, which shares the fourth dof."""
    low = slice(0, 5)
    lower = pm.Subdomain(
        0.5 * M[low],
        0.5 * K[low, low],
        0.5 * C[low, low],
        scheme=RULE,
        substeps=SUBSTEPS,
        name="lower",
    )
    mass, stiffness, damping = M.copy(), K.copy(), C.copy()
    mass[low] -= 0.5 * M[low]
    stiffness[low, low] -= 0.5 * K[low, low]
    damping[low, low] -= 0.5 * C[low, low]
    upper = pm.Subdomain(mass, stiffness, damping, scheme=RULE, name="frame")
    ties = pm.tie(upper, range(5), lower, range(5))
    return pm.Coupler([upper, lower], ties, dt=DT, threads=1, coupling="macro")


def cases_of(excitation, masses):
    """A case for each column; `masses` by subdomain."""
    return [
        {"force": {name: pm.BaseAcceleration(x, np.ones(len(m)), m, dt=DT) for name, m in masses}}
        for x in excitation.T.copy()
    ]


if __name__ == "__main__":
    run("ensembles", rows, about=__doc__)
