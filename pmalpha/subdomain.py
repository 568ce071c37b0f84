"""One part of a structure: its matrices, its scheme and its share of the time step."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._checks import flag, listing, vector, whole_number
from .errors import FactorizationError
from .forces import checked_force
from .matrices import Matrix, canonical, diagonal
from .schemes import Scheme

__all__ = ["Subdomain"]

# From this spectral radius at infinite frequency on, the velocity of a dof without mass grows.
UNDAMPED = 1.0 - 1e-9


class Subdomain:
    """One subdomain of the coupled problem (1): M w + C v + K u = F(t) + L^T Lam.

    Units are any consistent set. The arrays are copied; a `Coupler` does not change a subdomain,
    so that the same one can stand in several couplers.

    Parameters
    ----------
    M, K : (n,) array, (n, n) array or scipy.sparse matrix or array
        Mass and stiffness. A 1-D array is a diagonal. Symmetric; M positive semidefinite, and
        positive definite for an explicit scheme. A dof without mass is a zero row and column of M;
        only an implicit scheme that damps at infinite frequency takes it.
    C : like M and K, optional
        Viscous damping, symmetric. Default: none.
    scheme : Scheme
        `GeneralizedAlpha`, `Newmark`, `CentralDifference`, `HHT` or `WBZ`.
    substeps : int, default 1
        Own steps in a macro step dt: own step h = dt / substeps.
    double_step : bool, optional
        Whether the subdomain steps from t_{n-1} to t_{n+1} under coupling "pm". Default: when it
        is implicit and its own step is coarser than the finest; if all own steps are equal and
        nobody says anything, the first implicit subdomain of several. A single subdomain is never
        double, nor is anybody under "gc".
    force : (n,) array, callable, `SampledForce` or `BaseAcceleration`, optional
        External load, evaluated at the end of each own step. A callable ``f(t) -> (n,)`` is asked
        ahead of the run, once for each own step in the order of time, and once at t = 0.
    u0, v0 : (n,) array, optional
        Initial displacement and velocity. Default: zero.
    name : str, optional
        Default: "subdomain i", i its place in the Coupler.

    Raises
    ------
    TypeError, ValueError
        For complex, unsymmetric or infinite entries, shapes that do not agree, a scheme or force
        of the wrong kind, dofs without mass under a scheme that does not damp them.
    FactorizationError
        For a dof without mass in an explicit subdomain.

    Examples
    --------
    >>> import numpy as np
    >>> tower = Subdomain([2.0, 1.0], np.array([[3.0, -1.0], [-1.0, 1.0]]),
    ...                   scheme=GeneralizedAlpha(0.5), name="tower")
    >>> tower.n
    2
    """

    M: Matrix
    K: Matrix
    C: Matrix

    def __init__(
        self,
        M: Any,
        K: Any,
        C: Any = None,
        *,
        scheme: Scheme,
        substeps: int = 1,
        double_step: bool | None = None,
        force: Any = None,
        u0: Any = None,
        v0: Any = None,
        name: str | None = None,
    ):
        if not isinstance(scheme, Scheme):
            raise TypeError(f"scheme must be a pmalpha scheme, got {scheme!r}")
        if name is not None and not (isinstance(name, str) and name):
            raise TypeError(f"name must be a string that is not empty, got {name!r}")
        if M is None or K is None:
            raise TypeError(f"{'M' if M is None else 'K'} must be a matrix, got None")
        self.scheme = scheme
        self.substeps = whole_number(substeps, "substeps", low=1)
        self.double_step = None if double_step is None else flag(double_step, "double_step")
        self.name = name
        self.M, self.n = canonical(M, "M")
        self.K, _ = canonical(K, "K", self.n)
        self.C = None if C is None else canonical(C, "C", self.n)[0]
        self.force = checked_force(force, self.n)
        self.u0 = self._initial(u0, "u0")
        self.v0 = self._initial(v0, "v0")
        self._check_mass()

    def __repr__(self) -> str:
        label = "" if self.name is None else f"{self.name!r}, "
        return f"<Subdomain {label}{self.n} dofs, {self.scheme!r}, substeps={self.substeps}>"

    @property
    def massless(self) -> np.ndarray:
        """The dofs without mass: zero rows of M."""
        if self.M is None:
            return np.arange(self.n)
        # in a semidefinite matrix a zero on the diagonal means a zero row
        return np.flatnonzero(diagonal(self.M) == 0.0)

    def _initial(self, value: Any, name: str) -> np.ndarray:
        return np.zeros(self.n) if value is None else vector(value, self.n, name)

    def _check_mass(self) -> None:
        label = "the subdomain" if self.name is None else f"subdomain {self.name!r}"
        negative = [] if self.M is None else np.flatnonzero(diagonal(self.M) < 0.0)
        if len(negative):
            raise ValueError(
                f"M must be positive semidefinite, got a negative diagonal entry at dofs "
                f"{listing(negative)}"
            )
        massless = self.massless
        if not massless.size:
            return
        if self.M is not None and self.M.ndim == 2 and abs(self.M[massless, :]).sum() > 0.0:
            raise ValueError(
                f"M must be positive semidefinite, got a zero diagonal entry in a row that is "
                f"not zero, among dofs {listing(massless)}"
            )
        if self.scheme.explicit:
            raise FactorizationError(
                f"{label} is explicit and its mass matrix singular: dofs {listing(massless)} "
                "have no mass; give them mass or take an implicit scheme"
            )
        if self.scheme.radius_at_infinity() > UNDAMPED:
            raise ValueError(
                f"scheme must damp at infinite frequency (rho < 1) for dofs without mass, got "
                f"{self.scheme!r} and no mass at dofs {listing(massless)} of {label}"
            )
