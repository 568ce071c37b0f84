"""The initial values of a coupled problem, and the start from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import pmalpha._core as _core

from .._checks import vector
from ..errors import InstabilityError
from ..problem.loads import Force
from ..problem.subdomain import Subdomain
from ..results.quantities import by_index
from ..setup.member import Member
from ..setup.rows import ConstraintRows, CoreRows
from ..setup.start import InitialAccelerations
from .loads import Loads, force_at
from .motion import Motion, all_known, reached, values_at_start


class StartValues(NamedTuple):
    """What a run starts from."""

    states: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    # lam, g: (p,) arrays, multipliers and prescribed velocities
    lam: np.ndarray
    g: np.ndarray

    @property
    def end_multipliers(self) -> np.ndarray:
        """Those of the accelerations under mean coupling, twice, and two lengths of steps."""
        return np.concatenate([self.lam, self.lam, np.zeros(2)])


class AtStart(NamedTuple):
    """What acts at t = 0 beside the loads: forces in elimination order, velocities of all rows."""

    forces: list[np.ndarray]
    velocities: np.ndarray


class InitialValues:
    """Displacements and velocities of all subdomains at t = 0.

    u0, v0: values by subdomain that replace those of the `Subdomain`.
    values: list of (u, v), (n_i,) each, in the user's order.
    """

    def __init__(
        self,
        keys: Sequence[tuple[str, Subdomain]],
        rows: ConstraintRows,
        u0: Mapping[Any, Any] | None = None,
        v0: Mapping[Any, Any] | None = None,
    ):
        self.rows = rows
        u, v = (_chosen(values, keys, name) for name, values in (("u0", u0), ("v0", v0)))
        self.values = list(zip(u, v))

    def check(self, motions: Sequence[Motion], *, tied: bool = False) -> None:
        """Check against the constraints, except those with a callable velocity. With `tied` the
        displacements are constrained too."""
        if all_known(motions):
            self._check_velocities(motions)
        displacements = [u for u, _ in self.values]
        contacts = self.rows.contacts
        if contacts is not None and not contacts.move:
            contacts.check_gaps(displacements, np.zeros(contacts.count))
        if tied:
            self.rows.check_displacements(displacements, [motion.rows for motion in motions])
        else:
            self.rows.warn_of_displacements(displacements)

    def _check_velocities(self, motions: Sequence[Motion]) -> None:
        g, p = values_at_start(motions, self.rows.p), self.rows.p
        self.rows.check_velocities([v for _, v in self.values], g, lambda: reached(motions, p))

    def start(
        self,
        core: _core.Coupler,
        members: Sequence[Member],
        loads: Loads,
        rows: CoreRows,
        solver: InitialAccelerations | None,
        extra: AtStart | None = None,
    ) -> InitialAccelerations:
        """Set consistent initial values (S1) in the core, which changes in the last lines only.

        Returns the solver of the initial accelerations, created here if it is None.
        """
        ranks = self.rows.ranks
        solver = solver or InitialAccelerations(members, rows.p, rows.numbers, ranks)
        start = self.consistent(members, loads, rows, solver, extra)
        numbers = {"end_multipliers": start.end_multipliers} | self._contact(loads)
        for member, state in zip(members, start.states):
            member.core.start(*state, start.lam)
            member.reported = member.slowed = False
        core.start(0, start.lam, start.g)
        core.set_numbers(core.numbers() | numbers)
        return solver

    def _contact(self, loads: Loads) -> dict[str, np.ndarray]:
        """What the core has of contacts at t = 0; ConstraintError for gaps that are closed."""
        if loads.obstacles is None:
            return {}
        contacts, start = loads.obstacles.contacts, loads.obstacles.start()
        d = start[contacts.rows :][: contacts.count]
        contacts.check_gaps([u for u, _ in self.values], d)
        return {"contact": start}

    def consistent(
        self,
        members: Sequence[Member],
        loads: Loads,
        rows: CoreRows,
        solver: InitialAccelerations,
        extra: AtStart | None = None,
    ) -> StartValues:
        """Consistent initial values (S1), in elimination order."""
        states = self.in_order(members)
        forces = [loads.at_start(i) for i in range(len(members))]
        g = values_at_start(loads.motions, rows.p)
        if extra is not None:
            forces = [F + force for F, force in zip(forces, extra.forces)]
            g = g + extra.velocities
        terms = [[F, *parts] for F, parts in zip(forces, loads.terms_of_motion(states))]
        g = rows.jumps_in_core(g)
        slope = rows.jumps_in_core(values_at_start(loads.motions, rows.p, slopes=True))
        if not all_known(loads.motions):
            self._check_velocities(loads.motions)
        if self.rows.ranks is not None:
            self.rows.ranks.require_equal("a prescribed velocity", (g.tobytes(), slope.tobytes()))
        accelerations, lam = solver.solve(terms, slope)
        for member, w in zip(members, accelerations):
            if not np.all(np.isfinite(w)):
                raise InstabilityError(0, 0.0, member.name)
        # under mean coupling w is without the acceleration of the multipliers
        free = [
            w - member.core.accelerate(lam) if member.mean else w
            for member, w in zip(members, accelerations)
        ]
        return StartValues([(u, v, w) for (u, v), w in zip(states, free)], lam, g)

    def in_order(self, members: Sequence[Member]) -> list[tuple[np.ndarray, np.ndarray]]:
        """(u, v) of each subdomain in elimination order."""
        return [(u[member.order], v[member.order]) for member, (u, v) in zip(members, self.values)]


def consistent_in_lanes(
    initials: Sequence[InitialValues],
    forces: Sequence[Sequence[Force]],
    loads: Loads,
    rows: CoreRows,
    solver: InitialAccelerations,
) -> StartValues:
    """Consistent initial values (S1) of several cases without functions, in elimination order.

    Bitwise those of `InitialValues.consistent`, in a column for each case.

    initials: what is computed of one that several cases share is computed once.
    loads: with the prescribed velocities of all cases.
    """
    members, p = loads.members, rows.p
    states = {initial: initial.in_order(members) for initial in dict.fromkeys(initials)}
    moving = {initial: loads.terms_of_motion(state) for initial, state in states.items()}
    u, v = (
        [columns([states[initial][i][k] for initial in initials]) for i in range(len(members))]
        for k in range(2)
    )
    terms = []
    for i, member in enumerate(members):
        parts = zip(*(moving[initial][i] for initial in initials))
        F = columns([force_at(of_case[i], member, 0.0) for of_case in forces])
        terms.append([F, *map(columns, parts)])
    g = rows.jumps_in_core(values_at_start(loads.motions, p))
    slope = rows.jumps_in_core(values_at_start(loads.motions, p, slopes=True))
    w, lam = solver.solve_columns(terms, slope)
    for member, w_i in zip(members, w):
        if not np.all(np.isfinite(w_i)):
            raise InstabilityError(0, 0.0, member.name)
        if member.mean:
            w_i -= columns([member.core.accelerate(x) for x in np.ascontiguousarray(lam.T)])
    return StartValues(list(zip(u, v, w)), lam, columns([g] * len(initials)))


def columns(vectors: Sequence[np.ndarray]) -> np.ndarray:
    """(n, k) array of k vectors."""
    return np.ascontiguousarray(np.array(vectors).T)


def _chosen(argument: Any, keys: Sequence[tuple[str, Subdomain]], name: str) -> list[np.ndarray]:
    """`u0` or `v0` of each subdomain: the given values, else those of the `Subdomain`."""
    values = {} if argument is None else by_index(argument, keys, name)
    return [
        vector(values[i], s.n, f"{name} of {key!r}") if i in values else getattr(s, name)
        for i, (key, s) in enumerate(keys)
    ]
