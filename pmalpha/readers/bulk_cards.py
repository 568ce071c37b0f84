"""Cards of bulk data of Nastran: their fields, elements, what does not matter, and the rest."""

from __future__ import annotations

import re
from typing import NamedTuple


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
