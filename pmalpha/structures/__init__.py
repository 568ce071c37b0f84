"""Finite-element structures with their meshes: chains, rods, plane frames, plates, solids.

Most functions return a `Structure`: mass and stiffness of all dofs, none of them fixed, with the
points and elements of the mesh. `truss`, `corotational_frame` and `nonlinear_solid` have internal
forces in place of a stiffness; `plane_contact` and `sphere_contact` return one to be added. Dof of
node i, component c: dofs_per_node * i + c. Elements have the names and the order of corners of
meshio and VTK. Units are any consistent set.
"""

from ..reduction.modes import modes
from .contact import plane_contact, sphere_contact
from .continuum import plate, plate_on, solid, solid_on
from .element_force import ElementForce
from .frames import beam_frame, corotational_frame, subdivide, truss
from .imported import from_mesh, submesh
from .lines import chain, rod
from .materials import J2Plasticity, NeoHookean, StVenantKirchhoff
from .nonlinear import nonlinear_solid, nonlinear_solid_on
from .structure import Structure

__all__ = [
    "ElementForce",
    "J2Plasticity",
    "NeoHookean",
    "StVenantKirchhoff",
    "Structure",
    "beam_frame",
    "chain",
    "corotational_frame",
    "from_mesh",
    "modes",
    "nonlinear_solid",
    "nonlinear_solid_on",
    "plane_contact",
    "plate",
    "plate_on",
    "rod",
    "solid",
    "solid_on",
    "sphere_contact",
    "subdivide",
    "submesh",
    "truss",
]


def __dir__() -> list[str]:
    return sorted(__all__)
