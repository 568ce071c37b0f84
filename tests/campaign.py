"""What the campaigns that look for faults share: ``python tests/campaign_x.py --seconds 600``.

Each prints what it tried; a failure names the seed that repeats it. test_campaigns.py has a short
form of each.
"""

import argparse
from collections import Counter
from time import monotonic


def arguments(what, seconds=60.0, **others):
    """The parsed command line: `seed` and `seconds`, and others by their types."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=seconds, help="how long to try")
    for name, kind in others.items():
        parser.add_argument(f"--{name}", type=kind)
    return parser.parse_args()


def seeds(first, seconds):
    """Seeds from `first` on, until the time is over."""
    end, seed = monotonic() + seconds, first
    while monotonic() < end:
        yield seed
        seed += 1


def tried(attempt, numbers):
    """Counts of what ``attempt(seed, counts)`` tried; an exception names the seed."""
    counts = Counter()
    for seed in numbers:
        try:
            attempt(seed, counts)
        except Exception as error:
            raise AssertionError(f"seed {seed} fails") from error
    return counts
