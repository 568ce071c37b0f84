"""Physical groups of the entities in files of gmsh of format 4, where each may be in several.

Libraries of meshes take the first group of an entity, and refuse files in which one has none.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

# By dimension and number of an entity the numbers of its groups
Groups = dict[tuple[int, int], set[int]]

_FORMAT = re.compile(rb"\$MeshFormat\s+(\d+)(?:\.(\d+))?\s+(\d)\s+(\d+)")
_ENTITIES = re.compile(rb"\$Entities\s*?\n(.*?)\$EndEntities[^\n]*\n?", re.DOTALL)


def without_entities(content: bytes) -> tuple[bytes, Groups | None]:
    """A file without its entities, and their groups; None where it has none, as before format 4."""
    form, entities = _FORMAT.search(content), _ENTITIES.search(content)
    if form is None or entities is None:
        return content, None
    if b"$PartitionedEntities" in content:
        raise ValueError("partitions have groups of their own: save it with Mesh.PartitionOldStyle")
    major, minor, binary, size = (int(x or 0) for x in form.groups())
    is_point_short = (major, minor) != (4, 0)  # a point has three coordinates, not a box
    fields = _Binary(entities[1], size) if binary else _Text(entities[1])
    return content[: entities.start()] + content[entities.end() :], _groups(fields, is_point_short)


def _groups(fields: Any, is_point_short: bool) -> Groups:
    groups: Groups = {}
    for dimension, count in enumerate(fields.sizes(4)):
        for _ in range(count):
            (tag,) = fields.integers(1)
            fields.reals(3 if dimension == 0 and is_point_short else 6)
            # those in which the entity is reversed have negative numbers
            groups[dimension, tag] = {abs(x) for x in fields.integers(*fields.sizes(1))}
            if dimension:
                fields.integers(*fields.sizes(1))
    return groups


class _Text:
    def __init__(self, body: bytes):
        self.words = body.split()
        self.at = 0

    def integers(self, count: int) -> list[int]:
        return [int(x) for x in self._words(count)]

    sizes = integers

    def reals(self, count: int) -> None:
        self._words(count)

    def _words(self, count: int) -> list[bytes]:
        words = self.words[self.at : self.at + count]
        if len(words) < count:
            raise EOFError("entities end too early")
        self.at += count
        return words


class _Binary:
    def __init__(self, body: bytes, size: int):
        self.body = body
        self.size = f"u{size}"
        self.at = 0

    def integers(self, count: int, kind: str = "i4") -> list[int]:
        width = np.dtype(kind).itemsize
        if count * width > len(self.body) - self.at:
            raise EOFError("entities end too early")
        values = np.frombuffer(self.body, dtype=kind, count=count, offset=self.at)
        self.at += count * width
        return [int(x) for x in values]

    def sizes(self, count: int) -> list[int]:
        return self.integers(count, self.size)

    def reals(self, count: int) -> None:
        self.integers(count, "i8")
