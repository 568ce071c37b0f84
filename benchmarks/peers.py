"""Other programs, if installed, applied to a chain of unit masses and springs.

Each function takes (n, dt, rho, u0, steps) and returns the seconds per step, averaged over `steps`
steps, and the displacements after `WARM + steps` steps.
"""

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sp

WARM = 20


def exudyn_chain(n, dt, rho, u0, steps):
    """One object with n coordinates; the Jacobian is reused, results are not written."""
    import exudyn
    import exudyn.itemInterface as items

    system = exudyn.SystemContainer()
    mbs = system.AddSystem()
    node = mbs.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[0.0] * n,
            initialCoordinates=list(u0),
            initialCoordinates_t=[0.0] * n,
            numberOfODE2Coordinates=n,
        )
    )
    mass, stiffness = exudyn.MatrixContainer(), exudyn.MatrixContainer()
    ones = np.ones(n)
    mass.SetWithSparseMatrix(sp.csr_matrix(sp.diags_array(ones)), n, n, useDenseMatrix=False)
    K = sp.diags_array([-ones[1:], 2.0 * ones, -ones[1:]], offsets=[-1, 0, 1])
    stiffness.SetWithSparseMatrix(sp.csr_matrix(K), n, n, useDenseMatrix=False)
    mbs.AddObject(
        items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=mass, stiffnessMatrix=stiffness)
    )
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    settings.linearSolverType = exudyn.LinearSolverType.EigenSparse
    settings.solutionSettings.writeSolutionToFile = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = rho
    settings.timeIntegration.verboseMode = 0

    def run(begin, count):
        settings.timeIntegration.startTime = begin * dt
        settings.timeIntegration.endTime = (begin + count) * dt
        settings.timeIntegration.numberOfSteps = count
        mbs.SolveDynamic(settings, storeSolver=False, showHints=False, updateInitialValues=True)

    run(0, WARM)
    begin = time.thread_time()
    run(WARM, steps)
    seconds = time.thread_time() - begin
    return seconds / steps, mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates)


def opensees():
    """The module openseespy.opensees, loaded as the example does."""
    sys.path.append(str(Path(__file__).parent.parent / "examples"))
    from opensees_model import opensees as loaded

    return loaded()


def opensees_chain(n, dt, rho, u0, steps):
    """Truss elements of unit stiffness, fixed at both ends; factored once."""
    ops = opensees()

    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.uniaxialMaterial("Elastic", 1, 1.0)
    for i in range(n + 2):
        ops.node(i, float(i))
    ops.fix(0, 1)
    ops.fix(n + 1, 1)
    for i in range(n + 1):
        ops.element("Truss", i, i, i + 1, 1.0, 1)
    for i in range(n):
        ops.mass(i + 1, 1.0)
        ops.setNodeDisp(i + 1, 1, float(u0[i]), "-commit")
        below, above = (u0[i - 1] if i else 0.0), (u0[i + 1] if i + 1 < n else 0.0)
        ops.setNodeAccel(i + 1, 1, float(below + above - 2.0 * u0[i]), "-commit")
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("ProfileSPD")
    ops.algorithm("Linear", False, False, True)
    am, af = (2.0 - rho) / (1.0 + rho), 1.0 / (1.0 + rho)  # the weights of the new state
    ops.integrator("GeneralizedAlpha", am, af)
    ops.analysis("Transient")
    ops.analyze(WARM, dt)
    begin = time.thread_time()
    ops.analyze(steps, dt)
    seconds = time.thread_time() - begin
    return seconds / steps, np.array([ops.nodeDisp(i + 1, 1) for i in range(n)])


def installed(module):
    """True if the module can be imported."""
    return importlib.util.find_spec(module) is not None


# by name: the module needed, and the function
PEERS = {
    "Exudyn": ("exudyn", exudyn_chain),
    "OpenSees": ("openseespy", opensees_chain),
}
