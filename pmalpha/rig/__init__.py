"""Specimens in a laboratory or in another program: actuators, compensation, the protocol of rigs.

`serve` makes a function, a subdomain or a coupler the element of a model of OpenSees, `connect` a
specimen of what listens elsewhere, both by the messages of OpenSees and OpenFresco. `Client` and
`started` call any function of numbers and arrays in another process, which `serve_calls` serves.
"""

from ..problem.actuators import Compensated, SimulatedActuator
from ..problem.device import Response
from ..problem.external import External
from ..problem.limits import Limits
from ..problem.linear_actuator import LinearActuator, servo_hydraulic
from ..problem.linkage import Linkage
from ..results.ring import Monitored, read_monitor
from ..results.subdomain_history import RigRecord
from .calls import Client, RemoteError, started
from .calls import serve as serve_calls
from .connecting import Connected, connect
from .criteria import Evaluation, evaluate
from .served import Command
from .serving import serve
from .tracking import Tracking, tracking

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
