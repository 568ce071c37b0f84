"""Set-up of mean coupling: link responses to a constant acceleration of the interface, (K3).

The displacements at the end of a macro step are tied, so that the interface matrix (K4) consists of
displacements: one response for each constraint of each subdomain, stored where that is faster than
repeating the substeps, as under macro coupling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._checks import listing, numbered
from ..problem.matrices import combination, core_matrix
from .compliance import Block
from .factors import Factor
from .interface import is_symmetric_sum, summed
from .macro import check_work, is_stored, response_block, unit_responses
from .part import Part
from .ranks import Ranks, joined

# The smallest rho_b of an explicit scheme: below, the coupled step is unstable near its limit.
LEAST_EXPLICIT_RHO = 0.5
# 2 beta / gamma from which damping feeds the velocity gap; the trapezoidal rule has 1 to rounding.
ABOVE = 1.0 + 1e-9


def check_mean(parts: Sequence[Part]) -> None:
    """ValueError for what mean coupling cannot have."""
    for part in parts:
        s = part.subdomain
        if s.restoring is not None:
            raise ValueError(
                'coupling must be "macro", "pm" or "gc" with restoring forces, got "mean" and '
                f"restoring forces in {part.name!r}: the free macro run has no multipliers, so "
                "that forces would be evaluated away from the motion"
            )
        if s.has_feedback:
            raise ValueError(
                'coupling must be "macro", "pm" or "gc" with a force that is a function of t, u '
                f'and v, got "mean" and such a force on {part.name!r}: it would be evaluated away '
                "from the motion"
            )
        rho = getattr(s.scheme, "rho", 1.0)
        if s.scheme.explicit and rho < LEAST_EXPLICIT_RHO:
            raise ValueError(
                f'coupling="mean" needs rho >= {LEAST_EXPLICIT_RHO} in explicit subdomains, below '
                f"which it is unstable near the critical step, got {rho:g} in {part.name!r}"
            )
        tied = np.intersect1d(part.order[part.n - part.nb :], s.massless)
        if tied.size:
            raise ValueError(
                f'coupling="mean" needs mass at the interface dofs, got none at '
                f"{numbered('dof', tied)} of {part.name!r}"
            )


def doubts_of_damping(parts: Sequence[Part], ranks: Ranks | None = None) -> list[str]:
    """Why the velocity gap can grow with damping, (K8)."""
    own = [part.name for part in parts if _grows(part)]
    names = [repr(name) for name in joined(ranks, own)]
    if not names:
        return []
    return [
        'coupling="mean" grows with damping in subdomains with one substep and rho < 1 '
        f"({listing(names)}): the velocity gap at the interface does; take there the "
        'trapezoidal rule or central difference, or coupling="macro"'
    ]


def _grows(part: Part) -> bool:
    """Whether the damping feeds the velocity gap, (K8)."""
    scheme = part.subdomain.scheme
    return part.is_damped and part.substeps == 1 and 2.0 * scheme.beta > ABOVE * scheme.gamma


def mass_of_interface(part: Part) -> Factor:
    """The factor of M, with ones where dofs have no mass, which no constraint reaches."""
    massless = np.flatnonzero(np.isin(part.order, part.subdomain.massless))
    M = part.M
    if massless.size:
        ones = np.zeros(part.n)
        ones[massless] = 1.0
        M = combination([(1.0, M), (1.0, ones)])
    elif part.mass_factor is not None:
        return part.mass_factor
    return part.factor(M, f"M of subdomain {part.name!r}")


def prepare_mean(parts: Sequence[Part]) -> None:
    """Unit responses of all subdomains, which make their blocks of H."""
    check_work(parts, "mean")
    for part in parts:
        if part.responds:
            part.blocks = mean_blocks(part)


def mean_blocks(part: Part) -> dict[bool, Block]:
    """The blocks of H of a subdomain, of the single and the double step; stores the responses."""
    rows = part.L.rows
    stored = not part.waits and not part.double and rows.size > 0 and is_stored(part)
    single, _, states = unit_responses(part, rows, stored=stored)
    blocks = {False: response_block(part, rows, single)}
    if part.double:
        twice = unit_responses(part, rows, stored=False, twice=True)[0]
        # of the mean of both macro steps, the share of the new one
        share = 2.0 * part.h / part.lengths[1]
        blocks[True] = response_block(part, rows, share * twice)
    if states is not None:
        part.core.store_responses(rows, states)
    return blocks


def _of_old(part: Part) -> Block:
    """The block of a double step for the multipliers of its first macro step."""
    block, (h, long) = part.blocks[True], part.lengths
    result: Block = block.times((long - h) / h)
    return result


def doubled_part(parts: Sequence[Part], p: int, ranks: Ranks | None = None) -> Any:
    """The part of H of the subdomains that take double steps, for the core."""
    blocks = joined(
        ranks, [_of_old(part) for part in parts if part.double and part.internal is None]
    )
    own = is_symmetric_sum(parts, ranks)
    return core_matrix(summed(blocks, p), symmetric=own) if blocks else None
