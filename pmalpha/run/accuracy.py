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
from ..problem.matrices import Matrix, diagonal, product
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
# No time levels.
NONE = np.empty(0, dtype=np.int64)


class Recorded(Protocol):
    """What is needed of a `SubdomainHistory`."""

    @property
    def name(self) -> str: ...

    @property
    def t(self) -> np.ndarray: ...

    @property
    def u(self) -> np.ndarray: ...

    @property
    def v(self) -> np.ndarray: ...

    @property
    def a(self) -> np.ndarray: ...

    @property
    def dofs(self) -> np.ndarray: ...

    @property
    def substep(self) -> float | None: ...

    @property
    def double_after(self) -> float | None: ...


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
    errors = errors_of([history], steps, slice(None))[:, 0].T
    errors[previous_level(history, steps) < 0] = np.nan
    return errors


def errors_of(histories: Sequence[Recorded], steps: np.ndarray, columns: slice) -> np.ndarray:
    """e of some of the steps of a subdomain in several cases, (D1), (dofs, cases, steps)."""
    ends, _ = ends_of(histories, steps, columns)
    return error(ends, lengths_of(histories[0], steps))


def lengths_of(history: Recorded, steps: np.ndarray) -> np.ndarray:
    return (steps + 1 - previous_level(history, steps)) * (history.substep or 0.0)


def ends_of(
    histories: Sequence[Recorded], steps: np.ndarray, columns: slice, others: np.ndarray = NONE
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """u, v, w where the steps begin and u, w where they end, (dofs, cases, steps) each; and u at
    other levels."""
    begin, end, count = previous_level(histories[0], steps), steps + 1, steps.size
    u = levels_of(histories, "u", np.concatenate([begin, end, others]), columns)
    v = levels_of(histories, "v", begin, columns)
    w = levels_of(histories, "a", np.concatenate([begin, end]), columns)
    first, second, rest = slice(count), slice(count, 2 * count), slice(2 * count, None)
    return (u[..., first], v, w[..., first], u[..., second], w[..., second]), u[..., rest]


def error(ends: Sequence[np.ndarray], h: np.ndarray) -> np.ndarray:
    """e = u_1 - [u + h v + h^2 (2 w + w_1) / 6]                                            (D1)"""
    u, v, w, u1, w1 = ends
    return u1 - (u + h * v + h * h * (2.0 * w + w1) / 6.0)


def levels_of(
    histories: Sequence[Recorded], name: str, levels: np.ndarray, columns: slice
) -> np.ndarray:
    """Some time levels and dofs of the array `name` of several cases, (dofs, cases, levels)."""
    arrays = [getattr(history, name)[:, columns] for history in histories]
    found = np.empty((len(arrays), levels.size, arrays[0].shape[1]))
    for x, out in zip(arrays, found):
        if x.flags.carray:
            x.take(levels, 0, out, "wrap")  # the mode that writes into `out` at once
        else:  # in a file, say: `take` would read all of it
            out[:] = x[levels]
    return np.ascontiguousarray(np.moveaxis(found, 2, 0))


# ---- the warning ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sample:
    """Norms of some of the steps of a subdomain, weighted by the masses, for each case.

    Attributes
    ----------
    rate : (cases,) array
        Mean amplitude of the local error per unit of time.
    speed : (cases,) array
        Root mean square of the velocity.
    amplitude : (cases, SHAPE) array
        Distance from the mean displacement, at some time levels spread evenly over the run.
    lost, size : (cases,) arrays
        Means of e C e and e M e, with the local errors e.
    """

    rate: np.ndarray
    speed: np.ndarray
    amplitude: np.ndarray
    lost: np.ndarray
    size: np.ndarray


def warn_if_coarse(errors: np.ndarray, parts: Sequence[Part], end: float) -> None:
    """AccuracyWarning that names the subdomains whose steps are too coarse for the motion.

    `errors` (parts) are those of `accumulated_errors`, until the time `end`.
    """
    total = float(errors.sum())
    if not COARSE < total < np.inf:
        return
    size = f"{100.0 * total:.2g} per cent" if total < 0.99 else "100 per cent or more"
    coarse = [part for part, error in zip(parts, errors) if error >= 0.5 * errors.max()]
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
    cases: Sequence[Sequence[Recorded | None]],
    parts: Sequence[Part],
    duration: float,
    numbers: int = SAMPLED_NUMBERS,
) -> np.ndarray:
    """The share of each subdomain in the error at the end, relative to the motion, (D3).

    Zero where the records do not suffice: fewer than `FEWEST_STEPS` steps, not every time level
    recorded, a step above the critical one, or no motion.

    Parameters
    ----------
    cases : for each case the histories of all subdomains, or None where they were not recorded
        The same dofs and time levels in all cases.
    parts : sequence of Part
    duration : float
    numbers : int
        At most about so many are read of each array.

    Returns
    -------
    (cases, parts) array
    """
    errors = np.zeros((len(cases), len(parts)))
    if any(p.step_ratio is not None and not p.step_ratio.value <= 1.0 + 1e-6 for p in parts):
        return errors  # unstable, which has a warning of its own
    with np.errstate(all="ignore"):
        samples = {
            i: found
            for i, (part, own) in enumerate(zip(parts, zip(*cases)))
            if own[0] is not None and (found := sample(own, part, numbers)) is not None
        }
        if not samples:
            return errors
        moved = np.sqrt(np.max(sum(x.amplitude**2 for x in samples.values()), axis=1))
        speed = np.sqrt(sum(x.speed**2 for x in samples.values()))
        decay = 0.5 * sum(x.lost for x in samples.values()) / sum(x.size for x in samples.values())
        lasting = decay * duration > 1e-9  # false where nothing moves
        remembered = np.where(lasting, -np.expm1(-decay * duration) / decay, duration)
        judged = (moved > 0.0) & (moved < np.inf) & (speed > 0.0) & (speed < np.inf)
        for i, x in samples.items():
            share = x.rate * remembered * x.speed / speed / moved
            errors[:, i] = np.where(judged, share, 0.0)
    return errors


def sample(
    histories: Sequence[Recorded], part: Part, numbers: int = SAMPLED_NUMBERS
) -> Sample | None:
    """The norms of a subdomain in all cases; None where their records do not suffice."""
    first = histories[0]
    levels, dofs = first.u.shape
    if dofs == 0 or levels < FEWEST_STEPS + 1 or not is_complete(first):
        return None
    stride = 1 + dofs // SAMPLED_DOFS
    columns = slice(0, None, stride)
    count = max(2 * FEWEST_STEPS, numbers // len(range(0, dofs, stride)))
    steps = spread(int(previous_level(first, np.array([0]))[0] < 0), levels - 2, count)
    mass = mass_of(part.subdomain)[first.dofs[columns]] * stride
    ends, shape = ends_of(histories, steps, columns, shape_levels(levels))
    h = lengths_of(first, steps)
    errors = error(ends, h)
    mean = ends[0].mean(axis=2, keepdims=True)
    motion, speed, acceleration = (rms(x, mass) for x in (ends[0] - mean, *ends[1:3]))
    omega = np.where(motion > 0.0, np.sqrt(acceleration / motion), 0.0)  # at rest it is rounding
    scheme = part.subdomain.scheme
    factor = [phase_factor(scheme, float(f"{Omega:.1e}")) for Omega in omega * part.step]
    rate = AMPLITUDE * np.array(factor) * np.mean(norms(errors, mass) / h, axis=1)
    amplitude = norms(shape - mean, mass)
    known = errors if stride == 1 else None
    return Sample(rate, speed, amplitude, *decay_of(histories, part.subdomain, steps, known))


@lru_cache(maxsize=64)
def shape_levels(levels: int) -> np.ndarray:
    """`SHAPE` time levels, evenly from the first to the last; not to be written to."""
    some = np.linspace(0, levels - 1, SHAPE).round().astype(np.int64)
    some.setflags(write=False)
    return some


@lru_cache(maxsize=64)
def spread(first: int, last: int, count: int) -> np.ndarray:
    """At most `count` whole numbers, evenly from first to last; not to be written to."""
    numbers = np.linspace(first, last, min(count, last - first + 1)).astype(np.int64)
    numbers = numbers[np.diff(numbers, prepend=first - 1) > 0]
    numbers.setflags(write=False)
    return numbers


def norms(x: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Of x (dofs, cases, levels) over the dofs, weighted by `mass`, (cases, levels)."""
    return np.sqrt(np.einsum("j,jki->ki", mass, x * x))


def rms(x: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Root mean square over the levels of these norms, (cases,)."""
    return np.sqrt(np.einsum("j,jki->k", mass, x * x) / x.shape[2])


def mass_of(subdomain: Subdomain) -> np.ndarray:
    """The diagonal of M: weights that make displacements and rotations comparable."""
    return np.zeros(subdomain.n) if subdomain.M is None else diagonal(subdomain.M)


def decay_of(
    histories: Sequence[Recorded],
    subdomain: Subdomain,
    steps: np.ndarray,
    errors: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Means of e C e and e M e over some of the steps, per unit of time squared, (cases,) each.

    `errors` are the e of all recorded dofs in these steps where they are known.
    """
    n, first, cases = subdomain.n, histories[0], len(histories)
    some = np.arange(0, steps.size, 1 + steps.size // 32)
    together = max(1, SAMPLED_NUMBERS // (4 * n * cases))  # several arrays of them at a time
    lost, size = np.zeros(cases), np.zeros(cases)
    for begin in range(0, some.size, together):
        few = some[begin : begin + together]
        own = errors_of(histories, steps[few], slice(None)) if errors is None else errors[..., few]
        e = np.zeros((n, cases, few.size))
        e[first.dofs] = own / lengths_of(first, steps[few])
        size += summed_product(subdomain.M, e)
        if subdomain.C is not None:
            lost += summed_product(subdomain.C, e)
    return lost / some.size, size / some.size


def summed_product(A: Matrix, e: np.ndarray) -> np.ndarray:
    """Sums of e A e for the vectors e (n, cases, rows) of each case, (cases,)."""
    Ae = product(A, e.reshape(len(e), -1)).reshape(e.shape)
    return np.einsum("ikj,ikj->k", e, Ae)


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
