"""Response spectra of ground motion records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from .._checks import flag, real_array, real_number, require_moderate, sampling_step
from ..problem.records import Record, takes_record

__all__ = ["ResponseSpectrum", "response_spectrum"]

# Steps of Newton's method in a bracket, and the change of the phase w tau at which it ends: at a
# maximum the value differs by its square only.
MOST_STEPS, PHASE = 60, 1e-9
# Maximum number of periods between two samples: more are no spectrum, and brackets of the largest
# values fill memory.
MOST_PERIODS = 1e6


@dataclass(frozen=True, eq=False)
class ResponseSpectrum:
    """Largest responses of damped oscillators to a ground motion.

    Attributes
    ----------
    periods : (k,) array
        Periods of the undamped oscillators, in the unit of time of the record.
    damping : float
        Viscous damping ratio.
    sd : (k,) array
        Largest displacement relative to the ground.
    sv : (k,) array
        Largest velocity relative to the ground (not omega sd, which is `psv`).
    sa : (k,) array
        Largest absolute acceleration (not omega^2 sd, which is `psa`).
    """

    periods: np.ndarray
    damping: float
    sd: np.ndarray
    sv: np.ndarray
    sa: np.ndarray

    @property
    def psv(self) -> np.ndarray:
        """Pseudo-velocity omega sd, (k,); 0 at period 0."""
        result: np.ndarray = _frequencies(self.periods) * self.sd
        return result

    @property
    def psa(self) -> np.ndarray:
        """Pseudo-acceleration omega^2 sd, (k,), that of the largest spring force per mass.

        `sa` at period 0, the limit.
        """
        omega = _frequencies(self.periods)
        return np.where(self.periods > 0.0, omega**2 * self.sd, self.sa)

    def __repr__(self) -> str:
        periods = f"{self.periods.size} periods from {self.periods.min():g} to "
        return (
            f"<ResponseSpectrum: {periods}{self.periods.max():g}, damping ratio {self.damping:g}>"
        )


@overload
def response_spectrum(
    record: Record, periods: ArrayLike, damping: float = 0.05, *, free_vibration: bool = False
) -> ResponseSpectrum: ...


@overload
def response_spectrum(
    record: ArrayLike,
    dt: float,
    periods: ArrayLike,
    damping: float = 0.05,
    *,
    free_vibration: bool = False,
) -> ResponseSpectrum: ...


@takes_record
def response_spectrum(
    record: ArrayLike,
    dt: float,
    periods: ArrayLike,
    damping: float = 0.05,
    *,
    free_vibration: bool = False,
) -> ResponseSpectrum:
    """Response spectrum of a ground motion: exact for a record linear between its samples.

    :math:`u'' + 2 xi omega u' + omega^2 u = -a(t)`, at rest at the first sample. The motion from
    sample to sample is exact (Nigam and Jennings 1969), and so are the largest values, which are
    also looked for between samples. So the spectrum has no error of the time step, however short
    the period.

    Parameters
    ----------
    record : (m,) array, or Record
        Ground acceleration at t = 0, dt, 2 dt, ..., m >= 2, in any unit of acceleration. A Record
        has its dt: ``response_spectrum(record, periods)``.
    dt : float
        Time between two samples, positive.
    periods : (k,) array
        Periods of the oscillators, k >= 1. 0 is the rigid oscillator, whose `sa` is the peak
        ground acceleration; others are at least 1e-6 dt.
    damping : float, default 0.05
        Viscous damping ratio xi, in [0, 1).
    free_vibration : bool, default False
        Also consider the free vibration after the end of the record, where a long-period oscillator
        can have its largest displacement if the record was cut. By default, as in published
        spectra, the values are those of the duration of the record, (m - 1) dt.

    Returns
    -------
    ResponseSpectrum
        With `sd`, `sv`, `sa`, `psv` and `psa`, (k,) each, in the units of the record: a record in
        m/s^2 and s gives m, m/s and m/s^2.

    Raises
    ------
    TypeError, ValueError
        For arrays of the wrong shape or with values that are not finite, dt not positive, negative
        periods, a damping ratio outside [0, 1).

    Notes
    -----
    N. C. Nigam and P. C. Jennings, Calculation of response spectra from strong-motion earthquake
    records, Bull. Seism. Soc. Am. 59 (1969) 909-922.

    Examples
    --------
    El Centro with 2 % damping. Chopra's Dynamics of Structures has 2.67, 5.97 and 7.47 in, read at
    the samples of the record; between them the oscillators move up to (omega dt)^2 / 8 further:

    >>> from pmalpha import analysis, models
    >>> spectrum = analysis.response_spectrum(models.el_centro(), [0.5, 1.0, 2.0], 0.02)
    >>> (spectrum.sd / 9.81 * 386.09).round(2).tolist()
    [2.69, 5.97, 7.47]
    """
    a = real_array(record, "record")
    require_moderate(a, "record")
    if a.size < 2:
        raise ValueError(f"record must have at least 2 samples, got {a.size}")
    dt = sampling_step(dt, "dt")
    T = real_array(periods, "periods")
    require_moderate(T, "periods")
    if T.size == 0 or np.any(T < 0.0):
        got = "none" if T.size == 0 else f"{T.min():g}"
        raise ValueError(f"periods must be at least one and not negative, got {got}")
    if np.any((T > 0.0) & (T < dt / MOST_PERIODS)):
        raise ValueError(
            f"periods must be 0 or at least dt / {MOST_PERIODS:g}, got {T[T > 0.0].min():g} "
            f"with a dt of {dt:g}"
        )
    free_vibration = flag(free_vibration, "free_vibration")
    xi = real_number(damping, "damping", low=0.0)
    if not xi < 1.0:
        raise ValueError(f"damping must be below 1, got {damping!r}")
    peaks = np.zeros((T.size, 3))
    peaks[:, 2] = np.max(np.abs(a))
    moving = np.flatnonzero(T > 0.0)
    omegas = 2.0 * np.pi / T[moving]
    states = _states(a, dt, omegas, xi)
    for i, omega, y in zip(moving, omegas, np.moveaxis(states, 2, 0)):
        peaks[i] = _peaks(a, dt, omega, xi, y, free_vibration)
    return ResponseSpectrum(T, xi, *peaks.T)


def _frequencies(periods: np.ndarray) -> np.ndarray:
    """Angular frequencies, 0 in the place of infinity."""
    result: np.ndarray = np.divide(
        2.0 * np.pi, periods, out=np.zeros(periods.size), where=periods > 0.0
    )
    return result


def _states(a: np.ndarray, dt: float, omegas: np.ndarray, xi: float) -> np.ndarray:
    """(omega^2 u, omega v) at the samples for all oscillators, (m, 2, k).

    One step is the exponential of the matrix of (omega^2 u, omega v, a, dt a'), with a' constant.
    """
    from scipy.linalg import expm

    A = np.zeros((omegas.size, 4, 4))
    A[:, 0, 1] = omegas * dt
    A[:, 1, :3] = np.array([-1.0, -2.0 * xi, -1.0]) * omegas[:, None] * dt
    A[:, 2, 3] = 1.0
    G = np.moveaxis(expm(A), 0, 2)[:2]  # (2, 4, k)
    y = np.zeros((a.size, 2, omegas.size))
    for j, (begin, slope) in enumerate(zip(a[:-1], np.diff(a))):
        y[j + 1] = G[:, 0] * y[j, 0] + G[:, 1] * y[j, 1] + G[:, 2] * begin + G[:, 3] * slope
    return y


def _peaks(
    a: np.ndarray, dt: float, omega: float, xi: float, y: np.ndarray, free_vibration: bool
) -> Sequence[float]:
    """Largest |u|, |v| and |u'' + a| of one oscillator; y (m, 2) as `_states` returns it."""
    begin, slope, u, v = a[:-1], np.diff(a) / dt, y[:, 0] / omega**2, y[:, 1] / omega
    waves = _Waves.between_samples(omega, xi, u[:-1], v[:-1], begin, slope)
    values = (u, v, 2.0 * xi * omega * v + omega**2 * u)
    peaks = [wave.peak(dt, float(np.max(np.abs(x)))) for wave, x in zip(waves, values)]
    if free_vibration:
        rest = np.zeros(1)
        waves = _Waves.between_samples(omega, xi, u[-1:], v[-1:], rest, rest)
        peaks = [wave.peak(2.0 * np.pi / omega, x) for wave, x in zip(waves, peaks)]
    return peaks


@dataclass(frozen=True)
class _Waves:
    """x(tau) = exp(-decay tau) (p cos w tau + q sin w tau) + c + d tau in some intervals."""

    decay: float
    w: float
    p: np.ndarray
    q: np.ndarray
    c: np.ndarray
    d: np.ndarray

    @classmethod
    def between_samples(
        cls,
        omega: float,
        xi: float,
        u: np.ndarray,
        v: np.ndarray,
        begin: np.ndarray,
        slope: np.ndarray,
    ) -> tuple[_Waves, _Waves, _Waves]:
        """u, v and -(u'' + a), from u and v at the beginning of each interval."""
        decay, w = xi * omega, omega * np.sqrt(1.0 - xi**2)
        d = -slope / omega**2  # a particular solution is c + d tau
        c = (-begin - 2.0 * decay * d) / omega**2
        p = u - c
        q = (v - d + decay * p) / w
        p_v, q_v = w * q - decay * p, -w * p - decay * q
        p_a, q_a = 2.0 * decay * p_v + omega**2 * p, 2.0 * decay * q_v + omega**2 * q
        zero = np.zeros_like(d)
        return (
            cls(decay, w, p, q, c, d),
            cls(decay, w, p_v, q_v, d, zero),
            cls(decay, w, p_a, q_a, -begin, -slope),
        )

    def peak(self, length: float, least: float) -> float:
        """The largest |x| in the intervals of this length, or `least` if that is larger.

        least: at least the largest |x| at the ends of the intervals.
        """
        bound = self._bound(length)
        some = np.flatnonzero(bound > least)
        for j in some[np.argsort(-bound[some])]:
            if bound[j] <= least:
                break
            least = max(least, self._peak_in(j, length))
        return least

    def _bound(self, length: float) -> np.ndarray:
        """A bound of |x| in each interval, tight for intervals that are short to the period."""
        every = np.arange(self.p.size)
        begin, end = (np.abs(self._derivatives(every, t)) for t in (0.0, length))
        size, eighth = np.hypot(self.p, self.q), length**2 / 8.0
        # a function differs from its chord by at most length^2 / 8 times its curvature, |x''| too
        curvature = np.maximum(begin[2], end[2]) + eighth * abs(self.rate) ** 4 * size
        from_chord = np.maximum(begin[0], end[0]) + eighth * curvature
        linear = np.maximum(np.abs(self.c), np.abs(self.c + self.d * length))
        result: np.ndarray = np.minimum(from_chord, size + linear)
        return result

    def _peak_in(self, j: int, length: float) -> float:
        """The largest |x| where x' = 0 within interval j; 0 without such a time.

        Between two zeros of x'', which are known, x' has one zero at most.
        """
        wave = self.rate**2 * complex(self.p[j], -self.q[j])  # x'' = Re(wave exp(rate tau))
        first = (0.5 * np.pi - np.angle(wave)) % np.pi
        turns = (first + np.pi * np.arange(self.w * length / np.pi + 1.0)) / self.w
        tau = np.concatenate([[0.0], turns[turns < length], [length]])
        rises = self._derivatives(j, tau)[1] > 0.0
        turning = np.flatnonzero(rises[:-1] != rises[1:])
        begin, end, rising = tau[turning], tau[turning + 1], rises[turning]
        t = 0.5 * (begin + end)
        for _ in range(MOST_STEPS):
            x, slope, curvature = self._derivatives(j, t)
            before = (slope > 0.0) == rising
            begin, end = np.where(before, t, begin), np.where(before, end, t)
            with np.errstate(divide="ignore", invalid="ignore"):
                newton = t - slope / curvature
            within = (newton >= begin) & (newton <= end)
            change = np.abs(np.where(within, newton, 0.5 * (begin + end)) - t)
            t = np.where(within, newton, 0.5 * (begin + end))
            if np.all(self.w * change <= PHASE):
                break
        return float(np.max(np.abs(self._derivatives(j, t)[0]), initial=0.0))

    def _derivatives(
        self, j: int | np.ndarray, t: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, x' and x'' at these times in interval j, or at one time in several intervals."""
        z = self.rate
        wave = (self.p[j] - 1j * self.q[j]) * np.exp(z * t)
        x = wave.real + self.c[j] + self.d[j] * t
        return x, (z * wave).real + self.d[j], (z**2 * wave).real

    @property
    def rate(self) -> complex:
        """The eigenvalue of the oscillator, -decay + i w."""
        return complex(-self.decay, self.w)
