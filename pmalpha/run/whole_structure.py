"""What a coupler returns of the structure before it was cut: equilibrium, matrices, modes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import real_array, vector, whole_number
from ..errors import BucklingError
from ..memory import one_thread
from ..problem.matrices import is_symmetric
from ..problem.restoring import wheels_of
from ..reduction.modes import IndefiniteStiffness
from ..reduction.modes import modes as modes_of
from ..results.quantities import by_index
from ..setup.equilibrium import Equilibrium, static_displacements
from ..setup.internal_forces import matrices_at
from ..setup.ranks import joined
from ..setup.rows import Assembled
from ..setup.rows import assembled as assemble
from .session import Session, begin, check_call, require_alone, require_possible, together

MOVING = "springs with an end that moves"


def static(session: Session, steps: int) -> dict[str, np.ndarray]:
    with together(session):
        check_call(session, "static", steps)
        require_possible(session, "static")
        steps = whole_number(steps, "steps", low=1)
        for name, s in session.keys:
            if s.has_functions:
                what = MOVING if wheels_of(s.restoring) else "a restoring function"
                raise ValueError(
                    "static needs springs as restoring forces, and functions as internal ones, "
                    f"got {what} on {name!r}"
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
                f"force, got none for {name!r}" + f" with {MOVING}" * bool(wheels_of(s.restoring))
            )
    begin(session)
    t = session.clock.time(session.core.step_count)
    matrices = []
    for member in session.members:
        u, v, *memory = member.present()
        s, internal = member.subdomain, member.internal
        matrices.append((s.M, *matrices_at(s, internal, t, u, v, *memory)))
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


def harmonic(session: Session, omega: Any, force: Mapping[Any, Any]) -> dict[str, np.ndarray]:
    with session.guard:
        structure = _assembled(session, "harmonic")
    frequencies = np.atleast_1d(real_array(omega, "omega", (0, 1)))
    if np.any(frequencies < 0.0):
        raise ValueError(f"omega must not be negative, got {frequencies.min():g}")
    amplitudes = by_index(force, session.keys, "force")
    F = np.zeros(structure.n, dtype=complex)
    for i, value in amplitudes.items():
        name, s = session.keys[i]
        F += structure.map[name].T @ _amplitude(value, s.n, f"force of {name!r}")
    x = np.array([_response(structure, w, F) for w in frequencies]).reshape(-1, F.size)
    return {name: np.asarray((T @ x.T).T) for name, T in structure.map.items()}


def _amplitude(value: Any, n: int, name: str) -> np.ndarray:
    """(n,) complex."""
    return vector(np.real(value), n, name) + 1j * vector(np.imag(value), n, name)


def _response(structure: Assembled, w: float, F: np.ndarray) -> np.ndarray:
    """The solution of (K + i w C - w^2 M) x = F."""
    from scipy.sparse.linalg import splu

    A = sp.csc_array(structure.K + 1j * w * structure.C - w**2 * structure.M)
    with one_thread():
        try:
            x: np.ndarray = splu(A).solve(F)
        except RuntimeError:  # exactly singular
            x = np.full(F.size, np.nan, dtype=complex)
    if not np.all(np.isfinite(x)):
        raise ValueError(
            f"omega must be no natural frequency of an undamped structure, got {w:g}; give it "
            "damping"
        )
    return x


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
