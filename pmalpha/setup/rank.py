"""The rank of the constraints, determined from L alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing
from ..errors import ConstraintError
from ..memory import require
from ..problem.matrices import row_of_entries

# Below this squared distance of a row from the others its group of rows is factored once more.
SUSPICIOUS = 1e-6
# Largest number of connected rows that are factored as a dense matrix; there, a row at a distance
# below DEPENDENT from the others is dependent.
FEW, DEPENDENT = 1500, 1e-9
# Up to this number of entries all rows are: sparse matrices take longer.
AT_ONCE = 100


def require_independent(L: sp.csr_array, name: Callable[[int], str]) -> None:
    """ConstraintError unless L has full row rank, determined from L alone with rows of length 1.

    `name` returns the name of a row in messages.
    """
    p = L.shape[0]
    unit = rows_of_size_one(L)
    shared = np.bincount(L.indices, minlength=L.shape[1]).astype(float)
    require(16.0 * np.sum(shared**2), f"the rank of {p} constraints that share dofs")
    rows = row_of_entries(unit)
    unit.data /= np.sqrt(np.bincount(rows, unit.data**2))[rows]
    dependent = _dependent_rows(unit)
    if not dependent.size:
        return
    row = int(dependent[0])
    others = _combination(unit, np.setdiff1d(np.arange(p), dependent), row)
    raise ConstraintError(
        f"the constraints must be linearly independent: row {name(row)} is a combination of "
        f"row{'s' * (others.size > 1)} {listing([name(int(r)) for r in others], 10)}; "
        f"{dependent.size} of {counted(p, 'row')} "
        f"{'is' if dependent.size == 1 else 'are'} redundant and must be removed"
    )


def _dependent_rows(unit: sp.csr_array) -> np.ndarray:
    """Rows to remove so that the others are independent.

    The pivots of L L^T are the squared distances of a row from those eliminated before it: zero
    for a dependent row, at least about 2 / p for the ties of p + 1 dofs in a tree. A shift far
    below lets the factorization continue past a zero pivot. Connected rows with a small pivot, or
    with constraints that are not ties, then get a QR factorization where they are few enough.
    """
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu

    p = unit.shape[0]
    if unit.nnz <= AT_ONCE:
        return np.sort(_dependent_of_few(unit))
    shift, threshold = 1e-14, 1e-13 * (p + 100)
    gram = sp.csc_array(unit @ unit.T) + shift * sp.eye_array(p, format="csc")
    lu = splu(
        gram, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=dict(SymmetricMode=True)
    )
    pivots = lu.U.diagonal()[lu.perm_c]
    count, group = connected_components(gram, directed=False)
    sizes = np.bincount(group)
    closer = (pivots <= SUSPICIOUS) | (~_is_tie(unit) & (sizes[group] > 1))
    dependent = [np.flatnonzero((pivots <= threshold) & (sizes[group] > FEW))]
    order = np.argsort(group, kind="stable")
    members = np.split(order, np.cumsum(sizes)[:-1])
    for g in np.unique(group[closer]):
        if sizes[g] <= FEW:
            dependent.append(members[g][_dependent_of_few(unit[members[g]])])
    return np.sort(np.concatenate(dependent))


def _is_tie(unit: sp.csr_array) -> np.ndarray:
    """Rows of one entry, or of two of the same size: the bound of the pivots holds for them."""
    entries = np.diff(unit.indptr)
    result: np.ndarray = (entries == 1) | ((entries == 2) & (row_sizes(unit) <= 0.71))
    return result


def _dependent_of_few(unit: sp.csr_array) -> np.ndarray:
    """Dependent rows by a rank-revealing QR factorization with pivoting."""
    from scipy.linalg import qr

    touched, place = np.unique(unit.indices, return_inverse=True)
    columns = np.zeros((touched.size, unit.shape[0]))
    columns[place.reshape(-1), row_of_entries(unit)] = unit.data
    R, order = qr(columns, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diagonal(R)) > DEPENDENT))
    result: np.ndarray = order[rank:]
    return result


def row_sizes(L: sp.csr_array) -> np.ndarray:
    """The largest entry of each row, (p,)."""
    sizes = np.zeros(L.shape[0])
    np.maximum.at(sizes, row_of_entries(L), np.abs(L.data))
    return sizes


def rows_of_size_one(L: sp.csr_array) -> sp.csr_array:
    """L with each row divided by its largest entry: a multiple of a constraint is the same one."""
    scale = 1.0 / row_sizes(L)
    return sp.csr_array((scale[row_of_entries(L)] * L.data, L.indices, L.indptr), shape=L.shape)


def _combination(unit: sp.csr_array, independent: np.ndarray, row: int) -> np.ndarray:
    """The independent rows whose combination is the dependent row."""
    from scipy.sparse.linalg import splu

    block = unit[independent]
    gram = sp.csc_array(block @ block.T)
    weights = splu(gram).solve((block @ unit[[row]].T).toarray()[:, 0])
    result: np.ndarray = independent[np.abs(weights) > 1e-6]
    return result
