"""Derivatives by differences of whole runs, for what has no adjoint.

That are springs, restoring and internal forces, contacts and "mean" coupling.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from .._checks import real_number
from ..problem.matrices import combination
from ..setup.remade import remade
from .ground import with_mass
from .parameters import Parameters

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
