"""Random problems and a checksum of each result: are two versions bitwise identical?

    export PYTHONPATH=tests
    python benchmarks/surveys/bitwise.py 1000 > before.txt   # with one version installed
    python benchmarks/surveys/bitwise.py 1000 > after.txt    # with the other
    diff before.txt after.txt

A line is the seed and a SHA-256 of every array, or the error, with one thread and with three, and
the features of the problem (tests/problems.py). Not a test: it shows that two versions differ, not
which one is right.
"""

import argparse
import hashlib
import warnings

import numpy as np
from problems import STEPS, draw
from relations import results_of


def digest(problem, **options):
    """Of what a run records, or of its error."""
    seen = hashlib.sha256()
    try:
        history = problem.couple(**options).run(steps=STEPS, energy=True)
        for name, values in sorted(results_of(history).items()):
            seen.update(str(name).encode() + values.tobytes())
    except Exception as error:  # of any kind: it is compared
        seen.update(f"{type(error).__name__}: {error}".encode())
    return seen.hexdigest()[:16]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=int)
    parser.add_argument("--first", type=int, default=0)
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    for seed in range(chosen.first, chosen.first + chosen.problems):
        problem = draw(np.random.default_rng(seed))
        digests = digest(problem), digest(problem, threads=3)
        print(seed, *digests, *sorted(problem.features()), sep="; ", flush=True)


if __name__ == "__main__":
    main()
