"""OpenSees with an element elsewhere, or as one, in a process of its own: for test_rig_opensees.py.

frame PORT what integrator algorithm    a plane frame whose column "what" is behind genericClient at
    PORT, or its own for PORT 0; writes displacements of each step to its output
actuator PORT KIND                      a column of the frame behind `actuator` or `adapter`
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "examples"))
import numpy as np
import opensees_model as example

E, A, MOMENT, H = 200e9, 5e-3, 4e-5, 3.0
MASS = [500.0, 500.0, 20.0]  # of the column elsewhere
STIFF = 1e9  # between a command and the column: known exactly, and rounding is small
DT, STEPS = 0.01, 60
INTEGRATORS = {
    "newmark": ("Newmark", 0.5, 0.25),
    "explicit": ("NewmarkExplicit", 0.5),
    "alpha-os": ("AlphaOS", 0.9),
}


def columns():
    """Stiffness of a cantilever column at its top: ux, uy, rz."""
    EI = E * MOMENT
    return np.array(
        [[12 * EI / H**3, 0, 6 * EI / H**2], [0, E * A / H, 0], [6 * EI / H**2, 0, 4 * EI / H]]
    )


def frame(ops, port, kind):
    """Two columns and a beam; a "column" or a "yielding" spring is elsewhere, or its own."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    for node, x, y in ((1, 0.0, 0.0), (2, 5.0, 0.0), (3, 0.0, H), (4, 5.0, H)):
        ops.node(node, x, y)
    ops.fix(1, 1, 1, 1)
    ops.fix(2, 1, 1, 1)
    own = MASS if kind == "column" and not port else [0.0, 0.0, 0.0]
    ops.mass(3, 4e3, 4e3, 200.0)
    ops.mass(4, *(float(x) for x in np.add([4e3, 4e3, 200.0], own)))
    ops.element("elasticBeamColumn", 1, 1, 3, A, E, MOMENT, 1)
    ops.element("elasticBeamColumn", 3, 3, 4, A, E, MOMENT, 1)
    if kind == "column" and not port:
        ops.element("elasticBeamColumn", 2, 2, 4, A, E, MOMENT, 1)
    elif kind == "column":
        dofs = ("-dof", 1, 2, 3)
        ops.element("genericClient", 2, "-node", 4, *dofs, "-server", port, "-noRayleigh")
    elif kind == "yielding" and not port:
        ops.uniaxialMaterial("Steel01", 1, 20e3, 2e6, 0.1)
        ops.node(6, 5.0, H)
        ops.fix(6, 1, 1, 1)
        ops.element("zeroLength", 2, 6, 4, "-mat", 1, "-dir", 1)
    elif kind == "yielding":
        ops.element("genericClient", 2, "-node", 4, "-dof", 1, "-server", port, "-noRayleigh")


def analysis(ops, integrator, algorithm):
    ops.timeSeries("Sine", 1, 0.0, 10.0, 0.3, "-factor", 3.0)
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.test("NormDispIncr", 1e-14, 50)
    ops.algorithm(algorithm)
    ops.integrator(*INTEGRATORS[integrator])
    ops.analysis("Transient")


def run(port, kind, integrator, algorithm):
    ops = example.opensees()
    frame(ops, port, kind)
    analysis(ops, integrator, algorithm)
    for _ in range(STEPS):
        if ops.analyze(1, DT) != 0:
            raise SystemExit("OpenSees did not converge")
        values = [ops.nodeDisp(node, dof) for node in (3, 4) for dof in (1, 2, 3)]
        print(*(float(x).hex() for x in values), flush=True)
    ops.wipe()


def actuator(port, kind):
    """The column, whose top follows the commands, by a stiff spring."""
    ops = example.opensees()
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    ops.node(1, 0.0, 0.0)
    ops.node(2, 0.0, H)
    ops.fix(1, 1, 1, 1)
    ops.element("elasticBeamColumn", 1, 1, 2, A, E, MOMENT, 1)
    if kind == "adapter":
        kb = [STIFF if i == j else 0.0 for i in range(3) for j in range(3)]
        ops.element("adapter", 2, "-node", 2, "-dof", 1, 2, 3, "-stif", *kb, port)
    else:
        ops.node(3, -1.0, H)
        ops.fix(3, 1, 1, 1)
        ops.element("actuator", 2, 3, 2, STIFF, port)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.test("FixedNumIter", 2)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    while ops.analyze(1) == 0:
        pass


if __name__ == "__main__":
    {"frame": lambda p, *x: run(int(p), *x), "actuator": lambda p, k: actuator(int(p), k)}[
        sys.argv[1]
    ](*sys.argv[2:])
