"""Masses that are too small for the step: their accelerations lose the digits of displacements."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .._checks import numbered
from ..errors import StabilityWarning, warn
from ..problem.matrices import diagonal
from ..problem.subdomain import Subdomain

EPS = float(np.finfo(float).eps)


def warn_of_light(steps: Iterable[tuple[str, Subdomain, float]]) -> None:
    """StabilityWarning for dofs of implicit schemes with 0 < m < eps h^2 k.

    A displacement u is out of balance by k u, hence the acceleration k u / m, and the predictor
    adds h^2 times that: beyond u / eps nothing of u is left in the sum.
    """
    for name, s, h in steps:
        if s.scheme.explicit or s.M is None or s.tangent is None:
            continue
        m, k = diagonal(s.M), np.abs(diagonal(s.tangent))
        light = np.flatnonzero((m > 0.0) & (m < EPS * h * h * k))
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
