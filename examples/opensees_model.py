"""A frame in OpenSees, served to pmalpha: its matrices, or its lowest storey as a specimen.

Three storeys, one bay; the columns of the lowest storey yield. OpenSees has one model in a process,
so each runs in a process of its own, `with served("upper", "matrices") as model:`. The program that
calls this one is in docs/other-programs.md.

    matrices    a call without arguments returns M, C and K of the free dofs
    specimen    a call (t, u, v) moves the interface to u, and returns the forces that takes
    states      a call (t, u, v, q) returns forces, tangent and state of all dofs for a trial u
"""

import argparse
import ctypes
import os
import pickle
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from pmalpha import InternalForce
from pmalpha.rig.calls import Client, serve, started

# m, N, kg, s; nodes 1 and 2 are fixed, 11 and 12 are in mid-height of the lowest columns
FLOORS = [(3, 4), (5, 6), (7, 8)]
HEIGHT, WIDTH, MASS, INERTIA = 3.0, 5.0, 10e3, 100.0
STEEL = dict(fy=235e6, E=210e9, hardening=0.02)
DEPTH, AREA, MOMENT = 0.2, 7.8e-3, 5.7e-5
DAMPING = (0.2, 0.001)  # of the mass and of the initial stiffness
INTERFACE = [(node, dof) for node in FLOORS[0] for dof in (1, 2, 3)]
INSIDE = [(node, dof) for node in (11, 12) for dof in (1, 2, 3)]
PATIENCE = 3600.0  # seconds for which the model is kept while no call comes


def opensees():
    """The module openseespy.opensees.

    The LAPACK in its wheel for Linux does not find the BLAS beside it, which is loaded first here;
    with a BLAS of the system (apt install libblas3) that is not needed.
    """
    wheel = find_spec("openseespylinux")
    if wheel is not None and wheel.origin is not None:
        blas = Path(wheel.origin).with_name("lib") / "libblas.so.3"
        if blas.exists():
            ctypes.CDLL(str(blas))
    import openseespy.opensees as ops

    return ops


# ---- the model ----------------------------------------------------------------------------------


def build(ops, part):
    """The whole frame, or its "lower" or "upper" part, each with half of the masses between."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    if part != "upper":
        _lowest_storey(ops)
    for storey, nodes in enumerate(FLOORS):
        if part == "lower" and storey > 0:
            continue
        share = 0.5 if storey == 0 and part != "whole" else 1.0
        for column, node in enumerate(nodes):
            ops.node(node, column * WIDTH, (storey + 1) * HEIGHT)
            ops.mass(node, share * MASS, share * MASS, share * INERTIA)
        elastic = (AREA, STEEL["E"], MOMENT, 1)
        if part != "lower":
            ops.element("elasticBeamColumn", 100 + storey, *nodes, *elastic)
        if storey > 0:
            for column, (below, above) in enumerate(zip(FLOORS[storey - 1], nodes)):
                ops.element("elasticBeamColumn", 10 * storey + column, below, above, *elastic)
    if part != "upper":
        _lowest_columns(ops)
    ops.rayleigh(DAMPING[0], 0.0, DAMPING[1], 0.0)


def _lowest_storey(ops):
    for column, (base, middle) in enumerate([(1, 11), (2, 12)]):
        ops.node(base, column * WIDTH, 0.0)
        ops.fix(base, 1, 1, 1)
        ops.node(middle, column * WIDTH, HEIGHT / 2)
        ops.mass(middle, MASS / 20, MASS / 20, INERTIA / 20)


def _lowest_columns(ops):
    """Columns of fibres: two flanges, and a web of ten layers."""
    ops.uniaxialMaterial("Steel01", 1, STEEL["fy"], STEEL["E"], STEEL["hardening"])
    ops.section("Fiber", 1)
    ops.patch("rect", 1, 10, 1, -DEPTH / 2, -0.005, DEPTH / 2, 0.005)
    for side in (-1, 1):
        ops.fiber(side * DEPTH / 2, 0.0, 2.5e-3, 1)
    ops.beamIntegration("Legendre", 1, 1, 3)
    for tag, ends in enumerate([(1, 11), (11, 3), (2, 12), (12, 4)]):
        ops.element("dispBeamColumn", 1000 + tag, *ends, 1, 1)


# ---- its matrices -------------------------------------------------------------------------------


def matrices(ops):
    """M, C and K of the free dofs, (n, n) each: the matrix m M + c C + k K for three choices."""
    ops.wipeAnalysis()
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.algorithm("Linear")
    found = []
    for mck in np.eye(3).tolist():
        ops.integrator("GimmeMCK", *mck, 0.0)
        ops.analysis("Transient")
        ops.analyze(1, 0.0)  # numbers the equations; printA forms the matrix anew
        n = ops.systemSize()
        found.append(np.array(ops.printA("-ret")).reshape(n, n))
    return tuple(found)


# ---- its static response to displacements of some dofs ------------------------------------------


class Static:
    """A model whose `dofs` are moved, while the other dofs are in equilibrium without loads."""

    def __init__(self, ops, build, dofs):
        self.ops, self.build, self.dofs = ops, build, dofs
        self.restart()

    def restart(self):
        """The model as it is built."""
        ops = self.ops
        self.build()
        ops.timeSeries("Constant", 1)
        # Lagrange multipliers also move all dofs, for which "Transformation" has no equation left
        ops.constraints("Lagrange")
        ops.numberer("Plain")
        ops.system("FullGeneral")
        ops.test("EnergyIncr", 1e-18, 50)
        ops.algorithm("Newton")
        ops.integrator("LoadControl", 0.0)
        ops.analysis("Static")

    def move(self, u):
        """Displacements u of the dofs; the state that is reached is the new one."""
        ops = self.ops
        ops.remove("loadPattern", 1)
        ops.pattern("Plain", 1, 1)
        for (node, dof), value in zip(self.dofs, u.tolist()):
            ops.sp(node, dof, value)
        if ops.analyze(1) != 0:
            raise RuntimeError(f"OpenSees found no equilibrium at {u}")

    def force(self):
        """Forces that hold the dofs where they are."""
        self.ops.reactions()
        return np.array([self.ops.nodeReaction(*dof) for dof in self.dofs])

    def tangent(self):
        """Their derivative, with the other dofs eliminated."""
        ops, size = self.ops, self.ops.systemSize()
        A = np.array(ops.printA("-ret")).reshape(size, size)  # has rows of the multipliers too
        row = {
            (node, k + 1): number
            for node in ops.getNodeTags()
            for k, number in enumerate(ops.nodeDOFs(node))
        }
        fixed = {(node, dof) for node in ops.getFixedNodes() for dof in ops.getFixedDOFs(node)}
        c = [row[dof] for dof in self.dofs]
        i = [row[dof] for dof in row if dof not in fixed and dof not in self.dofs]
        inner = np.linalg.solve(A[np.ix_(i, i)], A[np.ix_(i, c)])
        return A[np.ix_(c, c)] - A[np.ix_(c, i)] @ inner

    def specimen(self, t, u, v):
        """What ``restoring`` calls: each command is a step of the loading."""
        self.move(u)
        return self.force()


class States:
    """The same for ``internal``: trial displacements from numbered states, which no trial changes.

    OpenSees can neither undo a converged step nor evaluate elements without one. A trial is
    therefore made in a copy of the process. Its state gets a number, which pmalpha returns as the
    history q when it has accepted the step; only then is the displacement repeated in this process.
    After a return to an earlier state, as by `Coupler.restore`, the model is built anew and its
    displacements are repeated from the start.
    """

    def __init__(self, model):
        self.model, self.present = model, 0
        self.numbers, self.came = {}, {}  # of (state before, u), and back

    def __call__(self, t, u, v, q):
        before = int(q[0])
        self.go(before)
        number = self.numbers.setdefault((before, u.tobytes()), len(self.numbers) + 1)
        self.came[number] = before, u
        return *in_a_copy(self.trial, u), [number]

    def trial(self, u):
        self.model.move(u)
        return self.model.force(), self.model.tangent()

    def go(self, state):
        """Repeat the displacements that lead to a state."""
        ahead, at = [], state
        while at not in (self.present, 0):
            if at not in self.came:
                raise ValueError(f"state {at} is none of this process")
            before, u = self.came[at]
            ahead.append((at, u))
            at = before
        if at != self.present:
            self.model.restart()
            self.present = 0
        for number, u in reversed(ahead):
            self.model.move(u)
            self.present = number


def in_a_copy(function, *arguments):
    """What a function returns in a copy of this process, which ends with it."""
    receiver, sender = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            try:
                result = function(*arguments)
            except Exception as error:
                result = error
            with open(sender, "wb") as pipe:
                pickle.dump(result, pipe)
        finally:
            os._exit(0)  # whatever happens, the copy goes no further
    os.close(sender)
    with open(receiver, "rb") as pipe:
        sent = pipe.read()
    os.waitpid(child, 0)
    if not sent:
        raise RuntimeError("OpenSees has ended the process of a trial")
    result = pickle.loads(sent)
    if isinstance(result, Exception):
        raise result
    return result


# ---- this process, and that which calls it ------------------------------------------------------


@contextmanager
def served(part, what, timeout=60.0):
    """A `pmalpha.rig.Client` of this program, which ends with the block."""
    with (
        started([Path(__file__), part, what], timeout=timeout) as (address, _),
        Client(address, timeout=timeout, name=f"OpenSees, {part} {what}") as client,
    ):
        yield client


def internal(client):
    """The force of a client of `States`, for ``internal`` of a subdomain."""

    def evaluate(t, u, v, q):
        f, K, q1 = client(t, u, v, q)
        return f, K, None, q1

    return InternalForce(evaluate, history=[0.0])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=["whole", "lower", "upper"])
    parser.add_argument("what", choices=["matrices", "specimen", "states"])
    args = parser.parse_args()
    ops = opensees()

    def make():
        build(ops, args.part)

    if args.what == "matrices":
        make()
        serve(lambda: matrices(ops), timeout=PATIENCE)
    elif args.what == "specimen":
        serve(Static(ops, make, INTERFACE).specimen, timeout=PATIENCE)
    else:
        serve(States(Static(ops, make, INTERFACE + INSIDE)), timeout=PATIENCE)


if __name__ == "__main__":
    main()
