"""The style of all figures as a context of matplotlib."""

import sys
from pathlib import Path

import pytest

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.figure import Figure  # noqa: E402

from pmalpha import plot  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1] / "notebooks"))
import drawings  # noqa: E402


def looks(ax):
    return [
        (line.get_color(), line._unscaled_dash_pattern[1], line.get_linewidth())
        for line in ax.lines
    ]


def test_curves_without_a_look_take_the_lines_of_all_figures_from_dark_to_light():
    with plot.style():
        plain, named = Figure().subplots(1, 2)
        for i in range(5):
            plain.plot([0.0, 1.0], [0.0, i])
            named.plot([0.0, 1.0], [0.0, i], **plot.LINES[::-1][i % 4])
    assert looks(plain) == looks(named)
    assert len(set(looks(plain))) == 4  # the fifth is as the first
    assert plain.lines[0].get_linestyle() == "-"


def test_the_style_ends_with_the_context():
    before = matplotlib.rcParams["axes.prop_cycle"], matplotlib.rcParams["font.size"]
    with plot.style():
        assert matplotlib.rcParams["axes.prop_cycle"] != before[0]
    assert (matplotlib.rcParams["axes.prop_cycle"], matplotlib.rcParams["font.size"]) == before


def test_matplotlib_takes_the_settings_as_a_style_of_its_own():
    from matplotlib import style

    with style.context(plot.RC):
        cycle = matplotlib.rcParams["axes.prop_cycle"].by_key()
    assert cycle["color"] == [line["color"] for line in plot.LINES[::-1]]


def test_meshes_have_solid_lines_also_beside_curves():
    with plot.style():
        ax = Figure().subplots()
        ax.plot([0.0, 1.0], [0.0, 1.0])
    plot.deformed([[0.0, 0.0], [1.0, 0.0]], [[0, 1]], [0.0, 0.0, 0.0, 0.1], ax=ax)
    assert ax.lines[1].get_linestyle() == "-"


# ---- schedules ------------------------------------------------------------------------------


def drawn_levels(ax):
    """Number of time levels of A by the label of its markers."""
    return {x.get_label(): len(x.get_xdata()) for x in ax.lines if "of A" in x.get_label()}


@pytest.mark.gate
def test_a_schedule_can_be_drawn_alone():
    both = drawings.timeline().axes
    for coupling, drawn in (("gc", both[:2]), ("pm", both[2:])):
        alone = drawings.timeline(coupling)
        assert [ax.get_title(loc="left") for ax in alone.axes] == [drawn[0].get_title("left"), ""]
        assert f'coupling="{coupling}"' in alone.axes[0].get_title(loc="left")
        assert drawn_levels(alone.axes[0]) == drawn_levels(drawn[0])
        words = [text.get_text() for text in alone.axes[1].texts]
        assert words == [text.get_text() for text in drawn[1].texts]
        alone.draw_without_rendering()
    # of the staggered schedule A has one chain; of the other every second time level
    assert set(drawn_levels(both[0])) == {"time level of A"}
    assert set(drawn_levels(both[2])) == {"time level of A", "time level of A, other chain"}


def test_springs_and_walls_are_solid_and_the_cut_is_dashed():
    """The cycle of lines must not reach into drawings: colours alone leave the line to it."""
    (ax,) = drawings.split_oscillator().axes
    dashed = [line for line in ax.lines if line.get_linestyle() != "-"]
    assert len(ax.lines) == 9  # a spring and a wall for each of four, and the cut
    assert [list(line.get_xdata()) for line in dashed] == [[1.9, 1.9]]
