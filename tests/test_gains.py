"""Energy that evaluated forces add to a motion, (B8) to (B10): what is seen, and what is not."""

import warnings
from collections import deque

import numpy as np
import pytest
from active_forces import ACTIVE_FORCES

import pmalpha as pm

IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.CentralDifference()
RHO_0, RHO_E = pm.GeneralizedAlpha(0.0), pm.GeneralizedAlpha(0.5, explicit=True)
TRAPEZOIDAL = pm.Newmark()
K, GAP = 1e5, 0.05  # omega = 316 of a closed stop
ADDED = "forces of subdomain 'ball' have added energy"


def ball(dt, scheme, spring=None, **forces):
    motion = {"v0": [1.0]} | forces
    part = pm.Subdomain([1.0], spring and [spring], scheme=scheme, name="ball", **motion)
    with warnings.catch_warnings():  # of critical steps
        warnings.simplefilter("ignore", pm.StabilityWarning)
        return pm.Coupler([part], dt=dt)


def stop(t, u, v):
    return K * np.maximum(u - GAP, 0.0)


def near_stop(t, u, v):
    return K * np.maximum(u - 1e-3, 0.0)


def iterated_stop(t, u, v, q):
    return stop(t, u, v), K * np.diag((u > GAP).astype(float))


STOPS = {
    "function": {"restoring": stop},
    "function with K_r": {"restoring": stop, "restoring_stiffness": [K]},
    "Gap": {"restoring": pm.Gap([0], K, GAP)},
    "iterated Gap": {"internal": pm.Gap([0], K, GAP)},
    "iterated function": {"internal": iterated_stop},
}
# With the stiffness of a stop that is open most of the time, it is warned of: of this one alone
open_stop = pytest.mark.filterwarnings("ignore:restoring_stiffness of:pmalpha.AccuracyWarning")
EACH_STOP = [pytest.param(x, marks=open_stop if "K_r" in x else ()) for x in STOPS]


def largest_energy(coupler, steps, spring=0.0):
    """The largest kinetic energy in a run, in multiples of that of the start."""
    v = coupler.run(steps=steps)["ball"].v[:, 0]
    return np.max(v**2) / v[0] ** 2


# ---- what is seen --------------------------------------------------------------------------------


@pytest.mark.parametrize("spring", [None, 40.0])
@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT, EXPLICIT, RHO_E], ids=repr)
@pytest.mark.parametrize("name", EACH_STOP)
def test_a_stop_that_throws_a_mass_away_is_warned_of_once(name, scheme, spring):
    forces = dict(STOPS[name])
    if scheme.explicit:
        forces.pop("restoring_stiffness", None)
    coupler = ball(0.01, scheme, spring, **forces)  # omega h = 3.16
    with pytest.warns(pm.StabilityWarning, match=ADDED) as seen:
        assert largest_energy(coupler, 100) > 2.0
        coupler.step(10)
    assert [x.category for x in seen].count(pm.StabilityWarning) == 1
    coupler.reset()
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        coupler.step(100)


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT, EXPLICIT, RHO_E], ids=repr)
@pytest.mark.parametrize("name", EACH_STOP)
def test_a_stop_that_is_hit_in_the_first_step_is_warned_of(name, scheme):
    """The forces of the start are known, so that the first step counts: after it the mass is inside
    of the stop, by 9 of its 10 mm if nothing stops it."""
    forces = {
        "function": {"restoring": near_stop},
        "function with K_r": {"restoring": near_stop, "restoring_stiffness": [K]},
        "Gap": {"restoring": pm.Gap([0], K, 1e-3)},
        "iterated Gap": {"internal": pm.Gap([0], K, 1e-3)},
        "iterated function": {
            "internal": lambda t, u, v, q: (near_stop(t, u, v), K * np.diag((u > 1e-3) * 1.0))
        },
    }[name]
    if scheme.explicit:
        forces.pop("restoring_stiffness", None)
    coupler = ball(0.01, scheme, **forces)
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        assert largest_energy(coupler, 20) > 1.5


def rotating_bar(t, u, v, q):
    """A mass on a bar of length 1 and EA = 2000 that turns: its strain is quadratic in u."""
    x = np.array([1.0, 0.0]) + u
    strain = 0.5 * (x @ x - 1.0)
    return 2e3 * strain * x, 2e3 * (np.outer(x, x) + strain * np.eye(2))


def test_a_stiff_bar_that_rotates_in_coarse_steps_is_warned_of():
    """By half a radian in a step, whose path on the chord compresses the bar: along it the
    stiffness is not between those at its ends."""
    mass = pm.Subdomain(
        [1.0, 1.0], None, scheme=IMPLICIT, internal=rotating_bar, v0=[0.0, 1.0], name="ball"
    )
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        v = pm.Coupler([mass], dt=0.5).run(steps=200)["ball"].v
    assert np.max(np.sum(v**2, axis=1)) > 10.0


def test_the_warning_has_amount_ratio_time_and_causes_in_order():
    """It is seen closed at t = 0.06, by 0.01, and at 0.07 v = 1 - h K 0.01 = -9, for ever."""
    coupler = ball(0.01, EXPLICIT, restoring=stop)
    with pytest.warns(pm.StabilityWarning) as seen:
        coupler.run(steps=50)
    (warning,) = seen
    words = str(warning.message)
    assert "since t = 0.07, 40 in all, 98.8 per cent of the largest energy 40.5 that" in words
    causes = ["resolves neither a stop nor a stiff force", "a delay or the wrong sign", "tangent"]
    places = [words.index(cause) for cause in causes]
    assert places == sorted(places)


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT, RHO_0, EXPLICIT], ids=repr)
def test_a_restoring_force_with_the_wrong_sign_is_warned_of(scheme):
    coupler = ball(0.01, scheme, u0=[1e-3], v0=[0.0], restoring=lambda t, u, v: -100.0 * u)
    with pytest.warns(pm.StabilityWarning, match=f"{ADDED}.* the wrong sign"):
        u = coupler.run(8.5)["ball"].u[:, 0]
    assert abs(u[-1]) > 1e33  # cosh(10 t) / 1000, and an error of order 2


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT, EXPLICIT], ids=repr)
@pytest.mark.parametrize("steps", [1, 2])
def test_a_delay_that_nothing_compensates_is_warned_of(scheme, steps):
    """k u(t - tau) is k u - k tau v: the amplitude grows as exp(omega^2 tau t / 2)."""
    past = deque([0.0] * (steps + 1), maxlen=steps + 1)

    def late(t, u, v):
        past.append(u[0])
        return np.array([100.0 * past[0]])

    coupler = ball(0.005, scheme, restoring=late)
    with pytest.warns(pm.StabilityWarning, match=f"{ADDED}.* a delay"):
        u = np.abs(coupler.run(10.0)["ball"].u[:, 0])
    growth = np.exp(50.0 * 0.005 * steps * 8.0)  # from the first to the last second
    assert u[-200:].max() / u[:200].max() > 0.5 * growth > 3.0


def test_an_estimate_of_the_damping_far_above_it_is_warned_of():
    coupler = ball(
        0.01, EXPLICIT, 100.0, u0=[1.0], restoring=lambda t, u, v: v, restoring_damping=[1e4]
    )
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        coupler.run(steps=60)


@pytest.mark.parametrize("name", ["active", "load", "van der Pol", "step"])
def test_a_force_that_feeds_in_energy_is_a_load(name):
    force = ACTIVE_FORCES[name]
    coupler = ball(0.05, IMPLICIT, 1.0, u0=[0.1], v0=[0.0], restoring=force)
    with pytest.warns(pm.StabilityWarning, match=r"is a load, force=f\(t, u, v\)"):
        fed = coupler.run(steps=200)
    as_load = ball(
        0.05,
        IMPLICIT,
        1.0,
        u0=[0.1],
        v0=[0.0],
        force=lambda t, u, v: -force(t, u, v),
        restoring=lambda t, u, v: 0.0 * u,  # without which there is nothing to watch
    )
    # warnings are errors; the same numbers in the same order
    assert np.array_equal(as_load.run(steps=200)["ball"].u, fed["ball"].u)


# ---- what is not ---------------------------------------------------------------------------------

SOUND = {
    "resolved stop": {"spring": 40.0, "restoring": stop, "dt": 1e-3},
    "resolved stop with K_r": STOPS["function with K_r"] | {"spring": 40.0, "dt": 5e-4},
    "resolved Gap": {"spring": 40.0, "restoring": pm.Gap([0], K, GAP), "dt": 1e-3},
    "resolved iterated Gap": {"spring": 40.0, "internal": pm.Gap([0], K, GAP), "dt": 1e-3},
    "bilinear": {"spring": 1.0, "restoring": pm.Bilinear([0], 10.0, 0.2, 0.05)},
    "iterated bilinear": {"spring": 1.0, "internal": pm.Bilinear([0], 10.0, 0.2, 0.05)},
    "Bouc-Wen": {"spring": 1.0, "restoring": pm.BoucWen([0], 10.0, 0.2)},
    "driven Bouc-Wen": {
        "spring": 1.0,
        "restoring": pm.BoucWen([0], 10.0, 0.2),
        "force": lambda t: [np.sin(1.1 * t)],
    },
    "linear": {"restoring": lambda t, u, v: 9.0 * u},
    "linear, released": {"restoring": lambda t, u, v: 9.0 * u, "u0": [1.0], "v0": [0.0]},
    "rest elsewhere": {"restoring": lambda t, u, v: 9.0 * (u - 1.0), "v0": [0.0]},
    "resonance": {
        "C": [0.3],
        "restoring": lambda t, u, v: 9.0 * u,
        "force": lambda t: [np.sin(3.0 * t)],
    },
    "Duffing": {"restoring": lambda t, u, v: 4.0 * u + u**3, "u0": [1.0]},
    "cubic spring": {"restoring": pm.CubicSpring([0], 4.0, 4.0)},
    "dashpot": {"spring": 9.0, "restoring": lambda t, u, v: 0.6 * v},
    "plastic function": {"spring": 1.0, "restoring": lambda t, u, v: np.clip(30 * u, -1.0, 1.0)},
    "carries a weight": {"restoring": lambda t, u, v: 9.0 * u + 100.0, "force": [100.0]},
    "snap-through": {
        "u0": [0.1],
        "v0": [0.0],
        "internal": lambda t, u, v, q: (u**3 - u, np.diag(3.0 * u * u - 1.0)),
    },
    "P-Delta": {"spring": 9.0, "restoring": lambda t, u, v: -1.0 * u},
}


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT, RHO_0, EXPLICIT, RHO_E], ids=repr)
@pytest.mark.parametrize("name", SOUND)
def test_sound_runs_are_silent(name, scheme):
    """Warnings are errors here."""
    options = {"dt": 0.1} | SOUND[name]
    if scheme.explicit:
        options.pop("restoring_stiffness", None)
        if name == "snap-through":
            return  # evaluated once, its path is not known
    coupler = ball(options.pop("dt"), scheme, **options)
    coupler.step(1500)
    assert coupler._session.members[0].core.gain == (0.0, 0.0, 0.0)


def test_a_subdomain_at_rest_neither_warns_nor_ends():
    coupler = ball(
        0.1, IMPLICIT, 3.0, v0=[0.0], restoring=lambda t, u, v: 9.0 * u + 100.0, force=[100.0]
    )
    coupler.step(2000)
    assert abs(coupler.state("ball").u[0]) < 1e-12  # rounding of forces of 100
    still = ball(0.1, IMPLICIT, 3.0, u0=[3e-20], v0=[1e-20], restoring=stop)
    still.step(2000)
    assert abs(still.state("ball").u[0]) < 1e-19


def test_noise_is_silent():
    rng = np.random.default_rng(0)
    noisy = ball(
        0.02, IMPLICIT, 1.0, u0=[1.0], restoring=lambda t, u, v: 4.0 * u + 1e-3 * rng.normal(size=1)
    )
    noisy.step(2000)


@pytest.mark.parametrize("seed", [1, 2, 6, 7, 9, 11])
def test_noise_of_a_measured_force_at_a_start_from_rest_is_silent(seed):
    """Half as large as what drives the first step: of the energy that it gives there, and of the
    first value, nothing is left in the motion that follows. Without the second sum of (B9) all of
    these were warned of."""
    rng = np.random.default_rng(seed)
    noisy = ball(
        0.02,
        TRAPEZOIDAL,
        1.0,
        v0=[0.0],
        force=lambda t: [np.sin(t)],
        restoring=lambda t, u, v: 4.0 * u + 1e-2 * rng.normal(size=1),
    )
    noisy.run(steps=200)


# ---- what an estimate adds to the mass -----------------------------------------------------------


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT], ids=repr)
def test_an_estimate_of_a_stop_that_is_never_reached_is_warned_of_with_its_mass(scheme):
    """u = v0 / omega sin(omega t) stays below the stop: with alpha_1 K more mass it swings with
    omega / sqrt(1 + mu), and is wrong by as much as it moves."""
    mu = scheme.coefficients(0.01)[0] * K
    omega, slow = np.sqrt(40.0), np.sqrt(40.0 / (1.0 + mu))
    coupler = ball(0.01, scheme, 40.0, v0=[0.05], **STOPS["function with K_r"])
    with pytest.warns(pm.AccuracyWarning, match=f"acted as {100.0 * mu:.3g} per cent of its mass"):
        x = coupler.run(steps=300)["ball"]
    # (omega h)^2 / 12 of a period in three periods
    np.testing.assert_allclose(x.u[:, 0], 0.05 / slow * np.sin(slow * x.t), atol=2e-4)
    right = 0.05 / omega * np.sin(omega * x.t)
    assert abs(x.u[:, 0] - right).max() > 0.01
    gap = ball(0.01, scheme, 40.0, v0=[0.05], restoring=pm.Gap([0], K, GAP))
    # the tangent of a Gap is zero while it is open
    np.testing.assert_allclose(gap.run(steps=300)["ball"].u[:, 0], right, atol=2e-4)


def test_springs_take_no_other_estimate_than_their_tangents():
    with pytest.raises(ValueError, match="restoring_stiffness must be the initial tangents"):
        ball(0.01, IMPLICIT, 40.0, restoring=pm.Gap([0], K, GAP), restoring_stiffness=[K])


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT], ids=repr)
def test_an_estimate_that_is_the_stiffness_adds_no_mass(scheme):
    """At any step; and a part above it half of that where alpha_1 K is half of the mass."""
    for share, expected in ((1.0, 0.0), (1.03, 0.015)):
        stiff = 0.5 / scheme.coefficients(0.1)[0]
        coupler = ball(
            0.1,
            scheme,
            1.0,
            restoring=lambda t, u, v, k=stiff: k * u,
            restoring_stiffness=[share * stiff],
        )
        coupler.step(100)
        np.testing.assert_allclose(
            coupler._session.members[0].core.added_mass, expected, atol=1e-12
        )


# ---- the formulas --------------------------------------------------------------------------------


def gain_of(u, v, w, pull, spring, along):
    """(B8) to (B10) of a mass 1 on a spring, without loads, from its recorded states: added, energy
    and the level at which their ratio first exceeded 0.1 for two levels.

    pull: K u, in explicit steps K ut. along: the change of the energy of the forces between the
    levels, None where it is not known.
    """
    acting = -w - pull  # M w + K u + r_a = 0
    du = np.diff(u)
    mean = 0.5 * (acting[1:] + acting[:-1])
    since = np.append(0.0, np.cumsum((mean - acting[0]) * du))
    gross = np.append(0.0, np.cumsum(np.abs((mean - acting[0]) * du)))
    T = 0.5 * v**2
    lost = np.append(0.0, np.cumsum(0.5 * (w[1:] + w[:-1]) * du)) - (T - T[0])
    added = np.minimum(-since, -np.append(0.0, np.cumsum(mean * du)))
    if along is not None:
        added = np.minimum(added, np.append(0.0, np.cumsum(along - mean * du)))
    added = added - np.maximum(lost, 0.0)
    E = T + 0.5 * spring * u**2
    fastest = (1.0 - 1e-9) * np.maximum.accumulate(T) <= T
    added = np.maximum.accumulate(np.where(fastest & (added > 0.01 * gross), added, 0.0))
    E = np.maximum.accumulate(np.where(fastest, E, 0.0))
    exceeds = added > 0.1 * E
    assert exceeds[-1]
    return added[-1], E[-1], int(np.argmax(exceeds[1:] & exceeds[:-1]))


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, IMPLICIT, EXPLICIT, RHO_E], ids=repr)
@pytest.mark.parametrize("kind", ["function", "Gap", "iterated Gap"])
def test_the_gain_is_that_of_the_formulas(kind, scheme):
    h = 0.01 if kind == "iterated Gap" else 0.008  # iterated, Omega = 2.5 adds less than a tenth
    coupler = ball(h, scheme, 40.0, **STOPS[kind])
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        x = coupler.run(steps=120)["ball"]
    u, v, w = (y[:, 0] for y in (x.u, x.v, x.a))
    predictor = u - scheme.coefficients(h)[0] * w
    predictor[0] = u[0]
    at = u if kind == "iterated Gap" and not scheme.explicit else predictor
    energy = 0.5 * K * np.maximum(at - GAP, 0.0) ** 2
    along = None if kind == "function" else np.diff(energy)
    pull = 40.0 * (predictor if scheme.explicit else u)
    added, E, level = gain_of(u, v, w, pull, 40.0, along)
    # sums of a hundred works
    np.testing.assert_allclose(
        coupler._session.members[0].core.gain, (added, E, x.t[level]), rtol=1e-8
    )


def test_a_restored_state_begins_with_no_gain():
    coupler = ball(0.01, IMPLICIT, 40.0, restoring=pm.Gap([0], K, GAP))
    snapshot = coupler.snapshot()
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        coupler.step(30)
    coupler.restore(snapshot)
    assert coupler._session.members[0].core.gain == (0.0, 0.0, 0.0)
