"""Figure 7 of the paper, slopes, and figures as files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from .styling import LINES, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..models import FourDof
    from ..run.history import History

__all__ = ["figure7", "save", "slope"]


def figure7(model: FourDof, histories: Mapping[str, History]) -> Figure:
    """Figure 7 of the paper: free vibration of the four-dof system, and its modal amplitudes.

    Displacements (left) and amplitudes of the modes of the uncut system (right), both at the macro
    time levels.

    Parameters
    ----------
    model : FourDof
        From `pmalpha.models.four_dof`, with the initial values of the histories.
    histories : dict
        History by title of its row, from top to bottom.

    Returns
    -------
    matplotlib.figure.Figure
        A row for each history.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    ValueError
        If not all dofs of a history are recorded.

    Examples
    --------
    >>> from pmalpha import models, plot
    >>> chain = models.four_dof()
    >>> history = chain.coupler(chain.macro_step).run(steps=5)
    >>> len(plot.figure7(chain, {"PM-alpha": history}).axes)
    2
    """
    with style():
        from matplotlib.figure import Figure

        rows = len(histories)
        figure = Figure(figsize=(7.1, 0.6 + 2.1 * rows), layout="constrained")
        axes = figure.subplots(
            rows, 2, sharex=True, sharey="col", squeeze=False, width_ratios=(1.5, 1.0)
        )
        for (left, right), (title, history) in zip(axes, histories.items(), strict=True):
            _displacements(left, *model.displacements(history))
            _modal_amplitudes(right, *model.modal_amplitudes(history), model.frequencies)
            left.set_title(title, loc="left")
        for ax in axes[0]:
            ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.08), ncols=2)
        for ax in axes[-1]:
            ax.set_xlabel("time $t$ (s)")
    return figure


def _displacements(ax: Axes, t: np.ndarray, u: np.ndarray) -> None:
    for i, line in enumerate(LINES):  # u_1, the smallest, above the others
        ax.plot(t, u[:, i], **line, zorder=3.0 - 0.1 * i, label=f"$u_{i + 1}$")
    ax.set_ylabel("displacement (m)")
    ax.set_xlim(t[0], t[-1])


def _modal_amplitudes(
    ax: Axes, t: np.ndarray, amplitudes: np.ndarray, frequencies: np.ndarray
) -> None:
    for i, line in enumerate(LINES):
        ax.plot(t, amplitudes[:, i], **line, label=f"{frequencies[i]:.2f} Hz")
    ax.set_ylabel("modal amplitude (m kg$^{1/2}$)")


def slope(ax: Axes, order: float, x: Sequence[float], y: float) -> None:
    """A reference line of this order on logarithmic axes, labelled at its end.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Both axes logarithmic.
    order : float
        Slope in log(y) over log(x).
    x : two floats
        Begin and end of the line.
    y : float
        Value at x[0].

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from pmalpha import plot
    >>> ax = Figure().subplots()
    >>> plot.slope(ax, 2, (0.01, 0.1), 1e-4)
    >>> [round(float(y), 6) for y in ax.lines[0].get_ydata()]
    [0.0001, 0.01]
    """
    begin, end = x
    top = y * (end / begin) ** order
    ax.plot([begin, end], [y, top], color="0.45", linestyle="-", linewidth=0.7)
    ax.annotate(
        f"{order:g}", (end, top), (3, 0), textcoords="offset points", va="center", color="0.3"
    )


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Write a figure to a file, with the resolution of print.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Such as of `History.plot`.
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
    with style():
        figure.savefig(path)
