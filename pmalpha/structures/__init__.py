"""Finite-element structures with their meshes: chains, rods, plane frames, plates, solids.

Each function returns a `Structure`: mass and stiffness of all dofs, none of them fixed, with the
points and elements of the mesh. Dof of node i, component c: dofs_per_node * i + c. Elements have
the names and the order of corners of meshio and VTK. Units are any consistent set.
"""

from ..setup.eigenmodes import modes
from .continuum import plate, plate_on, solid, solid_on
from .frames import beam_frame, subdivide
from .lines import chain, rod
from .structure import Structure
from .submeshes import submesh

__all__ = [
    "Structure",
    "beam_frame",
    "chain",
    "modes",
    "plate",
    "plate_on",
    "rod",
    "solid",
    "solid_on",
    "subdivide",
    "submesh",
]


def __dir__() -> list[str]:
    return sorted(__all__)
