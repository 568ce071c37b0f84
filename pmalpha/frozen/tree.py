"""A tree of None, numbers, words, arrays, tuples and dicts as the bytes of a file.

The form is that of csrc/core/describe/file.h: what the core is made of, written down.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from hashlib import blake2b
from typing import Any

import numpy as np

from .. import _core

FORMAT = 2
HEADER, NODE = 64, 40
ORDER = 0x01020304
TEXT, ARRAY = 8, 64  # alignment
NONE, INTEGER, REAL, WORD, TUPLE, DICT = range(6)
ARRAYS = {np.dtype(np.float64): 6, np.dtype(np.int64): 7, np.dtype(np.int32): 8}


# Nodes that one array may have: readers take what all nodes ask for up to this times the file.
SHARES = 8


class _Data:
    """What nodes point to, behind them: equal words once, equal arrays for up to eight nodes."""

    def __init__(self) -> None:
        self.pieces: list[tuple[int, Any]] = []  # alignment, bytes
        self.known: dict[Any, tuple[int, int]] = {}  # number of the piece, uses of it

    def add(self, key: Any, alignment: int, content: Any) -> int:
        """The number of the piece."""
        number, uses = self.known.get(key, (-1, 0))
        if number < 0 or (alignment == ARRAY and uses == SHARES):
            number, uses = len(self.pieces), 0
            self.pieces.append((alignment, content))
        self.known[key] = number, uses + 1
        return number

    def places(self, begin: int) -> list[int]:
        """Where each piece begins, and the end."""
        places = []
        for alignment, content in self.pieces:
            begin = -(-begin // alignment) * alignment
            places.append(begin)
            begin += memoryview(content).nbytes
        return [*places, -(-begin // 8) * 8]


def file_of(tree: Any) -> bytearray:
    """The bytes of a file with this tree.

    Raises TypeError for anything that is no data, with its place in the tree.
    """
    nodes: list[tuple[Any, ...]] = []  # kind, axes, three extents, content
    data, items = _Data(), [(tree, "")]
    at = 0
    while at < len(items):
        item, place = items[at]
        nodes.append(_node(item, place, data, items))
        at += 1
    begin = HEADER + NODE * len(nodes)
    places = data.places(begin)
    result = bytearray(places[-1])
    for i, (kind, axes, extents, content) in enumerate(nodes):
        value = struct.pack("<q", places[content]) if kind in (WORD, *ARRAYS.values()) else content
        struct.pack_into("<II3q8s", result, HEADER + NODE * i, kind, axes, *extents, value)
    for (_, content), begin_of in zip(data.pieces, places):
        flat = memoryview(content).cast("B")
        result[begin_of : begin_of + flat.nbytes] = flat
    total = _core.check_sum(memoryview(result)[HEADER:])
    header = b"pmalpha\0", FORMAT, ORDER, len(result), len(nodes), begin, total
    struct.pack_into("<8sIIQQQQ", result, 0, *header)
    return result


def _node(item: Any, place: str, data: _Data, items: list[tuple[Any, str]]) -> tuple[Any, ...]:
    """A node; its children are added to what is to be made nodes of."""
    if item is None:
        return NONE, 0, (0, 0, 0), bytes(8)
    if isinstance(item, (bool, int, np.integer)):
        return INTEGER, 0, (0, 0, 0), struct.pack("<q", int(item))
    if isinstance(item, (float, np.floating)):
        return REAL, 0, (0, 0, 0), struct.pack("<d", float(item))
    if isinstance(item, str):
        text = item.encode()
        return WORD, 0, (len(text), 0, 0), data.add(text, TEXT, text + b"\0")
    if isinstance(item, np.ndarray) and item.dtype in ARRAYS and 1 <= item.ndim <= 3:
        array = np.ascontiguousarray(item)
        kind = ARRAYS[item.dtype]
        flat = array.reshape(-1).view(np.uint8)
        key = kind, array.shape, blake2b(flat.data, digest_size=16).digest()
        extents = (*array.shape, *(0,) * (3 - array.ndim))
        return kind, array.ndim, extents, data.add(key, ARRAY, flat.data)
    pairs = _pairs(item)
    if pairs is not None:
        family = [(x, f"{place}.{key}") for key, value in pairs for x in (key, value)]
        return _parent(DICT, family, items)
    if isinstance(item, tuple):
        return _parent(TUPLE, [(x, f"{place}[{i}]") for i, x in enumerate(item)], items)
    raise TypeError(f"{place.lstrip('.')} is no data that a file can have, got {item!r}")


def _pairs(item: Any) -> Any:
    """Keys and values of a dict or a named tuple, None of anything else."""
    if isinstance(item, Mapping):
        return item.items()
    fields = getattr(item, "_fields", None)
    return zip(fields, item) if isinstance(item, tuple) and fields is not None else None


def _parent(
    kind: int, family: list[tuple[Any, str]], items: list[tuple[Any, str]]
) -> tuple[Any, ...]:
    first = len(items)
    items.extend(family)
    return kind, 0, (len(family), 0, 0), struct.pack("<q", first)
