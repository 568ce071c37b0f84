"""Histories of consecutive runs as one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .quantities import with_rows

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
        whole = stacked([whole, _without_common_row(whole, piece)])
    return whole


def _check_same(first: Any, second: Any, i: int) -> None:
    """ValueError unless the same is recorded in both."""
    if _content(first) != _content(second):
        raise ValueError(
            "pieces must have the same subdomains, recorded dofs, springs and outputs, and "
            f"constraints, piece {i} differs from those before"
        )


def _content(piece: Any) -> list[Any]:
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
    return [names, recorded, piece.multipliers.shape[1], [x[:3] for x in piece.contact_layout]]


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


def _without_common_row(first: Any, second: Any) -> Any:
    """The second without its first rows, if they are at the last time level of the first."""
    common = second.macro_times[0] - first.macro_times[-1] <= ROUNDING * first.macro_times[-1]
    if not common:
        return second
    return _with_rows(lambda x: x[1:], second)


def stacked(pieces: Sequence[Any]) -> Any:
    """The rows of all pieces, one after the other, without energies."""
    whole = _with_rows(lambda *x: np.concatenate(x), *pieces)
    subdomains = [
        s and replace(s, substep=s.substep if len({x.substep for x in own}) == 1 else None)
        for s, *own in zip(whole.subdomains, *(piece.subdomains for piece in pieces))
    ]
    return replace(whole, subdomains=tuple(subdomains), energy=None)


def _with_rows(change: Callable[..., np.ndarray], *pieces: Any) -> Any:
    """The first History with ``change(x, ...)`` for each array of those of all of them."""
    subdomains = [
        own[0] and with_rows(own[0], change, *own[1:])
        for own in zip(*(piece.subdomains for piece in pieces))
    ]
    first = with_rows(pieces[0], change, *pieces[1:])
    return replace(first, subdomains=tuple(subdomains))
