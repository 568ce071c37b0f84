"""A matrix exported by another program, with the labels of its rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._checks import counted, listing, plain_array

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
