"""Fixed dofs: reduced matrices, and the expansion of results to all dofs of the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing, require_finite
from ..problem.arguments import DofsLike, MatrixLike
from ..problem.dofs import checked_names, dof_array, names_at, numbers_along
from ..problem.matrices import Matrix, canonical, plain_matrices, sparse_diagonal

__all__ = ["Reduction", "reduce"]


def __dir__() -> list[str]:
    return sorted(__all__)


# Rounding of zeros in a computed motion, relative to its largest entry.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Reduction:
    """The matrices of the free dofs, and the numbering of free and fixed dofs.

    Made by `reduce`. Reduced dof k is dof ``free[k]`` of the unreduced matrices.

    Attributes
    ----------
    M, K, C : (n_free, n_free) csr_array, or ndarray where a dense one was given
        Arguments of `Subdomain`; K and C are None where none was given. Diagonal ones are sparse,
        so that c_m * M + c_k * K is a matrix with the pattern of M and K.
    n : int
        The number of all dofs.
    free : (n_free,) ndarray of int
        The free dofs, ascending.
    fixed : (n - n_free,) ndarray of int
        The fixed dofs, ascending.
    all_names : sequence of str or None
        The `dof_names` that were given, of all dofs.

    Examples
    --------
    A chain of three masses with dof 0 on the ground, and its history with all dofs:

    >>> K = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    >>> chain = reduce([1.0, 1.0, 1.0], K, fixed=[0])
    >>> model = Subdomain(chain.M, chain.K, scheme=GeneralizedAlpha(0.5),
    ...                   force=chain.reduce_load([0.0, 0.0, 1.0]))
    >>> history = solve(model, dt=0.1, t_end=1.0)
    >>> chain.expand(history.u).shape
    (11, 3)
    """

    M: Any
    K: Any
    C: Any
    n: int
    free: np.ndarray
    fixed: np.ndarray
    all_names: Sequence[str] | None = None

    @property
    def dof_names(self) -> Sequence[str] | None:
        """Names of the free dofs, for `Subdomain`; None without names."""
        return names_at(self.all_names, self.free, self.fixed)

    def __repr__(self) -> str:
        return f"<Reduction of {counted(self.n, 'dof')} to {self.free.size}>"

    def expand(self, u: Any) -> np.ndarray:
        """Displacements, velocities, accelerations or modes of all dofs, zero at the fixed ones.

        Parameters
        ----------
        u : (..., n_free) array_like
            Such as ``history["tower"].u``, if all dofs were recorded.

        Returns
        -------
        (..., n) ndarray
            A new array.

        Raises
        ------
        TypeError, ValueError
            For values that are not numbers, or not n_free in the last dimension.

        Examples
        --------
        >>> reduce([1.0, 1.0, 1.0], [2.0, 2.0, 2.0], fixed=[1]).expand([5.0, 7.0]).tolist()
        [5.0, 0.0, 7.0]
        """
        u = numbers_along(u, self.free.size, "u")
        result = np.zeros((*u.shape[:-1], self.n), dtype=np.result_type(u, np.float64))
        result[..., self.free] = u
        return result

    def place(self, dofs: Any) -> np.ndarray:
        """Reduced numbers of free dofs, for `tie`, `record` or springs.

        Parameters
        ----------
        dofs : array_like of int or str, any shape, or (n,) array of bool
            Free dofs, in the numbering of the unreduced matrices, or a mask.

        Returns
        -------
        ndarray of int, shape of `dofs`
            Their numbers in the reduced matrices.

        Raises
        ------
        TypeError, ValueError
            For values that are not dofs, and for fixed dofs.

        Examples
        --------
        >>> reduce([1.0, 1.0, 1.0], [2.0, 2.0, 2.0], fixed=[1]).place([0, 2]).tolist()
        [0, 1]
        """
        wanted = dof_array(dofs, self.n, "dofs", self.all_names)
        held = np.intersect1d(wanted, self.fixed)
        if held.size:
            raise ValueError(f"dofs must be free, got the fixed ones {listing(held)}")
        return np.searchsorted(self.free, wanted)

    def reduce_load(self, f: Any) -> np.ndarray:
        """The entries of a load on the free dofs.

        Loads on fixed dofs are carried by the supports and left out. For motions use
        `reduce_motion`. The spatial matrix (n, k) of a `SampledForce` has the dofs in the first
        dimension: use ``shape[reduction.free]``.

        Parameters
        ----------
        f : (..., n) array_like
            Forces on all dofs, in the last dimension.

        Returns
        -------
        (..., n_free) ndarray
            A new array.

        Raises
        ------
        TypeError, ValueError
            For values that are not numbers, or not n in the last dimension.

        Examples
        --------
        >>> reduce([1.0, 1.0, 1.0], [2.0, 2.0, 2.0], fixed=[1]).reduce_load([5.0, 6.0, 7.0])
        array([5., 7.])
        """
        return numbers_along(f, self.n, "f")[..., self.free]

    def reduce_motion(self, u: Any) -> np.ndarray:
        """The entries of a displacement or velocity at the free dofs, the inverse of `expand`.

        Parameters
        ----------
        u : (..., n) array_like
            Such as u0 or v0; zero at the fixed dofs, up to the rounding of its largest entry.

        Returns
        -------
        (..., n_free) ndarray
            A new array.

        Raises
        ------
        TypeError, ValueError
            For values that are not finite numbers, not n in the last dimension, or not zero at a
            fixed dof.

        Examples
        --------
        >>> reduce([1.0, 1.0, 1.0], [2.0, 2.0, 2.0], fixed=[1]).reduce_motion([5.0, 0.0, 7.0])
        array([5., 7.])
        """
        u = numbers_along(u, self.n, "u")
        require_finite(u, "u")
        size = np.abs(u[..., self.fixed])
        moved = np.unique(np.nonzero(size > ROUNDING * np.abs(u).max(initial=0.0))[-1])
        if moved.size:
            raise ValueError(
                f"u must be zero at the fixed dofs, got up to {size.max():g} at dofs "
                f"{listing(self.fixed[moved])}"
            )
        result: np.ndarray = u[..., self.free]
        return result


def reduce(
    M: MatrixLike,
    K: MatrixLike | None,
    C: MatrixLike | None = None,
    *,
    fixed: DofsLike,
    dof_names: Sequence[str] | np.ndarray | None = None,
) -> Reduction:
    """Remove the rows and columns of dofs that are fixed to the ground.

    Parameters
    ----------
    M, K, C : (n,) array, (n, n) array or scipy.sparse matrix or array
        As for `Subdomain`, symmetric, with all dofs. K or C can be None, and is then None in the
        result.
    fixed : int, str, array of them, or (n,) array of bool
        The dofs that do not move: their numbers or names, in any order, possibly repeated, or a
        mask. All dofs at x = 0 of nodes with two dofs each: ``np.repeat(points[:, 0] == 0.0, 2)``.
    dof_names : sequence of n str, optional
        Names of all dofs, such as ``structure.dof_names``. Those of the free ones are
        ``reduction.dof_names``.

    Returns
    -------
    Reduction
        The matrices of the free dofs, and their numbers.

    Raises
    ------
    TypeError, ValueError
        For matrices that `Subdomain` refuses as well, with unreduced numbers of dofs in the
        message; for dofs out of range, a mask of another length, no free dof left.

    Notes
    -----
    Under a ground motion the mass that couples free dofs to fixed ones also acts on the free dofs.
    ``BaseAcceleration(record, direction, reduction.M, dt=dt)`` neglects it, which is exact for a
    lumped mass. For a consistent mass use the load of the unreduced matrix, and append a zero to
    the record: ``SampledForce(record, dt, shape=-reduction.reduce_load(M @ direction))``, where M
    and direction have all dofs.

    Examples
    --------
    >>> K = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    >>> chain = reduce([1.0, 1.0, 0.5], K, fixed=[0])
    >>> chain.M.diagonal().tolist(), chain.K.tolist(), chain.free.tolist()
    ([1.0, 0.5], [[2.0, -1.0], [-1.0, 1.0]], [1, 2])
    """
    M, K, C = plain_matrices(M=M, K=K, C=C)
    mass, n = canonical(M, "M")
    named = (("K", K), ("C", C))
    stiffness, damping = (None if A is None else canonical(A, name, n)[0] for name, A in named)
    names = checked_names(dof_names, n)
    mask = np.zeros(n, dtype=bool)
    numbers = dof_array(fixed, n, "fixed", names)
    if numbers.ndim > 1:
        raise TypeError(f"fixed must be a 1-D array of whole numbers or a mask, got {fixed!r}")
    mask[numbers] = True
    free, held = np.flatnonzero(~mask), np.flatnonzero(mask)
    if not free.size:
        raise ValueError(f"fixed must leave a dof free, got all {n} of them")
    free.flags.writeable = held.flags.writeable = False
    return Reduction(
        M=_kept(mass, free),
        K=None if K is None else _kept(stiffness, free),
        C=None if C is None else _kept(damping, free),
        n=n,
        free=free,
        fixed=held,
        all_names=names,
    )


def _kept(A: Matrix | None, free: np.ndarray) -> np.ndarray | sp.csr_array:
    """Rows and columns of the free dofs; zeros for None, which represents a zero matrix."""
    if A is None:
        return sp.csr_array((free.size, free.size))
    if A.ndim == 1:
        return sparse_diagonal(A[free])
    return sp.csr_array(A[free][:, free]) if sp.issparse(A) else A[np.ix_(free, free)]
