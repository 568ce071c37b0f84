"""Histories of consecutive runs as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

WORKS = "works count from the beginning of a run, and the chains of a double step begin there anew"
# Times are equal up to the rounding of two ways to compute them.
ROUNDING = 1e-12


def joined(pieces: Sequence[Any]) -> Any:
    """The implementation of `History.join`."""
    pieces = tuple(pieces)
    if not pieces:
        raise ValueError("pieces must be at least one History, got none")
    if len(pieces) > 1 and any(piece.energy is not None for piece in pieces):
        raise ValueError(f"pieces must have no energies: {WORKS}")
    whole = pieces[0]
    for i, piece in enumerate(pieces[1:], start=1):
        _check_same(whole, piece, i)
        _check_times(whole.macro_times, piece.macro_times, i)
        whole = _pair(whole, piece)
    return whole


def _check_same(first: Any, second: Any, i: int) -> None:
    """ValueError unless the same is recorded in both."""
    if _content(first) != _content(second):
        raise ValueError(
            "pieces must have the same subdomains, recorded dofs, springs and outputs, and "
            f"constraints, piece {i} differs from those before"
        )


def _content(piece: Any) -> list:
    recorded = [
        None
        if s is None
        else (
            s.dofs.tolist(),
            None if s.springs is None else np.asarray(s.springs).tolist(),
            [(name, x.shape[1]) for name, x in s.outputs.items()],
        )
        for s in piece.subdomains
    ]
    names = [name for name, _ in piece.keys]
    return [names, recorded, piece.multipliers.shape[1]]


def _check_times(first: np.ndarray, second: np.ndarray, i: int) -> None:
    """ValueError unless the second begins where the first ends.

    With ``every`` the end of a run is recorded only if it is a multiple: then the second begins
    within less than a recorded interval after the last row.
    """
    gap = second[0] - first[-1]
    largest = max(np.max(np.diff(t), initial=0.0) for t in (first, second))
    rounding = ROUNDING * abs(first[-1])
    if gap < -rounding or (gap > rounding and not gap < (1.0 - 1e-6) * largest):
        raise ValueError(
            f"pieces must be consecutive, piece {i} begins at t = {second[0]:g} where the one "
            f"before ends at t = {first[-1]:g}"
        )


def _pair(first: Any, second: Any) -> Any:
    """The rows of both, that of the common time level once."""
    overlap = int(second.macro_times[0] - first.macro_times[-1] <= ROUNDING * first.macro_times[-1])

    def rows(a: Any, b: Any, names: Sequence[str]) -> dict[str, np.ndarray]:
        pairs = {name: (getattr(a, name), getattr(b, name)[overlap:]) for name in names}
        return {name: np.concatenate(pair) for name, pair in pairs.items()}

    subdomains = []
    for a, b in zip(first.subdomains, second.subdomains):
        if a is None:
            subdomains.append(None)
            continue
        names = ("t", "u", "v", "a") + (() if a.springs is None else ("deformation", "force"))
        names += tuple(x for x in ("iterations", "q") if getattr(a, x) is not None)
        outputs = {q: np.concatenate([x, b.outputs[q][overlap:]]) for q, x in a.outputs.items()}
        subdomains.append(replace(a, **rows(a, b, names), outputs=outputs))
    interface = ("multipliers", "multiplier_times", "velocity_jump")
    return replace(
        first,
        subdomains=tuple(subdomains),
        **rows(first, second, (*interface, "displacement_jump", "macro_times")),
    )
