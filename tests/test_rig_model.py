"""Linear specimens, the inverse of a model, and their loop: (Y13) to (Y18)."""

import pickle
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
import rig_reference as reference
from rig_benchmark import GROUND, RESTED, actuator, criteria, run
from rig_reference import FORCE_NOISE, NOISE, H, Plant, perturbed
from scipy.signal import lsim

import pmalpha as pm
from pmalpha import StabilityWarning, rig

GROWS = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
NOISY = {"noise": NOISE, "force_noise": FORCE_NOISE, "seed": 3}
W = 2.0 * np.pi
PAIR = [W * (-50.0 + 63.0j), W * (-50.0 - 63.0j)]
BOTH = [-120.0 * W, -90.0 * W]


def two_actuators(**options):
    """Of the multi-axial benchmark (2023): displacements of two actuators over two commands."""
    first, second = [-2.65 * W, -40.0 * W, *PAIR], [-3.5 * W, -18.5 * W, *PAIR]
    zeros = [[BOTH, [-3.0 * W]], [BOTH, [-5.0 * W]]]
    gains = [[2165.2, 4.5394e6], [349.95, 1.9238e7]]
    stiffness = [[2.0e6, -1.0e5], [-1.0e5, 3.0e6]]
    poles = [[first, second], [first, second]]
    return rig.LinearActuator.from_zpk(zeros, poles, gains, stiffness=stiffness, **options)


# ---- linear specimens ----------------------------------------------------------------------------


def test_the_servo_hydraulic_actuator_is_that_of_the_published_transfer_function():
    plant = rig.servo_hydraulic(mass=29.13, stiffness=1.19e6, damping=114.2209)
    published = [-7.6728, -29.2848 - 36.5917j, -29.2848 + 36.5917j]
    published += [-1.2738 - 67.1335j, -1.2738 + 67.1335j]
    # four decimals of cycles per second
    np.testing.assert_allclose(plant.poles / W, published, rtol=0.0, atol=6e-5)
    np.testing.assert_allclose(plant.poles, sorted_roots(Plant()), rtol=1e-6)
    assert plant.response(0.0).real == pytest.approx(1.0075145, rel=1e-7)
    at = plant.response(3.6)
    assert abs(at) == pytest.approx(0.915905, rel=1e-5)
    assert -np.angle(at) / (W * 3.6) == pytest.approx(23.7406e-3, rel=1e-5)
    assert plant.response([0.0, 3.6])[1] == at
    late = rig.servo_hydraulic(mass=29.13, stiffness=1.19e6, damping=114.2209, delay=0.002)
    assert late.response(3.6) == pytest.approx(at * np.exp(-0.002j * W * 3.6), rel=1e-12)


def sorted_roots(plant):
    """Roots of the polynomial D of (R2), as `poles` are sorted."""
    values = np.roots(plant.inverse)
    return values[np.lexsort([values.imag, np.abs(values).round(9)])]


@pytest.mark.parametrize("hold", ["linear", "zero"])
def test_a_linear_specimen_is_integrated_exactly(hold):
    commands = np.random.default_rng(1).standard_normal(2000)
    commands[0] = 0.0
    response = actuator(hold=hold).respond(commands, H)
    A, B, x, f = Plant().matrices
    t = H * np.arange(commands.size)
    for row, values in ((x, response.measured), (f, response.force)):
        system = A, B[:, None], row[None], np.zeros((1, 1))
        expected = lsim(system, commands, t, interp=hold == "linear")[1]
        # of one matrix exponential each, whose entries span thirteen decades
        np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_zeros_and_poles_make_the_same_specimen():
    plant = Plant()
    k, c, m = plant.stiffness, plant.damping, plant.mass
    gain = 2.1283e13 * plant.gain / m
    options = {"stiffness": k, "damping": c, "mass": m}
    same = rig.LinearActuator.from_zpk([], sorted_roots(plant), gain, **options)
    commands = np.random.default_rng(2).standard_normal(500)
    one, other = (x.respond(commands, H) for x in (same, actuator(plant)))
    for name in ("measured", "force"):
        expected = getattr(other, name)
        # both from roots of a polynomial of degree five, good to 1e-13 of their size
        error = np.abs(getattr(one, name) - expected).max()
        assert error < 1e-9 * np.abs(expected).max()


def test_it_begins_at_rest_under_its_first_command_and_late_commands_arrive_late():
    plant = actuator()
    still = plant.respond(np.full(50, 0.003), H)
    # 1e-10: the inverse of A, whose entries span thirteen decades
    np.testing.assert_allclose(still.measured, 0.003 * 1.0075144635, rtol=1e-9)
    np.testing.assert_allclose(still.force, 1.19e6 * still.measured, rtol=1e-9)
    commands = np.random.default_rng(3).standard_normal(300)
    late = actuator(delay=5 * H).respond(commands, H).measured
    on_time = plant.respond(np.concatenate([np.full(5, commands[0]), commands[:-5]]), H).measured
    np.testing.assert_array_equal(late, on_time)


def test_undamped_poles_are_allowed():
    plant = rig.LinearActuator(
        [[0.0, 1.0], [-1e4, 0.0]], [[0.0], [1e4]], [[1.0, 0.0]], [[2.0, 0.0]]
    )
    commands = np.append(0.0, np.ones(999))
    t = H * np.arange(1000)
    # a ramp of one step and then 1: 1 - cos(100 t), averaged over the step
    expected = 1.0 - (np.sin(100.0 * t) - np.sin(100.0 * (t - H))) / (100.0 * H)
    response = plant.respond(commands, H)
    np.testing.assert_allclose(response.measured[1:], expected[1:], rtol=0, atol=1e-11)


def test_two_actuators_respond_as_their_transfer_functions():
    plant = two_actuators()
    assert len(plant.A) == 8
    frequencies = np.array([0.0, 2.29, 20.0])
    s = 2j * np.pi * frequencies
    both = np.prod([s - z for z in BOTH], axis=0)
    below = [
        np.prod([s - p for p in poles], axis=0)
        for poles in ([-2.65 * W, -40.0 * W, *PAIR], [-3.5 * W, -18.5 * W, *PAIR])
    ]
    expected = np.empty((3, 2, 2), complex)
    expected[:, 0, 0], expected[:, 1, 0] = 2165.2 * both / below[0], 349.95 * both / below[0]
    expected[:, 0, 1] = 4.5394e6 * (s + 3.0 * W) / below[1]
    expected[:, 1, 1] = 1.9238e7 * (s + 5.0 * W) / below[1]
    np.testing.assert_allclose(plant.response(frequencies), expected, rtol=1e-9)
    published = [[0.8638, 0.1311], [0.1396, 0.9258]]
    np.testing.assert_allclose(plant.response(0.0).real, published, atol=6e-5)
    h, commands = 1.0 / 1024.0, np.random.default_rng(4).standard_normal((600, 2))
    commands[0] = 0.0
    t = h * np.arange(600)
    response = plant.respond(commands, h)
    for matrix, values in ((plant.C, response.measured), (plant.F, response.force)):
        answer = lsim((plant.A, plant.B, matrix, np.zeros((2, 2))), commands, t)[1]
        np.testing.assert_allclose(values, answer, rtol=0.0, atol=1e-8 * np.abs(answer).max())


def test_rows_with_other_poles_have_states_of_their_own():
    lag, other = [-50.0], [-20.0]
    plant = rig.LinearActuator.from_zpk(
        [[[], []], [[], []]], [[lag, lag], [other, lag]], [[50.0, 0.0], [2.0, 50.0]], stiffness=1.0
    )
    assert len(plant.A) == 3
    np.testing.assert_allclose(plant.response(0.0), [[1.0, 0.0], [0.1, 1.0]], rtol=1e-12)


def test_noise_has_its_deviations_and_measurements_are_multiples_of_the_quantum():
    commands = 0.003 * np.sin(W * 1.3 * H * np.arange(40000))
    true, noisy, again = (actuator(**x).respond(commands, H) for x in ({}, NOISY, NOISY))
    x, f = noisy.measured - true.measured, noisy.force - true.force
    # of 40000 numbers each the deviation is known to 0.35 per cent
    assert x.std() == pytest.approx(NOISE, rel=0.02)
    assert f.std() == pytest.approx(FORCE_NOISE, rel=0.02)
    assert abs(np.corrcoef(x, f)[0, 1]) < 0.02
    np.testing.assert_array_equal(noisy.measured, again.measured)
    np.testing.assert_array_equal(noisy.force, again.force)
    rounded = actuator(quantum=2.0**-18, saturation=0.002).respond(commands, H)
    steps = rounded.measured * 2.0**18
    np.testing.assert_array_equal(steps, np.round(steps))
    held = actuator(saturation=0.002).respond(commands, H).measured
    clipped = actuator().respond(np.clip(commands, -0.002, 0.002), H).measured
    np.testing.assert_array_equal(held, clipped)
    assert np.abs(rounded.measured - held).max() < 2.0**-17  # a quantum of commands, half of x


# ---- loops ---------------------------------------------------------------------------------------


def growth(history, after):
    """The rate of the peaks of storey 1 once the ground is at rest."""
    x = np.abs(history.u[:, 0])
    peaks = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:]) & (history.t[1:-1] > after)) + 1
    return np.polyfit(history.t[peaks], np.log(x[peaks]), 1)[0]


SHORT = np.where(np.arange(round(12.0 / H)) * H < 2.0, np.resize(GROUND, round(12.0 / H)), 0.0)


@GROWS
@pytest.mark.parametrize(("case", "rate"), [(1, 0.5235), (4, 0.9549)])
def test_without_compensation_the_loop_grows_at_the_rate_of_its_poles(case, rate):
    # 2 s of ground motion, and 4 s until the faster modes have decayed, at .12 and more a second
    assert growth(run(case, actuator(), a=SHORT), 6.0) == pytest.approx(rate, rel=0.01)


@pytest.mark.gate
@GROWS
def test_extrapolation_by_the_delay_at_the_first_frequency_makes_the_loop_grow():
    # its delays of 97, 194 and 291 steps are states of the loop whose poles are computed
    with pytest.warns(StabilityWarning, match="with its rig grows") as seen:
        history = run(1, rig.Compensated(actuator(), 0.0237406), a=SHORT[: round(5.0 / H)])
    rate = float(re.search(r"grows as exp\((.*) t\)", str(seen[0].message))[1])
    # from one second before the end on, when the other modes are below 1e-3 of this one
    assert growth(history, 4.0) == pytest.approx(rate, rel=0.01)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("case", "delay", "ahead", "rate"),
    [
        (4, 0.0087, None, -0.0028),
        (4, 0.0090, None, 0.0203),
        (1, 0.02, 0.004, 0.0984),
        (1, 0.02, 0.012, -0.5257),
    ],
)
def test_a_loop_just_beyond_its_margin_grows_and_is_warned_of(case, delay, ahead, rate):
    """With a dead time that the model does not have; of case 4 its poles cross at 8.74 ms.

    What extrapolates commands `ahead` of the inverse extrapolates their velocities too.
    """
    specimen = rig.Compensated(actuator(delay=delay), method="model", model=actuator())
    if ahead is not None:
        specimen = rig.Compensated(specimen, ahead)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", StabilityWarning)
        history = run(case, specimen, a=np.append(SHORT, np.zeros(SHORT.size)))
    growing = [str(x.message) for x in seen if "grows as exp" in str(x.message)]
    # peaks of 24 s, sampled 4096 times a second
    assert growth(history, 6.0) == pytest.approx(rate, abs=2e-4)
    assert bool(growing) == (rate > 0.0)
    if growing:
        said = float(growing[0].split("exp(")[1].split(" t)")[0])
        assert said == pytest.approx(rate, abs=1e-4)


NOMINAL = [(case, Plant()) for case in (1, 2, 3, 4)]
COMPARED = 8192  # steps of the independent loops, 2 s
FED_BACK = [(1, Plant()), (1, perturbed(6)), (1, perturbed(7))]


@pytest.fixture(scope="module")
def independent():
    """The loops of the reference with the inverse of the nominal model, and with feedback."""
    inverse, feedback = reference.ModelInverse(4), reference.ModelInverse(3, feedback=10.0)
    return (
        reference.run(*zip(*NOMINAL), GROUND[:COMPARED], inverse),
        reference.run(*zip(*FED_BACK), GROUND[:COMPARED], feedback),
    )


@pytest.mark.gate
@pytest.mark.parametrize("i", range(4))
def test_the_inverse_of_the_model_is_that_of_an_independent_loop(independent, i):
    case, plant = NOMINAL[i]
    history = run(case, rig.Compensated(actuator(plant), method="model"))
    expected = independent[0]
    pairs = [
        (history.u, expected.u[:, i]),
        (history.rig.sent[:, 0], expected.sent[:, i]),
        (history.rig.force[:, 0], expected.f[:, i]),
    ]
    for value, other in pairs:  # rounding of 8000 steps: 1e-11
        assert np.abs(value[:COMPARED] - other).max() < 1e-9 * np.abs(other).max()
    J = criteria(case, history)
    assert J[0] == 0.0
    assert np.all(J[[1, 3, 5, 7]] < [0.05, 0.15, 0.15, 0.1])
    answer = actuator(plant).respond(history.rig.sent[:, 0], H).measured
    np.testing.assert_array_equal(history.rig.measured[:, 0], answer)


@pytest.mark.parametrize("i", range(3))
def test_feedback_is_that_of_an_independent_loop_and_helps_a_wrong_model(independent, i):
    case, plant = FED_BACK[i]

    def J(feedback):
        compensated = rig.Compensated(
            actuator(plant), method="model", model=actuator(), feedback=feedback
        )
        history = run(case, compensated, plant)
        return criteria(case, history), history

    J_fed, history = J(10.0)
    expected = independent[1]
    for value, other in (
        (history.u, expected.u[:, i]),
        (history.rig.sent[:, 0], expected.sent[:, i]),
    ):
        assert np.abs(value[:COMPARED] - other).max() < 1e-9 * np.abs(other).max()
    if i == 0:
        assert J_fed[1] < 0.03 and J_fed[3] < 0.05
        return
    assert J_fed[1] < 1.2 and J_fed[3] < 2.9
    assert np.all(J_fed[[1, 3]] < J(0.0)[0][[1, 3]])


def learned(plant, variations, case=1, *, model=None, **noise):
    """True J1 to J9 of a test with least squares."""
    compensated = rig.Compensated(
        actuator(plant, **noise),
        method="model",
        model=model or actuator(),
        variations=variations,
        sigma=None if variations is None else 1e-4,
    )
    history = run(case, compensated, plant, a=RESTED)
    true = actuator(plant).respond(history.rig.sent[:, 0], H).measured
    return criteria(case, history, RESTED, true)


DEVIATIONS = {"stiffness": 5e4, "b1": 3.3, "b2": 3.3e3, "leakage": 1.3}


@pytest.mark.parametrize("how", ["share", "list"])
@pytest.mark.parametrize(("case", "row"), [(1, None), (4, None), (1, 6), (4, 7)])
def test_least_squares_find_the_plant_in_spite_of_noise(case, row, how):
    plant = Plant() if row is None else perturbed(row)
    variations = 0.03
    if how == "list":
        nominal = Plant()
        variations = [
            actuator(replace(nominal, **{name: getattr(nominal, name) + x}))
            for name, x in DEVIATIONS.items()
        ]
    J = learned(plant, variations, case, **NOISY)
    assert J[0] == 0.0
    assert np.all(J[[1, 3, 5]] < [0.3, 0.6, 0.6])


@pytest.mark.gate
def test_a_wrong_gain_is_found():
    plant = Plant(gain=0.9 * 1.0261)
    adaptive, fixed = learned(plant, 0.1, **NOISY), learned(plant, None, **NOISY)
    assert adaptive[3] < 3.0 and adaptive[3] < 0.25 * fixed[3]


@pytest.mark.gate
def test_least_squares_are_those_of_numpy():
    """Commands and measurements as they were, filtered by scipy, in the recursion of (Y16)."""
    plant, share, sigma = perturbed(6), 0.03, 1e-4
    compensated = rig.Compensated(
        actuator(plant), method="model", model=actuator(), variations=share, sigma=sigma
    )
    t = H * np.arange(1500)
    d = 0.004 * np.sin(W * 3.6 * t) * (1.0 - np.exp(-3.0 * t)) ** 3
    v = np.gradient(d, H)
    x = compensated.respond(d, H, v, np.gradient(v, H)).measured
    D, Z = Plant().inverse, reference.low_pass(6, 20.0)
    W_5 = reference.low_pass(5, 100.0)

    def rows(denominator):
        """Of D/N and of the change of each coefficient, s^0 first, over a denominator."""
        numerators = [D, *(share * D[j] * np.eye(6)[j] for j in range(5, -1, -1))]
        return [reference.Filter(reference.bilinear(n, denominator), 1) for n in numerators]

    def one(filter, value):
        return filter(np.array([value]))[0]

    ahead, back = rows(W_5), rows(Z)
    low = reference.Filter(reference.bilinear([1.0], Z), 1)
    a, delta, P, sent = np.gradient(v, H), np.zeros(6), np.eye(6), []
    for k in range(t.size):
        extra = W_5[-2] * v[k] + W_5[-3] * a[k] if k else 0.0
        y = np.array([one(filter, d[k] + extra) for filter in ahead])
        c = y[0] + delta @ y[1:]
        r = np.array([one(filter, x[k] - d[0]) for filter in back])
        e = one(low, c - (d[0] * D[-1])) - r[0]
        gain = P @ r[1:] / (sigma**2 + r[1:] @ P @ r[1:])
        delta = np.clip(delta + gain * (e - r[1:] @ delta), -3.0, 3.0)
        P = P - np.outer(gain, P @ r[1:])
        sent.append(c)
    answer = actuator(plant).respond(sent, H).measured
    # of the transfer functions of scipy, at 1024 times the frequencies of their poles
    assert np.abs(answer - x).max() < 1e-6 * np.abs(x).max()
    assert np.abs(delta).max() > 0.3  # it is not the nominal plant


@pytest.mark.parametrize(("delay", "limits"), [(0.0, (0.2, 5.0)), (0.5 * H, (0.0, 0.06))])
def test_a_held_command_is_late_by_half_a_step(delay, limits):
    history = run(1, rig.Compensated(actuator(hold="zero"), delay, method="model"))
    assert limits[0] <= criteria(1, history)[1] < limits[1]


@pytest.mark.gate
def test_the_inverse_of_a_matrix_follows_two_commands():
    h = 1.0 / 1024.0
    t = h * np.arange(8 * 1024)
    # below its bandwidth, as the storeys of the benchmark move
    d = 0.01 * np.column_stack(
        [np.sin(W * 2.29 * t) + 0.3 * np.sin(W * 5.0 * t), np.cos(W * 1.3 * t) - 1.0]
    )
    d *= (1.0 - np.exp(-2.0 * t))[:, None] ** 3

    def J2(compensated):
        x = compensated.respond(d, h).measured
        return [rig.tracking(d[:, i], x[:, i], h).J2 for i in range(2)]

    plant = two_actuators()
    assert max(J2(rig.Compensated(plant, method="model", bandwidth=60.0))) < 0.6
    assert max(J2(plant)) > 20.0
    wrong = rig.LinearActuator(plant.A, plant.B @ np.diag([0.9, 1.05]), plant.C, plant.F)
    changes = [
        rig.LinearActuator(plant.A, plant.B @ np.diag(x), plant.C, plant.F)
        for x in ([1.06, 1.0], [1.0, 1.06])
    ]
    options = {"method": "model", "model": plant, "bandwidth": 60.0}
    without = J2(rig.Compensated(wrong, **options))
    learning = J2(rig.Compensated(wrong, variations=changes, sigma=1e-4, **options))
    assert max(learning) < 0.25 * min(without)


def test_a_compensator_may_be_behind_a_compensator():
    t = H * np.arange(4096)
    d = 0.004 * np.sin(W * 3.0 * t) * (1.0 - np.exp(-3.0 * t)) ** 3
    inner = rig.Compensated(actuator(delay=0.004), method="model", model=actuator())
    both = rig.Compensated(inner, 0.004)
    assert rig.tracking(d, inner.respond(d, H).measured, H).J2 > 5.0
    assert rig.tracking(d, both.respond(d, H).measured, H).J2 < 0.5


# ---- linkages ------------------------------------------------------------------------------------

LENGTH = float(np.hypot(0.26670, 0.127))
ALPHA = np.deg2rad(25.4633)


def test_arms_are_those_of_the_published_coupler_and_forces_do_their_work():
    plant = two_actuators()
    linked = rig.Linkage(plant, arms=[(LENGTH, ALPHA), (LENGTH, -ALPHA)])
    rng = np.random.default_rng(5)
    d = np.cumsum(rng.uniform(-1e-3, 1e-3, (300, 2)), axis=0)
    x, theta = d.T
    expected = np.column_stack(
        [
            x + LENGTH * (np.cos(theta - ALPHA) - np.cos(ALPHA)),
            x + LENGTH * (np.cos(theta + ALPHA) - np.cos(ALPHA)),
        ]
    )
    np.testing.assert_allclose(linked.to_actuators(d), expected, rtol=0.0, atol=1e-14)
    turned = np.arcsin((expected[:, 0] - expected[:, 1]) / (2.0 * LENGTH * np.sin(ALPHA)))
    back = linked.to_dofs(expected)
    np.testing.assert_allclose(back, np.column_stack([x, turned]), rtol=0.0, atol=1e-14)
    response, alone = linked.respond(d, 0.001), plant.respond(expected, 0.001)
    np.testing.assert_allclose(response.measured, linked.to_dofs(alone.measured), atol=1e-13)
    # virtual work: the rate of the actuators' displacements by those of the dofs, a difference
    step = 1e-6
    for k in (10, 200):
        at = response.measured[k]
        for i, one in enumerate(np.eye(2) * step):
            rates = (linked.to_actuators(at + one) - linked.to_actuators(at - one)) / (2.0 * step)
            work = alone.force[k] @ rates
            # (step^2) of the difference, and rounding / step
            assert response.force[k, i] == pytest.approx(work, rel=1e-9)


@pytest.mark.gate
def test_a_linkage_hands_on_rates_so_that_a_compensator_behind_it_tracks():
    plant, h = two_actuators(), 1.0 / 1024.0
    t = h * np.arange(4096)
    d = np.column_stack([0.01 * np.sin(W * 2.0 * t), 0.05 * np.sin(W * 1.5 * t)])
    d *= (1.0 - np.exp(-3.0 * t))[:, None] ** 3
    compensated = rig.Compensated(plant, method="model", bandwidth=60.0)
    arms = [(LENGTH, ALPHA), (LENGTH, -ALPHA)]
    for linked in (
        rig.Linkage(compensated, arms=arms),
        rig.Linkage(compensated, [[1.0, 0.13], [1.0, -0.13]]),
    ):
        x = linked.respond(d, h).measured
        assert max(rig.tracking(d[:, i], x[:, i], h).J2 for i in range(2)) < 0.2
    # without rates the low-pass filter is a delay of 1.6 ms more, 11 per cent
    v = np.zeros_like(d)
    x = rig.Linkage(compensated, arms=arms).respond(d, h, v, v).measured
    assert rig.tracking(d[:, 0], x[:, 0], h).J2 > 2.0


# ---- bad input -----------------------------------------------------------------------------------

A, B, ROW, _ = Plant().matrices
MATRICES = A, B[:, None], ROW[None], np.eye(5)[2:3]


def linear(**changed):
    matrices = dict(zip("ABCF", MATRICES)) | changed
    return rig.LinearActuator(**matrices)


def unstable():
    return linear(A=A + 300.0 * np.eye(5))


def zero_on_the_right():
    return rig.LinearActuator.from_zpk([30.0], [-50.0, -60.0], 1.0, stiffness=1.0)


BAD = {
    "A must be square": lambda: linear(A=A[:4]),
    "B must have 5 rows": lambda: linear(B=np.ones((4, 1))),
    "C must have shape": lambda: linear(C=np.ones((2, 5))),
    "F must have shape": lambda: linear(F=np.ones((1, 4))),
    "A must be finite": lambda: linear(A=np.where(A == 1.0, np.nan, A)),
    "A must have no pole with positive real part": unstable,
    "dofs must be 1": lambda: linear(dofs=[0, 1]),
    "conjugates": lambda: rig.LinearActuator.from_zpk([], [-1.0 + 2.0j], 1.0, stiffness=1.0),
    "poles must be more than zeros": lambda: rig.LinearActuator.from_zpk(
        [-2.0], [-1.0], 1.0, stiffness=1.0
    ),
    "mass must be 0 without 3": lambda: rig.LinearActuator.from_zpk(
        [], [-1.0, -2.0], 1.0, stiffness=1.0, mass=1.0
    ),
    "damping must be 0 without 2": lambda: rig.LinearActuator.from_zpk(
        [], [-1.0], 1.0, stiffness=1.0, damping=1.0
    ),
    "stiffness must be a number or 1 by 1": lambda: rig.LinearActuator.from_zpk(
        [], [-1.0], 1.0, stiffness=np.eye(2)
    ),
    "valve must be three": lambda: rig.servo_hydraulic(
        mass=1.0, stiffness=1.0, damping=0.0, valve=(1.0, 2.0)
    ),
    "hold must be": lambda: actuator(hold="cubic"),
    "model must have zeros with negative": lambda: rig.Compensated(
        zero_on_the_right(), method="model"
    ),
    "model must be a LinearActuator": lambda: rig.Compensated(lambda t, u, v: u, method="model"),
    "bandwidth must be positive": lambda: rig.Compensated(
        actuator(), method="model", bandwidth=0.0
    ),
    "bandwidth must be at most": lambda: run(
        1, rig.Compensated(actuator(), method="model", bandwidth=1025.0)
    ),
    "sigma and variations must be given together": lambda: rig.Compensated(
        actuator(), method="model", variations=0.03
    ),
    "at least one model": lambda: rig.Compensated(
        actuator(), method="model", variations=[], sigma=1e-4
    ),
    r"variations\[0\] must be a LinearActuator of 1": lambda: rig.Compensated(
        actuator(), method="model", variations=[two_actuators()], sigma=1e-4
    ),
    "share between 0 and 1": lambda: rig.Compensated(
        actuator(), method="model", variations=1.0, sigma=1e-4
    ),
    "list of models for 2": lambda: rig.Compensated(
        two_actuators(), method="model", variations=0.03, sigma=1e-4
    ),
    'come with method="model"': lambda: rig.Compensated(actuator(), 0.01, model=actuator()),
    "commands of its specimen, 1": lambda: run(
        1, rig.Compensated(actuator(), method="model", model=two_actuators())
    ),
    "subdomain of 3": lambda: run(1, linear(B=np.eye(5)[:, :4], C=np.eye(5)[:4], F=np.eye(5)[:4])),
    "matrix must not be singular": lambda: rig.Linkage(two_actuators(), np.ones((2, 2))),
    "matrix must be square": lambda: rig.Linkage(two_actuators(), np.ones((2, 3))),
    "arms must be two": lambda: rig.Linkage(two_actuators(), arms=[(1.0, 0.5)]),
    "one of matrix and arms": lambda: rig.Linkage(two_actuators()),
    "as many commands": lambda: run(1, rig.Linkage(actuator(), np.eye(2))),
    "command must have 2 columns": lambda: two_actuators().respond(np.zeros(9), H),
    "acceleration must have shape": lambda: actuator().respond(
        np.zeros(9), H, acceleration=np.zeros(8)
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_refused_by_name(message):
    with pytest.raises((TypeError, ValueError), match=message):
        BAD[message]()


@pytest.mark.parametrize("variations", [None, 0.1, "models"])
def test_a_compensator_with_a_model_and_its_history_can_be_pickled_and_converted(variations):
    plant = rig.LinearActuator([[-50.0]], [[50.0]], [[1.0]], [[3.0]])
    other = rig.LinearActuator([[-40.0]], [[40.0]], [[1.0]], [[3.0]])
    how = {} if variations is None else {"sigma": 1.0}
    how |= {"variations": [other] if variations == "models" else variations}
    specimen = rig.Compensated(plant, method="model", feedback=0.5, **how)
    again = pickle.loads(pickle.dumps(specimen))
    runs = []
    for one in (specimen, again):
        s = pm.Subdomain(
            [1.0], [50.0], scheme=pm.CentralDifference(), v0=[0.5], restoring=one, name="m"
        )
        runs.append(pm.Coupler([s], dt=0.001).run(0.1, rig=True))
    np.testing.assert_array_equal(runs[0]["m"].u, runs[1]["m"].u)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(runs[0]))["m"].u, runs[0]["m"].u)
    pytest.importorskip("xarray")
    data = runs[0].to_xarray()
    np.testing.assert_array_equal(data["m_rig_command"], runs[0]["m"].rig_command)


@pytest.mark.parametrize("how", [{}, {"frequency": 50.0}, {"frequency": 50.0, "order": 3}])
def test_a_simulated_actuator_starts_within_its_saturation(how):
    spring = pm.CubicSpring([0], k=1.0, k3=0.0)
    late = rig.SimulatedActuator(spring, saturation=0.05, **how)
    np.testing.assert_allclose(late.respond([-0.1] * 30, 0.001).measured, -0.05, rtol=1e-12)
