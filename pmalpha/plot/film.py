"""Animations of deformed meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._checks import listing, positive_number, whole_number
from ..meshes.mesh import Mesh, checked_mesh, nodal_values
from ..results.history import History, SubdomainHistory
from ..results.times import linear, on_mesh
from .meshes import (
    EDGE,
    Look,
    Picture,
    axes_for,
    draw_mesh,
    draw_undeformed,
    enclose,
    flattened,
    moved_points,
    norm_of,
    picture_of,
    plain,
    stress_label,
    stresses,
    structure_of,
)
from .styling import shown_style

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


def animation(
    history: History | SubdomainHistory,
    meshes: Any,
    *,
    frames: int = 60,
    interval: float = 50.0,
    scale: float | None = None,
    values: Callable[[np.ndarray], Any] | str | None = None,
    value_label: str = "",
    ax: Axes | None = None,
) -> FuncAnimation:
    """Animation of deformed meshes, in a notebook or a window.

    A script shows it by ``plt.show()``, a notebook with
    ``IPython.display.HTML(animation.to_jshtml())``; ``animation.save(path)`` writes it.

    Parameters
    ----------
    history : History or SubdomainHistory
        With all dofs of these subdomains recorded. The motion of one subdomain, or of an uncut
        structure by `Cut.gather`, needs one mesh.
    meshes : dict, Structure, Cut or tuple
        By subdomain, with the keys of the history: ``(points, elements)`` as for `deformed`, or a
        `Structure`, whose fixed dofs are at rest. If the subdomain has other dofs than the mesh,
        ``(points, elements, expand)`` or ``(structure, expand)`` with a function from displacements
        (k, n) of the subdomain to those of the mesh, such as ``reduction.expand``. One of these
        without a dict for a single motion. A `Cut`, with a history of its subdomains or what it
        has gathered: the uncut structure.
    frames : int
        Number of frames, at equal intervals from the first to the last macro time level;
        displacements are interpolated between time levels.
    interval : float
        Milliseconds between frames.
    scale : float, optional
        As for `deformed`, one for all frames.
    values : callable or str, optional
        Function from displacements (N, dim) to the values shown by colour, (N,); or a stress by
        its name, as for `deformed`.
    value_label : str, optional
        Label of the colour bar. Default: of stresses their name.
    ax : matplotlib.axes.Axes, optional
        As for `deformed`.

    Returns
    -------
    matplotlib.animation.FuncAnimation
        To be kept by the caller while it is shown.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    TypeError, ValueError
        For meshes that are inconsistent with the dofs, and dofs that were not recorded.

    Examples
    --------
    >>> from pmalpha import plot
    >>> bar = Subdomain([1.0, 1.0], [[1.0, -1.0], [-1.0, 1.0]], scheme=Newmark(), v0=[0.0, 1.0])
    >>> history = Coupler([bar], dt=0.1).run(1.0)
    >>> moving = plot.animation(history, {0: ([[0.0], [1.0]], [[0, 1]])}, frames=2)
    >>> "<img" in moving.to_jshtml()
    True
    """
    if not isinstance(history, (History, SubdomainHistory)):
        raise TypeError(f"history must be a History or the motion of a mesh, got {history!r}")
    if values is not None and not callable(values) and not isinstance(values, str):
        raise TypeError(f"values must be callable or the name of a stress, got {values!r}")
    if isinstance(values, str):
        value_label = value_label or stress_label(values)
    _require_text(value_label, "value_label")
    interval = positive_number(interval, "interval")
    frames = whole_number(frames, "frames", low=1)
    t = history.t if isinstance(history, SubdomainHistory) else history.macro_times
    times = np.linspace(t[0], t[-1], frames)
    films = [
        _film(motion, mesh, key, times, values) for motion, mesh, key in _cast(history, meshes)
    ]
    with shown_style():
        from matplotlib.animation import FuncAnimation

        is_new, ax = ax is None, axes_for(films[0].mesh, ax)
        figure: Any = ax.figure
        moving = [(film.mesh, u) for film in films for u in film.u]
        picture = picture_of(ax, moving, scale, is_new)
        paint = _painter(ax, picture, films, value_label)
        for film in films:
            draw_undeformed(ax, film.mesh)
            moved = moved_points(film.mesh, picture.scale, film.u)
            enclose(ax, np.concatenate([film.mesh.points, *moved]), picture)
        ax.set_autoscale_on(False)
        time_label = ax.set_title("$t$", loc="left")
        if is_new:
            figure.draw_without_rendering()
            figure.set_layout_engine("none")  # the layout is computed once, not for each frame
        drawn: list[Artist] = []

        def show(frame: int) -> list[Artist]:
            while drawn:
                drawn.pop().remove()
            for i, (mesh, u, _) in enumerate(films):
                x = moved_points(mesh, picture.scale, u[frame])
                drawn.extend(draw_mesh(ax, mesh, x, paint(i, frame)))
            time_label.set_text(f"$t$ = {times[frame]:.4g}")
            return drawn

        return FuncAnimation(figure, show, frames=frames, interval=interval, blit=False)


def _require_text(value: Any, name: str) -> None:
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a str, got {value!r}")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name} must be text, got {value!r}") from None


class Film(NamedTuple):
    """A mesh, its displacements (frames, N, dim) and the values shown by colour (frames, N)."""

    mesh: Mesh
    u: np.ndarray
    values: np.ndarray | None


def _cast(history: Any, meshes: Any) -> Iterator[tuple[SubdomainHistory, Any, str]]:
    """Each motion with its mesh, and how messages call the mesh."""
    if hasattr(meshes, "gather"):
        motion = history if isinstance(history, SubdomainHistory) else meshes.gather(history)
        yield motion, meshes.structure, "meshes"
    elif isinstance(meshes, Mapping) and meshes and isinstance(history, History):
        for key, mesh in meshes.items():
            yield history[key], mesh, f"meshes[{key!r}]"
    elif isinstance(meshes, Mapping) or isinstance(history, History) and len(history) != 1:
        raise TypeError(
            "meshes must be a dict of meshes by subdomain for a History, one mesh for a single "
            f"motion, or a Cut, got {meshes!r}"
        )
    else:
        yield (history if isinstance(history, SubdomainHistory) else history[0]), meshes, "meshes"


def _film(s: SubdomainHistory, entry: Any, key: str, times: np.ndarray, values: Any) -> Film:
    if not np.array_equal(s.dofs, np.arange(s.dofs.size)):
        raise ValueError(f"all dofs of {s.name!r} must be recorded, got {listing(s.dofs)}")
    mesh = entry if isinstance(entry, (tuple, list)) else (entry,)
    if len(mesh) > 1 and callable(mesh[-1]):
        try:
            mesh, u = mesh[:-1], mesh[-1](linear(times, s.t, s.u))
        except ValueError as error:  # of another subdomain, say
            raise ValueError(f"{key} must have a function of u of {s.name!r}: {error}") from error
    else:
        u = linear(times, s.t, on_mesh(s))
    structure = structure_of(mesh[0])
    if len(mesh) == 1 and structure is not None:
        mesh = structure.points, structure.elements
    if len(mesh) != 2:
        raise TypeError(
            f"{key} must be a Structure or (points, elements), with or without a function, got "
            f"{entry!r}"
        )
    checked, moved = flattened(
        checked_mesh(mesh[0], mesh[1], f" of {key}"), u, f"u of {s.name!r} for {key}", len(times)
    )
    if values is None:
        return Film(checked, moved, None)
    if isinstance(values, str):
        return Film(checked, moved, stresses(structure, u, values))
    shown = [nodal_values(values(x), checked, "the result of values") for x in moved]
    return Film(checked, moved, np.array(shown))


def _painter(
    ax: Any, picture: Picture, films: Sequence[Film], value_label: str
) -> Callable[[int, int], Look]:
    """Function from the numbers of a mesh and a frame to a `Look`."""
    shown = [film.values for film in films if film.values is not None]
    if not shown:
        return lambda i, frame: plain(i)
    limits = min(x.min() for x in shown), max(x.max() for x in shown)
    norm = norm_of(ax, picture, limits, value_label)

    def look(i: int, frame: int) -> Look:
        values = films[i].values
        return Look(EDGE, EDGE, None if values is None else values[frame], norm)

    return look
