"""What a reader of meshes meets in a file and does not read: one rule for all formats.

A reader has a table of what it reads and one of what does not matter, such as output requests.
Everything else is named. What moves, makes or removes nodes or elements is refused, since the mesh
would be another one; so are pins and offsets of beams, and commands of Ansys outside of its blocks.
What is left out beside the rest (masses, springs, ties and other links between bodies, and names
that the reader has never heard of) is counted and warned of. `ignore` silences a name, or a family
of names.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NoReturn

from ..errors import warn


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
