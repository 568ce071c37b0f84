"""Plates and solids, on regular and on arbitrary meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import check_word, plain_array, real_array, require_moderate, whole_number
from ..meshes.mesh import KINDS, SHAPES
from .checked import (
    in_plane_stress,
    is_lumped,
    isotropic,
    measure,
    node_numbers,
    positive,
    require_used,
)
from .elasticity import Moduli, elastic_matrices
from .structure import Structure

__all__ = ["plate", "plate_on", "solid", "solid_on"]


def plate(
    nx: int,
    ny: int,
    h: float | Sequence[float],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    plane: str = "stress",
    mass: str = "consistent",
    origin: Sequence[float] = (0.0, 0.0),
) -> Structure:
    """A rectangle of nx by ny elements: `plate_on` a regular mesh.

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
    plane : {"stress", "strain"}
        In plane strain nu must be less than 0.5.
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
    >>> from pmalpha import structures
    >>> structures.plate(99, 24, 0.1, E=1000.0, nu=0.3, rho=100.0)
    <Structure 2500 points, 2376 quad, 5000 dofs>
    """
    counts = whole_number(nx, "nx", low=1), whole_number(ny, "ny", low=1)
    points, quads, corners = grid(counts, h, origin)
    moduli = moduli_of(2, E, nu, rho, t, plane, counts)
    return elastic(points, {"quad": quads}, {"quad": moduli}, mass, {"quad": corners})


def plate_on(
    points: ArrayLike,
    elements: ArrayLike | Mapping[str, ArrayLike],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    t: ArrayLike = 1.0,
    plane: str = "stress",
    mass: str = "consistent",
) -> Structure:
    """A plate on any mesh of triangles and quadrilaterals, of first or second order.

    With n_a the shape functions and d_i their derivatives, the stiffness between component i of
    node a and component j of node b is the integral over the element of
    t (lam d_i n_a d_j n_b + mu d_j n_a d_i n_b + mu delta_ij sum_k d_k n_a d_k n_b), with
    :math:`mu = E / (2 (1 + nu))` and :math:`lam = E nu / (1 - nu^2)` in plane stress,
    :math:`lam = E nu / ((1 + nu) (1 - 2 nu))` in plane strain (Hughes, The Finite Element Method).
    Integration is full, with 1, 3, 2 x 2, 3 x 3 and 3 x 3 points in triangles of 3 and 6 and
    quadrilaterals of 4, 8 and 9 nodes: elements of first order need several through the depth of
    what bends, and are stiff for nu near 0.5 in plane strain.

    Parameters
    ----------
    points : (N, 2) array_like
        Coordinates of the nodes.
    elements : (elements, nodes) array_like of int, or dict
        Nodes of each element in the order of meshio and VTK: corners counter-clockwise, then those
        on the edges, then that in the middle. An array is of triangles with 3 or 6 or of
        quadrilaterals with 4, 8 or 9 nodes. A dict has such arrays by the name of their kind:
        "triangle", "triangle6", "quad", "quad8", "quad9".
    E, nu, rho, t : float or (elements,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5] (plane strain: less than 0.5), density,
        thickness. Arrays have the elements in the order of the dict, kind after kind.
    plane : {"stress", "strain"}
    mass : {"consistent", "lumped"}
        Lumped, of first order: the row sums of the consistent mass matrix. Of second order: its
        diagonal, scaled to the mass of the element (Hinton, Rock, Zienkiewicz 1976). Both are
        positive.

    Returns
    -------
    Structure
        Components "ux", "uy".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are flat, not convex or
        numbered clockwise (by their numbers), numbers that are not positive.

    Examples
    --------
    Some elements of another plate, by `submesh`:

    >>> from pmalpha import structures
    >>> whole = structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> points, quads, nodes = structures.submesh(whole.points, whole.elements["quad"][:4])
    >>> structures.plate_on(points, quads, E=1.0, nu=0.3, rho=1.0)
    <Structure 9 points, 4 quad, 18 dofs>
    """
    return _on(points, elements, 2, E, nu, rho, t, plane, mass)


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
    >>> from pmalpha import structures
    >>> structures.solid(20, 4, 4, 0.25, E=30e9, nu=0.2, rho=2500.0, mass="lumped")
    <Structure 525 points, 320 hexahedron, 1575 dofs>
    """
    sizes = zip(("nx", "ny", "nz"), (nx, ny, nz))
    counts = tuple(whole_number(value, name, low=1) for name, value in sizes)
    points, cells, corners = grid(counts, h, origin)
    moduli = moduli_of(3, E, nu, rho, 1.0, "strain", counts)
    kind = "hexahedron"
    return elastic(points, {kind: cells}, {kind: moduli}, mass, {kind: corners})


def solid_on(
    points: ArrayLike,
    elements: ArrayLike | Mapping[str, ArrayLike],
    *,
    E: ArrayLike,
    nu: ArrayLike,
    rho: ArrayLike,
    mass: str = "consistent",
) -> Structure:
    """A solid on any mesh of tetrahedra, wedges and hexahedra, of first or second order.

    The formula of `plate_on` without t and with :math:`lam = E nu / ((1 + nu) (1 - 2 nu))`.
    Integration is full, with 1 and 4, 6 and 21, 2 x 2 x 2 and 3 x 3 x 3 points in tetrahedra,
    wedges and hexahedra of first and second order.

    Parameters
    ----------
    points : (N, 3) array_like
        Coordinates of the nodes.
    elements : (elements, nodes) array_like of int, or dict
        Nodes of each element in the order of meshio and VTK. Of first order: one face
        counter-clockwise as seen from inside the element, then the tip, or the opposite face from
        the corner above the first. Of second order the nodes on the edges follow. An array is of
        tetrahedra with 4 or 10, wedges with 6 or 15 or hexahedra with 8 or 20 nodes. A dict has
        such arrays by the name of their kind: "tetra", "tetra10", "wedge", "wedge15",
        "hexahedron", "hexahedron20".
    E, nu, rho : float or (elements,) array_like
        Young's modulus, Poisson's ratio in (-1, 0.5), density. Arrays have the elements in the
        order of the dict, kind after kind.
    mass : {"consistent", "lumped"}
        As for `plate_on`.

    Returns
    -------
    Structure
        Components "ux", "uy", "uz".

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, points that no element uses, elements that are flat, not convex or have
        another order of corners (by their numbers), numbers that are not positive.

    Examples
    --------
    >>> from pmalpha import structures
    >>> box = structures.solid(2, 2, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> points = box.points + 0.1 * box.points[:, ::-1] ** 2
    >>> structures.solid_on(points, box.elements["hexahedron"], E=1.0, nu=0.3, rho=1.0)
    <Structure 27 points, 8 hexahedron, 81 dofs>
    """
    return _on(points, elements, 3, E, nu, rho, 1.0, "strain", mass)


def moduli_of(
    d: int, E: Any, nu: Any, rho: Any, t: Any, plane: str, shape: tuple[int, ...]
) -> Moduli:
    """Lame's constants, density and thickness of elements of this shape, or (1,) of all."""
    check_word(plane, "plane", ("stress", "strain"))
    density = positive(rho, "rho", shape)
    if d == 3 or plane == "strain":
        lam, mu = isotropic(E, nu, shape)
        across = 0.5 * lam / (lam + mu)  # nu
    else:
        across = np.zeros(1)
        lam, mu = in_plane_stress(E, nu, shape)
    return Moduli(lam, mu, density, positive(t, "t", shape), across)


def grid(counts: tuple[int, ...], h: Any, origin: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and elements of a regular mesh, and the corners (1, a, d) of one element."""
    d = len(counts)
    edges, start = plain_array(h, "h"), real_array(origin, "origin")
    if edges.shape not in ((), (d,)):
        raise ValueError(f"h must be one number or {d}, got shape {edges.shape}")
    if start.shape != (d,):
        raise ValueError(f"origin must have shape ({d},), got {start.shape}")
    size = np.array([measure(e, "h") for e in np.broadcast_to(edges, d).tolist()])
    index = np.indices([c + 1 for c in counts]).reshape(d, -1).T
    # of each corner from the first node, in elements
    offset = SHAPES["quad" if d == 2 else "hexahedron"].nodes.astype(int)
    shape = [c + 1 for c in counts]
    first = np.indices(counts).reshape(d, -1).T
    numbers = [np.ravel_multi_index((first + step).T, shape) for step in offset]
    return start + size * index, np.column_stack(numbers), (size * offset)[None]


def elastic(
    points: np.ndarray,
    elements: dict[str, np.ndarray],
    moduli: dict[str, Moduli],
    mass: str,
    corners: dict[str, np.ndarray] | None = None,
) -> Structure:
    """The structure; corners (1, a, d) of each kind whose elements are all equal."""
    recipe = partial(elastic_matrices, points, elements, moduli, is_lumped(mass), corners)
    return Structure._of(recipe, points, elements, ("ux", "uy", "uz")[: points.shape[1]], moduli)


def _on(
    points: Any, elements: Any, d: int, E: Any, nu: Any, rho: Any, t: Any, plane: str, mass: str
) -> Structure:
    """On any mesh; arrays of the material have the elements in the order of the kinds."""
    nodes, cells = _checked(points, elements, d)
    ends = np.cumsum([len(block) for block in cells.values()])
    values = moduli_of(d, E, nu, rho, t, plane, (int(ends[-1]),))
    cut = [len(cells) * [x] if len(x) == 1 else np.split(x, ends[:-1]) for x in values]
    moduli = {kind: Moduli(*arrays) for kind, arrays in zip(cells, zip(*cut))}
    return elastic(nodes, cells, moduli, mass)


def _checked(points: Any, elements: Any, d: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (N, d), and nodes of elements by kind; each point must be in an element."""
    coordinates = real_array(points, "points", 2)
    require_moderate(coordinates, "points")
    if coordinates.shape[1] != d:
        flat = d == 2 and coordinates.shape[1] == 3 and len(np.unique(coordinates[:, 2])) == 1
        advice = f"; all have z = {coordinates[0, 2]:g}: give points[:, :2]" if flat else ""
        raise ValueError(f"points must have shape (points, {d}), got {coordinates.shape}{advice}")
    kinds = {KINDS[kind].nodes: kind for kind in SHAPES if KINDS[kind].dimension == d}
    if not isinstance(elements, Mapping) or sp.issparse(elements):  # a dok_array is a Mapping
        columns = plain_array(elements, "elements").shape[1:]
        if columns not in {(count,) for count in kinds}:
            allowed = ", ".join(map(str, kinds))
            raise ValueError(
                f"elements must have shape (elements, corners) with {allowed} nodes of each, got "
                f"{np.shape(elements)}"
            )
        elements = {kinds[columns[0]]: elements}
    wrong = [kind for kind in elements if kind not in kinds.values()]
    if wrong or not elements:
        raise ValueError(f"elements must be of {', '.join(kinds.values())}, got {wrong or 'none'}")
    cells = {
        kind: node_numbers(nodes, "elements", len(coordinates), KINDS[kind].nodes)
        for kind, nodes in elements.items()
    }
    require_used(len(coordinates), list(cells.values()), "elements")
    return coordinates, cells
