"""Paced runs whose process is stopped and continued at random (SIGSTOP, SIGCONT).

A run that stops ends at the first missed step. One that continues gives all of its commands, and
none of them in a burst: within a period the specimen is commanded no further than its limit of
velocity allows, and what it was not commanded for longer is what the schedule was shifted by.
"""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
from campaign import arguments, seeds, tried

PERIOD, STEPS, VELOCITY = 1e-3, 500, 2.0
PROGRAM = f"""
import json, sys
import numpy as np
import pmalpha as pm

def made(limits=None):
    rig = pm.rig.SimulatedActuator(pm.CubicSpring([0], k=400.0, k3=0.0))
    scheme = pm.CentralDifference()
    mass = pm.Subdomain([1.0], None, scheme=scheme, v0=[1.0], restoring=rig, limits=limits)
    return pm.Coupler([mass], dt={PERIOD}, coupling="gc")

made().run_paced({10 * PERIOD}, rate=1e9, on_late="continue")
coupler = made(pm.rig.Limits(velocity={VELOCITY}))
print("ready", flush=True)
try:
    history, end = coupler.run_paced({STEPS * PERIOD}, on_late=sys.argv[1]), ""
except (pm.PacingError, pm.LimitError) as error:
    history, end = coupler.last_history, type(error).__name__
p = history.pacing
numbers = dict(c=p.commanded, begun=p.begun, shift=p.shift, u=history[0].u[1:, 0], missed=p.missed)
print(json.dumps(dict(end=end) | {{name: np.asarray(x).tolist() for name, x in numbers.items()}}))
"""


def stalled_run(rng, on_late):
    """What the program has printed, and the time for which it was stopped, in s."""
    program = [sys.executable, "-c", PROGRAM, on_late]
    stopped = 0.0
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        for _ in range(rng.integers(1, 4)):
            time.sleep(rng.uniform(0.0, 0.2))
            begin = time.monotonic()
            os.kill(process.pid, signal.SIGSTOP)
            time.sleep(rng.choice([0.0005, 0.002, 0.02, 0.2]))
            os.kill(process.pid, signal.SIGCONT)
            stopped += time.monotonic() - begin
        found = json.loads(process.stdout.read())
    assert process.returncode == 0
    return found, stopped


def furthest(c, u):
    """The largest distance between two commands within a period, and the most such commands."""
    first = np.searchsorted(c, c - PERIOD, side="right")
    pieces = [u[j : k + 1] for k, j in enumerate(first)]
    return max(np.ptp(x) for x in pieces), max(x.size for x in pieces)


def attempt(seed, counts):
    rng = np.random.default_rng(seed)
    on_late = ("continue", "stop")[seed % 2]
    found, stopped = stalled_run(rng, on_late)
    c, shift = np.array(found["c"]), np.array(found["shift"])
    counts[f"{on_late}: {found['end'] or 'ran'}"] += 1
    if on_late == "stop":
        assert found["missed"] == (found["end"] == "PacingError")
        assert not np.any(shift)
        return
    assert found["end"] == "" and c.size == STEPS
    distance, most = furthest(c, np.array(found["u"]))
    assert distance <= VELOCITY * PERIOD
    counts["most commands in a period"] = max(counts["most commands in a period"], most)
    gaps, shifts = np.diff(c), np.diff(shift)
    # the schedule is shifted after a stall: in the step that is late, or the one after it
    late = np.flatnonzero(gaps[:-2] > 3.0 * PERIOD)
    assert np.all(shifts[late] + shifts[late + 1] > PERIOD)
    counts["missed"] += found["missed"]
    counts["ms stopped"] += round(1e3 * stopped)
    counts["ms shifted"] += round(1e3 * shift[-1])


def main():
    options = arguments(__doc__.splitlines()[0])
    print(dict(tried(attempt, seeds(options.seed, options.seconds))))


if __name__ == "__main__":
    main()
