"""What is said of tied displacements that have parted in a run."""

from __future__ import annotations

import numpy as np

from ..errors import AccuracyWarning, warn
from ..results.history import History
from .session import Session

# Part of the largest displacement of the two sides from which on the run is not what was meant.
SHARE = 0.1


def warn_of_drift(session: Session, history: History) -> None:
    """AccuracyWarning for the tie that has parted most, by more than a tenth of the motion.

    In memory alone: a file is not read for it. Rows that hold or move a dof are no ties.
    """
    jump = history.displacement_jump
    if session.coupling == "mean" or session.ranks is not None or type(jump) is not np.ndarray:
        return
    entries = [np.diff(L.tocsr().indptr) > 0 for L in session.rows.matrices]
    ties = np.sum(entries, axis=0) > 1
    for motion in session.loads.motions:
        ties[motion.rows] = False
    if len(jump) < 2 or not ties.any():
        return
    parted = np.where(ties, np.max(np.abs(jump - jump[0]), axis=0), 0.0)
    sizes = np.zeros(ties.size)
    for rows, s in zip(entries, history.subdomains):
        if s is not None and type(s.u) is np.ndarray and s.u.size:
            sizes[rows] = np.maximum(sizes[rows], max(s.u.max(), -s.u.min()))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(sizes > 0.0, parted / sizes, 0.0)
    row = int(np.argmax(shares))
    if not shares[row] > SHARE:
        return
    names = " and ".join(repr(n) for x, (n, _) in zip(entries, session.keys) if x[row])
    warn(
        f"tied displacements of {names} have parted by {parted[row]:.3g} in row "
        f"{session.rows.name(row)}, {100.0 * shares[row]:.0f} % of the largest displacement of "
        f'these subdomains, {sizes[row]:.3g}: coupling="{session.coupling}" ties velocities, so '
        'that what a step does not resolve, such as a jump at t = 0, stays; coupling="mean" has '
        "no drift",
        AccuracyWarning,
    )
