"""The nine criteria of a benchmark for several tests, as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import real_array, time_step
from .tracking import criteria

__all__ = ["Evaluation", "evaluate"]

CRITERIA = tuple(f"J{i}" for i in range(1, 10))
STOREYS = 3


@dataclass(frozen=True)
class Evaluation:
    """The criteria J1 to J9 of several tests; printed, it is a table.

    Attributes
    ----------
    names : tuple of str
        Of the tests.
    J : (k, 9) array
        J1 in thousandths of the unit of t, the others in per cent.
    """

    names: tuple[str, ...]
    J: np.ndarray

    @property
    def worst(self) -> np.ndarray:
        """The largest of each criterion, (9,)."""
        return np.asarray(np.max(self.J, axis=0))

    def __str__(self) -> str:
        """A line for each test, with four digits."""
        width = max(len(name) for name in (*self.names, "worst"))
        lines = [(" " * width, *CRITERIA)]
        rows = [*self.J, self.worst] if len(self.names) > 1 else list(self.J)
        for name, row in zip((*self.names, "worst"), rows):
            lines.append((name.ljust(width), *(f"{x:.4g}" for x in row)))
        return "\n".join(f"{name} " + " ".join(f"{x:>8}" for x in row) for name, *row in lines)


def evaluate(tests: Mapping[str, Any], reference: Any, dt: float) -> Evaluation:
    """The criteria J1 to J9 of the benchmark of Silva and others (2020), for several tests.

    Parameters
    ----------
    tests : dict of (command, measured, response)
        By name: the command of storey 1 and what was measured, (k,), and the displacements of three
        storeys, (k, 3), of which that of storey 1 is replaced by what was measured.
    reference : (k, 3) array
        Of the same structure without a test.
    dt : float
        Time between two rows.

    Returns
    -------
    Evaluation
        Has ``.names``, ``.J``, ``.worst``; printed, it is a table.

    Raises
    ------
    ValueError
        Without tests, and for arrays of other shapes.

    Examples
    --------
    >>> t = 0.001 * np.arange(4000)
    >>> d = np.sin(10 * t)
    >>> storeys = np.column_stack([d, 2 * d, 3 * d])
    >>> print(rig.evaluate({"late": (d, np.sin(10 * (t - 0.012)), storeys)}, storeys, 0.001))
                J1       J2       J3       J4       J5       J6       J7       J8       J9
    late        12    11.87    11.99    11.87    11.99        0        0        0        0
    """
    r, dt = real_array(reference, "reference", 2), time_step(dt, "dt")
    if r.shape[1] != STOREYS:
        raise ValueError(f"reference must have {STOREYS} columns, got shape {r.shape}")
    if not tests:
        raise ValueError("tests must be at least one, got none")
    rows = []
    for name, test in tests.items():
        if not isinstance(test, tuple) or len(test) != 3:
            raise TypeError(f"tests[{name!r}] must be (command, measured, response), got {test!r}")
        d, x, u = (real_array(x, f"tests[{name!r}]", (1, 2)) for x in test)
        if u.shape != r.shape or d.shape != (len(r),) or x.shape != d.shape:
            raise ValueError(
                f"tests[{name!r}] must have command and measured of {len(r)} rows and response of "
                f"shape {r.shape} as reference, got {d.shape}, {x.shape} and {u.shape}"
            )
        if len(d) < 4 or not np.ptp(d) > 0.0:
            raise ValueError(f"tests[{name!r}] must have a command of at least 4 samples that vary")
        values = criteria(d, x, dt, np.column_stack([x, u[:, 1:]]), r)
        rows.append([values[criterion] for criterion in CRITERIA])
    return Evaluation(tuple(tests), np.array(rows))
