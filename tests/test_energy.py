"""Energy balance: compared with (B1) to (B4) on a fully recorded run, and with closed forms."""

import warnings

import numpy as np
import pytest
from agreement import assert_close, assert_identical, largest
from reference_problems import random_problem

import pmalpha as pm
from pmalpha import models

KINDS = ("kinetic", "strain", "dissipated", "external", "interface")


def chain(n, k=100.0):
    return np.ones(n), 2.0 * k * np.eye(n) - k * np.eye(n, k=1) - k * np.eye(n, k=-1)


# ---- the formulas, once more in NumPy -------------------------------------------------------


def forces_at_time_levels(s, L, history, x):
    """F, C v and L^T Lam at the time levels of a subdomain, (time levels, n) each."""
    ratio = (len(history.multiplier_times) - 1) // max(len(x.t) - 1, 1)
    lam = history.multipliers[::ratio]
    n = x.u.shape[1]
    C = np.zeros((n, n)) if s.C is None else s.C
    force = s.reference_force or (lambda t: np.zeros(n))
    return np.array([force(t) for t in x.t]), x.v @ C, lam @ L


def expected_energies(problem, doubles, history, begin=0):
    """(B1) to (B3) by kind, (macro steps + 1, subdomains); the run began at macro step `begin`.

    Where that is later than the start, a chain of double steps begins with (B14).
    """
    columns = {kind: [] for kind in KINDS}
    for s, L, double, x in zip(problem.subdomains, problem.L, doubles, history.subdomains):
        F, damping, pull = forces_at_time_levels(s, L, history, x)
        works = np.zeros((len(x.t), 3))
        stored = np.einsum("ki,ij,kj->k", x.v, s.M, x.v) / 2.0
        stored += np.einsum("ki,ij,kj->k", x.u, s.K, x.u) / 2.0
        for level in range(1, len(x.t)):
            single = not double or begin * s.substeps + level <= s.substeps
            origin = level - 1 if single or level == 1 else level - 2
            du = x.u[level] - x.u[origin]
            dW = [du @ (q[origin] + q[level]) / 2.0 for q in (damping, F, pull)]
            works[level] = works[origin] + dW
            if level == 1 and not single and not s.scheme.explicit:
                works[1, 2] = stored[1] - stored[0] + works[1, 0] - works[1, 1]
        macro = slice(None, None, s.substeps)
        columns["kinetic"].append(np.einsum("ki,ij,kj->k", x.v, s.M, x.v)[macro] / 2.0)
        columns["strain"].append(np.einsum("ki,ij,kj->k", x.u, s.K, x.u)[macro] / 2.0)
        for kind, column in zip(KINDS[2:], works[macro].T):
            columns[kind].append(column)
    return {kind: np.array(x).T for kind, x in columns.items()}


def require_energies(energy, expected, tolerance=1e-11):
    # sums of some 100 products of some 10 terms, in another order: 1e-13 of the largest of all
    size, at = largest(*expected.values()), {"times": energy.t, "column": "subdomain"}
    for kind in KINDS:
        what = f"{kind} energy or work"
        assert_close(getattr(energy, kind), expected[kind], tolerance, what, size=size, **at)
    stored = expected["kinetic"] + expected["strain"]
    balance = stored - stored[0] + expected["dissipated"]
    balance -= expected["external"] + expected["interface"]
    what = "balance, of energies and works that agree,"
    assert_close(energy.balance, balance, 5.0 * tolerance, what, size=size, **at)


def doubles_of(coupler):
    return [part.double for part in coupler._session.members]


@pytest.mark.parametrize("seed", range(16))
def test_the_energies_are_those_of_the_formulas_on_what_was_recorded(seed):
    problem = random_problem(seed)
    coupler = problem.coupler()
    history = coupler.run(steps=9, energy=True)
    np.testing.assert_array_equal(history.energy.t, history.macro_times)
    require_energies(history.energy, expected_energies(problem, doubles_of(coupler), history))


@pytest.mark.parametrize("seed", range(60, 64))
def test_an_interval_sums_up_from_its_first_time_level(seed):
    problem = random_problem(seed)
    coupler = problem.coupler()
    coupler.step(3)
    history = coupler.run(steps=6, energy=True)
    expected = expected_energies(problem, doubles_of(coupler), history, begin=3)
    require_energies(history.energy, expected)
    for kind in KINDS[2:]:
        assert not getattr(history.energy, kind)[0].any()
    assert not history.energy.balance[0].any()


def test_the_work_of_a_restoring_force_under_macro_coupling_is_that_at_its_time_levels():
    seen = []

    def restoring(t, u, v):
        seen.append(0.3 * u)
        return 0.3 * u

    options = {"scheme": pm.Newmark(), "restoring": restoring, "restoring_stiffness": [0.3, 0.3]}
    K = np.array([[3.0, -1.0], [-1.0, 3.0]])
    a = pm.Subdomain([1.0, 1.0], K, scheme=pm.GeneralizedAlpha(0.8), u0=[1.0, 0.0], name="a")
    b = pm.Subdomain([1.0, 1.0], K, substeps=4, v0=[0.0, 1.0], name="b", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # required for a restoring force under macro coupling
        coupler = pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=0.1, coupling="macro")
    history = coupler.run(steps=6, energy=True)
    u, r = history["b"].u, np.array(seen)
    dW = np.sum(np.diff(u, axis=0) * (r[1:] + r[:-1]) / 2.0, axis=1)
    expected = np.append(0.0, np.cumsum(dW))[::4]
    # 24 sums of numbers below 1
    np.testing.assert_allclose(history.energy.dissipated[:, 1], expected, atol=1e-14)
    assert np.abs(expected).max() > 0.01


@pytest.mark.gate
def test_the_problems_have_works_of_every_kind_and_double_steps_with_substeps():
    # so the comparisons above cover all kinds
    seen = set()
    for seed in range(16):
        problem = random_problem(seed)
        for s, double in zip(problem.subdomains, doubles_of(problem.coupler())):
            seen |= {("double", double, s.substeps > 1), ("coupling", problem.coupling, double)}
            seen |= {("damped", s.C is not None), ("loaded", s.force is not None)}
    assert {("double", True, True), ("double", True, False), ("coupling", "gc", False)} <= seen
    assert {("damped", True), ("loaded", True)} <= seen


# ---- what is known of a method ---------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_the_balance_of_the_trapezoidal_rule_uncoupled_closes_to_rounding(damping):
    n = 12
    M, K = chain(n)
    rng = np.random.default_rng(1)
    start = {"u0": rng.normal(size=n), "v0": rng.normal(size=n)}
    force = {"force": lambda t: np.sin(7.0 * t) * np.ones(n)}
    s = pm.Subdomain(M, K, C=damping * K, scheme=pm.Newmark(), **start, **force)
    energy = pm.Coupler([s], dt=0.05).run(steps=500, energy=True).energy
    size = energy.kinetic[0, 0] + energy.strain[0, 0]
    assert energy.external[-1, 0] > 1e-3 * size
    assert (np.diff(energy.dissipated[:, 0]) > 0.0).all() == (damping > 0.0)
    # 500 steps of some 100 roundings
    np.testing.assert_allclose(energy.balance, 0.0, atol=1e-12 * size)
    assert not energy.interface.any()


def test_the_balance_of_a_damping_scheme_is_the_energy_it_removes():
    # M w1 + K u1 = 0 with rho = 0 on one mode: its energy falls by the balance
    s = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.0), u0=[1.0])
    energy = pm.Coupler([s], dt=0.3).run(steps=50, energy=True).energy
    stored = energy.kinetic[:, 0] + energy.strain[:, 0]
    np.testing.assert_array_equal(energy.balance[:, 0], stored - stored[0])
    assert energy.balance[-1, 0] < -0.9 * stored[0]


def pair_of_chains(coupling, substeps, scheme):
    M, K = chain(5)
    u0 = np.sin(np.arange(5))
    u0[-1] = 0.0
    a = pm.Subdomain(M, K, scheme=scheme, u0=u0, name="a")
    b = pm.Subdomain(M, 3.0 * K, scheme=scheme, substeps=substeps, name="b")
    return pm.Coupler([a, b], pm.tie(a, [4], b, [0]), dt=0.08, coupling=coupling)


def test_the_energy_that_gc_removes_is_the_work_at_the_interface():
    # Gravouil and Combescure: with trapezoidal subdomains the only loss is the work at the
    # interface, and none without subcycling. It is an energy of velocities and accelerations that
    # never grows; that of displacements and velocities falls over the run, not in every step.
    history = pair_of_chains("gc", 4, pm.Newmark()).run(steps=200, energy=True)
    energy = history.energy
    stored = (energy.kinetic + energy.strain).sum(axis=1)
    np.testing.assert_allclose(energy.balance, 0.0, atol=1e-12 * stored[0])
    lost = energy.interface.sum(axis=1)
    np.testing.assert_allclose(stored - stored[0], lost, atol=1e-12 * stored[0])
    assert lost[-1] < -0.3 * stored[0]
    together = pair_of_chains("gc", 1, pm.Newmark()).run(steps=200, energy=True).energy
    np.testing.assert_allclose(together.interface.sum(axis=1), 0.0, atol=1e-12 * stored[0])
    assert (
        np.abs(together.interface).max() > 0.1 * stored[0]
    )  # equal and opposite in the two subdomains


def test_the_work_of_a_prescribed_motion_is_that_of_its_force():
    # a mass of 2 driven at v = sin t: E = v^2, all of it the work of the multiplier
    s = pm.Subdomain([2.0], [0.0], scheme=pm.Newmark())
    drive = pm.Constraint({s: [[1.0]]}, velocity=lambda t: [np.sin(t)])
    energy = pm.Coupler([s], drive, dt=0.01).run(steps=300, energy=True).energy
    np.testing.assert_allclose(energy.interface, energy.kinetic, atol=1e-13)
    np.testing.assert_allclose(energy.kinetic[:, 0], np.sin(energy.t) ** 2, atol=1e-14)


def test_the_dissipation_of_a_damped_oscillator_is_the_loss_of_a_closed_form():
    # u = exp(-d t) cos-like: E(t) of the exact solution, order 2 in the step
    m, c, k = 1.0, 0.4, 9.0
    s = pm.Subdomain([m], [k], C=[c], scheme=pm.Newmark(), u0=[1.0])
    energy = pm.Coupler([s], dt=0.002).run(2.0, energy=True).energy
    d, w = c / (2.0 * m), np.sqrt(k / m - (c / (2.0 * m)) ** 2)
    t = energy.t
    u = np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t))
    v = -np.exp(-d * t) * (w + d**2 / w) * np.sin(w * t)
    stored = 0.5 * m * v**2 + 0.5 * k * u**2
    # error of the phase: (omega h)^2 / 12 of omega t = 2e-5, times an energy of 4.5 that beats
    np.testing.assert_allclose(energy.dissipated[:, 0], stored[0] - stored, atol=1e-4)


def test_the_work_of_a_restoring_force_is_counted_with_that_of_the_dampers():
    # K u given as r is evaluated at the predictor; its work over the substeps by (B2)
    seen = []

    def restoring(t, u, v):
        seen.append(9.0 * u[0])
        return 9.0 * u

    options = {"scheme": pm.CentralDifference(), "u0": [1.0], "restoring": restoring}
    s = pm.Subdomain([1.0], None, C=[0.1], substeps=3, **options)
    history = pm.Coupler([s], dt=0.06).run(steps=20, energy=True)
    u, v, r = history[0].u[:, 0], history[0].v[:, 0], np.array(seen)
    q = 0.1 * v + r
    expected = np.cumsum(np.append(0.0, np.diff(u) * (q[1:] + q[:-1]) / 2.0))[::3]
    # 60 sums of numbers up to 10
    np.testing.assert_allclose(history.energy.dissipated[:, 0], expected, atol=1e-13)
    assert not history.energy.strain.any()


# ---- what it may not do ----------------------------------------------------------------------


def test_the_energy_with_every_is_that_without_at_the_same_time_levels():
    coupler, other = (models.four_dof().coupler(0.05, coupling="pm") for _ in range(2))
    for c in (coupler, other):
        c.step(2)
    whole = coupler.run(steps=20, energy=True).energy
    some = other.run(steps=20, energy=True, every=5, record={}).energy
    at = np.flatnonzero(np.isin(whole.t, some.t))
    assert at.tolist() == [0, 3, 8, 13, 18]
    for name in (*KINDS, "balance"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[at])


def test_a_run_without_it_has_none():
    coupler = models.four_dof().coupler(0.05, coupling="pm")
    coupler.run(steps=3, energy=True)
    assert not coupler.run(steps=3).energy
    assert not coupler.run(steps=3, energy=False).energy
    with pytest.raises(TypeError, match="energy must be True or False, got 1"):
        coupler.run(steps=3, energy=1)
    assert coupler.step_count == 9


def test_a_callable_load_is_evaluated_no_more_often():
    times = {False: [], True: []}

    def run(energy):
        def force(t):
            times[energy].append(t)
            return [np.sin(t)]

        a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), force=force, name="a")
        b = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), substeps=3, name="b")
        c = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.05, coupling="pm")
        for _ in range(3):
            c.run(steps=4, energy=energy)

    run(False)
    run(True)
    assert times[True] == times[False] and len(times[True]) == 13


def test_the_first_load_of_a_resumed_run_is_evaluated(tmp_path):
    # after `load` it has not been evaluated in this process
    def coupler():
        s = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), force=lambda t: [np.sin(t)])
        return pm.Coupler([s], dt=0.05)

    c, resumed = coupler(), coupler()
    c.step(4)
    c.save(tmp_path / "state")
    resumed.load(tmp_path / "state")
    ours, theirs = (x.run(steps=5, energy=True).energy for x in (resumed, c))
    assert ours.external.tobytes() == theirs.external.tobytes() and ours.external.any()


def test_an_interrupted_run_has_the_energy_up_to_the_interruption():
    def force(t):
        if t > 0.33:
            raise ZeroDivisionError
        return [np.sin(t)]

    def coupler(force):
        s = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), u0=[1.0], force=force)
        return pm.Coupler([s], dt=0.05)

    broken, other = coupler(force), coupler(lambda t: [np.sin(t)])
    with pytest.raises(ZeroDivisionError):
        broken.run(steps=20, energy=True)
    assert_identical(broken.last_history, other.run(steps=6, energy=True))


# ---- files ----------------------------------------------------------------------------------


def test_the_energy_is_kept_with_the_history(tmp_path):
    history = models.four_dof().coupler(0.05, coupling="pm").run(steps=7, energy=True)
    history.save(tmp_path / "h.npz")
    assert_identical(pm.History.load(tmp_path / "h.npz"), history)
    models.four_dof().coupler(0.05, coupling="pm").run(steps=7).save(tmp_path / "without.npz")
    assert not pm.History.load(tmp_path / "without.npz").energy


def test_a_dataset_has_the_energy_with_names():
    pytest.importorskip("xarray")
    history = models.four_dof().coupler(0.05, coupling="pm").run(steps=7, energy=True)
    data = history.to_xarray()
    assert data["energy_balance"].dims == ("macro_times", "subdomain")
    np.testing.assert_array_equal(
        data["energy_strain"].sel(subdomain="B"), history.energy.strain[:, 1]
    )
