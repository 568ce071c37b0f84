"""Critical steps of springs and contact, and values of functions that are not finite."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import analysis, structures

IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.CentralDifference()
K, GAP, DT = 1e5, 0.1, 0.01  # omega = 316, omega h = 3.16


def ball(scheme=IMPLICIT, dt=DT, **forces):
    forces = forces or {"restoring": pm.Gap([0], K, GAP)}
    part = pm.Subdomain([1.0], None, scheme=scheme, v0=[1.0], name="ball", **forces)
    return pm.Coupler([part], dt=dt)


# ---- springs: the critical step (C4) -------------------------------------------------------------


@pytest.mark.parametrize(
    "scheme, forces",
    [
        (IMPLICIT, {"restoring": pm.Gap([0], K, GAP)}),
        (EXPLICIT, {"restoring": pm.Gap([0], K, GAP)}),
        (EXPLICIT, {"internal": pm.Gap([0], K, GAP)}),
        (pm.Newmark(), {"restoring": [pm.Gap([0], K, GAP), lambda t, u, v: 0.0 * u]}),
    ],
)
def test_a_stop_that_is_too_stiff_when_closed_is_warned_of(scheme, forces):
    words = r"'ball' is above its critical step 0\.006\d+ when contact is closed: .*internal="
    with pytest.warns(pm.StabilityWarning, match=words + ".*pmalpha.contact"):
        ball(scheme, **forces)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ball(scheme, dt=1.95 / np.sqrt(K), **forces)  # below the limit of both schemes


def test_springs_that_iterate_have_no_limit():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ball(internal=pm.Gap([0], K, GAP))


@pytest.mark.parametrize(
    "scheme, share",
    [
        (pm.Newmark(), 0.0),
        (IMPLICIT, 0.0),
        (IMPLICIT, 0.3),
        (pm.GeneralizedAlpha(0.3), 0.3),
        (pm.HHT(0.2), 0.0),
        (pm.HHT(0.2), 0.8),
    ],
)
def test_the_limit_with_an_estimate_is_that_of_the_linear_oscillator(scheme, share):
    # springs of constant k beside K, (1 - share) k of it a stop that is open at rest, so that K_r
    # is share k: a load keeps it closed
    k, K_lin, load = 50.0, 10.0, 600.0
    springs = [pm.CubicSpring([0], share * k, 0.0), pm.Gap([0], (1.0 - share) * k, 1e-9)]
    part = pm.Subdomain([2.0], [K_lin], scheme=scheme, restoring=springs, force=[load])
    critical = analysis.critical_step(part)

    def grows(h):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = pm.Coupler([part], dt=h)
            coupler.reset(u0={0: [10.001]})  # about load / (K + k) = 10
            try:
                u = coupler.run(steps=1500)[0].u
            except pm.InstabilityError:
                return True
        return np.max(np.abs(u - 10.0)) > 0.1

    if np.isinf(critical):
        assert not grows(10.0)
    else:
        assert grows(1.01 * critical) and not grows(0.98 * critical)


def test_an_estimate_of_the_tangent_has_no_critical_step():
    spring = pm.CubicSpring([0], 50.0, 0.0)
    for scheme in (pm.Newmark(), IMPLICIT):
        assert np.isinf(
            analysis.critical_step(pm.Subdomain([2.0], [9.0], scheme=scheme, restoring=spring))
        )


def test_dofs_without_mass_are_held_by_the_stiffness_beside_the_spring():
    # K of the massless dof is 10: stable up to the share b Omega_s^2 of it, 1.19 at rho = 0.8
    def limit(k):
        part = pm.Subdomain(
            [1.0, 0.0],
            np.array([[10.0, -10.0], [-10.0, 10.0]]),
            scheme=IMPLICIT,
            restoring=pm.Gap([1], k, 0.1),
        )
        return analysis.critical_step(part)

    b, Omega = IMPLICIT.coefficients(1.0)[0], 1.8 * np.sqrt(1.2)
    assert b * Omega**2 > 1.0
    assert limit(1e-3) == np.inf and limit(1e3) == 0.0


def test_many_dofs_have_the_limit_of_the_dofs_of_the_springs():
    n = 300
    chain = sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    part = pm.Subdomain(
        np.ones(n), sp.csr_array(chain), scheme=pm.Newmark(), restoring=pm.Gap([7], 400.0, 0.1)
    )
    # b Omega_s^2 = 1: K is out, and k / m = 400 alone is left
    np.testing.assert_allclose(analysis.critical_step(part), 2.0 / 20.0, rtol=1e-6)


# ---- contact of elements -------------------------------------------------------------------------


def falling():
    bar = structures.truss([[0, 0], [0, 1]], [[0, 1]], EA=1.0, rhoA=2.0)
    floor = structures.plane_contact(bar, 0, point=[0, -0.1], normal=[0, 2], stiffness=1e4)
    bar = bar.with_internal(floor)
    v0 = np.array([0.0, -1.0, 0.0, -1.0])
    return bar.subdomain(scheme=EXPLICIT, v0=v0, name="bar")


def test_the_critical_step_sees_contact_that_is_open():
    part = falling()
    # 1 / (M^-1)_11 = 0.5 of the consistent mass 2 / 6 [2 1; 1 2]; the bar itself adds EA / L = 1
    np.testing.assert_allclose(analysis.critical_step(part), 2.0 * np.sqrt(0.5 / 1e4), rtol=1e-3)
    with pytest.warns(pm.StabilityWarning, match="when contact is closed"):
        pm.Coupler([part], dt=0.0143)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pm.Coupler([part], dt=0.0141)


def test_spheres_and_reduced_forces_know_their_closed_tangent():
    bar = structures.truss([[0, 0, 1], [0, 0, 3]], [[0, 1]], EA=1.0, rhoA=1.0)
    sphere = structures.sphere_contact(bar, 0, center=[0, 0, 0], radius=0.9, stiffness=50.0)
    largest = sphere.largest_tangent().toarray()
    assert largest.tolist() == np.diag([50.0, 50.0, 50.0, 0.0, 0.0, 0.0]).tolist()
    kept = sphere.reduced([2, 5]).largest_tangent().toarray()
    assert kept.tolist() == [[50.0, 0.0], [0.0, 0.0]]
    assert bar.internal[0].largest_tangent() is None


# ---- values that are not finite ------------------------------------------------------------------


@pytest.mark.parametrize(
    "force", [lambda t, u, v: 1e5 * u, lambda t, u, v: 1e9 * u**3], ids=["linear", "cubic"]
)
def test_a_run_that_leaves_the_range_of_numbers_is_an_instability_and_not_a_wrong_function(force):
    # warnings of NumPy are errors here: it ends before the function overflows
    coupler = ball(restoring=force, restoring_stiffness=[10.0])
    with pytest.raises(
        pm.InstabilityError, match="forces of subdomain 'ball' .* too stiff"
    ) as error:
        coupler.run(10.0)
    assert error.value.cause.endswith("or internal= with tangents")
    assert np.isfinite(coupler.state(0).u).all() and coupler.time == error.value.time
    with pytest.raises(pm.InstabilityError):  # it does not go on
        coupler.step()
    coupler.reset()
    coupler.step()


@pytest.mark.parametrize("at", [0.005, 0.3])
def test_a_function_that_returns_nan_at_a_sane_state_is_named(at):
    coupler = ball(restoring=lambda t, u, v: u if t < at else np.nan * u)
    with pytest.raises(ValueError, match="restoring of subdomain 'ball' at t = .* finite, got nan"):
        coupler.run(1.0)
