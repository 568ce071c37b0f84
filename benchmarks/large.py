"""A million explicit dofs tied to a hundred thousand implicit ones: set-up, memory and step.

A bar of hex8 elements with 32 x 32 nodes in its cross-section: 326 layers of nodes are explicit
with ten substeps, 32 layers are implicit with one; 3072 constraints. The time of set-up is reported
by function. Needs 8 GB and some minutes.
"""

import cProfile
import pstats
import re
import time
from functools import partial
from pathlib import Path

import memory
import numpy as np
from timing import in_turn, once, run

import pmalpha as pm

MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}
SS, DT = 10, 2.0
# Functions of the package with at least this share of set-up, callees included, are reported.
SHARE = 0.02


def bars(side, explicit, implicit):
    """Both subdomains, as Structures."""
    left = pm.structures.solid(implicit - 1, side - 1, side - 1, 1.0, **MATERIAL)
    right = pm.structures.solid(
        explicit - 1, side - 1, side - 1, 1.0, **MATERIAL, origin=(implicit - 1.0, 0.0, 0.0)
    )
    return left, right


def subdomains(left, right):
    """The subdomains and their tie; every dof is loaded."""
    a = left.subdomain(scheme=pm.GeneralizedAlpha(0.8), force=np.sin(np.arange(left.n)))
    b = right.subdomain(
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=SS,
        force=np.sin(np.arange(right.n)),
    )
    x = left.points[:, 0].max()
    face_a, face_b = (s.dofs(s.nodes_at(x=x)) for s in (left, right))
    return [a, b], pm.tie(a, face_a, b, face_b)


def entry(what, seconds="", processor="", present="", peak=""):
    """A row of the table."""
    return {
        "what": what,
        "seconds": seconds,
        "processor s": processor,
        "MB": present,
        "MB peak": peak,
    }


def stage(what, call):
    """The row of a call, and its return value."""
    memory.forget_peak()
    processor = time.process_time()
    seconds, value = once(call, time.perf_counter)
    processor = time.process_time() - processor
    return entry(what, seconds, processor, memory.present(), memory.peak()), value


def functions(profile, total):
    """Rows for the functions of the package during set-up, by decreasing processor time."""
    package = str(Path(pm.__file__).parent)
    rows = []
    for (path, _, name), (_, _, _, seconds, _) in pstats.Stats(profile).stats.items():
        ours = path.startswith(package) and not name.startswith("<")
        builtin = re.search(r"pmalpha\.(_core\.\w+)>", name)
        if (ours or builtin) and seconds >= SHARE * total:
            function = f"{Path(path).stem}.{name}" if ours else builtin[1]
            rows.append(entry(f"of set-up, in {function}", processor=seconds))
    return sorted(rows, key=lambda row: -row["processor s"])


def rows(quick):
    sizes = (3, 6, 3) if quick else (32, 326, 32)
    profile = cProfile.Profile(time.process_time)
    found = []

    def measured(what, call):
        row, value = stage(what, call)
        found.append(row)
        return value

    solids = measured("matrices of both subdomains", partial(bars, *sizes))
    counts = [solid.n for solid in solids]
    pair, tie = measured("Subdomain and tie", partial(subdomains, *solids))
    del solids
    coupler = measured(
        "Coupler", partial(profile.runcall, pm.Coupler, pair, tie, dt=DT, coupling="pm")
    )
    setup = found[-1]["processor s"]
    measured("first two macro steps", partial(coupler.step, 2))
    (step,) = in_turn(coupler.step, rounds=2 if quick else 10, clock=time.perf_counter)
    found.append(entry("macro step", step, "", memory.present(), memory.peak()))
    found += functions(profile, setup)
    size = {
        "threads": coupler.threads,
        "dofs implicit": counts[0],
        "dofs explicit": counts[1],
        "constraints": tie.p,
    }
    return [row | size for row in found]


if __name__ == "__main__":
    run("large", rows, about=__doc__)
