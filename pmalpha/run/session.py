"""The state of a coupler, what all of its calls begin with, and the way back to t = 0.

`Coupler` has one `Session`; the functions of this folder take it as their first argument.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import ref

import numpy as np

import pmalpha._core as _core

from .._core import Guard
from ..errors import warn
from ..memory import reserve_buffers
from ..problem.arguments import Coupling
from ..problem.contacts import Contact
from ..problem.loads import Force, Mass, checked_force, depends_on_motion
from ..problem.restoring import devices_of
from ..problem.subdomain import Subdomain
from ..results.history import History
from ..results.quantities import by_index
from ..results.recording import Recorded
from ..results.times import Clock, clock_of
from ..setup.assembly import Assemblies, Assembly
from ..setup.combinations import Placed, require_call, require_schemes
from ..setup.contact_rows import Contacts
from ..setup.member import Member
from ..setup.ranks import Ranks, described, joined, require_equal_problems
from ..setup.rows import ConstraintRows, CoreRows
from ..setup.schedule import (
    MACRO,
    Layout,
    Options,
    Rows,
    checked_constraints,
    checked_options,
    checked_subdomains,
    double_steps,
    finest,
    most_threads,
    names_of,
    stages,
    two_sided_and_contacts,
)
from ..setup.start import InitialAccelerations
from .loads import InitialValues, Loads, warn_of_skipped
from .motion import Motion, Obstacles, motions_of
from .transfer import Steps
from .works import Works


@dataclass
class Session:
    """What a `Coupler` was made of, and its present state."""

    # one call at a time: a load that used its own coupler would see an incomplete step
    guard: Guard
    ranks: Ranks | None  # the processes that share the problem
    # the subdomains of all processes, or what is known of those of others
    everything: Sequence[Any]
    keys: tuple[tuple[str, Subdomain], ...]  # of this process
    options: Options
    threads_allowed: tuple[int, bool]  # from `most_threads`
    # rows, core_rows: the constraints, as the user has written them and as the core has them
    rows: ConstraintRows
    core_rows: CoreRows
    # assemblies, steps, assembly: what was made for each set of steps; the present steps, and what
    # belongs to them
    assemblies: Assemblies
    steps: Steps
    assembly: Assembly
    # initial, loads: initial values and loads of the last start or `reset`
    initial: InitialValues
    loads: Loads
    accelerations: InitialAccelerations | None  # the solver of the initial ones, while it is kept
    # started, was_reset: whether the initial accelerations are in the core; whether there was a
    # `reset`
    started: bool = False
    was_reset: bool = False
    last_history: History | None = None
    completed: ref[History] | None = None  # to the History of the last run that was completed
    changed: bool = False  # whether `change_steps` was called since the start
    # facts of the problem for a checkpoint, once they were needed
    constants: dict[str, Any] | None = None
    # the rows of the repr, of this assembly
    table: tuple[Assembly, list[tuple[str, ...]]] | None = None
    full_record: Recorded | None = None  # what runs record of everything, until the steps change
    monitor: Any = None  # what paced runs write for another process to look at
    works: Works = Works()  # of the last run with energies, with which they go on

    @property
    def coupling(self) -> Coupling:
        return self.options.coupling

    @property
    def clock(self) -> Clock:
        """The times of the present steps."""
        return self.steps.clock

    @property
    def members(self) -> tuple[Member, ...]:
        """The subdomains of this process with the present steps."""
        return self.assembly.members

    @property
    def core(self) -> _core.Coupler:
        """The coupler of the core with the present steps."""
        return self.assembly.core

    @property
    def fine(self) -> int:
        """Interface problems in a macro step."""
        return self.core.instants

    @property
    def done(self) -> int:
        """Completed macro steps."""
        return self.core.step_count if self.started else 0


# ---- set-up --------------------------------------------------------------------------------------
# In this order, which is that of the constructor of `Coupler`.


class Problem(NamedTuple):
    """What is coupled, as far as it is known without computing anything."""

    ranks: Ranks | None
    everything: Sequence[Any]  # of all processes
    keys: tuple[tuple[str, Subdomain], ...]  # of this one
    names: list[str]  # of all
    options: Options
    threads: tuple[int, bool]
    layout: Layout
    groups: tuple[Rows, ...]  # the rows of each constraint
    contacts: Contacts | None

    @property
    def clock(self) -> Clock:
        return clock_of(self.layout)

    @property
    def part(self) -> slice:
        """The subdomains of this process."""
        return slice(None) if self.ranks is None else self.ranks.part


def checked_problem(
    subdomains: Any, constraints: Any, options: Options, threads: int | None, ranks: Ranks | None
) -> Problem:
    """The arguments of a `Coupler`, each refused by its name where it is wrong."""
    subdomains = checked_subdomains(subdomains, may_be_empty=ranks is not None)
    most, fewer = most_threads(threads)
    threads_allowed = reserve_buffers(most, fewer=fewer), fewer
    everything = subdomains if ranks is None else described(ranks, subdomains)
    options = checked_options(options, len(everything))
    names = names_of(everything)
    bilateral, unilateral = two_sided_and_contacts(constraints)
    groups = checked_constraints(bilateral, everything, names, options.coupling)
    contacts = contacts_of(unilateral, everything, names, ranks)
    if ranks is not None:
        require_equal_problems(ranks, groups, options.facts)
    keys = tuple(zip(names[slice(None) if ranks is None else ranks.part], subdomains))
    substeps = tuple(s.substeps for s in everything)
    require_schemes(
        Placed(*key, options.coupling, is_shared=ranks is not None)
        for key in zip(names, everything)
    )
    layout = layout_of(everything, options.coupling, options.dt, substeps)
    check_delays(keys, clock_of(layout).dt)
    return Problem(
        ranks, everything, keys, names, options, threads_allowed, layout, groups, contacts
    )


class Ties(NamedTuple):
    """The constraints as independent rows, and what holds at t = 0."""

    rows: ConstraintRows
    motions: list[Motion]
    initial: InitialValues


def checked_ties(problem: Problem) -> Ties:
    """ValueError for constraints that depend on each other, or that the velocities violate."""
    rows = ConstraintRows(
        problem.groups, problem.everything, problem.part, problem.ranks, problem.contacts
    )
    coupling = problem.options.coupling
    fine = 1 if coupling in MACRO else max(problem.layout.substeps)
    motions = motions_of(problem.groups, rows, fine, problem.clock)
    initial = InitialValues(problem.keys, rows)
    initial.check(motions, tied=coupling == "mean")
    return Ties(rows, motions, initial)


def factored(problem: Problem, ties: Ties) -> Assemblies:
    """The orders, factors and H of these steps, judged; the rest when steps change."""
    with np.errstate(over="ignore"):  # a matrix that overflows is refused as singular
        return Assemblies(
            problem.keys,
            ties.rows.links,
            ties.rows.p,
            problem.layout,
            [motion.rows for motion in ties.motions],
            options=problem.options,
            threads=problem.threads,
            ranks=problem.ranks,
            contacts=problem.contacts,
            groups=problem.groups,
        )


def acting(problem: Problem, ties: Ties, assembly: Assembly) -> Loads:
    """The loads as these steps take them, with a warning of what they skip."""
    core, members, clock = assembly.core, assembly.members, problem.clock
    forces = [s.force for _, s in problem.keys]
    warn_of_skipped(members, forces, ties.motions, clock.dt / core.instants)
    touching = problem.contacts
    obstacles = None if touching is None else Obstacles(touching, core.instants, clock)
    newton, names = problem.options.newton, problem.names
    return Loads(core, members, clock, forces, ties.motions, newton, names, obstacles)


def begun(
    guard: Guard, problem: Problem, ties: Ties, assemblies: Assemblies, loads: Loads
) -> Session:
    """At t = 0, with the initial accelerations unless they need functions of the user."""
    session = Session(
        guard=guard,
        ranks=problem.ranks,
        everything=problem.everything,
        keys=problem.keys,
        options=problem.options,
        threads_allowed=problem.threads,
        rows=ties.rows,
        core_rows=CoreRows(assemblies.row_position, ties.rows.scale, problem.contacts),
        assemblies=assemblies,
        steps=Steps(problem.layout, problem.clock),
        assembly=assemblies.first,
        initial=ties.initial,
        loads=loads,
        accelerations=assemblies.accelerations,
    )
    take_loads(session)
    return session


def check_delays(keys: Sequence[tuple[str, Subdomain]], dt: float) -> None:
    """ValueError for a delay of a device of more steps of its subdomain than it takes."""
    for name, s in keys:
        for device in devices_of(s.restoring):
            device._check_delays(dt / s.substeps, f"restoring of subdomain {name!r}")


def contacts_of(
    contacts: Sequence[Contact],
    everything: Sequence[Any],
    names: Sequence[str],
    ranks: Ranks | None,
) -> Contacts | None:
    """The contacts, if there are any; ValueError for what they do not go with."""
    if not contacts:
        return None
    if ranks is not None:
        raise ValueError("contacts need a Coupler without comm: one process solves for impulses")
    made = Contacts(contacts, everything, names)
    made.check(everything, names)
    return made


def layout_of(
    everything: Sequence[Any], coupling: str, dt: float, substeps: tuple[int, ...]
) -> Layout:
    """The lengths of all steps; ValueError for numbers of substeps that do not fit."""
    finest(substeps, coupling)
    doubles = double_steps(everything, coupling, substeps)
    return Layout(dt, substeps, doubles, staged=stages(everything, substeps))


# ---- calls ---------------------------------------------------------------------------------------


def together(session: Session) -> AbstractContextManager[Any]:
    """One call at a time, that all processes make: it ends in all of them, or with an exception
    in all of them."""
    guard: AbstractContextManager[Any] = session.guard
    return guard if session.ranks is None else session.ranks.entered(session.guard)


def check_call(session: Session, *call: Any) -> None:
    """ValueError unless all processes make the same call."""
    if session.ranks is not None:
        session.ranks.require_equal("the call", call)


def in_any(session: Session, happened: bool) -> bool:
    """Whether this happened in some process."""
    return any(joined(session.ranks, [happened]))


def require_alone(session: Session, what: str) -> None:
    if session.ranks is not None:
        raise ValueError(f"{what} needs a Coupler without comm")


def placed_of(session: Session) -> list[Placed]:
    """The subdomains of this process with what is around them."""
    doubles, contacts = session.steps.layout.doubles, session.rows.contacts
    return [
        Placed(
            name,
            s,
            session.coupling,
            session.options.start,
            doubles[i],
            touches=contacts is not None and i in contacts.N,
            beside_contact=contacts is not None,
            moved=bool(session.loads.motions),
        )
        for i, (name, s) in enumerate(session.keys, session.assembly.first)
    ]


def require_possible(session: Session, what: str) -> None:
    """ValueError for what this call does not go with, by the table of setup/combinations.py."""
    require_call(what, placed_of(session))


def require_linear(session: Session, what: str) -> None:
    """ValueError with `comm`, for restoring and internal forces, and with contacts."""
    require_alone(session, what)
    require_possible(session, what)


# ---- steps and start -----------------------------------------------------------------------------


def take(session: Session, steps: Steps, assembly: Assembly) -> None:
    """Continue with these steps and this assembly."""
    if assembly is not session.assembly:
        session.table = session.full_record = None
    session.steps, session.assembly = steps, assembly


def take_first_steps(session: Session) -> None:
    """The steps with which the coupler was made, for a start."""
    layout, first = session.assemblies.first_layout, session.assemblies.first
    take(session, Steps(layout, clock_of(layout)), first)
    first.core.set_origin(0, 0.0)
    loads = session.loads
    if loads.core is not first.core or loads.clock != session.clock or any(loads.begins):
        session.loads = loads.with_steps(first.core, first.members, session.clock)


def take_loads(session: Session) -> None:
    """Give the core the loads, and start unless the start has to evaluate functions."""
    session.loads.to_core()
    if session.ranks is not None or not session.loads.has_functions:
        begin(session)  # otherwise `run` or `step` starts, and may raise an exception of theirs


def begin(session: Session) -> None:
    """Consistent initial values, unless computed before, equation (S1)."""
    if session.started:
        return
    solver = session.initial.start(
        session.core, session.members, session.loads, session.core_rows, session.accelerations
    )
    session.started = True
    # only a reset needs the factor of M again: kept from the first reset on
    session.accelerations = solver if session.was_reset else None


class Case(NamedTuple):
    """Initial values and the force on each subdomain."""

    initial: InitialValues
    forces: list[Force]


def checked_forces(
    keys: Sequence[tuple[str, Subdomain]], force: Any, masses: Sequence[Mass]
) -> list[Force]:
    """The force on each subdomain, that of the `Subdomain` where none is given."""
    forces = by_index(force, keys, "force")
    return [
        _checked_force(forces[i], s, name, mass) if i in forces else s.force
        for i, ((name, s), mass) in enumerate(zip(keys, masses))
    ]


def masses_of(keys: Sequence[tuple[str, Subdomain]]) -> list[Mass]:
    return [Mass(s.M, s.dof_names) for _, s in keys]


def _checked_force(force: Any, s: Subdomain, name: str, mass: Mass) -> Force:
    checked = checked_force(force, s.n, mass=mass)
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
    with together(session):
        check_call(session, "reset")
        initial = InitialValues(session.keys, session.rows, u0, v0)
        case = Case(initial, checked_forces(session.keys, force, masses_of(session.keys)))
        case.initial.check(session.loads.motions, tied=session.coupling == "mean")
        warn_of_records(session, [case])
        before = session.initial, session.loads, session.started, session.steps, session.assembly
        session.was_reset = True
        try:
            return_to_start(session, case)
        except BaseException:
            session.initial, session.loads, session.started, steps, assembly = before
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
    members = session.assemblies.first.members
    for case in cases:
        forces = [
            None if force is member.subdomain.force else force
            for member, force in zip(members, case.forces)
        ]
        warn_of_skipped(members, forces)


def return_to_start(session: Session, case: Case) -> None:
    take_first_steps(session)
    session.initial, session.started, session.works = case.initial, False, Works()
    session.loads = session.loads.renewed(case.forces)
    take_loads(session)  # changes the core in its last lines only
