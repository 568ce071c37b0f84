"""Solids of nonlinear material: quadrilaterals and hexahedra, total Lagrangian."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, overload

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import check_word, whole_number
from ..meshes.mesh import Block
from .checked import dimension_of, is_lumped, mesh_arguments, positive
from .continuum import grid
from .elasticity import gradients, mass_matrix
from .element_force import Conservative, ElementForce, Made, Selected, of_chosen
from .materials import Hyperelastic, Material
from .pattern import Assembly, Pattern
from .structure import Structure

__all__ = ["nonlinear_solid", "nonlinear_solid_on"]

# Elements of a chunk times Gauss points: arrays of the size of the second-level cache.
POINTS = 2048


@overload
def nonlinear_solid(
    nx: int,
    ny: int,
    /,
    h: float | Sequence[float],
    material: Material,
    *,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    plane: str = "strain",
    mass: str = "consistent",
    origin: Sequence[float] | None = None,
) -> Structure: ...


@overload
def nonlinear_solid(
    nx: int,
    ny: int,
    nz: int,
    /,
    h: float | Sequence[float],
    material: Material,
    *,
    rho: ArrayLike,
    mass: str = "consistent",
    origin: Sequence[float] | None = None,
) -> Structure: ...


def nonlinear_solid(
    *arguments: Any,
    h: Any = None,
    material: Any = None,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    plane: str = "strain",
    mass: str = "consistent",
    origin: Sequence[float] | None = None,
) -> Structure:
    """A rectangle or box of equal elements: `nonlinear_solid_on` a regular mesh.

    ``nonlinear_solid(nx, ny, h, material, ...)`` as `plate`, ``nonlinear_solid(nx, ny, nz, h,
    material, ...)`` as `solid`, whose numbers of nodes and elements it has.

    Parameters
    ----------
    *arguments : int
        Numbers of elements nx, ny and nz along the axes, at least 1: two of quadrilaterals,
        three of hexahedra.
    h : float, or one for each axis
        Edge lengths of an element.
    material : StVenantKirchhoff, NeoHookean or J2Plasticity
        As for `nonlinear_solid_on`.
    rho, t : float or array_like
        As for `nonlinear_solid_on`; arrays by element.
    plane : {"strain", "stress"}
        As for `nonlinear_solid_on`.
    mass : {"consistent", "lumped"}
        As for `nonlinear_solid_on`.
    origin : one float for each axis, optional
        The corner with the smallest coordinates. Default: zeros.

    Returns
    -------
    Structure
        Components "ux", "uy" and, in three dimensions, "uz".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive or not finite, wrong shapes, and what is not a material.

    Examples
    --------
    >>> from pmalpha import structures
    >>> rubber = structures.NeoHookean(1e6, 0.45)
    >>> block = structures.nonlinear_solid(8, 4, 4, 0.01, rubber, rho=1100.0, mass="lumped")
    >>> block
    <Structure 225 points, 128 hexahedron, 675 dofs, 1 internal force>
    >>> box = structures.solid(8, 4, 4, 0.01, E=1e6, nu=0.45, rho=1100.0)
    >>> bool(abs(block.tangent() - box.K).max() < 1e-12 * abs(box.K).max())  # without strain
    True
    """
    values = [*arguments, *(x for x in (h, material) if x is not None)]
    if len(values) < 3:
        raise TypeError(
            "nonlinear_solid needs nx, ny, h and a material, or nx, ny, nz, h and a material, got "
            f"{values!r}"
        )
    *counts, h, material = values
    if len(counts) not in (2, 3):
        raise ValueError(f"nonlinear_solid needs two or three numbers of elements, got {counts!r}")
    numbers = tuple(whole_number(n, name, low=1) for n, name in zip(counts, ("nx", "ny", "nz")))
    start = (0.0,) * len(numbers) if origin is None else origin
    points, elements, corners = grid(numbers, h, start)
    return _solid(points, elements, corners, material, rho, t, plane, mass)


def nonlinear_solid_on(
    points: ArrayLike,
    elements: ArrayLike,
    material: Material,
    *,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    plane: str = "strain",
    mass: str = "consistent",
) -> Structure:
    """A solid of nonlinear material on any mesh of quadrilaterals or hexahedra.

    Total Lagrangian with 2 x 2 or 2 x 2 x 2 Gauss points (Bonet and Wood, Nonlinear Continuum
    Mechanics for Finite Element Analysis): with n_a the shape functions, d_J their derivatives in
    the undeformed mesh and P the first Piola-Kirchhoff stress, the force of corner a along axis i
    is the integral of P_iJ d_J n_a, and its derivative that of d_J n_a dP_iJ/dF_jL d_L n_b.
    Integration is full: elements are stiff in bending and for nu near 0.5.

    Parameters
    ----------
    points : (N, 2) or (N, 3) array_like
        Coordinates of the nodes.
    elements : (E, 4) or (E, 8) array_like of int
        Corners as for `plate_on` and `solid_on`.
    material : StVenantKirchhoff, NeoHookean or J2Plasticity
        Of all elements; its numbers may be arrays by element.
    rho : float or (E,) array_like
        Density of the undeformed solid.
    t : float or (E,) array_like, default 1
        Thickness, in two dimensions only.
    plane : {"strain", "stress"}
        In two dimensions; "stress" with StVenantKirchhoff only, where the thickness of the
        undeformed plate counts.
    mass : {"consistent", "lumped"}
        As for `plate_on`.

    Returns
    -------
    Structure
        K has no entries, `internal` has one force. Components "ux", "uy" and, in three dimensions,
        "uz".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are not convex or have another
        order of corners, numbers out of their range, and what is not a material.

    Examples
    --------
    The force of a rotation is zero:

    >>> from pmalpha import structures
    >>> mesh = structures.plate(3, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> sheet = structures.nonlinear_solid_on(
    ...     mesh.points, mesh.elements["quad"], structures.StVenantKirchhoff(1.0, 0.3), rho=1.0)
    >>> turned = mesh.points @ [[0.0, 1.0], [-1.0, 0.0]]  # by 90 degrees
    >>> force = sheet.internal[0].residual((turned - mesh.points).ravel())
    >>> bool(abs(force).max() < 1e-15)
    True
    """
    dim = dimension_of(points)
    nodes, cells = mesh_arguments(points, elements, "elements", dim, 4 if dim == 2 else 8)
    return _solid(nodes, cells, nodes[cells], material, rho, t, plane, mass)


def _solid(
    points: np.ndarray,
    elements: np.ndarray,
    corners: np.ndarray,
    material: Any,
    rho: Any,
    t: Any,
    plane: str,
    mass: str,
) -> Structure:
    """The structure; corners of each element or, with one row, of all."""
    if not isinstance(material, Material):
        raise TypeError(
            f"material must be StVenantKirchhoff, NeoHookean or J2Plasticity, got {material!r}"
        )
    check_word(plane, "plane", ("strain", "stress"))
    d, shape = points.shape[1], (len(elements),)
    if d == 3 and (plane != "strain" or np.any(np.asarray(t) != 1.0)):
        raise ValueError("t and plane must not be given in three dimensions")
    density, thickness = positive(rho, "rho", shape), positive(t, "t", shape)
    name, components = ("quad", ("ux", "uy")) if d == 2 else ("hexahedron", ("ux", "uy", "uz"))
    values = (corners, thickness, density, *material._coefficients(len(elements), plane))
    recipe = partial(_assembled, name, material, values, is_lumped(mass))
    return Structure._of(recipe, points, {name: elements}, components)


def _assembled(
    name: str, material: Material, values: Sequence[np.ndarray], lumped: bool, selected: Selected
) -> Made:
    corners, t, rho, *coefficients = selected.rows(name, values)
    elements, n = selected.elements[name], selected.nodes * corners.shape[2]
    volumes, along = gradients(name, corners)
    pattern = Pattern.of(elements, selected.nodes)
    M = mass_matrix(Block(name, elements), pattern, corners, t * rho, lumped)
    kind = ElasticSolidForce if isinstance(material, Hyperelastic) else SolidForce
    force = kind(elements, pattern, t[:, None] * volumes, along, material, coefficients)
    return M, sp.csr_array((n, n)), (force,)


class SolidForce(ElementForce):
    def __init__(
        self,
        elements: np.ndarray,
        pairs: Pattern,
        weights: np.ndarray,
        along: np.ndarray,
        material: Material,
        coefficients: Sequence[np.ndarray],
    ):
        d, _, q, a = along.shape
        nodes = pairs.indptr.size - 1
        self._assembly = Assembly(elements, nodes, d, POINTS // q, pairs)
        self._material = material
        self._coefficients = coefficients
        self._weights = weights  # (E or 1, q)
        self._slopes = np.ascontiguousarray(np.moveaxis(along, 0, 2))  # (E or 1, q, d, a)
        self._shape = (len(elements), q, material._variables(d))
        super().__init__(self._assembly.pattern, np.zeros(int(np.prod(self._shape))))

    def _evaluate(
        self, u: np.ndarray, q: np.ndarray, tangent: bool
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        assembly, d = self._assembly, self._assembly.d
        before = q.reshape(self._shape)
        after = np.empty_like(before)
        forces = np.empty((len(assembly.elements), d, assembly.elements.shape[1]))
        sums = assembly.sums() if tangent else None
        for number, part in enumerate(assembly.chunks):
            slopes, weights = self._of(part)
            H = self._gradient(u, part)
            m = H.shape[2]
            state = np.moveaxis(before[part], 2, 0).reshape(-1, m)
            points = slopes.shape[1]
            moduli = np.empty((m, d, len(assembly.components), d)) if tangent else None
            values = self._values(part, points)
            stress, state = self._material._evaluate(values, H, state, moduli)
            after[part] = np.moveaxis(state.reshape(-1, m // points, points), 0, 2)
            weighted = weights[:, :, None, None] * slopes  # w d_J n_a
            flat = weighted.reshape(len(weighted), points * d, -1)
            stress = np.moveaxis(stress.reshape(d, d, -1, points), (2, 3), (0, 2))
            forces[part] = stress.reshape(-1, d, points * d) @ flat
            if sums is not None and moduli is not None:
                assembly.add(sums, number, _blocks(moduli, slopes, flat))
        f = assembly.force(np.swapaxes(forces, 1, 2))
        return f, None if sums is None else assembly.matrix(sums), after.ravel()

    def _of(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the shape functions and weights of a chunk; one row if all are equal."""
        return of_chosen(self._slopes, part), of_chosen(self._weights, part)

    def _gradient(self, u: np.ndarray, part: slice) -> np.ndarray:
        """H_iJ = du_i / dX_J, (d, d, m), at the Gauss points of a chunk."""
        corners, d = self._assembly.elements[part], self._assembly.d
        slopes, _ = self._of(part)
        moved = np.swapaxes(u.reshape(-1, d)[corners], 1, 2)  # (e, i, a)
        flat = slopes.reshape(len(slopes), -1, slopes.shape[3])  # (e, q J, a)
        H = (moved @ np.swapaxes(flat, 1, 2)).reshape(len(corners), d, -1, d)
        result: np.ndarray = np.moveaxis(H, (0, 2), (2, 3)).reshape(d, d, -1)
        return result

    def _values(self, part: slice, points: int) -> list[Any]:
        """Coefficients of the material at the Gauss points of a chunk."""
        return [
            float(c[0]) if len(c) == 1 else np.repeat(c[part], points) for c in self._coefficients
        ]


class ElasticSolidForce(SolidForce, Conservative):
    _material: Hyperelastic

    def _potential(self, u: np.ndarray) -> float:
        total = 0.0
        for part in self._assembly.chunks:
            _, weights = self._of(part)
            values = self._values(part, weights.shape[1])
            W = self._material._density(values, self._gradient(u, part))
            total += float(np.sum(weights * W.reshape(-1, weights.shape[1])))
        return total


def _blocks(moduli: np.ndarray, slopes: np.ndarray, flat: np.ndarray) -> list[np.ndarray]:
    """sum_q w d_J n_a A_iJjL d_L n_b, an array (e, a, b) for each pair of components."""
    _, d, pairs, _ = moduli.shape
    _, q, _, a = slopes.shape
    # A_iJjL d_L n_b, (e, q J, k b)
    right = (moduli.reshape(-1, q, d * pairs, d) @ slopes).reshape(-1, q * d, pairs * a)
    sums = (np.swapaxes(flat, 1, 2) @ right).reshape(-1, a, pairs, a)
    return [sums[:, :, k] for k in range(pairs)]
