"""Consistent initial accelerations and multipliers, equations (S1).

    M_i w_i = r_i + L_i^T Lam,    sum_i L_i w_i = g'(0),    r_i = F_i(0) - C_i v_i - K_i u_i

This has the form of one coupled step: with C = K = 0, al2 = 1 and r as load, the free problem is
M wf = r, the interface problem H Lam = - sum L wf with H = sum L M^-1 L^T, and the link problem
adds M^-1 L^T Lam. So a step of the core solves it.

Dofs without mass get a one on the diagonal of M, without load or constraint, so that w = 0 where
nothing determines it. Their equation, 0 = r + L^T Lam, and the acceleration that a tie gives them
are added to the interface problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._checks import listing, numbered
from .._core import LANES
from ..errors import ConstraintWarning, FactorizationError, warn
from ..memory import one_thread
from ..problem import forms
from ..problem.forms import Factor, Operator
from ..problem.matrices import EXPORTED, Matrix, combination, diagonal, sparse_diagonal
from ..problem.schemes import Scheme
from .interface import interface_factor, summed, total
from .link import Block, Link, diagonal_compliances
from .member import Member, core_parts
from .ranks import Ranks, check_stable, joined, processes

# A step of length 1 with al1 = 0 and al2 = 1.
UNIT_STEP = Scheme(am=0.0, af=0.0, beta=0.0, gamma=1.0, explicit=True)
# Shares of the largest entry of M that are added to an indefinite M, up to `EXPORTED`.
SHARES = (1e-14, 1e-13, 1e-12, 1e-11, EXPORTED)
# Tolerance of the equations of massless dofs at t = 0, relative to their terms: rounding of input.
RESIDUAL = 1e-8
# Where dofs without mass are tied: a singular value below this share of the largest entry is a
# zero; what a solution may leave of the right-hand side.
ZERO, LEFT = 1e-12, 1e-9


class InitialAccelerations:
    """Solves (S1) for any right-hand side, with factors made once.

    rows: (p,) array of int, numbers of the constraints, in the order of the multipliers.
    """

    def __init__(
        self, members: Sequence[Member], p: int, rows: np.ndarray, ranks: Ranks | None = None
    ):
        self.members, self.ranks = members, ranks
        self.masses = [_Mass(member) for member in members]
        blocks = joined(ranks, _compliances(self.masses))
        if ranks is not None:
            _require_mass(self.masses)
        self.ties_without_mass = any(m.is_tied for m in self.masses)
        H = None
        if self.ties_without_mass:
            L_m = sp.csr_array(sp.hstack([m.member.L.matrix[:, m.massless] for m in self.masses]))
            self.tied = np.unique(L_m.indices)
            self.saddle = _Saddle(total(blocks, p), L_m[:, self.tied])
            p = 0  # the saddle-point problem has the constraints; the core solves with M only
        else:
            H = summed(blocks, p)
        parts = [m.parts(linked=not self.ties_without_mass) for m in self.masses]
        self.cores = list(map(_core.Subdomain, parts))
        self.p = p
        factor = interface_factor(H, rows, "the interface matrix of the initial accelerations")
        everywhere = (forms.Motion(np.arange(p), None),)
        self.coupler = _core.Coupler(
            tuple(self.cores),
            {"p": p, "H_start": factor, "H": factor, "motions": everywhere}
            | {"schedule": "fine", "options": {"dt": 1.0}},
            processes(ranks, parts),
        )
        self.lanes: tuple[tuple[_core.Subdomain, ...], _core.Coupler] | None = None  # when needed

    def solve(
        self, terms: Sequence[Sequence[np.ndarray]], g: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """w_i and Lam for the terms of r_i, in elimination order.

        terms: for each subdomain the (n_i,) arrays F(0), -C v, -K u.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # then w is not finite either
            r: list[Any] = [sum(t) for t in terms]
        w, lam = self.response(r, g)
        with np.errstate(over="ignore"):
            sizes = [sum(np.abs(term) for term in parts) for parts in terms]
        size = max((np.max(x, initial=0.0) for x in sizes), default=0.0)
        broken = [mass.broken_equations(r_i, lam, size) for mass, r_i in zip(self.masses, r)]
        _warn_of_broken([x for x in broken if x is not None], size)
        return w, lam

    def response(
        self, r: Sequence[np.ndarray], g: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """w_i and Lam for right-hand sides r_i, which may leave equations without mass unsolved."""
        return self._solve_without_mass(r, g) if self.ties_without_mass else self._step(r, g)

    def solve_columns(
        self, terms: Sequence[Sequence[np.ndarray]], g: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """`solve` for `LANES` right-hand sides: (n_i, LANES) terms, and w; lam (p, LANES)."""
        if any(mass.massless.size for mass in self.masses):
            pairs = [self.solve([[x[:, k] for x in t] for t in terms], g) for k in range(LANES)]
            apart = zip(*(w_k for w_k, _ in pairs))
            return [np.stack(x, axis=-1) for x in apart], np.stack([x for _, x in pairs], axis=-1)
        r: list[Any] = [sum(t) for t in terms]
        if self.lanes is None:
            cores = tuple(core.in_lanes() for core in self.cores)
            self.lanes = cores, self.coupler.in_lanes(cores)
        cores, coupler = self.lanes
        lam = np.zeros(self.p * LANES)
        for core, loads in zip(cores, r):
            zero = np.zeros(loads.size)
            core.start(zero, zero, zero, lam)
            core.set_load(tuple(np.ascontiguousarray(loads.T)))
        for lane in range(LANES):
            coupler.set_motion(lane, g)
        coupler.start(0, lam, lam)
        check_stable(coupler.advance(1, None), self.members)
        w = [core.state()[2].reshape(-1, LANES) for core in cores]
        return w, coupler.multipliers.reshape(-1, LANES)

    def _step(self, r: Sequence[np.ndarray], g: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Solves M w = r + L^T Lam by one step of the core, from rest."""
        lam = np.zeros(self.p)
        for mass, core, load in zip(self.masses, self.cores, r):
            load = load.copy()
            load[mass.massless] = 0.0
            zero = np.zeros(load.size)
            core.start(zero, zero, zero, lam)
            core.set_load(load)
        self.coupler.set_motion(0, g)
        self.coupler.start(0, lam, lam)
        if self.ranks is not None:
            self.ranks.share(None)
        check_stable(self.coupler.advance(1, None), self.members, self.ranks)
        return [core.state()[2] for core in self.cores], self.coupler.multipliers

    def _solve_without_mass(
        self, r: Sequence[np.ndarray], g: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Solves the interface problem extended by the tied massless dofs:

        [H   B] [Lam]   [g - sum L wf]
        [B^T 0] [w_m] = [- r_m       ]      B: the columns of L of these dofs
        """
        no_rows = np.empty(0)
        wf, _ = self._step(r, no_rows)
        free = sum(m.tied @ w for m, w in zip(self.masses, wf))
        r_m = np.concatenate([r_i[m.massless] for m, r_i in zip(self.masses, r)])
        p, tied = g.size, self.tied
        solution = self.saddle.solve(np.concatenate([g - free, -r_m[tied]]))
        lam, w_m = solution[:p], np.zeros(r_m.size)
        w_m[tied] = solution[p:]
        loads = [r_i + m.tied.T @ lam for m, r_i in zip(self.masses, r)]
        w, _ = self._step(loads, no_rows)
        starts = np.cumsum([0] + [m.massless.size for m in self.masses])
        for mass, w_i, begin, end in zip(self.masses, w, starts[:-1], starts[1:]):
            w_i[mass.massless] = w_m[begin:end]
        return w, lam


def _require_mass(masses: Sequence[_Mass]) -> None:
    """ValueError for constraints on dofs without mass, whose equations are solved together."""
    for mass in masses:
        if mass.is_tied:
            dofs = np.sort(mass.member.order[np.intersect1d(mass.massless, mass.member.L.dofs)])
            raise ValueError(
                "constraints need dofs with mass in a Coupler with comm, got "
                f"{numbered('dof', dofs)} of {mass.member.name!r} without"
            )


class _Mass:
    """The mass matrix of a subdomain, with its massless dofs treated separately."""

    def __init__(self, member: Member):
        self.member = member
        self.massless = member.massless
        matrix = member.regular_mass if self.massless.size else member.M
        self.diagonal = matrix if matrix.ndim == 1 else None
        self.operator = Operator(1.0, member.mass_factor or _mass_factor(member, matrix))
        self.linked = member.L.without(self.massless) if self.massless.size else member.L

    @property
    def is_tied(self) -> bool:
        """Whether constraints reach dofs without mass."""
        return self.linked.values.size < self.member.L.values.size

    @property
    def tied(self) -> sp.csc_array:
        """The matrix of `linked`."""
        if not self.massless.size:
            return self.member.L.matrix
        has_mass = np.ones(self.member.n)
        has_mass[self.massless] = 0.0
        return sp.csc_array(self.member.L.matrix @ sp.diags_array(has_mass))

    def parts(self, *, linked: bool) -> dict[str, Any]:
        """What the core is made of."""
        L = self.linked if linked else Link.empty(self.member.n)
        return core_parts(self.member, UNIT_STEP, L, self.operator)

    def broken_equations(
        self, r: np.ndarray, lam: np.ndarray, size: float
    ) -> tuple[str, np.ndarray, float] | None:
        """The massless dofs in which 0 = r + L^T Lam does not hold, relative to forces of this
        size: the name of the subdomain, the dofs, and the largest force that is left; or None."""
        if not self.massless.size:
            return None
        left = np.abs(r + self.member.L.matrix.T @ lam)[self.massless]
        broken = self.massless[left > RESIDUAL * size]
        if not broken.size:
            return None
        return self.member.name, np.sort(self.member.order[broken]), float(np.max(left))


def _compliances(masses: Sequence[_Mass]) -> list[Block]:
    """L M^-1 L^T of each, those of diagonal masses in one pass."""
    plain = [(1.0 / m.diagonal, m.linked) for m in masses if m.diagonal is not None]
    blocks = iter(diagonal_compliances([d for d, _ in plain], [L for _, L in plain]))
    return [
        m.member.compliance(m.operator.factor, m.linked) if m.diagonal is None else next(blocks)
        for m in masses
    ]


def _warn_of_broken(broken: Sequence[tuple[str, np.ndarray, float]], size: float) -> None:
    """ConstraintWarning for equations without mass that do not hold at t = 0."""
    if not broken:
        return
    places = [f"{numbered('dof', dofs)} of {name!r}" for name, dofs, _ in broken]
    warn(
        f"the equations of dofs without mass do not hold at t = 0, those of {listing(places)}: "
        f"{max(left for _, _, left in broken):g} is left of forces up to {size:g}; the first "
        "steps will jump to a state where they hold",
        ConstraintWarning,
    )


def _mass_factor(member: Member, M: Matrix) -> Factor:
    """The factor of M; of M + s I if M of an implicit subdomain is indefinite by rounding.

    s is the smallest power of ten times the largest entry of M that makes it definite, up to the
    rounding of exported files. Steps do not need this factor.
    """
    what = f"M of subdomain {member.name!r}"
    try:
        return member.factor_of_mass()
    except FactorizationError as error:
        if member.subdomain.scheme.explicit or member.M is None:
            raise
        refusal = error
    largest = float(np.max(np.abs(diagonal(member.M))))
    for share in SHARES:
        shifted = combination([(1.0, M), (share * largest, np.ones(member.n))])
        try:
            factor = member.factor(shifted, what)
        except FactorizationError:
            continue
        warn(
            f"{what} is indefinite at the level of its last digits, as in files with few digits: "
            f"{share:g} of its largest entry is added to the diagonal for the initial "
            f"accelerations; the steps use M as given{_exchanged(member)}",
            ConstraintWarning,
        )
        return factor
    raise refusal


def _exchanged(member: Member) -> str:
    """What M and K look like, where M is no mass matrix and K could be one; nothing otherwise."""
    K = member.subdomain.K
    if K is None or member.M is None or not np.all(diagonal(K) > 0.0):
        return ""
    lumped = K.ndim == 1 or not sp.csr_array(K - sparse_diagonal(diagonal(K))).data.any()
    return "; K is a diagonal of positive numbers: are M and K exchanged?" if lumped else ""


class _Saddle:
    """Solves [[H, B], [B^T, 0]] x = right; the minimum-norm x where the matrix is singular."""

    def __init__(self, H: sp.csr_array, B: sp.csr_array):
        from scipy.sparse.linalg import splu

        matrix = sp.csc_array(sp.block_array([[H, B], [B.T, None]]))
        # units of mass scale H, not B: both are scaled to the same size, by a power of two
        size = np.max(np.abs(H.data), initial=0.0)
        s = 2.0 ** np.round(np.log2(size) / 2.0) if size > 0.0 else 1.0
        self.scale = np.concatenate([np.full(H.shape[0], 1.0 / s), np.full(B.shape[1], s)])
        scale = sp.diags_array(self.scale)
        self.matrix = sp.csc_array(scale @ matrix @ scale)
        try:
            with one_thread():
                self.lu = splu(self.matrix)
                self.regular = self._is_regular()
        except RuntimeError:  # exactly singular, as for two massless dofs tied to each other
            self.lu, self.regular = None, False

    def _is_regular(self) -> bool:
        """Whether no pivot is the rounding of zero, by the smallest singular value."""
        x = np.cos(np.arange(self.scale.size))
        for _ in range(2):
            x = self.lu.solve(self.lu.solve(x / np.linalg.norm(x)), "T")
        return bool(np.linalg.norm(x) < 1.0 / (ZERO * abs(self.matrix).max()) ** 2)

    def solve(self, right: np.ndarray) -> np.ndarray:
        from scipy.sparse.linalg import lsmr

        scaled = self.scale * right
        with one_thread():
            x = None if self.lu is None else self.lu.solve(scaled)
        holds = x is not None and self._holds(x, scaled)
        if not (holds and self.regular):
            limits = dict(atol=1e-14, btol=1e-14, maxiter=10 * scaled.size)
            smallest = lsmr(self.matrix, scaled, **limits)[0]
            if not holds or self._holds(smallest, scaled):
                x = smallest
        result: np.ndarray = self.scale * x
        return result

    def _holds(self, x: np.ndarray, scaled: np.ndarray) -> bool:
        residual = np.max(np.abs(self.matrix @ x - scaled), initial=0.0)
        return bool(residual <= LEFT * np.max(np.abs(scaled), initial=0.0))
