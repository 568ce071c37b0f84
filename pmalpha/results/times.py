"""A History at other times: between its time levels, and its largest values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
from scipy.sparse import issparse

from .._checks import MOST, counted, listing, plain_array, real_array, real_number, whole_number
from .._core import step_errors
from ..problem.dofs import NodeNames, dof_list
from .quantities import NO_ENERGY, growing, position, table_of, times_of

# ---- dof motion ---------------------------------------------------------------------------------
# The motion of dofs by name, and of all dofs at one time.

__all__ = ["DofMotion", "State"]


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True)
class DofMotion:
    """The motion of one dof: ``history["frame"]["roof"]``.

    Attributes
    ----------
    name : str
        Its name in `dof_names`, or its number.
    u, v, a : (k,) arrays, or numbers
        Displacement, velocity and true acceleration; numbers of a `State`.
    t : (k,) array, or None
        Times of the recorded time levels.
    """

    name: str
    u: Any
    v: Any
    a: Any
    t: Any = None

    def __repr__(self) -> str:
        if np.ndim(self.u) == 0:
            return f"<dof {self.name}: u = {self.u:.4g}, v = {self.v:.4g}, a = {self.a:.4g}>"
        return f"<dof {self.name}: {counted(np.size(self.u), 'time level')}>"


@dataclass(frozen=True)
class State:
    """The motion of a subdomain at one time.

    ``state["roof"]``, by name or number, is that of one dof.

    Attributes
    ----------
    u, v, a : (dofs,) arrays
        Displacement, velocity and true acceleration (w of the equations).
    dofs : (dofs,) array of int, or None
        The dofs of the entries. None: all.
    n : int or None
        Number of dofs of the subdomain.
    dof_names : sequence of str, or None
        Names of the entries.
    """

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    dofs: np.ndarray | None = None
    n: int | None = None
    dof_names: Sequence[str] | None = None

    def __getitem__(self, key: int | str) -> DofMotion:
        dofs = np.arange(len(self.u)) if self.dofs is None else self.dofs
        (j,) = columns_of(key, dofs, self.n, self.dof_names, "dof", one=True)
        name = label_of(dofs, self.dof_names, j)
        return DofMotion(name, *(float(x[j]) for x in (self.u, self.v, self.a)))

    def __repr__(self) -> str:
        dofs = np.arange(len(self.u)) if self.dofs is None else self.dofs
        return f"<State of {counted(len(dofs), 'dof')}: {largest(self, dofs, self.dof_names)}>"

    def __iter__(self) -> NoReturn:  # else entry after entry up to an error
        raise TypeError("a State is of one time: take its u, v or a")


def largest(motion: Any, dofs: np.ndarray, names: Sequence[str] | None) -> str:
    """The largest absolute u, v and a of the dofs, in words."""
    if dofs.size == 0:
        return "none recorded"
    sizes = ((kind, np.abs(getattr(motion, kind))) for kind in "uva")
    peaks = ((kind, size, int(np.argmax(size))) for kind, size in sizes)
    return ", ".join(
        f"largest |{kind}| {size[j]:.4g} at dof {label_of(dofs, names, j)}"
        for kind, size, j in peaks
    )


def columns_of(
    selection: Any,
    dofs: np.ndarray,
    n: int | None,
    names: Sequence[str] | None,
    what: str,
    *,
    one: bool = False,
) -> list[int]:
    """The columns of dofs among the recorded ones.

    n: number of dofs of the subdomain; None in files of older versions.
    one: whether it must be a single dof.
    """
    if one and (isinstance(selection, bool) or not isinstance(selection, (int, str, np.integer))):
        raise TypeError(
            f"{what} must be a name or a number, got {selection!r}; arrays of dofs are u, v and a"
        )
    if isinstance(selection, str):
        return [int(x) for x in dof_list(selection, len(dofs), what, names)]
    if plain_array(selection, what).dtype.kind in "UO" and _has_items(selection):
        return [j for x in selection for j in columns_of(x, dofs, n, names, what)]
    numbers = dof_list(selection, np.iinfo(np.int64).max if n is None else n, what)
    if dofs.size and np.array_equal(dofs, np.arange(dofs[0], dofs[0] + dofs.size)):
        column = {int(x): int(x - dofs[0]) for x in numbers if 0 <= x - dofs[0] < dofs.size}
    else:
        places = {int(dof): j for j, dof in enumerate(dofs)}
        column = {int(x): places[int(x)] for x in numbers if int(x) in places}
    missing = [int(x) for x in numbers if int(x) not in column]
    if missing:
        raise ValueError(
            f"{what} must have been recorded, got {listing(missing)}; recorded are {listing(dofs)}"
        )
    return [column[int(x)] for x in numbers]


def _has_items(value: Any) -> bool:
    """Whether it is a list, a set or an array that is not one number; False for sparse matrices."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Iterable) and not issparse(value)


def on_mesh(motion: Any, kind: str = "u") -> np.ndarray:
    """The u, v or a of a motion on all dofs of its mesh, (..., n): zeros at supports.

    motion: what was recorded of a subdomain, or a `State`.
    Returns that of the subdomain where its dofs are not those of a mesh, or not all were recorded.
    """
    x: np.ndarray = getattr(motion, kind)
    names = motion.dof_names
    if not isinstance(names, NodeNames) or len(names) != motion.n:
        return x
    values = np.zeros((*x.shape[:-1], names.model_size))
    values[..., names.numbers] = x
    return values


def label_of(dofs: np.ndarray, names: Sequence[str] | None, j: int) -> str:
    """The name of a column, or the number of its dof."""
    return str(int(dofs[j])) if names is None else names[j]


def labels_of(dofs: np.ndarray, names: Sequence[str] | None) -> list[Any]:
    """The names of columns, or the numbers of their dofs."""
    return [int(x) for x in dofs] if names is None else list(names)


# ---- clock --------------------------------------------------------------------------------------
# The times of macro steps, and the macro step at which a run ends.

# Tolerance of t_end, in macro steps: it must be a whole number of them.
TOLERANCE = 1e-6

# A step is at least this number of spacings between the numbers that a time can be.
SPACINGS = 1024

# The end of the first stage of a scheme of two is at gamma = 2 - sqrt 2 of both of them: by this
# part of their mean length later than the middle. csrc/core/couple/clock.h has the same number.
LATER = 0.17157287525380990


@dataclass(frozen=True)
class Clock:
    """Macro steps of length dt since macro step `origin` at time `t0`, where they began."""

    dt: float
    origin: int = 0  # the macro step of the last change of the steps
    t0: float = 0.0  # its time
    before: float = 0.0  # the length of the macro step before it; 0 where there was none
    # where fine steps are the stages of a scheme of two: their number, else 0
    staged: int = 0

    def __post_init__(self) -> None:
        least = SPACINGS * float(np.spacing(abs(self.t0)))
        if self.t0 and not self.dt >= least:
            raise ValueError(
                f"dt must be at least {least:.3g} at t = {self.t0:g}, where times of shorter steps "
                f"are rounded, got {self.dt:g}"
            )

    def count(self, step: int) -> int:
        """Macro steps from the origin to this one."""
        return step - self.origin

    def level(self, level: int, levels: int) -> float:
        """The time of a time level, `levels` of them in a macro step, counted from the origin."""
        later = LATER if level % 2 and levels == self.staged else 0.0
        return self.t0 + (level + later) / levels * self.dt  # (T1)

    def levels(self, first: int, last: int, levels: int) -> np.ndarray:
        """The same of the time levels first..last; a macro step begins with the first one."""
        times = np.arange(first, last + 1, dtype=float)
        if levels == self.staged:
            times[1::2] += LATER
        if levels > 1:
            times /= levels
        times *= self.dt
        return times + self.t0 if self.t0 else times

    def time(self, step: int) -> float:
        """The time at which a macro step begins, equation (T1)."""
        return self.level(self.count(step), 1)

    def end(self, t_end: float | None, steps: int | None, begin: int) -> int:
        """The macro step at which a run from macro step `begin` ends."""
        if (t_end is None) == (steps is None):
            raise TypeError("give either t_end or steps, not both or none")
        if steps is not None:
            return begin + whole_number(steps, "steps")
        t_end = real_number(t_end, "t_end")
        exact = (t_end - self.t0) / self.dt
        if not abs(exact) < MOST:
            raise ValueError(f"t_end must be within {MOST} steps of {self.dt:g}, got {t_end!r}")
        count = self.origin + round(exact)
        if abs(exact - round(exact)) > TOLERANCE:
            since = f" after the change of the steps at t = {self.t0:g}" if self.origin else ""
            raise ValueError(
                f"t_end must be a whole number of macro steps dt = {self.dt:g}{since}, got "
                f"{t_end!r}, which is {exact:.9g} of them"
            )
        if count < begin:
            raise ValueError(
                f"t_end must not be behind the present, t = {self.time(begin):g}, got {t_end!r}"
            )
        return count


def clock_of(layout: Any) -> Clock:
    """The times of the steps of a `Layout`, from the start."""
    return Clock(layout.dt, staged=layout.staged)


# ---- local error --------------------------------------------------------------------------------
# The estimate (D1) of the error that each step adds, from recorded u, v and a.


def is_complete(history: Any) -> bool:
    """Whether every time level of the subdomain was recorded."""
    t, h = history.t, history.substep
    return h is not None and _farthest(t, h) <= 1e-6 * h


def _farthest(t: np.ndarray, h: float) -> float:
    """The largest difference of a distance of two levels from h; with `every` the first may be
    h, where a run begins just before a recorded level."""
    return float(np.max(np.abs(np.diff(t) - h), initial=0.0))


def previous_level(history: Any, steps: np.ndarray) -> np.ndarray:
    """The level at which the step to level ``steps + 1`` began; -1 where it was not recorded."""
    if history.double_after is None or history.substep is None:
        return steps
    result: np.ndarray = steps - (
        history.t[steps + 1] > history.double_after + 0.5 * history.substep
    )
    return result


def local_error(history: Any) -> np.ndarray:
    """The estimate (D1) for each step and recorded dof, (k - 1, dofs)."""
    if history.substep is None:
        raise ValueError(
            "local_error needs a History of a run with steps of constant length, not of a scheme "
            "of two stages, and no older file"
        )
    if not is_complete(history):
        raise ValueError(
            f"local_error needs all time levels of {history.name!r}, run(every=None): its substep "
            f"is {history.substep:g}, got levels up to {np.max(np.diff(history.t)):g} apart"
        )
    begin = previous_level(history, np.arange(history.t.size - 1))
    known = begin >= 0
    errors = np.full((begin.size, history.dofs.size), np.nan)
    errors[known] = errors_of(history, np.flatnonzero(known)).T
    return errors


def errors_of(history: Any, steps: np.ndarray) -> np.ndarray:
    """e of some of the steps of a subdomain, (D1), (dofs, steps)."""
    begin, end, h = previous_level(history, steps), steps + 1, history.substep or 0.0
    return step_errors((history.u, history.v, history.a), begin, end, h)


# ---- interpolated -------------------------------------------------------------------------------

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
    fields |= dict(energy=NO_ENERGY)
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
