"""Static equilibrium of tied subdomains: K_i u_i = F_i + L_i^T Lam, sum_i L_i u_i = 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..errors import FactorizationError
from ..problem.matrices import Matrix
from ..problem.positive import FLOATING, scale_to_one, softest
from ..problem.tangents import SYMMETRY


def static_displacements(
    stiffnesses: Sequence[Matrix],
    constraints: Sequence[sp.csr_array],
    forces: Sequence[np.ndarray],
) -> list[np.ndarray]:
    """The displacements u_i, (n_i,) each.

    Parameters
    ----------
    stiffnesses : sequence of (n_i, n_i) matrices in inner form
    constraints : sequence of (p, n_i) csr_array
        L_i, with independent rows.
    forces : sequence of (n_i,) arrays

    Raises
    ------
    FactorizationError
        When the structure is floating or its stiffness indefinite.
    """
    from scipy.sparse.linalg import splu

    sizes = [f.size for f in forces]
    K = sp.csc_array(sp.block_diag([sparse(A, n) for A, n in zip(stiffnesses, sizes)]))
    L = sp.csr_array(sp.hstack(constraints))
    scale, K, L = _scaled(K, L)
    _require_stiff(K, L)
    p = L.shape[0]
    saddle = sp.csc_array(sp.block_array([[K, -L.T], [L, None]])) if p else K
    right = np.concatenate([scale @ np.concatenate(forces), np.zeros(p)])
    u = scale @ splu(saddle).solve(right)[: sum(sizes)]
    return np.split(u, np.cumsum(sizes)[:-1])


def _smallest_image(G: sp.csc_array) -> float:
    """The smallest ``|G x|`` for vectors x of length 1, approximately."""
    from scipy.sparse.linalg import splu

    try:
        lu = splu(G)
    except RuntimeError:  # exactly singular
        return 0.0
    x = np.cos(np.arange(G.shape[0]))
    for _ in range(4):
        x = lu.solve(lu.solve(x / np.linalg.norm(x), "T"))
        if not np.all(np.isfinite(x)):
            return 0.0
    return float(np.linalg.norm(G @ x) / np.linalg.norm(x))


def _scaled(K: sp.csc_array, L: sp.csr_array) -> tuple[sp.dia_array, sp.csc_array, sp.csr_array]:
    scale = scale_to_one(K)
    return scale, sp.csc_array(scale @ K @ scale), sp.csr_array(L @ scale)


def sparse(A: Matrix | None, n: int) -> sp.csc_array:
    if A is None:
        return sp.csc_array((n, n))
    return sp.csc_array(sp.diags_array(A) if A.ndim == 1 else A)


def require_stiff(K: sp.csc_array, L: sp.csr_array) -> None:
    """FactorizationError unless K is definite, or regular if unsymmetric, where L u = 0."""
    _require_stiff(*_scaled(K, L)[1:])


def _require_stiff(K: sp.csc_array, L: sp.csr_array) -> None:
    """FactorizationError unless K is positive definite on the motions that the ties allow.

    With the ties replaced by stiff springs, G = K + L^T L has to be positive definite. Inverse
    iteration finds the softest motion; the stiffness of a mechanism is rounding. An unsymmetric G
    only has to be regular.
    """
    G = sp.csc_array(K + L.T @ L)
    symmetric = abs(G - G.T).max() <= SYMMETRY * abs(G).max()
    if (softest(G) if symmetric else _smallest_image(G)) <= FLOATING:
        raise FactorizationError(
            "the structure is floating or its stiffness indefinite, so that it has no static "
            "equilibrium; support it by stiffness or by a constraint on one subdomain only"
        )
