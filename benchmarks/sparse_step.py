"""An uncoupled sparse implicit step against a Python loop over splu(...).solve.

The loop is given for nothing all that a time step needs besides the solve: it solves with the
same right-hand side again and again.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from timing import in_turn, report

import pmalpha as pm


def chain(n):
    """Stiffness of n equal springs in a row, (n, n)."""
    return sp.csr_array(
        sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    )


def cube(n):
    """Laplacian of an n x n x n grid: fill like that of a solid."""
    one, T = sp.eye_array(n), chain(n)
    layers = sp.kron(sp.kron(T, one), one)
    rows = sp.kron(sp.kron(one, T), one)
    return sp.csr_array(layers + rows + sp.kron(sp.kron(one, one), T))


def measure(name, K, steps):
    n, dt = K.shape[0], 0.1
    scheme = pm.GeneralizedAlpha(0.8)
    part = pm.Subdomain(np.ones(n), K, scheme=scheme, u0=np.sin(np.arange(n)))
    coupler = pm.Coupler([part], dt=dt)
    al1, _ = scheme.coefficients(dt)
    lu = splu(
        sp.csc_array(sp.eye_array(n) + al1 * K),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options=dict(SymmetricMode=True),
    )
    b = np.cos(np.arange(n))

    def loop():
        for _ in range(steps):
            lu.solve(b)

    ours, theirs = in_turn(lambda: coupler.step(steps), loop)
    return {
        "problem": name,
        "n": n,
        "us a step": ours / steps * 1e6,
        "us a solve": theirs / steps * 1e6,
        "step over solve": ours / theirs,
    }


def main():
    report(
        "sparse_step",
        [
            measure("chain", chain(1000), 2000),
            measure("chain", chain(100_000), 20),
            measure("cube", cube(15), 200),
            measure("cube", cube(30), 10),
        ],
    )


if __name__ == "__main__":
    main()
