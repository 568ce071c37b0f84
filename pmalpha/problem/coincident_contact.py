"""Contact of two meshes that lie face to face."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import real_array
from .coincident import coincident_nodes
from .reduction import Reduction
from .sides import Side, checked_sides
from .subdomain import Subdomain
from .unilateral import Contact

__all__ = ["contact_coincident"]


def contact_coincident(
    points: Mapping[Subdomain, Any] | Mapping[str, Any],
    normal: Any,
    *,
    gap: Any = 0.0,
    friction: Any = 0.0,
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
    gap, friction, restitution : optional
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
    columns = [side.columns[own] for side, own in zip(sides, pairs.T)]
    kept = np.any([(c >= 0) & (directions != 0.0) for c in columns], axis=(0, 2))
    columns, directions = [c[kept] for c in columns], directions[kept]
    along = _perpendicular(directions) if np.any(np.asarray(friction) != 0.0) else []
    return Contact(
        _matrices(sides, columns, directions),
        gap=gap,
        tangents=[_matrices(sides, columns, tangent) for tangent in along],
        friction=friction,
        restitution=restitution,
        name=name,
    )


def _directions(normal: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Unit vectors, one for each node of the first subdomain."""
    given = real_array(normal, "normal", (1, 2))
    if given.shape not in (shape[1:], shape):
        raise ValueError(f"normal must have shape {shape[1:]} or {shape}, got {given.shape}")
    length = np.linalg.norm(given, axis=-1, keepdims=True)
    if not np.all(length > 0.0):
        raise ValueError("normal must not have the length 0")
    return np.broadcast_to(given / length, shape)


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
    for side, own, sign in zip(sides, columns, (-1.0, 1.0)):
        row, component = np.nonzero((own >= 0) & (along != 0.0))
        entries = (sign * along[row, component], (row, own[row, component]))
        out[side.subdomain] = sp.csr_array(entries, shape=(len(own), side.n))
    return out
