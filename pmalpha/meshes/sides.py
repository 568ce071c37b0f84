"""The sides of a tie: subdomains with the coordinates of their nodes, and the tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import listing, real_array, real_number, require_moderate, whole_number
from ..errors import ConstraintWarning, warn
from ..problem.constraints import Constraint
from ..problem.subdomain import Subdomain
from ..reduction.fixed_dofs import Reduction

# The default tolerance as a fraction of the smallest distance between two nodes of one subdomain:
# far above the rounding in a mesh file, far below the size of an element. Nodes at larger
# distances, up to the fraction NEAR, cause a warning, since the mesh is probably inaccurate.
TOLERANCE = 0.01
NEAR = 0.1
# Nodes of one subdomain are coincident up to this fraction of its extent.
ONE_PLACE = 1e-9
# Rounding of a few operations with numbers of size 1.
ROUNDING = 64 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Side:
    """A subdomain or its name, its number of dofs, its points (N, d), and columns (N, components),
    -1 at fixed dofs."""

    subdomain: Subdomain | str
    n: int
    points: np.ndarray
    columns: np.ndarray


# Entries of one side in the constraints: rows, columns (-1 for a fixed dof) and values.
Entries = tuple[np.ndarray, np.ndarray, np.ndarray]


def checked_sides(points: Any, components: Any, dofs_per_node: Any, reduced: Any) -> list[Side]:
    """The checked arguments of a user, one Side per subdomain."""
    if not isinstance(points, Mapping):
        raise TypeError(f"points must be a dict of coordinates by subdomain, got {points!r}")
    for s in points:
        if not isinstance(s, (Subdomain, str)):
            raise TypeError(f"points must be of Subdomains or names of them, got {s!r}")
    reduced = {} if reduced is None else reduced
    if not isinstance(reduced, Mapping):
        raise TypeError(f"reduced must be a dict of Reductions by subdomain, got {reduced!r}")
    unknown = [s for s in reduced if s not in points]
    if unknown:
        raise ValueError(f"reduced must be of subdomains with points, got {listing(unknown)}")
    components = whole_number(components, "components", low=1)
    per_node = _per_node(dofs_per_node, points, components)
    sides = []
    for s, coordinates in points.items():
        array = _coordinates(coordinates, f"points of {s!r}")
        n = _count(s, len(array) * per_node[s], reduced.get(s))
        numbers = _numbers(s, n, len(array), per_node[s], reduced.get(s))
        sides.append(Side(s, n, array, numbers[:, :components]))
    dimensions = {side.points.shape[1] for side in sides}
    if len(dimensions) > 1:
        got = [f"{side.points.shape[1]} of {side.subdomain!r}" for side in sides]
        raise ValueError(f"points must have one dimension, got {listing(got)}")
    return sides


def _per_node(value: Any, points: Mapping[Any, Any], components: int) -> dict[Subdomain | str, int]:
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
    require_moderate(array, name)
    array = array.reshape(len(array), -1) if array.size else array
    if array.size == 0 or array.shape[1] > 3:
        raise ValueError(f"{name} must have shape (N,) or (N, d), d = 1, 2, 3, got {array.shape}")
    return array


def _count(subdomain: Subdomain | str, dofs: int, reduction: Any) -> int:
    """The dofs of a subdomain; of a name those with points, as far as they are free."""
    if reduction is not None and not isinstance(reduction, Reduction):
        raise TypeError(f"reduced must hold Reductions, got {reduction!r} of {subdomain!r}")
    if isinstance(subdomain, str):
        return dofs if reduction is None else reduction.free.size
    return subdomain.n


def _numbers(
    subdomain: Subdomain | str, free: int, nodes: int, per_node: int, reduction: Reduction | None
) -> np.ndarray:
    """The dof (nodes, per_node) of each node and component, -1 where it is fixed."""
    if reduction is not None and reduction.free.size != free:
        raise ValueError(f"reduced must hold the Reduction of {subdomain!r}, got {reduction!r}")
    n = free if reduction is None else reduction.n
    if nodes * per_node != n:
        raise ValueError(
            f"points times dofs_per_node must be the dofs of {subdomain!r}, got {nodes} x "
            f"{per_node} for {n}{_hint(nodes, n, reduction)}"
        )
    numbers = np.arange(n)
    if reduction is not None:
        numbers[reduction.fixed] = -1
        numbers[reduction.free] = np.arange(free)
    return numbers.reshape(nodes, per_node)


def _hint(nodes: int, n: int, reduction: Reduction | None) -> str:
    if n % nodes == 0:
        return f", which is {n // nodes} per node"
    return "" if reduction is not None else "; if dofs were fixed by reduce, give reduced"


def tolerance(tol: float | None, sides: Sequence[Side]) -> tuple[float, float]:
    """The distance up to which nodes are coincident, and that up to which they nearly are."""
    if tol is not None:
        reach = real_number(tol, "tol", low=0.0)
        return reach, reach
    spacing = min(_spacing(s.points) for s in sides)
    return (0.0, 0.0) if np.isinf(spacing) else (TOLERANCE * spacing, NEAR * spacing)


def _spacing(points: np.ndarray) -> float:
    """The smallest distance between two nodes that are not coincident, infinite if none are."""
    distance = tree_of(points).query(points, k=2)[0][:, 1]
    return float(distance[distance > ONE_PLACE * np.ptp(points, axis=0).max()].min(initial=np.inf))


def warn_of_near(missed: np.ndarray, reach: float, near: float) -> None:
    count = int(np.count_nonzero(missed))
    if count:
        warn(
            f"{count} nodes or pairs of nodes are not tied that are further apart than the default "
            f"tolerance {reach:g} but no further than {near:g}; give tol to tie them or not",
            ConstraintWarning,
        )


def tree_of(points: np.ndarray) -> Any:
    # sliding midpoints: medians are slow where many nodes have equal coordinates
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=False)


def constraint_of(sides: Sequence[Side], entries: Sequence[Entries], p: int) -> Constraint:
    """The constraints without the entries of fixed dofs, and without rows that become empty."""
    masks = [(columns >= 0) & (values != 0.0) for _, columns, values in entries]
    used = np.unique(np.concatenate([rows[k] for k, (rows, _, _) in zip(masks, entries)]))
    if not used.size:
        raise ValueError("reduced must leave a dof to tie, got fixed ones only")
    number = np.empty(p, dtype=np.int64)
    number[used] = np.arange(used.size)
    matrices = {}
    for side, k, (rows, columns, values) in zip(sides, masks, entries):
        shape = (used.size, side.n)
        matrices[side.subdomain] = sp.csr_array((values[k], (number[rows[k]], columns[k])), shape)
    return Constraint(matrices)
