"""Pictures of deformed meshes, in the plane and in space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from .._checks import listing, positive_number, real_number, whole_number
from ..structures.mesh import (
    Mesh,
    checked_mesh,
    edges,
    nodal_values,
    nodal_vectors,
    outer_faces,
    padded,
)
from .styling import style

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

    from ..run.history import History, SubdomainHistory

# Fills of one part after another, which differ in grey as well
FILLS = ("#BFD7EA", "#F3D9A4", "#8FBFA8", "#E3E3E3", "#7D9CC0")
EDGE, UNDEFORMED = "0.25", "0.6"
COLOURS = "viridis"  # its lightness rises all the way, so that it stays readable in grey
# Lines of a mesh get thinner above this many, or they would blacken the picture.
FULL_WIDTH_LINES = 1500
# The largest displacement is drawn as this part of the mesh, or as it is where that is about so.
SHARE, ABOUT = 0.1, 3.0
PIECES = 8  # of a line that is coloured
# Inches: the width of a picture, how high it may be, and what title and labels need of that.
WIDTH, LOWEST, HIGHEST, LABELS = 5.5, 1.7, 5.0, 0.9
FILLED = 0.97  # part of a picture in space that the box of all points fills
LIGHT = {"azdeg": 150, "altdeg": 50}  # over the shoulder of who looks at a solid


@dataclass
class Picture:
    """What the calls that draw into the same axes have in common."""

    scale: float
    own: bool = False
    parts: int = 0
    norm: Normalize | None = None


pictures: WeakKeyDictionary[Axes, Picture] = WeakKeyDictionary()


class Look(NamedTuple):
    """How faces and lines are drawn: in one colour each, or by values (N,) at the nodes."""

    face: Any
    line: Any
    values: np.ndarray | None = None
    norm: Normalize | None = None


def deformed(
    points: Any,
    elements: Any,
    u: Any,
    *,
    scale: float | None = None,
    values: Any = None,
    value_label: str = "",
    limits: tuple[float, float] | None = None,
    color: Any = None,
    label: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """A deformed mesh, over the undeformed one in thin grey.

    Several subdomains come into one picture by a call for each, with the `ax` of the first. They
    have one scale and one colour bar.

    Parameters
    ----------
    points : (N, dim) array_like
        Coordinates of the nodes; dim is 1, 2 or 3.
    elements : (m, 2), (m, 4) or (m, 8) array_like of int, or dict
        Nodes of lines, quadrilaterals (around) or hexahedra (around the bottom, then around the
        top); of these the outer faces are drawn. Or several of them by name: "line", "quad",
        "hexahedron".
    u : (N * d,) or (N, d) array_like
        Displacements, d >= dim dofs at each node. Those beyond dim, such as rotations, are not
        drawn: lines are straight.
    scale : float, optional
        By which displacements are multiplied. Default: that of the picture; for a new one 1, 2 or
        5 times a power of ten that makes the largest displacement 5 to 10 % of the mesh, and 1
        where it is about that already. It is written above the picture.
    values : (N,) array_like, optional
        What the colour shows; the picture gets a colour bar. In space a face has one colour, that
        of the mean of its corners.
    value_label : str, optional
        What stands beside the colour bar.
    limits : (low, high), optional
        Of the colour bar. Default: the range of all values in the picture.
    color : colour of matplotlib, optional
        Of the faces or lines, without `values`.
    label : str, optional
        Name of the part: in the legend, or with `values` on the part itself.
    ax : matplotlib.axes.Axes, optional
        Where to draw, three-dimensional if the points are. Default: a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        ``ax.figure`` is the figure, which `save` writes to a file.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    TypeError, ValueError
        For arrays that do not fit one another, or another scale than that of the picture.

    Examples
    --------
    A square, and a mast on it:

    >>> from pmalpha import plot
    >>> square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    >>> u = [[0.0, 0.0], [0.0, 0.0], [0.01, 0.0], [0.01, 0.0]]
    >>> ax = plot.deformed(square, [[0, 1, 2, 3]], u, label="box")
    >>> mast = [[0.5, 1.0], [0.5, 2.0]]
    >>> ax = plot.deformed(mast, [[0, 1]], [[0.01, 0.0], [0.03, 0.0]], label="mast", ax=ax)
    >>> ax.get_title(loc="right")
    'displacements × 10'
    """

    mesh, u = _flattened(checked_mesh(points, elements), u, "u")
    if values is not None:
        values = nodal_values(values, mesh, "values")
    with style():
        own, ax = ax is None, _axes(mesh, ax)
        picture = _picture(ax, [(mesh, u)], scale, own)
        x = mesh.points + picture.scale * u
        _draw_undeformed(ax, mesh)
        look = _plain(picture.parts) if color is None else Look(color, color)
        if values is not None:
            norm = _norm(ax, picture, limits or (values.min(), values.max()), value_label)
            look = look._replace(values=values, norm=norm)
        _draw(ax, mesh, x, look)
        _enclose(ax, np.concatenate([mesh.points, x]), picture)
        if label is not None:
            _name_part(ax, mesh, x, label, look)
        picture.parts += 1
    return ax


def animation(
    history: History,
    meshes: Mapping[Any, Any],
    *,
    frames: int = 60,
    interval: float = 50.0,
    scale: float | None = None,
    values: Callable[[np.ndarray], Any] | None = None,
    value_label: str = "",
) -> FuncAnimation:
    """The deformed meshes of subdomains as they move, for a notebook.

    Show it with ``IPython.display.HTML(animation.to_jshtml())``.

    Parameters
    ----------
    history : History
        With all dofs of these subdomains recorded.
    meshes : dict
        By subdomain, as the history is indexed: ``(points, elements)`` as `deformed` takes them,
        or a `Structure`. Where the subdomain has other dofs than the mesh,
        ``(points, elements, expand)`` or ``(structure, expand)`` with a function that takes
        displacements (k, n) of the one to those of the other, such as ``reduction.expand``.
    frames : int
        Equally far apart from the first to the last macro node; between nodes displacements are
        interpolated.
    interval : float
        Milliseconds from frame to frame.
    scale : float, optional
        As for `deformed`, chosen for all frames.
    values : callable, optional
        Displacements (N, dim) to what the colour shows, (N,).
    value_label : str, optional
        What stands beside the colour bar.

    Returns
    -------
    matplotlib.animation.FuncAnimation

    Raises
    ------
    ImportError
        If matplotlib is missing.
    TypeError, ValueError
        For meshes that do not fit the dofs, and dofs that were not recorded.

    Examples
    --------
    >>> from pmalpha import plot
    >>> bar = Subdomain([1.0, 1.0], [[1.0, -1.0], [-1.0, 1.0]], scheme=Newmark(), v0=[0.0, 1.0])
    >>> history = Coupler([bar], dt=0.1).run(1.0)
    >>> moving = plot.animation(history, {0: ([[0.0], [1.0]], [[0, 1]])}, frames=2)
    >>> "<img" in moving.to_jshtml()
    True
    """

    frames = whole_number(frames, "frames", low=1)
    times = np.linspace(history.macro_times[0], history.macro_times[-1], frames)
    films = _films(history, meshes, times)
    with style():
        from matplotlib.animation import FuncAnimation

        ax = _axes(films[0].mesh, None)
        figure: Any = ax.figure
        picture = _picture(ax, [(film.mesh, u) for film in films for u in film.u], scale, True)
        paint = _painter(ax, picture, films, values, value_label)
        for film in films:
            _draw_undeformed(ax, film.mesh)
            moved = film.mesh.points + picture.scale * film.u
            _enclose(ax, np.concatenate([film.mesh.points, *moved]), picture)
        ax.set_autoscale_on(False)
        clock = ax.set_title("$t$", loc="left")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, not for each frame
        drawn: list[Artist] = []

        def show(frame: int) -> list[Artist]:
            while drawn:
                drawn.pop().remove()
            for i, (mesh, u) in enumerate(films):
                x = mesh.points + picture.scale * u[frame]
                drawn.extend(_draw(ax, mesh, x, paint(i, u[frame])))
            clock.set_text(f"$t$ = {times[frame]:.4g}")
            return drawn

        return FuncAnimation(figure, show, frames=frames, interval=interval, blit=False)


class Film(NamedTuple):
    """A mesh and its displacements (frames, N, dim)."""

    mesh: Mesh
    u: np.ndarray


def _films(history: History, meshes: Any, times: np.ndarray) -> list[Film]:
    if not isinstance(meshes, Mapping) or not meshes:
        raise TypeError(f"meshes must be a dict of meshes by subdomain, got {meshes!r}")
    films = []
    for key, given in meshes.items():
        part = history[key]
        if not np.array_equal(part.dofs, np.arange(part.dofs.size)):
            raise ValueError(
                f"all dofs of {part.name!r} must be recorded, got {listing(part.dofs)}"
            )
        what = given if isinstance(given, (tuple, list)) else (given,)
        u = _at(times, part)
        if len(what) > 1 and callable(what[-1]):
            what, u = what[:-1], what[-1](u)
        if len(what) == 1:
            what = what[0].points, what[0].elements
        films.append(Film(*_flattened(checked_mesh(*what), u, f"u of {part.name!r}", len(times))))
    return films


def _at(times: np.ndarray, part: SubdomainHistory) -> np.ndarray:
    """Displacements at these times, on straight lines between the nodes."""
    after = np.clip(np.searchsorted(part.t, times), min(1, part.t.size - 1), part.t.size - 1)
    before = np.maximum(after - 1, 0)
    step = np.where(after > before, part.t[after] - part.t[before], 1.0)
    share = np.clip((times - part.t[before]) / step, 0.0, 1.0)[:, None]
    return (1.0 - share) * part.u[before] + share * part.u[after]


def _painter(
    ax: Any, picture: Picture, films: Sequence[Film], values: Any, value_label: str
) -> Callable[[int, np.ndarray], Look]:
    """How to draw part i with displacements u."""
    if values is None:
        return lambda i, u: _plain(i)

    def valued(i: int, u: np.ndarray) -> np.ndarray:
        return nodal_values(values(u), films[i].mesh, "what values returns")

    extremes = [valued(i, u) for i, film in enumerate(films) for u in film.u]
    limits = min(x.min() for x in extremes), max(x.max() for x in extremes)
    norm = _norm(ax, picture, limits, value_label)
    return lambda i, u: Look(EDGE, EDGE, valued(i, u), norm)


# ---- what pictures have in common -----------------------------------------------------------


def _flattened(mesh: Mesh, u: Any, name: str, times: int | None = None) -> tuple[Mesh, np.ndarray]:
    """Mesh and displacements with two coordinates at least."""
    u = nodal_vectors(u, mesh, name, times=times)
    return Mesh(padded(mesh.points, 2), mesh.blocks), padded(u, 2)


def _axes(mesh: Mesh, ax: Any | None) -> Axes:
    """New axes, or those given if the mesh can be drawn there."""
    from matplotlib.figure import Figure

    solid = mesh.points.shape[1] == 3
    if ax is not None:
        if (ax.name == "3d") != solid:
            needed = 'projection="3d"' if solid else "two dimensions"
            raise ValueError(f"ax must have {needed} for these points, got {ax!r}")
        return ax
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    ax = figure.add_subplot(projection="3d" if solid else None)
    if solid:
        ax.set_axis_off()
        _draw_directions(ax, mesh)
    else:
        ax.set(xlabel="$x$", ylabel="$y$", aspect="equal")
        ax.grid(False)
    return ax


def _picture(
    ax: Any, moved: Sequence[tuple[Mesh, np.ndarray]], scale: float | None, own: bool
) -> Picture:
    """The picture that these axes belong to, begun if there is none yet."""
    if scale is not None:
        scale = positive_number(scale, "scale")
    picture = pictures.get(ax)
    if picture is None:
        picture = pictures[ax] = Picture(_fitting_scale(moved) if scale is None else scale, own)
        ax.set_title(f"displacements \N{MULTIPLICATION SIGN} {picture.scale:g}", loc="right")
    if scale is not None and scale != picture.scale:
        raise ValueError(f"scale must be that of the picture, {picture.scale:g}, got {scale:g}")
    return picture


def _fitting_scale(moved: Sequence[tuple[Mesh, np.ndarray]]) -> float:
    points = np.concatenate([mesh.points for mesh, _ in moved])
    largest = max(np.linalg.norm(u, axis=1).max() for _, u in moved)
    size = np.ptp(points, axis=0).max()
    if not (largest > 0.0 and size > 0.0):
        return 1.0
    wanted = SHARE * size / largest
    if 1.0 / ABOUT <= wanted <= ABOUT:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted))


def _plain(part: int) -> Look:
    """The colours of a part; lines darker than faces, since they need contrast."""
    from matplotlib.colors import to_rgb

    face = to_rgb(FILLS[part % len(FILLS)])
    return Look(face, tuple(0.55 * channel for channel in face))


def _norm(ax: Any, picture: Picture, limits: Any, label: str) -> Normalize:
    """The colours of the picture, widened to these limits; with a colour bar when they are new."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    low, high = (real_number(x, "limits") for x in limits)
    if picture.norm is None:
        picture.norm = Normalize(low, high)
        bar = ScalarMappable(picture.norm, COLOURS)
        ax.figure.colorbar(bar, ax=ax, label=label, shrink=0.8)
    norm: Any = picture.norm
    norm.vmin, norm.vmax = min(low, norm.vmin), max(high, norm.vmax)
    return norm


def _enclose(ax: Any, x: np.ndarray, picture: Picture) -> None:
    """Let the axes reach around these points, and the figure be as high as they need."""
    if ax.name == "3d":
        _enclose_in_space(ax, x)
        return
    ax.update_datalim(x)
    width, height = ax.dataLim.size
    if height == 0.0:  # a line along x
        ax.update_datalim(x.mean(axis=0) + [[0.0, -0.1 * width], [0.0, 0.1 * width]])
        width, height = ax.dataLim.size
    ax.autoscale_view()
    if picture.own:
        room = WIDTH - LABELS - (0.0 if picture.norm is None else LABELS)
        wanted = LABELS + room * height / width if width > 0.0 else HIGHEST
        ax.figure.set_size_inches(WIDTH, np.clip(wanted, LOWEST, HIGHEST))


def _enclose_in_space(ax: Any, x: np.ndarray) -> None:
    """Equal scales, and a camera as near as the box of all points allows."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    ax.auto_scale_xyz(*x.T, had_data=True)
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    sizes = np.ptp(limits, axis=1)
    ax.set_box_aspect(sizes)
    corners = np.stack(np.meshgrid(*limits), axis=-1).reshape(-1, 3)
    flat = np.stack(proj_transform(*corners.T, ax.get_proj())[:2], axis=1)
    filled = np.ptp(ax.transLimits.transform(flat), axis=0).max()
    ax.set_box_aspect(sizes, zoom=FILLED / filled)


def _name_part(ax: Any, mesh: Mesh, x: np.ndarray, label: str, look: Look) -> None:
    if look.values is not None:
        paper: dict[str, Any] = {"facecolor": "w", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
        ax.text(*x.mean(axis=0), label, ha="center", va="center", bbox=paper, zorder=9)
        return
    only_lines = all(block.shape[1] == 2 for block in mesh.blocks)
    marker: dict[str, Any] = {
        "marker": "s",
        "markeredgecolor": EDGE,
        "markeredgewidth": 0.5,
        "linestyle": "none",
    }
    nothing = np.empty((x.shape[1], 0))
    ax.plot(*nothing, color=look.line if only_lines else look.face, label=label, **marker)
    place: dict[str, Any] = {
        "loc": "lower left",
        "bbox_to_anchor": (0.0, 1.0),
        "borderaxespad": 0.2,
    }
    ax.legend(ncols=3, handlelength=1.0, handletextpad=0.4, **place)


def _draw_directions(ax: Any, mesh: Mesh) -> None:
    """Where x, y and z point, at the corner of the mesh, instead of axes."""
    corner, sizes = mesh.points.min(axis=0), np.ptp(mesh.points, axis=0)
    corner = corner - 0.1 * sizes.max()
    for name, direction in zip("xyz", 0.15 * sizes.max() * np.eye(3)):
        ax.plot(*np.stack([corner, corner + direction], axis=1), color="k", linewidth=0.8)
        ax.text(*(corner + 1.35 * direction), f"${name}$", ha="center", va="center")


# ---- drawing --------------------------------------------------------------------------------


def _draw_undeformed(ax: Any, mesh: Mesh) -> None:
    """One broken line, which also in space lies beneath the faces."""
    for block in mesh.blocks:
        lines = edges(outer_faces(block))
        ends = mesh.points[lines]
        broken = np.concatenate([ends, np.full_like(ends[:, :1], np.nan)], axis=1)
        width = 0.6 * _thinner(len(lines))
        ax.plot(*broken.reshape(-1, ends.shape[-1]).T, color=UNDEFORMED, linewidth=width, zorder=1)


def _draw(ax: Any, mesh: Mesh, x: np.ndarray, look: Look) -> list[Artist]:
    drawn = []
    for block in mesh.blocks:
        if block.shape[1] == 2:
            drawn += _draw_lines(ax, x[block], block, look)
        else:
            draw = _draw_in_space if ax.name == "3d" else _draw_in_plane
            drawn += draw(ax, x, outer_faces(block), look)
    return drawn


def _thinner(lines: int) -> float:
    return min(1.0, np.sqrt(FULL_WIDTH_LINES / lines))


def _draw_lines(ax: Any, ends: Any, block: np.ndarray, look: Look) -> list[Artist]:
    """Lines with ends (m, 2, dim), in pieces where the colour changes along them."""
    from matplotlib.collections import LineCollection
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    kind = Line3DCollection if ends.shape[-1] == 3 else LineCollection
    width = 2.0 * _thinner(len(ends))
    if look.values is None:
        lines = kind(ends, colors=look.line, linewidths=width, zorder=2)
    else:
        along = np.arange(PIECES + 1)[:, None] / PIECES
        middle = along[:-1] + 0.5 / PIECES
        nodes = ends[:, 0] + along[..., None] * (ends[:, 1] - ends[:, 0])
        pieces = np.stack([nodes[:-1], nodes[1:]], axis=2).reshape(-1, *ends.shape[1:])
        begin, end = look.values[block].T
        lines = kind(pieces, cmap=COLOURS, norm=look.norm, linewidths=width, zorder=2)
        lines.set_array((begin + middle * (end - begin)).ravel())
    ax.add_collection(lines)
    return [lines]


def _draw_in_plane(ax: Any, x: Any, faces: np.ndarray, look: Look) -> list[Artist]:
    from matplotlib.collections import LineCollection, PolyCollection

    lines = x[edges(faces)]
    mesh = LineCollection(lines, colors=EDGE, linewidths=0.5 * _thinner(len(lines)), zorder=2.2)
    ax.add_collection(mesh)
    if look.values is None:
        fill = PolyCollection(x[faces], facecolors=look.face, edgecolors="none", zorder=2)
        ax.add_collection(fill)
        return [fill, mesh]
    triangles = faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    fill = ax.tripcolor(
        *x.T, triangles, look.values, shading="gouraud", cmap=COLOURS, norm=look.norm, zorder=2
    )
    return [fill, mesh]


def _draw_in_space(ax: Any, x: np.ndarray, faces: np.ndarray, look: Look) -> list[Artist]:
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    width = 0.5 * _thinner(2 * len(faces))
    border = {"edgecolors": EDGE, "linewidths": width}
    if look.values is None:
        light = LightSource(**LIGHT)
        fill = Poly3DCollection(
            x[faces], facecolors=look.face, shade=True, lightsource=light, **border
        )
    else:
        fill = Poly3DCollection(x[faces], cmap=COLOURS, norm=look.norm, **border)
        fill.set_array(look.values[faces].mean(axis=1))
    ax.add_collection3d(fill)
    return [fill]
