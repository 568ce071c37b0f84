"""What test_opensees.py compares with, computed by OpenSees alone, in a process of its own.

transient   a call (integrator, its numbers, algorithm, scale of the record, dt, steps) -> u
eigenvalues a call () -> those of the frame, by the solver of OpenSees
spring      a specimen of one dof, as `Static.specimen` of the example
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
import opensees_model as example

from pmalpha import models
from pmalpha.rig.calls import serve

ALGORITHMS = ("Linear", "Newton")
INTEGRATORS = ("Newmark", "HHT", "GeneralizedAlpha")


def transient(ops, number, numbers, algorithm, scale, dt, steps):
    """Displacements (steps + 1, n) of the whole frame under El Centro, rows as in its matrices."""
    example.build(ops, "whole")
    record, interval = models.el_centro()
    ops.timeSeries("Path", 1, "-dt", interval, "-values", *record.tolist(), "-factor", float(scale))
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.test("EnergyIncr", 1e-18, 50)
    ops.algorithm(ALGORITHMS[int(algorithm)])
    ops.integrator(INTEGRATORS[int(number)], *numbers.tolist())
    ops.analysis("Transient")
    nodes = [node for node in ops.getNodeTags() if node > 2]
    u = np.zeros((int(steps) + 1, 3 * len(nodes)))
    for k in range(int(steps)):
        if ops.analyze(1, float(dt)) != 0:
            raise RuntimeError(f"OpenSees did not converge in step {k + 1}")
        u[k + 1] = [ops.nodeDisp(node, dof) for node in nodes for dof in (1, 2, 3)]
    return u


def eigenvalues(ops):
    example.build(ops, "whole")
    return ops.eigen(6)


def spring(ops, k, fy, hardening):
    """A bilinear spring between the ground and node 2, whose other dof is free."""
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.node(1, 0.0)
    ops.node(2, 0.0)
    ops.fix(1, 1)
    ops.uniaxialMaterial("Steel01", 1, fy, k, hardening)
    ops.element("zeroLength", 1, 1, 2, "-mat", 1, "-dir", 1)


def main(what, *numbers):
    ops = example.opensees()
    if what == "transient":
        serve(lambda *arguments: transient(ops, *arguments), timeout=example.PATIENCE)
    elif what == "eigenvalues":
        serve(lambda: eigenvalues(ops), timeout=example.PATIENCE)
    else:
        values = [float(x) for x in numbers]
        specimen = example.Static(ops, lambda: spring(ops, *values), [(2, 1)]).specimen
        serve(specimen, timeout=example.PATIENCE)


if __name__ == "__main__":
    main(*sys.argv[1:])
