"""Ties and contact of coincident nodes: interfaces with matching meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
import scipy.sparse as sp

from .._checks import real_array
from ..problem.constraints import Constraint
from ..problem.contacts import Contact
from ..problem.subdomain import Subdomain
from ..reduction.fixed_dofs import Reduction
from .sides import (
    ROUNDING,
    Entries,
    Side,
    checked_sides,
    constraint_of,
    tolerance,
    tree_of,
    warn_of_near,
)

__all__ = ["contact_coincident", "tie_coincident"]


def tie_coincident(
    points: Mapping[Subdomain, Any] | Mapping[str, Any],
    components: int = 1,
    dofs_per_node: int | Mapping[Subdomain, int] | Mapping[str, int] | None = None,
    tol: float | None = None,
    *,
    reduced: Mapping[Subdomain, Reduction] | Mapping[str, Reduction] | None = None,
) -> Constraint:
    """Tie all coincident nodes of two or more subdomains, each once.

    Where k subdomains meet there are k - 1 constraints for each component: between the first of
    them, in the order of `points`, and each of the others, +1 on the earlier and -1 on the later.
    So the multiplier of a row is minus the force on the later subdomain. Rows are ordered by the
    earlier subdomain, its node, the later subdomain, the component.

    Parameters
    ----------
    points : dict
        The coordinates of all nodes of two or more subdomains, (N,) on a line or (N, d) with
        d = 1, 2 or 3, in one system and one unit, by the subdomains or by their names, as then in
        `dofs_per_node` and `reduced`.
    components : int, default 1
        Component c < components of node i is dof ``dofs_per_node * i + c``; these are tied.
    dofs_per_node : int or dict by subdomain, optional
        A dict where the subdomains differ, such as 3 for a frame (u, w, rotation) and 2 for a
        plate. Default: `components`.
    tol : float, optional
        Nodes up to this distance apart are coincident, in the unit of the points. Default: 0.01 of
        the smallest distance between two nodes of one subdomain (coincident ones excepted), over
        all subdomains; 0 if no subdomain has two nodes.
    reduced : dict, optional
        The `Reduction` of each subdomain that was made of reduced matrices; `points` then includes
        the fixed nodes. Where a dof is fixed in one subdomain, the velocity of the others is 0.

    Returns
    -------
    Constraint
        Its p rows are the sum of (k - 1) over points and components, none redundant.

    Raises
    ------
    TypeError, ValueError
        For points that are not finite, of different dimensions, or whose number does not fit the
        dofs; a tolerance that merges nodes of one subdomain; a subdomain that meets no other.

    Warns
    -----
    ConstraintWarning
        With the default tolerance, when nodes closer than ten times the tolerance are not tied.

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
    sides = checked_sides(points, components, dofs_per_node, reduced)
    if len(sides) < 2:
        raise ValueError(f"points must have two or more subdomains, got {len(sides)}")
    nodes, group = _coincident(sides, tol)
    rows, p = _pairwise(sides, nodes, group)
    return constraint_of(sides, rows, p)


def coincident_nodes(sides: Sequence[Side], tol: float | None) -> np.ndarray:
    """Pairs (k, 2) of the coincident nodes of two sides, in rising order of the first."""
    nodes, _ = _coincident(sides, tol)
    pairs = nodes.reshape(-1, 2) - _starts(sides)[:2]
    ordered: np.ndarray = pairs[np.argsort(pairs[:, 0])]
    return ordered


def _coincident(sides: Sequence[Side], tol: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that meet one of another side, and the group of each, sorted by group and node.

    Nodes are numbered consecutively over all sides. Two belong to one group if a chain of nodes of
    alternating sides, at distances up to the tolerance, connects them.
    """
    from scipy.sparse.csgraph import connected_components

    reach, near = tolerance(tol, sides)
    pairs, distance = _close_pairs(sides, near)
    tied = pairs[distance <= reach]
    n = _starts(sides)[-1]
    graph = sp.coo_array((np.ones(len(tied), dtype=bool), (tied[:, 0], tied[:, 1])), (n, n))
    label = connected_components(graph, directed=False)[1]
    nodes = np.unique(tied)
    _require_touch(sides, nodes, reach)
    nodes = nodes[np.lexsort((nodes, label[nodes]))]
    group = np.cumsum(np.diff(label[nodes], prepend=label[nodes[0]]) != 0)
    _require_no_merger(sides, nodes, group, reach)
    if tol is not None:
        _require_apart(sides, nodes, reach)
    warn_of_near(label[pairs[:, 0]] != label[pairs[:, 1]], reach, near)
    return nodes, group


def _close_pairs(sides: Sequence[Side], reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (k, 2) of nodes of different sides within reach, and their distances (k,).

    Each node of an earlier side is paired with at most the nearest two nodes of a later one: a
    second one already is a merger.
    """
    start = _starts(sides)
    low = np.array([s.points.min(axis=0) for s in sides]) - reach
    high = np.array([s.points.max(axis=0) for s in sides]) + reach
    pairs, distances = [np.empty((0, 2), dtype=np.int64)], [np.empty(0)]
    for i, one in enumerate(sides):
        overlap = ((low[i] <= high) & (low <= high[i])).all(axis=1)
        for j in (np.flatnonzero(overlap[i + 1 :]) + i + 1).tolist():
            near_i = _inside(one.points, low[j], high[j])
            near_j = _inside(sides[j].points, low[i], high[i])
            if not (near_i.size and near_j.size):
                continue
            # the bound is exclusive, and compared in squares
            distance, index = tree_of(sides[j].points[near_j]).query(
                one.points[near_i], k=2, distance_upper_bound=reach * (1.0 + ROUNDING) + 1e-150
            )
            matches = np.nonzero(distance <= reach)
            nodes_j = near_j[index[matches]] + start[j]
            pairs.append(np.column_stack([near_i[matches[0]] + start[i], nodes_j]))
            distances.append(distance[matches])
    return np.concatenate(pairs), np.concatenate(distances)


def _inside(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))


def _pairwise(
    sides: Sequence[Side], nodes: np.ndarray, group: np.ndarray
) -> tuple[list[Entries], int]:
    """The constraints of each group and component: between one node, the hub, and each other node.

    The hub is the first node, or a fixed one if there is any.
    """
    member = np.arange(len(nodes))
    start = _starts(sides)
    column = np.concatenate([s.columns for s in sides])[nodes]  # (members, components)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    fixed = np.minimum.reduceat(np.where(column < 0, member[:, None], len(nodes)), first)
    hub = np.where(fixed < len(nodes), fixed, first[:, None])[group]
    other, component = np.nonzero((column >= 0) & (hub != member[:, None]))
    hub = hub[other, component]

    earlier, later = np.minimum(hub, other), np.maximum(hub, other)
    order = np.lexsort((component, nodes[later], nodes[earlier]))
    earlier, later, component = earlier[order], later[order], component[order]
    rows = np.arange(len(order))
    entries = []
    for begin, end in zip(start, start[1:]):
        of = [(nodes[x] >= begin) & (nodes[x] < end) for x in (earlier, later)]
        columns = [column[x[mask], component[mask]] for x, mask in zip((earlier, later), of)]
        signs = [np.full(len(c), sign) for c, sign in zip(columns, (1.0, -1.0))]
        row = [rows[mask] for mask in of]
        entries.append((np.concatenate(row), np.concatenate(columns), np.concatenate(signs)))
    return entries, len(rows)


def _require_touch(sides: Sequence[Side], nodes: np.ndarray, reach: float) -> None:
    """ValueError for a side that meets no other."""
    alone = np.setdiff1d(np.arange(len(sides)), _side_of(sides, nodes))
    if not alone.size:
        return
    s = sides[alone[0]]
    points = np.concatenate([other.points for other in sides if other is not s])
    distance = tree_of(points).query(s.points)[0].min()
    raise ValueError(
        f"points must have nodes of every subdomain coincident with one of another, up to "
        f"{reach:g}, got none of {s.subdomain!r}; its smallest distance to another is {distance:g}"
    )


def _require_no_merger(
    sides: Sequence[Side], nodes: np.ndarray, group: np.ndarray, reach: float
) -> None:
    """ValueError where two nodes of one side belong to one group."""
    side = _side_of(sides, nodes)
    twice = np.flatnonzero((group[1:] == group[:-1]) & (side[1:] == side[:-1]))
    if twice.size:
        k = twice[0]
        _refuse_merger(sides[side[k]], nodes[[k, k + 1]] - _starts(sides)[side[k]], reach)


def _require_apart(sides: Sequence[Side], nodes: np.ndarray, reach: float) -> None:
    """ValueError for a tied node that has another of its own side within the tolerance."""
    for side, begin, end in zip(sides, _starts(sides), _starts(sides)[1:]):
        nodes_of_side = np.sort(nodes[(nodes >= begin) & (nodes < end)]) - begin
        distance, index = tree_of(side.points).query(side.points[nodes_of_side], k=2)
        close = np.flatnonzero(distance[:, 1] <= reach)
        if close.size:
            _refuse_merger(side, np.sort(index[close[0]]), reach)


def _refuse_merger(side: Side, nodes: np.ndarray, reach: float) -> NoReturn:
    i, j = (int(k) for k in nodes)
    raise ValueError(
        f"tol must not merge nodes of one subdomain, got {reach:g}: nodes {i} and {j} of "
        f"{side.subdomain!r} lie {np.linalg.norm(side.points[i] - side.points[j]):g} apart"
    )


def _starts(sides: Sequence[Side]) -> np.ndarray:
    """The number of the first node of each side, and the number of all nodes."""
    return np.cumsum([0] + [len(s.points) for s in sides])


def _side_of(sides: Sequence[Side], nodes: np.ndarray) -> np.ndarray:
    return np.searchsorted(_starts(sides), nodes, side="right") - 1


def contact_coincident(
    points: Mapping[Subdomain, Any] | Mapping[str, Any],
    normal: Any,
    *,
    gap: Any = 0.0,
    friction: Any = 0.0,
    friction_static: Any = None,
    restitution: Any = 0.0,
    dofs_per_node: int | Mapping[Subdomain, int] | Mapping[str, int] | None = None,
    tol: float | None = None,
    reduced: Mapping[Subdomain, Reduction] | Mapping[str, Reduction] | None = None,
    name: str | None = None,
) -> Contact:
    """Contact of all coincident nodes of two subdomains, as `tie_coincident` ties them.

    Row k is of pair k of nodes, ordered by the node of the first subdomain. With u_a and u_b their
    displacements the gap is g = gap + n . (u_b - u_a), and friction acts along the directions
    perpendicular to n.

    Parameters
    ----------
    points : dict
        The coordinates of all nodes of the two subdomains, (N, d) with d = 1, 2 or 3, as for
        `tie_coincident`. The first d components of a node are its displacements.
    normal : (d,) or (N, d) array_like
        The direction n from the first subdomain to the second, of any length: one for all nodes,
        or one for each node of the first subdomain.
    gap, friction, friction_static, restitution : optional
        As of `Contact`: a number, or one for each row.
    dofs_per_node, tol, reduced : optional
        As for `tie_coincident`, with d components. A pair whose displacements are all fixed has
        no row.
    name : str, optional
        As of `Contact`.

    Returns
    -------
    Contact
        For the constraints of a `Coupler`.

    Raises
    ------
    TypeError, ValueError
        As `tie_coincident` and `Contact`; for other than two subdomains, and a normal of length 0.

    Examples
    --------
    Two squares of four nodes with two components, one on the other; two nodes meet:

    >>> points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    >>> low = Subdomain(np.ones(8), np.ones(8), scheme=Newmark(), name="low")
    >>> top = Subdomain(np.ones(8), np.ones(8), scheme=Newmark(), name="top")
    >>> contact_coincident({low: points, top: points + [0.0, 1.0]}, [0.0, 1.0], friction=0.3)
    <Contact of 2 rows on 'low' and 'top'>
    """
    if not isinstance(points, Mapping) or len(points) != 2:
        raise ValueError(f"points must be a dict of two subdomains, got {points!r}")
    d = np.shape(next(iter(points.values())))[1:]
    sides = checked_sides(points, d[0] if d else 1, dofs_per_node, reduced)
    pairs = coincident_nodes(sides, tol)
    directions = _directions(normal, sides[0].points.shape)[pairs[:, 0]]
    columns = [side.columns[nodes] for side, nodes in zip(sides, pairs.T)]
    rows = np.any([(c >= 0) & (directions != 0.0) for c in columns], axis=(0, 2))
    columns, directions = [c[rows] for c in columns], directions[rows]
    along = _perpendicular(directions) if np.any(np.asarray(friction) != 0.0) else []
    return Contact(
        _matrices(sides, columns, directions),
        gap=gap,
        tangents=[_matrices(sides, columns, tangent) for tangent in along],
        friction=friction,
        friction_static=friction_static,
        restitution=restitution,
        name=name,
    )


def _directions(normal: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Unit vectors, one for each node of the first subdomain."""
    vectors = real_array(normal, "normal", (1, 2))
    if vectors.shape not in (shape[1:], shape):
        raise ValueError(f"normal must have shape {shape[1:]} or {shape}, got {vectors.shape}")
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not np.all(length > 0.0):
        raise ValueError("normal must not have the length 0")
    return np.broadcast_to(vectors / length, shape)


def _perpendicular(n: np.ndarray) -> list[np.ndarray]:
    """The one or two unit vectors perpendicular to each n, (rows, d)."""
    rows, d = n.shape
    if d == 1:
        raise ValueError("friction must be 0 on a line, where nothing slides")
    if d == 2:
        return [np.column_stack([-n[:, 1], n[:, 0]])]
    least = np.eye(3)[np.argmin(np.abs(n), axis=1)]
    first = np.cross(n, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return [first, np.cross(n, first)]


def _matrices(sides: list[Side], columns: list[np.ndarray], along: np.ndarray) -> dict[Any, Any]:
    """The rows of along . (u_b - u_a), without fixed dofs."""
    out = {}
    for side, dofs, sign in zip(sides, columns, (-1.0, 1.0)):
        row, component = np.nonzero((dofs >= 0) & (along != 0.0))
        entries = (sign * along[row, component], (row, dofs[row, component]))
        out[side.subdomain] = sp.csr_array(entries, shape=(len(dofs), side.n))
    return out
