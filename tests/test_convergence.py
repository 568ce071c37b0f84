"""Order of convergence through the public API, against the motion of the uncut structure.

The exact motion is scipy's: DOP853 for loaded structures, at relative 1e-12, which is far below
every error measured here (1e-6 and more); the matrix exponential for free vibration.

An order is the slope of log2(error) when the step is halved. An error c1 dt^q + c2 dt^(q+1) has a
slope that differs from q by about dt c2/c1: tolerances beside the slopes cover that second term.
"""

import functools
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import in_turn
from scipy.integrate import solve_ivp

import pmalpha as pm

SECOND = pm.GeneralizedAlpha(0.5)
FAST = pm.GeneralizedAlpha(0.5, explicit=True)


def orders(errors):
    """Observed orders between successive rows, each of half the step of the one before."""
    errors = np.asarray(errors)
    return np.log2(errors[:-1] / errors[1:])


def motion(M, C, K, force, u0, v0, t):
    """u, v, w (k, n) of M w + C v + K u = force(t) at the increasing times t[0] = 0, t[1], ..."""
    n, A = len(M), np.linalg.solve(M, np.hstack([-K, -C]))
    flexible = np.linalg.inv(M)

    def rate(t, x):
        return np.concatenate([x[n:], flexible @ force(t) + A @ x])

    x0 = np.concatenate([u0, v0])
    found = solve_ivp(rate, (0.0, t[-1]), x0, method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13)
    x = found.y.T
    return x[:, :n], x[:, n:], np.array([rate(*tx)[n:] for tx in zip(t, x)])


# ---- one subdomain --------------------------------------------------------------------------

M3 = np.diag([1.0, 2.0, 1.5])
K3 = 40.0 * (2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
C3 = 0.02 * M3 + 0.01 * K3
STATE3 = {"u0": np.array([1.0, 0.0, -0.5]), "v0": np.array([0.0, 2.0, 1.0])}


def push3(t):
    return np.array([5.0 * np.sin(3.0 * t), 0.0, 2.0 * np.cos(5.0 * t)])


def alone_orders(scheme, counts, form=np.asarray):
    """Orders of u, v, a at t = 1 of the damped and loaded chain of three."""
    truth = [x[-1] for x in motion(M3, C3, K3, push3, **STATE3, t=np.array([0.0, 1.0]))]
    chain = pm.Subdomain(form(M3), form(K3), C=form(C3), scheme=scheme, force=push3, **STATE3)
    errors = []
    for count in counts:
        got = pm.solve(chain, dt=1.0 / count, t_end=1.0)
        errors.append([np.abs(x[-1] - y).max() for x, y in zip((got.u, got.v, got.a), truth)])
    return orders(errors)


@pytest.mark.parametrize(
    "scheme, form",
    in_turn(
        [
            *(pm.GeneralizedAlpha(rho) for rho in (0.0, 0.5, 1.0)),
            *(pm.GeneralizedAlpha(rho, explicit=True) for rho in (0.0, 0.5, 1.0)),
            pm.Newmark(),
            pm.CentralDifference(),
            pm.HHT(0.2),
            pm.WBZ(0.15),
        ],
        np.asarray,
        sp.csr_array,
    ),
)
def test_an_uncoupled_subdomain_has_order_two_in_u_v_and_a(scheme, form):
    # dt omega = 0.03: the next term
    assert alone_orders(scheme, [400, 800], form) == pytest.approx(2.0, abs=0.05)


def test_numerical_damping_by_gamma_alone_costs_newmark_one_order():
    # gamma = 1/2 is required for order 2; without it the same measurement gives order 1
    assert alone_orders(pm.Newmark(0.3025, 0.6), [400, 800]) == pytest.approx(1.0, abs=0.05)


def test_a_load_late_by_a_third_of_a_step_costs_one_order():
    # as if equilibrium held within the step, at 1 - af: the load must be that of the end
    errors = []
    truth = motion(M3, C3, K3, push3, **STATE3, t=np.array([0.0, 1.0]))[1][-1]
    for h in (1 / 800, 1 / 1600):
        late = lambda t, h=h: push3(t - h / 3.0)  # noqa: E731
        chain = pm.Subdomain(M3, K3, C=C3, scheme=SECOND, force=late, **STATE3)
        errors.append(np.abs(pm.solve(chain, dt=h, t_end=1.0).v[-1] - truth).max())
    assert orders(errors) == pytest.approx(1.0, abs=0.15)  # the dt^2 term, still a tenth of it


# ---- partitioned structures -----------------------------------------------------------------


@dataclass
class Piece:
    """A subdomain: its matrices, the numbers of its dofs in the whole, its load if any."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    dofs: list
    force: object = None

    def load(self, t):
        return np.zeros(len(self.dofs)) if self.force is None else self.force(t)


class Structure:
    """Subdomains, and the whole structure that they form together.

    `ties` are (i, dof of i, j, dof of j); each tie is one constraint, in this order.
    """

    def __init__(self, pieces, ties, u0, v0):
        self.pieces, self.ties = pieces, ties
        self.u0, self.v0 = np.array(u0), np.array(v0)
        self.known = {}  # what `truth` returned, by its times: runs of several kinds share it
        n = len(u0)
        self.M, self.C, self.K = np.zeros((3, n, n))
        for q in pieces:
            at = np.ix_(q.dofs, q.dofs)
            self.M[at] += q.M
            self.C[at] += q.C
            self.K[at] += q.K

    def force(self, t):
        F = np.zeros(len(self.u0))
        for q in self.pieces:
            F[q.dofs] += q.load(t)
        return F

    def truth(self, t):
        """u, v, w (k, n) and the forces in the ties (k, p)."""
        u, v, w = motion(self.M, self.C, self.K, self.force, self.u0, self.v0, t)
        return u, v, w, self.tie_forces(t, u, v, w)

    def tie_forces(self, t, u, v, w):
        """Lam from (1), M_i w + C_i v + K_i u - F_i = L_i^T Lam, for all subdomains together."""
        L = self.constraints()
        left = [
            w[:, q.dofs] @ q.M + v[:, q.dofs] @ q.C + u[:, q.dofs] @ q.K
            - np.array([q.load(ti) for ti in t])
            for q in self.pieces
        ]  # fmt: skip
        return np.linalg.lstsq(np.hstack(L).T, np.hstack(left).T, rcond=None)[0].T

    def constraints(self):
        L = [np.zeros((len(self.ties), len(q.dofs))) for q in self.pieces]
        for row, (i, a, j, b) in enumerate(self.ties):
            L[i][row, a], L[j][row, b] = 1.0, -1.0
        return L

    def run(self, t_end, count, schemes, substeps, double=None, **options):
        parts = [
            pm.Subdomain(q.M, q.K, C=q.C, scheme=s, substeps=ss, force=q.force,
                         double_step=d, u0=self.u0[q.dofs], v0=self.v0[q.dofs])
            for q, s, ss, d in zip(
                self.pieces, schemes, substeps, double or [None] * len(substeps)
            )
        ]  # fmt: skip
        ties = [pm.tie(parts[i], [a], parts[j], [b]) for i, a, j, b in self.ties]
        return pm.Coupler(parts, ties, dt=t_end / count, **{"coupling": "pm", **options}).run(t_end)

    def errors(self, t_end, counts, substeps, sample=40, **options):
        """Largest errors of u, v, a, Lam in the second half of the run; a row for each count.

        At `sample` macro time levels, even and odd ones in turn, so that the largest includes the
        zig-zag of the double step. In the second half the transient of the start is over.
        """
        rows = [self._errors(t_end, n, substeps, sample, **options) for n in counts]
        return np.array(rows)

    def _errors(self, t_end, count, substeps, sample, **options):
        chosen = np.arange(sample + 1, 2 * sample + 1)
        levels = chosen * (count // (2 * sample)) - chosen % 2
        times = 0.0, *levels * t_end / count
        if times not in self.known:
            self.known[times] = self.truth(np.array(times))
        *motions, Lam = (x[1:] for x in self.known[times])
        got = self.run(t_end, count, substeps=substeps, **options)
        row = []
        for name, x in zip("uva", motions):
            ours = [getattr(g, name)[levels * ss] for g, ss in zip(got.subdomains, substeps)]
            row.append(max(np.abs(y - x[:, q.dofs]).max() for y, q in zip(ours, self.pieces)))
        return [*row, np.abs(got.multipliers[levels * max(substeps)] - Lam).max()]


@functools.cache
def cut_oscillator():
    """Period 1, mass cut ten to one and spring one to ten, damped and pushed on both sides."""
    one = np.ones((1, 1))
    m, k = 1 / 11, (2 * np.pi) ** 2 / 11
    a = Piece(10 * m * one, 0.3 * one, k * one, [0], lambda t: np.array([8.0 * np.sin(4.0 * t)]))
    b = Piece(m * one, 0.2 * one, 10 * k * one, [0], lambda t: np.array([5.0 * np.cos(3.0 * t)]))
    return Structure([a, b], [(0, 0, 1, 0)], [1.0], [0.3])


ALL_KINDS = [
    (SECOND, FAST),
    (pm.Newmark(), pm.CentralDifference()),
    (pm.HHT(0.1), pm.WBZ(0.2)),
]


@pytest.mark.parametrize(
    ("schemes", "coupling"), [*in_turn(ALL_KINDS, "pm", "gc"), (ALL_KINDS[0], "gc")]
)
def test_two_subdomains_with_equal_steps_have_order_two(coupling, schemes):
    errors = cut_oscillator().errors(1.0, [320, 640], (1, 1), schemes=schemes, coupling=coupling)
    # in u, v, a and the multiplier; dt omega = 0.02: the next term
    assert orders(errors) == pytest.approx(2.0, abs=0.05)


def test_a_scheme_of_order_one_in_one_subdomain_lowers_the_coupled_order():
    schemes = pm.Newmark(0.3025, 0.6), pm.CentralDifference()
    errors = cut_oscillator().errors(1.0, [320, 640], (1, 1), schemes=schemes, coupling="gc")
    assert orders(errors) == pytest.approx(1.0, abs=0.1)  # the dt^2 term: a few percent


@pytest.mark.parametrize(
    ("schemes", "ss", "coupling"),
    [
        (ALL_KINDS[0], 2, "pm"),
        (ALL_KINDS[0], 8, "gc"),
        (ALL_KINDS[1], 3, "gc"),
        (ALL_KINDS[2], 5, "pm"),
    ],
)
def test_two_subdomains_with_subcycling_have_order_one(coupling, ss, schemes):
    errors = cut_oscillator().errors(1.0, [640, 1280], (1, ss), schemes=schemes, coupling=coupling)
    # "pm" shows its order only below dt = 1/200; at 1/640 the dt^2 term of its double step is
    # still a twentieth of the dt term, which is 0.05 / 2 / ln 2 in the slope
    assert orders(errors) == pytest.approx(1.0, abs=0.06)


@functools.cache
def cross_point():
    """Three subdomains [hub, outer] of different mass and stiffness that share the hub."""
    pieces = []
    for i, (hub, outer, k) in enumerate([(0.4, 1.0, 30.0), (0.25, 0.7, 55.0), (0.35, 1.5, 80.0)]):
        M = np.diag([hub, outer])
        K = k * np.array([[1.0, -1.0], [-1.0, 1.0]]) + np.diag([0.0, 10.0 * (i + 1)])
        push = np.array([1.0, 3.0 - i])
        force = lambda t, push=push, i=i: push * np.sin((2.0 + i) * t)  # noqa: E731
        pieces.append(Piece(M, 0.02 * M + 0.01 * K, K, [0, i + 1], force))
    ties = [(0, 0, 1, 0), (1, 0, 2, 0)]
    return Structure(pieces, ties, [0.2, 1.0, -0.5, 0.3], [0.1, -0.2, 0.4, 0.0])


THREE = SECOND, FAST, pm.HHT(0.15)


@pytest.mark.parametrize("coupling", ["pm", "gc"])
def test_three_subdomains_at_a_cross_point_have_order_two_with_equal_steps(coupling):
    errors = cross_point().errors(1.0, [400, 800], (1, 1, 1), schemes=THREE, coupling=coupling)
    assert orders(errors) == pytest.approx(2.0, abs=0.05)  # dt omega = 0.03: the next term


@pytest.mark.gate
@pytest.mark.parametrize(
    ("coupling", "substeps", "double"),
    [
        ("gc", (1, 4, 2), None),
        ("pm", (1, 4, 2), None),  # both implicit subdomains take double steps
        ("pm", (4, 4, 1), (True, False, True)),  # at the finest step too, beside single ones
    ],
)
def test_three_subdomains_at_a_cross_point_have_order_one_with_subcycling(
    coupling, substeps, double
):
    options = {"schemes": THREE, "coupling": coupling, "double": double}
    errors = cross_point().errors(1.0, [160, 640, 1280], substeps, sample=20, **options)
    # at least order 1 in everything: a factor 4, less a tenth for terms of opposite sign
    assert (errors[1] < errors[0] / 4 * 1.1).all()
    # and no more in a, which contains the error of the multipliers: the dt^2 term is up to a
    # fifth of the dt term, 0.2 / 2 / ln 2 in the slope
    assert orders(errors[1:])[0, 2] == pytest.approx(1.0, abs=0.15)


# ---- the start ------------------------------------------------------------------------------


def start_errors(start, ss, count):
    """Errors of a of the subcycled side at the fine instants of the second macro step."""
    whole = cut_oscillator()
    got = whole.run(2.0 / count, 2, (SECOND, FAST), (1, ss), start=start)
    t = got[1].t
    return (got[1].a - whole.truth(t)[2])[ss + 1 :, 0]


@pytest.mark.parametrize("ss", [2, 20])
def test_after_the_plain_start_the_acceleration_error_does_not_shrink(ss):
    whole = cut_oscillator()
    a, b = (q.M[0, 0] for q in whole.pieces)
    Lam = whole.truth(np.array([0.0, 1e-4]))[3][0, 0]
    # vf_1 misses (al2(2h) - al2(h)) Lam / mA, half of al2(2h) Lam / mA. It enters (18) with weight
    # 1 - 1/ss, so for dt -> 0 Lam misses -(1 - 1/ss) (Lam / mA) / (2 / mA + 1 / (ss mB)), and a of
    # B misses minus that over mB
    expected = (1 - 1 / ss) * (Lam / a) / (2 / a + 1 / (ss * b)) / b
    plain, rebased = (start_errors(start, ss, 10_000)[0] for start in ("plain", "rebased"))
    assert plain == pytest.approx(expected, rel=5e-3)  # O(dt): 1e-4 omega times a few
    assert abs(rebased) < 1e-2 * abs(expected)


@pytest.mark.parametrize("ss", [2, 5])
def test_the_plain_start_leaves_the_order_of_the_run_as_it_is(ss):
    options = {"schemes": (SECOND, FAST), "start": "plain"}
    errors = cut_oscillator().errors(1.0, [640, 1280], (1, ss), **options)
    # the misfit of the start acts for one macro step: O(dt) in u, v, and damped in a and Lam
    assert orders(errors) == pytest.approx(1.0, abs=0.1)  # the dt^2 term: a twentieth, as above
