"""Dofs of springs as a user gives them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import MOST, listing, plain_array

GROUND = -1


def spring_dofs(dofs: Any) -> np.ndarray:
    """(m, 2) array of int, -1 for the ground; of names too an array of objects, None for it."""
    array = plain_array(dofs, "dofs")
    if array.dtype.kind in "UO" and array.size:
        array = _named(np.array(dofs, dtype=object), dofs)  # or numbers beside words were words
    elif array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"dofs must be whole numbers or names, got {dofs!r}")
    if isinstance(dofs, tuple) and array.shape == (2,):
        pair = tuple(array.tolist())
        raise ValueError(
            f"dofs must be [{pair}] for one spring between two dofs, or {list(pair)} for two "
            f"springs to the ground, got {pair}"
        )
    array = np.array(array)  # one without memory of its own may claim to be of any size
    if array.dtype != object and array.size and int(array.max()) >= MOST:
        raise ValueError(f"dofs must be below {MOST}, got {array.max()}")
    if array.ndim < 2:
        array = _to_ground(np.atleast_1d(array))
    if array.ndim != 2 or array.shape[1] != 2 or len(array) == 0:
        raise ValueError(f"dofs must be of shape (m,) or (m, 2), m > 0, got {np.shape(dofs)}")
    if array.dtype != object:
        if array.min() < GROUND:
            raise ValueError(f"dofs must not be below -1, the ground, got {array.min()}")
        array = array.astype(np.int64)
    same = np.flatnonzero(array[:, 0] == array[:, 1])
    if same.size:
        raise ValueError(f"dofs of a spring must differ, got the same at springs {listing(same)}")
    array.setflags(write=False)
    return array


def _named(array: np.ndarray, dofs: Any) -> np.ndarray:
    """Names and numbers as they are, in pairs None for the ground."""
    for at, x in np.ndenumerate(array):
        if isinstance(x, (bool, np.bool_)) or not isinstance(x, (str, int, np.integer)):
            raise TypeError(f"dofs must be whole numbers or names, got {dofs!r}")
        if array.ndim == 2 and x in ("ground", GROUND):
            array[at] = None
    return array


def _to_ground(first: np.ndarray) -> np.ndarray:
    """Pairs with the ground; of objects if numbers count from the end."""
    if first.dtype == object or first.size and first.min() < 0:
        return np.column_stack([first.astype(object), np.full(first.shape, None)])
    return np.column_stack([first, np.full_like(first, GROUND, dtype=np.int64)])
