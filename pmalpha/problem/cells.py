"""Elements to which nodes are tied: shape functions, and checked elements of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import listing
from .shapes import SHAPES, Shape
from .sides import Side, length


@dataclass(frozen=True, eq=False)
class Cell:
    """An element in reference coordinates xi: the box [0, 1]^d, or the simplex in it."""

    shape: Shape

    @property
    def corners(self) -> np.ndarray:
        """(k, d)"""
        return self.shape.nodes

    def weights(self, xi: np.ndarray) -> np.ndarray:
        """N (q, k) at xi (q, d)."""
        return self.shape.values(xi)

    def slopes(self, xi: np.ndarray) -> np.ndarray:
        """dN / dxi (q, k, d) at xi (q, d)."""
        return self.shape.slopes(xi)

    def inside(self, xi: np.ndarray) -> np.ndarray:
        """xi, moved into the element where it is outside."""
        xi = np.clip(xi, 0.0, 1.0)
        box = len(self.corners) == 2 ** xi.shape[1]
        return xi if box else xi / np.maximum(xi.sum(axis=1, keepdims=True), 1.0)


_CELLS = {name: Cell(SHAPES[name]) for name in ("line", "triangle", "quad", "tetra", "hexahedron")}


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of one kind: nodes (m, k), coordinates of these (m, k, d), centres and radii."""

    cell: Cell
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
    radius = length(points - centre[:, None, :]).max(axis=1)
    _require_proper(cell, points, radius)
    return Elements(cell, nodes, points, centre, radius)


def _cell(kind: str | None, shape: tuple[int, ...], dimension: int) -> Cell:
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
        raise ValueError(f"cell must be {' or '.join(fitting)} for elements_b of {shape}, got None")
    if kind is not None and kind not in fitting:
        raise ValueError(
            f"cell must fit elements_b of shape {shape} in {dimension}-D, got {kind!r}"
        )
    return _CELLS[fitting[0] if kind is None else kind]


def _require_proper(cell: Cell, points: np.ndarray, radius: np.ndarray) -> None:
    """ValueError unless the map from xi keeps its orientation at all corners."""
    size = np.stack([_measure(jacobian(cell, xi, points)) for xi in cell.corners], axis=1)
    if size.ndim == 3:  # normals of a surface: their component along the mean normal
        mean = size.mean(axis=1, keepdims=True)
        size = (size * mean).sum(axis=2) / np.maximum(length(mean), np.finfo(float).tiny)
    size *= np.sign(size.sum(axis=1, keepdims=True))
    smallest = 1e-12 * radius ** cell.corners.shape[1]
    wrong = np.flatnonzero(~(size > smallest[:, None]).all(axis=1))
    if wrong.size:
        raise ValueError(
            "elements_b must be convex, numbered around and not flat, got elements "
            f"{listing(wrong)} that are not"
        )


def jacobian(cell: Cell, xi: np.ndarray, points: np.ndarray) -> np.ndarray:
    """dx / dxi (m, dimension, d) of the elements, at one xi (d,) or at one for each (m, d)."""
    result: np.ndarray = points.transpose(0, 2, 1) @ cell.slopes(np.atleast_2d(xi))
    return result


def _measure(J: np.ndarray) -> np.ndarray:
    """Length, signed area or volume (m,), or the normals (m, 3) of a surface in space."""
    dimension, d = J.shape[1:]
    if d == 1:
        return length(J[:, :, 0])
    if d == dimension:
        result: np.ndarray = np.linalg.det(J)
        return result
    return np.cross(J[:, :, 0], J[:, :, 1])
