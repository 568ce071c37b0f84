"""How well a measured displacement follows its command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from .._checks import real_array, time_step

__all__ = ["Tracking", "tracking"]

# Samples of the delay that the published criterion J1 looks at, and lags of `delay` at most.
SILVA_LAGS, MOST_LAGS = 50, 2000
# Correlations that differ by less are of the same size: of these the shortest delay is taken.
SAME = 1e-3


@dataclass(frozen=True)
class Tracking:
    """Indicators of `tracking`.

    Attributes
    ----------
    delay : float
        By which the measured displacement is late (negative: early), between samples too.
    nrmse : float
        Root mean square of measured - command, divided by that of the command.
    amplitude : float
        Standard deviation of measured divided by that of the command, when aligned by the delay.
    energy : float
        The last of `energies`.
    energies : (k,) array
        Integral of F (d' - x') dt, what a late specimen puts into the structure.
    J1, J2, J3 : float
        Of the benchmark of Silva and others (2020): delay in thousandths of the unit of t, whole
        samples and at most 49; tracking errors in per cent, standard deviation and largest.
    J4, J5, J6, J7, J8, J9 : float or None
        Per cent, of the storeys 1, 2 and 3 against a reference: J4, J6, J7 standard deviations, J5,
        J8, J9 largest values. None without reference.
    """

    delay: float
    nrmse: float
    amplitude: float
    energy: float
    energies: np.ndarray
    J1: float
    J2: float
    J3: float
    J4: float | None = None
    J5: float | None = None
    J6: float | None = None
    J7: float | None = None
    J8: float | None = None
    J9: float | None = None

    def __repr__(self) -> str:
        """The numbers that there are, without the array."""
        values = ((x.name, getattr(self, x.name)) for x in fields(self) if x.name != "energies")
        return f"Tracking({', '.join(f'{name}={x:.4g}' for name, x in values if x is not None)})"


def tracking(
    command: Any,
    measured: Any,
    dt: float,
    *,
    force: Any = None,
    response: Any = None,
    reference: Any = None,
) -> Tracking:
    """Compare a measured displacement with its command.

    Parameters
    ----------
    command, measured : (k,) array
        Displacements d and x at the same times, k at least 4.
    dt : float
        Time between two of them.
    force : (k,) array, optional
        F, measured. Default: that of a spring of stiffness 1, F = x.
    response, reference : (k, s) arrays, optional
        Displacements of up to three storeys in the test, the measured one first, and of the same
        structure without a test.

    Returns
    -------
    Tracking
        The indicators.

    Raises
    ------
    ValueError
        For arrays of different lengths, too short ones, and a constant command.

    Examples
    --------
    >>> t = 0.001 * np.arange(4000)
    >>> late = rig.tracking(np.sin(10 * t), 0.9 * np.sin(10 * (t - 0.012)), 0.001)
    >>> print(round(late.delay, 4), round(late.amplitude, 2), round(late.J2))
    0.012 0.9 15
    """
    d, dt = real_array(command, "command"), time_step(dt, "dt")
    if d.size < 4 or not np.ptp(d) > 0.0:
        raise ValueError(f"command must be at least 4 samples that vary, got {d.size}")
    x = _like(measured, d.shape, "measured")
    F = x if force is None else _like(force, d.shape, "force")
    error = x - d
    lag, delay = _delay(d, x)
    early, late = _aligned(d, x, lag)
    mean = 0.5 * (F[1:] + F[:-1])
    energies = np.concatenate([[0.0], np.cumsum(mean * (np.diff(d) - np.diff(x)))])
    return Tracking(
        delay=delay * dt,
        nrmse=float(np.linalg.norm(error) / np.linalg.norm(d)),
        amplitude=float(late.std() / early.std()),
        energy=float(energies[-1]),
        energies=energies,
        **criteria(d, x, dt, response, reference),
    )


def criteria(
    d: np.ndarray, x: np.ndarray, dt: float, response: Any, reference: Any
) -> dict[str, float]:
    """J1 to J3 of a command and what was measured, and J4 to J9 with a reference."""
    lags = range(min(SILVA_LAGS, d.size - 2))
    lag = int(np.argmax([_correlation(*_aligned(d, x, j)) for j in lags]))
    of_command = {"J1": 1e3 * dt * lag, "J2": _of_deviation(x, d), "J3": _of_largest(x, d)}
    return of_command | _of_storeys(response, reference, d.size)


def _like(values: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    array = real_array(values, name)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape} as command, got {array.shape}")
    return array


def _aligned(d: np.ndarray, x: np.ndarray, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """d(t) and x(t + lag) where both are known."""
    n = d.size - abs(lag)
    return d[max(0, -lag) :][:n], x[max(0, lag) :][:n]


def _correlation(d: np.ndarray, x: np.ndarray) -> float:
    d, x = d - d.mean(), x - x.mean()
    size = float(np.linalg.norm(d) * np.linalg.norm(x))
    return float(d @ x) / size if size > 0.0 else 0.0


def _delay(d: np.ndarray, x: np.ndarray) -> tuple[int, float]:
    """The lag of the largest correlation, in whole samples and with the parabola through it.

    Of a periodic motion many are as large: the shortest is taken.
    """
    most = min(MOST_LAGS, d.size // 4)
    lags = np.arange(-most, most + 1)
    values = np.array([_correlation(*_aligned(d, x, int(lag))) for lag in lags])
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    peak = (values >= padded[:-2]) & (values >= padded[2:]) & (values >= values.max() - SAME)
    at = int(min(np.flatnonzero(peak), key=lambda i: abs(lags[i])))
    lag = int(lags[at])
    if not 0 < at < values.size - 1:
        return lag, float(lag)
    before, here, after = values[at - 1 : at + 2]
    curvature = before - 2.0 * here + after
    return lag, lag + (0.5 * (before - after) / curvature if curvature < 0.0 else 0.0)


def _of_deviation(x: np.ndarray, d: np.ndarray) -> float:
    return float(100.0 * (x - d).std() / d.std())


def _of_largest(x: np.ndarray, d: np.ndarray) -> float:
    return float(100.0 * np.abs(x - d).max() / np.abs(d).max())


def _of_storeys(response: Any, reference: Any, k: int) -> dict[str, float]:
    if response is None and reference is None:
        return {}
    if response is None or reference is None:
        raise TypeError("give both response and reference, or none of them")
    x, r = real_array(response, "response", (1, 2)), real_array(reference, "reference", (1, 2))
    if x.shape != r.shape or x.shape[0] != k or x.ndim == 2 and not 1 <= x.shape[1] <= 3:
        raise ValueError(
            f"response and reference must have shape ({k}, s) with up to three storeys s, got "
            f"{x.shape} and {r.shape}"
        )
    columns = list(zip(x.reshape(k, -1).T, r.reshape(k, -1).T))
    result = {name: _of_deviation(*pair) for name, pair in zip(("J4", "J6", "J7"), columns)}
    return result | {name: _of_largest(*pair) for name, pair in zip(("J5", "J8", "J9"), columns)}


# ---- criteria -----------------------------------------------------------------------------------
# The nine criteria of a benchmark for several tests, as a table.

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
