"""Errors against an exact solution, and orders of convergence."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy

import pmalpha._core as _core

from .._checks import positive_number, real_array, real_number, vector, whole_number
from ..errors import ConstraintWarning
from ..problem.matrices import dense
from ..problem.subdomain import dense_whole
from ..run.advance import advance_to
from ..run.coupler import Coupler
from ..run.session import begin, require_linear
from ..setup.member import Member, core_parts
from .amplification import checked_coupler, state_kept

# ---- exact --------------------------------------------------------------------------------------
# Exact solutions of linear coupled problems.

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


# ---- convergence --------------------------------------------------------------------------------

__all__ = ["global_error", "local_error", "observed_order", "start_error"]


def observed_order(run: Callable[[float], float], steps: Sequence[float] | np.ndarray) -> float:
    """Slope of log(error) over log(dt), by least squares.

    Parameters
    ----------
    run : callable
        ``run(dt)`` returns the error with this step, a positive number.
    steps : sequence of float
        At least two different positive steps.

    Returns
    -------
    float
        The order q in :math:`error ~ dt^q`.

    Raises
    ------
    ValueError
        For fewer than two different steps, and for an error that is not positive and finite.

    Notes
    -----
    For an error c1 dt^q + c2 dt^(q+1) the slope differs from q by about dt c2 / c1.

    Examples
    --------
    >>> from pmalpha import analysis
    >>> round(analysis.observed_order(lambda dt: 7.0 * dt**2, [0.1, 0.05, 0.025]), 10)
    2.0
    """
    if not callable(run):
        raise TypeError(f"run must be callable, got {run!r}")
    values = list(steps) if isinstance(steps, Iterable) else steps
    steps = [positive_number(dt, "steps") for dt in real_array(values, "steps").tolist()]
    if len(set(steps)) < 2:
        raise ValueError(f"steps must have at least two different values, got {steps}")
    errors = [_positive_error(run(dt), dt) for dt in steps]
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def _positive_error(error: Any, dt: float) -> float:
    error = real_number(error, f"what run returns at dt = {dt:g}")
    if not error > 0.0:
        raise ValueError(f"run must return a positive finite error, got {error!r} at dt = {dt:g}")
    result: float = error
    return result


def global_error(
    coupler: Coupler, exact: Callable[[float], Instant], t_end: float
) -> dict[str, float]:
    """Errors at t_end of a run from t = 0; the state of the coupler is unchanged.

    Parameters
    ----------
    coupler : Coupler
        With its loads.
    exact : callable
        ``exact(t) -> (dict, Lam)``, as from `exact_solution`: (u, v, w), (n_i,) each, by name of
        the subdomain, and Lam, (p,).
    t_end : float
        A positive whole number of macro steps.

    Returns
    -------
    dict
        Maximum absolute errors: "u", "v" and "a" (of the true acceleration w) over all dofs of all
        subdomains, "multipliers" over all constraints.

    Raises
    ------
    ValueError, InstabilityError
        From `Coupler.run`; for wrong shapes of the exact solution.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> coupler = models.split_oscillator(10.0).coupler(0.01, coupling="pm")
    >>> errors = analysis.global_error(coupler, analysis.exact_solution(coupler), 1.0)
    >>> errors["u"] < 0.01
    True
    """
    with checked_coupler(coupler)._session.guard, state_kept(coupler):
        steps = coupler._session.clock.end(t_end, None, 0)
        _from_the_start(coupler, steps)
        return _errors(coupler, exact(coupler._session.clock.time(steps)))


def start_error(coupler: Coupler, exact: Callable[[float], Instant]) -> dict[str, float]:
    """Errors after the first two macro steps: the initialization error e2 of the paper.

    In the first macro step all subdomains take single steps, in the second the first double steps.
    With different steps the error depends on the `start` of the coupler: "rebased", equation
    (S3), or "plain" as in the paper.

    Parameters
    ----------
    coupler : Coupler
        As for `global_error`.
    exact : callable
        As for `global_error`.

    Returns
    -------
    dict
        As from `global_error`.

    Examples
    --------
    >>> from pmalpha import analysis, models
    >>> oscillator = models.split_oscillator(10.0, substeps=5, v0=6.0)
    >>> def error_of_v(dt, start):
    ...     coupler = oscillator.coupler(dt, start=start, coupling="pm")
    ...     return analysis.start_error(coupler, analysis.exact_solution(coupler))["v"]
    >>> steps = [1 / 640, 1 / 1280]
    >>> [round(analysis.observed_order(lambda dt: error_of_v(dt, start), steps))
    ...  for start in ("plain", "rebased")]
    [1, 2]
    """
    return global_error(coupler, exact, 2.0 * checked_coupler(coupler).dt)


def _from_the_start(coupler: Coupler, steps: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConstraintWarning)  # given when the coupler was made
        coupler._session.started = False
        begin(coupler._session)
    advance_to(coupler._session, steps, None)


def local_error(
    coupler: Coupler, exact: Callable[[float], Instant], *, n: int = 3
) -> dict[str, float]:
    """Errors of one macro step after the start, from exact data: tau_n of the paper.

    Exact data at t_n = n dt: u, v and w of `exact`, a = w, and the stored free velocity from the
    exact v and Lam, equation (S2) with the operators of the step (of 2 h for a double-step
    subdomain)::

        vf = v - al2 Mbar^-1 L^T Lam

    A double-step subdomain has exact data also at its time level before t_n. a = w is a choice: in
    a run a is a first-order approximation of the true acceleration, and another definition of exact
    data, with a as in a smooth solution of the scheme, would give other local errors.

    Parameters
    ----------
    coupler : Coupler
        As for `global_error`.
    exact : callable
        As for `global_error`.
    n : int, default 3
        The macro step is from n dt to (n + 1) dt; at least 1, so that it is after the start.

    Returns
    -------
    dict
        As from `global_error`, at t_{n+1}.

    Examples
    --------
    O(dt^2) in the velocity for rho < 1:

    >>> from pmalpha import analysis, models
    >>> oscillator = models.split_oscillator(10.0, rho=0.5, v0=6.0)
    >>> def error_of_v(dt):
    ...     coupler = oscillator.coupler(dt, coupling="pm")
    ...     return analysis.local_error(coupler, analysis.exact_solution(coupler))["v"]
    >>> round(analysis.observed_order(error_of_v, [1 / 640, 1 / 1280]), 1)
    2.0
    """
    n = whole_number(n, "n", low=1)
    require_linear(checked_coupler(coupler)._session, "local_error")
    if coupler.coupling == "mean":
        raise ValueError(
            'coupling must be "pm", "gc" or "macro" for local_error, whose exact data are states '
            'with the acceleration of the multipliers, got "mean"'
        )
    with coupler._session.guard, state_kept(coupler):
        for member in coupler._session.members:
            member.core.set_levels(_exact_state(coupler, member, exact, n))
        zero = np.zeros(coupler._session.core_rows.p)  # no step reads these multipliers
        coupler._session.core.start(n, zero, zero)
        advance_to(coupler._session, n + 1, None)
        return _errors(coupler, exact(coupler._session.clock.time(n + 1)))


def _exact_state(
    coupler: Coupler, member: Member, exact: Callable[[float], Instant], n: int
) -> dict[str, np.ndarray]:
    """The arrays of a subdomain in the core at t_n, from exact data."""
    u, v, w, lam = _exact_at(coupler, member, exact, coupler._session.clock.time(n))
    h = 2.0 * member.h if member.double else member.h
    # a separate core subdomain, whose single step is h, starts with (S2)
    operator = member.operator(h)
    core = _core.Subdomain(core_parts(member, member.subdomain.scheme, member.L, operator))
    core.start(u, v, w, lam)
    levels = core.levels()
    if member.double:
        t = ((n * member.substeps - 1) / member.substeps) * coupler.dt
        u, v, w, _ = _exact_at(coupler, member, exact, t)
        # no step reads this free velocity, and there are no springs and internal forces
        before = (u, v, w, w, np.zeros(member.nb), np.zeros(0), np.zeros(0))
        levels |= {f"previous_{name}": x for name, x in zip(levels, before)}
    return levels


def _exact_at(
    coupler: Coupler, member: Member, exact: Callable[[float], Instant], t: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """u, v, w and Lam at time t in the core's order."""
    states, lam = exact(t)
    state = [
        vector(x, member.n, f"{name} of {member.name!r} from exact({t:g})")[member.order]
        for x, name in zip(states[member.name], "uvw")
    ]
    rows = coupler._session.core_rows
    return (*state, rows.forces_in_core(vector(lam, rows.p, f"Lam from exact({t:g})")))


def _errors(coupler: Coupler, solution: Instant) -> dict[str, float]:
    states, lam = solution
    rows = coupler._session.core_rows
    got = rows.forces(coupler._session.core.multipliers)
    errors = {"u": 0.0, "v": 0.0, "a": 0.0}
    for member in coupler._session.members:
        for name, x, y in zip(errors, member.core.state(), states[member.name]):
            y = vector(y, member.n, f"{name} of {member.name!r} from exact")
            errors[name] = max(errors[name], float(np.max(np.abs(x[member.position] - y))))
    difference = np.abs(got - vector(lam, rows.p, "Lam from exact"))
    return errors | {"multipliers": float(np.max(difference, initial=0.0))}
