"""The page of what goes with what, `combinations.md`, made from what the program does.

`python docs/combinations.py` writes the page; with ``--check`` it ends with an error where the page
is not what the program does now. `make docs` checks it. Each cell is tried: a problem of two
subdomains with the features alone (tests/problems.py), under each coupling.
"""

import re
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "combinations.md"
sys.path.insert(0, str(ROOT / "tests"))
from problems import FEATURES, Problem  # noqa: E402

import pmalpha as pm  # noqa: E402

COUPLINGS = ("gc", "pm", "macro", "mean")
# What the page calls the features that it has: those of a kind are tried by one of them.
SHOWN = {
    "explicit scheme": "explicit generalized alpha",
    "`Bathe`": "Bathe",
    "substeps": "substeps",
    "double steps": "double steps",
    "no mass at a dof": "massless dof",
    "full mass matrix": "full mass",
    "damping C": "damping",
    "lagged damping": "lagged damping",
    "Rayleigh damping": "Rayleigh",
    "unsymmetric K": "unsymmetric K",
    "gyroscopic C": "gyroscopic",
    "reduced subdomain": "reduced",
    "load f(t)": "function of time",
    "controller f(t, u, v)": "controller",
    "compiled load": "compiled load",
    "record": "samples",
    "ground motion": "ground motion",
    "moving load": "beam with a moving load",
    "springs, once a step": "bilinear springs",
    "springs that move": "beam with springs that move",
    "specimen, a function": "specimen",
    "compiled specimen": "compiled specimen",
    "specimen outside": "external specimen",
    "simulated actuator": "late actuator",
    "compensator": "polynomial",
    "adaptive compensator": "adaptive",
    "linear actuator": "linear actuator",
    "linkage": "linkage",
    "limits": "limits",
    "springs, iterated": "iterated bilinear springs",
    "function, iterated": "iterated function",
    "conserving springs": "conserving springs",
    "general constraint": "general constraint",
    "prescribed velocity": "prescribed velocity",
    "contact": "contact",
    "contact with friction": "contact with friction",
    "moving obstacle": "moving obstacle",
    "plain start": "plain start",
}
SEED = 22


def saved(coupler, folder):
    coupler.step(1)
    coupler.save(folder / "state.npz")
    coupler.load(folder / "state.npz")


def misfit(coupler):
    s = coupler.subdomains[0]
    levels = len(coupler.run_each([{}], steps=2)[0].subdomains[0].t)
    return pm.Misfit({s.name: dict(dofs=[0], u=np.zeros((levels, 1)))})


def goal(coupler):
    return pm.Goal(coupler.subdomains[0].name, 0, at=2 * coupler.dt)


def shaken(coupler):
    s = coupler.subdomains[0]
    return coupler.harmonic([1.0], {s.name: np.ones(s.n)})


# What one does with a coupler.
VERBS = {
    "`save`, `load`": saved,
    "`run(energy=True)`": lambda c, folder: c.run(steps=2, energy=True),
    "`run(tolerance=)`": lambda c, folder: c.run(steps=2, tolerance=0.1),
    "`run_each`": lambda c, folder: c.run_each([{}, {}], steps=2),
    "`run_paced`": lambda c, folder: c.run_paced(2 * c.dt, rate=1e4, on_late="continue"),
    "`change_steps`": lambda c, folder: c.change_steps(dt=c.dt / 2.0),
    "`estimate_error`": lambda c, folder: c.estimate_error(steps=2),
    "`error_budget`": lambda c, folder: c.error_budget(goal(c), 2 * c.dt),
    "`gradient`": lambda c, folder: c.gradient(misfit(c), steps=2),
    "`freeze`": lambda c, folder: c.freeze(folder / "model.pma"),
    "`export_fmu`": lambda c, folder: c.export_fmu(folder / "model.fmu"),
    "`static`": lambda c, folder: c.static(),
    "`modes`": lambda c, folder: c.modes(1),
    "`harmonic`": lambda c, folder: shaken(c),
    "`growth`": lambda c, folder: c.growth(16),
}


class Notes:
    """The footnotes: refusals by name, each once, with their numbers."""

    def __init__(self):
        self.numbers = {}

    def __call__(self, error):
        words = re.sub(r"\s+", " ", str(error)).replace("|", r"\|").replace("<", r"\<")
        words = re.sub(r" at 0x[0-9a-f]+", "", words)
        return f"[^{self.numbers.setdefault(words, len(self.numbers) + 1)}]"

    def text(self):
        return "\n".join(f"[^{number}]: {words}" for words, number in self.numbers.items())


def tried(choices, coupling, act, count=2):
    """None, or the refusal, of a coupler with these features."""
    problem = Problem(SEED, count, (*choices, (coupling, 0)))
    try:
        coupler = problem.couple(threads=1)
        with tempfile.TemporaryDirectory() as folder:
            act(problem if act is shared else coupler, Path(folder))
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        if not last.filename.startswith(str(Path(pm.__file__).parent)):
            raise
        return error
    return None


def shared(problem, folder):
    """A coupler of one process of several, with constraints by name as each of these has them."""
    from mpi4py import MPI
    from rank_bitwise import by_name

    ties = problem.space["ties"]
    if all(isinstance(tie, pm.Constraint) for tie in ties):
        ties = by_name(ties)
    coupler = pm.Coupler(problem.space["parts"], ties, comm=MPI.COMM_SELF, **problem.options())
    coupler.run(steps=2)


def run(coupler, folder):
    coupler.run(steps=2)


def cell(notes, choices, act=run, count=2, possible=COUPLINGS):
    """yes; the couplings under which it is possible, and why not under the others; or why not."""
    refused = {c: tried(choices, c, act, count) for c in possible}
    good = [c for c, error in refused.items() if error is None]
    errors = [error for error in refused.values() if error is not None]
    if not good:
        return notes(errors[0])
    marks = list(dict.fromkeys(map(notes, errors)))
    return "yes" if not marks else f"yes: {', '.join(good)} {''.join(marks)}"


def at(name, place):
    return (name, 0 if FEATURES[name].place != "subdomain" else place)


def pair(one, two):
    """Two features at one subdomain, or, of a group, beside each other, with how many there are."""
    group, other = FEATURES[one].group, FEATURES[two].group
    if one == two or (group and group == other):
        if FEATURES[one].place == "tie":
            return ((one, 0), (two, 1)), 3
        return ((one, 0), (two, 1)), 2
    return (at(one, 0), at(two, 0)), 2


def table(head, rows):
    lines = [f"| {' | '.join(['', *head])} |", f"|{'---|' * (len(head) + 1)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def page():
    notes, possible, coupled = Notes(), {}, []
    for words, name in SHOWN.items():
        refused = {c: tried([at(name, 0)], c, run) for c in COUPLINGS}
        possible[name] = [c for c in COUPLINGS if refused[c] is None]
        coupled.append([words, *("yes" if e is None else notes(e) for e in refused.values())])
    uses, verbs = [], VERBS | {"`comm=`": shared}
    for words, name in SHOWN.items():
        among = possible[name] or COUPLINGS
        cells = (cell(notes, [at(name, 0)], act, 2, among) for act in verbs.values())
        uses.append([words, *cells])
    names = list(SHOWN.values())
    met = {}
    for i, one in enumerate(names):
        for two in names[: i + 1]:
            among = [c for c in COUPLINGS if c in possible[one] and c in possible[two]]
            choices, count = pair(one, two)
            met[one, two] = met[two, one] = cell(notes, choices, run, count, among or COUPLINGS)
    square = [[words, *(met[one, two] for two in names)] for words, one in SHOWN.items()]
    return f"""# What goes with what

Made by a script that tries each cell, and checked when this site is made. "yes": under all
couplings where both are possible, or under those that follow. Numbers: the words of the refusal.

## Couplings

{table([f'"{c}"' for c in COUPLINGS], coupled)}

## What one does with a coupler

Of couplers with one of these features, under the couplings that take it.

{table(list(verbs), uses)}

## Features with each other

Both at one subdomain; of two schemes, devices or ties, and of one with itself, each has its own.

{table(list(SHOWN), square)}

## Why not

{notes.text()}
"""


def made():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return page()


if __name__ == "__main__":
    text = made()
    if "--check" in sys.argv[1:]:
        if PAGE.read_text() != text:
            raise SystemExit("docs/combinations.md is not what the program does: make it again")
    else:
        PAGE.write_text(text)
