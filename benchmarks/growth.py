"""Set-up, macro step and memory over the number of dofs, of constraints and of subdomains.

Each size runs in a separate process, so that its memory can be measured: the resident memory after
the subdomains are created, and the peak while the Coupler is created and stepped. The large sizes
need 8 GB.
"""

import json
import subprocess
import sys
import time

import memory
import numpy as np
import scipy.sparse as sp
from timing import in_turn, once, run

import pmalpha as pm

EXPLICIT = pm.GeneralizedAlpha(0.8, explicit=True)
IMPLICIT = pm.GeneralizedAlpha(0.8)
MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}


def loaded(structure, scheme, **options):
    """A subdomain under a load that leaves no dof at rest."""
    return structure.subdomain(scheme=scheme, force=np.sin(np.arange(structure.n)), **options)


def explicit_solid(n):
    """One explicit box of hex8 with about n dofs, uncoupled."""
    side = round((n / 3) ** (1 / 3)) - 1
    return [loaded(pm.structures.solid(side, side, side, 1.0, **MATERIAL), EXPLICIT)], None, 0.5


def implicit_solid(n):
    """One implicit box of hex8 with about n dofs, uncoupled."""
    side = round((n / 3) ** (1 / 3)) - 1
    return [loaded(pm.structures.solid(side, side, side, 1.0, **MATERIAL), IMPLICIT)], None, 0.5


def implicit_edge(p):
    """Two implicit strips of 2500 x 4 elements, tied at p dofs of their long edges."""
    lower = pm.structures.plate(2500, 4, 1.0, **MATERIAL)
    upper = pm.structures.plate(2500, 4, 1.0, **MATERIAL, origin=(0.0, 4.0))
    a, b = loaded(lower, IMPLICIT), loaded(upper, IMPLICIT)
    of_a, of_b = (s.dofs(s.nodes_at(y=4.0))[:p] for s in (lower, upper))
    return [a, b], pm.tie(a, of_a, b, of_b), 0.5


def explicit_constraints(p):
    """Two explicit subdomains of p dofs tied everywhere: H is diagonal."""
    K = sp.csr_array(2.0 * sp.eye_array(p))
    a = pm.Subdomain(np.ones(p), K, scheme=EXPLICIT, force=np.ones(p))
    b = pm.Subdomain(np.ones(p), K, scheme=EXPLICIT, substeps=2)
    return [a, b], pm.tie(a, np.arange(p), b, np.arange(p)), 0.1


def tiles(columns, rows):
    """Plates of 4 x 4 elements, tied at common edges, alternately implicit and explicit."""
    meshes = [
        pm.structures.plate(4, 4, 1.0, **MATERIAL, origin=(4.0 * i, 4.0 * j))
        for i in range(columns)
        for j in range(rows)
    ]
    subdomains = []
    for k, mesh in enumerate(meshes):
        explicit = (k // rows + k % rows) % 2
        scheme = EXPLICIT if explicit else IMPLICIT
        subdomains.append(loaded(mesh, scheme, substeps=2 if explicit else 1))
    points = {s: mesh.points for s, mesh in zip(subdomains, meshes)}
    return subdomains, pm.tie_coincident(points, components=2), 0.5


def tiles_in_a_row(count):
    return tiles(count, 1)


def tiles_in_a_grid(count):
    side = round(count**0.5)
    return tiles(side, side)


PROBLEMS = {
    "explicit hex8, dofs": (explicit_solid, (1e3, 1e4, 1e5, 1e6)),
    "implicit hex8, dofs": (implicit_solid, (1e3, 1e4, 3e4, 1e5)),
    "constraints, implicit": (implicit_edge, (10, 100, 300, 1000, 5000)),
    "constraints, explicit": (explicit_constraints, (100, 1000, 1e4, 1e5)),
    "subdomains in a row": (tiles_in_a_row, (2, 10, 100, 1000)),
    "subdomains in a grid": (tiles_in_a_grid, (4, 16, 100, 1024)),
}


def measure(problem, size):
    """One row, in this process."""
    made, (subdomains, constraints, dt) = once(lambda: PROBLEMS[problem][0](size))
    before = memory.present()
    memory.forget_peak()
    setup, coupler = once(
        lambda: pm.Coupler(subdomains, constraints, dt=dt, threads=1, coupling="pm")
    )
    coupler.step(2)
    (step,) = in_turn(coupler.step, rounds=3, seconds=1.0)
    return {
        "problem": problem,
        "size": size,
        "dofs": sum(s.n for s in subdomains),
        "constraints": sum(c.p for c in [constraints] if c is not None),
        "subdomains s": made,
        "set-up s": setup,
        "macro step ms": step * 1e3,
        "MB before": before,
        "MB peak": memory.peak(),
    }


def apart(problem, size):
    """The same row, measured in a separate process."""
    print(time.strftime("%H:%M:%S"), problem, size, file=sys.stderr)
    command = [sys.executable, __file__, "--one", problem, str(size)]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return json.loads(out)


def rows(quick):
    if quick:
        quickest = {"explicit hex8, dofs": 100, "subdomains in a grid": 4}
        return [apart(problem, size) for problem, size in quickest.items()]
    return [apart(name, int(size)) for name, (_, sizes) in PROBLEMS.items() for size in sizes]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(sys.argv[2], int(sys.argv[3]))))
    else:
        run("growth", rows, about=__doc__)
