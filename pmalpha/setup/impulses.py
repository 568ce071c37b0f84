"""What impulses meet in a subdomain, equation (U4)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import Matrix, combination, diagonal, sparse
from .link import Link

# Parts of the entries of C that are rounding of a0 M + a1 K.
ROUNDING = 1e-12


def struck(part: Any) -> tuple[Any, ...] | None:
    """What impulses meet in a subdomain, for the core: equation (U4)."""
    if part.N is None:
        return None
    s, begin = part.subdomain, part.n - part.nb
    reached = np.diff(part.N.ptr)[begin:] > 0
    inverse = np.zeros(part.nb)
    inverse[reached] = 1.0 / diagonal(part.M)[begin:][reached]
    al1, al2 = s.scheme.coefficients(part.h)
    rates = _rates(part, np.flatnonzero(reached) + begin)
    if rates is not None and not s.scheme.explicit:
        a0, a1 = rates
        alpha = (a1 + 0.5 * part.h) / (al1 + al2 * a1)
        return inverse, alpha, a0 - alpha * (1.0 + al2 * a0), None
    stiffness = combination([(1.0, part.K), (1.0, part.K_r)])
    B = combination([(1.0, part.damping), (0.5 * part.h, stiffness)])
    return inverse, 0.0, 0.0, Link.of(_columns(B, part.n)).core(begin)


def _columns(A: Matrix | None, n: int) -> sp.csc_array:
    result = sp.csc_array(sparse(A, n))
    result.sort_indices()
    return result


def _rates(part: Any, dofs: np.ndarray) -> tuple[float, float] | None:
    """(a0, a1) of Mbar = M + al2 C + al1 K with C = a0 M + a1 K, where K and C act as such on
    impulses at these dofs; None elsewhere, and for restoring forces, whose balance reads w."""
    s = part.subdomain
    if s.restoring is not None or s.has_feedback:
        return None
    if part.damping is None or not abs(_columns(part.damping, part.n)[:, dofs]).sum():
        return 0.0, 0.0
    if s.rayleigh is None or s.K is None:
        return None
    a0, a1 = s.rayleigh
    proportional = combination([(a0, s.M), (a1, s.K)])
    rest = combination([(1.0, s.C), (-1.0, proportional)])
    size = abs(_columns(s.C, part.n)).max()
    if rest is None or abs(_columns(rest, part.n)).max() <= ROUNDING * size:
        return float(a0), float(a1)
    return None
