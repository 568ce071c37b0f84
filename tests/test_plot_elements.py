"""Pictures of meshes of triangles, tetrahedra, wedges and elements of second order."""

import numpy as np
import pytest

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection, PolyCollection, TriMesh  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: E402

from pmalpha import plot  # noqa: E402
from pmalpha.meshes.mesh import KINDS  # noqa: E402

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def of(ax, kind):
    return [artist for artist in ax.collections if type(artist) is kind]


def polygons(collection):
    return [path.vertices[:-1] for path in collection.get_paths()]  # the last closes it


def undeformed(ax):
    drawn = ax.lines[0].get_xydata().reshape(-1, 3, 2)[:, :2]
    return {frozenset(map(tuple, ends)) for ends in drawn.tolist()}


def area(x):
    x, y = np.asarray(x).T
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


def test_triangles_are_drawn_where_they_have_moved_to():
    u = np.array([[0.0, 0.0], [0.0, 0.0], [0.1, 0.0], [0.1, 0.0]])
    given = plot.deformed(SQUARE, TRIANGLES, u, scale=2)
    named = plot.deformed(SQUARE, {"triangle": TRIANGLES}, u, scale=2)
    for ax in (given, named):
        (fill,) = of(ax, PolyCollection)
        np.testing.assert_array_equal(polygons(fill), (SQUARE + 2.0 * u)[TRIANGLES])
        (borders,) = of(ax, LineCollection)
        assert len(borders.get_segments()) == len(undeformed(ax)) == 5  # the diagonal once


def test_edges_meet_at_their_nodes_and_not_at_the_nearest_pixels():
    # matplotlib moves a straight line along an axis to whole pixels, each line by itself
    ax = plot.deformed(SQUARE, TRIANGLES, np.zeros((4, 2)), scale=1)
    for kind in (PolyCollection, LineCollection):
        assert [drawn.get_snap() for drawn in of(ax, kind)] == [False]


@pytest.mark.parametrize("kind, corners", [("triangle6", 3), ("quad8", 4), ("quad9", 4)])
def test_faces_of_second_order_bend_with_the_nodes_on_their_edges(kind, corners):
    x = SQUARE[:corners]
    middles = 0.5 * (x + np.roll(x, -1, axis=0))
    points = np.concatenate([x, middles, x.mean(axis=0, keepdims=True)])[: KINDS[kind].nodes]
    u = np.zeros_like(points)
    u[corners] = [0.0, -0.1]  # the middle of the lower edge
    ax = plot.deformed(points, {kind: [list(range(len(points)))]}, u, scale=1)
    ((drawn,),) = map(polygons, of(ax, PolyCollection))
    expected = np.empty((2 * corners, 2))
    expected[::2], expected[1::2] = x, middles + u[corners : 2 * corners]
    np.testing.assert_array_equal(drawn, expected)
    assert len(undeformed(ax)) == 2 * corners


@pytest.mark.parametrize("kind", ["triangle", "triangle6", "quad", "quad8", "quad9"])
def test_colours_of_a_surface_cover_it_and_use_all_nodes(kind):
    corners = len(KINDS[kind].edges)
    x = SQUARE[:corners]
    points = np.concatenate([x, 0.5 * (x + np.roll(x, -1, axis=0)), [x.mean(axis=0)]])
    points = points[: KINDS[kind].nodes]
    values = np.arange(float(len(points)))
    ax = plot.deformed(
        points, {kind: [list(range(len(points)))]}, np.zeros_like(points), values=values
    )
    (fill,) = of(ax, TriMesh)
    np.testing.assert_array_equal(fill.get_array(), values)
    triangles = fill._triangulation.triangles
    assert sum(area(points[nodes]) for nodes in triangles) == pytest.approx(area(x), rel=1e-15)
    assert set(triangles.ravel()) == set(range(len(points)))
    ax.figure.draw_without_rendering()


def test_triangles_and_quadrilaterals_of_one_mesh_are_one_picture():
    points = np.concatenate([SQUARE, [[2.0, 0.5]]])
    elements = {"triangle": [[1, 4, 2]], "quad": [[0, 1, 2, 3]]}
    ax = plot.deformed(points, elements, np.zeros((5, 2)))
    (fill,) = of(ax, PolyCollection)
    assert sorted(len(corners) for corners in polygons(fill)) == [3, 4]
    assert len(undeformed(ax)) == 6
    ax = plot.deformed(points, elements, np.zeros((5, 2)), values=np.arange(5.0))
    (fill,) = of(ax, TriMesh)
    assert len(fill._triangulation.triangles) == 3


def test_a_line_with_a_node_in_its_middle_is_drawn_through_it():
    points = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]])
    u = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.5]])
    ax = plot.deformed(points, {"line3": [[0, 1, 2]]}, u, scale=1)
    (beam,) = of(ax, LineCollection)
    np.testing.assert_array_equal(beam.get_segments(), [[[0, 0], [1, 0.5]], [[1, 0.5], [2, 0]]])
    ax = plot.deformed(points, {"line3": [[0, 1, 2]]}, u, scale=1, values=[0.0, 2.0, 8.0])
    (beam,) = of(ax, LineCollection)
    middles = np.mean(beam.get_segments(), axis=1)
    left = middles[:, 0] < 1.0  # 0 at x = 0, 8 at x = 1
    np.testing.assert_allclose(beam.get_array()[left], 8.0 * middles[left, 0], rtol=1e-14)


def test_lines_are_drawn_above_faces():
    elements = {"line": [[0, 2]], "quad": [[0, 1, 2, 3]]}
    ax = plot.deformed(SQUARE, elements, np.zeros((4, 2)))
    kinds = [len(artist.get_paths()[0].vertices) for artist in ax.collections]
    assert kinds[-1] == 2  # drawn last among equal heights
    fill, line = of(ax, PolyCollection)[0], ax.collections[-1]
    assert line.get_zorder() >= fill.get_zorder()


CUBE = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in SQUARE])
# A cube of five tetrahedra, of two wedges, of three pyramids with their apex in a corner
CUBES = {
    "tetra": [[0, 1, 2, 5], [0, 2, 3, 7], [0, 5, 7, 4], [2, 7, 5, 6], [0, 2, 7, 5]],
    "wedge": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]],
    "pyramid": [[4, 7, 6, 5, 0], [1, 5, 6, 2, 0], [2, 6, 7, 3, 0]],
}
OUTER = {"tetra": 12, "wedge": 8, "pyramid": 9}


@pytest.fixture
def drawn(monkeypatch):
    """The corners handed to Poly3DCollection, which does not return them afterwards."""
    handed = []
    set_verts = Poly3DCollection.set_verts

    def remembering(self, verts, closed=True):
        handed.append([np.array(corners) for corners in verts])
        set_verts(self, verts, closed)

    monkeypatch.setattr(Poly3DCollection, "set_verts", remembering)
    return handed


@pytest.mark.parametrize("kind", CUBES)
def test_the_outer_faces_of_solids_are_the_sides_of_the_cube(drawn, kind):
    ax = plot.deformed(CUBE, {kind: CUBES[kind]}, np.zeros((8, 3)))
    (faces,) = drawn
    # 5 tetrahedra: two triangles a side. Wedges: two on top, two below, four sides. Pyramids: a
    # square on the three sides away from the apex, two triangles on the three that touch it.
    assert len(faces) == OUTER[kind]
    for face in faces:
        assert any(np.all(face[:, i] == side) for i in range(3) for side in (0.0, 1.0))
        # seen from outside, the corners are around the outward normal
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        assert normal @ (face.mean(axis=0) - 0.5) > 0.0
    ax.figure.draw_without_rendering()


def with_middles(points, elements, kind):
    """Points and elements of second order: a node on each edge of the table, made here."""
    numbers, points = {}, list(points)
    rows = []
    for nodes in elements:
        row = list(nodes)
        for a, b in KINDS[kind].edges:
            ends = frozenset((nodes[a], nodes[b]))
            if ends not in numbers:
                numbers[ends] = len(points)
                points.append(0.5 * (points[nodes[a]] + points[nodes[b]]))
            row.append(numbers[ends])
        rows.append(row)
    return np.array(points), rows


@pytest.mark.parametrize(
    "kind, second", [("tetra", "tetra10"), ("wedge", "wedge15"), ("pyramid", "pyramid13")]
)
def test_solids_of_second_order_have_the_same_outer_faces_with_more_points(drawn, kind, second):
    points, elements = with_middles(CUBE, CUBES[kind], kind)
    values = points[:, 0]
    ax = plot.deformed(points, {second: elements}, np.zeros_like(points), values=values)
    (faces,) = drawn
    assert len(faces) == OUTER[kind]
    for face in faces:
        np.testing.assert_allclose(
            face[1::2], 0.5 * (face[::2] + np.roll(face[::2], -1, axis=0)), atol=0.0
        )
        assert any(np.all(face[:, i] == side) for i in range(3) for side in (0.0, 1.0))
    # the limits are those of the cube, and margins
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    assert np.all(np.abs(limits - [0.0, 1.0]) < 0.2), limits
    # the colour of a face is the mean of its corners
    (fill,) = of(ax, Poly3DCollection)
    np.testing.assert_allclose(
        fill.get_array(), [face[::2, 0].mean() for face in faces], rtol=1e-15
    )
    ax.figure.draw_without_rendering()


def test_a_hexahedron_of_20_nodes_has_six_faces_of_8(drawn):
    points, elements = with_middles(CUBE, [list(range(8))], "hexahedron")
    plot.deformed(points, {"hexahedron20": elements}, np.zeros_like(points))
    assert [len(face) for face in drawn[0]] == 6 * [8]
