"""Delays of actuators, their compensation, and indicators of tracking: (Y1) to (Y9)."""

import numpy as np
import pytest
from scipy.optimize import root
from scipy.signal import lsim

import pmalpha as pm
from pmalpha import rig


def spring(k=1.0):
    return pm.CubicSpring([0], k=k, k3=0.0)


def oscillator(restoring, *, k, c=0.0, k_r=None, u0=1.0, v0=0.0):
    return pm.Subdomain(
        [1.0],
        [k],
        C=[c] if c else None,
        scheme=pm.CentralDifference(),
        damping="lagged" if c else "implicit",
        u0=[u0],
        v0=[v0],
        restoring=restoring,
        restoring_stiffness=k_r,
        name="m",
    )


def energy_of(history, k):
    return 0.5 * history.v[:, 0] ** 2 + 0.5 * k * history.u[:, 0] ** 2


# ---- what a delay does (Y8), (Y9) ----------------------------------------------------------------


ADDED = "forces of subdomain 'm' have added energy"
# what is measured here is that growth
GROWS = pytest.mark.filterwarnings(f"ignore:{ADDED}:pmalpha.StabilityWarning")


@GROWS
@pytest.mark.parametrize("tau", [0.002, 0.004, 0.01])
def test_an_undamped_oscillator_grows_at_every_delay_at_the_rate_of_the_exact_root(tau):
    k = k_e = 50.0
    late = rig.SimulatedActuator(spring(k_e), delay=tau)
    mass = oscillator(late, k=k, k_r=[k_e])
    history = pm.Coupler([mass], dt=1e-3).run(10.0)["m"]
    late_half = history.t > 1.0  # past the start, at rest before
    slope = np.polyfit(history.t[late_half], np.log(energy_of(history, k + k_e)[late_half]), 1)[0]

    def characteristic(x):
        s = complex(*x)
        value = s**2 + k + k_e * np.exp(-s * tau)
        return value.real, value.imag

    exact = root(characteristic, [k_e * tau / 2.0, np.sqrt(k + k_e)], tol=1e-12).x[0]
    # the fit over whole periods is good to some 1e-3; (Y8) is the first term in tau
    assert slope / 2.0 == pytest.approx(exact, rel=3e-3)
    assert exact == pytest.approx(k_e * tau / 2.0, rel=0.02)


def growth(restoring, k, k_total, c=0.0, end=20.0):
    mass = oscillator(restoring, k=k, c=c)
    history = pm.Coupler([mass], dt=2e-3).run(end)["m"]
    energy = energy_of(history, k_total)
    quarter = energy.size // 4
    return energy[-quarter:].mean() / energy[quarter : 2 * quarter].mean()


@GROWS
@pytest.mark.parametrize(("share", "grows"), [(0.95, False), (1.05, True)])
def test_with_damping_there_is_a_critical_delay(share, grows):
    m, k, k_e = 1.0, 60.0, 40.0
    c = 2.0 * 0.05 * np.sqrt(k + k_e)
    b = 2.0 * m * k - c**2
    w = np.sqrt((b + np.sqrt(b**2 - 4.0 * m**2 * (k**2 - k_e**2))) / (2.0 * m**2))
    tau = np.arccos((m * w**2 - k) / k_e) / w
    assert tau == pytest.approx(25.26e-3, abs=1e-5)
    late = rig.SimulatedActuator(spring(k_e), delay=share * tau)
    assert (growth(late, k, k + k_e, c) > 1.0) == grows


@GROWS
@pytest.mark.parametrize(("share", "grows"), [(0.95, False), (1.05, True)])
def test_a_dashpot_as_specimen_has_a_critical_delay(share, grows):
    m, k, c_e = 1.0, 100.0, 2.0
    w = (c_e + np.sqrt(c_e**2 + 4.0 * m * k)) / (2.0 * m)
    late = rig.SimulatedActuator(lambda t, u, v: c_e * v, delay=share * np.pi / (2.0 * w))
    assert (growth(late, k, k, end=8.0) > 1.0) == grows


# ---- actuators -----------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.02, 0.0237, 0.004])
def test_a_command_arrives_after_the_delay_between_steps_too(delay):
    t, w = 0.01 * np.arange(400), 5.0
    late = rig.SimulatedActuator(spring(), delay=delay)
    response = late.respond(np.sin(w * t), 0.01)
    # cubics between samples: 3/128 (w h)^4 = 1.5e-7, in the first interval ten times that
    assert np.abs(response.measured - np.sin(w * (t - delay)))[20:].max() < 2e-6
    np.testing.assert_array_equal(response.force, response.measured)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_dynamics_are_those_of_the_transfer_function(order):
    w, damping, t = 2.0 * np.pi * 8.0, 0.6, 0.002 * np.arange(600)
    lag, pair = [1.0 / w, 1.0], [1.0 / w**2, 2.0 * damping / w, 1.0]
    polynomial = {1: lag, 2: pair, 3: np.polymul(lag, pair)}[order]
    command = np.interp(t, [0.0, 0.1, 0.5, 0.8, 2.0], [0.0, 1.0, -0.5, 0.3, 0.3])
    actuator = rig.SimulatedActuator(spring(), order=order, frequency=8.0, damping=damping)
    expected = lsim(([1.0], polynomial), command, t)[1]  # exact for commands linear in steps
    response = actuator.respond(command, 0.002)
    assert np.abs(response.measured - expected).max() < 1e-10
    velocity = []
    probe = rig.SimulatedActuator(
        lambda t, u, v: velocity.append(v[0]) or u, order=order, frequency=8.0, damping=damping
    )
    probe.respond(command, 0.002)
    # differences over two steps of a curve with corners in its slope, of the first order: w h = 0.1
    differences = np.gradient(expected, t)
    assert np.abs(velocity - differences)[2:-2].max() < 0.05 * np.abs(velocity).max()


def test_commands_saturate_and_displacements_are_rounded():
    t = 0.01 * np.arange(700)
    actuator = rig.SimulatedActuator(spring(2.0), saturation=0.5, quantum=0.125)
    response = actuator.respond(np.sin(t), 0.01)
    expected = 0.125 * np.round(np.clip(np.sin(t), -0.5, 0.5) / 0.125)
    np.testing.assert_array_equal(response.measured, expected)
    np.testing.assert_array_equal(response.force, 2.0 * expected)


def test_noise_has_its_deviation_and_is_repeated_by_its_seed():
    still = np.zeros((20000, 2))
    several = pm.CubicSpring([0, 1], k=[1.0, 1.0], k3=0.0)

    def noise(**seed):
        return rig.SimulatedActuator(several, noise=0.1, **seed).respond(still, 0.01).measured

    first = noise(seed=4)
    np.testing.assert_array_equal(first, noise(seed=4))
    assert not np.array_equal(first, noise(seed=5))
    assert not np.array_equal(noise(), noise())
    # of 20000 numbers each: mean and deviation to 4 standard errors, no correlation
    assert np.abs(first.mean(axis=0)).max() < 4 * 0.1 / np.sqrt(20000)
    assert np.abs(first.std(axis=0) - 0.1).max() < 4 * 0.1 / np.sqrt(40000)
    pairs = [(first[:, 0], first[:, 1]), (first[1:, 0], first[:-1, 0])]
    assert max(abs(np.corrcoef(*pair)[0, 1]) for pair in pairs) < 4 / np.sqrt(20000)


# ---- compensation (Y4) to (Y7) -------------------------------------------------------------------


@pytest.mark.parametrize(("order", "printed"), [(1, 4.0e-2), (2, 8.0e-3), (3, 1.6e-3), (4, 3.2e-4)])
def test_a_polynomial_leaves_the_power_of_twice_the_sine(order, printed):
    w, tau, h = 10.0, 0.02, 0.001
    t = h * np.arange(4000)
    late = rig.SimulatedActuator(spring(), delay=tau)
    measured = rig.Compensated(late, tau, order=order).respond(np.sin(w * t), h).measured
    error = np.abs(measured - np.sin(w * t))[200:].max()
    exact = (2.0 * np.sin(w * tau / 2.0)) ** (order + 1)
    assert error == pytest.approx(exact, rel=1e-3)  # peaks between samples: (w h)^2 / 8
    assert exact == pytest.approx(printed, rel=0.02)


def test_the_inverse_of_a_lag_has_its_amplitude_and_undoes_a_lag_of_steps():
    w, tau, h = 10.0, 0.02, 0.001
    t = h * np.arange(4000)
    late = rig.SimulatedActuator(spring(), delay=tau)
    measured = rig.Compensated(late, tau, "inverse").respond(np.sin(w * t), h).measured
    indicators = rig.tracking(np.sin(w * t)[600:], measured[600:], h)
    # of backward differences, first order in h: w^2 tau h / 2 = 1e-3
    assert indicators.amplitude == pytest.approx(np.sqrt(1.0 + (w * tau) ** 2), rel=2e-3)
    assert indicators.delay * w == pytest.approx(w * tau - np.arctan(w * tau), abs=2e-3)


def loop(specimen):
    mass = oscillator(specimen, k=50.0, k_r=[50.0], u0=0.0, v0=10.0)
    return pm.Coupler([mass], dt=1e-3).run(steps=1885)["m"].u[:, 0]  # three periods


@GROWS  # order 1 leaves a fifth of it
def test_compensation_in_the_loop_leaves_the_published_errors():
    exact = loop(spring(50.0))
    late = rig.SimulatedActuator(spring(50.0), delay=0.02)
    with pytest.warns(pm.StabilityWarning, match=ADDED):
        errors = [np.abs(loop(late) - exact).max()]
    errors += [
        np.abs(loop(rig.Compensated(late, 0.02, order=N)) - exact).max() for N in (1, 2, 3, 4)
    ]
    errors.append(np.abs(loop(rig.Compensated(late, 0.02, "inverse")) - exact).max())
    # in per cent, as measured by another program, whose steps and start are others: the order of
    # the error and one digit
    np.testing.assert_allclose(100 * np.array(errors), [137, 20, 3.4, 0.76, 0.25, 9.4], rtol=0.2)


def motion(h, seconds):
    t = h * np.arange(round(seconds / h))
    parts = [(0.7, 0.0), (1.3, 1.0), (2.9, 2.0)]
    return np.minimum(1.0, t) * sum(np.sin(2.0 * np.pi * f * t + p) for f, p in parts)


@pytest.mark.gate
@pytest.mark.parametrize("guess", [0.0, 0.04])
def test_the_adaptive_compensation_finds_a_delay_and_an_amplitude(guess):
    h = 1 / 512
    d = motion(h, 6.0)

    def weak(t, u, v):  # measures 0.9 of what it was sent
        return u, 0.9 * u

    late = rig.SimulatedActuator(weak, delay=0.02)
    measured = rig.Compensated(late, guess, "adaptive").respond(d, h).measured
    before = rig.tracking(d[1500:], rig.Compensated(late, guess).respond(d, h).measured[1500:], h)
    after = rig.tracking(d[1500:], measured[1500:], h)
    assert after.nrmse < 0.01 < 0.1 < before.nrmse
    assert abs(after.delay) < 1e-4
    assert after.amplitude == pytest.approx(1.0, abs=1e-3)


def test_the_adaptive_compensation_needs_what_was_measured():
    with pytest.raises(TypeError, match="must return the measured displacement"):
        rig.Compensated([spring()], 0.02, "adaptive")
    alone = rig.Compensated(lambda t, u, v: u, 0.02, "adaptive")
    with pytest.raises(TypeError, match=r"must return \(r, x\).*got r alone"):
        alone.respond([0.0, 1.0], 0.01)
    mass = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), restoring=alone, name="m")
    with pytest.raises(TypeError, match=r"restoring of subdomain 'm' at t = 0: .* must return"):
        pm.Coupler([mass], dt=0.1).run(1.0)


# ---- in a coupler --------------------------------------------------------------------------------


class Late:
    """A spring that has the command of the step before, in Python."""

    def __init__(self, k, begin):
        self.k, self.before = k, np.array(begin)

    def __call__(self, t, u, v):
        r, self.before = self.k * self.before, u
        return r


def problem(restoring, coupling, **rig_options):
    chain = pm.Subdomain(
        [1.0, 1.0],
        np.array([[2.0, -1.0], [-1.0, 1.0]]),
        scheme=pm.GeneralizedAlpha(0.8),
        u0=[0.3, 0.5],
        substeps=8 if rig_options.get("double_step") else 1,
        double_step=coupling == "pm" and not rig_options.get("double_step"),
        name="chain",
    )
    options = dict(scheme=pm.GeneralizedAlpha(0.9), substeps=4) | rig_options
    test = pm.Subdomain(
        [1.0, 1.0], [1.0, 2.0], restoring=restoring, u0=[0.5, 0.1], name="rig", **options
    )
    return pm.Coupler([chain, test], pm.tie(chain, [1], test, [0]), dt=0.1, coupling=coupling)


KINDS = [
    ("pm", {}),
    ("pm", dict(scheme=pm.CentralDifference(), double_step=True)),
    ("gc", {}),
    (
        "gc",
        dict(substeps=1, internal=pm.InternalForce(lambda t, u, v, q: (u**3, np.diag(3 * u**2)))),
    ),
    ("pm", dict(substeps=1, double_step=False)),
]


@pytest.mark.parametrize(("coupling", "options"), KINDS)
def test_a_delay_of_one_step_is_that_of_a_function_with_a_memory(coupling, options):
    h = 0.1 / options.get("substeps", 4)
    k = np.array([3.0, 4.0])
    late = rig.SimulatedActuator(pm.CubicSpring([0, 1], k=k, k3=0.0), delay=h)
    runs = [
        problem(restoring, coupling, **options).run(2.0)
        for restoring in (late, Late(k, [0.5, 0.1]), pm.CubicSpring([0, 1], k=k, k3=0.0))
    ]
    np.testing.assert_array_equal(runs[0]["rig"].u, runs[1]["rig"].u)
    np.testing.assert_array_equal(runs[0].multipliers, runs[1].multipliers)
    assert not np.array_equal(runs[0]["rig"].u, runs[2]["rig"].u)


def complete():
    inner = rig.SimulatedActuator(
        pm.Bilinear([0, 1], k=3.0, fy=0.2, hardening=0.1),
        delay=0.04,
        frequency=5.0,
        noise=1e-3,
        seed=1,
    )
    return [rig.Compensated(inner, 0.1, "adaptive"), rig.SimulatedActuator(inner, delay=0.03)]


def test_the_state_is_saved_restored_and_kept_by_what_fails(tmp_path):
    fails = [False]

    def failing(t, u, v):
        if fails[0] and t > 0.75:
            raise RuntimeError("torn off")
        return 0.0 * u

    def make():
        return problem([*complete(), failing], "pm")

    whole = make().run(2.0)
    coupler = make()
    first = coupler.run(0.5)
    coupler.save(tmp_path / "state.npz")
    present = coupler.snapshot()
    fails[0] = True
    with pytest.raises(RuntimeError, match="torn off"):
        coupler.run(2.0)
    fails[0] = False
    rests = [coupler.run(2.0)]
    coupler.restore(present)
    rests.append(coupler.run(2.0))
    loaded = make()
    loaded.load(tmp_path / "state.npz")
    rests.append(loaded.run(2.0))
    for rest in rests:
        np.testing.assert_array_equal(rest["rig"].u[-40:], whole["rig"].u[-40:])
    coupler.reset()
    np.testing.assert_array_equal(coupler.run(0.5)["rig"].u, first["rig"].u)
    assert np.isfinite(whole["rig"].u).all()


def test_cases_side_by_side_are_those_of_reset():
    coupler = problem(complete(), "pm")
    cases = [{"u0": {"rig": [0.5, x]}} for x in (0.0, 0.2)]
    for case, history in zip(cases, coupler.run_each(cases, 1.0)):
        coupler.reset(**case)
        np.testing.assert_array_equal(coupler.run(1.0)["rig"].u, history["rig"].u)


def test_another_actuator_is_another_problem_and_other_steps_are_refused(tmp_path):
    def make(delay):
        return problem(rig.SimulatedActuator(spring(), delay=delay), "gc")

    coupler = make(0.02)
    coupler.run(0.5)
    coupler.save(tmp_path / "state.npz")
    with pytest.raises(ValueError, match="delay=0.02.*delay=0.03"):
        make(0.03).load(tmp_path / "state.npz")
    before = coupler.state("rig").u
    with pytest.raises(ValueError, match="'rig' must stay 0.025, got 0.05.*actuators"):
        coupler.change_steps(substeps={"rig": 2})
    with pytest.raises(ValueError, match="tolerance must come without restoring functions"):
        coupler.run(1.0, tolerance=1e-3)
    np.testing.assert_array_equal(coupler.state("rig").u, before)
    coupler.change_steps(substeps={"chain": 2})
    coupler.run(1.0)


def test_a_specimen_may_return_what_was_measured():
    plain = problem(lambda t, u, v: 3.0 * u, "pm").run(1.0)
    both = problem(lambda t, u, v: (3.0 * u, 0.0 * u), "pm").run(1.0)
    np.testing.assert_array_equal(plain["rig"].u, both["rig"].u)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (dict(delay=-0.1), ValueError, "delay must be finite and at least 0"),
        (dict(delay=np.nan), ValueError, "delay must be finite"),
        (dict(order=4), ValueError, "order must be at most 3, got 4"),
        (dict(frequency=0.0), ValueError, "frequency must be positive"),
        (dict(frequency=1e-300), ValueError, "frequency must be at least 1e-50"),
        (dict(damping=-1.0), ValueError, "damping must be positive"),
        (dict(noise=-1.0), ValueError, "noise must be"),
        (dict(saturation=0.0), ValueError, "saturation must be positive"),
        (dict(quantum=0.0), ValueError, "quantum must be positive"),
        (dict(seed=-1), ValueError, "seed must be at least 0"),
    ],
)
def test_bad_actuators_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        rig.SimulatedActuator(spring(), **options)


def test_dynamics_that_are_far_faster_than_the_step_are_refused():
    quick = rig.SimulatedActuator(spring(), frequency=1e8)
    mass = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), restoring=quick, name="rig")
    with pytest.raises(ValueError, match="at most 10000 in a step of 0.01, got 1e\\+08"):
        pm.Coupler([mass], dt=0.01)


def test_bad_specimens_and_methods_are_refused():
    for wrong in (3.0, None, [], [spring(), lambda t, u, v: u], [[spring()]]):
        with pytest.raises(TypeError, match="specimen must be a callable"):
            rig.SimulatedActuator(wrong)
    with pytest.raises(ValueError, match="method must be"):
        rig.Compensated(spring(), 0.1, "fast")
    with pytest.raises(ValueError, match="order must be at least 1"):
        rig.Compensated(spring(), 0.1, order=0)
    with pytest.raises(ValueError, match="dof"):
        problem(rig.SimulatedActuator(pm.CubicSpring([5], k=1.0, k3=0.0)), "pm")
    with pytest.raises(ValueError, match="delay must be at most"):
        rig.SimulatedActuator(spring(), delay=1e9).respond([0.0, 1.0], 0.01)


# ---- indicators ----------------------------------------------------------------------------------


def test_indicators_of_a_late_sine_have_their_closed_forms():
    w, tau, A, h = 10.0, 0.012, 0.9, 0.001
    t = h * np.arange(2513)  # four periods
    d, x = np.sin(w * t), A * np.sin(w * (t - tau))
    found = rig.tracking(d, x, h)
    assert found.delay == pytest.approx(tau, abs=1e-6)
    assert found.amplitude == pytest.approx(A, rel=1e-3)  # the windows end elsewhere in the period
    error = np.sqrt(1.0 + A**2 - 2.0 * A * np.cos(w * tau))
    assert found.nrmse == pytest.approx(error, rel=2e-3)
    assert found.J1 == pytest.approx(12.0)
    assert found.J2 == pytest.approx(100.0 * error, rel=2e-3)
    assert found.J3 == pytest.approx(100.0 * error, rel=1e-3)
    # integral of x d' over a period: - pi A sin(w tau); of x x' nothing
    assert found.energy == pytest.approx(-4.0 * np.pi * A * np.sin(w * tau), rel=2e-3)
    assert found.energies[-1] == found.energy and found.energies[0] == 0.0
    assert found.J4 is None
    doubled = rig.tracking(d, x, h, force=2.0 * x)
    assert doubled.energy == pytest.approx(2.0 * found.energy)


@pytest.mark.gate
def test_an_early_displacement_has_a_negative_delay_and_one_of_many_samples_is_found():
    t = 1e-4 * np.arange(8000)
    d = np.sin(10.0 * t) + 0.3 * np.sin(37.0 * t)

    def at(tau):
        s = t - tau
        return rig.tracking(d, np.sin(10.0 * s) + 0.3 * np.sin(37.0 * s), 1e-4).delay

    assert at(-0.005) == pytest.approx(-0.005, abs=2e-4)
    assert at(0.03) == pytest.approx(0.03, abs=2e-4)


def test_the_criteria_of_storeys_compare_with_the_reference():
    t = 0.01 * np.arange(1000)
    r = np.stack([np.sin(t), 2.0 * np.sin(t), 3.0 * np.sin(t)], axis=1)
    found = rig.tracking(r[:, 0], r[:, 0], 0.01, response=r * [1.01, 0.98, 1.03], reference=r)
    values = [found.J4, found.J5, found.J6, found.J8, found.J7, found.J9]
    np.testing.assert_allclose(values, [1.0, 1.0, 2.0, 2.0, 3.0, 3.0], rtol=1e-9)
    assert found.nrmse == found.J2 == found.delay == 0.0
    with pytest.raises(TypeError, match="both response and reference"):
        rig.tracking(r[:, 0], r[:, 0], 0.01, response=r)


@pytest.mark.parametrize(
    ("command", "measured", "message"),
    [
        ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0], "at least 4 samples"),
        ([1.0] * 5, [1.0] * 5, "that vary"),
        ([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0], r"measured must have shape \(4,\)"),
        ([1.0, 2.0, np.nan, 4.0], [1.0] * 4, "command must be finite"),
    ],
)
def test_bad_records_are_refused(command, measured, message):
    with pytest.raises(ValueError, match=message):
        rig.tracking(command, measured, 0.1)
