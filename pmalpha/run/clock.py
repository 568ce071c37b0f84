"""The times of macro steps, and the macro step at which a run ends."""

from __future__ import annotations

from .._checks import MOST, real_number, whole_number

# Tolerance of t_end, in macro steps: it must be a whole number of them.
TOLERANCE = 1e-6


class Clock:
    """Macro steps of length dt, counted from t = 0."""

    def __init__(self, dt: float):
        self.dt = dt

    def time(self, step: int) -> float:
        """The time at which a macro step begins, equation (T1)."""
        return step * self.dt

    def end(self, t_end: float | None, steps: int | None, begin: int) -> int:
        """The macro step at which a run from macro step `begin` ends."""
        if (t_end is None) == (steps is None):
            raise TypeError("give either t_end or steps, not both or none")
        if steps is not None:
            return begin + whole_number(steps, "steps")
        t_end = real_number(t_end, "t_end")
        if not abs(t_end / self.dt) < MOST:
            raise ValueError(f"t_end must be within {MOST} steps of {self.dt:g}, got {t_end!r}")
        count = round(t_end / self.dt)
        if abs(t_end / self.dt - count) > TOLERANCE:
            raise ValueError(
                f"t_end must be a whole number of macro steps dt = {self.dt:g}, got {t_end!r}, "
                f"which is {t_end / self.dt:.9g} of them"
            )
        if count < begin:
            raise ValueError(
                f"t_end must not be behind the present, t = {self.time(begin):g}, got {t_end!r}"
            )
        return count
