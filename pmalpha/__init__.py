"""Partitioned structural dynamics: subdomains with different time steps, coupled by PM-alpha.

Start with `Subdomain`, `tie` and `Coupler`; the equations are in docs/method.md.
"""

from . import analysis, export, models, plot, readers, remote, rig, structures
from .cutting.cut import cut
from .cutting.element_factors import element_parameters
from .cutting.elements import Elements
from .cutting.plan import Plan, PlanRow
from .cutting.result import Cut
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
from .files import PACKAGE_VERSION as _version
from .gradients.gradient import Gradient
from .gradients.misfit import Misfit
from .gradients.parameters import Parameters
from .problem.coincident import tie_coincident
from .problem.constraints import Constraint, tie
from .problem.discrete_gradient import DiscreteGradient
from .problem.forces import BaseAcceleration, SampledForce
from .problem.internal import InternalForce
from .problem.interpolation import interpolate
from .problem.newton import Newton
from .problem.reduction import Reduction, reduce
from .problem.schemes import HHT, WBZ, CentralDifference, GeneralizedAlpha, Newmark, Scheme
from .problem.springs import (
    Bilinear,
    BoucWen,
    CubicSpring,
    Gap,
    Multilinear,
    RambergOsgood,
    SpringState,
)
from .problem.subdomain import Subdomain
from .problem.superelement import ReducedBasis
from .problem.supports import SupportMotion
from .problem.tangent_check import TangentCheck
from .results.energy import Energy
from .results.history import History, SubdomainHistory
from .results.pacing import Pacing
from .run.coupler import Coupler
from .run.snapshot import Snapshot
from .run.state import State
from .run.study import CaseResult, Study
from .run.uncoupled import solve

__version__ = _version

__all__ = [
    "HHT",
    "WBZ",
    "AccuracyWarning",
    "BaseAcceleration",
    "Bilinear",
    "BoucWen",
    "BucklingError",
    "CallbackError",
    "CaseResult",
    "CasesError",
    "CentralDifference",
    "Constraint",
    "ConstraintError",
    "ConstraintWarning",
    "ConvergenceError",
    "Coupler",
    "Cut",
    "CubicSpring",
    "DiscreteGradient",
    "Elements",
    "Energy",
    "FactorizationError",
    "Gap",
    "GeneralizedAlpha",
    "Gradient",
    "History",
    "InstabilityError",
    "InternalForce",
    "LimitError",
    "Misfit",
    "Multilinear",
    "Newmark",
    "Newton",
    "Pacing",
    "PacingError",
    "Parameters",
    "PerformanceWarning",
    "Plan",
    "PlanRow",
    "PmalphaError",
    "RambergOsgood",
    "ReducedBasis",
    "Reduction",
    "SampledForce",
    "Scheme",
    "Snapshot",
    "SpringState",
    "StabilityWarning",
    "State",
    "Study",
    "Subdomain",
    "SubdomainHistory",
    "SupportMotion",
    "TangentCheck",
    "analysis",
    "cut",
    "element_parameters",
    "export",
    "interpolate",
    "models",
    "plot",
    "readers",
    "reduce",
    "remote",
    "rig",
    "solve",
    "structures",
    "tie",
    "tie_coincident",
]


def __dir__() -> list[str]:
    return sorted(__all__)
