"""Restoring forces that count: open loops, evaluations of filters and of linear systems."""

import numpy as np

import pmalpha as pm


def lagging(**options):
    """An actuator that follows at a rate, and a spring behind it."""
    one = np.eye(1)
    return pm.rig.LinearActuator(-50.0 * one, 50.0 * one, one, 30.0 * one, dofs=[0], **options)


def yielding():
    return pm.RambergOsgood([0], 10.0, 1.0, 5.0)


# How each is made, and how many counts there are in what it remembers.
COUNTING = {
    "a spring": (lambda: [pm.CubicSpring([0], 2.0, 3.0), yielding()], 1),
    "an actuator": (
        lambda: pm.rig.SimulatedActuator(yielding(), delay=0.03, noise=1e-4, seed=1),
        2,
    ),
    "a linear actuator": (lambda: lagging(delay=0.03, noise=1e-4, seed=1), 1),
    "a compensator": (lambda: pm.rig.Compensated(lagging(), 0.03), 2),
    "one that adapts": (lambda: pm.rig.Compensated(lagging(), 0.03, method="adaptive"), 2),
    "two rigs and a spring": (lambda: [lagging(), yielding(), lagging(delay=0.02)], 3),
}


def counting(restoring):
    """Two masses, the first on such a force."""
    a = pm.Subdomain(
        np.ones(2),
        np.eye(2) * 5,
        scheme=pm.Newmark(),
        restoring=restoring(),
        u0=[1.0, 0.0],
        name="a",
    )
    return pm.Coupler([a], dt=0.01)
