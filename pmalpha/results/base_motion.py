"""The motion of the ground under a subdomain, which absolute outputs add to its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..problem.forces import BaseAcceleration, Force, terms_of

QUANTITIES = ("u", "v", "a")


class Loads(NamedTuple):
    """The loads of a subdomain, as given and as its steps take them: averaged ones as means."""

    force: Force
    seen: Force


def check_ground(loads: Loads, name: str) -> None:
    """ValueError unless the loads have a ground motion whose direction is known."""
    motions = [x for x in terms_of(loads.force) if isinstance(x, BaseAcceleration)]
    if not motions or any(x.direction is None for x in motions):
        got = "one of a reduced subdomain, without its direction" if motions else "none"
        raise ValueError(f"absolute outputs of {name!r} need a BaseAcceleration, got {got}")


def added(loads: Loads, weights: Sequence[Any], t: np.ndarray) -> Any:
    """What the ground adds to outputs at times t, (levels, rows).

    weights: (rows, n) matrices that act on u, v and a of the ground; None without entries.
    """
    total: Any = 0.0
    for ground, seen in zip(terms_of(loads.force), terms_of(loads.seen)):
        if not isinstance(ground, BaseAcceleration):
            continue
        for quantity, W in zip(QUANTITIES, weights):
            if W is not None:
                assert isinstance(seen, BaseAcceleration)
                series = seen._series(t) if quantity == "a" else integrated(ground, quantity, t)
                total = total + _product(series, (W @ ground.direction).T)
    return total


def _product(series: np.ndarray, A: np.ndarray) -> np.ndarray:
    """series @ A, row by row the same for any number of rows, as a product of BLAS is not."""
    total = np.zeros((len(series), A.shape[1]))
    for column, row in zip(series.T, A):
        total += column[:, None] * row
    return total


def integrated(ground: BaseAcceleration, quantity: str, t: np.ndarray) -> np.ndarray:
    """Velocity or displacement of the ground, (levels, k): exact integrals from rest at t = 0."""
    from scipy.interpolate import PPoly

    f, dt = ground.values, ground.dt
    if len(f) == 1:
        return np.zeros((t.size, f.shape[1]))
    end = dt * (len(f) - 1)
    v = PPoly(np.array([np.diff(f, axis=0) / dt, f[:-1]]), dt * np.arange(len(f))).antiderivative()
    within = np.minimum(t, end)
    result: np.ndarray = v(within)
    if quantity == "u":
        result = v.antiderivative()(within) + (t - within)[:, None] * v(end)
    return result
