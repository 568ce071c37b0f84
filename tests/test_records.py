"""Ground motions: every format gives its samples, step and unit; another file is refused."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.readers import read_record

VALUES = [0.01, -0.02, 0.3, 4e-3, -5.0]


def written(tmp_path, text, name="valley.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


def fixed(values, columns, width, digits):
    """Fields that may follow each other without a blank."""
    fields = [f"{x:{width}.{digits}f}" for x in values]
    return "".join("".join(fields[k : k + columns]) + "\n" for k in range(0, len(fields), columns))


PEER = "PEER\nA VALLEY\nACCELERATION TIME HISTORY IN UNITS OF G\nNPTS=  5, DT=   .0200 SEC\n"
CSMIP = "Corrected accelerogram\n a valley\n  5 points of accel data equally spaced at  .020 sec, "
CSMIP += "in cm/sec2.  (3f8.4)\n"
REAL = [-999.0] * 100
COSMOS = "Corrected acceleration\n  100 Real-header values follow on 20 lines, Format=(5F15.6)\n"


def cosmos(at, value, seconds=0):
    real = list(REAL)
    real[at] = value
    rows = "".join("".join(f"{x:15.6f}" for x in real[k : k + 5]) + "\n" for k in range(0, 100, 5))
    text = f"{COSMOS}{rows}   1 Comment line(s) follow, each starting with a |:\n| a valley\n"
    text += f"    5 acceleration pts, approx {seconds} secs, units=cm/s^2 (4),Format=(3F8.4)\n"
    return text + fixed(VALUES, 3, 8, 4) + "End-of-data for Chan  1 acceleration\n"


ESM = "EVENT_NAME: A VALLEY\nSAMPLING_INTERVAL_S: 0.020000\nNDATA: 5\nUNITS: cm/s^2\nUSER5:\n"
K_NET = """Origin Time       2011/03/11 14:46:00
Sampling Freq(Hz) 50Hz
Duration Time(s)  0.1
Dir.              N-S
Scale Factor      2000(gal)/8000
Max. Acc. (gal)   5.0
Memo.
"""


def of_fields(values, columns, form):
    return "".join(
        "".join(form.format(x) for x in values[k : k + columns]) + "\n"
        for k in range(0, len(values), columns)
    )


def geonet(heading="Corrected accelerogram VALLEY_20 GNS Science", seconds=0.08, step=0.02):
    """Two components, each with accelerations and velocities."""
    whole, real = [2018] * 40, [7.0] * 60
    whole[33:36], real[23], real[25] = [len(VALUES), 3, 0], seconds, step
    text = heading + "\n" + "Displacement:  peak    0.131 mm     at  43.66 sec\n" * 15
    text += of_fields(whole, 10, "{:8d}") + of_fields(real, 10, "{:8.2f}")
    return 2 * (text + fixed(VALUES, 10, 8, 3) + fixed([9.0, 9.0, 9.0], 10, 8, 1))


def smc(heading="2 CORRECTED ACCELEROGRAM", rate=50.0, number=5, high=False):
    whole, real = [-32768] * 48, [1.7e38] * 50
    whole[15:17], whole[46], real[1] = [2, number], 8 if high else -32768, rate
    text = heading + "\n" + "*\n" * 10 + of_fields(whole, 8, "{:10d}")
    text += of_fields(real, 5, "{:15.7E}") + "|\n| a valley\n"
    digits, width = (7, 14) if high else (4, 10)
    fields = [f"{x:.{digits}E}".replace("E+0", "E+").replace("E-0", "E-") for x in VALUES]
    return text + of_fields(fields, 5 if high else 8, f"{{:>{width}}}")


FORMATS = {
    "mm/s^2": geonet(),
    "cm/s^2, USGS": smc(),
    "cm/s^2, USGS with more digits": smc(high=True),
    "g": PEER + ".1E-01 -.2E-01 .3 4.0E-03\n -5\n*** End ***\n",
    "cm/sec2": CSMIP + fixed(VALUES, 3, 8, 4) + "  5 points of veloc data equally spaced\n 9. 9.\n",
    "cm/s^2 (4)": cosmos(61, 20.0),
    "cm/s^2": ESM + "".join(f"{x}\n" for x in VALUES),
    "gal": K_NET + "0.04 -0.08 1.2 0.016\n -20\n",
    "m/s^2": "Time (s)\tAcceleration (m/s^2)\n"
    + "".join(f"{0.02 * i:.3f}\t{x}\n" for i, x in enumerate(VALUES)),
    "not given": "# t, a\n" + "".join(f"{0.02 * i:.3f}, {x}\n" for i, x in enumerate(VALUES)),
}


@pytest.mark.parametrize("unit", FORMATS)
def test_a_record_has_its_samples_step_and_unit(tmp_path, unit):
    record = read_record(written(tmp_path, FORMATS[unit]))
    unit = unit.partition(",")[0]
    np.testing.assert_allclose(record.values, VALUES, rtol=1e-15)
    assert record.dt == pytest.approx(0.02, rel=1e-15) and record.name == "valley.txt"
    assert record.header.splitlines()[-1].lower() == f"unit: {unit}"
    assert ("not given" in repr(record)) == (unit == "not given") and unit in repr(record).lower()
    assert "unit" not in repr(0.01 * record)  # in which the unit is another one


@pytest.mark.parametrize("unit", FORMATS)
@pytest.mark.parametrize("system", ["ends of lines", "mark of bytes"])
def test_ends_of_lines_and_marks_of_another_system_change_nothing(tmp_path, unit, system):
    content = FORMATS[unit].encode()
    if system == "ends of lines":
        content = content.replace(b"\n", b"\r\n")
    else:
        content = b"\xef\xbb\xbf" + content
    path = tmp_path / "valley.txt"
    path.write_bytes(content)
    np.testing.assert_allclose(read_record(path).values, VALUES, rtol=1e-15)


# Headings as networks or people write them, of which the second channel is understood.
HEADINGS = [
    "    5 points of accel data equally spaced at  .020 sec, in cm/sec2.",
    "    5 points of accel data equally spaced at  .020 sec, in cm/sec2. 3f8.4",
    "    5 points of data equally spaced at  .020 sec, in cm/sec2.  (3f8.4)",
    "    5 point of accel data equally spaced at  .020 sec, in cm/sec2.  (3f8.4)",
    "    5 points of accel data, dt =  .020 sec, in cm/sec2.  (3f8.4)",
    "Acceleration, 5 points equally spaced at  .020 sec, in cm/sec2.  (3f8.4)",
    "    5 samples of accel data equally spaced at  .020 sec, in cm/sec2.  (3f8.4)",
    "    5 acceleration pts, approx  0 secs, units=cm/s^2 (4)",
    "    5 acceleration pts, units=cm/s^2 (4),Format=(3F8.4)",
    "    5 pts of acceleration, approx  0 secs, units=cm/s^2 (4),Format=(3F8.4)",
    "    5 acceleration pts, approx 0 secs, Format=(3F8.4)",
    "NPTS 5 of acceleration, approx  0 secs, units=cm/s^2 (4),Format=(3F8.4)",
]


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("end", ["", "/&  ---- End of data for channel  1 ----\n"])
def test_a_heading_that_is_not_understood_is_no_reason_to_take_the_next_channel(
    tmp_path, heading, end
):
    second = CSMIP + fixed([7.0] * 5, 3, 8, 4)
    path = written(tmp_path, f"Chan 1\n{heading}\n{fixed(VALUES, 3, 8, 4)}{end}{second}")
    with pytest.raises(ValueError, match="line 2: the heading of the first channel must be as in"):
        read_record(path)


@pytest.mark.parametrize(
    "heading",
    [
        "    5 points of acceleration data, equally-spaced at  .020 seconds, in cm/sec2.  (3f8.4)",
        "    5 points of accel. data equally spaced at  .020 sec, (in cm/sec2)  (3f8.4)",
    ],
)
def test_headings_in_other_words_are_understood(tmp_path, heading):
    words = "    9 points of corrected accel, velocity and displacement data, approx"
    text = f"Chan 1\n{words}\n{heading}\n"
    path = written(tmp_path, text + fixed(VALUES, 3, 8, 4) + CSMIP + fixed([7.0] * 5, 3, 8, 4))
    np.testing.assert_allclose(read_record(path).values, VALUES, rtol=1e-15)


def test_fields_that_touch_are_read_by_their_width(tmp_path):
    values = [10.1234, 10.2345, -99.125, 99.125, 0.5]
    text = CSMIP.replace("3f8.4", "3f7.4") + fixed(values[:2], 3, 7, 4)
    path = written(tmp_path, text.replace("  5 points", "  2 points"))
    assert "10.123410.2345" in path.read_text()
    np.testing.assert_array_equal(read_record(path).values, values[:2])


@pytest.mark.parametrize("head", ["valley, Ms 6.7", "mb 6.1, ms 6.7", "MS=6.7", "M 6.7, ms: 6.7"])
def test_a_magnitude_is_no_unit_of_time(tmp_path, head):
    assert read_record(written(tmp_path, f"# {head}\n0.00 0.1\n0.01 0.2\n")).dt == 0.01


@pytest.mark.parametrize(
    "head", ["t (ms), a", "t [ms] a", "time, ms; a", "time in msec", "t, milliseconds", "TIME (MS)"]
)
def test_times_in_milliseconds_are_refused(tmp_path, head):
    with pytest.raises(ValueError, match="times must be in seconds, got milliseconds"):
        read_record(written(tmp_path, f"# {head}\n0 0.1\n10 0.2\n"))


def test_the_recorder_of_cosmos_has_the_step_where_the_record_has_none(tmp_path):
    assert read_record(written(tmp_path, cosmos(33, 0.02))).dt == 0.02
    with pytest.raises(ValueError, match="step of the header must fit 5 samples in 90 s, got 0.02"):
        read_record(written(tmp_path, cosmos(33, 0.02, 90)))


def test_uneven_times_are_resampled_between_the_samples(tmp_path):
    t = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
    text = "".join(f"{a} {b}\n" for a, b in zip(t, VALUES))
    record = read_record(written(tmp_path, text))
    expected = pm.readers.Record.from_times(t, VALUES)
    np.testing.assert_array_equal(record.values, expected.values)
    assert record.dt == expected.dt


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must be a record of PEER, .* or two columns of numbers, got ''"),
        ("a b\nc d\n", "must be a record of PEER"),
        ("1\n2\n3\n", "must be a record of PEER"),
        ("0 1\n0.1 2\n0.1 3\n", "line 3: times must increase"),
        ("0 1\n0.1 2\n0.2 nan\n", "line 3: must hold finite numbers"),
        ("0 1\n0.1 2\n0.2 3 4\n", "line 3: must hold finite numbers"),
        (FORMATS["g"].replace("NPTS=  5", "NPTS=  7"), "line 7: must hold finite numbers"),
        (FORMATS["cm/sec2"].replace("  5 points of accel", "  9 points of accel"), "must "),
        (FORMATS["cm/s^2"].replace("NDATA: 5", "NDATA: 6"), "must give 6 samples, got 5"),
        (FORMATS["gal"].replace("-20", "x"), "line 9: must hold finite numbers"),
        (FORMATS["gal"].replace(" -20\n", ""), "must give 5 samples, got 4"),
        (FORMATS["gal"].replace("Memo.\n", ""), "must have a line Memo before the samples"),
        (FORMATS["not given"].replace("t, a", "t (ms), a"), "times must be in seconds"),
        (FORMATS["gal"].replace("50Hz", "0Hz"), "must be positive"),
        ("\0", "must be text, got a binary file"),
        (geonet("Uncorrected accelerogram X GNS Science"), "must be a corrected record, such as"),
        (geonet(seconds=0.16), "line 23: the step of the header must fit 5 samples in 0.16 s"),
        (geonet()[:1300], "must have a header of 26 lines and more"),
        (smc("1 UNCORRECTED ACCELEROGRAM"), "must be a corrected record, such as .V2 of CSMIP"),
        (smc("3 VELOCITY"), "must be a record of accelerations, got '3 VELOCITY'"),
        (smc("6 FOURIER AMPLITUDE SPECTRA"), "must be a record of accelerations, got '6 FOUR"),
        (smc(rate=1.7e38), "line 18: the sampling rate must be positive and known, got 1.7e.38"),
        (smc(number=-32768), "numbers of comments and samples must be positive, got 2 and -32768"),
        (smc(number=6), "must give 6 samples, got 5"),
        (smc().replace(" 3.0000E-1", "30.000E-2"), "line 30: must hold finite numbers"),
        (
            "Uncorrected accelerogram\nx\n1 2 3\n",
            "must be a corrected record, such as .V2 of CSMIP",
        ),
        (FORMATS["g"].replace("ACCELERATION", "VELOCITY").replace("OF G", "OF CM/S"), "unit CM/S"),
        (
            FORMATS["cm/s^2"].replace("UNITS: cm/s^2", "UNITS: cm"),
            "must be a record of accel.* cm$",
        ),
        ("time (s) velocity (m/s)\n0 1\n1 2\n", "must be a record of accelerations, got 'time"),
        ("a\n# t v (m/s)\n0 1\n1 2\n", "must be a record of accelerations, got the unit m/s"),
        ("t, displacement\n0 1\n1 2\n", "must be a record of accelerations, got 't, disp"),
        (CSMIP.replace("accel data", "veloc data") + "1 2 3\n4 5\n", "got '5 points of veloc data"),
        (
            FORMATS["g"].replace(".3 4.0E-03", "10.1234510.23456"),
            "must have blanks between its num",
        ),
        (CSMIP + "10.1234510.23456 3.0000\n" + "  1.0   2.0\n", "must hold finite numbers"),
        (
            CSMIP.replace("3f8.4", "3f9.4") + "10.1234510.23456 3.0000\n  1.0  2.0\n",
            "must hold fini",
        ),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_its_line(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        read_record(written(tmp_path, text))


def test_the_step_of_peer_is_the_first_one_after_the_number_of_samples(tmp_path):
    """Others before it, and a title with one of the words, are none."""
    path = tmp_path / "x.AT2"
    path.write_text("PEER\nDT= 9. OF NPTS\nDT= 7., NPTS=  2, AT, DT=   .0050 SEC, DT= 8.\n .1 .2\n")
    assert pm.readers.read_at2(path).dt == 0.005
