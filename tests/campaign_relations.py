"""Relations between runs that hold whatever the numbers, on random problems: relations.py.

It also counts the pairs of runs that were compared.
"""

from itertools import islice

import relations
from campaign import arguments, seeds, tried


def attempt(seed, counts):
    compare, pairs = relations.require_equal, set()

    def counted(relation, *others):
        pairs.add(relation)
        compare(relation, *others)

    relations.require_equal = counted
    try:
        relations.attempt(seed, counts)
    finally:
        relations.require_equal = compare
    counts["pairs"] += len(pairs)


if __name__ == "__main__":
    given = arguments(__doc__, cases=int)
    numbers = islice(seeds(given.seed, given.seconds), given.cases)
    print(dict(sorted(tried(attempt, numbers).items())))
