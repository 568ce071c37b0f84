"""Harwell-Boeing files, as ``HBMAT`` of ANSYS writes them, with its mapping file."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .._checks import counted, fortran_real
from ..files import checked_path, reading
from .exported import ExportedMatrix
from .text import Entries, refuse, text_lines

__all__ = ["read_harwell_boeing"]

# Of formats such as (8I10), (d25.15), (1P,5E16.9): numbers in a line, the kind, and their width
FORMAT = re.compile(r"\((?:1P,?)?(\d*)([IEDFG])(\d+)(?:\.(\d+)(?:E\d+)?)?\)")
TYPES = "RSA (symmetric) and RUA (unsymmetric)"
# Names of dofs in the mapping file and their components
COMPONENTS = {"UX": 1, "UY": 2, "UZ": 3, "ROTX": 4, "ROTY": 5, "ROTZ": 6}
HEADER = 4
# Of what is converted at once
WHOLE, REAL = re.compile("[0-9 ]*"), re.compile("[0-9.E+ -]*")


class Block(NamedTuple):
    """Lines of numbers of one width: the first line, from 0, and what they are."""

    begin: int
    end: int
    entries: int
    width: int
    per_line: int
    what: str
    decimals: int


def read_harwell_boeing(
    path: str | os.PathLike[str], mapping: str | os.PathLike[str] | None = None
) -> ExportedMatrix:
    """Read a real matrix in Harwell-Boeing format, such as of ``HBMAT`` of ANSYS.

    Of a symmetric one (RSA) the file has a triangle, and the other is added; an unsymmetric one
    (RUA) is as written. A right-hand side after the matrix is not read.

    Parameters
    ----------
    path : str or path
        The file, such as stiff.matrix.
    mapping : str or path, optional
        The mapping file, such as stiff.mapping: a line for each row with its number, node and dof,
        UX to ROTZ or 1 to 6. Default: the labels of the rows are (row, 0), rows from 1.

    Returns
    -------
    ExportedMatrix
        Rows in the order of the file.

    Raises
    ------
    OSError
        When a file cannot be read.
    TypeError
        For a wrong type of path.
    ValueError
        With file and line: other types than RSA and RUA, numbers that are not as the header says,
        indices out of range, repeated entries, a mapping with other rows than the matrix.

    Examples
    --------
    >>> import os, tempfile
    >>> from pmalpha.readers import read_harwell_boeing
    >>> lines = ["a spring", "9 3 3 3 0", "RSA 2 2 3 0", "(1I14) (1I14) (1D25.15)"]
    >>> lines += ["1", "3", "4", "1", "2", "2", "0.2d+01", "-0.1d+01", "0.1d+01"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path, mapping = (os.path.join(folder, x) for x in ("stiff.matrix", "stiff.mapping"))
    ...     with open(path, "w") as file, open(mapping, "w") as rows:
    ...         _ = file.write("".join(f"{line}\\n" for line in lines))
    ...         _ = rows.write("1 7 UX\\n2 9 UX\\n")
    ...     K = read_harwell_boeing(path, mapping)
    >>> K.matrix.toarray().tolist(), K.labels.tolist()
    ([[2.0, -1.0], [-1.0, 1.0]], [[7, 1], [9, 1]])
    """
    path = str(checked_path(path))
    lines = _lines(path)
    kind, n, blocks = _header(path, lines)
    pointers, rows = (_numbers(path, lines, block, _index) for block in blocks[:2])
    values = _numbers(path, lines, blocks[2], _real if blocks[2].decimals else fortran_real)
    _check_indices(path, blocks, n, pointers, rows)
    columns = np.repeat(np.arange(n), np.diff(pointers))
    labels = np.column_stack([np.arange(1, n + 1), np.zeros(n, dtype=np.int64)])
    numbers = blocks[2].begin + 1 + np.arange(len(values)) // blocks[2].per_line
    entries = Entries(path, numbers, rows - 1, columns, values, labels)
    entries.require_once(either_side=kind == "RSA")
    if mapping is not None:
        labels = _mapping(str(checked_path(mapping)), n)
    return ExportedMatrix(entries.matrix(kind == "RSA"), labels, os.path.basename(path))


def _lines(path: str) -> list[str]:
    """All lines, those of the header too that are blank."""
    with io.TextIOWrapper(reading(path), encoding="latin-1", newline=None) as file:
        text = file.read()
    if "\0" in text:
        refuse(path, 1, "must be text, got a binary file: give HBMAT the form ASCII")
    lines = text.split("\n")
    if lines.pop():
        refuse(path, len(lines) + 1, "must end with a new line, or is cut off")
    return lines


def _header(path: str, lines: list[str]) -> tuple[str, int, tuple[Block, Block, Block]]:
    """Type, number of rows, and the blocks of pointers, rows and values."""
    if len(lines) < HEADER:
        refuse(path, len(lines), f"must have {HEADER} lines of a header at least")
    cards = [_whole(path, 2, word) for word in lines[1].split()]
    words = lines[2].split()
    kind = words[0].upper() if words else ""
    if kind not in ("RSA", "RUA"):
        refuse(path, 3, f"the type must be one of {TYPES}, got {kind!r}")
    sizes = [_whole(path, 3, word) for word in words[1:]]
    if len(cards) < HEADER or len(sizes) < 3 or min(cards + sizes) < 0:
        refuse(path, 2, "numbers of lines, rows, columns and entries must follow each other")
    n, columns, entries = sizes[:3]
    if n != columns or n == 0:
        refuse(path, 3, f"the matrix must be square, got {n} rows and {columns} columns")
    begin = HEADER + (len(cards) > HEADER and cards[4] > 0)
    counts, names = (n + 1, entries, entries), ("pointers", "rows", "values")
    blocks = []
    for count, card, text, what in zip(counts, cards[1:4], lines[3].split(), names):
        match = FORMAT.fullmatch(text.upper())
        if match is None or (match[2] == "I") == (what == "values") or not int(match[3]):
            refuse(path, 4, f"the format of {what} must be as (8I10) or (1d25.15), got {text!r}")
        per_line = int(match[1] or 1)
        if card != -(-count // max(per_line, 1)) or begin + card > len(lines):
            rule = f"{count} {what} must be in {counted(card, 'line')} of up to {per_line}"
            refuse(path, 2, f"{rule}, after line {begin} of {len(lines)}")
        blocks.append(
            Block(begin, begin + card, count, int(match[3]), per_line, what, int(match[4] or 0))
        )
        begin += card
    if len(blocks) < 3:
        refuse(path, 4, f"must have formats of pointers, rows and values, got {lines[3]!r}")
    return kind, n, (blocks[0], blocks[1], blocks[2])


def _whole(path: str, line: int, text: str) -> int:
    try:
        return _index(text)
    except ValueError:
        refuse(path, line, f"must have whole numbers, got {text!r}")


def _index(text: str) -> int:
    if not text.strip().isascii() or not text.strip().isdigit():
        raise ValueError(f"must have whole numbers, got {text!r}")
    if len(text.strip()) > 18:
        raise ValueError("must have whole numbers below 1e18")
    return int(text)


def _real(text: str) -> float:
    """Fortran takes digits after the point from the format where a field has none."""
    if text.strip().lstrip("+-").isdigit():
        raise ValueError(f"must have a point or an exponent in each value, got {text.strip()!r}")
    return fortran_real(text)


def _numbers(
    path: str, lines: list[str], block: Block, number_of: Callable[[str], Any]
) -> np.ndarray:
    """Of fields of one width; one number in a line may be written anywhere in it."""
    fields: list[str] = []
    for i in range(block.begin, block.end):
        line, left = lines[i].rstrip(), min(block.per_line, block.entries - len(fields))
        of_line = [line[j : j + block.width] for j in range(0, len(line), block.width)]
        if left == 1 and len(line.split()) == 1:
            of_line = [line]
        if len(of_line) != left:
            rule = f"must have {left} {block.what} of width {block.width}"
            refuse(path, i + 1, f"{rule}, got {len(of_line)}")
        fields += of_line
    bare = number_of is _real and any(field.strip().lstrip("+-").isdigit() for field in fields)
    array = None if bare else _converted(fields, number_of is _index)
    if array is None:
        numbers = []
        for i, field in enumerate(fields):
            try:
                numbers.append(number_of(field))
            except ValueError as error:
                refuse(path, block.begin + i // block.per_line + 1, str(error))
        array = np.array(numbers)
    if not np.isfinite(array).all():
        i = block.begin + int(np.argmin(np.isfinite(array))) // block.per_line
        refuse(path, i + 1, "must have finite numbers")
    return array


def _converted(fields: list[str], are_whole: bool) -> np.ndarray | None:
    """All at once; None for fields of which one has to be looked at."""
    text = " ".join(fields).upper().replace("D", "E")
    words = text.split()
    if len(words) != len(fields) or (WHOLE if are_whole else REAL).fullmatch(text) is None:
        return None
    try:
        return np.array(words, dtype=np.int64 if are_whole else np.float64)
    except (ValueError, OverflowError):
        return None


def _check_indices(
    path: str, blocks: tuple[Block, Block, Block], n: int, pointers: np.ndarray, rows: np.ndarray
) -> None:
    if pointers[0] != 1 or pointers[-1] != len(rows) + 1 or (np.diff(pointers) < 0).any():
        rule = f"pointers must go from 1 to the number of entries + 1, {len(rows) + 1}, and never"
        refuse(path, blocks[0].begin + 1, f"{rule} down, got {pointers[0]} to {pointers[-1]}")
    wrong = np.flatnonzero((rows < 1) | (rows > n))
    if wrong.size:
        line = blocks[1].begin + int(wrong[0]) // blocks[1].per_line + 1
        refuse(path, line, f"rows must be 1 to {n}, got {rows[wrong[0]]}")


def _mapping(path: str, n: int) -> np.ndarray:
    """Labels (n, 2) from lines of row, node and dof, after what else is at the top."""
    labels: dict[int, tuple[int, int]] = {}
    for line in text_lines(path):
        words = line.text.split()
        if not labels and not (len(words) == 3 and words[0].isdigit()):
            continue
        if len(words) != 3:
            refuse(path, line.number, f"must have row, node and dof, got {line.text.strip()!r}")
        row, node = (_whole(path, line.number, word) for word in words[:2])
        name = words[2].upper()
        component = COMPONENTS.get(name)
        if component is None and name in map(str, COMPONENTS.values()):
            component = int(name)
        if component is None:
            refuse(path, line.number, f"dof must be of {', '.join(COMPONENTS)}, got {name!r}")
        if row in labels or not 1 <= row <= n:
            refuse(path, line.number, f"rows must be 1 to {n}, each once, got {row}")
        labels[row] = (node, component)
    if len(labels) < n:
        raise ValueError(f"{path} must have {counted(n, 'row')} of the matrix, got {len(labels)}")
    return np.array([labels[row] for row in range(1, n + 1)], dtype=np.int64)
