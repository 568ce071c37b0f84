"""What is said of tied displacements that have parted in the first steps of a run."""

from __future__ import annotations

import numpy as np

from ..errors import AccuracyWarning, warn
from ..results.history import History
from .gains import cause_of
from .session import Session

# Part of the largest displacement of the run from which on it is not what was meant.
SHARE = 0.1
# Macro steps at the start, and in the whole run at least: in fewer the motion is not known.
FIRST, LEAST = 10, 100


def warn_of_drift(session: Session, history: History) -> None:
    """AccuracyWarning for the tie that has parted most in the first steps from t = 0, by more than
    a tenth of the motion: a start that the step does not resolve, and that no later step closes.

    In memory alone, with all dofs: a file is not read for it, and of less the motion is not known.
    Rows that hold or move a dof are no ties. A run whose growth is explained is not judged.
    """
    jump, times = history.displacement_jump, history.macro_times
    if session.coupling == "mean" or session.ranks is not None or type(jump) is not np.ndarray:
        return
    dt = session.clock.dt
    if len(jump) <= FIRST or times[0] != 0.0 or times[-1] < LEAST * dt:
        return
    first = jump[: int(np.searchsorted(times, (FIRST + 0.5) * dt))]
    if len(first) < 2 or any(map(cause_of, session.members)):
        return
    # of each subdomain what a displacement of 1 of all its dofs contributes to a row at most
    factors = np.array([abs(L).sum(axis=1) for L in session.rows.matrices])
    ties = np.sum(factors > 0.0, axis=0) > 1
    for motion in session.loads.motions:
        ties[motion.rows] = False
    size = _largest(session, history) if ties.any() else 0.0
    if not size > 0.0:
        return
    parted = np.where(ties, np.max(np.abs(first - first[0]), axis=0), 0.0)
    shares = parted / np.where(ties, np.max(factors, axis=0), 1.0) / size
    row = int(np.argmax(shares))
    if not shares[row] > SHARE:
        return
    names = " and ".join(repr(n) for x, (n, _) in zip(factors, session.keys) if x[row] > 0.0)
    warn(
        f"tied displacements of {names} have parted by {parted[row]:.3g} in the first steps, in "
        f"row {session.rows.name(row)}, {100.0 * shares[row]:.0f} % of the largest displacement of "
        f'the run, {size:.3g}, and coupling="{session.coupling}", which ties velocities, '
        "keeps the gap: the step does not resolve the start; give the initial velocities that it "
        'leads to, or take shorter steps or coupling="mean", which has no drift',
        AccuracyWarning,
    )


def _largest(session: Session, history: History) -> float:
    """The largest displacement of the run, 0 where not all of them are in memory."""
    size = 0.0
    for s, (_, subdomain) in zip(history.subdomains, session.keys):
        if s is None or type(s.u) is not np.ndarray or s.u.shape[1] < subdomain.n:
            return 0.0
        size = max(size, s.u.max(), -s.u.min())
    return float(size)
