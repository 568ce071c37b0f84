"""Back to t = 0 with other initial values and loads: `Coupler.reset`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..errors import warn
from ..problem.forces import Force, checked_force, depends_on_motion
from ..problem.subdomain import Subdomain
from ..results.keys import by_index
from ..setup.constraint_rows import ConstraintRows
from .initial import InitialValues
from .sampled import warn_of_skipped
from .session import Session, check_call, take, take_first_steps, take_loads, together


class Case(NamedTuple):
    """Initial values and the force on each subdomain."""

    initial: InitialValues
    forces: list[Force]


def checked_case(
    keys: Sequence[tuple[str, Subdomain]],
    rows: ConstraintRows,
    u0: Any = None,
    v0: Any = None,
    force: Any = None,
) -> Case:
    """The arguments of `Coupler.reset`, with those of the `Subdomain` where none is given."""
    return Case(InitialValues(keys, rows, u0, v0), checked_forces(keys, force))


def checked_forces(keys: Sequence[tuple[str, Subdomain]], force: Any) -> list[Force]:
    """The force on each subdomain, that of the `Subdomain` where none is given."""
    given = by_index(force, keys, "force")
    return [
        _checked_force(given[i], s, name) if i in given else s.force
        for i, (name, s) in enumerate(keys)
    ]


def _checked_force(force: Any, s: Subdomain, name: str) -> Force:
    checked = checked_force(force, s.n)
    if depends_on_motion(checked) and not s.has_feedback:
        raise ValueError(
            f"force of {name!r} can only be a function of t, u and v where that of the Subdomain "
            "is one"
        )
    return checked


def reset(
    session: Session,
    u0: Mapping[Any, Any] | None,
    v0: Mapping[Any, Any] | None,
    force: Mapping[Any, Any] | None,
) -> None:
    """`Coupler.reset`."""
    with together(session):
        check_call(session, "reset")
        case = checked_case(session.keys, session.rows, u0, v0, force)
        case.initial.check(session.loads.motions, tied=session.coupling == "mean")
        warn_of_records(session, [case])
        kept = session.initial, session.loads, session.started, session.steps, session.assembly
        session.was_reset = True
        try:
            return_to_start(session, case)
        except BaseException:
            session.initial, session.loads, session.started, steps, assembly = kept
            take(session, steps, assembly)
            session.core.set_origin(steps.clock.origin, steps.clock.t0)
            session.loads.to_core()
            raise
        session.last_history = None
        if session.changed:
            session.changed = False
            warn(
                "reset() returns to the steps with which the coupler was made: those of "
                "change_steps are undone; call it again for them",
                UserWarning,
            )


def warn_of_records(session: Session, cases: Sequence[Case]) -> None:
    """Warn of loads of which steps skip samples, but for those of the `Subdomain`, of which
    the set-up has warned."""
    parts = session.assemblies.first.parts
    for case in cases:
        forces = [
            None if force is part.subdomain.force else force
            for part, force in zip(parts, case.forces)
        ]
        warn_of_skipped(parts, forces)


def return_to_start(session: Session, case: Case) -> None:
    take_first_steps(session)
    session.initial, session.started = case.initial, False
    session.loads = session.loads.renewed(case.forces)
    take_loads(session)  # changes the core in its last lines only
