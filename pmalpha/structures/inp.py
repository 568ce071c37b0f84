"""The mesh in an input file of Abaqus or CalculiX: nodes, elements and sets.

Of a type of element only the shape is taken, such as that of C3D8R; sections, materials and steps
are not read. meshio reads these files too, but gives the sets of a file with several blocks of
elements to the wrong ones, and knows no CPE4 or CPS8.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from io import TextIOWrapper
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import warn
from ..files import reading
from ..problem.kinds import KINDS
from .mesh import Block

Member = TypeVar("Member")
# How often the files may be read, all of them together, and how many may include each other in a
# row.
MOST_OFTEN, MOST_ABOVE = 16, 50

# Shapes by the beginning of a type
_SHAPES = {
    "C3D20": "hexahedron20",
    "C3D15": "wedge15",
    "C3D10": "tetra10",
    "C3D8": "hexahedron",
    "C3D6": "wedge",
    "C3D5": "pyramid",
    "C3D4": "tetra",
    "STRI65": "triangle6",
    "STRI3": "triangle",
    **dict.fromkeys(("T2D2", "T3D2", "B21", "B23", "B31", "B33"), "line"),
    **{
        f"{family}{nodes}": kind
        for family in ("CPS", "CPE", "CPEG", "CAX", "S", "M3D", "R3D")
        for nodes, kind in ((8, "quad8"), (6, "triangle6"), (4, "quad"), (3, "triangle"))
    },
}


class Input:
    """What is read: points, blocks of elements, and sets by name.

    Sets hold pairs (block, number) of elements and numbers of points, each once: sets of sets may
    name the same ones many times over.
    """

    def __init__(self, path: Path):
        self.blocks: list[Block] = []
        self.elements: dict[str, set[tuple[int, int]]] = {}
        self.nodes: dict[str, set[int]] = {}
        self._coordinates: list[list[float]] = []
        # by the numbers in the file; None for elements of other types
        self._point: dict[int, int] = {}
        self._element: dict[int, tuple[int, int] | None] = {}
        self._skipped: set[str] = set()
        self._axisymmetric: set[str] = set()
        readers = {
            "NODE": self._read_nodes,
            "ELEMENT": self._read_elements,
            "NSET": self._read_node_set,
            "ELSET": self._read_element_set,
            "INSTANCE": self._refuse_moved,
        }
        for keyword, options, rows in _sections(path, (), Sizes()):
            if keyword in readers:
                try:
                    readers[keyword](options, rows)
                except (LookupError, OverflowError, ValueError) as error:
                    raise ValueError(f"{path.name}, *{keyword}: {error}") from None
        width = max(map(len, self._coordinates), default=0)
        padded = [row + (width - len(row)) * [0.0] for row in self._coordinates]
        self.points = np.array(padded, dtype=float).reshape(len(padded), width)
        for types, what in ((self._skipped, "left out"), (self._axisymmetric, "taken as plane")):
            if types:
                named = ", ".join(sorted(types))
                warn(f"{path.name}: elements of type {named} are {what}", UserWarning)

    def _read_nodes(self, options: dict[str, str], rows: list[list[str]]) -> None:
        first = len(self._coordinates)
        for row in rows:
            number = int(row[0])
            if number in self._point:
                raise ValueError(f"node {number} is given twice; write a file without parts")
            self._point[number] = len(self._coordinates)
            self._coordinates.append([float(x) for x in row[1:4] if x])
        _extend(self.nodes, options.get("NSET"), range(first, len(self._coordinates)))

    def _read_elements(self, options: dict[str, str], rows: list[list[str]]) -> None:
        name = _option(options, "TYPE").upper()
        kind = _SHAPES.get(
            max((key for key in _SHAPES if name.startswith(key)), key=len, default="")
        )
        if name.startswith("CAX"):
            self._axisymmetric.add(name)
        if kind is None:
            self._skipped.add(name)
            self._element.update((int(row[0]), None) for row in rows)
            return
        numbers = np.array([int(x) for row in rows for x in row if x], dtype=np.int64)
        width = KINDS[kind].nodes + 1
        if numbers.size % width:
            raise ValueError(f"elements of type {name} must have {width - 1} nodes")
        table = numbers.reshape(-1, width)
        places = [(len(self.blocks), i) for i in range(len(table))]
        self._element.update(zip(table[:, 0].tolist(), places))
        nodes = [_found(self._point, x, "node") for x in table[:, 1:].ravel().tolist()]
        self.blocks.append(Block(kind, np.array(nodes, dtype=np.int64).reshape(len(table), -1)))
        _extend(self.elements, options.get("ELSET"), places)

    def _read_node_set(self, options: dict[str, str], rows: list[list[str]]) -> None:
        members: set[int] = set()
        if "ELSET" in options:
            for block, i in self.elements[_key(self.elements, options["ELSET"])]:
                members.update(self.blocks[block].nodes[i].tolist())
        for entry in _entries(options, rows):
            if isinstance(entry, int):
                members.add(_found(self._point, entry, "node"))
            else:
                members |= self.nodes[_key(self.nodes, entry)]
        _extend(self.nodes, _option(options, "NSET"), members)

    def _read_element_set(self, options: dict[str, str], rows: list[list[str]]) -> None:
        members: set[tuple[int, int]] = set()
        for entry in _entries(options, rows):
            if isinstance(entry, int):
                place = _found(self._element, entry, "element")
                members |= set() if place is None else {place}
            else:
                members |= self.elements[_key(self.elements, entry)]
        _extend(self.elements, _option(options, "ELSET"), members)

    def _refuse_moved(self, options: dict[str, str], rows: list[list[str]]) -> None:
        if rows:
            raise ValueError("a part is moved; write a file without parts and instances")


class Sizes:
    """Bytes that were read, and those of the different files: what files include twice, which
    include others twice, would double with each of them."""

    def __init__(self) -> None:
        self.of_files: dict[Path, int] = {}
        self.read = 0

    def add(self, path: Path, size: int) -> None:
        """ValueError if files were read too often."""
        self.of_files[path.resolve()] = size
        self.read += size
        if self.read > MOST_OFTEN * sum(self.of_files.values()):
            raise ValueError(
                f"{path.name}, *INCLUDE: all files together must be read at most {MOST_OFTEN} times"
            )


def _sections(
    path: Path, above: tuple[Path, ...], sizes: Sizes
) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Keywords with their options and rows of data; included files are read in their place.

    `above` are the files that include this one.
    """
    keyword = ""
    options: dict[str, str] = {}
    rows: list[list[str]] = []
    for line in _lines(path, sizes):
        if line.startswith("*"):
            yield keyword, options, rows
            name, *given = (x.strip() for x in line[1:].split(","))
            pairs = (x.partition("=") for x in given)
            keyword, rows = name.upper(), []
            options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
            if keyword == "INCLUDE":
                yield from _sections(_included(path, above, options), (*above, path), sizes)
        else:
            rows.append([x.strip() for x in line.split(",")])
    yield keyword, options, rows


def _included(path: Path, above: tuple[Path, ...], options: dict[str, str]) -> Path:
    """A file in the folder of the first file or below it: a file may come from a stranger."""
    name, folder = _option(options, "INPUT"), (*above, path)[0].parent.resolve()
    found = (path.parent / name.replace("\0", "")).resolve()
    try:
        is_file = "\0" not in name and folder in found.parents and found.is_file()
    except OSError:  # a name that is too long
        is_file = False
    if not is_file:
        raise ValueError(
            f"{path.name}, *INCLUDE: INPUT must be a file in the folder of the first file or below "
            f"it, got {name!r}"
        )
    if len(above) > MOST_ABOVE:
        raise ValueError(f"{path.name}, *INCLUDE: {MOST_ABOVE} files include each other in a row")
    if found in {x.resolve() for x in (*above, path)}:
        raise ValueError(f"{path.name}, *INCLUDE: {name!r} includes itself")
    return found


def _lines(path: Path, sizes: Sizes) -> Iterator[str]:
    """Lines without comments and empty ones; a line of options that ends in a comma goes on."""
    begun = ""
    with TextIOWrapper(reading(path), encoding="utf-8", errors="replace") as file:
        sizes.add(path, os.fstat(file.fileno()).st_size)
        for line in file:
            line = begun + line.strip()
            begun = ""
            if line.startswith("*") and not line.startswith("**") and line.endswith(","):
                begun = line
            elif line and not line.startswith("**"):
                yield line


def _entries(options: dict[str, str], rows: list[list[str]]) -> Iterator[int | str]:
    """Numbers, and names of other sets."""
    for row in rows:
        given = [x for x in row if x]
        if "GENERATE" in options:
            first, last, step = (*map(int, given), 1)[:3]
            yield from range(first, last + 1, step)
        else:
            yield from (int(x) if x.isdigit() else x.strip('"') for x in given)


def _option(options: dict[str, str], name: str) -> str:
    if not options.get(name):
        raise ValueError(f"{name}= is missing")
    return options[name]


def _found(places: dict[int, Any], number: int, what: str) -> Any:
    if number not in places:
        raise ValueError(f"{what} {number} does not exist")
    return places[number]


def _key(sets: dict[str, Any], name: str) -> str:
    """The name as it was first written; upper and lower case are equal."""
    for known in sets:
        if known.upper() == name.upper():
            return known
    raise ValueError(f"set {name!r} does not exist")


def _extend(sets: dict[str, set[Member]], name: str | None, members: Iterable[Member]) -> None:
    if name is not None:
        known = next((x for x in sets if x.upper() == name.upper()), name)
        sets.setdefault(known, set()).update(members)
