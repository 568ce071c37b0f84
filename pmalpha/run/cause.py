"""Steps too long for evaluated forces: warnings, and why a motion grew as far as it is found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import StabilityWarning, warn
from ..problem.restoring import functions_of, is_compiled
from ..problem.subdomain import Subdomain
from ..setup.bounce import MOST
from ..setup.internal_forces import matrix_of_springs, springs_at
from ..setup.member import Member
from ..setup.stability import (
    at_springs,
    largest_eigenvalue,
    predicted_product,
    present_ratio,
    warn_of_steps,
)
from ..setup.stiff_restoring import cause_of_contact, gain_of_contact

# Gain of energy that is reported: stable forces evaluated once a step reach the first one at 0.976
# of their critical step, and smooth ones that are iterated 1.
REPORTED, ITERATED = 20.0, 2.0
# Up to this share x of the critical step stable forces add x^2 / (1 - x^2) = 1, half of ITERATED.
SOFT = 0.707


def least_gain(member: Member) -> float:
    """The gain of energy above which it is reported."""
    return ITERATED if member.subdomain.iterates or _damps_only(member) else REPORTED


def _damps_only(member: Member) -> bool:
    """Whether all forces that are evaluated are those of functions with `restoring_damping`, and
    were not seen to be stiff: then what the steps add is an error of that estimate."""
    s, watch = member.subdomain, member.watch
    if s.restoring_damping is None or s.springs or s.internal is not None or watch is None:
        return False
    if any(map(is_compiled, functions_of(s.restoring))):
        return False
    return watch.highest * watch.step**2 < (SOFT * watch.Omega) ** 2


def warn_of_gains(members: Sequence[Member]) -> None:
    """StabilityWarning for energy that steps have added, for contact seen by the core that they do
    not resolve, and for forces that alternate, once for each subdomain and start."""
    for member in members:
        found = {
            "impact": _of_impact(member),
            "alternation": _of_alternation(member),
            "gain": _of_gain(member),
        }
        for kind, text in found.items():
            if text and kind not in member.reported:
                warn(text, StabilityWarning)
        member.reported = {kind for kind, text in found.items() if text}


def _of_gain(member: Member) -> str:
    if not member.core.gain > least_gain(member):
        return ""
    return f"the energy of subdomain {member.name!r} grows by its steps: {cause_of(member)}"


def cause_of(member: Member) -> str:
    """The cause of growth in a subdomain, or empty."""
    s = member.subdomain
    if s.restoring is None and s.internal is None:
        return _of_step(member)
    gain = member.core.gain
    why = _of_springs(member) or _of_impact(member) or (_of_others(member) if gain > 1.0 else "")
    added = f"its steps added {gain:.3g} times its kinetic energy: " if why and gain > 1.0 else ""
    return f"{added}{why}"


def _of_impact(member: Member) -> str:
    """Of a contact that the core has seen and the steps do not resolve, or empty."""
    square, share, t = member.core.impact
    if square == 0.0 or (member.watch is not None and member.watch.has_found(t)):
        return ""  # nothing, or the values of a Python function, which has a warning of its own
    omega = float(np.sqrt(square))
    gain = gain_of_contact(member.subdomain.scheme, member.step, omega, share)
    compiled = any(map(is_compiled, functions_of(member.subdomain.restoring)))
    kind = "compiled restoring function" if compiled else "internal force"
    return cause_of_contact(kind, member.name, member.step, omega, gain, t) if gain > MOST else ""


def _of_alternation(member: Member) -> str:
    """Of forces that alternate with the velocity from step to step, or empty."""
    t, s = member.core.alternates, member.subdomain
    if t == 0.0:
        return ""
    kind = "internal" if s.restoring is None else "restoring"
    other = "" if s.scheme.explicit else "give their largest slope as restoring_damping=, "
    return (
        f"the {kind} forces of subdomain {member.name!r} alternate with its velocity from step to "
        f"step about t = {t:g}: they rise too steeply with it for the step {member.step:g}, as "
        "dashpots c |v|^alpha and friction sign(v) do near rest, and do not hold what they should; "
        f"take smaller steps, {other}or give them as internal= of an implicit scheme"
    )


def _of_step(member: Member) -> str:
    ratio = member.step_ratio
    if ratio is None or not ratio.is_above or ratio.raised:
        return ""
    return (
        f"its step {member.step:g} is {ratio.value:.3g} times the critical one; take smaller steps"
    )


def _of_springs(member: Member) -> str:
    s = member.subdomain
    if not s.springs or s.massless.size:
        return ""
    omega = _frequency_of_springs(member)
    if not omega * member.step > predicted_product(s.scheme):
        return ""
    once = "" if s.iterates and not s.restoring_springs else ", where they are evaluated once,"
    return (
        f"its springs are too stiff for the step {member.step:g}{once} with a circular frequency "
        f"of {omega:.3g} at present, or when contact is closed; {_remedy(s)}"
    )


def _of_others(member: Member) -> str:
    s = member.subdomain
    kind = "internal forces are" if s.restoring is None else "restoring forces are"
    if _damps_only(member):
        return (
            "its restoring_damping= is above the damping of its restoring forces, for the step "
            f"{member.step:g}; give a smaller one, or take smaller steps"
        )
    over = " or restoring_damping= above their damping" if s.restoring_damping is not None else ""
    return f"its {kind} too stiff for the step {member.step:g}{over}; {_remedy(s)}"


def _remedy(s: Subdomain) -> str:
    if s.iterates:
        return "take smaller steps, or internal=DiscreteGradient(...) for springs"
    if s.restoring is None or s.scheme.explicit:
        return "take smaller steps, or internal= with an implicit scheme"
    return (
        "take smaller steps, give a larger estimate restoring_stiffness=, or give the forces as "
        "internal="
    )


def _frequency_of_springs(member: Member) -> float:
    """The largest circular frequency of the springs alone where they will be, or closed."""
    s = member.subdomain
    u, v, _, remembered = member.present()
    with np.errstate(over="ignore", invalid="ignore"):
        _, tangents = springs_at(s, u + member.step * v, remembered)
        larger = [np.maximum(x.largest_tangent, k) for x, k in zip(s.springs, tangents)]
        if not all(np.all(np.isfinite(k)) for k in larger):
            return np.inf
        A, M = at_springs(s, matrix_of_springs(s, larger))
        return float(np.sqrt(largest_eigenvalue(A, M)[0]))


def warn_of_present_steps(members: Sequence[Member], t: float) -> None:
    """StabilityWarning where an explicit step is above the critical one of the present state.

    Evaluates the internal forces of each explicit subdomain once, with their tangents.
    """
    warn_of_steps(
        (p.name, s, p.step, present_ratio(s, p.internal, p.step, t, p.present()))
        for p, s in ((member, member.subdomain) for member in members)
        if p.internal is not None and s.scheme.explicit
    )
