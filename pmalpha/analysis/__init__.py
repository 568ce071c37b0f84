"""Amplification matrices, spectra, stability limits and errors of linear couplers.

These are computed by steps of the C core that also does the runs; equations in docs/method.md.
`response_spectrum` is the spectrum of a ground motion, exact and without the core.
"""

from ..setup.stability import critical_step
from .amplification import AmplificationMatrix, amplification_matrix
from .exact import exact_solution, global_error, local_error, observed_order, start_error
from .response import ResponseSpectrum, response_spectrum
from .spectra import period_and_damping, spectral_radius, stability_limit, zero_stability

__all__ = [
    "AmplificationMatrix",
    "ResponseSpectrum",
    "amplification_matrix",
    "critical_step",
    "exact_solution",
    "global_error",
    "local_error",
    "observed_order",
    "period_and_damping",
    "response_spectrum",
    "spectral_radius",
    "stability_limit",
    "start_error",
    "zero_stability",
]


def __dir__() -> list[str]:
    return sorted(__all__)
