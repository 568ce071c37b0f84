"""Hyperelastic materials: stress and its derivative at many points at once.

Arrays at the Gauss points have the points last: (d, d, m). With H the gradient of the displacement,
F = 1 + H, a material returns the stress P = dW/dF (first Piola-Kirchhoff) and, where a tangent is
wanted, A_iJjL = dP_iJ / dF_jL, which is written for i <= j to out[:, J, k, L], k the number of the
pair (i, j).

J2 plasticity at small strain: radial return with its consistent tangent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .checked import in_plane_stress, isotropic, not_negative, positive
from .elasticity import cofactors_of
from .pattern import upper

__all__ = ["J2Plasticity", "NeoHookean", "StVenantKirchhoff"]

# Numbers of the components of a symmetric tensor, and how often each is in the full tensor.
POSITIONS = {
    2: {(0, 0): 0, (1, 1): 1, (2, 2): 2, (0, 1): 3},
    3: {(0, 0): 0, (1, 1): 1, (2, 2): 2, (1, 2): 3, (0, 2): 4, (0, 1): 5},
}
WEIGHTS = {2: (1.0, 1.0, 1.0, 2.0), 3: (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)}


class Material:
    """What a nonlinear solid needs of its material."""

    # Numbers of history at a Gauss point of a solid in d dimensions.
    def _variables(self, d: int) -> int:
        return 0

    def _coefficients(self, elements: int, plane: str) -> tuple[np.ndarray, ...]:
        """Checked values by element, each (1,) or (elements,), for `_evaluate`."""
        raise NotImplementedError

    def _evaluate(
        self, coefficients: Sequence[Any], H: np.ndarray, before: np.ndarray, out: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The stress (d, d, m) and the history (variables, m) at the end; A is written to out."""
        raise NotImplementedError


class Hyperelastic(Material):
    """A material with an energy density."""

    def _density(self, coefficients: Sequence[Any], H: np.ndarray) -> np.ndarray:
        """W (m,)."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class StVenantKirchhoff(Hyperelastic):
    """The linear law between Green strain and second Piola-Kirchhoff stress.

    :math:`W = lam/2 tr(E)^2 + mu E : E` with the Green strain :math:`E = (F^T F - 1) / 2` and the
    moduli of `solid_on` or, in plane stress, `plate_on` (Bonet and Wood, Nonlinear Continuum
    Mechanics for Finite Element Analysis). For large rotations and small strains; in strong
    compression, below 0.58 of the length in uniaxial strain, it softens.

    Parameters
    ----------
    E, nu : float or (elements,) array_like
        Young's modulus, above 0; Poisson's ratio in (-1, 0.5), 0.5 in plane stress too.

    Examples
    --------
    >>> from pmalpha import structures
    >>> steel = structures.StVenantKirchhoff(210e9, 0.3)
    >>> structures.nonlinear_solid(4, 2, 0.5, steel, rho=7850.0)
    <Structure 15 points, 8 quad, 30 dofs, 1 internal force>
    """

    E: ArrayLike
    nu: ArrayLike

    def _coefficients(self, elements: int, plane: str) -> tuple[np.ndarray, ...]:
        moduli = in_plane_stress if plane == "stress" else isotropic
        return moduli(self.E, self.nu, (elements,))

    def _evaluate(
        self, coefficients: Sequence[Any], H: np.ndarray, before: np.ndarray, out: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        lam, mu = coefficients
        F, S = _deformation(H), _second_stress(coefficients, H)
        P = product(F, S)
        if out is not None:
            d = len(F)
            # A_iJjL = lam F_iJ F_jL + mu ((F F^T)_ij delta_JL + F_iL F_jJ) + delta_ij S_JL
            for k, (i, j) in enumerate(upper(d)):
                left = mu * sum(F[i, J] * F[j, J] for J in range(d))
                scaled, turned = lam * F[i], mu * F[j]
                for J, L in np.ndindex(d, d):
                    value = scaled[J] * F[j, L] + turned[J] * F[i, L]
                    if J == L:
                        value += left
                    if i == j:
                        value += S[J, L]
                    out[:, J, k, L] = value
        return P, before

    def _density(self, coefficients: Sequence[Any], H: np.ndarray) -> np.ndarray:
        strain, S = _green(H), _second_stress(coefficients, H)
        d = len(H)
        result: np.ndarray = 0.5 * sum(strain[i, j] * S[i, j] for i, j in np.ndindex(d, d))
        return result


@dataclass(frozen=True, eq=False)
class NeoHookean(Hyperelastic):
    """A compressible rubber-like material.

    :math:`W = mu/2 (tr(F^T F) - 3) - mu ln J + lam/2 (ln J)^2` with :math:`J = det F` and lam, mu
    as in `solid_on` (Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis).
    Where an element is turned inside out (J <= 0 at a Gauss point) force and tangent are not
    finite.

    Parameters
    ----------
    E, nu : float or (elements,) array_like
        Young's modulus at small strain, above 0; Poisson's ratio in (-1, 0.5).

    Examples
    --------
    >>> from pmalpha import structures
    >>> structures.nonlinear_solid(2, 2, 2, 0.5, structures.NeoHookean(1e6, 0.4), rho=1100.0)
    <Structure 27 points, 8 hexahedron, 81 dofs, 1 internal force>
    """

    E: ArrayLike
    nu: ArrayLike

    def _coefficients(self, elements: int, plane: str) -> tuple[np.ndarray, ...]:
        if plane == "stress":
            raise ValueError("plane must be 'strain' for NeoHookean, got 'stress'")
        return isotropic(self.E, self.nu, (elements,))

    def _evaluate(
        self, coefficients: Sequence[Any], H: np.ndarray, before: np.ndarray, out: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        lam, mu = coefficients
        F, d = _deformation(H), len(H)
        change = _volume_change(H)  # J - 1
        with np.errstate(invalid="ignore", divide="ignore"):
            pressure = lam * np.log1p(change)
            G = cofactors_of(F) / (1.0 + change)  # F^-T
        # P = (mu (F F^T - 1) + lam ln J) F^-T; F F^T - 1 = H + H^T + H H^T has no cancellation
        tau = np.empty_like(F)
        for i, j in upper(d):
            b = H[i, j] + H[j, i] + sum(H[i, J] * H[j, J] for J in range(d))
            tau[i, j] = tau[j, i] = mu * b + (pressure if i == j else 0.0)
        P = product(tau, G)
        if out is not None:
            # A_iJjL = mu delta_ij delta_JL + lam G_iJ G_jL + (mu - lam ln J) G_jJ G_iL
            shear = mu - pressure
            for k, (i, j) in enumerate(upper(d)):
                scaled, turned = lam * G[i], shear * G[j]
                for J, L in np.ndindex(d, d):
                    value = scaled[J] * G[j, L] + turned[J] * G[i, L]
                    if i == j and J == L:
                        value += mu
                    out[:, J, k, L] = value
        return P, before

    def _density(self, coefficients: Sequence[Any], H: np.ndarray) -> np.ndarray:
        lam, mu = coefficients
        d = len(H)
        # tr(F^T F) - d = 2 tr H + H : H
        trace = sum(2.0 * H[i, i] for i in range(d)) + sum(h * h for h in H.reshape(d * d, -1))
        with np.errstate(invalid="ignore", divide="ignore"):
            logarithm = np.log1p(_volume_change(H))
        result: np.ndarray = 0.5 * mu * trace - mu * logarithm + 0.5 * lam * logarithm**2
        return result


def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A B at each point."""
    d = len(A)
    out = np.empty_like(A)
    for i, j in np.ndindex(d, d):
        out[i, j] = sum(A[i, k] * B[k, j] for k in range(d))
    return out


def _deformation(H: np.ndarray) -> np.ndarray:
    F = H.copy()
    for i in range(len(H)):
        F[i, i] += 1.0
    return F


def _green(H: np.ndarray) -> np.ndarray:
    """E = (H + H^T + H^T H) / 2."""
    d = len(H)
    strain = np.empty_like(H)
    for i, j in upper(d):
        square = sum(H[k, i] * H[k, j] for k in range(d))
        strain[i, j] = strain[j, i] = 0.5 * (H[i, j] + H[j, i] + square)
    return strain


def _second_stress(coefficients: Sequence[Any], H: np.ndarray) -> np.ndarray:
    """S = lam tr(E) 1 + 2 mu E."""
    lam, mu = coefficients
    strain, d = _green(H), len(H)
    pressure = lam * sum(strain[i, i] for i in range(d))
    S = 2.0 * mu * strain
    for i in range(d):
        S[i, i] += pressure
    result: np.ndarray = S
    return result


def _volume_change(H: np.ndarray) -> np.ndarray:
    """det(1 + H) - 1, without cancellation for small H."""
    if len(H) == 2:
        result: np.ndarray = H[0, 0] + H[1, 1] + _minor(H, 0, 1)
        return result
    minors = _minor(H, 0, 1) + _minor(H, 0, 2) + _minor(H, 1, 2)
    cofactor = cofactors_of(H)
    result = H[0, 0] + H[1, 1] + H[2, 2] + minors + sum(H[0, j] * cofactor[0, j] for j in range(3))
    return result


def _minor(H: np.ndarray, i: int, j: int) -> np.ndarray:
    result: np.ndarray = H[i, i] * H[j, j] - H[i, j] * H[j, i]
    return result


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

    for k, (i, j) in enumerate(upper(d)):
        for J, L in np.ndindex(d, d):
            value = -along * direction(i, J) * direction(j, L)
            if i == J and j == L:
                value += lam
            if i == j and J == L:
                value += mu
            if i == L and J == j:
                value += mu
            out[:, J, k, L] = value
