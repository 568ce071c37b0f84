"""J2 plasticity at small strain: radial return with its consistent tangent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .checked import isotropic, not_negative, positive
from .materials import Material, component_pairs

__all__ = ["J2Plasticity"]


@dataclass(frozen=True, eq=False)
class J2Plasticity(Material):
    """Von Mises plasticity at small strain with linear isotropic and kinematic hardening.

    With xi = dev(sigma) - 2/3 H_k eps_p, the stress obeys
    ``|xi| <= sqrt(2/3) (sigma_y + H_i alpha)``, where alpha is the accumulated plastic strain. Over
    a step the stress returns radially, and the tangent is the derivative of that (Simo and Hughes,
    Computational Inelasticity, box 3.2). In uniaxial stress the slope beyond the yield stress is
    E H / (E + H), H = H_i + H_k. Strains are those of the undeformed mesh: for small rotations.

    The history at each Gauss point, after one another by element and Gauss point, is the plastic
    strain (xx, yy, zz, xy in plane strain; xx, yy, zz, yz, xz, xy in three dimensions; tensor
    components, not twice them), then alpha.

    Parameters
    ----------
    E, nu : float or (elements,) array_like
        Young's modulus, above 0; Poisson's ratio in (-1, 0.5).
    yield_stress : float or (elements,) array_like
        Of uniaxial stress, sigma_y, above 0.
    isotropic, kinematic : float or (elements,) array_like, default 0
        Hardening moduli H_i and H_k, at least 0.

    Examples
    --------
    >>> from pmalpha import structures
    >>> steel = structures.J2Plasticity(210e9, 0.3, yield_stress=235e6, isotropic=2e9)
    >>> block = structures.nonlinear_solid(2, 1, 1, 0.1, steel, rho=7850.0)
    >>> block.internal[0].history.size  # 2 elements, 8 Gauss points, 7 numbers
    112
    """

    E: ArrayLike
    nu: ArrayLike
    yield_stress: ArrayLike
    isotropic: ArrayLike = 0.0
    kinematic: ArrayLike = 0.0

    def _variables(self, d: int) -> int:
        return 5 if d == 2 else 7

    def _coefficients(self, elements: int, plane: str) -> tuple[np.ndarray, ...]:
        if plane == "stress":
            raise ValueError("plane must be 'strain' for J2Plasticity, got 'stress'")
        shape = (elements,)
        return (
            *isotropic(self.E, self.nu, shape),
            positive(self.yield_stress, "yield_stress", shape),
            not_negative(self.isotropic, "isotropic", shape),
            not_negative(self.kinematic, "kinematic", shape),
        )

    def _evaluate(
        self, coefficients: Sequence[Any], H: np.ndarray, before: np.ndarray, out: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        lam, mu, strength, isotropic_modulus, kinematic_modulus = coefficients
        d = len(H)
        positions = POSITIONS[d]
        plastic, alpha = before[:-1], before[-1]
        pressure = (lam + 2.0 / 3.0 * mu) * sum(H[i, i] for i in range(d))
        # trial: xi = 2 mu (dev eps - eps_p) - 2/3 H_k eps_p
        xi = -(2.0 * mu + 2.0 / 3.0 * kinematic_modulus) * plastic
        deviator = _deviator(H, positions)
        xi += 2.0 * mu * deviator
        size = np.sqrt(sum(w * x * x for w, x in zip(WEIGHTS[d], xi)))
        excess = size - np.sqrt(2.0 / 3.0) * (strength + isotropic_modulus * alpha)
        hardening = 2.0 / 3.0 * (isotropic_modulus + kinematic_modulus)
        multiplier = np.maximum(excess, 0.0) / (2.0 * mu + hardening)
        n = xi / np.where(size > 0.0, size, 1.0)
        after = np.concatenate(
            [plastic + multiplier * n, (alpha + np.sqrt(2.0 / 3.0) * multiplier)[None]]
        )
        stress = 2.0 * mu * (deviator - after[:-1])
        P = np.empty_like(H)
        for (i, j), k in positions.items():
            if i < d and j < d:
                P[i, j] = P[j, i] = stress[k] + (pressure if i == j else 0.0)
        if out is not None:
            # theta = 1 - 2 mu g / |xi|, theta_bar = 1 / (1 + (H_i + H_k) / (3 mu)) - (1 - theta)
            yields = excess > 0.0
            lost = np.where(yields, 2.0 * mu * multiplier / np.where(yields, size, 1.0), 0.0)
            along = np.where(yields, 2.0 * mu / (2.0 * mu + hardening) - lost, 0.0)
            shear = mu * (1.0 - lost)
            _moduli(lam + 2.0 / 3.0 * (mu - shear), shear, 2.0 * mu * along, n, positions, out)
        return P, after


# Numbers of the components of a symmetric tensor, and how often each is in the full tensor.
POSITIONS = {
    2: {(0, 0): 0, (1, 1): 1, (2, 2): 2, (0, 1): 3},
    3: {(0, 0): 0, (1, 1): 1, (2, 2): 2, (1, 2): 3, (0, 2): 4, (0, 1): 5},
}
WEIGHTS = {2: (1.0, 1.0, 1.0, 2.0), 3: (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)}


def _deviator(H: np.ndarray, positions: dict[tuple[int, int], int]) -> np.ndarray:
    """The deviator of the strain, which has no component zz in plane strain."""
    d = len(H)
    mean = sum(H[i, i] for i in range(d)) / 3.0
    out = np.empty((len(positions), H.shape[2]))
    for (i, j), k in positions.items():
        inside = i < d and j < d
        out[k] = (0.5 * (H[i, j] + H[j, i]) if inside else 0.0) - (mean if i == j else 0.0)
    return out


def _moduli(
    lam: Any, mu: Any, along: np.ndarray, n: np.ndarray, positions: Any, out: np.ndarray
) -> None:
    """D_iJjL = lam d_iJ d_jL + mu (d_ij d_JL + d_iL d_Jj) - along n_iJ n_jL, for i <= j."""
    d = out.shape[1]

    def direction(i: int, j: int) -> np.ndarray:
        result: np.ndarray = n[positions[min(i, j), max(i, j)]]
        return result

    for k, (i, j) in enumerate(component_pairs(d)):
        for J, L in np.ndindex(d, d):
            value = -along * direction(i, J) * direction(j, L)
            if i == J and j == L:
                value += lam
            if i == j and J == L:
                value += mu
            if i == L and J == j:
                value += mu
            out[:, J, k, L] = value
