"""Points that run along a path, and loads there, equations (L7) and (L8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._cached import Frozen
from .._checks import counted, listing, real_number
from . import forms
from .dofs import NodeNames
from .loads import Load, Mass, Samples
from .matrices import checksum
from .records import Record
from .sampled import SampledForce

__all__ = ["MovingLoad", "MovingPoint"]

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
            With all dofs of the path.

        Returns
        -------
        (levels,) ndarray
            N(s) u at the times of the motion, nan off the path.

        Raises
        ------
        ValueError
            Where dofs of the path were not recorded.
        """
        if np.ndim(motion.u) != 2:
            raise ValueError("motion must have all dofs of the path, got that of one dof")
        count = motion.u.shape[1]
        if motion.dof_names is None and count < motion.n:
            raise ValueError(f"motion must have all {motion.n} dofs, got {count}")
        placed = self._placed(count, motion.dof_names, "motion")
        values = np.full(len(motion.t), np.nan)
        for level in np.flatnonzero(self.is_on(motion.t)):
            dofs, N = placed._under(float(motion.t[level]))
            values[level] = N @ motion.u[level, dofs]
        return values

    # ---- in a subdomain ---------------------------------------------------------------------

    def _changed(self, dofs: np.ndarray, shape: np.ndarray, n: int) -> MovingPoint:
        """On other dofs, which have numbers only."""
        return MovingPoint(self._ends, dofs, shape, n, self.speed, self.start)

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> MovingPoint:
        """The same on the dofs of a subdomain: by their names, or by numbers without names, those
        of the structure in turn that are not fixed; further ones are those of vehicles."""
        if self._names is None:
            if n != self.n:
                raise ValueError(f"{label}: a MovingPoint must act on {n} dofs, got {self.n}")
            return self
        fixed = np.concatenate([self._fixed, getattr(names, "supports", self._fixed[:0])])
        free = np.setdiff1d(np.arange(self.n), fixed)
        numbers = np.full(self.n + 1, -1)  # the last one: no dof
        if names is not None:
            present, position = _in_names(self._names, names, label)
            numbers[present] = position
        elif n < free.size:
            raise ValueError(
                f"{label}: a subdomain of a MovingPoint must have the {free.size} dofs of its "
                f"structure that are not fixed, got {n}; supports are moving_point(fixed=)"
            )
        else:
            numbers[free] = np.arange(free.size)
        used = np.unique(self._dofs[self._dofs >= 0])
        absent = np.setdiff1d(used[numbers[used] < 0], fixed)
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
        ends, dofs, shape = map(np.ascontiguousarray, arrays)
        return forms.Path(ends, dofs, shape, self.start, self.speed)

    @property
    def _numbers(self) -> np.ndarray:
        """Its path, start and speed, for the comparison of problems."""
        arrays = self._ends, self._dofs.ravel(), self._shape.ravel(), [self.start, self.speed]
        return np.concatenate(arrays)


class MovingLoad(Load):
    """A force that moves over a structure, p(t) at a `MovingPoint`, equation (L7).

    The core evaluates it at the ends of the substeps of its subdomain: F(t) = N(s(t))^T p(t), with
    the shape functions of the element under it; zero before and after the path. Several act
    together as a list, ``force=[MovingLoad(axle, -60e3) for axle in axles]``.

    Parameters
    ----------
    point : MovingPoint
        As made by `Structure.moving_point`; the direction of the force is that of the point, so
        that a weight on "uy" is negative.
    force : float, Record or SampledForce
        Its size: constant, or samples in time, linear between them; the first at t = 0, the last
        held after the end.

    Raises
    ------
    TypeError, ValueError
        For another kind of point, numbers that are not finite, samples of several series or with
        averages.

    Examples
    --------
    >>> from pmalpha import structures
    >>> bar = structures.beam_frame([[0, 0], [4, 0]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0)
    >>> point = bar.moving_point([0, 1], speed=2.0)
    >>> MovingLoad(point, SampledForce([0.0, -8.0], dt=2.0))
    <MovingLoad of 2 samples at <MovingPoint on 2 nodes, length 4, speed 2, at 0 for t = 0>>
    """

    _in_lanes = False

    def __init__(self, point: MovingPoint, force: Any):
        if not isinstance(point, MovingPoint):
            raise TypeError(
                f"point must be a MovingPoint, as Structure.moving_point makes one, got {point!r}"
            )
        self.point = point
        self.values, self.dt = _size(force)
        self._freeze()

    @property
    def n(self) -> int:
        """Number of dofs it acts on; 0 where its subdomain has to give it."""
        return 0 if self.point._names is not None else self.point.n

    def __repr__(self) -> str:
        m = len(self.values)
        size = f"{self.values[0]:g}" if m == 1 else counted(m, "sample")
        return f"<MovingLoad of {size} at {self.point!r}>"

    def __call__(self, t: float) -> np.ndarray:
        """F(t), on the dofs of the structure or of its subdomain."""
        times = self.dt * np.arange(len(self.values))
        N: np.ndarray = float(np.interp(t, times, self.values)) * self.point.weights(t)
        return N

    def _moved(self, point: MovingPoint) -> MovingLoad:
        return MovingLoad(point, SampledForce(self.values, self.dt))

    def _of(self, mass: Mass, n: int, name: str) -> MovingLoad:
        return self._moved(self.point._placed(n, mass.names, name))

    def _core(self, order: np.ndarray, scale: np.ndarray | None = None) -> forms.Load:
        position = np.empty(len(order), dtype=np.int64)
        position[order] = np.arange(len(order))
        return forms.Moving(self.values, self.dt, True, 0.0, self.point._core(position))

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> MovingLoad:
        return self._moved(self.point._part(dofs, share))

    def _projected(self, T: np.ndarray) -> MovingLoad:
        return self._moved(self.point._projected(T))

    @property
    def _samples(self) -> Samples | None:  # type: ignore[override]
        if len(self.values) == 1:
            return None
        return Samples(self.values[:, None], self.dt, True, np.ones(1))

    def _facts(self) -> str:
        path = checksum(self.point._numbers)
        return f"MovingLoad {checksum(self.values)}, dt {self.dt!r}, path {path}"


def _size(force: Any) -> tuple[np.ndarray, float]:
    """Samples (m,) and the time between them; one sample of a constant force."""
    if isinstance(force, Record):
        force = SampledForce(force)
    if not isinstance(force, SampledForce):
        if np.ndim(force):
            raise TypeError(
                "force must be a number, a Record or a SampledForce, which has dt, got an array"
            )
        return np.array([real_number(force, "force")]), 1.0
    values = force.values if force.shape is None else force.values @ force.shape.T
    if values.shape[1] != 1 or force.average or not force.hold:
        raise ValueError(
            f"force must be samples of one series, without average and ground motion, got {force!r}"
        )
    return np.ascontiguousarray(values[:, 0]), force.dt


def _in_names(model: NodeNames, names: Sequence[str], label: str) -> tuple[np.ndarray, np.ndarray]:
    """The dofs of the model that are among the names, and their positions there."""
    if isinstance(names, NodeNames):
        if (names.components, names.model_size) == (model.components, model.model_size):
            return names.numbers, np.arange(len(names))
        raise ValueError(
            f"{label}: the MovingPoint must be of the structure of its subdomain, got one of "
            f"{model.model_size} dofs where there are {names.model_size}"
        )
    known = {model._name(dof): dof for dof in model.numbers}
    pairs = [(known[name], i) for i, name in enumerate(names) if name in known]
    dofs, positions = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return dofs, positions
