"""Critical steps of elements, and the numbers of substeps that follow from them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..problem.schemes import Scheme
from ..setup.stability import critical_product
from .whole import Blocks, Whole

# Steps are at most this fraction of the critical step of every element.
FRACTION = 0.95
# Elements whose matrices are held at a time.
CHUNK = 4096
# lambda_max <= |B^16|_F^(1/16), at most the 32nd root of the number of dofs above lambda_max: up to
# 1.05 times the frequency for 24 dofs
SQUARINGS = 4
# Numbers of substeps of elements that share a node differ by this factor at most, 2^2.
GRADE = 2
# A group of connected elements of up to this number becomes finer if all its neighbours are.
ISLAND = 8
# Levels above this one are refused: 2^20 substeps.
FINEST = 20


def frequencies(whole: Whole) -> np.ndarray:
    """(elements,): upper bounds of the highest circular frequency of each element alone.

    The largest of them is an upper bound of the highest frequency of any assembly of the elements
    (Irons and Treharne, 1971), with any dofs fixed or tied. inf for an element with stiffness at a
    dof without mass.
    """
    omega = np.empty(whole.count)
    for blocks in whole.blocks(CHUNK):
        omega[blocks.numbers] = np.sqrt(_largest(blocks))
    return omega


def _largest(blocks: Blocks) -> np.ndarray:
    """(e,) or (1,): bounds of the largest eigenvalue of K with respect to M."""
    free = blocks.free
    K = np.where(free[:, :, None] & free[:, None, :], blocks.K, 0.0)
    if blocks.M.ndim == 2:
        return _of_lumped(K, np.broadcast_to(blocks.M, free.shape))
    k = free.shape[1]
    mass = np.einsum("ekk->ek", blocks.M)
    free = free & ((mass > 0.0) | (np.abs(K).max(axis=2) > 0.0))  # not rotations of a solid
    M = np.where(free[:, :, None] & free[:, None, :], blocks.M, np.eye(k))
    if len(M) < len(K):
        M = np.broadcast_to(M, K.shape)
    smallest = np.linalg.eigvalsh(M)[:, 0]
    definite = smallest > 1e-12 * np.abs(M).max(axis=(1, 2))
    values = np.full(len(K), np.inf)
    R = np.linalg.cholesky(M[definite])  # M = R R^T
    half = np.linalg.solve(R, K[definite])
    values[definite] = _bound(np.linalg.solve(R, np.swapaxes(half, 1, 2)))
    return values


def _of_lumped(K: np.ndarray, mass: np.ndarray) -> np.ndarray:
    loaded = np.abs(K).max(axis=2) > 0.0
    held = (loaded & ~(mass > 0.0)).any(axis=1)
    root = np.where(mass > 0.0, mass, np.inf) ** -0.5
    values = _bound(root[:, :, None] * K * root[:, None, :])
    values[held] = np.inf
    return values


def _bound(B: np.ndarray) -> np.ndarray:
    """(e,): |B^16|_F^(1/16), an upper bound of the eigenvalues of symmetric matrices (e, k, k)."""
    size = np.sqrt(np.einsum("eij,eij->e", B, B))
    S = B / np.where(size > 0.0, size, 1.0)[:, None, None]
    for _ in range(SQUARINGS):
        S = S @ S
    power = 0.5 / 2**SQUARINGS
    result: np.ndarray = size * np.einsum("eij,eij->e", S, S) ** power
    return result


def levels_of(omega: np.ndarray, dt: float, scheme: Scheme, *, check: bool = True) -> np.ndarray:
    """The smallest levels l >= 0 with dt / 2^l up to 0.95 times the critical step.

    Raises
    ------
    ValueError
        For a macro step more than 2^20 times as long, with `check`.
    """
    limit = critical_product(scheme)
    if not np.isfinite(limit):
        return np.zeros(omega.shape, dtype=np.int64)
    with np.errstate(divide="ignore"):
        ratio = np.log2(dt * omega / (FRACTION * limit))
    most = float(np.max(ratio))
    if check and most > FINEST:
        cause = f"it is {2.0**most:.3g} times the shortest of them"
        if np.isinf(most):
            cause = "some elements have no mass where they have stiffness"
        raise ValueError(
            f"dt must be at most 2^{FINEST} times the critical steps of elements in an explicit "
            f"subdomain, got {dt:g}: {cause}"
        )
    # a ratio of exactly 2^l must not become l + 1 by rounding
    return np.maximum(np.ceil(ratio - 1e-9), 0.0).astype(np.int64)


def graded(whole: Whole, levels: np.ndarray) -> np.ndarray:
    """Levels that are not lower, without islands, and 2 apart at most where elements meet."""
    levels = levels.copy()
    while True:
        before = levels.copy()
        while _raise_to_neighbours(whole, levels):
            pass
        _absorb_islands(whole, levels)
        if np.array_equal(levels, before):
            return levels


def _raise_to_neighbours(whole: Whole, levels: np.ndarray) -> bool:
    """Raise levels to 2 below the highest of the elements with a common node, in place."""
    at = np.zeros(whole.link_count + 1, dtype=levels.dtype)  # the last entry is that of -1
    groups = whole.by_group(levels)
    for links, own in zip(whole.links, groups):
        np.maximum.at(at, links.ravel(), np.repeat(own, links.shape[1]))
    at[-1] = 0
    needed = np.concatenate([at[links].max(axis=1) for links in whole.links]) - GRADE
    raised = bool(np.any(needed > levels))
    np.maximum(levels, needed, out=levels)
    return raised


def _absorb_islands(whole: Whole, levels: np.ndarray) -> None:
    """Give a few connected elements among finer ones the lowest level around them, in place."""
    group, size = _connected(whole, levels)
    most = np.iinfo(levels.dtype).max
    lowest = np.full(size.size, most)
    coarser = np.zeros(size.size, dtype=bool)
    for level in np.unique(levels)[::-1]:  # from the finest, so that the lowest one remains
        at = np.zeros(whole.link_count + 1, dtype=bool)  # the last entry is that of -1
        for links, own in zip(whole.links, whole.by_group(levels)):
            at[links[own == level]] = True
        at[-1] = False
        touched = np.concatenate([at[links].any(axis=1) for links in whole.links])
        lowest[group[touched & (levels < level)]] = level
        coarser[group[touched & (levels > level)]] = True
    change = ((size <= ISLAND) & ~coarser & (lowest < most))[group]
    levels[change] = lowest[group[change]]


def _connected(whole: Whole, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The group of each element, connected through nodes with elements of its level; sizes."""
    from scipy.sparse.csgraph import connected_components

    nodes, top = whole.link_count, int(levels.max()) + 1
    begin, rows, columns = 0, [], []
    for links, own in zip(whole.links, whole.by_group(levels)):
        kept = links >= 0
        element = begin + np.arange(len(links))
        rows.append(np.broadcast_to(element[:, None], links.shape)[kept])
        columns.append((links * top + own[:, None])[kept])
        begin += len(links)
    shape = (whole.count, nodes * top)
    row, column = np.concatenate(rows), np.concatenate(columns)
    _, column = np.unique(column, return_inverse=True)
    n = shape[0] + int(column.max()) + 1
    graph = sp.coo_array((np.ones(row.size, dtype=bool), (row, shape[0] + column)), shape=(n, n))
    group = connected_components(graph, directed=False)[1][: shape[0]]
    return group, np.bincount(group)
