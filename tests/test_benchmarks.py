"""The benchmarks run and write the data of the tables. No time is tested."""

import csv
import importlib
import os
import re
from pathlib import Path

import forks
import pytest

pytestmark = pytest.mark.gate

ROOT = Path(__file__).parent.parent
BENCHMARKS = ROOT / "benchmarks"
# instructions.py carries Python under valgrind, which takes a minute at any size, and
# step_profile.py needs perf; ranks.py is run by test_mpi.py
SCRIPTS = [
    "contact",
    "coupling_cost",
    "cut_plan",
    "cut_threads",
    "cutting",
    "elements",
    "ensembles",
    "executors",
    "fine_step",
    "growth",
    "large",
    "limits",
    "mass_scaling",
    "mean",
    "newton",
    "one_per_cent",
    "pacing",
    "plate",
    "recorded",
    "rig_loop",
    "setting_up",
    "subcycled_energy",
    "subcycling",
    "threads",
    "uncoupled",
    "watched",
]
TOLERANCE = 1e-10  # both sum the same terms in another order, 20 steps long


def columns_and_rows(path):
    with open(path, newline="") as file:
        reader = csv.DictReader(file)
        return reader.fieldnames, list(reader)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The CSV of a script run with --quick, by its name."""
    folder = tmp_path_factory.mktemp("results")
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    with forks.server(ROOT / "tests" / "benchmarked.py", env=environment) as error_of:

        def run(script):
            path = folder / f"{script}.csv"
            if not path.exists():
                error = error_of(BENCHMARKS / f"{script}.py", "--quick", "--results", folder)
                if error:
                    pytest.fail(error, pytrace=False)
            return columns_and_rows(path)

        yield run


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_benchmark_runs_and_writes_the_columns_of_its_committed_results(quick, script):
    columns, rows = quick(script)
    committed, _ = columns_and_rows(BENCHMARKS / "results" / f"{script}.csv")
    assert columns == committed
    assert columns[-3:] == ["machine", "versions", "date"]
    assert rows and all(None not in row and "" != row[columns[0]] for row in rows)


@pytest.mark.parametrize("script", ["plate", "uncoupled"])
def test_a_loop_that_is_timed_against_pmalpha_gives_the_same_numbers(quick, script):
    _, rows = quick(script)
    assert all(float(row["difference"]) < TOLERANCE for row in rows)


def test_newton_loops_that_are_timed_against_pmalpha_give_the_same_numbers(quick):
    _, rows = quick("newton")
    compared = [float(row["difference"]) for row in rows if row["difference"]]
    # all iterate to 1e-8 of the motion, and the last correction of bilinear springs is exact
    assert len(compared) >= 2 and max(compared) < TOLERANCE


def test_every_benchmark_is_named_in_the_readme():
    readme = (BENCHMARKS / "README.md").read_text()
    shared = {"timing", "memory", "peers", "draw"}
    scripts = {path.stem for path in BENCHMARKS.glob("*.py")} - shared
    assert not [name for name in sorted(scripts) if f"benchmarks/{name}.py" not in readme]


def test_the_tables_of_the_pages_are_those_of_the_results(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    draw = importlib.import_module("draw")
    texts = [path.read_text() for path in draw.PAGES]
    assert [draw.page(text) for text in texts] == texts
    assert set(re.findall(r"<!-- (\w+) -->", "".join(texts))) - {"end"} == set(draw.TABLES)


def test_every_picture_of_the_pages_is_drawn_from_results_with_these_columns(monkeypatch, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(BENCHMARKS)
    draw = importlib.import_module("draw")
    monkeypatch.setattr(draw, "PICTURES", tmp_path)
    with matplotlib.rc_context():
        draw.draw()
    texts = "".join(path.read_text() for path in draw.PAGES)
    named = set(re.findall(r"pictures/(performance-\S+\.svg)", texts))
    assert named == {path.name for path in tmp_path.iterdir()}
