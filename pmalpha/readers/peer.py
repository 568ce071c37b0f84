"""Ground motion records of the PEER strong-motion database."""

from __future__ import annotations

import os
import re

import numpy as np

from ..files import checked_path, reading
from ..problem.record import Record
from .text import refuse

__all__ = ["read_at2"]

# An exponent has two digits where the next field follows without a blank: 0.1000E-010.2000E-01
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?(?:\d+(?![\d.])|\d\d(?=\d*\.)))?"
NO_NUMBER = re.compile(rf"(?!{NUMBER}|[+-]?(?:nan|inf))", re.IGNORECASE)
# Two fields without a blank, of which no rule says where one ends: 10.1234510.23456
TOUCHING = re.compile(r"\.\d+\.")
# The line of a header with the number of samples and the time between them. "NPTS=  4000, DT=
# .0050 SEC" is that of today; before, the numbers came first: "4000  0.0050  NPTS, DT", on one line
# or with the labels on the line above or below.
COUNT = re.compile(r"NPTS\s*[=:]\s*(\d+)", re.IGNORECASE)
STEP = re.compile(rf"\bDT\s*[=:]\s*({NUMBER})", re.IGNORECASE)
LABELS = re.compile(r"NPTS\s*(?:,\s*)?DT", re.IGNORECASE)
NUMBERS = re.compile(rf"^\s*(\d+)(?:\s*,)?\s+({NUMBER})\s*,?\s*(?:SEC\b)?", re.IGNORECASE)
TITLE_LINES = 8  # maximum number of lines of a header


def read_at2(path: str | os.PathLike[str]) -> Record:
    """Read a ground motion record in the text format of PEER.

    A header of some lines, whose last gives the number of samples and the time between them, as
    ``NPTS=  4000, DT=   .0050 SEC`` or in the old forms ``4000  0.0050  NPTS, DT``, on one line or
    on two. Then the samples, any number in a line; text may follow the last one. The files of
    velocities (.VT2) and displacements (.DT2) have the same form.

    Parameters
    ----------
    path : str or path
        The file, such as RSN6_IMPVALL.I_I-ELC180.AT2.

    Returns
    -------
    Record
        Its values are in the unit that the header names: for .AT2 files g, so that
        ``9.81 * record`` is in m/s^2; its dt is in s. Its name is that of the file, its header
        the lines of the header, without the blanks at their ends. ``values, dt = record``.

    Raises
    ------
    ValueError
        For a file without such a header, with samples that are not numbers or not finite, or
        whose number of samples is not that of the header, with file and line.
    OSError
        When the file cannot be read.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> text = "PEER\\nA VALLEY\\nUNITS OF G\\nNPTS=  3, DT=   .0050 SEC\\n .1E-01 -.2E-01\\n .3\\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "record.AT2")
    ...     _ = path.write_text(text)
    ...     record = read_at2(path)
    >>> record.values.tolist(), record.dt, record.header.splitlines()[1]
    ([0.01, -0.02, 0.3], 0.005, 'A VALLEY')
    """
    name = str(checked_path(path))
    with reading(path) as file:
        content = file.read()
    if b"\0" in content:
        refuse(name, 1, "must be text, got a binary file")
    lines = [line.rstrip() for line in content.decode("latin-1").splitlines()]
    count, dt, first = _header(name, lines)
    values = _samples(name, lines, first, count)
    if values.size != count:
        rule = f"must give the number of samples, got NPTS = {count} and {values.size} samples"
        refuse(name, first, rule)
    header = "\n".join(line.strip() for line in lines[:first])
    return Record(values, dt, os.path.basename(name), header=header)


def _labelled(line: str) -> tuple[str, str] | None:
    """The words of "NPTS= ..., DT= ...", of the first NPTS and the first DT after it.

    One search after the other: a pattern of both, over a long line, would take its square.
    """
    count = COUNT.search(line)
    step = STEP.search(line, count.end()) if count else None
    return (count[1], step[1]) if count and step else None


def _header(name: str, lines: list[str]) -> tuple[int, float, int]:
    """Number of samples, time between them, and index of the first line with samples."""
    for i, line in enumerate(lines[:TITLE_LINES]):
        words, last = _labelled(line), i
        if words is None and LABELS.search(line):
            for last in (i, i + 1, i - 1):  # numbers on this line, below or above
                match = NUMBERS.match(lines[last]) if 0 <= last < len(lines) else None
                if match is not None:
                    words = match[1], match[2]
                    break
        if words is None:
            continue
        last = max(last, i)
        count, dt = int(words[0]), _number(words[1])
        if not (count > 0 and 0.0 < dt < np.inf):
            refuse(name, i + 1, f"NPTS and DT must be positive, got {line.strip()!r}")
        return count, dt, last + 1
    got = lines[0][:60] if lines else ""
    refuse(name, 1, f"must begin with a header that gives NPTS and DT, got {got!r}")


def _samples(name: str, lines: list[str], first: int, count: int) -> np.ndarray:
    """The numbers of the lines; a line of text may follow the last of them."""
    samples: list[float] = []
    for i, line in enumerate(lines[first:], start=first + 1):
        if len(samples) == count and NO_NUMBER.match(line.strip()):
            break
        if re.sub(NUMBER, "", line).strip():
            refuse(name, i, f"must hold finite numbers, got {line.strip()[:60]!r}")
        if TOUCHING.search(line):
            refuse(name, i, f"must have blanks between its numbers, got {line.strip()[:60]!r}")
        row = [_number(word) for word in re.findall(NUMBER, line)]
        if not np.all(np.isfinite(row)):
            refuse(name, i, f"must hold finite numbers, got {line.strip()[:60]!r}")
        samples += row
    return np.array(samples)


def _number(word: str) -> float:
    """A number of Fortran: also with the exponent 1.0D-03."""
    return float(word.upper().replace("D", "E"))
