"""Matrices of Abaqus and CalculiX."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import MOST, fortran_real, listing
from ..errors import warn
from ..files import checked_path
from .exported import ExportedMatrix, checked_labels
from .text import Entries, Line, labelled, refuse, text_lines

# ---- user elements ------------------------------------------------------------------------------
# Element matrices of Abaqus: the user elements of ``*ELEMENT MATRIX OUTPUT``.

KINDS = {"STIFFNESS": "K", "MASS": "M", "DAMPING": "C"}
# Components of a node; and zeros in place of matrices that a file has not, by those that it has
MOST_COMPONENTS, MOST_ZEROS = 30, 64


@dataclass(frozen=True, eq=False)
class ElementMatrices:
    """Matrices of elements with the labels of their rows, for `pmalpha.Elements`.

    Attributes
    ----------
    labels : (e, k, 2) ndarray of int
        Node and component of each row of each element.
    K, M, C : (e, k, k) ndarray or None
        None where the file has none.

    Examples
    --------
    >>> labels = np.array([[[1, 1], [2, 1]]])
    >>> both = ElementMatrices(labels, K=np.array([[[2.0, -1.0], [-1.0, 1.0]]]))
    >>> both.dofs([[1, 1], [2, 1]]).tolist()
    [[0, 1]]
    """

    labels: np.ndarray
    K: np.ndarray | None = None
    M: np.ndarray | None = None
    C: np.ndarray | None = None

    def dofs(self, rows: Any) -> np.ndarray:
        """The dofs of the elements, (e, k), in a structure with these rows.

        Parameters
        ----------
        rows : (n, 2) array_like of int
            Node and component of each dof of the structure.

        Returns
        -------
        (e, k) ndarray of int
            -1 for what is not in `rows`, that is for a fixed dof.

        Examples
        --------
        >>> ElementMatrices(np.array([[[7, 1], [9, 1]]])).dofs([[9, 1]]).tolist()
        [[-1, 0]]
        """
        number = {tuple(row): i for i, row in enumerate(np.asarray(rows).tolist())}
        of_element = self.labels.reshape(-1, 2).tolist()
        numbers = [number.get(tuple(label), -1) for label in of_element]
        return np.array(numbers, dtype=np.int64).reshape(self.labels.shape[:2])


def is_user_element(line: Line) -> bool:
    return line.text.lstrip().upper().startswith("*USER ELEMENT")


def element_matrices(path: str, lines: list[Line]) -> ElementMatrices:
    """The matrices of a file in which *USER ELEMENT begins each element."""
    labels: list[list[list[int]]] = []
    matrices: dict[str, list[np.ndarray]] = {key: [] for key in KINDS.values()}
    count = 0  # of matrices that the file has
    for word, head, comments, data in _sections(path, lines):
        if word == "*USER ELEMENT":
            labels.append(_labels(path, head, comments, data))
            if len(labels[-1]) != len(labels[0]):
                refuse(path, head.number, "must have elements of one number of dofs")
        elif word == "*MATRIX" and labels:
            kind = _option(head, "TYPE")
            if kind not in KINDS:
                refuse(path, head.number, f"TYPE must be one of {', '.join(KINDS)}, got {kind!r}")
            arrays = matrices[KINDS[kind]]
            arrays += (len(labels) - 1 - len(arrays)) * [np.zeros(2 * (len(labels[0]),))]
            arrays.append(_triangle(path, head, data, len(labels[-1])))
            count += 1
        else:
            refuse(path, head.number, f"must be *USER ELEMENT or *MATRIX, got {head.text!r}")
    missing = np.zeros(2 * (len(labels[0]),))
    zeros = len(labels) * sum(map(bool, matrices.values())) - count
    if missing.size * zeros > MOST_ZEROS * max(missing.size * count, 10**5):
        rule = (
            f"must have one matrix in {MOST_ZEROS} of its elements, got {count} of {zeros + count}"
        )
        refuse(path, lines[-1].number, rule)
    fields = {
        key: np.array(arrays + (len(labels) - len(arrays)) * [missing]) if arrays else None
        for key, arrays in matrices.items()
    }
    return ElementMatrices(np.array(labels, dtype=np.int64), **fields)


def _sections(path: str, lines: list[Line]) -> Iterator[tuple[str, Line, list[str], list[Line]]]:
    """Keyword, its line, the comments after it, and its lines of data."""
    head, comments, data = None, [], []  # type: Line | None, list[str], list[Line]
    for line in lines:
        text = line.text.strip()
        if text.startswith("**"):
            comments.append(text[2:].strip().upper())
        elif text.startswith("*"):
            if head is not None:
                yield _word(head), head, comments, data
            head, comments, data = line, [], []
        elif head is None:
            refuse(path, line.number, f"must begin with a keyword, got {text!r}")
        else:
            data.append(line)
    if head is not None:
        yield _word(head), head, comments, data


def _word(line: Line) -> str:
    return " ".join(line.text.split(",")[0].upper().split())


def _option(line: Line, name: str) -> str:
    pairs = (x.partition("=") for x in line.text.upper().split(",")[1:])
    return {key.strip(): value.strip() for key, _, value in pairs}.get(name, "")


def _labels(path: str, head: Line, comments: list[str], data: list[Line]) -> list[list[int]]:
    """Node and component of each row: the nodes are in comments, the components in data."""
    if "UNSYMM" in head.text.upper():
        refuse(path, head.number, "must be symmetric elements, got UNSYMM")
    try:
        count = int(_option(head, "NODES"))
        listed = comments[comments.index("ELEMENT NODES") + 1 :]
        nodes = [int(x) for text in listed for x in text.replace(",", " ").split()]
        rows = [[int(x) for x in line.text.replace(",", " ").split()] for line in data]
    except ValueError:
        refuse(path, head.number, "must have NODES=, and nodes after a comment ** ELEMENT NODES")
    if len(nodes) != count or not rows:
        refuse(path, head.number, f"must have {count} nodes, got {nodes}")
    # the components of all nodes, then those from a node on that has other ones
    if max(map(len, rows)) > MOST_COMPONENTS:
        most = f"at most {MOST_COMPONENTS} components at a node"
        refuse(path, head.number, f"must have {most}, got {max(map(len, rows))}")
    changes = {position - 1: components for position, *components in rows[1:]}
    labels, components = [], rows[0]
    for i, node in enumerate(nodes):
        components = changes.get(i, components)
        labels += [[node, component] for component in components]
    return labels


def _triangle(path: str, head: Line, data: list[Line], n: int) -> np.ndarray:
    """A symmetric matrix of its lower triangle, row by row."""
    values = []
    for line in data:
        try:
            values += [fortran_real(x) for x in line.text.replace(",", " ").split()]
        except ValueError:
            refuse(path, line.number, f"must hold numbers, got {line.text.strip()!r}")
    if len(values) != n * (n + 1) // 2 or not np.all(np.isfinite(values)):
        rule = f"must have {n * (n + 1) // 2} finite values, the lower triangle of {n} rows"
        refuse(path, head.number, f"{rule}, got {len(values)}")
    A = np.zeros((n, n))
    A[np.tril_indices(n)] = values
    return np.asarray(A + np.tril(A, -1).T)


# ---- abaqus -------------------------------------------------------------------------------------

__all__ = ["read_abaqus"]

ROW_COLUMN, NODE_DOF = 3, 5  # fields of a line in the two formats
# Maximum number of rows per entry in a coordinate list without labels, which may have empty rows: a
# wrong digit in an index must not give a matrix that fills the memory.
ROWS_PER_ENTRY = 10


def read_abaqus(
    path: str | os.PathLike[str], labels: Any = None
) -> ExportedMatrix | ElementMatrices:
    """Read a matrix of ``*MATRIX OUTPUT`` of Abaqus, or of MATRIXSTORAGE of CalculiX.

    Two formats, distinguished by the number of columns: FORMAT=COORDINATE, "row column value", and
    FORMAT=MATRIX INPUT, "node, dof, node, dof, value", also after the keyword line
    ``*MATRIX INPUT``. If no off-diagonal entry has its transposed entry in the file, the file has
    one triangle and the other is added; otherwise the matrix is as written.

    Parameters
    ----------
    path : str or path
        The file, such as job_STIF1.mtx.
    labels : (n, 2) array_like of int, optional
        Node and component of each row of a coordinate list, which does not have them: from the file
        .dof of CalculiX, in which nodes of shells and beams, which it expands, repeat, or from the
        model. Default: (row, 0) with rows from 1 to the largest in
        the file.

    Returns
    -------
    ExportedMatrix
        The rows of the format with labels are in the order of nodes, then components; internal
        nodes of Abaqus, with numbers below 0, come last.
    ElementMatrices
        For a file of ``*ELEMENT MATRIX OUTPUT``, which has user elements: labels (e, k, 2) and the
        matrices K, M and C (e, k, k) or None, for `pmalpha.Elements`.

    Raises
    ------
    OSError
        When the file cannot be read.
    TypeError
        For a wrong type of path, and labels that are not whole numbers.
    ValueError
        With file and line: a wrong number of columns, a value that is not a finite number, indices
        out of range, repeated entries, a file that ends within a line.

    Warns
    -----
    UserWarning
        For 1e36 on the diagonal, which Abaqus writes for dofs with boundary conditions, with their
        rows: they are to be left out (`ExportedMatrix.constrained`).

    Notes
    -----
    A list that was cut off between two lines cannot be distinguished from a smaller or sparser
    matrix. Compare `n` with the model, and check that ``K @ rigid_motion`` is zero.

    Examples
    --------
    >>> import os, tempfile
    >>> from pmalpha.readers import read_abaqus
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "job_STIF1.mtx")
    ...     with open(path, "w") as file:
    ...         _ = file.write("5,1, 5,1, 2.0\\n5,1, 9,1, -1.0\\n9,1, 9,1, 1.0\\n")
    ...     K = read_abaqus(path)
    >>> K.matrix.toarray().tolist(), K.labels.tolist()
    ([[2.0, -1.0], [-1.0, 1.0]], [[5, 1], [9, 1]])
    """
    path = str(checked_path(path))
    if labels is not None:
        labels = checked_labels(labels, differ=False)
    lines = list(text_lines(path))
    if any(is_user_element(line) for line in lines):
        return element_matrices(path, lines)
    lines, unsymmetric = _abaqus_data(path, lines)
    table = _table(path, lines)
    numbers = np.array([line.number for line in lines])
    if table.shape[1] == ROW_COLUMN:
        rows, columns, n = _coordinates(path, numbers, table, labels)
        if labels is None:
            labels = np.column_stack([np.arange(1, n + 1), np.zeros(n, dtype=np.int64)])
    elif labels is not None:
        raise ValueError(f"labels must be None for {path}, whose lines have nodes and dofs")
    else:
        rows, columns, labels = labelled(table[:, :4].astype(np.int64))
    entries = Entries(path, numbers, rows, columns, table[:, -1], labels)
    entries.require_once()
    complete = not unsymmetric and not entries.have_transposed().any()
    expanded = len(np.unique(labels, axis=0)) < len(labels)
    matrix = ExportedMatrix(entries.matrix(complete), labels, os.path.basename(path), expanded)
    if matrix.constrained.size:
        warn(
            f"{matrix.name}: rows {listing(matrix.constrained)} have 1e36 on the diagonal, which "
            "stands for a boundary condition: leave them out, or fix them",
            UserWarning,
        )
    return matrix


def _abaqus_data(path: str, content: Sequence[Line]) -> tuple[list[Line], bool]:
    """The data lines, and whether a keyword line has TYPE=UNSYMMETRIC."""
    lines: list[Line] = []
    unsymmetric, keywords = False, 0
    for line in content:
        text = line.text.lstrip()
        if text[0] not in "*%":
            lines.append(line)
        elif text.startswith("%%MatrixMarket"):
            refuse(path, line.number, "is a Matrix Market file: read it with scipy.io.mmread")
        elif not text.startswith(("**", "%")):
            keywords += 1
            unsymmetric = _is_unsymmetric(path, line)
            if keywords > 1 or lines:
                refuse(path, line.number, f"must be the only matrix of the file, got {text!r}")
    if not lines:
        raise ValueError(f"{path} must hold lines of a matrix, got none")
    return lines, unsymmetric


def _is_unsymmetric(path: str, line: Line) -> bool:
    word, *options = [field.strip().upper() for field in line.text.split(",")]
    if word != "*MATRIX INPUT":
        refuse(path, line.number, f"must be data or *MATRIX INPUT, got {line.text.strip()!r}")
    parameters = {
        key.strip(): value.strip() for key, _, value in (o.partition("=") for o in options)
    }
    if "SCALE FACTOR" in parameters or "INPUT" in parameters:
        refuse(path, line.number, "must not have SCALE FACTOR or INPUT, which are not supported")
    return parameters.get("TYPE") == "UNSYMMETRIC"


def _table(path: str, lines: Sequence[Line]) -> np.ndarray:
    """The numbers of all lines, (lines, 3) or (lines, 5): whole indices and finite values."""
    columns = len(_fields(lines[0].text))
    if columns not in (ROW_COLUMN, NODE_DOF):
        refuse(
            path,
            lines[0].number,
            "must have 3 fields (row, column, value) or 5 (node, dof, node, dof, value), got "
            f"{columns}: {lines[0].text.strip()!r}",
        )
    texts = [line.text.replace(",", " ").replace("D", "e").replace("d", "e") for line in lines]
    try:
        table = np.loadtxt(texts, ndmin=2, comments=None)
    except ValueError:  # line by line, to find the wrong one
        table = np.array([_numbers(path, line, columns) for line in lines])
    index = table[:, :-1]
    is_valid = np.all((index == np.round(index)) & (np.abs(index) < MOST), axis=1)
    is_valid &= np.isfinite(table[:, -1])
    if not is_valid.all():
        line = lines[int(np.argmin(is_valid))]
        rule = "must have whole numbers before a finite value"
        refuse(path, line.number, f"{rule}, got {line.text.strip()!r}")
    return table


def _fields(text: str) -> list[str]:
    return text.replace(",", " ").split()


def _numbers(path: str, line: Line, columns: int) -> list[float]:
    fields = _fields(line.text)
    if len(fields) != columns:
        rule = f"must have {columns} fields as the lines above"
        refuse(path, line.number, f"{rule}, got {len(fields)}: {line.text.strip()!r}")
    try:
        return [float(field.replace("D", "e").replace("d", "e")) for field in fields]
    except ValueError:
        refuse(path, line.number, f"must hold numbers, got {line.text.strip()!r}")


def _coordinates(
    path: str, numbers: np.ndarray, table: np.ndarray, labels: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows and columns, numbered from 0, and the size of the matrix."""
    index = table[:, :2].astype(np.int64)
    n = int(index.max()) if labels is None else len(labels)
    if labels is None:
        n = min(n, ROWS_PER_ENTRY * len(table))
    inside = np.all((index >= 1) & (index <= n), axis=1)
    if not inside.all():
        bad = int(np.argmin(inside))
        rule = f"must have row and column in 1..{n}" if n > 0 else "must have row and column from 1"
        refuse(path, int(numbers[bad]), f"{rule}, got {index[bad, 0]}, {index[bad, 1]}")
    return index[:, 0] - 1, index[:, 1] - 1, n
