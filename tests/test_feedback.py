"""Loads that depend on the motion, f(t, u, v): they are restoring forces with the sign changed."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from agreement import assert_identical

import pmalpha as pm
from pmalpha import structures

SOFT = pm.GeneralizedAlpha(0.5)
FAST = pm.GeneralizedAlpha(0.5, explicit=True)


def controller(t, u, v):
    return [np.sin(3.0 * t) - 0.8 * v[0] - u[1], -0.3 * u[1] ** 3 - 0.1 * v[1]]


def restoring(t, u, v):
    return -np.array(controller(t, u, v))


def pair(coupling="gc", *, double=None, threads=None, scheme=SOFT, **loads):
    """A subdomain of two dofs with these loads, tied to an explicit one with three substeps."""
    K = [[30.0, -10.0], [-10.0, 30.0]]
    u0 = [0.1, 0.2]
    a = pm.Subdomain([1.0, 2.0], K, scheme=scheme, u0=u0, double_step=double, name="a", **loads)
    b = pm.Subdomain([1.0], [20.0], scheme=FAST, u0=[0.2], substeps=3, name="b")
    tie = pm.tie(a, [1], b, [0])
    return pm.Coupler([a, b], tie, dt=0.05, coupling=coupling, threads=threads)


# ---- a restoring force with the sign changed -------------------------------------------------


CASES = [("gc", None), ("pm", None), ("pm", True), ("macro", None), ("macro", True)]


@pytest.mark.parametrize("scheme", [SOFT, FAST], ids=["implicit", "explicit"])
@pytest.mark.parametrize(("coupling", "double"), CASES)
def test_it_is_bitwise_a_restoring_force_with_the_sign_changed(coupling, double, scheme):
    """Whatever calls make the run; what a restoring force dissipates is the work of the load."""
    first, second = (
        pair(coupling, double=double, scheme=scheme, **load)
        for load in (dict(force=controller), dict(restoring=restoring))
    )
    one, two = (c.run(steps=20, energy=True) for c in (first, second))
    assert_identical(replace(one, energy=None), replace(two, energy=None))
    assert np.array_equal(one.energy.external, -two.energy.dissipated)
    assert not one.energy.dissipated.any() and one.energy.external[-1, 0] != 0.0
    assert np.array_equal(one.energy.balance, two.energy.balance)
    for c in (first, second):
        c.step(3)
        c.change_steps(dt=0.04)
        c.restore(c.snapshot())
        c.step(2)
    assert_identical(first.run(steps=5), second.run(steps=5))
    assert_identical(first.run_each([{}], 0.4)[0], second.run_each([{}], 0.4)[0])


def test_it_is_evaluated_once_per_substep_in_the_order_of_time():
    log = []

    def logged(t, u, v):
        log.append(t)
        u[:], v[:] = np.nan, np.nan  # copies
        return [0.0]

    s = pm.Subdomain([1.0], [4.0], scheme=SOFT, substeps=4, force=logged, u0=[1.0])
    coupler = pm.Coupler([s], dt=0.1)
    assert log == []  # not before the first run or step
    history = coupler.run(steps=5)
    assert log == list(history[0].t) and np.all(np.isfinite(history[0].u))


def test_threads_and_springs_and_other_restoring_forces_go_with_it():
    """All three on one subdomain, against their sum as one restoring function."""

    def specimen(t, u, v):
        return np.array([2.0 * u[0] ** 3, 0.0])

    def both(t, u, v):
        return specimen(t, u, v) - np.array(controller(t, u, v))

    spring = pm.CubicSpring([1], k=3.0, k3=1.0)
    fed, summed = (
        pair("pm", threads=threads, restoring=[spring, r], restoring_stiffness=np.eye(2), **force)
        for r, force, threads in ((specimen, dict(force=controller), 2), (both, {}, 1))
    )
    assert_identical(fed.run(steps=30), summed.run(steps=30))


@pytest.mark.parametrize("scheme", [SOFT, FAST], ids=["implicit", "explicit"])
def test_a_feedback_of_velocity_and_displacement_is_of_order_two(scheme):
    """u'' + 9 u = -0.6 u' - 7 u, released at 1: damped vibration with omega 4, zeta 0.075."""
    omega, damping, T, errors = 4.0, 0.3, 2.0, []
    free = np.sqrt(omega**2 - damping**2)
    exact = np.exp(-damping * T) * (np.cos(free * T) + damping / free * np.sin(free * T))
    for dt in (0.02, 0.01):
        s = pm.Subdomain(
            [1.0], [9.0], scheme=scheme, u0=[1.0], force=lambda t, u, v: -0.6 * v - 7.0 * u
        )
        errors.append(abs(pm.solve(s, dt=dt, t_end=T).u[-1, 0] - exact))
    assert errors[0] < 0.02 and 3.5 < errors[0] / errors[1] < 4.5


# ---- other loads ---------------------------------------------------------------------------------


def test_other_loads_take_its_place_and_it_returns():
    coupler, plain = pair(force=controller), pair(force=[1.0, 2.0])
    first = coupler.run(steps=10)
    coupler.reset(force={"a": [1.0, 2.0]})
    assert_identical(coupler.run(steps=10), plain.run(steps=10))
    coupler.reset(force={"a": lambda t, u, v: np.zeros(2)})
    assert_identical(coupler.run(steps=10), pair().run(steps=10))
    coupler.reset()
    assert_identical(coupler.run(steps=10), first)
    cases = [{"force": {"a": load}} for load in ([1.0, 2.0], controller)]
    one, two = coupler.run_each(cases, 0.5)
    assert_identical(two, first)
    assert np.array_equal(one["a"].u[:1], first["a"].u[:1])
    with pytest.raises(ValueError, match="force of 'a' can only be a function of t, u and v where"):
        plain.reset(force={"a": controller})


def test_the_work_of_other_loads_in_its_place_is_theirs():
    coupler, plain = pair(force=controller), pair(force=[1.0, 2.0])
    coupler.reset(force={"a": [1.0, 2.0]})
    one, two = (c.run(steps=10, energy=True).energy for c in (coupler, plain))
    assert np.array_equal(one.external, two.external)
    assert not one.dissipated.any() and not two.dissipated.any()


def test_a_checkpoint_goes_on(tmp_path):
    coupler, fresh = pair(force=controller), pair(force=controller)
    coupler.step(7)
    coupler.save(tmp_path / "state.npz")
    fresh.load(tmp_path / "state.npz")
    assert_identical(coupler.run(steps=5), fresh.run(steps=5))
    with pytest.raises(ValueError, match="force of 'a'"):
        pair(force=lambda t: [0.0, 0.0]).load(tmp_path / "state.npz")


def test_static_takes_its_value_at_the_start():
    """K u = f(0, u0, v0), with those of the reset."""
    s = pm.Subdomain([1.0], [4.0], scheme=SOFT, v0=[3.0], name="s", force=lambda t, u, v: v + u)
    coupler = pm.Coupler([s], dt=0.1)
    assert coupler.static()["s"] == pytest.approx(0.75)
    coupler.reset(u0={"s": [5.0]}, v0={"s": [0.0]})
    assert coupler.static()["s"] == pytest.approx(1.25)
    spring = dict(internal=pm.CubicSpring([0], 1.0, 1.0))  # 4 u + u + u^3 = 6
    s = pm.Subdomain(
        [1.0], [4.0], scheme=SOFT, v0=[6.0], name="s", force=lambda t, u, v: v, **spring
    )
    assert pm.Coupler([s], dt=0.1).static()["s"] == pytest.approx(1.0)


# ---- which functions -----------------------------------------------------------------------------


class Method:
    def of_t(self, t):
        return [1.0]

    def of_motion(self, t, u, v):
        return [1.0]

    __call__ = of_motion


@pytest.mark.parametrize(
    ("function", "feeds_back"),
    [
        (lambda t: [1.0], False),
        (lambda t, gain=1.0, offset=0.0: [gain], False),
        (lambda *arguments: [float(len(arguments))], False),
        (lambda t, /: [1.0], False),
        (lambda t=0.0: [1.0], False),
        (Method().of_t, False),
        (np.cos, False),
        (lambda t, u, v: [1.0], True),
        (lambda t, u, v, gain=1.0, *, more=2.0: [1.0], True),
        (functools.partial(lambda gain, t, u, v: [gain], 1.0), True),
        (Method().of_motion, True),
        (Method(), True),
    ],
)
def test_the_required_arguments_decide(function, feeds_back):
    s = pm.Subdomain([1.0], [0.0], scheme=SOFT, force=function)
    assert s.has_feedback is feeds_back
    assert pm.solve(s, dt=0.1, steps=1).a[0, 0] == 1.0


@pytest.mark.parametrize("function", [lambda: [1.0], lambda t, u: [1.0], lambda t, u, v, w: [1.0]])
def test_other_numbers_of_arguments_are_refused(function):
    with pytest.raises(TypeError, match=r"force must be a function of t alone, or of t, u and v"):
        pm.Subdomain([1.0], [1.0], scheme=SOFT, force=function)
    with pytest.raises(TypeError, match=r"velocity must be a function of t alone, got one with"):
        pm.Constraint({"a": [[1.0]]}, velocity=controller)


def test_what_it_cannot_do_is_refused_by_name():
    s = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=SOFT, name="a", force=controller)
    own = pm.Coupler([s], dt=0.1)
    with pytest.raises(ValueError, match="got \"mean\" and such a force on 'a'"):
        pair("mean", force=controller)
    with pytest.raises(ValueError, match="force of 'a' must not be a function of t, u and v"):
        pair("macro", force=controller, internal=pm.CubicSpring([0], 1.0, 1.0))
    with pytest.raises(ValueError, match="tolerance must come without"):
        pair(force=controller).run(1.0, tolerance=1e-3)
    with pytest.raises(ValueError, match="loads that do not depend on the motion"):
        pm.analysis.amplification_matrix(own)
    with pytest.raises(ValueError, match="force must not be a function of t, u and v"):
        s.reduced([0], modes=0)
    rod = structures.rod(2, 1.0, EA=1.0, rhoA=1.0)
    with pytest.raises(TypeError, match="force must not be a function of t, u and v"):
        pm.cut(rod, [0, 1], scheme=SOFT, force=lambda t, u, v: np.zeros(3))


@pytest.mark.parametrize("value", [[1.0], [np.nan, 0.0], None])
def test_a_wrong_value_names_the_force_and_the_time(value):
    """The coupler is then at the last whole macro step."""

    def breaking(t, u, v):
        return value if t > 0.26 else [0.0, 0.0]

    coupler = pair(force=breaking)
    with pytest.raises(
        (TypeError, ValueError), match="force of subdomain 'a' at t = 0.3: its value"
    ):
        coupler.run(steps=20)
    assert coupler.step_count == 5
    assert coupler.last_history["a"].t[-1] == coupler.time == 0.25


# ---- functions of t, in advance ------------------------------------------------------------------


def test_functions_of_t_are_evaluated_ahead_in_chunks_that_depend_on_counts_only():
    """Never on the clock: 32 macro steps, or what is left."""
    log = []

    def force(t):
        log.append("f")
        return [0.0]

    def specimen(t, u, v):
        log.append("r")
        return 0.0 * u

    s = pm.Subdomain([1.0], [1.0], scheme=SOFT, substeps=2, force=force, restoring=specimen)
    pm.Coupler([s], dt=0.01).step(70)
    text = "".join(log)[2:]  # but those at t = 0
    assert text == "".join((x * 2 * n) for n in (32, 32, 6) for x in "fr")
