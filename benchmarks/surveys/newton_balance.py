"""How far from balance Newton's method accepts, and how many iterations it takes.

    export PYTHONPATH=tests
    python benchmarks/surveys/newton_balance.py [held] [wrong] [strings] [iterations] [--seeds N]
        [--kernels A B]

`held`: the random problems of tests/test_newton_held.py with a subdomain that constraints hold,
under "gc" and "pm". `wrong`: the same with tangents that are wrong by a factor (even seeds) or
forces that jump (odd ones), which may be refused but not accepted out of balance. `strings`: random
strings under prestress, at rest. `iterations`: corrections in a substep, and evaluations, of stiff
chains, contact, oscillators and pendula in all schedules. Balance is in tolerances, each row of the
residual relative to the sum of its absolute terms. Minutes in all. `--kernels`, with `held` and
`wrong`: once for each of these kernels of OpenBLAS (Prescott, Nehalem, Haswell, SkylakeX), and the
runs that do not end alike under all of them.
"""

import argparse
import json
import os
import subprocess
import sys
import warnings
from collections import Counter
from dataclasses import replace

import newton_chains
import numpy as np
from newton_coupled import coupler
from newton_problems import chain, duffing_pair, pendulum
from newton_reference import run_macro
from test_newton_held import DT, STEPS, PrestressedString, held, imbalance, with_fault

import pmalpha as pm

TOL = 1e-8
REFUSED = (pm.ConvergenceError, pm.FactorizationError)


def balance(seed, coupling, wrong):
    """The largest residual of all iterated subdomains in tolerances, or the name of an error."""
    subdomains, L = held(seed, coupling)
    jump = 0.0
    if wrong:
        subdomains, jump = with_fault(subdomains, seed)
    try:
        history = coupler(subdomains, L, DT, coupling, newton=newton_of(seed)).run(steps=STEPS)
    except pm.PmalphaError as error:
        return type(error).__name__
    members = zip(subdomains, L, history, strict=True)
    found = [imbalance(s, Li, x, history.multipliers, jump) for s, Li, x in members if s.internal]
    return max(found) / TOL


def newton_of(seed):
    return pm.Newton(tol=TOL, tangent=("full", "reuse")[seed % 3 > 0])


def balances(seeds, wrong):
    """`balance` of all runs, by seed and coupling."""
    couplings = ("gc", "pm")
    return {f"{seed} {x}": balance(seed, x, wrong) for seed in seeds for x in couplings}


def under(kernel, *arguments):
    """What this script prints in a process that runs with this kernel of OpenBLAS."""
    command = [sys.executable, __file__, *map(str, arguments)]
    environment = os.environ | {"OPENBLAS_CORETYPE": kernel}
    return subprocess.check_output(command, env=environment, text=True)


def balances_under(kernel, seeds, wrong):
    what = ["wrong" if wrong else "held", "--json", "--first", seeds.start, "--seeds", len(seeds)]
    return json.loads(under(kernel, *what))


def verdict(found):
    if isinstance(found, str):
        return found
    return "accepted" if found <= 10.0 else "above 10 tol"


def compare(kernels, seeds, wrong):
    """Print how runs end under each kernel, and those that do not end alike."""
    results = {kernel: balances_under(kernel, seeds, wrong) for kernel in kernels}
    for kernel, found in results.items():
        print(f"{kernel:12}", dict(Counter(verdict(x) for x in found.values())))
    runs = list(results[kernels[0]])
    ends = {run: [verdict(results[kernel][run]) for kernel in kernels] for run in runs}
    unlike = {run: x for run, x in ends.items() if len(set(x)) > 1}
    print(f"not alike: {len(unlike)} of {len(runs)}")
    for run, x in unlike.items():
        print("   ", run, *x)


def survey(seeds, wrong):
    counts, worst = Counter(), []
    for run, found in balances(seeds, wrong).items():
        seed, coupling = int(run.split()[0]), run.split()[1]
        kind = ("factor", "jump")[seed % 2] if wrong else "held"
        counts[kind, found if isinstance(found, str) else "accepted"] += 1
        if not isinstance(found, str) and found > 10.0:
            worst.append((round(found, 1), kind, seed, coupling))
    print(dict(counts), f"above 10 tol: {len(worst)}")
    for line in sorted(worst, reverse=True):
        print("   ", *line)


def strings(seeds):
    counts = Counter()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        T, EA = 10.0 ** rng.uniform(0.0, 5.0), 10.0 ** rng.uniform(1.0, 8.0)
        n = int(rng.integers(3, 12))
        string = PrestressedString(T, EA, n)
        mass = np.full(2 * n - 4, 10.0 ** rng.uniform(-2.0, 2.0))
        s = pm.Subdomain(mass, None, scheme=pm.GeneralizedAlpha(0.5), internal=string)
        try:
            iterations = pm.Coupler([s], dt=DT).run(steps=STEPS)[0].iterations
            counts["after all iterations" if iterations.max() >= 40 else "at once"] += 1
        except REFUSED:
            counts["refused"] += 1
    print(dict(counts))


class Counted:
    """An internal force that counts its evaluations."""

    calls = 0

    def __init__(self, internal):
        self.internal = internal

    def __call__(self, t, u, v, q):
        Counted.calls += 1
        return self.internal(t, u, v, q)


def problems():
    """Name, subdomains and constraints of a schedule, steps and their length."""
    for name, (law, values, dts, _) in newton_chains.problems().items():
        for dt in dts:
            yield (
                f"{name}, dt {dt:.2g}",
                lambda law=law, values=values, **how: chain(newton_chains.N, law, **values, **how),
                dt,
            )
    yield "oscillators", duffing_pair, 0.05
    yield "pendulum", pendulum, 0.01


def iterations():
    total = Counter()
    for name, make, dt in problems():
        for tangent in ("full", "reuse"):
            count = Counter()
            for how, values in newton_chains.SCHEDULES.values():
                subdomains, L = make(**values)
                subdomains = [replace(s, internal=Counted(s.internal)) for s in subdomains]
                coupling = "pm" if subdomains[0].double else "gc"
                coupling = "macro" if how is run_macro else coupling
                Counted.calls = 0
                c = coupler(subdomains, L, dt, coupling, newton=pm.Newton(tangent=tangent))
                try:
                    history = c.run(steps=100)
                except REFUSED:
                    count["refused"] += 1
                    continue
                for x in history:
                    count["corrections"] += int(x.iterations.sum())
                    count["substeps"] += len(x.t) - 1
                count["evaluations"] += Counted.calls
            report(f"{name}, {tangent}", count)
            for key, value in count.items():
                total[tangent, key] += value
    for tangent in ("full", "reuse"):
        report(f"all, {tangent}", {k: n for (x, k), n in total.items() if x == tangent})


def report(name, count):
    corrections, evaluations = (
        count[k] / count["substeps"] for k in ("corrections", "evaluations")
    )
    refused = count.get("refused", 0)
    print(f"{name:45} {corrections:8.4f} {evaluations:8.4f} a substep, {refused} refused")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", default=["held", "wrong", "strings", "iterations"])
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kernels", nargs="*", default=[])
    parser.add_argument("--json", action="store_true", help="balances only, of one kind")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for what in given.what:
            if given.json:
                print(json.dumps(balances(seeds, what == "wrong")))
                continue
            print(what)
            if what == "iterations":
                iterations()
            elif what == "strings":
                strings(seeds)
            elif given.kernels:
                compare(given.kernels, seeds, what == "wrong")
            else:
                survey(seeds, what == "wrong")
