"""The damping matrix of a subdomain, as given and proportional to its mass and stiffness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._checks import plain_array, positive_number, real_number
from ..errors import PerformanceWarning, warn
from .matrices import Matrix, canonical, combination, dense, read_only
from .springs import assembled, core_springs, stiffness
from .tangents import first_tangent, histories

# Rounding of c_m M + c_k K, relative to its largest entry.
ROUNDING = 1e-12

REMEDY = (
    "NumPy adds a 1-D M to every row of K: take rayleigh=(c_m, c_k), or a sparse diagonal M, "
    "scipy.sparse.diags_array(M)"
)


def damping_matrix(
    C: Any,
    rayleigh: tuple[float, float] | None,
    n: int,
    *,
    M: Matrix,
    K: Matrix,
    K_argument: Any,
    symmetric: bool = True,
) -> Matrix:
    """C + c_m M + c_k K in inner form.

    K: with the tangents at u0.
    K_argument: K as given by the user.
    """
    if C is not None and not sp.issparse(C):
        _refuse_broadcast(plain_array(C, "C"), M, K, symmetric)
    damping = None if C is None else canonical(C, "C", n, symmetric=symmetric)[0]
    if damping is not None and damping.ndim == 2 and not sp.issparse(damping):
        _warn_of_dense(damping, K_argument)
    if rayleigh is None:
        return damping
    c_m, c_k = rayleigh
    with np.errstate(over="ignore", invalid="ignore"):
        total = combination([(1.0, damping), (c_m, M), (c_k, K)])
    if total is not None and not np.isfinite(total.data if sp.issparse(total) else total).all():
        raise ValueError(f"rayleigh must give a finite c_m M + c_k K, got {rayleigh!r}")
    return read_only(total)


def stiffness_at_start(s: Any) -> Matrix | None:
    """K and the tangents at u0 of internal forces and springs; of functions among the restoring
    forces the estimate that was given."""
    terms: list[tuple[float, Matrix | None]] = [(1.0, s.K)]
    springs = s.springs
    if springs:
        _, slopes, _ = _core.follow_springs(core_springs(springs, np.arange(s.n)), s.u0, None)
        ends = np.cumsum([len(spring) for spring in springs])
        tangents = assembled(springs, np.split(slopes, ends[:-1]), s.n)
        terms.append((1.0, canonical(tangents, "springs", s.n)[0]))
    if s.has_functions and s.restoring_stiffness is not None:
        of_springs = canonical(stiffness(springs, "initial_tangent", s.n), "springs", s.n)[0]
        terms += [(1.0, s.restoring_stiffness), (-1.0, of_springs)]
    if s.internal is not None and s.internal.forces:
        forces, q0 = s.internal.forces, histories(s.internal.forces)[0]
        motion, labels = (s.u0, s.v0), s.internal.labels
        name = "subdomain" if s.name is None else s.name
        pattern, values, _ = first_tangent(
            forces, s.n, *motion, q0, name, labels, symmetric=s.symmetric
        )
        A = sp.csr_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)
        terms.append((1.0, canonical(A, "K_t of internal", s.n, symmetric=s.symmetric)[0]))
    return combination(terms)


def checked_rayleigh(rayleigh: Any, damping_ratio: Any = None) -> tuple[float, float] | None:
    """(c_m, c_k), both finite and at least 0; given as such or by ratios at two periods."""
    if damping_ratio is not None:
        if rayleigh is not None:
            raise TypeError("rayleigh must not be given with damping_ratio, which determines it")
        return _of_ratios(damping_ratio)
    if rayleigh is None:
        return None
    try:
        c_m, c_k = rayleigh
    except (TypeError, ValueError):
        raise TypeError(f"rayleigh must be a pair (c_m, c_k), got {rayleigh!r}") from None
    return real_number(c_m, "rayleigh[0]", low=0.0), real_number(c_k, "rayleigh[1]", low=0.0)


def _of_ratios(argument: Any) -> tuple[float, float]:
    """c_m and c_k with these damping ratios at two periods."""
    if not isinstance(argument, Mapping) or len(argument) != 2:
        raise TypeError(
            "damping_ratio must be a dict of two periods with their damping ratios, such as "
            f"{{1.2: 0.05, 0.1: 0.05}}, got {argument!r}"
        )
    periods = np.array([positive_number(T, "damping_ratio: a period") for T in argument])
    ratios = [real_number(x, "damping_ratio: a ratio", low=0.0) for x in argument.values()]
    coefficients = rayleigh_coefficients(2.0 * np.pi / periods, ratios, "damping_ratio")
    if min(coefficients) < 0.0:
        raise ValueError(
            "damping_ratio must have ratios that c_m M + c_k K gives with c_m, c_k >= 0, got "
            f"{argument!r}: c_m = {coefficients[0]:g}, c_k = {coefficients[1]:g}"
        )
    return coefficients


def rayleigh_coefficients(
    omegas: Sequence[float] | np.ndarray, ratios: Sequence[float], name: str
) -> tuple[float, float]:
    """c_m and c_k with these damping ratios at two angular frequencies."""
    if not max(ratios) < 1.0:
        raise ValueError(
            f"{name} must be below 1, as fractions of critical damping (5 per cent is 0.05), got "
            f"{max(ratios)!r}"
        )
    # ratio = c_m / (2 omega) + c_k omega / 2
    rows = [[0.5 / omega, 0.5 * omega] for omega in omegas]
    c_m, c_k = np.linalg.solve(rows, ratios)
    return float(c_m), float(c_k)


@np.errstate(over="ignore", invalid="ignore")  # what overflows is no such C
def _refuse_broadcast(C: np.ndarray, M: Matrix | None, K: Matrix | None, symmetric: bool) -> None:
    """ValueError for C = c_m 1 m^T + c_k K, which NumPy makes of c_m * m + c_k * K, m 1-D.

    Of unequal masses m the skew part of C is c_m (1 m^T - m 1^T). Of equal masses C - c_k K has
    one value at all places, off the diagonal as well. Where C may be unsymmetric, m has to be M.
    """
    size = None if C.ndim != 2 or C.dtype.kind not in "iuf" else C.shape[0]
    if size is None or C.shape != (size, size) or size < 2 or not np.all(np.isfinite(C)):
        return
    C = np.asarray(C, dtype=np.float64)
    limit = ROUNDING * np.max(np.abs(C))
    first = C[0] - C[:, 0]  # c_m (m_j - m_0) where M was added to every row
    if np.max(np.abs(first)) > limit:
        if not (symmetric or _is_multiple(first, M)):
            return
        if size > 2 and np.max(np.abs(C - C.T - first + first[:, None])) <= limit:
            raise ValueError(
                "C must be symmetric, got one that differs from its transpose as c_m * M + c_k * K "
                f"does for an M that is 1-D; {REMEDY}"
            )
        return
    if K is None or K.shape[0] != size or M is not None and M.ndim == 2:
        return
    c_m = _constant_beside(C, dense(K), limit)
    if c_m is not None:
        raise ValueError(
            f"C must not be c_k * K with the same number added to every entry, got {c_m:g} added; "
            f"{REMEDY}"
        )


def _is_multiple(first: np.ndarray, M: Matrix | None) -> bool:
    """Whether first = c_m (m - m_0) with the masses m of a 1-D M."""
    if M is None or M.ndim != 1 or M.size != first.size:
        return False
    m = M - M[0]
    return bool(
        np.max(np.abs(first * (m @ m) - m * (m @ first)))
        <= ROUNDING * abs(m @ m) * np.max(np.abs(first))
    )


def _constant_beside(C: np.ndarray, K: np.ndarray, limit: float) -> float | None:
    """a of C = a 1 1^T + b K, a != 0; None if there is none, or if K leaves a choice."""
    low, high = K.min(), K.max()
    if not np.any((K != low) & (K != high)):  # two unknowns would fit any C of this pattern
        return None
    i, j = (np.unravel_index(at, K.shape) for at in (K.argmin(), K.argmax()))
    b = (C[j] - C[i]) / (high - low)
    a = C[i] - b * low
    if not np.abs(a) > 100.0 * limit or np.max(np.abs(C - a - b * K)) > limit:
        return None
    return float(a)


def _warn_of_dense(C: np.ndarray, K: Any) -> None:
    if K is None or not (sp.issparse(K) or np.ndim(K) == 1):
        return
    kind = "sparse" if sp.issparse(K) else "diagonal"
    n = len(C)
    warn(
        f"C is dense and K is {kind}: each step then reads all {n} x {n} entries, and where C "
        "was meant to have the pattern of M and K it is wrong. For C = c_m M + c_k K take "
        "rayleigh=(c_m, c_k); a C that is meant to be full can be given as scipy.sparse.csr_array",
        PerformanceWarning,
    )
