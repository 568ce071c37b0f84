"""Every row of docs/validated.md is within its tolerance, and its digits are those of the run."""

import re
from pathlib import Path

import numpy as np
import pytest
import validated

PAGE = Path(__file__).parent.parent / "docs" / "validated.md"
MARKS = {case: pytest.mark.gate for case in validated.SLOW}


def on_page(case):
    """The lines of a case in the table."""
    text = PAGE.read_text("utf-8").partition("<!-- validated -->")[2].partition("<!-- end -->")[0]
    return [line for line in text.splitlines() if line.startswith(f"| `{case.__name__}`")]


def numbers(line):
    """Published, ours, and the errors of a line."""
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    return [float(x) for x in re.findall(r"[-+.\de]+", " ".join(cells[3:7]))]


@pytest.mark.parametrize(
    "case",
    [pytest.param(x, id=x.__name__, marks=MARKS.get(x, ())) for x in validated.CASES],
)
def test_the_published_results_are_reproduced_uncut_and_in_subdomains(case):
    rows = case()
    lines = on_page(case)
    assert len(lines) == len(rows)
    for row, line in zip(rows, lines):
        uncut = row.error(row.ours)
        assert uncut <= row.tolerance, (row.quantity, uncut)
        for coupling, value in row.coupled.items():
            error = row.error(value)
            assert error <= row.tolerance, (row.quantity, coupling, error)
            if coupling in ("macro", "mean"):
                # as right as uncut: within a factor of 2, or far below the tolerance
                assert error <= max(2.0 * uncut, 0.1 * row.tolerance), (row.quantity, error)
        written = validated.line_of(case, "", row)
        for shown, computed in zip(numbers(line), numbers(written), strict=True):
            # two digits of an error, which rounding of 1e-12 in the run moves by one at most
            assert shown == pytest.approx(computed, rel=0.06, abs=1e-7), line


def test_there_are_at_least_25_rows_with_a_coupled_run():
    text = PAGE.read_text("utf-8")
    assert len(re.findall(r"^\| `\w+` \|.*\(\d.*\) \|", text, flags=re.MULTILINE)) >= 25
    assert {"sdnd106", "deep_beam"} <= {case.__name__ for case in validated.CASES}


def test_a_wrong_result_is_outside_of_the_tolerance():
    row = validated.Row("u", [1.0, -2.0], 1e-2, [1.0, -2.0], {})
    assert row.error([1.0, -2.0]) == 0.0
    assert row.error([1.03, -2.0]) == pytest.approx(0.015)
    assert row._replace(each=True).error(np.array([1.03, -2.0])) == pytest.approx(0.03)
