"""Subdomains of a coupler by name, by index or by the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._checks import counted
from ..problem.dofs import dof_list
from ..problem.subdomain import Subdomain


def position(key: str | int | Subdomain, keys: Sequence[tuple[str, Subdomain | None]]) -> int:
    """Index of a subdomain given by name, object or index; KeyError or IndexError."""
    for i, (name, subdomain) in enumerate(keys):
        if (isinstance(key, str) and key == name) or (key is subdomain and key is not None):
            return i
    if isinstance(key, (int, np.integer)) and not isinstance(key, bool):
        if -len(keys) <= key < len(keys):
            return int(key) % len(keys)
        raise IndexError(f"there are {counted(len(keys), 'subdomain')}, got index {key}")
    names = ", ".join(repr(name) for name, _ in keys)
    if isinstance(key, Subdomain) and any(subdomain is None for _, subdomain in keys):
        raise KeyError(
            f"a History from a file has names and indices only, got {key!r}; use {names}"
        )
    raise KeyError(f"no subdomain {key!r}; there are {names}")


def by_index(
    values: Mapping[Any, Any] | None, keys: Sequence[tuple[str, Any]], name: str
) -> dict[int, Any]:
    """Values given by subdomain, by its index; ValueError for unknown or repeated subdomains."""
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise TypeError(f"{name} must be a dict by subdomain, got {values!r}")
    result: dict[int, Any] = {}
    for key, value in values.items():
        try:
            i = position(key, keys)
        except LookupError as error:
            raise ValueError(f"{name}: {error.args[0]}") from None
        if i in result:
            raise ValueError(f"{name} must not name a subdomain twice, got {keys[i][0]!r} twice")
        result[i] = value
    return result


def chosen_springs(
    record_springs: Mapping[Any, Any] | None,
    keys: Sequence[tuple[str, Subdomain]],
    dofs: Sequence[np.ndarray | None],
) -> list[np.ndarray | None]:
    """The springs to record of each subdomain, None for a subdomain left out."""
    chosen: list[np.ndarray | None] = [None] * len(keys)
    for i, springs in by_index(record_springs, keys, "record_springs").items():
        name, subdomain = keys[i]
        count = sum(len(spring) for spring in subdomain.springs)
        what = f"record_springs[{name!r}]"
        if count == 0 or dofs[i] is None:
            lack = "springs" if count == 0 else "recorded dofs"
            raise ValueError(f"{what} must be of a subdomain with {lack}, got one without")
        chosen[i] = np.arange(count) if springs is None else dof_list(springs, count, what)
    return chosen
