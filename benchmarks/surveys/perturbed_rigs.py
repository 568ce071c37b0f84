"""True J1 to J9 of the benchmark of 2020 on its nominal plant and on twenty perturbed ones.

    export PYTHONPATH=tests
    python benchmarks/surveys/perturbed_rigs.py [model] [feedback] [learning] [--cases 1 2 3 4]

El Centro of the package times 0.4, all of it, with 5 s of rest before and after, and the noise of
the sensors. Each plant of each case is a run of 209 000 steps, a second; the rows are written to
benchmarks/results/perturbed_rigs.csv.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from rig_benchmark import DT, VALUES, actuator, criteria, run
from rig_reference import CASES, DRAWN, FORCE_NOISE, NOISE, H, Plant, ground, perturbed

from pmalpha import rig

sys.path.append(str(Path(__file__).parents[1]))
from timing import report

REST = 5.0
RECORD = ground(VALUES, DT, DT * len(VALUES) + 2.0 * REST, REST)
METHODS = {
    "model": {},
    "feedback": {"feedback": 10.0},
    "learning": {"variations": 0.03, "sigma": 1e-4},
}


def true_criteria(case, method, plant, seed):
    """J1 to J9 with the displacement of the plant without its noise."""
    noisy = actuator(plant, noise=NOISE, force_noise=FORCE_NOISE, seed=seed)
    device = rig.Compensated(noisy, method="model", model=actuator(), **METHODS[method])
    history = run(case, device, plant, RECORD)
    true = actuator(plant).respond(history.rig.sent[:, 0], H).measured
    return criteria(case, history, RECORD, true)


def rows_of(case, method):
    """Of the nominal plant, and mean and worst of the perturbed ones."""
    nominal = true_criteria(case, method, Plant(), 1)
    drawn = np.array([true_criteria(case, method, perturbed(i), 2 + i) for i in range(len(DRAWN))])
    table = {"nominal": nominal, "mean of 20": drawn.mean(axis=0), "worst of 20": drawn.max(axis=0)}
    return [
        {"case": case, "method": method, "plants": plants}
        | {f"J{k + 1}": float(x) for k, x in enumerate(J)}
        for plants, J in table.items()
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("methods", nargs="*", default=list(METHODS), help=" ".join(METHODS))
    parser.add_argument("--cases", nargs="*", type=int, default=list(CASES))
    given = parser.parse_args()
    rows = []
    for case in given.cases:
        for method in given.methods:
            rows += rows_of(case, method)
            report("perturbed_rigs", rows)
