"""How far `Coupler.estimate_error` is from the true error: docs/right.md, random and named cases.

    export PYTHONPATH=tests
    python benchmarks/surveys/error_estimates.py [--count 40] [linear] [nonlinear] [contact] [named]

Random chains of 3 to 9 masses in two or three subdomains, in free motion of their lowest modes over
5 to 12 periods, with 8 to 80 macro steps in the second period. The true motion is that of the uncut
chain, by its modes where it is linear, by DOP853 with cubic springs to the ground, and with contact
that of the same run with a 16th of the step. Errors are those of all dofs at all time levels, over
the largest displacement.
"""

import argparse
import warnings
from functools import partial

import numpy as np
from error_cases import Case, named_cases, random_chain, watched_cases

import pmalpha as pm

COUPLINGS = ("gc", "pm", "macro", "mean")
BINS = (0.0, 0.01, 0.1, 0.5, np.inf)


def random_contact(seed, coupling):
    """Two masses on springs, cut at the first; the second meets a stop at half of its amplitude."""
    rng = np.random.default_rng([seed, 44])
    k = 100.0 * 10.0 ** rng.uniform(-0.5, 0.5, 2)
    substeps, scheme = int(rng.choice([2, 5])), pm.GeneralizedAlpha(0.8)
    # under "pm" subdomains with contact take single steps, and all are at the finest step
    dt = 2.0 * np.pi / np.sqrt(k.sum()) / 10.0 ** rng.uniform(1.5, 3.0)
    make = partial(contact_coupler, k, substeps, scheme, coupling, float(rng.uniform(0.3, 0.7)))
    steps = int(4.0 * 2.0 * np.pi / np.sqrt(k.sum()) / dt)
    finest = make(dt / 16.0).run(steps=16 * steps)
    return Case(make(dt), steps, lambda i, t: finest[i].u[::16])


def contact_coupler(k, substeps, scheme, coupling, restitution, dt):
    a = pm.Subdomain([0.5], k[:1], scheme=scheme, v0=[1.0], name="a")
    explicit = pm.GeneralizedAlpha(0.8, explicit=True)
    K = k[1] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    b = pm.Subdomain([0.5, 1.0], K, scheme=explicit, substeps=substeps, v0=[1.0, 1.0], name="b")
    stop = pm.contact(b, [1], gap=0.5 / np.sqrt(k.sum()), restitution=restitution)
    return pm.Coupler([a, b], [pm.tie(a, 0, b, 0), stop], dt=dt, coupling=coupling, threads=1)


def row(case):
    """True error, the estimates with one and two halvings, and the observed order."""
    one, two = case.estimate(1), case.estimate(2)
    return case.error(one.history), one.relative, two.relative, two.order


def table(name, make, seeds):
    rows = []
    for seed in seeds:
        try:
            rows.append(row(make(seed)))
        except (pm.InstabilityError, pm.ConvergenceError) as error:
            print(f"{name}: seed {seed}: {type(error).__name__}")
    found = np.array(rows)
    for low, high in zip(BINS, BINS[1:]):
        own = found[(found[:, 0] >= low) & (found[:, 0] < high)]
        if not own.size:
            continue
        ratios = [np.percentile(own[:, k] / own[:, 0], [0, 50, 100]) for k in (1, 2)]
        shown = "   ".join("{:6.2f} {:6.2f} {:6.2f}".format(*x) for x in ratios)
        text = f"{100 * low:g} to {100 * high:g} %"
        print(
            f"{name:<18}{text:>14}{len(own):5d}   {shown}{(own[:, 3] < 0.5).sum():5d}", flush=True
        )
    return found


# What version 0.3 said of the cases, where it said anything.
SAID_BY_0_3 = {
    "half sine of 10 ms, period 1 s, dt = 1 ms": "100 %",
    "stop of 1e4, dt = 1e-4": "100 %",
    "wrong sign": "step too coarse",
    "delay of one step": "step too coarse",
    "at rest beside a stop, u0 = 3e-20": "ended",
}


def said(history):
    """The warnings of a run, in a word each."""
    words = {"added energy": "energy", "of its mass": "mass", "critical": "critical step"}
    found = [word for text in history.warnings for mark, word in words.items() if mark in text]
    return ", ".join(found) or "-"


def named():
    """The errors that are estimated beside the true ones, and what the runs warn of."""
    head = ("true", "one", "two", "order", "0.3 said", "said")
    print("\n{:<52}{:>9}{:>9}{:>9}{:>7}   {:<16}{}".format("", *head))
    for name, case in (*named_cases(), *watched_cases()):
        before = SAID_BY_0_3.get(name, "-")
        try:
            one, two = case.estimate(1), case.estimate(2)
        except ValueError as error:  # a function with a memory
            history = case.coupler.run(steps=case.steps)
            numbers = f"{case.error(history):9.2e}  refused: {str(error)[:40]}"
            print(f"{name:<52}{numbers}   {before:<16}{said(history)}")
            continue
        history = case.coupler.run(steps=case.steps)
        numbers = (
            f"{case.error(history):9.2e}{one.relative:9.2e}{two.relative:9.2e}{two.order:7.2f}"
        )
        print(f"{name:<52}{numbers}   {before:<16}{said(history)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surveys", nargs="*", default=["linear", "nonlinear", "contact", "named"])
    parser.add_argument("--count", type=int, default=40)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    print("estimate / true error, smallest, median and largest: one halving, two; order < 0.5")
    for name in arguments.surveys:
        seeds = range(arguments.count)
        if name == "named":
            named()
        elif name == "contact":
            for coupling in ("gc", "pm"):
                table(f"contact, {coupling}", partial(random_contact, coupling=coupling), seeds)
        else:
            for coupling in COUPLINGS:
                make = partial(random_chain, coupling=coupling, nonlinear=name == "nonlinear")
                table(f"{name}, {coupling}", make, seeds)


if __name__ == "__main__":
    main()
