"""A mesh with its motion as a grid of PyVista."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._checks import real_number
from ..files import library
from ..meshes.kinds import KINDS
from ..meshes.mesh import checked_mesh, nodal_vectors, padded
from ..results.dof_motion import on_mesh


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
