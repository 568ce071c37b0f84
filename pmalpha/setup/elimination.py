"""The elimination of a subdomain: its order, and what is known of its factors before their numbers.

Two implementations stand behind the same verbs of the core. With the interface last, a coupled step
is two sweeps of the factor; in the ordinary order it is two sweeps and two more along the paths of
the interface in the elimination tree, of a factor that may be much smaller.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import Matrix, permuted
from .factors import Factor, Names, Structure, factorize, structure_of
from .ordering import elimination_order, rows_of
from .paths import Paths, paths_to

# The ordinary order is looked at where the block of the interface alone is this share of the
# factor. Below, the paths to the interface would be longer than what having it last costs.
BORDER_SHARE = 0.1


@dataclass(frozen=True)
class Elimination:
    """How the sparse matrices of a subdomain are factored.

    Attributes
    ----------
    order : (n,) array of int
        Dof at each place of the subdomain's vectors; those of the interface last.
    nb : int
        Dofs of the interface.
    structure : Structure or None
        One symbolic analysis for Mbar(h), Mbar(2 h) and M; None where nothing is sparse.
    paths : Paths or None
        Where the interface is not last in the factors.
    superlu : bool
        Factors by SuperLU.
    """

    order: np.ndarray
    nb: int
    structure: Structure | None = None
    paths: Paths | None = None
    superlu: bool = False

    @property
    def swept(self) -> int:
        """Entries that a coupled step sweeps."""
        along = 0 if self.paths is None else self.paths.entries
        return 2 * (self.structure.entries + along)

    def factor(self, A: Matrix, names: Names) -> Factor:
        """The factor of a matrix in the subdomain's order."""
        if A is None or not sp.issparse(A):
            return factorize(A, names, nb=self.nb)
        if self.paths is None:
            return factorize(A, names, nb=self.nb, structure=self.structure, superlu=self.superlu)
        place, supernodes = self.paths.place, self.paths.supernodes
        order = np.argsort(place)
        names = replace(names, numbers=names.numbers[order])
        inverse, panels = factorize(permuted(A, order), names, structure=self.structure)
        return inverse, (*panels, place, supernodes)


def elimination(
    n: int, graph: sp.csr_array | None, last: np.ndarray, *, superlu: bool = False
) -> Elimination:
    """The elimination that sweeps fewest entries a step, as far as is predicted.

    Parameters
    ----------
    n : int
    graph : (n, n) csr_array or None
        Of all that is to be factored, from `graph_of`.
    last : (nb,) sorted array of int
        The interface.
    """
    order = elimination_order(n, graph, last)
    if graph is None:
        return Elimination(order, last.size)
    structure = structure_of(*rows_of(graph, order), last.size)
    chosen = Elimination(order, last.size, structure, superlu=superlu)
    border = last.size * (last.size + 1) / 2
    if superlu or structure.panels is None or border < BORDER_SHARE * structure.entries:
        return chosen
    other = ordinary(graph, last)
    return other if other is not None and other.swept < chosen.swept else chosen


def ordinary(graph: sp.csr_array, last: np.ndarray) -> Elimination | None:
    """The elimination in the ordinary order; None where it is swept by columns."""
    n, nb = graph.shape[0], last.size
    whole = elimination_order(n, graph, np.arange(0))
    structure = structure_of(*rows_of(graph, whole), 0)
    if structure.panels is None or nb == 0:
        return None
    order = np.concatenate([whole[~np.isin(whole, last)], last])
    place = np.argsort(whole)[order]
    return Elimination(order, nb, structure, paths_to(structure.panels, place, nb))
