"""Gain of subcycling: a small stiff subdomain with a fine step, over the uncut box at that step.

A box of hex8 elements whose last layers are 400 times as stiff and take twenty substeps per macro
step. Both subdomains are explicit, or both implicit (then accuracy requires the fine step).
The theoretical ratio assumes a cost in proportion to dofs, (n_A + ss n_B) / (ss (n_A + n_B));
"of the subdomains" is the same ratio from the measured uncoupled steps of the two subdomains and of
the uncut box, (T_A + ss T_B) / (ss T_uncut).
"""

from functools import partial

import numpy as np
from timing import in_turn, run

import pmalpha as pm

SS, STIFF = 20, 400.0
MATERIAL = {"nu": 0.3, "rho": 1.0, "mass": "lumped"}
SCHEMES = {
    "explicit": pm.GeneralizedAlpha(0.8, explicit=True),
    "implicit": pm.GeneralizedAlpha(0.8),
}
# Half the critical step of a unit cube of E = 1, or less.
DT = 0.4
# Consecutive macro steps per measurement, so that the caches are warm.
STEPS = 5


def box(layers, side, E, begin=0):
    return pm.structures.solid(layers, side, side, 1.0, E=E, origin=(begin, 0.0, 0.0), **MATERIAL)


def subdomain(structure, scheme, substeps):
    load = np.sin(np.arange(structure.n))
    return structure.subdomain(scheme=SCHEMES[scheme], substeps=substeps, force=load)


def measure(scheme, layers, stiff, side, seconds):
    soft, hard = box(layers - stiff, side, 1.0), box(stiff, side, STIFF, layers - stiff)
    E = np.ones((layers, side, side))
    E[layers - stiff :] = STIFF
    uncut = subdomain(box(layers, side, E), scheme, SS)
    a, b = subdomain(soft, scheme, 1), subdomain(hard, scheme, SS)
    tie = pm.tie_coincident({a: soft.points, b: hard.points}, components=3)
    split = pm.Coupler([a, b], tie, dt=DT, threads=1, coupling="pm")
    couplers = [split, *(pm.Coupler([s], dt=DT, threads=1) for s in (a, b, uncut))]
    calls = [partial(c.step, STEPS) for c in couplers]
    ours, of_a, of_b, fine = (x / STEPS for x in in_turn(*calls, rounds=3, seconds=seconds))
    return {
        "schemes": scheme,
        "dofs": uncut.n,
        "stiff share": hard.n / (soft.n + hard.n),
        "constraints": tie.p,
        "subcycled ms": ours * 1e3,
        "uncut at the fine step ms": fine * 1e3,
        "ratio": ours / fine,
        "theoretical ratio": (soft.n + SS * hard.n) / (SS * (soft.n + hard.n)),
        "ratio of the subdomains": (of_a + of_b) / fine,
    }


def rows(quick):
    if quick:
        return [measure("explicit", 4, 1, 1, 0.0)]
    return [
        measure(scheme, layers, stiff, 8, 4.0)
        for scheme in SCHEMES
        for layers, stiff in ((100, 1), (100, 5), (100, 20))
    ]


if __name__ == "__main__":
    run("subcycling", rows, about=__doc__)
