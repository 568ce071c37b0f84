"""Filters of commands in the form of the core: delays, dynamics, least squares: (Y1) to (Y7)."""

from __future__ import annotations

from math import comb

import numpy as np

from . import forms

# Largest lag of a command, in steps.
LARGEST_LAG = 1 << 20
# Of the adaptive compensation: the low-pass filter, samples in a second, and limits of the
# coefficients and of their change in a second, for delays up to 0.06 s.
CUTOFF, SAMPLES, LONGEST = 20.0, 64, 0.06
LEAST, MOST = np.array([0.7, 0.0, 0.0]), np.array([1.3, 0.06, 0.0032])
CHANGE = np.array([2.0, 0.05, 0.001])
# It rests while the motion of the last second is below this share of the largest one.
THRESHOLD = 0.05
# Periods of an actuator in a step: above it rounding exceeds what the dynamics do in a step.
FASTEST = 1e4


def delayed(delay: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Lags in steps and their weights: (Y1), a cubic between the commands around t - delay."""
    steps = delay / h
    if steps > LARGEST_LAG:
        raise ValueError(f"delay must be at most {LARGEST_LAG} steps of {h:g}, got {delay:g}")
    step_count = round(steps)
    if abs(steps - step_count) < 1e-9 * max(1.0, steps):
        return np.array([step_count], dtype=np.int64), np.ones(1)
    lags = max(0, int(steps) - 1) + np.arange(4)
    weights = [
        np.prod([(steps - other) / (lag - other) for other in lags if other != lag]) for lag in lags
    ]
    return lags.astype(np.int64), np.array(weights)


def held_dynamics(
    order: int, frequency: float | None, damping: float, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """phi, before, after and slope of (Y2): exact for commands that are linear in a step."""
    from scipy.linalg import expm

    if frequency is None:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(1)
    if frequency * h > FASTEST:
        raise ValueError(
            f"frequency of an actuator must be at most {FASTEST:g} in a step of {h:g}, got "
            f"{frequency:g}; without dynamics leave it out"
        )
    w = 2.0 * np.pi * frequency
    # coefficients of x', x'', ... in w^-order x^(order) + ... + x = c
    of_lag, of_pair = np.array([1.0 / w, 1.0]), np.array([1.0 / w**2, 2.0 * damping / w, 1.0])
    polynomial = {1: of_lag, 2: of_pair, 3: np.polymul(of_lag, of_pair)}[order]
    A = np.zeros((order + 2, order + 2))
    A[: order - 1, 1:order] = np.eye(order - 1)
    A[order - 1, :order] = -polynomial[:0:-1] / polynomial[0]
    A[order - 1, order] = 1.0 / polynomial[0]  # the command, and its increment over the step
    A[order, order + 1] = 1.0 / h
    E = expm(h * A)[:order]
    before, after = E[:, order] - E[:, order + 1], E[:, order + 1]
    slope = np.array([-w, w]) if order == 1 else np.eye(order + 1)[1]
    return tuple(map(np.ascontiguousarray, (E[:, :order], before, after, slope)))  # type: ignore


def adaptive(delay: float, h: float) -> forms.Adaptive:
    """The adaptive compensation, (Y6) and (Y7), for steps of length h."""
    from scipy.signal import butter

    every = max(1, round(1.0 / (SAMPLES * h)))
    window = max(8, round(1.0 / (every * h)))
    # larger limits for a larger delay, of a1 in proportion and of a2 to its square
    scale = max(1.0, 3.0 * delay / LONGEST) ** np.arange(3)
    start = np.array([1.0, delay, 0.5 * delay**2])
    limits = np.array([start, LEAST, scale * MOST, scale * CHANGE * every * h])
    sections = butter(6, min(CUTOFF, 0.25 / h), fs=1.0 / h, output="sos")[:, [0, 1, 2, 4, 5]]
    return forms.Adaptive(h, limits, THRESHOLD, every, window, np.ascontiguousarray(sections))


def inverse_of_lag(delay: float, h: float) -> forms.Actuator:
    """(Y5)"""
    lead = delay / h
    return _weighted(np.array([0, 1]), np.array([1.0 + lead, -lead]), h)


def extrapolation(order: int, delay: float, h: float) -> forms.Actuator:
    """(Y4)"""
    taps = [
        ((-1.0) ** i * comb(order + 1, i + 1), *delayed(i * delay, h)) for i in range(order + 1)
    ]
    lags, at = np.unique(np.concatenate([lag for _, lag, _ in taps]), return_inverse=True)
    weights = np.bincount(at, np.concatenate([a * weight for a, _, weight in taps]))
    return _weighted(lags, weights, h)


def _weighted(lags: np.ndarray, weights: np.ndarray, h: float) -> forms.Actuator:
    lags = np.ascontiguousarray(lags, dtype=np.int64)
    return forms.Actuator(lags, weights, np.inf, *held_dynamics(1, None, 1.0, h), 0.0, 0.0, 0)
