"""What runs warn of: nothing where they are sound, and of each gain of energy above a tenth.

    export PYTHONPATH=tests
    python benchmarks/surveys/warned_runs.py [--first 0] [--count 100] [KIND ...]

KIND: sound, realistic, thrown or grown, problems of tests/watched_runs.py. Of sound and realistic
ones each warning is printed, but for those of set-up that state a coupled step that grows: they are
counted. Of thrown masses, and of chains with forces that are too stiff, cut and with double steps,
those are printed that gain more than a tenth in silence.
"""

import argparse
import warnings
from collections import Counter

import watched_runs

import pmalpha as pm


def quiet(make, seeds):
    """Prints the warnings of runs that should have none."""
    found = Counter()
    for seed in seeds:
        run = make(seed)
        try:
            before, during = run.warned()
        except (pm.InstabilityError, pm.ConvergenceError) as error:
            found[type(error).__name__] += 1
            print(f"{seed} {run.kind}: {error}", flush=True)
            continue
        found["runs"] += 1
        found["warned by set-up"] += bool(before)
        found["warned by the run"] += bool(during)
        for category, text in before + during:
            print(f"{seed} {run.kind}: {category.__name__}: {text}", flush=True)
    return dict(found)


def announced(make, seeds):
    """How many gains there are by size, and how many were announced."""
    found = Counter()
    for seed in seeds:
        run, gain_of = make(seed)
        coupler = run.make()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                history = coupler.run(steps=run.steps)
            except (pm.InstabilityError, pm.ConvergenceError) as error:
                found[type(error).__name__] += 1
                continue
        gain = gain_of(history)
        words = [x for x in caught if x.category is pm.StabilityWarning]
        size = "above a tenth" if gain > 0.1 else "below"
        found[f"{size}, {'announced' if words else 'silent'}"] += 1
        if gain > 0.1 and not words or gain < 0.02 and words:
            print(
                f"{seed} {run.kind}: gain {gain:.3g}, {'warned' if words else 'silent'}", flush=True
            )
    return dict(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=["sound", "realistic", "thrown"])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=100)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.count)
    for kind in arguments.kinds:
        make = getattr(watched_runs, kind)
        found = announced(make, seeds) if kind in ("thrown", "grown") else quiet(make, seeds)
        print(f"{kind}: {found}")


if __name__ == "__main__":
    main()
