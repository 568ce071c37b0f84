"""Small linear problems are warned of when their macro step grows, whatever the coupling."""

import re
import warnings

import numpy as np
import pytest
from coupled_problems import random_coupler
from threadpoolctl import threadpool_info

import pmalpha as pm
from pmalpha import analysis
from pmalpha.setup import amplification as propagation

ALPHA = pm.GeneralizedAlpha


def three_oscillators(c):
    """The third with two substeps and damping c."""
    a = pm.Subdomain([0.6], [6.0], scheme=pm.Newmark(), name="a")
    b = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5), name="b")
    d = pm.Subdomain([0.1], [30.0], C=[c], scheme=ALPHA(0.5), substeps=2, name="d")
    return [a, b, d], [pm.tie(a, 0, b, 0), pm.tie(b, 0, d, 0)]


def radius(coupler):
    return analysis.spectral_radius(analysis.amplification_matrix(coupler))


def test_mean_coupling_with_a_damped_subdomain_with_substeps_is_warned_of_where_it_grows():
    with pytest.warns(pm.StabilityWarning, match='coupling="mean" grows with these') as caught:
        coupler = pm.Coupler(*three_oscillators(30.0), dt=0.7, coupling="mean")
    grown = float(re.search(r"by a factor of (\S+) in", str(caught[0].message))[1])
    # three digits of what the factor adds; the motion of a passive structure does not grow
    np.testing.assert_allclose(grown - 1.0, radius(coupler) - 1.0, rtol=5.1e-3)
    assert grown > 1.05


@pytest.mark.parametrize("coupling", ["gc", "macro"])
def test_other_couplings_of_the_same_problem_are_not_warned_of(coupling):
    """Warnings are errors here."""
    coupler = pm.Coupler(*three_oscillators(30.0), dt=0.7, coupling=coupling)
    assert radius(coupler) < 1.0 + 1e-7


def whirl(circulatory):
    """A driven rotor with a disc, and the rate of its whirl: 1.1 u'' + (4.4 - i c) u = 0."""
    K = 4.0 * np.eye(2) + circulatory * np.array([[0.0, 1.0], [-1.0, 0.0]])
    rotor = pm.Subdomain(np.ones(2), K, scheme=ALPHA(0.5), symmetric=False, name="rotor")
    disc = pm.Subdomain([0.1, 0.1], [0.4, 0.4], scheme=ALPHA(0.5), name="disc")
    rate = np.max(np.roots([1.1, 0.0, 4.4 - 1j * circulatory]).real)
    return [rotor, disc], [pm.tie(rotor, [0, 1], disc, [0, 1])], rate


def test_growth_of_the_structure_itself_is_not_that_of_the_steps():
    """Warnings are errors here."""
    subdomains, ties, rate = whirl(0.5)
    coupler = pm.Coupler(subdomains, ties, dt=0.1, coupling="gc")
    assert radius(coupler) > 1.01
    # the damping of the scheme takes a twentieth of it at 31 steps a period
    np.testing.assert_allclose(np.log(radius(coupler)), rate * 0.1, rtol=0.1)


def test_growth_that_the_steps_add_to_that_of_a_structure_is_warned_of_with_both():
    dt, (oscillators, ties), (rotor, coupling, rate) = 0.7, three_oscillators(30.0), whirl(0.5)
    with pytest.warns(pm.StabilityWarning, match='coupling="mean" grows with these') as caught:
        coupler = pm.Coupler([*oscillators, *rotor], [*ties, *coupling], dt=dt, coupling="mean")
    words = r"by a factor of (\S+) in a macro step, of which (\S+) is the growth of the structure"
    total, of_structure = map(float, re.search(words, str(caught[0].message)).groups())
    # three digits of what the factors add
    np.testing.assert_allclose(of_structure - 1.0, np.exp(rate * dt) - 1.0, rtol=5.1e-3)
    np.testing.assert_allclose(total - 1.0, radius(coupler) - 1.0, rtol=5.1e-3)
    assert total > of_structure


def is_warned(make):
    """What was made, and whether with a StabilityWarning."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made = make()
    return made, any(issubclass(w.category, pm.StabilityWarning) for w in caught)


@pytest.mark.gate
def test_growing_random_problems_are_warned_of_and_sound_ones_are_not():
    """benchmarks/surveys/coupling_radii.py has a thousand."""
    counts = {True: 0, False: 0}
    for seed in range(26_000, 26_060):
        try:
            coupler, warned = is_warned(lambda seed=seed: random_coupler(seed))
        except ValueError:  # numbers of substeps that do not fit, "mean" with a small rho
            continue
        try:
            found = radius(coupler)
        except pm.InstabilityError:
            found = np.inf
        if 1.0 + 1e-7 < found < 1.0 + 1e-5:
            continue  # a triple eigenvalue of modulus one has this rounding
        assert warned is (found > 1.0 + 1e-7), (seed, found)
        counts[warned] += 1
    assert min(counts.values()) >= 3  # there were some of either kind


def test_an_eigenvalue_counts_as_growing_if_it_is_above_one_by_more_than_its_rounding():
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    G = np.diag([1.0, 1.0, 1.0, 0.5, -0.9, 0.3]) + np.diag([1.0, 1.0, 0.0, 0.0, 0.0], 1)
    defective = Q @ G @ Q.T  # a triple eigenvalue in one Jordan block, as of a floating structure
    assert np.abs(np.linalg.eigvals(defective)).max() > 1.0 + 1e-6  # eps^(1/3)
    assert propagation.certain_radius(defective) == 1.0
    G[4, 4] = -1.0 - 1e-6
    np.testing.assert_allclose(
        propagation.certain_radius(Q @ G @ Q.T), 1.0 + 1e-6, rtol=1e-12
    )  # simple, but for rounding of 1e-15


def chain_in_two(n, **options):
    K = 200.0 * np.eye(n) - 100.0 * (np.eye(n, k=1) + np.eye(n, k=-1))
    a, b = (pm.Subdomain(np.ones(n), K, scheme=ALPHA(0.8), name=x, **options) for x in "ab")
    return [a, b], pm.tie(a, n - 1, b, 0)


@pytest.mark.parametrize(
    ("n", "coupling", "options", "checked"),
    [
        (12, "gc", {}, True),  # 2 x 4 x 12 numbers and the free velocity
        (14, "gc", {}, False),
        (14, "mean", {}, False),
        (14, "mean", {"C": 1e-3 * np.eye(14)}, True),
        (40, "mean", {"C": 1e-3 * np.eye(40)}, False),
    ],
)
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # damping with one substep may grow
def test_the_radius_is_computed_up_to_the_size_that_the_documents_state(
    monkeypatch, n, coupling, options, checked
):
    """100 rows, or 300 where there is a reason; with one thread of BLAS."""
    threads = []

    def certain_radius(G):
        threads.extend(x["num_threads"] for x in threadpool_info() if x["user_api"] == "blas")
        return 1.0

    monkeypatch.setattr(propagation, "certain_radius", certain_radius)
    pm.Coupler(*chain_in_two(n, **options), dt=0.01, coupling=coupling)
    assert bool(threads) is checked and set(threads) <= {1}
