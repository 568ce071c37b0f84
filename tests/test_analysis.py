"""pm.analysis compared with closed forms, with runs, and with the reference."""

import re
import warnings

import numpy as np
import pytest
import reference
import scipy.sparse as sp
from pairwise import in_turn, pairwise
from reference_problems import random_problem

import pmalpha as pm
from pmalpha import analysis, models, structures
from pmalpha.analysis import amplification

RHOS = [0.0, 0.2, 0.5, 0.8, 0.99]


def implicit(rho):
    return pm.GeneralizedAlpha(rho)


def explicit(rho):
    return pm.GeneralizedAlpha(rho, explicit=True)


def bifurcation(rho):
    """Omega_b, (C1)."""
    return (1 + rho) * np.sqrt(2 - rho)


def limit(rho):
    """Omega_s, (C1)."""
    return np.sqrt(12 * (1 + rho) * (2 - rho) / (10 - 5 * rho + rho**2))


def oscillator(scheme, Omega, xi=0.0, substeps=1):
    """One dof of circular frequency 1, stepped by Omega."""
    subdomain = pm.Subdomain([1.0], [1.0], C=[2.0 * xi], scheme=scheme, substeps=substeps)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        return pm.Coupler([subdomain], dt=Omega * substeps)


def roots(scheme, Omega, xi=0.0):
    """The eigenvalues of one step, from the core."""
    return np.linalg.eigvals(analysis.amplification_matrix(oscillator(scheme, Omega, xi)))


# ---- one scheme: closed forms ----------------------------------------------------------------


def multistep_roots(scheme, Omega, xi):
    """Roots of the three-step form (3), (4) of the paper: equilibrium within the step."""
    am, af, g, b = scheme.am, scheme.af, scheme.gamma, scheme.beta
    al = np.array([am, 1 - 3 * am, -2 + 3 * am, 1 - am])
    ga = np.array([af * (g - 1), -1 + 2 * af + g - 3 * g * af, 1 - af - 2 * g + 3 * g * af])
    ga = np.append(ga, (1 - af) * g)
    de = np.array([0.5 + b - g, 0.5 - 2 * b + g, b])
    # u at i + j - af, j = 1..3, is (1 - af) E^j + af E^(j-1)
    inside = (1 - af) * np.append(0.0, de) + af * np.append(de, 0.0)
    return np.roots((al + 2 * xi * Omega * ga + Omega**2 * inside)[::-1])


@pytest.mark.parametrize(
    ("scheme", "Omega", "xi"),
    pairwise(
        [implicit(0.0), implicit(0.5), implicit(0.8), pm.HHT(0.2), pm.WBZ(0.3)],
        [0.01, 0.7, 3.0, 40.0],
        [0.0, 0.1],
    ),
)
def test_the_implicit_eigenvalues_are_the_roots_of_chung_and_hulbert_and_a_zero(scheme, Omega, xi):
    # w is fixed by equilibrium, hence the zero. Compared as polynomials: roots that are nearly
    # equal would magnify rounding. Coefficients are sums of terms below 10
    G = analysis.amplification_matrix(oscillator(scheme, Omega, xi))
    expected = np.append(np.poly(multistep_roots(scheme, Omega, xi)), 0.0)
    assert np.poly(G) == pytest.approx(expected, abs=1e-12)
    other = np.append(np.poly(multistep_roots(scheme, 1.001 * Omega, xi)), 0.0)
    assert np.poly(G) != pytest.approx(other, abs=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8, 1.0])
def test_at_infinite_frequency_all_implicit_roots_are_minus_rho(rho):
    def distance(Omega):
        found = sorted(roots(implicit(rho), Omega), key=abs)
        return np.max(np.abs(np.array(found[1:]) + rho))  # the first is the zero

    # the triple root splits like Omega^(-2/3) = 5e-4, times a constant of a few
    assert distance(1e5) < 3e-3 < distance(1e2)


@pytest.mark.parametrize("rho", RHOS)
def test_at_the_bifurcation_all_explicit_roots_are_minus_rho(rho):
    def polynomial(Omega):
        return np.poly(analysis.amplification_matrix(oscillator(explicit(rho), Omega)))

    # z (z + rho)^3; rounding of eigenvalues cancels in the coefficients, of size 3
    triple = [1.0, 3 * rho, 3 * rho**2, rho**3, 0.0]
    assert polynomial(bifurcation(rho)) == pytest.approx(triple, abs=1e-13)
    assert polynomial(0.999 * bifurcation(rho)) != pytest.approx(triple, abs=1e-4)


@pytest.mark.parametrize("rho", RHOS)
def test_an_explicit_root_leaves_the_unit_circle_at_the_limit(rho):
    # a simple root -1, condition number below 100
    assert np.min(np.abs(roots(explicit(rho), limit(rho)) + 1.0)) < 1e-12
    inside, outside = (
        analysis.spectral_radius(analysis.amplification_matrix(oscillator(explicit(rho), x)))
        for x in (0.9999 * limit(rho), 1.0001 * limit(rho))
    )
    assert inside < 1.0 < outside


def test_one_step_of_the_core_is_the_matrix_of_the_scheme():
    # (u, h v, h^2 w, h^2 a) against (u, v, w, a)
    for scheme in (implicit(0.3), explicit(0.6), pm.HHT(0.1), pm.CentralDifference()):
        scale = np.array([1.0, 0.4, 0.16, 0.16])
        G = analysis.amplification_matrix(oscillator(scheme, 0.4, xi=0.2))
        # sums of a few terms of size 10
        assert scale[:, None] * G / scale == pytest.approx(
            scheme.amplification(0.4, 0.2), abs=1e-13
        )


# ---- period and damping ----------------------------------------------------------------------

GRID = np.array([[0.01, 0.1, 0.5], [1.0, 1.5, 1.9]])


# tan(Omega_h / 2) = Omega / 2; and sin(Omega_h / 2) = Omega / 2, a period too short
@pytest.mark.parametrize(
    "scheme, inverse", [(pm.Newmark(), np.arctan), (pm.CentralDifference(), np.arcsin)]
)
def test_second_order_schemes_have_the_period_of_the_textbook_and_no_damping(scheme, inverse):
    elongation, damping = analysis.period_and_damping(scheme, GRID)
    assert elongation.shape == damping.shape == GRID.shape
    # rounding of the eigenvalue divided by Omega
    assert elongation == pytest.approx(GRID / (2 * inverse(GRID / 2)) - 1, abs=1e-12)
    assert damping == pytest.approx(0.0, abs=1e-12)
    assert np.all((elongation < 0.0) == scheme.explicit)


@pytest.mark.parametrize("xi", [0.01, 0.3, 0.9])
def test_a_damped_oscillator_under_the_trapezoidal_rule_is_the_pade_fraction(xi):
    z = GRID * (-xi + 1j * np.sqrt(1 - xi**2))
    lam = (1 + z / 2) / (1 - z / 2)
    elongation, damping = analysis.period_and_damping(pm.Newmark(), GRID, xi)
    # rounding, over the distance of the two eigenvalues and once more over their angle, 0.004
    assert elongation == pytest.approx(z.imag / np.angle(lam) - 1, abs=1e-10)
    exact = -z.real / z.imag
    assert damping == pytest.approx(-np.log(np.abs(lam)) / np.angle(lam) - exact, abs=1e-10)


@pytest.mark.parametrize(
    "scheme", [implicit(0.5), implicit(0.0), explicit(0.5), pm.HHT(0.3)], ids=repr
)
def test_period_error_and_algorithmic_damping_are_of_order_two_and_three(scheme):
    def at(i):
        return lambda Omega: abs(analysis.period_and_damping(scheme, Omega)[i])

    # next term: relative Omega^2 = 1e-3
    assert analysis.observed_order(at(0), [0.02, 0.04]) == pytest.approx(2.0, abs=0.01)
    assert analysis.observed_order(at(1), [0.02, 0.04]) == pytest.approx(3.0, abs=0.01)


def test_beyond_the_bifurcation_there_is_no_period():
    Omega = bifurcation(0.5) * np.array([0.999, 1.001])
    for result in analysis.period_and_damping(explicit(0.5), Omega):
        assert np.isnan(result).tolist() == [False, True]


@pytest.mark.parametrize(
    "scheme, Omega, xi, message",
    [
        ("trapezoidal", 1.0, 0.0, "scheme must be a pmalpha scheme, got 'trapezoidal'"),
        (pm.Newmark(), [1.0, 0.0], 0.0, "Omega must be positive, got 0.0"),
        (pm.Newmark(), [1.0, np.nan], 0.0, "Omega must be finite"),
        (pm.Newmark(), 1.0, 1.0, "xi must be below 1, got 1.0"),
        (pm.Newmark(), 1.0, -0.1, "xi must be finite and at least 0, got -0.1"),
    ],
)
def test_invalid_arguments_of_period_and_damping_are_refused(scheme, Omega, xi, message):
    with pytest.raises((TypeError, ValueError), match=re.escape(message)):
        analysis.period_and_damping(scheme, Omega, xi)


# ---- amplification matrix --------------------------------------------------------------------


def unloaded(seed, **changes):
    """A random problem without loads."""
    problem = random_problem(seed)
    for subdomain in problem.subdomains:
        subdomain.force = None
    for name, value in changes.items():
        setattr(problem, name, value)
    return problem.coupler()


@pytest.mark.gate
def test_the_random_problems_contain_what_the_next_test_needs():
    couplers = [unloaded(seed) for seed in range(15)]
    parts = [part for coupler in couplers for part in coupler._session.members]
    assert {part.double for part in parts} == {True, False}
    assert any(part.double and part.subdomain.substeps > 1 for part in parts)
    assert any(part.double and part.subdomain.scheme.explicit for part in parts)
    kinds = {type(A) if A is None or sp.issparse(A) else A.ndim for p in parts for A in (p.M, p.K)}
    assert {1, 2, sp.csr_array} <= kinds
    assert {len(coupler._session.members) for coupler in couplers} == {2, 3, 4, 5}


def present(coupler):
    """The state X of the coupler, as the amplification matrix has it."""
    cores = [part.core for part in coupler._session.members]
    return amplification.layout_of(coupler).read(coupler._session.core, cores, 1)[:, 0]


@pytest.mark.parametrize("seed", range(15))
def test_the_matrix_to_the_power_k_is_a_run_of_k_macro_steps(seed):
    coupler = unloaded(seed)
    G = analysis.amplification_matrix(coupler)
    coupler.step(2)
    X = present(coupler)
    coupler.step(6)
    after = present(coupler)
    # rounding of six products with some hundred terms each
    size = np.abs(np.linalg.matrix_power(np.abs(G), 6) @ np.abs(X)).max()
    assert np.linalg.matrix_power(G, 6) @ X == pytest.approx(after, abs=1e-14 * size)
    assert np.linalg.matrix_power(G, 6) @ X == pytest.approx(after, abs=1e-10 * np.abs(X).max())
    # the names of the rows, from the state that the user gets
    for part in coupler._session.members:
        for name, x in zip("uvw", vars(coupler.state(part.name)).values()):
            rows = [G.names.index(f"{name}[{d}] of {part.name} at n") for d in range(part.n)]
            assert np.array_equal(after[rows], x)


def test_a_wrong_entry_of_the_matrix_is_detected():
    coupler = unloaded(0)
    G = analysis.amplification_matrix(coupler)
    coupler.step(2)
    X = present(coupler)
    coupler.step(1)
    G[0, np.argmax(np.abs(X))] += 1e-9
    assert G @ X != pytest.approx(present(coupler), abs=1e-10 * np.abs(X).max())


def test_a_unit_state_that_overflows_in_its_step_is_no_column_of_the_matrix():
    far = pm.Subdomain([1e-20], [1e300], scheme=pm.GeneralizedAlpha(0.8, explicit=True), name="far")
    with pytest.warns(pm.StabilityWarning):
        coupler = pm.Coupler([far], dt=1.0)
    with pytest.raises(pm.InstabilityError, match="'far' is not finite any more in macro step 1"):
        analysis.amplification_matrix(coupler)


def test_loads_are_left_out_of_the_matrix():
    for seed in range(2):
        loaded = analysis.amplification_matrix(random_problem(seed).coupler())
        assert np.array_equal(loaded, analysis.amplification_matrix(unloaded(seed)))


def test_the_rows_of_the_split_oscillator_are_those_of_the_paper():
    G = analysis.amplification_matrix(
        models.split_oscillator(10.0, substeps=2).coupler(0.1, coupling="pm")
    )
    a = [f"{x}[0] of A at {when}" for when in ("n-1", "n") for x in ("u", "v", "w", "a", "vf")]
    b = [f"{x}[0] of B at n" for x in ("u", "v", "w", "a")]
    assert G.shape == (14, 14)
    assert list(G.names) == a + b
    # what was at n is at n-1 one macro step later
    assert np.array_equal(G[:5], np.eye(14)[5:10])


LOADS = {
    "none": None,
    "constant": np.array([0.3, -0.2]),
    "sampled": pm.SampledForce([0.0, 1.0, -1.0], 0.04, shape=[1.0, 2.0]),
    "callable": lambda t: np.array([np.cos(t), t]),
}


def loaded_coupler(kind):
    a = pm.Subdomain(
        [1.0, 2.0], [3.0, 1.0], scheme=implicit(0.6), force=LOADS[kind], v0=[0.0, 0.5], name="a"
    )
    b = pm.Subdomain(
        [1.0, 1.0], [[9.0, -4.0], [-4.0, 9.0]], C=[0.1, 0.1], scheme=explicit(0.6), substeps=4,
        force=LOADS[kind], v0=[0.5, 0.0], name="b",
    )  # fmt: skip
    motion = {"velocity": lambda t: [0.1 * np.sin(t)]} if kind == "callable" else {}
    driven = pm.Constraint({b: [[0.0, 1.0]]}, **motion)
    return pm.Coupler([a, b], [pm.tie(a, [1], b, [0]), driven], dt=0.05, coupling="pm")


def history_bytes(history):
    arrays = [getattr(s, x).tobytes() for s in history.subdomains for x in ("t", "u", "v", "a")]
    return arrays + [history.multipliers.tobytes(), history.velocity_jump.tobytes()]


def somewhere(t):
    """Stands in for an exact solution."""
    return {name: 3 * [np.full(2, t)] for name in "ab"}, np.array([1.0, -t])


@pytest.mark.parametrize(("kind", "steps"), [*in_turn(LOADS, 0, 5), ("callable", 0)])
def test_an_analysis_leaves_the_coupler_as_it_was(kind, steps):
    touched, other = loaded_coupler(kind), loaded_coupler(kind)
    touched.step(steps)
    other.step(steps)
    analysis.amplification_matrix(touched)
    analysis.zero_stability(touched)
    analysis.global_error(touched, somewhere, 0.2)
    analysis.start_error(touched, somewhere)
    analysis.local_error(touched, somewhere, n=7)
    assert touched.step_count == steps
    assert np.array_equal(touched.multipliers, other.multipliers)
    assert history_bytes(touched.run(steps=7)) == history_bytes(other.run(steps=7))


def test_an_analysis_that_fails_leaves_the_coupler_as_it_was():
    touched, other = loaded_coupler("sampled"), loaded_coupler("sampled")
    touched.step(2)
    other.step(2)

    def broken(t):
        raise ArithmeticError("no truth today")

    for analyse in (
        lambda: analysis.global_error(touched, broken, 0.5),
        lambda: analysis.local_error(touched, broken),
    ):
        with pytest.raises(ArithmeticError):
            analyse()
    assert history_bytes(touched.run(steps=3)) == history_bytes(other.run(steps=3))


@pytest.mark.parametrize(
    "function",
    [
        analysis.amplification_matrix,
        analysis.zero_stability,
        analysis.exact_solution,
        lambda c: analysis.global_error(c, somewhere, 1.0),
        lambda c: analysis.start_error(c, somewhere),
        lambda c: analysis.local_error(c, somewhere),
    ],
)
def test_anything_but_a_coupler_is_refused(function):
    with pytest.raises(TypeError, match="coupler must be a Coupler, got 'rig'"):
        function("rig")


# ---- spectral radius -------------------------------------------------------------------------


def test_eigenvalues_are_left_out_by_value():
    G = np.diag([1.0, 1.0 - 1e-7, -1.0, 0.5])
    assert analysis.spectral_radius(G) == 1.0
    assert analysis.spectral_radius(G, drop=[1.0]) == 1.0
    assert analysis.spectral_radius(G, drop=[1.0, -1.0]) == 0.5
    assert analysis.spectral_radius(G, drop=[1.0, -1.0], tol=1e-8) == 1.0 - 1e-7
    assert analysis.spectral_radius(G, drop=[1.0, -1.0, 0.5]) == 0.0


def test_complex_eigenvalues_count_by_modulus_and_are_left_out_by_value():
    G = np.array([[0.0, -0.8], [0.8, 0.0]])
    assert analysis.spectral_radius(G) == pytest.approx(0.8, abs=1e-15)
    assert analysis.spectral_radius(G, drop=[0.8j]) == pytest.approx(0.8, abs=1e-15)
    assert analysis.spectral_radius(G, drop=[0.8j, -0.8j]) == 0.0


def test_a_defective_eigenvalue_one_is_left_out_though_rounding_splits_it():
    Q = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    G = Q @ np.array([[1.0, 9.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.3]]) @ Q.T
    assert np.sort(np.abs(np.linalg.eigvals(G) - 1.0))[1] > 1e-10
    assert analysis.spectral_radius(G, drop=[1.0]) == pytest.approx(0.3, abs=1e-13)


@pytest.mark.parametrize(
    "G, message",
    [
        (np.ones((2, 3)), "G must be square, got shape (2, 3)"),
        (np.ones(3), "G must be a 2-D array, got shape (3,)"),
        (np.full((2, 2), np.nan), "G must be finite, got nan at [0, 0]"),
    ],
)
def test_a_matrix_without_eigenvalues_is_refused(G, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        analysis.spectral_radius(G)


# ---- critical step and stability limit -------------------------------------------------------


def chain_of(n, scheme, form, **options):
    """Unit masses and springs, fixed at one end: omega_max = 2 sin((2n - 1)/(2n + 1) pi/2)."""
    M, K = models.shear_frame(np.ones(n), np.ones(n))
    return pm.Subdomain(M, form(K.toarray()), scheme=scheme, **options)


def highest(n):
    return 2 * np.sin((2 * n - 1) / (2 * n + 1) * np.pi / 2)


@pytest.mark.parametrize("rho", RHOS)
@pytest.mark.parametrize("form", [np.asarray, sp.csr_array], ids=["dense", "sparse"])
def test_the_critical_step_of_a_chain_is_the_limit_over_its_highest_frequency(rho, form):
    critical = analysis.critical_step(chain_of(7, explicit(rho), form))
    # a radius of 1 + 1e-7 is taken for 1: over the slope of the root, at most 1e-7 of Omega
    assert critical == pytest.approx(limit(rho) / highest(7), rel=2e-7)


def test_the_critical_step_of_a_long_sparse_chain_is_on_the_safe_side():
    critical = analysis.critical_step(chain_of(300, pm.CentralDifference(), sp.csr_array))
    assert 0.998 < critical / (2.0 / highest(300)) <= 1.0


# LAPACK's bisection for a part of the spectrum loses such eigenvalues, here for several n
@pytest.mark.parametrize("n", range(17, 38))
def test_many_equal_frequencies_have_a_critical_step_and_modes(n):
    M, K = np.eye(n) + 1e-3, np.full(n, 0.25)
    s = pm.Subdomain(M, K, scheme=pm.CentralDifference())
    assert analysis.critical_step(s) == pytest.approx(2.0 / 0.5, rel=1e-7)
    omegas, shapes = structures.modes(M, K, 4)
    exact = np.sqrt(0.25 / (1.0 + 1e-3 * n))
    assert omegas == pytest.approx([exact, 0.5, 0.5, 0.5], rel=1e-10)
    assert shapes.T @ M @ shapes == pytest.approx(np.eye(4), abs=1e-12)


# Lanczos' method from one vector finds four of the five lowest, and the sixth as the tenth
@pytest.mark.parametrize("n", [60, 150])
def test_modes_of_equal_substructures_are_all_found(n):
    one = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    K = sp.csr_array(sp.block_diag([one] * 5))
    omegas, shapes = structures.modes(np.ones(5 * n), K, 10)
    exact = 2.0 * np.sin(np.arange(1, 3) * np.pi / (2 * n + 2))
    assert omegas == pytest.approx(np.repeat(exact, 5), rel=1e-9)
    assert shapes.T @ shapes == pytest.approx(np.eye(10), abs=1e-9)


def test_the_critical_step_is_the_length_of_a_substep():
    one, many = (
        analysis.critical_step(chain_of(3, explicit(0.5), np.asarray, substeps=ss))
        for ss in (1, 20)
    )
    assert one == many


@pytest.mark.parametrize(
    "scheme", [implicit(0.0), implicit(1.0), pm.Newmark(), pm.HHT(0.3)], ids=repr
)
def test_where_every_step_is_stable_the_critical_step_is_infinite(scheme):
    assert analysis.critical_step(chain_of(3, scheme, np.asarray)) == np.inf


def test_without_stiffness_the_critical_step_is_infinite():
    free = pm.Subdomain([1.0, 2.0], np.zeros(2), scheme=explicit(0.5))
    assert analysis.critical_step(free) == np.inf


def test_the_critical_step_of_anything_but_a_subdomain_is_refused():
    with pytest.raises(TypeError, match="subdomain must be a Subdomain, got 0.5"):
        analysis.critical_step(0.5)


@pytest.mark.parametrize("double", [False, True])
def test_the_warning_begins_at_the_critical_step_or_at_half_of_it_with_double_steps(double):
    # the tie is at a free mass beside the stiff one, and leaves its critical step as it is
    options = dict(scheme=explicit(0.5), double_step=double, name="stiff")
    stiff = pm.Subdomain([1.0, 1.0], [4.0, 0.0], **options)
    soft = pm.Subdomain([1.0], [0.01], scheme=implicit(0.5), double_step=False)
    tie = pm.tie(stiff, [1], soft, [0])
    critical = analysis.critical_step(stiff) / (2 if double else 1)
    pm.Coupler([stiff, soft], tie, dt=critical, coupling="pm")
    with pytest.warns(pm.StabilityWarning, match="'stiff' is above its critical step"):
        pm.Coupler([stiff, soft], tie, dt=critical * (1 + 1e-6), coupling="pm")
    # no double steps there
    pm.Coupler([stiff, soft], tie, dt=analysis.critical_step(stiff), coupling="gc")


def double_explicit(rho, Omega, double):
    """An explicit oscillator of frequency 1, not tied; another subdomain takes single steps."""
    subdomain = pm.Subdomain([1.0], [1.0], scheme=explicit(rho), double_step=double)
    other = pm.Subdomain([1.0], [0.0], scheme=implicit(rho), double_step=False)
    return pm.Coupler([subdomain, other], dt=Omega, coupling="pm")


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_a_double_step_explicit_subdomain_has_half_the_limit(rho):
    # an excess of 1e-6 in the radius, over the slope of the root: below 1e-6 of Omega
    for double, factor in ((False, 1.0), (True, 0.5)):
        found = analysis.stability_limit(lambda x, d=double: double_explicit(rho, x, d), 0.1, 3.0)
        assert found == pytest.approx(factor * limit(rho), rel=2e-6)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_two_explicit_subdomains_with_equal_steps_have_the_limit_of_the_uncut_oscillator(rho):
    # "gc" with one scheme and one step is the uncut scheme, here with Omega = omega h
    def cut(Omega):
        model = models.split_oscillator(
            3.0, stiffness=1.0, scheme_a=explicit(rho), scheme_b=explicit(rho)
        )
        return model.coupler(Omega, coupling="gc")

    assert analysis.stability_limit(cut, 0.1, 3.0) == pytest.approx(limit(rho), rel=2e-6)


@pytest.mark.gate
def test_the_drift_and_a_free_motion_are_not_taken_for_instability():
    # both subdomains floating: the defective eigenvalue 1 of a motion at constant velocity
    # besides the 1 of the drift; the limit is that of B's spring between its two masses
    def floating(h):
        K = np.array([[1.0, -1.0], [-1.0, 1.0]])
        a = pm.Subdomain([1.0, 1.0], 1e-3 * K, scheme=pm.Newmark(), name="a")
        b = pm.Subdomain([1.0, 1.0], K, scheme=pm.CentralDifference(), name="b")
        return pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=h, coupling="pm")

    found = analysis.stability_limit(floating, 0.1, 20.0)
    # ties do not lower the limit of the floating subdomain, 2 / sqrt(2)
    assert found >= np.sqrt(2.0) * (1 - 1e-6)
    # and a tenth above, a run of the core grows
    coupler = floating(0.1)
    for x, grows in ((0.9 * found, False), (1.1 * found, True)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = floating(x)
        coupler.reset(u0={"b": [0.0, 1.0]})
        v = np.abs(coupler.run(steps=200)["b"].v)
        assert (v[100:].max() > 1e3 * v[:100].max()) == grows


def test_a_bracket_that_does_not_contain_the_limit_is_refused():
    def alone(Omega):
        return oscillator(explicit(0.5), Omega)

    for lo, hi, message in (
        (2.0, 3.0, "the coupler must be stable at lo, got spectral radius 1."),
        (0.1, 1.0, "the coupler must be unstable at hi, got spectral radius 0."),
        (1.0, 1.0, "lo must be below hi, got 1.0 and 1.0"),
        (np.nan, 1.0, "lo must be finite, got nan"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            analysis.stability_limit(alone, lo, hi)


# ---- zero stability --------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.0, 0.2, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("b1", [0.01, 1.0, 100.0])
def test_the_loop_of_gc_with_equal_steps_has_the_closed_form_for_any_masses(rho, b1):
    # roots -rho and -(3 rho - 1)/(3 - rho), docs/method.md section 12
    coupler = models.split_oscillator(b1, rho=rho).coupler(0.01, coupling="gc")
    expected = max(rho, abs(3 * rho - 1) / (3 - rho))
    # where the roots meet, at rho = 1, rounding is magnified to its root
    assert analysis.zero_stability(coupler) == pytest.approx(
        expected, abs=1e-12 if rho < 1 else 1e-7
    )


@pytest.mark.parametrize("scheme", [implicit(0.0), implicit(0.8), pm.Newmark()], ids=repr)
def test_two_fine_steps_in_a_macro_step_square_the_loop(scheme):
    # Newmark: (-1)^2, not the 1 of the common velocity
    subdomains = [pm.Subdomain([m], [1.0], scheme=scheme, substeps=2) for m in (1.0, 3.0)]
    coupler = pm.Coupler(
        subdomains, pm.tie(subdomains[0], [0], subdomains[1], [0]), dt=0.1, coupling="gc"
    )
    roots = scheme.af / (1 - scheme.af), (1 - scheme.gamma) / scheme.gamma
    expected = max(map(abs, roots)) ** 2
    assert analysis.zero_stability(coupler) == pytest.approx(expected, abs=1e-10)


def test_interior_dofs_and_stiffness_do_not_enter_the_loop():
    # only the halves of the second mass of the four-dof chain enter the loop: b1 = 1
    for ss in (1, 3):
        chain = models.four_dof(0.6, substeps=ss)
        halves = models.split_oscillator(1.0, rho=0.6, substeps=ss)
        found = analysis.zero_stability(chain.coupler(0.01, coupling="pm"))
        assert found == pytest.approx(
            analysis.zero_stability(halves.coupler(0.01, coupling="pm")), abs=1e-10
        )
        assert found != pytest.approx(
            analysis.zero_stability(
                models.split_oscillator(2.0, rho=0.6, substeps=ss).coupler(0.01, coupling="pm")
            ),
            abs=1e-3,
        )


@pytest.mark.parametrize(
    "b1, ss, rho", [(10.0, 1, 0.5), (0.1, 1, 0.2), (1.0, 3, 0.7), (30.0, 3, 0.1)]
)
def test_the_loop_is_what_the_spectrum_of_the_coupler_tends_to(b1, ss, rho):
    # as dt -> 0: the largest eigenvalue away from 1 and -1, which belong to motion and chains,
    # and apart from the root of recursion (9), which is not in the loop
    coupler = models.split_oscillator(b1, rho=rho, substeps=ss).coupler(1e-5, coupling="pm")
    values = np.linalg.eigvals(analysis.amplification_matrix(coupler))
    distance = np.abs(np.abs(values) - analysis.zero_stability(coupler))
    assert distance.min() < 1e-7  # perturbed by (omega dt)^2 = 4e-9
    larger = values[np.abs(values) > analysis.zero_stability(coupler) + 1e-6]
    assert np.abs(np.abs(larger) - 1.0).max() < 1e-3  # omega dt = 6e-5


def test_zero_stability_needs_constraints_and_masses():
    with pytest.raises(ValueError, match="coupler must have constraints, got none"):
        analysis.zero_stability(oscillator(implicit(0.5), 0.1))
    a = pm.Subdomain([0.0, 1.0], [[2.0, -1.0], [-1.0, 1.0]], scheme=implicit(0.5), name="rod")
    b = pm.Subdomain([1.0], [1.0], scheme=implicit(0.5))
    coupler = pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=0.1, coupling="pm")
    with pytest.raises(ValueError, match="mass at all dofs, got dofs without mass in 'rod'"):
        analysis.zero_stability(coupler)


# ---- errors ----------------------------------------------------------------------------------


def test_the_observed_order_is_the_slope_of_a_straight_line():
    steps = [0.3, 0.1, 0.04]
    assert analysis.observed_order(lambda dt: 5 * dt**2.5, steps) == pytest.approx(2.5, abs=1e-13)
    # through three points that are not on one: by hand, with logs to base 2
    errors = {1.0: 1.0, 0.5: 0.5, 0.25: 0.0625}
    found = analysis.observed_order(errors.get, errors)
    assert found == pytest.approx(2.0, abs=1e-13)  # x = 0, -1, -2; y = 0, -1, -4: slope 4 / 2


@pytest.mark.parametrize(
    "error, steps, message",
    [
        (1.0, [0.1], "steps must have at least two different values, got [0.1]"),
        (1.0, [0.1, 0.1], "steps must have at least two different values"),
        (1.0, [0.1, -0.2], "steps must be positive, got -0.2"),
        (0.0, [0.1, 0.2], "run must return a positive finite error, got 0.0 at dt = 0.1"),
        (np.nan, [0.1, 0.2], "what run returns at dt = 0.1 must be finite, got nan"),
    ],
)
def test_an_order_without_errors_is_refused(error, steps, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        analysis.observed_order(lambda dt: error, steps)


K3 = 30.0 * (2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
BAR = dict(M=np.diag([1.0, 2.0, 1.5]), K=K3, C=0.01 * K3 + 0.05 * np.eye(3))


def three_bars(force=None, substeps=(1, 2, 6), **options):
    """Three bars of three dofs that meet at their first dofs."""
    rng = np.random.default_rng(5)
    bars = []
    for i, ss in enumerate(substeps):
        u0, v0 = rng.normal(size=(2, 3))
        u0[0], v0[0] = 0.7, -0.4
        kinds = [implicit(0.5), implicit(0.8), explicit(0.3)]
        bars.append(
            pm.Subdomain(
                BAR["M"],
                BAR["K"],
                C=BAR["C"],
                scheme=kinds[i],
                substeps=ss,
                u0=u0,
                v0=v0,
                force=force,
                name=f"bar {i}",
            )  # fmt: skip
        )
    ties = [pm.tie(bars[i], [0], bars[i + 1], [0]) for i in (0, 1)]
    return pm.Coupler(bars, ties, **({"dt": 0.01, "coupling": "pm"} | options))


def assembled():
    """The same bars as one structure of seven dofs, the shared one first."""
    positions = [[0, 1 + 2 * i, 2 + 2 * i] for i in range(3)]
    M, C, K = np.zeros((3, 7, 7))
    for at in positions:
        for whole, name in ((M, "M"), (C, "C"), (K, "K")):
            whole[np.ix_(at, at)] += BAR[name]
    return M, C, K, positions


def gathered(values, positions):
    x = np.zeros(7)
    for at, values_at in zip(positions, values):
        x[at] = values_at
    return x


@pytest.mark.parametrize("t", [0.0, 0.31, 2.0])
def test_the_exact_solution_is_that_of_the_assembled_structure(t):
    coupler = three_bars()
    M, C, K, positions = assembled()
    start = [(s.u0, s.v0) for _, s in coupler._session.keys]
    u0, v0 = (gathered(x, positions) for x in zip(*start))
    u, v, w = reference.exact(M, C, K, u0, v0, t)
    states, lam = analysis.exact_solution(coupler)(t)
    for i, at in enumerate(positions):
        # expm of a matrix of norm 100 t
        for got, x in zip(states[f"bar {i}"], (u, v, w)):
            assert got == pytest.approx(x[at], abs=1e-11)
    # the multiplier of the tie between 0 and 1 balances inertia and springs of bar 0
    force = (BAR["M"] @ w[positions[0]] + BAR["C"] @ v[positions[0]] + BAR["K"] @ u[positions[0]])[
        0
    ]
    assert lam[0] == pytest.approx(force, abs=1e-10)


def test_the_exact_solution_under_a_constant_load_can_be_rest():
    pull = np.array([1.0, 0.0, -2.0])
    M, C, K, positions = assembled()
    u = np.linalg.solve(K, sum(gathered([pull], [at]) for at in positions))
    coupler = three_bars(force=pull)
    rest = {f"bar {i}": u[at] for i, at in enumerate(positions)}
    coupler.reset(u0=rest, v0={name: np.zeros(3) for name in rest})
    states, lam = analysis.exact_solution(coupler)(3.0)
    for name, x in rest.items():
        assert states[name][0] == pytest.approx(x, abs=1e-12)
        assert states[name][2] == pytest.approx(0.0, abs=1e-10)
    assert lam == pytest.approx(coupler.multipliers, abs=1e-11)


def test_a_gap_stays_in_the_exact_solution():
    a = pm.Subdomain([1.0], [2.0], scheme=implicit(0.5), u0=[0.3], name="a")
    b = pm.Subdomain([1.0], [2.0], scheme=implicit(0.5), name="b")
    with pytest.warns(pm.ConstraintWarning):
        coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm")
    states, _ = analysis.exact_solution(coupler)(1.7)
    assert states["a"][0] - states["b"][0] == pytest.approx(0.3, abs=1e-13)
    # mean displacement: an oscillator of mass 2 and stiffness 4
    mean = (states["a"][0] + states["b"][0]) / 2
    assert mean == pytest.approx(0.15 * np.cos(np.sqrt(2.0) * 1.7), abs=1e-13)


def test_what_has_no_exact_solution_is_refused():
    with pytest.raises(ValueError, match="no loads or constant ones .* on subdomain 'bar 0'"):
        analysis.exact_solution(three_bars(force=lambda t: np.zeros(3)))
    with pytest.raises(ValueError, match="must have no prescribed motion"):
        analysis.exact_solution(loaded_coupler("callable"))
    a = pm.Subdomain([0.0, 1.0], [[2.0, -1.0], [-1.0, 1.0]], scheme=implicit(0.5))
    with pytest.raises(ValueError, match="must have mass in every motion"):
        analysis.exact_solution(pm.Coupler([a], dt=0.1))


@pytest.mark.parametrize(("coupling", "start"), [("pm", "plain"), ("gc", "rebased")])
def test_the_global_error_is_that_of_the_history(coupling, start):
    coupler = three_bars(coupling=coupling, start=start)
    exact = analysis.exact_solution(coupler)
    coupler.step(3)
    found = analysis.global_error(coupler, exact, 0.2)
    history = three_bars(coupling=coupling, start=start).run(0.2)
    states, lam = exact(0.2)
    expected = {x: 0.0 for x in "uva"}
    for s in history.subdomains:
        for x, truth in zip("uva", states[s.name]):
            expected[x] = max(expected[x], np.abs(getattr(s, x)[-1] - truth).max())
    expected["multipliers"] = np.abs(history.multipliers[-1] - lam).max()
    assert found == expected
    assert min(found.values()) > 1e-6
    two = analysis.global_error(coupler, exact, 2 * coupler.dt)
    assert analysis.start_error(coupler, exact) == two


def reference_local_error(exact, n, dt):
    """One macro step of the bars from exact data, by the reference: bars 0 and 1 are double."""
    L = [np.zeros((2, 3)) for _ in range(3)]
    L[0][0, 0], L[1][0, 0], L[1][1, 0], L[2][1, 0] = 1.0, -1.0, 1.0, -1.0
    schemes = [reference.alpha(0.5), reference.alpha(0.8), reference.alpha(0.3, explicit=True)]
    steppers = []
    for i, ss in enumerate((1, 2, 6)):
        subdomain = reference.Subdomain(**BAR, **schemes[i], substeps=ss, double=i < 2)
        x = reference.Stepper(subdomain, L[i], dt, 6)
        for t in (n * dt - dt / ss, n * dt):
            states, lam = exact(t)
            u, v, w = states[f"bar {i}"]
            vf = v - x.later.link(lam)[1]  # (S2) with the operators of the present step
            x.states.append(reference.State(t, u, v, w, w, vf))
        x.states = [None] * (n * ss - 1) + x.states
        x.step, x.back = x.later, 1 if subdomain.double else 0
        steppers.append(x)
    H = reference.interface_matrix(steppers)
    for k in range(6 * n + 1, 6 * n + 7):
        lam = reference.fine_step(steppers, L, H, k)
    states, truth = exact((n + 1) * dt)
    errors = {}
    for j, name in enumerate("uva"):
        last = [getattr(x.states[-1], "uvw"[j]) for x in steppers]
        errors[name] = max(np.abs(x - states[f"bar {i}"][j]).max() for i, x in enumerate(last))
    return errors | {"multipliers": np.abs(lam - truth).max()}


@pytest.mark.parametrize("n", [1, 4])
def test_the_local_error_is_that_of_the_reference_from_exact_data(n):
    coupler = three_bars(dt=0.02)
    exact = analysis.exact_solution(coupler)
    expected = reference_local_error(exact, n, 0.02)
    found = analysis.local_error(coupler, exact, n=n)
    # rounding of states of size 100, magnified by 1 / h in w and Lam
    assert found == pytest.approx(expected, rel=1e-6)
    assert min(found.values()) > 1e-5
    assert found != pytest.approx(reference_local_error(exact, n + 1, 0.02), rel=1e-2)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda c, e: analysis.local_error(c, e, n=0), "n must be at least 1, got 0"),
        (lambda c, e: analysis.local_error(c, e, n=1.5), "n must be a whole number, got 1.5"),
        (lambda c, e: analysis.global_error(c, e, 0.015), "t_end must be a whole number of macro"),
        (lambda c, e: analysis.global_error(c, e, -1.0), "t_end must not be behind"),
    ],
)
def test_an_error_between_time_levels_is_refused(call, message):
    coupler = three_bars()
    with pytest.raises((TypeError, ValueError), match=message):
        call(coupler, analysis.exact_solution(coupler))


def test_an_exact_solution_that_does_not_fit_is_refused():
    coupler = three_bars()
    exact = analysis.exact_solution(coupler)

    def short(t):
        states, lam = exact(t)
        return states | {"bar 1": 3 * [np.zeros(2)]}, lam

    def scalar(t):
        return exact(t)[0], np.zeros(1)

    for analyse in (analysis.local_error, analysis.start_error):
        with pytest.raises(ValueError, match="u of 'bar 1' from exact.* must have shape"):
            analyse(coupler, short)
        with pytest.raises(ValueError, match="Lam from exact.* must have shape"):
            analyse(coupler, scalar)
