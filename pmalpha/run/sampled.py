"""Sampled forces as the steps of a subdomain take them: values or means; what steps skip."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .._checks import listing
from ..errors import AccuracyWarning, warn
from ..problem.forces import Force, SampledForce
from ..results.clock import Clock
from ..setup.part import Part
from .motion import Motion

# The mean over a step shorter than this share of the time between samples is its value in the
# middle: the impulse of a sample is then kept within 2 / (pi n)^2 = 1 / 1000, n such steps in it.
SHORT = 1.0 / 16.0
# Skipped samples are judged by the motion of an oscillator with a period of so many steps, which a
# run with these steps is expected to follow, and this damping ratio.
STEPS_IN_PERIOD, DAMPING = 50, 0.05
# Relative change of this motion from which on a Coupler warns. Every second sample of El Centro
# changes it by 0.06, every third one by 0.18; white noise with the frequencies that the steps can
# follow, 1 / (2 h) at most, by 0.03 or less.
SKIPPED = 0.1
# Series of a force, those of the largest energy, that are judged.
JUDGED_SERIES = 32
# Samples after the end of a record for which the motion is followed, which takes a period.
MOST_SAMPLES = 1_000_000


# ---- means -------------------------------------------------------------------------------------


def seen_by(part: Part, force: Force, clock: Clock) -> Force:
    """The force that a subdomain takes at its time levels: averaged ones as means, (L2)."""
    if not (isinstance(force, SampledForce) and force.average) or part.step < SHORT * force.dt:
        return force
    end = (len(force.values) - 1) * force.dt
    # the last level whose half step before it reaches into the record, and one with what follows
    last = max(0, int(np.ceil((end + part.step - clock.t0) / part.h))) + 1
    t = clock.t0 + part.h * np.arange(last + 1)
    before, after = _half_steps(part, last + 1)
    means = _means(force, np.maximum(t - before, 0.0), t + after)
    return force._changed(values=means, dt=part.h, average=False, _begin=clock.t0)


def _half_steps(part: Part, levels: int) -> tuple[np.ndarray, np.ndarray]:
    """Half of the steps that end and begin at each time level, counted from the origin."""
    before, after = (np.full(levels, 0.5 * part.step) for _ in range(2))
    if part.double:  # the first macro step has single steps, or one that spans a change
        first = part.substeps if part.over is None else 1
        before[: first + 1] = 0.5 * (part.h if part.over is None else part.over)
        after[:first] = 0.5 * part.h
    return before, after


def _means(force: SampledForce, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The means of the samples, linear between them, over intervals; (k, series)."""
    result: np.ndarray = (_integral(force, end) - _integral(force, begin)) / (end - begin)[:, None]
    return result


def _integral(force: SampledForce, t: np.ndarray) -> np.ndarray:
    """From 0 to t >= 0, exact but for rounding; (k, series)."""
    f, dt = force.values, force.dt
    last = len(f) - 1
    whole = np.zeros_like(f)
    whole[1:] = dt * np.cumsum(0.5 * (f[:-1] + f[1:]), axis=0)
    x = np.minimum(t / dt, last)
    j = np.minimum(x.astype(np.int64), max(last - 1, 0))
    s = (x - j)[:, None]
    total = whole[j] + dt * s * (f[j] + 0.5 * s * (f[np.minimum(j + 1, last)] - f[j]))
    if force.hold:
        total += np.maximum(t - last * dt, 0.0)[:, None] * f[last]
    result: np.ndarray = total
    return result


# ---- what steps skip ---------------------------------------------------------------------------


def warn_of_skipped(
    parts: Sequence[Part],
    forces: Sequence[Force],
    motions: Sequence[Motion] = (),
    fine: float = 0.0,
) -> None:
    """One AccuracyWarning for all sampled loads of which the steps skip what matters.

    Parameters
    ----------
    parts : sequence of Part
    forces : sequence of Force
        One for each subdomain.
    motions : sequence of Motion
    fine : float
        Time between two interface problems, at which those are evaluated.
    """
    taken = [(f"the force on {part.name!r}", f, part.step) for part, f in zip(parts, forces)]
    taken += [(f"the {motion.what}", motion.velocity, fine) for motion in motions]
    known: dict[tuple[object, ...], tuple[float, float]] = {}
    found = []
    for name, force, step in taken:
        if not isinstance(force, SampledForce) or force.average or step <= force.dt:
            continue
        weights = _weights(force)
        key = step, force.dt, force.values.tobytes(), weights.tobytes()
        if key not in known:  # a record acts on many subdomains
            known[key] = skipped(force, step, weights)
        energy, change = known[key]
        if change > SKIPPED:
            every = f"step {step:g}, samples every {force.dt:g}"
            found.append(
                f"{name} ({every}: {energy:.2g} of its energy, {change:.2g} of the motion)"
            )
    if found:
        warn(
            f"steps skip samples of {listing(found)}: what the steps see differs from the samples "
            "by this part of their energy, which changes the motion of an oscillator with a period "
            f"of {STEPS_IN_PERIOD} steps by this part of itself; take smaller steps, or, for a "
            "force, average=True, which takes its means over the steps",
            AccuracyWarning,
        )


def _weights(force: SampledForce) -> np.ndarray:
    """How much each series counts: the norm of its distribution over the dofs."""
    if force.shape is None:
        return np.ones(force.values.shape[1])
    result: np.ndarray = np.linalg.norm(force.shape / (np.abs(force.shape).max() or 1.0), axis=0)
    return result


def skipped(force: SampledForce, step: float, weights: np.ndarray) -> tuple[float, float]:
    """What straight lines between the values at steps change of a sampled force, (L3).

    Returns the energy of the difference, relative to that of the force, and the root mean square
    of the difference of the responses, relative to that of the response.
    """
    f = force.values * (weights / (np.abs(force.values).max() or 1.0))
    if f.shape[1] > JUDGED_SERIES:
        f = f[:, np.argsort(np.sum(f * f, axis=0))[-JUDGED_SERIES:]]
    period = STEPS_IN_PERIOD * step
    rest = int(np.ceil(min(period / force.dt, MOST_SAMPLES)))  # the force is over, or held
    f = np.concatenate([f, np.repeat(f[-1:] if force.hold else 0.0 * f[-1:], rest, axis=0)])
    t = force.dt * np.arange(len(f))
    levels = step * np.arange(int(t[-1] / step) + 2)
    lines = np.stack([np.interp(t, levels, np.interp(levels, t, x)) for x in f.T], axis=1)
    both = np.concatenate([f, f - lines], axis=1)
    responses = _motions(both, math.pi * force.dt / period)
    (energy, lost), (response, change) = (
        [float(np.sum(half * half)) for half in np.split(values, 2, axis=1)]
        for values in (both[: len(force.values)], responses)
    )
    return (lost / energy, math.sqrt(change / response)) if energy and response else (0.0, 0.0)


def _motions(f: np.ndarray, x: float) -> np.ndarray:
    """The motion of an oscillator under each column of f, from rest; x = omega dt / 2.

    y'' + 2 zeta omega y' + omega^2 y = f by the trapezoidal rule, without the factor (dt / 2)^2.
    """
    from scipy.linalg.blas import dtbsv

    damping = 2.0 * DAMPING * x
    a = [1.0 + damping + x * x, 2.0 * x * x - 2.0, 1.0 - damping + x * x]
    rows = np.asfortranarray(np.tile(np.array(a)[:, None], len(f)))  # a lower triangle, as a band
    sums = f.copy()
    sums[1:] += 2.0 * f[:-1]
    sums[2:] += f[:-2]
    return np.stack([dtbsv(2, rows, column, lower=1) for column in sums.T], axis=1)
