"""Specimens in a laboratory or in another program: actuators, delays, and the protocol of rigs."""

from ..problem.actuators import Compensated, Response, SimulatedActuator
from ..problem.limits import Limits
from .tracking import Tracking, tracking

__all__ = ["Compensated", "Limits", "Response", "SimulatedActuator", "Tracking", "tracking"]


def __dir__() -> list[str]:
    return sorted(__all__)
