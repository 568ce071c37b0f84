"""The adjoint of a linear coupled run: the same coupler, run once more under reversed loads.

All couplings are reciprocal: the transposed run is the run itself under reversed time, up to one
scalar filter for each subdomain. The equations (A1) to (A14) are in docs/method.md.

A run is divided in blocks of macro steps, the last one first. What a block leaves to the one before
it is the adjoint of the state in which it began.

The adjoint of runs under "mean" with the trapezoidal rule, (A17).

There the constraints are on displacements, and multipliers that are constant over a macro step act
like the load c L^T lam with c = 2 / (1 + z), whose accelerations W = w + c y stand in (A9).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._cached import cached_property
from ..problem.forces import SampledForce
from ..problem.matrices import sparse
from ..problem.schemes import Scheme
from .filters import Filters, MeanFilters, responses_to_state
from .parameters import Parameters

UNITS = ("u", "v", "w", "a")  # the order of handed-over adjoints


@dataclass
class Sources:
    """dJ/du, dJ/dv and dJ/dw of some dofs of a subdomain, (levels, dofs) each."""

    dofs: np.ndarray
    u: np.ndarray
    v: np.ndarray
    w: np.ndarray

    def of_levels(self, first: int, last: int) -> Sources:
        """Those of the levels first + 1 to last, in reversed order."""
        rows = slice(first + 1, last + 1)
        return Sources(self.dofs, *(x[rows][::-1] for x in (self.u, self.v, self.w)))

    def at(self, level: int, n: int) -> np.ndarray:
        """(4, n), in the order of `UNITS`."""
        out = np.zeros((4, n))
        for row, x in zip(out, (self.u, self.v, self.w)):
            row[self.dofs] = x[level]
        return out


class AdjointMember:
    """A subdomain as its adjoint needs it.

    L: (p, n) sparse.
    ratio: interface levels in a substep; under "macro" 1.
    double: whether its steps are double ones.
    """

    def __init__(
        self, name: str, subdomain: Any, L: sp.csc_array, dt: float, ratio: int, double: bool
    ):
        self.name, self.n, self.L = name, subdomain.n, sp.csr_array(L)
        self.substeps, self.ratio, self.double = subdomain.substeps, ratio, double
        self.h = dt / subdomain.substeps
        self.scheme: Scheme = subdomain.scheme
        self.M, self.K = (sparse(x, self.n) for x in (subdomain.M, subdomain.K))
        self.C = sparse(subdomain.C, self.n)
        self.filters = Filters(self.scheme, self.h, double)
        al1, al2 = self.scheme.coefficients(2.0 * self.h if double else self.h)
        self.al1, self.al2 = al1, al2
        self.al1_beside_K = al1 if self.scheme.explicit else 0.0

    @cached_property
    def links(self) -> tuple[np.ndarray, np.ndarray]:
        """Y = Mbar^-1 L^T and Mbar^-T L^T, (n, p), for (A10) and (A12)."""
        import scipy.sparse.linalg as sla

        implicit = 0.0 if self.scheme.explicit else self.al1
        Mbar = sla.splu(sp.csc_array(self.M + self.al2 * self.C + implicit * self.K))
        LT = self.L.T.toarray()
        return Mbar.solve(LT), Mbar.solve(LT, trans="T")

    def motion(self, run: Any, w: np.ndarray | None) -> dict[str, np.ndarray]:
        """What stands beside dM, dC and dK in (A9), of a run; w: that at its beginning."""
        return {"M": run.a, "C": run.v, "K": run.u - self.al1_beside_K * run.a}

    def adjoint_of(self, run: Any, first: int = 0) -> np.ndarray:
        """mu of a reversed run after its level `first`, in its order, (A8)."""
        return self.filters.phi(run.a[first + 1 :])

    @property
    def weights(self) -> dict[str, float]:
        return {"M": 1.0, "C": self.al2, "K": 0.0 if self.scheme.explicit else self.al1}


@dataclass
class Handed:
    """Adjoints at the end of a block: of the states of each subdomain, and of its equilibrium.

    A state is u, v, w, a at the last level, for double steps at the last but one too.
    """

    states: list[np.ndarray]  # (1 or 2, 4, n)
    eta: list[np.ndarray]  # (n,)


class Adjoint:
    """The adjoint of runs of one coupler.

    macro: whether the interface is solved at macro steps only.
    fine: interface levels in a macro step.
    reverse: ``reverse(forces, steps, g, double)``, the History of a run of this number of macro
        steps from rest under these loads by name, with the transposed matrices. g: velocities
        (levels, p) of the constraints, None for zero. double: steps are double after the first
        macro step.
    """

    # Whose responses, of u, v and a, the constraints are on.
    tied = 1

    def __init__(
        self,
        members: Sequence[AdjointMember],
        macro: bool,
        dt: float,
        fine: int,
        reverse: Callable[..., Any],
    ):
        self.members, self.macro, self.fine, self.reverse = members, macro, fine, reverse
        self.h = dt / fine
        self.p = members[0].L.shape[0]
        self.double = any(x.double for x in members)

    def nothing_handed(self) -> Handed:
        return Handed(
            [np.zeros((1, 4, x.n)) for x in self.members], [np.zeros(x.n) for x in self.members]
        )

    def block(
        self,
        sources: Mapping[str, Sources],
        of_lam: np.ndarray | None,
        first: int,
        last: int,
        handed: Handed,
    ) -> tuple[list[np.ndarray], np.ndarray, list[np.ndarray], np.ndarray]:
        """The adjoint of macro steps first + 1 to last.

        of_lam: (interface levels, p) array or None, dJ/dlam from t = 0 on.
        Returns mu: list of (levels, n), dJ/dF at the levels after the first, of each subdomain; at
            the last one without eta.
        Returns nu: (interface levels, p), dJ/dg.
        Returns start: list of (1 or 2, 4, n), the adjoints of the states in which the block begins.
        Returns lam: (p,), those of its multipliers.
        """
        g = None if of_lam is None else self._velocities(of_lam, first, last)
        lead = int(self.double or g is not None)
        taken = [
            sources[x.name].of_levels(first * x.substeps, last * x.substeps) for x in self.members
        ]
        forces = {
            x.name: reversed_load(x, phi, states, lead * x.substeps)
            for x, phi, states in zip(self.members, taken, handed.states)
        }
        run = self.reverse(forces, lead + last - first, g, self.double)
        mus = [x.adjoint_of(run[x.name], lead * x.substeps)[::-1] for x in self.members]
        nu = self._of_motion(run.multipliers[lead * self.fine :])
        start, of_start = self._start(taken, handed.states, mus, nu)
        return mus, nu, start, of_start

    def _of_motion(self, lam: np.ndarray) -> np.ndarray:
        """dJ/dg of the multipliers of a reversed run from its beginning on, (A8)."""
        lam = np.diff(lam, axis=0)
        lam[1:] -= lam[:-1].copy()
        return -lam[::-1] / self.h

    def _velocities(self, of_lam: np.ndarray, first: int, last: int) -> np.ndarray:
        """(A7), after a macro step of rest."""
        levels = of_lam[first * self.fine + 1 : last * self.fine + 1][::-1]
        g = -self.h * np.cumsum(np.cumsum(levels, axis=0), axis=0)
        return np.vstack([np.zeros((self.fine + 1, self.p)), g])

    def _start(
        self,
        taken: Sequence[Sources],
        states: Sequence[np.ndarray],
        mus: Sequence[np.ndarray],
        nu: np.ndarray,
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """(A11), (A12)"""
        starts, of_lam = [], np.zeros(self.p)
        for x, phi, handed, mu in zip(self.members, taken, states, mus):
            e = responses_to_state(x.scheme, x.h, len(mu), x.double)
            eu, ev = e[:, 0, 1:], e[:, 1, 1:]
            at_nodes = self._transposed(x, nu)
            start = -(x.K.T @ (eu @ mu).T).T - (x.C.T @ (ev @ mu).T).T
            start[:, phi.dofs] += eu[:, ::-1] @ phi.u + ev[:, ::-1] @ phi.v
            start -= (x.L.T @ (e[:, self.tied] @ at_nodes).T).T
            for k, (of_u, of_v, _, of_a) in enumerate(handed[: len(mu)]):
                of_level = e[:, :, len(mu) - k]
                start += of_level @ np.stack([of_u, of_v, of_a])
            start = start.reshape(-1, 4, x.n)
            if len(handed) > len(mu):  # the last level but one is the first of this block
                start[0] += handed[1]
            starts.append(start)
            of_lam += self._of_start_multipliers(x, mu, at_nodes)
        return starts, of_lam

    def _of_start_multipliers(self, x: AdjointMember, mu: np.ndarray, at_nodes: np.ndarray) -> Any:
        """The share of a subdomain in (A12)."""
        if self.macro:
            ramp = 1.0 - np.arange(1, x.substeps) / x.substeps
            return x.L @ (ramp @ mu[: x.substeps - 1])
        if x.ratio > 1:
            _, transposed = x.links
            return x.al2 * (x.L @ (transposed @ at_nodes[0]))
        return 0.0

    def _transposed(self, x: AdjointMember, nu: np.ndarray) -> np.ndarray:
        """P^T nu on the levels of a subdomain from the first on; under "macro" R^T nu."""
        if self.macro:
            out = np.zeros((len(nu) * x.substeps + 1, self.p))
            out[x.substeps :: x.substeps] = nu
            return out
        steps = len(nu) // x.ratio
        out = np.zeros((steps + 1, self.p))
        within = np.vstack([np.zeros((1, self.p)), nu[:-1]]).reshape(steps, x.ratio, self.p)
        theta = np.arange(x.ratio) / x.ratio
        out[:-1] += np.einsum("j,kjp->kp", 1.0 - theta, within)
        out[1:] += np.einsum("j,kjp->kp", theta, within)
        out[-1] += nu[-1]
        return out

    @cached_property
    def _gram(self) -> Any:
        """The factors of sum L L^T."""
        import scipy.sparse.linalg as sla

        return sla.splu(sp.csc_array(sum(x.L @ x.L.T for x in self.members)))

    def taking_over(self, start: list[np.ndarray], of_lam: np.ndarray) -> Handed:
        """(A14): what the next block leaves, with the adjoint of its multipliers as sources."""
        if not self.p:
            return Handed(start, [np.zeros(x.n) for x in self.members])
        y = self._gram.solve(-of_lam)
        etas = []
        for x, state in zip(self.members, start):
            eta = x.L.T @ y
            of_u = x.K.T @ eta
            state[0, 0] -= of_u
            state[0, 1] -= x.C.T @ eta
            state[0, 2] -= x.M.T @ eta - x.al1_beside_K * of_u
            etas.append(eta)
        return Handed(start, etas)

    def at_zero(
        self, sources: Mapping[str, Sources], start: list[np.ndarray], of_lam: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], np.ndarray]:
        """(A13): mu_0, and the adjoints of u0, v0 and g'(0)."""
        import scipy.sparse.linalg as sla

        states = [s[0] + sources[x.name].at(0, x.n) for x, s in zip(self.members, start)]
        M = sp.block_diag([x.M.T for x in self.members], format="csc")
        L = sp.hstack([x.L for x in self.members], format="csc")
        matrix = sp.block_array([[M, L.T], [L, None]], format="csc") if self.p else M
        right = np.concatenate([s[2] + s[3] for s in states] + [-of_lam])
        *mus, slope = np.split(
            sla.splu(matrix).solve(right), np.cumsum([x.n for x in self.members])
        )
        u0 = [s[0] - x.K.T @ m for x, s, m in zip(self.members, states, mus)]
        v0 = [s[1] - x.C.T @ m for x, s, m in zip(self.members, states, mus)]
        return mus, u0, v0, slope

    def of_interface(
        self, parameters: Parameters, member: AdjointMember, lam: np.ndarray, nu: np.ndarray
    ) -> np.ndarray:
        """(A10): lam (interface levels + 1, p) from the first level of the block on."""
        if self.macro or member.ratio == 1:
            return np.zeros(parameters.m)
        q = member.ratio
        theta = np.arange(q)[:, None] / q
        nodes = lam[::q]
        straight = (1.0 - theta) * nodes[:-1, None] + theta * nodes[1:, None]
        beyond = lam[:-1].reshape(len(nodes) - 1, q, self.p) - straight  # zero at the nodes
        B = beyond.reshape(len(lam) - 1, self.p)[1:].T @ nu[:-1]
        Y, transposed = member.links
        result: np.ndarray = member.al2 * parameters._traces(Y @ B, transposed, member.weights)
        return result


def reversed_load(
    x: AdjointMember, phi: Sources, handed: Sequence[np.ndarray] | np.ndarray = (), lead: int = 0
) -> Any:
    """The loads (A6) of the reversed run: of the sources, and of what was handed over."""
    levels = len(phi.u)
    loads = x.filters.loads(phi.u, phi.v, phi.w)
    shape = np.zeros((x.n, phi.dofs.size))
    shape[phi.dofs, np.arange(phi.dofs.size)] = 1.0
    series, shapes = [loads], [shape]
    impulses = x.filters.impulses(levels)
    for k, states in enumerate(handed[:levels]):
        if np.any(states):
            series.append(np.vstack([np.zeros((k, 4)), impulses[: levels - k]]))
            shapes.append(states.T)
    values, columns = np.hstack(series), np.hstack(shapes)
    if values.shape[1] == 0:
        return np.zeros(x.n)
    values = np.vstack([np.zeros((lead + 1, values.shape[1])), values])
    if values.shape[1] >= x.n:
        return SampledForce(values @ columns.T, x.h)
    return SampledForce(values, x.h, columns)


class MeanAdjointMember(AdjointMember):
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

    members: list[MeanAdjointMember]
    tied = 0

    def _of_motion(self, lam: np.ndarray) -> np.ndarray:
        """dJ/d of what the ties of displacements prescribe."""
        lam = lam[1:].copy()
        lam[1:] -= lam[:-1].copy()
        return -lam[::-1]

    def _of_start_multipliers(self, x: AdjointMember, mu: np.ndarray, at_nodes: np.ndarray) -> Any:
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
    ) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], np.ndarray]:
        for x, state in zip(self.members, start):
            state[0] += sources[x.name].at(0, x.n)
        handed = self.taking_over(start, of_lam)
        u0, v0 = ([state[0, i] for state in handed.states] for i in range(2))
        return handed.eta, u0, v0, np.zeros(self.p)
