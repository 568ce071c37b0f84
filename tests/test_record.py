"""Records: samples with their time step, taken where both are wanted."""

import pickle

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.analysis import response_spectrum
from pmalpha.readers import Record

RECORD = Record([[0.0], [1.0], [-2.0], [0.5]], 0.1, "valley", header="of a file")
VALUES, DT = RECORD


def taken(make, *others, **named):
    """`make` with a Record in place of samples and dt, in every form of a call."""
    first = next(iter(named))
    rest = {name: value for name, value in named.items() if name != first}
    return [
        make(RECORD, *others, *named.values()),
        make(RECORD, None, *others, *named.values()),
        make(RECORD, DT, *others, *named.values()),
        make(RECORD, *others, **named),
        make(RECORD, *others, named[first], **rest),
        make(RECORD, *others, dt=DT, **named),
    ]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (pm.SampledForce, {"shape": [2.0, 0.0]}),
        (pm.SupportMotion, {"kind": "displacement"}),
    ],
)
@pytest.mark.filterwarnings("ignore:record of displacements begins")  # only calls are compared
def test_a_record_is_taken_for_samples_and_step(make, named):
    expected = make(VALUES, DT, **named)
    name = "values" if make is pm.SampledForce else "record"
    for one in [*taken(make, **named), make(**{name: RECORD}, **named)]:
        assert [one(t).tolist() for t in (0.0, 0.17)] == [expected(t).tolist() for t in (0.0, 0.17)]


def test_a_ground_motion_takes_a_record_or_samples_with_their_step():
    M = [3.0, 4.0]
    expected = pm.BaseAcceleration(VALUES, [1.0, 2.0], M, dt=DT)
    for one in (
        pm.BaseAcceleration(RECORD, [1.0, 2.0], M),
        pm.BaseAcceleration(record=RECORD, direction=[1.0, 2.0], M=M, dt=DT),
        pm.Subdomain(M, M, scheme=pm.Newmark(), force=pm.BaseAcceleration(RECORD, [1, 2])).force,
    ):
        assert [one(t).tolist() for t in (0.0, 0.17)] == [expected(t).tolist() for t in (0.0, 0.17)]
    with pytest.raises(ValueError, match=r"dt must be 0.1 as in <Record 'valley'.*, got 0.02"):
        pm.BaseAcceleration(RECORD, dt=0.02)
    with pytest.raises(TypeError, match=r"dt must be given with an array, .* a Record has it"):
        pm.BaseAcceleration(VALUES, [1.0, 2.0], M)
    with pytest.raises(
        ValueError, match=r"direction must have shape \(2,\), got one number, 1.0; dt"
    ):
        pm.BaseAcceleration(RECORD, 1.0, M)
    table = np.transpose([[0.0, 0.1, 0.2], [0.0, 1.0, 2.0]])
    with pytest.raises(
        ValueError, match="if the first column is time, take readers.Record.from_times"
    ):
        pm.BaseAcceleration(table, [1.0, 2.0], M, dt=0.1)
    with pytest.raises(TypeError, match="without M has a value in its subdomain only, s.force"):
        pm.BaseAcceleration(RECORD)(0.1)
    assert repr(pm.BaseAcceleration(RECORD)) == (
        "<BaseAcceleration: 4 samples, dt = 0.1, to t = 0.3, of the mass of its subdomain>"
    )


@pytest.mark.parametrize("seed", range(5))
def test_uneven_series_are_taken_at_even_times_on_their_straight_lines(seed):
    rng = np.random.default_rng(seed)
    t = 3.0 + np.cumsum(rng.uniform(0.5, 1.5, 20))
    values = rng.normal(size=(20, 2))
    record = Record.from_times(t, values)
    assert record.dt <= np.diff(t).min() and record.values.shape[1] == 2
    at = t[0] + record.dt * np.arange(len(record.values))
    assert at[-1] == pytest.approx(t[-1], rel=1e-14)  # begins and ends with the series
    for k in (0, 1):
        expected = np.interp(at, t, values[:, k])
        np.testing.assert_allclose(record.values[:, k], expected, rtol=0, atol=1e-13)
    given = Record.from_times(t, values[:, 0], dt=0.7)
    assert given.dt == 0.7 and t[-1] - 0.7 < t[0] + 0.7 * (len(given.values) - 1) <= t[-1]
    even = Record.from_times(2.0 + 0.01 * np.arange(20), values[:, 0])
    np.testing.assert_array_equal(even.values, values[:, 0])
    assert even.dt == pytest.approx(0.01, rel=1e-13)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([0.0, 0.2, 0.2], [1, 2, 3]), ValueError, "t must rise, got 0.2 after 0.2"),
        (([0.0, 0.2], [1, 2, 3]), ValueError, "values must have a row for each of 2 times"),
        (([0.0], [1]), ValueError, "t must be at least 2 times, got 1"),
        (([0.0, 1e-9, 1.0], [1, 2, 3]), ValueError, "dt must be given where times are 1e-09 apart"),
        (([0.0, 1.0], [1, 2], -1.0), ValueError, "dt must be positive"),
    ],
)
def test_series_that_are_none_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        Record.from_times(*arguments)


def test_the_spectrum_of_a_record_is_that_of_its_samples_and_step():
    record = Record(VALUES[:, 0], DT)
    expected = response_spectrum(VALUES[:, 0], DT, [0.3, 2.0], 0.02)
    for one in (
        response_spectrum(record, [0.3, 2.0], 0.02),
        response_spectrum(record, periods=[0.3, 2.0], damping=0.02),
        response_spectrum(*record, [0.3, 2.0], 0.02),
    ):
        assert one.sd.tolist() == expected.sd.tolist()


def test_another_step_than_that_of_the_record_is_refused():
    with pytest.raises(ValueError, match=r"dt must be 0.1 as in <Record 'valley'.*, got 0.02"):
        pm.SampledForce(RECORD, 0.02, [1.0])
    with pytest.raises(TypeError, match="'dt'"):
        pm.SampledForce([0.0, 1.0], shape=[1.0])


def test_a_record_unpacks_scales_and_is_an_array_of_its_values():
    assert (VALUES == RECORD.values).all() and DT == RECORD.dt == RECORD[1]
    VALUES[0] += 0.0  # what is unpacked belongs to the user
    for scaled in (2 * RECORD, RECORD * 2.0, np.float64(2.0) * RECORD):
        assert isinstance(scaled, Record) and scaled.header == "of a file"
        np.testing.assert_array_equal(scaled.values, 2.0 * RECORD.values)
    assert np.abs(RECORD).max() == 2.0
    again = pickle.loads(pickle.dumps(RECORD))
    assert (again.name, again.dt, again.values.tolist()) == ("valley", 0.1, RECORD.values.tolist())
    with pytest.raises(TypeError):
        RECORD * [1.0]
    with pytest.raises(AttributeError, match="dt of a Record must not be changed"):
        RECORD.dt = 1.0


def test_el_centro_has_a_name():
    record = pm.models.el_centro()
    assert record.name.startswith("El Centro 1940") and record.values.shape == (1561,)
