"""Lines of a text file, and errors with file and line."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import NamedTuple, NoReturn

from ..files import reading


class Line(NamedTuple):
    number: int
    text: str


def refuse(path: str, line: int, rule: str) -> NoReturn:
    """Raise a ValueError with file and line."""
    raise ValueError(f"{path}, line {line}: {rule}")


def text_lines(path: str) -> Iterator[Line]:
    """The lines that are not blank; ValueError for a binary file or one that ends in a line."""
    with io.TextIOWrapper(reading(path), encoding="latin-1", newline=None) as file:
        for number, text in enumerate(file, start=1):
            if "\0" in text:
                refuse(path, number, "must be text, got a binary file")
            if text.strip():
                if not text.endswith("\n"):
                    end = text.strip()[-30:]
                    refuse(path, number, f"must end with a new line, or is cut off, got {end!r}")
                yield Line(number, text.rstrip())
