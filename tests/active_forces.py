"""Restoring forces of one dof that feed in energy, or take it, with no help of the steps."""

import numpy as np

ACTIVE_FORCES = {
    "active": lambda u, v, t: -0.2 * v,  # negative damping: it grows a million times
    "load": lambda u, v, t: -np.sin(6.0 * t) * np.ones(1),
    "van der Pol": lambda u, v, t: u - 2.0 * (1.0 - u * u) * v,
    "plastic": lambda u, v, t: np.clip(30.0 * u, -1.0, 1.0),
    "friction": lambda u, v, t: 0.3 * np.sign(v),
    "noise": lambda u, v, t: 4.0 * u + 0.1 * np.sin(1e5 * t),
    "step": lambda u, v, t: -1.0 * (t > 1.0) * np.ones(1),
}
