"""A mesh, as points and blocks of elements, and values at its nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._checks import counted, listing, not_real, real_array, require_finite

# ---- kinds ---------------------------------------------------------------------------------------
# Kinds of elements: names, nodes, faces, numbers in files, and shape functions.
#
# Names and orders of nodes are those of meshio and VTK. Of second-order kinds the nodes on the
# edges follow the corners, in the order of `edges`; the node in the middle of "quad9" is the last.
#
# The reference element is the box [0, 1]^d or the simplex in it, a wedge a triangle times a line. A
# shape function is the polynomial of its monomials that is 1 at its node and 0 at the others.

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


def _shape_of(name: str) -> Shape:
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


SHAPES = {name: _shape_of(name) for name in _MONOMIALS}


def dimension_of_kind(kind: str) -> int:
    """That of a kind of element; 0 of a point, and of what is none here."""
    return KINDS[kind].dimension if kind in KINDS else 0


__all__ = ["BY_COLUMNS", "KINDS", "Kind"]


class Block(NamedTuple):
    """Elements of one kind: its name and the nodes (m, k)."""

    kind: str
    nodes: np.ndarray


class ElementType(NamedTuple):
    """What a file says of the elements of a block beyond their kind; empty where it says nothing.

    The family is "SOLID", "PLANE STRESS", "PLANE STRAIN", "AXISYMMETRIC", "MEMBRANE", "SHELL",
    "BAR" or "BEAM", or of what is left out one of `unread`.
    """

    name: str = ""
    family: str = ""


class FileMesh(NamedTuple):
    """What a file has: points (N, dim), blocks of cells, each of a type.

    Groups have the numbers of their cells by the number of a block, in ascending order, for blocks
    of which they have some; points are those of named sets of points.
    """

    points: np.ndarray
    blocks: list[Block]
    groups: dict[str, dict[int, np.ndarray]]
    points_of: dict[str, np.ndarray]
    types: list[ElementType]


def by_block(cells: ArrayLike, starts: np.ndarray) -> dict[int, np.ndarray]:
    """Cells that are numbered through all blocks, by their block, and counted in it.

    starts: where each block begins, and the end.
    """
    numbers = np.unique(np.asarray(cells, dtype=np.int64))
    block = np.searchsorted(starts, numbers, side="right") - 1
    splits = np.flatnonzero(np.diff(block)) + 1
    parts = zip(np.split(numbers, splits), np.split(block, splits))
    return {int(of[0]): x - starts[of[0]] for x, of in parts if x.size}


def first_of_equal(blocks: list[Block]) -> np.ndarray:
    """For each cell of all blocks the first one of the same nodes, itself or one before it."""
    start = np.cumsum([0, *(len(block.nodes) for block in blocks)])
    first = np.arange(start[-1])
    for width in dict.fromkeys(block.nodes.shape[1] for block in blocks):
        numbers = [i for i, block in enumerate(blocks) if block.nodes.shape[1] == width]
        cells = np.concatenate([np.arange(start[i], start[i + 1]) for i in numbers])
        nodes = np.sort(np.concatenate([blocks[i].nodes for i in numbers]), axis=1)
        if _have_equal_rows(nodes):
            _, one, inverse = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
            first[cells] = cells[one[inverse.reshape(-1)]]
    return first


def without_cells(read: FileMesh, first: np.ndarray) -> FileMesh:
    """With one cell for those of which `first` is the same, in the groups of all of them."""
    start = np.cumsum([0, *(len(block.nodes) for block in read.blocks)])
    remaining = first == np.arange(first.size)
    number = np.cumsum(remaining) - 1  # of a cell that remains
    blocks = [
        block._replace(nodes=block.nodes[remaining[a:b]])
        for block, a, b in zip(read.blocks, start, start[1:])
    ]
    ends = np.cumsum([0, *(len(block.nodes) for block in blocks)])
    groups = {}
    for name, members in read.groups.items():
        all_of = [start[i] + cells for i, cells in members.items()]
        groups[name] = by_block(number[first[np.concatenate(all_of)]] if all_of else [], ends)
    return read._replace(blocks=blocks, groups=groups)


def _have_equal_rows(nodes: np.ndarray) -> bool:
    """Whether two rows may be equal: by one number of each, which is sorted fast."""
    factors = np.random.default_rng(0).integers(1, 2**62, size=nodes.shape[1])
    return bool(np.unique(nodes @ (2 * factors + 1)).size < len(nodes))


def are_sides(blocks: list[Block], number: int) -> np.ndarray:
    """Of each cell of a block whether it is a side or an edge of a cell of higher dimension."""
    kind, cells = KINDS[blocks[number].kind], blocks[number].nodes
    corners = np.sort(cells[:, : _corner_count(kind)], axis=1)
    near = np.zeros(1 + max(int(b.nodes.max(initial=0)) for b in blocks), dtype=bool)
    near[corners] = True
    sides = [np.empty((0, corners.shape[1]), dtype=np.int64)]
    for block in blocks:
        other = KINDS.get(block.kind)
        if other is None or other.dimension <= kind.dimension:
            continue
        of_edges = other.edges if kind.dimension == 1 else ()
        faces = ((KINDS[name], nodes) for name, nodes in other.faces if kind.dimension == 2)
        for side in (*of_edges, *(nodes[: _corner_count(face)] for face, nodes in faces)):
            if len(side) == corners.shape[1]:
                nodes = block.nodes[:, list(side)]
                sides.append(np.sort(nodes[near[nodes].all(axis=1)], axis=1))
    rows = np.concatenate([*sides, corners])
    first = first_of_equal([Block("", rows)])
    return first[len(rows) - len(corners) :] < len(rows) - len(corners)


def _corner_count(kind: Kind) -> int:
    return 2 if kind.dimension == 1 else len(kind.edges)


class Mesh(NamedTuple):
    """Points (N, dim) and blocks of elements, checked."""

    points: np.ndarray
    blocks: tuple[Block, ...]


def checked_mesh(points: Any, elements: Any, whose: str = "") -> Mesh:
    """The mesh; TypeError or ValueError if it is invalid, with the words `whose` after the name.

    Elements are an array, or a dict of arrays by the name of their kind.
    """
    points = real_array(points, f"points{whose}", 2)
    N, dim = points.shape
    if N == 0 or dim not in (1, 2, 3):
        raise ValueError(
            f"points{whose} must have 1, 2 or 3 columns and at least one row, got {(N, dim)}"
        )
    if not isinstance(elements, Mapping):
        return Mesh(points, (_checked_block(None, elements, f"elements{whose}", N, dim),))
    if not elements:
        raise ValueError(f"elements{whose} must not be empty")
    blocks = []
    for kind, block in elements.items():
        if kind not in KINDS:
            raise ValueError(f"elements{whose} must be of {', '.join(KINDS)}, got {kind!r}")
        blocks.append(_checked_block(kind, block, f"elements[{kind!r}]{whose}", N, dim))
    return Mesh(points, tuple(blocks))


def _checked_block(kind: str | None, elements: Any, name: str, N: int, dim: int) -> Block:
    elements = np.asarray(elements)
    if elements.dtype.kind not in "iu":
        raise TypeError(f"{name} must hold node numbers, got dtype {elements.dtype}")
    if elements.ndim != 2 or len(elements) == 0:
        raise ValueError(f"{name} must be 2-D with at least one row, got shape {elements.shape}")
    columns = elements.shape[1]
    if kind is None and columns not in BY_COLUMNS:
        raise ValueError(
            f"{name} must be a dict by kind of element unless they have "
            f"{', '.join(map(str, BY_COLUMNS))} columns, got {columns}"
        )
    kind = BY_COLUMNS[columns] if kind is None else kind
    if columns != KINDS[kind].nodes:
        raise ValueError(f"{name} must have {counted(KINDS[kind].nodes, 'column')}, got {columns}")
    if dim < KINDS[kind].dimension:
        raise ValueError(
            f"{name} must fit the points, got {kind} with {counted(dim, 'coordinate')}"
        )
    outside = elements[(elements < 0) | (elements >= N)]
    if outside.size:
        raise ValueError(f"{name} must hold nodes 0..{N - 1}, got {listing(outside)}")
    return Block(kind, elements.astype(np.int64))


def nodal_vectors(values: Any, mesh: Mesh, name: str, *, times: int | None = None) -> np.ndarray:
    """Vectors at the nodes, such as displacements: (N, dim), or (times, N, dim).

    `values` has shape (N * d,) or (N, d), after `times` if given, with d >= dim dofs per node; the
    dofs beyond dim, such as rotations, are dropped. Returns a view where possible.
    """
    N, dim = mesh.points.shape
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise not_real(array, name)
    before = () if times is None else (times,)
    after = array.shape[len(before) :]
    flat = len(after) == 1 and after[0] % N == 0 and after[0] >= N * dim
    by_node = len(after) == 2 and after[0] == N and after[1] >= dim
    if array.shape[: len(before)] != before or not (flat or by_node):
        raise ValueError(
            f"{name} must have shape {_shape(*before, f'{N} d')} or {_shape(*before, N, 'd')} with "
            f"d >= {dim} dofs at each of {N} nodes, got {array.shape}"
        )
    vectors = array.reshape(*before, N, -1)[..., :dim]
    require_finite(vectors, name)
    return vectors


def _shape(*entries: Any) -> str:
    return f"({', '.join(str(entry) for entry in entries)}{',' if len(entries) == 1 else ''})"


def nodal_values(values: Any, mesh: Mesh, name: str, *, times: int | None = None) -> np.ndarray:
    """A number at each node: (N,), or (times, N)."""
    shape = (len(mesh.points),) if times is None else (times, len(mesh.points))
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise not_real(array, name)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    require_finite(array, name)
    return array


def padded(vectors: np.ndarray, columns: int) -> np.ndarray:
    """Vectors with `columns` components at least, the additional ones zero."""
    missing = columns - vectors.shape[-1]
    if missing <= 0:
        return vectors
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], missing))], axis=-1)


def lines(mesh: Mesh) -> np.ndarray:
    """Ends (e, 2) of the straight pieces of which the elements of dimension 1 consist."""
    pieces = [np.empty((0, 2), dtype=np.int64)]
    for kind, nodes in mesh.blocks:
        if KINDS[kind].dimension == 1:
            path = nodes[:, KINDS[kind].path]
            pieces.append(np.stack([path[:, :-1], path[:, 1:]], axis=-1).reshape(-1, 2))
    return np.concatenate(pieces)


def outer_faces(mesh: Mesh) -> list[Block]:
    """Surfaces, and of solids the faces that belong to only one, as blocks of surfaces."""
    surfaces = [block for block in mesh.blocks if KINDS[block.kind].dimension == 2]
    faces = [
        Block(kind, block.nodes[:, nodes])
        for block in mesh.blocks
        for kind, nodes in KINDS[block.kind].faces
    ]
    return _by_kind([*surfaces, *_unshared(faces)])


def _by_kind(blocks: list[Block]) -> list[Block]:
    return [
        Block(kind, np.concatenate([block.nodes for block in blocks if block.kind == kind]))
        for kind in dict.fromkeys(block.kind for block in blocks)
    ]


def _unshared(faces: list[Block]) -> list[Block]:
    """The faces whose corners are those of no other face; orders of elements may differ."""
    if not faces:
        return []
    outer = unshared(np.concatenate([_corners(block) for block in faces]))
    ends = np.cumsum([len(block.nodes) for block in faces])[:-1]
    return [
        Block(block.kind, block.nodes[mask])
        for block, mask in zip(faces, np.split(outer, ends), strict=True)
    ]


def unshared(keys: np.ndarray) -> np.ndarray:
    """Which rows (m,) of keys (m, k) are equal to no other row."""
    order = np.lexsort(keys.T)
    same = np.all(keys[order[1:]] == keys[order[:-1]], axis=1)
    outer = np.empty(len(keys), dtype=bool)
    outer[order] = ~(np.append(same, False) | np.insert(same, 0, False))
    return outer


def _corners(faces: Block) -> np.ndarray:
    """Corners (m, 4) in rising order; of a triangle the first entry is -1."""
    count = len(KINDS[faces.kind].edges)
    corners = np.full((len(faces.nodes), 4), -1, dtype=np.int64)
    corners[:, 4 - count :] = np.sort(faces.nodes[:, :count], axis=1)
    return corners


def edges(surfaces: list[Block]) -> np.ndarray:
    """The straight pieces of the edges of surfaces, each once: (e, 2)."""
    pieces = [np.empty((0, 2), dtype=np.int64)]
    for kind, nodes in surfaces:
        path = nodes[:, KINDS[kind].path]
        pieces.append(np.stack([path, np.roll(path, -1, axis=1)], axis=-1).reshape(-1, 2))
    ends = np.sort(np.concatenate(pieces), axis=1)
    count = int(ends.max(initial=0)) + 1
    return np.stack(np.divmod(np.unique(ends[:, 0] * count + ends[:, 1]), count), axis=-1)
