"""Gradients: their time over that of the run itself, and over forward sensitivities.

A frame of 20 storeys on an explicit base (27 dofs, ten substeps, 2000 macro steps) with 20 storey
stiffnesses and 8 accelerometers, and a plate (11 972 dofs, 100 macro steps) with the stiffness of
each of its 5760 elements and 10 accelerometers, under macro coupling. The Jacobian is that of all
accelerometers and stiffnesses.
"""

import numpy as np
from timing import in_turn, run

import pmalpha as pm

DT, STOREYS = 0.01, 20
SENSORS = [1, 4, 7, 10, 13, 16, 18, 20]
DAMPING = 0.002


def spring_chain(stiffnesses):
    """K of springs between n + 1 dofs in a row."""
    n = len(stiffnesses)
    K = np.zeros((n + 1, n + 1))
    for j, k in enumerate(stiffnesses):
        K[j : j + 2, j : j + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return K


def frame(stiffnesses, shaking):
    """A floating shear frame tied to the top of an explicit base; shaking: acceleration by time."""
    K = spring_chain(stiffnesses)
    top = pm.Subdomain(
        np.ones(STOREYS + 1),
        K,
        C=DAMPING * K,
        scheme=pm.GeneralizedAlpha(0.8),
        force=pm.SampledForce(shaking[::10], DT, -np.ones(STOREYS + 1)),
        name="frame",
    )
    below = spring_chain(np.full(6, 2e4))[1:, 1:]
    base = pm.Subdomain(
        np.ones(6),
        below,
        C=1e-4 * below,
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=10,
        force=pm.SampledForce(shaking, DT / 10, -np.ones(6)),
        name="base",
    )
    ties = pm.tie("frame", [0], "base", [5])
    return pm.Coupler([top, base], ties, dt=DT, coupling="macro", threads=1)


def harmonics(steps):
    """A base acceleration of 40 harmonics, at the fine steps, zero at t = 0."""
    rng = np.random.default_rng(0)
    t = DT / 10 * np.arange(10 * steps + 1)
    omega, phase = rng.uniform(1.0, 60.0, 40), rng.uniform(0.0, 6.28, 40)
    return np.sin(np.outer(t, omega) + phase).sum(axis=1) * np.minimum(t, 1.0)


def storeys():
    spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    dofs = np.column_stack([np.arange(STOREYS), np.arange(1, STOREYS + 1)])
    return pm.Parameters("frame", dofs=dofs, K=spring, C=DAMPING * spring)


def plate(nx, ny):
    """An implicit and an explicit part, ten substeps."""
    wall = pm.structures.plate(nx, ny, 1.0, E=1e4, nu=0.3, rho=1.0, mass="lumped")
    parts = np.where(np.arange(nx * ny) < 5 * nx * ny // 6, 0, 1)
    schemes = [pm.GeneralizedAlpha(0.8), pm.GeneralizedAlpha(0.8, explicit=True)]
    foot = wall.dofs(wall.nodes_at(x=0.0))
    pull = np.zeros(wall.n)
    pull[wall.dofs(wall.nodes_at(x=float(nx)), "uy")] = 1.0
    halves = pm.cut(wall, parts, scheme=schemes, fixed=foot, dt=0.08, force=pull)
    return halves, halves.coupler(coupling="macro", threads=1)


def measured(coupler, sensors, steps):
    """A Misfit to nothing of accelerations, whose gradient costs what any other does."""
    data = {
        name: dict(dofs=dofs, a=np.zeros((steps * coupler.subdomains[i].substeps + 1, len(dofs))))
        for i, (name, dofs) in enumerate(sensors.items())
    }
    return pm.Misfit(data)


def row(what, coupler, parameters, sensors, steps, seconds):
    misfit = measured(coupler, sensors, steps)

    def forward():
        coupler.reset()
        coupler.run(steps=steps, record=sensors)

    def gradient():
        coupler.gradient(misfit, steps=steps, parameters=parameters)

    m = sum(p.m for p in parameters)
    few = [pm.Parameters(p.subdomain, dofs=p.dofs[:8], K=p.matrices["K"][:8]) for p in parameters]
    few = few[:1]

    def eight():
        coupler.jacobian({x: y[:1] for x, y in sensors.items()}, steps=steps, parameters=few)

    def whole():
        coupler.jacobian(sensors, steps=steps, parameters=parameters)

    calls = [forward, gradient, eight] + ([whole] if m <= 100 else [])
    times = in_turn(*calls, rounds=3, seconds=seconds)
    return {
        "problem": what,
        "parameters": m,
        "macro steps": steps,
        "run ms": times[0] * 1e3,
        "gradient over run": times[1] / times[0],
        "eight sensitivities over run": times[2] / times[0],
        "parameters at which the gradient is cheaper": 8.0 * times[1] / times[2],
        "jacobian over run": times[3] / times[0] if m <= 100 else "",
    }


def rows(quick):
    steps, size, seconds = (20, (12, 4), 0.0) if quick else (2000, (120, 48), 5.0)
    shaken = frame(np.full(STOREYS, 1600.0), harmonics(steps))
    of_storeys = {"frame": np.array(SENSORS)}
    found = [row("frame, 20 storeys", shaken, [storeys()], of_storeys, steps, seconds)]
    halves, coupler = plate(*size)
    each = halves.parameters(np.arange(np.prod(size)))
    each = [  # each part has those of its own elements
        pm.Parameters(p.subdomain, dofs=p.dofs[len(p.labels) :], K=p.matrices["K"][len(p.labels) :])
        for p in each
    ]
    sensors = {"part 0": np.arange(3, 123, 24), "part 1": np.arange(3, 123, 24)}
    if quick:
        sensors = {name: dofs[:1] for name, dofs in sensors.items()}
    found.append(row("plate", coupler, each, sensors, min(steps, 100), seconds))
    return found


if __name__ == "__main__":
    run("gradients", rows, about=__doc__)
