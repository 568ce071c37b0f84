"""The tree of a frozen model: what the core was made of, its present, inputs and outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._checks import listing
from ..problem import forms
from ..problem.argument_types import Coupling
from ..setup.assembly import Assembly
from ..setup.constraint_rows import CoreRows
from ..setup.member import Member
from .ports import Input, Output, Ports

# Words in place of functions: csrc/library/open.c.
INPUTS = "inputs"


# ---- subdomains ----------------------------------------------------------------------------------


def subdomain(member: Member, i: int, ports: Ports, load: Any, coupling: Coupling) -> Any:
    """A subdomain with its load; ValueError for functions that no input replaces."""
    fields = dict(member.parts)
    fields["restoring"] = _restoring(member, ports.of_kind("specimen", i), coupling)
    fields["load"] = load
    if fields.get("internal") is not None:
        _check_internal(member)
    if fields.get("iterate") is not None:
        iterate = fields["iterate"]
        fields["iterate"] = iterate._replace(threads=1, pattern=_with_loops(iterate.pattern))
    return {
        "name": member.name,
        "parts": fields,
        "order": np.ascontiguousarray(member.order, dtype=np.int64),
        "levels": member.core.levels(),
        "iteration": member.core.iteration(),
    }


def _restoring(member: Member, inputs: Sequence[Input], coupling: Coupling) -> Any:
    """The restoring force, with inputs in place of its functions."""
    restoring: forms.Restoring | None = member.parts.get("restoring")
    where = f"subdomain {member.name!r}"
    if member.feedback is not None:
        raise ValueError(
            f"force of {where} depends on the motion, which no frozen model has: let it be the "
            "negative restoring force, and that an input"
        )
    functions = () if restoring is None else restoring.functions
    replaced = tuple(_with_inputs(x, where) for x in functions)
    count = sum(new is not old for new, old in zip(replaced, functions))
    if inputs and count != 1:
        raise ValueError(
            f"inputs {listing([x.name for x in inputs])} need {where} to have one restoring "
            f"function, whose place they take, got {count}"
        )
    if count and not inputs:
        raise ValueError(
            f"restoring of {where} is a function, which no file can have: give its dofs as inputs, "
            f'inputs={{"...": ("specimen", {member.name!r}, dof)}}, or springs'
        )
    if inputs and coupling in ("macro", "mean") and member.substeps > 1:
        raise ValueError(
            f"{where} must have one substep under {coupling!r} coupling to have a specimen as "
            f"input, got {member.substeps}: commands would be ahead of the interface force"
        )
    return None if restoring is None else restoring._replace(functions=replaced)


def _with_inputs(function: Any, where: str) -> Any:
    """The same where it is data, or a word in place of a function."""
    if not isinstance(function, forms.Specimen):
        return INPUTS
    if function.function is None:
        return function
    if any(isinstance(x, forms.LinkageMatrix | forms.LinkageArms) for x in function.filters):
        raise ValueError(
            f"restoring of {where} has a Linkage, whose commands are of no dof, which an input "
            "must have: let the loop turn the command of the dofs into those of the actuators"
        )
    if any(_measures(x) for x in function.filters):
        raise ValueError(
            f"restoring of {where} has a compensator that needs the measured displacement of its "
            'specimen, which no input has: take method="polynomial", "inverse", or "model" without '
            "feedback and variations"
        )
    return function._replace(function=INPUTS)


def _measures(x: forms.Filter) -> bool:
    learns = isinstance(x, forms.Inverse) and not (x.feedback is None and x.regressors is None)
    return learns or isinstance(x, forms.Adaptive)


def _check_internal(member: Member) -> None:
    forces = member.parts["internal"].forces
    if any(x.function is not None or x.potential is not None for x in forces):
        raise ValueError(
            f"internal of subdomain {member.name!r} has functions, which no file can have: take "
            "springs"
        )


def _with_loops(pattern: forms.Numeric) -> forms.Numeric:
    """The same without routines of BLAS."""
    return pattern._replace(dgemm=None, dtrsm=None)


# ---- the coupler ---------------------------------------------------------------------------------


def coupler(assembly: Assembly) -> dict[str, Any]:
    """The coupler, for one thread."""
    fields = dict(assembly.parts)
    fields["options"] = dict(fields["options"], threads=1, worthwhile=False)
    iteration, contact = fields.get("iteration"), fields.get("contact")
    if isinstance(iteration, forms.Iteration):
        fields["iteration"] = iteration._replace(pattern=_with_loops(iteration.pattern))
    if contact is not None:
        fields["contact"] = contact._replace(dgemm=None, dtrsm=None)
    return fields


def state(assembly: Assembly, origin: int, t0: float) -> dict[str, Any]:
    core = assembly.core
    times = {"step": core.step_count, "origin": origin, "t0": float(t0)}
    return times | {"arrays": core.numbers()}


# ---- inputs and outputs --------------------------------------------------------------------------


def place_of(member: Member, dof: int) -> dict[str, Any]:
    return {"dof": dof, "position": int(member.position[dof])}


def input_of_subdomain(x: Input, member: Member, value: float) -> dict[str, Any]:
    place = {"subdomain": x.subdomain, **place_of(member, x.dof)}
    return {"name": x.name, "kind": x.kind, "value": float(value)} | place


def input_of_velocity(x: Input, motion: int, scale: float, value: float) -> dict[str, Any]:
    fields = {"motion": motion, "scale": float(scale), "value": float(value)}
    return {"name": x.name, "kind": x.kind} | fields


def output(x: Output, members: Sequence[Member], rows: CoreRows) -> Mapping[str, Any]:
    made: dict[str, Any] = {"name": x.name, "what": x.what, "scale": 1.0}
    if x.what == "multiplier":
        place = {"position": int(rows.position[x.number]), "scale": float(rows.scale[x.number])}
        return made | place
    member = members[x.subdomain]
    of_spring = x.what in ("deformation", "spring force")
    number = x.number if of_spring else int(member.position[x.number])
    return made | {"subdomain": x.subdomain, "position": number}
