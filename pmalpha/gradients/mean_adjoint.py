"""The adjoint of runs under "mean" with the trapezoidal rule, (A17).

There the constraints are on displacements, and multipliers that are constant over a macro step act
like the load c L^T lam with c = 2 / (1 + z), whose accelerations W = w + c y stand in (A9).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from .adjoint import Adjoint, Handed, Member, Sources
from .filters import MeanFilters


class MeanMember(Member):
    """A subdomain with the trapezoidal rule under "mean"."""

    def __init__(
        self, name: str, subdomain: Any, L: sp.csc_array, dt: float, ratio: int, double: bool
    ):
        super().__init__(name, subdomain, L, dt, ratio, double)
        self.filters = MeanFilters(self.h)  # type: ignore[assignment]

    def motion(self, run: Any, w: np.ndarray | None) -> dict[str, np.ndarray]:
        """With W from its means over the substeps, the differences of v."""
        from scipy.signal import lfilter

        assert w is not None
        means = np.diff(run.v, axis=0) / self.h
        W = lfilter([2.0], [1.0, 1.0], means, axis=0, zi=-w[None])[0]
        return {"M": np.vstack([w, W]), "C": run.v, "K": run.u}

    def adjoint_of(self, run: Any, first: int = 0) -> np.ndarray:
        return self.filters.phi(run.u[first + 1 :])

    @cached_property
    def inertia(self) -> Any:
        """The factors of M^T."""
        import scipy.sparse.linalg as sla

        return sla.splu(sp.csc_array(self.M.T))


class MeanAdjoint(Adjoint):
    """The adjoint of runs under "mean", whose initial accelerations know no multipliers."""

    members: list[MeanMember]
    tied = 0

    def _of_motion(self, lam: np.ndarray) -> np.ndarray:
        """dJ/d of what the ties of displacements prescribe."""
        lam = lam[1:].copy()
        lam[1:] -= lam[:-1].copy()
        return -lam[::-1]

    def _of_start_multipliers(self, x: Member, mu: np.ndarray, at_nodes: np.ndarray) -> Any:
        return 0.0

    def taking_over(self, start: list[np.ndarray], of_lam: np.ndarray) -> Handed:
        """w at the end of a block is what its equation of motion gives without multipliers."""
        etas = []
        for x, state in zip(self.members, start):
            eta = x.inertia.solve(state[0, 2] + state[0, 3])
            state[0, 0] -= x.K.T @ eta
            state[0, 1] -= x.C.T @ eta
            state[0, 2:] = 0.0
            etas.append(eta)
        return Handed(start, etas)

    def at_zero(
        self, sources: Mapping[str, Sources], start: list[np.ndarray], of_lam: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
        """mu_0, and the adjoints of u0 and v0."""
        for x, state in zip(self.members, start):
            state[0] += sources[x.name].at(0, x.n)
        handed = self.taking_over(start, of_lam)
        u0, v0 = ([state[0, i] for state in handed.states] for i in range(2))
        return handed.eta, u0, v0
