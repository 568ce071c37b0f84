"""What a History shows of itself in a notebook: whether the run was the one that was meant."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from .._checks import counted
from .._tables import html_table
from .dof_motion import label_of

HEADINGS = (
    "subdomain",
    "dofs",
    "time levels",
    "substep",
    "largest |u|",
    "largest |v|",
    "largest |a|",
)
# Numbers in the motion of a subdomain that are read for its largest values.
MOST_READ = 20_000_000


def history_html(history: Any) -> str:
    """The implementation of `History._repr_html_`."""
    lines = [title(history), *energy_lines(history)]
    recorded = [s for s in history.subdomains if s is not None]
    table = html_table(HEADINGS, [row_of(s) for s in recorded], ("subdomain",))
    others = [name for (name, _), s in zip(history.keys, history.subdomains) if s is None]
    if others:
        lines.append(f"not recorded: {', '.join(others)}")
    found = "".join(f"<p>{escape(line)}</p>" for line in lines)
    warned = "".join(f"<li>{escape(text)}</li>" for text in history.warnings)
    return f"{found}{table}" + (f"<p>warnings:</p><ul>{warned}</ul>" if warned else "")


def title(history: Any) -> str:
    t, p = history.macro_times, history.multipliers.shape[1]
    coupling = "" if history.coupling is None else f", coupling = {history.coupling!r}"
    levels = counted(len(t), "macro time level")
    return f"History: t = {t[0]:g} .. {t[-1]:g}, {levels}{coupling}, {counted(p, 'constraint')}"


def energy_lines(history: Any) -> list[str]:
    if history.energy is None:
        return []
    energy = history.energy
    stored = (energy.kinetic + energy.strain).sum(axis=1)
    added = float(energy.balance.sum(axis=1)[-1])
    return [
        f"energy: largest {stored.max():.4g}, at the end {stored[-1]:.4g}; "
        f"the scheme {'added' if added > 0.0 else 'removed'} {abs(added):.2g}"
    ]


def row_of(s: Any) -> tuple[str, ...]:
    step = "changed" if s.substep is None else f"{s.substep:g}"
    step += "" if s.double_after is None else ", double"
    return (
        s.name,
        str(s.dofs.size),
        str(s.t.size),
        step,
        *(largest(s, name) for name in "uva"),
    )


def largest(s: Any, quantity: str) -> str:
    """The largest absolute value with its dof and time."""
    x = getattr(s, quantity)
    if x.size == 0 or x.size > MOST_READ:
        return "-"
    row, column = np.unravel_index(int(np.abs(x).argmax()), x.shape)
    dof = label_of(s.dofs, s.dof_names, int(column))
    dof = f"dof {dof}" if s.dof_names is None else dof
    return f"{abs(x[row, column]):.4g} ({dof}, t = {s.t[row]:g})"
