"""How the iteration of internal forces is controlled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, get_args

from .._checks import check_word, real_number, whole_number
from .argument_types import TangentPolicy
from .frozen import Frozen

__all__ = ["Newton"]


@dataclass(frozen=True)
class Newton(Frozen):
    """Control of the Newton-Raphson iteration of ``internal=``, for ``newton=`` of a `Coupler`.

    Parameters
    ----------
    tol : float, default 1e-8
        Relative accuracy of forces and motion, in (0, 1). An iterate is accepted when in every row
        the residual is at most ``tol`` of the forces that act there, or did when the step began,
        and the error that is left, estimated from the rate of convergence, at most ``tol`` of the
        largest motion in a step so far. Where all residuals are rounding, as at rest or in a
        subdomain that constraints hold, they decide alone.
    iterations : int, default 40
        Largest number of iterations in a substep; more are a `ConvergenceError`. At least 1.
    tangent : {"full", "reuse"}, default "full"
        "full": a new tangent and its factor in each iteration. "reuse": factors are kept, over
        substeps too, as long as an iteration reduces the error to a fifth; for subdomains whose
        factorization takes more time than several evaluations of the force.

    Raises
    ------
    TypeError, ValueError
        For a value of the wrong kind or out of its range.

    Examples
    --------
    >>> Newton()
    Newton(tol=1e-08, iterations=40, tangent='full')
    >>> Newton(tol=1e-10, tangent="reuse").tol
    1e-10
    """

    _is_frozen: ClassVar[bool] = True  # the fields by the dataclass, others by Frozen

    tol: float = 1e-8
    iterations: int = 40
    tangent: TangentPolicy = "full"

    def __post_init__(self) -> None:
        tol = real_number(self.tol, "tol")
        if not 0.0 < tol < 1.0:
            raise ValueError(f"tol must be above 0 and below 1, got {self.tol!r}")
        object.__setattr__(self, "tol", tol)
        object.__setattr__(self, "iterations", whole_number(self.iterations, "iterations", low=1))
        check_word(self.tangent, "tangent", get_args(TangentPolicy))


DEFAULT = Newton()
