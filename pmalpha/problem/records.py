"""A measured record: its samples, the time between them, its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from inspect import signature
from numbers import Real
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from .._cached import Frozen
from .._checks import (
    check_word,
    counted,
    positive_number,
    real_array,
    real_number,
    require_moderate,
    sampling_step,
    time_step,
    whole_number,
)
from ..errors import AccuracyWarning, warn
from . import corrections

__all__ = ["Record"]

# Times that differ from even ones by less than this share of their distance are even, written with
# few digits.
EVEN = 1e-3
ROUNDING = 1e-12  # of a length over dt
MOST_SAMPLES = 1e7
UNIT = "unit: "


class Record(Frozen):
    """Samples at t = 0, dt, 2 dt, ..., as `readers.read_at2` and `models.el_centro` return them.

    `BaseAcceleration`, `SampledForce`, `SupportMotion` and `analysis.response_spectrum` take it in
    place of samples and dt: ``BaseAcceleration(record, direction)``. ``values, dt = record``
    unpacks it, ``9.81 * record`` changes its unit, and where an array is expected it is its values.

    Parameters
    ----------
    values : (m,) or (m, k) array_like
        The samples.
    dt : float
        Time between two samples, positive.
    name : str, optional
        Of the record or of its file.
    header : str, optional
        What the file says of it.

    Raises
    ------
    TypeError, ValueError
        For samples that are not finite numbers, and a dt that is not positive.

    Examples
    --------
    >>> from pmalpha.readers import Record
    >>> record = 9.81 * Record([0.0, 0.1, -0.2], 0.02, name="valley")
    >>> record
    <Record 'valley': 3 samples, dt = 0.02, to t = 0.04, largest 1.962>
    >>> values, dt = record
    >>> push = SampledForce(record, shape=[0.0, 2.0])
    >>> push(0.02).round(3).tolist()
    [0.0, 1.962]
    """

    def __init__(self, values: Any, dt: float, name: str = "", *, header: str = ""):
        self.values = real_array(values, "values", (1, 2))
        self.dt = time_step(dt, "dt")
        for word, text in (("name", name), ("header", header)):
            if not isinstance(text, str):
                raise TypeError(f"{word} must be a string, got {text!r}")
        self.name, self.header = name, header
        self._freeze()

    @classmethod
    def from_times(cls, t: Any, values: Any, dt: float | None = None) -> Record:
        """A Record of a series with its times, which may be uneven: linear between them.

        Parameters
        ----------
        t : (m,) array_like
            In rising order, m >= 2. The first is t = 0 of the Record.
        values : (m,) or (m, k) array_like
            The samples at these times.
        dt : float, optional
            Time between two samples of the Record, which ends at the last one within t. Default:
            that of t where it is even; else the largest one that divides the whole and is not
            longer than the shortest time between two samples, so that the ends agree.

        Returns
        -------
        Record
            Samples of the straight lines. A dt longer than the times between samples skips some.

        Raises
        ------
        TypeError, ValueError
            For times that do not rise, another number of values, and a dt that is not positive;
            without dt for times so uneven that a Record would have more than ten million samples.

        Examples
        --------
        >>> from pmalpha.readers import Record
        >>> Record.from_times([1.0, 1.1, 1.3], [0.0, 2.0, 4.0]).values.round(9).tolist()
        [0.0, 2.0, 3.0, 4.0]
        """
        t, values = real_array(t, "t"), real_array(values, "values", (1, 2))
        if t.size < 2:
            raise ValueError(f"t must be at least 2 times, got {t.size}")
        steps = np.diff(t)
        if not np.all(steps > 0.0):
            i = int(np.argmin(steps > 0.0))
            raise ValueError(f"t must rise, got {t[i + 1]:g} after {t[i]:g}")
        if len(values) != t.size:
            raise ValueError(
                f"values must have a row for each of {t.size} times, got {len(values)}"
            )
        length = float(t[-1] - t[0])
        if dt is None:
            even = length / steps.size
            if np.all(np.abs(t - t[0] - even * np.arange(t.size)) <= EVEN * even):
                return cls(values, even)
            count = np.ceil(length / steps.min() - EVEN)
            if not count < MOST_SAMPLES:
                raise ValueError(f"dt must be given where times are {steps.min():g} apart")
            dt = length / count
        dt = time_step(dt, "dt")
        at = t[0] + dt * np.arange(int(length / dt * (1.0 + ROUNDING)) + 1)
        columns = [np.interp(at, t, x) for x in values.reshape(t.size, -1).T]
        return cls(columns[0] if values.ndim == 1 else np.transpose(columns), dt)

    @property
    def unit(self) -> str:
        """What the last line of the header says after "unit: ", or nothing."""
        last = self.header.rpartition("\n")[2]
        return last.removeprefix(UNIT) if last.startswith(UNIT) else ""

    def in_unit(self, name: str, *, unit: str | None = None) -> Record:
        """The same accelerations in another unit.

        Parameters
        ----------
        name : str
            "m/s2", "cm/s2", "mm/s2", "gal", "g", "mg", "ft/s2" or "in/s2".
        unit : str, optional
            That of the samples. Default: what the header names.

        Returns
        -------
        Record
            Its header names the new unit.

        Raises
        ------
        ValueError
            For other words, and where the header names no unit and none is given.

        Examples
        --------
        >>> from pmalpha.readers import Record
        >>> Record([0.0, 0.5], 0.02, header="unit: g").in_unit("m/s2")
        <Record: 2 samples, dt = 0.02, to t = 0.02, largest 4.903 m/s2>
        """
        factor = corrections.factor_between(self.unit if unit is None else unit, name)
        return self._changed(factor * self.values, unit=name)

    def integrated(self) -> tuple[Record, Record]:
        """Velocity and displacement of an acceleration, from rest.

        Returns
        -------
        velocity : Record
            Exact for an acceleration that is linear between its samples, at the same times; in the
            unit of the samples times that of t: m/s of m/s2, "g s" of g.
        displacement : Record
            The same, times the unit of t squared.

        Examples
        --------
        >>> from pmalpha.readers import Record
        >>> velocity, displacement = Record([0.0, 1.0, 1.0], 2.0).integrated()
        >>> velocity.values.tolist(), displacement.values.round(4).tolist()
        ([0.0, 1.0, 3.0], [0.0, 0.6667, 4.6667])
        """
        v, d = corrections.integrals(self.values, self.dt)
        units = corrections.units_of_integrals(self.unit)
        return self._changed(v, unit=units[0]), self._changed(d, unit=units[1])

    def corrected(
        self,
        method: str = "polynomial",
        *,
        degree: int = 2,
        frequency: float | None = None,
        order: int = 4,
    ) -> Record:
        """The acceleration with its baseline corrected, so that its integrals do not drift.

        Parameters
        ----------
        method : {"polynomial", "highpass"}
            "polynomial": without the polynomial whose integral fits the velocity best (least
            squares). It takes a drift, and not periods that are shorter than the record: of the 31
            s of El Centro spectral displacements up to 15 s change by less than 1 per cent.
            "highpass": without what is slower than `frequency`, by a Butterworth filter that runs
            there and back (`scipy.signal`), which delays nothing. It takes long periods and lasting
            displacements too: of El Centro a frequency of 0.1 takes 2 per cent of the spectral
            displacement at 4 s, 7 at 5 s, 24 at 8 s.
        degree : int, default 2
            Of the polynomial of the acceleration, 0 to 8.
        frequency : float, optional
            Corner of the highpass in cycles per unit of t, where it halves amplitudes; below half
            of 1/dt. Needed for "highpass".
        order : {2, 4, 6, 8}, default 4
            Of the highpass, both ways together.

        Returns
        -------
        Record
            Of "highpass" it is longer by 0.75 order/frequency at both ends, in which the filter
            acts: cut off, the integrals drift again.

        Raises
        ------
        TypeError, ValueError
            For other words and numbers.

        Examples
        --------
        >>> from pmalpha import models
        >>> record = models.el_centro()
        >>> _, displacement = record.corrected().integrated()
        >>> bool(abs(displacement.values[-1]) < 0.1)
        True
        """
        check_word(method, "method", ("polynomial", "highpass"))
        if len(self.values) < 3:
            raise ValueError(f"a record must have 3 samples to be corrected, got {self!r}")
        if method == "polynomial":
            if frequency is not None:
                raise TypeError('frequency must be left out with method="polynomial"')
            degree = whole_number(degree, "degree", low=0, high=8)
            return self._changed(corrections.without_polynomial(self.values, self.dt, degree), True)
        if frequency is None:
            raise TypeError('frequency must be given with method="highpass"')
        corner = positive_number(frequency, "frequency")
        if not corner < 0.5 / self.dt:
            raise ValueError(f"frequency must be below {0.5 / self.dt:g}, got {frequency!r}")
        if not isinstance(order, int) or order not in (2, 4, 6, 8):
            raise ValueError(f"order must be 2, 4, 6 or 8, got {order!r}")
        return self._changed(corrections.highpass(self.values, self.dt, corner, order), True)

    def resampled(self, dt: float) -> Record:
        """The same with another time between samples.

        Parameters
        ----------
        dt : float
            Where it divides the present one, the samples of the straight lines, which is the same
            function of time. Else frequencies above half of 1/dt are removed before
            (`scipy.signal.resample_poly`), so that they do not come back as lower ones.

        Returns
        -------
        Record
            From t = 0, to at most the same end.

        Raises
        ------
        ValueError
            For a dt that is no ratio of whole numbers up to 1000 of the present one.

        Examples
        --------
        >>> from pmalpha.readers import Record
        >>> Record([0.0, 1.0, 0.0], 0.02).resampled(0.01).values.tolist()
        [0.0, 0.5, 1.0, 0.5, 0.0]
        """
        new = time_step(dt, "dt")
        values = corrections.resampled(self.values, self.dt, new)
        last = (len(self.values) - 1) * self.dt
        count = int(last / new * (1.0 + ROUNDING)) + 1
        return Record(values[:count], new, self.name, header=self.header)

    def plot(self, ax: Any = None) -> Any:
        """The record with its velocity and displacement from rest.

        Parameters
        ----------
        ax : three matplotlib.axes.Axes, optional
            Default: those of a new figure of pyplot.

        Returns
        -------
        (3,) array of matplotlib.axes.Axes
            Those drawn in.
        """
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.subplots(3, sharex=True)[1]
        axes = np.atleast_1d(ax)
        if axes.shape != (3,):
            raise ValueError(f"ax must be three axes, got shape {axes.shape}")
        t = self.dt * np.arange(len(self.values))
        unit = f" ({self.unit})" if self.unit else ""
        labels = f"acceleration{unit}", "velocity", "displacement"
        for one, record, label in zip(axes, (self, *self.integrated()), labels):
            one.plot(t, record.values)
            one.set_ylabel(label)
        axes[-1].set_xlabel("t")
        return axes

    def _changed(self, values: np.ndarray, keeps: bool = False, *, unit: str = "") -> Record:
        """Other samples in another unit, or in the same one where `keeps`."""
        header = self.header
        if not keeps:
            header = header.rpartition(UNIT)[0] if self.unit else header
            header = (f"{header.rstrip()}\n" if header.strip() else "") + f"{UNIT}{unit}" * bool(
                unit
            )
        return Record(values, self.dt, self.name, header=header)

    def __repr__(self) -> str:
        m = len(self.values)
        label = f" {self.name!r}" if self.name else ""
        largest = np.abs(self.values).max(initial=0.0)
        return (
            f"<Record{label}: {m} samples, dt = {self.dt:g}, to t = {(m - 1) * self.dt:g}, "
            f"largest {largest:.4g}{f' {self.unit}' if self.unit else ''}>"
        )

    def __iter__(self) -> Iterator[Any]:
        return iter((np.array(self.values), self.dt))

    def __getitem__(self, i: int) -> Any:
        return tuple(self)[i]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype)

    # a number of NumPy leaves the product to __rmul__
    __array_priority__ = 1.0

    def __mul__(self, factor: Any) -> Record:
        if not isinstance(factor, Real):
            return NotImplemented
        values = real_number(factor, "factor") * self.values
        header = self.header.rpartition(UNIT)[0] if self.unit else self.header
        return Record(values, self.dt, self.name, header=header)

    __rmul__ = __mul__


def takes_record(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function with parameters for samples and, next, ``dt`` that takes a Record for both.

    The arguments after dt may come one place earlier. A dt that is given has to be the Record's.
    """
    names = list(signature(function).parameters)
    samples = names.index("dt") - 1

    @wraps(function)
    def call(*args: Any, **keywords: Any) -> Any:
        record = args[samples] if len(args) > samples else keywords.get(names[samples])
        if not isinstance(record, Record):
            return function(*args, **keywords)
        keywords.pop(names[samples], None)
        before, after = args[:samples], list(args[samples + 1 :])
        dt = keywords.pop("dt", None)
        if after and (after[0] is None or isinstance(after[0], Real)):
            dt = after.pop(0)
        if dt is not None and dt != record.dt:
            raise ValueError(f"dt must be {record.dt!r} as in {record!r}, got {dt!r}")
        return function(*before, record.values, record.dt, *after, **keywords)

    return call


# ---- supports -----------------------------------------------------------------------------------
# Motions of supports from records, for constraints with a prescribed velocity.

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
