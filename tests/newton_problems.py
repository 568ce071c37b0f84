"""Problems with internal forces in two subdomains, for tests and tables of Newton's method.

Every function returns the subdomains, their constraint matrices and a function of a Result that
measures it. All units are any consistent set.
"""

import functools

import numpy as np
import scipy.integrate
from newton_step import Nonlinear
from reference import alpha


def springs(pairs, law):
    """evaluate(t, u, v, q) of springs between pairs of dofs (-1: the ground).

    law(d, q) -> force, tangent and new history of every spring, each of the shape of d.
    """

    def evaluate(t, u, v, q):
        B = np.zeros((len(pairs), len(u)))
        for row, (i, j) in enumerate(pairs):
            if i >= 0:
                B[row, i] -= 1.0
            if j >= 0:
                B[row, j] += 1.0
        f, k, q1 = law(B @ u, q)
        return B.T @ f, B.T @ (k[:, None] * B), np.zeros((len(u), len(u))), q1

    return evaluate


def duffing(k, k3, c3=0.0):
    """evaluate(t, u, v, q) of one dof: k u + k3 u^3 + c3 v^3."""

    def evaluate(t, u, v, q):
        return k * u + k3 * u**3 + c3 * v**3, np.diag(k + 3 * k3 * u**2), np.diag(3 * c3 * v**2), q

    return evaluate


def cubic(k, k3):
    """Law of cubic springs."""
    return lambda d, q: (k * d + k3 * d**3, k + 3.0 * k3 * d**2, q)


def bilinear(k, hardening, yield_at):
    """Law of bilinear springs with kinematic hardening, (H3); q are the plastic deformations."""

    def law(d, q):
        p = np.clip(q, d - yield_at, d + yield_at)
        tangent = np.where(p == q, k, hardening * k)
        return hardening * k * d + (1.0 - hardening) * k * (d - p), tangent, p

    return law


def contact(k, gap, stiffness):
    """Law of linear springs with a penalty stop at the deformation `gap`."""

    def law(d, q):
        closed = d > gap
        return k * d + stiffness * np.where(closed, d - gap, 0.0), k + stiffness * closed, q

    return law


def chain(n, law, history=None, ss=(1, 1), double=False, rho=0.5, **values):
    """Two chains of n unit masses from the ground to a free end, tied in the middle.

    Each side has half of the tied mass; `values` are those of Nonlinear for the uncut chain of
    2 n - 1 masses.
    """
    left, right = list(range(n)), list(range(n - 1, 2 * n - 1))
    scheme = [rho, rho] if np.isscalar(rho) else rho
    u0 = values.get("u0", np.zeros(2 * n - 1))
    v0 = values.get("v0", np.zeros(2 * n - 1))
    force = values.get("force")
    subdomains, L = [], []
    for side, dofs in enumerate((left, right)):
        pairs = [(i - 1, i) for i in range(n)] if side == 0 else [(i, i + 1) for i in range(n - 1)]
        M = np.eye(n)
        M[(n - 1, n - 1) if side == 0 else (0, 0)] = 0.5
        share = np.diag(M)
        subdomains.append(
            Nonlinear(
                M=M,
                K=np.zeros((n, n)),
                internal=springs(pairs, law),
                history=None if history is None else np.full(len(pairs), history),
                substeps=ss[side],
                double=double and side == 0,
                u0=u0[dofs],
                v0=v0[dofs],
                force=None if force is None else lambda t, d=dofs, s=share: s * force(t)[d],
                **alpha(scheme[side]),
            )
        )
        row = np.zeros((1, n))
        row[0, n - 1 if side == 0 else 0] = 1.0 if side == 0 else -1.0
        L.append(row)
    return subdomains, L


# ---- two Duffing oscillators, tied ----------------------------------------------------------

DUFFING = (1.0, 20.0, 30.0, 0.05), (0.4, 30.0, 60.0, 0.0)  # m, k, k3, c3 of A and B


def duffing_pair(ss=(1, 1), double=False, rho=0.5, explicit=False):
    """A and B on one dof, from u = 1, v = 0.5; B may be explicit. Free period about 0.7."""
    one = np.ones((1, 1))
    subdomains = [
        Nonlinear(
            M=m * one,
            K=0.0 * one,
            internal=duffing(k, k3, c3),
            substeps=ss[side],
            double=double and side == 0,
            u0=[1.0],
            v0=[0.5],
            **alpha(rho, explicit=explicit and side == 1),
        )
        for side, (m, k, k3, c3) in enumerate(DUFFING)
    ]
    return subdomains, [one, -one]


@functools.cache
def duffing_path(end):
    m, k, k3, c3 = np.sum(DUFFING, axis=0)
    return scipy.integrate.solve_ivp(
        lambda t, y: [y[1], -(k * y[0] + k3 * y[0] ** 3 + c3 * y[1] ** 3) / m],
        (0.0, end),
        [1.0, 0.5],
        method="DOP853",
        dense_output=True,
        rtol=1e-13,
        atol=1e-14,
    ).sol


def duffing_exact(t):
    """u and v of the pair at the times t, by DOP853."""
    return duffing_path(round(float(t[-1]), 9))(t)


def duffing_error(result):
    """Largest errors of u and v of A."""
    x = result.subdomains[0]
    u, v = duffing_exact(x.t)
    return abs(x.u[:, 0] - u).max(), abs(x.v[:, 0] - v).max()


# ---- a double pendulum of stiff bars --------------------------------------------------------


def pendulum(ss=(1, 1), double=False, rho=0.5, EA=1e7):
    """Two bars of length 1 with unit masses at their ends, released from the horizontal.

    A: the upper bar and half of the middle mass; B: the other half, the lower bar and its mass.
    """

    def bar(x):
        length = np.linalg.norm(x)
        c, N = x / length, EA * (length - 1.0)
        return N * c, EA * np.outer(c, c) + N / length * (np.eye(2) - np.outer(c, c))

    def upper(t, u, v, q):
        f, k = bar(np.array([1.0, 0.0]) + u)
        return f, k, np.zeros((2, 2)), q

    def lower(t, u, v, q):
        f, k = bar(np.array([1.0, 0.0]) + u[2:] - u[:2])
        return np.concatenate([-f, f]), np.block([[k, -k], [-k, k]]), np.zeros((4, 4)), q

    A, B = (
        Nonlinear(
            M=np.diag(m),
            K=np.zeros((len(m), len(m))),
            internal=internal,
            substeps=ss[side],
            double=double and side == 0,
            force=lambda t, m=m: np.array(m) * np.tile([0.0, -9.81], len(m) // 2),
            **alpha(rho),
        )
        for side, (m, internal) in enumerate((([0.5] * 2, upper), ([0.5, 0.5, 1.0, 1.0], lower)))
    )
    return [A, B], [np.eye(2), -np.eye(2, 4)]


def pendulum_error(result):
    """Largest error of the displacements of B against rigid bars, by DOP853."""

    def rates(t, y):
        a, b, va, vb = y  # angles of the bars with the horizontal, and their rates
        M = np.array([[2.0, np.cos(a - b)], [np.cos(a - b), 1.0]])
        f = [
            -np.sin(a - b) * vb**2 - 2 * 9.81 * np.cos(a),
            np.sin(a - b) * va**2 - 9.81 * np.cos(b),
        ]
        return [va, vb, *np.linalg.solve(M, f)]

    x = result.subdomains[1]
    span = (0.0, x.t[-1])
    path = scipy.integrate.solve_ivp(
        rates, span, np.zeros(4), method="DOP853", t_eval=x.t, rtol=1e-11, atol=1e-12
    )
    a, b = path.y[:2]
    middle = np.array([np.cos(a) - 1.0, np.sin(a)])
    end = middle + [np.cos(b) - 1.0, np.sin(b)]
    return abs(x.u.T - np.vstack([middle, end])).max()
