"""Motions of supports from records, for constraints with a prescribed velocity."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from .._checks import check_word, counted, real_array, require_moderate, sampling_step
from ..errors import AccuracyWarning, warn
from .record import Record, takes_record

__all__ = ["SupportMotion"]

# Initial velocity of a record of displacements, as a share of its largest velocity, from which on
# a beginning at rest is warned of.
MOVING = 0.1


class SupportMotion:
    """Motion of k supports from records: the ``velocity`` of a `Constraint`.

    For supports that move differently (multi-support excitation, wave passage). The displacements
    of the structure are then absolute, unlike those under a `BaseAcceleration`. All supports begin
    at rest at zero displacement, as a `Subdomain` without `u0` and `v0` does.

    Parameters
    ----------
    record : (m,) or (m, k) array, or Record
        Samples at t = 0, dt, 2 dt, ..., m >= 2; a column for each support. A Record has its dt:
        ``SupportMotion(record, "acceleration")``.
    dt : float
        Time between two samples, positive.
    kind : {"acceleration", "displacement"}
        "acceleration": linear between the samples; velocity and displacement are its exact
        integrals. After the record the acceleration is zero: a record whose velocity does not
        return to zero keeps moving the support. "displacement": a cubic spline through the samples
        minus the first one, with zero velocity at both ends; at rest after the record. A record
        that begins with a slope moves at once: its first samples are then not those of the motion.

    Raises
    ------
    TypeError, ValueError
        For records of the wrong shape or with values that are not finite, dt not positive, another
        kind.

    Warns
    -----
    AccuracyWarning
        For displacements that begin with a slope above a tenth of their largest velocity.

    Notes
    -----
    The object is a callable, evaluated in Python at every fine step. The displacement of a support
    in a run is the scheme's integral of the velocity: it follows `displacement` within the error of
    the step.

    Examples
    --------
    A mass between two supports that are shaken one after the other:

    >>> record = np.zeros((200, 2))
    >>> record[1:21, 0] = record[31:51, 1] = np.sin(np.arange(20) * np.pi / 10)
    >>> motion = SupportMotion(record, 0.02, "acceleration")
    >>> K = [[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]]
    >>> frame = Subdomain([0.1, 1.0, 0.1], K, scheme=GeneralizedAlpha(0.8))
    >>> held = Constraint({frame: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}, velocity=motion)
    >>> history = Coupler([frame], held, dt=0.01).run(4.0)
    >>> bool(np.allclose(history[0].u[-1, [0, 2]], motion.displacement(4.0), atol=1e-5))
    True
    """

    @overload
    def __init__(self, record: Record, kind: str): ...

    @overload
    def __init__(self, record: ArrayLike, dt: float, kind: str): ...

    @takes_record
    def __init__(self, record: ArrayLike, dt: float, kind: str):
        from scipy.interpolate import CubicSpline, PPoly

        samples = real_array(record, "record", (1, 2))
        require_moderate(samples, "record")
        if len(samples) < 2 or samples.size == 0:
            raise ValueError(f"record must have at least 2 samples, got shape {samples.shape}")
        samples = samples.reshape(len(samples), -1)
        dt = sampling_step(dt, "dt")
        check_word(kind, "kind", ("acceleration", "displacement"))
        t = dt * np.arange(len(samples))
        self.end = float(t[-1])
        if kind == "acceleration":
            linear = np.array([np.diff(samples, axis=0) / dt, samples[:-1]])
            self._velocity = PPoly(linear, t).antiderivative()
            self._displacement = self._velocity.antiderivative()
        else:
            _warn_of_slope(samples, dt)
            self._displacement = CubicSpline(t, samples - samples[0], bc_type="clamped")
            self._velocity = self._displacement.derivative()
        self.k = samples.shape[1]

    def __call__(self, t: float) -> np.ndarray:
        """The velocities at time t >= 0, (k,)."""
        result: np.ndarray = self._velocity(min(t, self.end))
        return result

    def displacement(self, t: float) -> np.ndarray:
        """The displacements of the supports at a time.

        Parameters
        ----------
        t : float
            At least 0.

        Returns
        -------
        (k,) ndarray
            In the unit of the record.
        """
        later = max(t - self.end, 0.0)
        result: np.ndarray = self._displacement(min(t, self.end)) + later * self._velocity(self.end)
        return result

    def __repr__(self) -> str:
        return f"<SupportMotion of {counted(self.k, 'support')}, {self.end:g} long>"


def _warn_of_slope(samples: np.ndarray, dt: float) -> None:
    """AccuracyWarning for displacements that begin with a velocity."""
    rates = np.diff(samples, axis=0) / dt
    slopes = rates[0] if len(rates) == 1 else 1.5 * rates[0] - 0.5 * rates[1]  # of order 2
    column = int(np.argmax(np.abs(slopes)))
    slope, largest = slopes[column], np.max(np.abs(rates))
    if abs(slope) > MOVING * largest:
        warn(
            f"record of displacements begins with the slope {slope:.4g} in column {column}, of a "
            f"largest velocity of {largest:.4g}, and is taken with velocity 0 at t = 0: the "
            "structure and its supports begin at rest; begin the record where it is at rest, or "
            "give its accelerations",
            AccuracyWarning,
        )
