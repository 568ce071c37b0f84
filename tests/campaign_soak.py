"""Long use: millions of macro steps with constant memory and exact times.

Couplers of every coupling step on and on, with callbacks, springs, Newton's method and threads; now
and then they run with a History, in memory or in a file, run several cases, are saved and loaded,
restored from snapshots. The largest memory of
the process after the first tenth of the time must not grow; time levels are those of whole numbers.
"""

import gc
import resource
import tempfile
import weakref
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from time import monotonic

import numpy as np
from campaign import arguments

import pmalpha as pm

K3 = np.array([[4.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 2.0]])
KINDS = ("pm", "gc", "macro", "mean", "callbacks", "newton")
HDF5 = find_spec("h5py") is not None
# Growth of the largest memory that is allowed: buffers of the allocator, not a byte per step.
SLACK = 4 << 20


def made(kind):
    """A coupler; its callbacks refer to it."""
    this = []
    here = kind == "callbacks"
    scheme = pm.Newmark() if kind == "mean" else pm.GeneralizedAlpha(0.8)  # it grows with damping
    common = {"scheme": scheme, "u0": [1.0, 0.5, 0.2]}
    force = (lambda t: np.full(3, np.sin(t) + 0.0 * len(this))) if here else None
    internal = pm.CubicSpring([0], k=1.0, k3=0.5) if kind == "newton" else None
    a = pm.Subdomain(np.ones(3), K3, C=0.01 * K3, force=force, name="a", **common)
    restoring = (lambda t, u, v: 0.1 * np.tanh(u)) if here else None
    own = {"substeps": 2, "u0": [0.2, 0.0], "scheme": scheme, "name": "b"}
    b = pm.Subdomain(np.ones(2), [3.0, 3.0], restoring=restoring, internal=internal, **own)
    coupling = {"callbacks": "pm", "newton": "gc"}.get(kind, kind)
    coupler = pm.Coupler([a, b], pm.tie(a, [2], b, [0]), dt=0.01, coupling=coupling, threads=2)
    this.append(coupler)
    return coupler


def use(coupler, folder, counts, steps):
    """This number of steps, a multiple of 40, and each of the other calls once."""
    path = folder / "state.npz"
    coupler.step(steps)
    coupler.save(path)
    few = steps // 4
    history = coupler.run(steps=few, energy=True, every=10)
    assert history.macro_times[-1] == coupler.time == coupler.step_count * 0.01
    coupler.load(path)
    kept = coupler.snapshot()
    coupler.step(few)
    coupler.restore(kept)
    assert np.isfinite(coupler.state("a").u).all()
    counts["macro steps"] += steps + 2 * few
    counts["calls"] += 8
    cases = [{"u0": {"a": [0.1 * k, 0.0, 0.0], "b": [0.0, 0.0]}} for k in range(5)]
    histories = coupler.run_each(cases, steps=few, record={"b": [0]})
    assert [h.macro_times[-1] for h in histories] == 5 * [few * 0.01]
    counts["macro steps"] += 5 * few
    counts["calls"] += 1
    if HDF5:
        path = folder / "run.h5"
        u = coupler.run(steps=few, record_to=path, overwrite=True)["b"].u
        assert u.shape == (2 * few + 1, 2)
        assert pm.History.load(path).macro_times[-1] == coupler.time
        counts["macro steps"] += few
        counts["calls"] += 2


def largest():
    """Bytes of the largest memory that the process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def campaign(seconds=600.0, least=10, steps=2000):
    """Counts; `least` rounds of `steps` and more at least. AssertionError where something grows."""
    counts, begin, at_first = Counter(), monotonic(), None
    couplers = {kind: made(kind) for kind in KINDS}
    with tempfile.TemporaryDirectory() as folder:
        while monotonic() < begin + seconds or counts["rounds"] < least:
            for kind in KINDS:
                use(couplers[kind], Path(folder), counts, steps)
                new = made(kind)
                gone = weakref.ref(new)
                new.step()
                del new
                gc.collect()
                assert gone() is None, f"a coupler of {kind} is not collected"
                counts["couplers"] += 1
            counts["rounds"] += 1
            if at_first is None and counts["rounds"] >= 3 and monotonic() > begin + 0.1 * seconds:
                at_first = largest()
    counts["bytes grown"] = largest() - (at_first or largest())
    assert counts["bytes grown"] < SLACK, dict(counts)
    counts["longest run, macro steps"] = max(c.step_count for c in couplers.values())
    return dict(counts)


if __name__ == "__main__":
    given = arguments(__doc__, seconds=600.0)
    print(campaign(given.seconds))
