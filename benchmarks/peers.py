"""Other programs, if installed: a chain of unit masses and springs, and two coupled plates.

Each function for the chain takes (n, dt, rho, u0, steps) and returns the seconds per step, averaged
over `steps` steps, and the displacements after `WARM + steps` steps. PETSc and Kratos run in
processes of their own, from the sources in `programs`.
"""

import functools
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

WARM = 20
HERE = Path(__file__).parent
# The interpreter that has Kratos, whose wheels exist for a few versions of Python only.
KRATOS_PYTHON = os.environ.get("KRATOS_PYTHON", sys.executable)


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
    sys.path.append(str(HERE.parent / "examples"))
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


def result(command, given):
    """The JSON object that a program writes in a line of its own, run with one thread."""
    run = subprocess.run(
        command,
        input=given,
        capture_output=True,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    if run.returncode:
        raise RuntimeError(f"{command[0]} failed: {run.stdout[-2000:]}{run.stderr[-2000:]}")
    return json.loads(next(x for x in run.stdout.splitlines() if x.startswith("{")))


def petsc_config(*words):
    """What pkg-config reports of PETSc, or None without PETSc."""
    if shutil.which("pkg-config") is None:
        return None
    run = subprocess.run(["pkg-config", *words, "PETSc"], capture_output=True, text=True)
    return None if run.returncode else run.stdout.split()


@functools.cache
def petsc_program():
    """Path of the compiled program, in the folder of builds."""
    program = HERE.parent / "build" / "petsc_chain"
    program.parent.mkdir(exist_ok=True)
    compiler = petsc_config("--variable=ccompiler")
    source = HERE / "programs" / "petsc_chain.c"
    flags = petsc_config("--cflags", "--libs")
    subprocess.run([*compiler, "-O2", "-o", program, source, *flags], check=True)
    return program


def petsc_chain(n, dt, rho, u0, steps):
    """TSALPHA2 with a sparse Cholesky factor that is kept."""
    command = [petsc_program(), *map(str, (n, dt, rho, WARM, steps))]
    found = result(command, " ".join(repr(float(x)) for x in u0))
    return found["seconds"], np.array(found["u"])


def kratos_plates(**given):
    """Least seconds of a macro step of the two plates, and the displacements of B."""
    found = result([KRATOS_PYTHON, HERE / "programs" / "kratos_plates.py"], json.dumps(given))
    return found["seconds"], np.array(found["u"])


def installed(module, python=sys.executable):
    """True if this interpreter, or another one, finds the module."""
    code = f"import sys, importlib.util as u; sys.exit(u.find_spec({module!r}) is None)"
    return subprocess.run([python, "-c", code]).returncode == 0


class Peer(NamedTuple):
    """Another program for the chain."""

    installed: Callable
    chain: Callable
    largest: int = 1000  # number of dofs; with more it takes minutes
    tolerance: float = 1e-3  # of displacements; terms of third order differ


PEERS = {
    "Exudyn": Peer(lambda: installed("exudyn"), exudyn_chain),
    "OpenSees": Peer(lambda: installed("openseespy"), opensees_chain),
    # PETSc 3.18 begins with twice the initial acceleration, which leaves an error of order dt^2
    "PETSc": Peer(lambda: petsc_config("--exists") is not None, petsc_chain, 100_000, 1e-2),
}
