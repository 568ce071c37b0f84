"""Energy that steps add: of cases side by side, in free macro runs, by compiled functions.

And forces of dashpots that alternate from step to step.
"""

import warnings

import numpy as np
import pytest
from active_forces import RHO_0, fed
from compiled import RESTORING
from scipy import LowLevelCallable
from scipy.integrate import solve_ivp

import pmalpha as pm

K, GAP, DT = 1e5, 0.05, 0.01  # omega = 316, omega h = 3.16
STEPS = 400
IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.CentralDifference()


def made(coupler):
    """Its warnings about the step and macro coupling are not what is tried here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        return coupler()


def compiled(force):
    """force(u) of one dof, as a compiled function."""

    def call(t, n, u, v, r, user):
        r[0] = force(u[0])
        return 0

    return LowLevelCallable(RESTORING(call))


# ---- cases side by side --------------------------------------------------------------------------


def growing():
    """A mass on K = 40 against a stop, which it meets from some 0.32 m/s on."""
    part = pm.Subdomain([1.0], [40.0], scheme=IMPLICIT, restoring=pm.Gap([0], K, GAP), name="ball")
    return made(lambda: pm.Coupler([part], dt=DT))


def test_cases_that_grow_fail_each_for_itself():
    speeds = [0.1, 1.0, 0.2, 0.3, -0.1, 1.5, 0.0, 0.25, 0.05, 0.15, 0.12]
    cases = [{"v0": {"ball": [v]}} for v in speeds]
    coupler = growing()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        with pytest.raises(pm.CasesError) as caught:
            coupler.run_each(cases, steps=STEPS)
    assert caught.value.failures.keys() == {1, 5}
    for k, case in enumerate(cases):
        alone, error = growing(), caught.value.failures.get(k)
        alone.reset(**case)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            if error is None:
                history = alone.run(steps=STEPS)
            else:
                with pytest.raises(pm.InstabilityError, match="stop|springs") as single:
                    alone.run(steps=STEPS)
                assert str(single.value) == str(error)
                history = alone.last_history
        assert np.array_equal(history["ball"].u, caught.value.histories[k]["ball"].u)


@pytest.mark.parametrize("k_r, steps", [(0.0, 60), (K, 1500)])
def test_a_moderate_gain_of_a_case_is_warned_of(k_r, steps):
    # a free mass leaves the stop once, with several times its speed; with K_r = K and a spring that
    # brings it back it gains less in each bounce
    stop = pm.Gap([0], K, GAP if k_r else 0.1)
    part = pm.Subdomain(
        [1.0],
        [40.0] if k_r else None,
        scheme=IMPLICIT,
        restoring=stop,
        restoring_stiffness=[k_r],
        name="ball",
    )
    coupler = made(lambda: pm.Coupler([part], dt=DT))
    cases = [{"v0": {"ball": [v]}} for v in (-0.3, -0.1, 1.0, 0.0)]
    with pytest.warns(pm.StabilityWarning, match="'ball' grows by its steps: .* added") as seen:
        histories = coupler.run_each(cases, steps=steps)
    assert len(seen) == 1
    assert abs(histories[2]["ball"].v).max() > 5.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coupler.run_each([*cases[:2], *cases[3:], *cases[3:]], steps=steps)


# ---- free macro runs -----------------------------------------------------------------------------


def struck(scheme, restoring, estimate=0.0, **options):
    """A mass on K = 40, cut in two halves; one has substeps and a stop."""
    a = pm.Subdomain([0.5], [20.0], scheme=IMPLICIT, v0=[1.0], name="a")
    b = pm.Subdomain(
        [0.5],
        [20.0],
        scheme=scheme,
        substeps=4,
        v0=[1.0],
        restoring=restoring,
        restoring_stiffness=[estimate],
        name="b",
        **options,
    )
    return made(lambda: pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=4 * DT, coupling="macro"))


@pytest.mark.parametrize(
    "scheme, restoring, estimate",
    [
        (IMPLICIT, pm.Gap([0], K, GAP), 0.0),
        (IMPLICIT, pm.Gap([0], K, GAP), K),
        (pm.Newmark(), pm.Gap([0], K, GAP), K),
        (EXPLICIT, pm.Gap([0], K, GAP), 0.0),
        (IMPLICIT, compiled(lambda u: K * max(u - GAP, 0.0)), K),
    ],
    ids=["stop", "stop with K_r", "trapezoidal", "explicit", "function"],
)
def test_growth_in_free_macro_runs_ends_in_an_error_with_its_cause(scheme, restoring, estimate):
    coupler = struck(scheme, restoring, estimate)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        with pytest.raises(pm.InstabilityError, match="'b' .* step 0.01") as error:
            coupler.run(steps=250)
    assert error.value.cause.startswith("its steps added") and "smaller" in error.value.cause
    speeds = np.abs(coupler.last_history["b"].v)
    assert 3.0 < speeds.max() < 1e3  # it had begun to grow, of a speed of 1


def test_a_watched_subdomain_moves_the_same_whether_inner_time_levels_are_recorded_or_not():
    """With K_r = k the free run and the link response are those of a spring in K: no gain."""
    one = struck(IMPLICIT, pm.CubicSpring([0], 300.0, 0.0), 300.0)
    two = struck(IMPLICIT, pm.CubicSpring([0], 300.0, 0.0), 300.0)
    recorded, plain = one.run(steps=40), two.run(steps=40, every=1)
    assert one._session.members[1].core.gain < 1e-9  # rounding of sums of some hundred terms
    assert np.array_equal(recorded["b"].u[::4], plain["b"].u)


@pytest.mark.parametrize(("force", "scheme"), fed([EXPLICIT, IMPLICIT, pm.Newmark(), RHO_0]))
def test_forces_that_feed_in_energy_are_not_taken_for_macro_steps(force, scheme):
    a = pm.Subdomain([0.5], [0.5], scheme=pm.Newmark(), u0=[0.1], name="a")
    b = pm.Subdomain([0.5], [0.5], scheme=scheme, substeps=3, u0=[0.1], restoring=force, name="b")
    coupler = made(lambda: pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="macro"))
    coupler.step(500)
    assert coupler._session.members[1].core.gain < 1.5


# ---- functions that are iterated -----------------------------------------------------------------


def stop(u, v, t, q):
    closed = u > GAP
    return K * np.where(closed, u - GAP, 0.0), K * np.diag(closed.astype(float))


@pytest.mark.parametrize("springs", [None, 40.0])
@pytest.mark.parametrize("scheme", [IMPLICIT, pm.Newmark()], ids=["rho 0.8", "trapezoidal"])
def test_contact_of_an_iterated_function_has_the_work_of_the_stop_that_it_is(scheme, springs):
    """The trapezoidal rule balances with the mean of the forces of both ends, whatever happens in
    between: that alone sees no gain. The path bends once, so what is found is exact."""
    gains = []
    for internal in (stop, pm.Gap([0], K, GAP)):
        part = pm.Subdomain(
            [1.0], springs and [springs], scheme=scheme, v0=[1.0], internal=internal, name="ball"
        )
        coupler = made(lambda part=part: pm.Coupler([part], dt=DT))
        with pytest.warns(pm.StabilityWarning, match="'ball' grows by its steps: .* internal="):
            history = coupler.run(steps=500)
        v, u = history["ball"].v[:, 0], history["ball"].u[:, 0]
        energy = (
            0.5 * v**2 + 0.5 * (springs or 0.0) * u**2 + 0.5 * K * np.maximum(u - GAP, 0.0) ** 2
        )
        assert energy.max() > 1.5  # of 0.5
        gains.append(coupler._session.members[0].core.gain)
    # sums of some hundred works, of iterates that agree to the tolerance of 1e-8
    np.testing.assert_allclose(gains[0], gains[1], rtol=1e-6)


# ---- compiled functions --------------------------------------------------------------------------


def ball(force, estimate=0.0, scheme=IMPLICIT, dt=DT):
    part = pm.Subdomain(
        [1.0],
        None,
        scheme=scheme,
        v0=[1.0],
        restoring=compiled(force),
        restoring_stiffness=[estimate],
        name="ball",
    )
    return pm.Coupler([part], dt=dt)


@pytest.mark.parametrize("estimate, gain", [(0.0, r"8\.92"), (K, r"1\.78")])
def test_contact_of_a_compiled_function_is_compared_like_that_of_a_python_one(estimate, gain):
    coupler = ball(lambda u: K * max(u - 0.1, 0.0), estimate)
    words = rf"closes a contact at t = 0\.11 .* about 316, .* leave with {gain}; .*internal="
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", pm.StabilityWarning)
        coupler.step(20)
        coupler.step(20)  # no second one
    of_contact = [w for w in seen if "compiled restoring function" in str(w.message)]
    assert len(of_contact) == 1
    with pytest.warns(pm.StabilityWarning, match=words):
        warnings.warn_explicit(of_contact[0].message, pm.StabilityWarning, __file__, 0)
    coupler.reset()
    with pytest.warns(pm.StabilityWarning, match="compiled restoring function .* closes"):
        coupler.step(20)


@pytest.mark.parametrize("by_python, by_core", [(K, 0.0), (0.0, K), (0.5 * K, 0.5 * K)])
def test_a_contact_among_python_and_compiled_functions_is_warned_of_once(by_python, by_core):
    def stop(u, v, t):
        return by_python * np.maximum(u - 0.1, 0.0)

    force = compiled(lambda u: by_core * max(u - 0.1, 0.0))
    part = pm.Subdomain(
        [1.0], None, scheme=IMPLICIT, v0=[1.0], restoring=[stop, force], name="ball"
    )
    coupler = pm.Coupler([part], dt=DT)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", pm.StabilityWarning)
        coupler.step(20)
        coupler.step(20)
    of_contact = [str(w.message) for w in seen if "closes a contact" in str(w.message)]
    assert len(of_contact) == 1
    assert ("compiled" in of_contact[0]) == (by_python == 0.0)


def test_contact_of_a_compiled_function_that_is_resolved_is_not_reported():
    for dt in (0.0005, 1.9 / np.sqrt(K)):
        ball(lambda u: K * max(u - 0.1, 0.0), dt=dt).step(int(0.5 / dt))  # warnings are errors


@pytest.mark.parametrize(
    "force",
    [lambda u: 3e4 * u, lambda u: min(max(3e4 * u, -1.0), 1.0), lambda u: 10.0 * u + 1e5 * u**3],
    ids=["linear", "plastic", "cubic"],
)
def test_a_compiled_function_without_contact_is_silent(force):
    ball(force, dt=0.002).step(500)


# ---- dashpots that are too steep near rest -------------------------------------------------------

STIFFNESS, END = 100.0, 3.0  # of an oscillator of mass 1 that is released at u = 1


def damper(c):
    return lambda u, v, t: c * np.sign(v) * np.abs(v) ** 0.3


def steep(restoring, scheme=IMPLICIT, **options):
    part = pm.Subdomain(
        [1.0], [STIFFNESS], scheme=scheme, u0=[1.0], restoring=restoring, name="floor", **options
    )
    return pm.Coupler([part], dt=DT)


def error_of(history, force):
    """Of its displacement, against a step that is chosen by the solver."""
    exact = solve_ivp(
        lambda t, y: [y[1], -STIFFNESS * y[0] - force(y[0], y[1], t)],
        (0.0, END),
        [1.0, 0.0],
        method="LSODA",
        t_eval=history["floor"].t,
        max_step=DT,
        rtol=1e-7,
        atol=1e-9,
    )
    return np.max(np.abs(history["floor"].u[:, 0] - exact.y[0]))


@pytest.mark.parametrize("scheme", [IMPLICIT, EXPLICIT], ids=["implicit", "explicit"])
@pytest.mark.parametrize("c", [30.0, 200.0])
def test_a_dashpot_whose_force_alternates_is_warned_of_once(c, scheme):
    """c |v|^0.3 is infinitely steep at rest. In steps it pushes forth and back there, and holds
    nothing: the oscillator swings on where it should creep."""
    coupler = steep(damper(c), scheme)
    with pytest.warns(pm.StabilityWarning, match="'floor' alternate .* step 0.01") as seen:
        history = coupler.run(END)
        coupler.step(100)
    assert len(seen) == 1
    assert ("restoring_damping=" in str(seen[0].message)) == (scheme is IMPLICIT)
    assert error_of(history, damper(c)) > 0.05
    coupler.reset()
    with pytest.warns(pm.StabilityWarning, match="alternate"):
        coupler.step(200)


def test_friction_that_lets_a_mass_creep_is_warned_of():
    # from turning point to turning point 0.6 are lost: 1, -0.4, -0.2, where 20 < 30 holds it
    coupler = steep(lambda u, v, t: 30.0 * np.sign(v))
    with pytest.warns(pm.StabilityWarning, match="'floor' alternate .* friction"):
        u = coupler.run(3.0 * END)["floor"].u[:, 0]
    assert abs(u[-1]) < 0.05


def test_a_dashpot_that_hardly_alternates_is_not_warned_of():
    for c in (1.0, 10.0):
        history = steep(damper(c)).run(END)  # warnings are errors
        assert error_of(history, damper(c)) < 0.02


def test_a_compiled_dashpot_and_an_internal_one_of_an_explicit_subdomain_alternate_too():
    def call(t, n, u, v, r, user):
        r[0] = 200.0 * np.sign(v[0]) * abs(v[0]) ** 0.3
        return 0

    def internal(u, v, t, q):
        return damper(200.0)(u, v, t), np.zeros((1, 1))

    with pytest.warns(pm.StabilityWarning, match="the restoring forces of .* alternate"):
        steep(LowLevelCallable(RESTORING(call))).step(100)
    with pytest.warns(pm.StabilityWarning, match="the internal forces of .* alternate"):
        steep(None, EXPLICIT, internal=internal).step(100)


def test_what_the_warning_advises_is_right():
    def iterated(u, v, t, q):
        speed = v * v + 1e-6  # of which the slope at rest is finite
        slope = 200.0 * speed**-0.35 * (1.0 - 0.7 * v * v / speed)
        return 200.0 * v * speed**-0.35, np.zeros((1, 1)), np.diag(slope)

    history = steep(None, internal=iterated).run(END)
    assert error_of(history, damper(200.0)) < 0.005


def test_noise_and_the_highest_frequency_of_a_stable_step_do_not_alternate():
    rng = np.random.default_rng(0)
    noise = [lambda u, v, t: 1e-3 * rng.normal(size=1), lambda u, v, t: rng.normal(size=1)]
    stiff = [lambda u, v, t: (1.9 / DT) ** 2 * u, lambda u, v, t: 0.3 / DT * v]
    for force in noise + stiff:
        steep(force, EXPLICIT).step(1500)  # warnings are errors
