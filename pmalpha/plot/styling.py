"""The style of all figures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from typing import TYPE_CHECKING, Any

from ..files import library

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LINES", "RC", "save", "style"]

# Colours of Okabe and Ito, distinguishable in colour blindness, from light to dark
LINES: tuple[dict[str, Any], ...] = (
    {"color": "#E69F00", "linestyle": (0, (1, 1)), "linewidth": 1.6},
    {"color": "#009E73", "linestyle": (0, (4, 1, 1, 1)), "linewidth": 1.2},
    {"color": "#0072B2", "linestyle": (0, (5, 1.5)), "linewidth": 1.2},
    {"color": "#000000", "linestyle": "-", "linewidth": 0.9},
)


def _cycle() -> str:
    """The lines from dark to light, as text that matplotlib reads: no import is needed for it."""
    keys = LINES[0].keys()
    return " + ".join(f"cycler({key!r}, {[line[key] for line in LINES[::-1]]!r})" for key in keys)


# rcParams of matplotlib for all figures
RC: dict[Any, Any] = {
    "axes.prop_cycle": _cycle(),
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "lines.linewidth": 1.0,
    "figure.dpi": 120,
    "savefig.dpi": 300,
}


@contextmanager
def style() -> Iterator[None]:
    """The style of all figures, as a context for further figures.

    Fonts, axes, resolution, and the cycle of `LINES` from dark to light: the first curve is solid
    and black, the next ones are dashed, dash-dotted and dotted. A curve with a colour of its own
    that is to be solid states both: ``ax.plot(x, y, "k-")``. With
    ``matplotlib.rcParams.update(RC)`` a whole session has the style.

    Yields
    ------
    None
        Figures made in the context have the style.

    Raises
    ------
    ImportError
        If matplotlib is missing.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from pmalpha import plot
    >>> with plot.style():
    ...     lines = Figure().subplots().plot([[0.0, 0.0], [1.0, 2.0]])
    >>> [line.get_color() for line in lines] == [look["color"] for look in plot.LINES[:1:-1]]
    True
    """
    matplotlib = library("matplotlib", "drawing", "'pmalpha[plot]'")
    with matplotlib.rc_context(RC):
        yield


@contextmanager
def shown_style() -> Iterator[None]:
    """The style for figures of pyplot.

    The backend is loaded before: the settings of a notebook would be lost at the end of the
    context.
    """
    with style():
        from matplotlib import pyplot
    pyplot.draw_if_interactive()  # type: ignore[no-untyped-call]  # of matplotlib
    with style():
        yield


def require_axes(ax: Any) -> None:
    if ax is not None and not hasattr(ax, "add_artist"):
        raise TypeError(f"ax must be one Axes of matplotlib, got {type(ax).__name__}")


def shown_figure(**options: Any) -> Figure:
    """A figure of pyplot, with its options: a notebook shows it at the end of the cell, a script by
    plt.show()."""
    from matplotlib import pyplot

    with pyplot.rc_context({"figure.max_open_warning": 0}):
        return pyplot.figure(**options)


def save(figure: Figure | Axes, path: str | PathLike[str]) -> None:
    """Write a figure to a file, with the resolution of print.

    Parameters
    ----------
    figure : matplotlib.figure.Figure or matplotlib.axes.Axes
        Such as of `History.plot`; of axes, their figure.
    path : str or path
        The suffix gives the format: .png, .pdf, .svg.

    Raises
    ------
    OSError, ValueError
        From matplotlib: no such folder, unknown format.

    Examples
    --------
    >>> import io, matplotlib.figure
    >>> from pmalpha import plot
    >>> plot.save(matplotlib.figure.Figure(), io.BytesIO())
    """
    target: Any = figure if hasattr(figure, "savefig") else figure.figure
    with style():
        target.savefig(path)
