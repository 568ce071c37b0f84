"""Warnings: energy and mass that forces add to a motion, steps too long for present tangents."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..errors import AccuracyWarning, StabilityWarning, warn
from ..results.history import History
from ..setup.judging import warn_of_steps
from ..setup.member import Member
from ..setup.stability import present_ratio
from .session import Session

# What can be the cause, in this order.
CAUSES = (
    "the step {step:g} resolves neither a stop nor a stiff force; a force acts with a delay or the "
    "wrong sign; Newton's iteration was given a wrong tangent"
)


# Of the mass, from which on what an estimate adds to it is reported: 1 per cent of a period, and so
# 6 per cent of the amplitude after one.
ADDED_MASS = 0.02


def warn_of_gains(members: Sequence[Member]) -> None:
    """StabilityWarning for evaluated forces that are too stiff for the step, (B15), or have added
    energy, (B10), AccuracyWarning for mass that an estimate has, (B13), once for each subdomain and
    start."""
    for member in members:
        text = stiff_of(member) or gain_of(member)
        if text and not member.reported:
            warn(text, StabilityWarning)
            member.reported = True
        share = member.core.added_mass
        if share > ADDED_MASS and not member.slowed:
            warn(_words_of_mass(member, share), AccuracyWarning)
            member.slowed = True


def _words_of_mass(member: Member, share: float) -> str:
    return (
        f"restoring_stiffness of subdomain {member.name!r} is above the stiffness that its forces "
        f"have had in the motion: what is beyond has acted as {100.0 * share:.3g} per cent of its "
        f"mass; take a smaller estimate or shorter steps than {member.step:g}, or give a stop and "
        "other forces of which the stiffness is known as internal= with their tangents"
    )


def stiff_of(member: Member) -> str:
    """By how much the step of a subdomain is too long for its evaluated forces, or empty."""
    excess, rate, h, t = member.core.stiff
    if not t > 0.0:
        return ""
    ratio, substep = math.sqrt(excess), h / 2.0 if member.double else h
    cure = f"take substeps of at most {substep / ratio:.3g}"
    if rate > 1.0:
        cure += f" if they are of springs and {substep / rate:.3g} if they are of dashpots"
    estimate = "" if member.subdomain.restoring is None else ", a larger restoring_stiffness"
    double = " (a double step)" if member.double else ""
    return (
        f"forces of subdomain {member.name!r} that are evaluated once in a step are too stiff for "
        f"it: since t = {t:g} its motion grows, and the step {h:g}{double} is {ratio:.3g} times "
        f"that which their increments over those of the displacement allow; {cure}{estimate}, or "
        "internal= with tangents"
    )


def gain_of(member: Member) -> str:
    """What the forces of a subdomain have added to its motion, or empty."""
    added, energy, t = member.core.gain
    if not t > 0.0:
        return ""
    causes = CAUSES.format(step=member.step)
    active = (
        ""
        if member.subdomain.restoring is None
        else ("; a force that is meant to feed in energy is a load, force=f(t, u, v)")
    )
    return (
        f"forces of subdomain {member.name!r} have added energy to its motion since t = {t:g}, "
        f"{added:.3g} in all, {100.0 * added / energy:.3g} per cent of the largest energy "
        f"{energy:.3g} that it has had; one of three causes: {causes}{active}"
    )


def cause_of(member: Member) -> str:
    """What is known of why a motion has grown beyond all bounds, or empty."""
    ratio = member.step_ratio
    if ratio is None or not ratio.is_above or ratio.raised:
        return stiff_of(member) or gain_of(member)
    return (
        f"its step {member.step:g} is {ratio.value:.3g} times the critical one; take smaller steps"
    )


def warn_of_present_steps(members: Sequence[Member], t: float) -> None:
    """StabilityWarning where an explicit step is above the critical one of the present state.

    Evaluates the internal forces of each explicit subdomain once, with their tangents.
    """
    warn_of_steps(
        (p.name, s, p.step, present_ratio(s, p.internal, p.step, t, p.present()))
        for p, s in ((member, member.subdomain) for member in members)
        if p.internal is not None and s.scheme.explicit
    )


# ---- drift --------------------------------------------------------------------------------------
# What is said of tied displacements that have parted in the first steps of a run.

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
