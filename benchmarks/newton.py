"""Iterations of internal forces: the core's share of them, and frames against other programs.

A block of hexahedra: an iteration over what it cannot do without, that is one evaluation of force
and tangent, one factorization and one sweep pair (a step of the linear block, with its products);
and ``tangent="reuse"`` over a new tangent in each iteration.

Two plastic frames of 200 dofs under an earthquake: shear storeys, and storeys of columns and beams
with hinges at the ends of the beams. They are compared with OpenSees, if it is installed, and with
a SciPy loop of Newton's method for the trapezoidal rule: NumPy for the springs, LAPACK for the
banded tangent. All displacements are compared at the end.
"""

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp
from peers import installed, opensees
from scipy.linalg import cython_blas
from scipy.linalg.lapack import dpbsv
from timing import in_turn, run

import pmalpha as pm
from pmalpha import _core, models, structures
from pmalpha.problem.forms import Numeric
from pmalpha.problem.matrices import core_sparse
from pmalpha.setup.factors import GROWTH, LOST
from pmalpha.setup.internal_forces import tangent_pattern

DAMPING = 0.1  # C = DAMPING M of the frames
SAMPLE = 0.02  # of the record of El Centro
DT = 0.005
ITERATIONS = 40
CLOCK = time.thread_time
TOLERANCE = 1e-8  # of all programs, relative to the motion


def row(problem, dofs, what, seconds, other, other_seconds, iterations, difference=""):
    return {
        "problem": problem,
        "dofs": dofs,
        "what": what,
        "iterations a step": iterations,
        "us": 1e6 * seconds,
        "compared with": other,
        "us of that": 1e6 * other_seconds,
        "that over this": other_seconds / seconds,
        "difference": difference,
    }


# ---- a block of hexahedra ----------------------------------------------------------------------


def block(counts):
    """A block of rubber that is stretched and sheared, as a structure and its subdomain."""
    structure = structures.nonlinear_solid(*counts, 1.0, structures.NeoHookean(210.0, 0.3), rho=1.0)
    v0 = np.zeros((len(structure.points), 3))
    v0[:, :2] = np.outer(structure.points[:, 0], [0.1, 0.2])
    scheme = pm.GeneralizedAlpha(0.8)
    return structure, structure.subdomain(scheme=scheme, v0=v0.ravel(), name="block")


def stepped(subdomain, steps, **newton):
    """A call that makes these steps from the initial values, and the iterations of one of them."""
    coupler = pm.Coupler([subdomain], dt=0.02, threads=1, newton=pm.Newton(**newton))
    iterations = float(np.mean(coupler.run(steps=steps)["block"].iterations[1:]))

    def call():
        coupler.reset()
        coupler.step(steps)

    return call, iterations


def once_from_rest(subdomain):
    """Only the reset, whose time is to be subtracted."""
    coupler = pm.Coupler([subdomain], dt=0.02, threads=1)
    return coupler.reset


def parts_of_iteration(structure, subdomain):
    """Calls of the evaluation, of the factorization and of a linear step."""
    (force,) = structure.internal
    K = sp.csr_array(force(subdomain.u0)[1])
    symbolic = tangent_pattern(K, np.zeros(0, int))
    first, _, _, start, _ = panels = symbolic.structure
    al1, _ = subdomain.scheme.coefficients(0.02)
    A = sp.csr_array((structure.M + al1 * K)[symbolic.order][:, symbolic.order])
    A.sort_indices()
    values, inverse = np.empty(start[-1]), np.empty(first[-1])
    blas = [cython_blas.__pyx_capi__[name] for name in ("dgemm", "dtrsm")]
    linear = pm.Subdomain(
        structure.M, K, scheme=subdomain.scheme, v0=subdomain.v0, name="linear block"
    )
    coupler = pm.Coupler([linear], dt=0.02, threads=1)
    entries = core_sparse(A)
    pattern = Numeric(entries.ptr, entries.indices, panels, *blas, unsymmetric=False)
    return (
        partial(force, subdomain.u0),
        partial(_core.factor_panels, pattern, entries.values, values, inverse, LOST, GROWTH, 1),
        coupler.step,
    )


def block_rows(counts, steps, rounds):
    structure, subdomain = block(counts)
    full, iterations = stepped(subdomain, steps)
    reuse, more = stepped(subdomain, steps, tangent="reuse")
    reset = once_from_rest(subdomain)
    calls = [full, reuse, reset, *parts_of_iteration(structure, subdomain)]
    with_full, with_reuse, without, *parts = in_turn(*calls, rounds=rounds)
    with_full, with_reuse = (x - without for x in (with_full, with_reuse))
    name = f"hex8 block {'x'.join(map(str, counts))}"
    n, one = structure.n, with_full / steps / iterations
    shares = ", ".join(f"{1e3 * x:.3g}" for x in parts)
    print(f"{name}: evaluation, factor, linear step: {shares} ms")
    return [
        row(name, n, "an iteration", one, "evaluation + factor + sweeps", sum(parts), iterations),
        row(
            name,
            n,
            'a step, tangent="reuse"',
            with_reuse / steps,
            'tangent="full"',
            with_full / steps,
            more,
        ),
    ]


# ---- plastic frames ----------------------------------------------------------------------------


@dataclass
class Frame:
    """Masses, elastic stiffness, and bilinear springs between pairs of dofs, -1: the ground."""

    name: str
    M: np.ndarray
    K: sp.csr_array
    pairs: np.ndarray
    k: np.ndarray
    fy: np.ndarray
    hardening: float
    direction: np.ndarray  # displacements of the dofs for one of the ground
    acceleration: np.ndarray

    def subdomain(self):
        return pm.Subdomain(
            self.M,
            self.K if self.K.nnz else None,
            C=DAMPING * self.M,
            scheme=pm.Newmark(),
            internal=pm.Bilinear(self.pairs, self.k, self.fy, self.hardening),
            force=pm.BaseAcceleration(self.acceleration, self.direction, self.M, dt=SAMPLE),
            name="frame",
        )


def record(factor):
    """The ground motion in m/s^2, from 0 on."""
    return np.concatenate([[0.0], factor * 9.81 * models.el_centro().values])


def shear_frame(n):
    """Storeys of one dof, each with a spring."""
    storey = np.arange(n)
    return Frame(
        "shear frame",
        M=np.ones(n),
        K=sp.csr_array((n, n)),
        pairs=np.column_stack([storey - 1, storey]),
        k=np.full(n, 4e4),
        fy=2.0 + 2.0 * np.sqrt(n - storey),
        hardening=0.02,
        direction=np.ones(n),
        acceleration=record(1.0),
    )


STOREY, BAY = 3.5, 6.0
COLUMN, BEAM = {"EA": 4e9, "EI": 4e8}, {"EA": 3e9, "EI": 2e8}
MASSES = {"joint": (2e4, 2e4, 2e3), "hinge": 1e3}
FLOOR = 8  # ux, uy, rz of the left joint, two hinges, ux, uy, rz of the right joint
HINGE = {"k": 1e8, "fy": 4e5, "hardening": 0.05}


def dofs_of(floor, side):
    """ux, uy, rz of a joint; of the ground, floor 0, -1."""
    if floor == 0:
        return np.full(3, -1)
    return FLOOR * (floor - 1) + (5 * side) + np.arange(3)


def hinges_of(floor):
    """Rotation of the ends of the beam."""
    return FLOOR * (floor - 1) + np.array([3, 4])


def stiffness_of_line(L, c, s, *, EA, EI):
    """A beam with two nodes in the direction (c, s)."""
    a, b = EA / L, EI / L**3
    own = np.zeros((6, 6))
    own[np.ix_([0, 3], [0, 3])] = a * np.array([[1.0, -1.0], [-1.0, 1.0]])
    bent = np.array([1.0, L / 2, -1.0, L / 2])
    turned = np.array([0.0, 1.0, 0.0, -1.0])
    own[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = b * (
        12.0 * np.outer(bent, bent) + L * L * np.outer(turned, turned)
    )
    T = np.kron(np.eye(2), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    return T.T @ own @ T


def plane_frame(floors):
    """Columns and beams of one bay, with a plastic hinge at both ends of each beam."""
    n = FLOOR * floors
    K = sp.lil_array((n, n))
    column = stiffness_of_line(STOREY, 0.0, 1.0, **COLUMN)
    beam = stiffness_of_line(BAY, 1.0, 0.0, **BEAM)
    M, direction, pairs = np.zeros(n), np.zeros(n), []
    for floor in range(1, floors + 1):
        left, right, hinges = dofs_of(floor, 0), dofs_of(floor, 1), hinges_of(floor)
        M[left] = M[right] = MASSES["joint"]
        M[hinges] = MASSES["hinge"]
        direction[[left[0], right[0]]] = 1.0
        pairs += [(left[2], hinges[0]), (right[2], hinges[1])]
        lines = [(beam, [*left[:2], hinges[0], *right[:2], hinges[1]])]
        lines += [(column, [*dofs_of(floor - 1, i), *dofs_of(floor, i)]) for i in (0, 1)]
        for k, dofs in lines:
            free = np.flatnonzero(np.array(dofs) >= 0)
            at = np.array(dofs)[free]
            K[np.ix_(at, at)] += k[np.ix_(free, free)]
    count = len(pairs)
    return Frame(
        "plane frame with hinges",
        M=M,
        K=sp.csr_array(K),
        pairs=np.array(pairs),
        k=np.full(count, HINGE["k"]),
        fy=np.full(count, HINGE["fy"]),
        hardening=HINGE["hardening"],
        direction=direction,
        acceleration=record(1.0),
    )


class Loop:
    """Newton's method for the trapezoidal rule, with the tangent as a band for LAPACK."""

    def __init__(self, frame):
        self.frame, n = frame, frame.M.size
        self.first, self.second = frame.pairs.T
        both = self.first >= 0
        K = sp.coo_array(frame.K)
        rows = np.concatenate([K.row, self.second[both], self.first[both]])
        columns = np.concatenate([K.col, self.first[both], self.second[both]])
        self.width = int(np.max(np.abs(rows - columns)))
        # Mbar = M + al2 C + al1 K, its lower triangle by diagonals
        self.al1, self.al2 = DT * DT / 4.0, DT / 2.0
        self.base = np.zeros((self.width + 1, n))
        self.base[0] = frame.M * (1.0 + self.al2 * DAMPING)
        lower = K.row >= K.col
        where = (K.row - K.col)[lower], K.col[lower]
        np.add.at(self.base, where, self.al1 * K.data[lower])
        # where the springs are in it, as positions of the flat array
        lesser = np.minimum(self.first, self.second)[both]
        apart = np.abs(self.first - self.second)[both]
        self.both, self.off = both, apart * n + lesser
        self.u, self.v, self.w, self.p = np.zeros(n), np.zeros(n), np.zeros(n), 0.0 * frame.k
        # B^T: the forces of the springs on the dofs; B: their deformations
        springs = np.arange(frame.k.size)
        self.B = sp.csr_array(
            (
                np.concatenate([np.ones(springs.size), -np.ones(both.sum())]),
                (
                    np.concatenate([springs, springs[both]]),
                    np.concatenate([self.second, self.first[both]]),
                ),
            ),
            shape=(springs.size, n),
        )
        self.BT = sp.csr_array(self.B.T)
        self.dy = frame.fy / frame.k
        self.count, self.done, self.scale = 0, 0, 0.0

    def springs(self, u):
        """Forces, tangents and plastic deformations of the springs."""
        f = self.frame
        d = self.B @ u
        elastic = d - self.p
        p = np.where(
            elastic > self.dy, d - self.dy, np.where(elastic < -self.dy, d + self.dy, self.p)
        )
        hard, soft = f.hardening * f.k, (1.0 - f.hardening) * f.k
        k = hard + np.where(np.abs(elastic) > self.dy, 0.0, soft)
        return hard * d + soft * (d - p), k, p

    def tangent(self, k):
        A = self.base.copy()
        flat = A.ravel()
        k = self.al1 * k
        A[0] += np.bincount(self.second, k, A.shape[1])
        A[0] += np.bincount(self.first[self.both], k[self.both], A.shape[1])
        flat[self.off] -= k[self.both]
        return A

    def step(self, steps):
        f = self.frame
        samples = SAMPLE * np.arange(f.acceleration.size)
        load, al1, al2 = -f.M * f.direction, self.al1, self.al2
        elastic = f.K.nnz > 0
        for _ in range(steps):
            self.done += 1
            ground = np.interp(self.done * DT, samples, f.acceleration)
            F = load * ground
            ut = self.u + DT * self.v + al1 * self.w
            vt = self.v + al2 * self.w
            w = -self.w  # the velocity of the first guess is the present one
            for _ in range(ITERATIONS):
                u = ut + al1 * w
                force, k, p = self.springs(u)
                R = F - f.M * (w + DAMPING * (vt + al2 * w)) - self.BT @ force
                if elastic:
                    R -= f.K @ u
                _, dw, info = dpbsv(self.tangent(k), R, lower=1, overwrite_ab=1)
                assert info == 0
                w += dw
                self.count += 1
                du = ut + al1 * w - self.u
                self.scale = max(self.scale, f.M @ (du * du))
                if al1 * al1 * (f.M @ (dw * dw)) <= TOLERANCE**2 * self.scale:
                    break
            else:
                raise RuntimeError(f"no convergence in step {self.done}: it has no line search")
            self.u, self.v, self.w = ut + al1 * w, vt + al2 * w, w
            self.p = self.springs(self.u)[2]


# ---- the same by OpenSees ----------------------------------------------------------------------


def opensees_analysis(frame, handler, energy):
    """Load, damping and solution of a model whose nodes and elements are made."""
    ops = opensees()

    ops.timeSeries("Path", 1, "-dt", SAMPLE, "-values", *frame.acceleration.tolist())
    ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
    ops.rayleigh(DAMPING, 0.0, 0.0, 0.0)
    ops.constraints(handler)
    ops.numberer("RCM")
    ops.system("ProfileSPD")
    ops.test("EnergyIncr", energy, ITERATIONS)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def opensees_shear_frame(frame, energy):
    """zeroLength elements in a row; the function that gives the displacements."""
    ops = opensees()

    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    n = frame.M.size
    for i in range(n + 1):
        ops.node(i, 0.0)
    ops.fix(0, 1)
    for i in range(n):
        ops.mass(i + 1, float(frame.M[i]))
        ops.uniaxialMaterial(
            "Steel01", i + 1, float(frame.fy[i]), float(frame.k[i]), frame.hardening
        )
        ops.element("zeroLength", i + 1, i, i + 1, "-mat", i + 1, "-dir", 1)
    opensees_analysis(frame, "Plain", energy)
    return lambda: np.array([ops.nodeDisp(i + 1, 1) for i in range(n)])


def opensees_plane_frame(frame, energy):
    """Elastic beams and columns; a zeroLength element and tied displacements at each beam end."""
    ops = opensees()

    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.geomTransf("Linear", 1)
    ops.uniaxialMaterial("Steel01", 1, HINGE["fy"], HINGE["k"], HINGE["hardening"])
    floors = frame.M.size // FLOOR
    tags = iter(range(1, 10 * (floors + 1)))
    for floor in range(floors + 1):
        for side in (0, 1):
            joint = 10 * floor + side
            ops.node(joint, side * BAY, floor * STOREY)
            if floor == 0:
                ops.fix(joint, 1, 1, 1)
                continue
            ops.node(joint + 2, side * BAY, floor * STOREY)
            ops.mass(joint, *MASSES["joint"])
            ops.mass(joint + 2, 0.0, 0.0, MASSES["hinge"])
            ops.equalDOF(joint, joint + 2, 1, 2)
            ops.element("zeroLength", next(tags), joint, joint + 2, "-mat", 1, "-dir", 6)
            line = COLUMN["EA"], 1.0, COLUMN["EI"], 1
            ops.element("elasticBeamColumn", next(tags), joint - 10, joint, *line)
        if floor > 0:
            line = BEAM["EA"], 1.0, BEAM["EI"], 1
            ops.element("elasticBeamColumn", next(tags), 10 * floor + 2, 10 * floor + 3, *line)
    opensees_analysis(frame, "Transformation", energy)

    def displacements():
        u = []
        for floor in range(1, floors + 1):
            left, right = ([ops.nodeDisp(10 * floor + i, k) for k in (1, 2, 3)] for i in (0, 1))
            u += [*left, ops.nodeDisp(10 * floor + 2, 3), ops.nodeDisp(10 * floor + 3, 3), *right]
        return np.array(u)

    return displacements


def opensees_rows(frame, make, energy, ours, u, steps, iterations):
    ops = opensees()

    seconds = float("inf")
    for _ in range(3):
        displacements = make(frame, energy)
        begin = CLOCK()
        assert ops.analyze(steps, DT) == 0
        seconds = min(seconds, (CLOCK() - begin) / steps)
    n = frame.M.size
    return [
        row(
            frame.name,
            n,
            "a step",
            ours,
            "OpenSees",
            seconds,
            iterations,
            difference(displacements(), u),
        )
    ]


def difference(theirs, ours):
    return float(np.max(np.abs(theirs - ours)) / np.max(np.abs(ours)))


def frame_rows(frame, opensees, steps, rounds):
    """Ours against the loop, and against OpenSees where it is installed."""
    subdomain = frame.subdomain()
    coupler = pm.Coupler([subdomain], dt=DT, threads=1)
    history = coupler.run(steps=steps)["frame"]
    u, iterations = history.u[-1], float(np.mean(history.iterations[1:]))
    loop = Loop(frame)
    loop.step(steps)
    yielding = np.count_nonzero(loop.p)
    print(
        f"{frame.name}: {yielding} of {loop.p.size} springs have yielded, "
        f"{loop.count / steps:.3g} iterations a step of the loop, largest u {np.max(np.abs(u)):.3g}"
    )
    both = [lambda: (coupler.reset(), coupler.step(steps)), coupler.reset]
    ours, reset, theirs = in_turn(*both, lambda: Loop(frame).step(steps), rounds=rounds)
    ours = (ours - reset) / steps
    n = frame.M.size
    found = [
        row(
            frame.name,
            n,
            "a step",
            ours,
            "SciPy loop",
            theirs / steps,
            iterations,
            difference(loop.u, u),
        )
    ]
    if opensees is not None:
        energy = 0.5 * TOLERANCE**2 * loop.scale / loop.al1  # the criterion of the loop
        found += opensees_rows(frame, opensees, energy, ours, u, steps, iterations)
    return found


def rows(quick):
    has_opensees = installed("openseespy")
    if not has_opensees:
        print("OpenSees is not installed: left out")
    storeys, floors, steps = (5, 2, 100) if quick else (200, 25, 1500)
    found = []
    for counts in ((2, 2, 2),) if quick else ((9, 4, 3), (25, 20, 20)):
        found += block_rows(counts, steps=2 if quick else 5, rounds=1 if quick else 2)
    peers = (opensees_shear_frame, opensees_plane_frame) if has_opensees else (None, None)
    for frame, peer in zip((shear_frame(storeys), plane_frame(floors)), peers):
        found += frame_rows(frame, peer, steps, rounds=1 if quick else 5)
    return found


if __name__ == "__main__":
    run("newton", rows, about=__doc__)
