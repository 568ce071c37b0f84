"""Every notebook runs from top to bottom; it asserts its own results."""

import base64
import io
import os
import runpy
from pathlib import Path

import forks
import numpy as np
import pytest
import waits

import pmalpha

pytestmark = pytest.mark.gate

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks():
    assert NOTEBOOKS


# the package that is being tested, and drawings beside the notebooks
FOLDERS = [Path(pmalpha.__file__).parents[1], NOTEBOOKS[0].parent, os.environ.get("PYTHONPATH")]
PYTHONPATH = os.pathsep.join(str(folder) for folder in FOLDERS if folder)


@pytest.fixture(scope="module")
def execute(tmp_path_factory):
    """The error of a notebook that is executed by tests/executed.py, and the files that it left."""
    folder = tmp_path_factory.mktemp("present")
    script = Path(__file__).with_name("executed.py")
    environment = os.environ | {"PYTHONPATH": PYTHONPATH}
    with forks.server(script, cwd=folder, env=environment) as error_of:
        yield lambda path: (error_of(path), list(folder.iterdir()))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_runs_and_leaves_its_file_alone(path, execute):
    before = path.read_bytes()
    error, left = execute(path)
    if error:
        pytest.fail(error, pytrace=False)
    assert path.read_bytes() == before
    assert not left


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")
@pytest.mark.parametrize(
    "source, error", [("import numpy\n1 / 0", "ZeroDivisionError"), ("import os\nos._exit(3)", "3")]
)
def test_a_cell_that_fails_is_an_error_and_the_next_notebook_runs(source, error, tmp_path, execute):
    path = tmp_path / "wrong.ipynb"
    for text, expected in ((source, error), ("print(1)", "")):
        notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text)])
        nbformat.write(notebook, path)
        found, left = execute(path)
        assert expected in found and bool(expected) == bool(found) and not left


@pytest.mark.campaign
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_runs_in_a_kernel_of_jupyter(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)
    before = path.read_bytes()
    notebook = nbformat.reads(before.decode(), as_version=4)
    # an error in a cell is raised here
    nbclient.execute(notebook, cwd=tmp_path, timeout=int(waits.LIMIT))
    assert path.read_bytes() == before
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_is_kept_as_it_was_run(path):
    cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    # in order, from a new kernel
    assert [c.execution_count for c in cells] == list(range(1, len(cells) + 1))
    outputs = [output for c in cells for output in c.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert all(output.output_type != "error" for output in outputs)
    assert all(output.get("name") != "stderr" for output in outputs)  # warnings go there


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_begins_with_its_result_and_a_picture_of_its_run(path):
    images = pytest.importorskip("PIL.Image")
    gallery = runpy.run_path(str(path.parents[1] / "docs" / "gallery.py"))
    first = nbformat.read(path, as_version=4).cells[0]
    assert first.source.split("\n\n")[1].startswith("**Result.** ")
    assert first.source.split("\n\n")[2].endswith("](attachment:result.png)")
    number = dict(gallery["entries"](path.parents[1] / "docs" / "gallery.md"))[path]
    stored = gallery["small"](list(gallery["pictures"](path))[number - 1]).convert("RGB")
    shown = images.open(io.BytesIO(base64.b64decode(first.attachments["result.png"]["image/png"])))
    assert shown.size == stored.size
    # other versions of Pillow choose other colours; another picture differs by tens
    assert np.abs(np.asarray(shown.convert("RGB"), float) - np.asarray(stored, float)).mean() < 3
