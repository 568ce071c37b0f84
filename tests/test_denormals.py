"""Denormal numbers: zero in the core, and what they were for the functions of the caller."""

import numpy as np
import pytest

import pmalpha as pm

SMALLEST = np.finfo(float).tiny


def is_denormal_kept():
    return bool(np.array([SMALLEST])[0] * np.array([0.5])[0] > 0.0)


def decayed(threads=1, scale=1e-305, **options):
    """Two subdomains whose motion, of this size at first, passes through denormal numbers."""
    n = 6
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    how = dict(scheme=pm.GeneralizedAlpha(0.5), v0=scale * np.ones(n))
    a, b = (
        pm.Subdomain(np.ones(n), K, C=np.eye(n), substeps=s, name=f"s{s}", **how) for s in (1, 4)
    )
    tie = pm.tie(a, [n - 1], b, [0])
    return pm.Coupler([a, b], tie, dt=0.4, coupling="gc", threads=threads, **options)


def test_callables_of_python_have_the_denormal_numbers_of_the_caller():
    seen = []

    def spring(t, u, v):
        seen.append(is_denormal_kept())
        return u

    def load(t, u, v):
        seen.append(is_denormal_kept())
        return 0.0 * u

    mass = pm.Subdomain([1.0], None, scheme=pm.CentralDifference(), restoring=spring, force=load)
    report = lambda done, total: seen.append(is_denormal_kept())  # noqa: E731
    pm.Coupler([mass], dt=0.1).run(1.0, progress=report)
    assert len(seen) > 20 and all(seen) and is_denormal_kept()


@pytest.mark.parametrize("energy", [False, True])
def test_a_decayed_motion_is_bitwise_identical_however_it_is_computed(energy):
    end = 60.0
    whole = decayed().run(end, energy=energy)
    assert np.abs(whole["s4"].u[-1]).max() < 1e-306  # down to where numbers become denormal
    for threads in (1, 2):
        coupler = decayed(threads)
        coupler.run(0.5 * end)
        later = coupler.run(end, energy=energy)
        for name in ("s1", "s4"):
            rows = later[name].u.shape[0]
            assert np.array_equal(later[name].u, whole[name].u[-rows:])
        assert np.array_equal(later.multipliers, whole.multipliers[-len(later.multipliers) :])


def test_no_recorded_displacement_is_denormal():
    u = np.abs(decayed().run(200.0)["s4"].u)
    assert not np.any((u > 0.0) & (u < SMALLEST))
