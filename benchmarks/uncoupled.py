"""An uncoupled implicit step against a Python loop over splu(...).solve, and other programs.

The loop is generalized-alpha as in pmalpha, factored once with SuperLU: predictors, product with K,
solve, correctors, on whole arrays. Exudyn, OpenSees and PETSc compute the same chain with their own
generalized-alpha schemes; their columns are empty if they are not installed.
"""

import time

import numpy as np
import scipy.sparse as sp
from peers import PEERS, WARM
from plate import solver
from timing import in_turn, run

import pmalpha as pm

RHO, DT = 0.8, 0.1
SOLID = {"E": 100.0, "nu": 0.3, "rho": 1.0}
# The difference between the schemes of other programs and ours grows with the steps.
PEER_STEPS = 5000


def chain(n):
    """Stiffness of n equal springs in a row, (n, n)."""
    return sp.csr_array(
        sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    )


class Loop:
    """Generalized-alpha with equilibrium at the end of the step, equations (5) to (12)."""

    def __init__(self, M, K, scheme, u0):
        self.K, self.scheme, self.u = K, scheme, u0.copy()
        self.al1, self.al2 = scheme.coefficients(DT)
        mass = sp.diags_array(M) if M.ndim == 1 else M
        self.lu = solver(mass + self.al1 * K)
        self.v = np.zeros(u0.size)
        self.w = -(K @ u0) / M if M.ndim == 1 else solver(M).solve(-(K @ u0))
        self.a = self.w.copy()

    def step(self, count):
        am, af, beta, gamma = (getattr(self.scheme, x) for x in ("am", "af", "beta", "gamma"))
        c, h = 1.0 - am, DT
        u_a, u_w = h * h * (0.5 - beta / c), h * h * beta * af / c
        v_a, v_w = h * (1.0 - gamma / c), h * gamma * af / c
        for _ in range(count):
            ut = self.u + h * self.v + u_a * self.a + u_w * self.w
            vt = self.v + v_a * self.a + v_w * self.w
            w = self.lu.solve(-(self.K @ ut))
            self.u, self.v = ut + self.al1 * w, vt + self.al2 * w
            self.a = ((1.0 - af) * w + af * self.w - am * self.a) / c
            self.w = w


def solid(*counts):
    """Matrices of a solid that is fixed at one end."""
    box = pm.structures.solid(*counts, 1.0, **SOLID)
    free = np.setdiff1d(np.arange(box.n), box.dofs(box.nodes_at(x=0.0)))
    return sp.csr_array(box.M[free][:, free]), sp.csr_array(box.K[free][:, free])


def measure(name, M, K, steps, seconds):
    n, scheme = K.shape[0], pm.GeneralizedAlpha(RHO)
    u0 = np.sin(np.pi * np.arange(1, n + 1) / (n + 1))
    subdomain = pm.Subdomain(M, K, scheme=scheme, u0=u0)
    coupler = pm.Coupler([subdomain], dt=DT, threads=1)
    loop = Loop(M, K, scheme, u0)
    coupler.step(20)
    loop.step(20)
    u = coupler.state(0).u
    differ = float(np.max(np.abs(u - loop.u)) / np.max(np.abs(loop.u)))
    ours, theirs = in_turn(
        lambda: coupler.step(steps), lambda: loop.step(steps), rounds=3, seconds=seconds
    )
    row = {
        "problem": name,
        "n": n,
        "us a step": ours / steps * 1e6,
        "us a step of the loop": theirs / steps * 1e6,
        "loop over ours": theirs / ours,
        "difference": differ,
    }
    for other, peer in PEERS.items():
        measured = name == "chain" and n <= peer.largest and peer.installed()
        few = min(steps, PEER_STEPS)
        found = peer_step(peer, n, u0, few, seconds) * 1e6 if measured else ""
        row[f"us a step of {other}"] = found
    return row


def peer_step(peer, n, u0, steps, seconds):
    """Least seconds per step of another program, whose displacements are checked."""
    loop = Loop(np.ones(n), chain(n), pm.GeneralizedAlpha(RHO), u0)
    loop.step(WARM + steps)
    least, done, start = float("inf"), 0, time.perf_counter()
    while done < 3 or time.perf_counter() - start < seconds:
        found, u = peer.chain(n, DT, RHO, u0, steps)
        np.testing.assert_allclose(u, loop.u, atol=peer.tolerance)
        least = min(least, found)
        done += 1
    return least


def rows(quick):
    for other, peer in PEERS.items():
        if not peer.installed():
            print(f"{other} is not installed: left out")
    if quick:
        return [measure("chain", np.ones(2), chain(2), 10, 0.0)]
    found = [
        measure("chain", np.ones(n), chain(n), steps, 3.0)
        for n, steps in ((2, 50_000), (1000, 500), (100_000, 5))
    ]
    for counts in ((15, 14, 14), (21, 20, 21)):
        found.append(measure("solid", *solid(*counts), 3, 5.0))
    return found


if __name__ == "__main__":
    run("uncoupled", rows, about=__doc__)
