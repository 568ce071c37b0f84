"""Meshes of files, with the names in them: Abaqus by our own reader, all others by meshio."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._checks import listing
from ..problem.kinds import KINDS
from .inp import Input
from .mesh import Block


class FileMesh(NamedTuple):
    """Points (N, dim) and blocks of cells.

    Groups have the numbers of their cells in each block; points are those of named sets of points.
    """

    points: np.ndarray
    blocks: list[Block]
    groups: dict[str, list[np.ndarray]]
    points_of: dict[str, np.ndarray]


def read_mesh(mesh: Any, names: str | None) -> FileMesh:
    """A file, or a mesh of meshio; `names` is the name of cell data that number groups."""
    if isinstance(mesh, (str, os.PathLike)):
        path = Path(mesh)
        if not path.is_file():
            raise FileNotFoundError(f"mesh must be a file, got {str(mesh)!r}, which does not exist")
        if path.suffix.lower() == ".inp":
            return _of_input(Input(path), names)
        mesh = _read(path)
    if not all(hasattr(mesh, name) for name in ("points", "cells", "cell_sets", "point_sets")):
        raise TypeError(f"mesh must be a path or a mesh of meshio, got {mesh!r}")
    return _of_meshio(mesh, names)


def _read(path: Path) -> Any:
    meshio = _meshio(path)
    try:
        return meshio.read(path, file_format=_format(path))
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # of a dozen types, for damaged files
        reason = str(error) or type(error).__name__
        raise ValueError(f"mesh must be a whole file, but {str(path)!r}: {reason}") from error


def _meshio(path: Path) -> Any:
    try:
        import meshio
    except ImportError as error:
        raise ImportError(
            f"reading {path.name!r} requires meshio: pip install pmalpha[mesh]"
        ) from error
    return meshio


def _format(path: Path) -> str | None:
    """None where the suffix is enough: a .msh file is one of Ansys if it begins with "(".

    meshio tries Ansys first, whose reader does not end for some files of other kinds.
    """
    with path.open("rb") as file:
        return "gmsh" if path.suffix == ".msh" and file.read(1) != b"(" else None


def _of_input(read: Input, names: str | None) -> FileMesh:
    if names is not None:
        raise ValueError(f"names must be None for an .inp file, which has sets, got {names!r}")
    groups = {}
    for name, places in read.elements.items():
        pairs = np.array(places, dtype=np.int64).reshape(-1, 2)
        groups[name] = [np.unique(pairs[pairs[:, 0] == b, 1]) for b in range(len(read.blocks))]
    points_of = {name: np.unique(np.array(x, dtype=np.int64)) for name, x in read.nodes.items()}
    return FileMesh(read.points, read.blocks, groups, points_of)


def _of_meshio(mesh: Any, names: str | None) -> FileMesh:
    blocks = [Block(cells.type, np.asarray(cells.data)) for cells in mesh.cells]
    groups: dict[str, list[np.ndarray]] = {}
    for name, members in (mesh.cell_sets or {}).items():
        if not name.startswith("gmsh:"):
            groups[name] = [_numbers(x) for x in members]
    for name, own in {**_physical(mesh, blocks), **_numbered(mesh, names)}.items():
        known = groups.get(name, len(blocks) * [_numbers(None)])
        groups[name] = [np.union1d(a, b) for a, b in zip(known, own)]
    points_of = {name: np.unique(_numbers(x)) for name, x in (mesh.point_sets or {}).items()}
    return FileMesh(np.asarray(mesh.points, dtype=float), blocks, groups, points_of)


def _numbers(members: Any) -> np.ndarray:
    return np.array([] if members is None else members, dtype=np.int64)


def _physical(mesh: Any, blocks: list[Block]) -> dict[str, list[np.ndarray]]:
    """The physical groups of gmsh: by name, or by number where they have none."""
    tags = mesh.cell_data.get("gmsh:physical")
    if tags is None:
        return {}
    named = {(int(tag), int(d)): name for name, (tag, d) in mesh.field_data.items()}
    groups: dict[str, list[np.ndarray]] = {}
    for number, (block, own) in enumerate(zip(blocks, tags)):
        d = KINDS[block.kind].dimension if block.kind in KINDS else 0
        for tag in np.unique(own).tolist():
            if tag != 0:  # no group
                name = named.get((tag, d), str(tag))
                members = groups.setdefault(name, len(blocks) * [_numbers(None)])
                members[number] = np.flatnonzero(np.asarray(own) == tag)
    return groups


def _numbered(mesh: Any, names: str | None) -> dict[str, list[np.ndarray]]:
    """Groups of equal cell data, named by their value."""
    if names is None:
        return {}
    if names not in mesh.cell_data:
        known = listing([repr(x) for x in mesh.cell_data]) or "none"
        raise ValueError(f"names must be that of cell data of the mesh ({known}), got {names!r}")
    data = [np.asarray(x) for x in mesh.cell_data[names]]
    if any(x.ndim != 1 or x.dtype.kind not in "iu" for x in data):
        raise ValueError(f"names must be that of whole numbers by cell, got {names!r}")
    values = np.unique(np.concatenate(data)).tolist()
    return {str(value): [np.flatnonzero(x == value) for x in data] for value in values}
