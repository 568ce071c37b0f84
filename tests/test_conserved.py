"""What the couplings conserve exactly, (M9) of docs/method.md: `history.energy.conserved`."""

import h5py
import numpy as np
import pytest
from agreement import assert_close, assert_constant

import pmalpha as pm

# The rounding of a thousand macro steps, of terms up to 1e2 times the sum.
EXACT = 1e-11


def conserved(coupler, history):
    """E* at the macro time levels, from the recorded motion."""
    shares = []
    for s in coupler.subdomains:
        x, h = history[s.name], coupler.dt / s.substeps
        w, v = x.a[:: s.substeps], x.v[:: s.substeps]
        inertia = np.diag(s.M) + h**2 * (s.scheme.beta - 0.25) * s.K
        shares.append(0.5 * np.sum(w * (w @ inertia) + v * (v @ s.K), axis=1))
    return np.transpose(shares)


def random_loop(substeps, schemes, coupling, **options):
    rng = np.random.default_rng(11)
    subdomains = []
    for i, (s, scheme) in enumerate(zip(substeps, schemes)):
        A = rng.normal(size=(4, 4))
        v0 = rng.normal(size=4)
        v0[[0, 3]] = 0.0
        M, K = rng.uniform(0.5, 2.0, 4), 3.0 * A @ A.T + np.eye(4)
        subdomains.append(
            pm.Subdomain(M, K, scheme=scheme, substeps=s, v0=v0, name=str(i), **options)
        )
    a, b, c = subdomains
    ties = [pm.tie(a, 3, b, 0), pm.tie(b, 3, c, 0), pm.tie(c, 3, a, 0)]
    return pm.Coupler(subdomains, ties, dt=0.2, coupling=coupling)


def assert_conserved(history):
    what = "conserved sum of all subdomains"
    assert_constant(history.energy.conserved.sum(axis=1), EXACT, what, times=history.energy.t)


TRAPEZOIDAL = [pm.Newmark()] * 3
MIXED = [pm.Newmark(), pm.Newmark(beta=0.3), pm.CentralDifference()]


@pytest.mark.parametrize(
    "substeps, schemes",
    [((1, 1, 1), TRAPEZOIDAL), ((1, 1, 1), MIXED), ((1, 3, 7), TRAPEZOIDAL), ((2, 3, 7), MIXED)],
)
def test_macro_coupling_conserves_it_to_rounding(substeps, schemes):
    coupler = random_loop(substeps, schemes, "macro")
    history = coupler.run(steps=1000, energy=True)
    recorded = history.energy.conserved
    assert recorded.shape == (1001, 3)
    assert_conserved(history)
    shares, at = conserved(coupler, history), {"times": history.energy.t, "column": "subdomain"}
    assert_close(recorded, shares, 1e-12, "conserved share", size=np.max(shares), **at)
    if substeps == (1, 1, 1) and schemes is TRAPEZOIDAL:
        return  # then it is the energy of one trapezoidal rule
    # the energy itself is not conserved: it oscillates about its beginning
    total = (history.energy.kinetic + history.energy.strain).sum(axis=1)
    assert np.max(np.abs(total / total[0] - 1.0)) > 1e-4


@pytest.mark.parametrize("coupling", ["pm", "gc"])
def test_equal_substeps_conserve_it_without_macro_coupling(coupling):
    # under "pm" an implicit subdomain would take double steps
    schemes = [pm.CentralDifference()] * 3 if coupling == "pm" else MIXED
    history = random_loop((2, 2, 2), schemes, coupling).run(steps=300, energy=True)
    assert_conserved(history)


def loss_at_the_interface(coupler, history):
    """(A15) of each macro step, from the recorded multipliers; each loop row ties dof 3 and 0."""
    p = len(coupler.subdomains)
    fine = max(s.substeps for s in coupler.subdomains)
    total = np.zeros(history.energy.t.size - 1)
    for i, s in enumerate(coupler.subdomains):
        L = np.zeros((p, 4))
        L[i, 3], L[i - 1, 0] = 1.0, -1.0
        al1, al2 = s.scheme.coefficients(coupler.dt / s.substeps)
        inertia = np.diag(s.M) + (0.0 if s.scheme.explicit else al1) * s.K
        H = al2 * L @ np.linalg.solve(inertia, L.T)
        change = np.diff(history.multipliers, axis=0).reshape(len(total), s.substeps, -1, p)
        beyond = change - change.mean(axis=2, keepdims=True)
        total += np.einsum("nkqp,pr,nkqr->n", beyond, H, beyond) * fine / coupler.dt
    return total


@pytest.mark.parametrize(
    ("coupling", "schemes", "substeps"),
    [
        ("gc", TRAPEZOIDAL, (1, 5, 1)),
        ("gc", MIXED, (1, 2, 4)),
        ("pm", [pm.CentralDifference()] * 3, (3, 6, 2)),
    ],
)
def test_different_substeps_lose_what_the_interface_dissipates(coupling, schemes, substeps):
    coupler = random_loop(substeps, schemes, coupling)
    history = coupler.run(steps=200, energy=True)
    total = history.energy.conserved.sum(axis=1)
    lost = loss_at_the_interface(coupler, history)
    assert np.all(lost >= 0.0) and total[-1] < 0.5 * total[0]
    named = {"size": total[0], "times": history.energy.t[1:]}
    assert_close(-np.diff(total), lost, 1e-13, "loss of the macro step to this", **named)


def test_a_scheme_whose_two_accelerations_are_one_conserves_it():
    """rho = 1: a = w, and the explicit one is central difference seen at its predictor."""
    schemes = [pm.GeneralizedAlpha(1.0), pm.Newmark(), pm.GeneralizedAlpha(1.0, explicit=True)]
    history = random_loop((1, 3, 7), schemes, "macro").run(steps=300, energy=True)
    assert_conserved(history)


def test_under_mean_coupling_it_is_the_energy():
    history = random_loop((1, 3, 7), TRAPEZOIDAL, "mean").run(steps=300, energy=True)
    energy = history.energy
    assert np.array_equal(energy.conserved, energy.kinetic + energy.strain)
    assert_conserved(history)


def test_a_constant_load_does_not_change_it():
    coupler = random_loop((1, 3, 7), MIXED, "macro", force=[0.0, 1.0, 0.0, 3.0])
    assert_conserved(coupler.run(steps=300, energy=True))


@pytest.mark.parametrize("load", [np.array([0.0, 1.0, 0.0, 3.0]), "function"])
def test_under_mean_coupling_the_potential_of_a_constant_load_belongs_to_it(load):
    F = np.array([0.0, 1.0, 0.0, 3.0])
    force = (lambda t: F) if isinstance(load, str) else load
    coupler = random_loop((1, 3, 7), TRAPEZOIDAL, "mean", force=force)
    coupler.step(3)  # works begin at zero there, what is conserved does not
    energy = coupler.run(steps=300, energy=True).energy
    before = random_loop((1, 3, 7), TRAPEZOIDAL, "mean", force=force).run(steps=1, energy=True)
    total, stored = energy.conserved.sum(axis=1), (energy.kinetic + energy.strain).sum(axis=1)
    largest = np.max(stored)
    assert np.max(np.abs(total - before.energy.conserved[0].sum())) < EXACT * largest
    assert np.ptp(stored) > 0.1 * largest  # the load does work


def pull(t):
    return np.array([0.0, np.sin(t), 0.0, 0.0])


def test_other_loads_and_damping_change_it():
    for options in ({"force": pull}, {"C": 0.1 * np.ones(4)}):
        coupler = random_loop((1, 3, 7), TRAPEZOIDAL, "macro", **options)
        history = coupler.run(steps=100, energy=True)
        shares = conserved(coupler, history)
        assert np.max(np.abs(history.energy.conserved - shares)) < 1e-12 * np.max(shares)
        total = history.energy.conserved.sum(axis=1)
        assert np.max(np.abs(total / total[0] - 1.0)) > 1e-3


def test_it_changes_where_a_scheme_has_algorithmic_damping():
    """With what would be E*, so that the tests above are not empty; there is none then."""
    schemes = [pm.GeneralizedAlpha(0.8), pm.Newmark(), pm.Newmark()]
    coupler = random_loop((1, 3, 7), schemes, "macro")
    history = coupler.run(steps=300, energy=True)
    assert history.energy.conserved is None
    total = conserved(coupler, history).sum(axis=1)
    assert np.ptp(total) > 0.005 * total[0]


@pytest.mark.parametrize(
    ("coupling", "substeps", "schemes"),
    [
        ("pm", (1, 1, 1), TRAPEZOIDAL),
        ("mean", (1, 3, 7), MIXED),
        ("macro", (1, 3, 7), [pm.Newmark(gamma=0.6, beta=0.4)] * 3),
    ],
)
def test_there_is_none_where_nothing_is_conserved(coupling, substeps, schemes):
    coupler = random_loop(substeps, schemes, coupling)
    assert coupler.run(steps=3, energy=True).energy.conserved is None


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # of an undamped double step
def test_there_is_none_with_double_steps_and_forces():
    for options in ({"restoring": pm.CubicSpring([0], k=1.0, k3=1.0)}, {"double_step": True}):
        a = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="a", **options)
        b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="b")
        coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.2, coupling="macro")
        assert coupler.run(steps=3, energy=True).energy.conserved is None


@pytest.mark.parametrize("schemes", [TRAPEZOIDAL, [pm.GeneralizedAlpha(0.5)] * 3])
def test_files_and_datasets_have_it(tmp_path, schemes):
    def make():
        return random_loop((1, 3, 7), schemes, "macro")

    history = make().run(steps=20, every=4, energy=True)
    history.save(tmp_path / "a.npz")
    history.save(tmp_path / "a.h5")
    written = make().run(steps=20, every=4, energy=True, record_to=tmp_path / "b.h5")
    both = [pm.History.load(tmp_path / "a.npz"), pm.History.load(tmp_path / "a.h5"), written]
    dataset = history.to_xarray()
    if schemes is not TRAPEZOIDAL:
        assert all(other.energy.conserved is None for other in both)
        assert "energy_conserved" not in dataset
        return
    for other in both:
        assert np.array_equal(other.energy.conserved, history.energy.conserved)
    assert np.array_equal(dataset["energy_conserved"], history.energy.conserved)
    with h5py.File(tmp_path / "b.h5") as file:
        assert file["energy/conserved"].attrs["units"] == "F u / t^2; F u under mean coupling"
