"""python -m pmalpha: the numbers it prints and the picture it draws."""

import contextlib
import io

import numpy as np
import pytest
import waits
from test_models import PM, PM_ALPHA, four_dof_by_reference

from pmalpha import models
from pmalpha.__main__ import main


def row(text, start, columns):
    """The last numbers of the one line that begins like this."""
    (line,) = [line for line in text.splitlines() if line.startswith(start)]
    return [float(x) for x in line.split()[-columns:]]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    pytest.importorskip("matplotlib")
    folder = tmp_path_factory.mktemp("demo")
    with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.chdir(folder):
        assert main([]) == 0
    return folder, printed.getvalue()


def test_the_demo_prints_that_pm_alpha_annihilates_what_pm_keeps(finished):
    _, text = finished
    start = row(text, "start", 4)
    pm = row(text, "PM at step 100", 4)
    alpha = row(text, "PM-alpha at step 100", 4)
    # 0.697 is |phi_3^T M u0| of the chain
    assert start[2] == 0.697
    # the claims of figure 7, after macro step 100
    assert pm[2] > 0.6
    assert alpha[2] < 0.01
    for first in (pm[0], alpha[0]):
        assert first == pytest.approx(start[0], rel=0.05)


@pytest.mark.gate
def test_the_demo_prints_the_drift(finished):
    _, text = finished
    chain = models.four_dof()
    for name, schemes in {"PM ": PM, "PM-alpha ": PM_ALPHA}.items():
        (line,) = [x for x in text.splitlines() if x.startswith(name) and "at step" not in x]
        (gap,) = (float(x) for x in line.split()[1:])
        run = four_dof_by_reference(chain, *schemes, 100)
        expected = np.abs(run.displacement_jump).max()
        assert gap == pytest.approx(expected, abs=6e-4)  # three decimals


@pytest.mark.gate
def test_the_demo_prints_the_same_each_time(finished, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    assert capsys.readouterr().out == finished[1]


@pytest.mark.gate
def test_the_picture_is_a_png_fit_for_print(finished):
    from matplotlib import image

    folder, text = finished
    assert text.splitlines()[-1] == "Figure 7: figure7.png"
    picture = folder / "figure7.png"
    assert picture.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    pixels = image.imread(picture)[..., :3]
    # 180 mm, the width of a page with two columns, at 300 dots per inch is 2126
    assert pixels.shape[1] >= 2126
    # black, a blue and a white that are not mere antialiasing: curves on paper
    for colour in ((0.0, 0.0, 0.0), (0.0, 0x72 / 255, 0xB2 / 255), (1.0, 1.0, 1.0)):
        close = np.abs(pixels[::3, ::3] - np.array(colour)).max(axis=-1) < 0.01
        assert close.sum() > 1000 / 9, colour


@pytest.mark.gate
def test_name_of_the_picture_and_number_of_steps_can_be_chosen(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    assert main(["--output", "small.png", "--steps", "3"]) == 0
    assert [x.name for x in tmp_path.iterdir()] == ["small.png"]
    printed = capsys.readouterr().out
    assert "3 macro steps" in printed
    assert "PM at step 3, t = 0.16 s" in printed  # 3 / (40 * 0.47 Hz) = 0.1596 s


@pytest.mark.parametrize("steps", ["0", "-1", "1.5", "many"])
def test_an_invalid_number_of_steps_is_refused(tmp_path, steps, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main([f"--steps={steps}"])
    assert ended.value.code == 2
    assert f"must be a whole number above 0, got '{steps}'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.gate
def test_a_picture_that_cannot_be_written_is_one_clear_line(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    assert main(["--output", "nowhere/figure.png", "--steps", "3"]) == 1
    printed = capsys.readouterr()
    assert "PM-alpha at step 3" in printed.out  # the numbers are printed without the picture
    assert printed.err.startswith("pmalpha: nowhere/figure.png not drawn: ")
    assert len(printed.err.splitlines()) == 1


def test_without_matplotlib_the_demo_names_what_to_install(tmp_path):
    done = waits.program(f"""
        import os, runpy, sys, warnings
        warnings.simplefilter("error")
        os.chdir({str(tmp_path)!r})
        sys.argv = ["pmalpha"]
        sys.modules["matplotlib"] = None  # cannot be imported
        runpy.run_module("pmalpha", run_name="__main__")
    """)
    assert done.returncode == 1
    assert "PM-alpha at step 100" in done.stdout
    assert "pip install 'pmalpha[plot]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1
