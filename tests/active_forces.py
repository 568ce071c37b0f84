"""Restoring forces of one dof that feed in energy, or take it, with no help of the steps."""

import numpy as np
import pytest

import pmalpha as pm

RHO_0 = pm.GeneralizedAlpha(0.0)
ACTIVE_FORCES = {
    "active": lambda u, v, t: -0.2 * v,  # negative damping: it grows as long as it runs
    "load": lambda u, v, t: -np.sin(6.0 * t) * np.ones(1),
    "van der Pol": lambda u, v, t: u - 2.0 * (1.0 - u * u) * v,
    "plastic": lambda u, v, t: np.clip(30.0 * u, -1.0, 1.0),
    "friction": lambda u, v, t: 0.3 * np.sign(v),
    "noise": lambda u, v, t: 4.0 * u + 0.1 * np.sin(1e5 * t),
    "step": lambda u, v, t: -1.0 * (t > 1.0) * np.ones(1),
}


# friction that should hold a mass lets it creep, and alternates at the end
CREEPS = pytest.mark.filterwarnings("ignore:.* alternate:pmalpha.StabilityWarning")


def fed(schemes):
    """Each force with two of four schemes in turn."""
    return [
        pytest.param(
            force,
            schemes[(i + j) % 4],
            id=f"{name}, {schemes[(i + j) % 4]!r}",
            marks=[CREEPS] * (name == "friction"),
        )
        for i, (name, force) in enumerate(ACTIVE_FORCES.items())
        for j in (0, 2)
    ]
