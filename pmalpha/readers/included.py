"""Files that a file of a mesh includes."""

from __future__ import annotations

import os
from io import TextIOWrapper
from pathlib import Path

from ..files import reading
from .unread import refused_at

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
