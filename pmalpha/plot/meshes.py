"""Deformed meshes, in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from .._checks import positive_number, real_number, require_finite, require_moderate
from ..meshes.mesh import (
    KINDS,
    Block,
    Mesh,
    checked_mesh,
    edges,
    lines,
    nodal_values,
    nodal_vectors,
    outer_faces,
    padded,
)
from ..results.times import State, on_mesh
from .styling import require_axes, shown_figure, shown_style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize


# Fill colours of the first, second, ... mesh, with different grey values
FILLS = ("#BFD7EA", "#F3D9A4", "#8FBFA8", "#E3E3E3", "#7D9CC0")
EDGE, UNDEFORMED = "0.25", "0.6"
COLOURS = "viridis"  # of monotonic lightness, readable in grey
# A mesh with more lines is drawn with thinner lines, so that it does not appear black.
FULL_WIDTH_LINES = 1500
# The largest displacement is drawn as at most SHARE times the size of the mesh; to scale if the
# factor for that is between 1 / ABOUT and ABOUT.
SHARE, ABOUT = 0.1, 3.0
PIECES = 8  # of a coloured line
# Inches: width of a figure, its minimum and maximum height, and the space for title and labels.
WIDTH, LOWEST, HIGHEST, LABELS = 5.5, 1.7, 5.0, 0.9
FILLED = 0.97  # fraction of a figure in space that the box of all points fills
LIGHT = {"azdeg": 150, "altdeg": 50}  # from behind the viewer, from above


@dataclass
class Picture:
    """State shared by the calls that draw into the same axes."""

    scale: float
    is_new: bool = False  # the axes were created here
    meshes: int = 0
    norm: Normalize | None = None


pictures: WeakKeyDictionary[Axes, Picture] = WeakKeyDictionary()


class Look(NamedTuple):
    """Colours of faces and lines: one colour each, or by values (N,) at the nodes."""

    face: Any
    line: Any
    values: np.ndarray | None = None
    norm: Normalize | None = None


def deformed(
    points: Any,
    elements: Any,
    u: Any = None,
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

    ``deformed(points, elements, u)``, or ``deformed(structure, u)`` with a `Structure` or a `Cut`.
    For several subdomains in one figure, call it once for each, with the `ax` of the first call.
    They have one scale and one colour bar.

    Parameters
    ----------
    points : (N, dim) array_like, or Structure or Cut
        Coordinates of the nodes; dim is 1, 2 or 3. A Structure and a Cut have them with their
        elements, and u follows.
    elements : array_like of int, or dict
        Nodes of elements by the name of their kind, in the order of nodes of meshio and VTK:
        "line", "triangle", "quad", "tetra", "pyramid", "wedge", "hexahedron", and of second order
        "line3", "triangle6", "quad8", "quad9", "tetra10", "pyramid13", "wedge15", "hexahedron20".
        An array is taken as lines (m, 2), triangles (m, 3), quadrilaterals (m, 4) or hexahedra
        (m, 8). Of solids the outer faces are drawn. Edges of second order consist of two straight
        pieces.
    u : (N * d,) or (N, d) array_like, or State
        Displacements, or a motion at one time, such as ``history.at(2.0)["frame"]``, in which
        fixed dofs are at rest; d >= dim dofs per node. Dofs beyond dim, such as rotations, are not
        drawn: lines are straight.
    scale : float, optional
        Factor of the displacements, shown above the axes. Default: that of the axes; for new axes
        1, 2 or 5 times a power of ten such that the largest displacement is 5 to 10 % of the size
        of the mesh, or 1 if it is about that already.
    values : (N,) array_like or str, optional
        Values shown by colour, with a colour bar. In space each face has one colour, for the mean
        of its corners. "mises" and the other words of `Structure.stress`: stresses of a Structure
        of linear plates or solids.
    value_label : str, optional
        Label of the colour bar. Default: of stresses their name.
    limits : (low, high), optional
        Limits of the colour bar. Default: the range of all values in the axes.
    color : colour of matplotlib, optional
        Colour of the faces or lines, without `values`.
    label : str, optional
        Name of the subdomain: in the legend, or with `values` on the mesh.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into, three-dimensional for three-dimensional points. Default: those of a new
        figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        ``ax.figure`` is the figure, which `save` writes to a file.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    TypeError, ValueError
        For inconsistent shapes, or another scale than that of the axes.

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

    Stresses of a wall that is pushed:

    >>> from pmalpha import structures
    >>> wall = structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    >>> ax = plot.deformed(wall, 0.01 * np.repeat(wall.points[:, 1:], 2, axis=1), values="mises")
    """
    structure = structure_of(points)
    if structure is not None:
        u = elements if u is None else u
        points, elements = structure.points, structure.elements
    if isinstance(u, State):
        u = on_mesh(u)
    if isinstance(values, str):
        values, value_label = stresses(structure, u, values), value_label or stress_label(values)
    mesh, u = flattened(checked_mesh(points, elements), u, "u")
    if values is not None:
        values = nodal_values(values, mesh, "values")
    with shown_style():
        is_new, ax = ax is None, axes_for(mesh, ax)
        picture = picture_of(ax, [(mesh, u)], scale, is_new)
        x = moved_points(mesh, picture.scale, u)
        draw_undeformed(ax, mesh)
        look = plain(picture.meshes) if color is None else Look(color, color)
        if values is not None:
            norm = norm_of(ax, picture, limits or (values.min(), values.max()), value_label)
            look = look._replace(values=values, norm=norm)
        draw_mesh(ax, mesh, x, look)
        enclose(ax, np.concatenate([mesh.points, x]), picture)
        if label is not None:
            _label_mesh(ax, mesh, x, label, look)
        picture.meshes += 1
    return ax


def structure_of(value: Any) -> Any:
    """The Structure that is given or of which a Cut is given; None for something else."""
    structure = getattr(value, "structure", value)
    return structure if hasattr(structure, "points") and hasattr(structure, "elements") else None


def stresses(structure: Any, u: Any, what: str) -> np.ndarray:
    """Stresses (..., N) at the nodes for displacements (..., n) or (..., N, d)."""
    if structure is None or not hasattr(structure, "stress"):
        raise TypeError(f"values must be numbers unless a Structure is drawn, got {what!r}")
    u = np.asarray(u)
    by_node = u.shape[-2:] == (len(structure.points), structure.dofs_per_node)
    result: np.ndarray = structure.stress(u.reshape(*u.shape[:-2], -1) if by_node else u, what)
    return result


def stress_label(what: str) -> str:
    return "von Mises stress" if what == "mises" else f"stress {what}"


def moved_points(mesh: Mesh, scale: float, u: np.ndarray) -> np.ndarray:
    """The points where they are drawn; ValueError where the picture has no number for them."""
    with np.errstate(over="ignore"):
        x = mesh.points + scale * u
    require_finite(x, "points + scale u")
    return x


# ---- axes and scales ------------------------------------------------------------------------


def flattened(mesh: Mesh, u: Any, name: str, times: int | None = None) -> tuple[Mesh, np.ndarray]:
    """Mesh and displacements with at least two coordinates."""
    u = nodal_vectors(u, mesh, name, times=times)
    return Mesh(padded(mesh.points, 2), mesh.blocks), padded(u, 2)


def axes_for(mesh: Mesh, ax: Any | None) -> Axes:
    """New axes, or the given ones if their dimension is that of the mesh."""
    solid = mesh.points.shape[1] == 3
    require_axes(ax)
    if ax is not None:
        if (ax.name == "3d") != solid:
            needed = 'projection="3d"' if solid else "two dimensions"
            raise ValueError(f"ax must have {needed} for these points, got {ax!r}")
        result: Axes = ax
        return result
    figure = shown_figure(figsize=(WIDTH, 4.0), layout="constrained")
    ax = figure.add_subplot(projection="3d" if solid else None)
    if solid:
        ax.set_axis_off()
        _draw_directions(ax, mesh)
    else:
        ax.set(xlabel="$x$", ylabel="$y$", aspect="equal")
        ax.grid(False)
    return ax


def picture_of(
    ax: Any, moved: Sequence[tuple[Mesh, np.ndarray]], scale: float | None, is_new: bool
) -> Picture:
    """The `Picture` of these axes, created if there is none yet."""
    if scale is not None:
        scale = positive_number(scale, "scale")
        require_moderate(np.array([scale]), "scale")
    picture = pictures.get(ax)
    if picture is None:
        picture = pictures[ax] = Picture(_fitting_scale(moved) if scale is None else scale, is_new)
        ax.set_title(f"displacements \N{MULTIPLICATION SIGN} {picture.scale:g}", loc="right")
    if scale is not None and scale != picture.scale:
        raise ValueError(f"scale must be that of the axes, {picture.scale:g}, got {scale:g}")
    return picture


def _fitting_scale(moved: Sequence[tuple[Mesh, np.ndarray]]) -> float:
    points = np.concatenate([mesh.points for mesh, _ in moved])
    largest = max(np.linalg.norm(u, axis=1).max() for _, u in moved)
    size = np.ptp(points, axis=0).max()
    if not (largest > 0.0 and size > 0.0):
        return 1.0
    limit = SHARE * size / largest
    if 1.0 / ABOUT <= limit <= ABOUT:
        return 1.0
    power = 10.0 ** np.floor(np.log10(limit))
    return float(power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= limit))


def plain(number: int) -> Look:
    """The colours of a mesh; lines are darker than faces, for contrast."""
    from matplotlib.colors import to_rgb

    face = to_rgb(FILLS[number % len(FILLS)])
    return Look(face, tuple(0.55 * channel for channel in face))


def norm_of(ax: Any, picture: Picture, limits: Any, label: str) -> Normalize:
    """The colour scale of the axes, extended to these limits; a new one gets a colour bar."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    low, high = (real_number(x, "limits") for x in limits)
    if picture.norm is None:
        picture.norm = Normalize(low, high)
        bar = ScalarMappable(picture.norm, COLOURS)
        ax.figure.colorbar(bar, ax=ax, label=label, shrink=0.8)
    norm: Any = picture.norm
    norm.vmin, norm.vmax = min(low, norm.vmin), max(high, norm.vmax)
    result: Normalize = norm
    return result


def enclose(ax: Any, x: np.ndarray, picture: Picture) -> None:
    """Extend the axes to these points, and adjust the height of the figure."""
    if ax.name == "3d":
        _enclose_in_space(ax, x)
        return
    ax.update_datalim(x)
    width, height = ax.dataLim.size
    if height == 0.0:  # a line along x
        ax.update_datalim(x.mean(axis=0) + [[0.0, -0.1 * width], [0.0, 0.1 * width]])
        width, height = ax.dataLim.size
    ax.autoscale_view()
    if picture.is_new:
        space = WIDTH - LABELS - (0.0 if picture.norm is None else LABELS)
        with np.errstate(over="ignore"):  # infinite is the highest
            fitting = LABELS + space * height / width if width > 0.0 else HIGHEST
        ax.figure.set_size_inches(WIDTH, np.clip(fitting, LOWEST, HIGHEST))


def _enclose_in_space(ax: Any, x: np.ndarray) -> None:
    """Equal scales, and a zoom at which the box of all points fills the axes."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    ax.auto_scale_xyz(*x.T, had_data=True)
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    sizes = np.ptp(limits, axis=1)
    ax.set_box_aspect(sizes)
    corners = np.stack(np.meshgrid(*limits), axis=-1).reshape(-1, 3)
    flat = np.stack(proj_transform(*corners.T, ax.get_proj())[:2], axis=1)
    filled = np.ptp(ax.transLimits.transform(flat), axis=0).max()
    ax.set_box_aspect(sizes, zoom=FILLED / filled)


def _label_mesh(ax: Any, mesh: Mesh, x: np.ndarray, label: str, look: Look) -> None:
    if look.values is not None:
        patch: dict[str, Any] = {"facecolor": "w", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
        ax.text(*x.mean(axis=0), label, ha="center", va="center", bbox=patch, zorder=9)
        return
    only_lines = all(KINDS[block.kind].dimension == 1 for block in mesh.blocks)
    marker: dict[str, Any] = {
        "marker": "s",
        "markeredgecolor": EDGE,
        "markeredgewidth": 0.5,
        "linestyle": "none",
    }
    no_points = np.empty((x.shape[1], 0))
    ax.plot(*no_points, color=look.line if only_lines else look.face, label=label, **marker)
    position: dict[str, Any] = {
        "loc": "lower left",
        "bbox_to_anchor": (0.0, 1.0),
        "borderaxespad": 0.2,
    }
    ax.legend(ncols=3, handlelength=1.0, handletextpad=0.4, **position)


def _draw_directions(ax: Any, mesh: Mesh) -> None:
    """The directions of x, y and z at a corner of the mesh, instead of axes."""
    corner, sizes = mesh.points.min(axis=0), np.ptp(mesh.points, axis=0)
    corner = corner - 0.1 * sizes.max()
    for name, direction in zip("xyz", 0.15 * sizes.max() * np.eye(3)):
        ax.plot(*np.stack([corner, corner + direction], axis=1), "k-", linewidth=0.8)
        ax.text(*(corner + 1.35 * direction), f"${name}$", ha="center", va="center")


# ---- drawing --------------------------------------------------------------------------------


def draw_undeformed(ax: Any, mesh: Mesh) -> None:
    """All edges as one interrupted line, which is below the faces also in space."""
    ends = mesh.points[np.concatenate([lines(mesh), edges(outer_faces(mesh))])]
    line = np.concatenate([ends, np.full_like(ends[:, :1], np.nan)], axis=1)
    width = 0.6 * _thinner(len(ends))
    look = {"color": UNDEFORMED, "linestyle": "-", "linewidth": width}
    ax.plot(*line.reshape(-1, ends.shape[-1]).T, **look, zorder=1)


def draw_mesh(ax: Any, mesh: Mesh, x: np.ndarray, look: Look) -> list[Artist]:
    pieces, faces = lines(mesh), outer_faces(mesh)
    drawn: list[Artist] = []
    if faces:
        fill = _draw_in_space if ax.name == "3d" else _draw_in_plane
        drawn += fill(ax, x, faces, look)
    if len(pieces):
        drawn += _draw_lines(ax, x[pieces], pieces, look)
    return drawn


def _thinner(lines: int) -> float:
    result: float = min(1.0, np.sqrt(FULL_WIDTH_LINES / lines))
    return result


def _draw_lines(ax: Any, ends: Any, nodes: np.ndarray, look: Look) -> list[Artist]:
    """Lines with ends (m, 2, dim), in pieces if the colour varies along them."""
    from matplotlib.collections import LineCollection
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    kind: Any = Line3DCollection if ends.shape[-1] == 3 else LineCollection
    width = 2.0 * _thinner(len(ends))
    if look.values is None:
        drawn = kind(ends, colors=look.line, linewidths=width, zorder=2)
    else:
        along = np.arange(PIECES + 1)[:, None] / PIECES
        middle = along[:-1] + 0.5 / PIECES
        divisions = ends[:, 0] + along[..., None] * (ends[:, 1] - ends[:, 0])
        pieces = np.stack([divisions[:-1], divisions[1:]], axis=2).reshape(-1, *ends.shape[1:])
        begin, end = look.values[nodes].T
        drawn = kind(pieces, cmap=COLOURS, norm=look.norm, linewidths=width, zorder=2)
        drawn.set_array((begin + middle * (end - begin)).ravel())
    ax.add_collection(drawn)
    return [drawn]


def _draw_in_plane(ax: Any, x: Any, faces: list[Block], look: Look) -> list[Artist]:
    from matplotlib.collections import LineCollection, PolyCollection

    ends = x[edges(faces)]
    # snapped to pixels, edges that are nearly parallel to an axis would miss their nodes
    mesh = LineCollection(
        ends, colors=EDGE, linewidths=0.5 * _thinner(len(ends)), zorder=2.2, snap=False
    )
    ax.add_collection(mesh)
    if look.values is None:
        fill = PolyCollection(
            _outlines(x, faces), facecolors=look.face, edgecolors="none", zorder=2, snap=False
        )
        ax.add_collection(fill)
        return [fill, mesh]
    triangles = [nodes[:, KINDS[kind].triangles].reshape(-1, 3) for kind, nodes in faces]
    fill = ax.tripcolor(
        *x.T,
        np.concatenate(triangles),
        look.values,
        shading="gouraud",
        cmap=COLOURS,
        norm=look.norm,
        zorder=2,
    )
    return [fill, mesh]


def _outlines(x: np.ndarray, faces: list[Block]) -> list[np.ndarray]:
    """The corners of a polygon for each face, and the nodes on its edges."""
    return [outline for kind, nodes in faces for outline in x[nodes[:, KINDS[kind].path]]]


def _draw_in_space(ax: Any, x: np.ndarray, faces: list[Block], look: Look) -> list[Artist]:
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    outlines = _outlines(x, faces)
    border = {"edgecolors": EDGE, "linewidths": 0.5 * _thinner(2 * len(outlines))}
    if look.values is None:
        light = LightSource(**LIGHT)
        fill = Poly3DCollection(
            outlines, facecolors=look.face, shade=True, lightsource=light, **border
        )
    else:
        fill = Poly3DCollection(outlines, cmap=COLOURS, norm=look.norm, **border)
        fill.set_array(np.concatenate([_means(look.values, block) for block in faces]))
    # not add_collection3d, whose limits include corners that faces with fewer corners do not have
    ax.auto_scale_xyz(*x.T, had_data=ax.has_data())
    ax.add_collection(fill, autolim=False)
    return [fill]


def _means(values: np.ndarray, faces: Block) -> np.ndarray:
    corners = faces.nodes[:, : len(KINDS[faces.kind].edges)]
    means: np.ndarray = values[corners].mean(axis=1)
    return means
