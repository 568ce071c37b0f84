"""A linear subdomain whose stiffness is indefinite is warned of, with its rate of growth."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import models
from pmalpha._cached import Once
from pmalpha.setup.judging import warn_of_growing
from pmalpha.setup.link import Link

SCHEME = pm.GeneralizedAlpha(0.8)


def part(K, M=None, **options):
    M = np.ones(np.shape(K)[0]) if M is None else M
    return pm.Subdomain(M, K, scheme=SCHEME, **options)


def chain(n, end=1.0):
    d = np.full(n, 2.0)
    d[[0, -1]] = end
    return sp.csr_array(sp.diags_array([-np.ones(n - 1), d, -np.ones(n - 1)], offsets=[-1, 0, 1]))


def test_the_rate_of_growth_is_named_and_right():
    with pytest.warns(pm.StabilityWarning, match=r"'subdomain 0'.* exp\(10 t\)"):
        coupler = pm.Coupler([part([-100.0], v0=[1.0])], dt=0.001)
    coupler.step(2000)
    # v = cosh(10 t), at t = 2 half of exp(20); order 2, so that (omega h)^2 = 1e-4 over 20 periods
    np.testing.assert_allclose(coupler.state(0).v, 0.5 * np.exp(20.0), rtol=2e-3)


@pytest.mark.parametrize("n", [3, 5000])
def test_wrong_entries_are_found_in_matrices_of_any_size(n):
    K = chain(n).tolil()
    K[1, 2] = K[2, 1] = 3.0  # in place of -1
    with pytest.warns(pm.StabilityWarning, match="not positive semidefinite"):
        pm.Coupler([part(K.tocsr())], dt=0.01)
    d = np.ones(n)
    d[2] = -4.0
    with pytest.warns(pm.StabilityWarning, match=r"exp\(2 t\)"):
        pm.Coupler([part(d)], dt=0.01)


@pytest.mark.parametrize("n", [4, 40, 3000])
def test_floating_subdomains_are_not_reported(n):
    rng = np.random.default_rng(0)
    K = chain(n) * 1.23e7
    K.data *= 1.0 + 1e-11 * rng.standard_normal(K.data.size)  # digits of a file
    K = sp.csr_array(0.5 * (K + K.T))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pm.Coupler([part(K)], dt=0.01)


def test_ties_that_hold_it_decide():
    soft = part([-1.0], name="soft")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stiff = part([3.0], name="stiff")
        # under "pm" the gap of the displacements, which ties of velocities do not see, would grow
        pm.Coupler([soft, stiff], pm.tie(soft, [0], stiff, [0]), dt=0.01, coupling="gc")
    weak = part([0.5], name="weak")
    # (1 - 0.5) / 2
    with pytest.warns(pm.StabilityWarning, match=r"'soft'.* exp\(0.5 t\)"):
        pm.Coupler([soft, weak], pm.tie(soft, [0], weak, [0]), dt=0.01, coupling="pm")


def test_large_structures_are_warned_of_with_doubt():
    soft, large = part([-1.0], name="soft"), part(chain(500, end=2.0), name="large")
    with pytest.warns(pm.StabilityWarning, match="unless its constraints hold it"):
        pm.Coupler([soft, large], pm.tie(soft, [0], large, [0]), dt=0.01, coupling="pm")


def test_springs_that_hold_it_and_internal_forces_are_not_judged():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        well = pm.CubicSpring([0], 0.0, 1.0)  # two wells
        pm.Coupler([part([-1.0], restoring=well)], dt=0.01)
        pm.Coupler([part([-1.0], internal=well)], dt=0.01)


def test_a_direction_without_mass_grows_at_once():
    K = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 1.0]])
    massless = part(K, M=[1.0, 0.0, 0.0])  # which the factor of Mbar refuses afterwards
    with pytest.warns(pm.StabilityWarning, match="grows at once"):
        warn_of_growing([("a", massless)], [Link.empty(3)], Once(), complete=True)


@pytest.mark.parametrize("ratios", [[5.0, 5.0], [0.05, 1.0], [np.float64(2.0), 0.0]])
def test_rayleigh_refuses_per_cent(ratios):
    with pytest.raises(ValueError, match="^ratios must be below 1, .*0.05"):
        models.rayleigh([1.0, 5.0], ratios)


# ---- damping -------------------------------------------------------------------------------------


def test_a_negative_damper_is_named_with_its_rate():
    """v' = -c v / m: exp(3 t)."""
    with pytest.warns(pm.StabilityWarning, match=r"C of subdomain 'a' .* up to exp\(3 t\)"):
        pm.Coupler([part([4.0, 4.0], [2.0, 1.0], C=[-6.0, 1.0], name="a")], dt=0.01)


@pytest.mark.parametrize("n", [3, 5000])
def test_wrong_entries_of_damping_are_found_in_matrices_of_any_size(n):
    C = chain(n).tolil()
    C[1, 2] = C[2, 1] = 3.0  # in place of -1
    with pytest.warns(pm.StabilityWarning, match="C of .* not positive semidefinite"):
        pm.Coupler([part(chain(n), C=C.tocsr())], dt=0.01)


def test_damping_that_takes_energy_is_not_reported():
    """Warnings are errors here. Skew parts do no work; a damper that is tied to one takes more."""
    gyroscopic = np.array([[0.0, 5.0], [-5.0, 0.0]])
    pm.Coupler([part([4.0, 4.0], C=gyroscopic, symmetric=False)], dt=0.01)
    for count in (4, 40, 3000):
        pm.Coupler([part(chain(count), C=0.01 * chain(count))], dt=0.01)
    a, b = part([4.0], C=[-1.0], name="a"), part([4.0], C=[1.5], name="b")
    pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.01, coupling="gc")
    c = part([4.0], C=[0.5], name="c")
    with pytest.warns(pm.StabilityWarning, match=r"up to exp\(0.25 t\)"):
        pm.Coupler([a, c], pm.tie(a, 0, c, 0), dt=0.01, coupling="gc")
