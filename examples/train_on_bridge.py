"""A vehicle of two axles crosses a bridge of two spans, whose pier takes shorter steps.

``python examples/train_on_bridge.py`` prints the deflection and the forces of the wheels.
"""

import numpy as np
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures

BODY, WHEEL = 12e3, 1.5e3  # kg at each axle
SPRING, DAMPER, CONTACT = 2e6, 4e4, 5e7  # N/m, N s/m: above and under the wheels
GRAVITY, DISTANCE = 9.81, 8.0  # m/s2; m between the axles
SCHEME = pm.GeneralizedAlpha(0.8)

# Roads before and after it are members that supports hold, so that axles never fall; the joint is
# 0.1 m long, without stiffness.
x = [-20.0, -0.1, 0.0, 20.0, 40.0, 40.1, 60.0]
road = np.array([True, True, False, False, True, True])
bridge = structures.beam_frame(
    np.column_stack([x, np.zeros(7)]),
    [[i, i + 1] for i in range(6)],
    EA=2e10,
    EI=np.where(road, 1.0, 6e9),
    rhoA=np.where(road, 1e-3, 9e3),
    divisions=np.where(road, 1, 10),
)
deck = bridge.nodes_at(y=0.0)
held = np.concatenate([bridge.dofs([0, 1, 5, 6]), bridge.dofs([2, 4], "uy"), bridge.dofs(2, "ux")])


def train_on_bridge(speed, dt=0.0005):
    """The coupler, and the points under the wheels; each axle is a body on a wheel."""
    span = bridge.subdomain(scheme=SCHEME, fixed=held)
    # the path begins at x = -20: the first axle starts at x = -5
    points = [bridge.moving_point(deck, speed, 15.0 - s, fixed=held) for s in (0.0, DISTANCE)]
    suspension = np.kron(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]])
    weight = np.tile([BODY, WHEEL], 2) * GRAVITY
    sag = -(BODY + WHEEL) * GRAVITY / CONTACT
    train = pm.Subdomain(
        sp.block_diag([span.M, np.diag(weight / GRAVITY)]),
        sp.block_diag([span.K, SPRING * suspension]),
        C=sp.block_diag([0.0 * span.K, DAMPER * suspension]),
        scheme=SCHEME,
        restoring=[pm.Gap([(p, f"wheel {i}")], CONTACT, 0.0) for i, p in enumerate(points)],
        force=np.concatenate([np.zeros(span.n), -weight]),
        u0=np.concatenate([np.zeros(span.n), np.tile([sag - BODY * GRAVITY / SPRING, sag], 2)]),
        dof_names=[*span.dof_names, "body 0", "wheel 0", "body 1", "wheel 1"],
        name="train",
    )
    pier = structures.rod(6, 8.0, EA=4e9, rhoA=6e3).subdomain(
        scheme=SCHEME, fixed=["ux 0"], substeps=5, name="pier"
    )
    tie = pm.tie(train, ["uy 3"], pier, ["ux 6"])
    return pm.Coupler([train, pier], tie, dt=dt, coupling="gc"), points


def crossing(speed, dt=0.0005):
    """Deflection of the first span in its middle, and the forces of both wheels."""
    coupler, points = train_on_bridge(speed, dt)
    steps = int(round(45.0 / speed / dt))
    train = coupler.run(steps=steps)["train"]
    middle = bridge.nodes_at(x=10.0)[0]
    forces = [
        CONTACT * np.maximum(p.displacement(train) - train[f"wheel {i}"].u, 0.0)
        for i, p in enumerate(points)
    ]
    return train[f"uy {middle}"].u, np.array(forces)


if __name__ == "__main__":
    for speed in (20.0, 40.0, 80.0):
        deflection, forces = crossing(speed)
        share = forces / ((BODY + WHEEL) * GRAVITY)
        print(
            f"{speed:g} m/s: deflection {-1e3 * deflection.min():.2f} mm, wheels "
            f"{share.min():.2f} to {share.max():.2f} of their weight"
        )
