"""Set-up and step over the number of dofs, conditions and subdomains."""

import time

import numpy as np
import scipy.sparse as sp
from sparse_step import chain, cube
from timing import report

import pmalpha as pm

EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)
IMPLICIT = pm.GeneralizedAlpha(0.8)


def two_cubes(n):
    """An implicit cube of n^3 dofs on an explicit one with ten substeps, tied over a face."""
    K, size, face = cube(n), n**3, np.arange(n * n)
    a = pm.Subdomain(np.ones(size), K, scheme=IMPLICIT)
    b = pm.Subdomain(np.ones(size), K, scheme=EXPLICIT, substeps=10)
    return pm.Coupler([a, b], pm.tie(a, face, b, face + size - n * n), dt=1.0)


def wide_interface(p):
    """Two explicit subdomains of p dofs tied everywhere."""
    K = sp.csr_array(2.0 * sp.eye_array(p))
    a = pm.Subdomain(np.ones(p), K, scheme=EXPLICIT)
    b = pm.Subdomain(np.ones(p), K, scheme=EXPLICIT, substeps=2)
    return pm.Coupler([a, b], pm.tie(a, np.arange(p), b, np.arange(p)), dt=0.1)


def row_of_subdomains(count):
    """Chains of ten dofs in a row, implicit and explicit in turn."""
    parts = [
        pm.Subdomain(
            np.ones(10), chain(10), scheme=EXPLICIT if i % 2 else IMPLICIT, substeps=1 + i % 2
        )
        for i in range(count)
    ]
    ties = [pm.tie(a, [9], b, [0]) for a, b in zip(parts, parts[1:])]
    return pm.Coupler(parts, ties, dt=0.1)


def measure(name, size, make):
    begin = time.perf_counter()
    coupler = make(size)
    made = time.perf_counter()
    coupler.step(2)
    steps, ready = 0, time.perf_counter()
    while steps < 5 or time.perf_counter() - ready < 1.0:
        coupler.step()
        steps += 1
    step = (time.perf_counter() - ready) / steps
    return {"problem": name, "size": size, "set-up s": made - begin, "macro step ms": step * 1e3}


def main():
    rows = [measure("two cubes, n per edge", n, two_cubes) for n in (5, 10, 20, 30)]
    rows += [measure("conditions", p, wide_interface) for p in (100, 1000, 10_000, 100_000)]
    rows += [measure("subdomains", N, row_of_subdomains) for N in (2, 10, 100, 1000)]
    report("growth", rows)


if __name__ == "__main__":
    main()
