"""Matrices that other programs wrote as text: Abaqus, CalculiX and Nastran.

What to write into their input is in docs/exported-matrices.md. Matrix Market and Harwell-Boeing
files are read by ``scipy.io.mmread`` and ``scipy.io.hb_read``.
"""

from .abaqus import read_abaqus
from .exported import ExportedMatrix
from .nastran import read_dmig
from .symmetry import asymmetry, symmetrized

__all__ = ["ExportedMatrix", "asymmetry", "read_abaqus", "read_dmig", "symmetrized"]


def __dir__() -> list[str]:
    return sorted(__all__)
