"""The displacement drift of a run as a measure of its error at the interfaces; AccuracyWarning.

The measure is equation (D4) of docs/method.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ..errors import AccuracyWarning, warn
from ..problem.matrices import product
from ..results.history import History
from ..setup.constraint_rows import ConstraintRows
from ..setup.member import Member
from ..setup.ranks import joined
from .motion import Motion

# A run warns from this measure on. It is not judged with fewer macro steps.
LARGE = 0.005
FEWEST_MACRO_STEPS = 3
# A drift below this share of the displacements is their rounding, which adds up over the steps.
ROUNDING = 1e-9
# Numbers of each array that are read; of longer records samples are taken.
SAMPLED_NUMBERS = 40_000
# Macro time levels at least, of which more are read where there are few dofs.
SAMPLES = 64


def warn_if_drifting(
    history: History, members: Sequence[Member], rows: ConstraintRows, motions: Sequence[Motion]
) -> None:
    """AccuracyWarning when macro steps are too long for the forces that cross the interfaces.

    members: no warning unless one, of any process, has substeps under macro coupling.
    rows: with the processes, all of which call this; each of them warns.
    motions: prescribed velocities; the displacements of their rows are not tied.
    """
    if history.macro_times.size <= FEWEST_MACRO_STEPS:
        return
    if not any(joined(rows.ranks, [member.has_responses for member in members])):
        return
    with np.errstate(all="ignore"):
        shares = drift_shares(history, members, rows, motions)
    if not LARGE < np.sum(shares) < np.inf:
        return
    worst = int(np.argmax(shares))
    own = [repr(p.name) for p, L in zip(members, rows.matrices) if np.any(L.indices == worst)]
    names = joined(rows.ranks, own)
    jump = history.displacement_jump[:, worst]
    warn(
        f"the macro step is too long for the forces between {' and '.join(names)}, which are "
        f"linear in it: the displacements in constraint {rows.name(worst)} drifted apart by "
        f"{np.max(np.abs(jump - jump[0])):.2g} until t = {history.macro_times[-1]:g}; take a "
        "smaller dt, with fewer substeps",
        AccuracyWarning,
    )


def drift_shares(
    history: History, members: Sequence[Member], rows: ConstraintRows, motions: Sequence[Motion]
) -> np.ndarray:
    """The share of each constraint in the measure (D4), (p,); zeros where it cannot be computed.

    That is with a step above the critical one, and unless all dofs of all subdomains were recorded.
    """
    p, levels = rows.p, history.macro_times.size
    none = np.zeros(p)
    if p == 0:
        return none
    known = []
    for member, own in zip(members, history.subdomains):
        sound = member.step_ratio is None or member.step_ratio.is_judged
        whole = own is not None and np.array_equal(own.dofs, np.arange(member.n))
        known.append((member.n, sound and whole))
    found = joined(rows.ranks, known)
    if not all(judged for _, judged in found):
        return none
    numbers = sum(n for n, _ in found) + p
    some = spread(0, levels - 1, max(SAMPLES, SAMPLED_NUMBERS // numbers))
    jump = history.displacement_jump[some] - history.displacement_jump[0]
    force = np.std(levels_of(history.multipliers, levels, some), axis=0)
    work = force * np.max(np.abs(jump), axis=0)
    terms = []
    for member, own, L in zip(members, history.subdomains, rows.matrices):
        assert own is not None  # or it is not judged
        v, u = (levels_of(x, levels, some) for x in (own.v, own.u))
        energy = float(np.mean([x @ product(member.subdomain.M, x) for x in v]))
        terms.append((energy, abs(L) @ np.std(u, axis=0), abs(L) @ np.max(np.abs(u), axis=0)))
    kinetic, distance, sizes = (sum(x) for x in zip(*joined(rows.ranks, terms)))
    work[np.max(np.abs(jump), axis=0) <= ROUNDING * sizes] = 0.0
    for motion in motions:
        work[motion.rows] = 0.0
    size = kinetic + 0.5 * float(force @ distance)
    return work / size if size > 0.0 else none


@lru_cache(maxsize=64)
def spread(first: int, last: int, count: int) -> np.ndarray:
    """At most `count` whole numbers, evenly from first to last; not to be written to."""
    numbers = np.linspace(first, last, min(count, last - first + 1)).astype(np.int64)
    numbers = numbers[np.diff(numbers, prepend=first - 1) > 0]
    numbers.setflags(write=False)
    return numbers


def levels_of(values: np.ndarray, levels: int, some: np.ndarray) -> np.ndarray:
    """Some of the macro time levels of an array with rows for all its time levels."""
    result: np.ndarray = values[some * ((len(values) - 1) // (levels - 1))]
    return result
