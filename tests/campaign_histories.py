"""Random histories of calls of a coupler, against an undisturbed twin: test_histories.py."""

import warnings

from campaign import arguments, seeds, tried
from test_histories import attempt

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    given = arguments(__doc__)
    print(dict(sorted(tried(attempt, seeds(given.seed, given.seconds)).items())))
