"""Meshes of files, with the names in them: Abaqus and Nastran by our own code, others by libraries.

Of the readers of meshlane and meshio, which are the same but for gmsh and MED, those are used that
read no other file, and end for every damaged file of campaign_files.py, one of them since what it
reads from raises an exception behind its end.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import math
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .._checks import listing, require_finite, require_moderate
from ..files import reading
from ..memory import require
from ..meshes.mesh import (
    KINDS,
    SHAPES,
    Block,
    ElementType,
    FileMesh,
    dimension_of_kind,
    first_of_equal,
    without_cells,
)
from ..results.history_file import SIGNATURE, own_array
from .bulk import is_model, read_bulk, read_model
from .exodus import read_exodus
from .inp import read_input
from .text import Unread

# ---- gmsh entities ------------------------------------------------------------------------------
# Physical groups of the entities in files of gmsh of format 4, where each may be in several.
# Libraries of meshes take the first group of an entity, and refuse files in which one has none.

# By dimension and number of an entity the numbers of its groups
EntityGroups = dict[tuple[int, int], set[int]]

_FORMAT = re.compile(rb"\$MeshFormat\s+(\d+)(?:\.(\d+))?\s+(\d)\s+(\d+)")
_ENTITIES = re.compile(rb"\$Entities\s*?\n(.*?)\$EndEntities[^\n]*\n?", re.DOTALL)


def without_entities(content: bytes) -> tuple[bytes, EntityGroups | None]:
    """A file without its entities, and their groups; None where it has none, as before format 4."""
    form, entities = _FORMAT.search(content), _ENTITIES.search(content)
    if form is None or entities is None:
        return content, None
    if b"$PartitionedEntities" in content:
        raise ValueError("partitions have groups of their own: save it with Mesh.PartitionOldStyle")
    major, minor, binary, size = (int(x or 0) for x in form.groups())
    is_point_short = (major, minor) != (4, 0)  # a point has three coordinates, not a box
    fields = _Binary(entities[1], size) if binary else _Text(entities[1])
    return content[: entities.start()] + content[entities.end() :], _groups(fields, is_point_short)


def _groups(fields: Any, is_point_short: bool) -> EntityGroups:
    groups: EntityGroups = {}
    for dimension, count in enumerate(fields.sizes(4)):
        for _ in range(count):
            (tag,) = fields.integers(1)
            fields.reals(3 if dimension == 0 and is_point_short else 6)
            # those in which the entity is reversed have negative numbers
            groups[dimension, tag] = {abs(x) for x in fields.integers(*fields.sizes(1))}
            if dimension:
                fields.integers(*fields.sizes(1))
    return groups


class _Text:
    def __init__(self, body: bytes):
        self.words = body.split()
        self.at = 0

    def integers(self, count: int) -> list[int]:
        return [int(x) for x in self._words(count)]

    sizes = integers

    def reals(self, count: int) -> None:
        self._words(count)

    def _words(self, count: int) -> list[bytes]:
        words = self.words[self.at : self.at + count]
        if len(words) < count:
            raise EOFError("entities end too early")
        self.at += count
        return words


class _Binary:
    def __init__(self, body: bytes, size: int):
        self.body = body
        self.size = f"u{size}"
        self.at = 0

    def integers(self, count: int, kind: str = "i4") -> list[int]:
        width = np.dtype(kind).itemsize
        if count * width > len(self.body) - self.at:
            raise EOFError("entities end too early")
        values = np.frombuffer(self.body, dtype=kind, count=count, offset=self.at)
        self.at += count * width
        return [int(x) for x in values]

    def sizes(self, count: int) -> list[int]:
        return self.integers(count, self.size)

    def reals(self, count: int) -> None:
        self.integers(count, "i8")


# ---- skfem meshes -------------------------------------------------------------------------------
# Meshes of scikit-fem: its order of nodes, subdomains and boundaries.

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


# ---- mesh files ---------------------------------------------------------------------------------

# Of each group the cells by the number of a block
Groups: TypeAlias = dict[str, dict[int, np.ndarray]]

# Formats of both by suffix; a .msh file may also be one of Ansys. Left out: HMF, mdpa, OFF, PLY,
# Tecplot, TetGen and WKT, whose readers do not end for some damaged files, XDMF and DOLFIN, which
# name other files, and formats of libraries that are not tested here.
FORMATS = {
    ".avs": "avsucd",
    ".cdb": "ansysInp",
    ".cgns": "cgns",
    ".dato": "permas",
    ".h5m": "h5m",
    ".med": "med",
    ".mesh": "medit",
    ".meshb": "medit",
    ".msh": "gmsh",
    ".obj": "obj",
    ".post": "permas",
    ".stl": "stl",
    ".ugrid": "ugrid",
    ".vol": "netgen",
    ".vtk": "vtk",
    ".vtu": "vtu",
}
# Texts in a file of MOAB that name its programs, of any length; no reader reads them.
HISTORY = "tstt/history"
# Bytes that a reader takes for a point of a grid of VTK: coordinates and a cell, each twice.
POINT_OF_GRID = 200
# Reads at the end that a reader may make.
MOST_ENDS = 100
OWN_READERS: dict[str, Callable[[Path, Unread], FileMesh]] = {
    ".inp": read_input,
    **dict.fromkeys((".bdf", ".dat", ".fem", ".nas"), read_bulk),
    **dict.fromkeys((".e", ".ex2", ".exii", ".exo", ".exodus", ".g", ".gen"), read_exodus),
}


def read_mesh(mesh: Any, names: str | None, unread: Unread) -> FileMesh:
    """A file, or a mesh of a library; `names` is the name of cell data that number groups."""
    if is_model(mesh):
        return _checked(read_model(mesh, unread), unread)
    if is_skfem_mesh(mesh):
        return _checked(read_skfem(mesh), unread)
    path = None
    if isinstance(mesh, (str, os.PathLike)):
        path = Path(mesh)
        if not path.is_file():
            raise FileNotFoundError(f"mesh must be a file, got {str(mesh)!r}, which does not exist")
        reader = OWN_READERS.get(path.suffix.lower())
        if reader is not None and names is not None:
            raise ValueError(
                f"names must be None for an {path.suffix} file, which has groups, got {names!r}"
            )
        if reader is not None:
            return _checked(reader(path, unread), unread)
        mesh = _read(path, unread)
    if not all(hasattr(mesh, name) for name in ("points", "cells", "cell_sets", "point_sets")):
        raise TypeError(
            f"mesh must be a path or a mesh of meshlane, meshio or scikit-fem, got {mesh!r}"
        )
    read = _of_library(mesh, names)
    if path is not None and path.suffix.lower() == ".cdb":
        # its reader gives plane elements and shells alike
        either = ElementType("PLANE or SHELL", "SHELL")
        surfaces = [dimension_of_kind(block.kind) == 2 for block in read.blocks]
        read = read._replace(types=[either if x else ElementType() for x in surfaces])
    return _checked(read, unread)


def _checked(read: FileMesh, unread: Unread) -> FileMesh:
    """The mesh with its numbers checked, and cells with the same nodes as one cell.

    Formats that know one group of a cell, such as MSH 2.2 of gmsh, repeat those of several; of
    formats whose elements have types those that are left out are counted.
    """
    _check(read)
    first = first_of_equal(read.blocks)
    equal = np.flatnonzero(first != np.arange(first.size))
    if not equal.size:
        return read
    block_of = np.repeat(np.arange(len(read.blocks)), [len(x.nodes) for x in read.blocks])
    for i, j in {*zip(block_of[equal].tolist(), block_of[first[equal]].tolist())}:
        kinds = read.blocks[j].kind, read.blocks[i].kind
        if kinds[0] != kinds[1]:
            raise ValueError(f"mesh must not have {kinds[0]} and {kinds[1]} with the same nodes")
        name = read.types[i].name
        count = np.count_nonzero((block_of[equal] == i) & (block_of[first[equal]] == j))
        what = "elements {} that have the nodes of another one are left out"
        unread.leave_out(what, name, "GEOMETRY", int(count) if name else 0)
    return without_cells(read, first)


def mesh_library(use: str) -> Any:
    """meshlane, or meshio, from which it comes, which has no maintainer; else ImportError."""
    for name in ("meshlane", "meshio"):
        with contextlib.suppress(ImportError):
            return import_module(name)
    raise ImportError(f"{use} needs meshlane or meshio: pip install 'pmalpha[mesh]'")


def _read(path: Path, unread: Unread) -> Any:
    reader = mesh_library(f"reading {path.name!r}")
    file_format = _format(path)
    if not hasattr(reader, file_format):
        raise ImportError(f"reading {path.name!r} needs meshlane: pip install meshlane")
    read = getattr(reader, file_format).read  # that of all formats prints why, and ends Python
    said = io.StringIO()  # what the library prints, such as that it leaves something out
    if file_format == "ansysInp":
        _require_blocks(path, unread)
    try:
        _require_own_arrays(path)
        if file_format == "vtk":
            _require_memory_of_grids(path)
        if file_format in TYPES_OF_CELLS:
            _require_known_cells(path, file_format)
        with contextlib.redirect_stderr(said):
            if file_format in SPECIAL:
                mesh = SPECIAL[file_format](path, read)
            else:
                mesh = read(str(path))
        _count_cells(path, file_format, mesh, unread)
    except MemoryError:
        raise
    except Exception as error:  # of a dozen types, for damaged files
        reason = str(error) or f"the reader of {file_format} gives no reason"
        is_cut_off = isinstance(error, EOFError)
        what = "a whole file" if is_cut_off else f"a file that {reader.__name__} reads"
        raise ValueError(f"mesh must be {what}, but {str(path)!r}: {reason}") from error
    for text in said.getvalue().split("Warning:")[1:]:
        unread.leave_out(f"{reader.__name__} reports: {{}}", " ".join(text.split()), "UNKNOWN")
    return mesh


def _require_blocks(path: Path, unread: Unread) -> None:
    """ValueError for commands of Ansys with nodes, elements and connections outside of blocks."""
    with reading(path) as file:
        for number, line in enumerate(file, start=1):
            command = COMMANDS.match(line)
            if command:
                name = command[1].decode().upper()
                family = "CONNECTION" if name in ("CE", "CP") else "GEOMETRY"
                reason = "only NBLOCK, EBLOCK and CMBLOCK are read"
                unread.refuse(name, family, f"{path.name}, line {number}, {name}", reason)


def _require_known_cells(path: Path, file_format: str) -> None:
    """ValueError for types of cells of VTK, as far as they are text, that no library here reads."""
    with reading(path) as file:
        content = file.read()
    for array in TYPES_OF_CELLS[file_format].finditer(content):
        types = array[1].split()
        for number, (name, instead) in UNKNOWN_CELLS.items():
            count = types.count(b"%d" % number)
            if count:
                raise ValueError(
                    f"{name} (cell type {number} of VTK, {count} of them) are not read: save "
                    f"{instead} in their place"
                )


def _count_cells(path: Path, file_format: str, mesh: Any, unread: Unread) -> None:
    """What a library has left out in silence: elements of contact; of VTK, such as voxels."""
    if file_format not in CELLS:
        return
    with reading(path) as file:
        count = sum(int(x) for x in re.findall(CELLS[file_format], file.read()))
    left = count - sum(len(cells.data) for cells in mesh.cells)
    if count and left and file_format != "ansysInp":
        raise ValueError(f"{left} of its cells are of other types, such as voxels and pixels")
    unread.leave_out("elements of {} are left out", "contact", "CONNECTION", max(left, 0))


def _read_vtk(path: Path, read: Callable[[str], Any]) -> Any:
    """Numbers that are called vtkIdType, of which libraries do not know the size, have 32 bits."""
    with reading(path) as file:
        text = file.read()
    known = re.sub(rb"(?i)(?<=\s)vtkIdType(?=\s)", b"int", text)
    return read(str(path)) if known == text else _read_as(known, path, read)


def _read_gmsh(path: Path, read: Callable[[str], Any]) -> Any:
    """With all groups of each entity, of which libraries take the first."""
    with reading(path) as file:
        content = file.read()
    if b"$MeshFormat" not in content:
        old = ", but $NOD of its first version" if b"$NOD" in content else ""
        raise ValueError(f"it has no $MeshFormat, with which files of gmsh begin{old}")
    content, groups = without_entities(content)
    if groups is None:
        return read(str(path))
    mesh = _read_as(content, path, read)
    names = {(int(tag), int(d)): name for name, (tag, d) in mesh.field_data.items()}
    tags = mesh.cell_data.get("gmsh:geometrical", [])
    for i, (cells, entity) in enumerate(zip(mesh.cells, tags)):
        d = dimension_of_kind(cells.type)
        for group in groups.get((d, int(entity[0])), ()) if len(entity) else ():
            name = names.get((group, d), str(group))
            members = mesh.cell_sets.setdefault(name, len(mesh.cells) * [None])
            members[i] = np.arange(len(cells.data))
    return mesh


def _read_as(content: bytes, path: Path, read: Callable[[str], Any]) -> Any:
    """The mesh of a file if it had this content."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        copy.write_bytes(content)
        return read(str(copy))


def _format(path: Path) -> str:
    """The format, as both libraries name it: a .msh file is one of Ansys if it begins with "("."""
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        raise ValueError(f"mesh must be another file than {path.name!r}: {NOT_READ[suffix]}")
    if suffix not in FORMATS:
        raise ValueError(
            f"mesh must be a file with suffix {', '.join(FORMATS)} or .inp, got {path.name!r}; "
            "give meshlane.read(path) or meshio.read(path) for a file that you trust: the readers "
            "of other formats may read other files, or never end"
        )
    with reading(path) as file:
        begin = file.read(16).removeprefix(codecs.BOM_UTF8).lstrip()[:1]
        return "ansys" if suffix == ".msh" and begin == b"(" else FORMATS[suffix]


class _Bytes(io.BufferedReader):
    """Bytes of a file, of which there is an end."""

    def __init__(self, path: Path):
        super().__init__(io.FileIO(path))
        self.ends = 0

    def read(self, size: int | None = -1, /) -> bytes:
        return self._more(super().read(size))

    def readline(self, size: int | None = -1, /) -> bytes:
        return self._more(super().readline(size))

    def _more(self, content: bytes) -> bytes:
        self.ends += not content
        if self.ends > MOST_ENDS:
            raise EOFError("it ends too early")
        return content


def _read_ansys(path: Path, read: Callable[[Any], Any]) -> Any:
    with reading(path) as file:
        if FACES_OF_FLUENT.search(file.read()):
            raise ValueError(
                "a mesh of Fluent lists the faces between cells and not the nodes of cells; save "
                "it for a structural program, such as .cdb, .inp or .bdf"
            )
    with _Bytes(path) as file:
        return read(file)


# Formats that neither library reads, and a way
NOT_READ = {
    ".unv": "I-DEAS files are read by neither meshlane nor meshio; Gmsh opens them and saves .msh"
}
# A list of faces of a mesh of Fluent: section 13, or 2013 and 3013 in binary, of a zone
FACES_OF_FLUENT = re.compile(rb"\(\s*(?:20|30)?13\s*\(\s*0*[1-9a-fA-F]")
# Formats that are read in a way of their own
SPECIAL: dict[str, Callable[[Path, Any], Any]] = {
    "ansys": _read_ansys,
    "gmsh": _read_gmsh,
    "vtk": _read_vtk,
}
# Commands of Ansys beside blocks; "N,R5.3,LOC,-1" ends a block
COMMANDS = re.compile(rb"(?i)\s*(CE|CP|EN|E|N)\s*,(?!\s*R5\.\d\s*,\s*LOC\s*,\s*-1)")
# Where types of cells are written as text, and what no library here reads of them
TYPES_OF_CELLS = {
    "vtk": re.compile(rb"(?im)^[^\S\n]*CELL_TYPES\s+\d+\s+([\d\s]*)"),
    "vtu": re.compile(rb"""(?i)<DataArray\b[^>]*\bName\s*=\s*["']types["'][^>]*>([\d\s]*)<"""),
}
UNKNOWN_CELLS = {
    6: ("triangle strips", "triangles"),
    8: ("pixels", "quads"),
    11: ("voxels", "hexahedra"),
    42: ("polyhedra", "tetrahedra or hexahedra"),
}
# What counts the cells of a file
CELLS = {
    "ansysInp": re.compile(rb"(?im)^\s*EBLOCK\s*,[^,\n]*,[^,\n]*,[^,\n]*,\s*(\d+)"),
    "vtk": re.compile(rb"(?im)^[^\S\n]*CELL_TYPES\s+(\d+)"),
    "vtu": re.compile(rb"""NumberOfCells\s*=\s*["']\s*(\d+)"""),
}


def _require_own_arrays(path: Path) -> None:
    """ValueError for an HDF5 file with anything that `own_array` refuses."""
    with reading(path) as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            return
    import h5py

    def check(name: str, place: Any) -> None:
        for key in place.attrs:
            if place.attrs.get_id(key).dtype.kind == "O":
                raise ValueError(f"attribute {key} of /{name} must be of fixed length")
        if isinstance(place, h5py.Dataset):
            alone = h5py.h5o.get_info(place.id).rc == 1  # not of another name too
            if not (name == HISTORY and place.dtype.kind == "O" and alone):
                own_array(root, name)
            return
        for key in place if isinstance(place, h5py.Group) else ():  # else a named type of data
            if isinstance(place.get(key, getlink=True), h5py.ExternalLink):
                raise ValueError(f"{name}/{key} leads to another file")

    with h5py.File(path, "r", locking=False) as root:
        check("", root)
        root.visititems(check)


def _require_memory_of_grids(path: Path) -> None:
    """MemoryError for a grid of VTK, which three numbers describe, that memory cannot hold."""
    with reading(path) as file:
        for dimensions in re.finditer(
            rb"(?im)^[^\S\n]*DIMENSIONS\s+(\d+)\s+(\d+)\s+(\d+)", file.read()
        ):
            points = math.prod(map(int, dimensions.groups()))
            require(POINT_OF_GRID * points, f"the grid of {path.name!r}")


def _of_library(mesh: Any, names: str | None) -> FileMesh:
    blocks = [Block(cells.type, _rows(cells)) for cells in mesh.cells]
    groups: Groups = {}
    for name, members in (mesh.cell_sets or {}).items():
        if not name.startswith("gmsh:"):
            groups[name] = {i: x for i, x in enumerate(map(_numbers, members)) if x.size}
    for name, arrays in {**_physical(mesh, blocks), **_numbered(mesh, names)}.items():
        known, none = groups.get(name, {}), _numbers(None)
        numbers = sorted({*known, *arrays})
        groups[name] = {i: np.union1d(known.get(i, none), arrays.get(i, none)) for i in numbers}
    points_of = {name: np.unique(_numbers(x)) for name, x in (mesh.point_sets or {}).items()}
    points = np.asarray(mesh.points, dtype=float)
    return FileMesh(points, blocks, groups, points_of, len(blocks) * [ElementType()])


def _rows(cells: Any) -> np.ndarray:
    """Nodes of cells; ValueError for polygons of different sizes, in meshlane a list."""
    if isinstance(cells.data, list) and len({len(row) for row in cells.data}) > 1:
        raise ValueError(f"mesh must have cells of one size in each block, got {cells.type!r}")
    return np.asarray(cells.data)


def _check(read: FileMesh) -> None:
    """ValueError for nodes, and members of groups and sets, that the mesh does not have."""
    shape = read.points.shape
    if len(shape) != 2 or shape[1] not in (2, 3):
        raise ValueError(f"mesh must have points of shape (N, 2) or (N, 3), got {shape}")
    for block in read.blocks:
        nodes, kind = block.nodes, block.kind
        width = KINDS[kind].nodes if kind in KINDS else nodes.shape[-1]
        if nodes.dtype.kind not in "iu" or nodes.ndim != 2 or nodes.shape[1] != width:
            raise ValueError(
                f"mesh must have the numbers of {width} nodes for each {kind!r}, got an array of "
                f"shape {nodes.shape}, dtype {nodes.dtype}"
            )
        _require_below(nodes, len(read.points), f"nodes of {kind!r}")
        if kind in KINDS:
            used = read.points[nodes]
            require_finite(used, f"points of {kind!r} in the mesh")
            require_moderate(used, f"points of {kind!r} in the mesh")
    for name, members in read.groups.items():
        for i, elements in members.items():
            _require_below(elements, len(read.blocks[i].nodes), f"elements of group {name!r}")
    for name, points in read.points_of.items():
        _require_below(points, len(read.points), f"points of set {name!r}")


def _require_below(numbers: np.ndarray, count: int, what: str) -> None:
    outside = numbers[(numbers < 0) | (numbers >= count)]
    if outside.size:
        raise ValueError(f"mesh must have {what} in 0..{count - 1}, got {outside.flat[0]}")


def _numbers(members: Any) -> np.ndarray:
    return np.array([] if members is None else members, dtype=np.int64)


def _physical(mesh: Any, blocks: list[Block]) -> Groups:
    """The physical groups of gmsh: by name, or by number where they have none.

    A negative number is that of the group in which the entity is reversed.
    """
    tags = mesh.cell_data.get("gmsh:physical")
    if tags is None:
        return {}
    named = {(int(tag), int(d)): name for name, (tag, d) in mesh.field_data.items()}
    groups: Groups = {}
    for number, (block, tags_of_block) in enumerate(zip(blocks, tags)):
        d = dimension_of_kind(block.kind)
        group = np.abs(tags_of_block)
        for tag, cells in _cells_by_tag(group):
            if tag != 0:  # no group
                groups.setdefault(named.get((tag, d), str(tag)), {})[number] = cells
    return groups


def _cells_by_tag(tags: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each value, in ascending order, and the cells that have it."""
    order = np.argsort(tags, kind="stable")
    values, first = np.unique(tags[order], return_index=True)
    return zip(values.tolist(), np.split(order, first[1:]))


def _numbered(mesh: Any, names: str | None) -> Groups:
    """Groups of equal cell data, named by their value."""
    if names is None:
        return {}
    if names not in mesh.cell_data:
        known = listing([repr(x) for x in mesh.cell_data]) or "none"
        raise ValueError(f"names must be that of cell data of the mesh ({known}), got {names!r}")
    data = [np.asarray(x) for x in mesh.cell_data[names]]
    data = [x[:, 0] if x.ndim == 2 and x.shape[1] == 1 else x for x in data]
    if any(x.ndim != 1 or x.dtype.kind not in "iu" for x in data):
        raise ValueError(f"names must be that of whole numbers by cell, got {names!r}")
    groups: Groups = {str(value): {} for value in np.unique(np.concatenate(data)).tolist()}
    for number, x in enumerate(data):
        for value, cells in _cells_by_tag(x):
            groups[str(value)][number] = cells
    return groups
