"""A coupler as a frozen model: `Coupler.freeze`, `Coupler.export_fmu`."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

from .._checks import check_word
from ..files import checked_path, package_version, replacing, uninterrupted
from ..frozen import fmu, model
from ..frozen.model import Input, Ports, file_of
from ..problem.loads import core_load, loads_of
from .inputs_at_start import Present, present
from .motion import Motion
from .session import Session, begin, require_alone, require_possible


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
    require_possible(session, "export_fmu")
    if license is not None and not isinstance(license, str):
        raise TypeError(f"license must be a text, got {license!r}")
    if units is not None and not (
        isinstance(units, Mapping) and all(isinstance(x, str) and x for x in units.values())
    ):
        raise TypeError(f"units must be a dict of texts by name, got {units!r}")
    identifier = fmu.identifier_of(checked_path(path).stem)
    ports, content, starts = frozen(session, inputs, outputs)
    fine = session.clock.dt / session.fine
    variables = fmu.variables_of(ports, starts, session.keys, units)
    facts: dict[str, Any] = {"time": fmu.time_of(ports), "fmi": fmi, "license": license}
    facts |= {"start": session.clock.time(session.core.step_count), "fine": fine}
    with replacing(path) as file:
        fmu.write(file, identifier, content, variables, **facts)


def frozen(session: Session, inputs: Any, outputs: Any) -> tuple[Ports, bytearray, list[float]]:
    """Inputs and outputs, checked, the bytes of the model, and what inputs begin with."""
    with session.guard:
        require_alone(session, "freeze")
        ports = Ports.of(inputs, outputs, session.keys, session.rows.p)
        check(session, ports)
        begin(session)
        now = present(session, ports)
        content = file_of(tree_of(session, ports, now))
        return ports, content, list(now.values)


def tree_of(session: Session, ports: Ports, now: Present) -> dict[str, Any]:
    """What the file has."""
    members, assembly, clock = session.members, session.assembly, session.clock
    rows_of = [motion.rows for motion in session.loads.motions]
    free = [x.dof for x in ports.inputs if x.kind == "velocity" and not _is_among(x.dof, rows_of)]
    places = {row: (len(rows_of) + i, 0) for i, row in enumerate(free)}
    places |= {int(row): (j, k) for j, rows in enumerate(rows_of) for k, row in enumerate(rows)}
    return {
        "format": "pmalpha",
        "made by": package_version(),
        "coupler": model.coupler(assembly, [session.core_rows.position[row] for row in free]),
        "subdomains": tuple(
            model.subdomain(member, core_load(session.loads.seen[i], member.order), now.levels[i])
            for i, member in enumerate(members)
        ),
        "motions": (*(x.core_load() for x in session.loads.motions), *(None for _ in free)),
        "obstacle": None,
        "state": model.state(assembly, clock.origin, clock.t0, now.numbers, bool(free)),
        "inputs": tuple(
            model.input_of(x, value, members, session.core_rows, places)
            for x, value in zip(ports.inputs, now.values)
        ),
        "begin": now.begin,
        "outputs": tuple(model.output(x, members, session.core_rows) for x in ports.outputs),
    }


def _is_among(row: int, groups: Any) -> bool:
    return any(row in rows for rows in groups)


# ---- what no file can have ---------------------------------------------------------------------


def check(session: Session, ports: Ports) -> None:
    """ValueError for what cannot be frozen, by name, before anything is evaluated."""
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
    for i, member in enumerate(session.members):
        _check_loads(session, i)
        model.check_functions(member, ports.of_kind("specimen", i), session.coupling)
        _check_substeps(session, i, ports.of_kind("force", i))
    for motion in session.loads.motions:
        _check_motion(motion)


def _check_loads(session: Session, i: int) -> None:
    name = session.members[i].name
    for load in loads_of(session.loads.forces[i]):
        if load._kind in ("of t", "compiled"):
            kind = "a compiled function" if load._kind == "compiled" else "a function"
            raise ValueError(
                f"force of subdomain {name!r} has {kind}, which no file can have: give samples, or "
                "leave it out and set what it returns, dof by dof, as inputs, which add to all "
                f'other loads: inputs={{"...": ("force", {name!r}, dof)}}'
            )


def _check_substeps(session: Session, i: int, inputs: list[Input]) -> None:
    member = session.members[i]
    if inputs and session.coupling in ("macro", "mean") and member.substeps > 1:
        raise ValueError(
            f"input {inputs[0].name!r}: subdomain {member.name!r} must have one substep under "
            f"{session.coupling!r} coupling to have a force as input, got {member.substeps}: one "
            "value would serve all of them"
        )


def _check_motion(motion: Motion) -> None:
    if not motion.known:
        rows = ", ".join(map(str, motion.rows))
        raise ValueError(
            f"{motion.what} is a function, which no file can have: give samples, or leave it out "
            f'and set it as an input, inputs={{"...": ("velocity", row)}}, row {rows}'
        )
