"""Files that a file of a mesh includes."""

from __future__ import annotations

from pathlib import Path

from .unread import refused_at

# Files that a file may include, those in its includes among them
MOST_INCLUDES = 1000


class Included:
    """Where the files are that one file and its includes name, and how many there were."""

    def __init__(self, path: Path):
        self.folder = path.parent.resolve()
        self.count = 0

    def find(self, name: str, above: tuple[Path, ...], where: str) -> Path:
        """The file of this name beside the last of `above`, which include each other in turn.

        It must be in the folder of the first file or below it: a file may come from a stranger.
        """
        found = (above[-1].parent / name.replace("\0", "")).resolve()
        try:
            is_file = "\0" not in name and self.folder in found.parents and found.is_file()
        except OSError:  # a name that is too long
            is_file = False
        if not is_file:
            refused_at(
                where, f"must name a file in the folder of the first file or below it, got {name!r}"
            )
        if found in {path.resolve() for path in above}:
            refused_at(where, f"{name!r} includes itself")
        self.count += 1
        if self.count > MOST_INCLUDES:
            refused_at(where, f"must include at most {MOST_INCLUDES} files")
        return found
