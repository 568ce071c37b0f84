"""`Coupler.gradient`: value and gradient of a function of a linear run.

`Coupler.jacobian`: how recorded motions depend on parameters.

Either by forward sensitivities, a run for each parameter, or by reversed runs, one for each sensor
and each of its substeps in a macro step: from rest, the adjoint of a sensor at one macro time level
is that at another one, shifted. Its products with the motion are convolutions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from .._checks import real_number, whole_number
from ..memory import available, require
from ..problem.dofs import dof_list
from ..problem.matrices import combination
from ..problem.sampled import SampledForce
from ..results.history import History
from ..setup.ranks import remade
from .adjoint import Adjoint, AdjointMember, Problem, Sources, subdomain_of
from .parameters import KINDS, Misfit, Parameters, check_masses, places, with_mass

# ---- differences --------------------------------------------------------------------------------
# Derivatives by differences of whole runs, for what has no adjoint. That are springs, restoring
# and internal forces, contacts and "mean" coupling.

# The smallest step: above it parameters of any size keep some digits of their change.
SMALLEST = 1e-300


def by_differences(
    session: Any,
    make: Callable[..., Any],
    of: Sequence[tuple[Parameters, str]],
    steps: int,
    record: Any,
    differences: float,
    reporting: Callable[[int], AbstractContextManager[Any]],
) -> Iterator[tuple[Any, Any, float]]:
    """For each parameter the Histories with it smaller and larger, and the difference of the two.

    make: makes a coupler, with the arguments of `Coupler`.
    of: sequence of (Parameters, name of their subdomain).
    differences: by which each parameter is changed to both sides.
    reporting: makes the report of a number of runs.
    """
    h = real_number(differences, "differences", low=SMALLEST)
    count, total = 0, 2 * sum(p.m for p, _ in of)
    with reporting(total) as report:
        for p, name in of:
            for j in range(p.m):
                pair = []
                for step in (-h, h):
                    coupler = _changed(session, make, p, name, j, step)
                    pair.append(coupler.run(steps=steps, record=record))
                    count += 1
                    if report is not None:
                        report(count)
                yield pair[0], pair[1], 2.0 * h


def _changed(
    session: Any, make: Callable[..., Any], p: Parameters, name: str, j: int, step: float
) -> Any:
    """The coupler at t = 0 with parameter j changed by a step."""

    def change(key: str, arguments: dict[str, Any]) -> None:
        if key != name:
            return
        dofs = np.arange(arguments["u0"].size)
        for kind in p.matrices:
            arguments[kind] = combination(
                [(1.0, arguments[kind]), (step, p._matrix(kind, j, dofs))]
            )
        if "M" in p.matrices:
            arguments["force"] = with_mass(arguments["force"], arguments["M"])

    return remade(session, make, change)


# ---- gradient -----------------------------------------------------------------------------------

__all__ = ["Gradient"]


def __dir__() -> list[str]:
    return sorted(__all__)


# Macro steps in a block: rounding grows with it, and the memory of a block.
BLOCK = 100
# Numbers for each dof and level of a block: motion of both runs, loads, filters.
ARRAYS = 12
# Bytes of the motion that the gradient needs, up to which the run keeps it; else it is run again.
KEPT = 2**27
# Parameters of one subdomain, its name, and its motion by what it is multiplied by.
Of: TypeAlias = "tuple[Parameters, str, dict[str, np.ndarray]]"
# A reversed run with its convolutions takes the time of this number of forward sensitivities.
ADVANTAGE = 2
# Cases whose loads are in memory at one time.
TOGETHER = 64


@dataclass(frozen=True)
class Gradient:
    """Value and gradient of a function of a run, of `Coupler.gradient`.

    Attributes
    ----------
    value : float
    parameters : list of (m,) arrays
        With respect to each of the `Parameters`.
    force : dict of (levels, n) arrays
        With respect to the loads at the time levels of each subdomain, from t = 0 on.
    u0, v0 : dict of (n,) arrays
        With respect to the initial values.
    velocity : (interface levels, p) array or None
        With respect to the velocities that the constraints prescribe, from t = 0 on. The initial
        accelerations depend on g'(0), which is that of a straight line between the first two
        levels; initial velocities are those of `v0`. By differences `force`, `u0` and `v0` are
        empty, and this is None.
    history : History
        The run.
    """

    value: float
    parameters: list[np.ndarray]
    force: dict[str, np.ndarray]
    u0: dict[str, np.ndarray]
    v0: dict[str, np.ndarray]
    velocity: np.ndarray | None
    history: Any

    def __repr__(self) -> str:
        sizes = [len(x) for x in self.parameters]
        of = f"by {sizes} parameters" if sizes else "by loads and initial values"
        return f"<Gradient of the value {self.value:.6g} {of}>"


def gradient(
    coupler: Any,
    session: Any,
    objective: Any,
    end: tuple[float | None, int | None],
    parameters: Any,
    block: int | None,
    differences: float | None,
    reporting: Callable[[int], AbstractContextManager[Any]],
) -> Gradient:
    """`Coupler.gradient`; `reporting` makes the report of a number of macro steps, or of runs."""
    parameters, names = checked_parameters(parameters, session)
    if not callable(objective):
        raise TypeError(f"objective must be a Misfit or a function of a History, got {objective!r}")
    if isinstance(objective, Misfit):
        objective = objective._placed(dict(session.keys), session.rows.p)
    block = None if block is None else whole_number(block, "block", low=1)
    if differences is not None:
        of = list(zip(parameters, names))
        return _by_differences(coupler, session, objective, end, of, differences, reporting)
    with from_beginning(coupler, session):
        problem, steps = Problem(coupler, session), steps_of(session, end)
        block = fitting(problem.single.members, steps) if block is None else block
        with reporting(2 * steps) as report:
            blocks = Blocks(coupler, problem, steps, block, report)
            return blocks.gradient(objective, parameters, names)


def _by_differences(
    coupler: Any,
    session: Any,
    objective: Any,
    end: tuple[float | None, int | None],
    of: Sequence[tuple[Parameters, str]],
    differences: float,
    reporting: Callable[[int], AbstractContextManager[Any]],
) -> Gradient:
    record = objective.record if isinstance(objective, Misfit) else None
    with from_beginning(coupler, session):
        steps = steps_of(session, end)
        history = coupler.run(steps=steps, record=record)
    runs = by_differences(session, type(coupler), of, steps, record, differences, reporting)
    slopes = np.array([(objective(b)[0] - objective(a)[0]) / h for a, b, h in runs])
    split = np.split(slopes, np.cumsum([p.m for p, _ in of])[:-1])
    return Gradient(objective(history)[0], split, {}, {}, {}, None, history)


@contextmanager
def from_beginning(coupler: Any, session: Any) -> Iterator[None]:
    """At t = 0 with the present initial values and loads; afterwards as before."""
    if session.changed:
        dt = session.assemblies.first_layout.dt
        raise ValueError(
            f"a gradient needs the steps with which the coupler was made, dt = {dt:g}, got those "
            "of change_steps; reset returns to the first ones, another Coupler has any"
        )
    present, last = coupler.snapshot(), session.last_history
    names = [name for name, _ in session.keys]
    u0, v0 = (dict(zip(names, x)) for x in zip(*session.initial.values))
    try:
        coupler.reset(u0, v0, dict(zip(names, session.loads.forces)))
        yield
    finally:
        coupler.restore(present)
        session.last_history = last


def steps_of(session: Any, end: tuple[float | None, int | None]) -> int:
    """The number of macro steps from t = 0, at least one."""
    steps: int = session.clock.end(*end, 0)
    if steps == 0:
        raise ValueError("a gradient needs a run of at least one macro step, got none")
    return steps


def fitting(members: Sequence[AdjointMember], steps: int) -> int:
    """Macro steps of a block that fit into half of the memory beside the gradient of the loads.

    MemoryError where that alone does not fit.
    """
    level = 8 * sum(x.n * x.substeps for x in members)
    require(steps * level, "the gradient with respect to the loads", "take fewer macro steps")
    left = available()
    if left is None or level == 0:
        return BLOCK
    return min(max(int(0.5 * (left - steps * level) / (ARRAYS * level)), 1), BLOCK)


class Blocks:
    """A run in blocks of macro steps, forward and back."""

    def __init__(self, coupler: Any, problem: Problem, steps: int, block: int, report: Any):
        self.coupler, self.steps, self.report = coupler, steps, report
        self.problem, self.single, self.steady = problem, problem.single, problem.steady
        lead = 0 if self.single is self.steady else min(1, steps)
        self.borders = sorted({0, lead, steps, *range(lead, steps, block)})

    def adjoint(self, first: int) -> Adjoint:
        """That of the block that begins there."""
        return self.single if first == 0 else self.steady

    def forward(self, record: Any, names: Sequence[str]) -> tuple[list[Any], list[Any], Any]:
        """Of each block a snapshot at its beginning or its motion, w at all borders, the History.

        `names` are the subdomains of the parameters.
        """
        sizes = {x.name: x.n * x.substeps for x in self.single.members}
        in_memory = 24 * self.steps * sum(sizes[name] for name in set(names)) <= KEPT
        if in_memory and record is not None:
            record = {**record, **dict.fromkeys(names)}
        blocks, pieces, borders = [], [], []
        self.coupler.step(0)  # the initial accelerations
        for first, last in zip(self.borders, self.borders[1:]):
            snapshot = None if in_memory else self.coupler.snapshot()
            borders.append(self.problem.accelerations())
            pieces.append(self.coupler.run(steps=last - first, record=record))
            blocks.append(pieces[-1] if in_memory else snapshot)
            self._reported(last)
        borders.append(self.problem.accelerations())
        return blocks, borders, type(pieces[0]).join(pieces)

    def motion(self, block: Any, steps: int, names: Sequence[str]) -> Any:
        """That of a block of which there is the motion or a snapshot."""
        if isinstance(block, History):
            return block
        self.coupler.restore(block)
        return self.coupler.run(steps=steps, record=dict.fromkeys(names))

    def _ground(self, x: AdjointMember, first: int, last: int) -> np.ndarray:
        """The acceleration of the ground at the levels of macro steps first to last."""
        return self.problem.ground(x.name, first * x.substeps, last * x.substeps)

    def _reported(self, done: int) -> None:
        if self.report is not None:
            self.report(done)

    def gradient(
        self, objective: Any, parameters: Sequence[Parameters], names: Sequence[str]
    ) -> Gradient:
        """`names` are the subdomains of the parameters."""
        record = objective.record if isinstance(objective, Misfit) else None
        blocks, accelerations, history = self.forward(record, names)
        result = objective(history)
        if not isinstance(result, Sequence) or len(result) != 2:
            raise TypeError(
                "objective must return its value and the derivatives by subdomain, or be a Misfit, "
                f"got {result!r}"
            )
        value, derivatives = result
        members, p, fine = self.single.members, self.single.p, self.single.fine
        sources, of_lam = checked_sources(members, derivatives, history, self.steps)
        if self.problem.mean and (of_lam is not None or any(np.any(x.w) for x in sources.values())):
            raise ValueError(
                'objective must be a function of u and v under "mean", whose multipliers and '
                "accelerations alternate, got a source of a or of multipliers"
            )

        totals = [np.zeros(p.m) for p in parameters]
        force = {x.name: np.zeros((self.steps * x.substeps + 1, x.n)) for x in members}
        velocity = np.zeros((self.steps * fine + 1, p))
        place = {x.name: i for i, x in enumerate(members)}
        handed = self.steady.nothing_handed()
        start, of_start = handed.states, np.zeros(p)
        for first, last in zip(self.borders[-2::-1], self.borders[:0:-1]):
            adjoint = self.adjoint(first)
            if last < self.steps:
                handed = adjoint.taking_over(start, of_start)
            run = self.motion(blocks.pop(), last - first, names)
            end, beginning = accelerations.pop(), accelerations[-1]
            mus, nu, start, of_start = adjoint.block(sources, of_lam, first, last, handed)
            velocity[first * fine + 1 : last * fine + 1] = nu
            for x, mu, eta in zip(members, mus, handed.eta):
                force[x.name][first * x.substeps + 1 : last * x.substeps + 1] = mu
                force[x.name][last * x.substeps] += eta
            for total, of, name in zip(totals, parameters, names):
                i = place[name]
                x = adjoint.members[i]
                motion = x.motion(run[name], beginning[i])
                motion["M"] = motion["M"] + self._ground(x, first, last)
                at_end = end[i] + self._ground(x, last, last)
                total += _of_block(of, motion, mus[i], at_end, handed.eta[i])
                total += adjoint.of_interface(of, x, run.multipliers, nu)
            self._reported(2 * self.steps - first)
        if of_lam is not None:
            of_start = of_start + of_lam[0]
        at_zero, u0, v0, slope = self.single.at_zero(sources, start, of_start)
        velocity[:2] += np.outer([-1.0, 1.0], slope) / self.single.h
        for x, mu in zip(members, at_zero):
            force[x.name][0] = mu
        for total, of, name in zip(totals, parameters, names):
            at = run[name]
            i = place[name]
            w = beginning[i] + self._ground(members[i], 0, 0)
            motion = {"M": w, "C": at.v[:1], "K": at.u[:1]}
            total += of._products(force[name][:1], motion)
        of_u0, of_v0 = dict(zip(place, u0)), dict(zip(place, v0))
        return Gradient(value, totals, force, of_u0, of_v0, velocity, history)


def _of_block(
    of: Parameters, motion: Mapping[str, np.ndarray], mu: np.ndarray, w: np.ndarray, eta: np.ndarray
) -> np.ndarray:
    """(A9) of a block, w (1, n) that at its end, with eta of (A14)."""
    at_end = {kind: y[-1:] for kind, y in motion.items()} | {"M": w}
    sums: np.ndarray = of._products(mu, {kind: y[1:] for kind, y in motion.items()})
    sums = sums + of._products(eta[None], at_end)
    return sums


def checked_parameters(parameters: Any, session: Any) -> tuple[list[Parameters], list[str]]:
    """One or several Parameters, and the subdomains they are of."""
    listed = [parameters] if isinstance(parameters, Parameters) else list(parameters)
    for p in listed:
        if not isinstance(p, Parameters):
            raise TypeError(f"parameters must be Parameters, got {type(p).__name__}")
    names = [subdomain_of(session.keys, p) for p in listed]
    check_masses(session.keys, session.loads.forces, listed, names)
    return listed, names


def checked_sources(
    members: Sequence[AdjointMember], sources: Any, history: Any, steps: int
) -> tuple[dict[str, Sources], np.ndarray | None]:
    """What the objective returned, by subdomain, and that of the multipliers."""
    if not isinstance(sources, Mapping):
        raise TypeError(f"objective must return (value, sources), a dict, got {sources!r}")
    names = [x.name for x in members]
    if unknown := set(sources) - {*names, "multipliers"}:
        raise KeyError(f"sources must be by subdomain, {names}, got {sorted(map(str, unknown))}")
    of_lam = sources.get("multipliers")
    if of_lam is not None:
        of_lam = np.asarray(of_lam, float)
        if of_lam.shape != history.multipliers.shape:
            raise ValueError(
                f"the source of multipliers must have shape {history.multipliers.shape}, got "
                f"{of_lam.shape}"
            )
    return {x.name: _sources(x, sources.get(x.name, {}), history, steps) for x in members}, of_lam


def _sources(x: AdjointMember, sources: Mapping[str, Any], history: Any, steps: int) -> Sources:
    """The sources of a subdomain as the objective returned them, on the dofs where they are."""
    levels = steps * x.substeps + 1
    if not sources:
        none = np.zeros((levels, 0))
        return Sources(np.zeros(0, int), none, none, none)
    dofs = history[x.name].dofs
    if unknown := set(sources) - set(KINDS):
        raise ValueError(
            f"sources of {x.name!r} must be of u, v or a, got {sorted(map(str, unknown))}"
        )
    arrays = []
    for kind in KINDS:
        array = np.zeros((levels, dofs.size)) if kind not in sources else np.asarray(sources[kind])
        if array.shape != (levels, dofs.size):
            raise ValueError(
                f"the source {kind} of {x.name!r} must have shape {(levels, dofs.size)}, got "
                f"{array.shape}"
            )
        arrays.append(array)
    present = np.any([np.any(array, axis=0) for array in arrays], axis=0)
    return Sources(dofs[present], *(array[:, present] for array in arrays))


def jacobian(
    coupler: Any,
    session: Any,
    sensors: Mapping[str, Any],
    end: tuple[float | None, int | None],
    parameters: Any,
    what: str,
    differences: float | None,
    reporting: Callable[[int], AbstractContextManager[Any]],
) -> dict[str, np.ndarray]:
    """`Coupler.jacobian`; `reporting` makes the report of a number of parameters or runs."""
    parameters, names = checked_parameters(parameters, session)
    if not parameters:
        raise ValueError("parameters must be at least one, got none")
    if what not in KINDS:
        raise ValueError(f"what must be one of {', '.join(KINDS)}, got {what!r}")
    sensors = checked_sensors(sensors, session.keys)
    if differences is not None:
        with from_beginning(coupler, session):
            steps, of_names = steps_of(session, end), list(zip(parameters, names))
        make = type(coupler)
        runs = by_differences(session, make, of_names, steps, sensors, differences, reporting)
        columns = []
        for histories in runs:
            a, b = (_recorded(x, sensors, what) for x in histories[:2])
            columns.append({name: (b[name] - a[name]) / histories[2] for name in sensors})
        return _stacked(columns)
    with from_beginning(coupler, session):
        problem = Problem(coupler, session)
        problem.require_constant_interface("jacobian without differences=")
        steps = steps_of(session, end)
        if problem.mean and what == "a":
            raise ValueError('what must be "u" or "v" under "mean", whose accelerations alternate')
        coupler.step(0)
        beginning = problem.accelerations()
        run = coupler.run(steps=steps, record=dict.fromkeys(names))
        motions = problem.motions(run, beginning)
        of = [(p, name, motions[name]) for p, name in zip(parameters, names)]
        count = sum(dofs.size * problem.substeps[name] for name, dofs in sensors.items())
        m = sum(p.m for p in parameters)
        if ADVANTAGE * count < m and problem.invariant and all(map(_at_rest, of)):
            with reporting(count) as report:
                return _by_reversed_runs(problem, of, sensors, steps, what, report)
        with reporting(m) as report:
            return _by_forward_runs(problem, of, sensors, steps, what, report)


def _at_rest(of: Of) -> bool:
    """Whether the parameters do not matter at t = 0, where a reversed run has another end."""
    p, _, motion = of
    return not any(np.any(motion[kind][0]) for kind in p.matrices)


def _by_forward_runs(
    problem: Problem,
    of: Sequence[Of],
    sensors: Mapping[str, np.ndarray],
    steps: int,
    what: str,
    report: Any,
) -> dict[str, np.ndarray]:
    cases = [case for entry in of for case in _cases(problem, *entry)]
    columns: list[dict[str, np.ndarray]] = []
    for chunk in _chunks(cases):
        runs = problem.sensitive(chunk, steps, sensors)
        columns += [_recorded(history, sensors, what) for history in runs]
        if report is not None:
            report(len(columns))
    return _stacked(columns)


def _stacked(columns: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """(levels, sensors, m) by name, of the columns of all parameters."""
    return {name: np.stack([x[name] for x in columns], axis=-1) for name in columns[0]}


def _by_reversed_runs(
    problem: Problem,
    of: Sequence[Of],
    sensors: Mapping[str, np.ndarray],
    steps: int,
    what: str,
    report: Any,
) -> dict[str, np.ndarray]:
    """(A16): the load of each parameter convolved with the adjoint of each sensor."""
    import scipy.fft as sfft

    members = {x.name: x for x in problem.single.members}
    names = {name for _, name, _ in of}
    lengths = {name: sfft.next_fast_len(2 * steps * members[name].substeps) for name in names}
    spectra = [
        (p, name, {kind: sfft.rfft(motion[kind][1:], lengths[name], axis=0) for kind in p.matrices})
        for p, name, motion in of
    ]
    m = sum(p.m for p, *_ in of)
    out = {
        name: np.zeros((steps * members[name].substeps + 1, dofs.size, m))
        for name, dofs in sensors.items()
    }
    loads = [
        (name, column, dof, before)
        for name, dofs in sensors.items()
        for column, dof in enumerate(dofs)
        for before in range(members[name].substeps)
    ]
    done = 0
    for chunk in _chunks(loads):
        cases = [
            problem.unit_loads(name, dof, before, what, steps) for name, _, dof, before in chunk
        ]
        runs = problem.reversed_runs(cases, steps, dict.fromkeys(names))
        for (name, column, _, before), run in zip(chunk, runs):
            mus = {x: sfft.rfft(members[x].adjoint_of(run[x]), lengths[x], axis=0) for x in names}
            level = slice(members[name].substeps - before, None, members[name].substeps)
            first = 0
            for p, subdomain, motion in spectra:
                q = members[subdomain].substeps
                series = sfft.irfft(p._spectrum(mus[subdomain], motion), lengths[subdomain], axis=0)
                out[name][level, column, first : first + p.m] = series[q - 1 : steps * q : q]
                first += p.m
        done += len(chunk)
        if report is not None:
            report(done)
    return out


def checked_sensors(sensors: Any, keys: Any) -> dict[str, np.ndarray]:
    """Dofs by name, each an array of int."""
    if not isinstance(sensors, Mapping) or not sensors:
        raise TypeError(f"sensors must be a dict of dofs by subdomain, got {sensors!r}")
    known = dict(keys)
    if unknown := set(sensors) - set(known):
        raise KeyError(f"sensors must be of {sorted(known)}, got {sorted(map(str, unknown))}")
    return {
        name: dof_list(dofs, known[name].n, f"sensors[{name!r}]", known[name].dof_names)
        for name, dofs in sensors.items()
    }


def _chunks(cases: Sequence[Any]) -> Iterator[Sequence[Any]]:
    for first in range(0, len(cases), TOGETHER):
        yield cases[first : first + TOGETHER]


def _cases(
    problem: Problem, p: Parameters, name: str, motion: dict[str, np.ndarray]
) -> Iterator[dict[str, Any]]:
    """The load of each parameter, -(dM w + dC v + dK u), (A9), with zero initial values."""
    for j in range(p.m):
        dofs, values = p._force(j, motion)
        n = motion["K"].shape[1]
        shape = np.zeros((n, dofs.size))
        shape[dofs, np.arange(dofs.size)] = 1.0
        yield {name: SampledForce(values, problem.dt / problem.substeps[name], shape)}


def _recorded(history: Any, sensors: Mapping[str, Any], what: str) -> dict[str, np.ndarray]:
    return {
        name: getattr(history[name], what)[:, places(history[name].dofs, np.asarray(dofs))]
        for name, dofs in sensors.items()
    }
