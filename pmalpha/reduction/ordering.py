"""The order of elimination: interface dofs last, little fill before them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy
import scipy.sparse as sp

import pmalpha._core as _core

from ..problem.matrices import Matrix

# Up to this ratio of fill the natural order is taken without computing others: a chain, a frame
# with its storeys in a row.
LITTLE_FILL = 1.5
# The natural order is not considered where its envelope, a bound of its fill, is this many times
# the fill of another order.
HOPELESS = 8.0
# Possible numbers of dofs per node.
NODE_SIZES = (1, 2, 3, 6)
# Below this number of nodes nested dissection does not reduce the fill.
FEW_NODES = 100


class Graph(NamedTuple):
    """A symmetric graph without loops, in the types of the core."""

    ptr: np.ndarray  # (n + 1,) array of int64
    # the neighbours of vertex i are index[ptr[i]:ptr[i + 1]], ascending in what `graph_of` returns
    index: np.ndarray  # type: ignore[assignment]  # hides the method of a tuple

    @property
    def n(self) -> int:
        return self.ptr.size - 1


def graph_of(terms: Sequence[Matrix | None]) -> Graph | None:
    """The graph of any sum of these matrices in inner form, None unless one is sparse and none
    dense."""
    sparse = [A for A in terms if A is not None and sp.issparse(A)]
    if not sparse or len(sparse) < sum(A is not None and A.ndim == 2 for A in terms):
        return None
    # the matrices one below the other: row i of each belongs to vertex i
    n, patterns = sparse[0].shape[0], [_pattern(A) for A in sparse]
    begins = np.cumsum([0] + [index.size for _, index in patterns])
    ptr = np.concatenate(
        [[0], *(offsets[1:] + begin for (offsets, _), begin in zip(patterns, begins))]
    )
    index = np.concatenate([columns for _, columns in patterns])
    vertex = np.tile(np.arange(n, dtype=np.int32), len(sparse))
    return Graph(*_core.graph_of_groups(ptr, index, vertex, n))


def _pattern(A: sp.csr_array) -> tuple[np.ndarray, np.ndarray]:
    """(ptr, index) of the entries that are not zero."""
    if not A.data.all():
        A = A.copy()
        A.eliminate_zeros()
    return A.indptr.astype(np.int64, copy=False), A.indices.astype(np.int32, copy=False)


def elimination_order(n: int, graph: Graph | None, last: np.ndarray) -> np.ndarray:
    """Dof at each position of the elimination order.

    The order of least fill among the natural order, minimum degree and, where pymetis is installed,
    nested dissection. It is found on the graph of the nodes, so the dofs of one node stay together.

    graph: from `graph_of`; None for the natural order.
    last: (nb,) sorted array of int, interface dofs, which come last.
    """
    if n == 0 or graph is None:
        is_interior = np.ones(n, dtype=bool)
        is_interior[last] = False
        return np.concatenate([np.flatnonzero(is_interior), last])
    nodes = node_graph(graph, last)
    best = _least_fill(nodes)
    best = best[_core.postorder(*rows_of(nodes.graph, best), nodes.border)]
    return nodes.dofs_of(best)


@dataclass(frozen=True)
class NodeGraph:
    """The graph of the nodes, with the nodes of the interface last."""

    graph: Graph
    border: int  # number of nodes of the interface
    dofs: np.ndarray  # (n,) array of int, dofs node by node
    start: np.ndarray  # (N + 1,) array of int, index in `dofs` at which the dofs of each node begin

    def dofs_of(self, order: np.ndarray) -> np.ndarray:
        """The order of the dofs that follows from an order of the nodes."""
        sizes = np.diff(self.start)[order]
        ends = np.cumsum(sizes)
        result: np.ndarray = self.dofs[
            np.arange(ends[-1]) + np.repeat(self.start[order] - ends + sizes, sizes)
        ]
        return result


def node_graph(graph: Graph, last: np.ndarray) -> NodeGraph:
    """The graph with the dofs of each node merged; its interface dofs and the others separately."""
    n = graph.n
    border = np.zeros(n, dtype=bool)
    border[last] = True
    label = np.arange(n) // node_size(graph) + n * border
    dofs = np.argsort(label, kind="stable")
    begins = np.diff(label[dofs], prepend=-1) != 0
    start = np.append(np.flatnonzero(begins), n)
    node = np.empty(n, dtype=np.int32)
    node[dofs] = np.cumsum(begins) - 1
    merged = graph if start.size == n + 1 and not last.size else _merged(graph, node)
    return NodeGraph(merged, int(np.count_nonzero(begins & border[dofs])), dofs, start)


def with_full_nodes(graph: Graph, last: np.ndarray) -> Graph:
    """The graph with edges between the interface dofs of each node, and between its others.

    On regular meshes some of these couplings vanish. The columns of a node would then be leaves of
    the elimination tree side by side, and supernodes of one column each.
    """
    n, size = graph.n, node_size(graph)
    if size == 1:
        return graph
    border = np.zeros(n, dtype=bool)
    border[last] = True
    dof = np.repeat(np.arange(n), size)
    other = (np.arange(n)[:, None] // size * size + np.arange(size)).ravel()
    added = border[dof] == border[other]
    counts = np.bincount(dof[added], minlength=n).cumsum()
    ptr = np.concatenate([graph.ptr, graph.ptr[-1] + counts])
    index = np.concatenate([graph.index, other[added].astype(np.int32)])
    vertex = np.tile(np.arange(n, dtype=np.int32), 2)
    return Graph(*_core.graph_of_groups(ptr, index, vertex, n))


def node_size(graph: Graph) -> int:
    """Dofs per node when they are numbered node by node: 1, 2, 3 or 6, found from the graph.

    Dofs of one node have the same neighbours, except for couplings that vanish on regular meshes,
    so that merging b of them reduces the entries of a row up to b times. Merging neighbours that do
    not form a node reduces them less, at the ends of the mesh: by less than the cube root of b.
    """
    sizes = (b for b in NODE_SIZES if graph.n % b == 0)
    return max(sizes, key=lambda b: _gain(graph, b) / np.cbrt(b))


def _gain(graph: Graph, b: int) -> float:
    """Entries of a row of the graph per entry of a row of the merged graph."""
    n, entries = graph.n, graph.index.size
    merged = entries if b == 1 else _merged(graph, np.arange(n, dtype=np.int32) // b).index.size
    return (entries + n) / (b * merged + n)


def _merged(graph: Graph, node: np.ndarray) -> Graph:
    """The graph of the nodes, from the graph of the dofs and the node of each of them."""
    return Graph(*_core.graph_of_groups(*graph, node, int(node.max()) + 1))


def _least_fill(nodes: NodeGraph) -> np.ndarray:
    """The order of the nodes with the least fill."""
    graph, N = nodes.graph, nodes.start.size - 1
    natural = np.arange(N)
    bound = envelope(graph, natural)
    if bound <= LITTLE_FILL * (graph.index.size + N) / 2:
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


def _leading(graph: Graph, size: int) -> Graph:
    """The graph of the first vertices only."""
    ptr = graph.ptr[: size + 1]
    index = graph.index[: ptr[-1]]
    mask = index < size
    before = np.concatenate([[0], np.cumsum(mask, dtype=np.int64)])
    return Graph(before[ptr], index[mask])


def envelope(graph: Graph, order: np.ndarray) -> int:
    """An upper bound of `fill`, in one pass: each row is counted from its first entry on."""
    ptr, index = rows_of(graph, order)
    n = order.size
    first = np.arange(n)
    filled = np.diff(ptr) > 0
    first[filled] = np.minimum(np.minimum.reduceat(index, ptr[:-1][filled]), first[filled])
    return int(np.sum(np.arange(n) - first)) + n


def fill(graph: Graph, order: np.ndarray) -> int:
    """Entries of the factor in this order, with the diagonal."""
    return order.size + int(_core.count_factor(*rows_of(graph, order)).sum())


def rows_of(graph: Graph, order: np.ndarray) -> Graph:
    """The graph with vertex k taken from order[k]; neighbours are not in ascending order."""
    begin = graph.ptr[order]
    ptr = np.concatenate([[0], np.cumsum(graph.ptr[order + 1] - begin, dtype=np.int64)])
    entries = np.arange(ptr[-1]) + np.repeat(begin - ptr[:-1], np.diff(ptr))
    position = np.empty(order.size, dtype=np.int32)
    position[order] = np.arange(order.size)
    return Graph(ptr, position[graph.index[entries]])


def _minimum_degree(graph: Graph) -> np.ndarray:
    """Multiple minimum degree by SuperLU; the incomplete factor drops all entries, so that only the
    order is computed."""
    from scipy.sparse.linalg import spilu

    n, ptr = graph.n, graph.ptr
    if n < 2 or graph.index.size == 0:
        return np.arange(n)
    loops = np.arange(n)
    index = np.insert(graph.index, ptr[1:], loops)
    values = np.insert(-np.ones(graph.index.size), ptr[1:], np.diff(ptr) + 1.0)
    definite = sp.csc_array((values, index, ptr + np.arange(n + 1)), shape=(n, n))
    definite.sort_indices()
    factor = spilu(
        definite,
        permc_spec="MMD_AT_PLUS_A",
        drop_tol=1.0,
        fill_factor=1.0,
        options=dict(SymmetricMode=True),
    )
    return np.argsort(factor.perm_c)


def has_nested_dissection() -> bool:
    try:
        import pymetis  # noqa: F401
    except ImportError:
        return False
    return True


def _nested_dissection(graph: Graph) -> np.ndarray | None:
    """Nested dissection by METIS, None where pymetis is not installed.

    METIS does not return on an unsymmetric graph and crashes on loops and on an empty one.
    """
    if not has_nested_dissection():
        return None
    import pymetis

    limit = np.iinfo(np.int32).max  # METIS may have been compiled with integers of 32 bits
    if not 0 < graph.index.size <= limit:
        return None
    adjacency = pymetis.CSRAdjacency(adj_starts=graph.ptr.astype(np.int32), adjacent=graph.index)
    options = pymetis.Options(seed=1, numbering=0)  # the same order in every run
    order, _ = pymetis.nested_dissection(adjacency, options=options)
    return np.array(order, dtype=np.int64)


# ---- factors of SuperLU -------------------------------------------------------------------------

# A structure is floating when its stiffness for some motion is below the rounding of its entries,
# relative to the diagonal, which makes the test independent of scaling and units.
FLOATING = 64.0 * np.finfo(float).eps
# Up to this number of entries the order of SuperLU is found faster than one that fills less.
ORDERED = 10_000

# S^-1 b for b of shape (n,) or (n, k).
Solve: TypeAlias = Callable[[np.ndarray], np.ndarray]


def positive_definite(S: sp.csc_array | np.ndarray) -> Solve:
    """Solves with S, pivots on the diagonal; LinAlgError if one is not positive."""
    from scipy.sparse.linalg import splu

    if isinstance(S, np.ndarray):
        factor = scipy.linalg.cho_factor(S, lower=True, check_finite=False)
        return lambda b: scipy.linalg.cho_solve(factor, b, check_finite=False)
    ordered: Any = S
    n = S.shape[0]
    order, by = np.arange(n), "MMD_AT_PLUS_A"
    if ordered.nnz > ORDERED:
        graph, none = graph_of([sp.csr_array(S)]), np.empty(0, dtype=np.int64)
        order, by = elimination_order(n, graph, none), "NATURAL"
        ordered = sp.csc_array(sp.csr_array(S)[order][:, order])
    try:
        lu = splu(ordered, by, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:  # exactly singular
        raise np.linalg.LinAlgError(str(error)) from error
    if not (np.all(lu.U.diagonal() > 0.0) and np.array_equal(lu.perm_r, lu.perm_c)):
        raise np.linalg.LinAlgError("a pivot is not positive")

    def solve(b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        x[order] = lu.solve(b[order])
        return x

    return solve


def is_definite(S: np.ndarray) -> bool:
    """Whether a dense symmetric matrix has a Cholesky factor, hence is positive definite."""
    try:
        np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        return False
    return True


def scale_to_one(K: sp.csc_array) -> sp.dia_array:
    """Scales the diagonal to about one, by powers of two, so that units have no effect."""
    return sp.diags_array(scales_to_one(K.diagonal()))


def scales_to_one(diagonal: np.ndarray) -> np.ndarray:
    """The factors of rows and columns in that, (n,)."""
    d = np.where(diagonal == 0.0, 1.0, np.abs(diagonal))
    return 2.0 ** np.round(-0.5 * np.log2(d))


def softest(G: sp.csc_array | np.ndarray, solve: Solve | None = None) -> float:
    """The smallest eigenvalue of G, approximately, or zero when a pivot is not positive."""
    if solve is None:
        try:
            solve = positive_definite(G)
        except np.linalg.LinAlgError:
            return 0.0
    x = np.cos(np.arange(G.shape[0]))
    for _ in range(4):
        x = solve(x / np.abs(x).max())
        if not np.isfinite(x).all():
            return 0.0
    x /= np.abs(x).max()
    return float(x @ (G @ x) / (x @ x))
