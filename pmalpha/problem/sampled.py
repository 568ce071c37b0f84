"""Loads given by samples: `SampledForce`, and ground motions, `BaseAcceleration`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from sys import float_info
from typing import Any, NamedTuple, Self, overload

import numpy as np

from .._checks import counted, flag, listing, plain_array, real_array, time_step
from . import forms
from .arguments import MatrixLike
from .dofs import along, components_of
from .loads import Load, Mass, Samples, against
from .matrices import Matrix, canonical, checksum, product
from .records import Record, takes_record

__all__ = ["BaseAcceleration", "SampledForce"]

# Rounding of M times a direction, relative to its largest entry: of two forms of one matrix.
SAME_MASS = 1e-9


class SampledForce(Load):
    """A force given by samples with linear interpolation, equation (L1).

    A subdomain takes its values at the ends of its own substeps only, t = 0 included. What is
    between two of them has no influence: samples closer together than the steps are skipped, and
    frequencies above half a step's are seen as lower ones. The Coupler warns where that changes the
    response; `average` takes means instead. After the last sample the force is constant.

    Parameters
    ----------
    values : (m,) or (m, k) array, or Record
        Samples at t = 0, dt, 2 dt, ...; m >= 1. A Record has its dt:
        ``SampledForce(record, shape)``.
    dt : float
        Time between two samples, any consistent unit, positive; not the vector of their times.
    shape : (n,) or (n, k) array, optional
        Distribution of the k samples over the n dofs: F(t) = shape @ s(t). Without it the samples
        are the forces on the dofs, k = n.
    average : bool, default False
        True: each time level takes the mean of the force over one step of the subdomain about it,
        half of the step that ends there and half of the one that begins there, equation (L2);
        double steps take it over 2 h. Impulses are kept, wherever they are and however the steps
        change, equation (L5); nothing is delayed, and the order of accuracy remains; t = 0 takes
        the mean over the first half step. Frequencies near those of the steps are damped, not
        removed: filter the record for that. Calling the object returns F(t) itself.

    Raises
    ------
    ValueError
        For NaN or infinite samples, shapes that do not fit, or dt not positive.

    Examples
    --------
    >>> push = SampledForce([0.0, 1.0, 0.0], dt=0.1, shape=[0.0, 2.0])
    >>> push(0.05).tolist(), push(7.0).tolist()
    ([0.0, 1.0], [0.0, 0.0])
    >>> push
    <SampledForce on 2 dofs: 3 samples, dt = 0.1, to t = 0.2>
    """

    hold = True
    _prescribes = True
    _values_name, _shape_name = "values", "shape"
    _begin = 0.0  # the time of the first sample

    @overload
    def __init__(self, values: Record, shape: Any = None, *, average: bool = False): ...

    @overload
    def __init__(self, values: Any, dt: float, shape: Any = None, *, average: bool = False): ...

    @takes_record
    def __init__(self, values: Any, dt: float, shape: Any = None, *, average: bool = False):
        self.values = _columns(values, self._values_name)
        self.dt = time_step(dt, "dt")
        self.average = flag(average, "average")
        self.shape = None if shape is None else _columns(shape, "shape")
        if self.shape is not None and self.shape.shape[1] != self.values.shape[1]:
            raise ValueError(_columns_differ(self, self.shape.shape[1]))
        if self.shape is not None:
            with np.errstate(over="ignore"):
                largest = np.abs(self.values).max() * np.abs(self.shape).sum(axis=1).max()
            if not largest < np.inf:
                raise ValueError(f"{self._values_name} times {self._shape_name} must be finite")
        self._freeze()

    @property
    def n(self) -> int:
        """Number of dofs the force acts on."""
        result: int = (self.values.T if self.shape is None else self.shape).shape[0]
        return result

    def __repr__(self) -> str:
        m, k = self.values.shape
        series = "" if k == 1 else f" of {k} series"
        averaged = ", averaged" if self.average else ""
        return (
            f"<{type(self).__name__} on {counted(self.n, 'dof')}: {counted(m, 'sample')}{series}, "
            f"dt = {self.dt:g}, to t = {(m - 1) * self.dt:g}{averaged}>"
        )

    def _core(self, order: np.ndarray, scale: np.ndarray | None = None) -> forms.Load:
        values, shape = self.values, self.shape
        if shape is None:
            values = np.ascontiguousarray(values[:, order])
            values = values if scale is None else values / scale
        else:
            shape = np.ascontiguousarray(shape[order].T)
            shape = shape if scale is None else shape / scale
        return forms.Sampled(values, shape, self.dt, self.hold, self._begin)

    def _at_times(self, t: np.ndarray, n: int) -> np.ndarray:
        series = self._series(t)
        return series if self.shape is None else series @ self.shape.T

    @property
    def _samples(self) -> Samples:  # type: ignore[override]
        weights = np.ones(self.values.shape[1])
        if self.shape is not None:
            weights = np.linalg.norm(self.shape / (np.abs(self.shape).max() or 1.0), axis=0)
        return Samples(self.values, self.dt, self.hold, weights)

    def _facts(self) -> str:
        shape = "" if self.shape is None else f", shape {checksum(self.shape)}"
        average = ", average" if self.average else ""
        return f"{type(self).__name__} {checksum(self.values)}, dt {self.dt!r}{shape}{average}"

    def _largest(self) -> np.ndarray:
        samples = self.values if self.shape is None else self.values @ self.shape.T
        largest: np.ndarray = np.abs(samples).max(axis=0)
        return largest

    def _slope(self) -> np.ndarray:
        slope: np.ndarray = (self(self.dt) - self(0.0)) / self.dt
        return slope

    def _projected(self, T: np.ndarray) -> SampledForce:
        return self._changed(shape=T.T if self.shape is None else T.T @ self.shape, direction=None)

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> SampledForce:
        if self.shape is None:
            return self._changed(values=share * self.values[:, dofs])
        direction = None if self.direction is None else self.direction[dofs]
        shares = np.broadcast_to(share, np.shape(dofs))[:, None]
        return self._changed(shape=shares * self.shape[dofs], direction=direction)

    def _series(self, t: np.ndarray) -> np.ndarray:
        """The k samples at (m,) times, (m, k), for t >= 0, evaluated like in the core."""
        places = _places(t, self._begin, self.dt, len(self.values) - 1)
        series = self._between(places._replace(share=places.share[:, None]))
        if not self.hold:
            series[places.is_over] = 0.0
        return series

    def _between(self, places: _Places) -> np.ndarray:
        s = places.share
        result: np.ndarray = (1.0 - s) * self.values[places.j] + s * self.values[places.after]
        return result

    def _changed(self, **attributes: Any) -> Self:
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__, **attributes)
        return new

    def __call__(self, t: float) -> np.ndarray:
        """F(t), shape (n,), for t >= 0, evaluated like in the core."""
        place = _place(t, self._begin, self.dt, len(self.values) - 1)
        sample = self._between(place)
        if place.is_over and not self.hold:
            sample[:] = 0.0
        result: np.ndarray = sample if self.shape is None else self.shape @ sample
        return result


class _Places(NamedTuple):
    """Times among samples: those before and after, the share of the latter, whether all are before.

    Arrays, or of one time the numbers.
    """

    j: Any
    after: Any
    share: Any
    is_over: Any


def _places(t: np.ndarray, begin: float, dt: float, last: int) -> _Places:
    """Of (m,) times, among the samples 0..last from `begin` on."""
    x = _position((t - begin) / dt)
    j = np.minimum(np.maximum(x, 0.0), max(last - 1, 0)).astype(np.int64)
    return _Places(j, np.minimum(j + 1, last), np.minimum(x, last) - j, x > last)


@lru_cache(maxsize=64)
def _place(t: float, begin: float, dt: float, last: int) -> _Places:
    """Of one time: many loads have the same times."""
    return _Places(*(x.item() for x in _places(np.array([t]), begin, dt, last)))


def _position(x: np.ndarray) -> np.ndarray:
    """Times x in samples, moved to the nearest sample within the rounding of three operations.

    Otherwise a record could end one step early.
    """
    nearest = np.rint(x)
    return np.where(np.abs(x - nearest) <= 16.0 * float_info.epsilon * nearest, nearest, x)


class BaseAcceleration(SampledForce):
    """Load of a ground motion: -M direction record(t), with displacements relative to the ground.

    Without M it is that of the mass of its subdomain, in which ``s.force`` has it. Outputs
    ``"absolute a"``, ``"absolute v"`` and ``"absolute u"`` of `Coupler.run` add the motion of the
    ground.

    Parameters
    ----------
    record : Record, or (m,) or (m, k) array
        Ground acceleration at t = 0, dt, 2 dt, ..., in the unit of u / t^2 (multiply a record in
        units of g by g). Zero after its end. Between samples and between steps as for
        `SampledForce`.
    direction : str, dict, (n,) or (n, k) array, optional
        Displacement of each dof for a unit displacement of the ground. Where dofs have names, as of
        a mesh, a component, ``"ux"``, or several with factors, ``{"ux": 1.0, "uy": 0.4}``. For a
        record of several series a list of these, one each, or a column each. Default: ones, where
        all dofs are displacements along the ground motion; refused for dofs of several components.
    M : (n,) or (n, n) array or scipy.sparse matrix, optional
        The mass matrix of the same subdomain; another one is refused there.
    dt : float
        Time between two samples, positive. A Record has it.
    average : bool, default False
        As for `SampledForce`: True takes means over the steps of the subdomain.

    Raises
    ------
    ValueError, TypeError
        As for `SampledForce` and the matrices of `Subdomain`.

    Examples
    --------
    >>> quake = BaseAcceleration([0.0, 3.0], dt=0.02)
    >>> tower = Subdomain([10.0, 20.0], [5.0, 5.0], scheme=Newmark(), force=quake)
    >>> tower.force(0.02).tolist()
    [-30.0, -60.0]
    """

    hold = False
    _is_ground, _prescribes = True, False
    # (n, k): the force is -M direction s(t) of the mass of its subdomain
    direction: np.ndarray | None = None
    _values_name, _shape_name = "record", "direction"
    # whose mass it has: "own", that of any subdomain; "given", by the user, to be compared; "part"
    # of a load of a larger structure
    _mass = "own"
    # components for each series, until a subdomain gives the names of its dofs
    _along: tuple[Any, ...] = ()
    _is_left_out = False  # the direction: ones

    def __init__(
        self,
        record: Any,
        direction: Any = None,
        M: MatrixLike | None = None,
        *,
        dt: float | None = None,
        average: bool = False,
    ):
        values, dt = _samples(record, dt)
        mass, n = (None, None) if M is None else canonical(M, "M")
        named = _named_directions(direction)
        if named and M is not None:
            raise ValueError(
                f"M must be left out where direction is a component, got both with {direction!r}: "
                "names of dofs and the mass are those of the subdomain"
            )
        if named:
            self._along, direction = named, None
        self._is_left_out = direction is None and not named
        if direction is not None:
            direction = _directions(direction, n)
        elif n is not None:
            direction = np.ones((n, 1))
        self.direction = direction
        if M is not None:
            direction = against(mass, direction)
            self._mass = "given"
        super().__init__(values, dt, direction, average=average)
        if M is None:
            object.__setattr__(self, "shape", None)

    @property
    def n(self) -> int:
        """Number of dofs the force acts on; 0 where its subdomain has to give it."""
        known = self.direction if self.shape is None else self.shape
        return 0 if known is None else len(known)

    def __repr__(self) -> str:
        of = "" if self.shape is not None else ", of the mass of its subdomain"
        return super().__repr__().replace(" on 0 dofs", "")[:-1] + f"{of}>"

    def __call__(self, t: float) -> np.ndarray:
        """F(t), shape (n,), for t >= 0, evaluated like in the core."""
        if self.shape is None:
            raise TypeError(
                "a BaseAcceleration without M has a value in its subdomain only, s.force(t)"
            )
        return super().__call__(t)

    def _of(self, mass: Mass, n: int, name: str) -> BaseAcceleration:
        """The load of a subdomain with this mass; ValueError for another M that was given."""
        if self._mass == "part":
            return self
        direction = self._directions(mass, n, name)
        if direction.shape[1] != self.values.shape[1]:
            raise ValueError(_columns_differ(self, direction.shape[1]))
        shape = mass.against(direction)
        if self._mass == "own":
            return self._changed(shape=shape, direction=direction)
        assert self.shape is not None  # that of the M given
        if np.array_equal(self.shape, shape):
            return self
        largest = np.abs(shape).max()
        wrong = np.abs(self.shape - shape).max(axis=1)
        if wrong.max() <= SAME_MASS * largest:
            return self
        dof = int(np.argmax(wrong))
        raise ValueError(
            f"M of the BaseAcceleration in {name} must be the mass matrix of the subdomain, or be "
            f"left out; got one that gives {self.shape[dof, 0]:g} at dof {dof} for a unit "
            f"acceleration, not {shape[dof, 0]:g}"
        )

    def _with_mass(self, M: Matrix | None) -> BaseAcceleration:
        if self.direction is None:
            return self
        return self._changed(shape=-product(M, self.direction))

    def _directions(self, mass: Mass, n: int, name: str) -> np.ndarray:
        """The columns of direction for these dofs."""
        if self.direction is not None and not self._is_left_out:
            return self.direction
        if self._along:
            what = f"direction of the BaseAcceleration in {name}"
            return np.column_stack([along(x, mass.names, what) for x in self._along])
        several = [x for x in dict.fromkeys(components_of(mass.names, numbered=True)) if x]
        if len(several) > 1:
            raise ValueError(
                f"direction of the BaseAcceleration in {name} must be given where dofs are of "
                f"several components, {listing(several)}: {several[0]!r}, a dict of components and "
                f"factors, or a number for each dof; got none, which would move all alike"
            )
        return np.ones((n, 1))

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> SampledForce:
        return super()._part(dofs, share)._changed(_mass="part")

    def _projected(self, T: np.ndarray) -> SampledForce:
        return super()._projected(T)._changed(_mass="part")


def _samples(record: Any, dt: Any) -> tuple[Any, Any]:
    """The samples and dt of a Record, or those that are given."""
    if isinstance(record, Record):
        if dt is not None and dt != record.dt:
            raise ValueError(f"dt must be {record.dt!r} as in {record!r}, got {dt!r}")
        return record.values, record.dt
    if dt is None:
        raise TypeError(
            "dt must be given with an array, BaseAcceleration(values, direction, M, dt=0.01); a "
            f"Record has it{_table(plain_array(record, 'record'))}"
        )
    return record, dt


def _named_directions(direction: Any) -> tuple[Any, ...]:
    """Directions by components, one for each series; empty for arrays."""
    items = direction if isinstance(direction, (list, tuple)) else [direction]
    named = [isinstance(x, (str, Mapping)) for x in items]
    if any(named) and not all(named):
        raise TypeError(
            "direction must be components for all series of the record, or numbers, got "
            f"{direction!r}"
        )
    return tuple(dict(x) if isinstance(x, Mapping) else x for x in items) if any(named) else ()


def _directions(direction: Any, n: int | None) -> np.ndarray:
    if plain_array(direction, "direction").ndim == 0:
        rule = "a number for each dof" if n is None else f"have shape ({n},)"
        got = f"one number, {direction!r}; dt is a keyword, dt=0.01"
        raise ValueError(f"direction must {'be ' if n is None else ''}{rule}, got {got}")
    columns = _columns(direction, "direction")
    if n not in (None, len(columns)):
        raise ValueError(f"M must be of size {len(columns)} like direction, got size {n}")
    return columns


def _columns_differ(force: SampledForce, columns: int) -> str:
    """What is wrong with another number of columns than there are series."""
    values = force.values
    return (
        f"{force._shape_name} must have a column for each of the {values.shape[1]} series of "
        f"{force._values_name}, got {columns}{_table(values)}"
    )


def _table(values: np.ndarray) -> str:
    """What an error adds for values whose first column may be time."""
    if values.ndim != 2 or values.shape[1] < 2 or values.dtype.kind not in "iuf":
        return ""
    rises = len(values) > 2 and bool(np.all(np.diff(values[:, 0]) > 0.0))
    return (
        "; if the first column is time, take readers.Record.from_times(t, values)" if rises else ""
    )


def _columns(value: Any, name: str) -> np.ndarray:
    array = real_array(value, name, (1, 2))
    if array.size == 0:
        raise ValueError(f"{name} must not be empty, got shape {array.shape}")
    return array.reshape(len(array), -1)
