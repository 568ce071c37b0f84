"""A coupler of the same problem as another one at t = 0, with other steps or matrices."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..problem.constraints import Constraint
from ..problem.subdomain import Subdomain
from ..problem.unilateral import Contact

# What a Subdomain is made of; its C has these already.
IN_C = {"rayleigh", "damping_ratio"}
ARGUMENTS = [name for name in inspect.signature(Subdomain).parameters if name not in IN_C]


def remade(
    session: Any,
    make: Callable[..., Any],
    change: Callable[[str, dict[str, Any]], None],
    *,
    of_motion: Callable[[Any, str], Any] = lambda motion, _: motion,
    **options: Any,
) -> Any:
    """The coupler at t = 0, with the present initial values and loads.

    make: makes a coupler, with the arguments of `Coupler`.
    change: changes the arguments of the `Subdomain` of this name, a dict.
    of_motion: ``of_motion(motion, what)`` is taken in place of a prescribed velocity and of the
        motion of a contact, `what` being its name in messages.
    options: those of `Coupler` in place of those with which it was made.
    """
    subdomains = []
    present = zip(session.keys, session.loads.forces, session.initial.values)
    for (key, s), force, (u0, v0) in present:
        arguments: dict[str, Any] = {x: getattr(s, x) for x in ARGUMENTS}
        arguments |= dict(name=key, force=force, u0=u0, v0=v0)
        for matrix in "MK":  # None is one of zeros
            arguments[matrix] = np.zeros(s.n) if arguments[matrix] is None else arguments[matrix]
        change(key, arguments)
        subdomains.append(Subdomain(**arguments))
    constraints = [*_constraints(session, of_motion), *_contacts(session, of_motion)]
    options = {**session.options._asdict(), **options}
    return make(subdomains, constraints, **options)


def _constraints(session: Any, of_motion: Callable[[Any, str], Any]) -> Iterator[Constraint]:
    rows, names = session.rows, [name for name, _ in session.keys]
    motions = {int(motion.rows[0]): motion for motion in session.loads.motions}
    for first, last in zip(rows.starts, rows.starts[1:]):
        matrices = {name: sp.csr_array(L)[first:last] for name, L in zip(names, rows.matrices)}
        sides: Mapping[str, Any] = {name: L for name, L in matrices.items() if L.nnz}
        motion = motions.get(int(first))
        velocity = None if motion is None else of_motion(motion.velocity, motion.what)
        yield Constraint(sides, velocity)


def _contacts(session: Any, of_motion: Callable[[Any, str], Any]) -> Iterator[Contact]:
    names = {s: name for name, s in session.keys}
    known = session.rows.contacts
    for c, label in () if known is None else zip(known.contacts, known.names):
        matrices, *tangents = (
            {names.get(s, s): N for s, N in x.items()} for x in (c.matrices, *c.tangents)
        )
        numbers = ("gap", "friction", "friction_static", "restitution", "name")
        arguments = {x: getattr(c, x) for x in numbers}
        what = f"motion of {label!r}"
        motion: Any = (
            tuple(of_motion(f, what) for f in c.motion)
            if isinstance(c.motion, tuple)
            else of_motion(c.motion, what)
        )
        yield Contact(matrices, tangents=tangents, motion=motion, **arguments)
