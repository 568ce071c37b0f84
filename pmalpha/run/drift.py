"""What is said of tied displacements that have parted in the first steps of a run."""

from __future__ import annotations

import numpy as np

from ..errors import AccuracyWarning, warn
from ..results.history import History
from .session import Session

# Part of the largest displacement of the two sides from which on the run is not what was meant.
SHARE = 0.1
# Macro steps at the start, and in the whole run at least: in fewer the motion is not known.
FIRST, LEAST = 10, 100


def warn_of_drift(session: Session, history: History) -> None:
    """AccuracyWarning for the tie that has parted most in the first steps from t = 0, by more than
    a tenth of the motion: a start that the step does not resolve, and that no later step closes.

    In memory alone: a file is not read for it. Rows that hold or move a dof are no ties.
    """
    jump, times = history.displacement_jump, history.macro_times
    if session.coupling == "mean" or session.ranks is not None or type(jump) is not np.ndarray:
        return
    dt = session.clock.dt
    if len(jump) <= FIRST or times[0] != 0.0 or times[-1] < LEAST * dt:
        return
    first = jump[: int(np.searchsorted(times, (FIRST + 0.5) * dt))]
    entries = [np.diff(L.tocsr().indptr) > 0 for L in session.rows.matrices]
    ties = np.sum(entries, axis=0) > 1
    for motion in session.loads.motions:
        ties[motion.rows] = False
    if len(first) < 2 or not ties.any():
        return
    parted = np.where(ties, np.max(np.abs(first - first[0]), axis=0), 0.0)
    sizes = np.zeros(ties.size)
    for rows, s in zip(entries, history.subdomains):
        if s is not None and type(s.u) is np.ndarray and s.u.size:
            sizes[rows] = np.maximum(sizes[rows], max(s.u.max(), -s.u.min()))
    shares = parted / np.where(sizes > 0.0, sizes, np.inf)
    row = int(np.argmax(shares))
    if not shares[row] > SHARE:
        return
    names = " and ".join(repr(n) for x, (n, _) in zip(entries, session.keys) if x[row])
    warn(
        f"tied displacements of {names} have parted by {parted[row]:.3g} in the first steps, in "
        f"row {session.rows.name(row)}, {100.0 * shares[row]:.0f} % of the largest displacement of "
        f'the run, {sizes[row]:.3g}, and coupling="{session.coupling}", which ties velocities, '
        "keeps the gap: the step does not resolve the start; give the initial velocities that it "
        'leads to, or take shorter steps or coupling="mean", which has no drift',
        AccuracyWarning,
    )
