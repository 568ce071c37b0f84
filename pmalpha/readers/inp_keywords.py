"""Keywords of Abaqus and CalculiX: what does not matter for a mesh, what is left out or refused."""

from __future__ import annotations

import re
from typing import Any

from ..meshes.kinds import KINDS
from ..meshes.mesh import ElementType


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
