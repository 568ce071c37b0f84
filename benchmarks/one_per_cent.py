"""Work for one per cent: steps in proportion, steps of the error budget, one step for all.

Three problems, each with one goal. In proportion: the steps of the subdomains have the ratio of
what limits them, one step of each implicit subdomain in a macro step. Budget: turns of
`Coupler.error_budget` and `ErrorBudget.steps` from steps in proportion on. One step: all
subdomains, implicit, at equal steps. Work is matrix entries that substeps read, per time of the
problem; the error is that of the goal against a run with much shorter steps.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from timing import run

import pmalpha as pm
from pmalpha import structures

TARGET = 0.01
TURNS = 8


class Problem(NamedTuple):
    """What is computed, and the steps to begin with.

    make: ``make(dt, substeps, implicit)``, a coupler, with all subdomains implicit or not.
    ratios: substeps of steps in proportion for a macro step of 1; at least 1 is taken.
    """

    make: Callable
    goal: pm.Goal
    t_end: float
    first: int  # macro steps to begin with
    ratios: dict


def tower(dt, substeps, implicit=False):
    """The first example of README.md."""
    K = np.array([[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]])
    soft = pm.Subdomain(
        [1.0, 2.0, 1.0],
        K,
        scheme=pm.GeneralizedAlpha(0.8),
        substeps=substeps["tower"],
        u0=[0.0, 0.0, 0.1],
        name="tower",
    )
    scheme = pm.GeneralizedAlpha(0.8, explicit=not implicit)
    base = pm.Subdomain([1.0], [400e3], scheme=scheme, substeps=substeps["base"], name="base")
    return pm.Coupler([soft, base], pm.tie(soft, 0, base, 0), dt=dt, coupling="macro")


def plates(dt, substeps, implicit=False):
    """A cantilever of two plates, the one at the support of a third of the element size."""
    material = dict(E=200e9, nu=0.3, rho=7800.0, mass="lumped")
    fine = structures.plate(15, 15, 1.0 / 15.0, **material)
    coarse = structures.plate(20, 5, 0.2, origin=(1.0, 0.0), **material)
    tip = coarse.dofs(coarse.nodes_at(x=5.0), "uy")
    push = np.zeros(coarse.n)
    push[tip] = -1e4 / tip.size
    explicit = pm.GeneralizedAlpha(0.8, explicit=not implicit)
    a = fine.subdomain(
        scheme=explicit,
        substeps=substeps["fine"],
        fixed=fine.dofs(fine.nodes_at(x=0.0)),
        name="fine",
    )
    b = coarse.subdomain(
        scheme=pm.GeneralizedAlpha(0.8),
        substeps=substeps["coarse"],
        force=lambda t: np.sin(np.pi * min(t / 0.01, 1.0)) ** 2 * push,
        name="coarse",
    )
    shared = [(f"{c} {i}", f"{c} {j}") for i, j in _edge(fine, coarse) for c in ("ux", "uy")]
    ties = pm.tie(a, [x for x, _ in shared], b, [y for _, y in shared])
    return pm.Coupler([a, b], ties, dt=dt, coupling="macro")


def _edge(fine, coarse):
    """Nodes at x = 1 of both, at the heights of the coarse ones."""
    left, right = fine.nodes_at(x=1.0), coarse.nodes_at(x=1.0)
    heights = fine.points[left, 1]
    for j in right:
        (i,) = left[np.abs(heights - coarse.points[j, 1]) < 1e-9]
        yield i, j


def ricker(t, frequency=4.0, delay=0.35):
    a = (np.pi * frequency * (t - delay)) ** 2
    return (1.0 - 2.0 * a) * np.exp(-a)


STOREYS = 10
ROOF = f"ux {2 * STOREYS}"


def soil(dt, substeps, implicit=False):
    """Soil with dashpots around it, a frame of ten storeys, equipment of 40 Hz on its roof."""
    ground = structures.plate(
        60,
        30,
        2.0,
        E=180e6,
        nu=0.35,
        rho=1900.0,
        plane="strain",
        origin=(-60.0, -60.0),
        mass="lumped",
    )
    mesh = ground
    for side in (dict(y=-60.0), dict(x=-60.0), dict(x=60.0)):
        mesh = mesh.with_damping(ground.absorbing(ground.nodes_at(**side)).C)
    near = mesh.nodes(lambda x, y: (abs(x + 30.0) < 3.0) & (abs(y + 30.0) < 3.0))
    source = np.zeros(mesh.n)
    source[mesh.dofs(near, "ux")] = 2e6 / near.size
    points = [[x, 3.0 * i] for i in range(STOREYS + 1) for x in (-2.0, 2.0)]
    columns = [[2 * i + k, 2 * i + 2 + k] for i in range(STOREYS) for k in (0, 1)]
    beams = [[2 * i, 2 * i + 1] for i in range(1, STOREYS + 1)]
    storeys = structures.beam_frame(points, columns + beams, EA=4e9, EI=6e7, rhoA=400.0)
    below = mesh.subdomain(
        scheme=pm.GeneralizedAlpha(0.8),
        substeps=substeps["soil"],
        force=lambda t: ricker(t) * source,
        name="soil",
    )
    frame = storeys.subdomain(
        scheme=pm.GeneralizedAlpha(0.8),
        substeps=substeps["frame"],
        damping_ratio={0.5: 0.02, 0.05: 0.02},
        name="frame",
    )
    k = 50.0 * (2.0 * np.pi * 40.0) ** 2
    equipment = pm.Subdomain(
        [20.0, 50.0],
        [[k, -k], [-k, k]],
        scheme=pm.GeneralizedAlpha(0.8, explicit=not implicit),
        substeps=substeps["equipment"],
        name="equipment",
    )
    feet = [int(mesh.nodes_at(x=x, y=0.0)[0]) for x in (-2.0, 2.0)]
    ties = [
        pm.tie(below, [f"{c} {node}" for node in feet], frame, [f"{c} 0", f"{c} 1"])
        for c in ("ux", "uy")
    ]
    ties.append(pm.tie(frame, ROOF, equipment, 0))
    return pm.Coupler([below, frame, equipment], ties, dt=dt, coupling="macro")


PROBLEMS = {
    "tower of README": Problem(
        tower, pm.Goal("tower", 2, at=19.64), 19.64, 982, {"tower": 0.0, "base": 1 / 0.003}
    ),
    "two plates": Problem(
        plates, pm.Goal("coarse", "uy 83", at=0.05), 0.05, 100, {"coarse": 0.0, "fine": 1 / 1.2e-5}
    ),
    "soil, frame, equipment": Problem(
        soil,
        pm.Goal("frame", ROOF, at=1.2),
        1.2,
        60,
        {"soil": 0.0, "frame": 0.0, "equipment": 1 / 0.004},
    ),
}


def work(coupler):
    """Matrix entries that substeps read in a second of the problem."""
    members = coupler._session.members
    return sum(x.core.entries * x.substeps for x in members) / coupler.dt


def in_proportion(problem, steps):
    dt = problem.t_end / steps
    return dt, {name: max(1, int(np.ceil(dt * x))) for name, x in problem.ratios.items()}


def value(problem, coupler):
    record = {problem.goal.subdomain: list(problem.goal.dofs)}
    return problem.goal(coupler.run(problem.t_end, record=record))[0]


def searched(problem, exact, make):
    """The longest macro step, within 3 per cent, from which on the error is below the target."""

    def error(steps):
        coupler = make(steps)
        return abs(value(problem, coupler) / exact - 1.0), coupler

    high = problem.first
    while error(high)[0] > TARGET or error(2 * high)[0] > TARGET:
        high *= 2
    low = high // 2
    while high - low > max(1, high // 30):
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle)[0] <= TARGET else (middle, high)
    return error(high)


def measured(name, problem, exact, turns=TURNS):
    rows = []
    for kind in ("in proportion", "one step"):

        def make(steps, kind=kind):
            if kind == "in proportion":
                return problem.make(*in_proportion(problem, steps))
            return problem.make(problem.t_end / steps, dict.fromkeys(problem.ratios, 1), True)

        error, coupler = searched(problem, exact, make)
        rows.append((name, kind, coupler, error))
    coupler = problem.make(*in_proportion(problem, problem.first))
    for _ in range(turns):
        budget = coupler.error_budget(problem.goal, problem.t_end)
        tolerance = TARGET * abs(budget.corrected)
        if budget.bound <= tolerance:
            break
        coupler = problem.make(*budget.steps(tolerance))
    rows.insert(1, (name, "budget", coupler, abs(budget.value / exact - 1.0)))
    return rows


def reference(problem):
    """By two runs with short steps, extrapolated."""
    one, two = (
        value(problem, problem.make(*in_proportion(problem, k * problem.first))) for k in (16, 32)
    )
    return two + (two - one) / 3.0


def rows(quick):
    made = []
    for name, problem in PROBLEMS.items():
        if quick and name != "tower of README":
            continue
        exact = reference(problem)
        for _, kind, coupler, error in measured(name, problem, exact):
            made.append(
                {
                    "problem": name,
                    "steps": kind,
                    "dt": coupler.dt,
                    "substeps": ", ".join(str(s.substeps) for s in coupler.subdomains),
                    "million entries a second": work(coupler) / 1e6,
                    "interface problems a second": 1.0 / coupler.dt,
                    "error %": 100.0 * float(error),
                }
            )
    return made


if __name__ == "__main__":
    run("one_per_cent", rows, about=__doc__)
