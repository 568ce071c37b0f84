"""Iterated subdomains that constraints hold at zero: their forces cancel, what is left is rounding.

Random problems in which general constraints hold the first subdomain and some dofs of the others,
and tie the rest: masses and stiffnesses over four decades, loads, every kind of substeps. Their
numbers are rounded and their forces summed without BLAS: the same problems on every processor.
"""

from dataclasses import replace

import newton_step
import numpy as np
import pytest
from newton_coupled import coupler
from newton_reference import Newton, Nonlinear, run
from pairwise import in_turn
from reference import alpha

import pmalpha as pm

# random steps, long for some periods
pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

DT, STEPS = 0.1, 8
couplings = pytest.mark.parametrize("coupling", ["gc", "pm"])


def rounded(A):
    """To half of the digits, so that what is left has no rounding of the products it came from."""
    return A.astype(np.float32).astype(float)


def matrix(rng, n, size):
    """Symmetric positive definite, with eigenvalues around `size`."""
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A = size * (Q * 10.0 ** rng.uniform(-1.0, 1.0, n)) @ Q.T
    return rounded(0.5 * (A + A.T))


def law(K, k3):
    def evaluate(t, u, v, q):
        return np.sum(K * u, axis=1) + k3 * u**3, K + np.diag(3.0 * k3 * u**2), np.zeros_like(K), q

    return evaluate


def subdomain(rng, substeps, iterated):
    n, size = rng.integers(1, 4), 10.0 ** rng.uniform(-2.0, 2.0)
    K = matrix(rng, n, size * 10.0 ** rng.uniform(-1.0, 2.0))
    F, omega = size * rng.normal(size=n), rng.uniform(0.0, 4.0, n) * (rng.random(n) < 0.7)
    return Nonlinear(
        M=matrix(rng, n, size),
        K=K,
        internal=law(0.5 * K, size * 10.0 ** rng.uniform(-1.0, 2.0)) if iterated else None,
        substeps=int(substeps),
        force=lambda t: F * np.cos(omega * t),
        **alpha(0.5),
    )


def held(seed, coupling):
    """Subdomains and constraint matrices; the first subdomain is held at zero."""
    rng = np.random.default_rng(seed)
    ss = [(1, 1, 1), (1, 5, 5), (5, 1, 1), (2, 6, 1), (3, 3, 1)][rng.integers(5)]
    count = rng.integers(2, 4)
    subdomains = [subdomain(rng, ss[i], i == 0 or rng.random() < 0.5) for i in range(count)]
    doubled = coupling == "pm" and ss[0] == min(ss[:count])
    subdomains[0] = replace(subdomains[0], double=doubled)
    sizes = [len(s.M) for s in subdomains]
    first, total = sizes[0], sum(sizes)
    others = rng.permutation(np.arange(first, total))
    k = rng.integers(0, len(others))
    zero, moving = np.append(np.arange(first), others[:k]), others[k:]
    L = np.zeros((len(zero) + len(moving) // 2, total))
    L[: len(zero), zero] = rng.normal(size=(len(zero), len(zero)))
    L[len(zero) :, moving] = rng.normal(size=(len(moving) // 2, len(moving)))
    L = rng.normal(size=(len(L), len(L))) @ L  # every row has to do with all dofs
    return subdomains, np.split(rounded(L), np.cumsum(sizes)[:-1], axis=1)


def iterated_often(subdomains, L, steps, monkeypatch):
    """The Result of the reference after 12 corrections of every step, none of them tested."""
    monkeypatch.setattr(newton_step.Iteration, "accepts", lambda self, good: False)
    monkeypatch.setattr(newton_step.Iteration, "rounding", lambda self: True)
    return run(subdomains, L, DT, steps, Newton(iterations=12))


# ---- it converges -----------------------------------------------------------------------------


@couplings
def test_a_spring_that_two_constraints_hold_under_load_is_at_rest(coupling):
    alpha = pm.GeneralizedAlpha(0.5)
    spring = pm.CubicSpring([0], 1.0, 2.0)
    a = pm.Subdomain([1.5], [1.0], scheme=alpha, internal=spring, force=[1.0], substeps=5)
    b = pm.Subdomain(
        [1.0, 2.0],
        [[2.0, -1.0], [-1.0, 3.0]],
        scheme=alpha,
        force=lambda t: [np.cos(t), np.cos(3.0 * t)],
    )
    hold = pm.Constraint({a: [[1.0], [0.3]], b: [[-1.0, 0.0], [-0.9, 0.0]]})  # det = 0.6
    history = pm.Coupler([a, b], hold, dt=DT, coupling=coupling).run(20.0)
    # some rounding of forces of order one, in the displacements h^2 of it for each step
    assert abs(history[0].u).max() < 1e-14 and abs(history[1].u[:, 0]).max() < 1e-14
    assert history[0].iterations.max() < 10
    # 1 + Lam_0 + 0.3 Lam_1 = 0 in the spring at rest: H magnifies rounding by its condition number
    Lam = history.multipliers
    np.testing.assert_allclose(Lam[:, 0] + 0.3 * Lam[:, 1], -1.0, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("seed", "coupling"), in_turn(range(6), "gc", "pm"))
def test_what_is_held_at_zero_stays_there(seed, coupling, monkeypatch):
    subdomains, L = held(seed, coupling)
    tangent = ("full", "reuse")[seed % 2]
    c = coupler(subdomains, L, DT, coupling, newton=pm.Newton(tol=1e-10, tangent=tangent))
    ours = c.run(steps=4)
    theirs = iterated_often(subdomains, L, 4, monkeypatch)
    size = max(abs(x.u).max() for x in theirs.subdomains)
    assert abs(ours[0].u).max() <= 1e-10 * max(size, abs(c.multipliers).max())
    for x, y in zip(ours, theirs.subdomains, strict=True):
        # the tolerance of the energy, with the root of condition numbers up to 1e4
        np.testing.assert_allclose(x.u, y.u, rtol=0.0, atol=1e-8 * size)


# ---- and nothing else is accepted -------------------------------------------------------------


def with_factor(internal, factor):
    """A tangent that is wrong by a factor."""

    def evaluate(t, u, v, q):
        f, K, C, q1 = internal(t, u, v, q)
        return f, factor * K, C, q1

    return evaluate


def with_jump(internal, part):
    """Dry friction, but of the displacement: a jump at zero, where the subdomain is held."""

    def evaluate(t, u, v, q):
        f, K, C, q1 = internal(t, u, v, q)
        return f + part * np.diag(K) * np.sign(u), K, C, q1

    return evaluate


def with_fault(subdomains, seed):
    """All tangents wrong by a factor, or all forces with a jump; and its size, or zero."""
    rng = np.random.default_rng([seed, 1])
    jump = 10.0 ** rng.uniform(-3.0, 0.0) if seed % 2 else 0.0
    factor = 10.0 ** rng.uniform(-1.0, 1.0)
    changed = (lambda f: with_jump(f, jump)) if jump else (lambda f: with_factor(f, factor))
    return [replace(s, internal=changed(s.internal)) if s.internal else s for s in subdomains], jump


def imbalance(s, L, x, multipliers, jump):
    """The largest residual of (N2) at all time levels, each row relative to its terms.

    Where u is zero up to rounding, a force that jumps there has any value in between.
    """
    worst, zero = 0.0, 1e-10 * abs(x.u).max() + 1e-13
    for k in range(1, len(x.t)):
        f, K, _, _ = s.internal(x.t[k], x.u[k], x.v[k], x.q)
        terms = [s.M @ x.a[k], s.K @ x.u[k], f, -s.force(x.t[k])]
        pull = L.T * multipliers[k * ((len(multipliers) - 1) // (len(x.t) - 1))]
        size = sum(abs(y) for y in terms) + abs(pull).sum(axis=1)
        R = sum(terms) - pull.sum(axis=1)
        between = np.where(abs(x.u[k]) < zero, jump * np.diag(K), 0.0)
        R -= between * np.sign(x.u[k])
        worst = max(worst, (np.maximum(abs(R) - between, 0.0) / size).max())
    return worst


@pytest.mark.parametrize(
    ("seed", "coupling"),
    [
        *in_turn(range(12), "gc", "pm"),
        *(pytest.param(*x, marks=pytest.mark.campaign) for x in in_turn(range(24), "pm", "gc")),
        *(pytest.param(*x, marks=pytest.mark.campaign) for x in in_turn(range(12, 24), "gc", "pm")),
    ],
)
def test_wrong_tangents_and_jumps_are_refused_or_end_in_equilibrium(seed, coupling):
    subdomains, L = held(seed, coupling)
    subdomains, jump = with_fault(subdomains, seed)
    tangent = ("full", "reuse")[seed % 3 > 0]
    c = coupler(subdomains, L, DT, coupling, newton=pm.Newton(tangent=tangent))
    try:
        history = c.run(steps=STEPS)
    except (pm.ConvergenceError, pm.FactorizationError):
        return
    for s, Li, x in zip(subdomains, L, history, strict=True):
        if s.internal:
            # tol = 1e-8 of the motion, and forces that the motion magnifies
            assert imbalance(s, Li, x, history.multipliers, jump) < 1e-4


@couplings
def test_a_slow_subdomain_beside_one_that_converges_at_once_ends_in_equilibrium(coupling):
    # the tangents are 5 times the right ones: what is held converges at once, the other by 0.8
    subdomains, jump = with_fault(held(336, coupling)[0], 336)
    L = held(336, coupling)[1]
    history = coupler(subdomains, L, DT, coupling).run(steps=STEPS)
    # ten times the tolerance; 2.3e-7 with one rate of convergence for both
    assert imbalance(subdomains[2], L[2], history[2], history.multipliers, jump) < 1e-7


@couplings
@pytest.mark.parametrize("seed", [420, 916])
def test_a_row_whose_forces_are_small_is_in_balance_with_these(seed, coupling):
    # tangents wrong by a factor, so that corrections are small long before the residual is
    subdomains, L = held(seed, coupling)
    subdomains, jump = with_fault(subdomains, seed)
    newton = pm.Newton(tangent=("full", "reuse")[seed % 3 > 0])
    history = coupler(subdomains, L, DT, coupling, newton=newton).run(steps=STEPS)
    for s, Li, x in zip(subdomains, L, history, strict=True):
        if s.internal:
            # ten times the tolerance; 82 and 17 times where a tenth of the largest force counted
            assert imbalance(s, Li, x, history.multipliers, jump) < 1e-7


@couplings
@pytest.mark.parametrize("seed", [141, 213, 219, 387, 495])
def test_a_residual_that_jumps_in_the_last_correction_is_seen(seed, coupling):
    # up to 1e7 tolerances where it was taken from the rate of convergence
    subdomains, L = held(seed, coupling)
    subdomains, jump = with_fault(subdomains, seed)
    newton = pm.Newton(tangent=("full", "reuse")[seed % 3 > 0])
    c = coupler(subdomains, L, DT, coupling, newton=newton)
    try:
        history = c.run(steps=STEPS)
    except pm.ConvergenceError:
        return
    for s, Li, x in zip(subdomains, L, history, strict=True):
        if s.internal:
            # ten times the tolerance
            assert imbalance(s, Li, x, history.multipliers, jump) < 1e-7


def with_last_digits(internal, part):
    """A force that leaps with the last eight bits of a displacement."""

    def evaluate(t, u, v, q):
        f, K, C, q1 = internal(t, u, v, q)
        bits = np.ascontiguousarray(u).view(np.int64) & 255
        return f + part * np.diag(K) * bits / 255.0, K, C, q1

    return evaluate


@couplings
@pytest.mark.parametrize("seed", [0, 1, 2, 6, 7, 9])
def test_a_force_that_leaps_within_rounding_ends_in_equilibrium_where_constraints_hold_it(
    seed, coupling
):
    # Each correction, were it made, would be followed by another force: no run converged; 9 not
    # where the residual that stays, of a correction that is not made, was to be balanced too.
    subdomains, L = held(seed, coupling)
    leaping = with_last_digits(subdomains[0].internal, 0.01)
    subdomains[0] = replace(subdomains[0], internal=leaping)
    tangent = ("full", "reuse")[seed % 2]
    c = coupler(subdomains, L, DT, coupling, newton=pm.Newton(tangent=tangent))
    history = c.run(steps=STEPS)
    # of 40, after which it is refused
    assert history[0].iterations.max() < 20
    # ten times the tolerance
    assert imbalance(subdomains[0], L[0], history[0], history.multipliers, 0.0) < 1e-7
    theirs = run(subdomains, L, DT, STEPS, Newton())
    assert max(x.iterations.max() for x in theirs.subdomains) < 20


def test_the_forces_of_a_first_guess_far_away_are_no_scale_of_the_residual():
    # the guess h v_n is up to 1.5 from where a spring 1000 u^3 has stopped the mass before
    def internal(t, u, v, q):
        return 1e3 * u**3, 2.0 * 3e3 * u**2  # the tangent is twice the right one

    s = pm.Subdomain([1.0], None, scheme=pm.GeneralizedAlpha(0.5), internal=internal, v0=[3.0])
    mass = pm.Coupler([s], dt=0.5).run(steps=20)[0]
    inertia, spring = mass.a[:, 0], 1e3 * mass.u[:, 0] ** 3
    residual = abs(inertia + spring)[1:]
    forces = np.maximum(abs(inertia) + abs(spring), np.roll(abs(inertia), 1))[1:]
    # the tolerance and rounding; 15 tolerances where the forces of the guess counted
    assert (residual <= 1.01e-8 * forces).all()
    assert residual.max() > 1e-12  # the wrong tangent leaves something to be judged


def test_a_force_without_equilibrium_is_refused():
    def leap(t, u, v, q):  # of the velocity, which no constraint holds
        return np.where(v > 0.0, 1.0, -2.0), np.eye(1), np.eye(1), q

    one = np.eye(1)
    free = Nonlinear(M=1e-3 * one, K=0 * one, internal=leap, force=lambda t: [0.5], **alpha(0.5))
    fixed = replace(held(0, "gc")[0][0])
    with pytest.raises(pm.ConvergenceError, match="'1'"):
        n = len(fixed.M)
        coupler([fixed, free], [np.eye(n), np.zeros((n, 1))], DT, "gc").run(steps=STEPS)


# ---- a prestress that cancels within the force --------------------------------------------------


class PrestressedString:
    """A string along (0.6, 0.8) between points that are no dofs, so that only rounding is seen."""

    def __init__(self, T, EA, n=6):
        self.T, self.EA, self.n = T, EA, n
        self.X = np.outer(np.linspace(0.0, 1.0, n) ** 1.3, [0.6, 0.8])
        self.rest = np.linalg.norm(np.diff(self.X, axis=0), axis=1)

    def __call__(self, t, u, v, q):
        x = self.X.copy()
        x[1:-1] += u.reshape(-1, 2)
        F, K = np.zeros(2 * self.n), np.zeros((2 * self.n, 2 * self.n))
        for i, d in enumerate(np.diff(x, axis=0)):
            length = np.linalg.norm(d)
            c, N = d / length, self.T + self.EA * (length / self.rest[i] - 1.0)
            k = self.EA / self.rest[i] * np.outer(c, c)
            k = k + N / length * (np.eye(2) - np.outer(c, c))
            ends = slice(2 * i, 2 * i + 4)
            F[ends] += np.concatenate([-N * c, N * c])
            K[ends, ends] += np.block([[k, -k], [-k, k]])
        return F[2:-2], K[2:-2, 2:-2]


@pytest.mark.parametrize("T, EA", [(1.0, 1e2), (3e4, 1e7)])
def test_a_string_under_prestress_stays_at_rest_and_is_in_balance_when_it_is_pulled(T, EA):
    string = PrestressedString(T, EA)
    pull = 1e-3 * T * np.ones(8)

    def force(t):
        return pull if t > 5.5 * DT else 0.0 * pull

    s = pm.Subdomain(
        np.full(8, T), None, scheme=pm.GeneralizedAlpha(0.5), internal=string, force=force, name="s"
    )
    c = pm.Coupler([s], dt=DT)
    rest = c.run(steps=5)["s"]
    assert abs(rest.u).max() < 1e-14
    assert rest.iterations[1] == 40  # nothing says how large rounding is
    assert rest.iterations[2:].max() < 15  # it is known now, but for what it fluctuates by
    moved = c.run(steps=4)["s"]
    for u, v, a, t in zip(moved.u[1:], moved.v[1:], moved.a[1:], moved.t[1:], strict=True):
        f = string(t, u, v, None)[0]
        size = abs(force(t)) + abs(f) + abs(T * a)
        assert abs(force(t) - f - T * a).max() < 1e-7 * size.max()  # ten times the tolerance


@pytest.mark.parametrize("T, EA, mass, n", [(2e3, 20.0, 20.0, 8), (4e3, 10.0, 10.0, 11)])
def test_a_heavy_string_at_rest_is_at_rest(T, EA, mass, n):
    # much of the tangent is that of the mass, whose forces do not round as those of the string do
    string = PrestressedString(T, EA, n)
    masses = np.full(2 * n - 4, mass)
    s = pm.Subdomain(masses, None, scheme=pm.GeneralizedAlpha(0.5), internal=string)
    history = pm.Coupler([s], dt=DT).run(steps=STEPS)[0]
    # forces of order T, exact to some units in the last place, on stiffnesses of order n T
    assert abs(history.u).max() < 1e-13
