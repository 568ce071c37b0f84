"""Figures in one style, fit for print. Needs matplotlib: pip install 'pmalpha[plot]'.

Curves differ by line style and by grey value, not by colour alone. Nothing here opens a window:
each function returns a matplotlib Figure, which `save` writes to a file, or what belongs to one.
"""

from .drawings import split_oscillator, timeline
from .figures import figure7, save, slope
from .meshes import animation, deformed
from .styling import LINES, RC, style

__all__ = [
    "LINES",
    "RC",
    "animation",
    "deformed",
    "figure7",
    "save",
    "slope",
    "split_oscillator",
    "style",
    "timeline",
]


def __dir__() -> list[str]:
    return sorted(__all__)
