"""Ground motion records in the text formats of networks and data bases."""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable
from typing import NamedTuple, NoReturn

import numpy as np

from .._checks import fortran_real
from ..files import checked_path, reading
from ..problem.records import UNIT, Record
from .text import refuse

# ---- peer ---------------------------------------------------------------------------------------
# Ground motion records of the PEER strong-motion database.

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


# ---- records ------------------------------------------------------------------------------------

__all__ = ["read_record"]

_REAL = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+)?"
# CSMIP: "4000 points of accel data equally spaced at .020 sec, in cm/sec2. (8f10.3)"
_CSMIP = re.compile(
    rf"^\s*(\d+)\s+points of accel\w*\.? data,? equally[- ]spaced at\s+({_REAL})\s*sec.*?"
    r"in\s+([\w/^]+)\W*\((\d+)[fFeEgG](\d+)(?:\.(\d+))?",
    re.IGNORECASE,
)
# COSMOS: "12091 acceleration pts, approx  120 secs, units=cm/s^2 (4),Format=(8F10.5)"
_COSMOS = re.compile(
    r"^\s*(\d+)\s+accel\w*\.?\s+(?:pts|points)\.?,?\s*approx\.?\s+(\d+)\s*sec\w*\.?,\s*"
    r"units\s*=([^,]*),\s*Format\s*=\s*\(\s*(\d+)[A-Za-z](\d+)(?:\.(\d+))?",
    re.IGNORECASE,
)
_REAL_HEADER = re.compile(
    r"^\s*(\d+)\s+Real-header values follow on\s+(\d+)\s+lines", re.IGNORECASE
)
# What looks like a heading of a channel, whether it is understood or not
_CHANNEL = re.compile(
    r"(?=.*(?:accel|veloc|displ|\bpoints?\b|\bpts\b|\bsamples\b))(?=.*\d)"
    r".*(?:spaced|approx|format|units|\bsec)",
    re.IGNORECASE,
)
# GeoNet: "Corrected accelerogram 20180212_211554_WPWS_20 GNS Science"
_GEONET = re.compile(r"\s*(un)?corrected accelerogram\b.*\bGNS Science", re.IGNORECASE)
# USGS: "2 CORRECTED ACCELEROGRAM"; 3 to 6 are velocities, displacements and spectra
_SMC = re.compile(
    r"\s*([0-6]) (?:UNKNOWN|(?:UN)?CORRECTED ACCELEROGRAM|VELOCITY|DISPLACEMENT|RESPONSE SPECTRA"
    r"|FOURIER AMPLITUDE)"
)
_END_OF_CHANNEL = re.compile(r"^\s*(?:/&)?\W*end[- ]of[- ]data", re.IGNORECASE)
_UNKNOWN = -999.0
# Times in another unit than seconds, in the lines before two columns; "Ms 6.7" is a magnitude
_MILLISECONDS = re.compile(
    r"[(\[]\s*(?i:ms)\s*[)\]]|[,\s]ms\b(?!\s*[=:]?\s*\d)|\b(?i:msecs?|milliseconds?)\b"
    r"|\b(?i:time|t|dt)[\s,:_]+(?i:ms)\b(?!\s*[=:]?\s*\d)"
)
# Units and headings of what is no acceleration
_OTHER_UNIT = re.compile(
    r"(?:cm|mm|m|in|ft)(?:/(?:s|sec|second))?\W*(?:\(\d+\)\W*)?$", re.IGNORECASE
)
_OTHER_MOTION = re.compile(r"veloc|displ", re.IGNORECASE)
# That of a heading of two columns, "acceleration (m/s^2)"
_UNIT = re.compile(r"[(\[]\s*(g|gal|mg|(?:cm|mm|m|in|ft)/s[^()\[\]]*)\s*[)\]]", re.IGNORECASE)
_NPTS, _DT = (re.compile(rf"\b{word}\b", re.IGNORECASE) for word in ("NPTS", "DT"))
# Times of a list that differ by less than this part of a step are those of equal steps: files have
# few digits.
_EQUAL = 1e-3


class _File(NamedTuple):
    path: str
    lines: list[str]

    @property
    def name(self) -> str:
        return os.path.basename(self.path)


def read_record(path: str | os.PathLike[str]) -> Record:
    """Read a ground motion record; its format is found by what is in the file.

    PEER (``.AT2``, see `read_at2`); corrected records of CSMIP (``.V2``) and of COSMOS (``.V1``,
    ``.V2``), of which the first accelerogram is read: a file in which another heading comes before
    the first one that is understood is refused; of GeoNet (``.V2A``), the first component; of the
    USGS (``.smc``); ESM and ITACA (``.ASC``); K-NET and KiK-net; and two columns, time and value.

    Parameters
    ----------
    path : str or path
        The file.

    Returns
    -------
    Record
        In the unit that the file names, which is the last line of `Record.header`: "unit: cm/s2".
        Values of K-NET are multiplied with the scale factor of the file; their mean is not removed.
        Of two columns with uneven times see `Record.from_times`.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        For a file in none of these formats, a record of velocities or displacements, and with file
        and line for a number of samples that is not that of the header, fields that are not as wide
        as it says, values that are not finite, and times that do not increase.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "valley.txt")
    ...     _ = path.write_text("# time  acceleration\\n0.00 0.1\\n0.02 0.3\\n0.04 -0.2\\n")
    ...     record = read_record(path)
    >>> record.values.tolist(), record.dt
    ([0.1, 0.3, -0.2], 0.02)
    """
    name = str(checked_path(path))
    with reading(path) as file:
        content = file.read().removeprefix(codecs.BOM_UTF8)
    if b"\0" in content:
        refuse(name, 1, "must be text, got a binary file")
    text = _File(name, content.decode("latin-1").splitlines())
    if any(map(_names_steps, text.lines[:10])):
        record = read_at2(path)
        unit = re.search(r"UNITS? OF\s+(\S+)", record.header, re.IGNORECASE)
        return _of_acceleration(text, _with_unit(record, unit[1] if unit else "not given"))
    for read in (_geonet, _smc, _channels, _esm, _k_net, _columns):
        result = read(text)
        if result is not None:
            return _of_acceleration(text, result)
    if "UNCORRECTED" in "".join(text.lines[:3]).upper():
        _refuse_uncorrected(text)
    refuse(
        name,
        1,
        "must be a record of PEER, CSMIP, COSMOS, GeoNet, SMC, ESM, K-NET or two columns of "
        "numbers, got "
        f"{(text.lines or [''])[0].strip()[:60]!r}",
    )


def _names_steps(line: str) -> bool:
    """Whether it has NPTS and after it DT."""
    match = _NPTS.search(line)
    return match is not None and _DT.search(line, match.end()) is not None


def _with_unit(record: Record, unit: str) -> Record:
    header = f"{record.header}\n{UNIT}{unit}".lstrip("\n")
    return Record(record.values, record.dt, record.name, header=header)


def _record(file: _File, values: np.ndarray, dt: float, first: int, unit: str) -> Record:
    if not 0.0 < dt < np.inf:
        refuse(file.path, first, f"the time between samples must be positive, got {dt:g}")
    header = "\n".join(line.strip() for line in file.lines[:first])
    return _with_unit(Record(values, dt, file.name, header=header), unit)


def _of_acceleration(file: _File, record: Record) -> Record:
    unit = record.header.rpartition(UNIT)[2]
    if _OTHER_UNIT.match(unit.strip()):
        refuse(file.path, 1, f"must be a record of accelerations, got the unit {unit}")
    return record


def _channels(file: _File) -> Record | None:
    """The first accelerogram of a file of CSMIP or COSMOS, whose heading has to be understood."""
    dt = np.nan
    for i, line in enumerate(file.lines):
        head = _REAL_HEADER.match(line)
        if head:
            rows = file.lines[i + 1 : i + 1 + int(head[2])]
            dt = _cosmos_step([fortran_real(x) for row in rows for x in row.split()])
        for pattern, read in ((_CSMIP, _csmip), (_COSMOS, _cosmos)):
            match = pattern.match(line)
            if match:
                return read(file, i, match, dt)
        if _END_OF_CHANNEL.match(line) or _is_heading(file.lines, i):
            _refuse_heading(file, i)
    return None


def _is_heading(lines: list[str], i: int) -> bool:
    """Whether a line looks like the heading of a channel; two columns of numbers are none."""
    if not _CHANNEL.match(lines[i]):
        return False
    if "accel" in lines[i].lower() and _OTHER_MOTION.search(lines[i]):
        return False  # "points of corrected accel, velocity and displacement data"
    following = next((x.split() for x in lines[i + 1 :] if x.strip()), [])
    return len(following) != 2 and _are_numbers_that_touch(following)


def _are_numbers_that_touch(words: list[str]) -> bool:
    return bool(words) and all(re.fullmatch(r"[-+.\dEeDd]+", word) for word in words)


def _refuse_heading(file: _File, i: int) -> None:
    line = file.lines[i].strip()
    if _OTHER_MOTION.search(line):
        refuse(file.path, i + 1, f"must be a record of accelerations, got {line[:90]!r}")
    refuse(
        file.path,
        i + 1,
        "the heading of the first channel must be as in '5 points of accel data equally spaced at "
        ".020 sec, in cm/sec2. (8f10.3)' or '5 acceleration pts, approx 1 secs, units=cm/s^2, "
        f"Format=(8F10.5)', got {line[:90]!r}",
    )


def _csmip(file: _File, i: int, match: re.Match[str], dt: float) -> Record:
    values = _fixed(file, i + 1, int(match[1]), int(match[4]), int(match[5]), match[6])
    return _record(file, values, fortran_real(match[2]), i + 1, match[3])


def _cosmos(file: _File, i: int, match: re.Match[str], dt: float) -> Record:
    count, seconds = int(match[1]), int(match[2])
    if not abs(count * dt - seconds) <= 1.0 + 1e-2 * seconds:
        rule = f"the step of the header must fit {count} samples in {seconds} s, got {dt:g}"
        refuse(file.path, i + 1, rule)
    values = _fixed(file, i + 1, count, int(match[4]), int(match[5]), match[6])
    return _record(file, values, dt, i + 1, match[3].strip())


def _cosmos_step(values: list[float]) -> float:
    """Value 62 is the step of the record in ms, value 34 that of the recorder in s."""
    for i, factor in ((61, 1e-3), (33, 1.0)):
        if i < len(values) and values[i] not in (_UNKNOWN, 0.0):
            return factor * values[i]
    return np.nan


def _geonet(file: _File) -> Record | None:
    """The first component: 16 lines of text, 40 whole numbers, 60 real ones, accelerations."""
    match = _GEONET.match(file.lines[0]) if file.lines else None
    if match is None:
        return None
    if match[1]:
        _refuse_uncorrected(file)
    integers = _header_numbers(file, 16, 4, 10, 8)
    reals = _header_numbers(file, 20, 6, 10, 8)
    count, seconds, dt = int(integers[33]), reals[23], reals[25]
    if not abs((count - 1) * dt - seconds) <= 0.01 + 1e-4 * seconds:  # which have two decimals
        rule = f"the step of the header must fit {count} samples in {seconds:g} s, got {dt:g}"
        refuse(file.path, 23, rule)
    return _record(file, _fixed(file, 26, count, 10, 8, None), dt, 26, "mm/s^2")


def _smc(file: _File) -> Record | None:
    """11 lines of text, 48 whole numbers, 50 real ones, comments, accelerations in cm/s^2."""
    match = _SMC.match(file.lines[0]) if file.lines else None
    if match is None:
        return None
    if match[1] == "1":
        _refuse_uncorrected(file)
    if match[1] != "2":
        got = file.lines[0].strip()
        refuse(file.path, 1, f"must be a record of accelerations, got {got!r}")
    integers = _header_numbers(file, 11, 6, 8, 10)
    reals = _header_numbers(file, 17, 10, 5, 15)
    comments, count, rate = int(integers[15]), int(integers[16]), reals[1]
    if not (comments >= 0 and count > 0):
        got = f"got {comments} and {count}"
        refuse(file.path, 13, f"the numbers of comments and samples must be positive, {got}")
    if not 0.0 < rate < reals[0]:  # that for which a value is not known
        refuse(file.path, 18, f"the sampling rate must be positive and known, got {rate:g}")
    first = 27 + comments
    # 8 in the 47th place: with the digits of double precision
    columns, width, digits = (5, 14, "7") if integers[46] == 8 else (8, 10, "4")
    values = _fixed(file, first, count, columns, width, digits)
    return _record(file, values, 1.0 / rate, first, "cm/s^2")


def _header_numbers(file: _File, first: int, lines: int, columns: int, width: int) -> np.ndarray:
    if len(file.lines) < first + lines:
        refuse(file.path, len(file.lines), f"must have a header of {first + lines} lines and more")
    return _fixed(file, first, lines * columns, columns, width, None)


def _refuse_uncorrected(file: _File) -> NoReturn:
    rule = "must be a corrected record, such as .V2 of CSMIP, got an uncorrected one"
    refuse(file.path, 1, rule)


def _esm(file: _File) -> Record | None:
    pairs = [line.partition(":") for line in file.lines]
    first = next((i for i, (_, colon, _) in enumerate(pairs) if not colon), len(pairs))
    fields = {key.strip().upper(): value.strip() for key, _, value in pairs[:first]}
    if not {"SAMPLING_INTERVAL_S", "NDATA", "UNITS"} <= set(fields):
        return None
    values = _free(file, first, int(fields["NDATA"]))
    dt = fortran_real(fields["SAMPLING_INTERVAL_S"])
    return _record(file, values, dt, first, fields["UNITS"])


def _k_net(file: _File) -> Record | None:
    text = {line[:18].strip(): line[18:].strip() for line in file.lines[:17]}
    scale = re.match(rf"({_REAL})\((\w+)\)/({_REAL})", text.get("Scale Factor", ""))
    rate = re.match(rf"({_REAL})\s*Hz", text.get("Sampling Freq(Hz)", ""))
    if not scale or not rate:
        return None
    rate_of = fortran_real(rate[1])
    if not rate_of > 0.0:
        refuse(file.path, 1, f"the sampling rate must be positive, got {rate[1]} Hz")
    factor = fortran_real(scale[1]) / fortran_real(scale[3])
    first = 1 + next((i for i, x in enumerate(file.lines) if x.startswith("Memo")), -1)
    if first == 0:
        refuse(file.path, 1, "must have a line Memo before the samples")
    seconds = re.match(_REAL, text.get("Duration Time(s)", ""))
    count = round(fortran_real(seconds[0]) * rate_of) if seconds else None
    return _record(file, factor * _free(file, first, count), 1.0 / rate_of, first, scale[2])


def _columns(file: _File) -> Record | None:
    """Lines of text, then lines of time and value; None for anything else."""
    rows = [re.split(r"[\s,;]+", line.strip()) for line in file.lines]
    first = next((i for i, row in enumerate(rows) if len(row) == 2 and _are_numbers(row)), None)
    if first is None:
        return None
    if any(_MILLISECONDS.search(line) for line in file.lines[:first]):
        refuse(file.path, first, "times must be in seconds, got milliseconds in the header")
    titles = next((x for x in reversed(file.lines[:first]) if x.strip()), "")
    if re.match(r"\W*(?:t|time)\b", titles, re.IGNORECASE) and _OTHER_MOTION.search(titles):
        if "accel" not in titles.lower():
            refuse(file.path, first, f"must be a record of accelerations, got {titles.strip()!r}")
    units = [x.strip() for line in file.lines[:first] for x in _UNIT.findall(line)]
    unit = units[-1] if units else "not given"
    values = _free(file, first, width=2).reshape(-1, 2)
    t, a = values.T
    steps = np.diff(t)
    if t.size < 2 or not (steps > 0.0).all():
        wrong = first + 2 + int(np.argmin(steps > 0.0)) if t.size > 1 else first + 1
        refuse(file.path, wrong, "times must increase")
    dt = float((t[-1] - t[0]) / (t.size - 1))
    if np.abs(steps - dt).max() > _EQUAL * dt + np.spacing(np.abs(t).max()) * 4:
        record = Record.from_times(t - t[0], a)
        header = "\n".join(file.lines[:first])
        record = Record(record.values, record.dt, file.name, header=header)
        return _with_unit(record, unit)
    digits = float(f"{dt:.6g}")  # that of a file that gives times with few digits
    return _record(file, a, digits, first, unit)


def _are_numbers(words: list[str]) -> bool:
    try:
        return bool(np.isfinite([fortran_real(x) for x in words]).all())
    except ValueError:
        return False


def _fixed(
    file: _File, first: int, count: int, columns: int, width: int, digits: str | None
) -> np.ndarray:
    """The numbers in columns of fixed width, which may follow each other without a blank.

    digits: of each number after the point, by the format; those of numbers that touch are counted.
    """
    lines = -(-count // columns)

    def split(line: str) -> list[str]:
        fields = [line[k * width : (k + 1) * width] for k in range(columns)]
        for one, other in zip(fields, fields[1:]):
            touch = one[-1:].strip() and other[:1].strip() not in ("", "+", "-")
            if touch and digits and not all(_has_digits(x, int(digits)) for x in (one, other)):
                return ["a field of another width"]
        if line[columns * width :].strip():
            return ["a longer line"]
        return [x.strip() for x in fields]

    return _numbers(file, first, file.lines[first : first + lines], count, split)


def _has_digits(field: str, digits: int) -> bool:
    return len(re.split("[EeDd]", field.strip().partition(".")[2])[0]) == digits


def _free(
    file: _File, first: int, count: int | None = None, width: int | None = None
) -> np.ndarray:
    """The numbers between blanks, commas or semicolons up to the end of the file."""

    def split(line: str) -> list[str]:
        words = [x for x in re.split(r"[\s,;]+", line.strip()) if x]
        return words if width is None or len(words) in (0, width) else ["a line of another length"]

    return _numbers(file, first, file.lines[first:], count, split)


def _numbers(
    file: _File, first: int, lines: list[str], count: int | None, split: Callable[[str], list[str]]
) -> np.ndarray:
    values: list[float] = []
    for i, line in enumerate(lines, start=first + 1):
        words = [x for x in split(line) if x]
        if not _are_numbers(words):
            refuse(file.path, i, f"must hold finite numbers, got {line.strip()[:60]!r}")
        values += [fortran_real(x) for x in words]
    if count is not None and len(values) != count:
        refuse(file.path, first, f"must give {count} samples, got {len(values)}")
    if not values:
        refuse(file.path, first, "must give samples, got none")
    return np.array(values)
