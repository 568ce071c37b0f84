"""Kinds of elements: names, nodes, faces, and numbers in files.

Names and orders of nodes are those of meshio and VTK. Of second-order kinds the nodes on the edges
follow the corners, in the order of `edges`; the node in the middle of "quad9" is the last.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["BY_COLUMNS", "KINDS", "Kind"]

Nodes = tuple[int, ...]


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

# The kind of elements that are given as an array, without a name, by the number of its columns
BY_COLUMNS = {2: "line", 3: "triangle", 4: "quad", 8: "hexahedron"}
