"""What follows from a motion of a structure: stresses, forces of line elements, storey drifts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import check_word, real_array, real_number
from ..files import library
from ..meshes.mesh import KINDS, checked_mesh, nodal_vectors, padded
from ..results.times import on_mesh

# The rows of an element of `Structure.element_stresses`, by its dimension.
COMPONENTS = {2: ("xx", "yy", "xy"), 3: ("xx", "yy", "zz", "xy", "yz", "xz")}
# Components of a node for which the rigid-body motions are known.
BAR, BEAM = ("ux",), ("ux", "uy", "rz")
# Heights and forces are equal up to this fraction of the largest one.
EQUAL = 1e-9


def nodal_stress(structure: Any, u: Any, what: str) -> np.ndarray:
    u = real_array(u, "u", (1, 2))
    if u.shape[-1] != structure.n:
        raise ValueError(f"u must have {structure.n} in the last dimension, got shape {u.shape}")
    S = structure.element_stresses()
    names = COMPONENTS[structure.points.shape[1]]
    check_word(what, "what", ("mises", *names))
    elements = np.asarray(u @ S.T).reshape(*u.shape[:-1], -1, len(names))
    across = [
        np.broadcast_to(moduli.across, len(structure.elements[kind]))
        for kind, moduli in structure.moduli.items()
    ]
    values = (
        _mises(elements, np.concatenate(across))
        if what == "mises"
        else elements[..., names.index(what)]
    )
    blocks = [structure.elements[kind] for kind in structure.moduli]
    nodes = np.concatenate([block.ravel() for block in blocks])
    widths = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    meet = sp.csr_array(
        (np.ones(nodes.size), (np.repeat(np.arange(widths.size), widths), nodes)),
        shape=(widths.size, len(structure.points)),
    )
    count = np.bincount(nodes, minlength=len(structure.points))
    result: np.ndarray = (values @ meet) / np.maximum(count, 1)
    return result


def _mises(s: np.ndarray, across: np.ndarray) -> np.ndarray:
    """sqrt(3 J2) of stresses (..., E, components); across the plane zz = across (xx + yy)."""
    d = 2 if s.shape[-1] == 3 else 3
    normal = [s[..., i] for i in range(d)]
    if d == 2:
        normal.append(across * (normal[0] + normal[1]))
    xx, yy, zz = normal
    shear = sum(s[..., i] ** 2 for i in range(d, s.shape[-1]))
    J = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * shear
    result: np.ndarray = np.sqrt(J)
    return result


def line_forces(
    K: sp.csr_array, points: np.ndarray, lines: np.ndarray, components: tuple[str, ...]
) -> sp.csr_array:
    if np.unique(np.sort(lines, axis=1), axis=0).shape != lines.shape:
        raise ValueError("element_forces needs one element at most between two nodes")
    first, second = lines.T
    d = len(components)
    of_first, of_second = _blocks(K, first, second, d), _blocks(K, second, first, d)
    along = points[second] - points[first]
    if components == BAR:  # the normal force is the force at the second end
        rows = np.concatenate([of_second, -of_second], axis=2)
        return _placed(rows, lines, d, K.shape[1])
    at_first = np.concatenate([-of_first @ _rigid(along), of_first], axis=2)
    at_second = np.concatenate([of_second, -of_second @ _rigid(-along)], axis=2)
    R = rotations(along / np.hypot(*along.T)[:, None])
    return _placed(np.concatenate([R @ at_first, R @ at_second], axis=1), lines, d, K.shape[1])


def _blocks(K: sp.csr_array, i: np.ndarray, j: np.ndarray, d: int) -> np.ndarray:
    """(E, d, d): K between the dofs of nodes i and those of nodes j."""
    rows = np.repeat(d * i[:, None] + np.arange(d), d, axis=1)
    columns = np.tile(d * j[:, None] + np.arange(d), (1, d))
    return np.asarray(K[rows.ravel(), columns.ravel()]).reshape(-1, d, d)


def _rigid(along: np.ndarray) -> np.ndarray:
    """(E, 3, 3): motion of the other node, at this distance, per motion of a node."""
    B = np.broadcast_to(np.eye(3), (len(along), 3, 3)).copy()
    B[:, 0, 2], B[:, 1, 2] = -along[:, 1], along[:, 0]
    return B


def rotations(direction: np.ndarray) -> np.ndarray:
    """(E, 3, 3): from global axes to those of elements in this direction, (E, 2)."""
    c, s = direction.T
    R = np.zeros((len(c), 3, 3))
    R[:, 0, 0], R[:, 0, 1] = c, s
    R[:, 1, 0], R[:, 1, 1] = -s, c
    R[:, 2, 2] = 1.0
    return R


def _placed(rows: np.ndarray, lines: np.ndarray, d: int, n: int) -> sp.csr_array:
    """The matrices (E, r, 2 d) of the elements, one below the other, on all dofs."""
    elements, height, width = rows.shape
    columns = (d * lines[:, :, None] + np.arange(d)).reshape(elements, 1, width)
    columns = np.repeat(columns, height, axis=1)
    start = width * np.arange(elements * height + 1)
    matrix = sp.csr_array((rows.ravel(), columns.ravel(), start), shape=(elements * height, n))
    matrix.eliminate_zeros()
    return matrix


def storey_drifts(structure: Any, component: str) -> sp.csr_array:
    levels, is_grounded = _storeys(structure, component, "storey_drifts")
    means = [_mean(structure, nodes, component) for nodes in levels]
    if is_grounded:
        means.insert(0, sp.csr_array((1, structure.n)))  # the ground is the level below
    return sp.csr_array(sp.vstack([b - a for a, b in zip(means, means[1:])], format="csr"))


def storey_shears(structure: Any, component: str) -> sp.csr_array:
    """Minus the rows of K, summed over all nodes above the lower level of each storey: forces
    between these nodes have the sum zero."""
    levels, is_grounded = _storeys(structure, component, "storey_shears")
    heights = structure.points[:, -1]
    tolerance = EQUAL * np.ptp(structure.points, axis=0).max()
    lower = [-np.inf] * is_grounded + [heights[nodes].max() + tolerance for nodes in levels[:-1]]
    above = sp.csr_array((heights > np.array(lower)[:, None]).astype(float))
    nodes = np.arange(len(heights))
    rows = sp.csr_array(structure.K)[structure.dofs(nodes, component)]
    return sp.csr_array(-(above @ rows))


def _storeys(structure: Any, component: str, what: str) -> tuple[list[np.ndarray], bool]:
    """The nodes of each level, and whether the ground is a level below them."""
    if set(structure.elements) != {"line"} or component not in structure.components:
        raise ValueError(
            f"{what} needs elements 'line' with a component {component!r}, got "
            f"{sorted(structure.elements)} with {structure.components}"
        )
    along = structure.points.shape[1] == 1
    order = np.argsort(structure.points[:, 0], kind="stable")
    levels = list(order[:, None]) if along else levels_of(structure)
    springs = ground_springs(structure, component)[: structure.dofs_per_node]
    is_grounded = along and bool(springs.any())
    if len(levels) + is_grounded < 2:
        raise ValueError(f"{what} needs two levels with horizontal members, got fewer")
    return levels, is_grounded


def levels_of(structure: Any) -> list[np.ndarray]:
    """The nodes of each level, from the lowest: the feet, and where horizontal members end."""
    heights = structure.points[:, -1]
    tolerance = EQUAL * np.ptp(structure.points, axis=0).max()
    ends = structure.elements["line"]
    horizontal = np.abs(heights[ends[:, 1]] - heights[ends[:, 0]]) <= tolerance
    of_beams = np.unique(ends[horizontal])
    lowest = np.flatnonzero(heights <= heights.min() + tolerance)
    nodes = np.union1d(of_beams, lowest)
    order = nodes[np.argsort(heights[nodes], kind="stable")]
    steps = np.flatnonzero(np.diff(heights[order]) > tolerance) + 1
    return np.split(order, steps)


def base_shear(structure: Any, nodes: Any, component: str) -> sp.csr_array:
    K = sp.csr_array(structure.K)
    if nodes is None:
        springs = ground_springs(structure, component)
        if springs.any():
            return sp.csr_array(-springs[None, :])
        heights = structure.points[:, -1]
        nodes = np.flatnonzero(heights <= heights.min() + EQUAL * np.ptp(heights))
    rows = K[structure.dofs(nodes, component)]
    return sp.csr_array(np.ones((1, rows.shape[0])) @ rows)


def ground_springs(structure: Any, component: str) -> np.ndarray:
    """Stiffness of springs to the ground at each dof: the forces of a unit translation."""
    unit = np.zeros(structure.n)
    unit[structure.components.index(component) :: structure.dofs_per_node] = 1.0
    K = sp.csr_array(structure.K)
    springs: np.ndarray = K @ unit
    springs[np.abs(springs) <= EQUAL * np.abs(K).max()] = 0.0
    return springs


def _mean(structure: Any, nodes: np.ndarray, component: str) -> sp.csr_array:
    """The row of the mean displacement of some nodes."""
    dofs = structure.dofs(nodes, component)
    where = (np.zeros(dofs.size, int), dofs)
    return sp.csr_array((np.full(dofs.size, 1.0 / dofs.size), where), shape=(1, structure.n))


# ---- pyvista grid -------------------------------------------------------------------------------
# A mesh with its motion as a grid of PyVista.


def grid_of(
    structure: Any, motion: Any, t: Any, cells: Mapping[str, np.ndarray] | None = None
) -> Any:
    """The implementation of `Structure.to_pyvista`, with numbers of the elements by name."""
    pyvista = library("pyvista", "to_pyvista", "pyvista")
    mesh = checked_mesh(structure.points, structure.elements)
    rows, kinds = [], []
    for kind, nodes in mesh.blocks:
        rows.append(np.insert(nodes, 0, nodes.shape[1], axis=1).ravel())
        kinds.append(np.full(len(nodes), KINDS[kind].vtk, dtype=np.uint8))
    points = np.ascontiguousarray(padded(mesh.points, 3))
    grid = pyvista.UnstructuredGrid(np.concatenate(rows), np.concatenate(kinds), points)
    for name, numbers in (cells or {}).items():
        grid.cell_data[name] = numbers
    if motion is None:
        return grid
    if not hasattr(motion, "u"):
        grid.point_data["displacement"] = padded(nodal_vectors(motion, mesh, "motion"), 3)
        return grid
    k = -1 if t is None else _level(motion, t)
    for name, kind in (("displacement", "u"), ("velocity", "v"), ("acceleration", "a")):
        grid.point_data[name] = padded(nodal_vectors(on_mesh(motion, kind)[k], mesh, "motion"), 3)
    grid.field_data["time"] = [motion.t[k]]
    return grid


def _level(motion: Any, t: Any) -> int:
    """The recorded time level that is nearest to t."""
    times = np.asarray(motion.t)
    time = real_number(t, "t", low=float(times[0]), high=float(times[-1]))
    return int(np.argmin(np.abs(times - time)))
