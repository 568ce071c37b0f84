"""`Coupler.jacobian`: how recorded motions depend on parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from ..problem.dofs import dof_list
from ..problem.forces import SampledForce
from .gradient import checked_parameters, return_to_beginning, steps_of
from .misfit import KINDS, places
from .parameters import Parameters
from .problem import Problem, require_adjoint

# Cases whose loads are in memory at one time.
TOGETHER = 64


def jacobian(
    coupler: Any,
    session: Any,
    sensors: Mapping[str, Any],
    end: tuple[float | None, int | None],
    parameters: Any,
    what: str,
    reporting: Callable[[int], AbstractContextManager[Any]],
) -> dict[str, np.ndarray]:
    """`Coupler.jacobian`; `reporting` makes the report of a number of parameters."""
    parameters = checked_parameters(parameters)
    if not parameters:
        raise ValueError("parameters must be at least one, got none")
    if what not in KINDS:
        raise ValueError(f"what must be one of {', '.join(KINDS)}, got {what!r}")
    sensors = checked_sensors(sensors, session.keys)
    require_adjoint(session, "jacobian")
    present, last = coupler.snapshot(), session.last_history
    try:
        return_to_beginning(coupler, session)
        problem = Problem(coupler, session)
        problem.require_constant_interface("jacobian")
        names = [problem.name_of(p) for p in parameters]
        steps = steps_of(session, end)
        run = coupler.run(steps=steps, record=dict.fromkeys(names))
        cases = [x for p, name in zip(parameters, names) for x in _cases(problem, p, name, run)]
        columns = []
        with reporting(len(cases)) as report:
            for chunk in _chunks(cases):
                runs = problem.sensitive(chunk, steps, sensors)
                columns += [_recorded(history, sensors, what) for history in runs]
                if report is not None:
                    report(len(columns))
    finally:
        coupler.restore(present)
        session.last_history = last
    return {name: np.stack([x[name] for x in columns], axis=-1) for name in sensors}


def checked_sensors(sensors: Any, keys: Any) -> dict[str, np.ndarray]:
    """Dofs by name, each an array of int."""
    if not isinstance(sensors, Mapping) or not sensors:
        raise TypeError(f"sensors must be a dict of dofs by subdomain, got {sensors!r}")
    sizes = {name: s.n for name, s in keys}
    if unknown := set(sensors) - set(sizes):
        raise KeyError(f"sensors must be of {sorted(sizes)}, got {sorted(map(str, unknown))}")
    return {
        name: dof_list(dofs, sizes[name], f"sensors[{name!r}]") for name, dofs in sensors.items()
    }


def _chunks(cases: Sequence[Any]) -> Iterator[Sequence[Any]]:
    for first in range(0, len(cases), TOGETHER):
        yield cases[first : first + TOGETHER]


def _cases(problem: Problem, p: Parameters, name: str, run: Any) -> Iterator[dict[str, Any]]:
    """The load of each parameter, -(dM w + dC v + dK u), (A9), with zero initial values."""
    motion = problem.motion(name, run[name])
    for j in range(p.m):
        dofs, values = p._force(j, motion)
        n = motion["K"].shape[1]
        shape = np.zeros((n, dofs.size))
        shape[dofs, np.arange(dofs.size)] = 1.0
        yield {name: SampledForce(values, run[name].t[1] - run[name].t[0], shape)}


def _recorded(history: Any, sensors: Mapping[str, Any], what: str) -> dict[str, np.ndarray]:
    return {
        name: getattr(history[name], what)[:, places(history[name].dofs, np.asarray(dofs))]
        for name, dofs in sensors.items()
    }
