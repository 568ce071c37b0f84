"""A linear functional of a motion: what an error budget is made for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._cached import Frozen
from .._checks import check_word, positive_number, real_array, real_number
from ..problem.dofs import dof_list
from ..problem.subdomain import Subdomain
from ..results.quantities import position
from ..results.times import columns_of, within

__all__ = ["GAUSS", "Basis", "Goal", "basis"]


def __dir__() -> list[str]:
    return sorted(__all__)


# Three Gauss points in [0, 1] and their weights: exact to degree 5.
GAUSS = tuple(zip(0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0]), np.array([5.0, 8.0, 5.0]) / 18))


class Basis(NamedTuple):
    """What u0, v0, u1, v1 of a step are multiplied by, for the motion and its derivatives."""

    u: tuple[Any, ...]
    v: tuple[Any, ...]
    a: tuple[Any, ...]


def basis(s: Any, h: Any) -> Basis:
    """The cubic Hermite polynomial of a step of length h at the share s of it."""
    r = 1.0 - s
    return Basis(
        (r * r * (1.0 + 2.0 * s), h * s * r * r, s * s * (3.0 - 2.0 * s), -h * s * s * r),
        (-6.0 * s * r / h, r * (1.0 - 3.0 * s), 6.0 * s * r / h, s * (3.0 * s - 2.0)),
        (
            (12.0 * s - 6.0) / h**2,
            (6.0 * s - 4.0) / h,
            (6.0 - 12.0 * s) / h**2,
            (6.0 * s - 2.0) / h,
        ),
    )


class Goal(Frozen):
    """A displacement or velocity at a time, or its integral with a weight over the run.

    For `Coupler.error_budget`; `Coupler.gradient` takes it as an objective too. Between two time
    levels the motion is that of `History.at`, a cubic Hermite polynomial and its derivative.

    Parameters
    ----------
    subdomain : str, int or Subdomain
        Of the coupler.
    weights : str, int, dict or (n,) array
        A dof by name or number, or weights by dof, ``{"roof": 1.0, "ground": -1.0}``, or of all
        dofs: the goal is the sum of weights times their motion.
    at : float
        A time, positive. Give this or `weight`.
    weight : callable
        ``w(t)``, a number: the goal is the integral of w times the motion from t = 0 to the end of
        the run, by three Gauss points in each step of the subdomain.
    what : {"u", "v"}, default "u"
        Displacement or velocity.

    Raises
    ------
    TypeError, ValueError
        For none or both of `at` and `weight`, and weights that are all zero or not finite.

    Examples
    --------
    >>> Goal("frame", "roof", at=2.5)
    <Goal: u of 'roof' of 'frame' at t = 2.5>
    >>> Goal("frame", {0: -1.0, 2: 1.0}, weight=lambda t: np.sin(t), what="v")
    <Goal: v of 2 dofs of 'frame', weighted over the run>
    """

    def __init__(
        self,
        subdomain: str | int | Subdomain,
        weights: Any,
        *,
        at: float | None = None,
        weight: Callable[[float], float] | None = None,
        what: str = "u",
    ):
        if (at is None) == (weight is None):
            raise TypeError("give either at or weight, not both or none")
        if weight is not None and not callable(weight):
            raise TypeError(f"weight must be a function of t, got {weight!r}")
        check_word(what, "what", ("u", "v"))
        if not isinstance(subdomain, (str, int, np.integer, Subdomain)):
            raise TypeError(f"subdomain must be a name, a number or a Subdomain, got {subdomain!r}")
        self.subdomain, self.what, self.weight = subdomain, what, weight
        self.at = None if at is None else positive_number(at, "at")
        self.dofs, self.weights = _weighted(weights)
        self._of_all = np.ndim(weights) > 0 and not isinstance(weights, Mapping)
        self._freeze()

    def __repr__(self) -> str:
        s = self.subdomain
        of = repr(s.name if isinstance(s, Subdomain) else s)
        count = len(self.weights)
        one = repr(self.dofs[0]) if isinstance(self.dofs[0], str) else f"dof {self.dofs[0]}"
        when = ", weighted over the run" if self.at is None else f" at t = {self.at:g}"
        return f"<Goal: {self.what} of {one if count == 1 else f'{count} dofs'} of {of}{when}>"

    def __call__(self, history: Any) -> tuple[float, dict[str, dict[str, np.ndarray]]]:
        """The value in a History, and its derivatives, as an objective of a gradient."""
        motion = history[self.subdomain]
        name = history.keys[position(self.subdomain, history.keys)][0]
        what = f"dofs of {name!r} in the Goal"
        columns = columns_of(list(self.dofs), motion.dofs, motion.n, motion.dof_names, what)
        levels, shares = self._points(motion.t)
        h = np.diff(motion.t)[levels]
        u0, v0, u1, v1 = getattr(basis(shares[0], h), self.what)
        sources = {kind: np.zeros(motion.u.shape) for kind in "uv"}
        value = 0.0
        for kind, begin, end in (("u", u0, u1), ("v", v0, v1)):
            of_level = np.zeros(len(motion.t))
            np.add.at(of_level, levels, shares[1] * begin)
            np.add.at(of_level, levels + 1, shares[1] * end)
            sources[kind][:, columns] = np.outer(of_level, self.weights)
            value += float(of_level @ getattr(motion, kind)[:, columns] @ self.weights)
        return value, {name: sources}

    def _points(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Levels before the points in time, and their places in the steps and factors, (2, k)."""
        if self.at is not None:
            time = within(t, np.array([self.at]), "at of the Goal")
            level = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(t) - 2)
            share = (time - t[level]) / np.diff(t)[level]
            return level, np.array([share, [1.0]])
        assert self.weight is not None
        levels, h = np.arange(len(t) - 1).repeat(len(GAUSS)), np.diff(t).repeat(len(GAUSS))
        places, factors = (np.tile(x, len(t) - 1) for x in zip(*GAUSS))
        times = t[levels] + places * h
        values = np.array([_number(self.weight(float(x)), x) for x in times])
        return levels, np.array([places, factors * h * values])

    def _check(self, keys: Sequence[tuple[str, Subdomain]]) -> str:
        """The name of the subdomain among those of a coupler, whose dofs are checked."""
        name, s = keys[position(self.subdomain, keys)]
        if self._of_all and len(self.weights) != s.n:
            raise ValueError(
                f"weights of the Goal must have shape ({s.n},) as the dofs of {name!r}, got "
                f"{self.weights.shape}"
            )
        dof_list(list(self.dofs), s.n, f"dofs of {name!r} in the Goal", s.dof_names)
        return name


def _weighted(weights: Any) -> tuple[tuple[Any, ...], np.ndarray]:
    """Dofs by name or number, and their weights."""
    if isinstance(weights, (str, int, np.integer)) and not isinstance(weights, bool):
        return (weights,), np.ones(1)
    if isinstance(weights, Mapping):
        dofs = tuple(weights)
        numbers = [real_number(x, f"weights[{dof!r}]") for dof, x in weights.items()]
        values = np.array(numbers)
    else:
        values = real_array(weights, "weights")
        dofs = tuple(range(values.size))
    if not np.any(values):
        raise ValueError("weights must have an entry that is not zero, got none")
    return dofs, values


def _number(value: Any, t: float) -> float:
    array = np.asarray(value)
    if array.size != 1:
        raise ValueError(f"weight must return a number, got shape {array.shape} at t = {t:g}")
    return real_number(array.item(), f"weight at t = {t:g}")
