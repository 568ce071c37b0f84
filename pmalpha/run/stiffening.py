"""Explicit steps and the present tangents of internal forces, at the beginning of a run."""

from __future__ import annotations

from collections.abc import Sequence

from ..setup.part import Part
from ..setup.stability import StepRatio, present_ratio, warn_of_steps


def warn_of_present_steps(parts: Sequence[Part], t: float) -> None:
    """StabilityWarning where an explicit step is above the critical one of the present state.

    Evaluates the internal forces of each explicit subdomain once, with their tangents.
    """
    explicit = [p for p in parts if p.internal is not None and p.subdomain.scheme.explicit]
    warn_of_steps((p.name, p.subdomain, p.step, _ratio(p, t)) for p in explicit)


def _ratio(part: Part, t: float) -> StepRatio:
    assert part.internal is not None
    levels = part.core.levels()
    u, v = (levels[i][part.position] for i in (0, 1))
    remembered, q = part.core.springs(), levels[6][: part.internal.initial.size]
    return present_ratio(part.subdomain, part.internal, part.step, t, (u, v, q, remembered))
