"""The elimination of a subdomain: its order and the symbolic factorization.

The core has two implementations of a coupled step. With the interface last, the step is two sweeps
of the factor. In the ordinary order it is two sweeps, and two more along the paths of the interface
in the elimination tree, of a factor that may be much smaller.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import Matrix, permuted
from ..problem.ordering import (
    Graph,
    elimination_order,
    rows_of,
    with_full_nodes,
)
from .factors import Factor, Names, Structure, factorize, structure_of
from .paths import Paths, paths_to

# The ordinary order is considered where the block of the interface alone is this share of the
# factor. Below, sweeping the paths would cost more than the fill of an interface that is last.
BORDER_SHARE = 0.1


@dataclass(frozen=True)
class Elimination:
    """The factorization of the sparse matrices of a subdomain.

    Attributes
    ----------
    order : (n,) array of int
        Dof at each position of the subdomain's vectors; the interface dofs last.
    nb : int
        Number of interface dofs.
    structure : Structure or None
        One symbolic analysis for Mbar(h), Mbar(2 h) and M; None where nothing is sparse.
    paths : Paths or None
        Given where the interface is not last in the factors.
    threads : int
        Maximum number of threads that make one.
    """

    order: np.ndarray
    nb: int
    structure: Structure | None = None
    paths: Paths | None = None
    threads: int = 1

    @property
    def swept(self) -> int:
        """Matrix entries that a coupled step reads in sweeps."""
        along = 0 if self.paths is None else self.paths.entries
        assert self.structure is not None
        return 2 * (self.structure.entries + along)

    def factor(self, A: Matrix | None, names: Names, *, symmetric: bool = True) -> Factor:
        """The factor of a matrix in the subdomain's order."""
        if A is None or not sp.issparse(A):
            return factorize(A, names, nb=self.nb, symmetric=symmetric)
        if self.paths is None:
            return factorize(
                A,
                names,
                nb=self.nb,
                structure=self.structure,
                symmetric=symmetric,
                threads=self.threads,
            )
        position, supernodes = self.paths.position, self.paths.supernodes
        order = np.argsort(position)
        names = replace(names, numbers=names.numbers[order])
        A = permuted(A, order)
        inverse, panels = factorize(
            A, names, structure=self.structure, symmetric=symmetric, threads=self.threads
        )
        return inverse, (*panels, position, supernodes)


class Eliminations:
    """The eliminations of all subdomains of a coupler.

    Subdomains with the same graph and the same interface dofs, say equal meshes of different
    materials, have one elimination, which is found once.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, Elimination] = {}

    def of(self, n: int, graph: Graph | None, last: np.ndarray) -> Elimination:
        """As `elimination`."""
        arrays = (last, *(graph or ()))
        digest = sha256(repr((n, [x.size for x in arrays])).encode())
        for x in arrays:
            digest.update(x)
        key = digest.digest()
        if key not in self._known:
            self._known[key] = elimination(n, graph, last)
        return self._known[key]


def elimination(n: int, graph: Graph | None, last: np.ndarray) -> Elimination:
    """The elimination with the fewest predicted entries in the sweeps of a step.

    Parameters
    ----------
    n : int
    graph : Graph or None
        Of all matrices to factor, from `graph_of`.
    last : (nb,) sorted array of int
        Interface dofs.
    """
    order = elimination_order(n, graph, last)
    if graph is None:
        return Elimination(order, last.size)
    graph = with_full_nodes(graph, last)
    structure = structure_of(*rows_of(graph, order), last.size)
    chosen = Elimination(order, last.size, structure)
    border = last.size * (last.size + 1) / 2
    if structure.panels is None or border < BORDER_SHARE * structure.entries:
        return chosen
    other = ordinary(graph, last)
    return other if other is not None and other.swept < chosen.swept else chosen


def ordinary(graph: Graph, last: np.ndarray) -> Elimination | None:
    """The elimination in the ordinary order; None where columns are swept, not panels."""
    n, nb = graph.n, last.size
    whole = elimination_order(n, graph, np.arange(0))
    structure = structure_of(*rows_of(graph, whole), 0)
    if structure.panels is None or nb == 0:
        return None
    order = np.concatenate([whole[~np.isin(whole, last)], last])
    position = np.argsort(whole)[order]
    return Elimination(order, nb, structure, paths_to(structure.panels, position, nb))
