"""The arrays of which a sparse matrix of scipy.sparse consists, checked before SciPy uses them.

SciPy's compiled conversions do not check them again: arrays that were changed by hand end the
process there, or give another matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import Any

import numpy as np

LONGEST = np.iinfo(np.int32).max


def check_arrays(value: Any, name: str) -> None:
    """ValueError for a sparse matrix whose arrays do not fit each other or its shape."""
    if value.ndim != 2:
        raise ValueError(f"{name} must be 2-D when sparse, got shape {value.shape}")
    check = _CHECKS.get(value.format)
    if check is None:  # SciPy converts these in Python, with checks of its own
        return
    try:
        check(value, name)
    except ValueError as error:
        raise ValueError(f"{error}, in a damaged {value.format} matrix") from None


def _by_blocks(value: Any, name: str) -> None:
    shape, blocks = value.shape, np.shape(value.data)
    if len(blocks) != 3 or 0 in blocks[1:] or any(n % b for n, b in zip(shape, blocks[1:])):
        raise ValueError(f"{name} must have blocks that divide {shape}, got data of shape {blocks}")
    _compressed(value, (shape[0] // blocks[1], shape[1] // blocks[2]), 3, name)


def _compressed(value: Any, shape: tuple[int, int], ndim: int, name: str) -> None:
    """indptr, indices and data of a matrix by rows, columns or blocks."""
    major, minor = shape
    start = _whole(value.indptr, f"{name} must have an indptr", major + 1)
    if start[0] != 0:
        raise ValueError(f"{name} must have an indptr that begins with 0, got {start[0]}")
    falls = np.flatnonzero(start[1:] < start[:-1])
    if falls.size:
        k = int(falls[0])
        raise ValueError(
            f"{name} must have an indptr that does not decrease, got {start[k + 1]} after "
            f"{start[k]} at {k + 1}"
        )
    index = _whole(value.indices, f"{name} must have indices")
    data = _array(value.data, f"{name} must have data", ndim)
    if index.size != len(data):
        what = "data" if ndim == 1 else "blocks"
        raise ValueError(
            f"{name} must have as many indices as {what}, got {index.size} and {len(data)}"
        )
    if start[-1] > index.size or (ndim == 3 and start[-1] < index.size):  # SciPy drops no blocks
        raise ValueError(
            f"{name} must have {start[-1]} entries as its indptr has, got {index.size}"
        )
    _within(index[: start[-1]], 0, minor - 1, f"{name} must have indices")


def _by_entries(value: Any, name: str) -> None:
    data = _array(value.data, f"{name} must have data", 1)
    for index, size in zip((value.row, value.col), value.shape):
        index = _whole(index, f"{name} must have indices", data.size)
        _within(index, 0, size - 1, f"{name} must have indices")


def _by_diagonals(value: Any, name: str) -> None:
    data = _array(value.data, f"{name} must have data", 2)
    offsets = _whole(value.offsets, f"{name} must have offsets", len(data))
    _within(offsets, -LONGEST, LONGEST, f"{name} must have offsets")
    if np.unique(offsets).size < offsets.size:
        raise ValueError(f"{name} must have no offset twice, got {offsets.tolist()}")


def _by_lists(value: Any, name: str) -> None:
    rows, columns = value.shape
    lists = [np.asarray(x) for x in (value.rows, value.data)]
    if any(x.shape != (rows,) or x.dtype != object for x in lists):
        raise ValueError(f"{name} must have {rows} lists of indices and of data, got other arrays")
    if not all(isinstance(row, list) for x in lists for row in x):
        raise ValueError(f"{name} must have rows that are lists, got other objects")
    sizes = [np.fromiter(map(len, x), dtype=np.int64, count=rows) for x in lists]
    apart = np.flatnonzero(sizes[0] != sizes[1])
    if apart.size:
        i = apart[0]
        raise ValueError(
            f"{name} must have as many indices as data in each row, got {sizes[0][i]} and "
            f"{sizes[1][i]} in row {i}"
        )
    if sizes[0].any():
        index = _whole(list(chain.from_iterable(lists[0])), f"{name} must have indices")
        _within(index, 0, columns - 1, f"{name} must have indices")


def _array(value: Any, rule: str, ndim: int) -> np.ndarray:
    array = np.asarray(value)
    if array.ndim != ndim:
        raise ValueError(f"{rule} of {ndim} dimensions, got shape {array.shape}")
    return array


def _whole(value: Any, rule: str, size: int | None = None) -> np.ndarray:
    """A 1-D array of whole numbers, of this size if one is given."""
    array = _array(value, rule, 1)
    if array.dtype.kind not in "iu":
        raise ValueError(f"{rule} of whole numbers, got dtype {array.dtype}")
    if size is not None and array.size != size:
        raise ValueError(f"{rule} of size {size}, got {array.size}")
    return array


def _within(index: np.ndarray, low: int, high: int, rule: str) -> None:
    if not index.size:
        return
    least, most = index.min(), index.max()
    if least < low or most > high:
        raise ValueError(f"{rule} in {low}..{high}, got {least if least < low else most}")


_CHECKS: dict[str, Callable[[Any, str], None]] = {
    "csr": lambda value, name: _compressed(value, value.shape, 1, name),
    "csc": lambda value, name: _compressed(value, value.shape[::-1], 1, name),
    "bsr": _by_blocks,
    "coo": _by_entries,
    "dia": _by_diagonals,
    "lil": _by_lists,
}
