"""The formats of M, C and K, and the operations on them in set-up.

Inside the package a matrix is ``None`` (zero), a (n,) array (diagonal), a (n, n) array (dense) or
a ``scipy.sparse.csr_array`` with sorted indices and no duplicates.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from copy import copy
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._cached import Living
from .._checks import counted, real_array, require_finite
from ..memory import one_thread
from .forms import Band, Compressed, Strips

# ---- sparse arrays ------------------------------------------------------------------------------
# The arrays of a sparse matrix of scipy.sparse, checked before SciPy uses them: its compiled
# conversions do not check them again, and arrays that were changed by hand end the process there,
# or give another matrix.

LONGEST = np.iinfo(np.int32).max


def check_arrays(value: Any, name: str) -> None:
    """ValueError for a sparse matrix whose arrays do not fit each other or its shape."""
    if value.ndim != 2:
        raise ValueError(f"{name} must be 2-D when sparse, got shape {value.shape}")
    check = _CHECKS.get(value.format)
    if check is None:  # SciPy converts these in Python, with checks of its own
        return
    try:
        check(value)
    except (ValueError, IndexError) as error:
        raise ValueError(
            f"{name} must have arrays that fit: {error}, in a damaged {value.format} matrix"
        ) from None


def _compressed_arrays(value: Any) -> None:
    """By `check_format`, which does not look at starts where the last one is 0, at dtypes, and at
    blocks."""
    twin = copy(value)  # whose arrays SciPy shortens and converts
    twin.indptr, twin.indices = (_whole(x) for x in (value.indptr, value.indices))
    if value.format == "bsr":
        count, *blocks = np.shape(value.data)
        if 0 in blocks or any(n % b for n, b in zip(value.shape, blocks)):
            raise ValueError(f"blocks of {blocks} do not divide {value.shape}")
        if twin.indptr[-1] < count:  # SciPy drops no blocks
            raise ValueError(f"{twin.indptr[-1]} blocks by indptr, got {count}")
    falls = np.flatnonzero(np.diff(twin.indptr) < 0)
    if falls.size:
        raise ValueError(f"indptr decreases at {falls[0] + 1}")
    twin.check_format()


def _by_entries(value: Any) -> None:
    coords = tuple(_whole(x) for x in value.coords)
    sp.coo_array((np.asarray(value.data), coords), shape=value.shape).nnz  # noqa: B018


def _by_diagonals(value: Any) -> None:
    offsets = _whole(value.offsets)
    if np.any(np.abs(offsets) > LONGEST):
        raise ValueError(f"offsets beyond {LONGEST}, got {offsets.tolist()}")
    sp.dia_array((value.data, offsets), shape=value.shape)


def _by_lists(value: Any) -> None:
    rows, columns = value.shape
    lists = [np.asarray(x) for x in (value.rows, value.data)]
    if any(x.shape != (rows,) or x.dtype != object for x in lists):
        raise ValueError(f"no {rows} lists of indices and of data")
    for i, (index, data) in enumerate(zip(*lists)):
        if not (isinstance(index, list) and isinstance(data, list) and len(index) == len(data)):
            raise ValueError(f"row {i} is not a list of indices and one of as many data")
        if index and not 0 <= min(index) <= max(index) < columns:
            raise ValueError(f"row {i} has indices outside 0..{columns - 1}")


def _whole(index: Any) -> np.ndarray:
    """Indices as SciPy checks them."""
    array = np.asarray(index)
    if array.dtype.kind not in "iu":
        raise ValueError(f"indices of dtype {array.dtype}")
    return array.astype(np.int64) if array.dtype.kind == "u" else array


_CHECKS: dict[str, Callable[[Any], None]] = {
    "csr": _compressed_arrays,
    "csc": _compressed_arrays,
    "bsr": _compressed_arrays,
    "coo": _by_entries,
    "dia": _by_diagonals,
    "lil": _by_lists,
}


# ---- matrices -----------------------------------------------------------------------------------

Matrix: TypeAlias = np.ndarray | sp.csr_array  # a diagonal, dense, or by rows

# Tolerance of symmetry, for the rounding in assembled matrices: relative to the diagonal entries of
# row and column, which bound an entry of a definite matrix, and relative to the largest entries of
# row and column, for rows without a diagonal entry.
SYMMETRY = 1e-10
SYMMETRY_OF_ROW = 1e-14

# An asymmetry up to this is taken for the rounding of a file with few digits.
FEW_DIGITS = 1e-4

# What an error about an unsymmetric matrix of a subdomain ends with.
ADMITTED = "gyroscopic and circulatory terms and follower forces take symmetric=False"

# Rounding of the entries of a file with ten digits, relative to the largest one: a mass matrix may
# be indefinite by this.
EXPORTED = 1e-10

# The arrays of a matrix by rows.
_ARRAYS = ("indptr", "indices", "data")

# Up to this number of entries a product takes less time than setting the threads of BLAS.
SMALL = 10_000

# Matrices of up to this number of entries are kept by their contents while they are in use: equal
# ones are one object, whose checks, orders and factors are made once.
FEW = 2500
_equal: Living[Any] = Living()

# Most bytes of strips over those of rows with an index each, for which strips are stored: the
# product with strips has vector code, which outweighs more bytes while the matrix is in the caches.
# Measured on plates, solids, grids and graphs.
STRIPS_OVER_ROWS = 1.15
STRIPS_OVER_ROWS_IN_CACHE = 1.3
CACHE = 8_000_000  # bytes

# Largest width of a matrix that is stored as a band; a wider band is nearly always the result of an
# unsuitable order.
WIDEST_BAND = 64


def plain_matrix(value: Any) -> Any:
    """The sparse matrix of what is not one but has ``tocsr``, such as a reader's result."""
    return value.tocsr() if hasattr(value, "tocsr") and not sp.issparse(value) else value


def plain_matrices(**matrices: Any) -> list[Any]:
    """`plain_matrix` of each; ValueError unless the readers' results among them have equal rows."""
    labelled = [(name, A.labels) for name, A in matrices.items() if hasattr(A, "labels")]
    for name, labels in labelled[1:]:
        first, rows = labelled[0]
        if not np.array_equal(labels, rows):
            raise ValueError(
                f"{name} must have the labels of {first}, row by row, got {len(labels)} rows "
                f"and {len(rows)}; {name}.arranged({first}.labels) has them in that order"
            )
    return [plain_matrix(A) for A in matrices.values()]


def canonical(
    value: Any, name: str, n: int | None = None, *, symmetric: bool | None = None
) -> tuple[Matrix, int]:
    """Check a user's matrix and convert it to the inner form; the input is copied.

    value: (n,) array, (n, n) array, scipy.sparse matrix or array, or a number for one dof, or the
        result of a reader. Real or integer numbers, symmetric.
    symmetric: what the user said of the matrix: False admits an unsymmetric one, and where the user
        can say it, the error names it. One that is symmetric up to rounding becomes exactly
        symmetric in any case.

    The matrix is read-only, since factors that are made of it must remain valid; small equal ones
    are one object.
    """
    value = plain_matrix(value)
    contents = _contents(value, symmetric)
    A = None if contents is None else _equal.get(contents)
    if A is not None and n in (None, A.shape[0]):
        return A, A.shape[0]
    A, size = _checked(value, name, n, symmetric)
    if A is not None and contents is not None:
        _equal[contents] = A
    return A, size


def _contents(value: Any, symmetric: bool | None) -> tuple[Any, ...] | None:
    """What equal matrices have in common; None of those that are large or of a rare kind."""
    if type(value) is np.ndarray:
        arrays: tuple[Any, ...] = (value,)
    elif sp.issparse(value) and value.format in ("csr", "csc"):
        arrays = (value.indptr, value.indices, value.data)
    else:
        return None
    if not all(type(x) is np.ndarray and x.size <= FEW and x.dtype.kind in "iuf" for x in arrays):
        return None
    kind = value.shape if len(arrays) == 1 else (value.format, *value.shape)
    digest = hashlib.blake2b(b"".join(x.tobytes() for x in arrays)).digest()
    return symmetric, kind, *((x.dtype.str, x.shape) for x in arrays), digest


def _checked(
    value: Any, name: str, n: int | None, symmetric: bool | None
) -> tuple[Matrix | None, int]:
    """A user's matrix in the inner form, read-only, and its size."""
    A = _sparse(value, name) if sp.issparse(value) else real_array(value, name, (0, 1, 2))
    if A.ndim == 0:
        if n not in (None, 1):
            raise ValueError(f"{name} must be of size {n} like M, got one number")
        A = A.reshape(1)
    size = A.shape[0]
    if A.ndim == 2 and A.shape[1] != size:
        raise ValueError(f"{name} must be square, got shape {A.shape}")
    if n is not None and size != n:
        raise ValueError(f"{name} must be of size {n} like M, got shape {A.shape}")
    if size == 0:
        raise ValueError(f"{name} must not be empty, got shape {A.shape}")
    return read_only(_simplest(_symmetric(A, name, symmetric))), size


def read_only(A: Matrix | None) -> Matrix | None:
    if A is not None:
        for array in (A,) if isinstance(A, np.ndarray) else (A.data, A.indices, A.indptr):
            array.setflags(write=False)
    return A


def _sparse(value: Any, name: str) -> sp.csr_array:
    if value.dtype.kind not in "iuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {value.dtype}")
    A = _by_rows(value, name)
    A.sum_duplicates()
    A.eliminate_zeros()  # stored on one side only, zeros would make the pattern unsymmetric
    A.sort_indices()
    require_finite(A.data, f"the stored entries of {name}")
    shorten_indices(A)
    return A


def _by_rows(value: Any, name: str) -> sp.csr_array:
    """A copy of a user's sparse matrix, with its duplicates and zeros."""
    check_arrays(value, name)
    if value.format in ("csr", "csc"):
        return _compressed(value)
    result = sp.csr_array(sp.coo_array(value, copy=True))
    with np.errstate(over="ignore"):
        result.data = result.data.astype(np.float64)  # on Windows a long double too
    return result


def _compressed(value: Any) -> sp.csr_array:
    """A copy by rows of a compressed matrix, without a list of entries, which is twice as large."""
    end = value.indptr[-1]
    with np.errstate(over="ignore"):  # a longer float may become infinite, which is refused next
        data = value.data[:end].astype(np.float64)
    arrays = (data, value.indices[:end].copy(), value.indptr.copy())
    kind = sp.csr_array if value.format == "csr" else sp.csc_array
    return kind(arrays, shape=value.shape).tocsr()


def shorten_indices(A: sp.csr_array) -> None:
    """Use 32 bits per index where they suffice; 64 bits take a third more memory."""
    if max(A.nnz, *A.shape) <= np.iinfo(np.int32).max:
        A.indices = A.indices.astype(np.int32, copy=False)
        A.indptr = A.indptr.astype(np.int32, copy=False)


def rectangular(
    value: Any, columns: int | None, name: str, ndim: int | tuple[int, ...] = (0, 1, 2)
) -> sp.csr_array:
    """A user's matrix with this number of columns, by rows, without stored zeros; a copy.

    value: (rows, columns) array, or scipy.sparse matrix or array, a (columns,) array is one row, if
        `ndim` has 1; likewise a number for one column.
    columns: None where any number is right.
    """
    value = plain_matrix(value)
    if sp.issparse(value):
        if value.dtype.kind not in "iuf":
            raise TypeError(f"{name} must hold real numbers, got dtype {value.dtype}")
        A = _by_rows(value, name)
        require_finite(A.data, f"the stored entries of {name}")
    else:
        A = sp.csr_array(np.atleast_2d(real_array(value, name, ndim)))
    if columns is not None and A.shape[1] != columns:
        raise ValueError(f"{name} must have {counted(columns, 'column')}, got shape {A.shape}")
    A.sum_duplicates()
    A.eliminate_zeros()
    return A


def _symmetric(A: Any, name: str, required: bool | None) -> Any:
    """A, or (A + A^T) / 2 when the two differ by rounding only."""
    if A.ndim == 1:
        return A
    if sp.issparse(A):
        other = A.tocsc()  # the rows of A^T
        if all(np.array_equal(getattr(A, x), getattr(other, x)) for x in _ARRAYS):
            return A
        skew = sp.coo_array(A - A.T)
        rows, columns, values = skew.row, skew.col, np.abs(skew.data)
    elif np.array_equal(A, A.T):
        return A
    else:
        with np.errstate(over="ignore"):
            skew = np.abs(A - A.T)
        rows, columns = np.nonzero(skew)
        values = skew[rows, columns]
    if values.size == 0 or values.max() == 0.0:
        return A
    scale = np.sqrt(np.abs(diagonal(A)))
    of_rows = abs(A).max(axis=1)
    largest = np.sqrt(of_rows.toarray().ravel() if sp.issparse(A) else of_rows)
    excess = values - SYMMETRY * scale[rows] * scale[columns]
    excess -= SYMMETRY_OF_ROW * largest[rows] * largest[columns]
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0 and required is not False:
        raise ValueError(_unsymmetric(A, name, int(rows[worst]), int(columns[worst]), required))
    if excess[worst] > 0.0:
        return A
    mean = A * 0.5 + A.T * 0.5
    return sp.csr_array(mean) if sp.issparse(A) else mean


def _unsymmetric(A: Any, name: str, i: int, j: int, may_be: bool | None) -> str:
    """What is wrong with a matrix that is not symmetric at [i, j], and what to do."""
    entries = sp.coo_array(A)
    stored = entries.data != 0.0
    below = bool(np.any(entries.row[stored] > entries.col[stored]))
    above = bool(np.any(entries.row[stored] < entries.col[stored]))
    if below != above:
        side, other = ("below", "above") if below else ("above", "below")
        return (
            f"{name} must be symmetric, got one with entries {side} the diagonal and none {other} "
            f"it; if it is one triangle of a symmetric matrix, readers.completed({name}) is the "
            "whole"
        )
    got = f"{A[i, j]:g} at [{i}, {j}] and {A[j, i]:g} at [{j}, {i}]"
    d = np.sqrt(np.abs(diagonal(A)))
    size = d[i] * d[j] or max(abs(A[i, j]), abs(A[j, i]))
    with np.errstate(over="ignore"):
        difference = abs(A[i, j] - A[j, i]) / size
    if difference <= FEW_DIGITS:
        return (
            f"{name} must be symmetric to {SYMMETRY:g} of the diagonal, got {got}, which differ by "
            f"{difference:.2g} of it; for a matrix of few digits, readers.symmetrized({name}, tol) "
            "takes the mean"
        )
    return f"{name} must be symmetric, got {got}" + (f"; {ADMITTED}" if may_be else "")


def _simplest(A: Any) -> Matrix | None:
    """None or a 1-D array where the entries allow it."""
    if A.ndim == 1:
        return A if A.any() else None
    if not sp.issparse(A):
        d = A.diagonal().copy()
        if np.count_nonzero(A) == np.count_nonzero(d):
            return d if d.any() else None
        return A
    if np.count_nonzero(A.data) > A.shape[0]:
        return A  # more entries than the diagonal has
    rows = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    if not A.data[rows != A.indices].any():
        d = A.diagonal()
        return d if d.any() else None
    return A


def diagonal(A: Any) -> np.ndarray:
    d: np.ndarray = A if A.ndim == 1 else A.diagonal()
    return d


def sparse_diagonal(d: np.ndarray) -> sp.csr_array:
    """The diagonal matrix of d, which multiplies and adds as a matrix does; a 1-D array does not.

    c_m * d + c_k * K would add d to every row of K.
    """
    d = np.asarray(d, dtype=np.float64)
    index = np.flatnonzero(d).astype(np.int32)
    ptr = np.concatenate([[0], np.cumsum(d != 0.0)]).astype(np.int32)
    return sp.csr_array((d[index], index, ptr), shape=(d.size, d.size))


def permuted(A: Matrix | None, order: np.ndarray) -> Matrix | None:
    """A with row and column k taken from order[k]."""
    if A is None or np.array_equal(order, np.arange(order.size)):
        return A
    if A.ndim == 1:
        return A[order]
    if isinstance(A, np.ndarray):
        return np.ascontiguousarray(A[np.ix_(order, order)])
    ptr, index, data = _core.permuted(core_sparse(A), order)
    B = with_entries(A, data)
    B.indptr, B.indices = (x.astype(A.indices.dtype, copy=False) for x in (ptr, index))
    B.has_canonical_format = True
    return B


def with_entries(A: sp.csr_array, data: np.ndarray) -> sp.csr_array:
    """A matrix with the pattern of A, which it shares; the constructor of SciPy, which checks the
    pattern again, takes six times as long."""
    B = copy(A)
    B.data = data
    return B


def absolute(A: Matrix) -> Matrix:
    """The absolute values of the entries."""
    return np.abs(A) if isinstance(A, np.ndarray) else with_entries(A, np.abs(A.data))


def combination(terms: list[tuple[float, Matrix]]) -> Matrix | None:
    """The sum of factor times matrix, in the simplest form for all of them."""
    present = [(f, A) for f, A in terms if A is not None and f != 0.0]
    if not present:
        return None
    if all(A.ndim == 1 for _, A in present):
        return sum(f * A for f, A in present)
    if any(A.ndim == 2 and not sp.issparse(A) for _, A in present):
        return sum(f * dense(A) for f, A in present)
    total, *summands = (_scaled(f, A) for f, A in present)
    for A in summands:
        total = _sparse_sum(total, A)
    return total


def _scaled(factor: float, A: Matrix) -> Matrix:
    """factor A of a diagonal or a sparse matrix."""
    return factor * A if isinstance(A, np.ndarray) else with_entries(A, factor * A.data)


def _sparse_sum(A: Any, B: Any) -> Any:
    """A + B of matrices in inner form, of which none is dense."""
    if A.ndim == B.ndim == 1:
        return A + B
    if A.ndim == 2 and B.ndim == 2:
        return A + B
    A, d = (B, A) if A.ndim == 1 else (A, B)
    places = np.flatnonzero(A.indices == row_of_entries(A))
    if places.size < d.size:
        return sp.csr_array(A + sp.diags_array(d))
    data = A.data.copy()
    data[places] += d
    return with_entries(A, data)


def sparse(A: Matrix | None, n: int) -> sp.csr_array:
    """A matrix (n, n) in inner form by rows; None and diagonals too."""
    if A is None:
        return sp.csr_array((n, n))
    return sp.csr_array(sp.diags_array(A) if A.ndim == 1 else A)


def dense(A: Any) -> np.ndarray:
    """A matrix in inner form as (n, n) array."""
    if sp.issparse(A):
        result: np.ndarray = A.toarray()
        return result
    return np.diag(A) if A.ndim == 1 else A


def largest_pairs(A: Matrix, B: Matrix, k: int) -> tuple[np.ndarray, np.ndarray]:
    """The k largest theta of A x = theta B x, ascending, and their vectors (n, k); B definite."""
    from scipy.linalg import eigh

    n = A.shape[0]
    A, B = dense(A), dense(B)
    values, x = eigh(A, B, subset_by_index=[n - k, n - 1])
    if values.size < k:  # LAPACK's bisection loses eigenvalues of high multiplicity, silently
        values, x = eigh(A, B)
    return values[-k:], x[:, -k:]


def product(A: Matrix | None, x: np.ndarray) -> np.ndarray:
    """A x for x of shape (n,) or (n, k)."""
    if A is None:
        return np.zeros_like(x)
    if A.ndim == 1:
        result: np.ndarray = (A * x.T).T
        return result
    if not x.any():
        return np.zeros_like(x)
    if sp.issparse(A):
        result = A @ x
        return result
    if A.size <= SMALL:
        result = np.einsum("ij,j...->i...", A, x)
        return result
    with one_thread():
        result = A @ x
        return result


def is_symmetric(A: Matrix | None) -> bool:
    """Whether A is exactly symmetric, as matrices are that `canonical` found to be symmetric."""
    if A is None or A.ndim == 1:
        return True
    if not sp.issparse(A):
        return np.array_equal(A, A.T)
    A, other = sp.csr_array(A), sp.csr_array(A.T)
    other.sort_indices()
    return all(np.array_equal(getattr(A, x), getattr(other, x)) for x in _ARRAYS)


def skew_part(A: Matrix) -> Matrix | None:
    """(A - A^T) / 2; None where A is symmetric."""
    return None if is_symmetric(A) else combination([(0.5, A), (-0.5, A.T)])


def core_matrix(A: Matrix | None, *, symmetric: bool = True) -> Any:
    """A in a form of the core: None, an array by columns, Band, Compressed or Strips.

    Of a `symmetric` matrix, rows are taken for columns, and a band is what is above the diagonal.
    """
    if A is None or isinstance(A, np.ndarray):
        return None if A is None else np.ascontiguousarray(A if symmetric else A.T)
    n, rows = A.shape[0], row_of_entries(A)
    width = int(np.max(np.abs(A.indices - rows), initial=0))
    if not is_narrow(width + 1, n, A.nnz):
        return strips_or_rows(core_sparse(A))
    band = np.zeros((1 if symmetric else 2, width + 1, n))
    for half, (i, j) in zip(band, ((rows, A.indices), (A.indices, rows))):
        upper = j >= i
        half[j[upper] - i[upper], i[upper]] = A.data[upper]
    return Band(band[0] if symmetric else band)


def strips_or_rows(A: Compressed) -> Strips | Compressed:
    """Strips, where they take few enough bytes, else the rows themselves."""
    strips = Strips(*_core.strips(A))
    first, _, index, _, values = strips
    bytes_of_strips = 8 * values.size + 4 * index.size + 24 * first.size
    bytes_of_rows = 12 * A[2].size + 8 * A[0].size
    most = STRIPS_OVER_ROWS_IN_CACHE if bytes_of_strips <= CACHE else STRIPS_OVER_ROWS
    return strips if bytes_of_strips <= most * bytes_of_rows else A


def row_of_entries(A: Any) -> np.ndarray:
    """The row of each entry of a matrix by rows, the column of one by columns."""
    return np.repeat(np.arange(A.indptr.size - 1), np.diff(A.indptr))


def is_narrow(width: int, n: int, entries: int) -> bool:
    """Whether a band of this width takes no more bytes than (ptr, index, values)."""
    return 0 < width <= WIDEST_BAND and width <= n and 8 * width * n <= 12 * entries + 8 * n


def core_sparse(A: Any) -> Compressed:
    """A compressed matrix in the types of the core."""
    return Compressed(
        np.ascontiguousarray(A.indptr, dtype=np.int64),
        np.ascontiguousarray(A.indices, dtype=np.int32),
        np.ascontiguousarray(A.data, dtype=np.float64),
    )


def checksum(A: Any) -> str:
    """A word for an array or a sparse matrix, the same for equal ones; None is zero."""
    if A is None:
        return "zero"
    arrays = [A]
    if sp.issparse(A):
        arrays = [A.indptr.astype(np.int64), A.indices.astype(np.int64), A.data]
    digest = hashlib.sha256(repr(A.shape).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    return f"checksum {digest.hexdigest()[:16]}"
