"""Specimens behind simulated actuators, and compensators of their delays, (Y1) to (Y7)."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._checks import check_word, positive_number, real_number, whole_number
from ..problem import forms
from ..problem.device import DEFAULT_STEPS, Device
from .inverse import ModelInverse
from .linear import LinearActuator, adaptive, delayed, extrapolation, held_dynamics, inverse_of_lag

LOWEST = 1e-50


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

    def _filter(self, h: float, width: int) -> forms.Filter:
        dynamics = held_dynamics(self.order, self.frequency, self.damping, h)
        largest = np.inf if self.saturation is None else self.saturation
        ends = (*delayed(self.delay, h), largest, *dynamics)
        return forms.Actuator(*ends, self.noise, self.quantum or 0.0, self.seed)


class Compensated(Device):
    """A specimen whose commands are changed so that it follows in time.

    Parameters
    ----------
    specimen : callable, LowLevelCallable, springs, LinearActuator, SimulatedActuator, Compensated
        As ``restoring`` of `Subdomain`, or one of these devices. For "adaptive", and for "model"
        with `feedback` or `variations`, it must return (r, x), force and measured displacement,
        as simulated actuators do; a compiled function writes x into its argument u.
    delay : float, default 0.0
        The delay of its actuator, in the unit of t; for "adaptive" a first estimate, for "model"
        the dead time that the model does not have.
    method : {"polynomial", "inverse", "adaptive", "model"}
        "polynomial": the commands at t, t - tau, ..., t - order tau extrapolated to t + tau
        (Horiuchi and others 1999), for a delay. "inverse": that of a lag of the first order (Chen
        and Ricles 2009). "adaptive": d + tau d' + tau^2/2 d'' and an amplitude, whose coefficients
        follow from what was measured in the last second (Chae and others 2013); t is in seconds.
        "model": the inverse of a linear model of the actuator with its specimen, equation (Y14),
        with velocity and acceleration of the command as the structure has them.
    order : int, default 3
        Of the polynomial, 1 to 8.
    max_steps : int, default 100
        Largest number of substeps in the delay; more is a ValueError of the `Coupler`: a delay in
        ms where t is in s has a thousand times as many.
    model : LinearActuator, optional
        Of "model". Default: the specimen itself.
    bandwidth : float, default 100.0
        Of "model": commands are followed up to about this frequency, in cycles per unit of t; at
        most a quarter of 1/h. The noise that they have rises with it.
    feedback : float, default 0.0
        Of "model": bandwidth of an integral of the measured error, equation (Y15). It lowers what a
        wrong model leaves, and the margin of stability; 0 is none.
    variations : float or list of LinearActuator, optional
        Of "model": how far the model may be wrong, as standard deviations. A list of models, each
        with one quantity one deviation off, or, for one command, a share of every coefficient of
        the inverse. Recursive least squares then find the inverse, equation (Y16); t is in seconds.
    sigma : float, optional
        With `variations`: standard deviation of the error of a command, between steps that are
        independent. Not the noise of a sample: that error is correlated over some hundred steps.

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

    compensates = leads = True

    def __init__(
        self,
        specimen: Any,
        delay: float = 0.0,
        method: str = "polynomial",
        order: int = 3,
        *,
        max_steps: int = DEFAULT_STEPS,
        model: LinearActuator | None = None,
        bandwidth: float = 100.0,
        feedback: float = 0.0,
        variations: Any = None,
        sigma: float | None = None,
    ):
        super().__init__(specimen, delay, max_steps)
        check_word(method, "method", ("polynomial", "inverse", "adaptive", "model"))
        self.method = method
        self.order = whole_number(order, "order", low=1, high=8)
        self.inverse = None
        if method == "model":
            known = model_of(self.specimen, model)
            self.inverse = ModelInverse(known, delay, bandwidth, feedback, variations, sigma)
        elif model is not None or variations is not None or sigma is not None or feedback != 0.0:
            raise ValueError(
                'model, feedback, variations and sigma must come with method="model", got '
                f"method={method!r}"
            )
        if self.needs_measured and type(self.specimen) is tuple:
            raise TypeError(
                f"specimen must return the measured displacement for {self.needs_measured}, as a "
                "SimulatedActuator or a function that returns (r, x), got springs"
            )

    @property
    def needs_measured(self) -> str:  # type: ignore[override]
        """What needs the measured displacement, in messages."""
        if self.method == "adaptive":
            return 'method="adaptive"'
        learns = self.inverse is not None and self.inverse.measures
        return "feedback and variations" if learns else ""

    @property
    def needs_acceleration(self) -> bool:  # type: ignore[override]
        """Whether it needs the acceleration of commands."""
        return self.inverse is not None

    @property
    def facts(self) -> str:
        """Its parameters, for the comparison of problems."""
        order = f", order={self.order}" if self.method == "polynomial" else ""
        of_model = "" if self.inverse is None else f", {self.inverse.facts}"
        return f"Compensated delay={self.delay!r}, method={self.method!r}{order}{of_model}"

    def _check_width(self, n: int, label: str) -> None:
        if self.inverse is None:
            return
        width = n if self.width is None else self.width
        if self.inverse.model.n != width:
            raise ValueError(
                f"{label}: model of a Compensated must have the commands of its specimen, {width}, "
                f"got {self.inverse.model.n}"
            )

    def _filter(self, h: float, width: int) -> forms.Filter:
        if self.inverse is not None:
            return self.inverse.filter(h)
        if self.method == "adaptive":
            return adaptive(self.delay, h)
        if self.method == "inverse":
            return inverse_of_lag(self.delay, h)
        return extrapolation(self.order, self.delay, h)


def model_of(specimen: Any, model: Any) -> LinearActuator:
    """The model of a specimen for method="model"."""
    if model is None and isinstance(specimen, LinearActuator):
        return specimen
    if not isinstance(model, LinearActuator):
        raise TypeError(
            'model must be a LinearActuator for method="model" of a specimen that is none, got '
            f"{model!r}"
        )
    return model
