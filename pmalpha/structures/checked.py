"""Checked arguments of the functions that make structures: values by element, meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import listing, plain_array, positive_number, real_array, require_moderate

LARGEST = 1e50


def is_lumped(mass: Any) -> bool:
    if mass not in ("consistent", "lumped"):
        raise ValueError(f'mass must be "consistent" or "lumped", got {mass!r}')
    result: bool = mass == "lumped"
    return result


def per_element(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """(1,) or (elements,) array from a number or from an array of this shape, flat or not."""
    values = real_array(value, name, plain_array(value, name).ndim)
    flat = (int(np.prod(shape)),)
    if values.shape not in ((), shape, flat):
        allowed = " or ".join(str(s) for s in dict.fromkeys((shape, flat)))
        raise ValueError(f"{name} must be a number or of shape {allowed}, got {values.shape}")
    return values.reshape(-1)


def not_negative(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    values = per_element(value, name, shape)
    if not (values >= 0.0).all():
        raise ValueError(f"{name} must not be negative, got {values.min():g}")
    return values


def positive(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    values = per_element(value, name, shape)
    if not (values > 0.0).all():
        raise ValueError(f"{name} must be positive, got {values.min():g}")
    for x in (values.min(), values.max()):
        _check_range(x, name)
    return values


def measure(value: Any, name: str) -> float:
    """A positive number whose powers are in the range of numbers."""
    number = positive_number(value, name)
    _check_range(number, name)
    return number


def _check_range(number: float, name: str) -> None:
    """Products of a few such numbers are neither zero nor infinite."""
    if not 1.0 / LARGEST <= number <= LARGEST:
        raise ValueError(f"{name} must lie in {1.0 / LARGEST:g}..{LARGEST:g}, got {number:g}")


def poisson(nu: Any, shape: tuple[int, ...], *, incompressible: bool) -> np.ndarray:
    values = per_element(nu, "nu", shape)
    fits = (values > -1.0) & ((values <= 0.5) if incompressible else (values < 0.5))
    if not fits.all():
        bracket = "]" if incompressible else ")"
        raise ValueError(f"nu must lie in (-1, 0.5{bracket}, got {values[~fits][0]:g}")
    return values


def in_plane_stress(E: Any, nu: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """As `isotropic`, with the lam of plane stress, 2 lam mu / (lam + 2 mu); nu may be 0.5."""
    young, ratio = positive(E, "E", shape), poisson(nu, shape, incompressible=True)
    return young * ratio / (1.0 - ratio**2), young / (2.0 * (1.0 + ratio))


def isotropic(E: Any, nu: Any, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """lam and mu of a solid, each (1,) or (elements,)."""
    young, ratio = positive(E, "E", shape), poisson(nu, shape, incompressible=False)
    lam = young * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    return lam, young / (2.0 * (1.0 + ratio))


def mesh_arguments(
    points: Any, elements: Any, name: str, dim: int | None, corners: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points and elements; each point must be in at least one element."""
    coordinates = real_array(points, "points", 2)
    require_moderate(coordinates, "points", LARGEST)
    size = np.abs(coordinates).max(initial=0.0)
    if 0.0 < size < 1.0 / LARGEST:  # products of a few lengths would be zero
        raise ValueError(f"points must not all be below {1.0 / LARGEST:g}, got at most {size:g}")
    if dim is not None and coordinates.shape[1] != dim:
        raise ValueError(f"points must have shape (points, {dim}), got {coordinates.shape}")
    numbers = node_numbers(elements, name, len(coordinates), corners)
    require_used(len(coordinates), [numbers], name)
    return coordinates, numbers


def dimension_of(points: Any) -> int:
    """2 or 3, of points in the plane or in space."""
    shape = plain_array(points, "points").shape
    if shape[-1:] not in ((2,), (3,)):
        raise ValueError(f"points must have shape (N, 2) or (N, 3), got {shape}")
    return int(shape[-1])


def require_used(points: int, elements: list[np.ndarray], name: str) -> None:
    used = np.zeros(points, dtype=bool)
    for nodes in elements:
        used[nodes] = True
    unused = np.flatnonzero(~used)
    if unused.size:
        raise ValueError(f"{name} must use every point (see submesh), not {listing(unused)}")


def node_numbers(value: Any, name: str, nodes: int, corners: int | None) -> np.ndarray:
    """(elements, corners) array of node numbers in 0..nodes-1; any number of corners for None."""
    numbers = plain_array(value, name)
    if numbers.dtype.kind not in "iu":
        raise TypeError(f"{name} must be whole numbers, got dtype {numbers.dtype}")
    if numbers.ndim != 2 or numbers.shape[1] != (corners or numbers.shape[1]) or not numbers.size:
        raise ValueError(
            f"{name} must have shape (elements, {corners or 'corners'}), got {numbers.shape}"
        )
    outside = numbers[(numbers < 0) | (numbers >= nodes)]
    if outside.size:
        raise ValueError(f"{name} must lie in 0..{nodes - 1}, got {listing(outside)}")
    return numbers.astype(np.int64)
