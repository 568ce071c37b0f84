"""How late the steps of paced runs are, and the largest frame beside a specimen that keeps 1 kHz.

Four dofs and a compiled specimen at 1 and 10 kHz, with and without SCHED_FIFO (where it is allowed)
and a busy neighbour on each processor, the four at the same time, ten minutes; times are of the
clock, so the load of the machine is in them. For frames the median over the macro steps of the
slowest of their ten fine steps counts, which a busy machine changes less.
"""

import multiprocessing
import os
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import scipy.sparse as sp
from timing import run

import pmalpha as pm

SECONDS, FRAME_SECONDS = 600.0, 3.0
PRIORITY = 80
RATIO = 10  # fine steps in a macro step of the frame
PERIOD = 1e-3
SIZES = tuple(int(1000 * 2 ** (k / 2)) for k in range(2, 20))  # dofs, about


def specimen():
    return pm.rig.SimulatedActuator(pm.CubicSpring([0], k=400.0, k3=40.0))


def four_dofs(period):
    """The four-dof chain of the paper with the first spring as specimen, in free vibration."""
    model = pm.models.four_dof(substeps=RATIO)
    (a, b), springs = model.subdomains, model.springs
    K = np.array([[springs[1], -springs[1]], [-springs[1], springs[1]]])
    b = pm.Subdomain(b.M, K, scheme=b.scheme, substeps=RATIO, restoring=specimen(), name="B")
    return pm.Coupler([a, b], pm.tie(a, [0], b, [1]), dt=RATIO * period, coupling="pm", threads=1)


def frame(dofs, coupling):
    """A plane frame of ten bays, and a column of its ground floor as specimen."""
    bays = 10
    storeys = max(1, round(dofs / (3 * (bays + 1) + 2 * 3 * bays)))
    points = [(6.0 * x, 3.0 * y) for y in range(storeys + 1) for x in range(bays + 1)]
    at = np.arange(len(points)).reshape(storeys + 1, bays + 1)
    columns = np.stack([at[:-1], at[1:]], axis=-1).reshape(-1, 2)
    beams = np.stack([at[1:, :-1], at[1:, 1:]], axis=-1).reshape(-1, 2)
    whole = pm.structures.beam_frame(
        points,
        np.vstack([columns, beams]),
        EA=2e9,
        EI=2e7,
        rhoA=300.0,
        divisions=[1] * len(columns) + [3] * len(beams),
    )
    ground = np.zeros(whole.n)
    ground[whole.dofs(at[0])] = 1e12
    K = whole.K + sp.diags_array(ground)
    building = pm.Subdomain(whole.M, K, scheme=pm.GeneralizedAlpha(0.8), name="frame")
    rig = pm.Subdomain(
        [1e3],
        None,
        scheme=pm.CentralDifference(),
        substeps=RATIO,
        restoring=specimen(),
        restoring_stiffness=[400.0],
        v0=[0.0],
        force=pm.SampledForce(np.sin(np.arange(2000) * 0.05)[:, None], 1e-3),
        name="rig",
    )
    threads = 2 if coupling == "pm" else 1
    tie = pm.tie(building, whole.dofs(at[1, 0], "ux"), rig, [0])
    coupler = pm.Coupler(
        [building, rig], tie, dt=RATIO * PERIOD, coupling=coupling, threads=threads
    )
    return building.n, coupler


def burn():
    while True:
        pass


class Neighbours:
    """Programs that compute all the time, one for each processor."""

    def __init__(self, count):
        self.running = [multiprocessing.Process(target=burn, daemon=True) for _ in range(count)]

    def __enter__(self):
        for process in self.running:
            process.start()

    def __exit__(self, *exception):
        for process in self.running:
            process.terminate()
            process.join()


def quiet_frame(*arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # steps are not the question here
        return frame(*arguments)


def make_workers(coupler):
    """The first two macro steps at a priority, which the threads made in them inherit."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY // 2))
    except PermissionError:
        return
    try:
        coupler.step(2)
    finally:
        os.sched_setscheduler(0, *before)


def paced(coupler, t_end, priority):
    """Its Pacing, or None where the priority is not allowed."""
    try:
        return coupler.run_paced(t_end, on_late="continue", record={}, priority=priority).pacing
    except PermissionError:
        return None


def row(what, coupling, frequency, neighbours, priority, pacing, slowest):
    late = 1e6 * pacing.percentile([50.0, 99.0, 99.9, 100.0])
    return {
        "problem": what,
        "coupling": coupling,
        "kHz": frequency,
        "busy neighbours": neighbours,
        "SCHED_FIFO": "yes" if priority else "no",
        "fine steps": pacing.due.size,
        **dict(zip(("late 50 %, us", "99 %", "99.9 %", "most"), map(float, late))),
        "slowest step, us": 1e6 * slowest,
        "missed": pacing.missed,
    }


def lateness_row(seconds, frequency, neighbours, priority):
    period = 1e-3 / frequency
    macro = round(seconds / (RATIO * period))
    pacing = paced(four_dofs(period), macro * RATIO * period, priority)
    if pacing is None:
        return None
    slowest = float(np.median(pacing.duration))
    return row("4 dofs", "pm", frequency, neighbours, priority, pacing, slowest)


def lateness_rows(seconds):
    cases = [(frequency, priority) for frequency in (1, 10) for priority in (None, PRIORITY)]
    for neighbours in (0, os.cpu_count()):
        with Neighbours(neighbours), ProcessPoolExecutor(len(cases)) as pool:
            running = [pool.submit(lateness_row, seconds, f, neighbours, p) for f, p in cases]
            yield from filter(None, [each.result() for each in running])


def frame_rows(seconds, sizes):
    """Frames of growing size until the slowest fine step takes longer than the period."""
    for coupling in ("gc", "pm"):
        for size in sizes:
            n, coupler = quiet_frame(size, coupling)
            make_workers(coupler)
            macro = 2 + round(seconds / (RATIO * PERIOD))
            pacing = paced(coupler, macro * RATIO * PERIOD, PRIORITY)
            priority = PRIORITY
            if pacing is None:
                pacing, priority = paced(coupler, macro * RATIO * PERIOD, None), None
            each = np.median(pacing.duration.reshape(-1, RATIO), axis=0)
            yield row(f"frame, n = {n}", coupling, 1, 0, priority, pacing, float(each.max()))
            if each.max() > PERIOD:
                break


def measure(quick):
    seconds, sizes = (0.05, SIZES[:1]) if quick else (SECONDS, SIZES)
    return [*lateness_rows(seconds), *frame_rows(min(seconds, FRAME_SECONDS), sizes)]


if __name__ == "__main__":
    run("pacing", measure, about=__doc__)
