"""Time is counted in integers: t = (k / max(ss)) dt, in this order of operations (T1).

Expected times are decimal numbers, or (T1) computed by NumPy: equal means bitwise identical.
"""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import pmalpha as pm

SOFT = pm.GeneralizedAlpha(0.5)


def subdomain(substeps=1, **options):
    options = {"scheme": SOFT, **options}
    return pm.Subdomain([1.0], [4.0], substeps=substeps, u0=[1.0], **options)


def pair(dt, *substeps, coupling="pm", **options):
    """Subdomains of one dof with these substeps, tied in a row."""
    subdomains = [subdomain(ss) for ss in substeps]
    ties = [pm.tie(a, [0], b, [0]) for a, b in zip(subdomains, subdomains[1:])]
    return pm.Coupler(subdomains, ties, dt=dt, coupling=coupling, **options)


def divisor(ss):
    """A divisor of ss between 1 and ss where there is one, to have steps in between."""
    return next((d for d in range(int(ss**0.5), 1, -1) if ss % d == 0), 1)


# ---- counts and instants --------------------------------------------------------------------


# up to 100: the small ones, and every seventh; in campaigns the others
RATIOS = [
    pytest.param(ss, marks=[] if ss < 8 or ss % 7 == 2 else pytest.mark.campaign)
    for ss in range(1, 101)
]


@pytest.mark.parametrize("ss", RATIOS)
def test_every_ratio_takes_the_exact_number_of_steps_for_decimals(ss):
    # written as decimals: dt = 0.001 ss and t_end = 23 of them, each rounded once by the parser
    typed = Decimal("0.001") * ss
    dt, t_end = float(str(typed)), float(str(23 * typed))
    middle = divisor(ss)
    coupler = pair(dt, 1, ss, middle)
    history = coupler.run(t_end)
    assert coupler.step_count == 23
    coarse, fine, between = history.subdomains
    k = np.arange(23 * ss + 1)
    np.testing.assert_array_equal(fine.t, (k / ss) * dt)  # (T1)
    np.testing.assert_array_equal(history.multiplier_times, fine.t)
    # equal instants are bitwise identical
    np.testing.assert_array_equal(coarse.t, fine.t[::ss])
    np.testing.assert_array_equal(between.t, fine.t[:: ss // middle])
    np.testing.assert_array_equal(history.macro_times, coarse.t)
    assert coupler.time == coarse.t[-1]
    # the end is the decimal number, to the rounding of one product
    assert coupler.time == pytest.approx(t_end, rel=2.3e-16, abs=0)


def test_the_expected_times_are_not_what_a_running_sum_gives():
    # the last test could not detect a sum of steps if the two agreed
    k = np.arange(23 * 7 + 1)
    assert ((k / 7) * 0.007 != np.concatenate([[0.0], np.cumsum(np.full(23 * 7, 0.007 / 7))])).any()


@pytest.mark.parametrize("ss", [3, 7, 10, 97])
def test_loads_of_all_subdomains_are_evaluated_at_bitwise_identical_instants(ss):
    times = {"coarse": [], "fine": []}

    def logged(name):
        return lambda t: times[name].append(t) or [0.0]

    a, b = subdomain(force=logged("coarse")), subdomain(ss, force=logged("fine"))
    dt = float(str(Decimal("0.001") * ss))
    history = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling="pm").run(steps=11)
    np.testing.assert_array_equal(times["fine"], history[1].t)
    np.testing.assert_array_equal(times["coarse"], times["fine"][::ss])


@pytest.mark.parametrize("ss", RATIOS)
def test_the_core_evaluates_loads_at_bitwise_identical_instants(ss):
    # a ramp from 0 to 1024 within 1024: F(t) = t without a rounding, and w = F on a free unit mass
    clock = pm.SampledForce([0.0, 1024.0], 1024.0, shape=[1.0])
    options = {"scheme": SOFT, "force": clock}
    masses = [pm.Subdomain([1.0], [0.0], substeps=n, **options) for n in (1, divisor(ss), ss)]
    dt = float(str(Decimal("0.001") * ss))
    history = pm.Coupler(masses, dt=dt, coupling="pm").run(steps=23)
    for shown in history.subdomains:
        np.testing.assert_array_equal(shown.a[:, 0], shown.t)


@pytest.mark.parametrize(
    ("dt", "substeps", "steps", "t_end"),
    [
        (0.1, 100, 10_000, 1000.0),
        (0.001, 1, 1_000_000, 1000.0),
        (0.01, 8, 125_000, 1250.0),
        (0.007, 7, 142_857, 999.999),
    ],
)
def test_a_million_fine_steps_end_at_the_exact_time_and_count(dt, substeps, steps, t_end):
    coupler = pair(dt, 1, substeps)
    history = coupler.run(t_end, record={}, every=steps)
    assert coupler.step_count == steps
    # the double nearest to steps * dt is the decimal number
    assert coupler.time == t_end == history.macro_times[-1] == history.multiplier_times[-1]
    # a running sum is off by 1e-16 n^2 dt / 2 at worst: about 1e-8 here, and not zero
    total = np.cumsum(np.full(steps * substeps, dt / substeps))[-1]
    assert total != t_end


def test_a_million_steps_in_intervals_are_the_same_million():
    coupler = pair(0.01, 1, 5)
    for t_end in (0.01, 333.33, 999.98, 2000.0):
        coupler.run(t_end, record={}, every=10**9)
        assert coupler.time == t_end
    assert coupler.step_count == 200_000


def test_the_time_of_a_step_far_out_is_correctly_rounded():
    coupler = pair(0.1, 1, 3)
    coupler.step(100_000)
    history = coupler.run(steps=2)
    for n, t in enumerate(history.macro_times):
        assert t == float(Fraction(0.1) * (100_000 + n))  # one rounding of the exact product
    # fine instants: k / 3 is rounded once more
    exact = [Fraction(0.1) * Fraction(300_000 + k, 3) for k in range(7)]
    np.testing.assert_allclose(history.multiplier_times, [float(t) for t in exact], rtol=3e-16)


# ---- t_end ----------------------------------------------------------------------------------


@pytest.mark.parametrize("off", [0.0, 0.9e-6, -0.9e-6])
def test_t_end_may_miss_a_whole_number_of_steps_by_a_millionth_of_one(off):
    coupler = pair(0.25, 1)
    coupler.run(0.25 * (40 + off))
    assert (coupler.step_count, coupler.time) == (40, 10.0)


@pytest.mark.parametrize("off", [1.1e-6, -1.1e-6, 0.5, 0.25])
def test_t_end_that_is_no_whole_number_of_steps_is_refused(off):
    coupler = pair(0.25, 1)
    coupler.step(2)
    with pytest.raises(ValueError, match="t_end must be a whole number of macro steps"):
        coupler.run(0.25 * (40 + off))
    assert coupler.step_count == 2


def test_the_millionth_is_one_of_a_step_whatever_the_unit_of_time():
    for dt in (2.5e-9, 2.5e7):
        coupler = pair(dt, 1)
        with pytest.raises(ValueError, match="whole number"):
            coupler.run(dt * (40 + 1.1e-6))
        coupler.run(dt * (40 + 0.9e-6))
        assert coupler.step_count == 40


@pytest.mark.parametrize("behind", [0.75, 0.0, -0.25])
def test_t_end_before_the_present_time_is_refused(behind):
    coupler = pair(0.25, 1)
    coupler.step(4)
    with pytest.raises(ValueError, match=f"behind the present.*1.*got {behind:g}"):
        coupler.run(behind)
    assert coupler.step_count == 4


def test_t_end_at_the_present_time_takes_no_step():
    coupler = pair(0.25, 1, 2)
    for t_end, count in ((0.0, 0), (1.0, 4)):
        coupler.run(t_end)
        assert coupler.step_count == count
    with pytest.warns(UserWarning, match="the time is 1 already"):
        history = coupler.run(1.0)
    assert coupler.step_count == 4
    assert history.macro_times.tolist() == [1.0]
    assert history[1].t.tolist() == [1.0]


def test_t_end_is_absolute_and_steps_are_counted_from_the_present_time():
    coupler = pair(0.25, 1)
    coupler.run(1.0)
    coupler.run(1.5)
    assert coupler.step_count == 6
    coupler.run(steps=6)
    assert coupler.time == 3.0


def test_both_or_none_of_t_end_and_steps_is_a_type_error():
    coupler = pair(0.25, 1)
    with pytest.raises(TypeError, match="either t_end or steps"):
        coupler.run()
    with pytest.raises(TypeError, match="either t_end or steps"):
        coupler.run(1.0, steps=4)
    with pytest.raises(TypeError, match="either t_end or steps"):
        pm.solve(subdomain(), dt=0.25)
    assert coupler.step_count == 0


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"t_end": np.nan}, ValueError),
        ({"t_end": np.inf}, ValueError),
        ({"t_end": "1.0"}, TypeError),
        ({"t_end": 1j}, TypeError),
        ({"steps": -1}, ValueError),
        ({"steps": 1.0}, TypeError),
        ({"steps": True}, TypeError),
    ],
    ids=str,
)
def test_an_invalid_length_of_a_run_is_refused(arguments, error):
    coupler = pair(0.25, 1)
    coupler.step(2)
    with pytest.raises(error, match=next(iter(arguments))):
        coupler.run(**arguments)
    assert coupler.step_count == 2


def test_numbers_of_numpy_are_numbers():
    coupler = pair(np.float32(0.25), 1, np.int64(2))
    coupler.run(np.float64(1.0))
    coupler.run(steps=np.int32(4))
    coupler.step(np.int8(2))
    assert (coupler.step_count, coupler.time) == (10, 2.5)
