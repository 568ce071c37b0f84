"""Kinds of elements: names, nodes, faces, numbers in files, and shape functions.

Names and orders of nodes are those of meshio and VTK. Of second-order kinds the nodes on the edges
follow the corners, in the order of `edges`; the node in the middle of "quad9" is the last.

The reference element is the box [0, 1]^d or the simplex in it, a wedge a triangle times a line. A
shape function is the polynomial of its monomials that is 1 at its node and 0 at the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

__all__ = ["BY_COLUMNS", "KINDS", "Kind"]

Nodes = tuple[int, ...]
# The kind of elements that are given as an array, without a name, by the number of its columns
BY_COLUMNS = {2: "line", 3: "triangle", 4: "quad", 8: "hexahedron"}
_SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
_OF_TRIANGLE = [(0, 0), (1, 0), (0, 1)]
# By dimension and number of corners
_CORNERS = {
    (1, 2): [(0,), (1,)],
    (2, 3): _OF_TRIANGLE,
    (2, 4): _SQUARE,
    (3, 4): [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    (3, 6): [(*corner, z) for z in (0, 1) for corner in _OF_TRIANGLE],
    (3, 8): [(*corner, z) for z in (0, 1) for corner in _SQUARE],
}


class Kind(NamedTuple):
    """A kind of element; nodes are numbered in the element."""

    dimension: int
    nodes: int  # their number
    edges: tuple[Nodes, ...]  # corners of each
    faces: tuple[tuple[str, Nodes], ...]  # of a solid: kind and nodes, around as seen from outside
    path: Nodes  # of a line from its begin to its end; around a surface
    triangles: tuple[Nodes, ...]  # that fill a surface
    vtk: int
    xdmf: tuple[str, int]


def _around(nodes: Nodes) -> tuple[Nodes, ...]:
    return tuple(zip(nodes, (*nodes[1:], nodes[0]), strict=True))


def _surface(nodes: int, vtk: int, xdmf: tuple[str, int]) -> Kind:
    path = tuple(range(nodes))
    triangles = tuple((0, i, i + 1) for i in range(1, nodes - 1))
    return Kind(2, nodes, _around(path), (), path, triangles, vtk, xdmf)


def _solid(
    edges: tuple[Nodes, ...], faces: tuple[Nodes, ...], vtk: int, xdmf: tuple[str, int]
) -> Kind:
    named = tuple(({3: "triangle", 4: "quad"}[len(face)], face) for face in faces)
    return Kind(3, 1 + max(map(max, faces)), edges, named, (), (), vtk, xdmf)


def _second_order(kind: Kind, vtk: int, xdmf: tuple[str, int], *, middle: bool = False) -> Kind:
    """The kind with a node on each edge, and one in the middle of a surface."""
    on_edge = {frozenset(ends): kind.nodes + i for i, ends in enumerate(kind.edges)}
    nodes = kind.nodes + len(kind.edges)

    def with_middles(corners: Nodes) -> Nodes:
        return (*corners, *(on_edge[frozenset(ends)] for ends in _around(corners)))

    second = {"triangle": "triangle6", "quad": "quad8"}
    faces = tuple((second[name], with_middles(corners)) for name, corners in kind.faces)
    path: Nodes = ()
    triangles: tuple[Nodes, ...] = ()
    if kind.dimension == 1:
        path = (0, 2, 1)
    if kind.dimension == 2:
        path = tuple(node for i in kind.path for node in (i, kind.nodes + i))
        if middle:
            triangles = tuple((nodes, *ends) for ends in _around(path))
        else:
            before = (path[-1], *path[1:-1:2])
            at_corners = zip(before, path[::2], path[1::2], strict=True)
            inside = (tuple(kind.nodes + i for i in triangle) for triangle in kind.triangles)
            triangles = (*at_corners, *inside)
    return Kind(kind.dimension, nodes + middle, kind.edges, faces, path, triangles, vtk, xdmf)


_LINE = Kind(1, 2, ((0, 1),), (), (0, 1), (), 3, ("Polyline", 2))
_TRIANGLE = _surface(3, 5, ("Triangle", 4))
_QUAD = _surface(4, 9, ("Quadrilateral", 5))
_TETRA = _solid(
    ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    10,
    ("Tetrahedron", 6),
)
_PYRAMID = _solid(
    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    14,
    ("Pyramid", 7),
)
_WEDGE = _solid(
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    13,
    ("Wedge", 8),
)
_HEXAHEDRON = _solid(
    (*_around((0, 1, 2, 3)), *_around((4, 5, 6, 7)), (0, 4), (1, 5), (2, 6), (3, 7)),
    ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    12,
    ("Hexahedron", 9),
)

KINDS: dict[str, Kind] = {
    "line": _LINE,
    "line3": _second_order(_LINE, 21, ("Edge_3", 34)),
    "triangle": _TRIANGLE,
    "triangle6": _second_order(_TRIANGLE, 22, ("Triangle_6", 36)),
    "quad": _QUAD,
    "quad8": _second_order(_QUAD, 23, ("Quadrilateral_8", 37)),
    "quad9": _second_order(_QUAD, 28, ("Quadrilateral_9", 35), middle=True),
    "tetra": _TETRA,
    "tetra10": _second_order(_TETRA, 24, ("Tetrahedron_10", 38)),
    "pyramid": _PYRAMID,
    "pyramid13": _second_order(_PYRAMID, 27, ("Pyramid_13", 39)),
    "wedge": _WEDGE,
    "wedge15": _second_order(_WEDGE, 26, ("Wedge_15", 40)),
    "hexahedron": _HEXAHEDRON,
    "hexahedron20": _second_order(_HEXAHEDRON, 25, ("Hexahedron_20", 48)),
}


def _simplex(order: int) -> Callable[[tuple[int, ...]], bool]:
    """Polynomials of this degree."""
    return lambda e: sum(e) <= order


def _serendipity(order: int) -> Callable[[tuple[int, ...]], bool]:
    """Polynomials of this degree, not counting the variables that are linear."""
    return lambda e: sum(x for x in e if x > 1) <= order and max(e) <= order


def _wedge(order: int) -> Callable[[tuple[int, ...]], bool]:
    return lambda e: e[0] + e[1] <= order and e[2] <= order and sum(e) <= order + 1


# Whether a monomial with these exponents, of 2 at most, is one of the element.
_MONOMIALS: dict[str, Callable[[tuple[int, ...]], bool]] = {
    "line": _simplex(1),
    "line3": _simplex(2),
    "triangle": _simplex(1),
    "triangle6": _simplex(2),
    "quad": _serendipity(1),
    "quad8": _serendipity(2),
    "quad9": lambda e: True,
    "tetra": _simplex(1),
    "tetra10": _simplex(2),
    "wedge": _wedge(1),
    "wedge15": _wedge(2),
    "hexahedron": _serendipity(1),
    "hexahedron20": _serendipity(2),
}


@dataclass(frozen=True, eq=False)
class Shape:
    """Nodes of a reference element and its shape functions N_a = sum_m c_ma prod_i xi_i^e_mi."""

    corners: int
    nodes: np.ndarray  # (k, d)
    exponents: np.ndarray  # (k, d), of monomial m
    coefficients: np.ndarray  # (k, k), c_ma

    def values(self, xi: np.ndarray) -> np.ndarray:
        """N (q, k) at xi (q, d)."""
        result: np.ndarray = _powers(xi, self.exponents) @ self.coefficients
        return result

    def slopes(self, xi: np.ndarray) -> np.ndarray:
        """dN / dxi (q, k, d) at xi (q, d)."""
        columns = []
        for axis, unit in enumerate(np.eye(xi.shape[1], dtype=int)):
            factors = self.exponents[:, axis]
            lower = _powers(xi, np.maximum(self.exponents - unit, 0))
            columns.append((factors * lower) @ self.coefficients)
        return np.stack(columns, axis=2)


def _powers(xi: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """The monomials at points (q, d), (q, k)."""
    result: np.ndarray = np.prod(xi[:, None, :] ** exponents, axis=2)
    return result


def _shape(name: str) -> Shape:
    kind = KINDS[name]
    count = 1 + max(map(max, kind.edges))
    corners = np.array(_CORNERS[kind.dimension, count], dtype=float)
    # the corners, then the middles of the edges, then that of the element
    on_edges = corners[np.array(kind.edges)].mean(axis=1)
    nodes = np.concatenate([corners, on_edges, [corners.mean(axis=0)]])[: kind.nodes]
    belongs = _MONOMIALS[name]
    exponents = np.array([e for e in product(range(3), repeat=kind.dimension) if belongs(e)])
    # N_a(node b) = delta_ab; with nodes at 0, 1/2 and 1 the coefficients are whole numbers
    coefficients = np.round(np.linalg.inv(_powers(nodes, exponents)))
    return Shape(count, nodes, exponents, coefficients)


SHAPES = {name: _shape(name) for name in _MONOMIALS}


def dimension_of_kind(kind: str) -> int:
    """That of a kind of element; 0 of a point, and of what is none here."""
    return KINDS[kind].dimension if kind in KINDS else 0
