"""The motion of dofs by name, and of all dofs at one time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from scipy.sparse import issparse

from .._checks import counted, listing, plain_array
from ..problem.dofs import NodeNames, dof_list

__all__ = ["DofMotion", "State"]


def __dir__() -> list[str]:
    return sorted(__all__)


@dataclass(frozen=True)
class DofMotion:
    """The motion of one dof: ``history["frame"]["roof"]``.

    Attributes
    ----------
    name : str
        Its name in `dof_names`, or its number.
    u, v, a : (k,) arrays, or numbers
        Displacement, velocity and true acceleration; numbers of a `State`.
    t : (k,) array, or None
        Times of the recorded time levels.
    """

    name: str
    u: Any
    v: Any
    a: Any
    t: Any = None

    def __repr__(self) -> str:
        if np.ndim(self.u) == 0:
            return f"<dof {self.name}: u = {self.u:.4g}, v = {self.v:.4g}, a = {self.a:.4g}>"
        return f"<dof {self.name}: {counted(np.size(self.u), 'time level')}>"


@dataclass(frozen=True)
class State:
    """The motion of a subdomain at one time.

    ``state["roof"]``, by name or number, is that of one dof.

    Attributes
    ----------
    u, v, a : (dofs,) arrays
        Displacement, velocity and true acceleration (w of the equations).
    dofs : (dofs,) array of int, or None
        The dofs of the entries. None: all.
    n : int or None
        Number of dofs of the subdomain.
    dof_names : sequence of str, or None
        Names of the entries.
    """

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    dofs: np.ndarray | None = None
    n: int | None = None
    dof_names: Sequence[str] | None = None

    def __getitem__(self, key: int | str) -> DofMotion:
        dofs = np.arange(len(self.u)) if self.dofs is None else self.dofs
        (j,) = columns_of(key, dofs, self.n, self.dof_names, "dof", one=True)
        name = label_of(dofs, self.dof_names, j)
        return DofMotion(name, *(float(x[j]) for x in (self.u, self.v, self.a)))

    def __repr__(self) -> str:
        dofs = np.arange(len(self.u)) if self.dofs is None else self.dofs
        return f"<State of {counted(len(dofs), 'dof')}: {largest(self, dofs, self.dof_names)}>"

    def __iter__(self) -> NoReturn:  # else entry after entry up to an error
        raise TypeError("a State is of one time: take its u, v or a")


def largest(motion: Any, dofs: np.ndarray, names: Sequence[str] | None) -> str:
    """The largest absolute u, v and a of the dofs, in words."""
    if dofs.size == 0:
        return "none recorded"
    sizes = ((kind, np.abs(getattr(motion, kind))) for kind in "uva")
    peaks = ((kind, size, int(np.argmax(size))) for kind, size in sizes)
    return ", ".join(
        f"largest |{kind}| {size[j]:.4g} at dof {label_of(dofs, names, j)}"
        for kind, size, j in peaks
    )


def columns_of(
    selection: Any,
    dofs: np.ndarray,
    n: int | None,
    names: Sequence[str] | None,
    what: str,
    *,
    one: bool = False,
) -> list[int]:
    """The columns of dofs among the recorded ones.

    n: number of dofs of the subdomain; None in files of older versions.
    one: whether it must be a single dof.
    """
    if one and (isinstance(selection, bool) or not isinstance(selection, (int, str, np.integer))):
        raise TypeError(
            f"{what} must be a name or a number, got {selection!r}; arrays of dofs are u, v and a"
        )
    if isinstance(selection, str):
        return [int(x) for x in dof_list(selection, len(dofs), what, names)]
    if plain_array(selection, what).dtype.kind in "UO" and _has_items(selection):
        return [j for x in selection for j in columns_of(x, dofs, n, names, what)]
    numbers = dof_list(selection, np.iinfo(np.int64).max if n is None else n, what)
    if dofs.size and np.array_equal(dofs, np.arange(dofs[0], dofs[0] + dofs.size)):
        column = {int(x): int(x - dofs[0]) for x in numbers if 0 <= x - dofs[0] < dofs.size}
    else:
        places = {int(dof): j for j, dof in enumerate(dofs)}
        column = {int(x): places[int(x)] for x in numbers if int(x) in places}
    missing = [int(x) for x in numbers if int(x) not in column]
    if missing:
        raise ValueError(
            f"{what} must have been recorded, got {listing(missing)}; recorded are {listing(dofs)}"
        )
    return [column[int(x)] for x in numbers]


def _has_items(value: Any) -> bool:
    """Whether it is a list, a set or an array that is not one number; False for sparse matrices."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Iterable) and not issparse(value)


def on_mesh(motion: Any, kind: str = "u") -> np.ndarray:
    """The u, v or a of a motion on all dofs of its mesh, (..., n): zeros at supports.

    motion: what was recorded of a subdomain, or a `State`.
    Returns that of the subdomain where its dofs are not those of a mesh, or not all were recorded.
    """
    x: np.ndarray = getattr(motion, kind)
    names = motion.dof_names
    if not isinstance(names, NodeNames) or len(names) != motion.n:
        return x
    values = np.zeros((*x.shape[:-1], names.model_size))
    values[..., names.numbers] = x
    return values


def label_of(dofs: np.ndarray, names: Sequence[str] | None, j: int) -> str:
    """The name of a column, or the number of its dof."""
    return str(int(dofs[j])) if names is None else names[j]


def labels_of(dofs: np.ndarray, names: Sequence[str] | None) -> list[Any]:
    """The names of columns, or the numbers of their dofs."""
    return [int(x) for x in dofs] if names is None else list(names)
