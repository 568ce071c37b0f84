"""What a ground motion adds to accelerations in derivatives with respect to masses, (A18)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeGuard

import numpy as np

from ..problem.forces import BaseAcceleration, Force, each_term, terms_of
from ..problem.matrices import product
from ..problem.subdomain import Subdomain
from .parameters import Parameters

# Rounding of M times a direction, relative to its largest entry.
ROUNDING = 1e-12


def of_own_mass(force: BaseAcceleration, M: Any) -> bool:
    """Whether a ground motion is that of this mass matrix, -M direction record."""
    assert force.shape is not None
    if force.direction is None:
        return False
    error = np.abs(force.shape + product(M, force.direction)).max()
    return bool(error <= ROUNDING * np.abs(force.shape).max())


def with_mass(force: Force, M: Any) -> Force:
    """The loads of a subdomain for another mass matrix."""

    def changed(term: Any) -> Any:
        if not _is_ground(term) or term.direction is None:
            return term
        return term._changed(shape=-product(M, term.direction))

    return each_term(force, changed)


def _is_ground(term: Any) -> TypeGuard[BaseAcceleration]:
    return isinstance(term, BaseAcceleration)


def check_masses(
    keys: Sequence[tuple[str, Subdomain]],
    forces: Sequence[Force],
    parameters: Sequence[Parameters],
    names: Sequence[str],
) -> None:
    """ValueError where masses have parameters and a ground motion is that of another mass matrix.

    `names` are the subdomains of the parameters.
    """
    subdomains = {name: (s, force) for (name, s), force in zip(keys, forces)}
    for p, name in zip(parameters, names):
        s, force = subdomains[name]
        if "M" not in p.matrices:
            continue
        if not all(of_own_mass(x, s.M) for x in filter(_is_ground, terms_of(force))):
            raise ValueError(
                "parameters of M need a BaseAcceleration that is made of the M of the same "
                f"subdomain, got another one on {name!r}, whose dependence on the parameters is "
                "not known"
            )


def acceleration(force: Force, t: np.ndarray) -> np.ndarray:
    """Acceleration of the ground in the direction of each dof, (levels, n), as the load has it;
    without a ground motion (1, 1), zero."""
    motions = (x for x in filter(_is_ground, terms_of(force)) if x.direction is not None)
    return sum((x._series(t) @ x.direction.T for x in motions), np.zeros((1, 1)))
