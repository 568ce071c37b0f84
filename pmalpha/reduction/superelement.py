"""A large linear subdomain in few coordinates: Guyan and Craig-Bampton reduction.

With the dofs that are kept (b) and the others (i), u = T (u_b, q), T = [1, 0; Psi, Phi], where
Psi = -K_ii^-1 K_ib is the static shape of the others under unit displacements of the kept ones, and
Phi are mass-normalised modes of K_ii, M_ii, the kept dofs being fixed (Craig and Bampton 1968;
without Phi, Guyan 1965). The matrices are T^T M T, T^T C T and T^T K T, loads T^T F.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

from .._checks import counted, listing, positive_number, vector, whole_number
from ..blas import one_thread
from ..errors import warn
from ..memory import require
from ..problem.argument_types import DofsLike
from ..problem.dofs import dof_array, dof_list
from ..problem.forces import SampledForce, each_term, is_of_motion
from ..problem.matrices import Matrix, dense, diagonal, is_symmetric, product, sparse
from .eigenmodes import FLOATING, block, modes, positive_definite, scale_to_one, softest
from .fixed_dofs import numbers_along

__all__ = ["ReducedBasis"]


def __dir__() -> list[str]:
    return sorted(__all__)


# Columns of Psi that are solved for at once
COLUMNS = 64
# First number of modes up to a frequency; it is doubled until one is above
FIRST = 8
# Initial values that the coordinates represent worse than this, relative to their norm with the
# mass, are warned of.
REPRESENTED = 0.01


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """The displacements of a subdomain from those of its reduced one, `Subdomain.reduced`.

    Attributes
    ----------
    matrix : (n, r) ndarray
        T: displacements of all dofs for unit values of the r = b + m coordinates, the b kept dofs
        and the m modes.
    keep : (b,) ndarray of int
        The kept dofs; coordinate k < b is the displacement of dof ``keep[k]``.
    omega : (m,) ndarray
        Angular frequencies of the modes, in rising order; the kept dofs are fixed in them.
    all_names : sequence of str or None
        The `dof_names` of the whole subdomain.

    Examples
    --------
    A chain of four masses by its ends and one mode:

    >>> K = 6.0 * (np.diag([1, 2, 2, 1]) - np.eye(4, k=1) - np.eye(4, k=-1))
    >>> chain = Subdomain(np.ones(4), K, scheme=GeneralizedAlpha(0.5))
    >>> small, basis = chain.reduced([0, 3], modes=1)
    >>> small.n, basis.omega.round(6).tolist()
    (3, [2.44949])
    >>> basis.expand([[1.0, 0.0, 0.0]]).round(4).tolist()
    [[1.0, 0.6667, 0.3333, 0.0]]
    """

    matrix: np.ndarray
    keep: np.ndarray
    omega: np.ndarray
    all_names: Sequence[str] | None = None

    def __repr__(self) -> str:
        n, _ = self.matrix.shape
        dofs, shapes = counted(self.keep.size, "dof"), counted(self.omega.size, "mode")
        return f"<ReducedBasis of {counted(n, 'dof')}: {dofs} kept, {shapes}>"

    def expand(self, u: Any) -> np.ndarray:
        """Displacements, velocities or accelerations of all dofs.

        Parameters
        ----------
        u : (..., r) array_like
            Such as ``history["tower"].u`` of the reduced subdomain.

        Returns
        -------
        (..., n) ndarray
            On all dofs.

        Raises
        ------
        ValueError
            For another last dimension.

        Examples
        --------
        >>> bar = Subdomain([1.0, 1.0, 1.0], np.diag([2.0, 2.0, 2.0]), scheme=Newmark())
        >>> small, basis = bar.reduced([2], modes=0)
        >>> basis.expand([[3.0], [5.0]]).tolist()
        [[0.0, 0.0, 3.0], [0.0, 0.0, 5.0]]
        """
        result: np.ndarray = numbers_along(u, self.matrix.shape[1], "u") @ self.matrix.T
        return result

    def place(self, dofs: Any) -> np.ndarray:
        """Numbers of kept dofs in the reduced subdomain, for `tie`, `record` or springs.

        Parameters
        ----------
        dofs : array_like of int or str, any shape
            Kept dofs, in the numbering of the whole subdomain.

        Returns
        -------
        ndarray of int, shape of `dofs`
            Their numbers in the reduced subdomain.

        Raises
        ------
        TypeError, ValueError
            For what is not a number of a dof, and dofs that are not kept.

        Examples
        --------
        >>> bar = Subdomain([1.0, 1.0, 1.0], np.diag([2.0, 2.0, 2.0]), scheme=Newmark())
        >>> bar.reduced([2, 0], modes=0)[1].place([0, 2]).tolist()
        [1, 0]
        """
        n = self.matrix.shape[0]
        wanted = dof_array(dofs, n, "dofs", self.all_names)
        missing = np.setdiff1d(wanted, self.keep)
        if missing.size:
            raise ValueError(f"dofs must be kept ones, got {listing(missing)}")
        number = np.zeros(n, dtype=np.int64)
        number[self.keep] = np.arange(self.keep.size)
        result: np.ndarray = number[wanted]
        return result


def reduced_arguments(
    subdomain: Any, keep: DofsLike, count: int | None, omega: float | None
) -> tuple[dict[str, Any], ReducedBasis]:
    """The arguments of the reduced Subdomain, and the basis; `Subdomain.reduced`."""
    boundary = dof_list(keep, subdomain.n, "keep", subdomain.dof_names)
    if (count is None) == (omega is None):
        raise TypeError(f"either modes or omega must be given, got modes={count}, omega={omega}")
    if subdomain.K is None:
        raise ValueError("K must not be zero for a reduction")
    if not is_symmetric(subdomain.K):
        raise ValueError(
            "K must be symmetric for a reduction, which takes its static shapes and modes, got an "
            "unsymmetric one"
        )
    if boundary.size == 0:
        raise ValueError("keep must not be empty")
    what = f"a basis of {counted(boundary.size, 'static shape')}"
    require(16.0 * boundary.size * subdomain.n, what, "keep fewer dofs")
    arguments: dict[str, Any] = _springs(subdomain, boundary)
    arguments["symmetric"] = subdomain.symmetric
    with one_thread():
        basis = _basis(subdomain, boundary, count, omega)
        T = basis.matrix
        r = T.shape[1]
        for name in ("M", "C", "K"):
            A = getattr(subdomain, name)
            matrix = None if A is None else T.T @ product(A, T)
            arguments[name] = (
                matrix if matrix is None or not is_symmetric(A) else 0.5 * (matrix + matrix.T)
            )
        if arguments["M"] is None:
            arguments["M"] = np.zeros(r)  # of dofs without mass alone
        D_r = subdomain.restoring_damping
        if D_r is not None:
            arguments["restoring_damping"] = _of_kept(D_r, boundary, r, "restoring_damping")
        arguments["force"] = each_term(subdomain.force, lambda term: _projected(term, T))
        for name in ("u0", "v0"):
            arguments[name] = _coordinates(subdomain, getattr(subdomain, name), basis, name)
    return arguments, basis


def _basis(
    subdomain: Any, boundary: np.ndarray, count: int | None, omega: float | None
) -> ReducedBasis:
    n = subdomain.n
    interior = np.setdiff1d(np.arange(n), boundary)
    if not interior.size:
        frequencies, Phi = np.zeros(0), np.zeros((0, 0))
    else:
        frequencies, Phi = _modes(subdomain, interior, count, omega)
    T = np.zeros((n, boundary.size + frequencies.size))
    T[boundary, np.arange(boundary.size)] = 1.0
    if interior.size:
        T[interior, : boundary.size] = _static(subdomain.K, interior, boundary)
        T[interior, boundary.size :] = Phi
    for array in (T, boundary, frequencies):
        array.setflags(write=False)
    return ReducedBasis(T, boundary, frequencies, subdomain.dof_names)


def _static(K: Matrix, interior: np.ndarray, boundary: np.ndarray) -> np.ndarray:
    """Psi = -K_ii^-1 K_ib"""
    stiffness = sparse(K, K.shape[0])
    rows = stiffness[interior]
    right = sp.csc_array(rows[:, boundary])
    inner = sp.csc_array(rows[:, interior])
    scale = scale_to_one(inner)
    inner = sp.csc_array(scale @ inner @ scale)
    try:
        solve = positive_definite(inner)
        if softest(inner, solve) <= FLOATING:
            raise np.linalg.LinAlgError("singular up to rounding")
    except np.linalg.LinAlgError:
        raise ValueError(
            f"keep must hold the subdomain, which floats or is unstable with {boundary.size} kept "
            "dofs fixed"
        ) from None
    Psi = np.empty((interior.size, boundary.size))
    for first in range(0, boundary.size, COLUMNS):
        part = slice(first, first + COLUMNS)
        Psi[:, part] = scale @ solve(scale @ -right[:, part].toarray())
    return Psi


def _modes(
    subdomain: Any, interior: np.ndarray, count: int | None, omega: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and modes of the other dofs, the kept ones being fixed."""
    M, K = (None if A is None else block(A, interior) for A in (subdomain.M, subdomain.K))
    massive = 0 if M is None else int(np.count_nonzero(diagonal(M) > 0.0))
    if omega is None:
        k = whole_number(count, "modes", high=massive)
    else:
        limit = positive_number(omega, "omega")
        k = min(FIRST, massive)
    while k:
        frequencies, Phi = modes(M, K, k)
        if omega is None:
            return frequencies, Phi
        if frequencies[-1] > limit or k == massive:
            low = frequencies <= limit
            return frequencies[low], Phi[:, low]
        k = min(2 * k, massive)
    return np.zeros(0), np.zeros((interior.size, 0))


def _of_kept(A: Matrix, boundary: np.ndarray, r: int, name: str) -> np.ndarray:
    """An estimate for a restoring force of the kept dofs."""
    entries = sp.coo_array(sparse(A, A.shape[0]))
    rows, columns = entries.coords
    outside = np.setdiff1d(
        np.concatenate([rows, columns])[np.tile(entries.data != 0.0, 2)], boundary
    )
    if outside.size:
        raise ValueError(
            f"keep must have the dofs of {name}, not only others than {listing(outside)}"
        )
    small = np.zeros((r, r))
    small[: boundary.size, : boundary.size] = dense(block(A, boundary))
    return small


def _springs(subdomain: Any, boundary: np.ndarray) -> dict[str, Any]:
    """Springs on kept dofs, in the reduced numbering."""
    if subdomain.has_functions or subdomain.internal is not None and subdomain.internal.forces:
        raise ValueError(
            "restoring and internal forces must be springs for a reduction, got functions; give "
            "them to a subdomain that is tied to the reduced one"
        )
    if subdomain.limits is not None:
        raise ValueError("limits must be None for a reduction, got those of a specimen")
    number = np.full(subdomain.n + 1, -2)
    number[boundary], number[-1] = np.arange(boundary.size), -1
    result = {}
    for name, springs in (
        ("restoring", subdomain.restoring_springs),
        ("internal", () if subdomain.internal is None else subdomain.internal.springs),
    ):
        for spring in springs:
            lost = spring.dofs[number[spring.dofs] == -2]
            if lost.size:
                raise ValueError(
                    f"keep must have the dofs of springs, got {name} springs on {listing(lost)}"
                )
        moved = [spring._moved(number[spring.dofs]) for spring in springs]
        result[name] = moved or None
    return result


# ---- loads and initial values ---------------------------------------------------------------


class ProjectedForce:
    """T^T F(t) of a function F."""

    def __init__(self, force: Callable[[float], Any], T: np.ndarray):
        self.force, self.T = force, T

    def __call__(self, t: float) -> np.ndarray:
        result: np.ndarray = self.T.T @ vector(self.force(t), len(self.T), "the value of force")
        return result


def _projected(force: Any, T: np.ndarray) -> Any:
    if isinstance(force, LowLevelCallable):
        raise ValueError("force must not be a compiled function for a reduction")
    if is_of_motion(force):
        raise ValueError("force must not be a function of t, u and v for a reduction")
    if isinstance(force, SampledForce):
        return force._projected(T)
    return ProjectedForce(force, T) if callable(force) else T.T @ force


def _coordinates(subdomain: Any, u: np.ndarray, basis: ReducedBasis, name: str) -> np.ndarray:
    """(u_b, q) of displacements or velocities, q the mass-orthogonal projection on the modes."""
    T, b = basis.matrix, basis.keep.size
    values = np.concatenate([u[basis.keep], np.zeros(basis.omega.size)])
    rest = u - T[:, :b] @ values[:b]
    heavy = product(subdomain.M, rest)
    values[b:] = T[:, b:].T @ heavy
    rest = rest - T[:, b:] @ values[b:]
    lost, total = (x @ product(subdomain.M, x) for x in (rest, u))
    if lost > REPRESENTED**2 * total:
        warn(
            f"{name} is represented by the kept dofs and {basis.omega.size} modes with an error of "
            f"{np.sqrt(lost / total):.2g} of its norm with the mass; keep more modes",
            UserWarning,
        )
    return values
