"""The benchmark of 2020 in the package: numerical part, specimen, and their loop."""

import numpy as np
from rig_reference import CASES, H, Plant, ground, structure

import pmalpha as pm
from pmalpha import rig

SHAKEN, REST = 6.0, 5.0  # seconds of the record that tests take, and of rest before
VALUES, DT = pm.models.el_centro()
GROUND = ground(VALUES, DT, SHAKEN, rest=0.0)
RESTED = ground(VALUES, DT, REST + SHAKEN)


def actuator(plant=None, **options):
    plant = plant or Plant()
    return rig.servo_hydraulic(
        mass=plant.mass,
        stiffness=plant.stiffness,
        damping=plant.damping,
        gain=plant.gain,
        valve=(2.1283e13, plant.b1, plant.b2),
        leakage=plant.leakage,
        **options,
    )


def numerical(case, plant, specimen, a=GROUND):
    """The structure without the specimen, under the load of all of its mass."""
    M, C, K = structure(case)
    one = np.zeros((3, 3))
    one[0, 0] = 1.0
    return pm.Subdomain(
        M - plant.mass * one,
        K - plant.stiffness * one,
        C=C - plant.damping * one,
        scheme=pm.CentralDifference(),
        force=pm.SampledForce(a, H, shape=-M @ np.ones(3)),
        restoring=specimen,
        restoring_stiffness=plant.stiffness * one,
        name="building",
    )


def run(case, specimen, plant=None, a=GROUND):
    """The History of a test of the whole of `a`."""
    building = numerical(case, plant or Plant(), specimen, a)
    return pm.Coupler([building], dt=H).run(steps=len(a) - 1, rig=True)["building"]


def criteria(case, history, a=GROUND, x=None):
    """J1 to J9, (9,), of a true displacement x of the specimen, else of what was measured."""
    from rig_reference import response

    command = history.rig.command[:, 0]
    measured = history.rig.measured[:, 0] if x is None else x
    tests = {"test": (command, measured, history.u)}
    return rig.evaluate(tests, response(case, a), H).J[0]


__all__ = ["CASES", "GROUND", "RESTED", "actuator", "criteria", "numerical", "run"]
