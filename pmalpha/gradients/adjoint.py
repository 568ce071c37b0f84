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

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .._cached import cached_property
from ..problem.constraints import Constraint
from ..problem.matrices import is_symmetric, sparse
from ..problem.sampled import SampledForce
from ..problem.schemes import Scheme
from ..setup.ranks import remade
from .parameters import Parameters, acceleration

# ---- filters ------------------------------------------------------------------------------------
# The scalar filters that turn a coupled run into its adjoint, equations (A1) to (A6). A filter
# is a quotient of products of polynomials in z, the shift by one time level. Factors that are in
# both products are cancelled, and each one is applied by itself: the product of three
# integrations, multiplied out, would lose half of the digits.

Factor = tuple[float, ...]

DIFFERENCE: Factor = (1.0, -1.0)  # d = 1 - z
# Two factors are equal up to rounding.
ROUNDING = 1e-12


class Filter:
    """gain times the product of `over` divided by that of `under`, each factor (c0, c1, ...)."""

    def __init__(self, gain: float, over: Sequence[Factor] = (), under: Sequence[Factor] = ()):
        left, right = list(over), list(under)
        for x in over:
            same = next((y for y in right if _parallel(x, y)), None)
            if same is not None:
                left.remove(x)
                right.remove(same)
                gain *= x[0] / same[0]
        self.gain, self.over, self.under = gain, left, right

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The filtered rows of x, (levels, ...), from rest."""
        from scipy.signal import lfilter

        y = self.gain * x
        if y.size == 0:
            return y
        for c in self.over:
            x, y = y, c[0] * y
            for k in range(1, len(c)):
                y[k:] += c[k] * x[:-k]
        for c in self.under:
            y = lfilter([1.0], c, y, axis=0)
        return y


def _parallel(x: Factor, y: Factor) -> bool:
    if len(x) != len(y) or x[0] == 0.0 or y[0] == 0.0:
        return False
    return all(abs(a / x[0] - b / y[0]) <= ROUNDING for a, b in zip(x, y))


class Filters:
    """The filters of a subdomain with substeps of length `h`.

    Double steps have z^2 and 2 h in (A1), and Phi = 2 d m(z^2) / (1 + z).

    phi: (A5), from the accelerations of the reversed run to the adjoint mu.
    """

    def __init__(self, scheme: Scheme, h: float, double: bool):
        am, af, gamma = scheme.am, scheme.af, scheme.gamma
        d, sums = DIFFERENCE, [(1.0, 1.0)] if double else []
        slope, old, new, *quadratic = (
            _stretched(c) if double else c
            for c in ((gamma, 1.0 - gamma), (1.0 - am, am), (1.0 - af, af), *_displacement(scheme))
        )  # A = new / old
        two = 2.0 if double else 1.0
        self.phi = Filter(two, [d, slope, new], [old, *sums])
        self._of_u = Filter(two * h * h, quadratic, [d, d, d, slope, *sums])
        self._of_v = Filter(h, [], [d, d])
        self._of_w = Filter(1.0 / two, [old, *sums], [d, slope, new])
        self._of_a = Filter(1.0 / two, sums, [d, slope])

    def loads(self, u: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Loads of the reversed run, (A6), for sources (levels, k) in reversed order."""
        result: np.ndarray = self._of_u(u) + self._of_v(v) + self._of_w(w)
        return result

    def impulses(self, levels: int) -> np.ndarray:
        """Loads for a unit source of u, v, w and a at the first reversed level, (levels, 4)."""
        unit = np.zeros((levels, 1))
        unit[0] = 1.0
        return np.hstack([f(unit) for f in (self._of_u, self._of_v, self._of_w, self._of_a)])


class MeanFilters:
    """Those of the trapezoidal rule under "mean", from displacements of the reversed run, (A17)."""

    def __init__(self, h: float):
        mean = (0.5, 0.5)
        self.phi = Filter(1.0, [DIFFERENCE, mean])
        self._of_u = Filter(1.0, [], [DIFFERENCE, mean])
        self._of_v = Filter(1.0 / h, [], [mean, mean])

    def loads(self, u: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """As `Filters.loads`; there are no sources of w."""
        result: np.ndarray = self._of_u(u) + self._of_v(v)
        return result

    def impulses(self, levels: int) -> np.ndarray:
        """As `Filters.impulses`."""
        unit, none = np.zeros((2, levels, 1))
        unit[0] = 1.0
        return np.hstack([self._of_u(unit), self._of_v(unit), none, none])


def _stretched(c: Factor) -> Factor:
    """c with z^2 in place of z."""
    out = [0.0] * (2 * len(c) - 1)
    out[::2] = c
    return tuple(out)


def _displacement(scheme: Scheme) -> list[Factor]:
    """beta + (1/2 + gamma - 2 beta) z + (1/2 + beta - gamma) z^2, in real factors if possible."""
    beta, gamma = scheme.beta, scheme.gamma
    c0, c1, c2 = beta, 0.5 + gamma - 2.0 * beta, 0.5 + beta - gamma
    if c0 == 0.0:
        return [(0.0, 1.0), (c1, c2)]
    square = c1 * c1 - 4.0 * c0 * c2
    if square < -ROUNDING * c1 * c1:
        return [(c0, c1, c2)]
    root = np.sqrt(max(square, 0.0))
    return [(c0, (c1 + root) / 2.0), (1.0, (c1 - root) / (2.0 * c0))]


def responses_to_state(scheme: Scheme, h: float, levels: int, double: bool) -> np.ndarray:
    """u, v, a of steps after a unit in u, v, w, a at a start level, with w = 0 after it, (A11).

    Returns (units, 3, levels + 1) array, by unit, component and level. Units: u, v, w, a at level
        0; with double steps, which begin two levels before their end, the same at level -1 too.
    """
    if double:
        chain = responses_to_state(scheme, 2.0 * h, (levels + 1) // 2, False)
        out = np.zeros((2, 4, 3, levels + 1))
        out[0, ..., ::2] = chain[..., : levels // 2 + 1]
        out[1, ..., 1::2] = chain[..., 1 : (levels + 1) // 2 + 1]
        return out.reshape(8, 3, levels + 1)
    step = scheme.constants(h)
    u0, v0, w0, a0 = np.eye(4)[..., None]
    first = step.a_a * a0 + step.a_w * w0  # (9)
    a = np.hstack([a0, first * step.a_a ** np.arange(levels)])
    w = np.hstack([w0, np.zeros((4, levels))])
    of_v = step.v_a * a + step.v_w * w  # (6)
    v = np.cumsum(np.hstack([v0, of_v[:, :-1]]), axis=1)
    of_u = h * v + step.u_a * a + step.u_w * w  # (5)
    u = np.cumsum(np.hstack([u0, of_u[:, :-1]]), axis=1)
    return np.stack([u, v, a], axis=1)


# ---- adjoint ------------------------------------------------------------------------------------

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


# ---- problem ------------------------------------------------------------------------------------
# What of a coupler its adjoint needs, and the couplers that run in reversed time.


class Problem:
    """A linear coupled problem.

    single, steady: of the first macro step, whose steps are single, and of the others; one object
        where all steps are single.
    """

    def __init__(self, coupler: Any, session: Any):
        self.coupler, self.keys = coupler, session.keys
        layout, self.matrices = session.steps.layout, session.rows.matrices
        self.dt, self.mean = layout.dt, session.coupling == "mean"
        self.macro = self.mean or session.coupling == "macro"
        self._members = session.members
        self.session = session
        self.fine = 1 if self.macro else max(layout.substeps)
        self.symmetric = all(is_symmetric(s.C) and is_symmetric(s.K) for _, s in self.keys)
        self.forces = session.loads.seen
        self.prescribed = bool(session.loads.motions)
        self.doubles = layout.doubles
        self.substeps = {name: s.substeps for name, s in self.keys}
        self.single = self._adjoint([False] * len(self.keys))
        self.steady = self._adjoint(self.doubles) if any(self.doubles) else self.single

    def accelerations(self) -> list[np.ndarray]:
        """w of each subdomain at present, without what multipliers add under "mean"."""
        return [member.core.state()[2][member.position] for member in self._members]

    def ground(self, name: str, first: int, last: int) -> np.ndarray:
        """The acceleration of the ground at levels first to last of a subdomain, (levels, n);
        (1, 1) without a ground motion."""
        i = next(i for i, (key, _) in enumerate(self.keys) if key == name)
        t = np.arange(first, last + 1) / self.substeps[name] * self.dt  # (T1)
        return acceleration(self.forces[i], t)

    def motions(self, run: Any, beginning: Sequence[np.ndarray]) -> dict[str, Any]:
        """What dM, dC and dK are multiplied by in (A9), at all levels of a run from t = 0.

        `beginning` is w of each subdomain at t = 0.
        """
        out = {}
        members = zip(self.single.members, self.steady.members)
        for (first, x), w, history in zip(members, beginning, run.subdomains):
            if history is None:
                continue
            out[x.name] = motion = x.motion(history, w)
            single = slice(0, 1 if self.invariant else first.substeps + 1)
            motion["K"][single] = history.u[single] - first.al1_beside_K * history.a[single]
            motion["K"][0] = history.u[0]
            motion["M"] = motion["M"] + self.ground(x.name, 0, len(history.u) - 1)
        return out

    @property
    def invariant(self) -> bool:
        """Whether all macro steps are alike."""
        return self.single is self.steady

    def unit_loads(self, name: str, dof: int, before: int, what: str, steps: int) -> dict[str, Any]:
        """Loads of the reversed run of one dof, some substeps before the end."""
        loads: dict[str, Any] = {}
        for x in self.single.members:
            if x.name != name:
                loads[x.name] = np.zeros(x.n)
                continue
            unit, none = np.zeros((2, steps * x.substeps, 1))
            unit[before] = 1.0
            u, v, w = (unit if what == kind else none for kind in "uva")
            loads[name] = reversed_load(x, Sources(np.array([dof]), u, v, w))
        return loads

    def require_constant_interface(self, what: str) -> None:
        """ValueError where H multiplies what depends on the parameters, (A10)."""
        if not self.macro and any(s.substeps < self.fine for _, s in self.keys):
            raise ValueError(
                f'{what} needs coupling "macro", or equal substeps: under '
                f'"{self.session.coupling}" the H beside interpolated velocities depends on the '
                "parameters. Coupler.gradient has no such limit"
            )

    def sensitive(self, cases: Sequence[Mapping[str, Any]], steps: int, record: Any) -> list[Any]:
        """Runs from rest, each under loads on one subdomain by name."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # their loads are not those of a structure
            return self._from_rest(self._unmoved, cases, steps, record)

    def _adjoint(self, doubles: Sequence[bool]) -> Adjoint:
        of_member, of_all = (
            (MeanAdjointMember, MeanAdjoint) if self.mean else (AdjointMember, Adjoint)
        )
        members = []
        for (name, s), L, double in zip(self.keys, self.matrices, doubles):
            ratio = 1 if self.macro else self.fine // s.substeps
            members.append(of_member(name, s, L, self.dt, ratio, double))

        def reverse(forces: Any, steps: int, g: np.ndarray | None, double: bool) -> Any:
            return self.reversed_runs([forces], steps, None, g, double)[0]

        return of_all(members, self.macro, self.dt, self.fine, reverse)

    def reversed_runs(
        self,
        cases: Sequence[Mapping[str, Any]],
        steps: int,
        record: Any,
        g: np.ndarray | None = None,
        double: bool = False,
    ) -> list[Any]:
        """Runs with the transposed matrices from rest, each under loads by name."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # their loads are not those of a structure
            coupler = self._transposed if g is None else self._copy(g, double, True)
            return self._from_rest(coupler, cases, steps, record)

    def _from_rest(
        self, coupler: Any, cases: Sequence[Mapping[str, Any]], steps: int, record: Any
    ) -> list[Any]:
        rest = {name: np.zeros(s.n) for name, s in self.keys}
        runs = [{"u0": rest, "v0": rest, "force": {**rest, **forces}} for forces in cases]
        return list(coupler.run_each(runs, steps=steps, record=record))

    @cached_property
    def _unmoved(self) -> Any:
        """The coupler, or one like it without prescribed velocities."""
        return self._copy(None, True, False) if self.prescribed else self.coupler

    @cached_property
    def _transposed(self) -> Any:
        """The same of the transposed matrices."""
        return self._unmoved if self.symmetric else self._copy(None, True, True)

    def _copy(self, g: np.ndarray | None, double: bool, transposed: bool) -> Any:
        """A coupler of the same matrices, or the transposed ones, without loads."""

        names = [name for name, _ in self.keys]

        def change(name: str, arguments: dict[str, Any]) -> None:
            steady, i = double or g is None, names.index(name)
            arguments |= dict(force=None, u0=None, v0=None)
            arguments |= dict(double_step=self.doubles[i] and steady)
            if transposed:
                arguments |= {x: A.T for x in "KC" if (A := arguments[x]) is not None}

        velocity = None if g is None else SampledForce(g, self.dt / self.fine)
        rows: Any = ()
        if self.single.p:
            rows = Constraint({x: L for x, L in zip(names, self.matrices) if L.nnz}, velocity)
        return remade(self.session, type(self.coupler), change, constraints=rows, dt=self.dt)


def subdomain_of(keys: Any, p: Parameters) -> str:
    for name, s in keys:
        if p.subdomain in (name, s):
            p._check_size(s.n, name)
            result: str = name
            return result
    names = ", ".join(repr(name) for name, _ in keys)
    other = p.name in dict(keys) and "; it is another object of this name: give the name alone"
    raise KeyError(f"parameters must be of one of the subdomains {names}, got {p!r}{other or ''}")
