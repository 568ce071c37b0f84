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
    for _ in range(12):
        force, impulse = record(rng, 1.2)
        mass = pm.Subdomain([2.0], [0.0], scheme=scheme, force=force, substeps=2)
        coupler = pm.Coupler([mass], dt=rng.uniform(0.01, 0.2))
        while coupler.time < 1.2:  # an interval may have no step at all
            coupler.step(int(rng.integers(0, 4)))
            coupler.change_steps(rng.uniform(0.01, 0.2), {0: int(rng.integers(1, 4))})
        coupler.run(steps=80)
        assert abs(2.0 * coupler.state(0).v[0] - impulse) < ROUNDING


@pytest.mark.parametrize("coupling", ["pm", "macro", "mean"])
@pytest.mark.parametrize("scheme", SCHEMES[2:4], ids=str)
def test_both_chains_of_double_steps_have_the_impulse(coupling, scheme):
    """From the first step on, and where double steps span a change or begin anew."""
    rng = np.random.default_rng(12)
    for case in range(12):
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
