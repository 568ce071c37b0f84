"""Multipliers of a higher order, and how well macro steps resolve what crosses the interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Resolution"]

# Macro steps are as long as each other up to this part of one.
ROUNDING = 1e-6
# By D, the error of the coupling alone that nine in ten of 160 random runs over four periods did
# not exceed, relative to the largest displacement (error_budgets.py resolution 3000 40).
ERRORS = ((0.003, "3e-4"), (0.01, "2e-3"), (0.03, "2e-2"), (0.1, "0.2"))


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True, repr=False)
class Resolution:
    """How well macro steps resolve the multipliers, from `History.resolution`; printed, a sentence.

    Attributes
    ----------
    by_group : dict of float
        By number of the constraint of the coupler, in their order, D of its rows: the largest
        (M13) correction in the run over the largest multiplier.
    """

    by_group: dict[int, float]

    @property
    def largest(self) -> float:
        """The largest of all; 0 without constraints."""
        return max(self.by_group.values(), default=0.0)

    def __repr__(self) -> str:
        if not self.by_group:
            return "no constraints, no error of a coupling"
        D = self.largest
        worst = max(self.by_group, key=self.by_group.__getitem__)
        where = f" in constraint {worst}" if len(self.by_group) > 1 else ""
        error = next((text for limit, text in ERRORS if limit > D), None)
        if error is None:
            return f"D = {D:.2g}{where}: macro steps do not resolve the coupling, take shorter ones"
        return f"D = {D:.2g}{where}: in four periods the coupling errs by up to {error}, usually"


def corrected(history: Any) -> np.ndarray:
    """(M13), (macro time levels, p)."""
    lam = at_levels(history, "corrected_multipliers")
    second = second_differences(lam)
    if history.coupling == "mean":
        second[[1, -2]] = second[[2, -3]]
    result = lam + second / _sign(history)
    if history.coupling == "mean":
        for rows in (result[:4], result[:-5:-1]):  # quadratic in the level
            rows[0] = 3.0 * rows[1] - 3.0 * rows[2] + rows[3]
    elif history.macro_times[0] == 0.0:
        result[0] = lam[0]  # of the initial accelerations: exact
    return result


def _sign(history: Any) -> float:
    """The means of (M10) leave the multipliers of "macro" too small by this part of their second
    difference, and the means of neighbours of "mean" too large."""
    return -12.0 if history.coupling == "mean" else 12.0


def at_levels(history: Any, call: str) -> np.ndarray:
    """The multipliers at macro time levels; under "mean" means of the two middles about them."""
    if history.coupling not in ("macro", "mean"):
        raise ValueError(
            f'{call} needs a run with coupling "macro" or "mean", got {history.coupling!r}'
        )
    lengths = np.diff(history.macro_times)
    least = 5 if history.coupling == "mean" else 3
    if history.dt is None or np.any(np.abs(lengths - history.dt) > ROUNDING * history.dt):
        raise ValueError(
            f"{call} needs the multipliers of every macro step, of one length, got a History with "
            "every=, of other times, of steps that changed, or of an older version"
        )
    if len(lengths) < least:
        raise ValueError(f"{call} needs at least {least} macro steps, got {len(lengths)}")
    lam: np.ndarray = history.multipliers
    if history.coupling == "macro":
        return lam
    out = np.empty_like(lam)
    out[1:-1] = 0.5 * (lam[1:-1] + lam[2:])
    out[0] = 2.0 * out[1] - out[2]
    out[-1] = 2.0 * out[-2] - out[-3]
    return out


def second_differences(x: np.ndarray) -> np.ndarray:
    """Of all rows; that of the first and the last is the one of its neighbour."""
    out = np.empty_like(x)
    out[1:-1] = x[2:] - 2.0 * x[1:-1] + x[:-2]
    out[0], out[-1] = out[1], out[-2]
    return out


def resolution(history: Any) -> Resolution:
    """D by constraint."""
    lam = at_levels(history, "resolution")
    ends = np.cumsum(history.constraint_rows or (lam.shape[1],))
    size = np.abs(second_differences(lam)).max(axis=0) / 12.0
    largest = np.abs(lam).max(axis=0)
    by_group = {}
    for i, (first, last) in enumerate(zip((0, *ends[:-1]), ends)):
        most = largest[first:last].max(initial=0.0)
        by_group[i] = float(size[first:last].max() / most) if most > 0.0 else 0.0
    return Resolution(by_group if lam.shape[1] else {})
