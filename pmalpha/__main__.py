"""python -m pmalpha: the four-dof experiment of the paper, PM and PM-alpha (figure 7)."""

import argparse
import sys
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from . import __version__
from .models import FourDof, four_dof
from .plot.styling import LINES, save, style
from .results.history import History

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Runs: TypeAlias = dict[str, History]

SUBSTEPS = 20
STEP = 100  # macro step of the printed amplitudes: two and a half periods of the first mode


def main(arguments: list[str] | None = None) -> int:
    """Run the experiment, print the results and draw figure 7.

    Returns exit code: 0, or 1 if the figure could not be drawn.
    """
    options = _options(arguments)
    model = four_dof(0.5, substeps=SUBSTEPS)
    runs = {"PM": _run(four_dof(None, substeps=SUBSTEPS), options.steps)}
    runs["PM-alpha"] = _run(model, options.steps)
    steps = options.steps
    lines = [*_heading(model, steps), "", *_modes(model, runs), "", *_drift(runs)]
    print("\n".join(lines))
    try:
        _draw(model, runs, options.output)
    except (ImportError, OSError, ValueError) as error:
        print(f"pmalpha: {options.output} not drawn: {error}", file=sys.stderr)
        return 1
    print(f"\nFigure 7: {options.output}")
    return 0


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m pmalpha", description=__doc__)
    parser.add_argument("--version", action="version", version=f"pmalpha {__version__}")
    parser.add_argument(
        "--output",
        default="figure7.png",
        metavar="FILE",
        help="file of figure 7; its suffix gives the format (default: %(default)s)",
    )
    parser.add_argument(
        "--steps",
        type=_positive,
        default=100,
        metavar="N",
        help="number of macro steps, 40 per period of the first mode (default: %(default)s)",
    )
    return parser.parse_args(arguments)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, got {text!r}")
    return int(text)


def _run(model: FourDof, steps: int) -> History:
    return model.coupler(model.macro_step, coupling="pm").run(steps=steps)


def _heading(model: FourDof, steps: int) -> list[str]:
    return [
        "The four-dof system of the paper, in free vibration from u = (0, 0, 0, 1) m.",
        "Masses and springs are a surrogate with the published spectrum.",
        f"dt = {model.macro_step:.4f} s (dt f1 = 1/40), {SUBSTEPS} substeps in B, "
        f"{steps} macro steps.",
    ]


def _modes(model: FourDof, runs: Runs) -> Iterator[str]:
    frequencies = "".join(f"{f:>7.2f} Hz" for f in model.frequencies)
    yield f"{'modal amplitude (m kg^1/2)':<34}{frequencies}"
    amplitudes = {name: model.modal_amplitudes(history) for name, history in runs.items()}
    yield _row("start", amplitudes["PM"][1][0])
    for name, (t, x) in amplitudes.items():
        step = min(STEP, len(t) - 1)
        yield _row(f"{name} at step {step}, t = {t[step]:.2f} s", x[step])


def _row(label: str, values: np.ndarray) -> str:
    return f"{label:<34}" + "".join(f"{x:>10.3f}" for x in values)


def _drift(runs: Runs) -> Iterator[str]:
    yield f"{'':<12}{'displacement drift (m)':>24}"
    for name, history in runs.items():
        yield f"{name:<12}{np.abs(history.displacement_jump).max():>24.3f}"


def _draw(model: FourDof, runs: Runs, path: str) -> None:
    titles = {
        "PM": "PM: trapezoidal rule and central difference",
        "PM-alpha": r"PM-$\alpha$: $\rho_\infty = \rho_b = 0.5$",
    }
    histories = {titles[name]: history for name, history in runs.items()}
    save(figure7(model, histories), path)


def figure7(model: FourDof, histories: Mapping[str, History]) -> "Figure":
    """Figure 7 of the paper: free vibration of the four-dof system, and its modal amplitudes.

    Displacements (left) and amplitudes of the modes of the uncut system (right), both at the macro
    time levels.

    model: from `pmalpha.models.four_dof`, with the initial values of the histories.
    histories: history by title of its row, from top to bottom.
    Returns a row for each history.
    """
    with style():
        from matplotlib.figure import Figure

        rows = len(histories)
        figure = Figure(figsize=(7.1, 0.6 + 2.1 * rows), layout="constrained")
        axes = figure.subplots(
            rows, 2, sharex=True, sharey="col", squeeze=False, width_ratios=(1.5, 1.0)
        )
        for (left, right), (title, history) in zip(axes, histories.items(), strict=True):
            _displacements(left, *model.displacements(history))
            _modal_amplitudes(right, *model.modal_amplitudes(history), model.frequencies)
            left.set_title(title, loc="left")
        for ax in axes[0]:
            ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.08), ncols=2)
        for ax in axes[-1]:
            ax.set_xlabel("time $t$ (s)")
    return figure


def _displacements(ax: "Axes", t: np.ndarray, u: np.ndarray) -> None:
    for i, line in enumerate(LINES):  # u_1, the smallest, above the others
        ax.plot(t, u[:, i], **line, zorder=3.0 - 0.1 * i, label=f"$u_{i + 1}$")
    ax.set_ylabel("displacement (m)")
    ax.set_xlim(t[0], t[-1])


def _modal_amplitudes(
    ax: "Axes", t: np.ndarray, amplitudes: np.ndarray, frequencies: np.ndarray
) -> None:
    for i, line in enumerate(LINES):
        ax.plot(t, amplitudes[:, i], **line, label=f"{frequencies[i]:.2f} Hz")
    ax.set_ylabel("modal amplitude (m kg$^{1/2}$)")


if __name__ == "__main__":
    sys.exit(main())
