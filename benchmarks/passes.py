"""Substeps of an explicit subdomain in passes over K, over the same substeps one at a time.

Bars and a cube of hexahedra, tied to an implicit layer of the same elements at the four corners of
one end, under macro and mean coupling. A load that is a function is evaluated for one substep after
the other, so that the substeps are taken one at a time; here it returns the array that is the
constant load of the subdomain with passes. The results are compared bitwise.
"""

import numpy as np
from timing import in_turn, run

import pmalpha as pm

MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}
EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)


def corners(mesh, counts):
    """Dofs of the four corners of the end at x = 0."""
    ends = [(y, z) for y in (0.0, counts[1]) for z in (0.0, counts[2])]
    return mesh.dofs([mesh.nodes_at(x=0.0, y=y, z=z).item() for y, z in ends])


def coupler(counts, substeps, coupling, called):
    """The bar with substeps and its layer; the bar's subdomain."""
    layer = pm.structures.solid(1, *counts[1:], 1.0, **MATERIAL, origin=(-1.0, 0.0, 0.0))
    bar = pm.structures.solid(*counts, 1.0, **MATERIAL)
    force = np.sin(np.arange(bar.n))
    a = layer.subdomain(scheme=pm.GeneralizedAlpha(0.8), name="layer")
    b = bar.subdomain(
        scheme=EXPLICIT,
        substeps=substeps,
        force=(lambda t: force) if called else force,
        name="bar",
    )
    tie = pm.tie(a, corners(layer, counts), b, corners(bar, counts))
    return pm.Coupler([a, b], tie, dt=0.3 * substeps, coupling=coupling, threads=1), b


def measure(counts, substeps, coupling, seconds):
    (one, _), (passes, b) = (coupler(counts, substeps, coupling, x) for x in (True, False))
    apart, together = in_turn(lambda: one.step(), lambda: passes.step(), seconds=seconds)
    if not np.array_equal(one.state("bar").u, passes.state("bar").u):
        raise RuntimeError(f"{counts}: passes and single substeps differ")
    return {
        "elements": "x".join(map(str, counts)),
        "dofs": b.n,
        "K MB": 8 * b.K.nnz / 1e6,
        "substeps": substeps,
        "coupling": coupling,
        "one at a time ms": 1e3 * apart,
        "in passes ms": 1e3 * together,
        "gain": apart / together,
        "aim": 1.8,
    }


def rows(quick):
    if quick:
        return [measure((8, 3, 3), 4, "macro", 0.0)]
    cases = [
        ((60, 6, 6), 10, "macro"),
        ((200, 6, 6), 10, "macro"),
        ((400, 6, 6), 20, "macro"),
        ((1200, 4, 4), 10, "macro"),
        ((100, 10, 10), 10, "macro"),
        ((300, 10, 10), 10, "macro"),
        ((300, 10, 10), 10, "mean"),
        ((30, 30, 30), 10, "macro"),
    ]
    return [measure(*case, 3.0) for case in cases]


if __name__ == "__main__":
    run("passes", rows, about=__doc__)
