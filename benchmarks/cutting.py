"""Cutting cubes of hex8 elements into 16 subdomains, and the way back: time and memory.

"elements" are one element matrix for all, from `pm.Elements`; "structure" has its uncut matrices as
well. "gather" puts 1000 macro times of u, v and a together again. Times are processor times of the
process. The largest cube needs 6 GB.
"""

import time

import memory
import numpy as np
from timing import once, run

import pmalpha as pm

MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}
PARTS = 16


def cube(n, kind):
    """n^3 elements: a Structure, or Elements with the matrices of one element."""
    if kind == "structure":
        return pm.structures.solid(n, n, n, 1.0 / n, **MATERIAL)
    one = pm.structures.solid(1, 1, 1, 1.0 / n, **MATERIAL)
    own = one.dofs(one.elements["hexahedron"][0])
    first = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)[:-1, :-1, :-1].ravel()
    # the corners of one element in a cube of (n + 1)^3 nodes
    place = one.points[one.elements["hexahedron"][0]] * n
    corner = np.rint(place @ [(n + 1) ** 2, n + 1, 1]).astype(int)
    nodes = first[:, None] + corner
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 24)
    K = one.K.toarray()[np.ix_(own, own)]
    return pm.Elements(dofs, one.M.diagonal()[own][None], K[None])


def row(what, size, seconds, wall):
    return {
        "what": what,
        "size": size,
        "processor s": seconds,
        "s": wall,
        "MB peak": memory.peak(),
    }


def cutting(n, kind):
    memory.forget_peak()
    structure = cube(n, kind)
    begin = time.perf_counter()
    seconds, _ = once(lambda: pm.cut(structure, parts=PARTS, scheme=pm.CentralDifference()))
    return row(f"cut, {kind}", f"{n**3} elements", seconds, time.perf_counter() - begin)


def gathering(n, levels):
    memory.forget_peak()
    structure = cube(n, "structure")
    parts = pm.cut(structure, parts=PARTS, scheme=pm.CentralDifference())
    history = parts.coupler(1e-3, coupling="gc", threads=1).run(steps=levels)
    begin = time.perf_counter()
    seconds, whole = once(lambda: parts.gather(history))
    size = f"{len(whole.t)} times, {structure.n} dofs"
    return row("gather", size, seconds, time.perf_counter() - begin)


def rows(quick):
    if quick:
        return [cutting(4, "elements"), cutting(4, "structure"), gathering(4, 3)]
    table = [cutting(46, "elements"), cutting(46, "structure"), cutting(100, "elements")]
    return [*table, gathering(31, 999)]


if __name__ == "__main__":
    run("cutting", rows, about=__doc__)
