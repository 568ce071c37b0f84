"""`Coupler.jacobian`: how recorded motions depend on parameters.

Either by forward sensitivities, a run for each parameter, or by reversed runs, one for each sensor
and each of its substeps in a macro step: from rest, the adjoint of a sensor at one macro time level
is that at another one, shifted. Its products with the motion are convolutions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, TypeAlias

import numpy as np

from ..problem.dofs import dof_list
from ..problem.forces import SampledForce
from .differences import by_differences
from .gradient import checked_parameters, from_beginning, steps_of
from .misfit import KINDS, places
from .parameters import Parameters
from .problem import Problem, require_adjoint, subdomain_of

# Parameters of one subdomain, its name, and its motion by what it is multiplied by.
Of: TypeAlias = "tuple[Parameters, str, dict[str, np.ndarray]]"

# A reversed run with its convolutions takes the time of so many forward sensitivities.
ADVANTAGE = 2
# Cases whose loads are in memory at one time.
TOGETHER = 64


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
    parameters = checked_parameters(parameters)
    if not parameters:
        raise ValueError("parameters must be at least one, got none")
    if what not in KINDS:
        raise ValueError(f"what must be one of {', '.join(KINDS)}, got {what!r}")
    sensors = checked_sensors(sensors, session.keys)
    names = [subdomain_of(session.keys, p) for p in parameters]
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
    require_adjoint(session, "jacobian without differences=")
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
    cases = [case for each in of for case in _cases(problem, *each)]
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
    each = [
        (name, column, dof, before)
        for name, dofs in sensors.items()
        for column, dof in enumerate(dofs)
        for before in range(members[name].substeps)
    ]
    done = 0
    for chunk in _chunks(each):
        cases = [
            problem.unit_loads(name, dof, before, what, steps) for name, _, dof, before in chunk
        ]
        runs = problem.reversed_runs(cases, steps, dict.fromkeys(names))
        for (name, column, _, before), run in zip(chunk, runs):
            mus = {x: sfft.rfft(members[x].adjoint_of(run[x]), lengths[x], axis=0) for x in names}
            level = slice(members[name].substeps - before, None, members[name].substeps)
            first = 0
            for p, own, motion in spectra:
                q = members[own].substeps
                series = sfft.irfft(p._spectrum(mus[own], motion), lengths[own], axis=0)
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
