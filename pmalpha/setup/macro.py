"""Macro coupling before the first step: how subdomains answer to a ramp of the multipliers, (M3).

The interface matrix of (M4) needs the response of every subdomain with substeps to each of its own
conditions. What comes out is stored where that is faster than repeating the substeps, (M8).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from .._checks import listing
from ..errors import ConstraintWarning, PerformanceWarning, StabilityWarning, warn
from ..memory import require
from ..problem.matrices import Matrix
from ..problem.schemes import Scheme
from ..problem.subdomain import UNDAMPED
from .compliance import Block, conditions_of
from .factors import Factor, solve
from .interface import interface_matrix
from .part import Part

# Bytes that one subdomain may take for a stored response.
STORED = 256_000_000
# Matrix entries that sweeps read in a second, a round figure for one core.
RATE = 1e9
# Seconds of set-up that are worth a warning, and those that nobody waits for: a day.
LONG, ABSURD = 20.0, 86400.0
# Entries between two looks at Ctrl-C.
BLOCK = 5e7
# Velocity at the end of a macro step over its mean inside: below, a part resonates with the step.
RESONANT = 0.05


def prepare(parts: Sequence[Part]) -> None:
    """The responses of all parts with substeps, and what has to be said before a run."""
    check_work(parts)
    for part in parts:
        if part.ramped and part.nb:
            respond(part)
        if part.ramped and part.subdomain.restoring is not None:
            warn(
                f"the restoring force of subdomain {part.name!r} is met with substeps under "
                'coupling="macro": the run can grow unless restoring_stiffness is within some per '
                'cent of the true one, or the force soft against dt; else take coupling="pm" or '
                '"gc"',
                StabilityWarning,
            )
        _warn_of_massless_ties(part)
        if part.double and _damps_nothing(part.subdomain.scheme):
            warn(
                f"the double step of subdomain {part.name!r} leaves a zig-zag from macro step to "
                f"macro step undamped with {part.subdomain.scheme!r}; take rho < 1",
                StabilityWarning,
            )


def _warn_of_massless_ties(part: Part) -> None:
    """A velocity without inertia is tied at macro nodes alone: between them it is anything."""
    tied = np.intersect1d(part.order[part.n - part.nb :], part.subdomain.massless)
    if part.ramped and tied.size:
        warn(
            f"interface dofs {listing(tied)} of subdomain {part.name!r} have no mass: with "
            'substeps coupling="macro" is of order 1 there; give them mass, or take "pm" or "gc"',
            ConstraintWarning,
        )


def _damps_nothing(scheme: Scheme) -> bool:
    return bool(np.max(np.abs(np.linalg.eigvals(scheme.amplification(1.0)))) > UNDAMPED)


def check_work(parts: Sequence[Part]) -> None:
    """PerformanceWarning when the unit runs take long, ValueError when they take for ever."""
    works = {part.name: work(part) for part in parts if part.ramped}
    seconds = sum(works.values()) / RATE
    if seconds <= LONG:
        return
    name = max(works, key=works.__getitem__)
    part = next(p for p in parts if p.name == name)
    text = (
        f'coupling="macro" needs unit runs of about {seconds:.3g} s before the first step '
        f"(more than {LONG if seconds <= ABSURD else ABSURD:g} s), most of it for {name!r}: "
        f"{conditions_of(part.L).size} conditions times {part.subdomain.substeps} substeps times "
        f"{part.core.entries} matrix entries"
    )
    if seconds > ABSURD:
        raise ValueError(f'{text}; take coupling="pm" or "gc", which need none')
    warn(f"{text}; it is worth it for long runs only", PerformanceWarning)


def work(part: Part) -> float:
    """Matrix entries read by the unit runs of a part."""
    return float(part.core.entries) * part.subdomain.substeps * conditions_of(part.L).size


def is_stored(part: Part) -> bool:
    """(M8): whether reading U costs less than the substeps, and U is not too large."""
    size = 4.0 * part.n * conditions_of(part.L).size
    return size <= part.subdomain.substeps * part.core.entries and 8.0 * size <= STORED


def respond(part: Part) -> None:
    """Run the unit responses of a part; its block of H and of the mean velocities.

    Raises
    ------
    MemoryError
        When the blocks do not fit.
    ValueError
        When a response is not finite: the steps are far above the critical one.
    """
    rows = conditions_of(part.L)
    k, stored = rows.size, is_stored(part)
    size = 8.0 * 4.0 * part.n * k if stored else 0.0
    require(
        64.0 * k**2 + size, f"the response of {part.name!r} to {k} conditions under macro coupling"
    )
    end, mean = np.empty((k, k)), np.empty((k, k))
    states = np.empty((k, 4, part.n)) if stored else None
    columns = max(1, int(BLOCK // (part.core.entries * part.subdomain.substeps)))
    for begin in range(0, k, columns):
        own = slice(begin, min(begin + columns, k))
        kept = None if states is None else states[own]
        if not part.core.ramp(rows, begin, end[own], mean[own], kept):
            raise ValueError(
                f"substeps of subdomain {part.name!r} must be more: its response to the "
                f"multipliers grows beyond all numbers within a macro step, got "
                f"{part.subdomain.substeps} with own step {part.h:g}"
            )
    if states is not None:
        part.core.set_response(rows, states)
    part.response = _block(rows, end), _block(rows, mean)


def _block(rows: np.ndarray, values: np.ndarray) -> Block:
    """Symmetric but for rounding (M7); conditions that do not meet leave no entry."""
    return Block(rows, sp.csr_array(0.5 * (values + values.T)))


def warn_of_resonance(H: Matrix, factor: Factor, parts: Sequence[Part], place: np.ndarray) -> None:
    """StabilityWarning when some multipliers hardly move the velocities at the end of a macro step.

    Parameters
    ----------
    H : (p, p) matrix in inner form
        (M4).
    factor : Factor
        Of H.
    parts : sequence of Part
    place : (p,) array of int
        Place of each condition in the core's order.

    Notes
    -----
    The smallest eigenvalue of H x = lam P x by inverse iteration, P the same as H from the mean
    velocities inside the macro step.
    """
    if not any(part.response for part in parts):
        return
    mean = interface_matrix(parts, place.size, start=False, mean=True)
    product = _product(mean)
    x = np.cos(np.arange(place.size))
    for _ in range(8):
        x = solve(factor, product(x))
        x /= np.max(np.abs(x))
    ratio = float(x @ _product(H)(x)) / float(x @ product(x))
    if ratio >= RESONANT:
        return
    means = {p.name: p.response[1] for p in parts if p.response is not None}
    shares = {n: float(x[b.rows] @ (b.values @ x[b.rows])) for n, b in means.items()}
    names = [repr(n) for n, share in shares.items() if share > 0.1 * max(shares.values())]
    verb = "resonate" if len(names) > 1 else "resonates"
    row = int(np.flatnonzero(place == np.argmax(np.abs(x)))[0])
    warn(
        f"{' and '.join(names)} {verb} with the macro step: at its end the velocity in "
        f"condition {row} answers to the multipliers {ratio:.1e} times as strongly as inside it, "
        "so that multipliers will be large and inaccurate; change dt a little, add damping or take "
        'rho < 1, or coupling="gc"',
        StabilityWarning,
    )


def _product(A: Matrix):
    return (lambda x: A * x) if A.ndim == 1 else (lambda x: A @ x)
