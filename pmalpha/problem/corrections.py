"""What is done to a record before it is a load: units, baseline, filters, other steps."""

from __future__ import annotations

import re
from fractions import Fraction

import numpy as np

# Accelerations, in m/s2
UNITS = {
    "m/s2": 1.0,
    "cm/s2": 0.01,
    "mm/s2": 0.001,
    "gal": 0.01,
    "g": 9.80665,
    "mg": 9.80665e-3,
    "ft/s2": 0.3048,
    "in/s2": 0.0254,
}

# Of a highpass: length of the zeros at both ends times its frequency (Boore 2005, BSSA 95: 1.5 n)
PADS = 0.75
# dt over the new one as a ratio of whole numbers up to this one
MOST_RATIO = 1000


def factor_between(unit: str, other: str) -> float:
    """A number in one unit of acceleration times this is that in the other one."""
    return _size(unit, "unit") / _size(other, "name")


def _size(unit: str, what: str) -> float:
    """Of "cm/sec**2 (4)", "CM/S/S": 0.01."""
    if not isinstance(unit, str):
        raise TypeError(f"{what} must be text, got {unit!r}")
    word = re.sub(r"\(.*?\)|[\s^*]", "", unit.lower())
    word = re.sub(r"/s(ec)?/s(ec)?$|/s(ec)?2$", "/s2", word)
    if word not in UNITS:
        raise ValueError(
            f"{what} must be of {', '.join(UNITS)}, got {unit!r}; a factor changes any unit, "
            "9.80665 * record"
        )
    return UNITS[word]


def is_acceleration(unit: str) -> bool:
    """Whether it is one of `UNITS`, in any spelling."""
    try:
        return _size(unit, "unit") > 0.0
    except ValueError:
        return False


def units_of_integrals(unit: str) -> tuple[str, str]:
    """Of velocity and displacement, for an acceleration in `unit`; empty for none."""
    if length := re.fullmatch(r"(\w+)/s2", unit):
        return f"{length[1]}/s", length[1]
    return (f"{unit} s", f"{unit} s2") if unit else ("", "")


# ---- integrals ----------------------------------------------------------------------------------


def integrals(a: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and displacement from rest of a, (m,) or (m, k), linear between samples: exact."""
    v, d = np.zeros(a.shape), np.zeros(a.shape)
    v[1:] = np.cumsum(0.5 * dt * (a[:-1] + a[1:]), axis=0)
    d[1:] = np.cumsum(dt * v[:-1] + dt**2 / 6.0 * (2.0 * a[:-1] + a[1:]), axis=0)
    return v, d


# ---- baseline -----------------------------------------------------------------------------------


def without_polynomial(a: np.ndarray, dt: float, degree: int) -> np.ndarray:
    """a without the polynomial of this degree whose integral from 0 fits the velocity best."""
    s = np.linspace(0.0, 1.0, len(a))
    powers = np.arange(1, degree + 2)
    columns = s[:, None] ** powers
    velocity = integrals(a, dt)[0].reshape(len(a), -1)
    c = np.linalg.lstsq(columns, velocity, rcond=None)[0]
    slopes = powers * s[:, None] ** (powers - 1) / (dt * (len(a) - 1))
    result: np.ndarray = a - (slopes @ c).reshape(a.shape)
    return result


def highpass(a: np.ndarray, dt: float, frequency: float, order: int) -> np.ndarray:
    """a without what is slower, by a Butterworth filter there and back: without delay, between
    zeros that it needs before and after."""
    from scipy.signal import butter, sosfiltfilt

    zeros = int(np.ceil(PADS * order / (frequency * dt)))
    widths = [(zeros, zeros)] + [(0, 0)] * (a.ndim - 1)
    sections = butter(order // 2, frequency, "highpass", fs=1.0 / dt, output="sos")
    result: np.ndarray = sosfiltfilt(sections, np.pad(a, widths), axis=0, padlen=0)
    return result


# ---- other steps --------------------------------------------------------------------------------


def resampled(a: np.ndarray, dt: float, new: float) -> np.ndarray:
    """Samples at 0, new, 2 new, ...: of the straight lines where new divides dt, else without the
    frequencies above half of 1 / new."""
    from scipy.signal import resample_poly

    ratio = Fraction(dt / new).limit_denominator(MOST_RATIO)
    if ratio == 0 or ratio > MOST_RATIO or abs(float(ratio) * new / dt - 1.0) > 1e-9:
        raise ValueError(
            f"dt must be {dt:g} times a ratio of whole numbers up to {MOST_RATIO}, got {new!r}"
        )
    up, down = ratio.numerator, ratio.denominator
    if down == 1:
        at = np.arange((len(a) - 1) * up + 1) / up
        columns = [np.interp(at, np.arange(len(a)), x) for x in a.reshape(len(a), -1).T]
        return np.stack(columns, axis=1).reshape(at.size, *a.shape[1:])
    result: np.ndarray = resample_poly(a, up, down, axis=0, padtype="line")
    return result
