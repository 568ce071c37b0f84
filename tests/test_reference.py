"""The reference compared with independent results: closed forms, expm, residuals of raw data.

What the package is tested for, which is compared with the reference, is not repeated: orders of
coupled runs, limits of stability, equilibrium at time levels, instants.

`order` below is the slope of log(error) over log(dt). An error c1 dt^q + c2 dt^(q+1) has a slope
that differs from q by about dt c2/c1, so each slope is measured at steps small enough that the
tolerance beside it covers the second term, and large enough that rounding has no effect.
"""

from dataclasses import replace

import numpy as np
import pytest
from reference import Subdomain, alpha, exact, initial_accelerations, run

ONE = np.ones((1, 1))
FREE = [np.zeros((0, 1))]  # no constraints on a subdomain of one dof


def orders(errors):
    """Observed orders between successive rows, each of half the step of the one before."""
    errors = np.asarray(errors)
    return np.log2(errors[:-1] / errors[1:])


# ---- the exact solution ---------------------------------------------------------------------


def test_exact_is_the_damped_cosine_of_one_dof():
    m, c, k = 2.0, 0.6, 50.0
    d, om = c / (2 * m), np.sqrt(k / m - (c / (2 * m)) ** 2)
    t = np.linspace(0.0, 3.0, 7)
    u, v, w = exact(m * ONE, c * ONE, k * ONE, [1.0], [-d], t)
    # u = exp(-d t) cos(om t) starts with u = 1, v = -d
    cos, sin = np.exp(-d * t) * np.cos(om * t), np.exp(-d * t) * np.sin(om * t)
    # expm squares about 8 times: eps 2^8 of the largest value, 25; c = 0.61 misses by 1e-2
    np.testing.assert_allclose(u[:, 0], cos, rtol=0, atol=1e-11)
    np.testing.assert_allclose(v[:, 0], -d * cos - om * sin, rtol=0, atol=1e-11)
    np.testing.assert_allclose(w[:, 0], (d**2 - om**2) * cos + 2 * d * om * sin, rtol=0, atol=1e-11)
    assert exact(m * ONE, None, k * ONE, [1.0], None, 0.5)[0].shape == (1,)


# ---- one scheme alone -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rho", "am", "af", "beta", "gamma"),
    [
        (1.0, 0.5, 0.5, 0.25, 0.5),  # no damping
        (0.5, 0.0, 1 / 3, 4 / 9, 5 / 6),
        (0.0, -1.0, 0.0, 1.0, 1.5),  # all damping
    ],
)
def test_rho_gives_the_parameters_of_chung_and_hulbert(rho, am, af, beta, gamma):
    got = alpha(rho)
    # by hand from (P1); one rounding each
    assert [got[x] for x in ("am", "af", "beta", "gamma")] == pytest.approx(
        [am, af, beta, gamma], abs=1e-15
    )


def damped_chain(**scheme):
    """Three damped dofs between two walls."""
    K = 40.0 * (2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
    M = np.diag([1.0, 2.0, 1.5])
    start = {"u0": [1.0, 0.0, -0.5], "v0": [0.0, 2.0, 1.0]}
    return Subdomain(M, K, C=0.02 * M + 0.01 * K, **scheme, **start)


def uncoupled_errors(s, counts):
    """Errors of u, v, w at t = 1, one row for each number of steps."""
    truth = np.array(exact(s.M, s.C, s.K, s.u0, s.v0, 1.0))
    errors = []
    for count in counts:
        got = run([s], [np.zeros((0, len(s.M)))], 1.0 / count, count).subdomains[0]
        errors.append(np.abs([got.u[-1], got.v[-1], got.w[-1]] - truth).max(axis=1))
    return np.array(errors)


@pytest.mark.parametrize("explicit", [False, True])
@pytest.mark.parametrize("rho", [0.0, 0.5, 1.0])
def test_an_uncoupled_subdomain_has_order_two(rho, explicit):
    s = damped_chain(**alpha(rho, explicit))
    slopes = orders(uncoupled_errors(s, [80, 160]))
    assert slopes == pytest.approx(2.0, abs=0.1)  # dt omega = 0.15: the next term
    # gamma other than 1/2 - am + af costs one order; of the next term there is more
    off = replace(s, gamma=s.gamma + 0.1)
    assert orders(uncoupled_errors(off, [160, 320])) == pytest.approx(1.0, abs=0.2)


def three_step_residual(rho, h):
    """Left-hand side of the paper's three-step form (3) (4) on a computed sequence u."""
    m, c, k = 2.0, 0.4, 30.0
    scheme = alpha(rho)
    am, af, g, b = scheme["am"], scheme["af"], scheme["gamma"], scheme["beta"]
    s = Subdomain(m * ONE, k * ONE, C=c * ONE, **scheme, u0=[1.0], v0=[2.0])
    u = run([s], FREE, h, 40).subdomains[0].u[:, 0]
    al = [am, 1 - 3 * am, -2 + 3 * am, 1 - am]
    ga = [af * (g - 1), -1 + 2 * af + g - 3 * g * af, 1 - af - 2 * g + 3 * g * af, (1 - af) * g]
    de = [0.5 + b - g, 0.5 - 2 * b + g, b]
    inside = (1 - af) * u[1:] + af * u[:-1]  # u at i + 1 - af
    count = len(u) - 3
    inertia = sum((m * al[j] + h * c * ga[j]) * u[j : j + count] for j in range(4))
    return inertia + h**2 * k * sum(de[j] * inside[j : j + count] for j in range(3))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 1.0])
def test_implicit_displacements_satisfy_the_three_step_form_of_the_paper(rho):
    # sum of ten terms below 3 each, accumulated over 40 steps
    assert np.abs(three_step_residual(rho, 0.1)).max() < 1e-13


# ---- split oscillator -----------------------------------------------------------------------

OMEGA = 2 * np.pi
MIRROR = [ONE, -ONE]


def oscillator(ss=1, b1=10.0, rho=0.5, double=True):
    """m = 1, period 1, split in two: A implicit, B explicit; b1 = mA/mB = kB/kA."""
    m_b, k_a = 1 / (1 + b1), OMEGA**2 / (1 + b1)
    start = {"u0": [1.0], "v0": [0.3]}
    a = Subdomain((1 - m_b) * ONE, k_a * ONE, **alpha(rho), double=double, **start)
    stiff = (OMEGA**2 - k_a) * ONE
    return [a, Subdomain(m_b * ONE, stiff, **alpha(rho, explicit=True), substeps=ss, **start)]


@pytest.mark.gate
@pytest.mark.parametrize("ss", [1, 5])
def test_displacements_drift_by_a_bounded_amount_that_falls_with_the_square_of_the_step(ss):
    drift = np.abs(run(oscillator(ss=ss), MIRROR, 1 / 40, 200).displacement_jump[:, 0])
    # all roots are in the unit disc and 1 is simple: oscillations decay, the drift remains
    assert drift[100:].max() <= drift[:100].max()
    assert drift[0] == 0.0 < drift[100:].max()
    # each step adds O(dt^3) to the gap, 1/dt of them; dt omega = 0.08 is the next term
    fine = np.abs(run(oscillator(ss=ss), MIRROR, 1 / 80, 80).displacement_jump).max()
    assert orders([drift[:41].max(), fine]) == pytest.approx(2.0, abs=0.1)


# ---- the start ------------------------------------------------------------------------------


def test_the_first_multiplier_is_the_force_across_the_interface():
    subdomains = oscillator(b1=10.0)
    w, Lam = initial_accelerations(subdomains, MIRROR)
    # w = -omega^2 and Lam = mA w + kA = omega^2 (1 - b1) / (1 + b1); a few roundings of 40
    assert np.concatenate(w) == pytest.approx(-(OMEGA**2), rel=1e-14)
    assert Lam == pytest.approx(OMEGA**2 * (1 - 10) / (1 + 10), rel=1e-13)
    got = run(subdomains, MIRROR, 0.01, 1)
    np.testing.assert_array_equal(got.subdomains[0].a[0], got.subdomains[0].w[0])
    # (S2)  with al1 = h^2 8/27 and al2 = h 5/9 at rho = 1/2; a few roundings
    a, h = subdomains[0], 0.01
    vf = 0.3 - h * 5 / 9 * Lam[0] / (a.M[0, 0] + h**2 * 8 / 27 * a.K[0, 0])
    assert got.subdomains[0].vf[0] == pytest.approx(vf, rel=1e-13)


def test_with_equal_steps_the_two_starts_are_the_same():
    got = [run(oscillator(), MIRROR, 0.02, 30, start) for start in ("rebased", "plain")]
    # vf is interpolated between time levels only, and all fine instants are time levels
    np.testing.assert_array_equal(got[0].subdomains[1].u, got[1].subdomains[1].u)
    different = [run(oscillator(ss=2), MIRROR, 0.02, 30, start) for start in ("rebased", "plain")]
    assert np.abs(different[0].subdomains[1].u - different[1].subdomains[1].u).max() > 1e-4


def test_a_tiny_mass_is_not_treated_as_zero():
    subdomains = [Subdomain(1e-14 * ONE, ONE, u0=[1e-14]), Subdomain(1e6 * ONE, ONE, u0=[1.0])]
    w, _ = initial_accelerations(subdomains, [np.zeros((0, 1))] * 2)
    # w = -k u / m; two roundings
    assert np.concatenate(w) == pytest.approx([-1.0, -1e-6], rel=1e-14)


# ---- massless dofs --------------------------------------------------------------------------


def springs_in_series(m1, **options):
    """ground - 30 - m1 - 70 - mass 2, from rest, in static equilibrium inside."""
    K = np.array([[100.0, -70.0], [-70.0, 70.0]])
    return Subdomain(np.diag([m1, 2.0]), K, u0=[0.7, 1.0], **options)


def test_an_interior_massless_dof_is_static_condensation():
    whole = springs_in_series(0.0, **alpha(0.5))
    condensed = Subdomain(2.0 * ONE, 30 * 70 / 100 * ONE, u0=[1.0], **alpha(0.5))
    x = run([whole], [np.zeros((0, 2))], 0.1, 200).subdomains[0]
    y = run([condensed], FREE, 0.1, 200).subdomains[0]
    # its row of (7) is 100 u1 = 70 u2 at every time level; rounding of w = 10 over 200 steps
    np.testing.assert_allclose(x.u[:, 0], 0.7 * y.u[:, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(x.w[:, 1], y.w[:, 0], rtol=0, atol=1e-12)
    # nothing determines its w at t = 0, so it is zero, not the -7.35 of 0.7 u2; the effect
    # on v decays like n^2 rho^n, which is rounding after 60 steps
    assert x.w[0, 0] == 0.0
    assert abs(x.v[1, 0] - 0.7 * y.v[1, 0]) > 1e-2
    np.testing.assert_allclose(x.v[60:, 0], 0.7 * y.v[60:, 0], rtol=0, atol=1e-12)
    slow = run([springs_in_series(0.0, **alpha(0.9))], [np.zeros((0, 2))], 0.1, 60).subdomains[0]
    fast = run([replace(condensed, **alpha(0.9))], FREE, 0.1, 60).subdomains[0]
    assert abs(slow.v[60, 0] - 0.7 * fast.v[60, 0]) > 1e-6


def test_a_massless_dof_on_the_interface_has_the_acceleration_of_the_constraint():
    a = Subdomain(0.0 * ONE, 30.0 * ONE, u0=[1.0])
    b = springs_in_series(0.5)
    b.K = b.K - np.diag([30.0, 0.0])  # the spring to the ground is in A
    b.u0 = np.array([1.0, 2.0])
    w, Lam = initial_accelerations([a, b], [ONE, np.array([[-1.0, 0.0]])])
    # row of A: Lam = 30 * 1; row of B: w = (70 - 30) / 0.5; a few roundings
    assert Lam == pytest.approx([30.0], rel=1e-13)
    assert np.concatenate(w) == pytest.approx([80.0, 80.0, -35.0], rel=1e-13)


# ---- gc and pm ------------------------------------------------------------------------------


@pytest.mark.parametrize("ss", [1, 4])
def test_the_free_problem_of_a_double_step_does_not_need_the_last_multiplier(ss):
    n, dt = 6, 0.01

    def free_velocities(double, kick):
        subdomains = oscillator(ss=ss, double=double)
        subdomains[1].force = lambda t: np.array([kick if t == n * dt else 0.0])
        return run(subdomains, MIRROR, dt, 10).subdomains[0].vf[:, 0]

    # a kick of B at t_n changes Lam_n; under "pm" the free problem to t_{n+1} starts from t_{n-1}
    pm = free_velocities(True, 0.0) != free_velocities(True, 1.0)
    np.testing.assert_array_equal(pm, np.arange(11) >= n + 2)
    # under "gc" it starts from t_n
    gc = free_velocities(False, 0.0) != free_velocities(False, 1.0)
    np.testing.assert_array_equal(gc, np.arange(11) >= n + 1)


def test_gc_and_pm_take_the_same_first_macro_step():
    gc, pm = (run(oscillator(ss=4, double=double), MIRROR, 0.05, 2) for double in (False, True))
    for x, y, ss in zip(gc.subdomains, pm.subdomains, (1, 4), strict=True):
        np.testing.assert_array_equal(x.w[: ss + 1], y.w[: ss + 1])
        assert np.abs(x.w[ss + 1 :] - y.w[ss + 1 :]).max() > 1e-3


# ---- errors ---------------------------------------------------------------------------------


def test_a_schedule_that_the_method_does_not_define_is_refused():
    a, b = oscillator(ss=3)
    with pytest.raises(ValueError, match="divide"):
        run([replace(a, substeps=2), b], MIRROR, 0.1, 1)
    with pytest.raises(ValueError, match="double"):
        run([a, replace(b, double=True)], MIRROR, 0.1, 1)
    with pytest.raises(ValueError, match="start"):
        run([a, b], MIRROR, 0.1, 1, start="rebase")
    with pytest.raises(ValueError, match="L must"):
        run([a, b], [ONE, np.ones((1, 2))], 0.1, 1)
