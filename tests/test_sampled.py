"""Samples between the steps: means over the steps, and the warning about what steps skip."""

import numpy as np
import pytest
from agreement import assert_identical
from scipy import signal

import pmalpha as pm
from pmalpha import models, structures
from pmalpha.run import loads

# other tests ignore it
pytestmark = [
    pytest.mark.filterwarnings("error:steps skip samples:pmalpha.AccuracyWarning"),
    pytest.mark.filterwarnings("ignore:reset:UserWarning"),  # which undoes changed steps
]

TRAPEZOIDAL = pm.Newmark()
SCHEMES = [
    TRAPEZOIDAL,
    pm.CentralDifference(),
    pm.HHT(0.2),
    pm.GeneralizedAlpha(0.5),
    pm.GeneralizedAlpha(0.3, explicit=True),
]


def oscillator(force, omega=1.0, scheme=TRAPEZOIDAL, **options):
    return pm.Subdomain([1.0], [omega**2], scheme=scheme, force=force, name="mass", **options)


def pulse(at, samples=200, dt=0.001, **options):
    """An impulse of 1 in one sample, a triangle of two sample intervals."""
    values = np.zeros(samples)
    values[at] = 1.0 / dt
    return pm.SampledForce(values, dt, [1.0], **options)


# ---- means ---------------------------------------------------------------------------------------


def test_a_pulse_between_the_steps_is_kept_by_means_and_warned_of_without():
    """After an impulse of 1 at time s, u = sin(t - s)."""
    with pytest.warns(pm.AccuracyWarning, match=r"force on 'mass' \(step 0.01, samples every"):
        coupler = pm.Coupler([oscillator(pulse(3))], dt=0.01)
    assert coupler.run(1.0)["mass"].u[-1, 0] == 0.0
    u = pm.solve(oscillator(pulse(3, average=True)), dt=0.01, t_end=1.0).u[-1, 0]
    # the impulse is in F(0) alone, 0.003 s before its time: cos(1) 0.003 at most
    assert abs(u - np.sin(1.0 - 0.003)) < 0.002


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
@pytest.mark.parametrize("ratio", [0.7, 3.0, 4.4, 10.0])
def test_means_keep_the_impulse_of_any_record(scheme, ratio):
    """The final velocity of a free mass is the integral of the force over its mass; the steps need
    not be whole numbers of samples."""
    rng = np.random.default_rng(int(10.0 * ratio))
    for _ in range(5):
        values, dt = rng.standard_normal((rng.integers(1, 30), 2)), 0.02
        values = np.concatenate([values, np.zeros((1, 2))])
        force = pm.SampledForce(values, dt, average=True)
        mass = pm.Subdomain([1.0, 2.0], [0.0, 0.0], scheme=scheme, force=force, substeps=2)
        # long enough that accelerations of the past, which fall by 1/2 a step, are below rounding
        v = pm.solve(mass, dt=2.0 * ratio * dt, steps=60 + int(30 / ratio)).v[-1]
        impulse = dt * (values.sum(axis=0) - 0.5 * values[0])
        np.testing.assert_allclose(v, impulse / [1.0, 2.0], rtol=0, atol=1e-13)


def test_means_keep_the_impulse_under_double_steps():
    """In each of the two chains of time levels, from the third step on: in the first two, levels
    are common to steps of two lengths."""
    for at in (22, 27, 30, 34, 40, 58):
        force = pulse(at, samples=62, average=True)
        a = pm.Subdomain([1.0], [0.0], scheme=pm.GeneralizedAlpha(0.5), force=force, name="a")
        b = pm.Subdomain([1e-9], [0.0], scheme=pm.GeneralizedAlpha(0.5), name="b")
        v = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling="pm").run(1.0)["a"].v
        np.testing.assert_allclose(v[-2:], 1.0, rtol=0, atol=1e-7)  # the mass of b is 1e-9


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro", "mean"])
def test_means_are_of_order_two(coupling):
    """Nothing is delayed: by half a step it would be of order one."""
    dt, T, errors = 1e-3, 2.0, []
    t = dt * np.arange(int(T / dt) + 1)
    force = pm.SampledForce(2.0 * np.sin(3.0 * t) ** 2, dt, [1.0], average=True)
    # u'' + 4 u = sin(3t)^2 = (1 - cos 6t) / 2 for the two masses together
    exact = (1.0 - np.cos(2.0 * T)) / 8.0 + (np.cos(6.0 * T) - np.cos(2.0 * T)) / 64.0
    for step in (0.04, 0.02):
        a, b = (
            pm.Subdomain([1.0], [4.0], scheme=TRAPEZOIDAL, force=f, name=name, substeps=k)
            for name, f, k in (("a", force, 1), ("b", None, 1))
        )
        c = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=step, coupling=coupling)
        errors.append(abs(c.run(T)["a"].u[-1, 0] - exact))
    assert errors[0] > 3.5 * errors[1]


def test_means_of_a_straight_line_are_its_values():
    """But at t = 0, where the mean is that over the first half step."""
    line, dt = np.stack([1.0 + np.arange(101.0), 3.0 - np.arange(101.0)], axis=1), 0.01
    mass = dict(M=[1.0, 1.0], K=[0.0, 0.0], scheme=TRAPEZOIDAL, substeps=2)
    a, b = (
        pm.solve(
            pm.Subdomain(**mass, force=pm.SampledForce(line, dt, average=average)),
            dt=0.08,
            steps=12,
        ).a
        for average in (False, True)
    )
    np.testing.assert_allclose(a[1:], b[1:], rtol=0, atol=1e-11)  # of integrals up to 5000
    np.testing.assert_allclose(b[0], a[0] + [1.0, -1.0], rtol=0, atol=1e-11)  # at h / 4 = dt


def test_a_ground_motion_ends_with_its_last_sample_in_the_mean_too():
    """A constant record of 10 samples, 0.09 s: a step of 0.04 s ends at 0.08 and has 0.03 of it."""
    quake = pm.BaseAcceleration(np.ones(10), [1.0], [2.0], dt=0.01, average=True)
    a = pm.solve(pm.Subdomain([2.0], [0.0], scheme=TRAPEZOIDAL, force=quake), dt=0.04, steps=4).a
    np.testing.assert_allclose(a[:, 0], [-1.0, -1.0, -0.75, 0.0, 0.0], rtol=0, atol=1e-12)


def test_the_work_of_means_is_in_the_balance_of_energy():
    """The trapezoidal rule leaves nothing over, with the force that acts at the time levels."""
    rng = np.random.default_rng(0)
    force = pm.SampledForce(rng.standard_normal(200), 0.01, [1.0], average=True)
    coupler = pm.Coupler([oscillator(force, omega=5.0)], dt=0.037)
    coupler.step(3)
    energy = coupler.run(steps=40, energy=True).energy
    assert np.max(np.abs(energy.balance)) < 1e-12 * np.max(energy.kinetic)
    assert np.max(np.abs(energy.external)) > 0.1 * np.max(energy.kinetic)


def record_pair(coupling="pm", **options):
    rng = np.random.default_rng(1)
    quake, M = rng.standard_normal(300), [1.0, 2.0]
    K = np.array([[300.0, -100.0], [-100.0, 100.0]])
    a = pm.Subdomain(
        M,
        K,
        scheme=pm.GeneralizedAlpha(0.5),
        force=pm.BaseAcceleration(quake, [1.0, 1.0], M, dt=0.01, average=True),
        name="a",
    )
    force = pm.SampledForce(quake, 0.01, [1.0], average=True)
    b = pm.Subdomain(
        [1.0],
        [200.0],
        scheme=pm.GeneralizedAlpha(0.5, explicit=True),
        substeps=2,
        force=force,
        name="b",
    )
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.05, coupling=coupling, **options)


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro", "mean"])
def test_means_do_not_depend_on_how_a_run_is_made(coupling, tmp_path):
    """In pieces, from a file, a snapshot, after a reset, as a case, by a change of steps there and
    back."""
    whole = record_pair(coupling).run(steps=40)
    c = record_pair(coupling)
    c.step(17)
    kept = c.snapshot()
    c.save(tmp_path / "state.npz")
    rest = c.run(steps=23)
    assert np.array_equal(rest["a"].u, whole["a"].u[17:])
    c.restore(kept)
    assert_identical(c.run(steps=23), rest)
    other = record_pair(coupling)
    other.load(tmp_path / "state.npz")
    assert_identical(other.run(steps=23), rest)
    other.change_steps(dt=0.03)
    other.step(3)
    other.reset()
    assert_identical(other.run(steps=40), whole)
    (case,) = other.run_each([{}], 2.0)
    np.testing.assert_allclose(
        case["a"].u, whole["a"].u, rtol=0, atol=1e-12 * abs(whole["a"].u).max()
    )


def test_means_go_on_after_a_change_of_steps():
    """The impulse of a pulse after the change; 0.013 is no whole number of samples."""
    coupler = pm.Coupler([oscillator(pulse(103, average=True), omega=1e-9)], dt=0.01)
    coupler.step(4)
    coupler.change_steps(dt=0.013)
    coupler.step(20)
    assert abs(coupler.state("mass").v[0] - 1.0) < 1e-12


def test_a_coupler_with_means_is_another_problem(tmp_path):
    coupler = pm.Coupler([oscillator(pulse(10, average=True))], dt=0.001)
    coupler.save(tmp_path / "state.npz")
    with pytest.raises(ValueError, match="force of 'mass'"):
        pm.Coupler([oscillator(pulse(10))], dt=0.001).load(tmp_path / "state.npz")


def test_a_cut_structure_keeps_the_means():
    bar = structures.rod(4, 1.0, EA=1.0, rhoA=1.0)
    for force in (
        pm.BaseAcceleration([0.0, 1.0], np.ones(5), bar.M, dt=0.1, average=True),
        pm.SampledForce(np.ones((2, 5)), 0.1, average=True),
    ):
        cut = pm.cut(bar, [0, 0, 1, 1], scheme=TRAPEZOIDAL, force=force)
        assert all(s.force.average and type(s.force) is type(force) for s in cut.subdomains)


def test_average_is_checked():
    with pytest.raises(TypeError, match="average must be True or False, got 1"):
        pm.SampledForce([1.0], 0.1, average=1)
    mean = pm.SampledForce([1.0], 0.1, [1.0], average=True)
    with pytest.raises(ValueError, match="velocity must be a SampledForce without average"):
        pm.Constraint({"a": [[1.0]]}, velocity=mean)


# ---- the warning ---------------------------------------------------------------------------------


def quake(**options):
    record, dt = models.el_centro()
    return pm.BaseAcceleration(record, [1.0], [1.0], dt=dt, **options), dt


def skips(*arguments, **options):
    with pytest.warns(pm.AccuracyWarning, match="skip samples") as found:
        coupler = pm.Coupler(*arguments, **options)
    return coupler, str(found.pop(pm.AccuracyWarning).message)


def test_an_earthquake_may_skip_every_second_sample_but_not_two_of_three():
    force, dt = quake()
    for step in (0.5 * dt, 0.7 * dt, dt, 1.5 * dt, 2.0 * dt):
        pm.Coupler([oscillator(force)], dt=step)  # no warning, which would be an error
    _, message = skips([oscillator(force)], dt=3.0 * dt)
    assert "the force on 'mass' (step 0.06, samples every 0.02: 0.0" in message
    pm.Coupler([oscillator(quake(average=True)[0])], dt=3.0 * dt)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.9, 2.0])
def test_records_without_high_frequencies_may_be_sampled_less(share):
    """Frequencies up to this share of the highest that the steps can follow, 1 / (2 step)."""
    n, dt, every = 4000, 0.001, 10
    rng = np.random.default_rng(3)
    spectrum, f = np.fft.rfft(rng.standard_normal(n)), np.fft.rfftfreq(n, dt)
    spectrum[f > share * 0.5 / (every * dt)] = 0.0
    force = pm.SampledForce(np.fft.irfft(spectrum, n), dt, [1.0])
    if share < 1.0:
        pm.Coupler([oscillator(force)], dt=every * dt)
    else:
        skips([oscillator(force)], dt=every * dt)


def test_the_step_that_counts_is_the_one_that_is_taken():
    """2 h of double steps, h of substeps; of a prescribed velocity that of the interface."""
    force, dt = quake()
    a, b = (oscillator(force), pm.Subdomain([1.0], [1.0], scheme=TRAPEZOIDAL, name="b"))
    tie = pm.tie(a, [0], b, [0])
    pm.Coupler([a, b], tie, dt=2.0 * dt, coupling="gc")
    _, message = skips([a, b], tie, dt=2.0 * dt, coupling="pm")
    assert "step 0.08" in message
    pm.Coupler([oscillator(force, substeps=4)], dt=4.0 * dt)
    moved = pm.Constraint({b: [[1.0]]}, velocity=pulse(43))
    _, message = skips([b], moved, dt=0.01, coupling="gc")
    assert "the velocity of constraint 0 (step 0.01" in message


def test_loads_and_steps_that_come_later_are_judged_too():
    coupler = pm.Coupler([oscillator(quake()[0])], dt=0.02)
    case = {"force": {"mass": pulse(43)}}
    with pytest.warns(pm.AccuracyWarning, match="skip samples"):
        coupler.reset(**case)
    with pytest.warns(pm.AccuracyWarning, match="skip samples"):
        coupler.run_each([case], 0.2)
    coupler.reset()
    with pytest.warns(pm.AccuracyWarning, match="skip samples"):
        coupler.change_steps(dt=0.06)
    coupler.reset()  # to steps of 0.02


def test_a_warning_that_is_an_error_changes_nothing():
    coupler = pm.Coupler([oscillator(quake()[0])], dt=0.02)
    coupler.step(3)
    for change in (
        lambda: coupler.change_steps(dt=0.06),
        lambda: coupler.reset(force={"mass": pulse(43)}),
    ):
        with pytest.raises(pm.AccuracyWarning):
            change()
        assert (coupler.dt, coupler.step_count) == (0.02, 3)
    coupler.step(3)
    whole = pm.solve(oscillator(quake()[0]), dt=0.02, steps=6)
    assert coupler.state("mass").u[0] == whole.u[-1, 0]


@pytest.mark.parametrize("seed", range(3))
def test_what_steps_skip_is_that_of_straight_lines_through_an_oscillator(seed):
    """(L3) with the oscillator from SciPy: its transfer function by the bilinear transformation."""
    rng = np.random.default_rng(seed)
    count, dt, step = 40 + 7 * seed, 0.01, (0.03, 0.04, 0.025)[seed]
    values, weight = rng.standard_normal((count, 2)), np.array([1.0, 0.3])
    omega = 2.0 * np.pi / (50.0 * step)
    b, a = signal.bilinear([1.0], [1.0, 2.0 * 0.05 * omega, omega**2], 1.0 / dt)
    t = dt * np.arange(count + int(np.ceil(50.0 * step / dt)))
    f = np.zeros((len(t), 2))
    f[:count] = values * weight
    f[count:] = f[count - 1]
    levels = step * np.arange(len(t))  # far beyond the end, where the force is held
    skipped = f - np.column_stack([np.interp(t, levels, np.interp(levels, t, x)) for x in f.T])
    change, response = (signal.lfilter(b, a, x, axis=0) for x in (skipped, f))
    expected = (
        np.sum(skipped[:count] ** 2) / np.sum(f[:count] ** 2),
        np.sqrt(np.sum(change**2) / np.sum(response**2)),
    )
    force = pm.SampledForce(values, dt)
    samples = force._samples._replace(weights=weight)
    # sums of some hundred squares
    np.testing.assert_allclose(loads.skipped(samples, step), expected, rtol=1e-10)


def test_a_table_of_means_reaches_one_level_beyond_the_record():
    """The mean over the last step that has a share of it is not zero, that of the next one is: a
    free mass has all of the impulse, and keeps its velocity to the last digit."""
    for step in (0.003, 0.01, 0.07, 0.1):
        force = pulse(198, average=True)
        mass = pm.Subdomain([1.0], [0.0], scheme=TRAPEZOIDAL, force=force, name="mass")
        v = pm.Coupler([mass], dt=step).run(steps=int(0.2 / step) + 6)["mass"].v[:, 0]
        np.testing.assert_array_equal(v[-3:], v[-1])
        np.testing.assert_allclose(v[-1], 1.0, rtol=1e-12)  # the triangle ends with the record
