"""The structure of the README, which other examples couple to other programs."""

import numpy as np

import pmalpha as pm

DT = 0.01  # the macro step
ROOF = 0.1  # the initial displacement of the roof


def tower_on_rig(force=None, spring=0.0):
    """A coupler whose roof has the load `force(t)` and a spring of this stiffness to the ground.

    Without a load it can be an FMU, to which a master gives the force.
    """

    def load(t):
        return np.array([0.0, 0.0, force(t)])

    tower = pm.Subdomain(
        [1.0, 2.0, 1.0],
        np.array([[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0 + spring]]),
        scheme=pm.GeneralizedAlpha(0.8),
        force=None if force is None else load,
        u0=[0.0, 0.0, ROOF],
        name="tower",
    )
    explicit = pm.GeneralizedAlpha(0.8, explicit=True)
    rig = pm.Subdomain([1.0], [400e3], scheme=explicit, substeps=5, name="rig")
    return pm.Coupler([tower, rig], pm.tie("tower", 0, "rig", 0), dt=DT, coupling="macro")


if __name__ == "__main__":
    roof = tower_on_rig(lambda t: 0.0).run(20.0)["tower"].u[:, 2]
    print(f"roof: at most {abs(roof).max():.3f} in 20 s, at the end {roof[-1]:.3f}")
