"""Ties of nodes to the elements that contain them: interfaces with non-matching meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from .._checks import listing, plain_array
from ..problem.constraints import Constraint, require_two
from ..problem.dofs import dof_list
from ..problem.subdomain import Subdomain
from ..reduction.fixed_dofs import Reduction
from .mesh import SHAPES, Shape
from .sides import ROUNDING, Side, checked_sides, constraint_of, tolerance, tree_of, warn_of_near

__all__ = ["interpolate"]


_CELLS = {name: SHAPES[name] for name in ("line", "triangle", "quad", "tetra", "hexahedron")}


def inside(cell: Shape, xi: np.ndarray) -> np.ndarray:
    """xi, moved into the box or the simplex where it is outside."""
    xi = np.clip(xi, 0.0, 1.0)
    box = len(cell.nodes) == 2 ** xi.shape[1]
    return xi if box else xi / np.maximum(xi.sum(axis=1, keepdims=True), 1.0)


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of one kind: nodes (m, k), coordinates of these (m, k, d), centres and radii."""

    cell: Shape
    nodes: np.ndarray
    points: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


def checked_elements(value: Any, side: Side, kind: str | None) -> Elements:
    """The elements given by a user, checked."""
    nodes = np.asarray(value)
    if nodes.dtype.kind not in "iu" or nodes.ndim != 2:
        raise TypeError(f"elements_b must be a 2-D array of whole numbers, got {value!r}")
    cell = _cell(kind, nodes.shape, side.points.shape[1])
    outside = nodes[(nodes < 0) | (nodes >= len(side.points))]
    if outside.size:
        raise ValueError(
            f"elements_b must lie in 0..{len(side.points) - 1}, got {listing(outside)}"
        )
    nodes = nodes.astype(np.int64)
    points = side.points[nodes]
    centre = points.mean(axis=1)
    radius = np.linalg.norm(points - centre[:, None, :], axis=-1).max(axis=1)
    _require_proper(cell, points, radius)
    return Elements(cell, nodes, points, centre, radius)


def _cell(kind: str | None, shape: tuple[int, ...], dimension: int) -> Shape:
    if kind is not None and (not isinstance(kind, str) or kind not in _CELLS):
        raise ValueError(f"cell must be one of {listing([repr(c) for c in _CELLS])}, got {kind!r}")
    fitting = [
        name
        for name, c in _CELLS.items()
        if c.nodes.shape[0] == shape[1] and c.nodes.shape[1] <= dimension
    ]
    if shape[0] == 0 or not fitting:
        raise ValueError(
            f"elements_b must be lines, triangles, quads, tetrahedra or hexahedra with corner "
            f"nodes only, in {dimension}-D, got shape {shape}"
        )
    if kind is None and len(fitting) > 1:
        raise ValueError(f"cell must be {' or '.join(fitting)} for elements_b of {shape}, got None")
    if kind is not None and kind not in fitting:
        raise ValueError(
            f"cell must fit elements_b of shape {shape} in {dimension}-D, got {kind!r}"
        )
    return _CELLS[fitting[0] if kind is None else kind]


def _require_proper(cell: Shape, points: np.ndarray, radius: np.ndarray) -> None:
    """ValueError unless the map from xi keeps its orientation at all corners."""
    size = np.stack([_measure(jacobian(cell, xi, points)) for xi in cell.nodes], axis=1)
    if size.ndim == 3:  # normals of a surface: their component along the mean normal
        mean = size.mean(axis=1, keepdims=True)
        size = (size * mean).sum(axis=2) / np.maximum(
            np.linalg.norm(mean, axis=-1), np.finfo(float).tiny
        )
    size *= np.sign(size.sum(axis=1, keepdims=True))
    smallest = 1e-12 * radius ** cell.nodes.shape[1]
    wrong = np.flatnonzero(~(size > smallest[:, None]).all(axis=1))
    if wrong.size:
        raise ValueError(
            "elements_b must be convex, numbered around and not flat, got elements "
            f"{listing(wrong)} that are not"
        )


def jacobian(cell: Shape, xi: np.ndarray, points: np.ndarray) -> np.ndarray:
    """dx / dxi (m, dimension, d) of the elements, at one xi (d,) or at one for each (m, d)."""
    result: np.ndarray = points.transpose(0, 2, 1) @ cell.slopes(np.atleast_2d(xi))
    return result


def _measure(J: np.ndarray) -> np.ndarray:
    """Length, signed area or volume (m,), or the normals (m, 3) of a surface in space."""
    dimension, d = J.shape[1:]
    measure: np.ndarray
    if d == 1:
        measure = np.linalg.norm(J[:, :, 0], axis=-1)
    elif d == dimension:
        measure = np.linalg.det(J)
    else:
        measure = np.cross(J[:, :, 0], J[:, :, 1])
    return measure


def interpolate(
    a: Subdomain | str,
    points_a: Any,
    b: Subdomain | str,
    points_b: Any,
    elements_b: Any,
    *,
    cell: str | None = None,
    nodes_a: Any = None,
    components: int = 1,
    dofs_per_node: int | Mapping[Subdomain, int] | Mapping[str, int] | None = None,
    tol: float | None = None,
    reduced: Mapping[Subdomain, Reduction] | Mapping[str, Reduction] | None = None,
) -> Constraint:
    """Tie nodes of one subdomain to the elements of another that contain them.

    Node i of a, inside an element of b with shape functions N_j, has the velocity of that element:
    :math:`v_a(i) - sum_j N_j v_b(j) = 0` for each component, a row for each in the order of the
    nodes.

    Take the finer side as a: all of its interface nodes are then tied, and no gap can open. With
    the coarser side as a, the nodes of b between the nodes of a are free. For any meshes, the
    forces of the multipliers on the two sides are in equilibrium (resultant and moment), and
    velocities that are linear in space are transferred exactly. A constant stress is transferred
    exactly where the mesh of a refines that of b on the interface (every node of b is one of a),
    and elsewhere with an error that decreases with the mesh size.

    Parameters
    ----------
    a : Subdomain or str
        The side whose nodes are tied, or its name.
    points_a : (N,) or (N, d) array
        The coordinates of all its nodes, d = 1, 2 or 3.
    b : Subdomain or str
        The side to whose elements they are tied, or its name.
    points_b : (N,) or (N, d) array
        The coordinates of all nodes of b, in the system and the unit of `points_a`.
    elements_b : (m, k) array of int
        The nodes of elements of b, numbers into `points_b`: the edges or faces on the interface,
        or cells. Quadrilaterals are numbered around, convex; hexahedra with one face around, then
        the opposite one likewise.
    cell : {"line", "triangle", "quad", "tetra", "hexahedron"}, optional
        Kind of the elements. Default: by their number of nodes; required for 4 nodes in space,
        which a quad and a tetra have.
    nodes_a : array of int, optional
        The nodes of a to tie, each of which must be in an element. Default: all that are.
    components, dofs_per_node : optional
        As for `tie_coincident`.
    tol : float, optional
        A node at up to this distance from an element is tied to a point of it at that distance or
        less. Default: as for `tie_coincident`, 0.01 of the smallest distance between two nodes of
        one subdomain. Across a gap, rotations are transferred with an error of its size.
    reduced : dict, optional
        As for `tie_coincident`. A fixed dof has no entry in its constraint; a constraint on fixed
        dofs only is left out.

    Returns
    -------
    Constraint
        A node on the border of elements is tied to that of the lowest number; a node on a node of b
        has the weight 1 there and no other.

    Raises
    ------
    TypeError, ValueError
        As `tie_coincident`; for elements that are flat, not convex or numbered crosswise; nodes
        of `nodes_a` in no element; no node in any.

    Warns
    -----
    ConstraintWarning
        With neither `tol` nor `nodes_a` given, when nodes closer than ten times the tolerance are
        not tied.

    Examples
    --------
    Three nodes on an edge with two:

    >>> fine = Subdomain(np.ones(3), np.ones(3), scheme=GeneralizedAlpha(0.5))
    >>> coarse = Subdomain(np.ones(2), np.ones(2), scheme=GeneralizedAlpha(0.5))
    >>> points = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 4.0]])
    >>> tied = interpolate(fine, points, coarse, points[[0, 2]], [[0, 1]])
    >>> tied.matrices[coarse].toarray().tolist()
    [[-1.0, 0.0], [-0.75, -0.25], [0.0, -1.0]]
    """
    require_two(a, b)
    points: dict[Subdomain | str, Any] = {a: points_a, b: points_b}
    sides = checked_sides(points, components, dofs_per_node, reduced)
    of_a, of_b = sides
    elements = checked_elements(elements_b, of_b, cell)
    chosen = None
    if nodes_a is not None:
        chosen = dof_list(plain_array(nodes_a, "nodes_a"), len(of_a.points), "nodes_a")
    if chosen is not None and not chosen.size:
        raise ValueError("nodes_a must not be empty")
    tied, element, weights = _located(of_a, of_b, elements, chosen, tol)

    corners = elements.nodes[element]  # (q, k)
    count, size = of_a.columns.shape[1], corners.shape[1]
    row = np.arange(len(tied) * count).reshape(-1, count)
    values = np.broadcast_to(-weights[:, :, None], (len(tied), size, count))
    rows_b = np.broadcast_to(row[:, None, :], values.shape)
    entries_a = (row.ravel(), of_a.columns[tied].ravel(), np.ones(row.size))
    entries_b = (rows_b.ravel(), of_b.columns[corners].ravel(), values.ravel())
    return constraint_of(sides, [entries_a, entries_b], row.size)


def _located(
    a: Side, b: Side, elements: Elements, chosen: np.ndarray | None, tol: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of a that are tied (q,), the element of each (q,) and its weights there (q, k)."""
    nodes = np.arange(len(a.points)) if chosen is None else chosen
    reach, near = tolerance(tol, (a, b))
    if reach > elements.radius.max():
        raise ValueError(f"tol must be less than the size of the elements, got {reach:g}")
    which, element = _candidates(a.points[nodes], elements, near)
    xi, distance = _projected(elements.cell, elements.points[element], a.points[nodes[which]])

    # rounding of the coordinates, and of operations with the size of the element
    rounding = ROUNDING * (elements.radius[element] + np.abs(b.points).max())
    nearest = np.full(len(nodes), np.inf)
    np.minimum.at(nearest, which, distance)
    close = np.flatnonzero((distance <= reach) & (distance <= nearest[which] + rounding))
    close = close[np.lexsort((element[close], which[close]))]
    rows, first = np.unique(which[close], return_index=True)
    close = close[first]

    if chosen is not None and len(rows) < len(nodes):
        _refuse_outside(a, b, elements, np.delete(nodes, rows), reach)
    if not rows.size:
        _refuse_apart(a, b, elements, reach)
    if chosen is None:
        warn_of_near((nearest > reach) & (nearest <= near), reach, near)
    weights = elements.cell.values(xi[close])
    weights[weights <= (rounding[close] / elements.radius[element[close]])[:, None]] = 0.0
    return nodes[rows], element[close], weights / weights.sum(axis=1, keepdims=True)


def _candidates(
    points: np.ndarray, elements: Elements, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a point and an element whose distance may be up to `reach`."""
    balls = tree_of(points).query_ball_point(
        elements.centre, (elements.radius + reach) * (1.0 + ROUNDING)
    )
    counts = [len(ball) for ball in balls]
    which = np.concatenate([np.asarray(ball, dtype=np.int64) for ball in balls])
    return which, np.repeat(np.arange(len(counts)), counts)


def _projected(
    cell: Shape, points: np.ndarray, targets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """xi (q, d) of the point of each element nearest to its target, and the distance (q,).

    By Gauss-Newton iteration; zero up to rounding for a target in the element. Coordinates relative
    to the first node of the element avoid rounding errors far from the origin.
    """
    origin = points[:, :1]
    points, targets = points - origin, targets - origin[:, 0]
    xi = np.tile(cell.nodes.mean(axis=0), (len(targets), 1))
    active = np.arange(len(targets))
    for _ in range(50):
        at = xi[active]
        J = jacobian(cell, at, points[active])
        left = targets[active] - _mapped(cell, at, points[active])
        transposed = J.transpose(0, 2, 1)
        step = np.linalg.solve(transposed @ J, transposed @ left[:, :, None])[:, :, 0]
        xi[active] = inside(cell, at + step)
        # quadratic convergence: after an increment of 1e-9 the next one is below rounding
        active = active[np.abs(xi[active] - at).max(axis=1) > 1e-9]
        if not active.size:
            break
    return xi, np.linalg.norm(targets - _mapped(cell, xi, points), axis=-1)


def _mapped(cell: Shape, xi: np.ndarray, points: np.ndarray) -> np.ndarray:
    """x = sum_j N_j(xi) x_j."""
    result: np.ndarray = np.einsum("qk,qkx->qx", cell.values(xi), points)
    return result


def _refuse_outside(
    a: Side, b: Side, elements: Elements, missing: np.ndarray, reach: float
) -> NoReturn:
    corners = b.points[np.unique(elements.nodes)]
    distance = tree_of(corners).query(a.points[missing[0]])[0]
    raise ValueError(
        f"nodes_a must lie in an element of b, up to {reach:g}, got nodes {listing(missing)} "
        f"outside; the nearest node of an element is {distance:g} away from node {missing[0]}"
    )


def _refuse_apart(a: Side, b: Side, elements: Elements, reach: float) -> NoReturn:
    corners = b.points[np.unique(elements.nodes)]
    distance = tree_of(corners).query(a.points)[0].min()
    raise ValueError(
        f"points_a must have a node in an element of b, up to {reach:g}, got none; the smallest "
        f"distance from a node to one of an element is {distance:g}"
    )
