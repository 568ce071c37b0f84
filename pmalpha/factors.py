"""Factors A = R D R^T of symmetric positive definite matrices, (F1), as the core sweeps them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cython_blas
from scipy.linalg.lapack import dpotrf
from scipy.sparse.linalg import splu

from . import _core
from .blas import one_thread
from .errors import FactorizationError
from .matrices import Matrix, core_sparse, diagonal
from .memory import require

# A pivot that has lost all digits of the diagonal entry it came from.
LOST = 64.0 * np.finfo(float).eps
# A pivot that is so small a part of its diagonal entry makes one look for a mechanism.
SUSPICIOUS = 1e-7
# Bytes for each entry of a sparse factor while SuperLU makes it and the core's copy is taken.
SUPERLU_BYTES = 90
# From this many entries a column on, panels are swept faster than columns.
WIDE = 24

Factor = tuple[np.ndarray, Any]  # (inverse, R): the reciprocals of D, and R as the core takes it


def factorize(A: Matrix, what: str, dof: Callable[[int], str], *, nb: int = 0) -> Factor:
    """R and the reciprocals of D, as the core takes them.

    Parameters
    ----------
    A : matrix in inner form
        Symmetric, already in elimination order.
    what : str
        Names the matrix in messages.
    dof : callable
        Names the dof at a place of the elimination order in messages.
    nb : int, default 0
        The last so many unknowns are the interface, swept apart from the others.

    Raises
    ------
    FactorizationError
        When A is not positive definite.
    MemoryError
        When the factor does not fit, predicted before it is begun.
    """
    if A is None:
        raise _not_definite(what, dof(0))
    if A.ndim == 1:
        _check_pivots(A, A, what, dof)
        return 1.0 / A, None
    with one_thread():
        if not sp.issparse(A):
            factor = dense_columns(A, what, dof)
        else:
            ptr, index, _ = core_sparse(A)
            entries = A.shape[0] + int(_core.count_factor(ptr, index).sum())
            wide = entries > WIDE * A.shape[0]
            factor = panels(A, what, dof, nb=nb) if wide else columns(A, what, dof, entries, nb=nb)
    _check_softest(A, factor, what, dof)
    return factor


def dense_columns(A: np.ndarray, what: str, dof: Callable[[int], str]) -> Factor:
    """LAPACK's Cholesky factor, with the diagonal taken out."""
    n = A.shape[0]
    require(16.0 * n * n, f"the factor of {what} ({n} dofs, dense)")
    lower, info = dpotrf(A, lower=True, clean=True)
    if info > 0:
        raise _not_definite(what, dof(info - 1))
    root = lower.diagonal().copy()
    _check_pivots(root**2, A.diagonal(), what, dof)
    return 1.0 / root**2, np.ascontiguousarray(lower.T / root[:, None])


def panels(A: sp.csr_array, what: str, dof: Callable[[int], str], *, nb: int) -> Factor:
    """Our own supernodal factor: dense panels, 8 bytes an entry."""
    matrix = core_sparse(A)
    structure = _core.supernodes(matrix[0], matrix[1], nb)
    first, row_ptr, rows, start, _ = structure
    update = np.max(np.diff(first)) * np.max(np.diff(row_ptr))
    require(
        8.0 * (start[-1] + update) + 4.0 * rows.size,
        f"the factor of {what} ({A.shape[0]} dofs, {start[-1]} entries)",
    )
    values, inverse = np.empty(start[-1]), np.empty(A.shape[0])
    capsules = cython_blas.__pyx_capi__
    failed = _core.factor_panels(
        matrix, structure, values, inverse, LOST, capsules["dgemm"], capsules["dtrsm"]
    )
    if failed is not None:
        raise _not_definite(what, dof(failed))
    return inverse, (first, row_ptr, rows, start, values)


def columns(
    A: sp.csr_array, what: str, dof: Callable[[int], str], entries: int, *, nb: int
) -> Factor:
    """SuperLU's factor, column by column: for chains and other thin patterns.

    Where it leaves the diagonal the matrix is not definite, or it takes it for singular: then our
    own factor decides, and says where.
    """
    n = A.shape[0]
    require(SUPERLU_BYTES * entries, f"the factor of {what} ({n} dofs, {entries} entries)")
    d = A.diagonal()
    if not np.all(d > 0.0):
        raise _not_definite(what, dof(int(np.argmin(d > 0.0))))
    try:
        lu = splu(
            sp.csc_array(A),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options=dict(SymmetricMode=True),
        )
    except RuntimeError:  # SuperLU: exactly singular
        return panels(A, what, dof, nb=nb)
    natural = np.arange(n)
    if not (np.array_equal(lu.perm_r, natural) and np.array_equal(lu.perm_c, natural)):
        return panels(A, what, dof, nb=nb)
    pivots = lu.U.diagonal()
    _check_pivots(pivots, d, what, dof)
    R = lu.L
    R.sort_indices()
    _check_symmetric(R, pivots, lu.U, what)
    own = np.repeat(natural, np.diff(R.indptr))
    below = (R.indices > own) & (R.data != 0.0)
    kept = np.concatenate([[0], np.cumsum(np.bincount(own[below], minlength=n))])
    return 1.0 / pivots, (
        kept.astype(np.int64),
        R.indices[below].astype(np.int32),
        R.data[below],
    )


def _check_symmetric(R: Any, pivots: np.ndarray, U: Any, what: str) -> None:
    """SuperLU's U must be D R^T, which it is as long as it never left the diagonal."""
    x = np.cos(np.arange(R.shape[0]))
    ours, theirs = pivots * (R.T @ x), U @ x
    if np.max(np.abs(ours - theirs)) > 1e-9 * np.max(np.abs(pivots) * (abs(R).T @ abs(x))):
        raise FactorizationError(f"the factor of {what} is not symmetric")


def _check_pivots(D: np.ndarray, d: np.ndarray, what: str, dof: Callable[[int], str]) -> None:
    """D > 0, and not mere rounding of the diagonal d they came from, nor without reciprocal."""
    with np.errstate(over="ignore", divide="ignore"):
        bad = ~(D > LOST * np.abs(d)) | np.isinf(1.0 / D)
    if bad.any():
        raise _not_definite(what, dof(int(np.argmax(bad))))


def _check_softest(A: Any, factor: Factor, what: str, dof: Callable[[int], str]) -> None:
    """A mechanism leaves a small last pivot, of rounding that has added up over the others.

    So where a pivot is suspicious, inverse iteration finds the motion that A resists least: A
    resists a mechanism by the rounding of its own product with it.
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
        raise _not_definite(what, dof(int(np.argmin(share))))


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
    """R_bb, the last nb rows and columns of R, (nb, nb); what is above its diagonal is not read."""
    inverse, R = factor
    begin = inverse.size - nb
    if R is None:
        return np.eye(nb)
    if isinstance(R, np.ndarray):
        return R[begin:, begin:].T
    block = np.zeros((nb, nb), order="F")
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


def _not_definite(what: str, dof: str) -> FactorizationError:
    return FactorizationError(
        f"{what} is not positive definite: it is singular or indefinite, first seen at {dof}"
    )
