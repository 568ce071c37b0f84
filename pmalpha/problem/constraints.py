"""Interface constraints sum_i L_i v_i = g(t) between subdomains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing, numbered, plain_array
from .arguments import DofsLike, MatrixLike
from .forces import BaseAcceleration, checked_force
from .frozen import Frozen
from .matrices import rectangular
from .subdomain import Subdomain

__all__ = ["Constraint", "tie"]


class Constraint(Frozen):
    """Constraints sum_i L_i v_i = g(t) on velocities of one or more subdomains, equation (2).

    Without `velocity`, g is zero and the subdomains are tied. With `velocity`, the motion of a
    support or a driven end is prescribed.

    The multipliers act as + L_i^T Lam on the right-hand side of (1).

    Parameters
    ----------
    matrices : dict
        A matrix L_i, (p, n_i) dense or scipy.sparse, for each of the one or more subdomains that
        the constraints involve.
    velocity : callable, `SampledForce` or (p,) array, optional
        Right-hand side g(t) of the p rows. It is evaluated at every fine step, in advance like a
        load, and the initial velocities must satisfy it. Its derivative at t = 0, which the initial
        accelerations need (S1), is the slope of the first two samples; for a callable, a difference
        of order 2 over an eighth of the first fine step.

    Raises
    ------
    TypeError, ValueError
        For wrong shapes, entries that are not finite, or a row without any entry.

    Examples
    --------
    The mean of two dofs of a tied to a dof of b:

    >>> a = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=GeneralizedAlpha(0.5))
    >>> b = Subdomain([1.0], [1.0], scheme=GeneralizedAlpha(0.5))
    >>> Constraint({a: [[0.5, 0.5]], b: [[-1.0]]}).p
    1

    A driven end:

    >>> Constraint({b: [[1.0]]}, velocity=lambda t: [np.sin(t)]).p
    1
    """

    def __init__(self, matrices: Mapping[Subdomain, MatrixLike], velocity: Any = None):
        if not isinstance(matrices, Mapping) or not matrices:
            raise TypeError(f"matrices must be a dict of matrices by subdomain, got {matrices!r}")
        self.matrices = {s: _constraint_matrix(s, L) for s, L in matrices.items()}
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
                f"every constraint must have an entry, got none in {numbered('row', empty)}"
            )
        if isinstance(velocity, BaseAcceleration):
            raise TypeError("velocity must be a SampledForce, a callable or an array, not a force")
        self.velocity = checked_force(velocity, self.p, "velocity")
        self._freeze()

    def __repr__(self) -> str:
        subdomains = [s.name or f"subdomain of {counted(s.n, 'dof')}" for s in self.matrices]
        *others, last = map(repr, subdomains)
        names = f"{', '.join(others)} and {last}" if others else last
        motion = "" if self.velocity is None else f", velocity = {_short(self.velocity)}"
        return f"<{counted(self.p, 'constraint')} on {names}{motion}>"


def _short(velocity: Any) -> str:
    if isinstance(velocity, np.ndarray):
        return np.array2string(velocity, precision=4, threshold=6, separator=", ")
    return repr(velocity)


def _constraint_matrix(subdomain: Any, L: Any) -> sp.csr_array:
    if not isinstance(subdomain, Subdomain):
        raise TypeError(f"matrices must be keyed by Subdomain, got {subdomain!r}")
    what = f"L of {subdomain!r}"
    return rectangular(L, subdomain.n, what, ndim=2)


def tie(a: Subdomain, dofs_a: DofsLike, b: Subdomain, dofs_b: DofsLike) -> Constraint:
    """Tie dofs of two subdomains, with equal velocities: +1 on a, -1 on b.

    A positive multiplier is a positive force on a and a negative force on b.

    Parameters
    ----------
    a : Subdomain
        One side.
    dofs_a : int, (p,) array of int, or (n,) array of bool
        Its dofs, in numbers or as a mask.
    b : Subdomain
        The other side.
    dofs_b : int, (p,) array of int, or (n,) array of bool
        Its dofs; entry k of `dofs_a` is tied to entry k of `dofs_b`.

    Returns
    -------
    Constraint
        With p rows, in the order of the dofs.

    Raises
    ------
    TypeError, ValueError
        For dofs that are not whole numbers, out of range, repeated, or of unequal number.

    Examples
    --------
    >>> a = Subdomain([1.0, 1.0], [1.0, 1.0], scheme=GeneralizedAlpha(0.5))
    >>> b = Subdomain([1.0], [1.0], scheme=GeneralizedAlpha(0.5))
    >>> tie(a, 1, b, 0)
    <1 constraint on 'subdomain of 2 dofs' and 'subdomain of 1 dof'>
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
    """Whole numbers in 0..n-1, none twice: from one number, several, or a mask of n."""
    dofs = plain_array(value, name)
    if dofs.size == 0:
        dofs = dofs.astype(np.int64)
    if dofs.dtype.kind == "b" and dofs.ndim == 1:
        return np.flatnonzero(checked_mask(dofs, n, name))
    if dofs.dtype.kind not in "iu" or dofs.ndim > 1:
        raise TypeError(f"{name} must be a 1-D array of whole numbers, got {value!r}")
    dofs = np.atleast_1d(dofs)
    outside = dofs[(dofs < 0) | (dofs >= n)]
    if outside.size:
        raise ValueError(f"{name} must lie in 0..{n - 1}, got {listing(outside)}")
    values, counts = np.unique(dofs, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(f"{name} must not repeat a dof, got {listing(values[counts > 1])} twice")
    return dofs.astype(np.int64)


def checked_mask(mask: np.ndarray, n: int, name: str) -> np.ndarray:
    """A mask of n entries."""
    if mask.shape != (n,):
        raise ValueError(f"{name} must be a mask of shape ({n},), got shape {mask.shape}")
    return mask


def _boolean(columns: np.ndarray, sign: float, n: int) -> sp.csr_array:
    p = columns.size
    return sp.csr_array((np.full(p, sign), (np.arange(p), columns)), shape=(p, n))
