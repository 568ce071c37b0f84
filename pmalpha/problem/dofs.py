"""Numbers of dofs as a user gives them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import MOST, listing, plain_array


def dof_list(value: Any, n: int | None, name: str) -> np.ndarray:
    """Whole numbers in 0..n-1, none twice: from one number, several, or a mask of n.

    Where n is not known, None, they are not negative.
    """
    dofs = plain_array(value, name)
    if dofs.size == 0:
        dofs = dofs.astype(np.int64)
    if dofs.dtype.kind == "b" and dofs.ndim == 1:
        return np.flatnonzero(dofs if n is None else checked_mask(dofs, n, name))
    if dofs.dtype.kind not in "iu" or dofs.ndim > 1:
        raise TypeError(f"{name} must be a 1-D array of whole numbers, got {value!r}")
    dofs = np.atleast_1d(dofs)
    outside = dofs[(dofs < 0) | (dofs >= (MOST if n is None else n))]
    if outside.size and n is None:
        rule = "not be negative" if outside.min() < 0 else f"be below {MOST}"
        raise ValueError(f"{name} must {rule}, got {listing(outside)}")
    if outside.size:
        assert n is not None
        raise ValueError(f"{name} must lie in 0..{n - 1}, got {listing(outside)}")
    values, counts = np.unique(dofs, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(f"{name} must not repeat a dof, got {listing(values[counts > 1])} twice")
    return dofs.astype(np.int64)


def checked_mask(mask: np.ndarray, n: int, name: str) -> np.ndarray:
    """A mask of n entries."""
    if mask.shape != (n,):
        raise ValueError(f"{name} must be a mask of shape ({n},), got shape {mask.shape}")
    return mask
