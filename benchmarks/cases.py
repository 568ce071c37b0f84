"""Eight load cases by Coupler.run_each, side by side, over one case by reset and run.

Only the ends are recorded, so that the steps alone count; and a study of many records on the small
frame with springs of notebooks/fragility.ipynb, with everything recorded.
"""

import numpy as np
from step_profile import PROBLEMS
from timing import in_turn, run

import pmalpha as pm

LANES = 8
# Macro steps of a run.
STEPS = {
    "four dofs, ss = 20": 4000,
    "chain, n = 1000": 4000,
    "plates 49x9": 200,
    "hex8, n = 29 106": 40,
    "hex8 + explicit, one face": 40,
}
RECORDS, DT, DURATION = 16, 0.01, 12.0


def cases_row(name, steps, rounds):
    coupler = PROBLEMS[name]()
    ends = {"record": {}, "every": steps}

    def one():
        coupler.reset()
        coupler.run(steps=steps, **ends)

    def eight():
        coupler.run_each([{}] * LANES, steps=steps, **ends)

    alone, together = in_turn(one, eight, rounds=rounds)
    return row(name, alone / steps, together / steps)


def row(name, alone, together):
    return {
        "problem": name,
        "one, us a macro step": 1e6 * alone,
        "eight, us a macro step": 1e6 * together,
        "eight over one": together / alone,
        "gain": LANES * alone / together,
    }


def frame():
    """The frame of three storeys of notebooks/fragility.ipynb."""
    m, k = np.array([2e3, 20e3, 20e3]), np.array([40e6, 30e6, 20e6])
    fy, C = np.array([150e3, 120e3, 80e3]), 3e-3
    lower = pm.Subdomain(
        [18e3],
        None,
        C=[C * k[0]],
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=5,
        restoring=pm.Bilinear([0], k=k[0], fy=fy[0], hardening=0.05),
        name="lower",
    )
    upper = pm.Subdomain(
        m,
        None,
        C=C * pm.models.shear_frame(m, [0.0, *k[1:]])[1],
        scheme=pm.GeneralizedAlpha(0.8),
        double_step=True,
        restoring=pm.BoucWen([(1, 0), (2, 1)], k=k[1:], fy=fy[1:], hardening=0.05),
        name="upper",
    )
    return pm.Coupler(
        [lower, upper], pm.tie(upper, [0], lower, [0]), dt=DT, threads=1, coupling="pm"
    )


def study_row(count, rounds):
    """Records with everything that a call does for each: reset, History, judgement of the steps."""
    coupler, steps = frame(), round(DURATION / DT)
    records = 3.0 * np.random.default_rng(1).standard_normal((count, steps + 1))
    cases = [
        {
            "force": {
                "lower": pm.BaseAcceleration(x, [1.0], [18e3], dt=DT),
                "upper": pm.BaseAcceleration(x, np.ones(3), [2e3, 20e3, 20e3], dt=DT),
            }
        }
        for x in records
    ]

    def one_by_one():
        for case in cases:
            coupler.reset(**case)
            coupler.run(DURATION)

    alone, together = in_turn(one_by_one, lambda: coupler.run_each(cases, DURATION), rounds=rounds)
    each = count * steps
    return row("frame with springs, all recorded", alone / each, LANES * together / each)


def rows(quick):
    rounds, count = (1, LANES) if quick else (7, RECORDS)
    names = ["four dofs, ss = 20"] if quick else STEPS
    return [
        *(cases_row(name, 20 if quick else STEPS[name], rounds) for name in names),
        study_row(count, rounds),
    ]


if __name__ == "__main__":
    run("cases", rows, about=__doc__)
