"""Matrices of Nastran: DMIG entries of a punch file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._checks import fortran_real, listing
from ..files import checked_path
from .bulk import fields_of
from .exported import ExportedMatrix
from .text import Entries, labelled, refuse, text_lines

__all__ = ["read_dmig"]

SYMMETRIC, SQUARE = 6, (1, 2)
REAL, COMPLEX = (1, 2), (3, 4)


class _Field(NamedTuple):
    line: int
    text: str


@dataclass(frozen=True, eq=False)
class _Card:
    """A bulk data entry with its continuations: fields 2 to 9 of every line."""

    line: int
    fields: list[_Field]

    def text(self, i: int) -> str:
        return self.fields[i].text if i < len(self.fields) else ""


def read_dmig(path: str | os.PathLike[str], name: str | None = None) -> ExportedMatrix:
    """Read a matrix of DMIG entries, as in the punch file of Nastran.

    Fields of 8 columns (``DMIG``), of 16 (``DMIG*``) or separated by commas. Other bulk data
    entries of the punch file are ignored.

    Parameters
    ----------
    path : str or path
        The punch file, such as job.pch.
    name : str, optional
        Name of the matrix, such as "KAAX". Default: the only one in the file.

    Returns
    -------
    ExportedMatrix
        Rows in the order of points, then components. Zero rows and columns, which the file omits,
        are missing: see `ExportedMatrix.arranged`.

    Raises
    ------
    OSError
        When the file cannot be read.
    TypeError
        For a wrong type of path.
    ValueError
        With file and line: a complex or a rectangular matrix, a missing header, a field that is not
        a number, repeated entries, in the symmetric form also on both sides of the diagonal, a file
        that ends within an entry. With the names in the file: an unknown name, or several matrices
        and no `name`.

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
        refuse(path, line, f"must be followed by columns of {wanted}, got none")
    index = np.array([term[1:5] for term in terms], dtype=np.int64)
    rows, columns, labels = labelled(index)
    lines, values = np.array([t[0] for t in terms]), np.array([t[5] for t in terms])
    entries = Entries(path, lines, rows, columns, values, labels)
    entries.require_once(either_side=form == SYMMETRIC)
    return ExportedMatrix(entries.matrix(form == SYMMETRIC), labels, wanted)


def _dmig_cards(path: str) -> Iterator[_Card]:
    card: _Card | None = None
    for line in text_lines(path):
        if line.text.startswith("$"):
            continue
        try:
            name, texts, _ = fields_of(line.text)
        except ValueError as error:
            refuse(path, line.number, str(error))
        fields = [_Field(line.number, x) for x in texts]
        if name and name[0] not in "+*":
            if card is not None:
                yield card
            if name.startswith("INCLUDE"):
                refuse(path, line.number, "INCLUDE is not read: give the file that it names")
            card = _Card(line.number, fields) if name.rstrip("*") == "DMIG" else None
        elif card is not None:
            card.fields.extend(fields)
    if card is not None:
        yield card


def _dmig_form(path: str, name: str, cards: Sequence[_Card]) -> int:
    """The form in the header, which must be the first entry and unique."""
    header = cards[0]
    if header.text(1) != "0":
        rule = f"must come after the header of {name}, with 0 in its third field"
        refuse(path, header.line, f"{rule}, got {header.text(1)!r}")
    again = [card.line for card in cards[1:] if card.text(1) == "0"]
    if again:
        refuse(path, again[0], f"must not be a second header of {name}")
    form = _integer(path, header.fields[2], f"form of {name}")
    kind = _integer(path, header.fields[3], f"type of {name}")
    if kind in COMPLEX:
        refuse(path, header.line, f"{name} must be real, type 1 or 2, got complex type {kind}")
    if kind not in REAL:
        refuse(path, header.line, f"{name} must be of type 1 or 2 (real), got {kind}")
    if form not in (SYMMETRIC, *SQUARE):
        rule = f"{name} must be of form 6 (symmetric), 1 or 2 (square)"
        refuse(path, header.line, f"{rule}, got {form}")
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
            refuse(path, value.line, f"{rule}, got none")
        if imaginary.text and _real(path, imaginary) != 0.0:
            rule = "must have no imaginary part, since the type is real"
            refuse(path, imaginary.line, f"{rule}, got {imaginary.text!r}")
        yield value.line, *row, *column, _real(path, value)
    if not any(f.text for f in rest):
        refuse(path, card.line, f"must have rows for column {column}, or is cut off, got none")


def _integer(path: str, field: _Field, what: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,18}", field.text):
        refuse(path, field.line, f"{what} must be a whole number, got {field.text!r}")
    return int(field.text)


def _point(path: str, field: _Field) -> int:
    number = _integer(path, field, "point")
    if number < 1:
        refuse(path, field.line, f"point must be at least 1, got {number}")
    return number


def _component(path: str, field: _Field) -> int:
    """1 to 6 of a grid point, 0 or blank of a scalar point."""
    number = _integer(path, field, "component") if field.text else 0
    if not 0 <= number <= 6:
        refuse(path, field.line, f"component must lie in 0..6, got {number}")
    return number


def _real(path: str, field: _Field) -> float:
    try:
        value = fortran_real(field.text)
    except ValueError:
        value = np.inf
    if not np.isfinite(value):
        refuse(path, field.line, f"value must be a finite number, got {field.text!r}")
    return value
