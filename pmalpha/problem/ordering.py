"""The order of elimination: interface dofs last, little fill before them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spilu

from .. import _core
from .matrices import Matrix

# Up to this ratio of fill the natural order is taken without computing others: a chain, a frame
# with its storeys in a row.
LITTLE_FILL = 1.5
# The fill of an order is not counted if its envelope is this many times the fill of another order:
# the time to count is proportional to the fill.
HOPELESS = 8.0
# Possible numbers of dofs per node.
NODE_SIZES = (1, 2, 3, 6)
# Below this number of nodes nested dissection does not reduce the fill.
FEW_NODES = 100


def graph_of(terms: Sequence[Matrix]) -> sp.csr_array | None:
    """The graph of any sum of these matrices in inner form, None unless one is sparse and none
    dense: symmetric, without a diagonal, all entries one."""
    sparse = [A for A in terms if A is not None and sp.issparse(A)]
    if not sparse or len(sparse) < sum(A is not None and A.ndim == 2 for A in terms):
        return None
    return _pattern(sparse[0] if len(sparse) == 1 else sum(abs(A).sign() for A in sparse))


def elimination_order(n: int, graph: sp.csr_array | None, last: np.ndarray) -> np.ndarray:
    """Dof at each position of the elimination order.

    The order of least fill among the natural order, minimum degree and, where pymetis is installed,
    nested dissection. It is found on the graph of the nodes, so the dofs of one node stay together.

    Parameters
    ----------
    n : int
    graph : (n, n) csr_array or None
        From `graph_of`; None for the natural order.
    last : (nb,) sorted array of int
        Interface dofs, which come last.

    Returns
    -------
    (n,) array of int
    """
    if n == 0 or graph is None:
        interior = np.setdiff1d(np.arange(n), last, assume_unique=True)
        return np.concatenate([interior, last])
    nodes = node_graph(graph, last)
    best = _least_fill(nodes)
    best = best[_core.postorder(*rows_of(nodes.graph, best), nodes.border)]
    return nodes.dofs_of(best)


@dataclass(frozen=True)
class NodeGraph:
    """The graph of the nodes, with the nodes of the interface last.

    Attributes
    ----------
    graph : (N, N) csr_array
        Symmetric, without a diagonal, all entries one.
    border : int
        Number of nodes of the interface.
    dofs : (n,) array of int
        Dofs node by node.
    start : (N + 1,) array of int
        Index in `dofs` at which the dofs of each node begin.
    """

    graph: sp.csr_array
    border: int
    dofs: np.ndarray
    start: np.ndarray

    def dofs_of(self, order: np.ndarray) -> np.ndarray:
        """The order of the dofs that follows from an order of the nodes."""
        sizes = np.diff(self.start)[order]
        ends = np.cumsum(sizes)
        return self.dofs[np.arange(ends[-1]) + np.repeat(self.start[order] - ends + sizes, sizes)]


def node_graph(pattern: sp.csr_array, last: np.ndarray) -> NodeGraph:
    """The graph with the dofs of each node merged; its interface dofs and the others separately."""
    n = pattern.shape[0]
    border = np.zeros(n, dtype=bool)
    border[last] = True
    label = np.arange(n) // node_size(pattern) + n * border
    dofs = np.argsort(label, kind="stable")
    start = np.concatenate([np.flatnonzero(np.diff(label[dofs], prepend=-1)), [n]])
    node = np.empty(n, dtype=np.int64)
    node[dofs] = np.repeat(np.arange(start.size - 1), np.diff(start))
    graph = pattern if start.size == n + 1 and not last.size else _merged(pattern, node)
    return NodeGraph(graph, int(np.unique(label[last]).size), dofs, start)


def node_size(pattern: sp.csr_array) -> int:
    """Dofs per node when they are numbered node by node: 1, 2, 3 or 6, found from the pattern.

    Dofs of one node have the same neighbours, except for couplings that vanish on regular meshes,
    so that merging b of them reduces the entries of a row up to b times. Merging neighbours that do
    not form a node reduces them less, at the ends of the mesh: by less than the cube root of b.
    """
    n = pattern.shape[0]
    return max((b for b in NODE_SIZES if n % b == 0), key=lambda b: _gain(pattern, b) / np.cbrt(b))


def _gain(pattern: sp.csr_array, b: int) -> float:
    """Entries of a row of the pattern per entry of a row of the merged graph."""
    n = pattern.shape[0]
    entries = pattern.nnz if b == 1 else _merged(pattern, np.arange(n) // b).nnz
    return (pattern.nnz + n) / (b * entries + n)


def _merged(pattern: sp.csr_array, node: np.ndarray) -> sp.csr_array:
    """The graph of the nodes, from the graph of the dofs."""
    n, N = node.size, int(node.max()) + 1
    if n == N:
        ptr, index = rows_of(pattern, np.argsort(node))
        graph = sp.csr_array((pattern.data, index, ptr.astype(pattern.indptr.dtype)), shape=(n, n))
        graph.sort_indices()
        return graph
    member = sp.csr_array((np.ones(n), (node, np.arange(n))), shape=(N, n))
    merged = sp.csr_array(member @ pattern @ member.T)
    merged.sort_indices()
    return _pattern(merged)


def _least_fill(nodes: NodeGraph) -> np.ndarray:
    """The order of the nodes with the least fill."""
    graph, N = nodes.graph, nodes.start.size - 1
    natural = np.arange(N)
    bound = envelope(graph, natural)
    if bound <= LITTLE_FILL * (graph.nnz + N) / 2:
        return natural
    interior, border = natural[: N - nodes.border], natural[N - nodes.border :]
    inner = _leading(graph, interior.size)
    orders = [_minimum_degree(inner)]
    if interior.size >= FEW_NODES and (dissected := _nested_dissection(inner)) is not None:
        orders.append(dissected)
    candidates = [np.concatenate([order, border]) for order in orders]
    fills = [fill(graph, order) for order in candidates]
    if bound < HOPELESS * min(fills):
        candidates.append(natural)
        fills.append(fill(graph, natural))
    least = min(fills)
    return next(order for order, count in zip(candidates[::-1], fills[::-1]) if count == least)


def _leading(graph: sp.csr_array, size: int) -> sp.csr_array:
    """The graph of the first nodes only."""
    ptr = graph.indptr[: size + 1]
    return _graph(ptr, graph.indices[: ptr[-1]], graph.indices[: ptr[-1]] < size)


def envelope(pattern: sp.csr_array, order: np.ndarray) -> int:
    """An upper bound of `fill`, in one pass: each row is counted from its first entry on."""
    ptr, index = rows_of(pattern, order)
    n = order.size
    first = np.arange(n)
    filled = np.diff(ptr) > 0
    first[filled] = np.minimum(np.minimum.reduceat(index, ptr[:-1][filled]), first[filled])
    return int(np.sum(np.arange(n) - first)) + n


def fill(pattern: sp.csr_array, order: np.ndarray) -> int:
    """Entries of the factor in this order, with the diagonal."""
    return order.size + int(_core.count_factor(*rows_of(pattern, order)).sum())


def rows_of(pattern: sp.csr_array, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pattern in an order, as (ptr, index) of the core."""
    begin = pattern.indptr[order]
    ptr = np.concatenate([[0], np.cumsum(pattern.indptr[order + 1] - begin, dtype=np.int64)])
    entries = np.arange(ptr[-1]) + np.repeat(begin - ptr[:-1], np.diff(ptr))
    position = np.empty(order.size, dtype=np.int32)
    position[order] = np.arange(order.size)
    return ptr, position[pattern.indices[entries]]


def _pattern(A: Matrix) -> sp.csr_array:
    """The graph of A: symmetric, without a diagonal, all entries one."""
    other = sp.csr_array(A.T)
    same = np.array_equal(other.indptr, A.indptr) and np.array_equal(other.indices, A.indices)
    A = A if same else sp.csr_array(abs(A) + abs(other))  # a skew matrix would cancel
    return _graph(A.indptr, A.indices, (A.indices != _rows(A)) & (A.data != 0.0))


def _rows(A: sp.csr_array) -> np.ndarray:
    """The row of each entry."""
    return np.repeat(np.arange(A.shape[0], dtype=A.indices.dtype), np.diff(A.indptr))


def _graph(ptr: np.ndarray, index: np.ndarray, kept: np.ndarray) -> sp.csr_array:
    """The graph of the entries of (ptr, index) where `kept` is true."""
    before = np.concatenate([[0], np.cumsum(kept)]).astype(ptr.dtype)
    n, ptr = ptr.size - 1, before[ptr]
    return sp.csr_array((np.ones(int(ptr[-1])), index[kept], ptr), shape=(n, n))


def _minimum_degree(graph: sp.csr_array) -> np.ndarray:
    """Multiple minimum degree by SuperLU; the incomplete factor drops all entries, so that only the
    order is computed."""
    n = graph.shape[0]
    if n < 2 or graph.nnz == 0:
        return np.arange(n)
    degrees = np.diff(graph.indptr)
    loops = np.arange(n)
    values = np.concatenate([degrees + 1.0, -graph.data])
    where = (np.concatenate([loops, _rows(graph)]), np.concatenate([loops, graph.indices]))
    definite = sp.csc_array((values, where), shape=(n, n))
    definite.sum_duplicates()
    factor = spilu(
        definite,
        permc_spec="MMD_AT_PLUS_A",
        drop_tol=1.0,
        fill_factor=1.0,
        options=dict(SymmetricMode=True),
    )
    return np.argsort(factor.perm_c)


def has_nested_dissection() -> bool:
    """Whether pymetis is installed."""
    try:
        import pymetis  # noqa: F401
    except ImportError:
        return False
    return True


def _nested_dissection(graph: sp.csr_array) -> np.ndarray | None:
    """Nested dissection by METIS, None where pymetis is not installed.

    METIS does not return on an unsymmetric graph and crashes on loops and on an empty one, so it
    must be a result of `_pattern`.
    """
    if not has_nested_dissection():
        return None
    import pymetis

    limit = np.iinfo(np.int32).max  # METIS may have been compiled with integers of 32 bits
    if graph.nnz == 0 or graph.nnz > limit:
        return None
    adjacency = pymetis.CSRAdjacency(
        adj_starts=graph.indptr.astype(np.int32), adjacent=graph.indices.astype(np.int32)
    )
    options = pymetis.Options(seed=1, numbering=0)  # the same order in every run
    order, _ = pymetis.nested_dissection(adjacency, options=options)
    return np.array(order, dtype=np.int64)
