"""The picture of a cut."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import counted
from ..plot.meshes import deformed
from ..structures.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Subdomains that a legend lists.
LEGEND = 12


def drawn(cut: Any, structure: Structure, ax: Axes | None) -> Axes:
    colours = _colours(np.array([s.substeps for s in cut.subdomains]))
    for i, (s, colour) in enumerate(zip(cut.subdomains, colours)):
        points, elements = _submesh(structure, cut.labels == i)
        label = f"{s.name}, {counted(s.substeps, 'substep')}"
        if s.name == counted(s.substeps, "substep"):
            label = s.name
        ax = deformed(
            points,
            elements,
            np.zeros(points.shape),
            scale=1.0,
            color=colour,
            label=label if len(cut.subdomains) <= LEGEND else None,
            ax=ax,
        )
    assert ax is not None
    ax.set_title("", loc="right")
    return ax


def _submesh(structure: Structure, chosen: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points and elements of the chosen elements of all kinds."""
    ends = np.cumsum([len(e) for e in structure.elements.values()])[:-1]
    kinds = zip(structure.elements.items(), np.split(chosen, ends))
    elements = {kind: nodes[mask] for (kind, nodes), mask in kinds if mask.any()}
    used = np.unique(np.concatenate([nodes.ravel() for nodes in elements.values()]))
    number = np.zeros(len(structure.points), dtype=np.int64)
    number[used] = np.arange(used.size)
    return structure.points[used], {kind: number[nodes] for kind, nodes in elements.items()}


def _colours(substeps: np.ndarray) -> np.ndarray:
    """(k, 4): by substeps from light to dark; of subdomains with equal ones different hues."""
    from matplotlib import colormaps

    if np.unique(substeps).size == substeps.size:
        ranks = np.argsort(np.argsort(substeps))
        return np.array(colormaps["viridis"](np.linspace(0.95, 0.1, substeps.size)[ranks]))
    shade = 1.0 - 0.5 * np.log2(substeps) / max(1.0, np.log2(substeps.max()))
    hues = colormaps["tab20"](np.arange(substeps.size) % 20)
    return np.column_stack([hues[:, :3] * shade[:, None], hues[:, 3]])
