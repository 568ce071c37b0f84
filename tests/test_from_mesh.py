"""Structures on meshes of files: formats, names, materials, numbering of nodes, bad input."""

import sys
import warnings

import numpy as np
import pytest
from meshes import PLANE, SOLID, box, distorted
from pairwise import in_turn

import pmalpha as pm
from pmalpha import structures
from pmalpha.meshes.mesh import KINDS, SHAPES

meshio = pytest.importorskip("meshio")

STEEL = {"E": 7.0, "nu": 0.3, "rho": 3.0}
READABLE = [kind for kind in PLANE + SOLID if kind != "wedge15"]  # of meshio 5.3


def in_space(points):
    """Planar meshes of most files have a coordinate z = 0."""
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def halves(kind, *further):
    """A mesh of meshio: left and right half, the side x = 0, and the side as a set of points."""
    points, elements = distorted(kind, 2)
    left = points[elements].mean(axis=1)[:, 0] < 0.5
    wall = np.flatnonzero(points[:, 0] < 1e-9)
    d = points.shape[1]
    number = {"left": 1, "right": 2, "wall": 3}
    cells = [(kind, elements), ("vertex", wall[:, None])]
    data = [np.where(left, 1, 2), np.full(wall.size, 3)]
    mesh = meshio.Mesh(
        in_space(points),
        cells,
        cell_data=dict.fromkeys(("gmsh:physical", "gmsh:geometrical", *further), data),
        field_data={name: np.array([x, 0 if x == 3 else d]) for name, x in number.items()},
    )
    return mesh, np.flatnonzero(left), wall


def direct(kind, **options):
    points, elements = distorted(kind, 2)
    make = structures.plate_on if points.shape[1] == 2 else structures.solid_on
    return make(points, elements, **{**STEEL, **options})


def assert_equal(a, b):
    assert a.components == b.components and list(a.elements) == list(b.elements)
    np.testing.assert_array_equal(a.points, b.points)
    for kind in a.elements:
        np.testing.assert_array_equal(a.elements[kind], b.elements[kind])
    for name in ("M", "K"):
        assert abs(getattr(a, name) - getattr(b, name)).max() == 0.0


# ---- formats --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", READABLE)
def test_a_mesh_in_memory_gives_the_structure_of_its_elements(kind):
    mesh, left, wall = halves(kind)
    for mass in ("consistent", "lumped"):
        structure = structures.from_mesh(mesh, STEEL, mass=mass)
        assert_equal(structure, direct(kind, mass=mass))
    np.testing.assert_array_equal(structure.groups["left"], left)
    assert structure.groups["right"].size == len(structure.elements[kind]) - left.size
    np.testing.assert_array_equal(structure.sets["wall"], wall)
    assert "wall" not in structure.groups


# meshio 5.3 writes wedges to VTK in an order that it does not read
@pytest.mark.parametrize(
    ("kind", "version"),
    in_turn([x for x in READABLE if x != "wedge"], "gmsh22", "vtu") + [("wedge", "gmsh22")],
)
def test_files_that_meshio_writes_are_read_with_their_groups(tmp_path, mesh_library, kind, version):
    mesh, left, wall = halves(kind, *(["half"] if version == "vtu" else []))
    path = tmp_path / ("mesh.msh" if version == "gmsh22" else "mesh.vtu")
    meshio.write(path, mesh, file_format=version)
    if version == "vtu":
        structure = structures.from_mesh(path, STEEL, names="half")
        names = "1", "3"
    else:
        structure = structures.from_mesh(str(path), STEEL)
        names = "left", "wall"
    assert_equal(structure, direct(kind))
    np.testing.assert_array_equal(structure.groups[names[0]], left)
    np.testing.assert_array_equal(structure.sets[names[1]], wall)
    assert_equal(structures.from_mesh(mesh_library.read(path), STEEL), structure)


GMSH_41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
1 7 "wall"
2 8 "soft"
2 9 "hard"
$EndPhysicalNames
$Entities
0 1 2 0
1 0 0 0 0 1 0 1 7 0
1 0 0 0 1 1 0 1 8 0
2 1 0 0 2 1 0 1 9 0
$EndEntities
$Nodes
1 7 1 7
2 1 0 7
1
2
3
4
5
6
7
0 0 0
1 0 0
2 0 0
0 1 0
1 1 0
2 1 0
5 5 0
$EndNodes
$Elements
3 4 1 4
1 1 1 1
1 4 1
2 1 3 1
2 1 2 5 4
2 2 2 2
3 2 3 5
4 3 6 5
$EndElements
"""


def test_a_file_of_gmsh_4_1_has_its_names_and_loses_points_without_elements(tmp_path, capsys):
    path = tmp_path / "mesh.msh"
    path.write_text(GMSH_41)
    soft, hard = {**STEEL, "E": 1.0}, {**STEEL, "E": 10.0}
    structure = structures.from_mesh(path, {"soft": soft, "hard": hard})
    assert capsys.readouterr().out == ""
    assert repr(structure) == "<Structure 6 points, 1 quad, 2 triangle, 12 dofs>"
    assert {name: x.tolist() for name, x in structure.groups.items()} == {
        "soft": [0],
        "hard": [1, 2],
    }
    assert structure.dofs("wall", "uy").tolist() == [1, 7]
    assert structure.labels().tolist() == ["soft", "hard", "hard"]
    points = structure.points
    assert points.tolist() == [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]
    expected = structures.plate_on(points, structure.elements, **{**STEEL, "E": [1.0, 10.0, 10.0]})
    assert_equal(structure, expected)


INPUT = """** a comment
*HEADING
Two kinds of elements
*NODE, NSET=ALL
10, 0., 0., 0.
20, 1., 0., 0.
30, 2., 0.
40, 0., 1., 0.
50, 1., 1., 0.
60, 2., 1., 0.
*Element, type=CPE4R
7, 10, 20,
50, 40
*ELEMENT, TYPE=CPS3, ELSET=Right
1, 20, 30, 60
2, 20, 60, 50
*ELEMENT, TYPE=T2D2, ELSET=tie
100, 40, 50
101, 50, 60
*ELEMENT, TYPE=SPRINGA, ELSET=springs
200, 10, 60
*ELSET, ELSET=left
7,
*ELSET, ELSET=everything
left, RIGHT
*NSET, NSET=base, GENERATE
10, 30, 10
*NSET, NSET=base
40
*NSET, NSET=of_left, ELSET=LEFT
*STEP
*STATIC
*END STEP
"""


def test_an_input_of_abaqus_has_its_sets(tmp_path):
    path = tmp_path / "job.inp"
    path.write_text(INPUT)
    material = {"everything": STEEL, "tie": {"EA": 2.0, "rhoA": 1.0}}
    with pytest.warns(UserWarning, match="job.inp: elements of type SPRINGA are left out"):
        structure = structures.from_mesh(path, material, plane="strain")
    groups = {name: x.tolist() for name, x in structure.groups.items()}
    assert groups == {"Right": [1, 2], "tie": [3, 4], "left": [0], "everything": [0, 1, 2]}
    assert structure.sets["base"].tolist() == [0, 1, 2, 3]
    assert structure.sets["of_left"].tolist() == [0, 1, 3, 4]
    assert structure.sets["ALL"].tolist() == list(range(6))
    assert repr(structure) == "<Structure 6 points, 1 quad, 2 triangle, 2 line, 12 dofs>"
    plate = structures.plate_on(
        structure.points,
        {"quad": [[0, 1, 4, 3]], "triangle": [[1, 2, 5], [1, 5, 4]]},
        **STEEL,
        plane="strain",
    )
    difference = (structure.K - plate.K).toarray()
    bar = np.zeros((12, 12))
    bar[np.ix_([6, 8, 10], [6, 8, 10])] = [[2, -2, 0], [-2, 4, -2], [0, -2, 2]]
    np.testing.assert_allclose(difference, bar, rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", [kind for kind in READABLE if kind not in ("quad9", "triangle6")])
def test_an_input_that_meshio_writes_is_read_with_sets_over_several_blocks(tmp_path, kind):
    points, elements = distorted(kind, 2)
    half = len(elements) // 2
    mesh = meshio.Mesh(
        in_space(points),
        [(kind, elements[:half]), (kind, elements[half:])],
        cell_sets={"some": [[0], [0, 1]]},
        point_sets={"base": [0, 3]},
    )
    path = tmp_path / "job.inp"
    meshio.write(path, mesh)
    # meshio 5.3 writes quads as CAX4P, triangles as R3D3, of eight nodes as S8R5
    taken_as_plane = [UserWarning] if kind in ("quad", "triangle", "quad8") else []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        structure = structures.from_mesh(path, STEEL)
    assert [x.category for x in caught] == taken_as_plane
    assert_equal(structure, direct(kind))
    assert structure.groups["some"].tolist() == [0, half, half + 1]
    assert structure.sets["base"].tolist() == [0, 3]


def test_an_included_file_is_read_in_its_place(tmp_path):
    lines = INPUT.splitlines(keepends=True)
    start = lines.index("*Element, type=CPE4R\n")
    (tmp_path / "nodes.inp").write_text("".join(lines[3:start]))
    body = "".join(lines[start:])
    (tmp_path / "job.inp").write_text("*INCLUDE, INPUT=nodes.inp\n" + body)
    with pytest.warns(UserWarning, match="SPRINGA"):
        structure = structures.from_mesh(tmp_path / "job.inp", STEEL)
    assert structure.n == 12


# ---- numbering of nodes ---------------------------------------------------------------------

# The edges with nodes in their middles, in the order of the manuals: of gmsh "Node ordering", of
# Abaqus "Node ordering and face numbering on elements" (numbers from 1).
GMSH_EDGES = {
    "triangle6": (9, "01 12 20"),
    "quad8": (16, "01 12 23 30"),
    "tetra10": (11, "01 12 20 03 23 13"),
    "hexahedron20": (17, "01 03 04 12 15 23 26 37 45 47 56 67"),
}
ABAQUS_EDGES = {
    "triangle6": ("CPS6", "12 23 31"),
    "quad8": ("CPE8R", "12 23 34 41"),
    "tetra10": ("C3D10", "12 23 31 14 24 34"),
    "wedge15": ("C3D15", "12 23 31 45 56 64 14 25 36"),
    "hexahedron20": ("C3D20R", "12 23 34 41 56 67 78 85 15 26 37 48"),
}


def sheared(kind, edges, base):
    """Nodes of a straight element: its corners, then the middles of edges in the given order."""
    shape = SHAPES[kind]
    corners = shape.nodes[: shape.corners]
    ends = [[int(x) - base for x in edge] for edge in edges.split()]
    nodes = np.concatenate([corners, corners[ends].mean(axis=1)])
    d = nodes.shape[1]
    return in_space(nodes @ (np.eye(d) + 0.3 * np.tri(d, k=-1)) + 1.0)


def assert_patch(structure, kind):
    """Mass, and the stress of a linear displacement: wrong if a node were at another's place."""
    d = structure.points.shape[1]
    volume = {"triangle6": 1 / 2, "tetra10": 1 / 6, "wedge15": 1 / 2}.get(kind, 1.0)
    motion = np.tile(np.eye(d)[0], len(structure.points))
    assert motion @ structure.M @ motion == pytest.approx(3.0 * volume, rel=1e-13)
    x = structure.points[structure.elements[kind][0]]
    middles = np.array(KINDS[kind].edges)
    first = SHAPES[kind].corners
    np.testing.assert_allclose(x[first:], x[middles].mean(axis=1), rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", GMSH_EDGES)
def test_nodes_of_second_order_are_those_of_the_manual_of_gmsh(tmp_path, kind):
    number, edges = GMSH_EDGES[kind]
    nodes = sheared(kind, edges, 0)
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(nodes))]
    lines += [f"{i + 1} {x} {y} {z}" for i, (x, y, z) in enumerate(nodes)]
    numbers = " ".join(str(i + 1) for i in range(len(nodes)))
    lines += ["$EndNodes", "$Elements", "1", f"1 {number} 2 1 1 {numbers}", "$EndElements", ""]
    path = tmp_path / "one.msh"
    path.write_text("\n".join(lines))
    structure = structures.from_mesh(path, STEEL)
    assert structure.groups["1"].tolist() == [0]  # a physical group without a name
    assert_patch(structure, kind)


@pytest.mark.parametrize("kind", ABAQUS_EDGES)
def test_nodes_of_second_order_are_those_of_the_manual_of_abaqus(tmp_path, kind):
    name, edges = ABAQUS_EDGES[kind]
    nodes = sheared(kind, edges, 1)
    lines = ["*NODE"] + [f"{i + 1}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(nodes)]
    lines += [f"*ELEMENT, TYPE={name}", "1, " + ", ".join(str(i + 1) for i in range(len(nodes)))]
    path = tmp_path / "one.inp"
    path.write_text("\n".join(lines))
    plane = "strain" if name.startswith("CPE") else "stress"
    assert_patch(structures.from_mesh(path, STEEL, plane=plane), kind)


# ---- lines ----------------------------------------------------------------------------------


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_bars_are_those_of_a_truss_at_rest(d, mass):
    points = np.random.default_rng(4).uniform(size=(5, d))
    lines = [[0, 1], [1, 2], [3, 2], [4, 0], [4, 2]]
    EA = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    structure = structures.from_mesh(
        meshio.Mesh(in_space(points), [("line", lines)]), {"EA": EA, "rhoA": 2.0 * EA}, mass=mass
    )
    truss = structures.truss(points, lines, EA=EA, rhoA=2.0 * EA, mass=mass)
    assert abs(structure.M - truss.M).max() < 1e-15 * 10.0
    assert abs(structure.K - truss.tangent()).max() < 1e-14 * abs(structure.K).max()


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_beams_are_those_of_a_frame(mass):
    points, lines = [[0.0, 0.0], [0.0, 3.0], [4.0, 3.0]], [[0, 1], [1, 2]]
    values = {"EA": 9.0, "EI": [2.0, 3.0], "rhoA": 4.0}
    mesh = meshio.Mesh(points, [("line", lines)])
    structure = structures.from_mesh(mesh, values, mass=mass)
    assert structure.components == ("ux", "uy", "rz") and structure.unused.size == 0
    assert_equal(structure, structures.beam_frame(points, lines, **values, mass=mass))
    assert structure.element_forces().shape == (12, 9)


def test_a_bar_of_three_nodes_is_exact_under_a_uniform_load():
    points = np.array([[0.0, 0.0], [3.0, 4.0], [1.5, 2.0]])
    mesh = meshio.Mesh(points, [("line3", [[0, 1, 2]])])
    bar = structures.from_mesh(mesh, {"EA": 10.0, "rhoA": 2.0})
    n = np.array([0.6, 0.8])
    load = bar.M @ np.tile(n, 3)  # rhoA along the bar
    u = np.array([0.0, 0.5 * 2.0 * 25.0 / 10.0, 2.0 * (5.0 * 2.5 - 2.5**2 / 2) / 10.0])
    residual = (bar.K @ (u[:, None] * n).ravel() - load).reshape(3, 2) @ n
    np.testing.assert_allclose(residual, [-10.0, 0.0, 0.0], rtol=0, atol=1e-13)
    lumped = structures.from_mesh(mesh, {"EA": 10.0, "rhoA": 2.0}, mass="lumped")
    np.testing.assert_allclose(
        lumped.M.diagonal(), np.repeat([10 / 6, 10 / 6, 40 / 6], 2), rtol=1e-14
    )


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_a_plate_with_bars_and_beams_is_their_sum(mass):
    points, quads = box("quad", 2)
    lines = np.array([[0, 1], [1, 2], [2, 5], [5, 8]])
    mesh = meshio.Mesh(
        in_space(points),
        [("line", lines), ("quad", quads)],
        cell_sets={"bars": [[0, 1], []], "beams": [[2, 3], []], "wall": [[], [0, 1, 2, 3]]},
    )
    bar, beam = {"EA": 2.0, "rhoA": 1.0}, {"EA": 3.0, "EI": 4.0, "rhoA": 5.0}
    material = {"bars": bar, "beams": beam, "wall": {**STEEL, "t": 0.5}}
    whole = structures.from_mesh(mesh, material, mass=mass)
    assert list(whole.elements) == ["quad", "line"]
    assert whole.groups["beams"].tolist() == [6, 7]
    n = whole.n
    plate = structures.plate_on(points, quads, **STEEL, t=0.5, mass=mass)
    frame = structures.beam_frame(points[[2, 5, 8]], [[0, 1], [1, 2]], **beam, mass=mass)
    truss = structures.truss(points[[0, 1, 2]], [[0, 1], [1, 2]], **bar, mass=mass)
    placed = [
        (plate.M, plate.K, whole.dofs(np.arange(9), ["ux", "uy"])),
        (frame.M, frame.K, whole.dofs([2, 5, 8])),
        (truss.M, truss.tangent(), whole.dofs([0, 1, 2], ["ux", "uy"])),
    ]
    M, K = np.zeros((2, n, n))
    for m, k, dofs in placed:
        M[np.ix_(dofs, dofs)] += m.toarray()
        K[np.ix_(dofs, dofs)] += k.toarray()
    np.testing.assert_allclose(whole.M.toarray(), M, rtol=0, atol=1e-15)
    np.testing.assert_allclose(whole.K.toarray(), K, rtol=0, atol=1e-13)
    assert whole.unused.tolist() == whole.dofs([0, 1, 3, 4, 6, 7], "rz").tolist()
    # stresses of the plate, lines have none
    assert whole.element_stresses().shape == (12, n)
    # cut by its groups, and put together again
    fixed = np.union1d(whole.unused, whole.dofs(whole.nodes_at(y=0.0)))
    cut = pm.cut(whole, labels=whole.labels(), fixed=fixed, scheme=pm.GeneralizedAlpha(0.8))
    assembled = cut.coupler(dt=0.1, coupling="gc").assembled()
    free = np.setdiff1d(np.arange(n), fixed)
    exact = structures.modes(whole.M, whole.K, 4, fixed=fixed)[0]
    np.testing.assert_allclose(structures.modes(assembled.M, assembled.K, 4)[0], exact, rtol=1e-9)
    assert assembled.n == free.size


# ---- materials and names --------------------------------------------------------------------


def test_numbers_of_a_group_can_be_arrays_and_a_group_can_be_left_out():
    mesh, left, _ = halves("triangle")
    E = np.arange(1.0, left.size + 1.0)
    structure = structures.from_mesh(mesh, {"left": {**STEEL, "E": E}, "right": None})
    points, elements = distorted("triangle", 2)
    some_points, own, _ = structures.submesh(points, elements[left])
    assert_equal(structure, structures.plate_on(some_points, own, **{**STEEL, "E": E}))
    assert "right" not in structure.groups and structure.groups["left"].size == left.size


def test_labels_are_those_of_the_groups():
    mesh, left, _ = halves("tetra")
    structure = structures.from_mesh(mesh, STEEL)
    labels = structure.labels()
    np.testing.assert_array_equal(np.flatnonzero(labels == "left"), left)
    with pytest.raises(ValueError, match="names must cover every element, got none for"):
        structure.labels("left")
    with pytest.raises(ValueError, match="groups without common elements, got 'left' and 'left'"):
        structure.labels("left", "left")
    with pytest.raises(ValueError, match=r"a group must be one of .*'left', 'right'.* got 'top'"):
        structure.labels("top")
    with pytest.raises(ValueError, match="a set of nodes must be one of .* got 'top'"):
        structure.dofs("top")


PLATE = meshio.Mesh(
    in_space(box("quad", 1)[0]),
    [("quad", box("quad", 1)[1]), ("line", [[0, 1]])],
    cell_sets={"a": [[0], []], "edge": [[], [0]], "none": [[], []]},
    cell_data={"number": [[1], [2]], "size": [[1.0], [2.0]]},
)
CUBE = meshio.Mesh(
    box("hexahedron", 1)[0],
    [("hexahedron", box("hexahedron", 1)[1]), ("quad", [[0, 1, 3, 2]]), ("line", [[0, 1]])],
    cell_sets={"a": [[0], [], []], "top": [[], [0], []], "edge": [[], [], [0]]},
)
TILTED = meshio.Mesh(PLATE.points + [[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0]], PLATE.cells)
BAR = {"EA": 1.0, "rhoA": 1.0}


@pytest.mark.parametrize(
    "mesh, material, options, error, message",
    [
        (
            3,
            STEEL,
            {},
            TypeError,
            "mesh must be a path or a mesh of meshlane, meshio or scikit-fem, got 3",
        ),
        ("nowhere.msh", STEEL, {}, FileNotFoundError, "mesh must be a file, got 'nowhere.msh'"),
        (PLATE, 7.0, {}, TypeError, "material must be a dict, got 7.0"),
        (PLATE, {}, {}, TypeError, "material must be a dict"),
        (PLATE, {"E": 1.0, "nu": 0.3}, {}, ValueError, "material must have E, nu, rho .* E, nu$"),
        (PLATE, {**STEEL, "G": 1.0}, {}, ValueError, "material must have .* got E, nu, rho, G"),
        (PLATE, BAR, {}, ValueError, "material must have E, nu and rho for quad"),
        (PLATE, {**STEEL, "E": -1.0}, {}, ValueError, r"material\['E'\] must be positive, got -1"),
        (PLATE, {**STEEL, "nu": 0.7}, {}, ValueError, r"nu must lie in \(-1, 0.5\], got 0.7"),
        (PLATE, {**STEEL, "nu": 0.5}, {"plane": "strain"}, ValueError, r"nu must lie in .*0.5\)"),
        (PLATE, {**STEEL, "E": [1, 2]}, {}, ValueError, r"'E'\] must be a number or of shape \(1,"),
        (PLATE, STEEL, {"plane": "flat"}, ValueError, "plane must be 'stress' or 'strain'"),
        (PLATE, STEEL, {"mass": "none"}, ValueError, "mass must be"),
        (
            PLATE,
            STEEL,
            {"names": "x"},
            ValueError,
            "names must be that of cell data .* .'number', 'si",
        ),
        (PLATE, STEEL, {"names": "size"}, ValueError, "names must be that of whole numbers"),
        (PLATE, {"b": STEEL}, {}, ValueError, "names of groups .'a', 'edge', 'none'., got 'b'"),
        (
            PLATE,
            {"edge": BAR},
            {},
            ValueError,
            "every element, got none for 'quad' 0, in groups 'a'",
        ),
        (PLATE, {"a": STEEL, "none": BAR}, {}, ValueError, "'none'. must be of bars, got a group"),
        (PLATE, {"a": None}, {}, ValueError, "material must be of at least one element"),
        (PLATE, {"a": STEEL, "edge": {**BAR, "E": 1}}, {}, ValueError, "'edge'. must have E, nu, "),
        (CUBE, {**STEEL, "t": 1.0}, {}, ValueError, "material must not have a thickness t"),
        (CUBE, {"a": STEEL, "top": STEEL}, {}, ValueError, "'top'. must be of plates or solids"),
        (CUBE, {"a": STEEL, "edge": {**BAR, "EI": 1.0}}, {}, ValueError, "'edge'. must be of bars"),
        (TILTED, STEEL, {}, ValueError, "plates in a plane z = constant .* got quad in space"),
    ],
)
def test_what_does_not_fit_is_refused(mesh, material, options, error, message):
    with pytest.raises(error, match=message):
        structures.from_mesh(mesh, material, **options)


def test_an_element_in_two_groups_with_materials_is_refused():
    mesh, left, _ = halves("quad")
    mesh.cell_sets["twice"] = [left[:1], np.empty(0, dtype=int)]
    material = {"left": STEEL, "right": STEEL, "twice": STEEL}
    with pytest.raises(ValueError, match=r"once, got 'quad' 0 both in material\['left'\] and in"):
        structures.from_mesh(mesh, material)


@pytest.mark.parametrize(
    "cells, message",
    [
        ([("pyramid", [[0, 1, 3, 2, 4]])], "mesh must have elements of line, .* got pyramid"),
        ([("hexahedron27", [list(range(8)) + 19 * [0]])], "elements of line, .*, got hexahedron27"),
        ([("vertex", [[0]])], "mesh must have elements of line, .*, got none"),
        ([("tetra", [[0, 1, 2, 3]])], "Jacobian determinant of 0 in 0 of 'tetra'"),
    ],
)
def test_elements_that_cannot_be_built_are_refused(cells, message):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1.0], *3 * [[2, 2, 2]]])
    with pytest.raises(ValueError, match=message):
        structures.from_mesh(meshio.Mesh(points, cells), STEEL)


def test_an_inverted_element_of_a_file_is_refused_by_its_number():
    points, elements = box("tetra", 2)
    elements = elements.copy()
    elements[7] = elements[7][[0, 2, 1, 3]]
    with pytest.raises(ValueError, match="determinant of -.* in 7 of 'tetra'"):
        structures.from_mesh(meshio.Mesh(points, [("tetra", elements)]), STEEL)


@pytest.mark.parametrize(
    "change, message",
    [
        (
            ("20, 1., 0., 0.", "10, 1., 0., 0."),
            "NODE: node 10 is given twice, at different places",
        ),
        (("1, 20, 30, 60", "1, 20, 30, 61"), "ELEMENT: node 61 does not exist"),
        (("1, 20, 30, 60", "1, 20, 30"), "elements of type CPS3 must have 3 nodes"),
        (("*Element, type=CPE4R", "*Element"), "ELEMENT: TYPE= is missing"),
        (("7,\n*ELSET", "8,\n*ELSET"), "ELSET: element 8 does not exist"),
        (("left, RIGHT", "left, wrong"), "ELSET: set 'wrong' does not exist"),
        (("GENERATE\n10, 30, 10", "INTERNAL\n10, 17"), "NSET: node 17 does not exist"),
        (("*STEP", "*INSTANCE, NAME=a, PART=b\n*STEP"), "INSTANCE: part 'b' does not exist"),
        (
            ("*NSET, NSET=base\n40", "*NSET, NSET=base\nall, base"),
            "set 'base' must not hold itself",
        ),
        (("20, 1., 0., 0.", "20, 1., O., 0."), "NODE: must have numbers, got 'O.'"),
    ],
)
def test_an_invalid_input_of_abaqus_is_refused_by_its_keyword(tmp_path, change, message):
    path = tmp_path / "job.inp"
    assert change[0] in INPUT
    path.write_text(INPUT.replace(*change))
    with (
        warnings.catch_warnings(),
        pytest.raises(ValueError, match=rf"job.inp, line \d+, \*{message}|{message}"),
    ):
        warnings.simplefilter("ignore")
        structures.from_mesh(path, STEEL)


def test_without_a_library_a_file_is_refused_and_an_input_of_abaqus_is_read(tmp_path, monkeypatch):
    for name in ("meshlane", "meshio"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "mesh.msh").write_text(GMSH_41)
    message = r"mesh.msh' needs meshlane or meshio: pip install 'pmalpha\[mesh\]'"
    with pytest.raises(ImportError, match=message):
        structures.from_mesh(tmp_path / "mesh.msh", STEEL)
    (tmp_path / "job.inp").write_text(INPUT)
    with pytest.warns(UserWarning, match="SPRINGA"):
        assert structures.from_mesh(tmp_path / "job.inp", STEEL).n == 12


# ---- files of a stranger -------------------------------------------------------------------------

SQUARE = "*NODE\n1,0.,0.\n2,1.,0.\n3,1.,1.\n4,0.,1.\n*ELEMENT,TYPE=CPS4,ELSET=all\n1,1,2,3,4\n"
NESTED = "".join(f"*ELSET,ELSET=s{i}\n{f's{i - 1}' if i else '1'}\n" for i in reversed(range(99)))
FLAT = "".join(f"*ELSET,ELSET=a{i}\n1\n" for i in range(60))
CHAINED = "".join(f"CORD2R,{i},{i - 1},0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n" for i in range(1, 2000))
HUGE = {
    "sets.inp": (SQUARE + NESTED, "sets must hold each other at most 50 in a row"),
    "beside others.inp": (SQUARE + FLAT + NESTED, "sets must hold each other at most 50 in a row"),
    "nodes.inp": (
        SQUARE + "*NODE\n9000000,9.,9.\n*NGEN\n1,9000000\n",
        r"must make at most 20\d\d\d\d\d nodes, elements and members of sets",
    ),
    "instances.inp": (
        f"*PART,NAME=p\n{SQUARE}*NODE\n1000001,9.,9.\n*NGEN\n1,1000001\n*END PART\n"
        + "".join(f"*INSTANCE,NAME=i{i},PART=p\n*END INSTANCE\n" for i in range(3)),
        r"line \d+, \*INSTANCE: the file must make at most",
    ),
    "systems.bdf": (
        f"BEGIN BULK\n{CHAINED}GRID,1,1999,0.,0.,0.\n",
        "its coordinate system is given in too many others",
    ),
}


LARGE = {"nodes.inp": [pytest.mark.gate]}  # three seconds


@pytest.mark.parametrize("name", [pytest.param(x, marks=LARGE.get(x, [])) for x in HUGE])
def test_a_few_lines_that_make_very_much_are_refused(tmp_path, name):
    content, message = HUGE[name]
    (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=message) as caught:
        pm.structures.from_mesh(tmp_path / name, {"E": 1.0, "nu": 0.3, "rho": 1.0})
    assert name in str(caught.value)


# ---- cells of lower dimension that are no sides -----------------------------------------------

CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
APART = np.vstack([CUBE, CUBE + [0, 0, 2]])
CUBES = ("hexahedron", np.arange(16).reshape(2, 8))
BARS = ("line", [[4, 8], [5, 9], [0, 1], [6, 7]])  # two between the cubes, two edges
WALLS = ("quad", [[4, 5, 9, 8], [0, 1, 2, 3], [4, 5, 6, 7]])  # one between them, two sides


def beside(*cells, **sets):
    return meshio.Mesh(APART, [CUBES, *cells], cell_sets=sets)


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ([BARS], r"elements line that .* have no material: left out \(2\)"),
        ([WALLS], r"elements quad that .* left out \(1\)"),
        ([WALLS, ("line", [[4, 8], [4, 5]])], r"elements quad .* \(1\)"),  # edges of the wall
        ([BARS, WALLS], r"elements quad that .* \(1\)"),  # the bars are edges of the wall
        ([("triangle", [[4, 5, 6]])], r"elements triangle .* \(1\)"),  # half a side is none
    ],
)
def test_cells_without_material_that_are_no_sides_are_warned_of_by_kind_and_number(cells, said):
    with pytest.warns(UserWarning, match=said):
        structures.from_mesh(beside(*cells), STEEL)


def test_sides_and_what_the_user_leaves_out_are_no_warning():
    sets = {"bars": [[], [0, 1]], "rest": [[0, 1], []]}
    bar = {"EA": 1.0, "rhoA": 1.0}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        structures.from_mesh(beside(("line", BARS[1][2:]), ("quad", WALLS[1][1:])), STEEL)
        structures.from_mesh(beside(BARS), STEEL, ignore=["line"])
        structures.from_mesh(beside(BARS, WALLS), STEEL, ignore=["BEAM", "SHELL"])
        used = structures.from_mesh(beside(BARS, **sets), {"rest": STEEL, "bars": bar})
    assert len(used.elements["line"]) == 2


@pytest.mark.parametrize("kind", [kind for kind in PLANE + SOLID if KINDS[kind].nodes < 9])
def test_all_sides_of_all_kinds_are_sides(kind):
    points, elements = distorted(kind, 2)
    corner = elements[0]
    lines = [[corner[i], corner[j]] for i, j in KINDS[kind].edges]
    mesh = meshio.Mesh(in_space(points), [(kind, elements), ("line", lines)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        structures.from_mesh(mesh, STEEL)
    far = [np.lexsort(points.T)[[0, -1]]]  # opposite corners
    with pytest.warns(UserWarning, match=r"elements line .* \(1\)"):
        structures.from_mesh(meshio.Mesh(mesh.points, [(kind, elements), ("line", far)]), STEEL)
