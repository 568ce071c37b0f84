"""Critical steps of explicit subdomains for the tangents of the present state."""

import warnings

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import analysis

EXPLICIT = pm.CentralDifference()


def hardening(calls=None):
    """2 u + u^3 on one dof; the tangent is 2 + 3 u^2."""

    def evaluate(t, u, v, q):
        if calls is not None:
            calls.append((u.copy(), t))
        return 2.0 * u + u**3, 2.0 + 3.0 * u**2

    return evaluate


def oscillator(internal, **options):
    return pm.Subdomain([1.0], None, scheme=EXPLICIT, internal=internal, name="rig", **options)


def steps_of(tangent, mass=1.0):
    """Omega_s = 2 of the central difference method."""
    return 2.0 / np.sqrt(tangent / mass)


# ---- when asked -----------------------------------------------------------------------------


@pytest.mark.parametrize("u", [0.0, 0.5, -2.0])
def test_the_critical_step_at_a_displacement(u):
    for internal in (hardening(), pm.CubicSpring([0], 2.0, 1.0)):
        step = analysis.critical_step(oscillator(internal), u=[u])
        # a double eigenvalue of modulus one is found to 1e-7
        np.testing.assert_allclose(step, steps_of(2.0 + 3.0 * u**2), rtol=1e-6)


def test_the_default_is_that_of_the_initial_displacements():
    rig = oscillator(hardening(), u0=[1.0])
    assert analysis.critical_step(rig) == analysis.critical_step(rig, u=[1.0])
    assert analysis.critical_step(rig) < analysis.critical_step(rig, u=[0.0])


def test_the_tangent_follows_velocity_and_history():
    def evaluate(t, u, v, q):
        stiffness = 1.0 + 3.0 * v**2 + 5.0 * q
        return stiffness * u, stiffness, None, q

    rig = oscillator(pm.InternalForce(evaluate, history=[0.0]))
    for v, q in ((0.0, 0.0), (1.0, 0.0), (0.0, 2.0)):
        step = analysis.critical_step(rig, v=[v], q=[q])
        np.testing.assert_allclose(step, steps_of(1.0 + 3.0 * v**2 + 5.0 * q), rtol=1e-6)


@pytest.mark.parametrize(
    "spring, u, tangent",
    [
        (pm.Gap([0], 9.0, 0.5), 0.4, 10.0),  # open: it will close
        (pm.Gap([0], 9.0, 0.5), 0.6, 10.0),
        (pm.Bilinear([0], 4.0, 1.0), 3.0, 5.0),  # yielded: it will unload with k
        (pm.CubicSpring([0], 4.0, -1.0), 1.0, 5.0),
    ],
)
def test_springs_count_with_their_larger_tangent(spring, u, tangent):
    rig = pm.Subdomain([1.0], [1.0], scheme=EXPLICIT, internal=spring)
    np.testing.assert_allclose(analysis.critical_step(rig, u=[u]), steps_of(tangent), rtol=1e-6)


def test_wrong_states_are_named():
    rig = oscillator(hardening())
    for name in "uvq":
        with pytest.raises(ValueError, match=f"^{name} must have shape"):
            analysis.critical_step(rig, **{name: [1.0, 2.0]})
    with pytest.raises(ValueError, match="finite"):
        analysis.critical_step(rig, u=[np.nan])


# ---- at the beginning of a run --------------------------------------------------------------


def stiffened():
    """A step that is stable at rest and above the critical one at u = 3, where it is 0.37."""
    coupler = pm.Coupler([oscillator(hardening())], dt=0.5)
    return coupler


def test_a_run_from_a_stiff_state_warns_once():
    coupler = stiffened()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coupler.run(steps=2)  # at rest
    coupler.reset(u0={"rig": [3.0]})
    with pytest.warns(pm.StabilityWarning, match="the step 0.5 of subdomain 'rig'") as caught:
        coupler.run(steps=1)
    assert sum(w.category is pm.StabilityWarning for w in caught) == 1
    critical = float(str(caught[0].message).split("critical step ")[1].split(":")[0])
    np.testing.assert_allclose(critical, steps_of(2.0 + 27.0), rtol=1e-5)


def test_a_step_does_not_warn_and_does_not_evaluate_more():
    calls = []
    coupler = pm.Coupler([oscillator(hardening(calls))], dt=0.5)
    coupler.reset(u0={"rig": [3.0]})
    del calls[:]
    coupler.step()
    # the start, the substep, and the start once more, for forces that remember outside of q
    assert len(calls) == 3
    coupler.reset(u0={"rig": [3.0]})
    del calls[:]
    with pytest.warns(pm.StabilityWarning):
        coupler.run(steps=1)
    assert len(calls) == 3  # the start, the present and the substep
    assert [t for _, t in calls] == [0.0, 0.0, 0.5]


def test_the_first_run_leaves_the_warning_to_the_coupler():
    calls = []
    with pytest.warns(pm.StabilityWarning):
        coupler = pm.Coupler([oscillator(hardening(calls), u0=[3.0])], dt=0.5)
    del calls[:]
    with warnings.catch_warnings():
        warnings.simplefilter("error", pm.StabilityWarning)
        coupler.run(steps=1)
    assert len(calls) == 3  # with the start once more, for forces that remember outside of q


def test_a_warning_as_an_error_leaves_the_coupler():
    coupler = stiffened()
    coupler.reset(u0={"rig": [3.0]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(pm.StabilityWarning):
            coupler.run(steps=1)
    assert coupler.step_count == 0
    assert coupler.state("rig").u[0] == 3.0


def chain(dt, gap):
    """An explicit chain behind an implicit mass, so that its elimination order is its own."""

    def evaluate(t, u, v, q):
        k = np.where(np.abs(q) > 0.05, 4e3, 1.0)  # stiffens for good once it has moved
        return k * u, k, None, np.maximum(np.abs(u), q)

    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), v0=[1.0], name="a")
    b = pm.Subdomain(
        [1.0, 1.0, 1.0],
        None,
        scheme=EXPLICIT,
        internal=[pm.InternalForce(evaluate, history=np.zeros(3)), pm.Gap([1], 1e4, gap)],
        v0=[1.0, 0.5, 0.0],
        name="b",
    )
    return b, pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling="gc")


SUDDEN = "ignore:.*closes a contact:pmalpha.StabilityWarning"  # stiffens within a step


@pytest.mark.filterwarnings(SUDDEN)
def test_the_history_of_a_state_counts():
    b, coupler = chain(0.01, gap=0.02)
    coupler.step(7)
    state, q = coupler.state("b"), coupler.run(steps=0)["b"].q[-1]
    assert q[0] > 0.05 and state.u[1] > 0.02
    # the closed stop at dof 1, whose own force has not stiffened
    step = analysis.critical_step(b, u=state.u, v=state.v, q=q)
    np.testing.assert_allclose(step, steps_of(1e4 + 1.0), rtol=1e-6)


@pytest.mark.filterwarnings("ignore:.*when contact is closed:pmalpha.StabilityWarning", SUDDEN)
def test_a_run_takes_the_histories_and_springs_of_the_present():
    _, coupler = chain(0.033, gap=9.0)
    coupler.step(1)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "the step", pm.StabilityWarning)
        coupler.run(steps=2)  # not yet stiffened
    # 4000 on a mass of 1 at dof 0, the last of the order: 2 / sqrt(4000)
    with pytest.warns(pm.StabilityWarning, match="critical step 0.0316228"):
        coupler.run(steps=1)
    _, coupler = chain(0.033, gap=0.01)
    coupler.step(1)
    with pytest.warns(pm.StabilityWarning, match="critical step 0.019999"):
        coupler.run(steps=1)  # the stop is closed


def test_implicit_subdomains_are_not_evaluated():
    calls = []
    mass = pm.Subdomain([1.0], None, scheme=pm.Newmark(), internal=hardening(calls), name="rig")
    coupler = pm.Coupler([mass], dt=0.5)
    coupler.reset(u0={"rig": [3.0]})
    coupler.step()
    count = len(calls)
    coupler.run(steps=0)
    assert len(calls) == count
