"""What each rank does in the tests of couplers in several processes (test_mpi.py).

    mpiexec -n 3 python tests/on_ranks.py NAME [OPTIONS] [+ NAME [OPTIONS]] ...

Every rank asserts by itself and prints a line at the end of each, and the first one "end of NAME".
An assertion that fails ends all.
"""

import sys
import traceback
import warnings

from rank_arguments import arguments
from rank_bitwise import (
    bitwise,
    by_callable,
    chosen,
    explicit,
    fed,
    interpolated,
    iterated,
    static,
)
from rank_failures import failures
from rank_files import checkpoints, files, killed, killed_in_save, left
from rank_histories import histories
from rank_memory import allocations, memory
from rank_problems import WORLD

TESTS = (
    allocations,
    arguments,
    bitwise,
    by_callable,
    checkpoints,
    explicit,
    failures,
    fed,
    files,
    interpolated,
)
TESTS += (chosen, histories, iterated, killed, killed_in_save, left, memory, static)


def calls(words):
    """Name and options of each."""
    rest = list(words)
    while rest:
        end = rest.index("+") if "+" in rest else len(rest)
        yield rest[0], rest[1:end]
        rest = rest[end + 1 :]


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    try:
        for name, options in calls(sys.argv[1:]):
            {test.__name__: test for test in TESTS}[name](*options)
            if WORLD.rank == 0:
                print("end of", name, flush=True)
    except BaseException as error:
        # the last line is what pytest shows: which test, on which rank, what differs
        traceback.print_exc()
        print(f"{name} on rank {WORLD.rank}: {type(error).__name__}: {error}", file=sys.stderr)
        sys.stderr.flush()
        WORLD.Abort(1)
