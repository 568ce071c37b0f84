"""A study of records by 1, 2 and 4 processes, and by two threads of `Coupler.run_each`.

*Workers* is the processor time of all of them for a case, *program* that of the process that
distributes the cases and takes the results. Processors that have nothing else to do take
workers / n a case, or as long as the program if that takes longer: *efficiency* is the time
without an executor over n times that. With threads the program is the thread that calls, which
prepares the cases on one of the processors. Times of the clock would have what other programs on
the machine take. The program sends loads, 32 kB a case, or numbers, of which workers make the
loads. The rows of 64 workers have the times of four.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial

import ensembles
import numpy as np
from timing import run

import pmalpha as pm

TOGETHER = 8
PREDICTED = 64


def whole(threads=1):
    M, K, C = ensembles.matrices()
    frame = pm.Subdomain(M, K, C=C, scheme=ensembles.RULE, name="frame")
    return pm.Coupler([frame], dt=ensembles.DT, threads=threads)


def cut():
    return ensembles.cut(*ensembles.matrices())


MAKE = {"dense K and C": whole, "cut in two, ss = 10": cut}


@cache
def problem_of(name, count, steps):
    """The coupler, and a function that makes cases of some records."""
    masses = {x: masses for x, _, masses, *_ in ensembles.problems(count)}[name]
    records = ensembles.records(count, steps).T.copy()
    return MAKE[name](), lambda some: ensembles.cases_of(records[:, some], masses)


def peaks(history):
    """What a study keeps; and of which process, and how long that has worked."""
    return abs(history["frame"].u).max(axis=0), os.getpid(), time.process_time()


def of_numbers(name, count, steps, numbers):
    """The same of some cases, whose loads are made here."""
    coupler, cases_of = problem_of(name, count, steps)
    histories = coupler.run_each(cases_of(numbers), steps=steps, **ensembles.ONE)
    return [peaks(x) for x in histories]


# ---- seconds of workers and of the program ---------------------------------------------------


def by_none(study, cases):
    begin = time.process_time()
    study.run(cases)
    return time.process_time() - begin, 0.0


def by_processes(distribute, workers):
    begin = time.process_time()
    with ProcessPoolExecutor(workers) as pool:
        found = list(distribute(pool.map))
    program = time.process_time() - begin
    last = {}
    for _, process, seconds in found:
        last[process] = max(seconds, last.get(process, 0.0))
    return sum(last.values()), program


def by_threads(coupler, cases, steps):
    begin, process = time.thread_time(), time.process_time()
    coupler.run_each(cases, steps=steps, **ensembles.ONE)
    program = time.thread_time() - begin
    return time.process_time() - process - program, program


def least(measure, rounds):
    """The minimum of each time."""
    return np.min([measure() for _ in range(rounds)], axis=0)


# ---- rows ------------------------------------------------------------------------------------


def row(name, what, count, cases, times, longest, alone):
    workers, program = times
    return {
        "problem": name,
        "by": what,
        "workers": count,
        "us a case, workers": 1e6 * workers / cases,
        "us a case, program": 1e6 * program / cases,
        "efficiency": alone / (count * longest),
    }


def rows_of_threads(name, count, steps, rounds):
    cases = problem_of(name, count, steps)[1](range(count))
    one, two = (least(partial(by_threads, whole(n), cases, steps), rounds) for n in (1, 2))
    longest = max((two[0] + two[1]) / 2, two[1])
    return [row(name, "run_each, threads", 2, count, two, longest, sum(one))]


def rows_of_processes(name, count, steps, rounds):
    cases = problem_of(name, count, steps)[1](range(count))
    study = pm.Study(MAKE[name], steps=steps, result=peaks, together=TOGETHER, **ensembles.ONE)
    study.run(cases[:TOGETHER])  # makes the coupler
    chunks = [list(range(count))[k : k + TOGETHER] for k in range(0, count, TOGETHER)]

    def loads(map):
        return (case.value for case in study.run(cases, map=map))

    def numbers(map):
        return (x for some in map(partial(of_numbers, name, count, steps), chunks) for x in some)

    alone = least(partial(by_none, study, cases), rounds)
    rows = [row(name, "Study", 1, count, alone, alone[0], alone[0])]
    for what, distribute in {"loads": loads, "numbers": numbers}.items():
        for workers in (1, 2, 4, PREDICTED):
            if workers < PREDICTED:
                times = least(partial(by_processes, distribute, workers), rounds)
            longest = max(times[0] / workers, times[1])
            rows.append(row(name, f"processes, {what}", workers, count, times, longest, alone[0]))
    return rows


def measure(quick):
    count, steps, rounds = (16, 100, 1) if quick else (400, ensembles.STEPS, 4)
    whole_, cut_ = MAKE
    return [
        *rows_of_threads(whole_, count, steps, rounds),
        *rows_of_processes(whole_, count, steps, rounds),
        *rows_of_processes(cut_, count // 2, steps, rounds),
    ]


if __name__ == "__main__":
    run("executors", measure, about=__doc__)
