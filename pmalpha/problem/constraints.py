"""Interface conditions sum_i L_i v_i = 0 between subdomains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from .._checks import listing, plain_array, real_array, require_finite
from ..errors import ConstraintError
from ..memory import require
from .forces import BaseAcceleration, checked_force
from .matrices import entries
from .subdomain import Subdomain

__all__ = ["Constraint", "tie"]

# A squared distance of a row from the others that makes one look closer.
SUSPICIOUS = 1e-6
# Rows that hang together are looked at as a dense matrix up to this many; a distance of one of
# them below DEPENDENT counts as none.
FEW, DEPENDENT = 1500, 1e-9


class Constraint:
    """p conditions sum_i L_i v_i = g(t) on velocities of one or more subdomains, equation (2).

    Without `velocity` g is zero: the subdomains are held together. With it the motion is
    prescribed, of a support or a driven end.

    The multipliers act as + L_i^T Lam on the right-hand side of (1).

    Parameters
    ----------
    matrices : dict
        A matrix L_i, (p, n_i) dense or scipy.sparse, for each subdomain that takes part. One
        subdomain alone is allowed too.
    velocity : callable, `SampledForce` or (p,) array, optional
        g(t) of the p rows. It is asked at every fine step, ahead of the run like a load, and the
        initial velocities must fit it. Its derivative at t = 0, which the initial accelerations
        need (S1), is the slope of the first two samples; of a callable, a difference of order 2
        over an eighth of the first fine step.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, entries that are not finite, or a condition without any entry.

    Examples
    --------
    Two dofs of a against their mean in b:

    >>> a = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=GeneralizedAlpha(0.5))
    >>> b = Subdomain([1.0], [1.0], scheme=GeneralizedAlpha(0.5))
    >>> Constraint({a: [[0.5, 0.5]], b: [[-1.0]]}).p
    1

    A driven end:

    >>> Constraint({b: [[1.0]]}, velocity=lambda t: [np.sin(t)]).p
    1
    """

    def __init__(self, matrices: Mapping[Subdomain, Any], velocity: Any = None):
        if not isinstance(matrices, Mapping) or not matrices:
            raise TypeError(f"matrices must be a dict of matrices by subdomain, got {matrices!r}")
        self.matrices = {s: _condition_matrix(s, L) for s, L in matrices.items()}
        rows = {L.shape[0] for L in self.matrices.values()}
        if len(rows) > 1:
            raise ValueError(f"matrices must have the same number of rows, got {sorted(rows)}")
        self.p = rows.pop()
        counts = sum(np.bincount(L.nonzero()[0], minlength=self.p) for L in self.matrices.values())
        if self.p == 0:
            raise ValueError("matrices must have at least one row, got none")
        if np.any(counts == 0):
            empty = np.flatnonzero(counts == 0)
            raise ValueError(
                f"every condition must have an entry, got none in rows {listing(empty)}"
            )
        if isinstance(velocity, BaseAcceleration):
            raise TypeError("velocity must be a SampledForce, a callable or an array, not a force")
        self.velocity = checked_force(velocity, self.p, "velocity")


def _condition_matrix(subdomain: Any, L: Any) -> sp.csr_array:
    if not isinstance(subdomain, Subdomain):
        raise TypeError(f"matrices must be keyed by Subdomain, got {subdomain!r}")
    what = f"L of {subdomain!r}"
    if sp.issparse(L):
        if L.dtype.kind not in "iuf":
            raise TypeError(f"{what} must hold real numbers, got dtype {L.dtype}")
        if L.ndim != 2:
            raise ValueError(f"{what} must be 2-D, got shape {L.shape}")
        L = sp.csr_array(entries(L, what), dtype=np.float64)
        require_finite(L.data, f"the stored entries of {what}")
    else:
        L = sp.csr_array(real_array(L, what, 2))
    if L.shape[1] != subdomain.n:
        raise ValueError(f"{what} must have {subdomain.n} columns, got shape {L.shape}")
    L.sum_duplicates()
    L.eliminate_zeros()
    return L


def tie(a: Subdomain, dofs_a: Any, b: Subdomain, dofs_b: Any) -> Constraint:
    """Hold dofs of two subdomains together: +1 on a, -1 on b.

    A positive multiplier pushes a and pulls b.

    Parameters
    ----------
    a, b : Subdomain
        Two different ones.
    dofs_a, dofs_b : (p,) array of int
        Which dofs; entry k of one is tied to entry k of the other.

    Raises
    ------
    TypeError, ValueError
        For dofs that are no whole numbers, out of range, repeated, or not equally many.

    Examples
    --------
    >>> a = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=GeneralizedAlpha(0.5))
    >>> b = Subdomain([1.0], [1.0], scheme=GeneralizedAlpha(0.5))
    >>> tie(a, [1], b, [0]).p
    1
    """
    if a is b:
        raise ValueError(f"a and b must be two different subdomains, got {a!r} twice")
    columns_a, columns_b = _dofs(dofs_a, a, "dofs_a"), _dofs(dofs_b, b, "dofs_b")
    if columns_a.size != columns_b.size or columns_a.size == 0:
        raise ValueError(
            "dofs_a and dofs_b must be equally many and at least one, got "
            f"{columns_a.size} and {columns_b.size}"
        )
    return Constraint({a: _boolean(columns_a, 1.0, a.n), b: _boolean(columns_b, -1.0, b.n)})


def _dofs(value: Any, subdomain: Subdomain, name: str) -> np.ndarray:
    if not isinstance(subdomain, Subdomain):
        raise TypeError(f"a and b must be Subdomains, got {subdomain!r}")
    return dof_list(value, subdomain.n, name)


def dof_list(value: Any, n: int, name: str) -> np.ndarray:
    """Whole numbers in 0..n-1, none twice."""
    dofs = plain_array(value, name)
    if dofs.size == 0:
        dofs = dofs.astype(np.int64)
    if dofs.dtype.kind not in "iu" or dofs.ndim != 1:
        raise TypeError(f"{name} must be a 1-D array of whole numbers, got {value!r}")
    outside = dofs[(dofs < 0) | (dofs >= n)]
    if outside.size:
        raise ValueError(f"{name} must lie in 0..{n - 1}, got {listing(outside)}")
    values, counts = np.unique(dofs, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(f"{name} must not repeat a dof, got {listing(values[counts > 1])} twice")
    return dofs.astype(np.int64)


def _boolean(columns: np.ndarray, sign: float, n: int) -> sp.csr_array:
    p = columns.size
    return sp.csr_array((np.full(p, sign), (np.arange(p), columns)), shape=(p, n))


def stacked(constraints: Sequence[Constraint], subdomains: Sequence[Subdomain]) -> list[Any]:
    """L_i (p, n_i) of every subdomain over all constraints, as csc_array: by columns, since most of
    the rows belong to others.

    Raises ConstraintError when the rows depend on one another.
    """
    starts = np.cumsum([0] + [c.p for c in constraints])
    pieces: dict[Subdomain, list[Any]] = {s: [] for s in subdomains}
    for c, first in zip(constraints, starts):
        for s, L in c.matrices.items():
            own = sp.coo_array(L)
            pieces[s].append((own.data, own.row + first, own.col))
    p = int(starts[-1])
    matrices = [_joined(pieces[s], (p, s.n)) for s in subdomains]
    if constraints:
        _require_independent(sp.csr_array(sp.hstack(matrices)), RowNames(constraints))
    return matrices


def _joined(pieces: Sequence[Any], shape: tuple[int, int]) -> sp.csc_array:
    """One matrix from entries (values, rows, columns) of several."""
    if not pieces:
        return sp.csc_array(shape)
    values, rows, columns = (np.concatenate(x) for x in zip(*pieces))
    return sp.csc_array((values, (rows, columns)), shape=shape)


class RowNames:
    """How messages name a row of the stacked conditions."""

    def __init__(self, constraints: Sequence[Constraint]):
        self.starts = np.cumsum([0] + [c.p for c in constraints])

    def rows(self, i: int) -> np.ndarray:
        """The rows of constraint i."""
        return np.arange(self.starts[i], self.starts[i + 1])

    def __call__(self, row: int) -> str:
        if len(self.starts) <= 2:
            return str(row)
        c = int(np.searchsorted(self.starts, row, side="right")) - 1
        return f"{row} (row {row - self.starts[c]} of constraint {c})"


def _require_independent(L: sp.csr_array, name: RowNames) -> None:
    """ConstraintError unless L has full row rank, decided on L alone, with rows of length 1."""
    p = L.shape[0]
    unit = rows_of_size_one(L)
    shared = np.bincount(L.indices, minlength=L.shape[1]).astype(float)
    require(16.0 * np.sum(shared**2), f"the rank of {p} conditions that share dofs")
    unit = sp.csr_array(sp.diags_array(1.0 / np.sqrt(unit.power(2).sum(axis=1))) @ unit)
    dependent = _dependent_rows(unit)
    if not dependent.size:
        return
    row = int(dependent[0])
    others = _combination(unit, np.setdiff1d(np.arange(p), dependent), row)
    raise ConstraintError(
        f"the interface conditions depend on one another: row {name(row)} is a combination of "
        f"row{'s' * (others.size > 1)} {listing([name(int(r)) for r in others], 10)}; "
        f"{dependent.size} of {p} rows are "
        "too many, leave them out"
    )


def _dependent_rows(unit: sp.csr_array) -> np.ndarray:
    """Rows to leave out so that the others are independent.

    The pivots of L L^T are the squared distances of a row from those eliminated before it: zero
    for a dependent row, at least about 2 / p for the ties of p + 1 dofs in a tree. A shift far
    below keeps the factorization going past a zero pivot. Rows that hang together, with a small
    pivot or with conditions that are no ties, are then looked at by a QR factorization where they
    are few enough.
    """
    p = unit.shape[0]
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
            dependent.append(_dependent_of_few(unit, members[g]))
    return np.sort(np.concatenate(dependent))


def _is_tie(unit: sp.csr_array) -> np.ndarray:
    """Rows of one entry, or of two of the same size: for these the bound of the pivots holds."""
    entries = np.diff(unit.indptr)
    return (entries == 1) | ((entries == 2) & (row_sizes(unit) <= 0.71))


def _dependent_of_few(unit: sp.csr_array, rows: np.ndarray) -> np.ndarray:
    """By a QR factorization with pivoting, which reveals the rank."""
    block = sp.csc_array(unit[rows])
    touched = np.flatnonzero(np.diff(block.indptr))
    R, order = qr(block[:, touched].toarray().T, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diagonal(R)) > DEPENDENT))
    return rows[order[rank:]]


def row_sizes(L: sp.csr_array) -> np.ndarray:
    """The largest entry of each row, (p,)."""
    return abs(L).max(axis=1).toarray().ravel()


def rows_of_size_one(L: sp.csr_array) -> sp.csr_array:
    """L with each row divided by its largest entry: a condition times a number is the same."""
    return sp.csr_array(sp.diags_array(1.0 / row_sizes(L)) @ L)


def _combination(unit: sp.csr_array, independent: np.ndarray, row: int) -> np.ndarray:
    """The independent rows whose combination is the dependent one."""
    block = unit[independent]
    gram = sp.csc_array(block @ block.T)
    weights = splu(gram).solve((block @ unit[[row]].T).toarray()[:, 0])
    return independent[np.abs(weights) > 1e-6]
