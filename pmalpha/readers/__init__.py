"""Readers of matrices exported as text by Abaqus, ANSYS, CalculiX and Nastran, and of records.

docs/other-programs.md has the input of these programs. ``scipy.io.mmread`` reads Matrix Market
files.
"""

from ..problem.records import Record
from .abaqus import ElementMatrices, read_abaqus
from .exported import ExportedMatrix, asymmetry, completed, symmetrized
from .harwell_boeing import read_harwell_boeing
from .nastran import read_dmig
from .records import read_at2, read_record

__all__ = [
    "ElementMatrices",
    "ExportedMatrix",
    "Record",
    "asymmetry",
    "completed",
    "read_abaqus",
    "read_at2",
    "read_dmig",
    "read_harwell_boeing",
    "read_record",
    "symmetrized",
]


def __dir__() -> list[str]:
    return sorted(__all__)
