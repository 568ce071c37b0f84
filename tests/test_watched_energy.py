"""Energy that forces add: of cases side by side, in free macro runs, by compiled functions."""

import warnings

import numpy as np
import pytest
from compiled import RESTORING
from scipy import LowLevelCallable

import pmalpha as pm

K, GAP, DT = 1e5, 0.05, 0.01  # omega = 316, omega h = 3.16
STEPS = 400
IMPLICIT, EXPLICIT = pm.GeneralizedAlpha(0.8), pm.CentralDifference()
ADDED = "forces of subdomain 'ball' have added energy"


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


def test_cases_that_grow_are_warned_of_and_are_those_of_single_runs():
    speeds = [0.1, 1.0, 0.2, 0.3, -0.1, 1.5, 0.0, 0.25, 0.05, 0.15, 0.12]
    cases = [{"v0": {"ball": [v]}} for v in speeds]
    coupler = growing()
    with pytest.warns(pm.StabilityWarning, match=ADDED) as seen:
        histories = coupler.run_each(cases, steps=STEPS)
    assert len(seen) == 2  # of 1.0 and 1.5
    for k, (case, history) in enumerate(zip(cases, histories)):
        alone = growing()
        alone.reset(**case)
        with warnings.catch_warnings(record=True) as own:
            warnings.simplefilter("always", pm.StabilityWarning)
            expected = alone.run(steps=STEPS)
        assert len(own) == (speeds[k] >= 1.0)
        assert np.array_equal(expected["ball"].u, history["ball"].u)


# ---- free macro runs -----------------------------------------------------------------------------


def struck(scheme, restoring, estimate=None, **options):
    """A mass on K = 40, cut in two halves; one has substeps and a stop."""
    a = pm.Subdomain([0.5], [20.0], scheme=IMPLICIT, v0=[1.0], name="a")
    b = pm.Subdomain(
        [0.5],
        [20.0],
        scheme=scheme,
        substeps=4,
        v0=[1.0],
        restoring=restoring,
        restoring_stiffness=estimate,
        name="b",
        **options,
    )
    return made(lambda: pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=4 * DT, coupling="macro"))


@pytest.mark.parametrize(
    "scheme, restoring, estimate",
    [
        (IMPLICIT, pm.Gap([0], K, GAP), None),
        (EXPLICIT, pm.Gap([0], K, GAP), None),
        (IMPLICIT, compiled(lambda u: K * max(u - GAP, 0.0)), [K]),
    ],
    ids=["stop", "explicit", "function"],
)
def test_growth_in_free_macro_runs_is_warned_of(scheme, restoring, estimate):
    coupler = struck(scheme, restoring, estimate)
    with pytest.warns(pm.StabilityWarning, match="forces of subdomain 'b' have added energy"):
        v = coupler.run(steps=250)["b"].v
    assert np.abs(v).max() > 3.0  # of a speed of 1


def test_a_watched_subdomain_moves_the_same_whether_inner_time_levels_are_recorded_or_not():
    """With K_r = k the free run and the link response are those of a spring in K: no gain."""
    one = struck(IMPLICIT, pm.CubicSpring([0], 300.0, 0.0))
    two = struck(IMPLICIT, pm.CubicSpring([0], 300.0, 0.0))
    recorded, plain = one.run(steps=40), two.run(steps=40, every=1)
    assert one._session.members[1].core.gain == (0.0, 0.0, 0.0)
    assert np.array_equal(recorded["b"].u[::4], plain["b"].u)


# ---- functions that are iterated -----------------------------------------------------------------


def stop(t, u, v, q):
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
        with pytest.warns(pm.StabilityWarning, match=ADDED):
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


# that of a stop that is open most of the time is warned of
OPEN = pytest.mark.filterwarnings("ignore:restoring_stiffness of:pmalpha.AccuracyWarning")


@pytest.mark.parametrize("estimate", [0.0, pytest.param(K, marks=OPEN)])
def test_contact_of_a_compiled_function_is_watched_like_that_of_a_python_one(estimate):
    coupler = ball(lambda u: K * max(u - 0.1, 0.0), estimate)
    with pytest.warns(pm.StabilityWarning, match=ADDED) as seen:
        coupler.step(20)
        coupler.step(20)
    assert [x.category for x in seen].count(pm.StabilityWarning) == 1
    by_python = pm.Subdomain(
        [1.0],
        None,
        scheme=IMPLICIT,
        v0=[1.0],
        restoring=lambda t, u, v: K * np.maximum(u - 0.1, 0.0),
        restoring_stiffness=[estimate],
    )
    other = pm.Coupler([by_python], dt=DT)
    with pytest.warns(pm.StabilityWarning):
        other.step(40)
    gains = [x._session.members[0].core.gain for x in (coupler, other)]
    assert gains[0] == gains[1] and gains[0][0] > 0.0


@pytest.mark.parametrize(
    "force",
    [
        lambda u: 3e4 * u,
        lambda u: min(max(3e4 * u, -1.0), 1.0),
        lambda u: 10.0 * u + 1e5 * u**3,
    ],
    ids=["linear", "plastic", "cubic"],
)
def test_a_compiled_function_that_is_resolved_is_silent(force):
    ball(force, dt=0.002).step(500)  # warnings are errors
