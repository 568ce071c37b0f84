"""Problems with internal forces in two subdomains, for tests and tables of Newton's method.

Every function returns the subdomains, their constraint matrices and a function of a Result that
measures it. All units are any consistent set.
"""

import numpy as np
from newton_step import Nonlinear
from reference import alpha


def springs(pairs, law):
    """evaluate(u, v, t, q) of springs between pairs of dofs (-1: the ground).

    law(d, q) -> force, tangent and new history of every spring, each of the shape of d.
    """

    def evaluate(u, v, t, q):
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
    """evaluate(u, v, t, q) of one dof: k u + k3 u^3 + c3 v^3."""

    def evaluate(u, v, t, q):
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
