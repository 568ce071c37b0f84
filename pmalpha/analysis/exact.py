"""Exact solutions of linear coupled problems."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy

from ..problem.matrices import dense
from ..problem.subdomain import dense_whole
from ..run.coupler import Coupler
from ..run.session import require_linear
from .amplification import checked_coupler

__all__ = ["exact_solution"]

# An exact solution at one time: (u, v, w) by name of the subdomain, and Lam.
Instant = tuple[Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], np.ndarray]


def exact_solution(coupler: Coupler) -> Callable[[float], Instant]:
    """The exact solution of the linear problem (1), (2) of a coupler.

    For small problems: every call computes the dense matrix exponential of the uncut structure.

    Parameters
    ----------
    coupler : Coupler
        Any number of subdomains, without loads or with constant loads. The initial values are those
        of the coupler, also after ``reset(u0=..., v0=...)``.

    Returns
    -------
    callable
        Of the time t >= 0; it returns a dict with (u, v, w), (n_i,) each, by name of the subdomain,
        and Lam, (p,).

    Raises
    ------
    ValueError
        For loads that depend on time, prescribed motion, restoring forces, and an uncut structure
        with a singular mass matrix.

    Notes
    -----
    Let the columns of Z be a basis of the null space of L = [L_1 ... L_N]. Then u = u_0 + Z q
    satisfies (2), and Z^T times (1) is the equation of the uncut structure::

        Z^T M Z q'' + Z^T C Z q' + Z^T K (u_0 + Z q) = Z^T F

    w = Z q'', and Lam follows from (1): L L^T Lam = L (M w + C v + K u - F).

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> exact = analysis.exact_solution(models.split_oscillator(10.0).coupler(0.05, coupling="pm"))
    >>> state, lam = exact(0.25)
    >>> u, v, w = state["B"]
    >>> bool(abs(v[0] + 2 * np.pi) < 1e-12)
    True
    """
    require_linear(checked_coupler(coupler)._session, "exact_solution")
    with coupler._session.guard:
        return _Exact(coupler)


class _Exact:
    """The uncut structure as a linear system x' = A x, with x = (q, q', 1)."""

    def __init__(self, coupler: Coupler):
        if coupler._session.loads.motions:
            raise ValueError("coupler must have no prescribed motion for an exact solution")
        subdomains = [s for _, s in coupler._session.keys]
        self.names = [name for name, _ in coupler._session.keys]
        self.ends = np.cumsum([s.n for s in subdomains])[:-1]
        M, C, K = (dense_whole(subdomains, name) for name in "MCK")
        self.M, self.C, self.K = M, C, K
        self.L = np.hstack([dense(L) for L in coupler._session.rows.matrices])
        self.F = np.concatenate([_constant(coupler, i) for i in range(len(subdomains))])
        self.u0, v0 = (np.concatenate(x) for x in zip(*coupler._session.initial.values))
        self.Z = Z = scipy.linalg.null_space(self.L)
        m = Z.shape[1]
        mass = Z.T @ M @ Z
        if np.linalg.cond(mass) > 1e12:
            raise ValueError(
                "coupler must have mass in every motion of the uncut structure for an exact "
                f"solution, got a mass matrix of condition number {np.linalg.cond(mass):.1e}"
            )
        right = Z.T @ np.column_stack([-K @ Z, -C @ Z, self.F - K @ self.u0])
        self.A = np.zeros((2 * m + 1, 2 * m + 1))  # d/dt (q, q', 1)
        self.A[:m, m : 2 * m] = np.eye(m)
        self.A[m : 2 * m] = np.linalg.solve(mass, right)
        self.x0 = np.concatenate([np.zeros(m), Z.T @ v0, [1.0]])

    def __call__(self, t: float) -> Instant:
        m, Z = self.Z.shape[1], self.Z
        x = scipy.linalg.expm(self.A * t) @ self.x0
        u, v = self.u0 + Z @ x[:m], Z @ x[m : 2 * m]
        w = Z @ (self.A @ x)[m : 2 * m]
        force = self.M @ w + self.C @ v + self.K @ u - self.F  # L^T Lam, (1)
        lam = np.linalg.lstsq(self.L.T, force, rcond=None)[0]
        states = zip(*(np.split(x, self.ends) for x in (u, v, w)))
        return dict(zip(self.names, states)), lam


def _constant(coupler: Coupler, i: int) -> np.ndarray:
    """The constant load of subdomain i, in the user's order."""
    force, member = coupler._session.loads.forces[i], coupler._session.members[i]
    if force is not None and not isinstance(force, np.ndarray):
        raise ValueError(
            f"coupler must have no loads or constant ones for an exact solution, got {force!r} on "
            f"subdomain {member.name!r}"
        )
    return np.zeros(member.n) if force is None else force
