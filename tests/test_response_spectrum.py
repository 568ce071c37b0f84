"""Response spectra against closed forms, an adaptive solver, runs with tiny steps, and a book."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import pmalpha as pm
from pmalpha.analysis import response_spectrum

PERIODS = [0.03, 0.11, 0.5, 2.3, 9.0]


def vertex(x):
    """The largest |x| of equidistant values, by the parabola through it and its neighbours."""
    i = int(np.clip(np.argmax(np.abs(x)), 1, x.size - 2))
    slope, curvature = (x[i + 1] - x[i - 1]) / 2.0, x[i + 1] - 2.0 * x[i] + x[i - 1]
    inside = abs(slope) < abs(curvature)
    return max(np.abs(x).max(), abs(x[i] - slope**2 / (2.0 * curvature)) if inside else 0.0)


def integrated(record, dt, period, xi):
    """Largest |u|, |v| and |u'' + a| by DOP853, interval by interval."""
    omega = 2.0 * np.pi / period
    y, peaks = np.zeros(2), np.zeros(3)
    for begin, end in zip(record[:-1], record[1:]):

        def rate(t, y, begin=begin, end=end):
            a = begin + (end - begin) * t / dt
            return [y[1], -2.0 * xi * omega * y[1] - omega**2 * y[0] - a]

        times = np.linspace(0.0, dt, 201)
        found = solve_ivp(
            rate, (0.0, dt), y, "DOP853", t_eval=times, rtol=1e-11, atol=1e-14, max_step=dt / 10
        )
        u, v = found.y
        peaks = np.maximum(peaks, [vertex(x) for x in (u, v, 2.0 * xi * omega * v + omega**2 * u)])
        y = found.y[:, -1]
    return peaks


@pytest.mark.gate
@pytest.mark.parametrize("xi", [0.0, 0.7])
def test_a_spectrum_agrees_with_an_adaptive_solver(xi):
    record, dt = np.random.default_rng(3).standard_normal(15), 0.05
    spectrum = response_spectrum(record, dt, PERIODS, xi)
    expected = [integrated(record, dt, T, xi) for T in PERIODS]
    found = np.transpose([spectrum.sd, spectrum.sv, spectrum.sa])
    # the vertex of a parabola through three of 200 points: (omega dt / 200)^3 / 6 = 2e-5
    assert np.allclose(found, expected, rtol=2e-5, atol=0.0)


def powers(A, count):
    """exp(A k / count) for k = 0 .. count."""
    found = np.eye(len(A))[None]
    while len(found) <= count:
        found = np.concatenate([found, found @ expm(A / count * len(found))])
    return found[: count + 1]


def sampled(record, dt, period, xi, rest):
    """Largest |u|, |v| and |u'' + a| of 200 points a period, by the exponential."""
    omega = 2.0 * np.pi / period
    A = np.zeros((4, 4))  # of u, v, a and its slope
    A[0, 1] = A[2, 3] = 1.0
    A[1] = -(omega**2), -2.0 * xi * omega, -1.0, 0.0
    steps = powers(A * dt, int(200 * dt / period) + 20)
    intervals = [(a, (b - a) / dt, steps) for a, b in zip(record[:-1], record[1:])]
    if rest > 0.0:
        intervals.append((0.0, 0.0, powers(A * rest, int(200 * rest / period) + 20)))
    y, peaks = np.zeros(2), np.zeros(3)
    for begin, slope, steps in intervals:
        u, v, *_ = (steps @ [*y, begin, slope]).T
        peaks = np.maximum(peaks, [vertex(x) for x in (u, v, 2.0 * xi * omega * v + omega**2 * u)])
        y = u[-1], v[-1]
    return peaks


@pytest.mark.gate
def test_the_largest_values_are_those_between_samples_of_any_record():
    # between two samples an oscillator of a short period swings several times, each about as far
    for seed in range(60):
        rng = np.random.default_rng(seed)
        record, dt = rng.standard_normal(rng.integers(2, 6)), 10.0 ** rng.uniform(-2.0, 1.0)
        xi, free = rng.choice([0.0, 0.001, 0.005, 0.1, 0.8]), bool(rng.integers(2))
        period = dt * 10.0 ** rng.uniform(-1.2, 1.0)
        found = response_spectrum(record, dt, [period], xi, free_vibration=free)
        expected = sampled(record, dt, period, xi, free * period)
        # the vertex of a parabola through three of 200 points a period, as above
        values = np.array([found.sd[0], found.sv[0], found.sa[0]])
        assert np.allclose(values, expected, rtol=2e-5, atol=0.0), (seed, values / expected - 1.0)


def test_a_spectrum_is_that_of_runs_with_tiny_steps():
    record, dt = pm.models.el_centro()
    record = record[:301]
    spectrum = response_spectrum(record, dt, [0.2, 1.5], 0.05)
    for i, period in enumerate(spectrum.periods):
        omega = 2.0 * np.pi / period
        oscillator = pm.Subdomain(
            [1.0],
            [omega**2],
            C=[0.1 * omega],
            scheme=pm.Newmark(),
            force=pm.BaseAcceleration(record, [1.0], [1.0], dt=dt),
        )
        run = pm.solve(oscillator, dt / 100, 6.0)
        ground = np.interp(run.t, dt * np.arange(record.size), record)[:, None]
        peaks = [np.abs(x).max() for x in (run.u, run.v, run.a + ground)]
        # the period elongation (omega h)^2 / 12 of the trapezoidal rule is 3e-6 per radian at most
        found = [spectrum.sd[i], spectrum.sv[i], spectrum.sa[i]]
        assert np.allclose(found, peaks, rtol=2e-4, atol=0.0)


def test_the_spectrum_of_el_centro_is_the_published_one():
    # Chopra, Dynamics of Structures, section 6.6: deformation, pseudo-velocity and
    # pseudo-acceleration for 2 % damping, to three digits, read at samples 0.02 s apart, which
    # misses up to (omega dt)^2 / 8 = 0.8 % of the peak at T = 0.5 s
    spectrum = response_spectrum(*pm.models.el_centro(), [0.5, 1.0, 2.0], 0.02)
    inches = 386.09 / 9.81
    assert np.allclose(spectrum.sd * inches, [2.67, 5.97, 7.47], rtol=0.009, atol=0.0)
    assert np.allclose(spectrum.psv * inches, [33.7, 37.5, 23.5], rtol=0.009, atol=0.0)
    assert np.allclose(spectrum.psa / 9.81, [1.09, 0.610, 0.191], rtol=0.009, atol=0.0)


def test_a_constant_acceleration_doubles_the_static_displacement():
    omega = 2.0 * np.pi / np.array([0.31, 0.9, 3.0])
    spectrum = response_spectrum(np.full(12, 3.0), 0.5, 2.0 * np.pi / omega, 0.0)
    # u = -a (1 - cos omega t) / omega^2; the peaks fall between samples; rounding
    assert np.allclose(spectrum.sd, 6.0 / omega**2, rtol=1e-12, atol=0.0)
    assert np.allclose(spectrum.sv, 3.0 / omega, rtol=1e-12, atol=0.0)
    assert np.allclose(spectrum.sa, 6.0, rtol=1e-12, atol=0.0)
    assert np.allclose(spectrum.psa, 6.0, rtol=1e-12, atol=0.0)


def test_the_peak_after_a_short_record_counts_with_free_vibration_only():
    period, length = 4.0, 0.8
    omega = 2.0 * np.pi / period
    record, dt = np.full(5, 2.0), length / 4
    short = response_spectrum(record, dt, [period], 0.0)
    whole = response_spectrum(record, dt, [period], 0.0, free_vibration=True)
    # a rectangular pulse shorter than half a period: 2 a / omega^2 sin(pi t / T) afterwards
    assert short.sd[0] == pytest.approx(2.0 * (1.0 - np.cos(omega * length)) / omega**2, rel=1e-12)
    assert whole.sd[0] == pytest.approx(4.0 / omega**2 * np.sin(np.pi * length / period), rel=1e-12)


def test_a_rigid_oscillator_has_the_peak_ground_acceleration():
    record, dt = pm.models.el_centro()
    spectrum = response_spectrum(record, dt, [0.0, 1e-6, 1e-4], 0.05)
    pga = np.abs(record).max()
    assert spectrum.sd[0] == spectrum.sv[0] == 0.0
    assert spectrum.sa[0] == spectrum.psa[0] == pga and spectrum.psv[0] == 0.0
    # u'' is that of a quasi-static motion: of the kinks only, xi omega dt below the record
    assert np.allclose(spectrum.sa, pga, rtol=2e-3, atol=0.0)


def test_a_soft_oscillator_has_the_ground_displacement():
    record, dt = pm.models.el_centro()
    # displacement of a linear acceleration, summed exactly: dt^2 (2 a_j + a_{j+1}) / 6 in a step
    v = np.append(0.0, np.cumsum(0.5 * dt * (record[:-1] + record[1:])))
    x = np.append(0.0, np.cumsum(v[:-1] * dt + dt**2 * (2.0 * record[:-1] + record[1:]) / 6.0))
    spectrum = response_spectrum(record, dt, [2e4], 0.0)
    # the spring changes the motion by (omega t)^2 / 2 = 5e-5 in 31 s; velocities have a peak
    # between samples
    assert spectrum.sd[0] == pytest.approx(np.abs(x).max(), rel=2e-4)
    assert spectrum.sv[0] == pytest.approx(np.abs(v).max(), rel=2e-2)


def test_all_periods_at_once_are_the_single_ones():
    record, dt = pm.models.el_centro()
    together = response_spectrum(record, dt, PERIODS, 0.05)
    alone = [response_spectrum(record, dt, [T], 0.05) for T in PERIODS]
    for name in ("sd", "sv", "sa", "psv", "psa"):
        expected = [getattr(one, name)[0] for one in alone]
        assert np.allclose(getattr(together, name), expected, rtol=1e-12, atol=0.0)
    assert repr(together) == "<ResponseSpectrum: 5 periods from 0.03 to 9, damping ratio 0.05>"


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"record": [1.0]}, ValueError, "record must have at least 2 samples, got 1"),
        ({"record": [[1.0, 2.0]]}, ValueError, "record must be a 1-D array"),
        ({"record": [1.0, np.nan]}, ValueError, "record must be finite"),
        ({"dt": 0.0}, ValueError, "dt must be positive"),
        ({"periods": []}, ValueError, "periods must be at least one"),
        ({"periods": [1.0, -1.0]}, ValueError, "not negative, got -1"),
        ({"damping": 1.0}, ValueError, "damping must be below 1, got 1.0"),
        ({"damping": "5 %"}, TypeError, "damping must be a real number"),
    ],
)
def test_wrong_arguments_are_named(change, error, message):
    arguments = {"record": [0.0, 1.0], "dt": 0.1, "periods": [1.0], "damping": 0.05}
    with pytest.raises(error, match=message):
        response_spectrum(**(arguments | change))
