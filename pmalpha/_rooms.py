"""Where rooms of the package meet that do not know each other."""

from __future__ import annotations

from importlib import import_module
from typing import Any

# What rooms of the outer floors (structures, meshes, readers, cutting, analysis, plot, export,
# models, rig) import of the inner ones, by module. The rest of the inner rooms is their own.
INNER = {
    "problem.arguments": "DofsLike OF_ELEMENTS OF_RESTORING VectorLike check_order",
    "problem.constraints": "Constraint require_two tie",
    "problem.contacts": "Contact",
    "problem.corrections": "is_acceleration",
    "problem.damping": "checked_rayleigh rayleigh_coefficients",
    "problem.device": "External Limits Response divided",
    "problem.dofs": "GROUND NodeNames along as_nodes dof_array dof_list names_at spring_dofs",
    "problem.internal": "InternalForce",
    "problem.loads": "Load Mass checked_force has_ground load_of_free loads_of",
    "problem.matrices": (
        "Matrix canonical combination dense diagonal plain_matrix product rectangular "
        "sparse sparse_diagonal"
    ),
    "problem.moving": "MovingPoint",
    "problem.records": "Record UNIT takes_record",
    "problem.restoring": "functions_of",
    "problem.sampled": "SampledForce",
    "problem.schemes": "CentralDifference GeneralizedAlpha Newmark Scheme",
    "problem.springs": "Spring assembled core_springs",
    "problem.subdomain": "Subdomain dense_whole",
    "problem.tangents": "evaluated",
    "devices.actuators": "Compensated SimulatedActuator",
    "devices.linear": "LinearActuator servo_hydraulic",
    "devices.linkage": "Linkage",
    "reduction.fixed_dofs": "Reduction reduce",
    "reduction.modes": "modes",
    "reduction.ordering": "has_nested_dissection",
    "setup.amplification": "Layout propagation",
    "setup.foreseen": "entries_of_union foreseen",
    "setup.member": "Member core_parts",
    "setup.stability": "critical_product critical_step",
    "results.array_file": "Output",
    "results.contact": "nodal_fields",
    "results.history": "History SubdomainHistory",
    "results.history_file": "SIGNATURE own_array",
    "results.quantities": "OF_INTERFACE OF_SUBDOMAIN Quantity by_index in_units position times_of",
    "results.ring": "Monitored read_monitor",
    "results.subdomain": "RigRecord",
    "results.times": "State clock_of columns_of linear on_mesh",
    "gradients.parameters": "Parameters labelled",
    "run.advance": "advance_to",
    "run.coupler": "Coupler solve",
    "run.session": "begin require_linear take",
    "run.snapshot": "restore_snapshot snapshot_of",
    "run.transfer": "Steps",
}

# What methods call of a higher room, which they import by this table when a user calls them.
OUTER = {
    "energies": "plot.histories",
    "gaps_and_forces": "plot.histories",
    "reduced_arguments": "reduction.modes",
    "time_histories": "plot.histories",
}


def outer(name: str) -> Any:
    """A function of a higher room."""
    return getattr(import_module(f"{__package__}.{OUTER[name]}"), name)
