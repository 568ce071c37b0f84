"""What a run does beyond its steps: everything recorded, every hundredth level, nothing.

Eight dofs alone, and the four-dof example with twenty substeps, from `Coupler.run` and
`Coupler.step`; the first rows with another run each, so that set-up counts.
"""

import numpy as np
from timing import in_turn, run
from uncoupled import chain

import pmalpha as pm

EVERY = 100


def eight_dofs(restoring=None):
    alone = pm.Subdomain(
        np.ones(8), chain(8), scheme=pm.GeneralizedAlpha(0.8), restoring=restoring, u0=np.ones(8)
    )
    return pm.Coupler([alone], dt=0.1, threads=1)


def four_dofs():
    return pm.models.four_dof(rho=0.5).coupler(1.0 / 40.0 / 0.47, coupling="pm", threads=1)


PROBLEMS = {
    "eight dofs": (eight_dofs, 4000),
    "eight dofs with springs": (lambda: eight_dofs(pm.CubicSpring(range(8), 1.0, 0.1)), 4000),
    "four dofs, ss = 20": (four_dofs, 4000),
}


def rows(quick):
    found = []
    for name, (make, steps) in PROBLEMS.items():
        coupler, steps = make(), EVERY if quick else steps
        calls = {
            "step": lambda c=coupler, n=steps: c.step(n),
            "run, nothing recorded": lambda c=coupler, n=steps: c.run(steps=n, record={}),
            "run, every 100th level": lambda c=coupler, n=steps: c.run(steps=n, every=EVERY),
            "run, all recorded": lambda c=coupler, n=steps: c.run(steps=n),
        }
        times = in_turn(*calls.values(), seconds=0.0 if quick else 3.0)
        for what, t in zip(calls, times):
            row = {"problem": name, "steps": steps, "what": what, "ms": 1e3 * t}
            found.append(row | {"over step": t / times[0]})
    return found


if __name__ == "__main__":
    run("recorded", rows, about=__doc__)
