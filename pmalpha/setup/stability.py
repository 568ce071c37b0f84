"""The critical step of an explicit or conditionally stable subdomain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
import scipy.sparse as sp

from .._checks import vector
from ..memory import one_thread
from ..problem.arguments import VectorLike
from ..problem.matrices import (
    Matrix,
    absolute,
    combination,
    dense,
    diagonal,
    is_symmetric,
    largest_pairs,
    product,
    skew_part,
)
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from .internal_forces import InternalForces, internal_forces, present_tangent

# Below this size the eigenvalues of the dense matrices take less time than Lanczos.
SMALL = 200
# Lanczos approaches the highest frequency from below; MARGIN compensates for its tolerance.
LANCZOS_TOLERANCE, MARGIN = 1e-4, 1e-3
# Relative rounding of eigenvalues, by which a step may exceed the critical step.
ROUNDING = 1e-9


@dataclass(frozen=True)
class StepRatio:
    """The step of a subdomain divided by its critical step; with `is_bound` an upper bound.

    `when_closed`: it is at most 1 as long as contact is open. `raised`: whether ties or damping
    raise the critical step above it, since the coupled step does not grow; None before this was
    decided.
    """

    value: float
    is_bound: bool = False
    when_closed: bool = False
    raised: bool | None = None

    @property
    def is_above(self) -> bool:
        """Whether the step is above the critical one of the subdomain alone."""
        return not self.is_bound and not self.value <= 1.0 + ROUNDING


def critical_product(scheme: Scheme) -> float:
    """Largest stable Omega = omega h of an undamped oscillator; inf if there is none.

    Viscous damping, which is implicit in all schemes, does not lower it.
    """
    return _critical_product(scheme, scheme.explicit)


@lru_cache(maxsize=256)
def _critical_product(scheme: Scheme, explicit: bool) -> float:
    grid = np.geomspace(1e-2, 1e4, 600)
    unstable = grid[~_are_stable(scheme, explicit, grid)]
    if not unstable.size:
        return np.inf
    high = unstable[0]
    low = high / (grid[1] / grid[0])
    while high - low > 1e-12 * high:
        grid = np.linspace(low, high, 66)
        k = int(np.argmin(np.append(_are_stable(scheme, explicit, grid[1:-1]), False)))
        low, high = grid[k], grid[k + 1]
    return float(low)


def _are_stable(scheme: Scheme, explicit: bool, Omegas: np.ndarray) -> np.ndarray:
    # 1e-7: a double eigenvalue of modulus one is computed with an error of the square root of the
    # rounding
    amplifications = scheme._amplification(Omegas, 0.0, explicit)
    result: np.ndarray = np.max(np.abs(np.linalg.eigvals(amplifications)), axis=1) <= 1.0 + 1e-7
    return result


def predicted_product(scheme: Scheme) -> float:
    """Omega_s of a force at the predictor: that of the explicit scheme with these parameters."""
    return _critical_product(scheme, True)


@lru_cache(maxsize=256)
def critical_damping_product(scheme: Scheme) -> float:
    """Z_s, the largest stable c h of lagged damping without stiffness, equation (C2)."""
    ratio = (1.0 - 2.0 * scheme.af) / (1.0 - 2.0 * scheme.am) if scheme.gamma != 0.5 else 0.0
    return 1.0 / (1.0 + (scheme.gamma - 0.5) * ratio)


def critical_step(
    subdomain: Subdomain,
    *,
    u: VectorLike | None = None,
    v: VectorLike | None = None,
    q: VectorLike | None = None,
) -> float:
    """The longest stable step of a subdomain without constraints, equations (C1) and (C2).

    It limits the substep h = dt / substeps; for double steps, of length 2 h, the substep must not
    exceed half of it.

    Parameters
    ----------
    subdomain : Subdomain
        Its interface is taken as free: ties do not raise the limit.
    u, v : (n,) array, optional
        Displacement and velocity at which the tangents of internal forces are evaluated, those of
        `Coupler.state` for example. Default: u0 and v0 of the subdomain. Contact counts as closed.
    q : (m,) array, optional
        Their history there, a row of `SubdomainHistory.q`. Default: that at t = 0.

    Returns
    -------
    float
        In the unit of time of the matrices; inf where every step is stable. From a few hundred
        sparse dofs on, up to 0.1 per cent too small rather than too large.

    Notes
    -----
    The largest stable omega h of the scheme, divided by the highest circular frequency of
    :math:`K x = omega^2 M x`. Implicit damping does not lower the limit and is neglected. Lagged
    damping does: h is the step at which the largest eigenvalue of h^2 K / Omega_s^2 + h C / Z_s
    with respect to M is 1. Of an unsymmetric K, omega^2 is the largest modulus of an eigenvalue;
    where it is complex the motion itself grows, and no step is stable. Of lagged damping with a
    skew part G, h is the step up to which an oscillator with the largest stiffness, damping and
    ``|G|`` is stable, equation (C3). A restoring force is represented by the estimate K_r, which is
    added to K, and springs by their largest tangent stiffness (k of a `CubicSpring`), their dampers
    as lagged damping; in an implicit subdomain they have that of equation (C4), which K_r raises.
    Internal forces are represented by their tangents at u, v and q, at the time 0, springs among
    them by the tangent at u or the largest one and contact as closed at all of its nodes: with a
    longer step a bounce adds energy.

    `Coupler` warns of steps above the critical one, unless ties or damping make them stable: where
    all subdomains are linear and the amplification matrix has up to 300 rows, its spectral radius
    decides. `Coupler.run` warns once, at its beginning, of explicit steps above the critical one
    for the tangents of the present state.

    Examples
    --------
    >>> from pmalpha import analysis
    >>> rig = Subdomain([1.0], [4.0], scheme=CentralDifference())
    >>> round(analysis.critical_step(rig), 6)
    1.0
    >>> analysis.critical_step(Subdomain([1.0], [4.0], scheme=Newmark()))
    inf

    A hardening spring, at rest and at u = 1, where its tangent is 1 + 3 u^2:

    >>> spring = CubicSpring([0], k=1.0, k3=1.0)
    >>> rig = Subdomain([1.0], None, scheme=CentralDifference(), internal=spring)
    >>> round(analysis.critical_step(rig), 6), round(analysis.critical_step(rig, u=[1.0]), 6)
    (2.0, 1.0)
    """
    if not isinstance(subdomain, Subdomain):
        raise TypeError(f"subdomain must be a Subdomain, got {subdomain!r}")
    forces = internal_forces(subdomain, subdomain.name or "subdomain")
    initial = np.empty(0) if forces is None else forces.initial
    state = (
        subdomain.u0 if u is None else vector(u, subdomain.n, "u"),
        subdomain.v0 if v is None else vector(v, subdomain.n, "v"),
    )
    past = initial if q is None else vector(q, initial.size, "q")
    K = present_tangent(subdomain, forces, 0.0, *state, past, closed=True)
    return limit_of(subdomain, K)


@np.errstate(over="ignore")  # then the step is above any limit
def limit_of(subdomain: Subdomain, internal: Matrix, *, closed: bool = True) -> float:
    """The critical step with this tangent of the internal forces; `closed` is for springs."""
    limit = _limit_of_matrices(subdomain, internal, closed)
    return min(limit, _limit_of_springs(subdomain)) if closed else limit


def _limit_of_matrices(subdomain: Subdomain, internal: Matrix, closed: bool) -> float:
    terms = limiting_terms(subdomain, internal, closed=closed)
    stiffness, damping = (combination([term]) for term in terms)
    if stiffness is None and damping is None:
        return np.inf
    if subdomain.M is None or subdomain.massless.size:
        return 0.0
    if not is_symmetric(damping):
        return _skew_limit(subdomain, internal)
    matrices = [A for A in (stiffness, damping) if A is not None]
    margin = 1.0 if all(_is_cheap(A, subdomain.M) for A in matrices) else 1.0 + MARGIN
    if not (subdomain.symmetric or is_symmetric(stiffness)):
        result: float = 1.0 / (margin * np.sqrt(_largest_modulus(stiffness, subdomain.M)))
        return result
    return _root(stiffness, damping, subdomain.M) / margin


def _limit_of_springs(s: Subdomain) -> float:
    """The critical step of springs at the predictor of an implicit subdomain, equation (C4).

    Of many dofs, or where some have no mass, that of the dofs of the springs with all others held:
    not too short.
    """
    if s.scheme.explicit or not s.restoring_springs or s.largest_tangent is None:
        return np.inf
    Omega2 = predicted_product(s.scheme) ** 2
    b = s.scheme.coefficients(1.0)[0]
    A, M = at_springs(s, combination([(1.0, s.largest_tangent), (-b * Omega2, s.tangent)]))
    heavy = M > 0.0 if M.ndim == 1 else diagonal(M) > 0.0
    rounding = ROUNDING * float(np.max(np.abs(diagonal(s.largest_tangent))))
    if not heavy.all():
        light = np.eye(heavy.size)[:, ~heavy]
        if np.max(np.linalg.eigvalsh(light.T @ dense(A) @ light)) > rounding:
            return 0.0
        A, M = _of_dofs(A, heavy), _of_dofs(M, heavy)
    value = largest_eigenvalue(A, M)[0] if heavy.any() else 0.0
    is_rounding = value * float(np.max(diagonal(M), initial=0.0)) <= rounding
    return np.inf if is_rounding else float(np.sqrt(Omega2 / value))


def at_springs(s: Subdomain, A: Matrix) -> tuple[Matrix, Matrix]:
    """A and M; of many dofs, or where some have no mass, those of the dofs of springs."""
    M = np.zeros(s.n) if s.M is None else s.M
    if s.n <= SMALL and not s.massless.size:
        return A, M
    dofs = np.unique(np.concatenate([spring.dofs.ravel() for spring in s.springs]))
    rows = dofs[dofs >= 0]
    return _of_dofs(A, rows), _of_dofs(M, rows)


def _of_dofs(A: Matrix, dofs: np.ndarray) -> Matrix:
    return A[dofs] if A.ndim == 1 else A[dofs][:, dofs]


def limiting_terms(
    subdomain: Subdomain, internal: Matrix | None = None, *, closed: bool = True
) -> list[tuple[float, Matrix]]:
    """A = (K + K_r + K_t) / Omega_s^2 and B = C / Z_s if lagged: h^2 A + h B has to stay below M.

    Each is a factor and a matrix, which saves a copy of a large matrix. Springs count with their
    largest tangents and dampers, which are lagged, unless `closed` is False.
    """
    Omega = critical_product(subdomain.scheme)
    A = None
    if np.isfinite(Omega):
        A = subdomain.largest_tangent if closed else subdomain.initial_tangent
        A = A if internal is None else combination([(1.0, A), (1.0, internal)])
    B = subdomain.C if subdomain.damping == "lagged" else None
    dampers = subdomain.dampers if closed else None
    if dampers is not None:
        B = combination([(1.0, B), (1.0, dampers)])
    factor = 0.0 if B is None else 1.0 / critical_damping_product(subdomain.scheme)
    return [(1.0 / Omega**2, A), (factor, B)]


def _root(A: Matrix | None, B: Matrix | None, M: Matrix) -> float:
    """The h at which the largest eigenvalue of h^2 A + h B with respect to M is 1.

    With the Rayleigh quotients a and b of the eigenvector x at some h, the root of a h^2 + b h = 1
    is an upper bound of the solution. The iteration decreases from there on and converges
    quadratically, or in one step where one of the two matrices is zero.
    """
    h = 1.0
    for _ in range(100):
        value, x = largest_eigenvalue(combination([(h, A), (1.0, B)]), M)
        if not value > 0.0:
            return np.inf
        m = x @ product(M, x)
        a, b = max(x @ product(A, x) / m, 0.0), max(x @ product(B, x) / m, 0.0)
        if not a + b > 0.0:
            return np.inf
        before, h = h, 2.0 / (b + np.sqrt(b * b + 4.0 * a))
        if A is None or B is None or abs(h - before) <= 1e-12 * h:
            break
    return float(h)


def _skew_limit(subdomain: Subdomain, internal: Matrix) -> float:
    """The critical step with lagged damping that has a skew part, equation (C3)."""
    s, M = subdomain, subdomain.M
    K = combination([(1.0, s.largest_tangent), (1.0, internal)])
    k = 0.0 if K is None else _largest_modulus(K, M)
    C = combination([(0.5, s.C), (0.5, s.C.T)])
    c = 0.0 if C is None else largest_eigenvalue(C, M)[0]
    g = float(np.sqrt(_largest_modulus(_squared(skew_part(s.C), M), M)))
    oscillators = [(k, 0.0), (0.0, 1j * g), (k, 1j * g), (0.0, c + 1j * g), (k, c + 1j * g)]

    def is_stable(h: float) -> bool:
        return all(_lagged_radius(s.scheme, h, *x) <= 1.0 + 1e-7 for x in oscillators)

    low, high = 0.0, critical_product(s.scheme) / np.sqrt(max(k, g * g))
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return low


def _squared(G: Matrix, M: Matrix) -> Matrix:
    """G^T M^-1 G"""
    if M.ndim == 1:
        return G.T @ (sp.diags_array(1.0 / M) @ G)
    inverse = np.linalg.inv(dense(M))
    return dense(G).T @ inverse @ dense(G)


def _lagged_radius(scheme: Scheme, h: float, k: float, c: complex) -> float:
    """Spectral radius of an explicit step of w + c v + k u = 0 with lagged damping (R4)."""
    step = scheme.constants(h)
    ut, _ = step.predictors()
    amplification = step.closed(-c * np.array([0.0, 1.0, h, 0.0]) - k * ut)
    return float(np.max(np.abs(np.linalg.eigvals(amplification))))


def step_ratio(
    subdomain: Subdomain, step: float, internal: Matrix | None = None, closing: Matrix | None = None
) -> StepRatio:
    """The step divided by the critical one, as far as it has to be computed.

    `internal` is a tangent of the internal forces, which is added to K, and `closing` what contact
    adds to it where it closes.
    """
    with np.errstate(over="ignore"):
        tangent = combination([(1.0, internal), (1.0, closing)])
        ratio = _ratio_of_matrices(subdomain, step, tangent)
        springs = _limit_of_springs(subdomain)
        if np.isfinite(springs) and step > ratio.value * springs:
            ratio = StepRatio(step / springs if springs > 0.0 else np.inf)
        if ratio.is_bound or not ratio.value > 1.0 + ROUNDING:
            return ratio
        if closing is None and not subdomain.restoring_springs:
            return ratio
        opened = step / limit_of(subdomain, internal, closed=False)
        return replace(ratio, when_closed=opened <= 1.0 + ROUNDING)


def _ratio_of_matrices(subdomain: Subdomain, step: float, internal: Matrix | None) -> StepRatio:
    (a, A), (b, B) = limiting_terms(subdomain, internal)
    if not is_symmetric(B):
        return StepRatio(step / _limit_of_matrices(subdomain, internal, True))
    # the bound takes little time and nearly always suffices
    of_A, of_B = (a * row_sum_bound(A, subdomain.M), b * row_sum_bound(B, subdomain.M))
    with np.errstate(invalid="ignore"):  # a step whose square is 0, and matrices without a bound
        suffices = step * step * of_A + step * of_B <= 1.0 + ROUNDING
    if suffices:
        return StepRatio(0.5 * step * (of_B + np.sqrt(of_B**2 + 4.0 * of_A)), is_bound=True)
    critical = _limit_of_matrices(subdomain, internal, True)
    return StepRatio(step / critical if critical > 0.0 else np.inf)


def present_ratio(
    subdomain: Subdomain,
    internal: InternalForces,
    step: float,
    t: float,
    state: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> StepRatio:
    """The step divided by the critical one for the tangents of internal forces in a state: u, v, q
    and what springs remember, in the user's order of dofs."""
    u, v, q, remembered = state
    return step_ratio(subdomain, step, present_tangent(subdomain, internal, t, u, v, q, remembered))


def row_sum_bound(A: Matrix | None, M: Matrix | None) -> float:
    """An upper bound of the eigenvalues of A with respect to M, by row sums of |M^-1 A|; inf if M
    is not diagonal."""
    if A is None:
        return 0.0
    if M is None or M.ndim != 1 or np.any(M == 0.0):
        return np.inf
    size = absolute(A)
    rows = size if A.ndim == 1 else size @ np.ones(A.shape[0])
    return float(np.max(rows / M))


def _largest_modulus(A: Matrix, M: Matrix) -> float:
    """The largest modulus of an eigenvalue of A x = mu M x of an unsymmetric A; M definite."""
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, splu

    n = A.shape[0]
    if _is_cheap(A, M):
        with one_thread():
            return float(np.max(np.abs(scipy.linalg.eigvals(dense(A), dense(M)))))
    start = np.cos(np.arange(n))
    solve = (lambda x: x / M) if M.ndim == 1 else splu(sp.csc_array(M)).solve
    step = LinearOperator((n, n), matvec=lambda x: solve(A @ x), dtype=float)
    try:
        values = eigs(step, 1, which="LM", tol=LANCZOS_TOLERANCE, v0=start)[0]
    except ArpackNoConvergence as error:
        values = error.eigenvalues
    return float(np.max(np.abs(values), initial=0.0))


def largest_eigenvalue(A: Matrix, M: Matrix) -> tuple[float, np.ndarray]:
    """The largest eigenvalue of A x = mu M x, not below zero, and a vector x; M definite."""
    n = A.shape[0]
    if A.ndim == 1 and M.ndim == 1:
        i = int(np.argmax(A / M))
        return max(float(A[i] / M[i]), 0.0), np.eye(1, n, i)[0]
    if _is_cheap(A, M):
        try:
            values, x = largest_pairs(A, M, 1)
        except np.linalg.LinAlgError:  # a mass so small that the eigenvalue is out of range
            return np.inf, np.ones(n)
        return max(float(values[0]), 0.0), x[:, 0]
    return _lanczos(A, M)


def _is_cheap(A: Matrix, M: Matrix) -> bool:
    """Whether the eigenvalues are those of diagonal or dense matrices, exact up to rounding."""
    diagonal = A.ndim == 1 and M.ndim == 1
    return diagonal or M.shape[0] <= SMALL or not all(sp.issparse(X) or X.ndim == 1 for X in (A, M))


def _lanczos(A: Matrix, M: Matrix) -> tuple[float, np.ndarray]:
    # M^-1/2 A M^-1/2 for a diagonal M: no factor, and symmetric
    from scipy.sparse.linalg import ArpackNoConvergence, eigsh

    n = A.shape[0]
    start = np.cos(np.arange(n))  # the same start in every run
    options = dict(k=1, which="LA", tol=LANCZOS_TOLERANCE, v0=start)
    root = 1.0 / np.sqrt(M) if M.ndim == 1 else np.ones(n)
    try:
        if M.ndim == 1:
            scale = sp.diags_array(root)
            matrix = sp.diags_array(A) if A.ndim == 1 else A
            values, x = eigsh(sp.csr_array(scale @ matrix @ scale), **options)
        else:
            matrix = sp.diags_array(A) if A.ndim == 1 else A
            values, x = eigsh(sp.csc_array(matrix), M=sp.csc_array(M), **options)
    except ArpackNoConvergence as error:
        values, x = error.eigenvalues, error.eigenvectors
    if values.size == 0:
        return 0.0, start
    return float(max(values[0], 0.0)), root * x[:, 0]
