"""Speed-up with two threads: balanced subdomains, one in parallel with fine steps, many, one alone.

The limit for balanced subdomains is 1.7 where both factors fit in the private caches (PRIVATE) and
a step takes over 20 us. For larger ones it is 0.9 of the speed-up of reading: two threads that read
an array of the size of a factor each, against one thread that reads both. For a coarse subdomain in
parallel with a fine one it is the sum of the two times over the longer one. For a split subdomain
it is 0.9 of the speed-up of reading its stiffness in halves, or 1.7 where that fits in the private
caches. `none over one` compares the number of threads chosen by threads=None with one thread.
"""

import threading
import time

import numpy as np
import scipy.sparse as sp
from timing import in_turn, run

import pmalpha as pm

PRIVATE = 1e6  # bytes of the cache of one core
IMPLICIT = pm.GeneralizedAlpha(0.8)
EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)


def chain(n):
    """Stiffness of n equal springs in a row, (n, n)."""
    return sp.csr_array(
        sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    )


def cube(n):
    """Laplacian of an n x n x n grid, with fill similar to that of a solid."""
    one, T = sp.eye_array(n), chain(n)
    layers = sp.kron(sp.kron(T, one), one) + sp.kron(sp.kron(one, T), one)
    return sp.csr_array(layers + sp.kron(sp.kron(one, one), T))


def subdomain(K, scheme=IMPLICIT, **options):
    n = K.shape[0]
    return pm.Subdomain(np.ones(n), K, scheme=scheme, force=np.ones(n), **options)


def two(a, b, count, **options):
    """Two subdomains tied at `count` dofs of an edge."""
    edge = np.arange(count)
    return pm.Coupler([a, b], pm.tie(a, edge, b, edge), dt=0.2, **{"coupling": "pm", **options})


def balanced(n, coupling, threads):
    """Two equal cubes with equal steps."""
    return two(subdomain(cube(n)), subdomain(cube(n)), n, coupling=coupling, threads=threads)


def in_parallel(n, m, substeps, threads):
    """An implicit cube with double steps in parallel with an explicit one with substeps."""
    a, b = subdomain(cube(n)), subdomain(cube(m), EXPLICIT, substeps=substeps)
    return two(a, b, min(n, m), threads=threads)


def many(count, n, threads):
    """Chains in a row, all implicit with equal steps."""
    chains = [subdomain(chain(n)) for _ in range(count)]
    ties = [pm.tie(a, [n - 1], b, [0]) for a, b in zip(chains, chains[1:])]
    return pm.Coupler(chains, ties, dt=0.2, coupling="gc", threads=threads)


def solid(n, threads):
    """One explicit box of n x n x n hex8 with lumped mass."""
    box = pm.structures.solid(n, n, n, 1.0, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    return pm.Coupler(
        [box.subdomain(scheme=EXPLICIT, force=np.ones(box.n))], dt=0.5, threads=threads
    )


def array_bytes(x):
    """Bytes of all arrays in nested tuples."""
    if isinstance(x, np.ndarray):
        return x.nbytes
    return sum(map(array_bytes, x)) if isinstance(x, (tuple, list)) else 0


def reading(size, rounds):
    """Speed-up of two threads that read `size` bytes each over one that reads both arrays."""
    arrays = [np.ones(max(int(size) // 8, 1)) for _ in range(2)]
    repeats = max(1, int(1e8 / size))

    def read(array):
        for _ in range(repeats):
            np.dot(array, array)

    def together():
        other = threading.Thread(target=read, args=(arrays[1],))
        other.start()
        read(arrays[0])
        other.join()

    one, both = in_turn(
        lambda: [read(a) for a in arrays], together, rounds=rounds, clock=time.perf_counter
    )
    return one / both


def least_times(make, seconds, rounds):
    """Seconds per macro step with one thread, two, and threads=None; and the three couplers."""
    couplers = [make(threads) for threads in (1, 2, None)]
    couplers[0].step(3)
    (trial,) = in_turn(lambda: couplers[0].step(3), rounds=2)
    steps = max(1, round(seconds * 3.0 / trial))
    times = in_turn(
        *[lambda c=c: c.step(steps) for c in couplers], rounds=rounds, clock=time.perf_counter
    )
    return [t / steps for t in times], couplers


def row_of(problem, size, make, limit, quick):
    (one, two_, none), couplers = least_times(make, 0.002 if quick else 0.003, 3 if quick else 150)
    size_of = array_bytes(couplers[0]._session.members[0].factors[-1])
    return {
        "problem": problem,
        "size": size,
        "factor MB": size_of / 1e6,
        "us a macro step": one * 1e6,
        "two over one": one / two_,
        "limit": limit(size_of, one),
        "threads by None": couplers[2].threads,
        "none over one": none / one,
    }


def limit_of_balanced(quick):
    """1.7, or 0.9 of the speed-up of reading; 1 for steps of less than 20 us."""

    def limit(size, seconds):
        if size <= PRIVATE:
            return 1.7 if seconds > 2 * 20e-6 else 1.0
        return 0.9 * reading(size, 2 if quick else 9)

    return limit


def limit_in_parallel(n, m, substeps):
    """The sum of the two uncoupled times over the longer one."""
    a, b = subdomain(cube(n)), subdomain(cube(m), EXPLICIT, substeps=substeps)
    alone = [pm.Coupler([s], dt=0.2, threads=1) for s in (a, b)]
    times = in_turn(*[lambda c=c: c.step(5) for c in alone], rounds=5)
    return sum(times) / max(times)


def measure(quick):
    rows = []
    for coupling, sizes in (("gc", (4, 6, 8, 10, 12, 16, 20, 28)), ("pm", (8, 12, 16))):
        for n in (6,) if quick else sizes:
            rows.append(
                row_of(
                    f"balanced, {coupling}",
                    n**3,
                    lambda threads, n=n, c=coupling: balanced(n, c, threads),
                    limit_of_balanced(quick),
                    quick,
                )
            )
    for n, m in ((5, 4),) if quick else ((8, 8), (12, 8), (16, 12), (20, 16)):
        ideal = limit_in_parallel(n, m, 20)
        rows.append(
            row_of(
                "parallel to 20 substeps",
                f"{n**3} + {m**3}",
                lambda threads, n=n, m=m: in_parallel(n, m, 20, threads),
                lambda size, seconds, ideal=ideal: ideal,
                quick,
            )
        )
    halves = limit_of_balanced(quick)
    for n in (12,) if quick else (12, 20, 40):
        K_bytes = 8 * pm.structures.solid(n, n, n, 1.0, E=1.0, nu=0.3, rho=1.0).K.nnz
        rows.append(
            row_of(
                "split",
                3 * (n + 1) ** 3,
                lambda threads, n=n: solid(n, threads),
                lambda size, seconds, half=K_bytes / 2: halves(half, seconds),
                quick,
            )
        )
    for count, n in ((4, 20),) if quick else ((8, 20), (64, 20), (8, 1000), (64, 1000)):
        rows.append(
            row_of(
                "many",
                f"{count} x {n}",
                lambda threads, count=count, n=n: many(count, n, threads),
                lambda size, seconds: 1.0,
                quick,
            )
        )
    return rows


if __name__ == "__main__":
    run("threads", measure, about=__doc__)
