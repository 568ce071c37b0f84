"""A History at other times: between its time levels, and its largest values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._checks import counted, real_array, real_number
from . import not_recorded
from .dof_motion import DofMotion, State, columns_of, label_of, largest
from .keys import position
from .quantities import growing, table_of, times_of

__all__ = ["Instant", "Peak"]

# Times that differ from the ends of the run by less than this fraction of a step are the ends.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Instant:
    """All subdomains at one time: `History.at`.

    ``instant["frame"]``, by name, number or object, is a `State`, with ``.u``, ``.v``, ``.a``.

    Attributes
    ----------
    t : float
    multipliers : (p,) array
        The interface force, linear between its times.
    states : tuple of `State` or None
        None for a subdomain that was not recorded.
    keys : tuple of (str, `Subdomain` or None)
        As of the History.
    """

    t: float
    multipliers: np.ndarray
    states: tuple[State | None, ...]
    keys: tuple[tuple[str, Any], ...]

    def __getitem__(self, key: Any) -> State:
        i = position(key, self.keys)
        motion = self.states[i]
        if motion is None:
            raise KeyError(f"subdomain {self.keys[i][0]!r} was not recorded")
        return motion

    def __repr__(self) -> str:
        return f"<t = {self.t:g}: {', '.join(repr(name) for name, _ in self.keys)}>"


@dataclass(frozen=True)
class Peak:
    """The largest absolute values of a subdomain in a run: `History.peak`.

    ``peak["roof"]``, by name or number, has those of one dof.

    Attributes
    ----------
    u, v, a : (dofs,) arrays
        Largest absolute displacement, velocity and acceleration of each recorded dof.
    times : dict of (dofs,) arrays
        By "u", "v" and "a" when they occurred.
    outputs : dict of (rows,) arrays
        Of the outputs of the run.
    dofs : (dofs,) array of int
    n : int or None
    dof_names : sequence of str or None
        As of a `SubdomainHistory`.
    """

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    times: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    dofs: np.ndarray
    n: int | None = None
    dof_names: Sequence[str] | None = None

    def __repr__(self) -> str:
        most = largest(self, self.dofs, self.dof_names)
        return f"<Peak of {counted(self.dofs.size, 'dof')}: {most}>"

    def __getitem__(self, key: int | str) -> DofMotion:
        (j,) = columns_of(key, self.dofs, self.n, self.dof_names, "dof", one=True)
        values = (float(x[j]) for x in (self.u, self.v, self.a))
        return DofMotion(label_of(self.dofs, self.dof_names, j), *values)


def at(history: Any, t: Any) -> Instant:
    times = one_time(t, history.macro_times)
    time = float(times[0])
    states = [s and state(s, times) for s in history.subdomains]
    multipliers = linear(times, history.multiplier_times, history.multipliers)[0]
    return Instant(time, multipliers, tuple(states), history.keys)


def one_time(t: Any, levels: np.ndarray) -> np.ndarray:
    """A time of a run with these time levels, (1,)."""
    return within(levels, np.array([real_number(t, "t")]), "t")


def state(s: Any, times: np.ndarray) -> State:
    """The motion of a subdomain at one time, (1,)."""
    u, v, a = (x[0] for x in hermite(times, s.t, s.u, s.v, s.a))
    return State(u, v, a, s.dofs, s.n, s.dof_names)


def resampled(history: Any, times: Any) -> Any:
    times, t = rising(times, history.macro_times)
    fields: dict[str, Any] = {
        name: between(t, times_of(history, name), x, table_of(history)[name].between)
        for name, x in growing(history).items()
    }
    fields |= dict(multiplier_times=times, macro_times=times, dt=None)
    fields |= dict(energy=not_recorded.ENERGY)
    return replace(
        history, subdomains=tuple(s and resampled_one(s, t) for s in history.subdomains), **fields
    )


def rising(times: Any, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times of a run with these time levels, as given and as `within` has them."""
    values = real_array(times, "times")
    if values.size == 0 or np.any(np.diff(values) <= 0.0):
        raise ValueError("times must be at least one, in rising order")
    return values, within(levels, values, "times")


def resampled_one(s: Any, t: np.ndarray) -> Any:
    """A `SubdomainHistory` at other times of the run."""
    fields: dict[str, Any] = dict.fromkeys(("substep", "double_after"))
    fields |= {
        name: between(t, s.t, x, table_of(s)[name].between) for name, x in growing(s).items()
    }
    fields |= dict(zip("uva", hermite(t, s.t, s.u, s.v, s.a)), t=t)
    outputs = {name: linear(t, s.t, x) for name, x in s.outputs.items()}
    return replace(s, **fields, outputs=outputs)


def between(times: np.ndarray, t: np.ndarray, x: np.ndarray, how: str) -> np.ndarray | None:
    """Columns at other times by `Quantity.between`; None for those that have no value there."""
    if how == "linear":
        return linear(times, t, x)
    if how == "sum":  # what has been summed up to a time is linear between rows
        total = np.cumsum(x, axis=0)
        return np.diff(linear(times, t, total), axis=0, prepend=linear(times[:1], t, total))
    return None


def within(levels: np.ndarray, times: np.ndarray, name: str) -> np.ndarray:
    """The times; those that are the ends of the time levels but for rounding are these ends."""
    first, last = float(levels[0]), float(levels[-1])
    slack = ROUNDING * (last - first) / max(len(levels) - 1, 1)
    outside = times[(times < first - slack) | (times > last + slack)]
    if outside.size:
        raise ValueError(f"{name} must lie in the run, {first:g}..{last:g}, got {outside[0]:g}")
    inside: np.ndarray = np.clip(times, first, last)
    return inside


def hermite(
    times: np.ndarray, t: np.ndarray, u: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u by the cubic Hermite polynomial of u and v, v by its derivative, a linear."""
    if len(t) == 1:
        return tuple(np.repeat(x[:1], len(times), axis=0) for x in (u, v, a))  # type: ignore[return-value]
    i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    h = (t[i + 1] - t[i])[:, None]
    s = (times - t[i])[:, None] / h
    u0, u1, v0, v1 = u[i], u[i + 1], v[i], v[i + 1]
    # u = u0 + s h v0 + s^2 (3 d - 2 v0 h - v1 h) + s^3 (v0 h + v1 h - 2 d),  d = u1 - u0
    d, p, q = u1 - u0, h * v0, h * v1
    square, cube = 3.0 * d - 2.0 * p - q, p + q - 2.0 * d
    between = u0 + s * (p + s * (square + s * cube))
    rate = v0 + s * (2.0 * square + 3.0 * s * cube) / h
    at_end = s == 1.0  # exactly, whatever the rounding
    motion = np.where(at_end, u1, between), np.where(at_end, v1, rate)
    return *motion, (1.0 - s) * a[i] + s * a[i + 1]


def linear(times: np.ndarray, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Columns, linear between their times and constant beyond the first and the last."""
    if len(t) == 1 or x.shape[1] == 0:
        return np.repeat(x[:1], len(times), axis=0)
    i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    s = np.clip((times - t[i]) / (t[i + 1] - t[i]), 0.0, 1.0)[:, None]
    result: np.ndarray = (1.0 - s) * x[i] + s * x[i + 1]
    return result


def peak(s: Any) -> Peak:
    """The largest absolute values of a `SubdomainHistory`."""
    rows = {name: np.abs(getattr(s, name)).argmax(axis=0) for name in "uva"}
    columns = np.arange(s.dofs.size)
    u, v, a = (np.abs(getattr(s, name)[levels, columns]) for name, levels in rows.items())
    times = {name: s.t[levels] for name, levels in rows.items()}
    outputs = {name: np.abs(x).max(axis=0) for name, x in s.outputs.items()}
    return Peak(u, v, a, times, outputs, s.dofs, s.n, s.dof_names)
