"""Figure of a History: time histories of dofs, jumps and multipliers.

A `History` draws itself by this module, which therefore does not import it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..problem.dofs import dof_list
from ..results.quantities import OF_INTERFACE, OF_SUBDOMAIN, Quantity, by_index, in_units, times_of
from ..results.times import columns_of
from .styling import LINES, require_axes, shown_figure, shown_style, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

UNITS = {"length": "u", "time": "t", "force": "F"}
ENERGY = Quantity("subdomains", "a sum over the subdomains", "F u", "macro", label="energy")
MOTION = {name: x for name, x in OF_SUBDOMAIN.items() if x.label}
# The panels of constraints, jumps first.
INTERFACE = {
    name: x
    for name, x in sorted(OF_INTERFACE.items(), key=lambda item: not item[1].jump_of)
    if x.label
}
# A jump below ROUNDING times the largest value of the recorded dofs is a sentence below the panels
# instead of a panel: it is the rounding error of the interface problem, 1e-16 times the condition
# of H. An error of the constraints that matters to a result is larger.
ROUNDING = 1e-12
# Number of curves by default: that of the line styles. Markers allow a multiple of it.
DEFAULT_CURVES = len(LINES)
MARKERS = ("", "o", "s", "^")
MOST_CURVES = DEFAULT_CURVES * len(MARKERS)
# A curve with more than 2 BINS points is drawn as its envelope, two points per bin: finer than the
# resolution of print.
BINS = 2000
# A curve with more half waves is drawn as a thin solid line: dashes would not be visible.
HALF_WAVES = 150
# By default a curve is omitted if it differs from one already chosen by less than this fraction of
# the largest range, at about this number of samples.
DIFFERENT = 0.02
SAMPLES = 256
# Curves of the energies, in this order; those that are zero to rounding are left out.
ENERGIES = {
    "kinetic": "kinetic",
    "strain": "strain",
    "dissipated": "dissipated",
    "external": "work of loads",
    "interface": "work of constraints",
    "contact": "work of contact",
    "balance": "added by the steps",
}
LEGEND_WIDTH = 105  # characters in a line of the legend
LONGEST = 40  # characters of a name
HEIGHTS = (2.4, 1.15)  # of the panel of the dofs and of each panel below, in inches


class Curve(NamedTuple):
    """One recorded column with its label."""

    label: str
    t: np.ndarray
    x: np.ndarray


def time_histories(
    history: Any,
    dofs: Any = None,
    *,
    constraints: Any = None,
    quantity: str = "u",
    title: str | None = None,
    units: Mapping[str, str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    unit = _units(units)
    require_axes(ax)
    if not isinstance(quantity, str) or quantity not in MOTION:
        raise ValueError(f"quantity must be 'u', 'v' or 'a', got {quantity!r}")
    curves = list(_curves(history, dofs, quantity))
    if ax is not None:
        return _drawn_into(ax, curves, MOTION[quantity], unit, title)
    rows = _rows(history, constraints)
    notes = _rounding_notes(history) if rows else {}
    drawn = [x for x in INTERFACE if x not in notes and getattr(history, x) is not None]
    interface = drawn if rows else []
    chosen = history.substeps is not None and bool(np.any(history.substeps != history.substeps[0]))
    heights = [HEIGHTS[0]] * bool(curves) + [HEIGHTS[1]] * len(interface)
    heights += [HEIGHTS[1]] * (chosen and bool(heights))
    heights += [HEIGHTS[1]] * bool(history.energy)
    if not heights:
        raise ValueError("the history has neither recorded dofs, constraints nor energies to draw")
    with shown_style():
        figure = shown_figure(figsize=(7.1, 0.8 + sum(heights)), layout="constrained")
        panels = figure.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)
        axes = list(panels[:, 0])
        first: Axes = axes[0]
        axes[-1].set_xlabel(_time_label(unit))
        if history.macro_times[-1] > history.macro_times[0]:
            axes[-1].set_xlim(history.macro_times[0], history.macro_times[-1])
        if title is not None:
            figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize=10)
        if notes:
            words = "\n".join(notes.values())
            figure.supxlabel(words, x=0.01, horizontalalignment="left", fontsize=8.5)
        if history.energy:
            _draw_energy(axes.pop(), history, unit)
        if chosen:
            _draw_substeps(axes.pop(), history)
        if curves:
            _draw(axes[0], curves)
            _label_axis(axes[0], MOTION[quantity], unit)
            _legend(axes.pop(0))
        if rows:
            _draw_interface(axes, history, rows, unit, interface)
        figure.align_ylabels()
    return first


def energies(history: Any, *, title: str | None = None, ax: Axes | None = None) -> Axes:
    require_axes(ax)
    if not history.energy:
        raise ValueError(f"the history has no energies to draw: {history.energy.call} records them")
    with shown_style() if ax is None else style():
        if ax is None:
            ax = shown_figure(figsize=(7.1, 3.4), layout="constrained").subplots()
        ax.set_xlabel(_time_label({}))
        _draw_energy(ax, history, {})
        if title is not None:
            ax.figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize=10)
    return ax


def _drawn_into(
    ax: Axes,
    curves: Sequence[Curve],
    quantity: Quantity,
    unit: Mapping[str, str],
    title: str | None,
) -> Axes:
    """The panel of the dofs, in axes that are given."""
    if not curves:
        raise ValueError("the history has no recorded dofs to draw")
    with style():
        _draw(ax, curves, len(ax.lines))
        ax.set_xlabel(_time_label(unit))
        _label_axis(ax, quantity, unit)
        ax.legend()
        if title is not None:
            ax.set_title(title, loc="left")
    return ax


def _time_label(unit: Mapping[str, str]) -> str:
    return f"time $t$ ({unit['t']})" if "t" in unit else "time $t$"


def _units(units: Mapping[str, str] | None) -> dict[str, str]:
    """The units of u, t and F that are given."""
    words = {} if units is None else units
    if not isinstance(words, Mapping) or not all(isinstance(x, str) for x in words.values()):
        raise TypeError(f"units must be a dict of strings, got {units!r}")
    if set(words) - set(UNITS):
        raise ValueError(f"units must be those of 'length', 'time' and 'force', got {units!r}")
    return {UNITS[name]: unit for name, unit in words.items()}


def _rounding_notes(history: Any) -> dict[str, str]:
    """A sentence on each jump that is a rounding error of the recorded motion, by its name."""
    notes = {}
    for name, quantity in INTERFACE.items():
        if not quantity.jump_of:
            continue
        motions = [getattr(s, quantity.jump_of) for s in history.subdomains if s is not None]
        largest = max((_largest_size(x) for x in motions), default=0.0)
        jump = _largest_size(getattr(history, name))
        words = quantity.label.replace("\n", " ").capitalize()
        if jump == 0.0:
            notes[name] = f"{words}: zero."
        elif jump <= ROUNDING * largest:
            motion = MOTION[quantity.jump_of].label
            size = f"{_power_of_ten(jump / largest)} of the largest {motion}"
            notes[name] = f"{words}: rounding errors, at most {size}."
    return notes


def _largest_size(x: np.ndarray) -> float:
    """The largest absolute value, without a copy of an array that may be in a file."""
    return max(float(x.max(initial=0.0)), -float(x.min(initial=0.0)))


def _power_of_ten(x: float) -> str:
    """A number with one digit, not smaller than x."""
    exponent = int(np.floor(np.log10(x)))
    digit = int(np.ceil(x / 10.0**exponent))
    if digit == 10:
        digit, exponent = 1, exponent + 1
    return rf"${digit} \times 10^{{{exponent}}}$"


# ---- choice of curves -----------------------------------------------------------------------


def _curves(history: Any, dofs: Any, quantity: str) -> Iterator[Curve]:
    if dofs is None:
        chosen = _largest(history, quantity)
    else:
        chosen = [(s, _columns(s, numbers)) for s, numbers in _given_dofs(history, dofs)]
        count = sum(len(columns) for _, columns in chosen)
        if not 0 < count <= MOST_CURVES:
            raise ValueError(f"dofs must name 1 to {MOST_CURVES} dofs in all, got {count}")
    for s, columns in chosen:
        for j in columns:
            # a legend omits labels that begin with an underscore
            dof = f"dof {s.dofs[j]}" if s.dof_names is None else s.dof_names[j]
            label = f"{dof} of {_shortened(s.name)}".replace("$", r"\$")
            yield Curve(label, s.t, getattr(s, quantity)[:, j])


def _shortened(name: str) -> str:
    name = " ".join(name.split())
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}\N{HORIZONTAL ELLIPSIS}"


def _largest(history: Any, quantity: str) -> list[tuple[Any, list[int]]]:
    """The columns of largest range, an equal number of each subdomain."""
    motions = {
        i: getattr(s, quantity)
        for i, s in enumerate(history.subdomains)
        if s is not None and s.dofs.size
    }
    ranges = {i: np.ptp(x, axis=0) for i, x in motions.items()}
    largest = sorted(motions, key=lambda i: -ranges[i].max())[:DEFAULT_CURVES]
    count = DEFAULT_CURVES // len(largest) if largest else 0
    return [(history[i], _distinct(motions[i], ranges[i], count)) for i in sorted(largest)]


def _distinct(x: np.ndarray, ranges: np.ndarray, count: int) -> list[int]:
    """At most `count` different columns of large range."""
    sample = x[:: max(1, len(x) // SAMPLES)]
    score, chosen = ranges, [int(np.argmax(ranges))]
    while len(chosen) < count:
        score = np.minimum(score, np.ptp(sample - sample[:, chosen[-1:]], axis=0))
        best = int(np.argmax(score))
        if not score[best] > DIFFERENT * ranges[chosen[0]]:
            break
        chosen.append(best)
    return sorted(chosen)


def _given_dofs(history: Any, dofs: Any) -> Iterator[tuple[Any, Any]]:
    """Recorded subdomains with the dofs given for each."""
    if not isinstance(dofs, Mapping) and len(history) == 1:
        dofs = {0: dofs}
    for i, numbers in by_index(dofs, history.keys, "dofs").items():
        subdomain = history.subdomains[i]
        if subdomain is None:
            raise ValueError(f"dofs: subdomain {history.keys[i][0]!r} was not recorded")
        yield subdomain, numbers


def _columns(subdomain: Any, selection: Any) -> list[int]:
    """The columns of the given dofs, of all dofs for None."""
    if selection is None:
        return list(range(subdomain.dofs.size))
    return columns_of(
        selection, subdomain.dofs, subdomain.n, subdomain.dof_names, f"dofs of {subdomain.name!r}"
    )


def _rows(history: Any, constraints: Any) -> list[int]:
    p = history.multipliers.shape[1]
    if p == 0 and constraints is None:
        return []
    if constraints is None:
        return _distinct(history.multipliers, np.ptp(history.multipliers, axis=0), DEFAULT_CURVES)
    if p == 0:
        raise ValueError(f"the history has no constraints to draw, got constraints={constraints!r}")
    rows = [int(row) for row in dof_list(constraints, p, "constraints")]
    if len(rows) > MOST_CURVES:
        raise ValueError(f"constraints must be at most {MOST_CURVES} numbers, got {len(rows)}")
    return rows


# ---- drawing --------------------------------------------------------------------------------


def _draw_interface(
    axes: Sequence[Axes],
    history: Any,
    rows: list[int],
    unit: Mapping[str, str],
    interface: Sequence[str],
) -> None:
    for ax, name in zip(axes, interface, strict=True):
        t, x = times_of(history, name), getattr(history, name)
        if len(rows) < x.shape[1]:
            _band(ax, t, x)
        _draw(ax, [Curve(f"constraint {row}", t, x[:, row]) for row in rows])
        _label_axis(ax, INTERFACE[name], unit)
    if history.multipliers.shape[1] > 1:
        _legend(axes[0])


def _draw_substeps(ax: Axes, history: Any) -> None:
    """Substeps of the macro steps, each at the end of one; labels beside the ends of the curves."""
    for i, (name, _) in enumerate(history.keys[:DEFAULT_CURVES]):
        look = _look(i) | {"marker": "", "drawstyle": "steps-pre"}
        ax.plot(history.macro_times, history.substeps[:, i], label=_shortened(name), **look)
    ax.set_yscale("log", base=2)
    powers = 2 ** np.arange(int(np.log2(history.substeps.max())) + 2)
    ax.set_yticks(powers[:: 1 + powers.size // 6], minor=False)
    ax.minorticks_off()
    ax.yaxis.set_major_formatter("{x:g}")
    ax.set_ylabel("substeps")
    ax.legend(loc="upper right", ncols=DEFAULT_CURVES)


def _draw_energy(ax: Axes, history: Any, unit: Mapping[str, str]) -> None:
    """Energies, and works since the beginning, each summed over the subdomains."""
    sums = {name: x.sum(axis=1) for name, x in history.energy.arrays().items() if name in ENERGIES}
    largest = max(map(_largest_size, sums.values()))
    shown = [
        Curve(label, history.energy.t, sums[name])
        for name, label in ENERGIES.items()
        if name in sums and _largest_size(sums[name]) > ROUNDING * largest
    ]
    _draw(ax, shown)
    _label_axis(ax, ENERGY, unit)
    if shown:
        _legend(ax)


def _draw(ax: Axes, curves: Sequence[Curve], first: int = 0) -> None:
    """Curves with the looks from number `first` on."""
    for i, (label, t, x) in enumerate(curves, start=first):
        shown = _envelope(x)
        look = _look(i)
        if t.size == 1:
            look["marker"] = "o"
        if np.abs(np.diff(x[shown])).sum() > HALF_WAVES * np.ptp(x):
            look |= {"linestyle": "-", "linewidth": 0.5}
        every = max(1, shown.size // 12)
        ax.plot(t[shown], x[shown], **look, markevery=every, label=label)


def _look(i: int) -> dict[str, Any]:
    line, marker = i % DEFAULT_CURVES, MARKERS[i // DEFAULT_CURVES % len(MARKERS)]
    return LINES[::-1][line] | {"marker": marker, "markersize": 3.5}


def _band(ax: Axes, t: np.ndarray, x: np.ndarray) -> None:
    """Fill the range of all columns."""
    low, high = x.min(axis=1), x.max(axis=1)
    shown = np.union1d(_envelope(low), _envelope(high))
    label = f"all {x.shape[1]} constraints"
    ax.fill_between(t[shown], low[shown], high[shown], color="0.88", linewidth=0.0, label=label)


def _envelope(x: np.ndarray) -> np.ndarray:
    """Indices of the points to draw: all of a short curve, else the extremes of each bin."""
    if x.size <= 2 * BINS:
        return np.arange(x.size)
    width = -(-x.size // BINS)
    bins = np.pad(x, (0, -x.size % width), mode="edge").reshape(-1, width)
    first = np.arange(0, x.size, width)
    extremes = np.concatenate([first + bins.argmin(axis=1), first + bins.argmax(axis=1)])
    return np.unique(np.minimum(np.append(extremes, [0, x.size - 1]), x.size - 1))


def _label_axis(ax: Axes, quantity: Quantity, units: Mapping[str, str]) -> None:
    """Label the axis, with the power of ten of its numbers if they are large or small."""
    unit = in_units(quantity, units)
    largest = np.abs(ax.dataLim.intervaly).max()
    exponent = int(np.floor(np.log10(largest))) if largest > 0.0 else 0
    if not -3 <= exponent <= 3:
        ax.ticklabel_format(axis="y", scilimits=(exponent, exponent), useOffset=False)
        ax.yaxis.get_offset_text().set_visible(False)
        power = f"$10^{{{exponent}}}$"
        unit = power if unit is None else f"{power} {unit}"
    ax.set_ylabel(quantity.label if unit is None else f"{quantity.label} ({unit})")


def _legend(ax: Axes) -> None:
    """A legend above the panel, with the styles of curves that have few half waves."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], **_look(i), label=x.get_label()) for i, x in enumerate(ax.lines)]
    shown = [*ax.collections, *lines]
    longest = max(len(str(handle.get_label())) for handle in shown)
    columns = int(np.clip(LEGEND_WIDTH // (longest + 9), 1, 5))
    position: dict[str, Any] = {
        "loc": "lower left",
        "bbox_to_anchor": (-0.01, 1.0),
        "borderaxespad": 0.2,
    }
    ax.legend(handles=shown, ncols=columns, **position)


def gaps_and_forces(
    history: Any, rows: Any = None, *, title: str | None = None, ax: Axes | None = None
) -> Axes:
    require_axes(ax)
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
            for series in force.T:  # the mean over the step that ends at t
                below.step(history.t, np.concatenate([series[1:2], series[1:]]), where="pre")
    return ax
