"""Random problems of everything (problems.py) and all relations between their runs (relations.py).

A failure is the program of the smallest problem that fails. With ``--keep 1`` it goes on and prints
each kind of failure once. With ``--some 1`` each problem has one relation: most problems a second.
"""

from collections import Counter

import numpy as np
import relations
from campaign import arguments, seeds

SOME = 7  # relations of a problem


def campaign(numbers, keep=False, some=SOME):
    counts, found = Counter(), set()
    for seed in numbers:
        names = np.random.default_rng(seed).permutation(list(relations.RELATIONS))[:some]
        try:
            counts += relations.reported(relations.drawn(seed), [str(name) for name in names])
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
    given = arguments(__doc__, keep=int, some=int)
    counts = campaign(seeds(given.seed, given.seconds), bool(given.keep), given.some or SOME)
    print(dict(sorted(counts.items())))
