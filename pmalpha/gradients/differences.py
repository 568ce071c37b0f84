"""Derivatives by differences of whole runs, for what has no adjoint.

That are springs, restoring and internal forces, contacts, "mean" coupling and drift removed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import real_number
from ..problem.constraints import Constraint
from ..problem.matrices import combination
from ..problem.subdomain import Subdomain
from ..problem.unilateral import Contact
from .parameters import Parameters

# The smallest step: above it parameters of any size keep some digits of their change.
SMALLEST = 1e-300

# What a Subdomain is made of; its C has these already.
IN_C = {"rayleigh", "damping_ratio"}
ARGUMENTS = [name for name in inspect.signature(Subdomain).parameters if name not in IN_C]


def by_differences(
    session: Any,
    make: Callable[..., Any],
    of: Sequence[tuple[Parameters, str]],
    steps: int,
    record: Any,
    differences: float,
    reporting: Callable[[int], AbstractContextManager[Any]],
) -> Iterator[tuple[Any, Any, float]]:
    """For each parameter the Histories with it smaller and larger, and the difference of the two.

    make: makes a coupler, with the arguments of `Coupler`.
    of: sequence of (Parameters, name of their subdomain).
    differences: by which each parameter is changed to both sides.
    reporting: makes the report of a number of runs.
    """
    h = real_number(differences, "differences", low=SMALLEST)
    count, total = 0, 2 * sum(p.m for p, _ in of)
    with reporting(total) as report:
        for p, name in of:
            for j in range(p.m):
                pair = []
                for step in (-h, h):
                    coupler = remade(session, make, p, name, j, step)
                    pair.append(coupler.run(steps=steps, record=record))
                    count += 1
                    if report is not None:
                        report(count)
                yield pair[0], pair[1], 2.0 * h


def remade(
    session: Any, make: Callable[..., Any], p: Parameters, name: str, j: int, step: float
) -> Any:
    """The coupler at t = 0 with parameter j changed by a step."""
    subdomains = []
    present = zip(session.keys, session.loads.forces, session.initial.values)
    for (key, s), force, (u0, v0) in present:
        own: dict[str, Any] = {x: getattr(s, x) for x in ARGUMENTS}
        own |= dict(name=key, force=force, u0=u0, v0=v0)
        if key == name:
            for kind in p.matrices:
                own[kind] = combination(
                    [(1.0, own[kind]), (step, p._matrix(kind, j, np.arange(s.n)))]
                )
        subdomains.append(Subdomain(**own))
    constraints = [*_constraints(session), *_contacts(session)]
    return make(subdomains, constraints, **session.options._asdict())


def _constraints(session: Any) -> Iterator[Constraint]:
    rows, names = session.rows, [name for name, _ in session.keys]
    motions = {int(motion.rows[0]): motion.velocity for motion in session.loads.motions}
    for first, last in zip(rows.starts, rows.starts[1:]):
        matrices = {name: sp.csr_array(L)[first:last] for name, L in zip(names, rows.matrices)}
        sides: Mapping[str, Any] = {name: L for name, L in matrices.items() if L.nnz}
        yield Constraint(sides, motions.get(int(first)))


def _contacts(session: Any) -> Iterator[Contact]:
    names = {s: name for name, s in session.keys}
    known = session.rows.contacts
    for c in () if known is None else known.contacts:
        matrices, *tangents = (
            {names.get(s, s): N for s, N in x.items()} for x in (c.matrices, *c.tangents)
        )
        own = {x: getattr(c, x) for x in ("gap", "friction", "restitution", "motion", "name")}
        yield Contact(matrices, tangents=tangents, **own)
