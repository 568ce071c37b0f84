"""Contact by springs and functions that the step does not resolve is warned of, and why."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from active_forces import RHO_0, fed

import pmalpha as pm
from pmalpha import analysis, structures
from pmalpha.setup.bounce import MOST, RESOLVED, bounce_gain

IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.CentralDifference()
K, GAP, DT = 1e5, 0.1, 0.01  # omega = 316, omega h = 3.16


def ball(scheme=IMPLICIT, dt=DT, **forces):
    forces = forces or {"restoring": pm.Gap([0], K, GAP)}
    part = pm.Subdomain([1.0], None, scheme=scheme, v0=[1.0], name="ball", **forces)
    return pm.Coupler([part], dt=dt)


def stop(u, v, t):
    return np.maximum(K * (u - GAP), 0.0)


# ---- springs: the critical step (C4) -------------------------------------------------------------


@pytest.mark.parametrize(
    "scheme, forces",
    [
        (IMPLICIT, {"restoring": pm.Gap([0], K, GAP)}),
        (EXPLICIT, {"restoring": pm.Gap([0], K, GAP)}),
        (EXPLICIT, {"internal": pm.Gap([0], K, GAP)}),
        (pm.Newmark(), {"restoring": [pm.Gap([0], K, GAP), lambda u, v, t: 0.0 * u]}),
    ],
)
def test_a_stop_that_is_too_stiff_when_closed_is_warned_of(scheme, forces):
    words = r"'ball' is above its critical step 0\.006\d+ when contact is closed: .*internal="
    with pytest.warns(pm.StabilityWarning, match=words + ".*pmalpha.contact"):
        ball(scheme, **forces)
    # 1.95 / omega is below the limit of both schemes, 2 and 1.976, but what bounces gets 2.77 (C5)
    words = r"'ball' does not resolve .* leave with 2\.77; take smaller steps \(below 0\.00474\)"
    with pytest.warns(pm.StabilityWarning, match=words + ".*pmalpha.contact"):
        ball(scheme, dt=1.95 / np.sqrt(K), **forces)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ball(scheme, dt=1.5 / np.sqrt(K), **forces)


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
    # a spring of constant k beside K: the amplification of one step, with K_r = share k, by (C4)
    k, K_lin = 50.0, 10.0
    spring = pm.CubicSpring([0], k, 0.0)
    part = pm.Subdomain(
        [2.0], [K_lin], scheme=scheme, restoring=spring, restoring_stiffness=[share * k]
    )
    critical = analysis.critical_step(part)

    def grows(h):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = pm.Coupler([part], dt=h)
            coupler.reset(u0={0: [1.0]})
            try:
                coupler.step(1500)
            except pm.InstabilityError:
                return True
        return abs(coupler.state(0).u[0]) > 10.0

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


# ---- stops that stay below the limit: bounces (C5) -----------------------------------------------


def test_the_speed_that_a_bounce_adds_in_spite_of_an_estimate_is_named():
    with pytest.warns(pm.StabilityWarning, match=r"leave with 1\.78; .*internal=DiscreteGradient"):
        coupler = ball(restoring=pm.Gap([0], K, GAP), restoring_stiffness=[K])
    coupler.step(50)
    assert 1.7 < abs(coupler.state(0).v[0]) < 1.9  # as the warning says
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ball(dt=1.5 / np.sqrt(K), restoring=pm.Gap([0], K, GAP), restoring_stiffness=[K])
        # rho = 0 takes more than a bounce adds
        ball(pm.GeneralizedAlpha(0.0), restoring=pm.Gap([0], K, GAP), restoring_stiffness=[K])


@pytest.mark.parametrize(
    "scheme, estimate, Omega",
    [(IMPLICIT, [K], 3.16), (IMPLICIT, None, 1.9), (EXPLICIT, None, 1.7), (EXPLICIT, None, 1.5)],
)
def test_the_gain_is_that_of_runs(scheme, estimate, Omega):
    gain, dt = bounce_gain(scheme, Omega, float(estimate is not None)), Omega / np.sqrt(K)
    speeds = []
    for start in np.linspace(0.0, dt, 21):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            gap = pm.Gap([0], K, GAP + start)
            coupler = ball(scheme, dt, restoring=gap, restoring_stiffness=estimate)
        coupler.step(60)
        speeds.append(abs(coupler.state(0).v[0]))
    # 64 phases against 21
    np.testing.assert_allclose(max(speeds), gain, rtol=0.02)


@pytest.mark.parametrize("scheme", [pm.Newmark(), IMPLICIT, pm.GeneralizedAlpha(0.5), EXPLICIT])
def test_up_to_the_advised_step_a_bounce_adds_little(scheme):
    for share in (0.0,) if scheme.explicit else (0.0, 0.3, 1.0):
        gains = [bounce_gain(scheme, x, share) for x in np.linspace(0.1, RESOLVED, 15)]
        assert max(gains) < MOST < bounce_gain(scheme, 4.0, share)


def test_the_remedy_of_bounces_adds_nothing():
    stops = pm.DiscreteGradient(pm.Gap([0], K, GAP))
    with warnings.catch_warnings():
        warnings.simplefilter("error", pm.StabilityWarning)
        coupler = ball(pm.Newmark(), internal=stops)
        coupler.step(50)
    np.testing.assert_allclose(coupler.state(0).v, -1.0, rtol=1e-6)  # tolerance of Newton's method


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
    with pytest.warns(pm.StabilityWarning, match="does not resolve the contact .* 141: "):
        pm.Coupler([part], dt=0.0141)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pm.Coupler([part], dt=0.0105)


def test_spheres_and_reduced_forces_know_their_closed_tangent():
    bar = structures.truss([[0, 0, 1], [0, 0, 3]], [[0, 1]], EA=1.0, rhoA=1.0)
    sphere = structures.sphere_contact(bar, 0, center=[0, 0, 0], radius=0.9, stiffness=50.0)
    largest = sphere.largest_tangent().toarray()
    assert largest.tolist() == np.diag([50.0, 50.0, 50.0, 0.0, 0.0, 0.0]).tolist()
    kept = sphere.reduced([2, 5]).largest_tangent().toarray()
    assert kept.tolist() == [[50.0, 0.0], [0.0, 0.0]]
    assert bar.internal[0].largest_tangent() is None


# ---- callables -----------------------------------------------------------------------------------


@pytest.mark.parametrize("estimate, gain", [(None, "8.92"), ([K], "1.78")])
def test_the_stiffness_of_a_callable_is_compared_at_the_first_contact(estimate, gain):
    coupler = ball(restoring=stop, restoring_stiffness=estimate)
    words = rf"closes a contact at t = 0\.11 .* about 316, .* leave with {gain}; .*internal="
    with pytest.warns(pm.StabilityWarning, match=words):
        coupler.step(20)


def test_contact_of_a_callable_that_is_resolved_is_not_reported():
    for dt in (0.0005, 1.9 / np.sqrt(K)):
        ball(dt=dt, restoring=stop).step(int(0.5 / dt))  # warnings are errors


def closing(u, v, t, q):
    """The same as an internal force, of which the program knows its values only."""
    return K * np.maximum(u - GAP, 0.0), np.diag(K * (u > GAP)), None, q


def test_the_stiffness_of_an_internal_function_is_compared_at_the_first_contact():
    coupler = ball(EXPLICIT, internal=pm.InternalForce(closing))
    words = r"internal force .* closes a contact at t = 0\.11 .* about 316, .* leave with 8\.92; "
    with pytest.warns(pm.StabilityWarning, match=words):
        coupler.step(20)
    assert abs(coupler.state(0).v[0]) > 8.0
    ball(EXPLICIT, dt=1.4 / np.sqrt(K), internal=pm.InternalForce(closing)).step(100)  # silent


def test_a_stiff_callable_with_its_estimate_is_not_taken_for_contact():
    ball(restoring=lambda u, v, t: 1e6 * u, restoring_stiffness=[1e6]).step(500)


def test_an_estimate_that_is_too_small_is_reported():
    # b Omega_s^2 = 1.0 at rho = 0.8 to two digits: sqrt(1e6 - 3e5) = 836
    with pytest.warns(pm.StabilityWarning, match="stiffer than .* about 836"):
        with pytest.raises(pm.InstabilityError, match="restoring_stiffness="):
            ball(restoring=lambda u, v, t: 1e6 * u, restoring_stiffness=[3e5]).step(500)


# ---- values that are not finite ------------------------------------------------------------------


@pytest.mark.parametrize(
    "force",
    [
        lambda u, v, t: 1e5 * u,
        lambda u, v, t: 1e9 * u**3,
        lambda u, v, t: np.exp(1e4 * np.abs(u)) - 1.0,
    ],
    ids=["linear", "cubic", "exponential"],
)
def test_a_run_that_grows_is_an_instability_and_not_a_wrong_function(force):
    # warnings of NumPy are errors here
    coupler = ball(restoring=force, restoring_stiffness=[10.0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        with pytest.raises(pm.InstabilityError, match="step 0.01.*") as error:
            coupler.run(10.0)
    assert "internal=" in error.value.cause or "restoring_stiffness=" in error.value.cause
    assert np.isfinite(coupler.state(0).u).all() and coupler.time == error.value.time


@pytest.mark.parametrize("at", [0.005, 0.3])
def test_a_function_that_returns_nan_at_a_sane_state_is_named(at):
    coupler = ball(restoring=lambda u, v, t: u if t < at else np.nan * u)
    with pytest.raises(ValueError, match="restoring of subdomain 'ball' at t = .* finite, got nan"):
        coupler.run(1.0)


# ---- the energy that steps add -------------------------------------------------------------------


def growing(**forces):
    """A mass on K = 40 against a stop with a clearance of 0.05, which it meets again and again."""
    options = dict(scheme=IMPLICIT) | forces
    part = pm.Subdomain([1.0], [40.0], v0=[1.0], name="ball", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        return pm.Coupler([part], dt=DT)


@pytest.mark.parametrize(
    "forces",
    [
        {"restoring": pm.Gap([0], K, 0.05)},
        {"internal": pm.Gap([0], K, 0.05), "scheme": EXPLICIT},
        {"restoring": pm.CubicSpring([0], 1.0, 1e9)},
        {"restoring": lambda u, v, t: K * np.maximum(u - 0.05, 0.0)},
        # a dashpot c = 1 with an estimate of a thousand times that
        {"restoring": lambda u, v, t: v, "restoring_damping": [1e3], "scheme": EXPLICIT},
    ],
    ids=["stop", "explicit", "cubic", "callable", "dashpot"],
)
def test_growth_by_evaluated_forces_ends_in_an_error_with_its_cause(forces):
    coupler = growing(**forces)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        with pytest.raises(pm.InstabilityError, match="'ball' .* step 0.01") as error:
            coupler.run(10.0)
    assert "smaller steps" in error.value.cause
    assert coupler.time == error.value.time == coupler.last_history.macro_times[-1]
    with pytest.raises(pm.InstabilityError):  # it does not go on
        coupler.step()
    coupler.reset()
    coupler.step()


@pytest.mark.parametrize("scheme", [IMPLICIT, pm.Newmark()])
def test_a_moderate_gain_of_iterated_contact_is_warned_of_once(scheme):
    coupler = ball(scheme, internal=pm.Gap([0], K, GAP))
    with pytest.warns(pm.StabilityWarning, match=r"added 2\.\d+ times .*DiscreteGradient"):
        coupler.step(50)
    coupler.step(10)  # no second warning, which would be an error
    coupler.reset()
    with pytest.warns(pm.StabilityWarning, match="grows by its steps"):
        coupler.step(50)


@pytest.mark.parametrize(("force", "scheme"), fed([EXPLICIT, IMPLICIT, pm.Newmark(), RHO_0]))
def test_forces_that_feed_in_energy_are_not_taken_for_the_steps(force, scheme):
    part = pm.Subdomain([1.0], [1.0], scheme=scheme, u0=[0.1], restoring=force)
    coupler = pm.Coupler([part], dt=0.05)
    coupler.step(500)  # warnings are errors
    assert coupler._session.members[0].core.gain < 1.5


def damped(estimate, k=100.0, scheme=EXPLICIT, c=1.0):
    """omega h = 0.1, and a dashpot that takes half of the energy in 0.7 s."""
    part = pm.Subdomain(
        [1.0],
        [k],
        scheme=scheme,
        restoring=lambda u, v, t: c * v,
        restoring_damping=[estimate],
        u0=[1.0],
        name="ball",
    )
    return pm.Coupler([part], dt=DT)


@pytest.mark.parametrize(
    "scheme, estimate, steps",
    [
        (EXPLICIT, 1e4, 30),
        (pm.GeneralizedAlpha(0.5, explicit=True), 300.0, 200),
        (EXPLICIT, 220.0, 400),
    ],
)
def test_growth_by_an_estimate_above_the_damping_is_warned_of_early(estimate, steps, scheme):
    words = r"grows by its steps: .* restoring_damping= is above the damping .* smaller one"
    coupler = damped(estimate, scheme=scheme)
    with pytest.warns(pm.StabilityWarning, match=words):
        history = coupler.run(steps=steps)
    assert 1.1 < np.abs(history[0].u).max() < 4.0  # the exact motion decays


@pytest.mark.parametrize(
    "scheme, c, share",
    [(EXPLICIT, 1.0, 1.0), (EXPLICIT, 1.0, 3.0), (pm.Newmark(), 40.0, 1.2), (IMPLICIT, 0.0, 1.0)]
    + [(EXPLICIT, 40.0, 1.2)],
)
def test_estimates_near_the_damping_are_silent(scheme, c, share):
    damped(share * c if c else 1.0, scheme=scheme, c=c).step(1000)  # warnings are errors


def test_a_restored_state_begins_with_no_gain():
    coupler = growing(restoring=pm.Gap([0], K, 0.05))
    snapshot = coupler.snapshot()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        coupler.step(30)
        assert coupler._session.members[0].core.gain > 20.0
        coupler.restore(snapshot)
        assert coupler._session.members[0].core.gain == 0.0
        coupler.step(30)
        assert coupler._session.members[0].core.gain > 20.0


def sums_of(u, v, w, h, K_r):
    """(B8) for a mass with scheme IMPLICIT, a stop and K_r: P, V by steps, from recorded states."""
    al1 = IMPLICIT.coefficients(h)[0]
    ut = u - al1 * w
    r = K * np.maximum(ut - 0.05, 0.0)
    acting = r + K_r * (u - ut)
    whole, taken = r * w, (r - acting) * w
    share = np.clip(2.0 * taken / np.where(whole == 0.0, 1.0, whole), 0.0, 1.0)
    rest = al1 * np.where(whole == 0.0, 0.0, share * (whole - 0.5 * taken))
    P = np.diff(0.5 * K * np.maximum(ut - 0.05, 0.0) ** 2 + rest)
    V = 0.25 * h * (acting[1:] + acting[:-1]) * (v[1:] + v[:-1])
    return P, V


@pytest.mark.parametrize("K_r, substeps", [(0.0, 1), (K, 3)])
def test_the_gain_is_that_of_the_formulas(K_r, substeps):
    stops = pm.Gap([0], K, 0.05)
    coupler = growing(restoring=stops, restoring_stiffness=[K_r], substeps=substeps)
    steps = 25
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        part = coupler.run(steps=steps)[0]
    P, V = sums_of(part.u[1:, 0], part.v[1:, 0], part.a[1:, 0], DT / substeps, K_r)
    # (B9), (B10) at macro time levels; the first level has no force yet
    at = np.arange(1, steps + 1) * substeps - 1
    work, added, gross = (
        np.concatenate([[0.0], np.cumsum(x)])[at] for x in (P, P - V, abs(P) + abs(V))
    )
    A = added - np.minimum(np.minimum.accumulate(added), 0.0)
    T = 0.5 * part.v[(at + 1), 0] ** 2
    E = T + work - np.minimum(np.minimum.accumulate(work), 0.0)
    R = np.maximum(np.maximum.accumulate(E - A), 0.5)
    gains = np.where(A > 0.01 * gross, np.minimum(A, E) / R, 0.0)
    lasting = [gains[max(i - 3, 0) : i + 1].min() if i >= 3 else 0.0 for i in range(steps)]
    # sums of some hundred terms
    np.testing.assert_allclose(coupler._session.members[0].core.gain, max(lasting), rtol=1e-9)
    assert max(lasting) > 0.05


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_a_sound_run_under_macro_coupling_is_not_ended(share):
    """With K_r near k no energy is added, at whatever macro step (docs/couplings.md)."""
    for product in (4.4, 6.4):
        k = 0.5 * product**2
        a = pm.Subdomain([0.5], [k], scheme=pm.GeneralizedAlpha(0.5), u0=[1.0])
        b = pm.Subdomain(
            [0.5],
            None,
            scheme=pm.GeneralizedAlpha(0.5, explicit=True),
            substeps=20,
            u0=[1.0],
            restoring=lambda u, v, t, k=k: k * u,
            restoring_stiffness=[share * k],
        )
        with pytest.warns(pm.StabilityWarning, match="restoring"):
            coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=1.0, coupling="macro")
        x = coupler.run(steps=60)[1]
        assert x.t[-1] == 60.0
