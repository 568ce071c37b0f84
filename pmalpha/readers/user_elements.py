"""Element matrices of Abaqus: the user elements of ``*ELEMENT MATRIX OUTPUT``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import fortran_real
from .text import Line, refuse

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
