"""The elimination of a subdomain: its order, the interface last, and the symbolic factorization."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import Matrix
from ..problem.ordering import (
    Graph,
    elimination_order,
    rows_of,
    with_full_nodes,
)
from .factors import Factor, Names, Structure, factorize, structure_of


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
    threads : int
        Maximum number of threads that make one.
    """

    order: np.ndarray
    nb: int
    structure: Structure | None = None
    threads: int = 1

    @property
    def swept(self) -> int:
        """Matrix entries that a coupled step reads in sweeps."""
        assert self.structure is not None
        return 2 * self.structure.entries

    def factor(self, A: Matrix | None, names: Names, *, symmetric: bool = True) -> Factor:
        """The factor of a matrix in the subdomain's order."""
        if A is None or not sp.issparse(A):
            return factorize(A, names, nb=self.nb, symmetric=symmetric)
        return factorize(
            A,
            names,
            nb=self.nb,
            structure=self.structure,
            symmetric=symmetric,
            threads=self.threads,
        )


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
    """The elimination with little fill, the interface dofs last.

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
    return Elimination(order, last.size, structure_of(*rows_of(graph, order), last.size))
