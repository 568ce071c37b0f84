"""Mass scaling against cutting, on one mesh: the error of each over what it gains.

A cantilever plate of steel, 2 x 0.5 m, of triangles of 25 mm that become 0.5 mm at the middle of
the upper edge; the tip is loaded by a sine squared of 2 ms and the run lasts 10 ms, a period.
Central difference, and "gc" where it is cut. Mass scaling gives each element the density with which
the step is its critical one. "cut" are explicit subdomains by the steps of their elements; "auto"
is what `pm.cut` chooses for this step, with the finest elements implicit.

Errors are root mean squares over the run of the displacement of the tip and of the refined corner,
the larger one, against the uncut mesh at its own step, over that of the same displacement there.
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import Delaunay
from timing import once, run

import pmalpha as pm
from pmalpha import structures

LENGTH, HEIGHT = 2.0, 0.5
FINEST, COARSEST = 5e-4, 0.025
MATERIAL = {"E": 210e9, "nu": 0.3, "t": 0.01, "mass": "lumped"}
RHO, PUSH, END = 7800.0, 2e-3, 10e-3
SHARE = 0.945  # of the smallest critical step of an element


def mesh(finest, coarsest):
    """Points and triangles: rings about the middle of the upper edge in a grid."""
    x = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, round(LENGTH / coarsest) + 1)
    y = np.linspace(-HEIGHT, 0.0, round(HEIGHT / coarsest) + 1)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    rings, r = [np.zeros((1, 2))], 4.0 * finest
    while r < 4.0 * coarsest:
        angle = np.linspace(0.0, np.pi, 13)
        ring = r * np.column_stack([np.cos(angle), -np.sin(angle)])
        ring[[0, -1], 1] = 0.0
        rings.append(ring)
        r *= 1.25
    far = np.hypot(*grid.T) > rings[-1][0, 0] + 0.6 * coarsest
    points = np.concatenate([*rings, grid[far]]) + [0.5 * LENGTH, HEIGHT]
    triangles = Delaunay(points).simplices
    d1, d2 = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    area = 0.5 * (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])
    triangles[area < 0.0] = triangles[area < 0.0][:, ::-1]
    return points, triangles[np.abs(area) > 1e-3 * finest**2]


def steps_of(points, triangles):
    """The critical step of each element, alone and free."""
    apart = np.arange(triangles.size).reshape(triangles.shape)
    elements = structures.plate_on(points[triangles.ravel()], apart, rho=RHO, **MATERIAL)
    root = 1.0 / np.sqrt(elements.M.diagonal().reshape(-1, 6))
    K = sp.bsr_array(elements.K, blocksize=(6, 6)).data
    return 2.0 / np.sqrt(np.linalg.eigvalsh(root[:, :, None] * K * root[:, None, :])[:, -1])


def tip(points):
    """The middle of the free end, and the refined corner."""
    return [
        int(np.argmin(np.hypot(points[:, 0] - x, points[:, 1] - y)))
        for x, y in ((LENGTH, 0.5 * HEIGHT), (0.5 * LENGTH, HEIGHT))
    ]


def motions(parts, dt, count, rows, dofs):
    """Processor seconds, and the two displacements at `rows` + 1 times."""
    coupler = parts.coupler(dt, coupling="gc", threads=1)
    every = count // rows
    seconds, history = once(lambda: coupler.run(steps=count, every=every))
    return seconds, parts.gather(history).u[:, dofs]


def rows(quick):
    points, triangles = mesh(*((0.01, 0.1) if quick else (FINEST, COARSEST)))
    plate = structures.plate_on(points, triangles, rho=RHO, **MATERIAL)
    critical = steps_of(points, triangles)
    clamped = np.flatnonzero(points[:, 0] == 0.0)
    fixed = np.concatenate([2 * clamped, 2 * clamped + 1])
    dofs = [2 * node + 1 for node in tip(points)]
    tips = np.flatnonzero(points[:, 0] == points[:, 0].max())
    shape = np.zeros(plate.n)
    shape[2 * tips + 1] = 1e5 / tips.size
    force = pm.SampledForce(
        np.sin(np.linspace(0.0, np.pi, 2001)) ** 2, dt=PUSH / 2000.0, shape=shape
    )
    h, levels = SHARE * critical.min(), 4 if quick else 64
    block = 32 * levels
    fine = max(1, round((PUSH if quick else END) / h / block)) * block
    table, exact = [], None

    def measure(what, factor, cut, mass=0.0):
        nonlocal exact
        seconds, found = motions(cut, factor * h, fine // factor, levels, dofs)
        exact = (seconds, found) if exact is None else exact
        error = np.sqrt(np.mean((found - exact[1]) ** 2, axis=0) / np.mean(exact[1] ** 2, axis=0))
        table.append(
            {
                "what": what,
                "step over own": factor,
                "step s": factor * h,
                "dofs": plate.n,
                "mass added %": 100.0 * float(mass),
                "subdomains": len(cut.subdomains),
                "processor s": seconds,
                "faster": exact[0] / seconds,
                "error": float(error.max()),
            }
        )

    everything = {"force": force, "fixed": fixed}
    one = np.zeros(len(triangles), dtype=int)
    measure("uncut, own step", 1, pm.cut(plate, one, scheme=CENTRAL, **everything))
    for factor in (4, 8, 16, 32):
        heavier = np.maximum(1.0, (factor * h / SHARE / critical) ** 2)
        scaled = structures.plate_on(points, triangles, rho=RHO * heavier, **MATERIAL)
        added = scaled.M.diagonal().sum() / plate.M.diagonal().sum() - 1.0
        measure("mass scaling", factor, pm.cut(scaled, one, scheme=CENTRAL, **everything), added)
    for what, how in (
        ("cut", {"labels": "steps", "scheme": CENTRAL}),
        ("auto", {"parts": "auto", "scheme": [CENTRAL, pm.GeneralizedAlpha(1.0)]}),
    ):
        cut = pm.cut(plate, dt=32 * h, **how, **everything)
        measure(what, 32, cut)
    return table


CENTRAL = pm.CentralDifference()

if __name__ == "__main__":
    run("mass_scaling", rows, about=__doc__)
