"""Partitioned structural dynamics: subdomains with different time steps, coupled by PM-alpha.

Start with `Subdomain`, `tie` and `Coupler`; the equations are in docs/method.md.
"""

# ruff: noqa: E402 - before anything imports the extension it is compared with its sources

import sys as _sys
from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from .stale import require_present_build as _require_present_build

_require_present_build()

from .errors import (
    AccuracyWarning,
    BucklingError,
    CallbackError,
    CasesError,
    ConstraintError,
    ConstraintWarning,
    ConvergenceError,
    FactorizationError,
    InstabilityError,
    LimitError,
    PacingError,
    PerformanceWarning,
    PmalphaError,
    StabilityWarning,
)
from .problem.constraints import Constraint, tie
from .problem.contacts import Contact, contact
from .problem.forms import Newton
from .problem.internal import DiscreteGradient, InternalForce
from .problem.moving import MovingLoad
from .problem.records import SupportMotion
from .problem.sampled import BaseAcceleration, SampledForce
from .problem.schemes import HHT, WBZ, Bathe, CentralDifference, GeneralizedAlpha, Newmark, Scheme
from .problem.springs import Bilinear, BoucWen, CubicSpring, Gap, Multilinear, RambergOsgood
from .problem.subdomain import Subdomain
from .results.history import History, SubdomainHistory
from .run.coupler import Coupler, solve

if _TYPE_CHECKING:
    __version__: str
    from . import analysis, export, models, plot, readers, rig, structures  # noqa: F401
    from .cutting.cut import cut
    from .cutting.elements import Elements
    from .cutting.result import Cut
    from .cutting.whole import element_parameters
    from .frozen.model import c_library
    from .gradients.parameters import Goal, Misfit, Parameters
    from .meshes.coincident import contact_coincident, tie_coincident
    from .meshes.interpolation import interpolate
    from .reduction.fixed_dofs import reduce
    from .run.study import Study

__all__ = [
    "HHT",
    "WBZ",
    "Bathe",
    "AccuracyWarning",
    "BaseAcceleration",
    "Bilinear",
    "BoucWen",
    "BucklingError",
    "CallbackError",
    "CasesError",
    "CentralDifference",
    "Constraint",
    "ConstraintError",
    "ConstraintWarning",
    "Contact",
    "ConvergenceError",
    "Coupler",
    "Cut",
    "CubicSpring",
    "DiscreteGradient",
    "Elements",
    "FactorizationError",
    "Gap",
    "GeneralizedAlpha",
    "Goal",
    "History",
    "InstabilityError",
    "InternalForce",
    "LimitError",
    "Misfit",
    "MovingLoad",
    "Multilinear",
    "Newmark",
    "Newton",
    "PacingError",
    "Parameters",
    "PerformanceWarning",
    "PmalphaError",
    "RambergOsgood",
    "SampledForce",
    "Scheme",
    "StabilityWarning",
    "Study",
    "Subdomain",
    "SubdomainHistory",
    "SupportMotion",
    "analysis",
    "c_library",
    "contact",
    "contact_coincident",
    "cut",
    "element_parameters",
    "export",
    "interpolate",
    "models",
    "plot",
    "readers",
    "reduce",
    "rig",
    "solve",
    "structures",
    "tie",
    "tie_coincident",
]

# The modules of what is loaded when it is first used, for a third of the time of the import.
_LATER = {
    "c_library": "frozen.model",
    "contact_coincident": "meshes.coincident",
    "cut": "cutting.cut",
    "element_parameters": "cutting.whole",
    "Elements": "cutting.elements",
    "Cut": "cutting.result",
    "Goal": "gradients.parameters",
    "Misfit": "gradients.parameters",
    "Parameters": "gradients.parameters",
    "tie_coincident": "meshes.coincident",
    "interpolate": "meshes.interpolation",
    "reduce": "reduction.fixed_dofs",
    "Study": "run.study",
}
_MODULES = ("analysis", "export", "models", "plot", "readers", "rig", "structures")


def __getattr__(name: str) -> _Any:
    """What is loaded when it is first used."""
    if name in _MODULES:
        return _import_module(f".{name}", __name__)
    if name == "__version__":
        return _import_module(".files", __name__).package_version()
    if name not in _LATER:
        text = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(text, name=name, obj=_sys.modules[__name__])  # and what is near
    value = globals()[name] = getattr(_import_module(f".{_LATER[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
