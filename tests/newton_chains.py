"""Chains of nine masses on which Newton's method is tried, and the schedules it is tried in."""

import numpy as np
from newton_problems import bilinear, chain, contact, cubic
from newton_reference import run, run_macro

SCHEDULES = {
    "gc, s = 1": (run, {}),
    "pm, s = 1": (run, {"double": True}),
    "gc, s = 5": (run, {"ss": (1, 5)}),
    "pm, s = 5": (run, {"ss": (1, 5), "double": True}),
    "macro, s = 1": (run_macro, {}),
    "macro, s = 5": (run_macro, {"ss": (1, 5)}),
    "macro, double step": (run_macro, {"double": True}),
}

# ---- the stiff cubic chain ------------------------------------------------------------------

K, K3, N = 100.0, 1e4, 5
U0 = np.linspace(0.0, 1.0, 2 * N)[1:] ** 2
OMEGA = 2.0 * np.sqrt(K + 3.0 * K3 * np.diff(U0, prepend=0.0).max() ** 2)  # of the tangent at U0


def stiff_chain(**values):
    return chain(N, cubic(K, K3), u0=U0, **values)


def energy(result):
    """Energy of the cubic chain at the ends of the macro steps, relative to that at t = 0."""
    total, count = 0.0, len(result.displacement_jump) - 1
    for side, x in enumerate(result.subdomains):
        stride = (len(x.t) - 1) // count
        u, v = x.u[::stride], x.v[::stride]
        mass = np.ones(N)
        mass[0 if side else -1] = 0.5
        d = np.diff(u, axis=1) if side else np.diff(u, axis=1, prepend=0.0)
        total = total + 0.5 * v**2 @ mass + (0.5 * K * d**2 + 0.25 * K3 * d**4).sum(axis=1)
    return total / total[0]


def problems():
    """Name -> problem, its time step and number of steps."""
    n = 2 * N - 1
    load = {"force": lambda t: 30.0 * np.sin(2.0 * t) * np.ones(n), "history": 0.0}
    strike = {"v0": np.linspace(0.0, -1.0, n + 1)[1:]}
    return {
        "plastic chain": (bilinear(1e3, 0.005, 0.01), load, (0.05, 0.2), 100),
        "penalty contact, rho 0": (contact(100.0, 0.02, 1e6), {**strike, "rho": 0.0}, (0.2,), 300),
        "stiff cubic chain": (cubic(K, K3), {"u0": U0}, (10.0 / OMEGA, 40.0 / OMEGA), 200),
    }
