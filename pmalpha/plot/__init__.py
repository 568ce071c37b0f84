"""Figures in one style, suitable for print. Requires matplotlib: pip install 'pmalpha[plot]'.

Curves differ by line style and grey value, not only by colour. What draws takes ``ax=`` and
returns the axes that it drew into; without, they are those of a new figure of pyplot, which a
notebook shows at the end of the cell and a script by ``plt.show()``. `save` writes it to a file.
"""

from .film import animation
from .meshes import deformed
from .styling import LINES, RC, save, style

__all__ = ["LINES", "RC", "animation", "deformed", "save", "style"]


def __dir__() -> list[str]:
    return sorted(__all__)
