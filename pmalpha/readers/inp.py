"""The mesh in an input file of Abaqus or CalculiX: nodes, elements, sets, parts and instances.

Of a type of element the shape is taken, such as that of C3D8R. meshio reads these files too, but
gives the sets of a file with several blocks of elements to the wrong ones.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from .._checks import fortran_real
from ..meshes.mesh import KINDS, Block, ElementType, FileMesh, by_block
from .text import MOST_ABOVE, Included, Unread, refused_at

# ---- inp keywords -------------------------------------------------------------------------------
# Keywords of Abaqus and CalculiX: what does not matter for a mesh, what is left out or refused.


def _words(text: str) -> frozenset[str]:
    """Keywords between bars and ends of lines."""
    return frozenset(x.strip() for x in re.split(r"[|\n]", text)) - {""}


# What is read, in `inp`
READ = frozenset(
    ("NODE", "NGEN", "SYSTEM", "ELEMENT", "ELGEN", "NSET", "ELSET", "PART", "END PART", "INSTANCE")
)

# Materials, sections, loads, supports, steps and output belong to an analysis; a Structure has its
# own. Keywords of one group begin with the same word: "OUTPUT", "EL PRINT".
OF_ANALYSIS = _words(
    """
    ACOUSTIC FLOW VELOCITY|ACOUSTIC MEDIUM|AMPLITUDE|ASSEMBLY|BASE MOTION|BEAM GENERAL SECTION
    BEAM SECTION|BEAM SECTION GENERATE|BOUNDARY|BUCKLE|BULK VISCOSITY|CHANGE FRICTION
    CLEARANCE|CFLUX|CLOAD|COHESIVE SECTION|COMPLEX FREQUENCY|CONDUCTIVITY|CONNECTOR BEHAVIOR
    CONNECTOR DAMPING|CONNECTOR ELASTICITY|CONTACT CONTROLS|CONTACT CONTROLS ASSIGNMENT
    CONTACT EXCLUSIONS|CONTACT FILE|CONTACT FORMULATION|CONTACT INCLUSIONS
    CONTACT INITIALIZATION ASSIGNMENT|CONTACT OUTPUT|CONTACT PRINT|CONTACT PROPERTY ASSIGNMENT
    CONTROLS|COUPLED TEMPERATURE-DISPLACEMENT|CREEP|CYCLIC|CYCLIC HARDENING|DAMAGE EVOLUTION
    DAMAGE INITIALIZATION|DAMAGE STABILIZATION|DAMPING|DAMPING CONTROLS|DEFORMATION PLASTICITY
    DENSITY|DEPVAR|DESIGN VARIABLES|DFLUX|DISTRIBUTION|DISTRIBUTION TABLE|DLOAD|DRUCKER PRAGER
    DRUCKER PRAGER HARDENING|DSLOAD|DYNAMIC|EIGENVALUES|EL FILE|EL PRINT|ELASTIC
    ELECTRICAL CONDUCTIVITY|ELECTROMAGNETICS|ELEMENT OUTPUT|ELEMENT PROPERTIES|ELEMENT RESPONSE
    END ASSEMBLY|END INSTANCE|END PART|END STEP|ENERGY FILE|ENERGY OUTPUT|ENERGY PRINT|EXPANSION
    FIELD|FILE FORMAT|FILE OUTPUT|FILM|FILM PROPERTY|FIXED MASS SCALING|FLUID CONSTANTS
    FLUID SECTION|FREQUENCY|FRICTION|GAP CONDUCTANCE|GAP HEAT GENERATION|GASKET SECTION|GEOSTATIC
    GREEN|HEADING|HEAT TRANSFER|HOURGLASS STIFFNESS|HYPERELASTIC|HYPERFOAM|INCREMENTATION OUTPUT
    INERTIA RELIEF|INITIAL CONDITIONS|INTEGRATED OUTPUT|LOAD CASE|MAGNETIC PERMEABILITY|MATERIAL
    MEMBRANE SECTION|MODAL DAMPING|MODAL DYNAMIC|MODAL FILE|MODAL OUTPUT|MODAL PRINT|MONITOR
    MOHR COULOMB|MOHR COULOMB HARDENING|NO ANALYSIS|NODAL THICKNESS|NODE FILE|NODE OUTPUT
    NODE PRINT|NODE RESPONSE|NORMAL|OBJECTIVE|ORIENTATION|OUTPUT|PERMEABILITY
    PHYSICAL CONSTANTS|PLASTIC|PREPRINT|PRINT|RADIATE|RANDOM RESPONSE|RATE DEPENDENT
    RESPONSE SPECTRUM|RESTART|RETAINED NODAL DOFS|SECTION CONTROLS|SECTION FILE|SECTION PRINT
    SELECT CYCLIC SYMMETRY MODES|SELECT EIGENMODES|SENSITIVITY|SHEAR CENTER
    SHELL GENERAL SECTION|SHELL SECTION|SOLID SECTION|SOLUTION TECHNIQUE|SPECIFIC GAS CONSTANT
    SPECIFIC HEAT|SPECTRUM|STATIC|STEADY STATE DYNAMICS|STEP|SUBMODEL|SUBSTRUCTURE GENERATE
    SUBSTRUCTURE MATRIX OUTPUT|SUBSTRUCTURE OUTPUT|SURFACE|SURFACE BEHAVIOR|SURFACE INTERACTION
    SURFACE PROPERTY ASSIGNMENT|TEMPERATURE|TIME POINTS|TRANSFORM|TRANSVERSE SHEAR STIFFNESS
    TRUSS SECTION|UNCOUPLED TEMPERATURE-DISPLACEMENT|USER DEFINED FIELD|USER MATERIAL
    USER OUTPUT VARIABLES|VALUES AT INFINITY|VARIABLE MASS SCALING|VIEWFACTOR|VISCO
    VISCOELASTIC|VISCOUS
    MASS|ROTARY INERTIA|SPRING|DASHPOT|CONNECTOR SECTION|GAP|CFD|CONSTRAINT|CONTACT DAMPING
    CORRELATION LENGTH|DAMAGE INITIATION|DESIGN RESPONSE|DESIGNVARIABLES|FEASIBLE DIRECTION|FILTER
    FLUID SECTIONS|GEOMETRIC TOLERANCES|INITIAL STRAIN INCREASE|ROBUST DESIGN|USER SECTION
    """
)

# What connects nodes that no element does, or takes a connection away
CONNECTIONS = _words(
    """
    COUPLING|CYCLIC SYMMETRY MODEL|DISTRIBUTING|DISTRIBUTING COUPLING|EMBEDDED ELEMENT|EQUATION
    FASTENER|KINEMATIC|KINEMATIC COUPLING|MPC|NETWORK MPC|PERIODIC MEDIA|PRE-TENSION SECTION
    RELEASE|RIGID BODY|SHELL TO SOLID COUPLING|TIE
    """
)

# by the keyword the family of what is left out
LEFT_OUT = {
    **dict.fromkeys(CONNECTIONS, "CONNECTION"),
    **dict.fromkeys(
        ("CONTACT", "CONTACT PAIR", "FASTENER PROPERTY", "RIGID SURFACE"), "CONNECTION"
    ),
    **dict.fromkeys(("NONSTRUCTURAL MASS", "MASS ADJUST"), "MASS"),
    **dict.fromkeys(("FOUNDATION", "ELEMENT FOUNDATION"), "SPRING"),
    **dict.fromkeys(("REBAR", "REBAR LAYER"), "BEAM"),
    **dict.fromkeys(("MATRIX", "MATRIX INPUT", "MATRIX ASSEMBLE", "USER ELEMENT"), "MATRIX"),
    **dict.fromkeys(("UEL PROPERTY", "SUBSTRUCTURE PROPERTY", "SUBSTRUCTURE PATH"), "MATRIX"),
}

# by the keyword what it does to nodes and elements
REFUSED = {
    "ELCOPY": "it makes elements from others",
    "IMPERFECTION": "it moves nodes",
    "IMPORT": "it takes elements from another analysis",
    "MODEL CHANGE": "it removes elements",
    "NCOPY": "it makes nodes from others",
    "NFILL": "it makes nodes between others",
    "NMAP": "it moves nodes",
    "PARAMETER": "it gives values under a name",
    "REFINE MESH": "it makes elements from others",
    "SYMMETRIC MODEL GENERATION": "it makes elements from others",
}

_NAMES = {
    name.replace(" ", ""): name
    for name in (*READ, "END INSTANCE", *OF_ANALYSIS, *LEFT_OUT, *REFUSED)
}


def spelled(name: str) -> str:
    """A keyword in capitals with the blanks that it has in the tables, which CalculiX ignores."""
    words = name.upper().split()
    return _NAMES.get("".join(words), " ".join(words))


def is_of_analysis(keyword: str) -> bool:
    """Whether the keyword has nothing to do with nodes, elements and their connection."""
    return not keyword or keyword in OF_ANALYSIS or keyword.startswith(("END ", "CHANGE "))


# Kinds by the beginning of a type of element, and what the type means beyond its shape
_PLANE = {
    "CPS": "PLANE STRESS",
    "CPE": "PLANE STRAIN",
    "CPEG": "PLANE STRAIN",
    "CAX": "AXISYMMETRIC",
    "CGAX": "AXISYMMETRIC",
    "S": "SHELL",
    "R3D": "SHELL",  # rigid; meshio calls triangles so
    "M3D": "MEMBRANE",
}
_SURFACES = ((8, "quad8"), (6, "triangle6"), (4, "quad"), (3, "triangle"))
_SHAPES = {
    **{
        f"C3D{KINDS[kind].nodes}": (kind, "SOLID")
        for kind in (
            "hexahedron20",
            "wedge15",
            "tetra10",
            "hexahedron",
            "wedge",
            "pyramid",
            "tetra",
        )
    },
    "STRI65": ("triangle6", "SHELL"),
    "STRI3": ("triangle", "SHELL"),
    **dict.fromkeys(("T2D2", "T3D2"), ("line", "BAR")),
    **dict.fromkeys(("B21", "B23", "B31", "B33"), ("line", "BEAM")),
    **{
        f"{beginning}{nodes}": (kind, family)
        for beginning, family in _PLANE.items()
        for nodes, kind in _SURFACES
    },
}

# families of types that are left out, by the beginning
_OTHERS = {
    **dict.fromkeys(("SPRING", "GAP", "ITS"), "SPRING"),
    "DASHPOT": "DAMPER",
    **dict.fromkeys(("MASS", "ROTARYI", "HEATCAP"), "MASS"),
    **dict.fromkeys(
        ("CONN", "COH", "GK", "DCOUP", "RB", "R3D", "R2D", "RAX", "JOINT"), "CONNECTION"
    ),
    **dict.fromkeys(("B", "PIPE", "FRAME", "ELBOW", "T2D3", "T3D3"), "BEAM"),
    **dict.fromkeys(("S", "DS", "SC", "SAX"), "SHELL"),
    **dict.fromkeys(("U", "Z"), "MATRIX"),
}


def type_of(name: str) -> tuple[str | None, ElementType]:
    """The kind of element, None where there is none, and its type."""
    name = name.upper()
    kind, family = _longest(_SHAPES, name) or (None, None)
    return kind, ElementType(name, family or _longest(_OTHERS, name) or "UNKNOWN")


def _longest(table: dict[str, Any], name: str) -> Any:
    """The value of the longest key that the name begins with, or None."""
    keys = [key for key in table if name.startswith(key)]
    return table[max(keys, key=len)] if keys else None


# ---- inp ----------------------------------------------------------------------------------------

Key = TypeVar("Key", int, tuple[int, int])

# Nodes, elements and members of sets that a file may make beyond those that it lists, by *NGEN,
# *ELGEN, *INSTANCE and sets: as many, and further ones for each row of data
MOST_MADE, MADE_BY_ROW = 2 * 10**6, 64


class Made:
    """How much a file has made, so that few lines of a stranger do not fill the memory."""

    def __init__(self) -> None:
        self.rows = self.count = 0

    def add(self, count: float) -> None:
        self.count += int(min(count, 1e18))
        most = MOST_MADE + MADE_BY_ROW * self.rows
        if self.count > most:
            raise ValueError(
                f"the file must make at most {most} nodes, elements and members of sets beyond "
                f"those of its {self.rows} rows, got {self.count}"
            )


class Section(NamedTuple):
    """A keyword with its options and rows of data."""

    keyword: str
    options: dict[str, str]
    rows: list[list[str]]
    where: str  # file, line and keyword

    def option(self, name: str) -> str:
        if not self.options.get(name):
            raise ValueError(f"{name}= is missing")
        return self.options[name]


class Scope:
    """What is numbered together: a part, an instance, the assembly, or a file without parts."""

    def __init__(self, name: str = ""):
        self.name = name
        self.nodes: dict[int, tuple[float, ...]] = {}  # coordinates
        self.elements: dict[int, list[int]] = {}  # numbers of nodes, also of what is left out
        self.block_of: dict[int, list[int]] = {}  # the numbers of the block of an element
        # type and kind, numbers of elements, and file, line and keyword
        self.blocks: list[tuple[ElementType, str, list[int], str]] = []
        # by the name in capitals, the name and the members: numbers, or a section that lists them
        self.sets: dict[str, dict[str, tuple[str, list[Section | set[int]]]]] = {
            "NSET": {},
            "ELSET": {},
        }
        self.axes: tuple[np.ndarray, np.ndarray] | None = None  # of *SYSTEM: origin and rows

    def extend(self, kind: str, name: str | None, members: Section | set[int]) -> None:
        if name is not None:
            self.sets[kind].setdefault(name.upper(), (name, []))[1].append(members)

    @property
    def size(self) -> int:
        """Of what a copy of it has."""
        sets = (x for of_kind in self.sets.values() for _, parts in of_kind.values() for x in parts)
        members = sum(1 + len(x.rows if isinstance(x, Section) else x) for x in sets)
        return len(self.nodes) + len(self.elements) + len(self.blocks) + members

    def copied(self, name: str) -> Scope:
        new = Scope(name)
        new.nodes, new.elements = dict(self.nodes), dict(self.elements)
        for element_type, kind, numbers, where in self.blocks:
            new.add_block(element_type, kind, list(numbers), where)
        for which, sets in self.sets.items():  # members are not changed
            new.sets[which] = {
                key: (label, list(members)) for key, (label, members) in sets.items()
            }
        return new

    def add_block(
        self, element_type: ElementType, kind: str, numbers: list[int], where: str
    ) -> None:
        self.blocks.append((element_type, kind, numbers, where))
        self.block_of.update(dict.fromkeys(numbers, numbers))


def read_input(path: Path, unread: Unread) -> FileMesh:
    """The mesh of a file; several instances have sets called "instance.set"."""
    reader = _Reader(unread)
    for section in _sections(path):
        reader.made.rows += 1 + len(section.rows)
        try:
            reader.read(section)
        except (LookupError, OverflowError, ValueError) as error:
            refused_at(section.where, _reason(error, section))
    return _Joined(reader.scopes(), reader.made).mesh()


def _reason(error: Exception, section: Section) -> str:
    text = str(error)
    if "could not convert string" in text or "invalid literal" in text:
        return f"must have numbers, got {text.rpartition(': ')[2]}"
    return text.removeprefix(f"{section.where}: ")


class _Reader:
    """The scopes of a file, filled section by section."""

    def __init__(self, unread: Unread):
        self.unread = unread
        self.root = Scope()  # of the assembly, or of a file without parts
        self.scope = self.root
        self.parts: dict[str, Scope] = {}
        self.instances: dict[str, Scope] = {}
        self.moved: list[list[str]] = []
        self.made = Made()
        self.readers: dict[str, Callable[[Section], None]] = {
            "NODE": self._nodes,
            "NGEN": self._generated_nodes,
            "SYSTEM": self._system,
            "ELEMENT": self._elements,
            "ELGEN": self._generated_elements,
            "NSET": lambda x: self.scope.extend("NSET", x.option("NSET"), x),
            "ELSET": lambda x: self.scope.extend("ELSET", x.option("ELSET"), x),
            "PART": self._part,
            "END PART": self._end,
            "INSTANCE": self._instance,
            "END INSTANCE": self._end,
        }

    def read(self, section: Section) -> None:
        keyword = section.keyword
        if keyword in self.readers:
            self.readers[keyword](section)
        elif keyword in REFUSED:
            self.unread.refuse(keyword, "GEOMETRY", section.where, REFUSED[keyword])
        elif not is_of_analysis(keyword):
            family = LEFT_OUT.get(keyword, "UNKNOWN")
            self.unread.leave_out("keywords {} are not read", keyword, family)

    def scopes(self) -> list[Scope]:
        """The assembly, then the instances, or the parts where nothing is assembled."""
        return [self.root, *(self.instances or self.parts).values()]

    # ---- nodes --------------------------------------------------------------------------------

    def _nodes(self, section: Section) -> None:
        system = section.options.get("SYSTEM", "R").upper()
        if system not in ("R", "C"):
            raise ValueError(f"SYSTEM must be R or C, got {system!r}")
        added = set()
        for row in section.rows:
            number, values = int(row[0]), [_real(x) for x in row[1:4]]
            if system == "C":
                r, angle, z = (*values, 0.0, 0.0, 0.0)[:3]
                values = [r * np.cos(np.deg2rad(angle)), r * np.sin(np.deg2rad(angle)), z]
            if self.scope.axes is not None:
                origin, axes = self.scope.axes
                values = (origin + np.array((*values, 0.0, 0.0)[:3]) @ axes).tolist()
            point = tuple(map(float, values))
            if self.scope.nodes.setdefault(number, point) != point:
                raise ValueError(f"node {number} is given twice, at different places")
            added.add(number)
        self.scope.extend("NSET", section.options.get("NSET"), added)

    def _generated_nodes(self, section: Section) -> None:
        if {"LINE", "SYSTEM"} & set(section.options):
            self.unread.refuse("NGEN", "GEOMETRY", section.where, "it makes nodes along a curve")
            return
        nodes = self.scope.nodes
        added: set[int] = set()
        for row in section.rows:
            first, last, *step = (int(x) for x in row[:3] if x)
            numbers = range(first, last + 1, *step)
            if last not in numbers:
                raise ValueError(f"numbers must lead from {first} to {last}, got steps of {step}")
            self.made.add(len(numbers))
            ends = np.array([nodes[_known(nodes, x, "node")] for x in (first, last)])
            for k, number in enumerate(numbers):
                at = ends[0] + (ends[1] - ends[0]) * (k / (len(numbers) - 1))
                nodes.setdefault(number, tuple(at.tolist()))
            added.update(numbers)
        self.scope.extend("NSET", section.options.get("NSET"), added)

    def _system(self, section: Section) -> None:
        values = [_real(x) for row in section.rows for x in row if x]
        if not values:
            self.scope.axes = None
            return
        if len(values) not in (3, 9):
            raise ValueError(f"must have one point or three in space, got {len(values)} numbers")
        origin = np.array(values[:3])
        axes = np.eye(3)
        if len(values) == 9:
            x, y = np.array(values[3:6]) - origin, np.array(values[6:]) - origin
            axes = _axes(x, np.cross(x, y))
        self.scope.axes = origin, axes

    # ---- elements -----------------------------------------------------------------------------

    def _elements(self, section: Section) -> None:
        kind, element_type = type_of(section.option("TYPE"))
        if kind is None:
            added = self._left_out(section, element_type)
        else:
            rows, further = _elements(section, KINDS[kind].nodes, element_type)
            what = "nodes beyond those of an element {} are not read"
            self.unread.leave_out(what, element_type.name, "UNKNOWN", further)
            added = {number for number, _ in rows}
            self._add(rows)
            numbers = [number for number, _ in rows]
            self.scope.add_block(element_type, kind, numbers, section.where)
        self.scope.extend("ELSET", section.options.get("ELSET"), added)

    def _add(self, rows: Iterable[tuple[int, list[int]]]) -> None:
        for number, nodes in rows:
            if self.scope.elements.setdefault(number, nodes) is not nodes:
                raise ValueError(f"element {number} is given twice")

    def _left_out(self, section: Section, element_type: ElementType) -> set[int]:
        """Numbers of the elements, as far as they have one; nodes of an instance have a name."""
        added = set()
        for row in section.rows:
            numbers = [int(x) if x.isdigit() else 0 for x in row if x]
            if numbers and numbers[0] and numbers[0] not in added:
                self.scope.elements[numbers[0]] = [x for x in numbers[1:] if x]
                added.add(numbers[0])
        self._count(element_type, len(added))
        return added

    def _count(self, element_type: ElementType, count: int) -> None:
        what = "elements of type {} are left out"
        self.unread.leave_out(what, element_type.name, element_type.family, count)

    def _generated_elements(self, section: Section) -> None:
        added = set()
        for row in section.rows:
            master, *fields = (int(x) if x else 0 for x in row)
            count, nodes, step = _steps(fields)
            self.made.add(float(np.prod(count, dtype=float)))
            base = self.scope.elements[_known(self.scope.elements, master, "element")]
            numbers = self.scope.block_of.get(master, [])
            for at in np.ndindex(*count[::-1]):
                new, by = (int(np.dot(at[::-1], x)) for x in (step, nodes))
                if new:
                    self._add([(master + new, [x + by for x in base])])
                    numbers.append(master + new)
                    self.scope.block_of[master + new] = numbers
                added.add(master + new)
        self.scope.extend("ELSET", section.options.get("ELSET"), added)

    # ---- parts --------------------------------------------------------------------------------

    def _part(self, section: Section) -> None:
        name = section.option("NAME")
        self.scope = self.parts[name.upper()] = Scope(name)

    def _instance(self, section: Section) -> None:
        name = section.option("NAME")
        if name.upper() in self.instances:
            raise ValueError(f"instance {name!r} is given twice")
        if "PART" in section.options:
            part = section.options["PART"]
            if part.upper() not in self.parts:
                raise ValueError(f"part {part!r} does not exist")
            of_part = self.parts[part.upper()]
            self.made.add(of_part.size)
            self.scope = of_part.copied(name)
        else:
            self.unread.refuse("INSTANCE", "GEOMETRY", section.where, "it is of another analysis")
            self.scope = Scope(name)
        self.instances[name.upper()] = self.scope
        self.moved = section.rows

    def _end(self, section: Section) -> None:
        if section.keyword == "END INSTANCE" and self.moved:
            self._move(*self.moved)
        self.moved = []
        self.scope = self.root

    def _move(self, shift: list[str], turn: list[str] | None = None, *further: list[str]) -> None:
        """Move the nodes of the instance, then turn them about the axis of two points."""
        by = [_real(x) for x in shift]
        if any(by[3:]) or further or (turn is not None and len(turn) < 7):
            raise ValueError("an instance must have a shift of three numbers and a turn of seven")
        nodes = self.scope.nodes
        points = np.array([(*x, 0.0, 0.0)[:3] for x in nodes.values()]).reshape(-1, 3)
        points += (*by, 0.0, 0.0)[:3]
        if turn is not None:
            a, b = np.reshape([_real(x) for x in turn[:6]], (2, 3))
            axis = np.deg2rad(_real(turn[6])) * _unit(b - a)
            points = a + Rotation.from_rotvec(axis).apply(points - a)
        flat = max(map(len, nodes.values()), default=3) < 3 and not points[:, 2].any()
        self.scope.nodes = dict(zip(nodes, map(tuple, points[:, : 2 if flat else 3].tolist())))


def _elements(
    section: Section, width: int, element_type: ElementType
) -> tuple[list[tuple[int, list[int]]], int]:
    """Number and nodes of each element, and in how many of them there are further nodes.

    The lines of one are read until it has all nodes. Of lines that all have more, as many are read
    as CalculiX reads.
    """
    elements: list[tuple[int, list[int]]] = []
    begun: list[int] = []
    most = width + 1 + (element_type.family == "BEAM")  # a node that gives the direction
    lengths = {sum(map(bool, row)) for row in section.rows}
    has_more = len(lengths) == 1 and min(lengths) > most
    for row in section.rows:
        begun += [int(x) for x in row if x]
        if len(begun) > most and not has_more:
            break
        if len(begun) > width:
            elements.append((begun[0], begun[1 : width + 1]))
            begun = []
    if begun:
        raise ValueError(
            f"elements of type {element_type.name} must have {width} nodes, got "
            f"{len(begun) - 1} in element {begun[0]}"
        )
    return elements, len(elements) * has_more


def _steps(fields: list[int]) -> tuple[list[int], list[int], list[int]]:
    """Of *ELGEN in three directions: numbers of elements, steps of nodes and of elements."""
    triples = [fields[k : k + 3] for k in (0, 3, 6)]
    count = [(x or [1])[0] or 1 for x in triples]
    if min(count) < 1:
        raise ValueError(f"must have positive numbers of elements, got {count}")
    steps = [[(*x, 0, 0, 0)[k] or 1 for x in triples] for k in (1, 2)]
    return count, steps[0], steps[1]


# ---- all scopes together --------------------------------------------------------------------

Members = set[tuple[int, int]]


class _Joined:
    """One mesh of all scopes. Members of sets are pairs of a scope and a number in it."""

    def __init__(self, scopes: list[Scope], made: Made):
        self.scopes, self.made = scopes, made
        self.index = {scope.name.upper(): i for i, scope in enumerate(scopes) if i}
        self.known: dict[tuple[int, str, str], Members | None] = {}
        self.depth = 0  # of the sets that hold each other

    def mesh(self) -> FileMesh:
        points = [x for scope in self.scopes for x in scope.nodes.values()]
        width = max(map(len, points), default=0)
        padded = np.array([(*x, 0.0, 0.0)[:width] for x in points], dtype=float)
        pairs = ((i, n) for i, scope in enumerate(self.scopes) for n in scope.nodes)
        point = {pair: row for row, pair in enumerate(pairs)}
        blocks: list[Block] = []
        types: list[ElementType] = []
        place: dict[tuple[int, int], tuple[int, int]] = {}
        for i, scope in enumerate(self.scopes):
            for element_type, kind, numbers, where in scope.blocks:
                nodes = [
                    point[_known(point, (i, n), f"{where}: node")]
                    for x in numbers
                    for n in scope.elements[x]
                ]
                place.update({(i, x): (len(blocks), row) for row, x in enumerate(numbers)})
                table = np.array(nodes, dtype=np.int64).reshape(len(numbers), KINDS[kind].nodes)
                blocks.append(Block(kind, table))
                types.append(element_type)
        starts = np.cumsum([0, *(len(block.nodes) for block in blocks)])
        groups = {}
        for name, members in self._named("ELSET"):
            pairs_of = (place[x] for x in members if x in place)
            groups[name] = by_block([starts[b] + row for b, row in pairs_of], starts)
        points_of = {
            name: np.array(sorted(point[x] for x in members), dtype=np.int64)
            for name, members in self._named("NSET")
        }
        return FileMesh(padded.reshape(len(points), width), blocks, groups, points_of, types)

    def _named(self, kind: str) -> Iterator[tuple[str, Members]]:
        """Sets, of several instances and of a name that the assembly has too as "instance.set"."""
        several = len(self.scopes) > 2
        for i, scope in enumerate(self.scopes):
            for key, (name, _) in scope.sets[kind].items():
                plain = i == 0 or not (several or key in self.scopes[0].sets[kind])
                yield name if plain else f"{scope.name}.{name}", self._members(i, kind, name)
            if i and several and kind == "ELSET":
                yield scope.name, {(i, x) for x in scope.elements}

    def _members(self, i: int, kind: str, name: str) -> Members:
        key = name.upper()
        if key not in self.scopes[i].sets[kind]:
            raise ValueError(f"set {name!r} does not exist")
        if (i, kind, key) not in self.known and self.depth > MOST_ABOVE:
            raise ValueError(f"sets must hold each other at most {MOST_ABOVE} in a row")
        if (i, kind, key) in self.known:
            entry = self.known[i, kind, key]
            if entry is None:
                raise ValueError(f"set {name!r} must not hold itself")
            return entry
        self.known[i, kind, key] = None
        self.depth += 1
        members: Members = set()
        for part in self.scopes[i].sets[kind][key][1]:
            members |= {(i, x) for x in part} if isinstance(part, set) else self._listed(i, part)
        self.depth -= 1
        self.known[i, kind, key] = members
        return members

    def _listed(self, i: int, section: Section) -> Members:
        try:
            members: Members = set()
            target = self._instance(section.options.get("INSTANCE"), i)
            if section.keyword == "NSET" and "ELSET" in section.options:
                for j, x in self._members(target, "ELSET", section.options["ELSET"]):
                    members |= {(j, n) for n in self.scopes[j].elements[x]}
                    self.made.add(len(self.scopes[j].elements[x]))
            for entry in _entries(section, self._numbers(target, section.keyword), self.made):
                listed = self._entry(target, section.keyword, entry)
                self.made.add(len(listed) if isinstance(entry, str) else 0)
                members |= listed
            return members
        except (LookupError, OverflowError, ValueError) as error:
            text = str(error)
            refused_at(section.where, text.rpartition(f"*{section.keyword}: ")[2])

    def _instance(self, name: str | None, default: int) -> int:
        if name is None or not self.index:  # CalculiX knows no instances
            return default
        if name.upper() not in self.index:
            raise ValueError(f"instance {name!r} does not exist")
        return self.index[name.upper()]

    def _numbers(self, i: int, kind: str) -> Collection[int]:
        return self.scopes[i].nodes if kind == "NSET" else self.scopes[i].elements

    def _entry(self, i: int, kind: str, entry: int | str) -> Members:
        if isinstance(entry, str) and entry.upper() not in self.scopes[i].sets[kind]:
            instance, dot, rest = entry.rpartition(".")
            if dot and instance.upper() in self.index:
                i, entry = self.index[instance.upper()], int(rest) if rest.isdigit() else rest
        if isinstance(entry, str):
            return self._members(i, kind, entry)
        what = "node" if kind == "NSET" else "element"
        return {(i, _known(self._numbers(i, kind), entry, what))}


def _entries(section: Section, numbers: Collection[int], made: Made) -> Iterator[int | str]:
    """Numbers, and names of other sets; of a range the numbers that there are."""
    for row in section.rows:
        fields = [x for x in row if x]
        if "GENERATE" in section.options:
            first, last, step = (*map(int, fields), 1)[:3]
            listed = range(first, last + 1, step)
            if not listed:
                raise ValueError(f"numbers must lead from {first} to {last}, got steps of {step}")
            made.add(min(len(listed), len(numbers)))
            if len(listed) < len(numbers):
                yield from (x for x in listed if x in numbers)
            else:
                yield from (x for x in numbers if x in listed)
        else:
            yield from (int(x) if x.isdigit() else x.strip('"') for x in fields)


def _known(places: Collection[Key], number: Key, what: str) -> Key:
    if number not in places:
        shown = number[1] if isinstance(number, tuple) else number
        raise ValueError(f"{what} {shown} does not exist")
    return number


def _real(text: str) -> float:
    """A number; nothing is zero."""
    return fortran_real(text) if text else 0.0


def _unit(x: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(x)
    if not size > 0.0:
        raise ValueError("an axis must be given by two different points")
    return np.asarray(x / size)


def _axes(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Rows of unit vectors along x, and across it, and along z."""
    x, z = _unit(x), _unit(z)
    return np.array([x, np.cross(z, x), z])


# ---- lines of files -------------------------------------------------------------------------


def _sections(path: Path) -> Iterator[Section]:
    """The keywords of a file, and of the files that it includes in their places."""
    current: Section | None = None
    for item in _items((path,), Included(path)):
        if isinstance(item, list):
            if current is None:
                refused_at(path.name, f"must begin with a keyword, got {','.join(item)[:60]!r}")
            current.rows.append(item)
            continue
        if current is not None:
            yield current
        current = item
    if current is not None:
        yield current


def _items(
    above: tuple[Path, ...], included: Included, where: str = ""
) -> Iterator[Section | list[str]]:
    """Keywords without rows, and rows; of the last of `above`, which include each other in turn."""
    for number, line in _lines(above[-1], included, where):
        if not line.startswith("*"):
            yield _fields(line)
            continue
        section = _section(above[-1], number, line)
        name = section.options.get("INPUT")
        if section.keyword != "INCLUDE":
            yield section
        if section.keyword == "INCLUDE" or (name and section.keyword in READ):
            path = included.find(name or "", above, section.where)
            yield from _items((*above, path), included, section.where)


def _fields(line: str) -> list[str]:
    return [x.strip() for x in line.split(",")]


def _section(path: Path, number: int, line: str) -> Section:
    name, *parameters = (x.strip() for x in line[1:].split(","))
    keyword = spelled(name)
    pairs = (x.partition("=") for x in parameters)
    options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
    return Section(keyword, options, [], f"{path.name}, line {number}, *{keyword}")


def _lines(path: Path, included: Included, where: str) -> Iterator[tuple[int, str]]:
    """Lines without comments and empty ones; a line of options that ends in a comma goes on.

    It does so with the name of an option: some programs end lines of options in a comma for
    nothing.
    """
    begun: list[str] = []
    first = 0
    with included.open(path, where) as file:
        for number, text in enumerate(file, start=1):
            line = text.strip()
            if not line or line.startswith("**"):
                continue
            if begun and not line[0].isalpha():
                yield first, "".join(begun)
                begun = []
            first = first if begun else number
            begun.append(line)
            if not (begun[0].startswith("*") and line.endswith(",")):
                yield first, "".join(begun)
                begun = []
    if begun:
        yield first, "".join(begun)
