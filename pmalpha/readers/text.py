"""Lines of a text file and entries of a matrix in it, and errors with file and line."""

from __future__ import annotations

import codecs
import io
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
import scipy.sparse as sp

from ..errors import warn
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


# ---- unread -------------------------------------------------------------------------------------
# What a reader of meshes meets in a file and does not read: one rule for all formats. A reader
# has a table of what it reads and one of what does not matter, such as output requests.
# Everything else is named. What moves, makes or removes nodes or elements is refused, since the
# mesh would be another one; so are pins and offsets of beams, and commands of Ansys outside of
# its blocks. What is left out beside the rest (masses, springs, ties and other links between
# bodies, and names that the reader has never heard of) is counted and warned of. `ignore`
# silences a name, or a family of names.


class Unread:
    """Of one file: names to be silent about, and what has been left out so far."""

    def __init__(self, file: str, ignore: Iterable[str] = ()):
        if isinstance(ignore, str):
            raise TypeError(f"ignore must be a sequence of names, such as ({ignore!r},)")
        self.file = file
        self.ignore: set[str] = set()
        for name in ignore:
            if not isinstance(name, str) or not name.strip():
                raise TypeError(f"ignore must be a sequence of names, got {name!r}")
            self.ignore.add(name.strip().lstrip("*").upper())
        self._counts: dict[str, dict[str, int]] = {}

    def is_ignored(self, name: str, family: str) -> bool:
        return not self.ignore.isdisjoint((name.upper(), family))

    def leave_out(self, what: str, names: str, family: str, count: int = 1) -> None:
        """Count a name for the warning: `what` has a place for the names, "{} are left out"."""
        if count and not self.is_ignored(names, family):
            counts = self._counts.setdefault(what, {})
            counts[names] = counts.get(names, 0) + count

    def refuse(self, name: str, family: str, where: str, reason: str) -> None:
        """ValueError, unless the name is ignored."""
        if not self.is_ignored(name, family):
            refused_at(where, f"{reason}; ignore=({name!r},) reads the file without it")

    def warn(self) -> None:
        """One warning of all that was left out."""
        said = [
            f"{what.format(', '.join(sorted(counts)))} "
            f"({', '.join(str(counts[name]) for name in sorted(counts))})"
            for what, counts in self._counts.items()
        ]
        if said:
            warn(f"{self.file}: {'; '.join(said)}; ignore= silences a name", UserWarning)
        self._counts = {}


def refused_at(where: str, reason: str) -> NoReturn:
    """ValueError that names file, line and keyword first."""
    raise ValueError(f"{where}: {reason}")


# ---- included -----------------------------------------------------------------------------------
# Files that a file of a mesh includes.

# How often the files may be read, all of them together, and how many may include each other in a
# row.
MOST_OFTEN, MOST_ABOVE = 16, 50


class Included:
    """A file and those that it includes, which may come from a stranger.

    What files include twice, which include others twice, would double with each of them: bytes that
    were read are counted, and those of the different files.
    """

    def __init__(self, path: Path):
        self.folder = path.parent.resolve()
        self.sizes: dict[Path, int] = {}
        self.read = 0

    def open(self, path: Path, where: str) -> TextIOWrapper:
        """The lines of one of the files; ValueError if all were read too often."""
        file = TextIOWrapper(reading(path), encoding="utf-8-sig", errors="replace")
        size = os.fstat(file.fileno()).st_size
        self.sizes[path.resolve()] = size
        self.read += size
        if self.read > MOST_OFTEN * sum(self.sizes.values()):
            file.close()
            refused_at(where, f"all files together must be read at most {MOST_OFTEN} times")
        return file

    def find(self, name: str, above: tuple[Path, ...], where: str) -> Path:
        """The file of this name beside the last of `above`, which include each other in turn.

        It must be in the folder of the first file or below it.
        """
        file = (above[-1].parent / name.replace("\0", "")).resolve()
        try:
            is_file = "\0" not in name and self.folder in file.parents and file.is_file()
        except OSError:  # a name that is too long
            is_file = False
        if not is_file:
            refused_at(
                where, f"must name a file in the folder of the first file or below it, got {name!r}"
            )
        if len(above) > MOST_ABOVE:
            refused_at(where, f"{MOST_ABOVE} files include each other in a row")
        if file in {path.resolve() for path in above}:
            refused_at(where, f"{name!r} includes itself")
        return file
