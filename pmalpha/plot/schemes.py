"""Properties of schemes over the step: spectral radius, period elongation, damping ratio."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.spectra import period_and_damping, spectral_radius
from ..problem.schemes import Scheme
from .styling import LINES, shown_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["scheme_damping", "scheme_period", "scheme_radius"]

Schemes = Scheme | Sequence[Scheme] | Mapping[str, Scheme]
# h / T up to which a radius is drawn, and up to which period and damping are
RADIUS, ACCURACY = (1e-2, 1e3), 0.4


def scheme_radius(schemes: Schemes, xi: float = 0.0) -> Figure:
    """Plot the spectral radius of schemes over the step per period, h / T.

    Parameters
    ----------
    schemes : scheme, list of schemes, or dict of schemes by label
        Such as `GeneralizedAlpha`, at most 16. Labels do not begin with an underscore.
    xi : float, default 0
        Viscous damping ratio of the oscillator, in [0, 1).

    Returns
    -------
    matplotlib.figure.Figure
        Above 1 a scheme is unstable; the value for large h / T is the spectral radius at infinity.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    TypeError, ValueError
        For other objects than schemes, more than 16 of them or none, xi outside [0, 1).

    Examples
    --------
    >>> from pmalpha import plot
    >>> figure = plot.scheme_radius([GeneralizedAlpha(0.5), GeneralizedAlpha(0.8)])
    >>> [round(float(line.get_ydata()[-1]), 2) for line in figure.axes[0].lines]
    [0.5, 0.8]
    """
    steps = np.geomspace(*RADIUS, 400)

    def radius(scheme: Scheme) -> np.ndarray:
        return np.array([spectral_radius(scheme.amplification(x, xi)) for x in 2.0 * np.pi * steps])

    figure = _drawn(schemes, xi, steps, radius, "spectral radius")
    ax = figure.axes[0]
    ax.set_xscale("log")
    ax.set_xlim(*RADIUS)
    ax.set_ylim(0.0, 1.2)  # beyond the limit of a conditionally stable scheme it grows quickly
    return figure


def scheme_period(schemes: Schemes, xi: float = 0.0) -> Figure:
    """Plot the period elongation of schemes over the step per period, h / T.

    See `pmalpha.analysis.period_and_damping`. Errors as of `scheme_radius`.

    Parameters
    ----------
    schemes : scheme, list of schemes, or dict of schemes by label
        As for `scheme_radius`.
    xi : float, default 0
        Viscous damping ratio of the oscillator, in [0, 1).

    Returns
    -------
    matplotlib.figure.Figure
        Up to h / T = 0.4.

    Examples
    --------
    >>> from pmalpha import plot
    >>> plot.scheme_period({"trapezoidal": Newmark()}).axes[0].get_ylabel()
    'period elongation'
    """
    return _accuracy(schemes, xi, 0, "period elongation")


def scheme_damping(schemes: Schemes, xi: float = 0.0) -> Figure:
    """Plot the algorithmic damping ratio of schemes over the step per period, h / T.

    See `pmalpha.analysis.period_and_damping`. Errors as of `scheme_radius`.

    Parameters
    ----------
    schemes : scheme, list of schemes, or dict of schemes by label
        As for `scheme_radius`.
    xi : float, default 0
        Viscous damping ratio of the oscillator, in [0, 1).

    Returns
    -------
    matplotlib.figure.Figure
        Up to h / T = 0.4.

    Examples
    --------
    >>> from pmalpha import plot
    >>> plot.scheme_damping(GeneralizedAlpha(0.5)).axes[0].get_ylabel()
    'algorithmic damping ratio'
    """
    return _accuracy(schemes, xi, 1, "algorithmic damping ratio")


def _accuracy(schemes: Schemes, xi: float, which: int, label: str) -> Figure:
    """One result of `period_and_damping`."""
    steps = np.linspace(1e-3, ACCURACY, 200)

    def values(scheme: Scheme) -> np.ndarray:
        return period_and_damping(scheme, 2.0 * np.pi * steps, xi)[which]

    return _drawn(schemes, xi, steps, values, label)


def _drawn(
    schemes: Schemes, xi: float, x: np.ndarray, of: Callable[[Scheme], np.ndarray], label: str
) -> Figure:
    """One curve for each scheme."""
    labelled = _labelled(schemes)
    period_and_damping(next(iter(labelled.values())), [1.0], xi)  # checks xi
    with shown_style():
        from .shown import shown_figure

        figure = shown_figure(figsize=(5.0, 3.6), layout="constrained")
        ax = figure.subplots()
        for i, (name, scheme) in enumerate(labelled.items()):
            marker = ("", "o", "s", "^")[i // len(LINES)]
            look = LINES[::-1][i % len(LINES)] | {"marker": marker, "markersize": 3.5}
            ax.plot(x, of(scheme), **look, markevery=0.1, label=name.replace("$", r"\$"))
        ax.set_xlabel("step per period $h/T$")
        ax.set_ylabel(label)
        ax.set_xlim(0.0, x[-1])
        figure.legend(loc="outside upper left", ncols=2)  # beside the curves it hides one
    return figure


def _labelled(schemes: Schemes) -> dict[str, Scheme]:
    if isinstance(schemes, Scheme):
        schemes = [schemes]
    try:
        labelled = schemes if isinstance(schemes, Mapping) else {repr(s): s for s in schemes}
    except TypeError:  # also of what has __iter__ and then refuses, as an array of no dimension
        raise TypeError(f"schemes must be pmalpha schemes, got {schemes!r}") from None
    for scheme in labelled.values():
        if not isinstance(scheme, Scheme):
            raise TypeError(f"schemes must be pmalpha schemes, got {scheme!r}")
    if not 0 < len(labelled) <= 4 * len(LINES):
        raise ValueError(f"schemes must be 1 to {4 * len(LINES)}, got {len(labelled)}")
    hidden = [name for name in labelled if not str(name) or str(name).startswith("_")]
    if hidden:  # matplotlib's legends omit them
        raise ValueError(
            f"schemes must have names that do not begin with an underscore, got {hidden[0]!r}"
        )
    return {str(name): scheme for name, scheme in labelled.items()}
