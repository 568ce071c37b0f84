"""What the watch of energy costs: runs with springs, with the watch and without.

Eight dofs with a cubic spring at each, alone and tied at one dof to eight linear dofs, with and
without substeps, under "gc" and "macro", from `Coupler.run` with nothing recorded.
"""

import warnings
from unittest import mock

import numpy as np
from timing import in_turn, run
from uncoupled import chain

import pmalpha as pm
from pmalpha.setup import member

N = 8


def sprung(**options):
    springs = pm.CubicSpring(range(N), 1.0, 0.1)
    scheme = pm.GeneralizedAlpha(0.8)
    return pm.Subdomain(
        np.ones(N), chain(N), scheme=scheme, restoring=springs, u0=np.ones(N), **options
    )


def alone(coupling, substeps):
    return pm.Coupler([sprung(substeps=substeps)], dt=0.1 * substeps, coupling=coupling, threads=1)


def tied(coupling, substeps):
    linear = pm.Subdomain(
        np.ones(N), chain(N), scheme=pm.GeneralizedAlpha(0.8), u0=np.ones(N), name="linear"
    )
    parts = [sprung(substeps=substeps, name="sprung"), linear]
    constraints = [pm.tie(parts[0], [0], parts[1], [0])]
    return pm.Coupler(parts, constraints, dt=0.1 * substeps, coupling=coupling, threads=1)


PROBLEMS = {
    (make.__name__, coupling, substeps): make
    for make in (alone, tied)
    for coupling in ("gc", "macro")
    for substeps in (1, 10)
}


def with_and_without(make, *arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)  # macro coupling with springs
        watched = make(*arguments)
        with mock.patch.object(member, "_watch", lambda _: None):
            return watched, make(*arguments)


def rows(quick):
    found = []
    for (name, coupling, substeps), make in PROBLEMS.items():
        couplers = with_and_without(make, coupling, substeps)
        steps = 100 if quick else 4000 // substeps
        calls = [lambda c=c, n=steps: c.run(steps=n, record={}) for c in couplers]
        watched, plain = in_turn(*calls, seconds=0.0 if quick else 3.0)
        row = {"problem": name, "coupling": coupling, "substeps": substeps, "steps": steps}
        row |= {"ms": 1e3 * watched, "ms without": 1e3 * plain}
        found.append(row | {"share of the watch": 1.0 - plain / watched})
    return found


if __name__ == "__main__":
    run("watched", rows, about=__doc__)
