"""Ties found from where the nodes lie: interfaces that match, and interfaces that do not."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .._checks import listing, real_array, real_number, whole_number
from ..errors import ConstraintWarning
from .constraints import Constraint, dof_list
from .reduction import Reduction
from .subdomain import Subdomain

__all__ = ["interpolate", "tie_coincident"]

# The default tolerance as a part of the smallest distance between two nodes of one subdomain:
# far above what a mesh file rounds off, far below what a mesh means. What lies further apart,
# up to NEAR of that distance, is taken for a mesh that is not drawn to its tolerance.
TOLERANCE = 0.01
NEAR = 0.1
# Nodes of one subdomain no further apart than this part of its extent lie at one place.
ONE_PLACE = 1e-9
# What a few operations leave of numbers of size 1.
ROUNDING = 64 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class _Side:
    """A subdomain with its points (N, d), and columns (N, components), -1 at fixed dofs."""

    subdomain: Subdomain
    points: np.ndarray
    columns: np.ndarray


# Entries of one side in the conditions: rows, columns (-1 is none) and values.
_Entries = tuple[np.ndarray, np.ndarray, np.ndarray]


# ---- interfaces that match -------------------------------------------------------------------


def tie_coincident(
    points: Mapping[Subdomain, Any],
    components: int = 1,
    dofs_per_node: int | Mapping[Subdomain, int] | None = None,
    tol: float | None = None,
    *,
    reduced: Mapping[Subdomain, Reduction] | None = None,
) -> Constraint:
    """Tie all nodes that lie at the same place in two or more subdomains, each once.

    Where k subdomains meet there are k - 1 conditions for each component: the first of them, in
    the order of `points`, against each of the others, +1 on the earlier and -1 on the later. So
    the multiplier of a row is minus the force on the later subdomain. Rows are ordered by the
    earlier subdomain, its node, the later subdomain, the component.

    Parameters
    ----------
    points : dict
        The coordinates of all nodes of two or more subdomains, (N,) on a line or (N, d) with
        d = 1, 2 or 3, in one system and one unit.
    components : int, default 1
        Component c < components of node i is dof ``dofs_per_node * i + c``; these are tied.
    dofs_per_node : int or dict by subdomain, optional
        A dict where the subdomains differ, such as 3 for a frame (u, w, rotation) beside 2 for a
        plate. Default: `components`.
    tol : float, optional
        Nodes up to this distance apart lie at the same place, in the unit of the points. Default:
        0.01 of the smallest distance between two nodes of one subdomain (nodes drawn at one place
        left out), of all subdomains; 0 if none has two nodes.
    reduced : dict, optional
        The `Reduction` of each subdomain that was made of reduced matrices; `points` then has the
        fixed nodes too. A dof that is fixed on one side holds the others: their velocity is 0.

    Returns
    -------
    Constraint
        p = the sum of (k - 1) over places and components, none redundant.

    Raises
    ------
    TypeError, ValueError
        For points that are not finite, of different dimensions, or not as many as the dofs say; a
        tolerance that merges nodes of one subdomain; a subdomain that meets none of the others.

    Warns
    -----
    ConstraintWarning
        With the default tolerance, when nodes are left apart that are closer than ten times it.

    Examples
    --------
    Two squares of four nodes with two components, side by side; two nodes meet:

    >>> points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    >>> left = Subdomain(np.ones(8), np.ones(8), scheme=GeneralizedAlpha(0.5))
    >>> right = Subdomain(np.ones(8), np.ones(8), scheme=GeneralizedAlpha(0.5))
    >>> tied = tie_coincident({left: points, right: points + [1.0, 0.0]}, components=2)
    >>> [tied.matrices[s].nonzero()[1].tolist() for s in (left, right)]
    [[2, 3, 6, 7], [0, 1, 4, 5]]
    """
    sides = _sides(points, components, dofs_per_node, reduced)
    if len(sides) < 2:
        raise ValueError(f"points must have two or more subdomains, got {len(sides)}")
    nodes, group = _coincident(sides, tol)
    rows, p = _pairwise(sides, nodes, group)
    return _constraint(sides, rows, p)


def _coincident(sides: Sequence[_Side], tol: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that meet one of another side, and the number of their place, sorted by place, node.

    Nodes are numbered through all sides here. Two belong to one place when a chain of steps of at
    most the tolerance, from side to side, connects them.
    """
    reach, near = _tolerance(tol, sides)
    pairs, distance = _close_pairs(sides, near)
    tied = pairs[distance <= reach]
    label = _components(tied, _starts(sides)[-1])
    nodes = _marked(tied, len(label))
    _require_touch(sides, nodes, reach)
    nodes = nodes[np.lexsort((nodes, label[nodes]))]
    group = np.cumsum(np.diff(label[nodes], prepend=label[nodes[0]]) != 0)
    _require_no_merger(sides, nodes, group, reach)
    if tol is not None:
        _require_apart(sides, nodes, reach)
    _warn_of_near(label[pairs[:, 0]] != label[pairs[:, 1]], reach, near)
    return nodes, group


def _close_pairs(sides: Sequence[_Side], reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (k, 2) of nodes of different sides within reach, and their distances (k,).

    Of the nodes of a later side, each node of an earlier one is paired with the nearest two at
    most: a second one is a merger already, however many there are.
    """
    start = _starts(sides)
    low = np.array([s.points.min(axis=0) for s in sides]) - reach
    high = np.array([s.points.max(axis=0) for s in sides]) + reach
    pairs, distances = [np.empty((0, 2), dtype=np.int64)], [np.empty(0)]
    for i, one in enumerate(sides):
        overlap = ((low[i] <= high) & (low <= high[i])).all(axis=1)
        for j in (np.flatnonzero(overlap[i + 1 :]) + i + 1).tolist():
            mine = _inside(one.points, low[j], high[j])
            its = _inside(sides[j].points, low[i], high[i])
            if not (mine.size and its.size):
                continue
            # the bound is exclusive, and compared in squares
            distance, index = _tree(sides[j].points[its]).query(
                one.points[mine], k=2, distance_upper_bound=reach * (1.0 + ROUNDING) + 1e-150
            )
            found = np.nonzero(distance <= reach)
            pairs.append(np.column_stack([mine[found[0]] + start[i], its[index[found]] + start[j]]))
            distances.append(distance[found])
    return np.concatenate(pairs), np.concatenate(distances)


def _inside(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The points in a box."""
    return np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))


def _components(pairs: np.ndarray, n: int) -> np.ndarray:
    """For each of n nodes the number of its connected component."""
    graph = sp.coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), (n, n))
    return connected_components(graph, directed=False)[1]


def _pairwise(
    sides: Sequence[_Side], nodes: np.ndarray, group: np.ndarray
) -> tuple[list[_Entries], int]:
    """The conditions of each place and component: one node, the hub, against each of the others.

    The hub is the first node, or a fixed one if there is any, against which the free ones are held.
    """
    member = np.arange(len(nodes))
    start = _starts(sides)
    column = np.concatenate([s.columns for s in sides])[nodes]  # (members, components)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    fixed = np.minimum.reduceat(np.where(column < 0, member[:, None], len(nodes)), first)
    hub = np.where(fixed < len(nodes), fixed, first[:, None])[group]
    other, component = np.nonzero((column >= 0) & (hub != member[:, None]))
    hub = hub[other, component]

    early, late = np.minimum(hub, other), np.maximum(hub, other)
    order = np.lexsort((component, nodes[late], nodes[early]))
    early, late, component = early[order], late[order], component[order]
    rows = np.arange(len(order))
    entries = []
    for begin, end in zip(start, start[1:]):
        of = [(nodes[x] >= begin) & (nodes[x] < end) for x in (early, late)]
        columns = [column[x[own], component[own]] for x, own in zip((early, late), of)]
        signs = [np.full(len(c), sign) for c, sign in zip(columns, (1.0, -1.0))]
        row = [rows[own] for own in of]
        entries.append((np.concatenate(row), np.concatenate(columns), np.concatenate(signs)))
    return entries, len(rows)


def _require_touch(sides: Sequence[_Side], nodes: np.ndarray, reach: float) -> None:
    """ValueError for a side that meets no other."""
    alone = np.setdiff1d(np.arange(len(sides)), _side_of(sides, nodes))
    if not alone.size:
        return
    s = sides[alone[0]]
    others = np.concatenate([other.points for other in sides if other is not s])
    distance = _tree(others).query(s.points)[0].min()
    raise ValueError(
        f"points must have nodes of every subdomain at the same place as one of another, up to "
        f"{reach:g}, got none of {s.subdomain!r}; its smallest distance to another is {distance:g}"
    )


def _require_no_merger(
    sides: Sequence[_Side], nodes: np.ndarray, group: np.ndarray, reach: float
) -> None:
    """ValueError where two nodes of one side belong to one place."""
    side = _side_of(sides, nodes)
    twice = np.flatnonzero((group[1:] == group[:-1]) & (side[1:] == side[:-1]))
    if twice.size:
        k = twice[0]
        _refuse_merger(sides[side[k]], nodes[[k, k + 1]] - _starts(sides)[side[k]], reach)


def _require_apart(sides: Sequence[_Side], nodes: np.ndarray, reach: float) -> None:
    """ValueError for a tied node that has another of its own side within the tolerance."""
    for side, begin, end in zip(sides, _starts(sides), _starts(sides)[1:]):
        own = np.sort(nodes[(nodes >= begin) & (nodes < end)]) - begin
        distance, index = _tree(side.points).query(side.points[own], k=2)
        close = np.flatnonzero(distance[:, 1] <= reach)
        if close.size:
            _refuse_merger(side, np.sort(index[close[0]]), reach)


def _refuse_merger(side: _Side, nodes: np.ndarray, reach: float) -> NoReturn:
    i, j = (int(k) for k in nodes)
    raise ValueError(
        f"tol must not merge nodes of one subdomain, got {reach:g}: nodes {i} and {j} of "
        f"{side.subdomain!r} lie {_length(side.points[i] - side.points[j]):g} apart"
    )


def _starts(sides: Sequence[_Side]) -> np.ndarray:
    """The first node of each side, counted through all, and the number of all."""
    return np.cumsum([0] + [len(s.points) for s in sides])


def _side_of(sides: Sequence[_Side], nodes: np.ndarray) -> np.ndarray:
    return np.searchsorted(_starts(sides), nodes, side="right") - 1


# ---- interfaces that do not match ------------------------------------------------------------


def interpolate(
    a: Subdomain,
    points_a: Any,
    b: Subdomain,
    points_b: Any,
    elements_b: Any,
    *,
    cell: str | None = None,
    nodes_a: Any = None,
    components: int = 1,
    dofs_per_node: int | Mapping[Subdomain, int] | None = None,
    tol: float | None = None,
    reduced: Mapping[Subdomain, Reduction] | None = None,
) -> Constraint:
    """Tie nodes of one subdomain to the elements of another in which they lie.

    Node i of a, inside an element of b with shape functions N_j, follows that element:
    v_a(i) - sum_j N_j v_b(j) = 0 for each component, a row for each in the order of the nodes.

    Take the finer side as a: each of its interface nodes is then held, and opens nowhere. With
    the coarser side as a, the nodes of b between those of a are left free. What the multipliers do
    to the two sides is in balance, force and moment, for any meshes. Velocities that are linear
    in space pass exactly for any meshes too; a stress that is constant in space does where the
    mesh of a refines that of b on the interface (every node of b is one of a), and up to an error
    that falls with the mesh size where it does not.

    Parameters
    ----------
    a, b : Subdomain
        Two different ones.
    points_a, points_b : (N,) or (N, d) array
        The coordinates of all nodes of each, d = 1, 2 or 3, in one system and one unit.
    elements_b : (m, k) array of int
        The nodes of elements of b, numbers into `points_b`: the edges or faces on the interface,
        or cells. Quadrilaterals are numbered around, convex; hexahedra with one face around, then
        the opposite one likewise.
    cell : {"line", "triangle", "quad", "tetra", "hexahedron"}, optional
        What the elements are. Default: what their number of nodes says; with 4 in space, where a
        quad and a tetra have as many, it must be said.
    nodes_a : array of int, optional
        The nodes of a to tie, each of which must lie in an element. Default: all that do.
    components, dofs_per_node, reduced
        As for `tie_coincident`. A fixed dof of b has no entry, a fixed dof of a leaves the
        condition to b alone, and where all are fixed there is none.
    tol : float, optional
        A node up to this far from an element lies in it, and follows a point of it no further
        away. Default: as for `tie_coincident`, 0.01 of the smallest distance between two nodes of
        one subdomain. Across a gap, rotations are transferred with an error of its size.

    Returns
    -------
    Constraint
        A node on the border of elements follows that of the lowest number; one that lies on a
        node of b has the weight 1 there and no other.

    Raises
    ------
    TypeError, ValueError
        As `tie_coincident`; for elements that are flat, not convex or numbered crosswise; nodes
        of `nodes_a` in no element; no node in any.

    Warns
    -----
    ConstraintWarning
        With neither `tol` nor `nodes_a` given, when nodes are left out that are closer than ten
        times the tolerance.

    Examples
    --------
    Three nodes on an edge of two:

    >>> fine = Subdomain(np.ones(3), np.ones(3), scheme=GeneralizedAlpha(0.5))
    >>> coarse = Subdomain(np.ones(2), np.ones(2), scheme=GeneralizedAlpha(0.5))
    >>> points = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 4.0]])
    >>> tied = interpolate(fine, points, coarse, points[[0, 2]], [[0, 1]])
    >>> tied.matrices[coarse].toarray().tolist()
    [[-1.0, 0.0], [-0.75, -0.25], [0.0, -1.0]]
    """
    if a is b:
        raise ValueError(f"a and b must be two different subdomains, got {a!r} twice")
    sides = _sides({a: points_a, b: points_b}, components, dofs_per_node, reduced)
    of_a, of_b = sides
    elements = _elements(elements_b, of_b, cell)
    chosen = None if nodes_a is None else dof_list(nodes_a, len(of_a.points), "nodes_a")
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
    return _constraint(sides, [entries_a, entries_b], row.size)


@dataclass(frozen=True, eq=False)
class _Cell:
    """An element in reference coordinates xi: the box [0, 1]^d, or the simplex in it."""

    corners: np.ndarray  # (k, d)
    box: bool

    def weights(self, xi: np.ndarray) -> np.ndarray:
        """N (q, k) at xi (q, d)."""
        if self.box:
            return self._factors(xi).prod(axis=2)
        return np.column_stack([1.0 - xi.sum(axis=1), xi])

    def slopes(self, xi: np.ndarray) -> np.ndarray:
        """dN / dxi (q, k, d) at xi (q, d)."""
        d = self.corners.shape[1]
        if not self.box:
            return np.broadcast_to(np.vstack([-np.ones(d), np.eye(d)]), (len(xi), d + 1, d))
        factors = self._factors(xi)
        others = [np.delete(factors, axis, axis=2).prod(axis=2) for axis in range(d)]
        return (2.0 * self.corners - 1.0) * np.stack(others, axis=2)

    def inside(self, xi: np.ndarray) -> np.ndarray:
        """xi, brought back into the element where it lies outside."""
        xi = np.clip(xi, 0.0, 1.0)
        return xi if self.box else xi / np.maximum(xi.sum(axis=1, keepdims=True), 1.0)

    def _factors(self, xi: np.ndarray) -> np.ndarray:
        """(q, k, d): N is their product over d."""
        return np.where(self.corners == 1.0, xi[:, None, :], 1.0 - xi[:, None, :])


def _simplex(d: int) -> _Cell:
    return _Cell(np.vstack([np.zeros(d), np.eye(d)]), box=False)


_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_CUBE = np.vstack([np.insert(_SQUARE, 2, z, axis=1) for z in (0.0, 1.0)])
_CELLS = {
    "line": _Cell(np.array([[0.0], [1.0]]), box=True),
    "triangle": _simplex(2),
    "quad": _Cell(_SQUARE, box=True),
    "tetra": _simplex(3),
    "hexahedron": _Cell(_CUBE, box=True),
}


@dataclass(frozen=True, eq=False)
class _Elements:
    """Elements of one kind: their nodes (m, k), coordinates (m, k, d), centres and radii."""

    cell: _Cell
    nodes: np.ndarray
    places: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


def _elements(value: Any, side: _Side, kind: str | None) -> _Elements:
    """The checked elements of a user."""
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
    places = side.points[nodes]
    centre = places.mean(axis=1)
    radius = _length(places - centre[:, None, :]).max(axis=1)
    _require_proper(cell, places, radius)
    return _Elements(cell, nodes, places, centre, radius)


def _cell(kind: str | None, shape: tuple[int, ...], dimension: int) -> _Cell:
    if kind is not None and (not isinstance(kind, str) or kind not in _CELLS):
        raise ValueError(f"cell must be one of {listing([repr(c) for c in _CELLS])}, got {kind!r}")
    fitting = [
        name
        for name, c in _CELLS.items()
        if c.corners.shape[0] == shape[1] and c.corners.shape[1] <= dimension
    ]
    if shape[0] == 0 or not fitting:
        raise ValueError(
            f"elements_b must be lines, triangles, quads, tetrahedra or hexahedra with corner "
            f"nodes only, in {dimension}-D, got shape {shape}"
        )
    if kind is None and len(fitting) > 1:
        raise ValueError(f"cell must be said, {' or '.join(fitting)}, for elements_b of {shape}")
    if kind is not None and kind not in fitting:
        raise ValueError(
            f"cell must fit elements_b of shape {shape} in {dimension}-D, got {kind!r}"
        )
    return _CELLS[fitting[0] if kind is None else kind]


def _require_proper(cell: _Cell, places: np.ndarray, radius: np.ndarray) -> None:
    """ValueError unless the map from xi keeps its orientation at all corners."""
    size = np.stack([_measure(_jacobian(cell, xi, places)) for xi in cell.corners], axis=1)
    if size.ndim == 3:  # normals of a surface: their part along the mean one
        mean = size.mean(axis=1, keepdims=True)
        size = (size * mean).sum(axis=2) / np.maximum(_length(mean), np.finfo(float).tiny)
    size *= np.sign(size.sum(axis=1, keepdims=True))
    smallest = 1e-12 * radius ** cell.corners.shape[1]
    wrong = np.flatnonzero(~(size > smallest[:, None]).all(axis=1))
    if wrong.size:
        raise ValueError(
            "elements_b must be convex, numbered around and not flat, got elements "
            f"{listing(wrong)} that are not"
        )


def _jacobian(cell: _Cell, xi: np.ndarray, places: np.ndarray) -> np.ndarray:
    """dx / dxi (m, dimension, d) of all elements at one xi (d,), or each at its own (m, d)."""
    return places.transpose(0, 2, 1) @ cell.slopes(np.atleast_2d(xi))


def _measure(J: np.ndarray) -> np.ndarray:
    """Length, signed area or volume (m,), or the normals (m, 3) of a surface in space."""
    dimension, d = J.shape[1:]
    if d == 1:
        return _length(J[:, :, 0])
    if d == dimension:
        return np.linalg.det(J)
    return np.cross(J[:, :, 0], J[:, :, 1])


def _located(
    a: _Side, b: _Side, elements: _Elements, chosen: np.ndarray | None, tol: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of a that are tied (q,), the element of each (q,) and its weights there (q, k)."""
    nodes = np.arange(len(a.points)) if chosen is None else chosen
    reach, near = _tolerance(tol, (a, b))
    if reach > elements.radius.max():
        raise ValueError(f"tol must be less than the size of the elements, got {reach:g}")
    which, element = _candidates(a.points[nodes], elements, near)
    xi, distance = _projected(elements.cell, elements.places[element], a.points[nodes[which]])

    # coordinates as they are stored, and the element they are compared in
    rounding = ROUNDING * (elements.radius[element] + np.abs(b.points).max())
    nearest = np.full(len(nodes), np.inf)
    np.minimum.at(nearest, which, distance)
    held = np.flatnonzero((distance <= reach) & (distance <= nearest[which] + rounding))
    held = held[np.lexsort((element[held], which[held]))]
    found, first = np.unique(which[held], return_index=True)
    held = held[first]

    if chosen is not None and len(found) < len(nodes):
        _refuse_outside(a, b, elements, np.delete(nodes, found), reach)
    if not found.size:
        _refuse_apart(a, b, elements, reach)
    if chosen is None:
        _warn_of_near((nearest > reach) & (nearest <= near), reach, near)
    snap = rounding[held] / elements.radius[element[held]]
    return nodes[found], element[held], _snapped(elements.cell.weights(xi[held]), snap)


def _candidates(
    points: np.ndarray, elements: _Elements, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a point and an element that may be within reach of each other."""
    balls = _tree(points).query_ball_point(
        elements.centre, (elements.radius + reach) * (1.0 + ROUNDING)
    )
    counts = [len(ball) for ball in balls]
    which = np.concatenate([np.asarray(ball, dtype=np.int64) for ball in balls])
    return which, np.repeat(np.arange(len(counts)), counts)


def _projected(
    cell: _Cell, places: np.ndarray, targets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """xi (q, d) in each element near each target, and the distance left (q,), by Gauss-Newton.

    A target in the element is met up to rounding. Coordinates are taken from the first node, so
    that those of a mesh far from the origin lose nothing more.
    """
    origin = places[:, :1]
    places, targets = places - origin, targets - origin[:, 0]
    xi = np.tile(cell.corners.mean(axis=0), (len(targets), 1))
    active = np.arange(len(targets))
    for _ in range(50):
        at = xi[active]
        J = _jacobian(cell, at, places[active])
        gap = targets[active] - _place(cell, at, places[active])
        transposed = J.transpose(0, 2, 1)
        step = np.linalg.solve(transposed @ J, transposed @ gap[:, :, None])[:, :, 0]
        xi[active] = cell.inside(at + step)
        # quadratic: the step after one of 1e-9 is below rounding
        active = active[np.abs(xi[active] - at).max(axis=1) > 1e-9]
        if not active.size:
            break
    return xi, _length(targets - _place(cell, xi, places))


def _place(cell: _Cell, xi: np.ndarray, places: np.ndarray) -> np.ndarray:
    """x = sum_j N_j(xi) x_j."""
    return np.einsum("qk,qkx->qx", cell.weights(xi), places)


def _snapped(weights: np.ndarray, smallest: np.ndarray) -> np.ndarray:
    """Weights without those that are rounding; the others again of sum 1."""
    weights = np.where(weights <= smallest[:, None], 0.0, weights)
    return weights / weights.sum(axis=1, keepdims=True)


def _refuse_outside(
    a: _Side, b: _Side, elements: _Elements, missing: np.ndarray, reach: float
) -> NoReturn:
    corners = b.points[np.unique(elements.nodes)]
    distance = _tree(corners).query(a.points[missing[0]])[0]
    raise ValueError(
        f"nodes_a must lie in an element of b, up to {reach:g}, got nodes {listing(missing)} "
        f"outside; the nearest node of an element is {distance:g} away from node {missing[0]}"
    )


def _refuse_apart(a: _Side, b: _Side, elements: _Elements, reach: float) -> NoReturn:
    corners = b.points[np.unique(elements.nodes)]
    distance = _tree(corners).query(a.points)[0].min()
    raise ValueError(
        f"points_a must have a node in an element of b, up to {reach:g}, got none; the smallest "
        f"distance from a node to one of an element is {distance:g}"
    )


# ---- what both have in common ----------------------------------------------------------------


def _sides(points: Any, components: Any, dofs_per_node: Any, reduced: Any) -> list[_Side]:
    """The arguments of a user, checked and brought together by subdomain."""
    if not isinstance(points, Mapping):
        raise TypeError(f"points must be a dict of coordinates by subdomain, got {points!r}")
    for s in points:
        if not isinstance(s, Subdomain):
            raise TypeError(f"points must be of Subdomains, got {s!r}")
    reduced = {} if reduced is None else reduced
    if not isinstance(reduced, Mapping):
        raise TypeError(f"reduced must be a dict of Reductions by subdomain, got {reduced!r}")
    strangers = [s for s in reduced if s not in points]
    if strangers:
        raise ValueError(f"reduced must be of subdomains with points, got {listing(strangers)}")
    components = whole_number(components, "components", low=1)
    per_node = _per_node(dofs_per_node, points, components)
    sides = []
    for s, given in points.items():
        array = _coordinates(given, f"points of {s!r}")
        numbers = _numbers(s, len(array), per_node[s], reduced.get(s))
        sides.append(_Side(s, array, numbers[:, :components]))
    dimensions = {side.points.shape[1] for side in sides}
    if len(dimensions) > 1:
        got = [f"{side.points.shape[1]} of {side.subdomain!r}" for side in sides]
        raise ValueError(f"points must have one dimension, got {listing(got)}")
    return sides


def _per_node(value: Any, points: Mapping, components: int) -> dict[Subdomain, int]:
    if not isinstance(value, Mapping):
        value = {s: components if value is None else value for s in points}
    if set(value) != set(points):
        raise ValueError(
            f"dofs_per_node must name the subdomains of the points, got {listing(list(value))}"
        )
    numbers = {s: whole_number(k, "dofs_per_node", low=1) for s, k in value.items()}
    for s, number in numbers.items():
        if number < components:
            raise ValueError(
                f"components must be at most dofs_per_node, got {components} of {number} of {s!r}"
            )
    return numbers


def _coordinates(value: Any, name: str) -> np.ndarray:
    """(N, d), d up to 3."""
    array = real_array(value, name, (1, 2))
    array = array.reshape(len(array), -1) if array.size else array
    if array.size == 0 or array.shape[1] > 3:
        raise ValueError(f"{name} must have shape (N,) or (N, d), d = 1, 2, 3, got {array.shape}")
    return array


def _numbers(
    subdomain: Subdomain, nodes: int, per_node: int, reduction: Reduction | None
) -> np.ndarray:
    """The dof (nodes, per_node) of each node and component, -1 where it is fixed."""
    if reduction is not None:
        if not isinstance(reduction, Reduction):
            raise TypeError(f"reduced must hold Reductions, got {reduction!r} of {subdomain!r}")
        if reduction.free.size != subdomain.n:
            raise ValueError(f"reduced must hold what {subdomain!r} is made of, got {reduction!r}")
    n = subdomain.n if reduction is None else reduction.n
    if nodes * per_node != n:
        raise ValueError(
            f"points times dofs_per_node must be the dofs of {subdomain!r}, got {nodes} x "
            f"{per_node} for {n}{_hint(nodes, n, reduction)}"
        )
    numbers = np.arange(n)
    if reduction is not None:
        numbers[reduction.fixed] = -1
        numbers[reduction.free] = np.arange(subdomain.n)
    return numbers.reshape(nodes, per_node)


def _hint(nodes: int, n: int, reduction: Reduction | None) -> str:
    if n % nodes == 0:
        return f", which is {n // nodes} per node"
    return "" if reduction is not None else "; if dofs were fixed by reduce, say so with reduced"


def _tolerance(tol: float | None, sides: Sequence[_Side]) -> tuple[float, float]:
    """The distance up to which nodes are at one place, and that up to which they nearly are."""
    if tol is not None:
        reach = real_number(tol, "tol", low=0.0)
        return reach, reach
    spacing = min(_spacing(s.points) for s in sides)
    return (0.0, 0.0) if np.isinf(spacing) else (TOLERANCE * spacing, NEAR * spacing)


def _spacing(points: np.ndarray) -> float:
    """The smallest distance between two nodes at different places, infinite if there are none."""
    distance = _tree(points).query(points, k=2)[0][:, 1]
    return float(distance[distance > ONE_PLACE * np.ptp(points, axis=0).max()].min(initial=np.inf))


def _warn_of_near(missed: np.ndarray, reach: float, near: float) -> None:
    count = int(np.count_nonzero(missed))
    if count:
        warnings.warn(
            f"{count} nodes or pairs of nodes are not tied that lie further apart than the default "
            f"tolerance {reach:g} but no further than {near:g}; give tol to say what is meant",
            ConstraintWarning,
            stacklevel=4,
        )


def _tree(points: np.ndarray) -> cKDTree:
    # sliding midpoints: medians are slow where many nodes have equal coordinates
    return cKDTree(points, balanced_tree=False)


def _marked(numbers: np.ndarray, n: int) -> np.ndarray:
    """The numbers in 0..n-1 that occur, ascending."""
    mask = np.zeros(n, dtype=bool)
    mask[numbers] = True
    return np.flatnonzero(mask)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors * vectors).sum(axis=-1))


def _constraint(sides: Sequence[_Side], entries: Sequence[_Entries], p: int) -> Constraint:
    """The conditions without the fixed dofs, and without rows that have no other."""
    kept = [(columns >= 0) & (values != 0.0) for _, columns, values in entries]
    used = _marked(np.concatenate([rows[k] for k, (rows, _, _) in zip(kept, entries)]), p)
    if not used.size:
        raise ValueError("reduced must leave a dof to tie, got fixed ones only")
    place = np.empty(p, dtype=np.int64)
    place[used] = np.arange(used.size)
    matrices = {}
    for side, k, (rows, columns, values) in zip(sides, kept, entries):
        shape = (used.size, side.subdomain.n)
        matrices[side.subdomain] = sp.csr_array((values[k], (place[rows[k]], columns[k])), shape)
    return Constraint(matrices)
