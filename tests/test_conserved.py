"""The quantity that macro coupling conserves exactly, (M9) of docs/method.md."""

import numpy as np
import pytest

import pmalpha as pm


def conserved(coupler, history):
    """E* at the macro time levels."""
    total = 0.0
    for s in coupler.subdomains:
        x, h = history[s.name], coupler.dt / s.substeps
        w, v = x.a[:: s.substeps], x.v[:: s.substeps]
        inertia = np.diag(s.M) + h**2 * (s.scheme.beta - 0.25) * s.K
        total = total + 0.5 * np.sum(w * (w @ inertia) + v * (v @ s.K), axis=1)
    return total


@pytest.mark.parametrize("substeps", [(1, 1, 1), (1, 3, 7), (2, 3, 7)])
@pytest.mark.parametrize("explicit", [False, True])
def test_macro_coupling_conserves_it_to_rounding(substeps, explicit):
    """1e-11: the rounding of 3000 macro steps, of terms up to 1e2 times the sum."""
    rng = np.random.default_rng(11)
    subdomains = []
    for i, s in enumerate(substeps):
        A = rng.normal(size=(4, 4))
        v0 = rng.normal(size=4)
        v0[[0, 3]] = 0.0
        scheme = pm.CentralDifference() if explicit and i == 2 else pm.Newmark()
        M, K = rng.uniform(0.5, 2.0, 4), 3.0 * A @ A.T + np.eye(4)
        subdomains.append(pm.Subdomain(M, K, scheme=scheme, substeps=s, v0=v0, name=str(i)))
    a, b, c = subdomains
    ties = [pm.tie(a, 3, b, 0), pm.tie(b, 3, c, 0), pm.tie(c, 3, a, 0)]
    coupler = pm.Coupler(subdomains, ties, dt=0.2, coupling="macro")
    history = coupler.run(steps=3000, energy=True)
    E = conserved(coupler, history)
    assert np.max(np.abs(E / E[0] - 1.0)) < 1e-11
    if substeps == (1, 1, 1) and not explicit:
        return  # then it is the energy of one trapezoidal rule
    # the energy itself is not conserved: it oscillates about its beginning
    total = (history.energy.kinetic + history.energy.strain).sum(axis=1)
    assert np.max(np.abs(total / total[0] - 1.0)) > 1e-4


def test_it_changes_where_a_condition_does_not_hold():
    """With algorithmic damping, so that the test above is not empty."""
    a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.8), v0=[1.0], name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), v0=[1.0], substeps=3, name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.2, coupling="macro")
    E = conserved(coupler, coupler.run(steps=300))
    assert np.ptp(E) > 0.01 * E[0]
