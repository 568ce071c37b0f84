"""Factors A = R D R^T of symmetric positive definite matrices, (F1), in the forms of the core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cython_blas
from scipy.linalg.lapack import dpotrf
from scipy.sparse.linalg import splu

from .. import _core
from ..blas import one_thread
from ..errors import FactorizationError
from ..memory import require
from ..problem.matrices import Matrix, core_sparse, diagonal, is_narrow, row_of_entries
from .inertia import inertia

# A pivot below this fraction of its diagonal entry has lost all digits.
LOST = 64.0 * np.finfo(float).eps
# A pivot below this fraction of its diagonal entry starts the search for a mechanism.
SUSPICIOUS = 1e-7
# Bytes for each entry of a sparse factor while SuperLU makes it and it is copied for the core.
SUPERLU_BYTES = 90
# From this number of entries per column on, sweeps of panels are faster than sweeps of columns.
WIDE = 24

Factor = tuple[np.ndarray, Any]  # (inverse, R): the reciprocals of D, and R in a form of the core


@dataclass(frozen=True)
class Names:
    """Names of a matrix and its unknowns in messages.

    Attributes
    ----------
    what : str
    numbers : (n,) array of int
        Dof, or constraint, at each position of the elimination order.
    subdomain : str or None
        None: the unknowns are the multipliers of constraints.
    """

    what: str
    numbers: np.ndarray
    subdomain: str | None = None

    def not_definite(self, A: Matrix, position: int) -> FactorizationError:
        """The error for a matrix in elimination order, with the signs of its pivots."""
        n, number = self.numbers.size, int(self.numbers[position])
        counted = inertia(A, n)
        kind, pivots = "singular or indefinite", "counting its pivots would take too long"
        if counted is not None:
            kind = "indefinite" if counted[0] else "singular"
            pivots = "pivots: {} negative, {} zero, {} positive".format(*counted)
        unknown = "constraint" if self.subdomain is None else "dof"
        return FactorizationError(
            f"{self.what} is not positive definite: it is {kind}, first seen at {unknown} "
            f"{number}; {pivots}",
            subdomain=self.subdomain,
            dof=None if self.subdomain is None else number,
            inertia=counted,
        )


@dataclass(frozen=True)
class Structure:
    """The symbolic factorization of all matrices with entries in one pattern.

    Attributes
    ----------
    entries : int
        Stored entries of R, with the diagonal.
    panels : tuple or None
        (first, row_ptr, rows, start, owner); None where sweeps of columns are faster.
    """

    entries: int
    panels: tuple | None

    @property
    def operations(self) -> float:
        """Multiplications of the factorization: the squared lengths of the columns of R."""
        if self.panels is None:
            return 0.0  # few
        width, rows = np.diff(self.panels[0]), np.diff(self.panels[1]).astype(float)
        # sum over j of (rows + j)^2, j = 1..width
        return float(np.sum(width * rows**2 + rows * width * (width + 1.0) + width**3 / 3.0))


def structure_of(ptr: np.ndarray, index: np.ndarray, nb: int) -> Structure:
    """The structure of the factor of a symmetric pattern by rows, in elimination order."""
    n = ptr.size - 1
    entries = n + int(_core.count_factor(ptr, index).sum())
    if entries <= WIDE * n:
        return Structure(entries, None)
    panels = _core.supernodes(ptr, index, nb)
    return Structure(int(panels[3][-1]), panels)


def factorize(
    A: Matrix,
    names: Names,
    *,
    nb: int = 0,
    structure: Structure | None = None,
    superlu: bool = False,
) -> Factor:
    """R and the reciprocals of D, in the forms of the core.

    Parameters
    ----------
    A : matrix in inner form
        Symmetric, already in elimination order.
    names : Names
    nb : int, default 0
        Number of interface unknowns, which are last and swept separately.
    structure : Structure, optional
        Of a pattern that contains that of A, if A is sparse. Default: of the pattern of A.
    superlu : bool, default False
        Sparse factors by SuperLU, for any pattern.

    Raises
    ------
    FactorizationError
        When A is not positive definite.
    MemoryError
        When the factor would not fit, predicted before the factorization.
    """
    if A is None:
        raise names.not_definite(A, 0)
    if A.ndim == 1:
        check_pivots(A, A, names)
        return 1.0 / A, None
    with one_thread():
        if not sp.issparse(A):
            factor = dense_columns(A, names)
        else:
            if structure is None:
                structure = structure_of(*core_sparse(A)[:2], nb)
            if superlu or structure.panels is None:
                factor = columns(A, names, structure.entries, nb=nb)
            else:
                factor = panels(A, names, structure.panels)
    check_softest(A, factor, names)
    return factor


def dense_columns(A: np.ndarray, names: Names) -> Factor:
    """LAPACK's Cholesky factor, scaled to a unit diagonal."""
    n = A.shape[0]
    require(16.0 * n * n, f"the factor of {names.what} ({n} dofs, dense)")
    lower, info = dpotrf(A, lower=True, clean=True)
    if info > 0:
        raise names.not_definite(A, info - 1)
    root = lower.diagonal().copy()
    check_pivots(root**2, A, names)
    return 1.0 / root**2, np.ascontiguousarray(lower.T / root[:, None])


def panels(A: sp.csr_array, names: Names, structure: tuple) -> Factor:
    """The supernodal factor of the core: dense panels, 8 bytes per entry."""
    first, row_ptr, rows, start, _ = structure
    update = np.max(np.diff(first)) * np.max(np.diff(row_ptr))
    require(
        8.0 * (start[-1] + update) + 4.0 * rows.size,
        f"the factor of {names.what} ({A.shape[0]} dofs, {start[-1]} entries)",
    )
    values, inverse = np.empty(start[-1]), np.empty(A.shape[0])
    capsules = cython_blas.__pyx_capi__
    failed = _core.factor_panels(
        core_sparse(A), structure, values, inverse, LOST, capsules["dgemm"], capsules["dtrsm"]
    )
    if failed is not None:
        raise names.not_definite(A, failed)
    return inverse, (first, row_ptr, rows, start, values)


def columns(A: sp.csr_array, names: Names, entries: int, *, nb: int) -> Factor:
    """SuperLU's factor, column by column: for chains and other thin patterns.

    Where SuperLU pivots off the diagonal or reports a singular matrix, the matrix is probably not
    definite: then the supernodal factor decides, and locates the pivot.
    """
    n = A.shape[0]
    require(SUPERLU_BYTES * entries, f"the factor of {names.what} ({n} dofs, {entries} entries)")
    d = A.diagonal()
    if not np.all(d > 0.0):
        raise names.not_definite(A, int(np.argmin(d > 0.0)))
    natural, lu = np.arange(n), None
    try:
        lu = splu(
            sp.csc_array(A),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options=dict(SymmetricMode=True),
        )
    except RuntimeError:  # SuperLU: exactly singular
        pass
    if lu is None or np.any(lu.perm_r != natural) or np.any(lu.perm_c != natural):
        return panels(A, names, _core.supernodes(*core_sparse(A)[:2], nb))
    pivots, R = lu.U.diagonal(), lu.L
    check_pivots(pivots, A, names)
    R.sort_indices()
    _check_symmetric(R, pivots, lu.U, names.what)
    return 1.0 / pivots, below_diagonal(R)


def below_diagonal(R: sp.csc_array) -> tuple:
    """R by columns, sorted, in a form of the core: (band,) or (ptr, index, values)."""
    n, own = R.shape[0], row_of_entries(R)
    below = (R.indices > own) & (R.data != 0.0)
    columns, rows, values = own[below], R.indices[below], R.data[below]
    distance = rows - columns
    width = int(distance.max(initial=0))
    if width < n and is_narrow(width, n, values.size):
        band = np.zeros((n, width))
        band[columns, distance - 1] = values
        return (band,)
    ptr = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=n))])
    return ptr.astype(np.int64), rows.astype(np.int32), values


def _check_symmetric(R: Any, pivots: np.ndarray, U: Any, what: str) -> None:
    """SuperLU's U must be D R^T, which holds if all its pivots are on the diagonal."""
    x = np.cos(np.arange(R.shape[0]))
    ours, theirs = pivots * (R.T @ x), U @ x
    if np.max(np.abs(ours - theirs)) > 1e-9 * np.max(np.abs(pivots) * (abs(R).T @ abs(x))):
        raise FactorizationError(f"the factor of {what} is not symmetric")


def check_pivots(D: np.ndarray, A: Matrix, names: Names) -> None:
    """D > 0, above the rounding of the diagonal of A, and with a finite reciprocal."""
    with np.errstate(over="ignore", divide="ignore"):
        bad = ~(D > LOST * np.abs(diagonal(A))) | np.isinf(1.0 / D)
    if bad.any():
        raise names.not_definite(A, int(np.argmax(bad)))


def check_softest(A: Any, factor: Factor, names: Names) -> None:
    """FactorizationError for a mechanism, whose small last pivot is accumulated rounding.

    Where a pivot is suspicious, inverse iteration finds the softest motion x of A. For a mechanism,
    x^T A x is of the size of the rounding in A x.
    """
    inverse, d = factor[0], diagonal(A)
    share = 1.0 / (inverse * d)
    if np.min(share) > SUSPICIOUS:
        return
    x = np.cos(np.arange(d.size))
    for _ in range(4):
        x = solve(factor, d * (x / np.max(np.abs(x))))
        if not np.all(np.isfinite(x)):
            break
    size = np.max(np.abs(x))
    x = x / size
    if not np.isfinite(size) or x @ (A @ x) <= LOST * (x @ (d * x)):
        raise names.not_definite(A, int(np.argmin(share)))


def solve(factor: Factor, b: np.ndarray) -> np.ndarray:
    """A^-1 b by a step of the core: with K = C = 0, al1 = 0 and al2 = 1, w1 = A^-1 F."""
    n, none = b.size, np.empty(0)
    no_links = (0, np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int32), none)
    unit_step = (0.0, 0.0, 0.0, 1.0)
    part = _core.Subdomain(n, 0, 1, None, None, unit_step, (1.0, *factor), None, no_links)
    coupler = _core.Coupler((part,), 0, (none, None), (none, None), 1.0, False, ())
    zero = np.zeros(n)
    part.start(zero, zero, zero, none)
    part.set_load(b)
    coupler.start(0, none, none)
    coupler.advance(1, None)
    return part.state()[2]


def interface_block(factor: Factor, nb: int) -> np.ndarray:
    """R_bb, the last nb rows and columns of R, (nb, nb); entries above its diagonal are unused."""
    inverse, R = factor
    begin = inverse.size - nb
    if R is None:
        return np.eye(nb)
    if isinstance(R, np.ndarray):
        return R[begin:, begin:].T
    block = np.zeros((nb, nb), order="F")
    if len(R) == 1:
        for k in range(1, min(R[0].shape[1], nb - 1) + 1):
            np.fill_diagonal(block[k:], R[0][begin : begin + nb - k, k - 1])
        return block
    if len(R) == 3:
        ptr, index, values = R
        for j in range(begin, inverse.size):
            own = slice(ptr[j], ptr[j + 1])
            block[index[own] - begin, j - begin] = values[own]
        return block
    first, row_ptr, rows, start, values = R
    for s in range(np.searchsorted(first, begin), first.size - 1):
        own = np.arange(first[s], first[s + 1])
        where = np.concatenate([own, rows[row_ptr[s] : row_ptr[s + 1]]]) - begin
        panel = values[start[s] : start[s + 1]].reshape(own.size, where.size).T
        block[np.ix_(where, own - begin)] = panel
    return block
