"""Specimens behind actuators, and compensators of their delays, equations (Y1) to (Y7)."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
from scipy import LowLevelCallable

from .. import _core
from .._checks import (
    check_word,
    plain_array,
    positive_number,
    real_array,
    real_number,
    time_step,
    vector,
    whole_number,
)
from . import forms
from .argument_order import OF_RESTORING, check_order
from .lowlevel import check_signature
from .springs import Spring, core_springs

# Largest lag of a command, in steps.
LARGEST_LAG = 1 << 20
# Substeps of a delay that needs no further word.
DEFAULT_STEPS = 100
# Of the adaptive compensation: the low-pass filter, samples in a second, and limits of the
# coefficients and of their change in a second, for delays up to 0.06 s.
CUTOFF, SAMPLES, LONGEST = 20.0, 64, 0.06
LEAST, MOST = np.array([0.7, 0.0, 0.0]), np.array([1.3, 0.06, 0.0032])
CHANGE = np.array([2.0, 0.05, 0.001])
# It rests while the motion of the last second is below this share of the largest one.
THRESHOLD = 0.05
# Periods of an actuator in a step: above it rounding exceeds what the dynamics do in a step.
FASTEST = 1e4
LOWEST = 1e-50


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
    """What is between the commands of a run and a specimen."""

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
    def springs(self) -> tuple[Spring, ...]:
        """The springs of the specimen, if it is made of them."""
        inner = self.innermost
        return inner if type(inner) is tuple else ()

    def _placed(self, n: int, names: Sequence[str] | None, label: str) -> Device:
        """The same with numbers of dofs in the springs; `label` is that of the argument."""
        springs = self.springs
        placed = tuple(spring._placed(n, names, label) for spring in springs)
        if all(one is other for one, other in zip(springs, placed)):
            return self
        moved = copy(self)
        inner = self.specimen
        moved.specimen = inner._placed(n, names, label) if isinstance(inner, Device) else placed
        return moved

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        raise NotImplementedError

    def _filter(self, h: float) -> forms.Actuator | forms.Adaptive:
        """The filter in the form of the core, for steps of length h."""
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

    def respond(self, command: Any, dt: float, velocity: Any = None) -> Response:
        """Forces and measured displacements under given commands, without a structure.

        Parameters
        ----------
        command : (k,) or (k, n) array
            Displacements at t = 0, dt, 2 dt, ...; at rest before.
        dt : float
            Time between two commands.
        velocity : like command, optional
            Default: central differences of the command.

        Returns
        -------
        Response
            Has ``.force`` and ``.measured``, shaped as the command.

        Examples
        --------
        >>> late = rig.SimulatedActuator(lambda u, v, t: 2.0 * u, delay=0.02)
        >>> late.respond([0.0, 1.0, 0.0, 0.0, 0.0], 0.01).force
        array([0., 0., 0., 2., 0.])
        """
        d = real_array(command, "command", (1, 2))
        dt = time_step(dt, "dt")
        if d.shape[0] < 2:
            raise ValueError(f"command must have at least 2 rows, got {d.shape[0]}")
        v = (
            np.gradient(d, dt, axis=0)
            if velocity is None
            else real_array(velocity, "velocity", (1, 2))
        )
        if v.shape != d.shape:
            raise ValueError(f"velocity must have shape {d.shape}, got {v.shape}")
        shape = d.shape if d.ndim == 2 else (d.size, 1)
        specimen = core_specimen(
            self._placed(shape[1], None, "specimen"), shape[1], dt, "the specimen"
        )
        t = dt * np.arange(shape[0])
        flat = (np.ascontiguousarray(x.reshape(shape)) for x in (d, v))
        force, measured = _core.follow_specimen(specimen, t, *flat)
        return Response(force.reshape(d.shape), measured.reshape(d.shape))


class SimulatedActuator(Device):
    """A specimen behind a simulated actuator, which follows its commands late.

    A command is delayed, held within the saturation, and followed by linear dynamics; noise is
    added, and the displacement rounded to multiples of the quantum. The specimen has this
    displacement, and it is what is measured. All is compiled; with a compiled specimen no Python
    runs in a step. What it remembers is part of the state of the coupler: saved, restored, and
    unchanged by a macro step that fails.

    Parameters
    ----------
    specimen : callable, LowLevelCallable, springs, SimulatedActuator or Compensated
        As ``restoring`` of `Subdomain`; a callable may return (r, x), x what was measured instead.
    delay : float, default 0.0
        Dead time in the unit of t; need not be a multiple of the step.
    order : {1, 2, 3}, default 2
        Of the dynamics: a lag, an oscillator, or an oscillator behind a lag.
    frequency : float, optional
        Natural frequency in cycles per unit of time. Default: no dynamics, dead time only. At low
        frequencies the dynamics delay by ``damping / (pi frequency)`` and, of a lag, by
        ``1 / (2 pi frequency)``.
    damping : float, default 0.7
        Ratio of critical damping of the oscillator.
    noise : float, default 0.0
        Standard deviation of the displacement, one number in each step.
    saturation : float, optional
        Largest command that is followed, in both directions.
    quantum : float, optional
        Step of the converter of displacements.
    seed : int, optional
        Of the noise, which is the same in each run. Default: another one for each object.
    max_steps : int, default 100
        Largest number of substeps in the delay; more is a ValueError of the `Coupler`: a delay in
        ms where t is in s has a thousand times as many.

    Examples
    --------
    An undamped oscillator, half of whose stiffness is tested, grows by exp(k_e tau t / (2 m)):

    >>> actuator = rig.SimulatedActuator(CubicSpring([0], k=50.0, k3=0.0), delay=0.004)
    >>> mass = Subdomain([1.0], [50.0], scheme=CentralDifference(), u0=[1.0], restoring=actuator,
    ...                  name="m")
    >>> import warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", StabilityWarning)  # energy that the delay adds
    ...     u = Coupler([mass], dt=0.001).run(10.0)["m"].u
    >>> print(round(np.log(abs(u[-630:]).max()), 1))
    1.0
    """

    def __init__(
        self,
        specimen: Any,
        *,
        delay: float = 0.0,
        order: int = 2,
        frequency: float | None = None,
        damping: float = 0.7,
        noise: float = 0.0,
        saturation: float | None = None,
        quantum: float | None = None,
        seed: int | None = None,
        max_steps: int = DEFAULT_STEPS,
    ):
        super().__init__(specimen, delay, max_steps)
        self.order = whole_number(order, "order", low=1, high=3)
        self.frequency = None if frequency is None else positive_number(frequency, "frequency")
        if self.frequency is not None and self.frequency < LOWEST:
            raise ValueError(f"frequency must be at least {LOWEST:g}, got {self.frequency:g}")
        self.damping = positive_number(damping, "damping")
        self.noise = real_number(noise, "noise", low=0.0)
        self.saturation = None if saturation is None else positive_number(saturation, "saturation")
        self.quantum = None if quantum is None else positive_number(quantum, "quantum")
        drawn = int(np.random.SeedSequence().generate_state(1)[0])
        self.seed = drawn if seed is None else whole_number(seed, "seed")

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        names = ["delay", "order", "frequency", "damping", "noise", "saturation", "quantum", "seed"]
        if self.frequency is None:
            names = [name for name in names if name not in ("order", "damping")]
        if self.noise == 0.0:
            names.remove("seed")
        parameters = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"SimulatedActuator {parameters}"

    def _filter(self, h: float) -> forms.Actuator | forms.Adaptive:
        dynamics = held_dynamics(self.order, self.frequency, self.damping, h)
        largest = np.inf if self.saturation is None else self.saturation
        ends = (*delayed(self.delay, h), largest, *dynamics)
        return forms.Actuator(*ends, self.noise, self.quantum or 0.0, self.seed)


class Compensated(Device):
    """A specimen whose commands are changed so that it follows in time, in spite of a delay.

    Parameters
    ----------
    specimen : callable, LowLevelCallable, springs, SimulatedActuator or Compensated
        As ``restoring`` of `Subdomain`. For "adaptive" it must return (r, x), force and measured
        displacement, as a `SimulatedActuator` does; a compiled function writes x into its argument
        u.
    delay : float
        The delay of its actuator, in the unit of t; for "adaptive" a first estimate.
    method : {"polynomial", "inverse", "adaptive"}
        "polynomial": the commands at t, t - tau, ..., t - order tau extrapolated to t + tau
        (Horiuchi and others 1999). "inverse": that of a lag of the first order (Chen and Ricles
        2009). "adaptive": d + tau d' + tau^2/2 d'' and an amplitude, whose coefficients follow from
        what was measured in the last second (Chae and others 2013); t is in seconds.
    order : int, default 3
        Of the polynomial, 1 to 8.
    max_steps : int, default 100
        Largest number of substeps in the delay; more is a ValueError of the `Coupler`: a delay in
        ms where t is in s has a thousand times as many.

    Notes
    -----
    Of a motion of circular frequency w the error after the delay is
    :math:`(2 sin(w tau / 2))^(order + 1)` with "polynomial", and with "inverse" an amplitude of
    sqrt(1 + (w tau)^2). A higher order multiplies noise by up to 2^(order + 1).

    Examples
    --------
    >>> late = rig.SimulatedActuator(CubicSpring([0], k=50.0, k3=0.0), delay=0.004)
    >>> mass = Subdomain([1.0], [50.0], scheme=CentralDifference(), u0=[1.0], name="m",
    ...                  restoring=rig.Compensated(late, 0.004))
    >>> u = Coupler([mass], dt=0.001).run(10.0)["m"].u
    >>> print(round(abs(u[-630:]).max(), 2))
    1.0
    """

    def __init__(
        self,
        specimen: Any,
        delay: float,
        method: str = "polynomial",
        order: int = 3,
        *,
        max_steps: int = DEFAULT_STEPS,
    ):
        super().__init__(specimen, delay, max_steps)
        check_word(method, "method", ("polynomial", "inverse", "adaptive"))
        self.method = method
        self.order = whole_number(order, "order", low=1, high=8)
        if method == "adaptive" and type(self.specimen) is tuple:
            raise TypeError(
                'specimen must return the measured displacement for method="adaptive", as a '
                "SimulatedActuator or a function that returns (r, x), got springs"
            )

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        order = f", order={self.order}" if self.method == "polynomial" else ""
        return f"Compensated delay={self.delay!r}, method={self.method!r}{order}"

    def _filter(self, h: float) -> forms.Actuator | forms.Adaptive:
        if self.method == "adaptive":
            return adaptive(self.delay, h)
        taps: list[tuple[float, np.ndarray, np.ndarray]]
        if self.method == "inverse":
            lead = self.delay / h  # (Y5)
            lags, weights = np.array([0, 1]), np.array([1.0 + lead, -lead])
        else:
            N = self.order  # (Y4)
            taps = [
                ((-1.0) ** i * comb(N + 1, i + 1), *delayed(i * self.delay, h))
                for i in range(N + 1)
            ]
            lags, at = np.unique(np.concatenate([lag for _, lag, _ in taps]), return_inverse=True)
            weights = np.bincount(at, np.concatenate([a * weight for a, _, weight in taps]))
        lags = np.ascontiguousarray(lags, dtype=np.int64)
        dynamics = held_dynamics(1, None, 1.0, h)
        return forms.Actuator(lags, weights, np.inf, *dynamics, 0.0, 0.0, 0)


# ---- the filters of the core ---------------------------------------------------------------------


def delayed(delay: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Lags in steps and their weights: (Y1), a cubic between the commands around t - delay."""
    steps = delay / h
    if steps > LARGEST_LAG:
        raise ValueError(f"delay must be at most {LARGEST_LAG} steps of {h:g}, got {delay:g}")
    step_count = round(steps)
    if abs(steps - step_count) < 1e-9 * max(1.0, steps):
        return np.array([step_count], dtype=np.int64), np.ones(1)
    lags = max(0, int(steps) - 1) + np.arange(4)
    weights = [
        np.prod([(steps - other) / (lag - other) for other in lags if other != lag]) for lag in lags
    ]
    return lags.astype(np.int64), np.array(weights)


def held_dynamics(
    order: int, frequency: float | None, damping: float, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """phi, before, after and slope of (Y2): exact for commands that are linear in a step."""
    from scipy.linalg import expm

    if frequency is None:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(1)
    if frequency * h > FASTEST:
        raise ValueError(
            f"frequency of an actuator must be at most {FASTEST:g} in a step of {h:g}, got "
            f"{frequency:g}; without dynamics leave it out"
        )
    w = 2.0 * np.pi * frequency
    # coefficients of x', x'', ... in w^-order x^(order) + ... + x = c
    of_lag, of_pair = np.array([1.0 / w, 1.0]), np.array([1.0 / w**2, 2.0 * damping / w, 1.0])
    polynomial = {1: of_lag, 2: of_pair, 3: np.polymul(of_lag, of_pair)}[order]
    A = np.zeros((order + 2, order + 2))
    A[: order - 1, 1:order] = np.eye(order - 1)
    A[order - 1, :order] = -polynomial[:0:-1] / polynomial[0]
    A[order - 1, order] = 1.0 / polynomial[0]  # the command, and its increment over the step
    A[order, order + 1] = 1.0 / h
    E = expm(h * A)[:order]
    before, after = E[:, order] - E[:, order + 1], E[:, order + 1]
    slope = np.array([-w, w]) if order == 1 else np.eye(order + 1)[1]
    return tuple(map(np.ascontiguousarray, (E[:, :order], before, after, slope)))  # type: ignore


def adaptive(delay: float, h: float) -> forms.Adaptive:
    """The adaptive compensation, (Y6) and (Y7), for steps of length h."""
    from scipy.signal import butter

    every = max(1, round(1.0 / (SAMPLES * h)))
    window = max(8, round(1.0 / (every * h)))
    # larger limits for a larger delay, of a1 in proportion and of a2 to its square
    scale = max(1.0, 3.0 * delay / LONGEST) ** np.arange(3)
    start = np.array([1.0, delay, 0.5 * delay**2])
    limits = np.array([start, LEAST, scale * MOST, scale * CHANGE * every * h])
    sections = butter(6, min(CUTOFF, 0.25 / h), fs=1.0 / h, output="sos")[:, [0, 1, 2, 4, 5]]
    return forms.Adaptive(h, limits, THRESHOLD, every, window, np.ascontiguousarray(sections))


class CheckedSpecimen:
    """A Python specimen for the core: r, or (r, x) with the measured displacement."""

    def __init__(self, function: Any, n: int, what: str, *, needs_measured: bool):
        self.function, self.n, self.what = function, n, what
        self.needs_measured = needs_measured

    def __call__(self, u: np.ndarray, v: np.ndarray, t: float) -> Any:
        where = f"{self.what} at t = {t:g}"
        r, x = divided(self.function(u, v, t), self.n)
        try:
            if x is None and self.needs_measured:
                raise TypeError(
                    'the specimen must return (r, x), x the measured displacement, for method="'
                    'adaptive", got r alone'
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
    """A device with its specimen for the core: filters, springs, function, compensators."""
    devices = [device]
    while isinstance(devices[-1].specimen, Device):
        devices.append(devices[-1].specimen)
    inner, last = device.innermost, devices[-1]
    if device.springs:
        springs, function = core_springs(inner, np.arange(n)), None
    elif isinstance(inner, LowLevelCallable):
        springs, function = (), inner
    else:
        needs = isinstance(last, Compensated) and last.method == "adaptive"
        springs, function = (), CheckedSpecimen(inner, n, what, needs_measured=needs)
    outermost = [isinstance(one, Compensated) for one in devices]
    compensators = [*outermost, False].index(False)
    filters = tuple(one._filter(h) for one in devices)
    return forms.Specimen(filters, springs, function, compensators)
