"""Specimens in a laboratory or in another program: actuators, compensation, the protocol of rigs.

`serve` makes a function, a subdomain or a coupler the element of a model of OpenSees, `connect` a
specimen of what listens elsewhere, both by the messages of OpenSees and OpenFresco. `Client` and
`started` call any function of numbers and arrays in another process, which `serve_calls` serves.
"""

from ..devices.actuators import Compensated, SimulatedActuator
from ..devices.linear import LinearActuator, servo_hydraulic
from ..devices.linkage import Linkage
from ..problem.device import External, Limits, Response
from ..results.ring import Monitored, read_monitor
from ..results.subdomain import RigRecord
from .calls import Client, RemoteError, started
from .calls import serve as serve_calls
from .connecting import Connected, connect
from .serving import Command, serve
from .tracking import Evaluation, Tracking, evaluate, tracking

__all__ = [
    "Client",
    "Command",
    "Compensated",
    "Connected",
    "Evaluation",
    "External",
    "Limits",
    "LinearActuator",
    "Linkage",
    "Monitored",
    "RemoteError",
    "Response",
    "RigRecord",
    "SimulatedActuator",
    "Tracking",
    "connect",
    "evaluate",
    "read_monitor",
    "serve",
    "serve_calls",
    "servo_hydraulic",
    "started",
    "tracking",
]


def __dir__() -> list[str]:
    return sorted(__all__)
