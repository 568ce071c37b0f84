"""Set-up of the iteration of internal forces: their part of H, and what the coupler iterates with.

Under "pm" and "gc" the core adds the blocks of iterated subdomains to a constant part of H, in
every iteration. Under "macro" shooting begins with H of the tangents at t = 0, of linear twins of
the subdomains with internal forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted
from ..errors import FactorizationError
from ..memory import require
from ..problem import forms
from ..problem.forms import Newton
from ..problem.matrices import combination, core_matrix, permuted
from .interface import compute_unit_responses, is_symmetric_sum, mean_blocks, summed, total
from .internal_forces import core_size, numeric, structure
from .link import Block
from .member import Member, built, parts_of_steps
from .ranks import Ranks, joined


def prepare_iterated(members: Sequence[Member], coupling: str) -> None:
    """The blocks of H of the subdomains with internal forces.

    Under "macro" and "mean" those of their linear twins; else zero, but for explicit subdomains,
    whose blocks do not change: the core adds the others.
    """
    for member in members:
        if member.internal is None:
            continue
        if coupling == "mean":
            member.blocks = mean_blocks(linear_twin(member))
        elif coupling == "macro":
            twin = linear_twin(member)
            if twin.has_responses and twin.nb:
                compute_unit_responses(twin)
            member.response_blocks = twin.response_blocks
            lengths = (False, True) if member.double else (False,)
            member.blocks = {twice: twin.block(twice) for twice in lengths}
        elif member.tangent is not None:
            rows = member.L.rows
            size = 8.0 * 4.0 * float(rows.size) ** 2
            require(
                size, f"the block of H of {counted(rows.size, 'constraint')} of {member.name!r}"
            )
            empty = Block(rows, np.zeros((rows.size, rows.size)))
            member.blocks = {False: empty, True: empty}


def linear_twin(member: Member) -> Member:
    """The subdomain with the tangents at t = 0 in place of its internal forces."""
    assert member.internal is not None
    explicit = member.subdomain.scheme.explicit
    K_t, C_t = (permuted(A, member.order) for A in (member.internal.K, member.internal.C))
    twin = member.unbuilt(
        K=combination([(1.0, member.K), (1.0, K_t)]),
        C=combination([(1.0, member.C), (1.0, C_t)]),
        stiffness=None if explicit else combination([(1.0, member.stiffness), (1.0, K_t)]),
        damping=combination([(1.0, member.damping), *([] if explicit else [(1.0, C_t)])]),
        internal=None,
        tangent=None,
        has_responses=member.mean or member.substeps > 1,
        known={},
    )
    try:
        operators = list(map(twin.operator, twin.lengths))
    except FactorizationError:  # by (F10), whose pivots have any sign
        twin.indefinite = member.indefinite = True
        operators = list(map(twin.operator, twin.lengths))
    mass = twin.factor_of_mass() if twin.mean else None
    return built(twin, parts_of_steps(twin, operators, K_r=twin.K_r, mass=mass), operators)


def iteration_of(
    members: Sequence[Member], p: int, newton: Newton, macro: bool, ranks: Ranks | None = None
) -> forms.Iteration | forms.Shooting | None:
    """What the core's coupler iterates with; None where it is linear."""
    kinds = joined(
        ranks, [(member.internal is not None, member.tangent is not None) for member in members]
    )
    if not any(internal for internal, _ in kinds):
        return None
    options = (newton.tol, newton.iterations, newton.tangent == "reuse")
    if macro:
        return forms.Shooting(*options, *_responses(members, p, ranks))
    if not any(iterated for _, iterated in kinds):
        return None
    return forms.Iteration(*options, *_constant_part(members, p, ranks))


def _responses(members: Sequence[Member], p: int, ranks: Ranks | None) -> tuple[Any, Any, Any]:
    """The linear subdomains' part of H, in the first macro step and after it, and the size of H."""
    linear = [member for member in members if member.internal is None]
    blocks = [
        joined(ranks, [_block(member, start) for member in linear]) for start in (True, False)
    ]
    start, later = (summed(some, p) if some else None for some in blocks)
    H = summed(joined(ranks, [_block(member, False) for member in members]), p)
    symmetric = is_symmetric_sum(members, ranks)
    return (
        core_matrix(start, symmetric=symmetric),
        core_matrix(later, symmetric=symmetric),
        core_size(H, symmetric),
    )


def _block(member: Member, start: bool) -> Block:
    if member.response_blocks is not None:
        return member.response_blocks[0]
    return member.block(member.is_double(start=start))


def _constant_part(
    members: Sequence[Member], p: int, ranks: Ranks | None
) -> tuple[forms.Numeric, np.ndarray, np.ndarray]:
    """The pattern of H for the core, and the values of its constant part, in the first macro step
    and after it."""
    if p == 0:
        empty = sp.csr_array((0, 0))
        return numeric(empty, None, "the interface matrix H", True), np.empty(0), np.empty(0)
    start, later = (
        total(joined(ranks, [_block(member, first) for member in members]), p)
        for first in (True, False)
    )
    pattern = sp.csr_array((np.ones(start.nnz), start.indices, start.indptr), shape=(p, p))
    symmetric = is_symmetric_sum(members, ranks)
    symbolic = numeric(pattern, structure(pattern, p), "the interface matrix H", symmetric)
    return symbolic, np.ascontiguousarray(start.data), np.ascontiguousarray(later.data)
