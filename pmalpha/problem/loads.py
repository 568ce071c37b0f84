"""Loads: the values that ``force`` of a subdomain can have.

A load is evaluated at the end of a step only, as its value there or as a mean (docs/method.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from numbers import Number
from sys import float_info
from typing import Any, NamedTuple, Self, TypeAlias, TypeGuard, overload

import numpy as np
from scipy import LowLevelCallable

from .._cached import Frozen
from .._checks import counted, flag, listing, plain_array, real_array, time_step, vector
from . import forms
from .arguments import OF_FORCE, MatrixLike, check_order, check_signature, required_names
from .dofs import along, components_of
from .matrices import Matrix, canonical, product
from .records import Record, takes_record

__all__ = ["BaseAcceleration", "SampledForce"]

# Rounding of M times a direction, relative to its largest entry: of two forms of one matrix.
SAME_MASS = 1e-9


class SampledForce(Frozen):
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
    _values_name, _shape_name = "values", "shape"
    _begin = 0.0  # the time of the first sample
    # (n, k), of a ground motion: the force is -M direction s(t) of the mass of its subdomain
    direction: np.ndarray | None = None

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

    def _projected(self, T: np.ndarray) -> SampledForce:
        """The force T^T F(t) on other coordinates, with the displacements T u; T is (n, r)."""
        return self._changed(shape=T.T if self.shape is None else T.T @ self.shape, direction=None)

    def _part(self, dofs: np.ndarray, share: np.ndarray | float = 1.0) -> SampledForce:
        """The force on some dofs, each entry times its share."""
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
            direction = _against(mass, direction)
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


def _against(M: Matrix | None, direction: np.ndarray) -> np.ndarray:
    """-M direction, finite."""
    with np.errstate(over="ignore"):  # refused next
        shape = -product(M, direction)
    if not np.all(np.isfinite(shape)):
        raise ValueError("M times direction must be finite")
    return shape


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


Term: TypeAlias = np.ndarray | SampledForce | Callable[..., Any] | LowLevelCallable
# Several loads act together, as a tuple.
Force: TypeAlias = Term | tuple[Term, ...] | None


def checked_force(force: Any, n: int, name: str = "force", mass: Mass | None = None) -> Force:
    """A user's force, checked against the number of dofs as far as possible without calling it.

    mass: that of the dofs, of which ground motions are; None where there are none.
    """
    if isinstance(force, (list, tuple)) and not isinstance(force, LowLevelCallable):
        if not force:
            one = "a velocity" if name == "velocity" else "a load, or a list of loads"
            raise ValueError(f"{name} must be {one}, got an empty list; None is none")
        if any(x is None for x in force):
            i = next(i for i, x in enumerate(force) if x is None)
            raise TypeError(f"{name}[{i}] must be a load or a number, got None")
    if name != "velocity" and is_list_of_loads(force):
        terms = [checked_force(x, n, f"{name}[{i}]", mass) for i, x in enumerate(force)]
        return _together([x for term in terms for x in terms_of(term)])
    if force is None:
        return None
    if isinstance(force, BaseAcceleration) and mass is not None and force.n in (0, n):
        force = force._of(mass, n, name)
    if isinstance(force, SampledForce):
        if force.n != n:
            kind = type(force).__name__
            what = counted(n, "row" if name == "velocity" else "dof")
            raise ValueError(f"{name} must act on {what}, got a {kind} on {force.n}")
        return force
    if isinstance(force, LowLevelCallable) and name != "velocity":
        check_signature(force, "force")
        return force
    if isinstance(force, LowLevelCallable):
        raise TypeError(f"{name} must not be a LowLevelCallable")
    if callable(force):
        count = required_arguments(force)
        if count == 1 or count == 3 and name != "velocity":
            check_order(force, OF_FORCE, name)
            return force
        rule = "t alone" if name == "velocity" else "t alone, or of t, u and v"
        raise TypeError(
            f"{name} must be a function of {rule}, got one with {count} required arguments: "
            f"{force!r}"
        )
    return vector(force, n, name)


class Mass:
    """A mass matrix in inner form, None is zero, and its forces against unit ground motions.

    names: those of its dofs, or None.
    """

    def __init__(self, M: Matrix | None, names: Sequence[str] | None = None):
        self.M, self.names = M, names
        self._forces: dict[tuple[Any, ...], np.ndarray] = {}

    def against(self, direction: np.ndarray) -> np.ndarray:
        """-M direction, finite; that of equal directions is one array."""
        key = direction.shape, direction.tobytes()
        if key not in self._forces:
            self._forces[key] = _against(self.M, direction)
        return self._forces[key]


def has_ground(force: Any) -> bool:
    """Whether a user's force has a ground motion."""
    if isinstance(force, (list, tuple)) and not isinstance(force, LowLevelCallable):
        return any(map(has_ground, force))
    return isinstance(force, BaseAcceleration)


def is_list_of_loads(force: Any) -> bool:
    """Whether something in it is a load; a list with a number is the force on each dof."""
    if not isinstance(force, (list, tuple)) or isinstance(force, LowLevelCallable):
        return False
    return not any(isinstance(x, Number) for x in force) and any(
        x is None
        or callable(x)
        or isinstance(x, LowLevelCallable)
        or isinstance(x, np.ndarray)
        and x.ndim > 0
        or is_list_of_loads(x)
        for x in force
    )


def _together(terms: Sequence[Term]) -> Force:
    """Loads that act together, in their order; constant ones are added."""
    constant = [x for x in terms if isinstance(x, np.ndarray)]
    loads = [x for x in terms if not isinstance(x, np.ndarray)]
    result = [sum(constant[1:], constant[0]), *loads] if constant else loads
    if len(result) < 2:
        return result[0] if result else None
    return tuple(result)


def terms_of(force: Force) -> tuple[Term, ...]:
    """The loads that act together."""
    if force is None:
        return ()
    if isinstance(force, tuple) and not isinstance(force, LowLevelCallable):
        return force
    return (force,)


def each_term(force: Force, change: Callable[[Term], Any]) -> Force:
    """The sum of changed loads."""
    return _together([change(x) for x in terms_of(force)])


def required_arguments(function: Callable[..., Any]) -> int:
    """Number of positional arguments that a function requires; 1 where its signature is not
    readable, as of a compiled one."""
    names = required_names(function)
    return 1 if names is None else len(names)


def is_of_motion(force: Term) -> TypeGuard[Callable[..., Any]]:
    """True for a force f(t, u, v), which is evaluated like a restoring force."""
    return is_function(force) and required_arguments(force) == 3


def depends_on_motion(force: Force) -> bool:
    """Whether some of it is a force f(t, u, v)."""
    return any(map(is_of_motion, terms_of(force)))


def core_load(
    force: Force, order: np.ndarray, tables: Sequence[forms.Table] = ()
) -> forms.Load | tuple[forms.Load, ...]:
    """A force in a form of the core, in elimination order, without Python callables.

    tables: values of callables of t.
    """
    terms = [_core_term(x, order) for x in terms_of(force) if not is_function(x)]
    terms += tables
    return tuple(terms) if len(terms) > 1 else terms[0] if terms else None


def _core_term(force: Any, order: np.ndarray) -> forms.Load:
    if isinstance(force, np.ndarray):
        values: np.ndarray = force[order]
        return values
    if isinstance(force, LowLevelCallable):
        return forms.Called(force, order)
    assert isinstance(force, SampledForce)
    times = force.dt, force.hold, force._begin
    if force.shape is None:
        return forms.Sampled(np.ascontiguousarray(force.values[:, order]), None, *times)
    return forms.Sampled(force.values, np.ascontiguousarray(force.shape[order].T), *times)


def is_callback(force: Any) -> TypeGuard[Callable[[float], Any]]:
    """True for a force that is a Python callable of t alone, to be evaluated in advance."""
    return is_function(force) and not is_of_motion(force)


def is_function(force: Any) -> TypeGuard[Callable[..., Any]]:
    return callable(force) and not isinstance(force, SampledForce)


def summed(functions: Sequence[Callable[..., Any]], n: int, what: str) -> Callable[..., Any] | None:
    """The sum of functions of the same arguments, t first, each (n,); None without.

    what: its name in messages, such as "force of subdomain 'rig'".
    """
    if len(functions) < 2:
        return functions[0] if functions else None

    def total(t: float, *motion: np.ndarray) -> np.ndarray:
        values = [f(t, *(x.copy() for x in motion)) for f in functions]
        try:
            return sum((vector(x, n, "the value of each function") for x in values), np.zeros(n))
        except (TypeError, ValueError) as error:
            raise type(error)(f"{what} at t = {t:g}: {error}") from None

    return total
