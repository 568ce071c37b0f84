"""A matrix exported by another program, with the labels of its rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing, plain_array, real_array, real_number
from ..problem.matrices import plain_matrix, rectangular

__all__ = ["ExportedMatrix"]

FIXED = 1e36  # on the diagonal of a dof with a boundary condition


@dataclass(frozen=True, eq=False)
class ExportedMatrix:
    """A square matrix from a file, with node and component of its rows.

    It is taken where a matrix is: ``Subdomain(M, K)``, `reduce`, `structures.modes`.

    Attributes
    ----------
    matrix : (n, n) csr_array
        Row and column i belong to the same dof.
    labels : (n, 2) ndarray of int
        Node and component of each row, in the numbers of the other program: components 1, 2, 3 are
        displacements, 4, 5, 6 rotations; 0 if the file has no components.
    name : str
        Name of the matrix or of the file.
    expanded : bool
        Labels may repeat: CalculiX expands a node of a shell or beam to several.

    Examples
    --------
    >>> whole = ExportedMatrix(sp.csr_array([[2.0, -1.0], [-1.0, 1.0]]), [[7, 1], [9, 1]], "K")
    >>> whole.rows([9]).tolist()
    [1]
    """

    matrix: sp.csr_array
    labels: Any
    name: str = ""
    expanded: bool = False

    def __post_init__(self) -> None:
        labels = checked_labels(self.labels, differ=not self.expanded)
        if self.matrix.shape != (len(labels), len(labels)):
            raise ValueError(
                f"labels must be as many as the rows of the matrix, got {len(labels)} for shape "
                f"{self.matrix.shape}"
            )
        labels.setflags(write=False)
        object.__setattr__(self, "labels", labels)

    def __repr__(self) -> str:
        rows = counted(self.n, "row")
        return f"<ExportedMatrix {self.name!r}, {rows}, nnz = {self.matrix.nnz}>"

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.labels)

    @property
    def nnz(self) -> int:
        """Number of stored entries."""
        return int(self.matrix.nnz)

    @property
    def constrained(self) -> np.ndarray:
        """Rows with at least 1e36 on the diagonal, as Abaqus writes for boundary conditions."""
        return np.flatnonzero(np.abs(self.matrix.diagonal()) >= FIXED)

    def tocsr(self, copy: bool = False) -> sp.csr_array:
        """The matrix, as a matrix of SciPy returns itself.

        Parameters
        ----------
        copy : bool
            True: a copy.

        Returns
        -------
        (n, n) csr_array
            `matrix`.

        Examples
        --------
        >>> ExportedMatrix(sp.csr_array([[5.0]]), [[9, 1]]).tocsr().toarray().tolist()
        [[5.0]]
        """
        return self.matrix.copy() if copy else self.matrix

    def rows(self, nodes: Any, component: int | None = None) -> np.ndarray:
        """Rows of nodes, in the order of the nodes: dofs for `tie`, loads and `reduce`.

        Parameters
        ----------
        nodes : int or (k,) array of int
            In the numbers of the other program.
        component : int, optional
            One component of each node. Default: all components in the matrix.

        Returns
        -------
        (m,) ndarray of int
            Numbers of the rows, from 0.

        Raises
        ------
        ValueError
            For a node without such a row.

        Examples
        --------
        >>> K = ExportedMatrix(sp.eye_array(4, format="csr"), [[7, 1], [7, 2], [9, 1], [9, 2]])
        >>> K.rows([9, 7], 2).tolist(), K.rows(9).tolist()
        ([3, 1], [2, 3])
        """
        wanted = np.atleast_1d(plain_array(nodes, "nodes"))
        if wanted.ndim != 1 or wanted.dtype.kind not in "iu":
            raise TypeError(f"nodes must be whole numbers, got {nodes!r}")
        order = np.argsort(self.labels[:, 0], kind="stable")
        of_rows = self.labels[order, 0]
        first = np.searchsorted(of_rows, wanted, "left")
        last = np.searchsorted(of_rows, wanted, "right")
        rows_of_nodes = [order[i:j] for i, j in zip(first, last)]
        if component is not None:
            rows_of_nodes = [rows[self.labels[rows, 1] == component] for rows in rows_of_nodes]
        missing = [int(node) for node, rows in zip(wanted, rows_of_nodes) if not rows.size]
        if missing:
            which = "a row" if component is None else f"a row of component {component}"
            raise ValueError(f"nodes must have {which}, got {listing(missing)} without")
        return np.concatenate([np.empty(0, dtype=np.int64), *rows_of_nodes])

    def arranged(self, labels: Any) -> ExportedMatrix:
        """The matrix with rows for these labels, in this order; new rows are zero.

        Programs omit empty rows: a mass matrix may have fewer rows than the stiffness matrix.
        ``M.arranged(K.labels)`` has the rows of K.

        Parameters
        ----------
        labels : (m, 2) array_like of int
            Must contain all labels of the matrix.

        Returns
        -------
        ExportedMatrix
            With these m rows.

        Raises
        ------
        TypeError, ValueError
            For labels that are not pairs of whole numbers, repeated or missing.

        Examples
        --------
        >>> mass = ExportedMatrix(sp.csr_array([[5.0]]), [[9, 1]])
        >>> mass.arranged([[7, 1], [9, 1]]).matrix.toarray().tolist()
        [[0.0, 0.0], [0.0, 5.0]]
        """
        wanted = checked_labels(labels)
        if self.expanded:
            checked_labels(self.labels)  # ValueError for those that repeat
        row_of = {label: i for i, label in enumerate(map(tuple, wanted.tolist()))}
        matrix_labels = list(map(tuple, self.labels.tolist()))
        missing = [label for label in matrix_labels if label not in row_of]
        if missing:
            raise ValueError(f"labels must have all of the matrix, got none for {listing(missing)}")
        to = np.array([row_of[label] for label in matrix_labels], dtype=np.int64)
        entries = self.matrix.tocoo()
        n = len(wanted)
        matrix = sp.coo_array((entries.data, (to[entries.row], to[entries.col])), shape=(n, n))
        return ExportedMatrix(sp.csr_array(matrix), wanted, self.name)


def checked_labels(value: Any, *, differ: bool = True) -> np.ndarray:
    labels = plain_array(value, "labels")
    if labels.dtype.kind not in "iu":
        raise TypeError(f"labels must be whole numbers, got dtype {labels.dtype}")
    if labels.ndim != 2 or labels.shape[1] != 2:
        raise ValueError(f"labels must be pairs (node, component), got shape {labels.shape}")
    unique, counts = np.unique(labels, axis=0, return_counts=True)
    if differ and len(unique) < len(labels):
        twice = [tuple(label) for label in unique[counts > 1].tolist()]
        raise ValueError(f"labels must be different, got {listing(twice)} more than once")
    return labels.astype(np.int64)


# ---- symmetry -----------------------------------------------------------------------------------
# Asymmetry of a matrix from a file, and its symmetric part.

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
