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
from .._core import step_errors, step_norms
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
    begin = previous_level(history, np.arange(history.t.size - 1))
    known = begin >= 0
    errors = np.full((begin.size, history.dofs.size), np.nan)
    errors[known] = errors_of([history], np.flatnonzero(known))[:, 0].T
    return errors


def errors_of(histories: Sequence[Recorded], steps: np.ndarray) -> np.ndarray:
    """e of some of the steps of a subdomain in several cases, (D1), (dofs, cases, steps)."""
    begin, end, h = ends_of(histories[0], steps)
    return step_errors(motions_of(histories), begin, end, h)


def ends_of(history: Recorded, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The levels at which steps begin and end, and the length of one level."""
    return previous_level(history, steps), steps + 1, history.substep or 0.0


def motions_of(
    histories: Sequence[Recorded],
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    return tuple((history.u, history.v, history.a) for history in histories)


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
    count = max(2 * FEWEST_STEPS, numbers // len(range(0, dofs, stride)))
    steps = spread(int(previous_level(first, np.array([0]))[0] < 0), levels - 2, count)
    mass = mass_of(part.subdomain)[first.dofs[::stride]] * stride
    ends = ends_of(first, steps)
    norms = step_norms(motions_of(histories), *ends, stride, mass, shape_levels(levels))
    rate, motion, speed, acceleration = norms[:, :4].T
    omega = np.where(motion > 0.0, np.sqrt(acceleration / motion), 0.0)  # at rest it is rounding
    scheme = part.subdomain.scheme
    factor = [phase_factor(scheme, float(f"{Omega:.1e}")) for Omega in omega * part.step]
    rate = AMPLITUDE * np.array(factor) * rate
    return Sample(rate, speed, norms[:, 4:], *decay_of(histories, part.subdomain, steps))


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


def mass_of(subdomain: Subdomain) -> np.ndarray:
    """The diagonal of M: weights that make displacements and rotations comparable."""
    return np.zeros(subdomain.n) if subdomain.M is None else diagonal(subdomain.M)


def decay_of(
    histories: Sequence[Recorded], subdomain: Subdomain, steps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Means of e C e and e M e over some of the steps, per unit of time squared, (cases,) each."""
    n, first, cases = subdomain.n, histories[0], len(histories)
    some = steps[:: 1 + steps.size // 32].copy()
    together = max(1, SAMPLED_NUMBERS // (4 * n * cases))  # several arrays of them at a time
    lost, size = np.zeros(cases), np.zeros(cases)
    for at in range(0, some.size, together):
        few = some[at : at + together]
        begin, end, h = ends_of(first, few)
        e = np.zeros((n, cases, few.size))
        e[first.dofs] = errors_of(histories, few) / ((end - begin) * h)
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
