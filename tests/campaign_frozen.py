"""Damaged frozen models and states, which the C library takes or refuses, under the sanitizers.

Bytes, words, parts of the tree and ends are changed by frozen_fuzz.c; or one number of the file, or
of a state that was saved, with the check sum made right. It prints how many copies were opened or
restored, and how many of these stepped. A report of a sanitizer, a crash, a copy that takes more
than 120 s, or memory beyond what SECURITY.md promises ends it with the seed.
"""

import subprocess
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from campaign import arguments, seeds
from counted import COUNTING, counting
from frozen_couplers import COUPLINGS, SPRINGS, all_outputs, bouncing, frame, full, iterated

import pmalpha as pm

ROOT = Path(__file__).parent.parent
PROGRAM = ROOT / "build" / "frozen_fuzz"
COPIES = 200
LONGEST = 300  # s, of a process that tries COPIES; frozen_fuzz gives each one 120
KINDS = ("bytes", "numbers", "states")


def hybrid():
    return frame(
        "pm",
        "cubic",
        restoring=pm.rig.External([1]),
        velocity=pm.SampledForce([0.0, 0.0, 0.1], 0.01),
        limits=pm.rig.Limits(displacement=1.0, velocity=50.0),
    )


def models(folder):
    """The files of models of every kind."""
    made = {
        f"{c} {s}": frame(c, s) for c in COUPLINGS for s in SPRINGS if c != "mean" or s == "none"
    }
    made |= {"contact": bouncing(), "iterated": iterated("gc"), "shooting": iterated("macro")}
    made["kept tangents"] = iterated("gc", newton=pm.Newton(tangent="reuse"))
    made["panels"] = full("gc", 36, 17)  # tangents and the interface matrix in panels
    load = pm.SampledForce(np.ones((9, 1)), 0.01, np.array([1.0, 2.0, 3.0]))
    made["loads"] = frame("gc", force=[load, np.ones(3)])
    made |= {kind: counting(restoring) for kind, (restoring, _) in COUNTING.items()}
    inputs = {"column": ("specimen", "a", 1), "wind": ("force", "a", 2), "table": ("velocity", 1)}
    for name, coupler in made.items():
        coupler.freeze(folder / f"{name}.pma", outputs=all_outputs(coupler))
        yield folder / f"{name}.pma"
    coupler = hybrid()
    coupler.freeze(folder / "hybrid.pma", inputs, all_outputs(coupler))
    yield folder / "hybrid.pma"


def built():
    subprocess.run(["make", "-s", "-C", ROOT, "build/frozen_fuzz"], check=True)


def attempt(kind, path, seed, copies, counts):
    words = [str(PROGRAM), kind, str(path), str(seed), str(copies)]
    run = subprocess.run(
        words, capture_output=True, text=True, errors="replace", timeout=LONGEST + copies
    )
    if run.returncode != 0:
        raise AssertionError(
            f"{kind}, {path.stem}: {run.stderr[run.stderr.rfind('seed') :][:3000]}"
        )
    opened, stepped, by_size = map(int, run.stdout.split())
    counts.update({f"{kind}: copies": copies, f"{kind}: opened": opened})
    counts[f"{kind}: stepped"] += stepped
    counts["most memory by size"] = max(counts["most memory by size"], by_size)


def campaign(numbers, copies=COPIES, kinds=KINDS):
    counts = Counter()
    built()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        paths = list(models(Path(folder)))
        counts["models"] = len(paths)
        for k in numbers:
            for kind in kinds:
                for path in paths:
                    attempt(kind, path, k * copies, copies, counts)
    return counts


if __name__ == "__main__":
    words = arguments(__doc__)
    print(dict(campaign(seeds(words.seed, words.seconds))))
