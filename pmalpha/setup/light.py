"""Masses that are too small for the step: their accelerations lose the digits of displacements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from .._cached import Once
from .._checks import numbered
from ..errors import StabilityWarning, warn
from ..problem.matrices import Matrix, diagonal
from .member import Member

EPS = float(np.finfo(float).eps)


def warn_of_light(members: Iterable[Member]) -> None:
    """StabilityWarning for dofs of implicit schemes with 0 < m < eps h^2 k, k at t = 0.

    A displacement u is out of balance by k u, hence the acceleration k u / m, and the predictor
    adds h^2 times that: beyond u / eps nothing of u is left in the sum.
    """
    once = Once()
    for member in members:
        name, s, h = member.name, member.subdomain, member.step
        if s.scheme.explicit or s.M is None:
            continue
        stiffnesses = (s.tangent, None if member.internal is None else member.internal.K)
        light, m, k = once(partial(_light, s.M, stiffnesses, h), (s.M, *stiffnesses), h)
        if light.size:
            worst = light[np.argmax(k[light] / m[light])]
            ratio = h * h * k[worst] / m[worst]
            warn(
                f"the mass at {numbered('dof', light)} of subdomain {name!r} is smaller than "
                f"2.2e-16 h^2 K, down to {m[worst]:g} with h^2 K / M = {ratio:.3g}: accelerations "
                "out of balance move the displacements by more than the digits they have; give M "
                "a zero there, for a dof without mass, with a scheme that damps at infinite "
                "frequency",
                StabilityWarning,
            )


def _light(
    M: Matrix, stiffnesses: Sequence[Matrix | None], h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The dofs with 0 < m < eps h^2 k, m and k."""
    m, k = diagonal(M), np.abs(sum(diagonal(A) for A in stiffnesses if A is not None))
    return np.flatnonzero((m > 0.0) & (m < EPS * h * h * k)), m, k
