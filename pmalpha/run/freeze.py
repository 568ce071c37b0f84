"""A coupler as a frozen model: `Coupler.freeze`, `Coupler.export_fmu`."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

from .._checks import check_word
from ..files import checked_path, package_version, replacing, uninterrupted
from ..frozen import fmu, model
from ..frozen.ports import Input, Ports
from ..frozen.tree import file_of
from ..problem import forms
from ..problem.forces import core_load
from .motion import Motion
from .session import Session, begin, require_alone


def freeze(
    session: Session, path: str | PathLike[str], inputs: Mapping[str, Any] | None, outputs: Any
) -> None:
    _, content, _ = frozen(session, inputs, outputs)
    with replacing(path) as file:
        uninterrupted(file.write, content)


def export_fmu(
    session: Session,
    path: str | PathLike[str],
    inputs: Mapping[str, Any] | None,
    outputs: Any,
    fmi: str,
    license: str | None,
    units: Mapping[str, str] | None,
) -> None:
    check_word(fmi, "fmi", fmu.VERSIONS)
    if license is not None and not isinstance(license, str):
        raise TypeError(f"license must be a text, got {license!r}")
    if units is not None and not (
        isinstance(units, Mapping) and all(isinstance(x, str) and x for x in units.values())
    ):
        raise TypeError(f"units must be a dict of texts by name, got {units!r}")
    identifier = fmu.identifier_of(checked_path(path).stem)
    ports, content, starts = frozen(session, inputs, outputs)
    fine = session.clock.dt / session.fine
    variables, time = fmu.variables_of(ports, starts, units), fmu.time_of(ports)
    facts: dict[str, Any] = {"time": time, "fine": fine, "fmi": fmi, "license": license}
    with replacing(path) as file:
        fmu.write(file, identifier, content, variables, **facts)


def frozen(session: Session, inputs: Any, outputs: Any) -> tuple[Ports, bytearray, list[float]]:
    """Inputs and outputs, checked, the bytes of the model, and what inputs begin with."""
    with session.guard:
        require_alone(session, "freeze")
        ports = Ports.of(inputs, outputs, session.keys, session.rows.p)
        _check_steps(session)
        motions = {x.dof: _motion(session, x) for x in ports.inputs if x.kind == "velocity"}
        begin(session)
        members, assembly, clock = session.members, session.assembly, session.clock
        tree: dict[str, Any] = {
            "format": "pmalpha",
            "made by": package_version(),
            "coupler": model.coupler(assembly),
            "subdomains": tuple(
                model.subdomain(member, i, ports, _load(session, i, ports), session.coupling)
                for i, member in enumerate(members)
            ),
            "motions": tuple(
                _velocity(motion, j in motions.values())
                for j, motion in enumerate(session.loads.motions)
            ),
            "obstacle": None,
            "state": model.state(assembly, clock.origin, clock.t0),
            "inputs": tuple(_input(session, x, motions) for x in ports.inputs),
            "outputs": tuple(model.output(x, members, session.core_rows) for x in ports.outputs),
        }
        starts = [x["value"] for x in tree["inputs"]]
        return ports, file_of(tree), starts


def _check_steps(session: Session) -> None:
    if session.steps.first is not None:
        raise ValueError(
            "the macro step across a change of steps cannot be frozen: call step() once more"
        )
    obstacles = session.loads.obstacles
    if obstacles is not None and obstacles.moves:
        raise ValueError(
            "obstacles of contacts that move cannot be frozen: let them be subdomains with a "
            "prescribed velocity"
        )


# ---- loads ---------------------------------------------------------------------------------------


def _load(session: Session, i: int, ports: Ports) -> Any:
    """The load of a subdomain as the core has it, without functions that inputs replace."""
    loads, member = session.loads, session.members[i]
    load = core_load(loads.seen[i], member.order)
    terms = load if isinstance(load, tuple) and not hasattr(load, "_fields") else (load,)
    compiled = any(isinstance(x, forms.Called) for x in terms)
    replaced = bool(ports.of_kind("force", i))
    if compiled or (i in loads.callbacks and not replaced):
        kind = "a compiled function" if compiled else "a function"
        raise ValueError(
            f"force of subdomain {member.name!r} is {kind}, which no file can have: give its dofs "
            f'as inputs, inputs={{"...": ("force", {member.name!r}, dof)}}, or samples'
        )
    return load


def _motion(session: Session, x: Input) -> int:
    """The number of the prescribed velocity that an input replaces."""
    for j, motion in enumerate(session.loads.motions):
        if motion.what == f"velocity of constraint {x.dof}" and not motion.known:
            if motion.rows.size == 1:
                return j
            raise ValueError(f"input {x.name!r} needs {motion.what} to have one row")
    raise ValueError(
        f"input {x.name!r} needs constraint {x.dof} to have a velocity that is a function"
    )


def _velocity(motion: Motion, replaced: bool) -> Any:
    if replaced:
        return None
    if motion.known:
        return motion.core_load()
    raise ValueError(
        f"{motion.what} is a function, which no file can have: give it as an input, or samples"
    )


# ---- inputs --------------------------------------------------------------------------------------


def _input(session: Session, x: Input, motions: Mapping[int, int]) -> dict[str, Any]:
    """An input, which begins with what the function returned last that it replaces."""
    step, clock, loads = session.core.step_count, session.clock, session.loads
    if x.kind == "velocity":
        j = motions[x.dof]
        motion = loads.motions[j]
        g = session.core_rows.jumps(session.core.prescribed)[motion.rows[0]]
        return model.input_of_velocity(x, j, float(motion.scale[0]), g)
    member, value = session.members[x.subdomain], 0.0
    if x.kind == "specimen":
        restoring = member.parts["restoring"]
        value = float(getattr(restoring.functions[0], "last", {x.dof: 0.0})[x.dof])
    elif (callback := loads.callbacks.get(x.subdomain)) is not None:
        level = clock.count(step) * member.substeps
        F = callback.near_start_value(0.0) if step == 0 else callback.value_at(level)
        value = float(F[member.position[x.dof]])
    return model.input_of_subdomain(x, member, value)
