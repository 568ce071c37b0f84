"""Meshes of scikit-fem: its order of nodes, subdomains and boundaries."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..meshes.kinds import KINDS, SHAPES
from ..meshes.mesh import Block, ElementType, FileMesh

# By dimension and number of nodes
KIND_OF = {(KINDS[kind].dimension, KINDS[kind].nodes): kind for kind in SHAPES}


def is_skfem_mesh(mesh: Any) -> bool:
    return all(hasattr(mesh, name) for name in ("doflocs", "dofs", "elem", "boundaries"))


def read_skfem(mesh: Any) -> FileMesh:
    """Its subdomains are groups of elements, its boundaries sets of points.

    Both reference elements are the box [0, 1]^d or the simplex in it, with other orders of nodes.
    """
    cells = np.asarray(mesh.dofs.element_dofs)
    places = np.asarray(mesh.elem.doflocs, dtype=float)
    kind = KIND_OF.get((places.shape[1], len(cells)))
    if kind is None:
        raise ValueError(
            f"mesh must have elements of {', '.join(KIND_OF.values())}, got "
            f"{type(mesh).__name__} with {len(cells)} nodes in an element"
        )
    groups = {
        name: {0: np.unique(np.asarray(elements, dtype=np.int64))}
        for name, elements in (mesh.subdomains or {}).items()
    }
    points_of = {
        name: np.unique(mesh.dofs.get_facet_dofs(np.asarray(facets)).flatten())
        for name, facets in (mesh.boundaries or {}).items()
    }
    points = np.ascontiguousarray(np.asarray(mesh.doflocs, dtype=float).T)
    nodes = _turned(kind, points, cells[_order(SHAPES[kind].nodes, places)].T)
    return FileMesh(points, [Block(kind, nodes)], groups, points_of, [ElementType()])


def _order(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The numbers of the places at which the nodes are."""
    order: np.ndarray = np.abs(nodes[:, None] - places).max(axis=2).argmin(axis=1)
    return order


def _turned(kind: str, points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The nodes of elements with positive volumes: those of scikit-fem have no orientation."""
    shape = SHAPES[kind]
    d = shape.nodes.shape[1]
    if d == 1:
        return np.ascontiguousarray(nodes)
    middle = shape.nodes[: shape.corners].mean(axis=0)
    jacobians = np.einsum("eai,aj->eij", points[nodes], shape.slopes(middle[None])[0])
    mirrored = _order(shape.nodes[:, [1, 0, *range(2, d)]], shape.nodes)
    negative = np.linalg.det(jacobians) < 0.0
    return np.where(negative[:, None], nodes[:, mirrored], nodes)
