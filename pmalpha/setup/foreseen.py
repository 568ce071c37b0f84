"""What steps will cost, predicted from patterns before anything is factored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import Matrix, sparse
from ..problem.schemes import Scheme
from ..problem.subdomain import Subdomain
from ..reduction.ordering import graph_of
from .factors import elimination
from .interface import DENSE_SHARE, total
from .link import Block, Link, diagonal_compliances
from .member import STEP_NUMBERS
from .stability import step_ratio

# Bytes of an entry of a matrix: of the Subdomain by rows, and of the core.
BYTES, CORE_BYTES = 12, 9
# Vectors of a subdomain: states, right-hand sides, scratch.
VECTORS = 24


class Foreseen(NamedTuple):
    """Of one subdomain: interface dofs, entries that a step reads, bytes, step / critical step."""

    interface: int
    entries: int
    bytes: int
    ratio: float


def foreseen(
    subdomains: Sequence[Subdomain], ties: Mapping[Any, Any], p: int, dt: float
) -> tuple[list[Foreseen], int]:
    """Of each subdomain, and the entries that an interface problem reads.

    ties: the p constraints, matrices by subdomain.
    """
    rows = [_of_subdomain(s, _last(ties.get(s)), dt) for s in subdomains]
    blocks = [_block(s, ties[s]) for s in subdomains if s in ties]
    return rows, _interface(blocks, p) if p else 0


def _of_subdomain(s: Subdomain, last: np.ndarray, dt: float) -> Foreseen:
    swept = _swept(s, last)
    entries = swept + _size(s.K) + _size(s.C) + STEP_NUMBERS * s.n
    stored = sum(_size(A) for A in (s.M, s.K, s.C))
    size = (BYTES + CORE_BYTES) * stored + 4 * swept + 8 * VECTORS * s.n
    ratio = step_ratio(s, dt / s.substeps) if s.internal is None else None
    value = 0.0 if ratio is None else float(ratio.value)
    return Foreseen(last.size, int(entries), int(size), value)


def _last(L: Any) -> np.ndarray:
    """The interface dofs."""
    return np.empty(0, dtype=np.int64) if L is None else np.unique(L.indices).astype(np.int64)


def _size(A: Matrix | None) -> int:
    return 0 if A is None else int(A.size if isinstance(A, np.ndarray) else A.nnz)


def _is_plain(s: Subdomain) -> bool:
    """Whether Mbar is diagonal."""
    terms = (s.M, s.implicit_damping, s.implicit_stiffness)
    return all(A is None or A.ndim == 1 for A in terms)


def _swept(s: Subdomain, last: np.ndarray) -> int:
    """Entries of the factor of Mbar, twice."""
    if _is_plain(s):
        return 2 * s.n
    graph = graph_of([s.M, s.implicit_damping, s.implicit_stiffness])
    return s.n * (s.n + 1) if graph is None else elimination(s.n, graph, last).swept


def _block(s: Subdomain, L: Any) -> Block:
    """The pattern of its block of H."""
    link = Link.of(sp.csc_array(L))
    if _is_plain(s):
        return diagonal_compliances([np.ones(s.n)], [link.pattern])[0]
    return Block(link.rows, np.ones((link.rows.size, link.rows.size)))


def _interface(blocks: Sequence[Block], p: int) -> int:
    """Entries of the factor of H, twice."""
    largest = max((float(b.rows.size) for b in blocks if b.is_dense), default=0.0)
    if largest**2 > DENSE_SHARE * p**2:
        return p * (p + 1)
    H = total(blocks, p)
    if H.nnz <= p:
        return 2 * p
    if H.nnz > DENSE_SHARE * p * p:
        return p * (p + 1)
    return elimination(p, graph_of([H]), np.arange(0)).swept


def entries_of_union(
    subdomains: Sequence[Subdomain], dofs: Sequence[np.ndarray], size: int, p: int, scheme: Scheme
) -> int:
    """Entries that a step of one subdomain in place of all of them reads.

    dofs: those of each among `size` numbers; p of them are in two subdomains.
    """
    K, C, M = (_union([getattr(s, x) for s in subdomains], dofs, size) for x in "KCM")
    n: int = sum(numbers.size for numbers in dofs) - p
    fixed = STEP_NUMBERS * n + _size(K) + _size(C)
    implicit = [M, C] if scheme.explicit else [M, C, K]
    if all(A is None or A.ndim == 1 for A in implicit):
        return fixed + 2 * n
    graph = graph_of(implicit)
    if graph is None:
        return fixed + n * (n + 1)
    return fixed + elimination(size, graph, np.arange(0)).swept


def _union(matrices: Sequence[Matrix], dofs: Sequence[np.ndarray], n: int) -> Matrix | None:
    present = [(A, numbers) for A, numbers in zip(matrices, dofs) if A is not None]
    if not present:
        return None
    if all(A.ndim == 1 for A, _ in present):
        return np.ones(n)
    rows, columns = [np.arange(0)], [np.arange(0)]
    for A, numbers in present:
        entries = sp.coo_array(sparse(A, numbers.size))
        rows.append(numbers[entries.row])
        columns.append(numbers[entries.col])
    row, column = np.concatenate(rows), np.concatenate(columns)
    return sp.coo_array((np.ones(row.size), (row, column)), shape=(n, n)).tocsr()
