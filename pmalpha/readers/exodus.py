"""Meshes in files of Exodus II, which are netCDF: blocks are groups, with names or numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..files import reading
from ..meshes.mesh import Block, ElementType, FileMesh
from ..results.history_file import SIGNATURE, own_array
from .text import Unread

# Kinds by the letters of a type and its number of nodes; digits at its end repeat that
_SURFACES = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_TRIANGLES = {3: "triangle", 6: "triangle6"}
_LINES = {2: "line", 3: "line3"}
_HEXAHEDRA = {8: "hexahedron", 20: "hexahedron20"}
_TETRAHEDRA = {4: "tetra", 10: "tetra10"}
_PYRAMIDS = {5: "pyramid", 13: "pyramid13"}
TYPES: dict[str, tuple[str, dict[int, str]]] = {
    "HEX": ("SOLID", _HEXAHEDRA),
    "HEXAHEDRON": ("SOLID", _HEXAHEDRA),
    "TET": ("SOLID", _TETRAHEDRA),
    "TETRA": ("SOLID", _TETRAHEDRA),
    "WEDGE": ("SOLID", {6: "wedge", 15: "wedge15"}),
    "PYRAMID": ("SOLID", _PYRAMIDS),
    "PYRA": ("SOLID", _PYRAMIDS),
    "TRI": ("", _TRIANGLES),
    "TRIANGLE": ("", _TRIANGLES),
    "QUAD": ("", {4: "quad", 8: "quad8", 9: "quad9"}),
    "SHELL": ("SHELL", _SURFACES),
    "TRISHELL": ("SHELL", _TRIANGLES),
    "BAR": ("BAR", _LINES),
    "ROD": ("BAR", _LINES),
    "TRUSS": ("BAR", _LINES),
    "BEAM": ("BEAM", _LINES),
}
# Edges between both ends of the element come before those of its other end
ORDER = {
    "hexahedron20": (*range(12), *range(16, 20), *range(12, 16)),
    "wedge15": (*range(9), *range(12, 15), *range(9, 12)),
}
_READ = re.compile(
    r"coord[xyz]?|connect\d+|node_ns\d+|elem_ss\d+|(?:eb|ns|ss)_names|(?:eb|ns|ss)_prop1"
)


class _Array(NamedTuple):
    values: np.ndarray
    type: str  # of the elements of a block


def read_exodus(path: Path, unread: Unread) -> FileMesh:
    """Its blocks and sets of nodes; ValueError for elements that have no kind here."""
    try:
        arrays = _hdf5(path) if _is_hdf5(path) else _classic(path)
        points = _points(arrays)
    except MemoryError:
        raise
    except Exception as error:  # of several types, for damaged files
        reason = str(error) or type(error).__name__
        raise ValueError(f"mesh must be a whole file of Exodus, but {str(path)!r}: {reason}") from (
            error
        )
    blocks: list[Block] = []
    types: list[ElementType] = []
    groups: dict[str, dict[int, np.ndarray]] = {}
    for name, key in _members(arrays, "eb", "connect").items():
        nodes, word = _numbers(arrays, key), arrays[key].type.upper()
        family, kinds = TYPES.get(word.rstrip("0123456789"), ("", {}))
        if nodes.ndim != 2 or nodes.shape[1] not in kinds:
            what = f"elements {word} of {nodes.shape[-1]} nodes"
            unread.refuse(word, "GEOMETRY", f"{path.name}, block {name!r}", f"{what} are not read")
            continue
        kind = kinds[nodes.shape[1]]
        groups[name] = {len(blocks): np.arange(len(nodes))}
        blocks.append(Block(kind, nodes[:, ORDER.get(kind, range(nodes.shape[1]))]))
        types.append(ElementType(word, family))
    points_of = {
        name: np.unique(_numbers(arrays, key))
        for name, key in _members(arrays, "ns", "node_ns").items()
    }
    for name in _members(arrays, "ss", "elem_ss"):
        unread.leave_out("sets of sides {} are left out", name, "UNKNOWN")
    return FileMesh(points, blocks, groups, points_of, types)


def _is_hdf5(path: Path) -> bool:
    with reading(path) as file:
        return file.read(len(SIGNATURE)) == SIGNATURE


def _classic(path: Path) -> dict[str, _Array]:
    """Those of a file of netCDF in its classic form, or with offsets of 64 bits."""
    from scipy.io import netcdf_file

    with reading(path) as file:
        if file.read(4) not in (b"CDF\x01", b"CDF\x02"):
            raise ValueError("it must be netCDF: classic, with offsets of 64 bits, or netCDF-4")
        file.seek(0)
        variables = netcdf_file(file, mmap=False).variables
        return {
            name: _Array(np.array(x.data), _text(getattr(x, "elem_type", b"")))
            for name, x in variables.items()
            if _READ.fullmatch(name)
        }


def _hdf5(path: Path) -> dict[str, _Array]:
    """Those of a file of netCDF-4, which is HDF5."""
    import h5py

    def kind(array: Any) -> str:
        if "elem_type" not in array.attrs:
            return ""
        if array.attrs.get_id("elem_type").dtype.kind == "O":
            raise ValueError("elem_type must be of fixed length")
        return _text(array.attrs["elem_type"])

    with h5py.File(path, "r", locking=False) as root:
        stored = {name: own_array(root, name) for name in root if _READ.fullmatch(name)}
        return {name: _Array(array[()], kind(array)) for name, array in stored.items()}


def _text(x: Any) -> str:
    content = b"".join(np.asarray(x, dtype="S").ravel().tolist())
    return content.split(b"\0")[0].decode("latin-1").strip()


def _points(arrays: dict[str, _Array]) -> np.ndarray:
    """(N, dim): coord has a row for each direction."""
    if "coord" in arrays:
        return np.ascontiguousarray(np.asarray(arrays["coord"].values, dtype=float).T)
    rows = [arrays[name].values for name in ("coordx", "coordy", "coordz") if name in arrays]
    if not rows:
        raise ValueError("it must have coord, or coordx, coordy and coordz")
    return np.stack(rows, axis=1).astype(float)


def _members(arrays: dict[str, _Array], prefix: str, array: str) -> dict[str, str]:
    """By name the arrays of blocks or sets: by their number where they have no name of their own.

    A block or set without elements has no array.
    """
    names = arrays.get(f"{prefix}_names")
    texts = [_text(x) for x in names.values] if names is not None else []
    number = arrays.get(f"{prefix}_prop1")
    numbers = np.ravel(number.values).tolist() if number is not None else []
    members: dict[str, str] = {}
    for k in sorted(int(key[len(array) :]) for key in arrays if re.match(rf"{array}\d", key)):
        name = texts[k - 1] if 0 < k <= len(texts) else ""
        name = name or str(numbers[k - 1] if 0 < k <= len(numbers) else k)
        while name in members:
            name = f"{name} ({k})"
        members[name] = f"{array}{k}"
    return members


def _numbers(arrays: dict[str, _Array], key: str) -> np.ndarray:
    values = arrays[key].values
    if values.dtype.kind not in "iu":
        raise ValueError(f"mesh must have whole numbers in {key}, got {values.dtype}")
    return values.astype(np.int64) - 1
