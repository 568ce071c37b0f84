"""What a coupler returns of the structure before it was cut: equilibrium, matrices, modes."""

from __future__ import annotations

import math

import numpy as np

from .._checks import whole_number
from ..errors import BucklingError
from ..problem.matrices import is_symmetric
from ..reduction.eigenmodes import IndefiniteStiffness
from ..reduction.eigenmodes import modes as modes_of
from ..setup.eliminated_rows import Assembled
from ..setup.eliminated_rows import assembled as assemble
from ..setup.equilibrium import Equilibrium, static_displacements
from ..setup.internal_forces import matrices_at
from ..setup.ranks import joined
from .session import Session, begin, check_call, require_alone, require_no_contacts, together


def static(session: Session, steps: int) -> dict[str, np.ndarray]:
    with together(session):
        check_call(session, "static", steps)
        require_no_contacts(session, "static")
        steps = whole_number(steps, "steps", low=1)
        for name, s in session.keys:
            if s.has_functions:
                raise ValueError(
                    "static needs springs as restoring forces, and functions as internal ones, "
                    f"got a restoring function on {name!r}"
                )
        done = session.done
        motions = session.initial.values
        forces = [
            session.loads.static(i, motions[i], done)[member.position]
            for i, member in enumerate(session.members)
        ]
        u = equilibrium_of(session, forces, steps)
    return dict(zip((name for name, _ in session.keys), u))


def equilibrium_of(session: Session, forces: list[np.ndarray], steps: int) -> list[np.ndarray]:
    internal, matrices = [member.internal for member in session.members], session.rows.scaled
    iterated = [bool(s.springs) or x is not None for (_, s), x in zip(session.keys, internal)]
    if any(joined(session.ranks, iterated)):
        newton, ranks = session.loads.newton, session.ranks
        problem = Equilibrium(session.keys, internal, matrices, forces, newton, ranks)
        return problem.solve([u for u, _ in session.initial.values], steps)
    terms = [(s.K, L, F) for (_, s), L, F in zip(session.keys, matrices, forces)]
    u = static_displacements(*zip(*joined(session.ranks, terms)))
    return u if session.ranks is None else u[session.ranks.part]


def assembled(session: Session) -> Assembled:
    with session.guard:
        return _assembled(session, "assembled")


def _assembled(session: Session, what: str) -> Assembled:
    require_alone(session, what)
    for name, s in session.keys:
        if s.has_unknown_stiffness:
            raise ValueError(
                "the assembled structure needs restoring_stiffness where there is a restoring "
                f"force, got none for {name!r}"
            )
    begin(session)
    t = session.clock.time(session.core.step_count)
    matrices = []
    for member in session.members:
        u, v, *memory = member.present()
        s, internal = member.subdomain, member.internal
        matrices.append((s.M, *matrices_at(s, internal, u, v, t, *memory)))
    for member, (_, _, K) in zip(session.members, matrices):
        if what == "modes" and not (member.subdomain.symmetric or is_symmetric(K)):
            raise ValueError(
                "modes needs a symmetric stiffness, got an unsymmetric one of "
                f"{member.name!r}; M, C and K of assembled() have complex eigenvalues, of "
                "[[0, 1], [-M^-1 K, -M^-1 C]]"
            )
    return assemble([name for name, _ in session.keys], matrices, session.rows.scaled)


def modes(session: Session, k: int = 6) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    with session.guard:
        structure, t = _assembled(session, "modes"), session.clock.time(session.core.step_count)
    try:
        omega, shapes = modes_of(structure.M, structure.K, k)
    except IndefiniteStiffness as error:
        raise _buckling(error, structure, t) from None
    return omega, {name: T @ shapes for name, T in structure.map.items()}


def _buckling(error: IndefiniteStiffness, structure: Assembled, t: float) -> BucklingError:
    growth = math.sqrt(-error.square)
    mode = {name: T @ error.shape for name, T in structure.map.items()}
    name = max(mode, key=lambda name: float(np.max(np.abs(mode[name]), initial=0.0)))
    dof = int(np.argmax(np.abs(mode[name])))
    return BucklingError(
        f"the structure must be stable in its present state, at t = {t:g}, but has a motion of "
        f"negative stiffness, buckling or softening: omega^2 = {error.square:g}, which grows like "
        f"exp({growth:.3g} t); its largest displacement is that of dof {dof} of {name!r}, and "
        "`mode` of this error has it",
        growth,
        mode,
    )
