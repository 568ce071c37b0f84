"""Parts of equal cost with small interfaces: METIS, or bisection of coordinates."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .._checks import whole_number
from ..problem.ordering import has_nested_dissection
from .whole import Whole

# METIS takes weights as whole numbers; their sum has to fit into 32 bits.
TOTAL_WEIGHT = 2**30


def partition(whole: Whole, parts: int, costs: np.ndarray) -> np.ndarray:
    """(elements,): labels 0 .. parts - 1 of parts with nearly equal sums of costs, none empty.

    Raises
    ------
    TypeError, ValueError
        For more parts than elements, and where there is neither METIS nor coordinates.
    """
    k = whole_number(parts, "parts", low=1)
    if k > whole.count:
        raise ValueError(f"parts must be at most the number of elements, {whole.count}, got {k}")
    if k == 1:
        return np.zeros(whole.count, dtype=np.int64)
    if has_nested_dissection():
        labels = _by_metis(whole, k, costs)
        if np.unique(labels).size == k:
            return labels
    if whole.centroids is None:
        raise ValueError(
            "points, the centres of the elements, must be given for parts= of Elements where "
            "pymetis is not installed or leaves a part empty"
        )
    return bisected(whole.centroids, k, costs)


def bisected(points: np.ndarray, parts: int, costs: np.ndarray) -> np.ndarray:
    """Labels by recursive bisection across the longest extent of the points."""
    labels = np.zeros(len(points), dtype=np.int64)
    waiting = [(np.arange(len(points)), 0, parts)]
    while waiting:
        own, first, k = waiting.pop()
        if k == 1:
            labels[own] = first
            continue
        extent = np.ptp(points[own], axis=0)
        order = own[np.argsort(points[own, int(np.argmax(extent))], kind="stable")]
        left = k // 2
        share = np.cumsum(costs[order]) - 0.5 * costs[order]
        at = int(np.searchsorted(share, costs[order].sum() * left / k))
        at = min(max(at, left), own.size - (k - left))  # an element at least for each part
        waiting += [(order[:at], first, left), (order[at:], first + left, k - left)]
    return labels


def _by_metis(whole: Whole, parts: int, costs: np.ndarray) -> np.ndarray:
    import pymetis

    graph = adjacency(whole)
    weights = np.maximum(1, costs / costs.sum() * TOTAL_WEIGHT).astype(np.int32)
    _, labels = pymetis.part_graph(
        parts,
        adjacency=pymetis.CSRAdjacency(
            adj_starts=graph.indptr.astype(np.int32), adjacent=graph.indices.astype(np.int32)
        ),
        vweights=weights,
        options=pymetis.Options(seed=1, numbering=0),
    )
    return np.array(labels, dtype=np.int64)


def adjacency(whole: Whole) -> sp.csr_array:
    """Elements that share a face, as far as this can be seen: of two elements with common nodes
    those that have more than half as many as one of them has with any other element."""
    rows, columns, begin = [], [], 0
    for links in whole.links:
        kept = links >= 0
        element = begin + np.arange(len(links), dtype=np.int32)
        rows.append(np.broadcast_to(element[:, None], links.shape)[kept])
        columns.append(links[kept].astype(np.int32))
        begin += len(links)
    row, column = np.concatenate(rows), np.concatenate(columns)
    ones = np.ones(row.size, dtype=np.int32)
    member = sp.csr_array((ones, (row, column)), shape=(whole.count, whole.link_count))
    common = sp.csr_array(member @ member.T)
    row = np.repeat(np.arange(whole.count, dtype=np.int32), np.diff(common.indptr))
    apart = row != common.indices
    most = np.zeros(whole.count, dtype=common.data.dtype)
    np.maximum.at(most, row[apart], common.data[apart])
    least = np.minimum(most[row], most[common.indices])
    kept = apart & (2 * common.data > least)
    ptr = np.concatenate([[0], np.cumsum(np.bincount(row[kept], minlength=whole.count))])
    index = common.indices[kept]
    return sp.csr_array((np.ones(index.size, dtype=np.int32), index, ptr), shape=common.shape)
