"""A problem for test_study.py, in a module that other processes can import."""

import os
import threading

import numpy as np

import pmalpha as pm

made = []  # (process, thread) of every coupler that was made here


def make():
    made.append((os.getpid(), threading.get_ident()))
    K = [[6.0, -2.0], [-2.0, 2.0]]
    a = pm.Subdomain(np.ones(2), K, scheme=pm.GeneralizedAlpha(0.5), name="a")
    scheme = pm.GeneralizedAlpha(0.5, explicit=True)
    b = pm.Subdomain(np.ones(2), K, scheme=scheme, substeps=2, name="b")
    return pm.Coupler([a, b], pm.tie("a", 1, "b", 0), dt=0.1, threads=1, coupling="pm")


def peaks(history):
    return {
        "u": np.abs(history["b"].u).max(axis=0),
        "last": history.multipliers[-1, 0],
        "process": os.getpid(),
        "made": len(made),
    }


def cases(count):
    return [{"v0": {"a": [0.1 * k, 0.0]}, "force": {"b": [1.0, k]}} for k in range(count)]


class Unpicklable(Exception):
    """Can be pickled but not read again, with the reducers of tblib (part of dask) as well."""

    def __reduce__(self):
        return float, ("no exception",)


def fails(t):
    raise Unpicklable("one and two")


def main(engine):
    """Six cases by an engine that needs a main program of its own; prints what came out."""
    study = pm.Study(make, steps=5, result=peaks)
    if engine == "mpi4py":
        from mpi4py.futures import MPIPoolExecutor

        with MPIPoolExecutor() as pool:
            found = study.run(cases(6), map=pool.map)
    for case in found:
        print(case.value["u"].tobytes().hex(), case.value["last"].hex(), case.value["process"])


if __name__ == "__main__":
    import sys

    sys.path.insert(0, os.path.dirname(__file__))
    import studied  # not __main__, which the workers would not find

    studied.main(sys.argv[1])
