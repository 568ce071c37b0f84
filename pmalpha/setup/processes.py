"""The subdomains of other processes, in the form of the core."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .link import Link
from .part import Part, link_of
from .ranks import Ranks

# Pieces of its interface values that the core sends of a subdomain at a time, at most, and numbers
# that measure an iteration.
PIECES, MEASURES = 3, 6


def remote_of(part: Part, L: Link | None = None, h: float | None = None) -> tuple[Any, ...]:
    """What other processes have to know of a subdomain: (nb, substeps, h, doubled, continues,
    whether it has internal forces, link, constraints if its steps are iterated). With another link
    a single step of length h, without others.
    """
    single = L is not None
    h = part.h if h is None else h
    double = not single and part.double
    L = part.L if L is None else L
    return (
        part.nb,
        1 if single else part.substeps,
        h,
        double,
        double and part.over is not None,
        not single and part.internal is not None,
        link_of(part, L),
        None if single or part.tangent is None else L.rows,
    )


def _numbers(nb: int, rows: np.ndarray | None) -> int:
    """Of a subdomain with nb interface dofs, at most, in an exchange of the core."""
    return max(PIECES * nb + MEASURES, 0 if rows is None else rows.size**2)


def processes(ranks: Ranks | None, each: Iterable[tuple[Any, ...]]) -> tuple[Any, ...] | None:
    """The argument of that name of the core's coupler, from `remote_of` each own subdomain."""
    if ranks is None:
        return None
    own = list(each)
    remotes: list[Any] = list(ranks.joined(own))
    size = ranks.size + sum(_numbers(nb, rows) for nb, *_, rows in remotes)
    remotes[ranks.own] = [None] * len(own)
    values, counts, starts, gather = ranks.gather(size)
    return ranks.rank, tuple(remotes), ranks.first, values, counts, starts, gather
