"""Figures in one style, fit for print. Needs matplotlib: pip install 'pmalpha[plot]'.

Curves differ by line style and by grey value, not by colour alone. Nothing here opens a window:
each function returns a matplotlib Figure, which `save` writes to a file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .history import History
    from .models import FourDof

__all__ = ["LINES", "RC", "figure7", "save", "style"]

# Okabe and Ito's colours, which the colour-blind can tell apart, by falling grey value
LINES: tuple[dict, ...] = (
    {"color": "#E69F00", "linestyle": (0, (1, 1)), "linewidth": 1.6},
    {"color": "#009E73", "linestyle": (0, (4, 1, 1, 1)), "linewidth": 1.2},
    {"color": "#0072B2", "linestyle": (0, (5, 1.5)), "linewidth": 1.2},
    {"color": "#000000", "linestyle": "-", "linewidth": 0.9},
)

# what every figure has in common, for matplotlib's rcParams
RC = {
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
    "figure.dpi": 100,
    "savefig.dpi": 300,
}


@contextmanager
def style() -> Iterator[None]:
    """The style of all figures here, for figures of your own.

    Raises
    ------
    ImportError
        If matplotlib is missing.

    Examples
    --------
    >>> import matplotlib
    >>> from pmalpha import plot
    >>> with plot.style():
    ...     matplotlib.rcParams["font.size"]
    9.0
    """
    try:
        import matplotlib
    except ImportError as error:
        raise ImportError("drawing needs matplotlib: pip install 'pmalpha[plot]'") from error
    with matplotlib.rc_context(RC):
        yield


def figure7(model: FourDof, histories: Mapping[str, History]) -> Figure:
    """Figure 7 of the paper: free vibration of the four-dof system, and its modal amplitudes.

    Parameters
    ----------
    model : FourDof
        What the histories have in common, from `pmalpha.models.four_dof`.
    histories : dict
        By the title of their row, drawn from top to bottom.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ImportError
        If matplotlib is missing.
    ValueError
        If a history lacks dofs.

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
        figure = Figure(figsize=(7.1, 1.0 + 2.1 * rows), layout="constrained")
        axes = figure.subplots(
            rows, 2, sharex=True, sharey="col", squeeze=False, width_ratios=(1.5, 1.0)
        )
        for (left, right), (title, history) in zip(axes, histories.items(), strict=True):
            _displacements(left, *model.displacements(history))
            _modal_amplitudes(right, *model.modal_amplitudes(history), model.frequencies)
            left.set_title(title, loc="left")
        for ax, columns in zip(axes[0], (4, 2), strict=True):
            ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.08), ncols=columns)
        for ax in axes[-1]:
            ax.set_xlabel("time $t$ (s)")
        figure.supxlabel(_caption(model), x=0.01, horizontalalignment="left", fontsize=8.5)
    return figure


def _displacements(ax: Axes, t: np.ndarray, u: np.ndarray) -> None:
    for i, line in enumerate(LINES):
        ax.plot(t, u[:, i], **line, label=f"$u_{i + 1}$")
    ax.set_ylabel("displacement (m)")
    ax.set_xlim(t[0], t[-1])


def _modal_amplitudes(
    ax: Axes, t: np.ndarray, amplitudes: np.ndarray, frequencies: np.ndarray
) -> None:
    for i, line in enumerate(LINES):
        ax.plot(t, amplitudes[:, i], **line, label=f"{frequencies[i]:.2f} Hz")
    ax.set_ylabel("modal amplitude (m kg$^{1/2}$)")


def _caption(model: FourDof) -> str:
    spectrum = ", ".join(f"{f:.2f}" for f in model.frequencies)
    return (
        "Partitioned four-dof system in free vibration from $u = (0, 0, 0, 1)$ m, at rest: "
        "displacements (left) and amplitudes of the uncut\nsystem's modes (right) at the macro "
        f"nodes. Masses and springs are a surrogate with the published spectrum, {spectrum} Hz."
    )


def save(figure: Figure, path: str | PathLike) -> None:
    """Write a figure to a file, in print resolution.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : str or path
        The ending gives the format: .png, .pdf, .svg.

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
