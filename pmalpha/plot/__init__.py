"""Figures in one style, suitable for print. Requires matplotlib: pip install 'pmalpha[plot]'.

Curves differ by line style and grey value, not only by colour. No function opens a window: each
returns a matplotlib object; `save` writes a Figure to a file.
"""

from .meshes import animation, deformed
from .styling import LINES, RC, save, style

__all__ = ["LINES", "RC", "animation", "deformed", "save", "style"]


def __dir__() -> list[str]:
    return sorted(__all__)
