"""Drawings of several notebooks: the split oscillator, schedules of the couplings, slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pmalpha.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Markers of time levels: of A, of its other chain, of B, and between the time levels of A
LEVEL = {"marker": "o", "color": "k", "markersize": 7.0, "linestyle": "none"}
OTHER_LEVEL = {**LEVEL, "marker": "s", "markersize": 6.5, "markerfacecolor": "0.75"}
SMALL_LEVEL = {**LEVEL, "markersize": 4.0}
INTERPOLATED = {**SMALL_LEVEL, "markerfacecolor": "w", "markeredgewidth": 0.8}
INTERFACE = {**INTERPOLATED, "marker": "D", "markersize": 5.0}
LEGEND_HEIGHT = 0.55  # inches
ARROW = {
    "arrowstyle": "-|>",
    "color": "k",
    "linewidth": 0.8,
    "mutation_scale": 7,
    "shrinkA": 0,
    "shrinkB": 0,
}


def split_oscillator() -> Figure:
    """The split oscillator: its cut, and the two subdomains with the interface force."""
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.1, 1.2), layout="constrained")
        ax = figure.subplots()
        for x, cut in ((0.0, 0.0), (4.8, 1.0)):
            _spring(ax, x, x + 1.0, "$k_A$")
            _mass(ax, x + 1.0, 0.9, "$m_A$")
            _mass(ax, x + 1.9 + cut, 0.6, "$m_B$")
            _spring(ax, x + 3.5 + cut, x + 2.5 + cut, "$k_B$")
        ax.plot([1.9, 1.9], [-0.6, 0.6], "k", linestyle=(0, (6, 3)))
        for x, side, force in ((6.7, 1, r"$\Lambda$"), (7.7, -1, r"$-\Lambda$")):
            ax.annotate("", (x + 0.4 * side, 0), (x, 0), arrowprops=ARROW)
            ax.text(x + 0.22 * side, 0.1, force, ha="center")
        ax.set(xlim=(-0.1, 9.4), ylim=(-0.65, 0.65), xticks=[], yticks=[])
        _bare(ax)
    return figure


def _spring(ax: Axes, wall: float, end: float, name: str) -> None:
    """A spring from a wall to a mass."""
    x = wall + (end - wall) * np.array([0.0, 0.15, *np.linspace(0.2, 0.8, 8), 0.85, 1.0])
    ax.plot(x, 0.13 * np.array([0, 0, *[1, -1] * 4, 0, 0]), "k-", linewidth=0.8)
    ax.plot([wall, wall], [-0.35, 0.35], "k-", linewidth=2.5)
    ax.text((wall + end) / 2, 0.25, name, ha="center")


def _mass(ax: Axes, x: float, width: float, name: str) -> None:
    ax.bar(x + width / 2, 0.7, width, -0.35, color="0.88", edgecolor="k", linewidth=0.7)
    ax.text(x + width / 2, 0.0, name, ha="center", va="center")


def timeline(coupling: str | None = None) -> Figure:
    """The staggered schedule, the interfield parallel schedule, or one above the other.

    Two subdomains, A with one step per macro step and B with four. For each schedule: the time
    levels and the steps between them in simulated time, then the work of two macro steps in wall
    clock time. The widths of the blocks are schematic, not measured. `coupling`, "gc" or "pm": the
    schedule that is drawn alone.
    """
    drawn = [SCHEDULES[name] for name in ([coupling] if coupling else SCHEDULES)]
    with style():
        from matplotlib.figure import Figure

        heights = [height for schedule in drawn for height in schedule.heights]
        figure = Figure(figsize=(7.1, sum(heights) + LEGEND_HEIGHT), layout="constrained")
        axes = figure.subplots(len(heights), 1, height_ratios=heights)
        ends = []
        for schedule, ax, work in zip(drawn, axes[::2], axes[1::2], strict=True):
            ax.set_title(schedule.title, loc="left")
            _instants(ax, schedule.steps)
            ends.append(schedule.work(work))
        for work in axes[1::2]:
            _wall_clock(work, max(ends))
        handles, labels = axes[-2].get_legend_handles_labels()
        columns = 4 if len(labels) == 4 else 3
        figure.legend(handles, labels, loc="outside lower left", ncols=columns)
    return figure


def _instants(ax: Axes, steps: Sequence[tuple[int, int, int]]) -> None:
    """A, the interface and B in simulated time; steps of A are (begin, end, side of its axis)."""
    fine = np.arange(-4, 9) / 4
    ax.hlines([0.0, 2.0], -1.15, 2.15, color="0.6", linewidth=0.6)
    ax.vlines(fine, 0.0, 2.0, color="0.75", linewidth=0.6, linestyle=":")
    for begin, end in zip(fine[:-1], fine[1:], strict=True):
        _arc(ax, begin, end, 0.0, -0.55, linewidth=0.7)
    for begin, end, side in steps:
        _arc(ax, begin, end, 2.0, 0.8 * side, linewidth=1.2, linestyle="-" if side > 0 else "--")
    kinds: dict[str, tuple[Sequence[float] | np.ndarray, float, dict[str, Any]]] = {
        "time level of A": ([n for _, n, side in steps if side > 0], 2.0, LEVEL),
        "time level of A, other chain": ([n for _, n, s in steps if s < 0], 2.0, OTHER_LEVEL),
        "interpolated, (15)": ([t for t in fine if t % 1.0], 2.0, INTERPOLATED),
        "interface problem, (18)": (fine, 0.85, INTERFACE),
        "time level of B": (fine, 0.0, SMALL_LEVEL),
    }
    for label, (t, y, look) in kinds.items():
        if len(t):
            ax.plot(t, np.full(len(t), y), **look, label=label)
    ax.set(xlim=(-1.15, 2.15), ylim=(-0.65, 2.95))
    ax.set_xticks(range(-1, 3), ["$t_{n-1}$", "$t_n$", "$t_{n+1}$", "$t_{n+2}$"])
    ax.set_yticks([2.0, 0.85, 0.0], ["A", "interface", "B"])
    _bare(ax)


def _arc(ax: Axes, begin: float, end: float, y: float, height: float, **line: Any) -> None:
    """An arrow between two instants, above the axis at y or, with height < 0, below it."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    feet, top = y + 0.2 * height, y + 1.8 * height
    corners = [(begin + 0.03, feet), ((begin + end) / 2, top), (end - 0.03, feet)]
    path = Path(corners, [Path.MOVETO, Path.CURVE3, Path.CURVE3])
    ax.add_patch(FancyArrowPatch(path=path, arrowstyle="-|>", mutation_scale=7, color="k", **line))


def _staggered_work(ax: Axes) -> float:
    """Two staggered macro steps; returns their end."""
    width, begin = 1.7, 0.0
    for n in (1, 2):
        closing = begin + width + 4.0
        _block(ax, begin, width, 1, f"free $n{{+}}{n}$")
        _four_substeps(ax, begin + width, n)
        _block(ax, closing, width, 1, f"link $n{{+}}{n}$")
        _exchange(ax, begin + width, "$v_f$", down=True)
        _exchange(ax, closing, r"$\Lambda$", down=False)
        _note(ax, closing - 2.0, 1, "A idle")
        begin = closing + width
    _note(ax, begin / 2, 0, "B idle")
    return begin


def _parallel_work(ax: Axes) -> float:
    """Two interfield parallel macro steps; returns their end."""
    for n, shade in ((0, "0.8"), (1, "0.92")):
        begin = 4.6 * n
        _block(ax, begin, 2.0, 1, f"link $n{{+}}{n}$" if n else "link $n$", shade)
        _block(ax, begin + 2.0, 2.0, 1, f"free $n{{+}}{n + 2}$", shade)
        _four_substeps(ax, begin, n + 1)
        _exchange(ax, begin + 4.2, "$v_f$", down=True)
        _exchange(ax, begin + 4.4, r"$\Lambda$", down=False)
    return begin + 4.6


def _four_substeps(ax: Axes, begin: float, n: int) -> None:
    for j in range(4):
        _block(ax, begin + j, 1.0, 0, f"{j + 1}", "w")
    ax.text(begin + 2.0, -0.5, f"to $t_{{n+{n}}}$", ha="center", va="top", fontsize=8.5)


def _block(ax: Axes, begin: float, width: float, row: int, text: str, shade: str = "0.88") -> None:
    ax.barh(row, width, 0.6, begin, color=shade, edgecolor="k", linewidth=0.7)
    ax.text(begin + width / 2, row - 0.02, text, ha="center", va="center", fontsize=8.5)


def _note(ax: Axes, x: float, row: int, text: str) -> None:
    ax.text(x, row, text, ha="center", va="center", fontsize=8.5, color="0.4")


def _exchange(ax: Axes, x: float, what: str, *, down: bool) -> None:
    """An arrow from A to B, or from B to A."""
    tail, head = (0.72, 0.28) if down else (0.28, 0.72)
    ax.annotate("", (x, head), (x, tail), arrowprops=ARROW)
    side = -0.12 if down else 0.12
    ax.text(x + side, 0.5, what, ha="right" if down else "left", va="center", fontsize=8.5)


def _wall_clock(ax: Axes, end: float) -> None:
    ax.set(xlim=(-0.3, end + 0.1), ylim=(-0.95, 1.4), xticks=[])
    ax.set_yticks([1, 0], ["A", "B"])
    ax.annotate("", (1, 0), (0, 0), xycoords="axes fraction", arrowprops=ARROW)
    ax.set_xlabel("wall clock", loc="right", labelpad=2)
    _bare(ax)


def _bare(ax: Axes) -> None:
    ax.grid(False)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)


def slope(ax: Axes, order: float, x: Sequence[float], y: float) -> None:
    """A reference line of this order on logarithmic axes, labelled at its end.

    `x` are its begin and end, `y` is the value at the begin.
    """
    begin, end = x
    top = y * (end / begin) ** order
    ax.plot([begin, end], [y, top], color="0.45", linestyle="-", linewidth=0.7)
    ax.annotate(
        f"{order:g}", (end, top), (3, 0), textcoords="offset points", va="center", color="0.3"
    )


class Schedule(NamedTuple):
    """The contents of its two axes."""

    title: str
    steps: list[tuple[int, int, int]]  # of A: begin, end, side of the axis
    work: Callable[[Axes], float]
    heights: tuple[float, float]  # inches


SCHEDULES = {
    "gc": Schedule(
        'Staggered, coupling="gc": A takes steps $h = dt$',
        [(n, n + 1, 1) for n in range(-2, 3)],
        _staggered_work,
        (1.7, 1.2),
    ),
    "pm": Schedule(
        'Interfield parallel, coupling="pm": A takes steps $h = 2\\,dt$',
        [(n, n + 2, 1 if n % 2 else -1) for n in range(-4, 3)],
        _parallel_work,
        (2.05, 1.2),
    ),
}
