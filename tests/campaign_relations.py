"""Random problems of everything (problems.py) and all relations between their runs (relations.py).

A failure is the program of the smallest problem that fails. With ``--keep`` it goes on and prints
each kind of failure once.
"""

from collections import Counter

import relations
from campaign import arguments, seeds


def campaign(numbers, keep=False):
    counts, found = Counter(), set()
    for seed in numbers:
        try:
            counts += relations.reported(relations.drawn(seed))
        except AssertionError as error:
            if not keep:
                raise AssertionError(f"seed {seed}: {error}") from None
            counts["failures"] += 1
            kind = str(error).split("\n")[0][:60]
            if kind not in found:
                print(f"seed {seed}: {error}\n", flush=True)
                found.add(kind)
    return counts


if __name__ == "__main__":
    given = arguments(__doc__, keep=int)
    counts = campaign(seeds(given.seed, given.seconds), bool(given.keep))
    print(dict(sorted(counts.items())))
