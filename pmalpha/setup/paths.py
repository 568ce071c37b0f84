"""Factors in the ordinary order, with an interface anywhere in it, (F7) to (F9).

The paths are the interface unknowns and all their ancestors in the elimination tree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dtrsm

from ..blas import one_thread
from .factors import Factor, sides

# Columns of L^T in one sweep, for which each panel is read once.
BLOCK = 128


@dataclass(frozen=True)
class Paths:
    """The paths of a subdomain in its ordinary order of elimination.

    Attributes
    ----------
    position : (n,) array of int
        Position in the ordinary order of each dof of the subdomain's order, in which the interface
        dofs are last.
    supernodes : array of int
        Supernodes on the paths, ascending.
    entries : int
        Entries of the factor on the paths.
    """

    position: np.ndarray
    supernodes: np.ndarray
    entries: int


def paths_to(structure: tuple[np.ndarray, ...], position: np.ndarray, nb: int) -> Paths:
    """The paths of the last nb unknowns for (first, row_ptr, rows, start, owner)."""
    first, row_ptr, rows, start, owner = structure
    on_path = np.zeros(first.size - 1, dtype=bool)
    on_path[owner[position[position.size - nb :]]] = True
    above = np.full(first.size - 1, -1)
    has_rows = np.diff(row_ptr) > 0
    above[has_rows] = owner[rows[row_ptr[:-1][has_rows]]]
    for s in np.flatnonzero(has_rows):  # an ancestor has a higher number
        if on_path[s]:
            on_path[above[s]] = True
    supernodes = np.flatnonzero(on_path).astype(np.int64)
    return Paths(position, supernodes, int(np.sum(np.diff(start)[supernodes])))


def compliance_along_paths(factor: Factor, L_b: sp.csr_array) -> np.ndarray:
    """L_b (A^-1)_bb L_b^T, (rows, rows), by sweeps of blocks of columns along the paths.

    Parameters
    ----------
    factor : Factor
        With R = (first, row_ptr, rows, start, values, position, supernodes).
    L_b : (rows, nb) csr_array
        Every row has an entry.

    Rows are sorted by the first unknown of each on the paths, so that the sweep of a block of
    columns begins at the first unknown of its first row; earlier rows follow by symmetry, if there
    is one.
    """
    steps, R = _Steps(factor), factor[1]
    space = np.empty(steps.size * min(BLOCK, L_b.shape[0]))
    position = steps.local[R[5][R[5].size - L_b.shape[1] :]]  # of the interface dofs, on the paths
    reached = np.minimum.reduceat(position[L_b.indices], L_b.indptr[:-1])
    order = np.argsort(reached, kind="stable")
    L_b = sp.csr_array(L_b[order])
    swept = sp.csr_array((L_b.data, position[L_b.indices], L_b.indptr), (L_b.shape[0], steps.size))
    block = np.empty((order.size, order.size))
    with one_thread():
        for begin in range(0, order.size, BLOCK):
            own = slice(begin, min(begin + BLOCK, order.size))
            entries = sp.coo_array(swept[own])
            X = space[: steps.size * entries.shape[0]].reshape(steps.size, -1)
            X[:] = 0.0
            X[entries.col, entries.row] = entries.data
            steps.solve(X, int(reached[order[begin]]))
            if not steps.symmetric:
                block[:, own] = swept @ X
                continue
            block[begin:, own] = swept[begin:] @ X
            block[own, begin:] = block[begin:, own].T
    back = np.argsort(order)
    return block[np.ix_(back, back)]


class _Steps:
    """The supernodes on the paths, with their unknowns numbered along the paths."""

    def __init__(self, factor: Factor):
        both = sides(factor)
        inverse, (first, row_ptr, rows, start, _, position, supernodes) = both[0]
        self.symmetric = len(both) == 1
        widths = np.diff(first)[supernodes]
        self.size = int(widths.sum())
        self.begins = np.cumsum(np.concatenate([[0], widths]))
        self.local = np.full(position.size, -1)
        own = np.arange(self.size) + np.repeat(first[supernodes] - self.begins[:-1], widths)
        self.local[own] = np.arange(self.size)
        self.inverse = inverse[own][:, None]
        # of R, which is swept forward, and of Q, which is swept backward
        swept = [self._panels(side[1], widths) for side in both]
        (self.tops, self.below), (self.tops_back, self.below_back) = swept[0], swept[-1]
        self.rows = [self.local[rows[row_ptr[s] : row_ptr[s + 1]]] for s in supernodes]

    @staticmethod
    def _panels(
        R: tuple[np.ndarray, ...], widths: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The triangles of the panels on the paths, and what is below them."""
        first, _, _, start, values, _, supernodes = R
        panels = [
            values[start[s] : start[s + 1]].reshape(first[s + 1] - first[s], -1).T
            for s in supernodes
        ]
        tops = [np.asfortranarray(panel[:width]) for panel, width in zip(panels, widths)]
        return tops, [panel[width:] for panel, width in zip(panels, widths)]

    def solve(self, X: np.ndarray, reached: int) -> None:
        """X (size, k) := Q^-T D^-1 R^-1 X on the paths, with X zero before unknown `reached`.

        If A is symmetric, rows before `reached` are not changed: they do not hold the solution.
        """
        first = int(np.searchsorted(self.begins, reached, side="right")) - 1
        for k in range(first, len(self.rows)):
            own = X[self.begins[k] : self.begins[k + 1]]
            _solve_top(self.tops[k], own, transposed=False)
            X[self.rows[k]] -= self.below[k] @ own
        for k in reversed(range(first if self.symmetric else 0, len(self.rows))):
            here = slice(self.begins[k], self.begins[k + 1])
            own = X[here]
            own *= self.inverse[here]
            own -= self.below_back[k].T @ X[self.rows[k]]
            _solve_top(self.tops_back[k], own, transposed=True)


def _solve_top(top: np.ndarray, own: np.ndarray, *, transposed: bool) -> None:
    """own := R_kk^-1 own, or R_kk^-T own, in place: BLAS sees the transpose of own."""
    if own.shape[0] > 1:
        options = dict(side=1, lower=1, trans_a=not transposed, diag=1, overwrite_b=1)
        dtrsm(1.0, top, own.T, **options)
