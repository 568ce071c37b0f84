"""Forces of one dof that feed in energy, or take it, with no help of the steps."""

import numpy as np

ACTIVE_FORCES = {
    "active": lambda t, u, v: -0.2 * v,  # negative damping: it grows as long as it runs
    "load": lambda t, u, v: -np.sin(6.0 * t) * np.ones(1),
    "van der Pol": lambda t, u, v: u - 2.0 * (1.0 - u * u) * v,
    "step": lambda t, u, v: -1.0 * (t > 1.0) * np.ones(1),
}
