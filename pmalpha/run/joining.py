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


def _without_common_row(first: Any, second: Any) -> Any:
    """The second without its first rows, if they are at the last time level of the first."""
    common = second.macro_times[0] - first.macro_times[-1] <= ROUNDING * first.macro_times[-1]
    if not common:
        return second
    later = {name: getattr(second, name)[1:] for name in _interface(second)}
    subdomains = [
        s
        and replace(
            s,
            **{name: getattr(s, name)[1:] for name in _motion(s)},
            outputs={q: x[1:] for q, x in s.outputs.items()},
        )
        for s in second.subdomains
    ]
    return replace(second, subdomains=tuple(subdomains), **later)


def stacked(pieces: Sequence[Any]) -> Any:
    """The rows of all pieces, one after the other, without energies."""
    first = pieces[0]
    interface: dict[str, np.ndarray | None] = {
        name: np.concatenate([getattr(piece, name) for piece in pieces])
        for name in _interface(first)
        if all(getattr(piece, name) is not None for piece in pieces)
    }
    if "substeps" not in interface:
        interface["substeps"] = None
    subdomains = [s and _stacked(own) for s, *own in _by_subdomain(pieces)]
    return replace(first, subdomains=tuple(subdomains), **interface, energy=None)


def _by_subdomain(pieces: Sequence[Any]) -> list[tuple[Any, ...]]:
    """For each subdomain its history in the first piece, and those in all."""
    return [(own[0], *own) for own in zip(*(piece.subdomains for piece in pieces))]


def _stacked(own: Sequence[Any]) -> Any:
    first = own[0]
    rows = {name: np.concatenate([getattr(s, name) for s in own]) for name in _motion(first)}
    outputs = {q: np.concatenate([s.outputs[q] for s in own]) for q in first.outputs}
    same = len({s.substep for s in own}) == 1
    return replace(first, **rows, outputs=outputs, substep=first.substep if same else None)


def _interface(piece: Any) -> tuple[str, ...]:
    """The arrays of a History with a row for each time level."""
    names = ("multipliers", "multiplier_times", "velocity_jump", "displacement_jump", "macro_times")
    return names if piece.substeps is None else (*names, "substeps")


def _motion(s: Any) -> tuple[str, ...]:
    """The same of a subdomain."""
    names = ("t", "u", "v", "a") + (() if s.springs is None else ("deformation", "force"))
    return names + tuple(x for x in ("iterations", "q") if getattr(s, x) is not None)
