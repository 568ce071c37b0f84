"""Coupler.growth, and what set-up says of large couplers with an unsymmetric K.

The growth is that of the spectral radius where that is known, and of closed forms.
"""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import analysis


def circulatory(seed, coupling, n=4):
    """A damped subdomain with a skew part in K beside a symmetric one with four substeps."""
    rng = np.random.default_rng(seed)

    def matrix(n):
        A = rng.normal(size=(n, n))
        return A @ A.T + n * np.eye(n)

    S = rng.normal(size=(n, n)) * 1.5
    C = np.full(n, 0.6)
    a = pm.Subdomain(
        np.ones(n), matrix(n) + S - S.T, C=C, scheme=pm.Newmark(), symmetric=False, name="a"
    )
    b = pm.Subdomain(
        np.ones(3), matrix(3), C=C[:3], scheme=pm.CentralDifference(), substeps=4, name="b"
    )
    ties = pm.tie(a, [0, 1], b, [1, 2])
    return pm.Coupler([a, b], ties, dt=0.3, coupling=coupling)


@pytest.mark.gate
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # of what grows
@pytest.mark.parametrize("coupling", ["macro", "mean", "gc", "pm"])
def test_the_growth_of_small_couplers_is_their_spectral_radius(coupling):
    grown = 0
    for seed in range(6):
        coupler = circulatory(seed, coupling)
        radius = analysis.spectral_radius(analysis.amplification_matrix(coupler))
        found = coupler.growth(1500)
        # a pair of nearly equal size beats; settled says so
        np.testing.assert_allclose(found.factor, radius, rtol=0.0, atol=5e-6 + found.settled)
        assert found.grows == (radius > 1.0 + 1e-6)
        grown += found.grows
        assert found.settled < 2e-3
    assert grown > 0


def test_the_growth_of_central_difference_above_its_limit_is_that_of_the_closed_form():
    """z + 1/z = 2 - Omega^2, in the subdomain that is above its limit."""
    Omega = 2.02
    fast = pm.Subdomain([1.0], [Omega**2], scheme=pm.CentralDifference(), name="fast")
    slow = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), name="slow")
    with pytest.warns(pm.StabilityWarning):
        coupler = pm.Coupler([slow, fast], dt=1.0, coupling="gc")
    found = coupler.growth(200)
    np.testing.assert_allclose(found.factor, np.exp(2.0 * np.arccosh(Omega / 2.0)), rtol=1e-12)
    assert found.subdomain == "fast" and found.grows and found.steps == 200
    assert repr(found) == (
        f"the motion grows by a factor of {1.0 + float(f'{found.factor - 1.0:.3g}'):.12g} in a "
        f"macro step, settled to {found.settled:.2g} after 200 of them, most in 'fast'"
    )


def test_what_keeps_its_energy_neither_grows_nor_decays():
    """The trapezoidal rule keeps it in all of four couplings, and schemes of rho < 1 take it."""
    for coupling in ("gc", "macro", "mean"):
        parts = [
            pm.Subdomain([1.0, 2.0], [[3.0, -1.0], [-1.0, 2.0]], scheme=pm.Newmark(), name=name)
            for name in "ab"
        ]
        found = pm.Coupler(parts, pm.tie("a", [0], "b", [1]), dt=0.3, coupling=coupling).growth(100)
        assert abs(found.factor - 1.0) < 1e-12 and not found.grows  # rounding of sums
    damped = pm.Subdomain([1.0], [9.0], scheme=pm.GeneralizedAlpha(0.5), name="a")
    coupler = pm.Coupler([damped], dt=0.5)
    radius = analysis.spectral_radius(analysis.amplification_matrix(coupler))
    found = coupler.growth(100)
    # a single pair of eigenvalues: energies of eight random phases of it beat
    np.testing.assert_allclose(found.factor, radius, rtol=0.0, atol=1e-3 + found.settled)
    assert radius < 0.98


def test_the_coupler_stays_bitwise_as_it_was_and_seeds_repeat():
    one, other = (circulatory(3, "gc") for _ in range(2))
    for coupler in (one, other):
        coupler.step(3)
    first = one.growth(64, seed=5)
    assert repr(first) == repr(one.growth(64, seed=5)) != repr(one.growth(64, seed=6))
    for name in "ab":
        for x in "uva":
            a, b = (getattr(coupler.state(name), x) for coupler in (one, other))
            assert np.array_equal(a, b)
    x, y = (coupler.run(steps=4)["a"].u for coupler in (one, other))
    assert np.array_equal(x, y) and one.step_count == 7


@pytest.mark.parametrize(
    ("forces", "words"),
    [
        ({"restoring": lambda *x: [0.0]}, "a restoring force on 'mass'"),
        ({"restoring": pm.CubicSpring([0], k=1.0, k3=0.0)}, "a restoring force on 'mass'"),
        ({"internal": pm.CubicSpring([0], k=1.0, k3=0.0)}, "an internal force on 'mass'"),
        ({"force": lambda t, u, v: [0.0]}, "a function of t, u and v on 'mass'"),
    ],
)
def test_what_is_not_linear_is_refused_by_name(forces, words):
    mass = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="mass", **forces)
    with pytest.raises(ValueError, match=f"^growth needs .*{words}"):
        pm.Coupler([mass], dt=0.1).growth()


def test_contacts_and_wrong_numbers_are_refused_by_name():
    mass = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="mass")
    coupler = pm.Coupler([mass], pm.contact(mass, [0], gap=1.0), dt=0.1, coupling="gc")
    with pytest.raises(ValueError, match="^growth needs a Coupler without contacts"):
        coupler.growth()
    free = pm.Coupler([mass], dt=0.1)
    for arguments, words in (({"steps": 15}, "steps"), ({"seed": -1}, "seed")):
        with pytest.raises(ValueError, match=f"^{words} must be"):
            free.growth(**arguments)


# ---- what set-up says ----------------------------------------------------------------------------


def chain(n, scheme, substeps, skew=0.0, damping=None, name="soil"):
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K += skew * (np.eye(n, k=1) - np.eye(n, k=-1))
    C = None if damping is None else np.full(n, damping)
    return pm.Subdomain(
        np.ones(n), K, C=C, scheme=scheme, substeps=substeps, symmetric=not skew, name=name
    )


RHO, UNDAMPED = pm.GeneralizedAlpha(0.8), pm.CentralDifference()


@pytest.mark.parametrize("coupling", ["macro", "mean"])
@pytest.mark.parametrize(
    ("scheme", "substeps", "options", "told"),
    [
        (UNDAMPED, 10, {}, True),
        (UNDAMPED, 3, {}, True),
        (UNDAMPED, 2, {}, False),
        (UNDAMPED, 3, {"damping": 0.1}, False),
        (pm.Newmark(), 6, {}, True),
        (pm.Newmark(), 5, {}, False),
    ],
)
@pytest.mark.filterwarnings("ignore:coupling=.mean. grows with damping:pmalpha.StabilityWarning")
def test_an_unsymmetric_k_in_a_large_coupler_is_told_of_where_it_can_grow(
    coupling, scheme, substeps, options, told, recwarn
):
    layer = chain(60, pm.Newmark(), 1, skew=0.01, damping=0.5, name="layer")
    soil = chain(60, scheme, substeps, **options)
    pm.Coupler([soil, layer], pm.tie(soil, [59], layer, [0]), dt=0.2, coupling=coupling)
    found = [str(x.message) for x in recwarn]
    assert any("coupler.growth()" in x and 'coupling="gc"' in x for x in found) == told, found


def test_what_is_not_tied_to_it_and_gc_are_not_told_of():
    """Warnings are errors here. Three steps 1 : 2 : 24, the finest one beside the middle one."""
    layer = chain(60, RHO, 1, skew=0.01, damping=0.5, name="layer")
    soil, footing = chain(60, RHO, 2), chain(60, RHO, 24, name="footing")
    ties = [pm.tie(soil, [59], layer, [0]), pm.tie(soil, [0], footing, [3])]
    pm.Coupler([soil, layer, footing], ties, dt=0.2, coupling="macro")
    soil = chain(60, UNDAMPED, 10)
    pm.Coupler([soil, layer], pm.tie(soil, [59], layer, [0]), dt=0.2, coupling="gc")


@pytest.mark.parametrize(("coupling", "cure"), [("pm", 'coupling="gc" or '), ("gc", "")])
def test_circulatory_forces_above_what_damping_takes_are_told_of_in_large_couplers(coupling, cure):
    """Skew part of a row over c sqrt(k / m): 0.2 / (c sqrt 2), 14 and 7. Explicit meets implicit at
    equal steps; a scheme that both have grows no otherwise than the whole structure does."""

    def couple(c, scheme=UNDAMPED):
        disc = chain(90, RHO, 1, skew=0.1, damping=c, name="disc")
        pads = chain(90, scheme, 1, damping=c, name="pads")
        return pm.Coupler([disc, pads], pm.tie(disc, [89], pads, [0]), dt=0.2, coupling=coupling)

    told = f"'pads' is tied to 'disc', .* is 14.1 times .* coupler.growth.., and take {cure}smaller"
    with pytest.warns(pm.StabilityWarning, match=told):
        couple(0.01)
    couple(0.02)  # warnings are errors here
    if coupling == "gc":
        couple(0.01, RHO)


def test_circulatory_forces_of_small_couplers_are_judged_by_their_spectral_radius():
    """Up to 300 numbers of a state, where K is unsymmetric; here 240 and 14 times the damping."""
    disc = chain(20, RHO, 1, skew=0.1, damping=0.01, name="disc")
    pads = chain(40, UNDAMPED, 1, damping=0.01, name="pads")
    tie = pm.tie(disc, [19], pads, [0])
    coupler = pm.Coupler([disc, pads], tie, dt=0.2, coupling="gc")
    radius = analysis.spectral_radius(analysis.amplification_matrix(coupler))
    assert radius <= 1.0 + 1e-7  # that of the gap, of modulus 1, and rounding
