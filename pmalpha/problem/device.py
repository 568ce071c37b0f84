"""What is between the commands of a run and a specimen, and what both are for the core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields
from itertools import takewhile
from typing import Any, ClassVar

import numpy as np
from scipy import LowLevelCallable

import pmalpha._core as _core

from .._cached import Frozen
from .._checks import (
    called,
    plain_array,
    positive_number,
    real_array,
    real_number,
    time_step,
    vector,
    whole_number,
)
from ..errors import LimitError
from . import forms
from .arguments import OF_RESTORING, check_order, check_signature
from .dofs import dof_list
from .springs import Spring, core_springs

# ---- external ------------------------------------------------------------------------------------
# A specimen that is not in this program: what a frozen model leaves to the loop.


class External(Frozen):
    """A specimen that is not in this program, for ``restoring=`` of a `Subdomain`.

    Its force is an input of a frozen model or of an FMU: ``inputs={"column": ("specimen", "rig",
    0)}``. Here nothing can be stepped: `Coupler.run` and `step` refuse it.

    Parameters
    ----------
    dofs : int, str, or (k,) array of int or str, optional
        The dofs on which the specimen acts. Default: all of the subdomain.
    force : float, (k,) array, or dict by dof, default 0.0
        Its force at the start, on the left-hand side as restoring forces are, for the initial
        accelerations.

    Raises
    ------
    TypeError, ValueError
        For a force that is no finite number, or not one for each dof.

    Examples
    --------
    >>> column = rig.External([0], force=12.0)
    >>> frame = Subdomain([2.0, 1.0], [300.0, 200.0], scheme=Newmark(), restoring=column,
    ...                   restoring_stiffness=[250.0, 0.0], name="frame")
    >>> frame.restoring
    <External on dof 0, force 12 at the start>
    """

    repeatable = False  # as `Coupler.estimate_error` has to know

    def __init__(self, dofs: Any = None, *, force: Any = 0.0):
        self.dofs = dofs
        by_dof = isinstance(force, Mapping)
        self.force = dict(force) if by_dof else real_array(force, "force", (0, 1))
        self.at_start: np.ndarray | None = None  # (n,), in a subdomain
        self._freeze()

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> External:
        """The same with numbers of dofs of a subdomain; `label` is that of the argument."""
        what = f"{label}: dofs of an External"
        dofs = np.arange(n) if self.dofs is None else dof_list(self.dofs, n, what, names)
        values = np.zeros(n)
        if isinstance(self.force, dict):
            for dof, value in self.force.items():
                (number,) = dof_list(dof, n, f"{label}: force of an External", names)
                if number not in dofs:
                    raise ValueError(
                        f"{label}: force of an External must be on its dofs, got one on {dof!r}"
                    )
                values[number] = real_array(value, f"{label}: force of an External", (0,))
        elif self.force.ndim == 0 or self.force.size == dofs.size:
            values[dofs] = self.force
        else:
            raise ValueError(
                f"{label}: force of an External must be a number, or one for each of {dofs.size} "
                f"dofs, got {self.force.size}"
            )
        placed = object.__new__(External)
        placed.__dict__.update(dofs=dofs, force=self.force, at_start=values, _is_frozen=True)
        return placed

    def __repr__(self) -> str:
        if self.at_start is None:
            return f"<External on dofs {self.dofs!r}>" if self.dofs is not None else "<External>"
        dofs = ", ".join(map(str, self.dofs.tolist()))
        forces = ", ".join(f"{x:g}" for x in self.at_start[self.dofs])
        return f"<External on dof{'s' * (self.dofs.size > 1)} {dofs}, force {forces} at the start>"

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Its force at the start; ValueError later, since it is not in this program."""
        if t > 0.0 or self.at_start is None:
            raise ValueError(OUTSIDE)
        return self.at_start.copy()


OUTSIDE = (
    "an External specimen is not in this program, which cannot step it: freeze or export_fmu the "
    "coupler with its dofs as inputs, or give its force as a function, restoring=f"
)


# Substeps of a delay that needs no further word.
DEFAULT_STEPS = 100


@dataclass(frozen=True)
class Response:
    """What a specimen does under given commands.

    Attributes
    ----------
    force, measured : array
        Forces, and displacements that were measured, shaped as the commands.
    """

    force: np.ndarray
    measured: np.ndarray


class Device:
    """What is between the commands of a run and a specimen.

    Attributes
    ----------
    compensates : bool
        Whether it changes commands so that the specimen follows in time.
    leads : bool
        Whether it is a part of the program that runs a test, and not of a simulated rig.
    needs_measured : str
        What needs the measured displacement, in messages; "": nothing does.
    needs_acceleration : bool
        Whether it needs the velocity and the acceleration of commands at their own time (Y18).
    """

    compensates = leads = needs_acceleration = False
    needs_measured = ""

    def __init__(self, specimen: Any, delay: float, max_steps: int):
        self.delay = real_number(delay, "delay", low=0.0)
        self.max_steps = whole_number(max_steps, "max_steps", low=1)
        self.specimen: Any = specimen
        if isinstance(specimen, Device):
            return
        if isinstance(specimen, LowLevelCallable):
            check_signature(specimen, "restoring", "specimen")
            return
        springs = tuple(specimen) if isinstance(specimen, (list, tuple)) else (specimen,)
        if springs and all(isinstance(item, Spring) for item in springs):
            self.specimen = springs
        elif not callable(specimen):
            raise TypeError(
                "specimen must be a callable, a LowLevelCallable, springs, or one of these behind "
                f"an actuator or a compensator, got {specimen!r}"
            )
        else:
            check_order(specimen, OF_RESTORING, "specimen")

    @property
    def innermost(self) -> Any:
        """The springs, a tuple, or the function that the last command reaches."""
        inner = self.specimen
        return inner.innermost if isinstance(inner, Device) else inner

    @property
    def width(self) -> int | None:
        """Number of commands; None: that of the dofs of the subdomain."""
        inner = self.specimen
        return inner.width if isinstance(inner, Device) else None

    @property
    def dofs(self) -> np.ndarray | None:
        """The dofs of the commands; None: all dofs of the subdomain."""
        inner = self.specimen
        return inner.dofs if isinstance(inner, Device) else None

    @property
    def springs(self) -> tuple[Spring, ...]:
        """The springs of the specimen, if it is made of them."""
        inner = self.innermost
        return inner if type(inner) is tuple else ()

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> Device:
        """The same with numbers of dofs in the springs; `label` is that of the argument."""
        inner = self.specimen
        if isinstance(inner, Device):
            moved = copy(self)
            moved.specimen = inner._placed(n, names, label)
            moved._check_width(n, label)
            return moved
        if isinstance(inner, External):
            self._check_width(n, label)
            moved = copy(self)
            moved.specimen = inner._placed(n, names, label)
            return moved
        springs = self.springs
        placed = tuple(spring._placed(n, names, label) for spring in springs)
        self._check_width(n, label)
        if all(one is other for one, other in zip(springs, placed)):
            return self
        moved = copy(self)
        moved.specimen = placed
        return moved

    def _check_width(self, n: int, label: str) -> None:
        """ValueError where it is not for the commands of a specimen in a subdomain of n dofs."""

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        raise NotImplementedError

    def _filter(self, h: float, width: int) -> forms.Filter:
        """The filter in the form of the core, for steps of length h and this number of commands."""
        raise NotImplementedError

    def _linear(self, h: float) -> forms.Linear:
        """The linear system for the core, of one that has no specimen, with steps of length h."""
        raise NotImplementedError

    def _check_delays(self, h: float, what: str) -> None:
        """ValueError for a delay of more than `max_steps` steps of length h."""
        inner = self.specimen
        if isinstance(inner, Device):
            inner._check_delays(h, what)
        if self.delay > self.max_steps * h * (1.0 + 1e-9):
            raise ValueError(
                f"delay of {type(self).__name__}, {what}, must be at most max_steps = "
                f"{self.max_steps} substeps of {h:g}, got {self.delay:g}, {self.delay / h:.3g} "
                "substeps; it is in the unit of t"
            )

    def __repr__(self) -> str:
        return f"<{self.facts}>"

    def respond(
        self, command: Any, dt: float, velocity: Any = None, acceleration: Any = None
    ) -> Response:
        """Forces and measured displacements under given commands, without a structure.

        Parameters
        ----------
        command : (k,) or (k, n) array
            Displacements at t = 0, dt, 2 dt, ...; at rest before.
        dt : float
            Time between two commands.
        velocity, acceleration : like command, optional
            Default: central differences of the command and of the velocity.

        Returns
        -------
        Response
            Has ``.force`` and ``.measured``, shaped as the command.

        Examples
        --------
        >>> late = rig.SimulatedActuator(lambda t, u, v: 2.0 * u, delay=0.02)
        >>> late.respond([0.0, 1.0, 0.0, 0.0, 0.0], 0.01).force
        array([0., 0., 0., 2., 0.])
        """
        d = real_array(command, "command", (1, 2))
        dt = time_step(dt, "dt")
        if d.shape[0] < 2:
            raise ValueError(f"command must have at least 2 rows, got {d.shape[0]}")
        v = _rate(d, velocity, "velocity", dt)
        a = _rate(v, acceleration, "acceleration", dt)
        shape = d.shape if d.ndim == 2 else (d.size, 1)
        if self.width not in (None, shape[1]):
            raise ValueError(f"command must have {self.width} columns, got {shape[1]}")
        placed = self._placed(shape[1], None, "specimen") if self.width is None else self
        specimen = core_specimen(placed, shape[1], dt, "the specimen")._replace(dofs=None)
        t = dt * np.arange(shape[0])
        flat = (np.ascontiguousarray(x.reshape(shape)) for x in (d, v, a))
        force, measured = _core.follow_specimen(specimen, t, *flat)
        return Response(force.reshape(d.shape), measured.reshape(d.shape))


def _rate(x: np.ndarray, rate: Any, name: str, dt: float) -> np.ndarray:
    """The rate of x: given, or by central differences."""
    if rate is None:
        return np.asarray(np.gradient(x, dt, axis=0))
    values = real_array(rate, name, (1, 2))
    if values.shape != x.shape:
        raise ValueError(f"{name} must have shape {x.shape}, got {values.shape}")
    return values


class CheckedSpecimen:
    """A Python specimen for the core: r, or (r, x) with the measured displacement."""

    def __init__(self, function: Any, n: int, what: str, *, needs_measured: str):
        self.function, self.n, self.what = function, n, what
        self.needs_measured = needs_measured
        self.preset: np.ndarray | None = None  # what counts in its place, without a call

    def __call__(self, t: float, u: np.ndarray, v: np.ndarray) -> Any:
        if self.preset is not None:
            return self.preset
        where = f"{self.what} at t = {t:g}"
        r, x = divided(called(self.what, self.function, t, u, v), self.n)
        try:
            if x is None and self.needs_measured:
                raise TypeError(
                    "the specimen must return (r, x), x the measured displacement, for "
                    f"{self.needs_measured}, got r alone"
                )
            force = vector(r, self.n, "its value")
            return force if x is None else (force, vector(x, self.n, "measured displacement x"))
        except (TypeError, ValueError) as error:
            raise type(error)(f"{where}: {error}") from None


def divided(value: Any, n: int) -> tuple[Any, Any]:
    """r and x of what a specimen has returned, x None where it is r alone.

    A tuple of two is (r, x), but for a tuple of two numbers in a subdomain with two dofs.
    """
    if isinstance(value, tuple) and len(value) == 2:
        if n != 2 or plain_array(value[0], "r").ndim or plain_array(value[1], "x").ndim:
            return value
    return value, None


def core_specimen(device: Device, n: int, h: float, what: str) -> forms.Specimen:
    """A device with its specimen for the core, in a subdomain of n dofs with steps of length h."""
    devices = [device]
    while isinstance(devices[-1].specimen, Device):
        devices.append(devices[-1].specimen)
    inner, width = device.innermost, n if device.width is None else device.width
    springs: tuple[forms.Springs, ...] = ()
    function = linear = None
    if device.springs:
        springs = core_springs(inner, np.arange(n))
    elif isinstance(inner, Device):
        linear = devices.pop()._linear(h)
    elif isinstance(inner, LowLevelCallable):
        function = inner
    else:
        function = CheckedSpecimen(inner, n, what, needs_measured=devices[-1].needs_measured)
    leading = sum(1 for _ in takewhile(lambda one: one.leads, devices))
    return forms.Specimen(
        tuple(one._filter(h, width) for one in devices),
        linear,
        springs,
        function,
        device.dofs,
        compensators=max((k + 1 for k in range(leading) if devices[k].compensates), default=0),
        leading=leading,
        h=h if any(one.needs_acceleration for one in devices) else 0.0,
    )


# ---- limits -------------------------------------------------------------------------------------
# Limits of what a test specimen may be commanded and may return.

__all__ = ["External", "Limits"]


@dataclass(frozen=True)
class Limits(Frozen):
    """Limits of a specimen, for ``limits=`` of a `Subdomain` with a restoring force.

    A command is the displacement at which the restoring force is evaluated, once in a substep of
    length h, and what a `Compensated` specimen makes of it; behind a `Linkage`, what it makes of
    it as displacements of the dofs. Both are checked before it is given, and the force when it has
    come; the first one beyond its limit ends the run with a `LimitError`.
    The initial values are the first command, and the force that is evaluated there counts too.
    So the specimen stays at the last command, which was within the limits, and the coupler at its
    last whole macro step.

    Parameters
    ----------
    displacement : float or (n,) array, optional
        Largest absolute command of each dof. All limits are positive; ``inf`` for a dof without.
    velocity : float or (n,) array, optional
        Largest rate of the command, (d_k - d_{k-1}) / h, and of the velocity that the force is
        evaluated at.
    acceleration : float or (n,) array, optional
        Largest acceleration of the command, :math:`(d_k - 2 d_{k-1} + d_{k-2}) / h^2`.
    force : float or (n,) array, optional
        Largest absolute measured force.
    energy : float, optional
        Largest energy that the specimen may have returned beyond what it was given since the run
        began from given values (or the state was loaded), sum of (r_{k-1} + r_k) . (d_k - d_{k-1})
        / 2. A passive specimen returns at most what was stored in it then. A control loop that
        lags returns more and more before the motion grows visibly: an actuator with the delay tau
        before a spring k gives back pi k a^2 sin(omega tau) in each cycle of amplitude a.

    Raises
    ------
    TypeError, ValueError
        For values that are not positive numbers, or no limit at all.

    Examples
    --------
    >>> from pmalpha.rig import Limits
    >>> Limits(displacement=0.02, force=[5e3, 2e3])
    Limits(displacement=0.02, force=[5000.0, 2000.0])
    """

    _is_frozen: ClassVar[bool] = True  # the fields by the dataclass, others by Frozen

    displacement: Any = None
    velocity: Any = None
    acceleration: Any = None
    force: Any = None
    energy: float | None = None

    def __post_init__(self) -> None:
        for name in PER_DOF:
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _checked(value, name))
        if self.energy is not None:
            object.__setattr__(self, "energy", positive_number(self.energy, "energy"))
        if not self._given():
            raise TypeError(f"Limits needs one of {', '.join(x.name for x in fields(self))}")

    def _given(self) -> dict[str, Any]:
        values = {x.name: getattr(self, x.name) for x in fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def __repr__(self) -> str:
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in self._given().items()
        }
        return f"Limits({', '.join(f'{name}={value}' for name, value in values.items())})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Limits) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))


PER_DOF = ("displacement", "velocity", "acceleration", "force")


def _checked(value: Any, name: str) -> float | np.ndarray:
    if np.ndim(value) == 0:
        return positive_number(value, name)
    array = plain_array(value, name)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be a number or a 1-D array of numbers, got {value!r}")
    array = np.array(array, dtype=float)
    if not np.all(array > 0.0):
        raise ValueError(f"{name} must be positive, got {array[~(array > 0.0)][0]:g}")
    array.setflags(write=False)
    return array


def limits_of_dofs(limits: Limits, n: int) -> list[np.ndarray | None]:
    """The first four limits of each dof; None where there is none. ValueError for another n."""
    result: list[np.ndarray | None] = []
    for name in PER_DOF:
        value = getattr(limits, name)
        if isinstance(value, np.ndarray) and value.size != n:
            raise ValueError(
                f"limits: {name} must be a number or have the shape ({n},), got ({value.size},)"
            )
        result.append(None if value is None else np.full(n, value))
    return result


def check_first_command(limits: Limits, subdomain: str, u: np.ndarray, v: np.ndarray) -> None:
    """LimitError for initial values beyond the limits, which are the first command."""
    for name, x, limit in zip(PER_DOF, (u, v), limits_of_dofs(limits, u.size)):
        if limit is not None and (beyond := np.flatnonzero(~(np.abs(x) <= limit))).size:
            dof = int(beyond[0])
            raise LimitError(subdomain, name, dof, float(x[dof]), float(limit[dof]), 0.0)
