"""Factors in the forms of the core: A = R D R^T, positive definite (F1), or A = R D Q^T (F10)."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from ..errors import FactorizationError
from ..memory import gemm_and_trsm, one_thread, require
from ..problem.forms import Band, Compressed, Factor, Numeric, Panels, Supernodes
from ..problem.matrices import Matrix, core_sparse, diagonal, is_narrow, row_of_entries
from ..reduction.ordering import Graph, elimination_order, rows_of, with_full_nodes

# ---- inertia ------------------------------------------------------------------------------------
# The numbers of negative, zero and positive pivots, for the message about a refused matrix.

Inertia = tuple[int, int, int]

# Below these sizes the eigenvalues of the dense matrix are counted.
FEW, FEW_DENSE = 200, 2000
# Largest number of entries of a factor that is made only to count pivots: some seconds.
MOST = 5_000_000
# An eigenvalue below this is zero, with the matrix scaled to a unit diagonal.
ZERO = 1e-12


def inertia(A: Matrix | None, n: int) -> Inertia | None:
    """Negative, zero and positive pivots of a symmetric matrix; None where that takes too long.

    Scaling to a unit diagonal and, by Sylvester's law, elimination change none of the signs. Of a
    sparse matrix the pivots of A + ZERO I and A - ZERO I are counted, since a zero pivot would stop
    the factorization of A.

    A: (n, n) matrix in inner form, if sparse, in elimination order.
    """
    from scipy.linalg import eigvalsh

    if A is None:
        return 0, n, 0
    values = A.data if sp.issparse(A) else A
    if not np.all(np.isfinite(values)):
        return None
    if A.ndim == 1:
        return int(np.sum(A < 0.0)), int(np.sum(A == 0.0)), int(np.sum(A > 0.0))
    S = _scaled(A)
    if n <= FEW or not sp.issparse(A) and n <= FEW_DENSE:
        with one_thread():
            values = eigvalsh(S if isinstance(S, np.ndarray) else S.toarray())
        negative, positive = int(np.sum(values < -ZERO)), int(np.sum(values > ZERO))
        return negative, n - negative - positive, positive
    if not sp.issparse(A):
        return None
    ptr, index, _ = core_sparse(S)
    if n + int(_core.count_factor(ptr, index).sum()) > MOST:
        return None
    shift = ZERO * sp.eye_array(n)
    above, below = _pivots(S + shift), _pivots(S - shift)
    if above is None or below is None:
        return None
    negative, positive = int(np.sum(above < 0.0)), int(np.sum(below > 0.0))
    return negative, n - negative - positive, positive


def _scaled(A: np.ndarray | sp.csr_array) -> np.ndarray | sp.csr_array:
    """A scaled to a diagonal of +-1; rows with a zero diagonal entry by their largest entry."""
    size, largest = np.abs(diagonal(A)), abs(A).max(axis=1)
    largest = largest.toarray().ravel() if sp.issparse(largest) else largest
    size = np.where(size > 0.0, size, np.where(largest > 0.0, largest, 1.0))
    root = 1.0 / np.sqrt(size)
    if sp.issparse(A):
        return sp.csr_array(sp.diags_array(root) @ A @ sp.diags_array(root))
    return root[:, None] * A * root


def _pivots(A: sp.csr_array) -> np.ndarray | None:
    """The pivots of A in the given order, None where SuperLU pivots off the diagonal."""
    from scipy.sparse.linalg import splu

    options = dict(SymmetricMode=True)
    try:
        with one_thread():
            lu = splu(sp.csc_array(A), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:  # exactly singular
        return None
    natural = np.arange(A.shape[0])
    if not (np.array_equal(lu.perm_r, natural) and np.array_equal(lu.perm_c, natural)):
        return None
    result: np.ndarray | None = lu.U.diagonal()
    return result


# ---- factors ------------------------------------------------------------------------------------

# A pivot below this fraction of its diagonal entry has lost all digits.
LOST = 64.0 * np.finfo(float).eps
# The reciprocal of this and of smaller pivots is not finite.
LEAST = 2.0**-1024
# A pivot below this fraction of its diagonal entry starts the search for a mechanism.
SUSPICIOUS = 1e-7
# Bytes for each entry of thin panels while they are copied column by column.
COPIED_BYTES = 56
# From this number of entries per column on, sweeps of panels are faster than sweeps of columns.
WIDE = 24
# Multiplications for each thread that shares a factorization: some milliseconds. Of more threads
# than these some would wait above the subtrees, and each has 10 MB of scratch.
SHARE, MOST_THREADS = 1e8, 64

# What is subtracted from a diagonal entry of an unsymmetric matrix, relative to it, leaves half of
# the digits (F11).
GROWTH = 1e8


@dataclass(frozen=True)
class Names:
    """Names of a matrix and its unknowns in messages."""

    what: str
    # (n,) array of int, dof, or constraint, at each position of the elimination order
    numbers: np.ndarray
    subdomain: str | None = None  # None: the unknowns are the multipliers of constraints

    def not_definite(self, A: Matrix, position: int) -> FactorizationError:
        """The error for a matrix in elimination order, with the signs of its pivots."""
        counted = inertia(A, self.numbers.size)
        kind, pivots = "singular or indefinite", "counting its pivots would take too long"
        if counted is not None:
            kind = "indefinite" if counted[0] else "singular"
            pivots = "pivots: {} negative, {} zero, {} positive".format(*counted)
        text = f"is not positive definite: it is {kind}"
        return self._error(text, position, f"; {pivots}", counted)

    def not_factored(self, finding: str, position: int) -> FactorizationError:
        """The error for an unsymmetric matrix, with what was found at a position."""
        text = "is singular, or its pivots on the diagonal lose the digits of its entries"
        return self._error(text, position, f": {finding}")

    def too_large(self, position: int) -> FactorizationError:
        """The error for a pivot without a normal reciprocal."""
        return self._error("must have pivots of at most 4.49e307 (2^1022)", position, "")

    def _error(
        self, text: str, position: int, rest: str, inertia: Inertia | None = None
    ) -> FactorizationError:
        number, subdomain = int(self.numbers[position]), self.subdomain
        unknown, dof = ("constraint", None) if subdomain is None else ("dof", number)
        message = f"{self.what} {text}, first seen at {unknown} {number}{rest}"
        return FactorizationError(message, subdomain=subdomain, dof=dof, inertia=inertia)


@dataclass(frozen=True)
class Structure:
    """The symbolic factorization of all matrices with entries in one pattern."""

    entries: int  # of R, with the diagonal
    panels: Supernodes | None  # None where sweeps of columns are faster

    @property
    def operations(self) -> float:
        """Multiplications of the factorization: the squared lengths of the columns of R."""
        if self.panels is None:
            return 0.0  # few
        width, rows = np.diff(self.panels[0]), np.diff(self.panels[1]).astype(float)
        # sum over j of (rows + j)^2, j = 1..width
        return float(np.sum(width * rows**2 + rows * width * (width + 1.0) + width**3 / 3.0))

    def threads(self, most: int) -> int:
        """How many threads share a factorization, of `most`; it is bitwise the same for any."""
        return max(1, min(most, int(self.operations // SHARE), MOST_THREADS))

    def scratch(self, threads: int) -> float:
        """Bytes that a factorization in panels needs besides the factor."""
        assert self.panels is not None
        width, rows = np.diff(self.panels[0]), np.diff(self.panels[1])
        update = np.max(width, initial=0) * np.max(rows, initial=0)
        result: float = 8.0 * threads * (update + self.panels[4].size)
        return result


def structure_of(ptr: np.ndarray, index: np.ndarray, nb: int) -> Structure:
    """The structure of the factor of a symmetric pattern by rows, in elimination order."""
    n = ptr.size - 1
    entries = n + int(_core.count_factor(ptr, index).sum())
    if entries <= WIDE * n:
        return Structure(entries, None)
    panels = Supernodes(*_core.supernodes(ptr, index, nb))
    return Structure(int(panels.start[-1]), panels)


def factorize(
    A: Matrix | None,
    names: Names,
    *,
    nb: int = 0,
    structure: Structure | None = None,
    symmetric: bool = True,
    threads: int = 1,
) -> Factor:
    """R and the reciprocals of D, in the forms of the core; R and Q of an unsymmetric matrix.

    A: in elimination order.
    nb: number of interface unknowns, which are last and swept separately.
    structure: of a pattern that contains that of A, if A is sparse. Default: of the pattern of A.
    symmetric: A is symmetric, and has to be positive definite. Otherwise pivots have any sign.
    """
    if A is None:
        raise names.not_definite(A, 0)
    if A.ndim == 1:
        check_pivots(A if symmetric else np.abs(A), A, names)
        factor = Factor(1.0 / A, None)
        check_reciprocals(factor, names)
        return factor
    with one_thread():
        if not symmetric:
            factor = unsymmetric(A, names, nb, structure, threads)
        elif sp.issparse(A):
            factor = supernodal(A, names, nb, structure, threads)
        else:
            factor = dense_columns(A, names)
    check_reciprocals(factor, names)
    check = check_softest if symmetric else check_smallest
    check(A, factor, names)
    return factor


def dense_columns(A: np.ndarray, names: Names) -> Factor:
    """The factor of the core in one panel."""
    n = A.shape[0]
    require(16.0 * n * n, f"the factor of {names.what} ({n} dofs, dense)")
    inverse, R, failed = _core.factor_dense(A, LOST, *gemm_and_trsm())
    if failed is not None:
        raise names.not_definite(A, failed)
    with np.errstate(divide="ignore"):
        check_pivots(1.0 / inverse, A, names)
    return Factor(inverse, R)


def supernodal(
    A: sp.csr_array, names: Names, nb: int, structure: Structure | None, threads: int = 1
) -> Factor:
    """The factor of the core in panels, or in columns where these are thin."""
    entries = core_sparse(A)
    inverse, R, failed = _in_panels(entries, names, nb, structure, threads, symmetric=True)
    if failed is not None:
        raise names.not_definite(A, failed)
    return Factor(inverse, R)


def _in_panels(
    A: Compressed,
    names: Names,
    nb: int,
    structure: Structure | None,
    threads: int,
    *,
    symmetric: bool,
) -> tuple[np.ndarray, Band | Compressed | Panels, int | None]:
    """The reciprocals of D, R or R and Q, and the column where it failed, or None."""
    if structure is None:
        structure = structure_of(*A[:2], nb)
    thin = structure.panels is None
    if thin:
        structure = Structure(structure.entries, Supernodes(*_core.supernodes(*A[:2], nb)))
    assert structure.panels is not None
    n, entries = A[0].size - 1, structure.panels[3][-1]
    threads = structure.threads(threads)
    size, count = 8.0 * entries + 4.0 * structure.panels[2].size, f"{entries}"
    if not symmetric:
        size, count = 16.0 * entries + 12.0 * A[1].size, f"twice {entries}"
    if thin:
        size += COPIED_BYTES * entries
    what = f"the factor of {names.what} ({n} dofs, {count} entries)"
    require(size + structure.scratch(threads), what)
    values, inverse = np.empty(entries if symmetric else (2, entries)), np.empty(n)
    pattern = Numeric(A.ptr, A.indices, structure.panels, *gemm_and_trsm(), not symmetric)
    failed = _core.factor_panels(pattern, A.values, values, inverse, LOST, GROWTH, threads)
    panels = Panels(*structure.panels[:4], values)
    return inverse, columns_of_panels(panels) if thin and failed is None else panels, failed


# ---- unsymmetric matrices ----------------------------------------------------------------------


def unsymmetric(
    A: Matrix, names: Names, nb: int, structure: Structure | None, threads: int = 1
) -> Factor:
    """R D Q^T by the core, with pivots on the diagonal: dense, in panels or in columns."""
    n, sparse = A.shape[0], sp.issparse(A)
    if sparse:
        A = with_symmetric_pattern(A)
        entries = core_sparse(A)
    else:  # one panel
        index = np.tile(np.arange(n, dtype=np.int32), n)
        entries = Compressed(np.arange(0, n * n + 1, n), index, np.ascontiguousarray(A).ravel())
        panel = (np.array([0, n]), np.zeros(2, int), np.zeros(0, np.int32), np.array([0, n * n]))
        structure = Structure(n * n, Supernodes(*panel, np.zeros(n, int)))
    inverse, R, failed = _in_panels(entries, names, nb, structure, threads, symmetric=False)
    if failed is not None:
        raise _refused(names, diagonal(A), inverse, failed)
    return Factor(inverse, R if sparse else R[-1].reshape(2, n, n))


def with_symmetric_pattern(A: sp.csr_array) -> sp.csr_array:
    """A with the diagonal, and zeros stored across the diagonal from its entries."""
    n, rows = A.shape[0], row_of_entries(A)
    dofs = np.arange(n)
    where = (np.concatenate([rows, A.indices, dofs]), np.concatenate([A.indices, rows, dofs]))
    values = np.concatenate([A.data, np.zeros(A.nnz + n)])
    return sp.csr_array((values, where), shape=A.shape)  # adds up; sorted, zeros are kept


def columns_of_panels(panels: Panels) -> Band | Compressed:
    """R, or R and Q, by columns from their panels: for chains and other thin patterns."""
    first, row_ptr, rows, start, values = panels
    width, below = np.diff(first), np.diff(row_ptr)
    begin = np.cumsum(width + below) - (width + below)
    column = np.arange(first[-1])
    node, node_of_row = (np.repeat(np.arange(width.size), x) for x in (width, below))
    row = np.empty(width.sum() + below.sum(), np.int64)  # of each row of each panel
    row[begin[node] + column - first[node]] = column
    row[(begin + width - row_ptr[:-1])[node_of_row] + np.arange(rows.size)] = rows

    height = (width + below)[node]
    j = np.repeat(column, height)
    i = row[np.arange(j.size) + np.repeat(begin[node] - np.cumsum(height) + height, height)]
    entries = (i > j) & np.atleast_2d(values).any(axis=0)
    ptr = np.concatenate([[0], np.cumsum(np.bincount(j[entries], minlength=column.size))])
    return in_columns(ptr, i[entries], values[..., entries])


def check_smallest(A: Matrix, factor: Factor, names: Names) -> None:
    """FactorizationError for a mechanism of an unsymmetric matrix, as `check_softest`."""
    inverse, d = factor[0], diagonal(A)
    with np.errstate(all="ignore"):
        share = 1.0 / np.abs(inverse * d)
    position = int(np.argmin(share))
    if share[position] > SUSPICIOUS:
        return
    x = _softest(factor, d)
    if x is None or np.max(np.abs(A @ x)) <= LOST * np.max(abs(A) @ np.abs(x)):
        raise names.not_factored(_small_pivot(1.0 / inverse[position], d[position]), position)


def _refused(names: Names, d: np.ndarray, inverse: np.ndarray, position: int) -> FactorizationError:
    """The error for a pivot at hand, which is in the place of its reciprocal."""
    pivot, entry = inverse[position], d[position]
    cause = _small_pivot(pivot, entry)
    if abs(pivot) > LOST * abs(entry):
        cause = f"more than {GROWTH:g} times its diagonal entry {entry:g} is subtracted from it"
    return names.not_factored(cause, position)


def _small_pivot(pivot: float, entry: float) -> str:
    return f"a pivot of {pivot:g} where the diagonal entry is {entry:g}"


def sides(factor: Factor) -> list[Factor]:
    """The factor with R, and if there is a Q with Q in its place."""
    inverse, R = factor
    if R is None or isinstance(R, np.ndarray):
        return [factor] if R is None or R.ndim == 2 else [Factor(inverse, x) for x in R]
    name, ndim = ("band", 2) if isinstance(R, Band) else ("values", 1)
    values = getattr(R, name)
    if values.ndim == ndim:
        return [factor]
    return [Factor(inverse, R._replace(**{name: x})) for x in values]


def in_columns(ptr: np.ndarray, rows: np.ndarray, values: np.ndarray) -> Band | Compressed:
    """Entries below the diagonal by columns, of R (k,), or of R and Q (2, k), in a form of the
    core."""
    n = ptr.size - 1
    columns = np.repeat(np.arange(n), np.diff(ptr))
    distance = rows - columns
    width = int(distance.max(initial=0))
    if width < n and is_narrow(width, n, rows.size):
        band = np.zeros((*values.shape[:-1], n, width))
        band[..., columns, distance - 1] = values
        return Band(band)
    return Compressed(ptr, rows.astype(np.int32, copy=False), np.ascontiguousarray(values))


def check_pivots(D: np.ndarray, A: Matrix, names: Names) -> None:
    """D > 0, above the rounding of the diagonal of A, and with a finite reciprocal."""
    bad = ~(D > np.maximum(LOST * np.abs(diagonal(A)), LEAST))
    if bad.any():
        raise names.not_definite(A, int(np.argmax(bad)))


def check_reciprocals(factor: Factor, names: Names) -> None:
    """FactorizationError for reciprocals of pivots that are denormal, which the core takes as 0."""
    too_small = np.abs(factor.inverse) < np.finfo(float).tiny
    if too_small.any():
        raise names.too_large(int(np.argmax(too_small)))


def check_softest(A: Matrix, factor: Factor, names: Names) -> None:
    """FactorizationError for a mechanism, whose small last pivot is accumulated rounding.

    Where a pivot is suspicious, inverse iteration finds the softest motion x of A. For a mechanism,
    x^T A x is of the size of the rounding in A x.
    """
    inverse, d = factor[0], diagonal(A)
    share = 1.0 / (inverse * d)
    if np.min(share) > SUSPICIOUS:
        return
    x = _softest(factor, d)
    if x is None or x @ (A @ x) <= LOST * (x @ (d * x)):
        raise names.not_definite(A, int(np.argmin(share)))


def _softest(factor: Factor, d: np.ndarray) -> np.ndarray | None:
    """The softest motion by inverse iteration, its largest entry 1; None where it is not finite."""
    x = np.cos(np.arange(d.size))
    for _ in range(4):
        x = solve(factor, d * (x / np.max(np.abs(x))))
        if not np.all(np.isfinite(x)):
            return None
    result: np.ndarray | None = x / np.max(np.abs(x))
    return result


def solve(factor: Factor, b: np.ndarray) -> np.ndarray:
    """A^-1 b."""
    return _core.solve(factor, b)


def interface_block(factor: Factor, nb: int) -> np.ndarray:
    """R_bb, the last nb rows and columns of R, (nb, nb); entries above its diagonal are unused."""
    inverse, R = factor
    begin = inverse.size - nb
    if R is None:
        return np.eye(nb)
    if isinstance(R, np.ndarray):
        return R[begin:, begin:].T
    if isinstance(R, Band):
        return _block_of_band(R.band[begin:])
    block = np.zeros((nb, nb), order="F")
    if isinstance(R, Compressed):
        ptr, index, values = R
        column = np.repeat(np.arange(nb), np.diff(ptr[begin:]))
        block[index[ptr[begin] :] - begin, column] = values[ptr[begin] :]
        return block
    first, row_ptr, rows, start, values = R
    for s in range(np.searchsorted(first, begin), first.size - 1):
        columns = np.arange(first[s], first[s + 1])
        where = np.concatenate([columns, rows[row_ptr[s] : row_ptr[s + 1]]]) - begin
        panel = values[start[s] : start[s + 1]].reshape(columns.size, where.size).T
        block[np.ix_(where, columns - begin)] = panel
    return block


def _block_of_band(band: np.ndarray) -> np.ndarray:
    """(nb, nb), by columns, with row i + k of column i from band[i, k - 1], zero where i + k = nb
    and beyond: entries nb + 1 apart are one below the other in the rows of a (nb, nb + 1) array."""
    nb = len(band)
    width = max(min(band.shape[1], nb - 1), 0)
    rows = np.zeros((nb, nb + 1))
    rows[:, 1 : width + 1] = band[:, :width]
    return rows.ravel()[: nb * nb].reshape(nb, nb, order="F")


@dataclass(frozen=True)
class Elimination:
    """The factorization of the sparse matrices of a subdomain."""

    # (n,) array of int, dof at each position of the subdomain's vectors; the interface dofs last
    order: np.ndarray
    nb: int  # number of interface dofs
    # one symbolic analysis for Mbar(h), Mbar(2 h) and M; None where nothing is sparse
    structure: Structure | None = None
    threads: int = 1  # maximum number of threads that make one

    @property
    def swept(self) -> int:
        """Matrix entries that a coupled step reads in sweeps."""
        assert self.structure is not None
        return 2 * self.structure.entries

    def factor(self, A: Matrix | None, names: Names, *, symmetric: bool = True) -> Factor:
        """The factor of a matrix in the subdomain's order."""
        return factorize(
            A,
            names,
            nb=self.nb,
            structure=self.structure,
            symmetric=symmetric,
            threads=self.threads,
        )


class Eliminations:
    """The eliminations of all subdomains of a coupler.

    Subdomains with the same graph and the same interface dofs, say equal meshes of different
    materials, have one elimination, which is found once.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, Elimination] = {}

    def of(self, n: int, graph: Graph | None, last: np.ndarray) -> Elimination:
        """As `elimination`."""
        arrays = (last, *(graph or ()))
        digest = sha256(repr((n, [x.size for x in arrays])).encode())
        for x in arrays:
            digest.update(x)
        key = digest.digest()
        if key not in self._known:
            self._known[key] = elimination(n, graph, last)
        return self._known[key]


def elimination(n: int, graph: Graph | None, last: np.ndarray) -> Elimination:
    """The elimination with little fill, the interface dofs last.

    graph: of all matrices to factor, from `graph_of`.
    """
    order = elimination_order(n, graph, last)
    if graph is None:
        return Elimination(order, last.size)
    graph = with_full_nodes(graph, last)
    return Elimination(order, last.size, structure_of(*rows_of(graph, order), last.size))
