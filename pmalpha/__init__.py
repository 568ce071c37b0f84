"""Partitioned structural dynamics: subdomains with their own time steps, coupled by PM-alpha.

Start with `Subdomain`, `tie` and `Coupler`; the equations are in docs/method.md.
"""

from importlib.metadata import version as _version

from . import analysis, export, models, plot, readers
from .constraints import Constraint, tie
from .coupler import Coupler, solve
from .errors import (
    CallbackError,
    ConstraintError,
    ConstraintWarning,
    FactorizationError,
    InstabilityError,
    PerformanceWarning,
    PmalphaError,
    StabilityWarning,
)
from .forces import BaseAcceleration, SampledForce
from .history import Energy, History, State, SubdomainHistory
from .reduction import Reduction, reduce
from .schemes import HHT, WBZ, CentralDifference, GeneralizedAlpha, Newmark, Scheme
from .springs import Bilinear, BoucWen, CubicSpring, Gap, SpringState
from .subdomain import Subdomain
from .ties import interpolate, tie_coincident

__version__ = _version("pmalpha")

__all__ = [
    "HHT",
    "WBZ",
    "BaseAcceleration",
    "Bilinear",
    "BoucWen",
    "CallbackError",
    "CentralDifference",
    "Constraint",
    "ConstraintError",
    "ConstraintWarning",
    "Coupler",
    "CubicSpring",
    "Energy",
    "FactorizationError",
    "Gap",
    "GeneralizedAlpha",
    "History",
    "InstabilityError",
    "Newmark",
    "PerformanceWarning",
    "PmalphaError",
    "Reduction",
    "SampledForce",
    "Scheme",
    "SpringState",
    "StabilityWarning",
    "State",
    "Subdomain",
    "SubdomainHistory",
    "analysis",
    "export",
    "interpolate",
    "models",
    "plot",
    "readers",
    "reduce",
    "solve",
    "tie",
    "tie_coincident",
]
