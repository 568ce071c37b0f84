"""A cube of hex8 elements cut into as many explicit subdomains as there are threads, 2 to 16.

"one thread" is the time of a step of the cut cube over that of the uncut one, both on one thread:
what the interfaces cost. "largest share" is the matrix entries that the busiest thread reads over
those of all, as the core distributes them. Their product bounds the speed-up over the uncut cube on
one thread from above; what memory and synchronization take off is in benchmarks/threads.py.
"""

from functools import partial

import numpy as np
from timing import in_turn, run

import pmalpha as pm

MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}
EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)
DT, STEPS = 1e-3, 3


def largest_share(parts):
    """Work of the busiest thread over that of all, with a thread for each subdomain."""
    coupler = parts.coupler(DT, coupling="gc", threads=len(parts.subdomains))
    work = np.array([part.core.entries for part in coupler._session.members], dtype=float)
    return np.bincount(coupler._session.core.workers, work).max() / work.sum()


def rows(quick):
    n, counts, seconds = (4, (2,), 0.0) if quick else (36, (2, 4, 8, 16), 10.0)
    structure = pm.structures.solid(n, n, n, 1.0 / n, **MATERIAL)
    uncut = pm.Coupler([structure.subdomain(scheme=EXPLICIT)], dt=DT, threads=1)
    cuts = [pm.cut(structure, parts=count, scheme=EXPLICIT) for count in counts]
    couplers = [uncut, *(parts.coupler(DT, coupling="gc", threads=1) for parts in cuts)]
    calls = [partial(coupler.step, STEPS) for coupler in couplers]
    whole, *times = in_turn(*calls, rounds=5, seconds=seconds)
    table = []
    for parts, seconds in zip(cuts, times, strict=True):
        share = largest_share(parts)
        table.append(
            {
                "subdomains": len(parts.subdomains),
                "dofs": structure.n,
                "constraints": parts.p,
                "one thread": seconds / whole,
                "largest share": share,
                "speed-up at most": whole / seconds / share,
            }
        )
    return table


if __name__ == "__main__":
    run("cut_threads", rows, about=__doc__)
