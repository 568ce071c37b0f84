"""Mean coupling: a macro step of "mean" over one of "macro".

Two equal plane grids tied along an edge, both by the trapezoidal rule, with one and with five
substeps in the second of them; masses lumped or consistent, with damping or without.
"""

import numpy as np
import scipy.sparse as sp
from timing import in_turn, run

import pmalpha as pm

DT = 0.3


def line(n, below, diagonal):
    """A tridiagonal matrix."""
    values = [below, diagonal, below]
    return sp.diags_array(values, offsets=[-1, 0, 1], shape=(n, n))


def grid(n, consistent):
    """Mass and stiffness of a membrane of n x n nodes on springs."""
    one, stiff = sp.identity(n), line(n, -1.0, 2.0)
    K = sp.kron(stiff, one) + sp.kron(one, stiff) + 1e-3 * sp.identity(n * n)
    mass = line(n, 1.0 / 6.0, 4.0 / 6.0)
    return sp.csc_array(sp.kron(mass, mass)) if consistent else np.ones(n * n), sp.csc_array(K)


def coupler(n, substeps, consistent, damped, coupling):
    M, K = grid(n, consistent)
    a, b = (
        pm.Subdomain(
            M,
            K,
            C=0.01 * K if damped else None,
            scheme=pm.Newmark(),
            substeps=s,
            force=np.ones(n * n),
            name=name,
        )
        for name, s in (("a", 1), ("b", substeps))
    )
    edges = pm.tie(a, np.arange(n * n - n, n * n), b, np.arange(n))
    return pm.Coupler([a, b], edges, dt=DT, coupling=coupling, threads=1)


def measure(n, substeps, consistent, damped, seconds):
    couplers = [coupler(n, substeps, consistent, damped, c) for c in ("macro", "mean")]
    steps = max(2, 20_000 // n**2)
    macro, mean = in_turn(*(lambda c=c: c.step(steps) for c in couplers), seconds=seconds)
    return {
        "dofs per subdomain": n * n,
        "substeps": f"1, {substeps}",
        "mass": "consistent" if consistent else "lumped",
        "damped": damped,
        "macro ms": macro / steps * 1e3,
        "mean ms": mean / steps * 1e3,
        "mean over macro": mean / macro,
    }


def rows(quick):
    sizes, seconds = ((4,), 0.0) if quick else ((20, 60, 150), 2.0)
    return [
        measure(n, substeps, consistent, damped, seconds)
        for n in sizes
        for substeps in (1, 5)
        for consistent in (False, True)
        for damped in (False, True)
    ]


if __name__ == "__main__":
    run("mean", rows, about=__doc__)
