"""Records in the text format of PEER, written here by hand in its variants."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.readers import read_at2

TITLE = "PEER STRONG MOTION DATABASE RECORD\nA VALLEY 10/15/79 2319, STATION 6, 230\n"
UNITS = "ACCELERATION TIME HISTORY IN UNITS OF G\n"
SAMPLES = "  -.5264219E-03  -.5193430E-03   .5100000E-03\n   .1000000E+00   1.2345670E-01\n"
VALUES = [-0.5264219e-3, -0.5193430e-3, 0.51e-3, 0.1, 0.1234567]
FORMS = [
    "NPTS=  5, DT= .0050 SEC\n",
    "NPTS=   5, DT=   .0050 SEC,\n",
    "NPTS=5,DT=0.005\n",
    "NPTS=     5  DT=  5.0E-03 SEC\n",
    "npts = 5, dt = 5.0D-03 sec\n",
    "    5    0.0050   NPTS, DT\n",
    "    5    .0050    NPTS, DT\n",
    "NPTS, DT\n    5    0.0050\n",
    "    5    0.0050\nNPTS, DT\n",
]


def written(tmp_path, text, name="record.AT2"):
    path = tmp_path / name
    path.write_bytes(text.encode("latin-1"))
    return path


@pytest.mark.parametrize("form", FORMS, ids=repr)
def test_all_forms_of_the_header_give_the_same_record(tmp_path, form):
    record = read_at2(written(tmp_path, TITLE + UNITS + form + SAMPLES))
    assert record.values.tolist() == VALUES and record.dt == 0.005
    assert record.name == "record.AT2"
    assert record.header.splitlines() == [x.strip() for x in (TITLE + UNITS + form).splitlines()]


def test_line_ends_of_windows_and_a_missing_last_one_do_not_matter(tmp_path):
    text = (TITLE + UNITS + FORMS[0] + SAMPLES).replace("\n", "\r\n").rstrip()
    assert read_at2(written(tmp_path, text)).values.tolist() == VALUES


def test_columns_of_fortran_without_a_blank_between_are_read(tmp_path):
    text = TITLE + UNITS + "NPTS= 3, DT= .01 SEC\n-.1000000E-01-.2000000E-01\n+.3000000E-01\n\n"
    assert read_at2(written(tmp_path, text)).values.tolist() == [-0.01, -0.02, 0.03]


def test_the_shipped_record_comes_back_from_a_file_of_peer(tmp_path):
    acceleration, dt = pm.models.el_centro()
    rows = "\n".join("".join(f"{x:15.7E}" for x in row) for row in np.split(acceleration, [3, 900]))
    text = f"{TITLE}{UNITS}NPTS= {acceleration.size}, DT= {dt:.4f} SEC\n{rows}\n"
    record, step = read_at2(written(tmp_path, text))
    # eight digits are written
    assert step == dt and np.allclose(record, acceleration, rtol=1e-7, atol=0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: must begin with a header that gives NPTS and DT, got ''"),
        (TITLE + UNITS + SAMPLES, "line 1: must begin with a header"),
        (TITLE + UNITS + "NPTS= 6, DT= .005 SEC\n" + SAMPLES, "NPTS = 6 and 5 samples"),
        (TITLE + UNITS + "NPTS= 4, DT= .005 SEC\n" + SAMPLES, "NPTS = 4 and 5 samples"),
        (TITLE + UNITS + "NPTS= 5, DT= .000 SEC\n" + SAMPLES, "line 4: NPTS and DT must be posi"),
        (TITLE + UNITS + FORMS[0] + SAMPLES + "nan\n", "line 7: must hold finite numbers, got 'na"),
        (TITLE + UNITS + FORMS[0] + "1E999\n", "line 5: must hold finite numbers"),
        (TITLE + UNITS + FORMS[0] + "0.1 oops\n", "line 5: must hold finite numbers"),
        ("\0" * 9, "must be text, got a binary file"),
    ],
)
def test_another_file_is_refused_with_its_line(tmp_path, text, message):
    path = written(tmp_path, text)
    with pytest.raises(ValueError, match=message) as caught:
        read_at2(path)
    assert str(path) in str(caught.value)


def test_fields_may_follow_each_other_without_a_blank_and_text_the_last_one(tmp_path):
    rows = "0.1000E-010.2000E-01-.3000E+00\n 4.0D-03 5\n*** End Data ***\n"
    text = f"{TITLE}{UNITS}NPTS= 5, DT= .005 SEC\n{rows}"
    assert read_at2(written(tmp_path, text)).values.tolist() == [0.01, 0.02, -0.3, 0.004, 5.0]


def test_a_file_that_is_not_there_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_at2(tmp_path / "missing.AT2")
    with pytest.raises(TypeError, match="path must be a str or a path"):
        read_at2(3)
