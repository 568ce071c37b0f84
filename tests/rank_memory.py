"""What each rank does in the tests of too little memory on one of them."""

from pathlib import Path

import campaign_memory
import numpy as np
from rank_arguments import one_of
from rank_problems import RANK, SIZE, WORLD, chain, plastic, report

import pmalpha as pm
from pmalpha import memory as pmalpha_memory


def memory():
    """An interface matrix for which one rank has no memory, in set-up and in a change of steps.

    It belongs to subdomains of another rank."""
    n = 200
    pmalpha_memory.SMALL = 100_000  # of the matrix, and of nothing else

    def make():
        own = [chain(n, name) for name in "ab"] if RANK == 0 else [chain(3, f"r{RANK}")]
        ties = [pm.tie("a", np.arange(n), "b", np.arange(n)), pm.tie("a", [0], f"r{SIZE - 1}", [0])]
        return pm.Coupler(own, ties, dt=0.01, comm=WORLD, coupling="pm")

    coupler = make()
    coupler.step(3)
    available = pmalpha_memory.available
    for call in (make, lambda: coupler.change_steps(0.007)):

        def short(bad, call=call):
            if bad:
                pmalpha_memory.available = lambda: 1000
            try:
                call()
            finally:
                pmalpha_memory.available = available

        one_of(MemoryError, short, "interface matrix", f"{n + 1} constraints")
    assert (coupler.step_count, coupler.dt) == (3, 0.01)
    coupler.step(3)
    report("memory")


def allocations(folder, stride):
    """Allocations of the extension that fail on one rank, in turn, in all that allocates."""
    library = campaign_memory.failing()
    path = Path(folder) / "state.npz"
    coupler = spread()
    coupler.step(2)
    coupler.save(path)
    calls = spread, lambda: coupler.run(steps=3), lambda: coupler.load(path)
    raised = [fail_in_turn(library, call, int(stride)) for call in calls]
    assert min(raised) > 0, raised
    report("allocations")


def spread():
    """Chains with internal forces, linear and explicit ones, over all ranks."""
    first = np.linspace(0, 5, SIZE + 1).astype(int)
    return plastic("macro", pm.Newton(), None, WORLD, slice(first[RANK], first[RANK + 1]))


def fail_in_turn(library, call, stride):
    """Calls with every `stride`-th allocation of the last rank failing; how often that raised."""
    last, raised, k = SIZE - 1, 0, 1
    while True:
        error = None
        library.failing_allocations_arm(k if RANK == last else 0)
        try:
            call()
        except (MemoryError, pm.PmalphaError) as found:
            error = found
        failed = WORLD.bcast(library.failing_allocations_arm(0), last)
        assert len(set(WORLD.allgather(error is None))) == 1
        if error is not None:
            raised += 1
            assert isinstance(error, MemoryError if RANK == last else pm.PmalphaError), repr(error)
            assert RANK == last or f"rank {last}: " in str(error), error
            assert RANK == last or "MemoryError" in str(error), error
        if failed < k:
            return raised
        k += stride
