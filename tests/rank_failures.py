"""What each rank does in the tests of failures in a run."""

import ctypes
import os
import signal

import numpy as np
from rank_problems import COUPLINGS, RANK, SIZE, WORLD, chain, report, same, ties
from scipy import LowLevelCallable

import pmalpha as pm


class Broken(Exception):
    """Raised by a function of the user's."""


def expect(kind, *words):
    """What the rank that failed raises, and what the others do."""

    def check(error, failed):
        if RANK != failed and not issubclass(kind, pm.PmalphaError):
            assert type(error) is pm.PmalphaError, repr(error)
        else:
            assert type(error) is kind, repr(error)
        if RANK != failed:
            assert f"rank {failed}" in str(error), str(error)
        assert all(word in str(error) for word in words if RANK == failed or word[0] != "-"), error

    return check


def on_all(kind):
    """What all ranks find and raise by themselves."""

    def check(error, failed):
        assert type(error) is kind and f"'r{failed}'" in str(error), repr(error)

    return check


def fails_in(make, check, failed, coupling, step=None, **more):
    """A run of 400 steps that `make(failed)` ends; all ranks are at the same step, and go on."""
    options = dict(dt=0.01, coupling=coupling, comm=WORLD, **more)
    fine = {r: 4 if r == 0 else 1 for r in range(SIZE)}[RANK]
    broken = make(RANK == failed)
    coupler = pm.Coupler([chain(3, f"r{RANK}", substeps=fine, **broken)], ties(), **options)
    try:
        coupler.run(steps=400)
    except BaseException as error:
        check(error, failed)
    else:
        raise AssertionError("no error")
    done = WORLD.allgather(coupler.step_count)
    assert len(set(done)) == 1, done
    if step is not None:
        assert done[0] == step, done
    history = coupler.last_history
    assert history.macro_times.size == done[0] + 1, (history.macro_times.size, done)
    everyone = WORLD.allgather(history.multipliers)
    assert all(np.array_equal(everyone[0], other) for other in everyone)
    return coupler, done[0]


LOAD = "int (double, intptr_t, double *, void *)"


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, ctypes.c_ssize_t, ctypes.c_void_p, ctypes.c_void_p)
def fails_after(t, n, F, user):
    return 7 if t > 0.1234 else 0


class Counted:
    """A function of the user's that fails in one of its calls, or from then on."""

    def __init__(self, active, last, happens, value, once=True):
        self.active, self.last, self.happens, self.value = active, last, happens, value
        self.calls, self.once = 0, once

    def __call__(self, t, *motion):
        self.calls += 1
        if self.active and t > self.last:
            self.active = not self.once
            return self.happens()
        return self.value


def broken():
    raise Broken("the load is missing")


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    return np.zeros(3)


def load(failed, coupling):
    """An exception of a load, which is evaluated ahead."""

    def make(active):
        return {"force": Counted(active, 0.1234, broken, np.ones(3))}

    # times of the failure: the first substep that ends after 0.1234
    fails_in(make, expect(Broken, "the load is missing"), failed, coupling, step=12)


def restoring(failed, coupling):
    """An exception in the middle of a step."""
    if coupling == "mean":
        return

    def make(active):
        return {"restoring": Counted(active, 0.1234, broken, np.zeros(3))}

    coupler, step = fails_in(make, expect(Broken, "the load is missing"), failed, coupling, step=12)
    rest = coupler.run(steps=28)  # it goes on, and bitwise as without the failure
    alone = pm.Coupler(
        [
            chain(3, f"r{r}", substeps=4 if r == 0 else 1, restoring=lambda t, u, v: np.zeros(3))
            for r in range(SIZE)
        ],
        ties(),
        dt=0.01,
        coupling=coupling,
    )
    alone.step(step)
    same(rest, alone.run(steps=28), [f"r{RANK}"])


def internal(failed, coupling):
    """The same of internal forces, which are iterated or not, and of what they return."""
    shoots = coupling in ("macro", "mean")
    zero = np.zeros((3, 3))

    def wrong(active):
        def force(t, u, v, q):  # with a tangent that is far too small
            k = 1e9 if active and t > 0.1234 else 0.0
            return k * (u + 1.0), zero, zero

        return {"internal": force}

    def fails(happens, check, explicit=False):
        def make(active):
            force = Counted(active, 0.1234, happens, (np.zeros(3), zero, zero), once=False)
            return {"internal": force, "scheme": pm.GeneralizedAlpha(0.8, explicit=explicit)}

        fails_in(make, check, failed, coupling, step=12)

    for explicit in (True, False):
        fails(broken, expect(Broken, "the load is missing"), explicit)
        nan = np.full(3, np.nan), zero, zero
        kind = pm.InstabilityError if explicit else pm.ConvergenceError
        # of explicit ones all ranks find it in the interface problem of a fine step
        everywhere = explicit and not shoots
        fails(lambda nan=nan: nan, on_all(kind) if everywhere else expect(kind), explicit)
    softening = np.zeros(3), -1e25 * np.ones((3, 3)), zero  # too large for the mass to be seen
    fails(lambda: softening, expect(pm.ConvergenceError, "is singular but for rounding"))

    def check(error, failed):  # names the subdomain with the largest correction, as one process
        assert type(error) is pm.ConvergenceError, repr(error)
        texts = WORLD.allgather(str(error).rpartition("Newton's")[2])
        assert len(set(texts)) == 1 and "did not converge" in texts[0], texts

    few = pm.Newton(iterations=4)  # more are enough for a subdomain alone
    fails_in(wrong, check, failed, coupling, step=12, newton=few)

    def interrupted():
        interrupt()
        return np.zeros(3), zero, zero

    def interrupts(active):
        return {"internal": Counted(active, 0.1234, interrupted, (np.zeros(3), zero, zero))}

    fails_in(interrupts, expect(KeyboardInterrupt), failed, coupling)


def chosen_substeps(failed, coupling):
    """An exception in a run that chooses substeps, and in static equilibrium."""
    if coupling != "gc":
        return
    zero = np.zeros((3, 3))
    force = Counted(False, 0.1234, broken, (np.zeros(3), zero, zero), once=False)
    own = chain(3, f"r{RANK}", internal=force)
    coupler = pm.Coupler([own], ties(), dt=0.01, coupling="gc", comm=WORLD)
    force.active = RANK == failed
    check = expect(Broken, "the load is missing")
    for last, call in ((0.1234, lambda: coupler.run(4.0, tolerance=1.0)), (-1.0, coupler.static)):
        force.last = last
        try:
            call()
        except Exception as error:
            check(error, failed)
        else:
            raise AssertionError("no error")
        assert set(WORLD.allgather(coupler.step_count)) == {12}


def ctrl_c(failed, coupling):
    def make(active):
        return {"force": Counted(active, 0.1234, interrupt, np.ones(3))}

    fails_in(make, expect(KeyboardInterrupt), failed, coupling)


def not_a_number(failed, coupling):
    def make(active):
        def nan():
            return np.full(3, np.nan)

        return {"force": Counted(active, 0.1234, nan, np.ones(3))}

    fails_in(make, expect(ValueError, "must be finite"), failed, coupling, step=12)


def unstable(failed, coupling):
    """A subdomain that explodes at one rank."""
    if coupling in ("macro", "mean"):
        return  # its interface matrix is then indefinite from the beginning

    def make(active):
        scheme = pm.GeneralizedAlpha(0.8, explicit=True)
        return {"scheme": scheme, "k": 1e7 if active else 100.0}

    coupler, step = fails_in(make, on_all(pm.InstabilityError), failed, coupling)
    assert 1 < step < 400


def beside(failed, coupling):
    """States that overflow in a double-step subdomain, beside the fine steps; a compiled load.

    The load is known ahead, so that the step is opened while the macro step before is computed.
    """
    if coupling != "pm":
        return
    pushes = np.zeros((100, 3))
    pushes[13:] = [1.7e308, -1.7e308, 0.0]
    kinds = [(pushes, on_all(pm.InstabilityError)), (None, expect(pm.CallbackError, "7"))]
    steps = []
    for samples, check in kinds:
        compiled = LowLevelCallable(fails_after, signature=LOAD) if samples is None else None

        def make(active, samples=samples, compiled=compiled):
            return {"force": (compiled or pm.SampledForce(samples, 0.01)) if active else np.ones(3)}

        for threads in (1, 2):
            steps.append(fails_in(make, check, failed, coupling, threads=threads)[1])
    assert steps[0] == steps[1] and steps[2:] == [12, 12], steps


FAILURES = (load, restoring, internal, chosen_substeps, ctrl_c, not_a_number, unstable, beside)


def failures(*options):
    count = 0
    for coupling in options or COUPLINGS:
        for failure in FAILURES:
            for failed in range(SIZE) if SIZE < 3 else [1]:
                failure(failed, coupling)
                WORLD.Barrier()
                count += 1
    report(count, "failures")
