"""Two plates coupled by GC, against the same scheme as a loop in SciPy, and Kratos.

A is implicit (trapezoidal, dt = 0.1) and clamped at its left edge, B explicit (central difference,
dt = 0.01, lumped mass) under a line load along its lower edge. The loop is a typical hand-written
program: one factorization with SuperLU, a dense Cholesky factor of the interface matrix, and one
solve or one product for the link problem of A, whichever is faster. The columns of Kratos are empty
if it is not installed.
"""

import time

import numpy as np
import scipy.sparse as sp
from peers import KRATOS_PYTHON, installed, kratos_plates
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import splu
from timing import in_turn, once, run

import pmalpha as pm

MESHES = [(49, 9), (249, 9), (999, 9), (49, 49), (99, 99)]
DT, SS, H = 0.1, 10, 0.1
MATERIAL = {"E": 1000.0, "nu": 0.3, "rho": 100.0}
# Consecutive steps per measurement, so that the caches are warm.
STEPS = 10
# Steps after which the two results are compared, enough for rounding errors to grow.
COMPARED = 20


def problem(nx, ny):
    """Matrices, load and the tied dofs of the two plates."""
    left = pm.structures.plate(nx, ny, H, **MATERIAL)
    right = pm.structures.plate(nx, ny, H, **MATERIAL, mass="lumped", origin=(nx * H, 0.0))
    free = np.setdiff1d(np.arange(left.n), left.dofs(left.nodes_at(x=0.0)))
    lower = right.nodes_at(y=0.0)
    load = np.zeros(right.n)
    for component in ("ux", "uy"):
        load[right.dofs(lower, component)] = H / np.sqrt(2.0)
        load[right.dofs(lower[[0, -1]], component)] /= 2.0
    face = np.searchsorted(free, left.dofs(left.nodes_at(x=nx * H)))
    return {
        "M_A": sp.csr_array(left.M[free][:, free]),
        "K_A": sp.csr_array(left.K[free][:, free]),
        "M_B": right.M.diagonal(),
        "K_B": sp.csr_array(right.K),
        "F_B": load,
        "face_A": face,
        "face_B": right.dofs(right.nodes_at(x=nx * H)),
    }


def coupled(q, threads=1):
    """The same problem in pmalpha."""
    a = pm.Subdomain(q["M_A"], q["K_A"], scheme=pm.Newmark(), name="A")
    b = pm.Subdomain(
        q["M_B"],
        q["K_B"],
        scheme=pm.CentralDifference(),
        substeps=SS,
        force=q["F_B"],
        name="B",
    )
    tie = pm.tie(a, q["face_A"], b, q["face_B"])
    return pm.Coupler([a, b], tie, dt=DT, coupling="gc", threads=threads)


def solver(A):
    """SuperLU with the options for a symmetric positive definite matrix."""
    return splu(
        sp.csc_array(A),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options=dict(SymmetricMode=True),
    )


class Loop:
    """GC with the trapezoidal rule and central difference, in NumPy and SciPy.

    With `late` the variant of Kratos: the initial accelerations of A are zero, and B is tied to A
    at a time level one substep before that of A.
    """

    def __init__(self, q, late=False):
        self.late = late
        self.q, (n, m), p = q, (q["M_A"].shape[0], q["M_B"].size), q["face_A"].size
        self.h = DT / SS
        self.lu = solver(q["M_A"] + DT**2 / 4.0 * q["K_A"])
        self.inverse = 1.0 / q["M_B"]
        unit = np.zeros((n, p))
        unit[q["face_A"], np.arange(p)] = 1.0
        self.response = self.lu.solve(unit)  # Mbar^-1 L^T
        H = DT / 2.0 * self.response[q["face_A"]]
        H[np.diag_indices(p)] += self.h / 2.0 * self.inverse[q["face_B"]]
        self.H = cho_factor(0.5 * (H + H.T))
        self.by_product = False
        self._start(n, m, p)

    def _start(self, n, m, p):
        """At rest; accelerations of the tied plates, M w = F + L^T Lam."""
        q = self.q
        mass, unit = solver(q["M_A"]), np.zeros((n, p))
        unit[q["face_A"], np.arange(p)] = 1.0
        of_unit = mass.solve(unit)
        H = of_unit[q["face_A"]] + np.diag(self.inverse[q["face_B"]])
        lam = np.linalg.solve(H, (self.inverse * q["F_B"])[q["face_B"]])
        self.u_a, self.v_a, self.w_a = np.zeros(n), np.zeros(n), of_unit @ lam
        self.u_b, self.v_b = np.zeros(m), np.zeros(m)
        load = q["F_B"].copy()
        load[q["face_B"]] -= lam
        self.w_b = self.inverse * load
        # the free velocity at t = 0, (S2)
        self.vf = -DT / 2.0 * (self.response[q["face_A"]] @ lam)
        if self.late:
            self.w_a[:] = self.vf[:] = 0.0
            self.v_b = -self.h / 2.0 * self.inverse * q["F_B"]  # 0 when the first substep begins

    def link(self, lam):
        """Mbar^-1 L^T Lam"""
        if self.by_product:
            return self.response @ lam
        load = np.zeros(self.u_a.size)
        load[self.q["face_A"]] = lam
        return self.lu.solve(load)

    def predict(self):
        """u and v of B at the next fine time level."""
        self.u_b += self.h * self.v_b + self.h**2 / 2.0 * self.w_b
        self.v_b += self.h / 2.0 * self.w_b

    def step(self, count=1):
        """Macro steps."""
        q, h, face_a, face_b = self.q, self.h, self.q["face_A"], self.q["face_B"]
        for _ in range(count):
            u = self.u_a + DT * self.v_a + DT**2 / 4.0 * self.w_a
            v = self.v_a + DT / 2.0 * self.w_a
            w = -self.lu.solve(q["K_A"] @ u)
            vf = v[face_a] + DT / 2.0 * w[face_a]
            for j in range(1, SS + 1):
                if not self.late:
                    self.predict()
                self.w_b = self.inverse * (q["F_B"] - q["K_B"] @ self.u_b)
                self.v_b += h / 2.0 * self.w_b
                between = self.vf + j / SS * (vf - self.vf)
                lam = cho_solve(self.H, self.v_b[face_b] - between, check_finite=False)
                added = self.inverse[face_b] * lam
                self.w_b[face_b] -= added
                self.v_b[face_b] -= h / 2.0 * added
                if self.late:
                    self.predict()
            self.vf = vf
            self.w_a = w + self.link(lam)
            self.u_a = u + DT**2 / 4.0 * self.w_a
            self.v_a = v + DT / 2.0 * self.w_a


def difference(coupler, loop):
    """Largest difference of the displacements of B, over the largest displacement."""
    coupler.reset()
    coupler.step(COMPARED)
    loop.step(COMPARED)
    return float(np.max(np.abs(coupler.state("B").u - loop.u_b)) / np.max(np.abs(loop.u_b)))


def kratos(nx, ny, q, u, ours, seconds):
    """Cells of Kratos, empty if it is not installed; u are our displacements of B."""
    step, over, differ = "Kratos ms", "Kratos over ours", "difference of Kratos"
    if not installed("KratosMultiphysics", KRATOS_PYTHON):
        return {step: "", over: "", differ: ""}
    given = {"nx": nx, "ny": ny, "h": H, "dt": DT, "substeps": SS, **MATERIAL}
    given |= {"steps": COMPARED, "seconds": seconds / 3.0}
    theirs, v = min((kratos_plates(**given) for _ in range(3)), key=lambda run: run[0])
    largest = np.max(np.abs(u))
    late = Loop(q, late=True)
    late.step(COMPARED)
    # rounding: conjugate gradients iterate to it
    np.testing.assert_allclose(v, late.u_b, rtol=0.0, atol=1e-10 * largest)
    return {step: theirs * 1e3, over: theirs / ours, differ: float(np.max(np.abs(v - u)) / largest)}


def measure(nx, ny, seconds):
    q = problem(nx, ny)
    setup, coupler = once(lambda: coupled(q))
    setup_loop, loop = once(lambda: Loop(q))
    differ = difference(coupler, loop)
    u = coupler.state("B").u

    def by_product():
        loop.by_product = True
        loop.step(STEPS)

    def by_solve():
        loop.by_product = False
        loop.step(STEPS)

    threaded = coupled(q, threads=None)
    ours, product, solve = in_turn(
        lambda: coupler.step(STEPS), by_product, by_solve, rounds=3, seconds=seconds
    )
    (together,) = in_turn(
        lambda: threaded.step(STEPS), rounds=3, seconds=seconds / 4, clock=time.perf_counter
    )
    theirs = min(product, solve)
    return {
        "mesh": f"{nx}x{ny}",
        "dofs per subdomain": q["M_B"].size,
        "constraints": q["face_A"].size,
        "macro step ms": ours / STEPS * 1e3,
        "loop ms": theirs / STEPS * 1e3,
        "loop over ours": theirs / ours,
        "threads": threaded.threads,
        "with these threads ms": together / STEPS * 1e3 if threaded.threads > 1 else "",
        "set-up s": setup,
        "set-up of loop s": setup_loop,
        "difference": differ,
        **kratos(nx, ny, q, u, ours / STEPS, seconds),
    }


def rows(quick):
    if not installed("KratosMultiphysics", KRATOS_PYTHON):
        print("Kratos is not installed: left out")
    meshes, seconds = ([(9, 3)], 0.0) if quick else (MESHES, 4.0)
    return [measure(nx, ny, seconds) for nx, ny in meshes]


if __name__ == "__main__":
    run("plate", rows, about=__doc__)
