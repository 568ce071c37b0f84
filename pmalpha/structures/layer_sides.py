"""The sides of a plate that have an absorbing layer, and the elements of the layer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .._checks import counted, listing
from ..meshes.kinds import SHAPES
from ..meshes.mesh import unshared

__all__ = ["Side", "extruded", "sides_of", "snapped"]

# Coordinates on a side differ by less than this multiple of the size of the mesh.
ON_SIDE = 1e-9
ELSEWHERE = "graded_damping and absorbing take other elements"


class Side(NamedTuple):
    """A side of the rectangle, and its elements."""

    axis: int  # along the normal
    outward: float  # +1, -1
    at: float  # coordinate
    size: float  # of the elements along the normal
    edges: np.ndarray  # (m, 2) nodes
    owners: np.ndarray  # (m,) elements

    @property
    def name(self) -> str:
        return f"{'xy'[self.axis]} = {self.at:g}"


def sides_of(structure: Any, nodes: np.ndarray) -> list[Side]:
    """The sides of the box of a mesh whose nodes are chosen, each whole."""
    no_recipe = structure.recipe is None
    if no_recipe or not structure.moduli or set(structure.moduli) != set(structure.elements):
        names = ", ".join(map(repr, structure.elements)) or "of no kind"
        raise ValueError(f"absorbing_layer needs linear plates, got elements {names}; {ELSEWHERE}")
    if structure.points.shape[1] != 2 or structure.dofs_per_node != 2:
        raise ValueError(
            "absorbing_layer needs plates of four-node elements, got solids "
            f"({', '.join(map(repr, structure.elements))}) with {structure.dofs_per_node} dofs of "
            f"a node; {ELSEWHERE}"
        )
    chosen = np.zeros(len(structure.points), dtype=bool)
    chosen[nodes] = True
    kinds = [k for k, x in structure.elements.items() if k != "quad" and chosen[x].any()]
    if kinds or "quad" not in structure.elements:
        names = ", ".join(map(repr, kinds or structure.elements))
        raise ValueError(
            f"absorbing_layer needs four-node elements 'quad' at its sides, got {names}; "
            f"{ELSEWHERE}"
        )
    quads, points = structure.elements["quad"], structure.points
    edges = np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)])
    owners = np.tile(np.arange(len(quads)), 4)
    outer = unshared(np.sort(edges, axis=1))
    edges, owners = edges[outer], owners[outer]
    low, high = points.min(axis=0), points.max(axis=0)
    near = ON_SIDE * np.abs(points).max()
    sides, of_sides = [], np.zeros(len(points), dtype=bool)
    for axis, outward, at in [
        (0, -1.0, low[0]),
        (0, 1.0, high[0]),
        (1, -1.0, low[1]),
        (1, 1.0, high[1]),
    ]:
        on = (np.abs(points[edges][:, :, axis] - at) <= near).all(axis=1)
        meant = chosen[edges[on]].all(axis=1)
        if not meant.any():
            continue
        name = f"{'xy'[axis]} = {at:g}"
        if not meant.all():
            raise ValueError(
                f"nodes must be all nodes of a side, got some of {name} without "
                f"{listing(np.setdiff1d(edges[on], np.flatnonzero(chosen)))}"
            )
        extent = np.ptp(points[quads[owners[on]]][:, :, axis], axis=1)
        sides.append(Side(axis, outward, float(at), float(extent.mean()), edges[on], owners[on]))
        of_sides[edges[on]] = True
    left = np.flatnonzero(chosen & ~of_sides)
    if left.size or not sides:
        x = f" {left[0]} at {points[left[0]].tolist()}" if left.size else ""
        raise ValueError(
            "nodes must be those of sides parallel to the axes that bound the mesh, all nodes of "
            f"each, got {counted(left.size, 'other')}{x}"
        )
    return sides


def snapped(points: np.ndarray, sides: Sequence[Side]) -> np.ndarray:
    """The coordinates, with those of sides exactly on them."""
    points = points.copy()
    for side in sides:
        points[side.edges.ravel(), side.axis] = side.at
    return points


def extruded(
    structure: Any, sides: Sequence[Side], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 2), elements (E, 4) and the elements (E,) of the structure that they continue."""
    points = snapped(structure.points, sides)
    boxes, owners = [], []  # (2, 2): begin and end along x, along y

    def levels(side: Side) -> np.ndarray:
        return side.at + side.outward * side.size * np.arange(count + 1)

    for side in sides:
        ends = np.sort(points[side.edges][:, :, 1 - side.axis], axis=1)
        for a, b in np.sort(np.column_stack([levels(side)[:-1], levels(side)[1:]]), axis=1):
            across = np.tile([a, b], (len(ends), 1))
            pair = [across, ends] if side.axis == 0 else [ends, across]
            boxes.append(np.stack(pair, axis=1))
            owners.append(side.owners)
    for x in (side for side in sides if side.axis == 0):
        for y in (side for side in sides if side.axis == 1):
            corner = np.intersect1d(x.edges, y.edges)
            if not corner.size:
                raise ValueError(
                    f"the sides {x.name} and {y.name} must meet at a node of both, got none: the "
                    "mesh is no rectangle there"
                )
            spans = [
                np.sort(np.column_stack([levels(s)[:-1], levels(s)[1:]]), axis=1) for s in (x, y)
            ]
            boxes.append(
                np.stack(
                    [np.repeat(spans[0], count, axis=0), np.tile(spans[1], (count, 1))], axis=1
                )
            )
            owner = x.owners[(x.edges == corner[0]).any(axis=1)]
            owners.append(np.repeat(owner, count * count))
    box = np.concatenate(boxes)
    corners = np.stack(
        [
            np.stack([box[:, 0, i], box[:, 1, j]], axis=1)
            for i, j in SHAPES["quad"].nodes.astype(int)
        ],
        axis=1,
    )
    places, numbers = np.unique(corners.reshape(-1, 2) + 0.0, axis=0, return_inverse=True)
    return places, numbers.reshape(-1, 4), np.concatenate(owners)
