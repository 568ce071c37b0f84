"""Factors made by a function of the user: its arguments, and checks of its result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, numbered, plain_array, real_array, require_finite
from ..problem.ordering import Graph
from ..problem.sparse_arrays import check_arrays
from .factors import Factor, Names, below_diagonal, check_pivots, check_softest

# Tolerance of L D L^T x = A x for one vector x, relative to the terms.
AGREEMENT = 1e-9


class External:
    """The factors of one subdomain by ``function(A, last) -> (L, D, perm)``.

    The function gets all matrices of a subdomain with the same pattern, by stored zeros, so that a
    function which orders by pattern returns the same order for all of them.

    Parameters
    ----------
    function : callable
    graph : Graph
        Contains the pattern of every matrix, in the user's order of dofs.
    last : (nb,) array of int
        Interface dofs, which come last.
    subdomain : str
    """

    def __init__(
        self,
        function: Callable[..., Any],
        graph: Graph,
        last: np.ndarray,
        subdomain: str,
    ):
        self.function, self.last, self.subdomain = function, last, subdomain
        own = sp.csr_array(
            (np.ones(graph.index.size), graph.index, graph.ptr), shape=2 * (graph.n,)
        )
        self.pattern = sp.coo_array(own + sp.eye_array(graph.n))
        self.perm: np.ndarray | None = None
        self.first: Factor | None = None

    def factor(self, A: sp.csr_array, what: str) -> Factor:
        """The factor of a matrix in the user's order; the first one decides `perm`."""
        whole = self._on_pattern(A)
        result = self.function(whole.copy(), self.last.copy())
        if not (isinstance(result, tuple) and len(result) == 3):
            raise TypeError(f"factorize must return (L, D, perm), got {result!r}")
        n = A.shape[0]
        L = self._checked_lower(result[0], n)
        D = real_array(result[1], "D of factorize")
        if D.shape != (n,):
            raise ValueError(f"D of factorize must have shape ({n},), got {D.shape}")
        self.perm = self._checked_perm(result[2], n)
        ordered = sp.csr_array(whole[self.perm][:, self.perm])
        names = Names(what, self.perm, self.subdomain)
        self._check_product(ordered, L, D, what)
        check_pivots(D, ordered, names)
        factor = 1.0 / D, below_diagonal(L)
        check_softest(ordered, factor, names)
        self.first = factor if self.first is None else self.first
        return factor

    def _on_pattern(self, A: sp.csr_array) -> sp.csc_array:
        """A with zeros stored where another matrix of the subdomain has an entry."""
        own, zero = sp.coo_array(A), self.pattern
        values = np.concatenate([own.data, np.zeros(zero.nnz)])
        rows, columns = (
            np.concatenate([getattr(x, axis) for x in (own, zero)]) for axis in ("row", "col")
        )
        return sp.csc_array((values, (rows, columns)), shape=A.shape)

    def _checked_perm(self, value: Any, n: int) -> np.ndarray:
        perm = plain_array(value, "perm of factorize")
        if perm.dtype.kind not in "iu" or perm.shape != (n,):
            raise ValueError(
                f"perm of factorize must be {n} whole numbers, got dtype {perm.dtype} and shape "
                f"{perm.shape}"
            )
        perm = perm.astype(np.int64)
        if not np.array_equal(np.sort(perm), np.arange(n)):
            raise ValueError(f"perm of factorize must hold each of 0..{n - 1} once")
        others = np.setdiff1d(perm[n - self.last.size :], self.last)
        if others.size:
            raise ValueError(
                f"perm of factorize must end with the {counted(self.last.size, 'dof')} of the "
                f"interface of {self.subdomain!r}, got {numbered('dof', others)} among its last"
            )
        if self.perm is not None and not np.array_equal(perm, self.perm):
            raise ValueError(
                "perm of factorize must be the same for all matrices of a subdomain, which have "
                f"the same pattern, got a different one for {self.subdomain!r}"
            )
        return perm

    @staticmethod
    def _checked_lower(value: Any, n: int) -> sp.csc_array:
        """Lower triangular L whose diagonal is all ones or all zeros."""
        L = value if sp.issparse(value) else real_array(value, "L of factorize", 2)
        if L.shape != (n, n):
            raise ValueError(f"L of factorize must have shape ({n}, {n}), got {L.shape}")
        if L.dtype.kind not in "iuf":
            raise TypeError(f"L of factorize must hold real numbers, got dtype {L.dtype}")
        if sp.issparse(L):
            check_arrays(L, "L of factorize")
        L = sp.csc_array(L, dtype=np.float64, copy=True)
        L.sum_duplicates()
        require_finite(L.data, "the stored entries of L of factorize")
        d = L.diagonal()
        if not (np.all(d == 1.0) or np.all(d == 0.0)):
            raise ValueError("L of factorize must have ones on its diagonal, or no diagonal")
        columns = np.repeat(np.arange(n), np.diff(L.indptr))
        above = (L.indices < columns) & (L.data != 0.0)
        if above.any():
            k = int(np.argmax(above))
            raise ValueError(
                "L of factorize must be lower triangular, got an entry at "
                f"[{L.indices[k]}, {columns[k]}]"
            )
        return L

    @staticmethod
    def _check_product(A: sp.csr_array, L: sp.csc_array, D: np.ndarray, what: str) -> None:
        """L D L^T x = A x for one x, with A in the order of the factor."""
        lower = sp.csc_array(sp.tril(L, k=-1))
        x = np.cos(np.arange(D.size))
        y = D * (x + lower.T @ x)
        difference = y + lower @ y - A @ x
        size = np.abs(D) * (np.abs(x) + abs(lower).T @ np.abs(x))
        size = np.max(size + abs(lower) @ size, initial=0.0)
        if not np.max(np.abs(difference), initial=0.0) <= AGREEMENT * size:
            raise ValueError(
                "factorize must return L D L^T = A[perm][:, perm], got a product that differs by "
                f"{np.max(np.abs(difference)):g} for {what}, with terms up to {size:g}"
            )
