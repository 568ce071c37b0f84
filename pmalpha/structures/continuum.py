"""Plates in plane stress and solids, on regular and on arbitrary meshes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import listing, plain_array, positive_number, real_array, whole_number
from .arguments import is_lumped, isotropic, mesh_arguments, poisson, positive
from .pattern import Pattern, lumped_mass
from .structure import Structure

__all__ = ["plate", "plate_on", "solid", "solid_on"]

# Corners of the reference elements, in meshio's order.
QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
HEXAHEDRON = np.array([[x, y, z] for z in (-1, 1) for x, y in QUAD])


def plate(
    nx: int,
    ny: int,
    h: float | Sequence[float],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    mass: str = "consistent",
    origin: Sequence[float] = (0.0, 0.0),
) -> Structure:
    """A rectangle in plane stress, nx by ny elements: `plate_on` a regular mesh.

    Node (i, j), at origin + (i hx, j hy), has the number (ny + 1) i + j; element (i, j) the number
    ny i + j. A second plate on the right begins at ``origin=(nx * h, 0)``.

    Parameters
    ----------
    nx, ny : int
        Number of elements along x and y, at least 1.
    h : float or two floats
        Edge length of an element, or (hx, hy).
    E, nu, rho, t : float, (nx, ny) or (nx * ny,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5], density, thickness; arrays by element for
        plates of several materials.
    mass : {"consistent", "lumped"}
    origin : two floats, default (0, 0)
        The lower left corner.

    Returns
    -------
    Structure
        Components "ux", "uy", elements "quad".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive or not finite, and wrong shapes.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.plate(99, 24, 0.1, E=1000.0, nu=0.3, rho=100.0)
    <Structure 2500 points, 2376 quad, 5000 dofs>
    """
    counts = whole_number(nx, "nx", low=1), whole_number(ny, "ny", low=1)
    points, quads, corners = grid(counts, h, origin, QUAD)
    lam, mu, area_density = _plane_stress(E, nu, rho, t, counts)
    M, K = _continuum(quads, corners, QUAD, len(points), (lam, mu, area_density), mass)
    return Structure(M, K, points, {"quad": quads}, ("ux", "uy"))


def plate_on(
    points: ArrayLike,
    quads: ArrayLike,
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    mass: str = "consistent",
) -> Structure:
    """Plane stress on any mesh of bilinear quadrilaterals with 2 x 2 Gauss points.

    With n_a the shape functions and d_i their derivatives, the stiffness between component i of
    corner a and component j of corner b is the integral over the element of
    t (lam d_i n_a d_j n_b + mu d_j n_a d_i n_b + mu delta_ij sum_k d_k n_a d_k n_b), with
    mu = E / (2 (1 + nu)) and in plane stress lam = E nu / (1 - nu^2) (Hughes, The Finite Element
    Method). Integration is full: thin structures in bending need several elements through the
    depth.

    Parameters
    ----------
    points : (N, 2) array_like
        Coordinates of the nodes.
    quads : (elements, 4) array_like of int
        Corners, counter-clockwise.
    E, nu, rho, t : float or (elements,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5], density, thickness.
    mass : {"consistent", "lumped"}
        Lumped: the row sums of the consistent mass matrix, which are positive.

    Returns
    -------
    Structure
        Components "ux", "uy", elements "quad".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are not convex or numbered
        clockwise, numbers that are not positive.

    Examples
    --------
    Some elements of another plate, by `submesh`:

    >>> from pmalpha import models
    >>> whole = models.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> points, quads, nodes = models.submesh(whole.points, whole.elements["quad"][:4])
    >>> models.plate_on(points, quads, E=1.0, nu=0.3, rho=1.0)
    <Structure 9 points, 4 quad, 18 dofs>
    """
    nodes, elements = mesh_arguments(points, quads, "quads", 2, 4)
    lam, mu, area_density = _plane_stress(E, nu, rho, t, (len(elements),))
    coefficients = (lam, mu, area_density)
    M, K = _continuum(elements, nodes[elements], QUAD, len(nodes), coefficients, mass)
    return Structure(M, K, nodes, {"quad": elements}, ("ux", "uy"))


def solid(
    nx: int,
    ny: int,
    nz: int,
    h: float | Sequence[float],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    mass: str = "consistent",
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> Structure:
    """A box of nx by ny by nz elements: `solid_on` a regular mesh.

    Node (i, j, k), at origin + (i hx, j hy, k hz), has the number
    ((ny + 1) i + j) (nz + 1) + k; element (i, j, k) the number (ny i + j) nz + k.

    Parameters
    ----------
    nx, ny, nz : int
        Number of elements along the axes, at least 1.
    h : float or three floats
        Edge length of an element, or (hx, hy, hz).
    E, nu, rho : float, (nx, ny, nz) or (nx * ny * nz,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5), density; arrays by element.
    mass : {"consistent", "lumped"}
    origin : three floats, default (0, 0, 0)
        The corner with the smallest coordinates.

    Returns
    -------
    Structure
        Components "ux", "uy", "uz", elements "hexahedron".

    Raises
    ------
    TypeError, ValueError
        For numbers that are not positive or not finite, and wrong shapes.

    Examples
    --------
    >>> from pmalpha import models
    >>> models.solid(20, 4, 4, 0.25, E=30e9, nu=0.2, rho=2500.0, mass="lumped")
    <Structure 525 points, 320 hexahedron, 1575 dofs>
    """
    sizes = zip(("nx", "ny", "nz"), (nx, ny, nz))
    counts = tuple(whole_number(value, name, low=1) for name, value in sizes)
    points, hexahedra, corners = grid(counts, h, origin, HEXAHEDRON)
    coefficients = *isotropic(E, nu, counts), positive(rho, "rho", counts)
    M, K = _continuum(hexahedra, corners, HEXAHEDRON, len(points), coefficients, mass)
    return Structure(M, K, points, {"hexahedron": hexahedra}, ("ux", "uy", "uz"))


def solid_on(
    points: ArrayLike,
    hexahedra: ArrayLike,
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    mass: str = "consistent",
) -> Structure:
    """A solid on any mesh of trilinear hexahedra with 2 x 2 x 2 Gauss points.

    The formula of `plate_on` without t and with lam = E nu / ((1 + nu) (1 - 2 nu)).

    Parameters
    ----------
    points : (N, 3) array_like
        Coordinates of the nodes.
    hexahedra : (elements, 8) array_like of int
        Corners in meshio's order: one face counter-clockwise as seen from inside the element,
        then the opposite face from the corner above the first.
    E, nu, rho : float or (elements,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5), density.
    mass : {"consistent", "lumped"}
        Lumped: the row sums of the consistent mass matrix, which are positive.

    Returns
    -------
    Structure
        Components "ux", "uy", "uz", elements "hexahedron".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are not convex or have another
        order of corners, numbers that are not positive.

    Examples
    --------
    >>> from pmalpha import models
    >>> box = models.solid(2, 2, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> points = box.points + 0.1 * box.points[:, ::-1] ** 2
    >>> models.solid_on(points, box.elements["hexahedron"], E=1.0, nu=0.3, rho=1.0)
    <Structure 27 points, 8 hexahedron, 81 dofs>
    """
    nodes, elements = mesh_arguments(points, hexahedra, "hexahedra", 3, 8)
    shape = (len(elements),)
    coefficients = *isotropic(E, nu, shape), positive(rho, "rho", shape)
    M, K = _continuum(elements, nodes[elements], HEXAHEDRON, len(nodes), coefficients, mass)
    return Structure(M, K, nodes, {"hexahedron": elements}, ("ux", "uy", "uz"))


def _plane_stress(E, nu, rho, t, shape: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """t lam, t mu and t rho, each (1,) or (elements,)."""
    young, thickness = positive(E, "E", shape), positive(t, "t", shape)
    ratio = poisson(nu, shape, incompressible=True)
    lam, mu = young * ratio / (1.0 - ratio**2), young / (2.0 * (1.0 + ratio))
    return thickness * lam, thickness * mu, thickness * positive(rho, "rho", shape)


def grid(
    counts: tuple[int, ...], h: Any, origin: Any, reference: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and elements of a regular mesh, and the corners (1, a, d) of one element."""
    d = len(counts)
    edges, start = plain_array(h, "h"), real_array(origin, "origin")
    if edges.shape not in ((), (d,)):
        raise ValueError(f"h must be one number or {d}, got shape {edges.shape}")
    if start.shape != (d,):
        raise ValueError(f"origin must have shape ({d},), got {start.shape}")
    size = np.array([positive_number(e, "h") for e in np.broadcast_to(edges, d).tolist()])
    index = np.indices([c + 1 for c in counts]).reshape(d, -1).T
    offset = (reference + 1) // 2  # of each corner from the first node, in elements
    shape = [c + 1 for c in counts]
    first = np.indices(counts).reshape(d, -1).T
    numbers = [np.ravel_multi_index((first + step).T, shape) for step in offset]
    return start + size * index, np.column_stack(numbers), (size * offset)[None]


def _continuum(
    elements: np.ndarray,
    corners: np.ndarray,
    reference: np.ndarray,
    nodes: int,
    coefficients: tuple[np.ndarray, ...],
    mass: str,
) -> tuple[Any, sp.csr_array]:
    """M and K; corners and coefficients of each element or, with one row, of all elements."""
    lam, mu, density = coefficients
    shapes, slopes = at_gauss_points(reference)
    volumes, along = gradients(corners, slopes)
    weights = density[:, None] * volumes
    pattern = Pattern.of(elements, nodes)
    M = solid_mass(pattern, elements, weights, shapes, reference.shape[1], is_lumped(mass))
    return M, _stiffness(pattern, volumes, along, lam[:, None, None], mu[:, None, None])


def solid_mass(
    pattern: Pattern,
    elements: np.ndarray,
    weights: np.ndarray,
    shapes: np.ndarray,
    d: int,
    lumped: bool,
) -> Any:
    """M, or its diagonal if lumped; weights (E or 1, q) of the Gauss points, density included."""
    if lumped:
        return np.repeat(lumped_mass(elements, weights @ shapes, pattern.indptr.size - 1), d)
    squares = shapes[:, :, None] * shapes[:, None, :]  # (q, a, b)
    scalar = pattern.matrix(np.tensordot(weights, squares, axes=1))
    return sp.csr_array(sp.kron(scalar, sp.eye_array(d), format="csr"))


def at_gauss_points(reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """n_a (q, a) and their slopes (q, a, d) at the 2^d Gauss points, which have weight 1."""
    # n_a(x) = prod_i (1 + x_ai x_i) / 2, at x = x_q / sqrt 3
    factors = (1.0 + reference[None] * reference[:, None] / np.sqrt(3.0)) / 2.0
    slopes = [
        reference[:, i] / 2.0 * np.delete(factors, i, axis=2).prod(axis=2)
        for i in range(reference.shape[1])
    ]
    return factors.prod(axis=2), np.stack(slopes, axis=2)


def gradients(corners: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Volumes (E, q) of the Gauss points, and derivatives (d, E, q, a) along the axes."""
    jacobian = np.swapaxes(corners, 1, 2)[:, None] @ slopes  # dx_i / dxi_j, (E, q, d, d)
    volumes = np.linalg.det(jacobian)
    invalid = np.flatnonzero(~(volumes > 0.0).all(axis=1))
    if invalid.size:
        raise ValueError(
            "elements must be convex with corners in meshio's order (counter-clockwise), got a "
            f"Jacobian determinant of {volumes[invalid[0]].min():g} in {listing(invalid)}"
        )
    along = slopes @ np.linalg.inv(jacobian)
    return volumes, np.ascontiguousarray(np.moveaxis(along, 3, 0))


def _stiffness(
    pattern: Pattern, volumes: np.ndarray, gradients: np.ndarray, lam: np.ndarray, mu: np.ndarray
) -> sp.csr_array:
    """K of an isotropic material, by pairs of components to save memory."""
    g = np.sqrt(volumes)[:, :, None] * gradients
    d = len(g)

    def pair(i, j):
        """The integral of d_i n_a d_j n_b, (E, a, b)."""
        return np.swapaxes(g[i], 1, 2) @ g[j]

    shear = mu * sum(pair(k, k) for k in range(d))
    blocks = np.empty((pattern.indices.size, d, d))
    for i in range(d):
        for j in range(i + 1):
            G = pair(i, j)
            block = lam * G + mu * np.swapaxes(G, 1, 2) + (shear if i == j else 0.0)
            blocks[:, i, j] = pattern.sums(block)
            blocks[:, j, i] = pattern.sums(np.swapaxes(block, 1, 2)) if i != j else blocks[:, i, i]
    return pattern.of_blocks(blocks)
