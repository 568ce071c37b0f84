"""StabilityWarning for couplings that can grow, by the spectral radius where it is cheap."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import InstabilityError, StabilityWarning, warn
from .core_rows import CoreRows
from .part import Part
from .propagation import Layout, propagation

# Numbers of a state up to which the amplification matrix is made: a tenth of a second.
CHEAP = 300
# A triple eigenvalue of modulus one is computed to the third root of the rounding.
STABLE = 1.0 + 1e-5


def warn_of_growth(
    doubts: Sequence[str],
    otherwise: str | None,
    parts: Sequence[Part],
    core: Any,
    coupling: str,
    rows: CoreRows,
    *,
    in_lanes: bool,
    alone: bool,
) -> None:
    """StabilityWarning for each of the doubts, unless no step grows.

    Parameters
    ----------
    doubts : sequence of str
        Why a coupling of these schemes can grow.
    otherwise : str or None
        What to say if it grows and there are none; None where none grows without one.
    parts, core
        The assembly; without `in_lanes` the state of the core is lost.
    coupling : str
    rows : CoreRows
    in_lanes, alone : bool
        Whether the core has lanes, and the subdomains of no other process.
    """
    if not doubts and otherwise is None:
        return
    found, texts = "", list(doubts)
    if alone and all(is_linear(part) for part in parts):
        layout = Layout(parts, core, coupling, rows)
        if layout.size <= CHEAP:
            radius = _radius(layout, rows, in_lanes)
            if radius <= STABLE:
                return
            found = f": here by a factor of {radius:.4g} in a macro step"
            texts = texts or [str(otherwise)]
    for text in texts:
        warn(text + found, StabilityWarning)


def is_linear(part: Part) -> bool:
    s = part.subdomain
    return s.restoring is None and s.internal is None and not s.has_feedback


def _radius(layout: Layout, rows: CoreRows, in_lanes: bool) -> float:
    try:
        G = propagation(layout, rows, 1.0, in_lanes=in_lanes)[0]
    except InstabilityError:
        return np.inf
    return float(np.max(np.abs(np.linalg.eigvals(G)), initial=0.0))
