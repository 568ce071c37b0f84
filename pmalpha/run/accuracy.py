"""Local errors of the steps of a run, from what it recorded; AccuracyWarning.

The estimates are equations (D1) to (D3) of docs/method.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from .._checks import listing
from ..errors import AccuracyWarning, warn
from ..problem.matrices import diagonal, product
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..setup.part import Part

# A run warns from this accumulated error on, relative to the amplitude of the motion.
COARSE = 0.03
# A run of fewer steps of a subdomain is not judged.
FEWEST_STEPS = 16
# Numbers of each array that the check reads; of longer records it takes samples.
SAMPLED_NUMBERS, SAMPLED_DOFS = 40_000, 400
# Time levels, the same ones of all subdomains, at which the amplitude of the motion is taken.
SHAPE = 200
# Mean of |cos| of an oscillation is 2 / pi of its amplitude.
AMPLITUDE = 0.5 * np.pi


class Recorded(Protocol):
    """What is needed of a `SubdomainHistory`."""

    name: str
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    dofs: np.ndarray
    substep: float | None
    double_after: float | None


def is_complete(history: Recorded) -> bool:
    """Whether every time level of the subdomain was recorded."""
    t, h = history.t, history.substep
    return h is not None and (t.size < 2 or abs(t[1] - t[0] - h) <= 1e-6 * h)


def previous_level(history: Recorded, steps: np.ndarray) -> np.ndarray:
    """The level at which the step to level ``steps + 1`` began; -1 where it was not recorded."""
    if history.double_after is None or history.substep is None:
        return steps
    return steps - (history.t[steps + 1] > history.double_after + 0.5 * history.substep)


def local_error(history: Recorded) -> np.ndarray:
    """The estimate (D1) for each step and recorded dof, (k - 1, dofs)."""
    if history.substep is None:
        raise ValueError(
            "local_error needs a History of a run with steps of constant length, and no older file"
        )
    if not is_complete(history):
        raise ValueError(
            f"local_error needs all time levels of {history.name!r}, run(every=None): its substep "
            f"is {history.substep:g}, got levels {history.t[1] - history.t[0]:g} apart"
        )
    steps = np.arange(history.t.size - 1)
    errors = errors_of(history, steps, slice(None))
    errors[previous_level(history, steps) < 0] = np.nan
    return errors


def errors_of(history: Recorded, steps: np.ndarray, columns: slice) -> np.ndarray:
    """e = u_1 - [u + h v + h^2 (2 w + w_1) / 6] of some of the steps, (D1)."""
    begin, end = previous_level(history, steps), steps + 1
    h = ((end - begin) * (history.substep or 0.0))[:, None]
    u, v, w = (x[begin, columns] for x in (history.u, history.v, history.a))
    u1, w1 = history.u[end, columns], history.a[end, columns]
    return u1 - (u + h * v + h * h * (2.0 * w + w1) / 6.0)


# ---- the warning ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sample:
    """Norms of some of the steps of a subdomain, weighted by the masses.

    Attributes
    ----------
    part : Part
    rate : float
        Mean amplitude of the local error per unit of time.
    speed : float
        Root mean square of the velocity.
    amplitude : (SHAPE,) array
        Distance from the mean displacement, at some time levels spread evenly over the run.
    decay : (float, float)
        Means of e C e and e M e, with the local errors e.
    """

    part: Part
    rate: float
    speed: float
    amplitude: np.ndarray
    decay: tuple[float, float]


def warn_if_coarse(
    histories: Sequence[Recorded | None],
    parts: Sequence[Part],
    begin: float,
    end: float,
    numbers: int = SAMPLED_NUMBERS,
) -> None:
    """AccuracyWarning that names the subdomains whose steps are too coarse for the motion.

    At most about `numbers` are read of each array.
    """
    with np.errstate(all="ignore"):
        errors = accumulated_errors(histories, parts, end - begin, numbers)
    total = sum(errors.values())
    if not COARSE < total < np.inf:
        return
    size = f"{100.0 * total:.2g} per cent" if total < 0.99 else "100 per cent or more"
    coarse = [parts[i] for i, error in errors.items() if error >= 0.5 * max(errors.values())]
    doubles = [f", a double step of 2 x {part.h:g}" if part.double else "" for part in coarse]
    if len(coarse) == 1:
        double = f"{doubles[0]}," if doubles[0] else ""
        text = f"the step {coarse[0].step:g}{double} of subdomain {coarse[0].name!r} is"
    else:
        each = [f"{part.name!r} ({part.step:g}{x})" for part, x in zip(coarse, doubles)]
        text = f"the steps of subdomains {listing(each)} are"
    warn(
        f"{text} too coarse for {'its' if len(coarse) == 1 else 'their'} motion: the error "
        f"accumulated until t = {end:g} is about {size} of the amplitude; take smaller steps, or "
        "more substeps",
        AccuracyWarning,
    )


def accumulated_errors(
    histories: Sequence[Recorded | None],
    parts: Sequence[Part],
    duration: float,
    numbers: int = SAMPLED_NUMBERS,
) -> dict[int, float]:
    """The share of each recorded subdomain in the error at the end, relative to the motion, (D3).

    Empty where the records do not suffice: fewer than `FEWEST_STEPS` steps, not every time level
    recorded, a step above the critical one, or no motion.
    """
    samples = {}
    for i, (part, own) in enumerate(zip(parts, histories)):
        if part.step_ratio is not None and not part.step_ratio.value <= 1.0 + 1e-6:
            return {}  # unstable, which has a warning of its own
        found = None if own is None else sample(own, part, numbers)
        if found is not None:
            samples[i] = found
    sizes = [x.amplitude**2 for x in samples.values()]
    moved = np.sqrt(np.max(sum(sizes))) if sizes else 0.0
    speed = np.sqrt(sum(x.speed**2 for x in samples.values()))
    if not (0.0 < moved < np.inf and 0.0 < speed < np.inf):
        return {}
    lost, kinetic = (sum(x.decay[k] for x in samples.values()) for k in (0, 1))
    decay = 0.5 * lost / kinetic if kinetic > 0.0 else 0.0
    remembered = -np.expm1(-decay * duration) / decay if decay * duration > 1e-9 else duration
    return {i: x.rate * remembered * x.speed / speed / moved for i, x in samples.items()}


def sample(history: Recorded, part: Part, numbers: int = SAMPLED_NUMBERS) -> Sample | None:
    """The norms of a subdomain; None where its record does not suffice."""
    levels, dofs = history.u.shape
    if dofs == 0 or levels < FEWEST_STEPS + 1 or not is_complete(history):
        return None
    stride = 1 + dofs // SAMPLED_DOFS
    columns = slice(0, None, stride)
    count = max(2 * FEWEST_STEPS, numbers // len(range(0, dofs, stride)))
    first = int(previous_level(history, np.array([0]))[0] < 0)
    steps = spread(first, levels - 2, count)
    weights = np.sqrt(mass_of(part.subdomain)[history.dofs[columns]] * stride)
    u, v, w = (x[steps, columns] * weights for x in (history.u, history.v, history.a))
    errors = errors_of(history, steps, columns) * weights
    lengths = (steps + 1 - previous_level(history, steps)) * part.h
    speed = rms(v)
    motion = rms(u - u.mean(axis=0))
    omega = np.sqrt(rms(w) / motion) if motion > 0.0 else 0.0  # at rest w may be rounding
    factor = phase_factor(part.subdomain.scheme, float(f"{omega * part.step:.1e}"))
    rate = AMPLITUDE * factor * float(np.mean(np.linalg.norm(errors, axis=1) / lengths))
    few = np.linspace(0, levels - 1, SHAPE).round().astype(np.int64)
    positions = history.u[few, columns] * weights
    amplitude = np.linalg.norm(positions - u.mean(axis=0), axis=1)
    return Sample(part, rate, speed, amplitude, decay_of(history, part.subdomain, steps))


@lru_cache(maxsize=64)
def spread(first: int, last: int, count: int) -> np.ndarray:
    """At most `count` whole numbers, evenly from first to last; not to be written to."""
    numbers = np.linspace(first, last, min(count, last - first + 1)).astype(np.int64)
    numbers = numbers[np.diff(numbers, prepend=first - 1) > 0]
    numbers.setflags(write=False)
    return numbers


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(x * x, axis=1))))


def mass_of(subdomain: Subdomain) -> np.ndarray:
    """The diagonal of M: weights that make displacements and rotations comparable."""
    return np.zeros(subdomain.n) if subdomain.M is None else diagonal(subdomain.M)


def decay_of(history: Recorded, subdomain: Subdomain, steps: np.ndarray) -> tuple[float, float]:
    """Means of e C e and e M e over some of the steps, per unit of time squared."""
    some = steps[:: 1 + steps.size // 32]
    together = max(1, SAMPLED_NUMBERS // (4 * subdomain.n))  # several arrays of them at a time
    lost, size = 0.0, 0.0
    for begin in range(0, some.size, together):
        rows = some[begin : begin + together]
        lengths = (rows + 1 - previous_level(history, rows)) * (history.substep or 0.0)
        e = np.zeros((subdomain.n, rows.size))
        e[history.dofs] = (errors_of(history, rows, slice(None)) / lengths[:, None]).T
        size += float(np.sum(e * product(subdomain.M, e)))
        if subdomain.C is not None:
            lost += float(np.sum(e * product(subdomain.C, e)))
    return lost / some.size, size / some.size


@lru_cache(maxsize=1024)
def phase_factor(scheme: Scheme, Omega: float) -> float:
    """Error of a step of a free oscillator divided by the estimate (D1) of it, (D2)."""
    if not np.isfinite(Omega):
        return np.nan  # the squares of the motion overflow: not judged
    Omega = min(max(Omega, 0.02), 1.0)
    values, vectors = np.linalg.eig(scheme.amplification(Omega))
    k = int(np.argmin(np.abs(values - np.exp(1j * Omega))))
    z, (u, v, w, _) = values[k], vectors[:, k]
    estimate = z * u - (u + v + (2.0 * w + z * w) / 6.0)
    return float(np.abs(z - np.exp(1j * Omega)) * np.abs(u) / np.abs(estimate))
