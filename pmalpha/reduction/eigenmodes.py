"""The lowest frequencies and modes of a structure; factors of positive definite matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike

from .._checks import whole_number
from ..errors import warn
from ..problem.dofs import dof_list
from ..problem.matrices import (
    EXPORTED,
    canonical,
    combination,
    diagonal,
    largest_pairs,
    plain_matrices,
    product,
    sparse,
)
from .ordering import elimination_order, graph_of

__all__ = ["modes"]

# A structure is floating when its stiffness for some motion is below the rounding of its entries,
# relative to the diagonal, which makes the test independent of scaling and units.
FLOATING = 64.0 * np.finfo(float).eps
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


# S^-1 b for b of shape (n,) or (n, k).
Solve: TypeAlias = Callable[[np.ndarray], np.ndarray]


def positive_definite(S: sp.csc_array | np.ndarray) -> Solve:
    """Solves with S, pivots on the diagonal; LinAlgError if one is not positive."""
    from scipy.sparse.linalg import splu

    if not sp.issparse(S):
        factor = scipy.linalg.cho_factor(S, lower=True, check_finite=False)
        return lambda b: scipy.linalg.cho_solve(factor, b, check_finite=False)
    graph, none = graph_of([sp.csr_array(S)]), np.empty(0, dtype=np.int64)
    order = elimination_order(S.shape[0], graph, none)
    permuted = sp.csc_array(sp.csr_array(S)[order][:, order])
    try:
        lu = splu(permuted, "NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:  # exactly singular
        raise np.linalg.LinAlgError(str(error)) from error
    if not (np.all(lu.U.diagonal() > 0.0) and np.array_equal(lu.perm_r, lu.perm_c)):
        raise np.linalg.LinAlgError("a pivot is not positive")

    def solve(b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        x[order] = lu.solve(b[order])
        return x

    return solve


def scale_to_one(K: sp.csc_array) -> sp.dia_array:
    """Scales the diagonal to about one, by powers of two, so that units have no effect."""
    return sp.diags_array(scales_to_one(K.diagonal()))


def scales_to_one(diagonal: np.ndarray) -> np.ndarray:
    """The factors of rows and columns in that, (n,)."""
    d = np.where(diagonal == 0.0, 1.0, np.abs(diagonal))
    return 2.0 ** np.round(-0.5 * np.log2(d))


def softest(G: sp.csc_array | np.ndarray, solve: Solve | None = None) -> float:
    """The smallest eigenvalue of G, approximately, or zero when a pivot is not positive."""
    if solve is None:
        try:
            solve = positive_definite(G)
        except np.linalg.LinAlgError:
            return 0.0
    x = np.cos(np.arange(G.shape[0]))
    for _ in range(4):
        x = solve(x / np.abs(x).max())
        if not np.isfinite(x).all():
            return 0.0
    x /= np.abs(x).max()
    return float(x @ (G @ x) / (x @ x))


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
