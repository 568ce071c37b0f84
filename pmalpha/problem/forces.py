"""Loads: the values that ``force`` of a subdomain can have.

A load is evaluated at the end of a step only, as its value there or as a mean (docs/method.md).
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from sys import float_info
from typing import Any, TypeAlias, TypeGuard, overload

import numpy as np
from scipy import LowLevelCallable

from .._checks import counted, flag, real_array, time_step, vector
from .argument_types import MatrixLike
from .frozen import Frozen
from .lowlevel import check_signature
from .matrices import canonical, product
from .record import Record, takes_record

__all__ = ["BaseAcceleration", "SampledForce"]


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
        change, (L5); nothing is delayed, and the order of accuracy remains; t = 0 takes the mean
        over the first half step. Frequencies
        near those of the steps are damped, not removed: filter the record for that. Calling the
        object returns F(t) itself.

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
            raise ValueError(
                f"{self._shape_name} must have a column for each of the {self.values.shape[1]} "
                f"series of {self._values_name}, got {self.shape.shape[1]}"
            )
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
        last = len(self.values) - 1
        x = _position((t - self._begin) / self.dt)
        j = np.clip(x, 0, max(last - 1, 0)).astype(np.int64)
        s = (np.minimum(x, last) - j)[:, None]
        f, after = self.values[j], self.values[np.minimum(j + 1, last)]
        series: np.ndarray = (1.0 - s) * f + s * after
        if not self.hold:
            series[x > last] = 0.0
        return series

    def _changed(self, **attributes: Any) -> SampledForce:
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__, **attributes)
        return new

    def __call__(self, t: float) -> np.ndarray:
        """F(t), shape (n,), for t >= 0, evaluated like in the core."""
        sample = self._series(np.array([t]))[0]
        result: np.ndarray = sample if self.shape is None else self.shape @ sample
        return result


def _position(x: np.ndarray) -> np.ndarray:
    """Times x in samples, moved to the nearest sample within the rounding of three operations.

    Otherwise a record could end one step early.
    """
    nearest = np.rint(x)
    return np.where(np.abs(x - nearest) <= 16.0 * float_info.epsilon * nearest, nearest, x)


class BaseAcceleration(SampledForce):
    """Load of a ground motion: -M direction record(t), with displacements relative to the ground.

    Parameters
    ----------
    record : (m,) or (m, k) array, or Record
        Ground acceleration at t = 0, dt, 2 dt, ..., in the unit of u / t^2 (multiply a record in
        units of g by g). Zero after its end. Between samples and between steps as for
        `SampledForce`. A Record has its dt: ``BaseAcceleration(record, direction, M)``.
    dt : float
        Time between two samples, positive.
    direction : (n,) or (n, k) array
        Displacement of each dof for a unit displacement of the ground; a column for each record.
    M : (n,) or (n, n) array or scipy.sparse matrix
        The mass matrix of the same subdomain.
    average : bool, default False
        As for `SampledForce`: True takes means over the steps of the subdomain.

    Raises
    ------
    ValueError, TypeError
        As for `SampledForce` and the matrices of `Subdomain`.

    Examples
    --------
    >>> quake = BaseAcceleration([0.0, 3.0], dt=0.02, direction=[1.0, 1.0], M=[10.0, 20.0])
    >>> quake(0.02).tolist()
    [-30.0, -60.0]
    """

    hold = False
    _values_name, _shape_name = "record", "direction"

    @overload
    def __init__(self, record: Record, direction: Any, M: MatrixLike, *, average: bool = False): ...

    @overload
    def __init__(
        self, record: Any, dt: float, direction: Any, M: MatrixLike, *, average: bool = False
    ): ...

    @takes_record
    def __init__(
        self, record: Any, dt: float, direction: Any, M: MatrixLike, *, average: bool = False
    ):
        direction = _columns(direction, "direction")
        mass, n = canonical(M, "M")
        if n != len(direction):
            raise ValueError(f"M must be of size {len(direction)} like direction, got size {n}")
        with np.errstate(over="ignore"):  # refused next
            shape = -product(mass, direction)
        if not np.all(np.isfinite(shape)):
            raise ValueError("M times direction must be finite")
        self.direction = direction
        super().__init__(record, dt, shape, average=average)


def _columns(value: Any, name: str) -> np.ndarray:
    array = real_array(value, name, (1, 2))
    if array.size == 0:
        raise ValueError(f"{name} must not be empty, got shape {array.shape}")
    return array.reshape(len(array), -1)


Force: TypeAlias = np.ndarray | SampledForce | Callable[..., Any] | LowLevelCallable | None


def checked_force(force: Any, n: int, name: str = "force") -> Force:
    """A user's force, checked against the number of dofs as far as possible without calling it."""
    if force is None:
        return None
    if isinstance(force, SampledForce):
        if force.n != n:
            kind = type(force).__name__
            what = counted(n, "dof" if name == "force" else "row")
            raise ValueError(f"{name} must act on {what}, got a {kind} on {force.n}")
        return force
    if isinstance(force, LowLevelCallable) and name == "force":
        check_signature(force, name)
        return force
    if isinstance(force, LowLevelCallable):
        raise TypeError(f"{name} must not be a LowLevelCallable")
    if callable(force):
        count = required_arguments(force)
        if count == 1 or count == 3 and name == "force":
            return force
        rule = "t alone, or of t, u and v" if name == "force" else "t alone"
        raise TypeError(
            f"{name} must be a function of {rule}, got one with {count} required arguments: "
            f"{force!r}"
        )
    return vector(force, n, name)


def required_arguments(function: Callable[..., Any]) -> int:
    """Positional arguments that a function requires; 1 if it can be called with one.

    A function without a readable signature, such as a compiled one, is taken as one of t.
    """
    try:
        parameters = signature(function).parameters.values()
    except (TypeError, ValueError):
        return 1
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    required = sum(p.default is p.empty for p in positional)
    takes_one = bool(positional) or any(p.kind == p.VAR_POSITIONAL for p in parameters)
    return 1 if required == 0 and takes_one else required


def depends_on_motion(force: Force) -> TypeGuard[Callable[..., Any]]:
    """True for a force f(t, u, v), which is evaluated like a restoring force."""
    return is_function(force) and required_arguments(force) == 3


def core_load(force: Force, order: np.ndarray) -> Any:
    """A force that is not a Python callable of t, in a form of the core, in elimination order."""
    if force is None:
        return None
    if isinstance(force, np.ndarray):
        return force[order]
    if isinstance(force, LowLevelCallable):
        return force, order
    if depends_on_motion(force):
        return None  # part of the restoring forces
    assert isinstance(force, SampledForce)
    times = force.dt, force.hold, force._begin
    if force.shape is None:
        return np.ascontiguousarray(force.values[:, order]), None, *times
    return force.values, np.ascontiguousarray(force.shape[order].T), *times


def is_callback(force: Force) -> TypeGuard[Callable[[float], Any]]:
    """True for a force that is a Python callable of t alone, to be evaluated in advance."""
    return is_function(force) and not depends_on_motion(force)


def is_function(force: Force) -> TypeGuard[Callable[..., Any]]:
    return callable(force) and not isinstance(force, SampledForce)
