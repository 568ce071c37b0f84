"""Matrices of Abaqus and CalculiX."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._checks import MOST, listing
from ..errors import warn
from ..files import checked_path
from .exported import ExportedMatrix, checked_labels
from .text import Entries, Line, labelled, refuse, text_lines
from .user_elements import ElementMatrices, element_matrices, is_user_element

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
