"""The structure before it was cut: matrices of the subdomains with the constraints eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from .._checks import counted
from ..memory import require
from ..problem.matrices import Matrix, sparse

# An entry of the elimination below this multiple of the largest one, 1 or so, is rounding.
ROUNDING = 1e-14


class Assembled(NamedTuple):
    """The assembled structure, from `Coupler.assembled`."""

    # M, C, K: (n, n) csr_array
    M: sp.csr_array
    C: sp.csr_array
    K: sp.csr_array
    # the dofs of a subdomain from those of the structure, u_i = map[name] @ u. Entries are 0 and 1
    # for ties.
    map: dict[str, sp.csr_array]

    def __repr__(self) -> str:
        subdomains, dofs = counted(len(self.map), "subdomain"), counted(self.n, "dof")
        return f"<Assembled structure of {subdomains}, {dofs}>"

    @property
    def n(self) -> int:
        """Number of dofs."""
        return int(self.K.shape[0])


def assembled(
    names: Sequence[str],
    matrices: Sequence[tuple[Matrix, Matrix, Matrix]],
    constraints: Sequence[sp.csc_array],
) -> Assembled:
    """M, C and K on the motions that satisfy the constraints.

    matrices: sequence of (M, C, K) in inner form, (n_i, n_i) each.
    """
    sizes = [L.shape[1] for L in constraints]
    T = kernel(sp.csr_array(sp.hstack(constraints)))
    if T.shape[1] == 0:
        raise ValueError("the constraints must leave a motion, got all dofs fixed")
    parts = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    maps = [T[rows] for rows in parts]
    M, C, K = (_sum(maps, [triple[kind] for triple in matrices]) for kind in range(3))
    return Assembled(M, C, K, dict(zip(names, maps)))


def _sum(maps: Sequence[sp.csr_array], matrices: Sequence[Matrix]) -> sp.csr_array:
    """sum_i T_i^T A_i T_i"""
    n = maps[0].shape[1]
    total = sp.csr_array((n, n))
    for T, A in zip(maps, matrices):
        if A is not None:
            total = total + T.T @ sparse(A, T.shape[0]) @ T
    total = sp.csr_array(total)
    total.sort_indices()
    return total


def kernel(L: sp.csr_array) -> sp.csr_array:
    """T (n, n - p), a sparse basis of the motions with L T = 0.

    The columns are the dofs that are kept, in their order, with the entry 1. Rows with one or two
    entries are eliminated exactly, whatever their number; the others in groups of rows that share
    dofs, by a QR factorization with pivoting.
    """
    L = sp.csr_array(L, copy=True)
    L.eliminate_zeros()
    tied = _kernel_of_ties(L)
    left = sp.csr_array(L[np.diff(L.indptr) > 2] @ tied)
    return sp.csr_array(tied @ _kernel_of_groups(left)) if left.shape[0] else tied


def _kernel_of_ties(L: sp.csr_array) -> sp.csr_array:
    """The same for the rows of one entry, u_a = 0, and of two, l_a u_a + l_b u_b = 0."""
    from scipy.sparse.csgraph import connected_components

    n, entries = L.shape[1], np.diff(L.indptr)
    fixed = L.indices[L.indptr[:-1][entries == 1]]
    first = L.indptr[:-1][entries == 2]
    a, b = L.indices[first], L.indices[first + 1]
    ratio = -L.data[first] / L.data[first + 1]  # u_b = ratio u_a
    edges = sp.csr_array((np.ones(a.size), (a, b)), shape=(n, n))
    count, group = connected_components(edges, directed=False)
    factor = _factors(n, a, b, ratio)
    free = np.ones(count, dtype=bool)
    free[group[fixed]] = False
    # as many independent rows as dofs: such as u_a = u_b and u_a = -u_b
    free[np.bincount(group[a], minlength=count) >= np.bincount(group)] = False
    first_dof = np.full(count, n)  # the first dof of each group
    np.minimum.at(first_dof, group, np.arange(n))
    order = np.argsort(first_dof[free])
    column = np.full(count, -1)
    column[np.flatnonzero(free)[order]] = np.arange(order.size)
    rows = np.flatnonzero(free[group])
    values = factor[rows] / factor[first_dof[group[rows]]]
    return sp.csr_array((values, (rows, column[group[rows]])), shape=(n, order.size))


def _factors(n: int, a: np.ndarray, b: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Values x (n,) of a motion that satisfies x_b = ratio x_a, not zero."""
    factor = np.ones(n)
    if np.all(ratio == 1.0):
        return factor
    neighbours: list[list[tuple[int, float]]] = [[] for _ in range(n)]
    for i, j, r in zip(a, b, ratio):
        neighbours[i].append((int(j), r))
        neighbours[j].append((int(i), 1.0 / r))
    seen = np.zeros(n, dtype=bool)
    for start in range(n):
        waiting = [] if seen[start] else [start]
        seen[start] = True
        while waiting:
            i = waiting.pop()
            for j, r in neighbours[i]:
                if not seen[j]:
                    seen[j], factor[j] = True, r * factor[i]
                    waiting.append(j)
    return factor


def _kernel_of_groups(L: sp.csr_array) -> sp.csr_array:
    """The same for general rows, in groups of rows that share dofs."""
    from scipy.linalg import qr, solve_triangular
    from scipy.sparse.csgraph import connected_components

    n = L.shape[1]
    count, group = connected_components(sp.csr_array(abs(L) @ abs(L.T)), directed=False)
    removed = np.zeros(n, dtype=bool)
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    order = np.argsort(group, kind="stable")
    for members in np.split(order, np.cumsum(np.bincount(group, minlength=count))[:-1]):
        block = sp.csc_array(L[members])
        dofs = np.flatnonzero(np.diff(block.indptr))
        require(24.0 * members.size * dofs.size, f"the elimination of {members.size} constraints")
        R, pivots = qr(block[:, dofs].toarray(), mode="r", pivoting=True)
        p = members.size
        weights = -solve_triangular(R[:p, :p], R[:p, p:])
        weights[np.abs(weights) < ROUNDING * np.max(np.abs(weights), initial=1.0)] = 0.0
        i, j = np.nonzero(weights)
        removed[dofs[pivots[:p]]] = True
        rows.append(dofs[pivots[i]])
        columns.append(dofs[pivots[p + j]])
        values.append(weights[i, j])
    free = np.flatnonzero(~removed)
    column = np.full(n, -1)
    column[free] = np.arange(free.size)
    row, col = np.concatenate([free, *rows]), column[np.concatenate([free, *columns])]
    return sp.csr_array(
        (np.concatenate([np.ones(free.size), *values]), (row, col)), shape=(n, free.size)
    )
