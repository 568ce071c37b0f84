"""Cost of the coupling: a coupled step over the sum of the uncoupled steps of its subdomains.

A central subdomain, with neighbours of the same mesh at one, two or six of its faces; all are
implicit with one substep, or the neighbours are explicit with ten. The coupling adds fill, because
the interface dofs are last in the elimination order (more for more faces), and the interface
problem at every fine step, of p^2 entries if a subdomain is implicit. The
limit is the same coupler without constraints: its subdomains are stepped in turn, so that none of
them has the caches for itself, as it has alone.
"""

import warnings

import numpy as np
from timing import in_turn, run

import pmalpha as pm

MATERIAL = {"E": 100.0, "nu": 0.3, "rho": 1.0}
IMPLICIT = pm.GeneralizedAlpha(0.8)
EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)
DT = 0.1
# Of the ratio with one face.
TARGET = 1.1
# Consecutive steps per measurement, of the coupled subdomains and of each alone.
STEPS = 20
# Positions of the neighbours of a cube, in units of its edge.
SIDES = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]


def structures(counts, faces):
    """The central structure and its neighbours at the first `faces` sides."""
    build = pm.structures.plate if len(counts) == 2 else pm.structures.solid
    origins = [(0,) * len(counts)] + [side[: len(counts)] for side in SIDES[:faces]]
    return [
        build(*counts, 1.0, **MATERIAL, mass="lumped", origin=np.multiply(origin, counts))
        for origin in origins
    ]


def subdomains(meshes, substeps):
    """The central subdomain implicit; its neighbours explicit if they have substeps."""
    found = []
    for i, mesh in enumerate(meshes):
        explicit = i > 0 and substeps > 1
        found.append(
            mesh.subdomain(
                scheme=EXPLICIT if explicit else IMPLICIT,
                substeps=substeps if explicit else 1,
                force=np.sin(np.arange(mesh.n)),
            )
        )
    return found


def measure(name, counts, faces, substeps, seconds):
    meshes = structures(counts, faces)
    members = subdomains(meshes, substeps)
    points = {s: mesh.points for s, mesh in zip(members, meshes)}
    tie = pm.tie_coincident(points, components=len(counts))
    coupled = pm.Coupler(members, tie, dt=DT, threads=1, coupling="pm")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.ConstraintWarning)  # that nothing is tied
        untied = pm.Coupler(members, [], dt=DT, threads=1, coupling="pm")
    alone = [pm.Coupler([s], dt=DT, threads=1) for s in members]

    def each_alone():
        for c in alone:
            c.step(STEPS)

    whole, turns, single = in_turn(
        lambda: coupled.step(STEPS),
        lambda: untied.step(STEPS),
        each_alone,
        rounds=3,
        seconds=seconds,
    )
    return {
        "subdomains": name,
        "dofs per subdomain": meshes[0].n,
        "faces": faces,
        "substeps of the neighbours": substeps,
        "constraints": tie.p,
        "coupled step ms": whole / STEPS * 1e3,
        "sum of uncoupled ms": single / STEPS * 1e3,
        "coupled over sum": whole / single,
        "limit: untied over sum": turns / single,
        "target": TARGET if faces == 1 else "",
    }


def rows(quick):
    if quick:
        return [measure("cube", (2, 2, 2), 6, 10, 0.0)]
    cases = [
        ("plate", (99, 49), 1),
        ("plate", (149, 149), 1),
        ("bar of hex8", (16, 8, 8), 1),
        ("bar of hex8", (41, 8, 8), 1),
        ("cube of hex8", (14, 14, 14), 1),
        ("cube of hex8", (14, 14, 14), 2),
        ("cube of hex8", (14, 14, 14), 6),
    ]
    return [measure(*case, substeps, 4.0) for case in cases for substeps in (1, 10)]


if __name__ == "__main__":
    run("coupling_cost", rows, about=__doc__)
