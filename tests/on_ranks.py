"""What each rank does in the tests of couplers in several processes (test_mpi.py).

    mpiexec -n 3 python tests/on_ranks.py NAME

Every rank asserts by itself and prints one line at the end; an assertion that fails ends all.
"""

import sys
import traceback
import warnings

from rank_arguments import arguments
from rank_bitwise import (
    bitwise,
    by_callable,
    chosen,
    drifting,
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
TESTS += (chosen, drifting, histories, iterated, killed, killed_in_save, left, memory, static)

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    name, *options = sys.argv[1:]
    try:
        {test.__name__: test for test in TESTS}[name](*options)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        WORLD.Abort(1)
