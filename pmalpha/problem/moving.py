"""Points that run along a path, where loads act and springs end, equations (L7) and (L8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._cached import Frozen
from .._checks import listing, real_number
from . import forms
from .dofs import NodeNames

__all__ = ["MovingPoint"]

POWERS = np.arange(4)


class MovingPoint(Frozen):
    """A point that runs with constant speed along a path; made by `Structure.moving_point`.

    Its displacement is that of the element under it, u_p = N(s) u, with the shape functions N of
    that element. A force on it acts on the same dofs, N(s)^T f. Both ends belong to the path; off
    the path nothing acts.

    Attributes
    ----------
    speed, start : float
        At the time t it is at the distance s = start + speed t from the beginning of the path.
    length : float
        Of the path.
    n : int
        Number of dofs of the structure, or of the subdomain that it is placed in.

    Examples
    --------
    >>> from pmalpha import structures
    >>> beam = structures.beam_frame([[0, 0], [4, 0]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0)
    >>> point = beam.moving_point([0, 1], speed=2.0)
    >>> point
    <MovingPoint on 2 nodes, length 4, speed 2, at 0 for t = 0>
    >>> point.weights(1.0).tolist()  # in the middle: half of the force at each end, and moments
    [0.0, 0.5, 0.5, 0.0, 0.5, -0.5]
    """

    def __init__(
        self,
        ends: np.ndarray,
        dofs: np.ndarray,
        shape: np.ndarray,
        n: int,
        speed: Any,
        start: Any,
        *,
        names: NodeNames | None = None,
        fixed: Any = (),
    ):
        self._ends, self._dofs, self._shape = ends, dofs, shape
        self.n, self._names = n, names
        self.speed, self.start = real_number(speed, "speed"), real_number(start, "start")
        self._fixed = np.unique(np.asarray(fixed, dtype=np.int64))
        for array in (ends, dofs, shape, self._fixed):
            array.setflags(write=False)
        self._freeze()

    @property
    def length(self) -> float:
        """Length of the path."""
        return float(self._ends[-1])

    def __repr__(self) -> str:
        return (
            f"<MovingPoint on {len(self._ends)} nodes, length {self.length:g}, "
            f"speed {self.speed:g}, at {self.start:g} for t = 0>"
        )

    def position(self, t: Any) -> Any:
        """Distance from the beginning of the path.

        Parameters
        ----------
        t : float or array
            Time.

        Returns
        -------
        float or array
            start + speed t, also where that is not on the path.
        """
        return self.start + self.speed * np.asarray(t, dtype=float)[()]

    def is_on(self, t: Any) -> Any:
        """Whether it is on the path.

        Parameters
        ----------
        t : float or array
            Time.

        Returns
        -------
        bool or array of bool
            True at both ends too, up to rounding as in a run.
        """
        way = self.speed * np.asarray(t, dtype=float)[()]
        size = np.abs(self.start) + np.abs(way) + self.length
        rounding = 16.0 * np.finfo(float).eps * size
        s = self.start + way
        return (s >= -rounding) & (s <= self.length + rounding)

    def _under(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """The dofs under it and their shape functions; empty off the path."""
        if not self.is_on(t):
            return np.empty(0, dtype=np.int64), np.empty(0)
        s = float(np.clip(self.position(t), 0.0, self.length))
        at = int(np.searchsorted(self._ends[1:-1], s, side="right"))
        xi = (s - self._ends[at]) / (self._ends[at + 1] - self._ends[at])
        dofs, values = self._dofs[at], self._shape[at] @ xi**POWERS
        return dofs[dofs >= 0], values[dofs >= 0]

    def weights(self, t: float) -> np.ndarray:
        """The shape functions under it: of a unit force there the forces on the dofs.

        Parameters
        ----------
        t : float
            Time.

        Returns
        -------
        (n,) ndarray
            N(s), zero off the path.
        """
        dofs, values = self._under(real_number(t, "t"))
        N = np.zeros(self.n)
        np.add.at(N, dofs, values)
        return N

    def displacement(self, motion: Any) -> np.ndarray:
        """Displacement of the structure under it during a run.

        Parameters
        ----------
        motion : SubdomainHistory
            With all dofs of the path; those of supports may be absent if `moving_point` has them as
            `fixed`, or `Structure.subdomain` does.

        Returns
        -------
        (levels,) ndarray
            N(s) u at the times of the motion, nan off the path.

        Raises
        ------
        ValueError
            Where dofs of the path were not recorded.
        """
        placed = self._placed(motion.n, motion.dof_names, "motion")
        column = np.full(motion.n, -1)
        column[motion.dofs] = np.arange(len(motion.dofs))
        used = np.unique(placed._dofs[placed._dofs >= 0])
        if np.any(column[used] < 0):
            missing = listing(used[column[used] < 0])
            raise ValueError(f"motion must have the dofs of the path, got none of {missing}")
        values = np.full(len(motion.t), np.nan)
        for level in np.flatnonzero(self.is_on(motion.t)):
            dofs, N = placed._under(float(motion.t[level]))
            values[level] = N @ motion.u[level, column[dofs]]
        return values

    # ---- in a subdomain ---------------------------------------------------------------------

    def _changed(self, dofs: np.ndarray, shape: np.ndarray, n: int) -> MovingPoint:
        """On other dofs, which have numbers only."""
        return MovingPoint(self._ends, dofs, shape, n, self.speed, self.start)

    def _with_fixed(self, fixed: np.ndarray) -> MovingPoint:
        """The same, with further dofs of the structure that a subdomain need not have."""
        if self._names is None or not len(fixed):
            return self
        return MovingPoint(
            self._ends,
            self._dofs,
            self._shape,
            self.n,
            self.speed,
            self.start,
            names=self._names,
            fixed=np.concatenate([self._fixed, fixed]),
        )

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> MovingPoint:
        """The same on the dofs of a subdomain: by their names, or by numbers without names, those
        of the structure in turn that are not fixed; further ones are those of vehicles."""
        if self._names is None:
            if n != self.n:
                raise ValueError(f"{label}: a MovingPoint must act on {n} dofs, got {self.n}")
            return self
        free = np.setdiff1d(np.arange(self.n), self._fixed)
        numbers = np.full(self.n + 1, -1)  # the last one: no dof
        if names is not None:
            present, position = _in_names(self._names, names)
            numbers[present] = position
        elif n < free.size:
            raise ValueError(
                f"{label}: a subdomain of a MovingPoint must have the {free.size} dofs of its "
                f"structure that are not fixed, got {n}; supports are moving_point(fixed=)"
            )
        else:
            numbers[free] = np.arange(free.size)
        used = np.unique(self._dofs[self._dofs >= 0])
        absent = np.setdiff1d(used[numbers[used] < 0], self._fixed)
        if absent.size:
            lost = listing([self._names._name(dof) for dof in absent])
            raise ValueError(
                f"{label}: the subdomain of a MovingPoint must have all dofs of its path, got none "
                f"of {lost}; those of supports are moving_point(fixed=)"
            )
        return self._changed(numbers[self._dofs], self._shape, n)

    def _part(self, dofs: np.ndarray, share: np.ndarray | float) -> MovingPoint:
        """Of a point with numbers, on some of the dofs, with a share of each."""
        numbers, shares = np.full(self.n + 1, -1), np.zeros(self.n + 1)
        numbers[dofs], shares[dofs] = np.arange(len(dofs)), share
        shape = self._shape * shares[self._dofs][:, :, None]
        return self._changed(numbers[self._dofs], shape, len(dofs))

    def _projected(self, T: np.ndarray) -> MovingPoint:
        """Of a point with numbers, on coordinates q of the displacements T q; T is (n, r)."""
        rows = np.vstack([T, np.zeros(T.shape[1])])[self._dofs]  # (segments, width, r)
        shape = np.einsum("ekc,ekr->erc", self._shape, rows)
        dofs = np.tile(np.arange(T.shape[1]), (len(self._dofs), 1))
        return self._changed(dofs, shape, T.shape[1])

    def _core(self, position: np.ndarray) -> forms.Path:
        """For the core, of a point with numbers, for the position of each dof."""
        with_none = np.append(position, -1).astype(np.int64)
        arrays = self._ends, with_none[self._dofs], self._shape
        return forms.Path(*map(np.ascontiguousarray, arrays), self.start, self.speed)

    @property
    def _numbers(self) -> np.ndarray:
        """Its path, start and speed, for the comparison of problems."""
        arrays = self._ends, self._dofs.ravel(), self._shape.ravel(), [self.start, self.speed]
        return np.concatenate(arrays)


def _in_names(model: NodeNames, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """The dofs of the model that are among the names, and their positions there."""
    if isinstance(names, NodeNames):
        if (names.components, names.model_size) == (model.components, model.model_size):
            return names.numbers, np.arange(len(names))
        names = names[:]
    known = {model._name(dof): dof for dof in model.numbers}
    found = [(known[name], i) for i, name in enumerate(names) if name in known]
    dofs, positions = np.array(found, dtype=np.int64).reshape(-1, 2).T
    return dofs, positions
