"""Static equilibrium of tied subdomains, in one step or by Newton's method, (N18) to (N20).

    K_i u_i + f_i(u_i) = F_i + L_i^T Lam,    sum_i L_i u_i = 0

f has the springs and the internal forces at rest, each at the end of one path from its history at
t = 0, which is what the start of a run evaluates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..errors import ConvergenceError, FactorizationError
from ..problem.forms import Newton
from ..problem.matrices import Matrix, combination, product, sparse
from ..problem.subdomain import Subdomain
from ..problem.tangents import SYMMETRY
from ..reduction.ordering import FLOATING, scale_to_one, softest
from .internal_forces import InternalForces, internal_at, matrix_of_springs, springs_at
from .ranks import Ranks, joined

# Shares of the diagonal that are added to a tangent, in turn: a singular or indefinite one gives
# no direction in which the equilibrium is closer.
SHIFTS = (0.0, 1e-3, 1.0)
# The smallest load step, as a share of the first one.
SMALLEST = 2.0**-8
# Iterations without a line search, which converge quadratically or not at all.
PLAIN = 15
# An iteration gains nothing more when its correction is this large beside the one before.
STAGNATION = 0.3
# Residuals are exact up to this many units in the last place of their terms, as (N8).
ROUNDING = 100.0 * np.finfo(float).eps


def static_displacements(
    stiffnesses: Sequence[Matrix], constraints: Sequence[sp.csr_array], forces: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """The displacements u_i, (n_i,) each; constraints: L_i with independent rows."""
    from scipy.sparse.linalg import splu

    sizes = [f.size for f in forces]
    K = sp.csc_array(sp.block_diag([sparse(A, n) for A, n in zip(stiffnesses, sizes)]))
    L = sp.csr_array(sp.hstack(constraints))
    scale, K, L = _scaled(K, L)
    _require_stiff(K, L)
    p = L.shape[0]
    saddle = sp.csc_array(sp.block_array([[K, -L.T], [L, None]])) if p else K
    right = np.concatenate([scale @ np.concatenate(forces), np.zeros(p)])
    u = scale @ splu(saddle).solve(right)[: sum(sizes)]
    return np.split(u, np.cumsum(sizes)[:-1])


def _smallest_image(G: sp.csc_array) -> float:
    """The smallest ``|G x|`` for vectors x of length 1, approximately."""
    from scipy.sparse.linalg import splu

    try:
        lu = splu(G)
    except RuntimeError:  # exactly singular
        return 0.0
    x = np.cos(np.arange(G.shape[0]))
    for _ in range(4):
        x = lu.solve(lu.solve(x / np.linalg.norm(x), "T"))
        if not np.all(np.isfinite(x)):
            return 0.0
    return float(np.linalg.norm(G @ x) / np.linalg.norm(x))


def _scaled(K: sp.csc_array, L: sp.csr_array) -> tuple[sp.dia_array, sp.csc_array, sp.csr_array]:
    scale = scale_to_one(K)
    return scale, sp.csc_array(scale @ K @ scale), sp.csr_array(L @ scale)


def require_stiff(K: sp.csc_array, L: sp.csr_array) -> None:
    """FactorizationError unless K is definite, or regular if unsymmetric, where L u = 0."""
    _require_stiff(*_scaled(K, L)[1:])


def _require_stiff(K: sp.csc_array, L: sp.csr_array) -> None:
    """FactorizationError unless K is positive definite on the motions that the ties allow.

    With the ties replaced by stiff springs, G = K + L^T L has to be positive definite. Inverse
    iteration finds the softest motion; the stiffness of a mechanism is rounding. An unsymmetric G
    only has to be regular.
    """
    G = sp.csc_array(K + L.T @ L)
    symmetric = abs(G - G.T).max() <= SYMMETRY * abs(G).max()
    if (softest(G) if symmetric else _smallest_image(G)) <= FLOATING:
        raise FactorizationError(
            "the structure is floating or its stiffness indefinite, so that it has no static "
            "equilibrium; support it by stiffness or by a constraint on one subdomain only"
        )


@dataclass
class _Trial:
    """A correction with its multipliers: du, Lam, and their slope s(0), (N19)."""

    du: np.ndarray
    lam: np.ndarray
    slope: float


class Equilibrium:
    """Newton's method for the static equilibrium of tied subdomains.

    ranks: the subdomains are those of this process: all of them solve for the whole structure, each
        evaluates the forces of its own.
    """

    def __init__(
        self,
        subdomains: Sequence[tuple[str, Subdomain]],
        internal: Sequence[InternalForces | None],
        constraints: Sequence[sp.csr_array],
        forces: Sequence[np.ndarray],
        newton: Newton,
        ranks: Ranks | None = None,
    ):
        self.subdomains, self.internal, self.newton = subdomains, internal, newton
        self.ranks, self.part = ranks, slice(None) if ranks is None else ranks.part
        self.names = joined(ranks, [name for name, _ in subdomains])
        self.L = sp.csr_array(sp.hstack(joined(ranks, constraints)))
        loads = joined(ranks, forces)
        self.ends, self.F = np.cumsum([F.size for F in loads]), np.concatenate(loads)
        self.plain = min(PLAIN, newton.iterations)
        self.iterations, self.worst = 0, self.names[0]

    def solve(self, begin: Sequence[np.ndarray], steps: int) -> list[np.ndarray]:
        """The displacements u_i of these subdomains, (n_i,) each. The residual of `begin` and its
        jump are removed in load steps, `steps` equal ones at first; one that does not converge is
        halved, and the step after one that converges is doubled."""
        u, lam = np.concatenate(joined(self.ranks, begin)), np.zeros(self.L.shape[0])
        self.first, self.jump = self._residual(u), self.L @ u
        if not np.all(np.isfinite(self.first)):
            self._find_worst(np.where(np.isfinite(self.first), 0.0, 1.0))
            cause = "its forces at the initial displacements are not finite"
            raise ConvergenceError(self.worst, 0.0, 0, cause)
        done, step = 0.0, 1.0 / steps
        while done < 1.0:
            end = min(1.0, done + step)
            end = 1.0 if 1.0 - end < 1e-9 else end
            solution = self._load_step(u, lam, end, searches=False) or self._load_step(
                u, lam, end, searches=True
            )
            if solution is not None:
                (u, lam), done = solution, end
                step = min(2.0 * step, 1.0 / steps)
            elif step > SMALLEST / steps:
                step *= 0.5
            else:
                self._refuse(u, done)
        require_stiff(self._tangent(u), self.L)
        return self._members(u)

    def _refuse(self, u: np.ndarray, done: float) -> None:
        require_stiff(self._tangent(u), self.L)  # a mechanism has no equilibrium to be found
        cause = f"of the static load {done:.3g} were reached, in load steps down to {SMALLEST:g}"
        raise ConvergenceError(self.worst, 0.0, self.iterations, cause)

    # ---- one load step -------------------------------------------------------------------------

    def _load_step(
        self, u: np.ndarray, lam: np.ndarray, load: float, *, searches: bool
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """u and Lam at this share of the load; None if the iteration does not converge.

        Without a line search it is fast where an element is much stiffer in one direction than in
        another, in which a search would follow each turn of the path.
        """
        before, self.searches = np.inf, searches
        for iteration in range(self.newton.iterations if searches else self.plain):
            self.iterations = iteration + 1
            R = self._at(u, load)
            if not np.all(np.isfinite(R)):
                return None
            K = self._tangent(u)
            jump = self.L @ u - (1.0 - load) * self.jump
            if not np.any(R + self.L.T @ lam) and not np.any(jump):
                return u, lam
            search = self._searched(u, load, K, R, jump)
            if search is None:
                return None
            trial, x, shifted = search
            from_u, u, lam = u, u + x * trial.du, lam + x * (trial.lam - lam)
            error, scale = np.sqrt(trial.slope), self._scale(u, lam)
            if shifted or x < 1.0:
                before = np.inf
            elif error <= ROUNDING * scale:
                return u, lam
            elif error > STAGNATION * before and (
                error <= self.newton.tol * scale or self._is_rounding(from_u, load, trial)
            ):
                return u, lam
            else:
                before = error
        return None

    def _searched(
        self, u: np.ndarray, load: float, K: sp.csc_array, R: np.ndarray, jump: np.ndarray
    ) -> tuple[_Trial, float, bool] | None:
        """A correction, the part of it that the line search leaves, and whether K was shifted."""
        for shift in SHIFTS if self.searches else SHIFTS[:1]:
            trial = self._correction(u, K, R, jump, shift)
            if trial is None:
                continue
            if not self.searches or trial.slope == 0.0:
                return trial, 1.0, False
            x = self._line_search(u, load, trial)
            if x is not None:
                return trial, x, shift > 0.0
            if shift == 0.0 and self._is_rounding(u, load, trial):
                return trial, 1.0, False
        return None

    def _correction(
        self, u: np.ndarray, K: sp.csc_array, R: np.ndarray, jump: np.ndarray, shift: float
    ) -> _Trial | None:
        """K du - L^T Lam = R, L du = - jump; None unless du . K du > 0, or it is rounding: 0."""
        from scipy.sparse.linalg import splu

        d = np.abs(K.diagonal())
        d[d == 0.0] = np.max(d, initial=0.0) or 1.0
        scale = sp.diags_array(2.0 ** np.round(-0.5 * np.log2(d)))
        n, p = R.size, jump.size
        A = scale @ (K + shift * sp.diags_array(d)) @ scale
        L = sp.csr_array(self.L @ scale)
        saddle = sp.csc_array(sp.block_array([[A, -L.T], [L, None]]) if p else A)
        try:
            with np.errstate(all="ignore"):
                x = splu(saddle).solve(np.concatenate([scale @ R, -jump]))
        except RuntimeError:  # exactly singular
            return None
        du, lam = scale @ x[:n], x[n:]
        pulled = R + self.L.T @ lam
        slope = float(du @ pulled)
        terms = np.abs(self.F) + abs(K) @ np.abs(u) + abs(self.L).T @ np.abs(lam)
        reach = ROUNDING * (abs(self.L) @ (np.abs(u) + terms / d))
        if np.abs(du) @ np.abs(pulled) <= ROUNDING * (np.abs(du) @ terms):
            if np.all(np.abs(jump) <= reach):
                return _Trial(du, lam, 0.0)
        return _Trial(du, lam, slope) if np.isfinite(slope) and slope > 0.0 else None

    def _slope(self, u: np.ndarray, load: float, trial: _Trial, x: float) -> float:
        """s(x) = du . (R(u + x du) + L^T Lam), (N19)"""
        with np.errstate(all="ignore"):
            R = self._at(u + x * trial.du, load)
            left = trial.du * (R + self.L.T @ trial.lam)
        if x == 1.0:  # what the tangent did not predict
            self._find_worst(left)
        return float(np.sum(left))

    def _line_search(self, u: np.ndarray, load: float, trial: _Trial) -> float | None:
        """The part x of a correction that does not overshoot, as in (N10); None if there is none.

        A jump is removed in proportion to x, so that its work is in the slope.
        """
        s0 = trial.slope
        s1 = self._slope(u, load, trial, 1.0)
        if np.isfinite(s1) and s1 >= -0.8 * s0:
            return 1.0
        low, high, at_low, at_high = 0.0, 1.0, s0, s1
        for _ in range(10):
            share = 0.5
            if np.isfinite(at_high):
                share = min(max(at_low / (at_low - at_high), 0.1), 0.9)
            x = low + share * (high - low)
            s = self._slope(u, load, trial, x)
            if abs(s) <= 0.5 * s0:
                return x
            if s > 0.0:
                low, at_low = x, s
            else:
                high, at_high = x, s
        return None

    def _is_rounding(self, u: np.ndarray, load: float, trial: _Trial) -> bool:
        """Whether a correction is below the rounding of the forces, (N9)."""
        s0 = trial.slope

        def follows(x: float) -> bool:
            return abs(self._slope(u, load, trial, x) - (1.0 - x) * s0) <= 0.1 * x * s0

        return not follows(2.0**-10) and follows(2.0**30)

    # ---- residual and tangent ------------------------------------------------------------------

    def _at(self, u: np.ndarray, load: float) -> np.ndarray:
        """R without the multipliers: the residual of the beginning is removed with the load."""
        return self._residual(u) - (1.0 - load) * self.first

    def _members(self, u: np.ndarray) -> list[np.ndarray]:
        return np.split(u, self.ends[:-1])[self.part]

    def _residual(self, u: np.ndarray) -> np.ndarray:
        """F - K u - f(u)"""
        with np.errstate(all="ignore"):
            internal = [self._force(i, u_i) for i, u_i in enumerate(self._members(u))]
        result: np.ndarray = self.F - np.concatenate(joined(self.ranks, internal))
        return result

    def _force(self, i: int, u: np.ndarray) -> np.ndarray:
        (_, s), internal = self.subdomains[i], self.internal[i]
        q = np.empty(0) if internal is None else internal.initial
        f = internal_at(internal, s.n, 0.0, u, np.zeros(s.n), q, tangent=False).f
        if s.springs:
            f = f + springs_at(s, u)[0]
        result: np.ndarray = product(s.K, u) + f
        return result

    def _tangent(self, u: np.ndarray) -> sp.csc_array:
        tangents = []
        for (_, s), internal, u_i in zip(self.subdomains, self.internal, self._members(u)):
            q = np.empty(0) if internal is None else internal.initial
            terms = [(1.0, s.K), (1.0, internal_at(internal, s.n, 0.0, u_i, np.zeros(s.n), q).K)]
            if s.springs:
                terms.append((1.0, matrix_of_springs(s, springs_at(s, u_i)[1])))
            tangents.append(sparse(combination(terms), s.n))
        return sp.csc_array(sp.block_diag(joined(self.ranks, tangents)))

    def _scale(self, u: np.ndarray, lam: np.ndarray) -> float:
        """Root of the energy sum |u| . (|F| + |K u + f| + |L^T Lam|)."""
        f = self.F - self._residual(u)
        terms = np.abs(self.F) + np.abs(f) + np.abs(self.L.T @ lam)
        return float(np.sqrt(np.abs(u) @ terms))

    def _find_worst(self, energies: np.ndarray) -> None:
        shares = [np.sum(np.abs(x)) for x in np.split(energies, self.ends[:-1])]
        self.worst = self.names[int(np.argmax(shares))]
