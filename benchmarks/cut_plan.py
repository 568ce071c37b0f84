"""Gain of cut structures over the uncut one at the finest step, predicted and measured.

`plan.gain` is computed from sizes before anything is factored; "entries" is the ratio of the
predicted matrix entries of a macro step to those that the core counts. All runs are on one thread.
"theoretical" is the ratio of own steps times dofs, without any work at interfaces.
"""

from functools import partial

import numpy as np
from timing import in_turn, run

import pmalpha as pm

MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}
EXPLICIT = pm.GeneralizedAlpha(0.5, explicit=True)


def graded(n, ratio):
    """A square of n by n elements whose edges grow by this ratio along both axes."""
    edges = np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, ratio, n))]) / ratio
    points = np.stack(np.meshgrid(edges, edges, indexing="ij"), axis=-1).reshape(-1, 2)
    quads = pm.structures.plate(n, n, 1.0, E=1.0, nu=0.3, rho=1.0).elements["quad"]
    return pm.structures.plate_on(points, quads, **MATERIAL)


def cases(quick):
    """Name, structure and arguments of cut."""
    n = 8 if quick else 60
    plate = pm.structures.plate(n, n, 0.1, **MATERIAL)
    yield "graded plate", graded(n, 100.0), {"labels": "steps", "dt": 0.4}
    if quick:
        return
    yield "graded plate", graded(150, 100.0), {"labels": "steps", "dt": 0.4}
    yield "graded plate", graded(300, 30.0), {"labels": "steps", "dt": 0.06}
    yield "cube", pm.structures.solid(20, 20, 20, 0.1, **MATERIAL), {"parts": 4, "scheme": EXPLICIT}
    yield (
        "cube",
        pm.structures.solid(20, 20, 20, 0.1, **MATERIAL),
        {"parts": 16, "scheme": EXPLICIT},
    )
    yield "plate, implicit", plate, {"parts": 4, "scheme": pm.GeneralizedAlpha(0.5)}


def measure(name, structure, arguments, seconds):
    parts = pm.cut(structure, **arguments)
    dt = parts.dt or 1e-3
    plan = parts.plan(dt)
    coupler = parts.coupler(dt, coupling="gc", threads=1)
    finest = max(parts.subdomains, key=lambda s: s.substeps)
    uncut = structure.subdomain(scheme=finest.scheme, substeps=finest.substeps)
    one = pm.Coupler([uncut], dt=dt, threads=1)
    # about 10 ms for each measurement
    steps = [max(1, int(2e7 / cost)) for cost in (plan.cost, plan.uncut_cost)]
    calls = [partial(c.step, k) for c, k in zip((coupler, one), steps)]
    ours, whole = (x / k for x, k in zip(in_turn(*calls, seconds=seconds), steps))
    counted = sum(p.subdomain.substeps * p.core.entries for p in coupler._session.members)
    predicted = sum(row.substeps * row.entries for row in plan.subdomains)
    work = sum(s.substeps * s.n for s in parts.subdomains)
    return {
        "structure": name,
        "dofs": structure.n,
        "subdomains": len(parts.subdomains),
        "constraints": parts.p,
        "fine steps": plan.fine_steps,
        "predicted gain": plan.gain,
        "measured gain": whole / ours,
        "measured / predicted": whole / ours / plan.gain,
        "theoretical": structure.n * plan.fine_steps / work,
        "entries": predicted / counted,
    }


def rows(quick):
    return [measure(*case, 0.0 if quick else 3.0) for case in cases(quick)]


if __name__ == "__main__":
    run("cut_plan", rows, about=__doc__)
