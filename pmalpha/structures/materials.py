"""Hyperelastic materials: stress and its derivative at many points at once.

Arrays at the Gauss points have the points last: (d, d, m). With H the gradient of the displacement,
F = 1 + H, a material returns the stress P = dW/dF (first Piola-Kirchhoff) and, where a tangent is
wanted, A_iJjL = dP_iJ / dF_jL, which is written for i <= j to out[:, J, k, L], k the number of the
pair (i, j).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .checked import isotropic

__all__ = ["NeoHookean", "StVenantKirchhoff"]


class Material:
    """What a nonlinear solid needs of its material."""

    # Numbers of history at a Gauss point of a solid in d dimensions.
    def _variables(self, d: int) -> int:
        return 0

    def _coefficients(self, elements: int, plane: str) -> tuple[np.ndarray, ...]:
        """Checked values by element, each (1,) or (elements,), for `_evaluate`."""
        raise NotImplementedError

    def _evaluate(
        self,
        coefficients: Sequence[Any],
        H: np.ndarray,
        before: np.ndarray,
        out: np.ndarray | None,
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

    W = lam/2 tr(E)^2 + mu E : E with the Green strain E = (F^T F - 1) / 2 and the moduli of
    `solid_on` or, in plane stress, `plate_on` (Bonet and Wood, Nonlinear Continuum Mechanics for
    Finite Element Analysis). For large rotations and small strains; in strong compression, below
    0.58 of the length in uniaxial strain, it softens.

    Parameters
    ----------
    E, nu : float or (elements,) array_like
        Young's modulus, above 0; Poisson's ratio in (-1, 0.5).

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
        lam, mu = isotropic(self.E, self.nu, (elements,))
        return (2.0 * lam * mu / (lam + 2.0 * mu) if plane == "stress" else lam), mu

    def _evaluate(
        self, coefficients: Sequence[Any], H: np.ndarray, before: np.ndarray, out: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        lam, mu = coefficients
        F, S = _deformation(H), _second_stress(coefficients, H)
        P = product(F, S)
        if out is not None:
            d = len(F)
            # A_iJjL = lam F_iJ F_jL + mu ((F F^T)_ij delta_JL + F_iL F_jJ) + delta_ij S_JL
            for k, (i, j) in enumerate(component_pairs(d)):
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

    W = mu/2 (tr(F^T F) - 3) - mu ln J + lam/2 (ln J)^2 with J = det F and lam, mu as in `solid_on`
    (Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis). Where an element
    is turned inside out (J <= 0 at a Gauss point) force and tangent are not finite.

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
            G = _cofactor(F) / (1.0 + change)  # F^-T
        # P = (mu (F F^T - 1) + lam ln J) F^-T; F F^T - 1 = H + H^T + H H^T has no cancellation
        tau = np.empty_like(F)
        for i, j in component_pairs(d):
            b = H[i, j] + H[j, i] + sum(H[i, J] * H[j, J] for J in range(d))
            tau[i, j] = tau[j, i] = mu * b + (pressure if i == j else 0.0)
        P = product(tau, G)
        if out is not None:
            # A_iJjL = mu delta_ij delta_JL + lam G_iJ G_jL + (mu - lam ln J) G_jJ G_iL
            shear = mu - pressure
            for k, (i, j) in enumerate(component_pairs(d)):
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


def component_pairs(d: int) -> list[tuple[int, int]]:
    """(i, j) with i <= j, in the order of `Assembly.components`."""
    return [(i, j) for i in range(d) for j in range(i, d)]


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
    for i, j in component_pairs(d):
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
    cofactor = _cofactor(H)
    result = H[0, 0] + H[1, 1] + H[2, 2] + minors + sum(H[0, j] * cofactor[0, j] for j in range(3))
    return result


def _minor(H: np.ndarray, i: int, j: int) -> np.ndarray:
    result: np.ndarray = H[i, i] * H[j, j] - H[i, j] * H[j, i]
    return result


def _cofactor(F: np.ndarray) -> np.ndarray:
    """det(F) F^-T."""
    out = np.empty_like(F)
    if len(F) == 2:
        out[0, 0], out[1, 1] = F[1, 1], F[0, 0]
        out[0, 1], out[1, 0] = -F[1, 0], -F[0, 1]
        return out
    for i, j in np.ndindex(3, 3):
        a, b, c, e = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        out[i, j] = F[a, c] * F[b, e] - F[a, e] * F[b, c]
    return out
