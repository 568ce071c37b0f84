"""The critical step of an explicit or conditionally stable subdomain."""

from __future__ import annotations

import warnings
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse.linalg import ArpackNoConvergence, eigsh

from .errors import StabilityWarning
from .matrices import dense
from .schemes import Scheme
from .subdomain import Subdomain

# Below this size the eigenvalues of the dense matrices are cheaper than Lanczos.
SMALL = 200
# Lanczos approaches the highest frequency from below; this closes the gap of its tolerance.
LANCZOS_TOLERANCE, MARGIN = 1e-4, 1e-3
# A step is above the critical one when it is so by more than rounding of eigenvalues.
ROUNDING = 1e-9


@lru_cache(maxsize=256)
def critical_product(scheme: Scheme) -> float:
    """Largest stable Omega = omega h of an undamped oscillator; inf if there is none.

    Viscous damping, which all schemes take implicitly, does not lower it.
    """
    grid = np.geomspace(1e-2, 1e4, 600)
    unstable = [Omega for Omega in grid if not _is_stable(scheme, Omega)]
    if not unstable:
        return np.inf
    high = unstable[0]
    low = high / (grid[1] / grid[0])
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _is_stable(scheme, middle) else (low, middle)
    return low


def _is_stable(scheme: Scheme, Omega: float) -> bool:
    # 1e-7: a double eigenvalue of modulus one comes out of an eigenvalue routine at
    # the square root of the rounding
    radius = np.max(np.abs(np.linalg.eigvals(scheme.amplification(Omega))))
    return bool(radius <= 1.0 + 1e-7)


def critical_step(subdomain: Subdomain) -> float:
    """The longest stable step of a subdomain by itself, equation (C1).

    It limits the own step h = dt / substeps. A subdomain that takes double steps moves by 2 h: its
    own step must not exceed half of this.

    Parameters
    ----------
    subdomain : Subdomain
        With its interface free: ties do not raise the limit.

    Returns
    -------
    float
        In the unit of time of the matrices; inf where every step is stable. From a few hundred
        sparse dofs on, up to 0.1 per cent too small rather than too large.

    Notes
    -----
    The largest stable omega h of the scheme, divided by the highest circular frequency of
    K x = omega^2 M x. Damping is left out; being taken implicitly, it does not lower the limit.

    Examples
    --------
    >>> from pmalpha import analysis
    >>> rig = Subdomain([1.0], [4.0], scheme=CentralDifference())
    >>> round(analysis.critical_step(rig), 6)
    1.0
    >>> analysis.critical_step(Subdomain([1.0], [4.0], scheme=Newmark()))
    inf
    """
    if not isinstance(subdomain, Subdomain):
        raise TypeError(f"subdomain must be a Subdomain, got {subdomain!r}")
    limit = critical_product(subdomain.scheme)
    if np.isinf(limit) or subdomain.K is None:
        return np.inf
    omega = highest_frequency(subdomain)
    return float(limit / omega) if omega > 0.0 else np.inf


def warn_if_above_critical(subdomain: Subdomain, step: float, label: str) -> None:
    """StabilityWarning when a step of this length is above the critical one."""
    limit = critical_product(subdomain.scheme)
    if np.isinf(limit) or subdomain.K is None:
        return
    # the bound is cheap and nearly always enough
    if row_sum_bound(subdomain) <= limit / step * (1.0 + ROUNDING):
        return
    critical = critical_step(subdomain)
    if step <= critical * (1.0 + ROUNDING):
        return
    damping = "" if subdomain.C is None else " (damping, which may raise it, is left out)"
    warnings.warn(
        f"the step {step:g} of subdomain {label!r} is above its critical step "
        f"{critical:.6g}{damping}: the run will grow without bound; take smaller steps",
        StabilityWarning,
        stacklevel=3,
    )


def row_sum_bound(subdomain: Subdomain) -> float:
    """An upper bound of the highest frequency, by row sums of |M^-1 K|; inf if M is no diagonal."""
    M, K = subdomain.M, subdomain.K
    if M is None or M.ndim != 1 or np.any(M == 0.0):
        return np.inf
    rows = np.abs(K) if K.ndim == 1 else np.asarray(abs(K).sum(axis=1)).ravel()
    return float(np.sqrt(np.max(rows / M)))


def highest_frequency(subdomain: Subdomain) -> float:
    """Circular frequency of the highest mode; inf when a dof with stiffness has no mass."""
    M, K, n = subdomain.M, subdomain.K, subdomain.n
    if M is None or subdomain.massless.size:
        return np.inf
    if K.ndim == 1 and M.ndim == 1:
        return float(np.sqrt(max(np.max(K / M), 0.0)))
    if n <= SMALL or not all(sp.issparse(A) or A.ndim == 1 for A in (M, K)):
        values = eigh(dense(K), dense(M), eigvals_only=True, subset_by_index=[n - 1, n - 1])
        return float(np.sqrt(max(values[0], 0.0)))
    return _lanczos(M, K) * (1.0 + MARGIN)


def _lanczos(M, K) -> float:
    # M^-1/2 K M^-1/2 for a diagonal M: no factor, and symmetric
    start = np.cos(np.arange(K.shape[0]))  # the same every time
    options = dict(k=1, which="LA", tol=LANCZOS_TOLERANCE, return_eigenvectors=False, v0=start)
    try:
        if M.ndim == 1:
            root = sp.diags_array(1.0 / np.sqrt(M))
            A = root @ K @ root
            value = eigsh(sp.csr_array(A), **options)
        else:
            stiffness = sp.diags_array(K) if K.ndim == 1 else K
            value = eigsh(sp.csc_array(stiffness), M=sp.csc_array(M), **options)
    except ArpackNoConvergence as error:
        value = error.eigenvalues
    return float(np.sqrt(max(np.max(value, initial=0.0), 0.0)))
