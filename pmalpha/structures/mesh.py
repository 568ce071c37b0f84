"""A mesh, as points and blocks of elements, and values at its nodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .._checks import counted, listing, real_array, require_finite

# Names by the number of nodes of an element. Order of nodes as in VTK and meshio: around the
# quadrilateral; around the bottom of the hexahedron, then around its top.
KINDS = {2: "line", 4: "quad", 8: "hexahedron"}
FACES = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)


class Mesh(NamedTuple):
    """Points (N, dim) and blocks of elements (m, 2, 4 or 8), checked."""

    points: np.ndarray
    blocks: tuple[np.ndarray, ...]


def checked_mesh(points: Any, elements: Any) -> Mesh:
    """The mesh; TypeError or ValueError if it is invalid.

    Elements are an array, or a dict of arrays by the name of their kind.
    """
    points = real_array(points, "points", 2)
    N, dim = points.shape
    if N == 0 or dim not in (1, 2, 3):
        raise ValueError(f"points must have 1, 2 or 3 columns and at least one row, got {(N, dim)}")
    if not isinstance(elements, Mapping):
        return Mesh(points, (_checked_block(elements, "elements", N, dim),))
    if not elements:
        raise ValueError("elements must not be empty")
    blocks = []
    for kind, block in elements.items():
        if kind not in KINDS.values():
            raise ValueError(f"elements must be of {', '.join(KINDS.values())}, got {kind!r}")
        block = _checked_block(block, f"elements[{kind!r}]", N, dim)
        if KINDS[block.shape[1]] != kind:
            corners = next(count for count, name in KINDS.items() if name == kind)
            raise ValueError(
                f"elements[{kind!r}] must have {counted(corners, 'column')}, got {block.shape[1]}"
            )
        blocks.append(block)
    return Mesh(points, tuple(blocks))


def _checked_block(elements: Any, name: str, N: int, dim: int) -> np.ndarray:
    elements = np.asarray(elements)
    if elements.dtype.kind not in "iu":
        raise TypeError(f"{name} must hold node numbers, got dtype {elements.dtype}")
    if elements.ndim != 2 or elements.shape[1] not in KINDS or len(elements) == 0:
        raise ValueError(
            f"{name} must have 2, 4 or 8 columns and at least one row, got {elements.shape}"
        )
    if dim < {2: 1, 4: 2, 8: 3}[elements.shape[1]]:
        kind = KINDS[elements.shape[1]]
        raise ValueError(
            f"{name} must fit the points, got {kind} with {counted(dim, 'coordinate')}"
        )
    outside = elements[(elements < 0) | (elements >= N)]
    if outside.size:
        raise ValueError(f"{name} must hold nodes 0..{N - 1}, got {listing(outside)}")
    return elements.astype(np.int64)


def nodal_vectors(values: Any, mesh: Mesh, name: str, *, times: int | None = None) -> np.ndarray:
    """Vectors at the nodes, such as displacements: (N, dim), or (times, N, dim).

    `values` has shape (N * d,) or (N, d), after `times` if given, with d >= dim dofs per node; the
    dofs beyond dim, such as rotations, are dropped. Returns a view where possible.
    """
    N, dim = mesh.points.shape
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {array.dtype}")
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
        raise TypeError(f"{name} must hold real numbers, got dtype {array.dtype}")
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


def outer_faces(elements: np.ndarray) -> np.ndarray:
    """Lines and quadrilaterals unchanged; of hexahedra the faces that belong to only one."""
    if elements.shape[1] != 8:
        return elements
    faces = elements[:, FACES].reshape(-1, 4)
    nodes = np.sort(faces, axis=1)
    order = np.lexsort(nodes.T)
    same = np.all(nodes[order[1:]] == nodes[order[:-1]], axis=1)
    shared = np.append(same, False) | np.insert(same, 0, False)
    return faces[np.sort(order[~shared])]


def edges(faces: np.ndarray) -> np.ndarray:
    """The edges of faces, each once: (e, 2)."""
    if faces.shape[1] == 2:
        return faces
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    count = int(faces.max()) + 1
    return np.stack(np.divmod(np.unique(ends[:, 0] * count + ends[:, 1]), count), axis=-1)
