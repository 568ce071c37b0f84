"""The matrices of an absorbing layer, equations (V3) and (V4) of docs/method/loads.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..meshes.kinds import SHAPES
from .elasticity import RULES, Moduli, gradients, of_elements
from .layer_sides import Side

__all__ = ["matrices", "stretch_of"]

# The stretch grows with this power of the depth, (V4).
POWER = 2
# Unknowns of an element beside displacements: xx, yy, xy at four points of quadrature.
STRESSES = 12
Entries = tuple[np.ndarray, np.ndarray, np.ndarray]  # values, rows, columns


def stretch_of(
    structure: Any, sides: Sequence[Side], count: int, reflection: float, across: float
) -> Callable[[np.ndarray], np.ndarray]:
    """beta_x, beta_y at points (..., 2), (V4)."""
    lam, mu, density = structure.moduli["quad"][:3]
    speed = np.sqrt((lam + 2.0 * mu) / density)
    thickness = [count * side.size for side in sides]
    largest = [
        (POWER + 1) * of_elements(speed, side.owners).max() / (2.0 * L) * np.log(1.0 / reflection)
        for side, L in zip(sides, thickness, strict=True)
    ]

    def beta(points: np.ndarray) -> np.ndarray:
        result = np.zeros(points.shape)
        for side, L, b in zip(sides, thickness, largest, strict=True):
            depth = side.outward * (points[..., side.axis] - side.at)
            profile = b * np.maximum(depth / L, 0.0) ** POWER
            result[..., side.axis] += profile
            result[..., 1 - side.axis] += across * profile
        return result

    return beta


def matrices(
    points: np.ndarray,
    quads: np.ndarray,
    moduli: Moduli,
    stretch: Callable[[np.ndarray], np.ndarray],
    lumped: bool,
) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array]:
    """M, C, K of (V3): nodes first, then xx, yy, xy at the points of each element."""
    E, corners = len(quads), points[quads]
    volumes, along = gradients("quad", corners)  # (E, q), (2, E, q, a)
    N = SHAPES["quad"].values(RULES["quad"][0].points)
    lam, mu, rho, t = (np.broadcast_to(x, (E,)) for x in moduli[:4])
    w = volumes * t[:, None]
    Z = np.sqrt(rho * (lam + 2.0 * mu))
    at_nodes, at_points = stretch(corners), stretch(np.einsum("qa,eai->eqi", N, corners))
    nodal = (rho[:, None] * w) @ N
    D = np.zeros((E, 3, 3))
    D[:, 0, 0] = D[:, 1, 1] = lam + 2.0 * mu
    D[:, 0, 1] = D[:, 1, 0] = lam
    D[:, 2, 2] = mu
    flexibility = w[:, :, None, None] * ((Z**2)[:, None, None] * np.linalg.inv(D))[:, None]
    # derivatives scaled by Lam_p: d/dx by beta_y, d/dy by beta_x
    scaled = np.stack([along[0] * at_points[:, :, 1, None], along[1] * at_points[:, :, 0, None]])
    dofs = (2 * quads[:, :, None] + np.arange(2)).reshape(E, 8)
    stress = 2 * len(points) + np.arange(E * STRESSES).reshape(E, 4, 3)
    n = 2 * len(points) + E * STRESSES
    on_stress = stress[:, :, :, None], stress[:, :, None, :]

    def of_coefficients(at_nodes: np.ndarray, at_points: np.ndarray) -> list[Entries]:
        """rho w b, lumped: each node has its own stretch, as each point of the stress."""
        blocks = at_points[:, :, None, None] * flexibility
        return [(np.repeat(nodal * at_nodes, 2, axis=1), dofs, dofs), (blocks, *on_stress)]

    def of_slopes(g: np.ndarray) -> list[Entries]:
        """Z w B and its negative transpose."""
        B = np.zeros((E, 4, 3, 4, 2))
        B[:, :, 0, :, 0] = B[:, :, 2, :, 1] = g[0]
        B[:, :, 1, :, 1] = B[:, :, 2, :, 0] = g[1]
        B = (Z[:, None] * w)[:, :, None, None] * B.reshape(E, 4, 3, 8)
        of_u = dofs[:, None, None, :]
        return [(-B, stress[:, :, :, None], of_u), (B, of_u, stress[:, :, :, None])]

    mass = of_coefficients(np.ones((E, 4)), np.ones((E, 4)))
    if not lumped:
        consistent = np.einsum("eq,qa,qb,ij->eaibj", rho[:, None] * w, N, N, np.eye(2))
        mass[0] = (consistent.reshape(E, 8, 8), dofs[:, :, None], dofs[:, None, :])
    C = of_coefficients(at_nodes.sum(axis=2), at_points.sum(axis=2)) + of_slopes(along)
    K = of_coefficients(at_nodes.prod(axis=2), at_points.prod(axis=2)) + of_slopes(scaled)
    return _assembled(mass, n), _assembled(C, n), _assembled(K, n)


def _assembled(parts: list[Entries], n: int) -> sp.csr_array:
    """The sum of entries, each with its rows and columns; zeros are left out."""
    full = [np.broadcast_arrays(*part) for part in parts]
    values, rows, columns = (np.concatenate([x[i].ravel() for x in full]) for i in range(3))
    A = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(n, n)))
    A.eliminate_zeros()
    return A
