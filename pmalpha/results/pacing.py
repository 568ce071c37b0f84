"""The times of a run that was paced by a clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import counted, whole_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Pacing"]


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True)
class Pacing:
    """When the fine steps of `Coupler.run_paced` were due, and when they were done.

    Times are in seconds of the clock since the first fine step was due.

    Attributes
    ----------
    period : float
        Time between two fine steps, h / rate.
    due, begun, ended : (k,) arrays
        Of each completed fine step: when it should have begun, when it did, and when all of it was
        done.
    commanded, returned : (k,) arrays
        When the command was ready and given to the specimen (of several restoring functions the
        first), and when the force was back (the last); NaN in fine steps without an evaluation.
    shift : (k,) array
        By how much the schedule of each was later than that of the run: the sum of what the missed
        steps before it have shifted it by, with ``on_late="continue"``. In ``due``.
    lost : int
        Macro steps that are NaN in the file of ``record_to`` because the ring was full.
    """

    period: float
    due: np.ndarray
    begun: np.ndarray
    commanded: np.ndarray
    returned: np.ndarray
    ended: np.ndarray
    shift: np.ndarray
    lost: int = 0

    @property
    def lateness(self) -> np.ndarray:
        """How late each fine step began, (k,), in s."""
        late: np.ndarray = self.begun - self.due
        return late

    @property
    def duration(self) -> np.ndarray:
        """How long each fine step took, (k,), in s."""
        length: np.ndarray = self.ended - self.begun
        return length

    @property
    def missed(self) -> int:
        """The number of fine steps that ended after the next one was due."""
        count = self.due.size
        # in ns, as the core has compared them
        next_due = np.floor(1e9 * self.period * np.arange(1, count + 1)) + np.rint(1e9 * self.shift)
        return int(np.count_nonzero(np.rint(1e9 * self.ended) > next_due))

    def percentile(self, q: Any) -> Any:
        """Percentiles of the lateness.

        Parameters
        ----------
        q : float or array of float
            In [0, 100].

        Returns
        -------
        float or ndarray
            In s; NaN for a run without steps.
        """
        values = np.percentile(self.lateness, q) if self.due.size else np.full(np.shape(q), np.nan)
        return float(values) if np.ndim(q) == 0 else values

    def longest(self, count: int = 10) -> np.ndarray:
        """The fine steps that took longest.

        Parameters
        ----------
        count : int, default 10
            Their number.

        Returns
        -------
        (count,) array of int
            Their numbers, the longest first; `duration` has their lengths.
        """
        return np.argsort(-self.duration, kind="stable")[: whole_number(count, "count", low=1)]

    def plot(self, ax: Axes | None = None) -> Axes:
        """A histogram of the lateness and of the duration, in microseconds.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Default: a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            Those drawn in.
        """
        from matplotlib import pyplot

        if ax is None:
            ax = pyplot.subplots()[1]
        samples = {"begin after due": self.lateness, "length of the step": self.duration}
        largest = max([1e-6, *(float(x.max()) for x in samples.values() if x.size)])
        bins = np.geomspace(0.1, 1.001e6 * largest, 60)
        for label, x in samples.items():
            ax.hist(np.maximum(1e6 * x, bins[0]), bins.tolist(), histtype="step", label=label)
        ax.axvline(1e6 * self.period, color="0.6", linewidth=1.0, label="period")
        ax.set(xscale="log", yscale="log", xlabel="time (µs)", ylabel="fine steps")
        ax.legend()
        return ax

    def __repr__(self) -> str:
        if not self.due.size:
            return "<Pacing: no fine steps>"
        middle, high, most = 1e6 * self.percentile([50.0, 99.0, 100.0])
        return (
            f"<Pacing: {counted(self.due.size, 'fine step')} of {1e6 * self.period:g} us, late by "
            f"{middle:.3g} (median), {high:.3g} (99 %), {most:.3g} us (most), {self.missed} "
            f"missed, shifted by {self.shift[-1]:.3g} s>"
        )


def due_times(period: float, count: int) -> np.ndarray:
    """When the first `count` fine steps are due, in s; `period` in ns. As the core counts them."""
    due: np.ndarray = 1e-9 * np.floor(period * np.arange(count))
    return due
