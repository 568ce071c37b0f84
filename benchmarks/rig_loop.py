"""A loop with a servo-hydraulic rig at 4096 Hz: what specimen and compensation cost in a step, and
which numerical parts keep the rate, with "gc", and with "pm" on one and two threads.

A specimen costs processor time. A tower is paced at the rate, with SCHED_FIFO where it is allowed:
of the four fine steps of a macro step, in which its own step is taken, the slowest has to be
shorter than the period; each is the median of its durations by the clock.
"""

import warnings

import numpy as np
import scipy.sparse as sp
from pacing import PRIORITY, make_workers, paced
from timing import in_turn, run

import pmalpha as pm
from pmalpha import rig

H = 1.0 / 4096.0
RATIO = 4  # fine steps in a macro step of a tower
TOWERS = ("gc", 1), ("pm", 1), ("pm", 2)  # coupling, threads
STIFFNESS = 1.19e6
NOISE = {"noise": 16e-6, "force_noise": 2.18, "seed": 1}


def plant(**options):
    return rig.servo_hydraulic(mass=29.13, stiffness=STIFFNESS, damping=114.2209, **options)


def specimens():
    model = {"method": "model", "model": plant()}
    return {
        "spring": pm.CubicSpring([0], k=STIFFNESS, k3=0.0),
        "plant": plant(),
        "plant, noise": plant(**NOISE),
        "model": rig.Compensated(plant(), **model),
        "model, feedback": rig.Compensated(plant(), **model, feedback=10.0),
        "model, least squares": rig.Compensated(plant(), **model, variations=0.03, sigma=1e-4),
    }


def three_storeys(specimen):
    M, C, K = pm.models.rths(1)
    one = np.diag([1.0, 0.0, 0.0])
    is_spring = isinstance(specimen, pm.CubicSpring)
    building = pm.Subdomain(
        M - 29.13 * one,
        K - STIFFNESS * one,
        C=C - 114.2209 * one,
        scheme=pm.CentralDifference(),
        restoring=specimen,
        restoring_stiffness=None if is_spring else STIFFNESS * one,
        u0=[1e-3, 1e-3, 1e-3],
    )
    return pm.Coupler([building], dt=H)


def frame(n, coupling, threads):
    """A tower of n dofs, implicit with steps of 1/1024 s, whose foot of one dof has the rig.

    The foot takes four substeps. Under "pm" the double steps of the tower run beside them, with two
    threads in parallel.
    """
    width = 10
    grid = sp.eye_array(n // width), sp.eye_array(width)
    chain = [
        sp.diags_array([-np.ones(k - 1), 2.0 * np.ones(k), -np.ones(k - 1)], offsets=[-1, 0, 1])
        for k in (n // width, width)
    ]
    K = sp.csr_array(2e7 * (sp.kron(chain[0], grid[1]) + sp.kron(grid[0], chain[1])))
    M = np.full(K.shape[0], 1000.0)
    C = sp.csr_array(1e-4 * K)
    tower = pm.Subdomain(M, K, C=C, scheme=pm.GeneralizedAlpha(0.8), name="tower")
    foot = pm.Subdomain(
        [970.0],
        [2e7],
        C=[2e3],
        scheme=pm.CentralDifference(),
        substeps=RATIO,
        restoring=rig.Compensated(plant(), method="model"),
        restoring_stiffness=[STIFFNESS],
        force=[100.0],
        name="foot",
    )
    tie = pm.tie("tower", [0], "foot", [0])
    return pm.Coupler([tower, foot], tie, dt=RATIO * H, coupling=coupling, threads=threads)


def durations(coupler, steps):
    """Median duration (RATIO,) of each fine step of a macro step of a paced run."""
    make_workers(coupler)
    pacing = paced(coupler, (2 + steps) * RATIO * H, PRIORITY)
    if pacing is None:
        pacing = paced(coupler, (2 + steps) * RATIO * H, None)
    return np.median(pacing.duration.reshape(-1, RATIO), axis=0)


def tower_rows(quick):
    for n in (100,) if quick else (1000, 10_000, 50_000):
        first = None
        for coupling, threads in TOWERS:
            fine = durations(frame(n, coupling, threads), 5 if quick else 2000)
            first = fine.max() if first is None else first
            yield row(f"tower, {coupling}", n, threads, fine.mean(), fine.max(), first)


def rows(quick):
    steps, seconds = (200, 0.0) if quick else (20000, 3.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)  # of the plants without compensation
        couplers = {name: three_storeys(specimen) for name, specimen in specimens().items()}
    times = in_turn(*(lambda c=c: c.step(steps) for c in couplers.values()), seconds=seconds)
    table = [row(x, 3, 1, t / steps, t / steps, times[0] / steps) for x, t in zip(couplers, times)]
    return [*table, *tower_rows(quick)]


def row(what, n, threads, mean, slowest, first):
    return {
        "what": what,
        "dofs": n,
        "threads": threads,
        "us a fine step": 1e6 * mean,
        "us the slowest": 1e6 * slowest,
        "share of 1/4096 s": slowest / H,
        "us above the first": 1e6 * (slowest - first),
        "over the first": slowest / first,
    }


if __name__ == "__main__":
    run("rig_loop", rows, about=__doc__)
