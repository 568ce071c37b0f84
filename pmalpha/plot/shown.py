"""Figures that show themselves: in a notebook at the end of the cell, in a script by plt.show()."""

from __future__ import annotations

from io import BytesIO
from typing import Any

from matplotlib import pyplot
from matplotlib.figure import Figure


class ShownFigure(Figure):
    """A figure of pyplot that a notebook shows once, also as the value of a cell."""

    def _ipython_display_(self) -> None:
        if "inline" not in pyplot.get_backend():
            raise NotImplementedError  # IPython then takes the form of any Figure
        from IPython.display import Image, display

        png = BytesIO()
        self.savefig(png, format="png", dpi=self.dpi)
        display(Image(png.getvalue()))  # type: ignore[no-untyped-call]  # of IPython
        pyplot.close(self)  # otherwise it would be shown once more at the end of the cell


def shown_figure(**options: Any) -> ShownFigure:
    """A figure known to pyplot, with the options of `matplotlib.figure.Figure`."""
    with pyplot.rc_context({"figure.max_open_warning": 0}):
        return pyplot.figure(FigureClass=ShownFigure, **options)  # type: ignore[return-value]
