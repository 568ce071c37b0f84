"""The tree of a frozen model: what the core was made of, its present, inputs and outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._checks import counted, listing, numbered
from ..problem import forms
from ..problem.argument_types import Coupling
from ..problem.device import Device
from ..problem.restoring import external_of, items_of
from ..problem.springs import Spring
from ..setup.assembly import Assembly
from ..setup.constraint_rows import CoreRows
from ..setup.member import Member
from .ports import Input, Output

# Words in place of functions: csrc/library/open.c.
INPUTS = "inputs"


# ---- subdomains ----------------------------------------------------------------------------------


def subdomain(member: Member, load: Any, levels: Mapping[str, np.ndarray]) -> Any:
    """A subdomain with its load at a present, after `check_functions`."""
    fields = dict(member.parts)
    restoring: forms.Restoring | None = fields.get("restoring")
    if restoring is not None:
        functions = tuple(_with_inputs(x) if is_outside(x) else x for x in restoring.functions)
        fields["restoring"] = restoring._replace(functions=functions)
    fields["load"] = load
    if fields.get("iterate") is not None:
        iterate = fields["iterate"]
        fields["iterate"] = iterate._replace(threads=1, pattern=_with_loops(iterate.pattern))
    return {
        "name": member.name,
        "parts": fields,
        "order": np.ascontiguousarray(member.order, dtype=np.int64),
        "levels": levels,
        "iteration": member.core.iteration(),
    }


def is_outside(function: Any) -> bool:
    """Whether an entry of `forms.Restoring` is or has a function, which no file can have."""
    return not isinstance(function, forms.Specimen) or function.function is not None


def _with_inputs(function: Any) -> Any:
    """The word in place of a function."""
    return function._replace(function=INPUTS) if isinstance(function, forms.Specimen) else INPUTS


def check_functions(member: Member, inputs: Sequence[Input], coupling: Coupling) -> None:
    """ValueError for functions of a subdomain that these inputs do not replace."""
    where = f"subdomain {member.name!r}"
    if member.feedback is not None:
        raise ValueError(
            f"force of {where} depends on the motion, which no frozen model has: let it be the "
            "negative restoring force, and that an input"
        )
    _check_internal(member)
    items = items_of(member.subdomain.restoring)
    specimens = [x for x in items if _is_specimen(x)]
    acting = _acting_dofs(specimens, member.n)
    names = listing([x.name for x in inputs])
    beyond = [x for x in inputs if x.dof not in acting]
    missing = sorted(acting - {x.dof for x in inputs})
    if beyond:
        raise ValueError(
            f"input {beyond[0].name!r}: no specimen acts on dof {beyond[0].dof} of {where}; let "
            "its restoring= have a function or rig.External, whose place inputs take"
        )
    if missing:
        raise ValueError(
            f"restoring of {where} is {_described(specimens, member.n)}, which no file can have: "
            f'give all of these dofs as inputs, inputs={{"...": ("specimen", {member.name!r}, '
            f"dof)}}; missing {numbered('dof', missing)}. A specimen that acts on some dofs alone "
            "is rig.External(dofs)"
        )
    restoring = member.parts.get("restoring")
    functions = () if restoring is None else restoring.functions
    if sum(map(is_outside, functions)) > 1 or _are_mixed(specimens):
        raise ValueError(
            f"restoring of {where} has several functions or specimens, of which inputs {names} can "
            "replace one: let the others be in subdomains of their own, or springs"
        )
    if inputs and coupling in ("macro", "mean") and member.substeps > 1:
        raise ValueError(
            f"{where} must have one substep under {coupling!r} coupling to have a specimen as "
            f"input, got {member.substeps}: commands would be ahead of the interface force"
        )
    _check_devices(functions, where)


def _is_specimen(item: Any) -> bool:
    """Whether a restoring force is or ends in a function."""
    if isinstance(item, Device):
        return not item.springs and not isinstance(item.innermost, Device)
    return not isinstance(item, Spring)


def _acting_dofs(specimens: Sequence[Any], n: int) -> set[int]:
    """The dofs on which they act: a function on all of its subdomain."""
    dofs: set[int] = set()
    for item in specimens:
        external = external_of(item)
        dofs |= set(range(n) if external is None else map(int, external.dofs))
    return dofs


def _are_mixed(specimens: Sequence[Any]) -> bool:
    """Whether what is outside of this program acts where another specimen acts too."""
    external = [x for x in map(external_of, specimens) if x is not None]
    dofs = [int(dof) for x in external for dof in x.dofs]
    return bool(external) and (len(external) < len(specimens) or len(set(dofs)) < len(dofs))


def _described(specimens: Sequence[Any], n: int) -> str:
    if any(external_of(x) is None for x in specimens):
        return f"a function, which acts on all of its {counted(n, 'dof')}"
    return listing([repr(external_of(x)) for x in specimens])


def _check_devices(functions: Sequence[Any], where: str) -> None:
    """ValueError for what is between commands and an input that no loop outside can serve."""
    for function in functions:
        if not (isinstance(function, forms.Specimen) and is_outside(function)):
            continue
        if any(isinstance(x, forms.LinkageMatrix | forms.LinkageArms) for x in function.filters):
            raise ValueError(
                f"restoring of {where} has a Linkage, whose commands are of no dof, which an input "
                "must have: let the loop turn the command of the dofs into those of the actuators"
            )
        if any(_measures(x) for x in function.filters):
            raise ValueError(
                f"restoring of {where} has a compensator that needs the measured displacement of "
                'its specimen, which no input has: take method="polynomial", "inverse", or "model" '
                "without feedback and variations"
            )


def _measures(x: forms.Filter) -> bool:
    learns = isinstance(x, forms.Inverse) and not (x.feedback is None and x.regressors is None)
    return learns or isinstance(x, forms.Adaptive)


def _check_internal(member: Member) -> None:
    internal = member.parts.get("internal")
    forces = () if internal is None else internal.forces
    if any(x.function is not None or x.potential is not None for x in forces):
        raise ValueError(
            f"internal of subdomain {member.name!r} has functions, which no file can have: take "
            "springs"
        )


def _with_loops(pattern: forms.Numeric) -> forms.Numeric:
    """The same without routines of BLAS."""
    return pattern._replace(dgemm=None, dtrsm=None)


# ---- the coupler ---------------------------------------------------------------------------------


def coupler(assembly: Assembly, free: Sequence[int]) -> dict[str, Any]:
    """The coupler, for one thread; `free`: further rows with a velocity, as the core has them."""
    fields = dict(assembly.parts)
    fields["options"] = dict(fields["options"], threads=1, worthwhile=False)
    further = (forms.Motion(np.array([row], dtype=np.int64), None) for row in free)
    fields["motions"] = (*fields["motions"], *further)
    iteration, contact = fields.get("iteration"), fields.get("contact")
    if isinstance(iteration, forms.Iteration):
        fields["iteration"] = iteration._replace(pattern=_with_loops(iteration.pattern))
    if contact is not None:
        fields["contact"] = contact._replace(dgemm=None, dtrsm=None)
    return fields


def state(
    assembly: Assembly,
    origin: int,
    t0: float,
    numbers: Mapping[str, np.ndarray],
    has_free_motions: bool,
) -> dict[str, Any]:
    arrays = dict(numbers)
    if has_free_motions:
        arrays.setdefault("moved", np.zeros(arrays["prescribed"].size))
    return {"step": assembly.core.step_count, "origin": origin, "t0": float(t0), "arrays": arrays}


# ---- inputs and outputs --------------------------------------------------------------------------


def input_of(
    x: Input,
    value: float,
    members: Sequence[Member],
    rows: CoreRows,
    places: Mapping[int, tuple[int, int]],
) -> dict[str, Any]:
    """places: the number of the motion and the row of it, by row of the user."""
    fields: dict[str, Any] = {"name": x.name, "kind": x.kind, "value": float(value)}
    if x.kind == "velocity":
        motion, row = places[x.dof]
        return fields | {"motion": motion, "row": row, "scale": float(rows.scale[x.dof])}
    member = members[x.subdomain]
    place = {"dof": x.dof, "position": int(member.position[x.dof])}
    return fields | {"subdomain": x.subdomain} | place


def output(x: Output, members: Sequence[Member], rows: CoreRows) -> Mapping[str, Any]:
    made: dict[str, Any] = {"name": x.name, "what": x.what, "scale": 1.0}
    if x.what == "multiplier":
        place = {"position": int(rows.position[x.number]), "scale": float(rows.scale[x.number])}
        return made | place
    member = members[x.subdomain]
    of_spring = x.what in ("deformation", "spring force")
    number = x.number if of_spring else int(member.position[x.number])
    return made | {"subdomain": x.subdomain, "position": number}
