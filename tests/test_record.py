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
        (pm.BaseAcceleration, {"direction": [1.0, 1.0], "M": [3.0, 4.0]}),
        (pm.SupportMotion, {"kind": "displacement"}),
    ],
)
def test_a_record_is_taken_for_samples_and_step(make, named):
    expected = make(VALUES, DT, **named)
    name = "values" if make is pm.SampledForce else "record"
    for one in [*taken(make, **named), make(**{name: RECORD}, **named)]:
        assert [one(t).tolist() for t in (0.0, 0.17)] == [expected(t).tolist() for t in (0.0, 0.17)]


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
