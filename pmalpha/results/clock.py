"""The times of macro steps, and the macro step at which a run ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import MOST, real_number, whole_number

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
