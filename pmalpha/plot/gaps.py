"""Gaps and forces of contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..problem.dofs import dof_list
from .styling import shown_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def gaps_and_forces(history: Any, rows: Any = None, *, title: str | None = None) -> Figure:
    """`ContactHistory.plot`."""
    gap, force, label = history.gap, history.force, None
    if rows is None:
        gap, force = gap.min(axis=1, keepdims=True), force.sum(axis=1, keepdims=True)
    else:
        chosen = dof_list(rows, gap.shape[1], "rows")
        gap, force, label = gap[:, chosen], force[:, chosen], [f"row {k}" for k in chosen]
    # the force is the mean over a step: a line over its length
    with shown_style():
        from matplotlib import pyplot as plt

        figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(6.4, 4.4))
        above.plot(history.t, gap, label=label)
        above.axhline(0.0, color="0.6", linewidth=0.8)
        for k in range(force.shape[1]):
            below.step(history.t, np.concatenate([force[1:2, k], force[1:, k]]), where="pre")
        above.set_ylabel("gap" if label else "smallest gap")
        below.set_ylabel("force" if label else "sum of forces")
        below.set_xlabel("time $t$")
        above.set_title(history.name if title is None else title)
        if label and len(label) > 1:
            above.legend()
    return figure
