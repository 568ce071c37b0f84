"""Relations between runs that hold whatever the numbers, on random problems: relations.py."""

from itertools import islice

from campaign import arguments, seeds, tried
from relations import attempt

if __name__ == "__main__":
    given = arguments(__doc__, cases=int)
    numbers = islice(seeds(given.seed, given.seconds), given.cases)
    print(dict(sorted(tried(attempt, numbers).items())))
