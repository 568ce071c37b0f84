"""Asymmetry of a matrix from a file, and its symmetric part."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import real_array, real_number
from ..problem.matrices import plain_matrix, rectangular

__all__ = ["asymmetry", "completed", "symmetrized"]


def asymmetry(A: Any) -> float:
    """Asymmetry of a matrix: the maximum of ``|A_ij - A_ji| / sqrt(a_i a_j)``.

    a_i = ``|A_ii|``, so that the result does not depend on units, also with rotations and
    displacements in one matrix. If A_ii = 0, a_i is the largest magnitude in row and column i.

    Parameters
    ----------
    A : (n, n) array or scipy.sparse matrix or array
        With real entries.

    Returns
    -------
    float
        0 if A is symmetric.

    Raises
    ------
    TypeError, ValueError
        For a matrix that is not real, square and finite.

    Examples
    --------
    >>> from pmalpha.readers import asymmetry
    >>> round(asymmetry([[4.0, 1.0], [1.5, 1.0]]), 6)  # 0.5 / sqrt(4 * 1)
    0.25
    """
    return _worst_pair(_square(A))[0]


def completed(A: Any) -> Any:
    """The symmetric matrix of which A is one triangle with the diagonal.

    Some programs write one triangle of a symmetric matrix, which `Subdomain` refuses.

    Parameters
    ----------
    A : (n, n) array or scipy.sparse matrix or array
        With real entries, on one side of the diagonal only and on it.

    Returns
    -------
    (n, n) ndarray or csr_array
        A + A^T with the diagonal once, exactly symmetric.

    Raises
    ------
    TypeError, ValueError
        For a matrix that is not real, square and finite, or has entries on both sides.

    Examples
    --------
    >>> from pmalpha.readers import completed
    >>> completed([[4.0, 0.0], [1.0, 3.0]]).tolist()
    [[4.0, 1.0], [1.0, 3.0]]
    """
    A = _square(A)
    entries = sp.coo_array(A)
    side = np.sign(entries.row - entries.col)[entries.data != 0.0]
    if np.any(side > 0) and np.any(side < 0):
        raise ValueError("A must have entries on one side of the diagonal only, got some on both")
    matrix = A + A.T
    if sp.issparse(A):
        return sp.csr_array(matrix - sp.diags_array(A.diagonal()))
    matrix[np.diag_indices(len(A))] = A.diagonal()
    return matrix


def symmetrized(A: Any, tol: float) -> Any:
    """(A + A^T) / 2, if the asymmetry of A is at most tol.

    `Subdomain` requires matrices that are symmetric up to rounding, unless it is told
    ``symmetric=False``. This function is an explicit decision to symmetrize a matrix from a file
    with few digits, or with a small follower load.

    Parameters
    ----------
    A : (n, n) array or scipy.sparse matrix or array
        With real entries.
    tol : float
        Maximum `asymmetry`, at least 0.

    Returns
    -------
    (n, n) ndarray or csr_array
        Exactly symmetric.

    Raises
    ------
    TypeError, ValueError
        For a matrix that is not real, square and finite, or whose asymmetry exceeds tol.

    Examples
    --------
    >>> from pmalpha.readers import symmetrized
    >>> symmetrized([[4.0, 1.0], [1.0002, 1.0]], tol=1e-3).tolist()
    [[4.0, 1.0001], [1.0001, 1.0]]
    """
    tol = real_number(tol, "tol", low=0.0)
    A = _square(A)
    worst, i, j = _worst_pair(A)
    if worst > tol:
        raise ValueError(
            f"A must be symmetric up to tol = {tol:g}, got {worst:.3g}: {A[i, j]:g} at [{i}, {j}] "
            f"and {A[j, i]:g} at [{j}, {i}]"
        )
    mean = (A + A.T) * 0.5
    return sp.csr_array(mean) if sp.issparse(A) else mean


def _square(value: Any) -> Any:
    value = plain_matrix(value)
    is_sparse = sp.issparse(value)
    A = rectangular(value, None, "A") if is_sparse else real_array(value, "A", 2)
    if A.shape[0] != A.shape[1]:
        raise ValueError(f"A must be square, got shape {A.shape}")
    return A


def _worst_pair(A: Any) -> tuple[float, int, int]:
    """The maximum of |A_ij - A_ji| / sqrt(a_i a_j), and its i and j."""
    A = sp.csr_array(A)
    skew = sp.coo_array(A - A.T)
    rows, columns, values = skew.row, skew.col, np.abs(skew.data)
    if not values.size or values.max() == 0.0:
        return 0.0, 0, 0
    largest = np.maximum(abs(A).max(axis=1).toarray(), abs(A).max(axis=0).toarray()).ravel()
    size = np.sqrt(np.where(A.diagonal() == 0.0, largest, np.abs(A.diagonal())))
    apart = values > 0.0
    rows, columns, values = rows[apart], columns[apart], values[apart]
    ratio = values / (size[rows] * size[columns])
    worst = int(np.argmax(ratio))
    return float(ratio[worst]), int(rows[worst]), int(columns[worst])
