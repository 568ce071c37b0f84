"""Stops with a damper, (H13), against the closed form of an impact and against functions."""

import numpy as np
import pytest

import pmalpha as pm

MASS, STIFFNESS, GAP = 2.0, 800.0, 1.3e-3


def damper(zeta):
    return 2.0 * zeta * np.sqrt(STIFFNESS * MASS)


def restitution(zeta):
    """Share of the velocity after a half swing x = exp(-zeta w t) sin(w_d t) up to k x + c x' = 0.

    x' / x is -w / (2 zeta) there: tan(w_d t) = 2 zeta sqrt(1 - zeta^2) / (2 zeta^2 - 1).
    """
    root = np.sqrt(1.0 - zeta**2)
    return np.exp(-zeta / root * np.arctan2(2.0 * zeta * root, 2.0 * zeta**2 - 1.0))


def ball(scheme, dt, *, sign=1, **forces):
    """A mass that meets a stop with the velocity 1."""
    ball = pm.Subdomain([MASS], None, scheme=scheme, v0=[sign], u0=[-0.0101 * sign], **forces)
    return pm.Coupler([ball], dt=dt).run(0.3, energy=True)


SCHEMES = {
    "central difference": pm.CentralDifference(),
    "trapezoidal rule": pm.Newmark(),
    "generalized-alpha": pm.GeneralizedAlpha(0.8),
}


@pytest.mark.parametrize("zeta", [0.1, 0.3, 0.7])
@pytest.mark.parametrize("kind", ["restoring", "internal"])
@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_a_mass_comes_back_with_the_share_of_a_damped_half_swing(scheme, kind, zeta):
    stop = pm.Gap([0], k=STIFFNESS, gap=GAP, c=damper(zeta))
    history = ball(scheme, 2.5e-4, **{kind: stop})
    back, expected = -history[0].v[-1, 0], restitution(zeta)
    # the force begins with c v: half a step of it, c h / (2 m) = 1.4e-2 zeta / 2, is not known
    assert abs(back - expected) < 0.007 * zeta
    assert back < 1.0 - 0.5 * zeta
    lost = 0.5 * MASS * (1.0 - back**2)
    assert abs(history.energy.dissipated[-1, 0] - lost) < 5e-4
    assert np.all(np.diff(history.energy.dissipated[:, 0]) > -1e-12)


@pytest.mark.parametrize("kind", ["restoring", "internal"])
def test_a_stop_on_the_negative_side_and_one_between_dofs_are_the_same(kind):
    stop = {"k": STIFFNESS, "gap": GAP, "c": damper(0.3)}
    scheme = pm.Newmark()
    expected = ball(scheme, 1e-3, **{kind: pm.Gap([0], **stop)})[0].u
    mirrored = ball(scheme, 1e-3, sign=-1, **{kind: pm.Gap([0], sign=-1, **stop)})[0].u
    np.testing.assert_array_equal(mirrored, -expected)
    # a wall of a mass on which the ball leaves no trace: 1e-12 of its velocity
    pair = pm.Subdomain(
        [MASS, 1e12 * MASS],
        None,
        scheme=scheme,
        v0=[1.0, 0.0],
        u0=[-0.0101, 0.0],
        **{kind: pm.Gap([(0, 1)], **stop)},
    )
    both = pm.Coupler([pair], dt=1e-3).run(0.3)[0].u
    np.testing.assert_allclose(both[:, :1], expected, rtol=0, atol=1e-11)


def push(d, rate, k, c):
    """Force of the stop, and whether it acts."""
    force = k * (d - 0.01) + c * rate
    acts = (d > 0.01) & (force > 0.0)
    return np.where(acts, force, 0.0), acts


def coupled(coupling, forces, scheme):
    K = 400.0 * np.array([[2.0, -1.0], [-1.0, 1.0]])
    a = pm.Subdomain([1.0, 1.0], K, scheme=scheme, v0=[0.0, 1.0], name="a", substeps=2, **forces)
    b = pm.Subdomain([1.0], [100.0], scheme=pm.GeneralizedAlpha(0.8), name="b")
    tie = pm.tie(a, [0], b, [0])
    return pm.Coupler([a, b], tie, dt=2e-3, coupling=coupling).run(0.5, energy=True)


# of "macro" with forces that are evaluated in substeps
@pytest.mark.filterwarnings("ignore:the restoring forces:pmalpha.StabilityWarning")
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
@pytest.mark.parametrize("explicit", [True, False])
def test_evaluated_once_a_step_it_is_the_function(coupling, explicit):
    k, c = 2000.0, 30.0
    scheme = pm.GeneralizedAlpha(0.8, explicit=explicit)
    stop = pm.Gap([1], k=k, gap=0.01, c=c)

    def function(t, u, v):
        return [0.0, push(u[1], v[1], k, c)[0]]

    one = coupled(coupling, {"restoring": stop}, scheme)
    other = coupled(coupling, {"restoring": function}, scheme)
    assert one["a"].u[:, 1].max() > 0.015
    # sums of a few terms, in another order: rounding over 500 steps
    np.testing.assert_allclose(one["a"].u, other["a"].u, rtol=0, atol=1e-14)
    np.testing.assert_allclose(one["b"].v, other["b"].v, rtol=0, atol=1e-12)


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_iterated_it_is_the_function_with_both_tangents(coupling):
    k, c = 2000.0, 30.0
    stop = pm.Gap([1], k=k, gap=0.01, c=c)

    def function(t, u, v, q):
        force, acts = push(u[1], v[1], k, c)
        return [0.0, force], np.diag([0.0, k * acts]), np.diag([0.0, c * acts])

    scheme = pm.GeneralizedAlpha(0.8)
    one = coupled(coupling, {"internal": stop}, scheme)
    other = coupled(coupling, {"internal": pm.InternalForce(function)}, scheme)
    assert one["a"].u[:, 1].max() > 0.015
    # Newton's method ends at 1e-8 of the motion and the force is linear: with the tangents exact
    np.testing.assert_allclose(one["a"].u, other["a"].u, rtol=0, atol=1e-13)
    assert one["a"].iterations.max() == other["a"].iterations.max() <= 4


@pytest.mark.parametrize("where", ["restoring", "internal"])
@pytest.mark.parametrize("scheme", [pm.Newmark(), pm.CentralDifference()])
def test_a_damped_cubic_spring_without_its_cube_is_a_damped_oscillator(where, scheme):
    k, c, t_end = 40.0, 0.8, 3.0
    spring = pm.CubicSpring([0], k, 0.0, c=c)
    s = pm.Subdomain([1.0], None, scheme=scheme, u0=[0.1], **{where: spring})
    motion = pm.solve(s, dt=0.002, t_end=t_end)
    zeta = c / 2.0
    omega, t = np.sqrt(k - zeta**2), motion.t
    exact = 0.1 * np.exp(-zeta * t) * (np.cos(omega * t) + zeta / omega * np.sin(omega * t))
    # (omega h)^2 / 24 and / 12 a radian, over 19 of them: 1.3e-4 and 2.5e-4 of the amplitude
    assert np.abs(motion.u[:, 0] - exact).max() < 3e-4 * 0.1
    undamped = pm.solve(
        pm.Subdomain([1.0], None, scheme=scheme, u0=[0.1], **{where: pm.CubicSpring([0], k, 0.0)}),
        dt=0.002,
        t_end=t_end,
    )
    assert np.abs(undamped.u[:, 0] - exact).max() > 0.01


def test_without_a_damper_it_is_the_plain_stop():
    for kind in ("restoring", "internal"):
        plain, damped = (
            ball(pm.Newmark(), 1e-3, **{kind: pm.Gap([0], k=STIFFNESS, gap=GAP, **c)})[0].u
            for c in ({}, {"c": 0.0})
        )
        np.testing.assert_array_equal(plain, damped)


def test_a_damper_that_is_evaluated_once_limits_the_step_as_lagged_damping():
    for scheme in (pm.CentralDifference(), pm.Newmark()):
        stop = pm.Gap([0], k=0.0, gap=0.0, c=4.0)
        s = pm.Subdomain([MASS], None, scheme=scheme, restoring=stop)
        # (C2) without stiffness: c h = m, with the trapezoidal gamma = 1/2
        assert pm.analysis.critical_step(s) == pytest.approx(0.5, rel=1e-12)
    iterated = pm.Subdomain([MASS], None, scheme=pm.Newmark(), internal=stop)
    assert pm.analysis.critical_step(iterated) == np.inf


def test_bad_dampers_are_refused():
    with pytest.raises(ValueError, match="c must not be negative, got -1 at spring 1"):
        pm.Gap([0, 1], k=1.0, gap=0.0, c=[0.0, -1.0])
    with pytest.raises(ValueError, match="c must be a number or of shape"):
        pm.Gap([0, 1], k=1.0, gap=0.0, c=[0.0, 1.0, 2.0])
    stop = pm.Gap([0], k=1.0, gap=0.0, c=1.0)
    with pytest.raises(TypeError, match="Gap without c, which have a potential"):
        pm.DiscreteGradient(stop)
    with pytest.raises(ValueError, match="springs to be served must have no damper"):
        pm.rig.serve(stop)
