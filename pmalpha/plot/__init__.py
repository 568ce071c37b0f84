"""Figures in one style, suitable for print. Requires matplotlib: pip install 'pmalpha[plot]'.

Curves differ by line style and grey value, not only by colour. No function opens a window: each
returns a matplotlib object; `save` writes a Figure to a file.
"""

from .drawings import split_oscillator, timeline
from .figures import figure7, save, slope
from .meshes import animation, deformed
from .schemes import scheme_damping, scheme_period, scheme_radius
from .styling import LINES, RC, style

__all__ = [
    "LINES",
    "RC",
    "animation",
    "deformed",
    "figure7",
    "save",
    "scheme_damping",
    "scheme_period",
    "scheme_radius",
    "slope",
    "split_oscillator",
    "style",
    "timeline",
]


def __dir__() -> list[str]:
    return sorted(__all__)
