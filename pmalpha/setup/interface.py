"""The interface matrix H, the order of its rows, and its factor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from .._checks import counted
from ..memory import require
from ..problem.forms import Factor
from ..problem.matrices import Matrix, dense, row_of_entries
from ..reduction.ordering import elimination_order, graph_of
from .factors import Names, factorize
from .link import Block, diagonal_compliances
from .member import Member
from .ranks import Ranks, joined

# An interface matrix with more than this share of entries is factored as a dense one.
DENSE_SHARE = 0.1


def row_order(members: Sequence[Member], p: int, ranks: Ranks | None = None) -> np.ndarray:
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


def _patterns(members: Sequence[Member]) -> list[Block | None]:
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
