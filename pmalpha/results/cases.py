"""What `Coupler.run_each` keeps of many cases in place of their Histories: one value for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import counted
from ..files import library
from .conversion import COORDINATES
from .quantities import OF_INTERFACE, OF_SUBDOMAIN, growing, position
from .times import columns_of, labels_of

if TYPE_CHECKING:
    import xarray


__all__ = ["CaseMotion", "CaseValues"]


# Numbers that a reduction over rows takes at a time: rows of few columns one by one are slow.
WIDE = 1024


def over_rows(operation: np.ufunc, x: np.ndarray) -> np.ndarray:
    """``operation.reduce(x, axis=0)`` of a matrix, but for the order."""
    rows, columns = x.shape
    some = WIDE // max(columns, 1)
    if some < 2 or rows < 2 * some or columns == 0:
        result: np.ndarray = operation.reduce(x, axis=0)
        return result
    multiple = rows // some * some
    wide = operation.reduce(x[:multiple].reshape(-1, some * columns), axis=0)
    result = operation.reduce(np.vstack([wide.reshape(some, columns), x[multiple:]]), axis=0)
    return result


# What `reduce` makes of an array with a row for each time level.
REDUCTIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "peak": lambda x: np.maximum(over_rows(np.maximum, x), -over_rows(np.minimum, x)),
    "last": lambda x: x[-1],
    "sum": lambda x: over_rows(np.add, x),
}


@dataclass(frozen=True)
class CaseMotion:
    """One value of each recorded quantity of a subdomain, for many cases.

    Attributes
    ----------
    u, v, a : (cases, dofs) arrays
        Of displacement, velocity and acceleration.
    deformation, force : (cases, springs) arrays, or None
        Of recorded springs.
    outputs : dict of (cases, rows) arrays
        Of the outputs of the run.
    dofs : (dofs,) array of int
    n : int
        Number of dofs of the subdomain.
    dof_names : sequence of str or None
        Names of the recorded dofs.
    """

    u: np.ndarray
    v: np.ndarray
    a: np.ndarray
    deformation: np.ndarray | None
    force: np.ndarray | None
    outputs: Mapping[str, np.ndarray]
    dofs: np.ndarray
    n: int
    dof_names: Sequence[str] | None

    def __repr__(self) -> str:
        return f"<{counted(len(self.u), 'case')} of {counted(self.dofs.size, 'dof')}>"

    def column(self, dof: int | str) -> int:
        """The column of a dof, by its number or name.

        Parameters
        ----------
        dof : int or str
            Number of a dof of the subdomain, or its name.

        Returns
        -------
        int
            Number of the column of `u`, `v` and `a`.

        Raises
        ------
        TypeError
            If `dof` is neither a number nor a name.
        ValueError
            If the dof was not recorded, or there is none of this name or number.
        """
        (j,) = columns_of(dof, self.dofs, self.n, self.dof_names, "dof", one=True)
        return int(j)


@dataclass(frozen=True)
class CaseValues:
    """One value of each recorded quantity, for many cases: `Coupler.run_each` with ``reduce``.

    ``values["frame"]``, by name, number or object, is a `CaseMotion` with ``.u`` (cases, dofs). Of
    cases that failed all values are NaN.

    Attributes
    ----------
    reduce : str
        "peak": the largest absolute value over the recorded time levels, the first included;
        "last": the value at the end; "sum": the sum over the recorded time levels.
    subdomains : tuple of `CaseMotion` or None
        None for a subdomain that was not recorded.
    multipliers, velocity_jump, displacement_jump : (cases, p) arrays
    keys : tuple of (str, `Subdomain` or None)
        As of a `History`.
    """

    reduce: str
    subdomains: tuple[CaseMotion | None, ...]
    multipliers: np.ndarray
    velocity_jump: np.ndarray
    displacement_jump: np.ndarray
    keys: tuple[tuple[str, Any], ...] = field(repr=False)

    def __len__(self) -> int:
        return len(self.multipliers)

    def __repr__(self) -> str:
        names = ", ".join(repr(name) for name, _ in self.keys)
        return f"<{self.reduce} values of {counted(len(self), 'case')}: {names}>"

    def __getitem__(self, key: Any) -> CaseMotion:
        i = position(key, self.keys)
        motion = self.subdomains[i]
        if motion is None:
            raise KeyError(f"subdomain {self.keys[i][0]!r} was not recorded")
        return motion

    def to_xarray(self) -> xarray.Dataset:
        """All values, with the names that `History.to_xarray` has, over ``case``.

        Returns
        -------
        xarray.Dataset
            The arrays are shared, not copied.

        Raises
        ------
        ImportError
            Without xarray.
        """
        make = library("xarray", "to_xarray", "'pmalpha[xarray]'").Dataset
        variables: dict[str, Any] = {
            name: (("case", "constraint"), getattr(self, name)) for name in JUMPS
        }
        coordinates: dict[str, Any] = {
            "case": np.arange(len(self)),
            "constraint": np.arange(self.multipliers.shape[1]),
        }
        for (name, _), motion in zip(self.keys, self.subdomains):
            if motion is None:
                continue
            coordinates[f"{name}_dof"] = labels_of(motion.dofs, motion.dof_names)
            for kind in MOTION:
                x = getattr(motion, kind)
                if x is not None:
                    along = COORDINATES[OF_SUBDOMAIN[kind].columns]
                    variables[f"{name}_{kind}"] = (("case", f"{name}_{along}"), x)
            for output, x in motion.outputs.items():
                variables[f"{name}_{output}"] = (("case", f"{name}_{output}_row"), x)
        dataset: xarray.Dataset = make(variables, coordinates, attrs={"reduce": self.reduce})
        return dataset


MOTION = "u", "v", "a", "deformation", "force"
JUMPS = tuple(name for name, x in OF_INTERFACE.items() if x.columns == "constraints")


class Reducer:
    """Takes the History of one case after the other, and keeps a value of each quantity.

    reduce: a key of `REDUCTIONS`.
    """

    def __init__(self, reduce: str, count: int):
        self.reduce, self.count = reduce, count
        self.values: CaseValues | None = None

    def take(self, k: int, history: Any) -> None:
        """History of case k, which may be released or overwritten afterwards."""
        if self.values is None:
            self.values = self._empty(history)
        make = REDUCTIONS[self.reduce]
        for name in JUMPS:
            getattr(self.values, name)[k] = make(getattr(history, name))
        for s, motion in zip(history.subdomains, self.values.subdomains):
            if s is None or motion is None:
                continue
            arrays = growing(s)
            for name in MOTION:
                if name in arrays:
                    getattr(motion, name)[k] = make(arrays[name])
            for name, x in s.outputs.items():
                motion.outputs[name][k] = make(x)

    def _empty(self, history: Any) -> CaseValues:
        """NaN for all cases, in the arrays that a History has."""

        def nan(x: np.ndarray | None) -> Any:
            return None if x is None else np.full((self.count, x.shape[1]), np.nan)

        def motion(s: Any) -> CaseMotion:
            fields: dict[str, Any] = {name: nan(getattr(s, name)) for name in MOTION}
            outputs = {name: nan(x) for name, x in s.outputs.items()}
            return CaseMotion(**fields, outputs=outputs, dofs=s.dofs, n=s.n, dof_names=s.dof_names)

        motions = tuple(s and motion(s) for s in history.subdomains)
        jumps: dict[str, Any] = {name: nan(getattr(history, name)) for name in JUMPS}
        return CaseValues(self.reduce, motions, **jumps, keys=history.keys)
