"""Lines of a text file and entries of a matrix in it, and errors with file and line."""

from __future__ import annotations

import codecs
import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, NoReturn

import numpy as np
import scipy.sparse as sp

from ..files import reading

# A mark of UTF-8 at the beginning of a file
MARK = codecs.BOM_UTF8.decode("latin-1")


class Line(NamedTuple):
    number: int
    text: str


def refuse(path: str, line: int, rule: str) -> NoReturn:
    """Raise a ValueError with file and line."""
    raise ValueError(f"{path}, line {line}: {rule}")


def text_lines(path: str) -> Iterator[Line]:
    """The lines that are not blank; ValueError for a binary file or one that ends in a line."""
    if path.lower().endswith((".op2", ".op4")):
        raise ValueError(
            f"{path}: OUTPUT2 and OUTPUT4 are not read; their matrices can be given as arrays, "
            "such as those of pyNastran.op4"
        )
    with io.TextIOWrapper(reading(path), encoding="latin-1", newline=None) as file:
        for number, text in enumerate(file, start=1):
            text = text.removeprefix(MARK) if number == 1 else text
            if "\0" in text:
                refuse(path, number, "must be text, got a binary file")
            if text.strip():
                if not text.endswith("\n") and text.strip().upper() != "ENDDATA":
                    end = text.strip()[-30:]
                    refuse(path, number, f"must end with a new line, or is cut off, got {end!r}")
                yield Line(number, text.rstrip())


def labelled(entries: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns and labels of entries given as (node, component, node, component)."""
    both = np.concatenate([entries[:, :2], entries[:, 2:]])
    labels, index = np.unique(both, axis=0, return_inverse=True)
    # nodes by number, internal ones (-1, -2, ...) after all others
    order = np.lexsort([labels[:, 1], np.abs(labels[:, 0]), labels[:, 0] < 0])
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    rows, columns = rank[index.ravel()].reshape(2, -1)
    return rows, columns, labels[order]


@dataclass(frozen=True, eq=False)
class Entries:
    """Entries of a matrix, each with the number of its line."""

    path: str
    lines: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    labels: np.ndarray

    def require_once(self, *, either_side: bool = False) -> None:
        """ValueError for a repeated entry; with `either_side` its transposed entry counts too."""
        n = len(self.labels)
        key = self.rows * n + self.columns
        if either_side:
            key = np.minimum(key, self.columns * n + self.rows)
        order = np.argsort(key, kind="stable")
        again = np.flatnonzero(np.diff(key[order]) == 0)
        if again.size:
            first, second = order[again[0]], order[again[0] + 1]
            what = f"{self._label(self.rows[second])}, {self._label(self.columns[second])}"
            transposed = self.rows[first] != self.rows[second]
            side = ", on the other side of the diagonal" if transposed else ""
            rule = f"must have each entry once, got {what} again after line {self.lines[first]}"
            refuse(self.path, int(self.lines[second]), rule + side)

    def _label(self, row: int) -> str:
        node, component = self.labels[row]
        return f"({node}, {component})" if component else f"{node}"

    def have_transposed(self) -> np.ndarray:
        """For each off-diagonal entry, whether its transposed entry exists."""
        n = len(self.labels)
        off = self.rows != self.columns
        rows, columns = self.rows[off], self.columns[off]
        return np.isin(columns * n + rows, rows * n + columns)

    def matrix(self, complete: bool) -> sp.csr_array:
        """The matrix, with the transposed entries added if `complete`."""
        n = len(self.labels)
        rows, columns, values = self.rows, self.columns, self.values
        if complete:
            off = rows != columns
            rows, columns = np.append(rows, columns[off]), np.append(columns, self.rows[off])
            values = np.append(values, values[off])
        matrix = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(n, n)))
        matrix.sort_indices()
        return matrix
