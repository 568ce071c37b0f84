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
from error_cases import Case, named_cases, random_chain

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


def named():
    print(f"\n{'':<44}{'true':>9}{'one':>9}{'two':>9}  order   printed")
    for name, case in named_cases():
        true, one, two, order = row(case)
        print(f"{name:<44}{true:9.2e}{one:9.2e}{two:9.2e}{order:7.2f}   {case.estimate(2)!r}")


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
