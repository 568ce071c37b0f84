"""The table of docs/couplings.md: orders, errors, energies, drift and spectra of every coupling."""

from typing import get_args

import numpy as np
import pytest
from coupled_problems import loop, mean_problems, radius
from scipy.integrate import solve_ivp

import pmalpha as pm
from pmalpha import analysis, models
from pmalpha.problem.arguments import Coupling

COUPLINGS = ("pm", "gc", "macro", "mean")
SINGLE = pytest.mark.parametrize("name", COUPLINGS)


def errors(dt, name, substeps=20):
    """Largest errors of the split oscillator in u, v and the multipliers, over four periods."""
    oscillator = models.split_oscillator(10.0, substeps=substeps, v0=1.0)
    history = oscillator.coupler(dt, coupling=name).run(4.0)
    a, omega = history["A"], 2.0 * np.pi
    u = np.cos(omega * a.t) + np.sin(omega * a.t) / omega
    v = -omega * np.sin(omega * a.t) + np.cos(omega * a.t)
    s = history.keys[0][1]
    lam = history.multipliers[:: (history.multiplier_times.size - 1) // (a.t.size - 1), 0]
    force = (s.K[0] - s.M[0] * omega**2) * u
    if name == "mean":  # means of neighbours belong to the levels between them
        lam, force = 0.5 * (lam[2:] + lam[1:-1]), force[1:-1]
    return [np.max(np.abs(x)) for x in (a.u[:, 0] - u, a.v[:, 0] - v, lam - force)]


@SINGLE
def test_the_order_with_substeps(name):
    """Between 320 and 640 macro steps a period; of order 1: 1.0 to 1.3, still falling."""
    orders = np.log2(np.divide(errors(1 / 320, name), errors(1 / 640, name)))
    if name in ("macro", "mean"):
        assert np.all(np.abs(orders - 2.0) < 0.15)
    else:
        assert 0.9 < orders[1] < 1.3


def test_errors_relative_to_those_of_macro_coupling():
    """The second row: of v at 20, 80 and 160 macro steps a period, s = 20."""
    found = {name: [errors(1 / n, name)[1] for n in (20, 80, 160)] for name in COUPLINGS}
    ratios = {name: np.divide(found[name], found["macro"]) for name in found}
    assert np.allclose(ratios["pm"], [6.6, 9.7, 15], rtol=0.05)
    assert np.allclose(ratios["gc"], [2.7, 7.4, 15], rtol=0.05)
    assert np.allclose(ratios["mean"], [0.31, 0.28, 0.28], rtol=0.05)


@SINGLE
def test_the_third_mode_of_figure_7_decays_and_the_drift(name):
    """Decay per macro step: that of the scheme, with h or 2 h. Amplitudes are of order one."""
    chain = models.four_dof(0.5)
    history = chain.coupler(chain.macro_step, coupling=name).run(steps=100)
    amplitudes = chain.modal_amplitudes(history)[1]
    seen = (amplitudes[60, 2] / amplitudes[0, 2]) ** (1 / 60)
    expected = {"pm": 0.943, "gc": 0.973, "macro": 0.973, "mean": 0.973}[name]
    assert abs(seen - expected) < 0.003
    assert abs(amplitudes[100, 0] / amplitudes[0, 0] - 1.0) < 0.05
    drift = np.max(np.abs(history.displacement_jump))
    expected = {"pm": 0.021, "gc": 0.0055, "macro": 0.0068}.get(name)
    assert drift < 1e-14 if expected is None else abs(drift / expected - 1.0) < 0.05


@SINGLE
def test_energy_of_an_undamped_structure_with_substeps(name):
    """Trapezoidal rule, 5 substeps on one side: what 2000 macro steps leave."""
    K = np.array([[30.0, -20.0], [-20.0, 23.6]]), np.array([[405.4, -400.0], [-400.0, 400.0]])
    scheme = pm.Newmark()
    a = pm.Subdomain([1.0, 0.7], K[0], scheme=scheme, v0=[1.0, 0.0], name="a")
    b = pm.Subdomain([0.3, 0.5], K[1], scheme=scheme, substeps=5, name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, 1, b, 0), dt=0.1, coupling=name)
    history = coupler.run(steps=2000, energy=True)
    energy = (history.energy.kinetic + history.energy.strain).sum(axis=1)
    left = energy[-200:].mean() / energy[0]
    if name == "mean":
        assert np.max(np.abs(energy / energy[0] - 1.0)) < 1e-11
    elif name == "macro":
        assert 0.95 < left < 1.05
        conserved = history.energy.conserved.sum(axis=1)
        assert np.max(np.abs(conserved / conserved[0] - 1.0)) < 1e-11
    else:
        assert left < 0.5


@pytest.mark.parametrize(
    ("name", "double"), [*((x, False) for x in COUPLINGS), ("macro", True), ("mean", True)]
)
def test_spectra_are_those_of_a_stable_step(name, double):
    """1e-7: double eigenvalues of modulus one; 0.5, 20 substeps, far from and near the limit."""
    for b1 in (0.1, 10.0):
        for share in (0.1, 0.9):
            oscillator = models.split_oscillator(b1, substeps=5)
            a, b = oscillator.subdomains
            limit = 5 * analysis.critical_step(b)
            a = pm.Subdomain(a.M, a.K, scheme=a.scheme, double_step=double or None, name="A")
            b = pm.Subdomain(b.M, b.K, scheme=b.scheme, substeps=5, name="B")
            coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=share * limit, coupling=name)
            values = np.linalg.eigvals(analysis.amplification_matrix(coupler))
            assert np.max(np.abs(values)) < 1.0 + 1e-7
            drifting = np.min(np.abs(values - 1.0)) < 1e-7
            assert drifting == (name in ("pm", "gc", "macro"))  # the eigenvalue 1 is the drift


@SINGLE
def test_the_error_after_a_load_has_jumped(name):
    """Static displacement 1, s = 10."""
    a, b = models.split_oscillator(1.0, substeps=10, u0=0.0).subdomains
    b = pm.Subdomain(
        b.M,
        b.K,
        scheme=b.scheme,
        substeps=10,
        name="B",
        force=lambda t: np.array([4.0 * np.pi**2 if t > 0.5 else 0.0]),
    )
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=1 / 40, coupling=name)
    x = coupler.run(1.2)["A"]
    exact = np.where(x.t > 0.5, 1.0 - np.cos(2.0 * np.pi * (x.t - 0.5)), 0.0)
    error = np.max(np.abs(x.u[:, 0] - exact))
    expected = {"pm": 0.049, "gc": 0.029, "macro": 0.013, "mean": 0.014}
    assert abs(error / expected[name] - 1.0) < 0.05


@pytest.mark.parametrize("double", [False, True])
def test_mean_coupling_is_stable_for_random_oscillators(double):
    """1e-8: eigenvalues of modulus one that are double or nearly so; the whole scan is
    benchmarks/surveys/coupling_radii.py, 2400 problems."""
    assert max(map(radius, mean_problems(7 + double, 8, double))) < 1.0 + 1e-8


@pytest.mark.parametrize("rho", [0.5, 1.0])
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("explicit", [False, True])
def test_mean_coupling_is_stable_for_random_loops(rho, double, explicit):
    schemes = [pm.GeneralizedAlpha(rho)] * 2 + [pm.GeneralizedAlpha(rho, explicit=explicit)]
    radii = [radius(loop(k, schemes, double, False, coupling="mean")) for k in range(4)]
    assert max(radii) < 1.0 + 1e-7


def undamped(coupling):
    """Two masses on the ground, tied to two that vibrate at 46 rad/s against each other."""
    K = np.array([[30.0, -20.0], [-20.0, 23.6]]), np.array([[405.4, -400.0], [-400.0, 400.0]])
    a = pm.Subdomain([1.0, 0.7], K[0], scheme=pm.Newmark(), u0=[0.3, 1.0], name="a")
    b = pm.Subdomain(
        [0.3, 0.5], K[1], scheme=pm.CentralDifference(), substeps=8, u0=[1.0, 1.0], name="b"
    )
    return pm.Coupler([a, b], pm.tie(a, 1, b, 0), dt=0.2, coupling=coupling)


@SINGLE
def test_the_energy_that_is_left_after_20_000_macro_steps(name):
    """Central difference conserves its own discrete energy: (omega h)^2 / 4 is 0.3."""
    energy = undamped(name).run(steps=20_000, every=100, record={}, energy=True).energy
    total = (energy.kinetic + energy.strain).sum(axis=1) / (energy.kinetic + energy.strain)[0].sum()
    if name == "mean":
        assert total.min() > 0.99 and total.max() < 1.0 + 1e-9
    elif name == "macro":
        assert 0.95 < total[-10:].mean() < 1.1
    else:
        assert total[-10:].mean() < 0.1


@pytest.mark.parametrize("product", [2.0, 4.0, 8.0])
def test_a_stiff_restoring_force_does_not_make_it_grow(product):
    """omega dt = 4 grows by more than 10 under macro coupling, K_r = 0 and s = 20."""
    k = 0.5 * product**2
    a = pm.Subdomain([0.5], [k], scheme=pm.GeneralizedAlpha(0.5), u0=[1.0], name="a")
    b = pm.Subdomain(
        [0.5],
        None,
        scheme=pm.GeneralizedAlpha(0.5, explicit=True),
        substeps=20,
        u0=[1.0],
        restoring=lambda t, u, v: k * u,
        name="b",
    )
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=1.0, coupling="gc")
    x = coupler.run(steps=60, every=1)["b"]
    size = np.abs(x.u[:, 0]) + np.abs(x.v[:, 0]) / product
    assert size[-15:].max() < size[:30].max()


@pytest.mark.parametrize("substeps", [1, 5])
def test_soft_restoring_forces_keep_the_order(substeps):
    """A Duffing oscillator cut in two, its cubic spring in B: 2, and 1 with substeps."""
    exact = solve_ivp(
        lambda t, y: [y[1], -4.0 * y[0] - 3.0 * y[0] ** 3],
        (0.0, 2.0),
        [1.0, 0.0],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
    ).y[1, -1]
    found = []
    for n in (200, 400):
        a = pm.Subdomain([0.6], [3.0], scheme=pm.GeneralizedAlpha(0.5), u0=[1.0], name="a")
        b = pm.Subdomain(
            [0.4],
            [1.0],
            scheme=pm.GeneralizedAlpha(0.5, explicit=True),
            substeps=substeps,
            restoring=pm.CubicSpring([0], k=0.0, k3=3.0),
            u0=[1.0],
            name="b",
        )
        coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=2.0 / n, coupling="gc")
        found.append(abs(coupler.run(2.0)["a"].v[-1, 0] - exact))
    assert abs(np.log2(found[0] / found[1]) - (2.0 if substeps == 1 else 1.0)) < 0.25


def test_a_coupling_is_required_with_more_than_one_subdomain():
    a, b = (pm.Subdomain([1.0], [1.0], scheme=pm.Newmark()) for _ in range(2))
    with pytest.raises(TypeError, match="coupling must be given for 2 subdomains") as refused:
        pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1)
    first, *lines = str(refused.value).splitlines()
    named = [line.split()[0].strip("'") for line in lines]  # a line each
    assert named == list(get_args(Coupling))
    assert "2 subdomains" in first
    with pytest.raises(TypeError, match="coupling must be given for 2 subdomains"):
        pm.models.split_oscillator(1.0).coupler(0.1)


def test_one_subdomain_needs_no_coupling_and_takes_single_steps_under_all():
    mass = pm.Subdomain([1.0], [4.0], u0=[1.0], scheme=pm.Newmark())
    alone = pm.Coupler([mass], dt=0.1).run(steps=20)[0].u
    for coupling in get_args(Coupling):
        named = pm.Coupler([mass], dt=0.1, coupling=coupling).run(steps=20)[0].u
        np.testing.assert_allclose(named, alone, atol=1e-13)  # rounding of 20 steps


def test_an_argument_of_an_earlier_version_is_refused_by_what_replaces_it():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark())
    with pytest.raises(TypeError, match='drift is gone since version 0.4; take coupling="mean"'):
        pm.Coupler([a], dt=0.1, drift="removed")
