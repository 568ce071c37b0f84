"""Two discs on a turning shaft, cut in two: order, stability and energy with unsymmetric matrices.

Section 9 (F10), (B7) and (C3) of docs/method.md, EXTENSIONS: order against `expm`, spectral radii
against the exact growth, limits of explicit subdomains against one oscillator.
"""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import pairwise
from scipy.linalg import eigvals, expm

import pmalpha as pm
from pmalpha import analysis

# Skew damping under "mean" too, by the square of its size: slowly in these runs.
pytestmark = pytest.mark.filterwarnings("ignore:.*grows with damping:pmalpha.StabilityWarning")

J = np.array([[0.0, 1.0], [-1.0, 0.0]])


def shaft(g, circulatory=0.0, *, rho=0.5, explicit=False, substeps=1, double=None, **options):
    """Two discs that move in two directions, y and z each, on a shaft with bearings at both ends;
    the shaft is cut at its middle. A gyroscopic coefficient g per unit of mass; the circulatory one
    is that of a seal at the second disc."""
    spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K_a = np.kron(40.0 * spring + np.diag([30.0, 0.0]), np.eye(2))
    K_b = np.kron(40.0 * spring + np.diag([0.0, 25.0]), np.eye(2))
    K_b[2:, 2:] += circulatory * J
    M_a, M_b = np.kron(np.diag([2.0, 0.5]), np.eye(2)), np.kron(np.diag([0.5, 1.5]), np.eye(2))
    start = dict(scheme=pm.GeneralizedAlpha(rho), symmetric=False)
    a = pm.Subdomain(
        M_a,
        K_a,
        C=g * np.kron(np.diag([2.0, 0.0]), J),
        double_step=double,
        v0=[1.0, 0.5, 0.0, 0.0],
        name="a",
        **start,
    )
    start["scheme"] = pm.GeneralizedAlpha(rho, explicit=explicit)
    b = pm.Subdomain(
        M_b,
        K_b,
        C=g * np.kron(np.diag([0.0, 1.5]), J),
        substeps=substeps,
        v0=[0.0, 0.0, -0.5, 1.0],
        name="b",
        **start,
    )
    return lambda dt, coupling: pm.Coupler(
        [a, b], pm.tie(a, [2, 3], b, [0, 1]), dt=dt, coupling=coupling, **options
    )


def uncut(coupler):
    """The matrix of x' = A x of the uncut structure, x = (u, v)."""
    M, C, K, _ = coupler.assembled()
    n = M.shape[0]
    inverse = np.linalg.inv(M.toarray())
    return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]])


# ---- order ---------------------------------------------------------------------------------------


def velocity_errors(make, coupling, counts):
    """Largest errors of the velocities at t = 2, relative to the largest velocity."""
    errors = []
    for count in counts:
        coupler = make(2.0 / count, coupling)
        state, _ = analysis.exact_solution(coupler)(2.0)
        coupler.step(count)
        sizes = [np.max(np.abs(v)) for _, v, _ in state.values()]
        wrong = [np.max(np.abs(coupler.state(x).v - v)) for x, (_, v, _) in state.items()]
        errors.append(max(wrong) / max(sizes))
    return np.array(errors)


# coupling, substeps, double step of A, expected order
ORDERS = {
    "gc": ("gc", 1, None, 2.0),
    "macro": ("macro", 1, None, 2.0),
    "macro, substeps": ("macro", 4, None, 2.0),
    "macro, double step": ("macro", 1, True, 2.0),
    "pm": ("pm", 1, True, 2.0),
    "mean": ("mean", 1, None, 2.0),
    "mean, substeps": ("mean", 4, None, 2.0),
    "gc, substeps": ("gc", 4, None, 1.0),
}


@pytest.mark.parametrize(
    ("schedule", "forces", "explicit"),
    pairwise(list(ORDERS), [(3.0, 0.0), (10.0, 0.0), (3.0, 20.0)], [False, True]),
)
def test_orders_are_those_of_symmetric_subdomains(schedule, forces, explicit):
    """Order 2 within 0.03: what the next term of the error leaves at these steps. The first-order
    error of "gc" with substeps is small beside the other for g = 10 (1.28 here, 0.98 next)."""
    coupling, substeps, double, expected = ORDERS[schedule]
    make = shaft(*forces, explicit=explicit, substeps=substeps, double=double)
    steps = 320 if expected == 2.0 and not double else 640
    error = velocity_errors(make, coupling, [steps, 2 * steps])
    assert abs(np.log2(error[0] / error[1]) - expected) < (0.03 if expected == 2.0 else 0.3)


def test_a_transposed_gyroscopic_matrix_is_another_problem():
    """Otherwise the test above would not see R and Q exchanged."""
    one, other = (shaft(g)(0.05, "gc") for g in (3.0, -3.0))
    x, y = (analysis.exact_solution(c)(2.0)[0]["a"][1] for c in (one, other))
    assert np.max(np.abs(x - y)) > 0.5


# ---- stability -----------------------------------------------------------------------------------


def growth(coupler, dt):
    """Of the exact motion in a macro step: at least 1, rigid motion or not."""
    return max(1.0, float(np.max(np.abs(eigvals(expm(uncut(coupler) * dt))))))


def radius(coupler):
    return analysis.spectral_radius(analysis.amplification_matrix(coupler))


SCHEMES = {
    "rho 0.5": pm.GeneralizedAlpha(0.5),
    "rho 0.9": pm.GeneralizedAlpha(0.9),
    "trapezoidal": pm.Newmark(),
}


@pytest.mark.parametrize(
    ("coupling", "scheme", "substeps"), pairwise(["gc", "pm", "macro"], list(SCHEMES), [1, 5])
)
def test_no_gyroscopic_step_of_any_length_is_unstable(coupling, scheme, substeps):
    """1e-9: the rounding of defective eigenvalues of modulus one, which drift has."""
    for g in (3.0, 300.0):
        make = shaft(g, substeps=substeps, double=coupling == "pm" or None)
        for dt in np.geomspace(0.002, 10.0, 3):
            a, b = (
                pm.Subdomain(
                    s.M,
                    s.K,
                    C=s.C,
                    scheme=SCHEMES[scheme],
                    substeps=s.substeps,
                    double_step=s.double_step,
                    symmetric=False,
                )
                for s in make(dt, coupling).subdomains
            )
            with warnings.catch_warnings():  # of resonance with a macro step this long
                warnings.simplefilter("ignore", pm.StabilityWarning)
                coupler = pm.Coupler([a, b], pm.tie(a, [2, 3], b, [0, 1]), dt=dt, coupling=coupling)
            assert radius(coupler) <= 1.0 + 1e-9, (g, dt)


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_circulatory_forces_grow_no_faster_than_the_exact_motion(coupling):
    seen = 1.0
    for g in (3.0, 30.0):
        for dt in np.geomspace(0.002, 10.0, 5):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", pm.StabilityWarning)
                coupler = shaft(g, 20.0, double=coupling == "pm" or None)(dt, coupling)
            exact = growth(coupler, dt)
            assert radius(coupler) <= exact * (1.0 + 1e-9), (g, dt)
            seen = max(seen, exact)
    assert seen > 2.0  # the seal does feed energy in


# ---- explicit subdomains -------------------------------------------------------------------------

# limits of h omega for rho = 0, 0.5, 1 with C = g J in Mbar; 3 and more for "3" (measured before)
IMPLICIT_LIMITS = {0.0: (1.54, 1.86, 2.00), 0.2: (1.55, 1.87, 2.00), 1.0: (1.68, 2.03, 2.23)}
LAGGED_LIMITS = {0.2: 1.23, 1.0: 0.55, 3.0: 0.22}


def particle(g, rho, **options):
    return pm.Subdomain(
        [1.0, 1.0],
        np.eye(2),
        C=g * J,
        scheme=pm.GeneralizedAlpha(rho, explicit=True),
        symmetric=False,
        **options,
    )


def largest_stable_step(subdomain):
    """By bisection on the spectral radius of the step of the core."""
    low, high = 0.0, 4.0
    while high - low > 1e-4:
        h = 0.5 * (low + high)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            stable = radius(pm.Coupler([subdomain], dt=h)) <= 1.0 + 1e-7
        low, high = (h, high) if stable else (low, h)
    return low


@pytest.mark.gate
@pytest.mark.parametrize("g", IMPLICIT_LIMITS)
def test_a_gyroscopic_matrix_in_mbar_raises_the_explicit_limit(g):
    """0.01: the digits of the table. The critical step leaves C out, and is below it."""
    for rho, expected in zip((0.0, 0.5, 1.0), IMPLICIT_LIMITS[g]):
        found = largest_stable_step(particle(g, rho))
        assert abs(found - expected) < 0.012
        assert analysis.critical_step(particle(g, rho)) <= found + 1e-3


@pytest.mark.gate
@pytest.mark.parametrize("g", LAGGED_LIMITS)
def test_lagged_gyroscopic_damping_lowers_the_limit_of_rho_zero(g):
    s = particle(g, 0.0, damping="lagged")
    found = largest_stable_step(s)
    assert abs(found - LAGGED_LIMITS[g]) < 0.01
    # (C3) is sharp for one oscillator
    assert abs(analysis.critical_step(s) - found) < 1e-3


@pytest.mark.parametrize("n", [4, 300])
def test_the_lagged_limit_is_on_the_safe_side(n):
    """Of a random matrix; (C3) takes the largest stiffness, damping and skew part together."""
    rng = np.random.default_rng(n)
    A = sp.random_array((n, n), density=min(1.0, 4.0 / n), rng=rng)
    B = sp.random_array((n, n), density=min(1.0, 4.0 / n), rng=rng)
    scheme = pm.GeneralizedAlpha(0.0, explicit=True)
    s = pm.Subdomain(
        rng.uniform(1.0, 2.0, n),
        sp.csr_array(A @ A.T + sp.eye_array(n)),
        C=sp.csr_array(0.05 * A @ A.T + B - B.T),
        scheme=scheme,
        damping="lagged",
        symmetric=False,
    )
    h = analysis.critical_step(s)
    start = np.random.default_rng(1).normal(size=n)
    grown = []
    for step in (0.99 * h, 3.0 * h):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = pm.Coupler([s], dt=step)
        coupler.reset(v0={s.name or coupler.subdomains[0].name or "subdomain 0": start})
        try:
            coupler.step(2000)
            grown.append(np.max(np.abs(coupler.state(0).v)))
        except pm.InstabilityError:
            grown.append(np.inf)
    assert grown[0] < 10.0 and grown[1] > 1e6


@pytest.mark.parametrize(
    "scheme",
    [
        pm.GeneralizedAlpha(0.5, explicit=True),
        pm.GeneralizedAlpha(1.0, explicit=True),
        pm.CentralDifference(),
        pm.GeneralizedAlpha(0.0),
        pm.Newmark(),
    ],
)
def test_lagged_gyroscopic_damping_is_refused_elsewhere(scheme):
    with pytest.raises(ValueError, match="damping must be 'implicit' where C is not symmetric"):
        pm.Subdomain([1.0, 1.0], np.eye(2), C=J, scheme=scheme, damping="lagged", symmetric=False)
    # its symmetric part may be lagged
    pm.Subdomain([1.0, 1.0], np.eye(2), C=0.1 * np.eye(2), scheme=scheme, damping="lagged")


def test_lagged_gyroscopic_damping_is_admitted_by_the_numbers_of_the_scheme():
    """rho = 0 has alpha_m = -1, alpha_f = 0, beta = 1, gamma = 3/2, whatever the class."""
    scheme = pm.Scheme(-1.0, 0.0, 1.0, 1.5, explicit=True)
    assert pm.GeneralizedAlpha(0.0, explicit=True).coefficients(1.0) == scheme.coefficients(1.0)
    pm.Subdomain([1.0, 1.0], np.eye(2), C=J, scheme=scheme, damping="lagged", symmetric=False)
    other = pm.Scheme(-1.0, 0.0, 1.0, 1.5001, explicit=True)
    with pytest.raises(ValueError, match="damping must be 'implicit' where C is not symmetric"):
        pm.Subdomain([1.0, 1.0], np.eye(2), C=J, scheme=other, damping="lagged", symmetric=False)


def test_an_unsymmetric_stiffness_limits_the_step_by_its_largest_eigenvalue():
    """K = [[1, 5], [0, 4]] has the eigenvalues 1 and 4; its symmetric part 6 and -0.4."""
    K = np.array([[1.0, 5.0], [0.0, 4.0]])
    s = pm.Subdomain([1.0, 1.0], K, scheme=pm.CentralDifference(), symmetric=False)
    assert abs(analysis.critical_step(s) - 1.0) < 1e-12
    assert abs(largest_stable_step(s) - 1.0) < 1e-3
    with pytest.warns(pm.StabilityWarning, match="above its critical step 1:"):
        pm.Coupler([s], dt=1.1)
    n = 400  # sparse: convection along a chain; its eigenvalues are those of a symmetric matrix
    K = sp.diags_array(
        [np.full(n - 1, -1.02), np.full(n, 8.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1]
    )
    s = pm.Subdomain(np.ones(n), K, scheme=pm.CentralDifference(), symmetric=False)
    largest = 8.0 + 2.0 * np.sqrt(1.02) * np.cos(np.pi / (n + 1))
    step = analysis.critical_step(s)
    assert 0.99 * 2.0 / np.sqrt(largest) < step <= 2.0 / np.sqrt(largest) * (1.0 + 1e-4)


# ---- energy --------------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["gc", "macro", "mean"])
def test_the_balance_of_the_trapezoidal_rule_counts_circulatory_work(coupling):
    """(B7): the work of C v, zero for a gyroscopic C, and of the skew part of K; the balance of the
    trapezoidal rule is zero to rounding, 1e-12 after 400 macro steps."""
    a, b = shaft(5.0, 0.7, substeps=3 if coupling != "gc" else 1)(0.05, coupling).subdomains
    a, b = (
        pm.Subdomain(
            s.M, s.K, C=s.C, scheme=pm.Newmark(), substeps=s.substeps, v0=s.v0, symmetric=False
        )
        for s in (a, b)
    )
    ties = pm.tie(a, [2, 3], b, [0, 1])
    energy = pm.Coupler([a, b], ties, dt=0.05, coupling=coupling).run(steps=400, energy=True).energy
    size = np.max(energy.kinetic + energy.strain)
    assert np.max(np.abs(energy.balance.sum(axis=1))) < 1e-12 * size
    assert energy.dissipated[-1, 1] < -0.05 * size  # what the seal has fed in


def test_gyroscopic_forces_do_no_work():
    """v . C v = 0; the trapezoidal rule sees it as (u1 - u0) . C (v0 + v1) / 2, zero as well."""
    s = pm.Subdomain(
        [1.0, 2.0], np.eye(2), C=3.0 * J, scheme=pm.Newmark(), v0=[1.0, 0.0], symmetric=False
    )
    energy = pm.Coupler([s], dt=0.1).run(steps=300, energy=True).energy
    assert np.max(np.abs(energy.dissipated)) < 1e-14 * 300
    assert np.max(np.abs(energy.balance)) < 1e-13


# ---- everything else that a coupler does ---------------------------------------------------------


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_symmetric_matrices_are_bitwise_the_same_with_symmetric_false(coupling):
    def run(symmetric):
        rng = np.random.default_rng(4)
        A = rng.normal(size=(4, 4))
        options = dict(scheme=pm.GeneralizedAlpha(0.6), v0=[0.0, 1.0, 2.0, 0.0])
        a, b = (
            pm.Subdomain(
                np.ones(4),
                A @ A.T + np.eye(4),
                C=0.1 * np.eye(4) if i else 0.1 * A @ A.T,
                substeps=1 + i,
                symmetric=symmetric,
                **options,
            )
            for i in range(2)
        )
        return pm.Coupler([a, b], pm.tie(a, 0, b, 3), dt=0.1, coupling=coupling).run(steps=9)

    one, other = run(True), run(False)
    for i in range(2):
        np.testing.assert_array_equal(one[i].u, other[i].u)
    np.testing.assert_array_equal(one.multipliers, other.multipliers)


def test_a_static_equilibrium_with_a_follower_load():
    """Two springs in a row with K = [[3, -2 + p], [-1, 1]], cut at the second dof: dense solve."""
    K = np.array([[3.0, -1.5], [-1.0, 1.0]])
    a = pm.Subdomain(
        [1.0, 1.0], K, scheme=pm.Newmark(), force=[1.0, 2.0], symmetric=False, name="a"
    )
    b = pm.Subdomain([1.0], [0.5], scheme=pm.Newmark(), force=[0.25], name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, 1, b, 0), dt=0.1, coupling="pm")
    whole = K + np.diag([0.0, 0.5])
    expected = np.linalg.solve(whole, [1.0, 2.25])
    found = coupler.static()
    np.testing.assert_allclose(found["a"], expected, rtol=1e-13)
    np.testing.assert_allclose(found["b"], expected[1:], rtol=1e-13)
    # at rest from there
    coupler.reset(u0=found)
    assert np.max(np.abs(coupler.run(steps=50)["a"].v)) < 1e-13
    M, C, assembled_K, _ = coupler.assembled()
    np.testing.assert_array_equal(assembled_K.toarray(), whole)
    floating = pm.Subdomain(
        [1.0, 1.0], [[1.0, -1.0], [-2.0, 2.0]], scheme=pm.Newmark(), symmetric=False, force=[1, 0]
    )
    with pytest.raises(pm.FactorizationError, match="floating"):
        pm.Coupler([floating], dt=0.1).static()


def test_modes_leave_a_gyroscopic_matrix_out_and_refuse_an_unsymmetric_stiffness():
    coupler = shaft(5.0)(0.1, "gc")
    omega, _ = coupler.modes(3)
    expected, _ = shaft(0.0)(0.1, "gc").modes(3)
    np.testing.assert_array_equal(omega, expected)
    with pytest.raises(ValueError, match="modes needs a symmetric stiffness.*complex eigenvalues"):
        shaft(5.0, 1.0)(0.1, "gc").modes(3)


def test_unsymmetric_matrices_are_refused_by_default_and_the_remedy_is_named():
    for value in (dict(K=J + np.eye(2)), dict(K=np.eye(2), C=J)):
        with pytest.raises(ValueError, match="must be symmetric, got 1 at .*take symmetric=False"):
            pm.Subdomain([1.0, 1.0], scheme=pm.Newmark(), **value)
    with pytest.raises(ValueError, match=r"M must be symmetric, got .* at \[1, 0\]$"):
        pm.Subdomain(J + 2 * np.eye(2), np.eye(2), scheme=pm.Newmark(), symmetric=False)
    with pytest.raises(TypeError, match="symmetric must be"):
        pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), symmetric="no")


def test_a_mass_added_to_every_row_is_found_in_unsymmetric_damping_too():
    M, K = np.array([1.0, 2.0, 4.0]), 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    with pytest.raises(ValueError, match="c_m"):
        pm.Subdomain(M, K, C=0.1 * M + 0.2 * K, scheme=pm.Newmark(), symmetric=False)
    # a spin about (1, -2, 1) has such a skew part, but not that of these masses
    spin = np.array([[0.0, -1.0, -2.0], [1.0, 0.0, -1.0], [2.0, 1.0, 0.0]])
    assert pm.Subdomain(M, K, C=spin, scheme=pm.Newmark(), symmetric=False).C[0, 2] == -2.0


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_steps_that_change_reach_the_exact_solution(coupling):
    """Errors at 2 s with steps of 2 ms, then of 1 ms and other substeps."""
    make = shaft(5.0, 1.0, double=coupling == "pm" or None)
    coupler = make(0.002, coupling)
    state, _ = analysis.exact_solution(coupler)(2.0)
    coupler.step(500)
    coupler.change_steps(dt=0.001, substeps=None if coupling == "gc" else {"b": 2})
    coupler.step(1000)
    for name, (u, _, _) in state.items():
        assert np.max(np.abs(coupler.state(name).u - u)) < 2e-3 * np.max(np.abs(u))


def test_a_reduced_subdomain_keeps_its_gyroscopic_matrix():
    """T^T C T, not its symmetric part, which is zero; an unsymmetric K has no such basis."""
    K = 2.0 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    C = np.kron(np.eye(2), 3.0 * J)
    whole = pm.Subdomain(np.ones(4), K, C=C, scheme=pm.Newmark(), symmetric=False)
    small, basis = whole.reduced([0, 1], modes=1)
    np.testing.assert_allclose(small.C, basis.matrix.T @ C @ basis.matrix, rtol=0, atol=1e-14)
    assert np.max(np.abs(small.C - small.C.T)) > 1.0
    bad = pm.Subdomain(np.ones(4), K + 0.1 * C, scheme=pm.Newmark(), symmetric=False)
    with pytest.raises(ValueError, match="K must be symmetric for a reduction"):
        bad.reduced([0, 1], modes=1)
