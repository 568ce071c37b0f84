"""Linear bars of two or three nodes, and matrices on nodes that have further dofs."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..problem.shapes import SHAPES
from .elasticity import lumped_shares
from .pattern import Pattern, lumped_mass
from .quadrature import RULES, Rule


def bar_matrices(
    kind: str,
    lines: np.ndarray,
    corners: np.ndarray,
    EA: np.ndarray,
    rhoA: np.ndarray,
    nodes: int,
    lumped: bool,
) -> tuple[Any, sp.csr_array]:
    """M, or its diagonal if lumped, and K; corners (E, a, d) are the coordinates of the nodes."""
    shape, (stiff, heavy) = SHAPES[kind], RULES[kind]
    d = corners.shape[2]
    pattern = Pattern.of(lines, nodes)
    _, weights = _along(kind, corners, heavy)
    weights = weights * rhoA[:, None]
    N = shape.values(heavy.points)
    if lumped:
        M = np.repeat(lumped_mass(lines, lumped_shares(kind, N, weights), nodes), d)
    else:
        scalar = pattern.matrix(np.einsum("eq,qa,qb->eab", weights, N, N))
        M = sp.csr_array(sp.kron(scalar, sp.eye_array(d), format="csr"))
    B, lengths = _along(kind, corners, stiff)
    return M, pattern.matrix(np.einsum("e,eq,eqai,eqbj->eaibj", EA, lengths, B, B, optimize=True))


def _along(kind: str, corners: np.ndarray, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Strains (E, q, a, d) of unit displacements of the nodes, and lengths (E, q) of the points.

    With x' = dx / dxi the strain is x' . u' / |x'|^2.
    """
    slopes = SHAPES[kind].slopes(rule.points)[:, :, 0]
    tangent = np.einsum("qa,eai->eqi", slopes, corners)
    square = np.sum(tangent**2, axis=2)
    B = slopes[None, :, :, None] * (tangent / square[:, :, None])[:, :, None, :]
    return B, rule.weights * np.sqrt(square)


def embedded(A: Any, old: int, new: int) -> Any:
    """A matrix, or its diagonal, on nodes with more dofs, the first `old` of which it has."""
    if old == new:
        return A
    nodes = A.shape[0] // old
    dofs = (new * np.arange(nodes)[:, None] + np.arange(old)).ravel()
    if A.ndim == 1:
        whole = np.zeros(new * nodes)
        whole[dofs] = A
        return whole
    A = sp.csr_array(A)
    counts = np.zeros(new * nodes, dtype=A.indptr.dtype)
    counts[dofs] = np.diff(A.indptr)
    start = np.concatenate([[0], np.cumsum(counts)])
    return sp.csr_array((A.data, dofs[A.indices], start), shape=(new * nodes, new * nodes))
