"""The mesh in bulk data of Nastran: grid points, elements, and groups by property.

Of an element the shape is taken. Libraries of meshes read less of these files (no coordinate
systems, no free fields); pyNastran reads all of them, and its models are taken as they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from .._checks import fortran_real, listing
from ..meshes.mesh import Block, ElementType, FileMesh
from .text import Included, Unread, refused_at

# ---- bulk cards ---------------------------------------------------------------------------------
# Cards of bulk data of Nastran: their fields, elements, what does not matter, and the rest.


def fields_of(text: str) -> tuple[str, list[str], str]:
    """First field, the fields of data, each line as many as it can have, and the marker."""
    text = text.expandtabs(8)
    wide = "*" in text[:8].partition(",")[0]
    count = 4 if wide else 8
    if "," in text:
        name, *fields = (x.strip() for x in text.split(","))
        if any(fields[count + 1 :]):
            raise ValueError(f"must have at most {count + 2} fields, got {len(fields) + 1}")
    else:
        name = text[:8].strip()
        width = 64 // count
        fields = [text[i : i + width].strip() for i in (*range(8, 72, width), 72)]
    data = fields[:count] + (count - len(fields)) * [""]
    return name.upper(), data, "".join(fields[count : count + 1]).upper()


class Element(NamedTuple):
    """Where a card has its property (0: nowhere) and first node, and kinds by number of nodes."""

    family: str
    kinds: dict[int, str]
    group: int = 1
    first: int = 2


ELEMENTS = {
    "CHEXA": Element("SOLID", {8: "hexahedron", 20: "hexahedron20"}),
    "CPENTA": Element("SOLID", {6: "wedge", 15: "wedge15"}),
    "CTETRA": Element("SOLID", {4: "tetra", 10: "tetra10"}),
    "CPYRAM": Element("SOLID", {5: "pyramid", 13: "pyramid13"}),
    "CPYRA": Element("SOLID", {5: "pyramid", 13: "pyramid13"}),
    **dict.fromkeys(("CQUAD4", "CQUADR"), Element("SHELL", {4: "quad"})),
    **dict.fromkeys(("CTRIA3", "CTRIAR"), Element("SHELL", {3: "triangle"})),
    "CQUAD8": Element("SHELL", {8: "quad8"}),
    "CTRIA6": Element("SHELL", {6: "triangle6"}),
    "CROD": Element("BAR", {2: "line"}),
    "CTUBE": Element("BAR", {2: "line"}),
    "CONROD": Element("BAR", {2: "line"}, group=0, first=1),
    "CBAR": Element("BEAM", {2: "line"}),
    "CBEAM": Element("BEAM", {2: "line"}),
}

# Materials, properties, loads, supports, sets, solutions, optimization, aerodynamics: a Structure
# has its own. Fields of CHEXA and so on name properties, which begin with P.
_OF_ANALYSIS = re.compile(
    r"MAT\w*|P\w+|MDLPRM|FORCE\w*|MOMENT\w*|LOAD\w*|GRAV|ACCEL\w*|RFORCE|TEMP\w*|SPC\w*|DEFORM|BOLT\w*"
    r"|TABLE\w*|TABD\w*|TABRND\w*|TLOAD\w*|RLOAD\w*|DLOAD|LSEQ|DAREA|DELAY|DPHASE|TIC|IC|RANDPS|RANDT\d"
    r"|EIG\w*|FREQ\w*|TSTEP\w*|NLPARM|NLPCI|NLSTEP\w*|CYSYM|SET\d*|[ABCOQRU]SET\d*|OMIT\d*|SUPORT\d*"
    r"|DES\w+|DV\w+|DRESP\w*|DCON\w+|DEQATN|DOPTPRM|DOBJ\w*|DLINK|DSCREEN|TOPVAR|BMFACE|DT(ABLE|I)"
    r"|AE\w+|CAERO\d|SPLINE\d|TRIM|FLUTTER|FLFACT|MKAERO\d|GUST|DIVERG|CSSCHD|MONPNT\w*|MONDSP\w*"
    r"|CONV\w*|CHBDY\w|RADBC|RADM|QBDY\d|QVOL|QHBDY|VIEW\w*|SEQGP|GRAV|ECHO\w+|OUT\w+|ENDDATA|BEGIN|BAROR|BEAMOR"
)


def is_of_analysis(name: str) -> bool:
    """Whether the card has nothing to do with nodes, elements and their connection."""
    return _OF_ANALYSIS.fullmatch(name) is not None


# by a pattern the family of what is left out
_LEFT_OUT = {
    r"RBE\w*|RBAR\w*|RROD|RSPLINE|RSSCON|RTRPLT\w*|RJOINT|MPC\w*|TF|GM\w+|CWELD|CFAST|CSEAM|CGAP|B[CS]\w+"
    r"|BLSEG|BFRIC|BGSET|BGADD|BEDGE|CONCTL": "CONNECTION",
    r"CONM\d|CMASS\d|NSM\w*": "MASS",
    r"CELAS\d|CBUSH\w*|CBUTT": "SPRING",
    r"CDAMP\d|CVISC": "DAMPER",
    r"CBEND|CBEAM3|CBARAO": "BEAM",
    r"CSHEAR|CQUAD|CTRIA\w*|CQUAD\w*|CPLST\w+": "SHELL",
    r"CTRIAX\w*|CQUADX\w*|CTRAX\w*|CCONEAX": "AXISYMMETRIC",
    r"DMI\w*|GENEL|K2\w+|SPOINT|EPOINT": "MATRIX",
}


def family_of(name: str) -> str:
    """That of a card which is left out."""
    for pattern, family in reversed(_LEFT_OUT.items()):
        if re.fullmatch(pattern, name):
            return family
    return "UNKNOWN"


# by the card what it does to nodes and elements
REFUSED = {
    **dict.fromkeys(("CSUPER", "CSUPEXT", "SEBULK", "SEELT", "SELOC"), "it has superelements"),
    **dict.fromkeys(("GRIDB", "RINGAX", "SECTAX", "GRIDF", "EGRID"), "it makes nodes"),
    "EXTRN": "it takes elements from another analysis",
}


# ---- bulk ---------------------------------------------------------------------------------------

Found = TypeVar("Found")

# Fields of pins and offsets of CBAR and CBEAM, from the second field of the card on
BEAM_ENDS = range(8, 16)

# By the name of a card number, group and nodes of elements
Rows = dict[str, list[tuple[int, int, list[int]]]]


class Card(NamedTuple):
    """An entry with its fields from the second on; those of continuations follow."""

    name: str
    fields: list[str]
    where: str  # file, line and name

    def text(self, i: int) -> str:
        return self.fields[i] if i < len(self.fields) else ""

    def number(self, i: int, default: int | None = None) -> int:
        text = self.text(i)
        if not text and default is not None:
            return default
        try:
            return int(text)
        except ValueError:
            refused_at(self.where, f"field {i + 2} must be a whole number, got {text!r}")

    def real(self, i: int) -> float:
        text = self.text(i)
        try:
            return fortran_real(text) if text else 0.0
        except ValueError:
            refused_at(self.where, f"field {i + 2} must be a number, got {text!r}")


def read_bulk(path: Path, unread: Unread) -> FileMesh:
    """The mesh of a file, with groups "1", "2", ... of the elements of each property."""
    cards = list(_cards(path))
    read = frozenset(("GRID", "GRDSET", *SYSTEMS, *ELEMENTS))
    for card in cards:
        if card.name in REFUSED:
            unread.refuse(card.name, "GEOMETRY", card.where, REFUSED[card.name])
        elif card.name not in read:
            _leave_out(card.name, 1, unread)
    points = _Points(cards)
    rows: Rows = {name: [] for name in ELEMENTS}
    seen: set[int] = set()
    for card in cards:
        if card.name in ELEMENTS:
            number, group, nodes = _element(card, ELEMENTS[card.name])
            if ELEMENTS[card.name].family == "BEAM" and any(card.real(k) for k in BEAM_ENDS):
                reason = "pins and offsets of its ends, in fields 10 to 17, are not read"
                unread.refuse(card.name, "CONNECTION", card.where, reason)
            if number in seen:
                refused_at(card.where, f"element {number} is given twice")
            seen.add(number)
            rows[card.name].append((number, group, nodes))
    return _joined(points.all(), rows, unread)


def is_model(mesh: Any) -> bool:
    """Whether it is a model as pyNastran has it."""
    return all(isinstance(getattr(mesh, name, None), dict) for name in ("nodes", "elements"))


def read_model(model: Any, unread: Unread) -> FileMesh:
    """The mesh of a model of pyNastran, of which positions, nodes and properties are taken."""
    counts = dict(getattr(model, "card_count", {}))
    for name in ("GRID", "GRDSET", *SYSTEMS, *ELEMENTS):
        counts.pop(name, None)
    for name, count in counts.items():
        _leave_out(str(name).upper(), int(count), unread)
    points = {int(n): np.asarray(node.get_position()) for n, node in model.nodes.items()}
    rows: Rows = {name: [] for name in ELEMENTS}
    for number, element in model.elements.items():
        name = str(element.type).upper()
        if name in ELEMENTS:
            fields = ["" if n is None else str(int(n)) for n in element.nodes]
            card = Card(name, [str(number), "0", *fields], f"{name} {number}")
            nodes = _element(card, ELEMENTS[name]._replace(group=1, first=2))[2]
            group = int(getattr(element, "pid", None) or 0)
            rows[name].append((int(number), group, nodes))
        elif not counts:
            _leave_out(name, 1, unread)
    return _joined(points, rows, unread)


def _leave_out(name: str, count: int, unread: Unread) -> None:
    if not is_of_analysis(name):
        unread.leave_out("cards {} are not read", name, family_of(name), count)


def _element(card: Card, element: Element) -> tuple[int, int, list[int]]:
    """Number, group (0 for none) and nodes in the order of their kind."""
    number = card.number(0)
    group = card.number(element.group, number) if element.group else 0
    texts = [card.text(element.first + k) for k in range(max(element.kinds))]
    width = max((n for n in element.kinds if all(texts[:n])), default=0)
    if not width or any(texts[width:]):
        counts = " or ".join(map(str, sorted(element.kinds)))
        refused_at(card.where, f"must have {counts} grid points, got {listing(texts)}")
    nodes = [card.number(element.first + k) for k in range(width)]
    return number, group, [nodes[k] for k in ORDER.get((card.name, width), range(width))]


# Nodes of the middles of edges in the order of a kind, where the cards have another one
ORDER = {
    ("CHEXA", 20): (*range(12), *range(16, 20), *range(12, 16)),
    ("CPENTA", 15): (*range(9), *range(12, 15), *range(9, 12)),
}


def _joined(
    points: dict[int, np.ndarray],
    rows: Rows,
    unread: Unread,
) -> FileMesh:
    row_of = {number: row for row, number in enumerate(points)}
    blocks: list[Block] = []
    types: list[ElementType] = []
    groups: dict[str, dict[int, list[int]]] = {}
    for name, elements in rows.items():
        for width, kind in ELEMENTS[name].kinds.items():
            elements_of_kind = [x for x in elements if len(x[2]) == width]
            if not elements_of_kind:
                continue
            for number, _, nodes in elements_of_kind:
                missing = [n for n in nodes if n not in row_of]
                if missing:
                    where = f"{unread.file}, {name} {number}"
                    refused_at(where, f"grid point {missing[0]} does not exist")
            table = np.array(
                [[row_of[n] for n in nodes] for *_, nodes in elements_of_kind], dtype=np.int64
            )
            for row, (_, group, _) in enumerate(elements_of_kind):
                if group:
                    groups.setdefault(str(group), {}).setdefault(len(blocks), []).append(row)
            blocks.append(Block(kind, table.reshape(len(elements_of_kind), width)))
            types.append(ElementType(name, ELEMENTS[name].family))
    members = {
        name: {b: np.array(rows, dtype=np.int64) for b, rows in rows_of.items()}
        for name, rows_of in groups.items()
    }
    return FileMesh(
        np.array(list(points.values()), dtype=float).reshape(-1, 3), blocks, members, {}, types
    )


# ---- grid points and coordinate systems -----------------------------------------------------

SYSTEMS = tuple(f"CORD{way}{kind}" for way in "12" for kind in "RCS")


class _Points:
    """Grid points in the basic system; systems may be given in each other and by grid points."""

    def __init__(self, cards: list[Card]):
        self.cards: dict[int, Card] = {}
        self.systems: dict[int, tuple[str, Card, int]] = {}  # with the first field of the system
        self.default = 0
        for card in cards:
            if card.name == "GRID":
                known = self.cards.setdefault(card.number(0), card)
                if known.fields != card.fields:
                    refused_at(card.where, f"{card.number(0)} is given twice, differently")
            elif card.name == "GRDSET":
                self.default = card.number(1, 0)
            elif card.name in SYSTEMS:
                both = (0, 4) if card.name[4] == "1" and card.text(4) else (0,)
                for first in both:
                    if card.number(first) in self.systems:
                        refused_at(card.where, f"{card.number(first)} is given twice")
                    self.systems[card.number(first)] = card.name, card, first
        self.points: dict[int, np.ndarray | None] = {}
        self.axes: dict[int, tuple[np.ndarray, np.ndarray] | None] = {}

    def all(self) -> dict[int, np.ndarray]:
        points = {}
        for number, card in self.cards.items():
            try:
                points[number] = self.point(number, card)
            except RecursionError:
                refused_at(card.where, "its coordinate system is given in too many others in a row")
        return points

    def point(self, number: int, by: Card) -> np.ndarray:
        if number in self.points:
            return self._finished(self.points[number], by)
        if number not in self.cards:
            refused_at(by.where, f"grid point {number} does not exist")
        card = self.cards[number]
        self.points[number] = None
        values = np.array([card.real(k) for k in (2, 3, 4)])
        self.points[number] = point = self.basic(values, card.number(1, self.default), card)
        return point

    def basic(self, values: np.ndarray, system: int, by: Card) -> np.ndarray:
        """The point with these coordinates in a system, in the basic one."""
        if system == 0:
            return values
        if system not in self.systems:
            refused_at(by.where, f"coordinate system {system} does not exist")
        origin, axes = self._system(system, by)
        a, b, c = values
        kind = self.systems[system][0][-1]
        if kind == "C":
            values = np.array([a * np.cos(np.deg2rad(b)), a * np.sin(np.deg2rad(b)), c])
        elif kind == "S":
            theta, phi = np.deg2rad([b, c])
            across = a * np.sin(theta)
            values = np.array([across * np.cos(phi), across * np.sin(phi), a * np.cos(theta)])
        return np.asarray(origin + values @ axes)

    def _system(self, number: int, by: Card) -> tuple[np.ndarray, np.ndarray]:
        """Origin and unit vectors, as rows: the second point is on z, the third in the plane xz."""
        if number in self.axes:
            return self._finished(self.axes[number], by)
        self.axes[number] = None
        name, card, first = self.systems[number]
        if name[4] == "1":
            origin, on_z, in_xz = (self.point(card.number(first + k), card) for k in (1, 2, 3))
        else:
            coordinates = np.array([card.real(2 + k) for k in range(9)]).reshape(3, 3)
            origin, on_z, in_xz = (self.basic(x, card.number(1, 0), card) for x in coordinates)
        z = on_z - origin
        y = np.cross(z, in_xz - origin)
        if not (np.linalg.norm(z) > 0.0 and np.linalg.norm(y) > 0.0):
            refused_at(card.where, "must have three points that are not on a line")
        z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
        axes = origin, np.array([np.cross(y, z), y, z])
        self.axes[number] = axes
        return axes

    def _finished(self, value: Found | None, by: Card) -> Found:
        if value is None:
            refused_at(by.where, "coordinate systems must not depend on themselves")
        return value


# ---- lines ----------------------------------------------------------------------------------


def _cards(path: Path) -> Iterator[Card]:
    """Cards in fields of 8 or 16 columns or between commas, with their continuations."""
    current: Card | None = None
    marker = ""
    for where, text in _bulk_lines((path,), Included(path)):
        try:
            name, fields, mark = fields_of(text)
        except ValueError as error:
            refused_at(where, str(error))
        if name.startswith("BEGIN"):
            refused_at(where, f"must be one model, got {name!r}")
        if name and name[0] not in "+*":
            if current is not None:
                yield current
            current = Card(name.rstrip("*"), fields, f"{where}, {name.rstrip('*')}")
        elif current is not None:
            if len(name) > 1 and len(marker) > 1 and name[1:] != marker[1:]:
                refused_at(
                    where, f"continuation must follow its card, got {name!r} after {marker!r}"
                )
            current.fields.extend(fields)
        marker = mark
    if current is not None:
        yield current


def _bulk_lines(
    above: tuple[Path, ...], included: Included, where: str = ""
) -> Iterator[tuple[str, str]]:
    """File and line, and text without comments, of bulk data and the files that it includes."""
    path = above[-1]
    with included.open(path, where) as file:
        lines = [line.partition("$")[0].rstrip() for line in file]
    starts = [
        i + 1 for i, x in enumerate(lines) if x.upper().replace(",", " ").split()[:2] == BEGIN
    ]
    numbered = iter(enumerate(lines[starts[0] if starts else 0 :], start=1 + (starts or [0])[0]))
    for number, line in numbered:
        word = line.replace(",", " ").split()[:1]
        if not word:
            continue
        if word[0].upper() == "ENDDATA":
            return
        where = f"{path.name}, line {number}"
        if word[0].upper() == "INCLUDE":
            name = line.strip()[len("INCLUDE") :].strip()
            while name[:1] in ("'", '"') and name.count(name[0]) < 2 and len(name) < LONGEST_NAME:
                number, line = next(numbered, (0, name[0]))
                name += line.strip()
            included_path = included.find(name.strip("'\" "), above, f"{where}, INCLUDE")
            yield from _bulk_lines((*above, included_path), included, f"{where}, INCLUDE")
        else:
            yield where, line


BEGIN, LONGEST_NAME = ["BEGIN", "BULK"], 4096
