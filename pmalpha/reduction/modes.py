"""A large linear subdomain in few coordinates: Guyan and Craig-Bampton reduction.

With the dofs that are kept (b) and the others (i), u = T (u_b, q), T = [1, 0; Psi, Phi], where
Psi = -K_ii^-1 K_ib is the static shape of the others under unit displacements of the kept ones, and
Phi are mass-normalised modes of K_ii, M_ii, the kept dofs being fixed (Craig and Bampton 1968;
without Phi, Guyan 1965). The matrices are T^T M T, T^T C T and T^T K T, loads T^T F.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import counted, listing, positive_number, whole_number
from ..errors import warn
from ..memory import one_thread, require
from ..problem.arguments import DofsLike
from ..problem.dofs import dof_list
from ..problem.loads import each_load
from ..problem.matrices import (
    EXPORTED,
    Matrix,
    canonical,
    combination,
    dense,
    diagonal,
    is_symmetric,
    largest_pairs,
    plain_matrices,
    product,
    sparse,
)
from ..problem.subdomain import ReducedBasis
from .ordering import (
    FLOATING,
    positive_definite,
    scale_to_one,
    softest,
)

# ---- eigenmodes ---------------------------------------------------------------------------------
# The lowest frequencies and modes of a structure; factors of positive definite matrices.

__all__ = ["modes"]

# The problem is solved for theta = 1 / (omega^2 + shift), so that a floating structure can be
# factored. The shift is this multiple of a large K_ii / M_ii: small for ARPACK, which separates
# low modes; larger for the dense solver, where the error of theta is eps / shift.
ARPACK_SHIFT = 1e-10
DENSE_SHIFT = 1e-4
# The dense solver is used up to this number of free dofs, or for more than a quarter of the modes.
DENSE = 200
# Rounding error of x^T K x relative to |x|^T |K| |x|; a smaller omega^2 counts as zero.
ROUNDING = 8.0 * np.finfo(float).eps
# Relative tolerance of the lowest omega^2 outside the space found: modes that are missed can be
# replaced by modes whose omega^2 is larger by this only.
SEPARATE = 1e-6
# An omega^2 below zero by this multiple of the rounding error is warned of; K counts as indefinite
# if it is below zero by more than the digits of exported files, relative to |x|^T |K| |x|.
NOTABLE = 100.0
# The largest K_ii / M_ii is that of a dof that has practically no mass, if it is this multiple of
# the lower quartile; then the quartile is used.
SPREAD = 1e3
# An indefinite K + shift M is tried again with shifts that grow by this factor.
GROWTH, TRIALS = 100.0, 4
# Further trials, up to shifts at which a negative omega^2 is found, for the error that states it.
FURTHER = 4
LARGEST_SHIFT = DENSE_SHIFT * GROWTH**TRIALS


class IndefiniteStiffness(ValueError):
    """K has a negative omega^2.

    square: the lowest one that was found.
    shape: (n,) array, its mode, mass-normalised.
    """

    square: float
    shape: np.ndarray


def modes(
    M: Any, K: Any, k: int = 6, *, fixed: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest frequencies and modes: :math:`K x = omega^2 M x`.

    Dense up to 200 free dofs or for more than a quarter of all modes, otherwise ARPACK about a
    small negative shift, with one factor of K + shift M.

    Parameters
    ----------
    M, K : (n,) array, (n, n) array or scipy.sparse matrix or array
        Positive semidefinite, K within 1e-10 of its entries: the rounding of a file with ten
        digits. Floating structures and dofs without mass, or with a tiny one, are allowed.
    k : int, default 6
        Number of modes, including rigid-body modes.
    fixed : (f,) array of int, optional
        Dofs held at zero.

    Returns
    -------
    omegas : (k,) ndarray
        Angular frequencies in rising order, radians per unit of time. 0 for rigid-body modes:
        omega^2 within rounding error of zero is set to zero.
    modes : (n, k) ndarray
        In columns, on all dofs, zero at the fixed ones. Mass-normalised, modes.T @ M @ modes = 1;
        the largest entry of each mode is positive.

    Raises
    ------
    TypeError, ValueError
        For matrices that are not symmetric and positive semidefinite, dofs without mass and
        stiffness, dofs out of range, more modes than free dofs with mass.
    scipy.sparse.linalg.ArpackError
        When ARPACK does not converge.

    Warns
    -----
    UserWarning
        For an omega^2 below zero within the rounding of a file with ten digits, taken as 0.

    Examples
    --------
    >>> from pmalpha import structures
    >>> masses = structures.chain(3, 2.0, 8.0)  # floating: 2 sqrt(k/m) sin(i pi / 6)
    >>> structures.modes(masses.M, masses.K, 3)[0].round(6).tolist()
    [0.0, 2.0, 3.464102]
    """
    M, K = plain_matrices(M=M, K=K)
    mass, n = canonical(M, "M")
    if mass is None:
        raise ValueError("M must not be zero")
    stiffness, _ = canonical(K, "K", n)
    held = dof_list([] if fixed is None else fixed, n, "fixed")
    free = np.delete(np.arange(n), held)
    B = block(mass, free)
    A = np.zeros(free.size) if stiffness is None else block(stiffness, free)
    k = whole_number(k, "k", low=1)
    massive = np.flatnonzero(diagonal(B) > 0.0)
    if k > massive.size:
        raise ValueError(f"k must be at most {massive.size}, the free dofs with mass, got {k}")
    with np.errstate(over="ignore"):
        ratios = diagonal(A)[massive] / diagonal(B)[massive]
    if not np.isfinite(ratios).all():
        light = free[massive[np.argmax(np.abs(ratios))]]
        raise ValueError(
            f"M must be so large that K_ii / M_ii is finite, which it is not at {light}"
        )
    scale = _scale(ratios)
    if not LARGEST_SHIFT * scale * float(abs(B).max()) < np.inf:
        raise ValueError(
            f"M must have entries that are finite times K_ii / M_ii, got up to {abs(B).max():g} "
            f"and ratios about {scale:g}"
        )
    try:
        squares, shapes = _lowest(A, B, k, scale)
    except IndefiniteStiffness as error:
        part, error.shape = error.shape, np.zeros(n)
        error.shape[free] = part
        raise
    full = np.zeros((n, k))
    full[free] = shapes * np.sign(shapes[np.abs(shapes).argmax(axis=0), np.arange(k)])
    return np.sqrt(squares), full


def _scale(ratios: np.ndarray) -> float:
    """A large K_ii / M_ii, but not that of a tiny mass, whose frequency is far above all others."""
    positive = ratios[ratios > 0.0]
    if not positive.size:
        return 1.0
    largest, quartile = float(np.max(positive)), float(np.quantile(positive, 0.25))
    return largest if largest <= SPREAD * quartile else quartile


def block(A: Any, dofs: np.ndarray) -> Any:
    if A.ndim == 1:
        return A[dofs]
    return A[dofs][:, dofs]


def _lowest(A: Any, B: Any, k: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """The k lowest omega^2 and their modes, by Ritz's method in the space that they span."""
    n = B.shape[0]
    space = _dense_space if n <= DENSE or 4 * k > n else _space
    for trial in range(TRIALS + FURTHER):
        try:
            X = space(A, B, k, GROWTH**trial * scale)
            _, y = scipy.linalg.eigh(X.T @ product(A, X), X.T @ product(B, X))
            break
        except np.linalg.LinAlgError as error:
            if trial == TRIALS + FURTHER - 1:
                raise ValueError(
                    "K must be positive semidefinite and every dof have mass or stiffness, got a "
                    "singular or indefinite K + shift M"
                ) from error
    X = X @ y[:, :k]
    # x^T K x: eigh returns it with an error of eps times the largest omega^2
    squares = np.sum(X * product(A, X), axis=0)
    order = np.argsort(squares, kind="stable")  # rounding may exchange equal ones
    squares, X = squares[order], X[:, order]
    size = np.sum(np.abs(X) * product(abs(A), np.abs(X)), axis=0)
    # what should be zero in x is a rounding error of its largest entries, and counts by its square
    rounding = ROUNDING * (size + ROUNDING * scale)
    if np.any(squares < -EXPORTED * size):
        failure = IndefiniteStiffness(
            f"K must be positive semidefinite, got omega^2 = {squares[0]:g}"
        )
        failure.square, failure.shape = float(squares[0]), X[:, 0]
        raise failure
    if np.any(squares < -NOTABLE * rounding):
        worst = int(np.argmin(squares))
        warn(
            f"K is indefinite at the level of its last digits, as in files with few digits: "
            f"omega^2 = {squares[worst]:g}, {-squares[worst] / size[worst]:.1g} of the terms of "
            "x^T K x, is taken as 0",
            UserWarning,
        )
    return np.where(squares > rounding, squares, 0.0), X


def _dense_space(A: Any, B: Any, k: int, scale: float) -> np.ndarray:
    """X (n, k) of B x = theta (A + shift B) x for the k largest theta."""
    shifted = combination([(1.0, A), (DENSE_SHIFT * scale, B)])
    return largest_pairs(B, shifted, k)[1]


def _space(A: Any, B: Any, k: int, scale: float) -> np.ndarray:
    """The same space by ARPACK, or a larger one.

    Lanczos' method from one vector can miss some of several equal frequencies and return higher
    ones instead, as if all were found. So the lowest frequency outside the space is computed too;
    the space grows until it is above the k lowest ones inside.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    n, shift = B.shape[0], ARPACK_SHIFT * scale
    shifted: Any = combination([(1.0, A), (shift, B)])
    S, mass = (sp.csc_array(sparse(x, n)) for x in (shifted, B))
    solve = positive_definite(S)
    start = np.random.default_rng(0).standard_normal(n)  # reproducible

    def lowest(
        k: int, tolerance: float, outside: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        inverse = LinearOperator((n, n), matvec=lambda x: outside(solve(x)), dtype=float)
        squares, X = eigsh(
            S, k, M=mass, sigma=-shift, OPinv=inverse, v0=outside(start), tol=tolerance
        )
        return squares, outside(X)

    squares, X = lowest(k, 0.0, lambda x: x)
    while X.shape[1] < np.count_nonzero(diagonal(B)):
        outside = _outside(X, mass)
        if not lowest(1, SEPARATE, outside)[0] < (1.0 - 2.0 * SEPARATE) * np.sort(squares)[k - 1]:
            break
        square, x = lowest(1, 0.0, outside)
        squares, X = np.append(squares, square), np.column_stack([X, x])
    return X


def _outside(X: np.ndarray, mass: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Makes vectors orthogonal to X, with respect to the mass."""
    weights = mass @ X
    weights = np.linalg.solve(X.T @ weights, weights.T)
    return lambda x: x - X @ (weights @ x)


# ---- superelement -------------------------------------------------------------------------------

# Columns of Psi that are solved for at once
COLUMNS = 64
# First number of modes up to a frequency; it is doubled until one is above
FIRST = 8
# Initial values that the coordinates represent worse than this, relative to their norm with the
# mass, are warned of.
REPRESENTED = 0.01


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
        arguments["force"] = each_load(subdomain.force, lambda load: load._projected(T))
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
