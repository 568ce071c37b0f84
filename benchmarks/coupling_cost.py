"""What coupling costs: a coupled step over the sum of the uncoupled steps of its parts.

A part in the middle, with neighbours of the same mesh at one, two or six of its faces; all
implicit with one step, or the neighbours explicit with ten. What is added: interface dofs that come
last in the order of elimination (more fill the more faces there are), and the interface problem at
every fine step, of p^2 entries where a part is implicit.
"""

import numpy as np
from timing import in_turn, run

import pmalpha as pm

MATERIAL = {"E": 100.0, "nu": 0.3, "rho": 1.0}
IMPLICIT = pm.GeneralizedAlpha(0.8)
EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)
DT = 0.1
# Steps in a row, so that each finds in the caches what it left there.
STEPS = 4
# Where the neighbours of a cube are, in cubes.
SIDES = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]


def structures(counts, faces):
    """The part in the middle and its neighbours at the first `faces` sides."""
    build = pm.models.plate if len(counts) == 2 else pm.models.solid
    places = [(0,) * len(counts)] + [side[: len(counts)] for side in SIDES[:faces]]
    return [
        build(*counts, 1.0, **MATERIAL, mass="lumped", origin=np.multiply(place, counts))
        for place in places
    ]


def subdomains(parts, substeps):
    """The middle implicit, its neighbours with their substeps, explicit if there are any."""
    found = []
    for i, part in enumerate(parts):
        explicit = i > 0 and substeps > 1
        found.append(
            part.subdomain(
                scheme=EXPLICIT if explicit else IMPLICIT,
                substeps=substeps if explicit else 1,
                force=np.sin(np.arange(part.n)),
            )
        )
    return found


def measure(name, counts, faces, substeps, seconds):
    parts = structures(counts, faces)
    own = subdomains(parts, substeps)
    points = {s: part.points for s, part in zip(own, parts)}
    tie = pm.tie_coincident(points, components=len(counts))
    coupled = pm.Coupler(own, tie, dt=DT, threads=1)
    alone = [pm.Coupler([s], dt=DT, threads=1) for s in own]

    def each_alone():
        for _ in range(STEPS):
            for c in alone:
                c.step()

    whole, single = in_turn(lambda: coupled.step(STEPS), each_alone, rounds=3, seconds=seconds)
    return {
        "parts": name,
        "dofs of a part": parts[0].n,
        "faces": faces,
        "substeps of the neighbours": substeps,
        "conditions": tie.p,
        "coupled step ms": whole / STEPS * 1e3,
        "sum of uncoupled ms": single / STEPS * 1e3,
        "coupled over sum": whole / single,
    }


def rows(quick):
    if quick:
        return [measure("cube", (2, 2, 2), 6, 10, 0.0)]
    cases = [
        ("plate", (99, 49), 1),
        ("plate", (149, 149), 1),
        ("bar of hex8", (41, 8, 8), 1),
        ("cube of hex8", (14, 14, 14), 1),
        ("cube of hex8", (14, 14, 14), 2),
        ("cube of hex8", (14, 14, 14), 6),
    ]
    return [measure(*case, substeps, 4.0) for case in cases for substeps in (1, 10)]


if __name__ == "__main__":
    run("coupling_cost", rows, about=__doc__)
