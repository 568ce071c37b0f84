"""Random problems of everything that the package has, each of them a program.

A problem is a list of features with the subdomain or the tie that they are at, and a seed: `made`
writes the program of it, which is also what runs. Features draw their numbers by themselves, so
the others stay as they are when one is left out (`shrunk`). To add a feature is to add a function
here, with the kind of place where it acts; a new argument or class fails test_problems.py until
one uses it.

Numbers have units and dofs an order, in which the same problem can be written (`written`):
relations.py compares the runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from zlib import crc32

import compiled
import numpy as np
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import rig, structures

STEPS, TIME_STEP = 8, 0.05
NAMES = "abc"
HEADER = "import numpy as np\nimport scipy.sparse as sp\n\nimport pmalpha as pm"
MODULES = dict(np=np, sp=sp, pm=pm, rig=rig, structures=structures, compiled=compiled)


@dataclass(frozen=True)
class Feature:
    """What can be in a problem: ``add(sketch, part or place, rng)`` writes it.

    place: "subdomain", "tie", "coupler" or "run". One of a group is at a place. `unscaled`: it has
    numbers whose units cannot be changed.
    """

    name: str
    place: str
    add: object
    group: str
    unscaled: bool


FEATURES = {}


def feature(name, place="subdomain", group="", unscaled=False):
    def added(add):
        FEATURES[name] = Feature(name, place, add, group, unscaled)
        return add

    return added


# ---- writing ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Writing:
    """How numbers are written: the units of force, length and time, the order of dofs of each
    subdomain by a seed, and by another a relative change of all numbers (None: none)."""

    units: tuple = (1.0, 1.0, 1.0)
    order: int | None = None
    shift: int | None = None

    def text(self, x, force=0, length=0, time=0):
        """A number or an array in these units, as it is in a program."""
        F, L, T = self.units
        x = np.round(np.asarray(x, dtype=float), 3)
        if self.shift is not None:
            x = x * np.vectorize(self._change, otypes=[float])(np.abs(x))
        return repr((x * (F**force * L**length * T**time)).tolist())

    def _change(self, size):
        """Equal numbers change equally: symmetric matrices stay so."""
        return 1.0 + SHIFT * np.random.default_rng([self.shift, int(1e3 * size)]).uniform(-1.0, 1.0)


SHIFT = 2.0**-36
# the arguments of functions that depend on the motion
TUV, TUVQ = "t, u, v", "t, u, v, q"


@dataclass
class Part:
    """A subdomain while it is written. Vectors and matrices are in its first order of dofs."""

    name: str
    index: int
    writing: Writing
    M: np.ndarray
    K: np.ndarray
    order: np.ndarray
    u0: np.ndarray
    v0: np.ndarray
    arguments: dict = field(default_factory=dict)
    forces: dict = field(default_factory=dict)
    substeps: int = 1
    head: str = "pm.Subdomain"
    before: list = field(default_factory=list)
    after: list = field(default_factory=list)
    light: set = field(default_factory=set)
    tied: object = None
    built: bool = False  # of a structure, with its matrices

    @property
    def n(self):
        return len(self.M)

    def dof(self, i):
        """The number of dof i, -1 for the ground."""
        return -1 if i < 0 else int(np.argsort(self.order)[i])

    def vector(self, x, **units):
        return self.writing.text(np.asarray(x)[self.order], **units)

    def matrix(self, A, **units):
        return self.writing.text(np.asarray(A)[np.ix_(self.order, self.order)], **units)

    def number(self, x, **units):
        return self.writing.text(x, **units)

    def load(self, text):
        self.forces.setdefault("force", []).append(text)

    def moving(self, x):
        """A vector without entries at dofs without mass."""
        return np.where([i in self.light for i in range(self.n)], 0.0, x)

    def pairs(self, rng):
        """Dofs of springs, with the ground or each other."""
        a = int(rng.integers(self.n))
        pairs = [(a, -1)] if self.n == 1 or rng.random() < 0.5 else [(a, (a + 1) % self.n)]
        return [tuple(self.dof(i) for i in pair) for pair in pairs]


@dataclass
class Sketch:
    """A problem while it is written."""

    writing: Writing
    fine: int
    parts: list
    ties: list = field(default_factory=list)
    still: set = field(default_factory=set)
    coupler: dict = field(default_factory=dict)
    run: dict = field(default_factory=dict)
    steps: int = STEPS

    def number(self, x, **units):
        return self.writing.text(x, **units)

    def sides(self, k):
        """Parts and dofs of both sides of tie k: the last dof of one, the first of the next."""
        a, b = self.parts[k], self.parts[k + 1]
        return a, a.n - 1, b, 0


def call(head, positional=(), named=(), indent=4):
    """A call in lines of at most 100 columns."""
    words = [*positional, *(f"{key}={value}" for key, value in dict(named).items())]
    one = f"{head}({', '.join(words)})"
    if len(one) <= 96:
        return one
    lines, line = [], ""
    for word in words:
        if line and len(line) + len(word) > 92:
            lines.append(line)
            line = ""
        line += ("" if not line else " ") + word + ","
    pad = " " * indent
    return f"{head}(\n" + "".join(f"{pad}{x}\n" for x in [*lines, line]) + ")"


class Changed:
    """pmalpha with Subdomains of other arguments."""

    def __init__(self, change):
        self.change = change

    def __getattr__(self, name):
        return getattr(pm, name)

    def Subdomain(self, M, K, **arguments):
        return pm.Subdomain(**self.change({"M": M, "K": K, **arguments}))


# ---- problems -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """A seed, the number of subdomains, features with their places, and how it is written."""

    seed: int
    count: int
    choices: tuple
    writing: Writing = Writing()

    def features(self):
        return {name for name, _ in self.choices}

    @cached_property
    def sketch(self):
        return sketched(self)

    @cached_property
    def setup(self):
        """The lines that make subdomains and constraints."""
        s = self.sketch
        lines = []
        for part in s.parts:
            lines += part.before
            named = {"name": repr(part.name), **part.arguments}
            for key, terms in part.forces.items():
                named[key] = terms[0] if len(terms) == 1 else f"[{', '.join(terms)}]"
            positional = [named.pop(x) for x in ("M", "K") if x in named]
            lines += [f"{part.name} = " + call(part.head, positional, named), *part.after]
        names = ", ".join(part.name for part in s.parts)
        lines.append(call("ties = list", [f"[{', '.join(s.ties)}]"]) if s.ties else "ties = []")
        return "\n".join(lines).replace("ties = list([", "ties = ([") + f"\nparts = [{names}]"

    @property
    def program(self):
        s = self.sketch
        coupler = call("coupler = pm.Coupler", ["parts", "ties"], s.coupler)
        run = call("history = coupler.run", [], s.run)
        return f"{self.imports}\n\n{self.setup}\n{coupler}\n{run}"

    @property
    def imports(self):
        text = self.setup
        more = [m for m in ("rig", "structures") if f"{m}." in text]
        lines = [HEADER, *([f"from pmalpha import {', '.join(more)}"] if more else [])]
        return "\n".join(lines + ["import compiled"] * ("compiled." in text))

    @cached_property
    def space(self):
        return {}

    def couple(self, change=None, tied=None, **options):
        """A Coupler with these options besides; of subdomains made once, or of others whose
        arguments are ``change(arguments)`` and constraints ``tied(constraints)``."""
        if not self.space:
            self.space.update(MODULES)
            exec(compile(self.setup, "problem", "exec"), self.space)
        space = self.space
        if change is not None:
            space = {**MODULES, "pm": Changed(change)}
            exec(compile(self.setup, "problem", "exec"), space)
        ties = space["ties"] if tied is None else tied(space["ties"])
        return pm.Coupler(space["parts"], ties, **(self.options() | options))

    def options(self):
        """The arguments of `Coupler` besides subdomains and constraints."""
        return {key: eval(text, self.space) for key, text in self.sketch.coupler.items()}

    @property
    def is_unscaled(self):
        return any(FEATURES[name].unscaled for name in self.features())

    def recording(self):
        """The arguments of `run`, but the number of steps."""
        chosen = {key: eval(text, self.space) for key, text in self.sketch.run.items()}
        chosen.pop("steps")
        return chosen

    def written(self, **changes):
        return replace(self, writing=replace(self.writing, **changes))

    def without(self, choice):
        return replace(self, choices=tuple(c for c in self.choices if c != choice))


def rng_of(seed, *words):
    return np.random.default_rng([seed, *(crc32(str(w).encode()) for w in words)])


def sketched(problem):
    """The program of a problem: subdomains and their ties, then the features in their order."""
    seed, writing = problem.seed, problem.writing
    rng = rng_of(seed, "sizes")
    fine = int(rng.choice([2, 3, 4, 6]))
    parts = []
    for i in range(problem.count):
        own = rng_of(seed, "part", i)
        n = int(own.integers(1, 4))
        A = own.normal(size=(n, n))
        order = np.arange(n)
        if writing.order is not None:
            order = np.random.default_rng([writing.order, i]).permutation(n)
        M, K = np.diag(own.uniform(1.0, 3.0, n)), np.round(4.0 * A @ A.T / n + np.eye(n), 3)
        parts.append(Part(NAMES[i], i, writing, M, K, order, np.zeros(n), np.zeros(n)))
    s = Sketch(writing, fine, parts)
    s.coupler = {"dt": s.number(TIME_STEP, time=1)}
    s.run = {"steps": str(STEPS)}
    taken = list(problem.choices)
    for k in range(problem.count - 1):
        if not any(p == k and FEATURES[name].group == "tie" for name, p in taken):
            taken.append(("tie", k))
    for part in parts:
        if not any(p == part.index and FEATURES[name].group == "scheme" for name, p in taken):
            taken.append(("generalized alpha", part.index))
    for name, place in sorted(taken, key=lambda c: list(FEATURES).index(c[0])):
        at = parts[place] if FEATURES[name].place == "subdomain" else place
        FEATURES[name].add(s, at, rng_of(seed, name, place))
    _spread_stillness(s)
    for part in parts:
        _close(s, part)
    if problem.count > 1:
        s.coupler.setdefault("coupling", '"gc"')
    return s


def _spread_stillness(s):
    """A subdomain with dofs without mass begins at rest, and dofs tied to what is still do."""
    s.still |= {(p.index, i) for p in s.parts if p.light for i in range(p.n)}
    pairs = [((a.index, a.n - 1), (b.index, 0)) for a, b in zip(s.parts, s.parts[1:])]
    for one, two in [*pairs, *pairs[::-1]]:
        if one in s.still or two in s.still:
            s.still |= {one, two}


def _close(s, part):
    """What follows from all features of a subdomain."""
    if not part.built:
        part.arguments.setdefault("M", part.matrix(part.M, force=1, time=2, length=-1))
        part.arguments.setdefault("K", part.matrix(part.K, force=1, length=-1))
    if part.substeps > 1:
        part.arguments["substeps"] = str(part.substeps)
    for name, x, units in (("u0", part.u0, {}), ("v0", part.v0, {"time": -1})):
        still = [(part.index, i) in s.still for i in range(part.n)]
        x = np.where(still, 0.0, x)
        if x.any():
            part.arguments[name] = part.vector(x, length=1, **units)


def draw(rng, wanted=(), without=(), size=8):
    """A problem with up to `size` features, `wanted` among them and none of `without`."""
    seed, count = int(rng.integers(2**31)), int(rng.choice([1, 2, 2, 2, 3, 3]))
    wanted = list(wanted)
    if any(FEATURES[name].place == "tie" for name in wanted):
        count = max(count, 2)
    others = [name for name in FEATURES if name not in without and name not in wanted]
    names = wanted + list(rng.permutation(others)[: max(0, int(rng.integers(1, size + 1)))])
    choices = []
    for name in names:
        places = {"subdomain": count, "tie": count - 1}.get(FEATURES[name].place, 1)
        if places:
            choices.append((str(name), int(rng.integers(places))))
    return Problem(seed, count, compatible(choices))


def compatible(choices):
    """Of each group one feature at a place."""
    kept, groups = [], set()
    for name, place in choices:
        group = FEATURES[name].group
        if not group or (group, place) not in groups:
            kept.append((name, place))
            groups.add((group, place))
    return tuple(kept)


def shrunk(problem, fails):
    """The problem with features, then subdomains, left out one by one while it still fails."""
    smaller = True
    while smaller:
        smaller = False
        for choice in problem.choices:
            if fails(problem.without(choice)):
                problem, smaller = problem.without(choice), True
        last = problem.count - 1
        less = [c for c in problem.choices if not _is_at(c, last)]
        if last and fails(fewer := replace(problem, count=last, choices=tuple(less))):
            problem, smaller = fewer, True
    return problem


def _is_at(choice, last):
    name, place = choice
    kind = FEATURES[name].place
    return (kind == "subdomain" and place == last) or (kind == "tie" and place == last - 1)


import features  # noqa: E402, F401 - which fill FEATURES
