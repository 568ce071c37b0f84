"""Records before they are loads: integrals, baselines, other steps and units, by closed forms."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import models
from pmalpha.readers import Record

DT = 0.01
TIMES = DT * np.arange(2001)
# a pulse that leaves neither velocity nor displacement: the third derivative of a bump
BUMP = np.where(TIMES < 8.0, np.sin(np.pi * TIMES / 8.0) ** 4, 0.0)


def second_derivative(x):
    return np.gradient(np.gradient(x, DT), DT)


PULSE = Record(second_derivative(BUMP), DT)


def test_integrals_are_those_of_the_straight_lines_between_samples():
    """a = t on one step of 2: v = t^2 / 2, d = t^3 / 6; then at rest in a = 0."""
    velocity, displacement = Record([0.0, 2.0, 0.0, 0.0], 2.0).integrated()
    assert velocity.values.tolist() == [0.0, 2.0, 4.0, 4.0]
    assert displacement.values == pytest.approx([0.0, 8.0 / 6.0, 8.0, 16.0], rel=1e-15)
    both = Record(np.ones((3, 2)), 1.0).integrated()[1]
    assert both.values.tolist() == [[0.0, 0.0], [0.5, 0.5], [2.0, 2.0]]


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_polynomial_baseline_is_removed_up_to_its_degree(degree):
    drift = sum((k + 1.0) * (TIMES / 20.0) ** k for k in range(degree + 1)) * 1e-3
    drifted = Record(PULSE.values + drift, DT)
    clean = PULSE.corrected(degree=degree).values  # what the fit takes from the pulse itself
    found = drifted.corrected(degree=degree).values
    assert np.abs(found - clean).max() < 1e-7 * np.abs(drift).max()  # of lines through t^k
    if degree:
        left = drifted.corrected(degree=degree - 1).values
        assert np.abs(left - PULSE.corrected(degree=degree - 1).values).max() > 1e-5


def test_a_highpass_halves_its_corner_and_keeps_what_is_faster():
    """|H|^2 of a Butterworth filter of half the order, there and back: 1 / (1 + (f_c / f)^n)."""
    for f in (0.25, 0.5, 1.0, 4.0):
        wave = Record(np.sin(2.0 * np.pi * f * 0.01 * np.arange(6001)), DT)
        found = wave.corrected("highpass", frequency=0.5, order=4)
        pads = (len(found.values) - 6001) // 2
        assert pads == 600  # 0.75 * 4 / 0.5 in steps
        inner = slice(pads + 2000, pads + 4000)
        expected = wave.values[2000:4000] / (1.0 + (0.5 / f) ** 4)
        # the transient of the begin has decayed as exp(-2 pi 0.35 20)
        assert np.abs(found.values[inner] - expected).max() < 2e-3


def test_a_corrected_earthquake_comes_to_rest_and_keeps_its_peak():
    record = models.el_centro()
    tilted = Record(record.values + 0.02, record.dt)  # 2 cm/s2 make 9.6 m in 31 s
    assert tilted.integrated()[1].values[-1] > 9.0
    for corrected in (tilted.corrected(), tilted.corrected("highpass", frequency=0.1)):
        velocity, displacement = corrected.integrated()
        assert abs(velocity.values[-1]) < 0.05 and abs(displacement.values[-1]) < 0.2
        assert np.abs(corrected.values).max() == pytest.approx(3.128, abs=0.05)


def test_a_finer_step_is_the_same_function_and_a_coarser_one_has_no_aliases():
    slow, fast = (np.sin(2.0 * np.pi * f * TIMES) for f in (1.0, 40.0))
    record = Record(slow + fast, DT)
    fine = record.resampled(0.0025)
    assert fine.dt == 0.0025 and len(fine.values) == 8001
    assert fine.values == pytest.approx(np.interp(0.0025 * np.arange(8001), TIMES, record.values))
    coarse = record.resampled(0.02)
    assert len(coarse.values) == 1001
    inner = slice(100, -100)
    # the filter of scipy.signal.resample_poly: 1e-3 in its bands, -60 dB beyond
    assert np.abs(coarse.values - slow[::2])[inner].max() < 5e-3
    assert np.abs(record.values[::2] - slow[::2])[inner].max() > 0.5
    other = Record(slow, DT).resampled(0.015)
    t = 0.015 * np.arange(len(other.values))
    assert np.abs(other.values - np.sin(2.0 * np.pi * t))[inner].max() < 5e-3


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("G", 9.80665), ("cm/sec2", 0.01), ("cm/s^2 (4)", 0.01), ("gal", 0.01), ("m/s/s", 1.0)]
    + [("CM/SEC/SEC", 0.01), ("ft/s**2", 0.3048), ("in/s2", 0.0254), ("mg", 0.00980665)],
)
def test_units_are_those_of_files(unit, metres):
    record = Record([1.0, -2.0], DT, "valley", header=f"a valley\nunit: {unit}")
    found = record.in_unit("m/s2")
    assert found.values == pytest.approx([metres, -2.0 * metres], rel=1e-15)
    assert found.unit == "m/s2" and found.name == "valley" and found.header.startswith("a valley\n")
    assert found.in_unit(unit).values == pytest.approx(record.values, rel=1e-15)
    assert Record([1.0], DT).in_unit("m/s2", unit=unit).values == pytest.approx([metres])


def test_a_corrected_and_a_resampled_record_keep_their_unit():
    record = Record(PULSE.values, DT, "valley", header="unit: g")
    for changed in (record.corrected(), record.corrected("highpass", frequency=1.0)):
        assert (changed.unit, changed.name) == ("g", "valley")
    assert record.resampled(0.02).unit == "g"


def test_a_record_is_drawn_with_its_integrals():
    figure = pytest.importorskip("matplotlib.figure").Figure()
    axes = Record([0.0, 1.0, 1.0], 2.0, header="unit: g").plot(figure.subplots(3))
    drawn = [ax.get_lines()[0].get_ydata().tolist() for ax in axes]
    assert drawn[:2] == [[0.0, 1.0, 1.0], [0.0, 1.0, 3.0]]
    assert axes[0].get_ylabel() == "acceleration (g)" and axes[2].get_xlabel() == "t"
    with pytest.raises(ValueError, match="three axes"):
        PULSE.plot(figure.subplots())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: PULSE.in_unit("m/s2"), "unit must be of"),
        (lambda: PULSE.in_unit("m", unit="g"), "name must be of"),
        (lambda: PULSE.corrected("spline"), "method"),
        (lambda: PULSE.corrected(degree=9), "degree"),
        (lambda: PULSE.corrected(frequency=0.1), "frequency must be left out"),
        (lambda: PULSE.corrected("highpass"), "frequency must be given"),
        (lambda: PULSE.corrected("highpass", frequency=50.0), "frequency must be below 50"),
        (lambda: PULSE.corrected("highpass", frequency=1.0, order=3), "order"),
        (lambda: Record([1.0, 2.0], DT).corrected(), "3 samples"),
        (lambda: PULSE.resampled(0.0), "dt"),
        (lambda: PULSE.resampled(0.01 * np.pi), "ratio of whole numbers"),
    ],
)
def test_wrong_arguments_are_refused_by_name(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_integrals_have_units_and_an_acceleration_is_no_velocity_of_a_wave():
    for unit, names in {"m/s2": ["m/s", "m"], "g": ["g s", "g s2"], "": ["", ""]}.items():
        record = Record(np.ones(3), 0.1, header=f"unit: {unit}" if unit else "")
        assert [x.unit for x in record.integrated()] == names
    soil = pm.structures.plate(1, 2, 1.0, E=2.0, nu=0.0, rho=1.0, plane="strain")
    base = soil.absorbing(soil.nodes_at(y=0.0))
    quake = Record(np.ones(3), 0.1, header="unit: CM/SEC**2")
    with pytest.raises(ValueError, match=r"acceleration in CM/SEC\*\*2: .*integrated"):
        base.incident(quake, [1.0, 0.0])
    base.incident(quake.in_unit("m/s2").integrated()[0], [1.0, 0.0])


@pytest.mark.parametrize("dt", [0.02, 0.015, 0.025])
def test_straight_lines_are_resampled_to_their_ends(dt):
    line = Record(1.0 + 0.5 * np.arange(200), 0.01).resampled(dt)
    np.testing.assert_allclose(
        line.values, 1.0 + 50.0 * dt * np.arange(len(line.values)), rtol=5e-4
    )
    assert Record(np.ones(200), 0.01).resampled(dt).values == pytest.approx(1.0, rel=5e-4)
