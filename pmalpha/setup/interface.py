"""Set-up of macro coupling, (M3), and of mean coupling, (K3).

The interface matrices (M4) and (K4) consist of unit responses, of velocities and displacements at
the end of a macro step: one for each constraint of every subdomain that has link responses. They
are stored where that is faster than repeating the substeps, (M8).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, numbered
from .._core import LANES
from ..errors import FactorizationError, PerformanceWarning, warn
from ..memory import require
from ..problem import forms
from ..problem.forms import Factor, Newton
from ..problem.matrices import Matrix, combination, core_matrix, dense, permuted, row_of_entries
from ..reduction.ordering import elimination_order, graph_of
from .factors import Names, factorize
from .internal_forces import core_size, numeric, structure
from .link import Block, diagonal_compliances
from .member import Member, Ordered, Stepped, built, parts_of_steps
from .ranks import Ranks, joined

# ---- interface ----------------------------------------------------------------------------------
# The interface matrix H, the order of its rows, and its factor.

# An interface matrix with more than this share of entries is factored as a dense one.
DENSE_SHARE = 0.1


def row_order(members: Sequence[Stepped], p: int, ranks: Ranks | None = None) -> np.ndarray:
    """The order of the multipliers in which the interface matrix fills little."""
    if p < 2:
        return np.arange(p)
    # constraints of each subdomain, and the pattern of its block of H where that is not full
    patterns = joined(ranks, list(zip([member.L.rows for member in members], _patterns(members))))
    blocks = sum(float(rows.size) ** 2 for rows, sparse in patterns if sparse is None)
    if blocks > DENSE_SHARE * p**2:
        return np.arange(p)  # these blocks alone make the matrix dense
    require(40.0 * blocks, f"the pattern of the interface matrix of {counted(p, 'constraint')}")
    graphs = [
        Block(rows, np.ones((rows.size, rows.size))) if sparse is None else sparse
        for rows, sparse in patterns
    ]
    return elimination_order(p, graph_of([total(graphs, p)]), np.arange(0))


def _patterns(members: Sequence[Stepped]) -> list[Block | None]:
    """The blocks of H that connect constraints of one dof only; None for others."""
    thin = [p for p in members if p.is_diagonal and p.internal is None and not p.has_responses]
    blocks = diagonal_compliances([np.ones(p.n) for p in thin], [p.L.pattern for p in thin])
    block_of = dict(zip(map(id, thin), blocks))
    return [block_of.get(id(member)) for member in members]


def is_symmetric_sum(members: Sequence[Member], ranks: Ranks | None = None) -> bool:
    """Whether the sum of the blocks of these subdomains, of all processes, is symmetric."""
    return all(joined(ranks, [member.has_symmetric_block for member in members]))


def interface_matrix(
    members: Sequence[Member],
    p: int,
    *,
    start: bool,
    mean: bool = False,
    ranks: Ranks | None = None,
) -> Matrix:
    """H = sum_i al2_i L_i Mbar_i^-1 L_i^T, equations (18) and (F6); for link responses (M4).

    start: all subdomains take single steps, as in the first macro step.
    mean: for link responses, the mean velocity in the macro step instead of the one at its end.
    """
    make_diagonal_blocks([p for p in members if p.response_blocks is None], start=start)
    blocks = []
    for member in members:
        if member.response_blocks is not None:
            blocks.append(member.response_blocks[1 if mean else 0])
            continue
        blocks.append(member.block(member.is_double(start=start)))
    return summed(joined(ranks, blocks), p)


def make_diagonal_blocks(members: Sequence[Member], *, start: bool) -> None:
    """The blocks of H of all subdomains with a diagonal Mbar, in one pass."""
    plain = [(member, member.is_double(start=start)) for member in members if member.is_diagonal]
    new = [(member, twice) for member, twice in plain if twice not in member.blocks]
    inverses = [member.diagonal_inverse(twice) for member, twice in new]
    blocks = diagonal_compliances(inverses, [member.L for member, _ in new])
    for (member, twice), block in zip(new, blocks):
        member.blocks[twice] = block


def total(blocks: Sequence[Block], p: int) -> sp.csr_array:
    """The sum of blocks as a (p, p) matrix, in one pass."""
    values, rows, columns = (np.concatenate(x) for x in zip(*(b.entries() for b in blocks)))
    H = sp.csr_array((values, (rows, columns)), shape=(p, p))
    H.sort_indices()
    return H


def summed(blocks: Sequence[Block], p: int) -> Matrix | None:
    """The sum of the subdomains' blocks of H, in the form that is factored fastest."""
    if p == 0:
        return None
    if p == 1:
        return np.cumsum(np.concatenate([[0.0], *(b.values.ravel() for b in blocks)]))[-1:]
    largest = max((b.rows.size for b in blocks if b.is_dense), default=0)
    if largest**2 > DENSE_SHARE * p**2:
        return _dense_sum(blocks, p)
    H = total(blocks, p)
    if np.array_equal(H.indices, row_of_entries(H)):  # by the pattern: entries may be zero
        return H.diagonal()
    return dense(H) if H.nnz > DENSE_SHARE * p * p else H


def _dense_sum(blocks: Sequence[Block], p: int) -> Matrix:
    """The sum where one block alone makes it dense."""
    require(8.0 * p**2, f"the interface matrix of {counted(p, 'constraint')}")
    H = np.zeros((p, p))
    for block in blocks:
        if not block.is_dense:
            values, rows, columns = block.entries()
            H[rows, columns] += values
        elif block.rows.size == p:
            H += block.values
        else:
            H[np.ix_(block.rows, block.rows)] += block.values
    return H


def interface_factor(
    H: Matrix | None,
    rows: np.ndarray,
    what: str = "the interface matrix H",
    *,
    symmetric: bool = True,
    threads: int = 1,
) -> Factor:
    """The factor of H, empty without constraints. `rows` are the constraints in the order of H."""
    if H is None:
        return Factor(np.empty(0), None)
    names = Names(what, rows)
    return factorize(H, names, symmetric=symmetric, threads=threads)


# ---- macro --------------------------------------------------------------------------------------

# Largest size in bytes of the stored unit responses of one subdomain.
STORED = 256_000_000
# Matrix entries that sweeps read per second on one core, a round figure; with `LANES` vectors.
RATE, LANE_RATE = 1e9, 5e8
# Matrix entries read for each thread that shares unit responses: some milliseconds.
SHARE = 2e6
# Seconds of set-up from which on it is reported, and from which on (a day) it is refused.
LONG, ABSURD = 20.0, 86400.0


def prepare(members: Sequence[Member]) -> None:
    """Unit responses of all subdomains with substeps."""
    check_work(members, "macro")
    for member in members:
        if member.has_responses and member.nb:
            compute_unit_responses(member)


def check_work(members: Sequence[Member], coupling: str) -> None:
    """PerformanceWarning when the unit responses take long, ValueError for more than a day."""
    works = {member.name: work(member) for member in members if member.has_responses}
    if not works:
        return
    name = max(works, key=works.__getitem__)
    member = next(p for p in members if p.name == name)
    why = (
        f"{counted(member.L.rows.size, 'constraint')} times {member.substeps} substeps times "
        f"{member.core.entries} matrix entries"
    )
    option = f'coupling="{coupling}"'
    warn_of_work(works, LANE_RATE, option, why, 'take coupling="pm" or "gc", which need none')


def warn_of_work(
    works: Mapping[str, float], rate: float, option: str, why: str, remedy: str
) -> None:
    """PerformanceWarning for a long set-up, ValueError with a remedy for more than a day.

    `works` are matrix entries read for each subdomain, of which `rate` are read in a second.
    """
    seconds = sum(works.values()) / rate
    if seconds <= LONG:
        return
    text = (
        f"{option} needs about {seconds:.3g} s before the first step (more than "
        f"{LONG if seconds <= ABSURD else ABSURD:g} s), most of it for "
        f"{max(works, key=works.__getitem__)!r}: {why}"
    )
    if seconds > ABSURD:
        raise ValueError(f"{text}; {remedy}")
    warn(f"{text}; it is worth it for long runs only", PerformanceWarning)


def work(member: Member) -> float:
    """Matrix entries read to compute the unit responses of a subdomain, `LANES` in one pass."""
    passes = -(-member.L.rows.size // LANES)
    return float(member.core.entries) * member.substeps * passes


def is_stored(member: Member) -> bool:
    """(M8): whether reading U costs less than the substeps, and U is not too large."""
    size = 4.0 * member.n * member.L.rows.size
    return size <= member.substeps * member.core.entries and 8.0 * size <= STORED


def compute_unit_responses(member: Member) -> None:
    """Unit responses of a subdomain; sets its block of H, and the one of the mean velocities.

    Errors as of `unit_responses`.
    """
    rows = member.L.rows
    end, mean, states = unit_responses(member, rows, stored=is_stored(member))
    if states is not None:
        member.store(forms.Responses(rows, states))
    member.response_blocks = response_block(member, rows, end), response_block(member, rows, mean)


def unit_responses(
    member: Member, rows: np.ndarray, *, stored: bool, twice: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Responses of a subdomain to each of its constraints, at these rows.

    Threads share the constraints; the responses are bitwise the same for any number of threads.

    Returns end, mean: (k, k) array, what the core ties at the end of the macro step, and its mean
        over it; a row for each response.
    Returns states: (k, 4, n) array, or None, U, where it is to be stored.
    Raises ValueError when a response is not finite: the steps are far above the critical one.
    """
    k = rows.size
    threads = max(1, min(member.elimination.threads, int(work(member) // SHARE), -(-k // LANES)))
    size = 8.0 * 4.0 * member.n * (k if stored else 0) + 8.0 * 6.0 * member.n * LANES * threads
    require(
        64.0 * k**2 + size, f"the link response of {member.name!r} to {counted(k, 'constraint')}"
    )
    end, mean = np.empty((k, k)), np.empty((k, k))
    states = np.empty((k, 4, member.n)) if stored else None
    if not member.core.unit_responses(rows, end, mean, states, twice, threads):
        raise ValueError(
            f"substeps of subdomain {member.name!r} must be more: its response to the multipliers "
            f"is not finite at the end of a macro step, got {member.substeps} of length "
            f"{member.h:g}"
        )
    return end, mean, states


def response_block(member: Member, rows: np.ndarray, values: np.ndarray) -> Block:
    """The block (M7), sparse, since many pairs of constraints have no entry; row k of the values
    is the response to multiplier k, a column of H."""
    if not member.has_symmetric_block:
        return Block.of_nonzero(rows, values.T)
    return Block.of_nonzero(rows, 0.5 * (values + values.T))


def check_mean(members: Sequence[Ordered]) -> None:
    """ValueError for tied dofs without mass under mean coupling."""
    for member in members:
        tied = np.intersect1d(member.order[member.n - member.nb :], member.subdomain.massless)
        if tied.size:
            raise ValueError(
                f'coupling="mean" needs mass at the interface dofs, got none at '
                f"{numbered('dof', tied)} of {member.name!r}"
            )


def prepare_mean(members: Sequence[Member]) -> None:
    """Unit responses of all subdomains, which make their blocks of H."""
    check_work(members, "mean")
    for member in members:
        if member.has_responses:
            member.blocks = mean_blocks(member)


def mean_blocks(member: Member) -> dict[bool, Block]:
    """The blocks of H of a subdomain, of the single and the double step; stores the responses."""
    rows = member.L.rows
    stored = not member.deferred and not member.double and rows.size > 0 and is_stored(member)
    single, _, states = unit_responses(member, rows, stored=stored)
    blocks = {False: response_block(member, rows, single)}
    if member.double:
        twice = unit_responses(member, rows, stored=False, twice=True)[0]
        # of the mean of both macro steps, the share of the new one
        share = 2.0 * member.h / member.lengths[1]
        blocks[True] = response_block(member, rows, share * twice)
    if states is not None:
        member.store(forms.Responses(rows, states))
    return blocks


def _of_old(member: Member) -> Block:
    """The block of a double step for the multipliers of its first macro step."""
    block, (h, long) = member.blocks[True], member.lengths
    return block.times((long - h) / h)


def doubled_part(members: Sequence[Member], p: int, ranks: Ranks | None = None) -> Any:
    """The part of H of the subdomains that take double steps, for the core."""
    blocks = joined(
        ranks, [_of_old(member) for member in members if member.double and member.internal is None]
    )
    symmetric = is_symmetric_sum(members, ranks)
    return core_matrix(summed(blocks, p), symmetric=symmetric) if blocks else None


# ---- iteration -----------------------------------------------------------------------------------
# Set-up of the iteration of internal forces: their part of H, and what the coupler iterates with.
#
# Under "pm" and "gc" the core adds the blocks of iterated subdomains to a constant part of H, in
# every iteration. Under "macro" shooting begins with H of the tangents at t = 0, of linear twins of
# the subdomains with internal forces.


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
