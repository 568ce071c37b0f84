"""Impulses of averaged forces are kept, however the steps change.

For a free mass the velocity at the end is the integral of the force over its mass; of two masses
with a spring between them this holds for their momentum, since the spring's forces cancel. The
forces end long before the end of the runs: what algorithmic damping remembers is below rounding.
"""

import numpy as np
import pytest

import pmalpha as pm

SCHEMES = [
    pm.Newmark(),
    pm.Newmark(gamma=0.6, beta=0.31),  # of order 1
    pm.GeneralizedAlpha(0.0),
    pm.GeneralizedAlpha(0.8),
    pm.GeneralizedAlpha(0.5, explicit=True),
    pm.HHT(0.3),
    pm.WBZ(0.7),
]
# Of integrals of random forces of size 1 over less than 10 s.
ROUNDING = 1e-11


def record(rng, seconds, dt=None):
    """Random samples in a random interval, two series on one dof, zero at the end."""
    dt = rng.uniform(0.001, 0.03) if dt is None else dt
    values = np.zeros((int(seconds / dt) + 2, 2))
    begin, end = np.sort(rng.integers(0, len(values) - 1, 2))
    values[begin : end + 1] = rng.standard_normal((end + 1 - begin, 2))
    values[-1] = 0.0
    shape = rng.standard_normal((1, 2))
    force = pm.SampledForce(values, dt, shape, average=True)
    impulse = dt * (values.sum(axis=0) - 0.5 * values[0]) @ shape[0]
    return force, impulse


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_a_free_mass_has_the_impulse_after_any_changes_of_its_steps(scheme):
    rng = np.random.default_rng(11)
    for _ in range(3):
        force, impulse = record(rng, 1.2)
        mass = pm.Subdomain([2.0], [0.0], scheme=scheme, force=force, substeps=2)
        coupler = pm.Coupler([mass], dt=rng.uniform(0.01, 0.2))
        while coupler.time < 1.2:  # an interval may have no step at all
            coupler.step(int(rng.integers(0, 4)))
            coupler.change_steps(rng.uniform(0.01, 0.2), {0: int(rng.integers(1, 4))})
        coupler.run(steps=80)
        assert abs(2.0 * coupler.state(0).v[0] - impulse) < ROUNDING


@pytest.mark.parametrize("coupling, scheme", [("pm", SCHEMES[3]), ("macro", SCHEMES[2])])
def test_both_chains_of_double_steps_have_the_impulse(coupling, scheme):
    """From the first step on, and where double steps span a change or begin anew."""
    rng = np.random.default_rng(12)
    for case in range(8):
        force, impulse = record(rng, 1.0)
        mass = pm.Subdomain([2.0], [0.0], scheme=scheme, force=force, double_step=True, name="mass")
        other = pm.Subdomain([1.0], [1.0], scheme=scheme, double_step=False, substeps=2)
        fixed = pm.Constraint({other: [[1.0]]})
        dt = rng.uniform(0.02, 0.2)
        coupler = pm.Coupler([mass, other], fixed, dt=dt, coupling=coupling)
        for _ in range(case % 4):
            coupler.step(int(rng.integers(0, 5)))
            coupler.change_steps(rng.uniform(0.02, 0.2))
        coupler.run(steps=int(1.0 / 0.02) + 100)
        v = coupler.run(steps=2)["mass"].v[-2:, 0]
        np.testing.assert_allclose(2.0 * v, impulse, rtol=0, atol=ROUNDING)


def chain(force, **options):
    """A light and a heavy mass with a stiff spring between them, free in space."""
    K = 4000.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return pm.Subdomain([1.0, 2.0], K, scheme=pm.GeneralizedAlpha(0.8), force=force, **options)


def test_a_run_with_a_tolerance_keeps_the_momentum():
    rng = np.random.default_rng(13)
    for _ in range(2):
        force, impulse = record(rng, 1.0, dt=0.004)
        force = pm.SampledForce(
            force.values, 0.004, np.outer([0.3, 0.7], force.shape), average=True
        )
        coupler = pm.Coupler([chain(force)], dt=0.05, coupling="gc")
        history = coupler.run(4.0, tolerance=1e-4)
        assert len(set(history.substeps[:, 0])) > 2  # the steps have changed
        momentum = history.subdomains[0].v[-1] @ [1.0, 2.0]
        assert abs(momentum - impulse) < ROUNDING


def test_means_after_a_change_continue_from_a_file_and_a_snapshot(tmp_path):
    """Bitwise; also in the first macro step after the change, where double steps span it."""
    rng = np.random.default_rng(14)

    def coupler():
        a = chain(force, name="a", double_step=True)
        b = pm.Subdomain([1.0], [3.0], scheme=pm.GeneralizedAlpha(0.5), substeps=2, name="b")
        return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.03, coupling="pm")

    force, _ = record(rng, 1.0)
    force = pm.SampledForce(force.values, force.dt, np.outer([0.3, 0.7], force.shape), average=True)
    for more in (0, 1, 4):
        whole = coupler()
        whole.step(5)
        whole.change_steps(0.05)
        whole.step(more)
        whole.save(tmp_path / "state.npz")
        snapshot = whole.snapshot()
        expected = whole.run(steps=20)["a"].u
        whole.restore(snapshot)
        again = coupler()
        again.load(tmp_path / "state.npz")
        for other in (whole, again):
            np.testing.assert_array_equal(other.run(steps=20)["a"].u, expected)


def test_means_are_of_order_two_where_steps_change():
    """u'' + 4 u = sin(3t)^2 = (1 - cos 6t) / 2 from rest."""
    T, errors = 2.0, []
    t = 1e-3 * np.arange(2001)
    force = pm.SampledForce(np.sin(3.0 * t) ** 2, 1e-3, [1.0], average=True)
    exact = (1.0 - np.cos(2.0 * T)) / 8.0 + (np.cos(6.0 * T) - np.cos(2.0 * T)) / 64.0
    for dt in (0.02, 0.01):
        mass = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.8), force=force)
        coupler = pm.Coupler([mass], dt=dt)
        coupler.run(0.4)
        coupler.change_steps(4.0 * dt)
        coupler.run(1.2)
        coupler.change_steps(dt)
        errors.append(abs(coupler.run(T)[0].u[-1, 0] - exact))
    assert errors[0] > 3.5 * errors[1]
