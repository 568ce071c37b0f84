"""How far from balance Newton's method accepts, and how many iterations it takes.

    python tests/newton_survey.py [held] [wrong] [strings] [iterations] [--seeds N]

`held`: the random problems of tests/test_newton_held.py with a subdomain that constraints hold,
under "gc" and "pm". `wrong`: the same with tangents that are wrong by a factor (even seeds) or
forces that jump (odd ones), which may be refused but not accepted out of balance. `strings`: random
strings under prestress, at rest. `iterations`: corrections in a substep, and evaluations, of stiff
chains, contact, oscillators and pendula in all schedules. Balance is in tolerances, each row of the
residual relative to the sum of its absolute terms. Minutes in all.
"""

import argparse
import warnings
from collections import Counter
from dataclasses import replace

import newton_tables
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
    newton = pm.Newton(tol=TOL, tangent=("full", "reuse")[seed % 3 > 0])
    try:
        history = coupler(subdomains, L, DT, coupling, newton=newton).run(steps=STEPS)
    except pm.PmalphaError as error:
        return type(error).__name__
    members = zip(subdomains, L, history, strict=True)
    found = [imbalance(s, Li, x, history.multipliers, jump) for s, Li, x in members if s.internal]
    return max(found) / TOL


def survey(seeds, wrong):
    counts, worst = Counter(), []
    for seed in seeds:
        for coupling in ("gc", "pm"):
            found = balance(seed, coupling, wrong)
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

    def __call__(self, u, v, t, q):
        Counted.calls += 1
        return self.internal(u, v, t, q)


def problems():
    """Name, subdomains and constraints of a schedule, steps and their length."""
    for name, (law, values, dts, _) in newton_tables.problems().items():
        for dt in dts:
            yield (
                f"{name}, dt {dt:.2g}",
                lambda law=law, values=values, **how: chain(newton_tables.N, law, **values, **how),
                dt,
            )
    yield "oscillators", duffing_pair, 0.05
    yield "pendulum", pendulum, 0.01


def iterations():
    total = Counter()
    for name, make, dt in problems():
        for tangent in ("full", "reuse"):
            count = Counter()
            for how, values in newton_tables.SCHEDULES.values():
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
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for what in given.what:
            print(what)
            if what == "iterations":
                iterations()
            elif what == "strings":
                strings(seeds)
            else:
                survey(seeds, what == "wrong")
