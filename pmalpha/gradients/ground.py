"""What a ground motion adds to accelerations in derivatives with respect to masses, (A18)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..problem.forces import BaseAcceleration, Force
from ..problem.matrices import product
from ..problem.subdomain import Subdomain
from .parameters import Parameters

# Rounding of M times a direction, relative to its largest entry.
ROUNDING = 1e-12


def of_own_mass(force: Force, M: Any) -> bool:
    """Whether a ground motion is that of this mass matrix, -M direction record."""
    assert isinstance(force, BaseAcceleration) and force.shape is not None
    if force.direction is None:
        return False
    error = np.abs(force.shape + product(M, force.direction)).max()
    return bool(error <= ROUNDING * np.abs(force.shape).max())


def with_mass(force: Force, M: Any) -> Force:
    """A load of a subdomain for another mass matrix."""
    if not isinstance(force, BaseAcceleration) or force.direction is None:
        return force
    return force._changed(shape=-product(M, force.direction))


def check_masses(
    keys: Sequence[tuple[str, Subdomain]],
    forces: Sequence[Force],
    parameters: Sequence[Parameters],
    names: Sequence[str],
) -> None:
    """ValueError where masses have parameters and a ground motion is that of another mass matrix.

    `names` are the subdomains of the parameters.
    """
    own = {name: (s, force) for (name, s), force in zip(keys, forces)}
    for p, name in zip(parameters, names):
        s, force = own[name]
        if "M" not in p.matrices or not isinstance(force, BaseAcceleration):
            continue
        if not of_own_mass(force, s.M):
            raise ValueError(
                "parameters of M need a BaseAcceleration that is made of the M of the same "
                f"subdomain, got another one on {name!r}, whose dependence on the parameters is "
                "not known"
            )


def acceleration(force: Force, t: np.ndarray) -> np.ndarray:
    """That of the ground in the direction of each dof, (levels, n), as the load has it; without
    a ground motion (1, 1), zero."""
    if not isinstance(force, BaseAcceleration) or force.direction is None:
        return np.zeros((1, 1))
    result: np.ndarray = force._series(t) @ force.direction.T
    return result
