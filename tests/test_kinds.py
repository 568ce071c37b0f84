"""The table of the kinds of elements, against geometry written down here and against VTK."""

import numpy as np
import pytest

from pmalpha.meshes.mesh import (
    BY_COLUMNS,
    KINDS,
    SHAPES,
    Block,
    Mesh,
    checked_mesh,
    edges,
    lines,
    outer_faces,
)

# Corners in reference coordinates, and the corners at the ends of the edges with nodes, in the
# order of nodes of the VTK file formats.
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
CORNERS = {
    "line": [(0,), (1,)],
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "quad": SQUARE,
    "tetra": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "pyramid": [*((x, y, 0) for x, y in SQUARE), (0, 0, 1)],
    "wedge": [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (0, 1))],
    "hexahedron": [(x, y, z) for z in (0, 1) for x, y in SQUARE],
}
SECOND = {
    "line3": ("line", "01"),
    "triangle6": ("triangle", "01 12 20"),
    "quad8": ("quad", "01 12 23 30"),
    "quad9": ("quad", "01 12 23 30 0123"),
    "tetra10": ("tetra", "01 12 20 03 13 23"),
    "pyramid13": ("pyramid", "01 12 23 30 04 14 24 34"),
    "wedge15": ("wedge", "01 12 20 34 45 53 03 14 25"),
    "hexahedron20": ("hexahedron", "01 12 23 30 45 56 67 74 04 15 26 37"),
}
VOLUMES = {"tetra": 1 / 6, "pyramid": 1 / 3, "wedge": 1 / 2, "hexahedron": 1.0}
AREAS = {"triangle": 0.5, "quad": 1.0}


def first_order(name):
    return SECOND.get(name, (name, ""))[0]


def points_of(name):
    """Nodes in reference coordinates: corners, and the means of the corners of an edge."""
    corners = np.array(CORNERS[first_order(name)], dtype=float)
    groups = SECOND.get(name, ("", ""))[1].split()
    return np.array([*corners, *(corners[[int(i) for i in group]].mean(0) for group in groups)])


def of_dimension(d):
    return pytest.mark.parametrize("name", [name for name in KINDS if KINDS[name].dimension == d])


every_kind = pytest.mark.parametrize("name", [*CORNERS, *SECOND])


def test_the_kinds_are_those_of_this_file():
    assert set(SHAPES) <= set(KINDS) == {*CORNERS, *SECOND}


@every_kind
def test_dimension_and_nodes_are_those_of_the_reference_element(name):
    assert (KINDS[name].nodes, KINDS[name].dimension) == points_of(name).shape
    if name in SHAPES:
        np.testing.assert_allclose(SHAPES[name].nodes, points_of(name), rtol=0.0, atol=1e-15)


@every_kind
def test_numbers_and_names_in_files_are_those_of_meshio(name):
    pytest.importorskip("meshio")
    from meshio._vtk_common import vtk_to_meshio_type
    from meshio.xdmf.common import xdmf_idx_to_meshio_type, xdmf_to_meshio_type

    assert vtk_to_meshio_type[KINDS[name].vtk] == name
    assert xdmf_to_meshio_type[KINDS[name].xdmf[0]] == name
    assert xdmf_idx_to_meshio_type[KINDS[name].xdmf[1]] == name


def area_vector(around):
    """Of a polygon in space with these corners, by the shoelace formula."""
    return 0.5 * np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0)


@of_dimension(3)
def test_the_faces_of_a_solid_enclose_its_volume(name):
    x, volume, total = points_of(name), 0.0, 0.0
    for face, nodes in KINDS[name].faces:
        around = x[list(nodes)][list(KINDS[face].path)]
        vector = area_vector(around)
        total = total + vector
        volume += around.mean(axis=0) @ vector / 3.0  # divergence theorem, outward faces
        # the nodes of the face are those of its kind: corners, then the means of neighbours
        corners = around[:: 2 if face in SECOND else 1]
        expected = points_of(face)[: len(corners)]
        assert len(corners) == len(CORNERS[first_order(face)]) == len(expected)
        if face in SECOND:
            middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
            np.testing.assert_array_equal(around[1::2], middles)
    np.testing.assert_allclose(total, 0.0, atol=1e-15)  # sums of a few numbers of order 1
    assert volume == pytest.approx(VOLUMES[first_order(name)], rel=1e-14)


@of_dimension(2)
def test_the_triangles_of_a_surface_cover_it_once(name):
    x, kind = points_of(name), KINDS[name]
    ends = x[np.array(kind.triangles)]
    (a, b), (c, d) = (ends[:, 1] - ends[:, 0]).T, (ends[:, 2] - ends[:, 0]).T
    areas = 0.5 * (a * d - b * c)
    assert np.all(areas > 0.0)  # around as the surface, so that none covers another
    assert areas.sum() == pytest.approx(AREAS[first_order(name)], rel=1e-15)
    assert set(np.ravel(kind.triangles)) == set(range(kind.nodes))
    assert area_vector(np.pad(x[list(kind.path)], ((0, 0), (0, 1))))[2] == pytest.approx(
        AREAS[first_order(name)], rel=1e-15
    )


@every_kind
def test_vtk_has_the_same_nodes_and_the_same_faces(name):
    pytest.importorskip("vtkmodules")
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    cell, kind = vtkGenericCell(), KINDS[name]
    cell.SetCellType(kind.vtk)
    assert cell.GetNumberOfPoints() == kind.nodes
    assert cell.GetCellDimension() == kind.dimension
    for i in range(kind.nodes):
        cell.GetPointIds().SetId(i, i)
    theirs = {}
    for i in range(cell.GetNumberOfFaces()):
        face = cell.GetFace(i)
        ids = [face.GetPointId(j) for j in range(face.GetNumberOfPoints())]
        theirs[frozenset(ids)] = ids[: face.GetNumberOfEdges()]  # the corners
    assert set(theirs) == {frozenset(nodes) for _, nodes in kind.faces}
    for _, nodes in kind.faces:  # around in the same direction, from another corner
        corners = theirs[frozenset(nodes)]
        first = corners.index(nodes[0])
        assert (*corners[first:], *corners[:first]) == nodes[: len(corners)]
    if name == "pyramid13":  # its coordinates in VTK are those of a collapsed cube
        return
    own = cell.GetRepresentativeCell()
    found = [own.GetParametricCoords()[i] for i in range(3 * kind.nodes)]
    expected = np.pad(points_of(name), ((0, 0), (0, 3 - kind.dimension)))
    np.testing.assert_array_equal(np.reshape(found, (-1, 3)), expected)


# ---- faces of meshes --------------------------------------------------------------------------


def of_kind(blocks):
    return {kind: sorted(map(sorted, nodes.tolist())) for kind, nodes in blocks}


def test_a_face_between_solids_of_different_kinds_is_not_an_outer_face():
    # a cube, a wedge on its right side, a pyramid on its top, a tetrahedron beside the wedge
    points = [*CORNERS["hexahedron"], (2, 0, 0), (2, 0, 1), (0.5, 0.5, 2), (3, 1, 0)]
    elements = {
        "hexahedron": [list(range(8))],
        "wedge": [[1, 8, 2, 5, 9, 6]],
        "pyramid": [[4, 5, 6, 7, 10]],
        "tetra": [[2, 8, 9, 11]],
    }
    found = of_kind(outer_faces(checked_mesh(points, elements)))
    # the tetrahedron shares no whole face: the side of the wedge has four corners
    quads = [[0, 1, 2, 3], [0, 1, 4, 5], [2, 3, 6, 7], [0, 3, 4, 7], [1, 5, 8, 9], [2, 6, 8, 9]]
    triangles = [[1, 2, 8], [5, 6, 9], [4, 5, 10], [5, 6, 10], [6, 7, 10], [4, 7, 10]]
    triangles += [[2, 8, 9], [2, 8, 11], [2, 9, 11], [8, 9, 11]]
    assert found == {"quad": sorted(quads), "triangle": sorted(triangles)}


def test_a_face_between_orders_is_not_an_outer_face():
    """A cube with nodes on its edges on top of one without: ten outer faces in all."""
    below = np.array(CORNERS["hexahedron"], dtype=float)
    above = points_of("hexahedron20") + [0.0, 0.0, 1.0]
    points = np.concatenate([below, above[4:]])
    upper = [4, 5, 6, 7, *range(8, 24)]
    mesh = checked_mesh(points, {"hexahedron": [list(range(8))], "hexahedron20": [upper]})
    counts = {kind: len(nodes) for kind, nodes in outer_faces(mesh)}
    assert counts == {"quad": 5, "quad8": 5}


def test_edges_go_through_the_nodes_on_them_and_each_piece_is_once():
    nodes = np.array([[0, 1, 2, 4, 5, 6], [1, 3, 2, 7, 8, 5]])  # two triangles with a common edge
    found = {frozenset(ends) for ends in edges([Block("triangle6", nodes)]).tolist()}
    around = ["04", "41", "15", "52", "26", "60", "17", "73", "38", "82"]
    assert found == {frozenset(map(int, ends)) for ends in around}
    assert len(edges([Block("triangle6", nodes)])) == len(around)


def test_a_line_with_a_node_in_its_middle_is_two_pieces():
    mesh = Mesh(np.zeros((5, 2)), (Block("line3", np.array([[0, 1, 2]])),))
    assert lines(mesh).tolist() == [[0, 2], [2, 1]]
    assert outer_faces(mesh) == []


@pytest.mark.parametrize("columns, name", BY_COLUMNS.items())
def test_an_array_is_taken_as_the_kind_that_the_documents_name(columns, name):
    assert {2: "line", 3: "triangle", 4: "quad", 8: "hexahedron"}[columns] == name
    mesh = checked_mesh(np.zeros((8, 3)), [list(range(columns))])
    assert [block.kind for block in mesh.blocks] == [name]


@pytest.mark.parametrize("columns", [1, 5, 6, 9, 10, 20])
def test_an_array_of_other_kinds_needs_their_name(columns):
    with pytest.raises(ValueError, match=f"dict by kind .* have 2, 3, 4, 8 columns, got {columns}"):
        checked_mesh(np.zeros((20, 3)), [list(range(columns))])
