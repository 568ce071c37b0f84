"""Paths along beams and edges of elements, for points that move there, equation (L8)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import listing, plain_array, real_number
from ..meshes.mesh import KINDS
from ..problem.dofs import dof_list
from ..problem.moving import MovingPoint
from .element_force import Selected

# Coefficients of 1, xi, xi^2, xi^3.
LINEAR = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
QUADRATIC = np.array([[1.0, -3.0, 2.0, 0.0], [0.0, 4.0, -4.0, 0.0], [0.0, -1.0, 2.0, 0.0]])
# u and rz L at both ends of a beam, and what shear deformation of the ratio Phi adds
HERMITE = np.array([[1.0, 0.0, -3.0, 2.0], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]])
SHEAR = np.array([[1.0, -1.0, 0.0, 0.0], [0, 0.5, -0.5, 0], [0, 1, 0, 0], [0, -0.5, 0.5, 0]])

# A node in the middle of an edge is there up to this part of the length of the edge.
STRAIGHT = 1e-6


def moving_point(
    structure: Any, path: Any, speed: Any, start: Any, direction: Any, fixed: Any
) -> MovingPoint:
    """What `Structure.moving_point` returns."""
    factors = _direction(structure, direction)
    edges = _along(structure, path)
    segments = [_segment(structure, nodes, element, factors) for nodes, element in edges]
    width = max(len(dofs) for dofs, _ in segments)
    dofs = np.full((len(segments), width), -1)
    shape = np.zeros((len(segments), width, 4))
    for i, (of_segment, values) in enumerate(segments):
        dofs[i, : len(of_segment)], shape[i, : len(of_segment)] = of_segment, values
    between = [structure.points[nodes[-1]] - structure.points[nodes[0]] for nodes, _ in edges]
    ends = np.concatenate([[0.0], np.cumsum(np.linalg.norm(between, axis=1))])
    names = structure.dof_names
    supports = dof_list(fixed, structure.n, "fixed", names) if np.size(fixed) else ()
    return MovingPoint(ends, dofs, shape, structure.n, speed, start, names=names, fixed=supports)


def _direction(structure: Any, direction: Any) -> dict[str, float]:
    """Components of displacement with factors; the last one where none is given."""
    known = [x for x in structure.components if x.startswith("u")]
    if direction is None:
        return {known[-1]: 1.0}
    if not isinstance(direction, (str, Mapping)):
        raise TypeError(f"direction must be a name or a dict of names, got {direction!r}")
    factors = direction if isinstance(direction, Mapping) else {direction: 1.0}
    unknown = [x for x in factors if x not in known]
    if unknown or not factors:
        raise ValueError(f"direction must be of {listing(known)}, got {direction!r}")
    return {x: real_number(factor, f"direction[{x!r}]") for x, factor in factors.items()}


# ---- the nodes in their order --------------------------------------------------------------------


def _along(structure: Any, path: Any) -> list[tuple[tuple[int, ...], tuple[str, int]]]:
    """Edges of elements, each with its nodes from begin to end, and an element that has it."""
    nodes = np.asarray(plain_array(path, "path"))
    if nodes.ndim != 1 or nodes.size < 2:
        raise ValueError(f"path must be two nodes or more, got {path!r}")
    nodes = dof_list(nodes, len(structure.points), "path")
    edges = _edges(structure, nodes)
    ends: dict[int, list[int]] = {}
    for i, (corners, _) in enumerate(edges):
        for node in (corners[0], corners[-1]):
            ends.setdefault(node, []).append(i)
    middles = {node for corners, _ in edges for node in corners[1:-1]}
    lost = [int(x) for x in nodes if int(x) not in ends and int(x) not in middles]
    if lost:
        raise ValueError(
            f"path must be nodes along edges of elements, got {listing(lost)} at no edge between "
            "two of them"
        )
    return _in_turn(edges, ends, [int(x) for x in nodes])


def _edges(structure: Any, nodes: np.ndarray) -> list[tuple[tuple[int, ...], tuple[str, int]]]:
    """The edges of which all nodes are among these, once each."""
    chosen = np.zeros(len(structure.points), dtype=bool)
    chosen[nodes] = True
    edges: dict[frozenset[int], tuple[tuple[int, ...], tuple[str, int]]] = {}
    known = [name for name in structure.elements if name in KINDS]
    for name in sorted(
        known, key=lambda name: KINDS[name].dimension
    ):  # beams before what they hold
        kind, elements = KINDS[name], structure.elements[name]
        first = 1 + max(map(max, kind.edges))  # middle nodes follow the corners
        for j, (a, b) in enumerate(kind.edges):
            columns = [a, first + j, b] if kind.nodes > first else [a, b]
            edge = elements[:, columns]
            for e in np.flatnonzero(chosen[edge].all(axis=1)):
                corners = tuple(map(int, edge[e]))
                edges.setdefault(frozenset(corners), (corners, (name, int(e))))
    return list(edges.values())


def _in_turn(
    edges: list[tuple[tuple[int, ...], tuple[str, int]]],
    ends: dict[int, list[int]],
    nodes: list[int],
) -> list[tuple[tuple[int, ...], tuple[str, int]]]:
    """The edges of a chain in their order, from the end that is named first."""
    tips = [node for node in nodes if len(ends.get(node, ())) == 1]
    branches = [node for node in nodes if len(ends.get(node, ())) > 2]
    if len(tips) != 2 or branches:
        raise ValueError(
            f"path must be one chain with two ends, got ends {listing(tips) or 'none'} and "
            f"branches {listing(branches) or 'none'}"
        )
    node, before = tips[0], -1
    chain: list[tuple[tuple[int, ...], tuple[str, int]]] = []
    while True:
        following = [i for i in ends[node] if i != before]
        if not following:
            return chain
        before = following[0]
        corners, element = edges[before]
        forward = corners if corners[0] == node else corners[::-1]
        chain.append((forward, element))
        node = forward[-1]


# ---- shape functions -----------------------------------------------------------------------------


def _segment(
    structure: Any, nodes: tuple[int, ...], element: tuple[str, int], factors: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Dofs (k,) and coefficients (k, 4) of the displacement in a direction along an edge."""
    d = structure.dofs_per_node
    if "rz" in structure.components and element[0] == "line":
        stiffness = _stiffness(structure, element)
        if stiffness[2, 2] > 0.0:  # else a bar
            return _beam(structure, nodes, stiffness, factors)
    begin, end = structure.points[nodes[0]], structure.points[nodes[-1]]
    if len(nodes) == 3:
        away = np.linalg.norm(structure.points[nodes[1]] - (begin + end) / 2.0)
        if away > STRAIGHT * np.linalg.norm(end - begin):
            raise ValueError(
                f"path must have edges that are straight, with a node in their middle, got node "
                f"{nodes[1]} away from it by {away:g}"
            )
    shape = LINEAR if len(nodes) == 2 else QUADRATIC
    dofs = [
        d * node + structure.components.index(component) for component in factors for node in nodes
    ]
    return np.array(dofs), np.concatenate([factor * shape for factor in factors.values()])


def _beam(
    structure: Any, nodes: tuple[int, ...], stiffness: np.ndarray, factors: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Of a beam: linear along it, cubic across it."""
    along = structure.points[nodes[1]] - structure.points[nodes[0]]
    L = float(np.linalg.norm(along))
    x, y = along / L
    d_x, d_y = factors.get("ux", 0.0), factors.get("uy", 0.0)
    axial, across = d_x * x + d_y * y, d_y * x - d_x * y  # of the direction
    # Phi = 12 EI / (GA L^2), of which the entries of rz have the factors 4 + Phi and 2 - Phi
    ratio = stiffness[2, 5] / stiffness[2, 2]
    phi = max(0.0, float((2.0 - 4.0 * ratio) / (1.0 + ratio)))
    bent = (HERMITE + phi * SHEAR) / (1.0 + phi)
    # ux, uy, rz of both ends: axial and transverse displacement are x ux + y uy, x uy - y ux
    shape = np.zeros((2, 3, 4))
    for end in range(2):
        u, w = axial * LINEAR[end], across * bent[2 * end]
        shape[end] = x * u - y * w, y * u + x * w, across * L * bent[2 * end + 1]
    dofs = np.concatenate([3 * node + np.arange(3) for node in nodes])
    return dofs, shape.reshape(6, 4)


def _stiffness(structure: Any, element: tuple[str, int]) -> np.ndarray:
    """K (6, 6) of a line of a frame."""
    if structure.internal or structure.recipe is None:
        why = "internal forces, whose beams turn" if structure.internal else "no known elements"
        raise ValueError(f"path must be along beams of a linear frame, got one with {why}")
    kind, e = element
    one = Selected({kind: np.array([e])}, {kind: np.array([[0, 1]])}, 2)
    stiffness: np.ndarray = sp.csr_array(structure.recipe(one)[1]).toarray()
    return stiffness
