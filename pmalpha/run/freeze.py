"""A coupler as a frozen model: `Coupler.freeze`, `Coupler.export_fmu`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from scipy import LowLevelCallable

from .._checks import check_word
from ..files import checked_path, package_version, replacing, uninterrupted
from ..frozen import fmu, model
from ..frozen.model import Input, Ports, file_of, is_outside
from ..problem.loads import core_load, loads_of
from ..problem.restoring import CheckedRestoring
from ..setup.member import Member
from ..setup.rows import ROUNDING
from ..setup.start import InitialAccelerations
from . import works
from .checkpoint import CoreState
from .checkpoint import restore as restore_state
from .loads import AtStart
from .motion import Motion, values_at_start
from .session import Session, begin, require_alone, require_possible

# ---- inputs at start -----------------------------------------------------------------------------
# With what the inputs of a frozen model begin, and what they change of the initial accelerations.
#
# At t = 0 the values are in the initial accelerations (S1): the file has them, bitwise those of a
# run whose functions return these values there. Other values that a loop has before its first step
# change them by a linear map, which the file has too: the accelerations and multipliers for a unit
# of each input.


class Present(NamedTuple):
    """What a frozen model begins with.

    values: of the inputs; begin: what others change, None where there is nothing to begin.
    """

    levels: Sequence[Mapping[str, np.ndarray]]
    numbers: Mapping[str, np.ndarray]
    values: Sequence[float]
    begin: dict[str, Any] | None


def present(session: Session, ports: Ports) -> Present:
    """Evaluates no function; the coupler, which has started, stays as it is."""
    values = [_value(session, x) for x in ports.inputs]
    if session.core.step_count > 0:
        _refuse_velocities(ports)
        return Present(*_state(session), values, None)
    if not ports.inputs:
        return Present(*_state(session), values, None)
    solver = session.accelerations or InitialAccelerations(
        session.members, session.core_rows.p, session.core_rows.numbers, session.ranks
    )
    levels, numbers = _state(session)
    if any(_changes(session, x) for x in ports.inputs):
        levels, numbers = _state_with(session, ports, values, solver)
    return Present(levels, numbers, values, _begin(session, ports, solver))


def _state(session: Session) -> tuple[Sequence[Mapping[str, np.ndarray]], Mapping[str, np.ndarray]]:
    return [member.core.levels() for member in session.members], session.core.numbers()


def _refuse_velocities(ports: Ports) -> None:
    for x in ports.inputs:
        if x.kind == "velocity" and x.value:
            raise ValueError(
                f"the value at the start of inputs[{x.name!r}] must be 0 where a run has begun, "
                f"got {x.value:g}: the velocity would jump"
            )


# ---- values --------------------------------------------------------------------------------------


def _value(session: Session, x: Input) -> float:
    """As given, or for a specimen what its function has returned last, else 0."""
    if x.value is not None or x.kind != "specimen":
        return x.value or 0.0
    return float(_last(session, session.members[x.subdomain])[x.dof])


def _last(session: Session, member: Member) -> np.ndarray:
    """What the functions have returned last that inputs replace, (n,), in the user's order."""
    functions = member.parts["restoring"].functions
    if len(functions) == 1:
        last = member.core.functions(session.clock.count(session.core.step_count))
        if last is not None:
            result: np.ndarray = last[: member.n][member.position]
            return result
    for function in filter(is_outside, functions):
        if isinstance(function, CheckedRestoring):
            return function.last
    raise ValueError(
        f"restoring of subdomain {member.name!r} has a function among others, whose last value is "
        "not known: let it be in a subdomain of its own"
    )


def _changes(session: Session, x: Input) -> bool:
    """Whether the value is another one than that with which the coupler has started."""
    if x.kind == "specimen":
        last = _last(session, session.members[x.subdomain])[x.dof]
        return x.value is not None and x.value != last
    return bool(x.value)


# ---- the start with them -------------------------------------------------------------------------


def _state_with(
    session: Session, ports: Ports, values: Sequence[float], solver: InitialAccelerations
) -> tuple[Sequence[Mapping[str, np.ndarray]], Mapping[str, np.ndarray]]:
    """Levels and numbers of a start with these values; the coupler is led back."""
    members, core = session.members, session.core
    extra = AtStart([np.zeros(member.n) for member in members], np.zeros(session.rows.p))
    specimens = [np.zeros(member.n) for member in members]
    for x, value in zip(ports.inputs, values):
        if x.kind == "velocity":
            extra.velocities[x.dof] += value
        elif x.kind == "force":
            extra.forces[x.subdomain][members[x.subdomain].position[x.dof]] += value
        else:
            specimens[x.subdomain][x.dof] = value
    g = values_at_start(session.loads.motions, session.rows.p) + extra.velocities
    session.rows.check_velocities([v for _, v in session.initial.values], g)
    outside = [pair for x in zip(members, specimens) for pair in _functions(*x)]
    state = CoreState(
        [member.core.levels() for member in members],
        [member.core.iteration() for member in members],
        core.numbers(),
    )
    count = session.clock.count(0)
    functions = works.saved(members, works.Works(), count)
    try:
        for function, force in outside:
            function.preset = force
        session.initial.start(core, members, session.loads, session.core_rows, solver, extra)
        return _state(session)
    finally:
        for function, _ in outside:
            function.preset = None
        restore_state(state, members, core, session.clock, 0)
        works.restore_functions(members, functions, count)


def _functions(member: Member, values: np.ndarray) -> list[tuple[Any, np.ndarray]]:
    """The functions of a subdomain, each with the value that counts in its place."""
    restoring = member.parts.get("restoring")
    pairs = []
    for function in () if restoring is None else filter(is_outside, restoring.functions):
        inner = getattr(function, "function", function)  # of a specimen behind devices
        if isinstance(inner, LowLevelCallable):
            raise ValueError(
                f"restoring of subdomain {member.name!r} is a compiled function, which would be "
                "evaluated once more for the values of inputs at the start: take rig.External in "
                "its place"
            )
        pairs.append((inner, values))
    return pairs


# ---- what a loop may change ----------------------------------------------------------------------


def _begin(session: Session, ports: Ports, solver: InitialAccelerations) -> dict[str, Any]:
    """Accelerations and multipliers for a unit of each input, and how far velocities may differ."""
    return {
        "inputs": tuple(_response(session, x, solver) for x in ports.inputs),
        "rounding": np.array([_rounding(session, x) for x in ports.inputs]),
    }


def _response(session: Session, x: Input, solver: InitialAccelerations) -> Any:
    """None: a velocity changes no acceleration, which its slope would."""
    if x.kind == "velocity":
        return None
    members, p = session.members, session.core_rows.p
    r = [np.zeros(member.n) for member in members]
    r[x.subdomain][members[x.subdomain].position[x.dof]] = -1.0 if x.kind == "specimen" else 1.0
    accelerations, lam = solver.response(r, np.zeros(p))
    free = [
        w - member.core.accelerate(lam) if member.mean else w
        for member, w in zip(members, accelerations)
    ]
    return {"members": tuple(map(_entries, free)), "multipliers": _entries(lam)}


def _entries(x: np.ndarray) -> Any:
    """The entries that are not zero, with their places; None: there are none."""
    at = np.flatnonzero(x)
    return {"at": at.astype(np.int64), "by": x[at]} if at.size else None


def _rounding(session: Session, x: Input) -> float:
    """By what a velocity at the start may differ from that of the structure."""
    if x.kind != "velocity":
        return 0.0
    terms = [
        abs(L).tocsr()[[x.dof]] @ np.abs(v)
        for L, (_, v) in zip(session.rows.matrices, session.initial.values)
    ]
    return ROUNDING * float(sum(np.sum(term) for term in terms))


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
