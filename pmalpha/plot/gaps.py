"""Gaps and forces of contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..problem.dofs import dof_list
from .styling import shown_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def gaps_and_forces(
    history: Any, rows: Any = None, *, title: str | None = None, ax: Axes | None = None
) -> Axes:
    """`ContactHistory.plot`."""
    gap, force = history.gap, history.force
    labels, names = ["smallest gap"], ("smallest gap", "sum of forces")
    if rows is None:
        gap, force = gap.min(axis=1, keepdims=True), force.sum(axis=1, keepdims=True)
    else:
        chosen = dof_list(rows, gap.shape[1], "rows")
        gap, force, names = gap[:, chosen], force[:, chosen], ("gap", "force")
        labels = [f"row {k}" for k in chosen]
    with shown_style():
        from matplotlib import pyplot as plt

        below = None
        if ax is None:
            _, (ax, below) = plt.subplots(2, 1, sharex=True, figsize=(6.4, 4.4))
        ax.plot(history.t, gap, label=labels)
        ax.axhline(0.0, color="0.6", linewidth=0.8)
        ax.set_ylabel(names[0])
        (ax if below is None else below).set_xlabel("time $t$")
        ax.set_title(history.name if title is None else title)
        if len(labels) > 1:
            ax.legend()
        if below is not None:
            below.set_ylabel(names[1])
            for own in force.T:  # the mean over the step that ends at t
                below.step(history.t, np.concatenate([own[1:2], own[1:]]), where="pre")
    return ax
