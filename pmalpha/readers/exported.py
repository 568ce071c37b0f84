"""Matrices that other programs wrote as text: Abaqus, CalculiX and Nastran.

What to write into their input is in docs/exported-matrices.md. Matrix Market and Harwell-Boeing
files are read by ``scipy.io.mmread`` and ``scipy.io.hb_read``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

import numpy as np
import scipy.sparse as sp

from .._checks import MOST, listing, plain_array, real_array, real_number
from ..files import checked_path

__all__ = ["ExportedMatrix", "asymmetry", "read_abaqus", "read_dmig", "symmetrized"]


@dataclass(frozen=True, eq=False)
class ExportedMatrix:
    """A square matrix from a file, and what its rows stand for.

    Attributes
    ----------
    matrix : (n, n) csr_array
        Row and column i belong to the same dof.
    labels : (n, 2) ndarray of int
        Node and component of each row, as the other program numbers them: components 1, 2, 3 are
        displacements, 4, 5, 6 rotations; 0 where the file has none.
    name : str
        That of the matrix or of the file.

    Examples
    --------
    >>> whole = ExportedMatrix(sp.csr_array([[2.0, -1.0], [-1.0, 1.0]]), [[7, 1], [9, 1]], "K")
    >>> whole.rows([9]).tolist()
    [1]
    """

    matrix: sp.csr_array
    labels: Any
    name: str = ""

    def __post_init__(self):
        labels = _checked_labels(self.labels)
        if self.matrix.shape != (len(labels), len(labels)):
            raise ValueError(
                f"labels must be as many as rows and columns, got {len(labels)} for a matrix of "
                f"shape {self.matrix.shape}"
            )
        labels.setflags(write=False)
        object.__setattr__(self, "labels", labels)

    def __repr__(self) -> str:
        return f"<ExportedMatrix {self.name!r}, {self.n} rows, {self.matrix.nnz} entries>"

    @property
    def n(self) -> int:
        """How many rows there are."""
        return len(self.labels)

    def rows(self, nodes: Any, component: int | None = None) -> np.ndarray:
        """Rows of nodes, in the order of the nodes: dofs for `tie`, loads and `reduce`.

        Parameters
        ----------
        nodes : int or (k,) array of int
            As the other program numbers them.
        component : int, optional
            One component of each node. Default: all that the matrix has.

        Returns
        -------
        (m,) ndarray of int

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
        found = [order[i:j] for i, j in zip(first, last)]
        if component is not None:
            found = [rows[self.labels[rows, 1] == component] for rows in found]
        lost = [int(node) for node, rows in zip(wanted, found) if not rows.size]
        if lost:
            which = "a row" if component is None else f"a row of component {component}"
            raise ValueError(f"nodes must have {which}, got {listing(lost)} without")
        return np.concatenate([np.empty(0, dtype=np.int64), *found])

    def arranged(self, labels: Any) -> ExportedMatrix:
        """The matrix with rows for these labels, in this order; new rows are zero.

        Programs leave out empty rows: a mass matrix may have fewer than the stiffness matrix.
        ``M.arranged(K.labels)`` belongs to K row by row.

        Parameters
        ----------
        labels : (m, 2) array_like of int
            At least all labels that the matrix has.

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
        wanted = _checked_labels(labels)
        place = {label: i for i, label in enumerate(map(tuple, wanted.tolist()))}
        own = list(map(tuple, self.labels.tolist()))
        lost = [label for label in own if label not in place]
        if lost:
            raise ValueError(f"labels must have all of the matrix, got none for {listing(lost)}")
        to = np.array([place[label] for label in own], dtype=np.int64)
        entries = self.matrix.tocoo()
        n = len(wanted)
        matrix = sp.coo_array((entries.data, (to[entries.row], to[entries.col])), shape=(n, n))
        return ExportedMatrix(sp.csr_array(matrix), wanted, self.name)


def _checked_labels(value: Any) -> np.ndarray:
    labels = plain_array(value, "labels")
    if labels.dtype.kind not in "iu":
        raise TypeError(f"labels must be whole numbers, got dtype {labels.dtype}")
    if labels.ndim != 2 or labels.shape[1] != 2:
        raise ValueError(f"labels must be pairs (node, component), got shape {labels.shape}")
    unique, counts = np.unique(labels, axis=0, return_counts=True)
    if len(unique) < len(labels):
        twice = [tuple(label) for label in unique[counts > 1].tolist()]
        raise ValueError(f"labels must be different, got {listing(twice)} more than once")
    return labels.astype(np.int64)


# ---- symmetry --------------------------------------------------------------------------------


def asymmetry(A: Any) -> float:
    """By how much a matrix is unsymmetric: the largest of |A_ij - A_ji| / sqrt(a_i a_j).

    a_i = |A_ii|, so that units do not matter: rotations and displacements can stand in one matrix.
    Where A_ii is 0, a_i is the largest magnitude in row and column i.

    Parameters
    ----------
    A : (n, n) array or scipy.sparse matrix or array

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


def symmetrized(A: Any, tol: float) -> Any:
    """(A + A^T) / 2, if A is symmetric but for this part of its entries.

    `Subdomain` takes only matrices that are symmetric to rounding. A file with few digits, or a
    follower load known to be small, is made so here by an explicit decision.

    Parameters
    ----------
    A : (n, n) array or scipy.sparse matrix or array
    tol : float
        The largest `asymmetry` that is accepted, at least 0.

    Returns
    -------
    (n, n) ndarray or csr_array

    Raises
    ------
    TypeError, ValueError
        For a matrix that is not real, square and finite, or less symmetric than tol.

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
    A = sp.csr_array(value) if sp.issparse(value) else real_array(value, "A", 2)
    if A.shape[0] != A.shape[1]:
        raise ValueError(f"A must be square, got shape {A.shape}")
    if sp.issparse(A):
        real_array(A.data, "the stored entries of A")
    return A


def _worst_pair(A: Any) -> tuple[float, int, int]:
    """The largest |A_ij - A_ji| / sqrt(a_i a_j), and where it is."""
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


# ---- lines of a file -------------------------------------------------------------------------


class _Line(NamedTuple):
    number: int
    text: str


def _refuse(path: str, line: int, rule: str) -> NoReturn:
    raise ValueError(f"{path}, line {line}: {rule}")


def _lines(path: str) -> Iterator[_Line]:
    """The lines that are not blank; ValueError for what is no text, or ends within a line."""
    with open(path, encoding="latin-1", newline=None) as file:
        for number, text in enumerate(file, start=1):
            if "\0" in text:
                _refuse(path, number, "must be text, got a binary file")
            if text.strip():
                if not text.endswith("\n"):
                    end = text.strip()[-30:]
                    _refuse(path, number, f"must end with a new line, or is cut off, got {end!r}")
                yield _Line(number, text.rstrip())


# ---- Abaqus ----------------------------------------------------------------------------------

ROW_COLUMN, NODE_DOF = 3, 5  # fields of a line in the two formats
# A coordinate list without labels may leave rows empty, but not more than this many for each entry:
# a wrong digit in an index must not make a matrix that fills the memory.
ROWS_PER_ENTRY = 10


def read_abaqus(path: str | os.PathLike, labels: Any = None) -> ExportedMatrix:
    """A matrix that ``*MATRIX OUTPUT`` of Abaqus wrote, or MATRIXSTORAGE of CalculiX.

    Two formats, told apart by their columns: FORMAT=COORDINATE, "row column value", and
    FORMAT=MATRIX INPUT, "node, dof, node, dof, value", also with the keyword line
    ``*MATRIX INPUT`` above. Where no entry has its mirror image in the file, it holds one triangle,
    and the other one is filled in; otherwise the matrix is as written.

    Parameters
    ----------
    path : str or path
    labels : (n, 2) array_like of int, optional
        Node and component of each row of a coordinate list, which itself has none: the file
        .dof of CalculiX, or what is known of the model. Default: (row, 0) with rows from 1 to the
        largest one found.

    Returns
    -------
    ExportedMatrix
        Rows of the format with labels are in the order of nodes, then components; internal nodes
        of Abaqus, with numbers below 0, come last.

    Raises
    ------
    OSError
        When the file cannot be read.
    TypeError
        For a path that is none, and labels that are no whole numbers.
    ValueError
        With file and line: other columns than these, what is no number or not finite, indices out
        of range, entries that stand twice, a file that ends within a line.

    Notes
    -----
    A list that was cut off between two lines looks like one of a smaller or a sparser matrix.
    Compare `n` with the model, and see whether ``K @ rigid_motion`` vanishes.

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
        labels = _checked_labels(labels)
    lines, unsymmetric = _abaqus_data(path)
    table = _table(path, lines)
    numbers = np.array([line.number for line in lines])
    if table.shape[1] == ROW_COLUMN:
        rows, columns, n = _coordinates(path, numbers, table, labels)
        if labels is None:
            labels = np.column_stack([np.arange(1, n + 1), np.zeros(n, dtype=np.int64)])
    elif labels is not None:
        raise ValueError(f"labels must be None for {path}, whose lines have nodes and dofs")
    else:
        rows, columns, labels = _labelled(table[:, :4].astype(np.int64))
    entries = _Entries(path, numbers, rows, columns, table[:, -1], labels)
    entries.require_once()
    complete = not unsymmetric and not entries.mirrored().any()
    return ExportedMatrix(entries.matrix(complete), labels, os.path.basename(path))


def _abaqus_data(path: str) -> tuple[list[_Line], bool]:
    """The data lines, and whether a keyword line says TYPE=UNSYMMETRIC."""
    lines: list[_Line] = []
    unsymmetric, keywords = False, 0
    for line in _lines(path):
        text = line.text.lstrip()
        if text[0] not in "*%":
            lines.append(line)
        elif text.startswith("%%MatrixMarket"):
            _refuse(path, line.number, "is a Matrix Market file: read it by scipy.io.mmread")
        elif not text.startswith(("**", "%")):
            keywords += 1
            unsymmetric = _is_unsymmetric(path, line)
            if keywords > 1 or lines:
                _refuse(path, line.number, f"must be the only matrix of the file, got {text!r}")
    if not lines:
        raise ValueError(f"{path} must hold lines of a matrix, got none")
    return lines, unsymmetric


def _is_unsymmetric(path: str, line: _Line) -> bool:
    word, *options = [part.strip().upper() for part in line.text.split(",")]
    if word != "*MATRIX INPUT":
        _refuse(path, line.number, f"must be data or *MATRIX INPUT, got {line.text.strip()!r}")
    given = {key.strip(): value.strip() for key, _, value in (o.partition("=") for o in options)}
    if "SCALE FACTOR" in given or "INPUT" in given:
        _refuse(path, line.number, "must not have SCALE FACTOR or INPUT, which are not followed")
    return given.get("TYPE") == "UNSYMMETRIC"


def _table(path: str, lines: Sequence[_Line]) -> np.ndarray:
    """The numbers of all lines, (lines, 3) or (lines, 5): whole and finite where they must be."""
    columns = len(_fields(lines[0].text))
    if columns not in (ROW_COLUMN, NODE_DOF):
        _refuse(
            path,
            lines[0].number,
            "must have 3 fields (row, column, value) or 5 (node, dof, node, dof, value), got "
            f"{columns}: {lines[0].text.strip()!r}",
        )
    texts = [line.text.replace(",", " ").replace("D", "e").replace("d", "e") for line in lines]
    try:
        table = np.loadtxt(texts, ndmin=2, comments=None)
    except ValueError:  # which line it is, is found below
        table = np.array([_numbers(path, line, columns) for line in lines])
    index = table[:, :-1]
    whole = np.all((index == np.round(index)) & (np.abs(index) < MOST), axis=1)
    whole &= np.isfinite(table[:, -1])
    if not whole.all():
        line = lines[int(np.argmin(whole))]
        rule = "must have whole numbers before a finite value"
        _refuse(path, line.number, f"{rule}, got {line.text.strip()!r}")
    return table


def _fields(text: str) -> list[str]:
    return text.replace(",", " ").split()


def _numbers(path: str, line: _Line, columns: int) -> list[float]:
    fields = _fields(line.text)
    if len(fields) != columns:
        rule = f"must have {columns} fields as the lines above"
        _refuse(path, line.number, f"{rule}, got {len(fields)}: {line.text.strip()!r}")
    try:
        return [float(field.replace("D", "e").replace("d", "e")) for field in fields]
    except ValueError:
        _refuse(path, line.number, f"must hold numbers, got {line.text.strip()!r}")


def _coordinates(
    path: str, numbers: np.ndarray, table: np.ndarray, labels: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows and columns from 0, and the size of the matrix."""
    index = table[:, :2].astype(np.int64)
    n = int(index.max()) if labels is None else len(labels)
    if labels is None:
        n = min(n, ROWS_PER_ENTRY * len(table))
    inside = np.all((index >= 1) & (index <= n), axis=1)
    if not inside.all():
        bad = int(np.argmin(inside))
        rule = f"must have row and column in 1..{n}" if n > 0 else "must have row and column from 1"
        _refuse(path, int(numbers[bad]), f"{rule}, got {index[bad, 0]}, {index[bad, 1]}")
    return index[:, 0] - 1, index[:, 1] - 1, n


def _labelled(index: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns and labels of entries that name (node, component, node, component)."""
    both = np.concatenate([index[:, :2], index[:, 2:]])
    labels, place = np.unique(both, axis=0, return_inverse=True)
    # nodes by number, internal ones (-1, -2, ...) after all others
    order = np.lexsort([labels[:, 1], np.abs(labels[:, 0]), labels[:, 0] < 0])
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    rows, columns = rank[place.ravel()].reshape(2, -1)
    return rows, columns, labels[order]


@dataclass(frozen=True, eq=False)
class _Entries:
    """Entries of a matrix, each with the number of the line it comes from."""

    path: str
    lines: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    labels: np.ndarray

    def require_once(self, *, either_side: bool = False) -> None:
        """ValueError for a place that has two entries, or with its mirror image if asked."""
        n = len(self.labels)
        key = self.rows * n + self.columns
        if either_side:
            key = np.minimum(key, self.columns * n + self.rows)
        order = np.argsort(key, kind="stable")
        again = np.flatnonzero(np.diff(key[order]) == 0)
        if again.size:
            first, second = order[again[0]], order[again[0] + 1]
            what = f"{self._label(self.rows[second])}, {self._label(self.columns[second])}"
            mirrored = self.rows[first] != self.rows[second]
            side = ", on the other side of the diagonal" if mirrored else ""
            rule = f"must have each entry once, got {what} again after line {self.lines[first]}"
            _refuse(self.path, int(self.lines[second]), rule + side)

    def _label(self, row: int) -> str:
        node, component = self.labels[row]
        return f"({node}, {component})" if component else f"{node}"

    def mirrored(self) -> np.ndarray:
        """Of each entry off the diagonal: is its mirror image there?"""
        n = len(self.labels)
        off = self.rows != self.columns
        rows, columns = self.rows[off], self.columns[off]
        return np.isin(columns * n + rows, rows * n + columns)

    def matrix(self, complete: bool) -> sp.csr_array:
        """The matrix, with the mirror images of all entries if `complete`."""
        n = len(self.labels)
        rows, columns, values = self.rows, self.columns, self.values
        if complete:
            off = rows != columns
            rows, columns = np.append(rows, columns[off]), np.append(columns, self.rows[off])
            values = np.append(values, values[off])
        matrix = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(n, n)))
        matrix.sort_indices()
        return matrix


# ---- Nastran ---------------------------------------------------------------------------------

# "3.+5", "-1.25D-3", "2.5+10": the exponent may come without its letter
NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[EeDd]?([+-]\d+)|[EeDd](\d+))?")
SYMMETRIC, SQUARE = 6, (1, 2)
REAL, COMPLEX = (1, 2), (3, 4)


class _Field(NamedTuple):
    line: int
    text: str


@dataclass(frozen=True, eq=False)
class _Card:
    """An entry of the bulk data with all its continuations: fields 2 to 9 of every line."""

    line: int
    fields: list[_Field]

    def text(self, i: int) -> str:
        return self.fields[i].text if i < len(self.fields) else ""


def read_dmig(path: str | os.PathLike, name: str | None = None) -> ExportedMatrix:
    """A matrix of DMIG entries, as in the punch file of Nastran.

    Fields of 8 columns (``DMIG``), of 16 (``DMIG*``) or between commas. Entries of other kinds are
    passed over, so that the whole punch file can be given.

    Parameters
    ----------
    path : str or path
    name : str, optional
        Of the matrix, such as "KAAX". Default: the only one in the file.

    Returns
    -------
    ExportedMatrix
        Rows in the order of points, then components. Rows and columns that the file leaves out,
        being zero, are not there: see `ExportedMatrix.arranged`.

    Raises
    ------
    OSError
        When the file cannot be read.
    TypeError
        For a path that is none.
    ValueError
        With file and line: a complex or a rectangular matrix, one without its header, what is no
        number, entries that stand twice, in the symmetric form also on both sides of the diagonal,
        a file that ends within an entry. With the names there are: none, or several and no `name`.

    Examples
    --------
    >>> import os, tempfile
    >>> from pmalpha.readers import read_dmig
    >>> text = '''DMIG    KAAX           0       6       2       0
    ... DMIG*   KAAX                           5               1
    ... *                      5               1 2.000000000D+00
    ... DMIG*   KAAX                           9               1
    ... *                      5               1-1.000000000D+00
    ... *                      9               1 1.000000000D+00
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "job.pch")
    ...     with open(path, "w") as file:
    ...         _ = file.write(text)
    ...     K = read_dmig(path, "KAAX")
    >>> K.matrix.toarray().tolist(), K.labels.tolist()
    ([[2.0, -1.0], [-1.0, 1.0]], [[5, 1], [9, 1]])
    """
    path = str(checked_path(path))
    cards: dict[str, list[_Card]] = {}
    for card in _dmig_cards(path):
        cards.setdefault(card.text(0).upper(), []).append(card)
    names = listing([repr(key) for key in cards])
    if not cards:
        raise ValueError(f"{path} must have DMIG entries, got none")
    if name is None and len(cards) > 1:
        raise ValueError(f"name must be given where there are several matrices: {path} has {names}")
    wanted = next(iter(cards)) if name is None else str(name).upper()
    if wanted not in cards:
        raise ValueError(f"name must be of a matrix in {path}, which has {names}, got {name!r}")
    form = _dmig_form(path, wanted, cards[wanted])
    terms = [term for card in cards[wanted][1:] for term in _dmig_terms(path, card)]
    if not terms:
        line = cards[wanted][0].line
        _refuse(path, line, f"must be followed by columns of {wanted}, got none")
    index = np.array([term[1:5] for term in terms], dtype=np.int64)
    rows, columns, labels = _labelled(index)
    lines, values = np.array([t[0] for t in terms]), np.array([t[5] for t in terms])
    entries = _Entries(path, lines, rows, columns, values, labels)
    entries.require_once(either_side=form == SYMMETRIC)
    return ExportedMatrix(entries.matrix(form == SYMMETRIC), labels, wanted)


def _dmig_cards(path: str) -> Iterator[_Card]:
    card: _Card | None = None
    for line in _lines(path):
        text = line.text.expandtabs(8)
        if text.startswith("$"):
            continue
        if text[0] in "+* ,":
            if card is not None:
                card.fields.extend(_dmig_fields(path, line.number, text))
            continue
        if card is not None:
            yield card
        word = re.split(r"[\s*,]", text, maxsplit=1)[0].upper()
        card = None
        if word == "DMIG":
            card = _Card(line.number, _dmig_fields(path, line.number, text))
    if card is not None:
        yield card


def _dmig_fields(path: str, line: int, text: str) -> list[_Field]:
    """Fields 2 to 9 of a line, or half of them where they are wide."""
    wide = "*" in text[:8].split(",")[0]
    count = 4 if wide else 8
    if "," in text:
        parts = text.split(",")[1:]
        if len(parts) > count + 1:  # the last one marks the continuation
            _refuse(path, line, f"must have at most {count + 2} fields, got {len(parts) + 1}")
        parts = parts[:count]
    else:
        width = 64 // count
        parts = [text[i : i + width] for i in range(8, 72, width)]
    parts += [""] * (count - len(parts))
    return [_Field(line, part.strip()) for part in parts]


def _dmig_form(path: str, name: str, cards: Sequence[_Card]) -> int:
    """The form that the header says, which comes first and once."""
    header = cards[0]
    if header.text(1) != "0":
        rule = f"must come after the header of {name}, with 0 in its third field"
        _refuse(path, header.line, f"{rule}, got {header.text(1)!r}")
    again = [card.line for card in cards[1:] if card.text(1) == "0"]
    if again:
        _refuse(path, again[0], f"must not be a second header of {name}")
    form = _integer(path, header.fields[2], f"form of {name}")
    kind = _integer(path, header.fields[3], f"type of {name}")
    if kind in COMPLEX:
        _refuse(path, header.line, f"{name} must be real, type 1 or 2, got complex type {kind}")
    if kind not in REAL:
        _refuse(path, header.line, f"{name} must be of type 1 or 2 (real), got {kind}")
    if form not in (SYMMETRIC, *SQUARE):
        rule = f"{name} must be of form 6 (symmetric), 1 or 2 (square)"
        _refuse(path, header.line, f"{rule}, got {form}")
    return form


def _dmig_terms(path: str, card: _Card) -> Iterator[tuple[int, int, int, int, int, float]]:
    """Line, row label, column label and value of the entries of a column."""
    column = _point(path, card.fields[1]), _component(path, card.fields[2])
    rest = card.fields[4:]
    for i in range(0, len(rest), 4):
        node, component, value, imaginary = rest[i : i + 4]
        if not any(f.text for f in (node, component, value, imaginary)):
            continue
        row = _point(path, node), _component(path, component)
        if not value.text:
            rule = f"must have a value for row {row} of column {column}, or is cut off"
            _refuse(path, value.line, f"{rule}, got none")
        if imaginary.text and _real(path, imaginary) != 0.0:
            rule = "must have no imaginary part, being of a real type"
            _refuse(path, imaginary.line, f"{rule}, got {imaginary.text!r}")
        yield value.line, *row, *column, _real(path, value)
    if not any(f.text for f in rest):
        _refuse(path, card.line, f"must have rows for column {column}, or is cut off, got none")


def _integer(path: str, field: _Field, what: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,18}", field.text):
        _refuse(path, field.line, f"{what} must be a whole number, got {field.text!r}")
    return int(field.text)


def _point(path: str, field: _Field) -> int:
    number = _integer(path, field, "point")
    if number < 1:
        _refuse(path, field.line, f"point must be at least 1, got {number}")
    return number


def _component(path: str, field: _Field) -> int:
    """1 to 6 of a grid point, 0 or blank of a scalar point."""
    number = _integer(path, field, "component") if field.text else 0
    if not 0 <= number <= 6:
        _refuse(path, field.line, f"component must lie in 0..6, got {number}")
    return number


def _real(path: str, field: _Field) -> float:
    match = NUMBER.fullmatch(field.text)
    value = np.inf
    if match:
        digits, exponent, plain = match.groups()
        value = float(f"{digits}e{exponent or plain or 0}")
    if not np.isfinite(value):
        _refuse(path, field.line, f"value must be a finite number, got {field.text!r}")
    return value
