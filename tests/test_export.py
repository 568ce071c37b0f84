"""Files for ParaView, read back by independent readers."""

import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from pairwise import in_turn

import pmalpha as pm
from pmalpha import export, structures
from pmalpha.export import write_series

TIMES = np.array([0.0, 0.1, 0.30000000000000004])
SQUARES = (
    np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0], [1.0, 1.0], [2.0, 1.0]]),
    np.array([[0, 1, 4, 3], [1, 2, 5, 4]]),
)
CUBE = (
    np.array([[x, y, z] for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]),
    np.arange(8)[None],
)
ROD = np.array([[0.0], [1.0], [3.0]]), np.array([[0, 1], [1, 2]])
MIXED = (
    np.concatenate([CUBE[0], [[0.0, 0.0, 3.0]]]),
    {"line": [[4, 8], [8, 5]], "quad": [[4, 5, 6, 7]], "hexahedron": CUBE[1]},
)
NODES = {  # of each kind, by the name in meshio
    "line": 2,
    "line3": 3,
    "triangle": 3,
    "triangle6": 6,
    "quad": 4,
    "quad8": 8,
    "quad9": 9,
    "tetra": 4,
    "tetra10": 10,
    "pyramid": 5,
    "pyramid13": 13,
    "wedge": 6,
    "wedge15": 15,
    "hexahedron": 8,
    "hexahedron20": 20,
}
# Two elements of each kind: what is written is the numbers of the nodes, not a shape
ALL_KINDS = (
    np.random.default_rng(7).normal(size=(21, 3)),
    {kind: np.array([np.arange(k), np.arange(k) + 1]) for kind, k in NODES.items()},
)
SECOND_ORDER = ALL_KINDS[0], {"tetra10": ALL_KINDS[1]["tetra10"]}
MESHES = {
    "squares": SQUARES,
    "cube": CUBE,
    "rod": ROD,
    "mixed": MIXED,
    "all kinds": ALL_KINDS,
    "second order": SECOND_ORDER,
}


def motion(points, dofs=0, seed=0):
    """Arbitrary numbers for three times, with more dofs than coordinates at each node."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(3, len(points), points.shape[1] + dofs))


def in_space(vectors):
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], 3 - vectors.shape[-1]))], -1)


def blocks(elements):
    if isinstance(elements, dict):
        return {kind: np.array(block) for kind, block in elements.items()}
    return {{2: "line", 4: "quad", 8: "hexahedron"}[elements.shape[1]]: elements}


# ---- VTK ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MESHES)
def test_meshio_reads_the_mesh_and_the_fields_of_each_time(tmp_path, name):
    meshio = pytest.importorskip("meshio")
    points, elements = MESHES[name]
    if name == "all kinds":  # meshio 5.3 has the numbers of these kinds but not their dimension
        unknown = "pyramid13", "wedge15"
        elements = {kind: nodes for kind, nodes in elements.items() if kind not in unknown}
    u, v, a = (motion(points, seed=i) for i in range(3))
    heat = np.arange(3.0)[:, None] * np.ones(len(points))
    path = tmp_path / "run.pvd"
    write_series(path, points, elements, TIMES, u, v, a, data={"Wärme & <mehr>": heat})
    listed = list(ElementTree.parse(path).getroot().iter("DataSet"))
    assert [float(entry.get("timestep")) for entry in listed] == list(TIMES)
    for k, entry in enumerate(listed):
        mesh = meshio.read(path.parent / entry.get("file"))
        np.testing.assert_array_equal(mesh.points, in_space(points))
        # meshio 5.3 reads wedges by the older convention of VTK, (0, 1, 2) around from outside;
        # VTK itself is compared in tests/test_kinds.py
        turned = {"wedge": [0, 2, 1, 3, 5, 4]}
        assert {block.type: block.data.tolist() for block in mesh.cells} == {
            kind: block[:, turned.get(kind, slice(None))].tolist()
            for kind, block in blocks(elements).items()
        }
        for field, expected in (("displacement", u), ("velocity", v), ("acceleration", a)):
            np.testing.assert_array_equal(mesh.point_data[field], in_space(expected)[k])
        np.testing.assert_array_equal(mesh.point_data["Wärme & <mehr>"], heat[k])


def test_displacements_alone_are_enough_and_are_what_vtk_warps_by(tmp_path):
    write_series(tmp_path / "run.pvd", *SQUARES, TIMES, motion(SQUARES[0]))
    root = ElementTree.parse(tmp_path / "run" / "000000.vtu").getroot()
    (data,) = root.iter("PointData")
    assert data.get("Vectors") == "displacement"
    assert [array.get("Name") for array in data] == ["displacement"]


# ---- XDMF -----------------------------------------------------------------------------------


def read_item(path, item):
    """The numbers of a DataItem, read as it describes them."""
    kind = {("Float", "8"): "f8", ("Int", "8"): "i8"}[item.get("DataType"), item.get("Precision")]
    shape = [int(size) for size in item.get("Dimensions").split()]
    if item.get("Format") == "HDF":
        name, key = item.text.split(":")
        with pytest.importorskip("h5py").File(path.parent / name) as file:
            numbers = file[key][()]
        assert numbers.shape == tuple(shape) and numbers.dtype == kind
        return numbers
    assert item.get("Format") == "Binary"
    order = {"Little": "<", "Big": ">"}[item.get("Endian")]
    numbers = np.fromfile(
        path.parent / item.text,
        dtype=order + kind,
        count=int(np.prod(shape)),
        offset=int(item.get("Seek")),
    )
    return numbers.reshape(shape)


def read_xdmf(path):
    """Times, and for each the points, the topology as in the file, and the fields."""
    (collection,) = ElementTree.parse(path).getroot().find("Domain")
    assert collection.get("CollectionType") == "Temporal"
    for grid in collection:
        topology = grid.find("Topology")
        yield (
            float(grid.find("Time").get("Value")),
            read_item(path, grid.find("Geometry/DataItem")),
            (dict(topology.attrib), read_item(path, topology.find("DataItem"))),
            {
                (field.get("Name"), field.get("AttributeType"), field.get("Center")): read_item(
                    path, field.find("DataItem")
                )
                for field in grid.iter("Attribute")
            },
        )


@pytest.mark.parametrize(("name", "h5py"), in_turn(MESHES, True, False))
def test_xdmf_gives_the_location_of_the_numbers_of_each_time(tmp_path, monkeypatch, name, h5py):
    if not h5py:
        monkeypatch.setitem(sys.modules, "h5py", None)
    points, elements = MESHES[name]
    u, v = motion(points), motion(points, seed=1)
    heat = motion(points, seed=2)[..., 0]
    path = tmp_path / "run.xdmf"
    write_series(path, points, elements, TIMES, u, v, data={"heat": heat})
    assert (tmp_path / ("run.xdmf.h5" if h5py else "run.bin")).exists()
    read = list(read_xdmf(path))
    assert [time for time, *_ in read] == list(TIMES)
    for k, (_, places, _, fields) in enumerate(read):
        np.testing.assert_array_equal(places, in_space(points))
        assert list(fields) == [
            ("displacement", "Vector", "Node"),
            ("velocity", "Vector", "Node"),
            ("heat", "Scalar", "Node"),
        ]
        for values, expected in zip(fields.values(), (in_space(u), in_space(v), heat), strict=True):
            np.testing.assert_array_equal(values, expected[k])


@pytest.mark.parametrize("name", ["squares", "cube", "mixed"])
def test_meshio_reads_an_xdmf_file_from_any_folder(tmp_path, monkeypatch, name):
    meshio = pytest.importorskip("meshio")
    pytest.importorskip("h5py")
    points, elements = MESHES[name]
    u, a = motion(points), motion(points, seed=1)
    parts = np.arange(float(sum(map(len, blocks(elements).values()))))
    write_series(tmp_path / "run.xdmf", points, elements, TIMES, u, a=a, cells={"part": parts})
    (tmp_path / "moved").mkdir()
    for file in list(tmp_path.glob("run.*")):
        file.rename(tmp_path / "moved" / file.name)
    monkeypatch.chdir(tmp_path)
    with meshio.xdmf.TimeSeriesReader("moved/run.xdmf") as reader:
        places, cells = reader.read_points_cells()
        np.testing.assert_array_equal(places, in_space(points))
        assert {c.type: c.data.tolist() for c in cells} == {
            kind: nodes.tolist() for kind, nodes in blocks(elements).items()
        }
        for k, time in enumerate(TIMES):
            t, fields, numbers = reader.read_data(k)
            assert t == time and np.concatenate(numbers["part"]).tolist() == parts.tolist()
            np.testing.assert_array_equal(fields["displacement"], in_space(u)[k])
            np.testing.assert_array_equal(fields["acceleration"], in_space(a)[k])


@pytest.mark.parametrize("name", ["run.xdmf", "run.pvd"])
def test_a_structure_and_a_cut_are_written_with_their_motion(tmp_path, name):
    wall = structures.plate(4, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    parts = pm.cut(wall, [7, 7, 7, 7, 3, 3, 3, 3], v0=np.ones(wall.n))
    history = parts.coupler(dt=0.1, coupling="gc").run(steps=2)
    motion = parts.gather(history)
    (tmp_path / "expected").mkdir()
    all_of = motion.t, motion.u, motion.v, motion.a
    write_series(tmp_path / "expected" / name, wall.points, wall.elements, *all_of)
    write_series(tmp_path / name, wall, motion)
    expected = {
        path.relative_to(tmp_path / "expected"): path for path in files_in(tmp_path / "expected")
    }
    for path, other in expected.items():
        assert (tmp_path / path).read_bytes() == other.read_bytes()
    for given in (history, motion):
        write_series(tmp_path / name, parts, given)
        written = "".join(path.read_text() for path in files_in(tmp_path) if path.suffix != ".h5")
        assert '"part"' in written and '"substeps"' in written
    for wrong in (history, wall.elements):
        with pytest.raises(TypeError, match="a Structure must come with a motion alone"):
            write_series(tmp_path / name, wall, wrong)


def files_in(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


@pytest.mark.parametrize(
    "mesh, kind, corners",
    [
        (SQUARES, "Quadrilateral", "4"),
        (CUBE, "Hexahedron", "8"),
        (ROD, "Polyline", "2"),
        (SECOND_ORDER, "Tetrahedron_10", "10"),
    ],
)
def test_xdmf_names_the_elements_and_the_number_of_their_nodes(tmp_path, mesh, kind, corners):
    write_series(tmp_path / "run.xdmf", *mesh, TIMES, motion(mesh[0]))
    for _, _, (attributes, nodes), _ in read_xdmf(tmp_path / "run.xdmf"):
        assert attributes == {
            "TopologyType": kind,
            "NumberOfElements": "1" if mesh is CUBE else "2",
            "NodesPerElement": corners,
        }
        (written,) = blocks(mesh[1]).values()
        np.testing.assert_array_equal(nodes, written)


def test_xdmf_puts_the_kind_before_each_element_of_a_mixed_mesh(tmp_path):
    write_series(tmp_path / "run.xdmf", *MIXED, TIMES, motion(MIXED[0]))
    *_, (attributes, numbers), _ = next(read_xdmf(tmp_path / "run.xdmf"))
    assert attributes == {"TopologyType": "Mixed", "NumberOfElements": "4"}
    # 2: polyline, with its number of nodes; 5: quadrilateral; 9: hexahedron
    expected = [2, 2, 4, 8, 2, 2, 8, 5, 5, 4, 5, 6, 7, 9, *range(8)]
    np.testing.assert_array_equal(numbers, expected)


def nodes_of(cell):
    return [cell.GetPointId(j) for j in range(cell.GetNumberOfPoints())]


@pytest.mark.parametrize("name", MESHES)
def test_the_reader_of_vtk_reads_the_same(tmp_path, name):
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOXdmf2 import vtkXdmfReader

    points, elements = MESHES[name]
    u = motion(points)
    write_series(tmp_path / "run.xdmf", points, elements, TIMES, u)
    reader = vtkXdmfReader()
    reader.SetFileName(str(tmp_path / "run.xdmf"))
    reader.UpdateInformation()
    steps = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    assert list(reader.GetOutputInformation(0).Get(steps)) == list(TIMES)
    for k, time in enumerate(TIMES):
        reader.UpdateTimeStep(time)
        grid = reader.GetOutputDataObject(0)
        while not hasattr(grid, "GetCells"):
            grid = grid.GetBlock(0)
        moved = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
        np.testing.assert_array_equal(moved, in_space(u)[k])
        nodes = [nodes_of(grid.GetCell(i)) for i in range(grid.GetNumberOfCells())]
        assert nodes == [row for block in blocks(elements).values() for row in block.tolist()]


# ---- both -----------------------------------------------------------------------------------


@pytest.mark.parametrize("given", ["flat", "by node", "with rotations", "flat with rotations"])
def test_displacements_are_accepted_in_any_shape(tmp_path, given):
    points, elements = SQUARES
    u = motion(points, dofs="rotations" in given)
    write_series(
        tmp_path / "run.xdmf", points, elements, TIMES, u.reshape(3, -1) if "flat" in given else u
    )
    for k, (*_, fields) in enumerate(read_xdmf(tmp_path / "run.xdmf")):
        (values,) = fields.values()
        np.testing.assert_array_equal(values, in_space(u[..., :2])[k])


@pytest.mark.parametrize("name", ["run.xdmf", "run.pvd", "RUN.XDMF"])
def test_existing_files_are_replaced(tmp_path, name):
    points, elements = SQUARES
    for seed in (0, 1):
        write_series(str(tmp_path / name), points, elements, TIMES, motion(points, seed=seed))
    once = tmp_path / "once"
    once.mkdir()
    write_series(once / name, points, elements, TIMES, motion(points, seed=1))
    for file in once.rglob("*.*"):
        assert (tmp_path / file.relative_to(once)).read_bytes() == file.read_bytes()
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize(
    "change, error, message",
    [
        ({"path": "run.vtk"}, ValueError, r"path must end in \.xdmf or \.pvd, got 'run\.vtk'"),
        ({"path": 1.0}, TypeError, "path must be a str or a path"),
        ({"times": []}, ValueError, "times must not be empty"),
        ({"times": [0.0, 1.0, 1.0]}, ValueError, "times must rise, .* at entries 2"),
        ({"times": [0.0, 1.0, np.nan]}, ValueError, "times must be finite"),
        ({"times": [0.0, 1.0]}, ValueError, r"u must have shape \(2, 6 d\) or \(2, 6, d\)"),
        ({"u": np.zeros((3, 11))}, ValueError, r"u must have shape .* got \(3, 11\)"),
        ({"u": np.zeros((3, 6))}, ValueError, "with d >= 2 dofs at each of 6 nodes"),
        ({"u": None}, TypeError, "u must hold real numbers"),
        ({"v": np.zeros((2, 12))}, ValueError, r"v must have shape .* got \(2, 12\)"),
        ({"a": np.full((3, 12), np.inf)}, ValueError, "a must be finite"),
        (
            {"data": {"heat": np.zeros((3, 5))}},
            ValueError,
            r"data\['heat'\] must have shape \(3, 6\)",
        ),
        ({"data": {"displacement": np.zeros((3, 6))}}, ValueError, "other than displacement"),
        ({"elements": [[0, 1, 2, 3, 4]]}, ValueError, "elements must be a dict by kind .* got 5"),
        ({"elements": {"wedge6": [[0]]}}, ValueError, "elements must be of line, .* got 'wedge6'"),
        ({"most_times": 1}, ValueError, "most_times must be at least 2, got 1"),
        ({"most_times": 2.5}, TypeError, "most_times must be a whole number, got 2.5"),
        ({"points": np.zeros((6, 4))}, ValueError, "points must have 1, 2 or 3 columns"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_written(
    tmp_path, monkeypatch, change, error, message
):
    monkeypatch.chdir(tmp_path)
    points, elements = SQUARES
    arguments = {"path": "run.pvd", "points": points, "elements": elements, "times": TIMES}
    with pytest.raises(error, match=message):
        write_series(**arguments | {"u": np.zeros((3, 12))} | change)
    assert not list(tmp_path.iterdir())


def written_times(path):
    if path.suffix == ".xdmf":
        return [time for time, *_ in read_xdmf(path)]
    return [float(e.get("timestep")) for e in ElementTree.parse(path).getroot().iter("DataSet")]


@pytest.mark.parametrize(
    "count, most, numbers, suffix",
    [
        (10, 10, range(10), ".pvd"),
        (10, 9, [0, 2, 4, 6, 8, 9], ".xdmf"),
        (10, 4, [0, 3, 6, 9], ".pvd"),
        (11, 4, [0, 4, 8, 10], ".pvd"),
        (10, 2, [0, 9], ".xdmf"),
        (1, 2, [0], ".xdmf"),
    ],
)
def test_of_more_times_equal_intervals_and_the_last_are_written(
    tmp_path, count, most, numbers, suffix
):
    points, elements = SQUARES
    path, times = tmp_path / f"run{suffix}", 0.5 * np.arange(count)
    u = np.arange(count)[:, None] * np.ones(12)
    write_series(path, points, elements, times, u, most_times=most)
    assert written_times(path) == [0.5 * number for number in numbers]
    if suffix == ".xdmf":
        assert [
            fields["displacement", "Vector", "Node"][0, 0] for *_, fields in read_xdmf(path)
        ] == list(numbers)
    else:
        files = sorted(file.name for file in (tmp_path / "run").iterdir())
        assert files == [f"{number:06d}.vtu" for number in numbers]


@pytest.mark.parametrize("count", [20, 21, 42])
def test_a_long_run_is_thinned_in_files_of_their_own_and_a_warning_states_it(
    tmp_path, monkeypatch, thresholds, count
):
    """The files themselves are not needed here: the writer of one is replaced."""
    assert export.MOST_FILES == 1000
    thresholds(MOST_FILES=20)
    files = []
    monkeypatch.setattr(
        export, "_write_vtu", lambda path, mesh, fields, cells: files.append(path.name)
    )
    rod, times = ([[0.0], [1.0]], [[0, 1]]), np.arange(float(count))
    u = np.zeros((count, 2))
    if count == 20:  # and no warning, which would be an error
        write_series(tmp_path / "run.pvd", *rod, times, u)
        assert len(files) == 20
        return
    n = {21: 2, 42: 3}[count]
    kept = [*range(0, count - 1, n), count - 1]
    message = f"{len(kept)} of {count} times are written, one in {n} and the last"
    with pytest.warns(UserWarning, match=message) as caught:
        write_series(tmp_path / "run.pvd", *rod, times, u)
    assert caught[0].filename == __file__
    assert files == [f"{number:06d}.vtu" for number in kept]
    assert written_times(tmp_path / "run.pvd") == kept
    if count == 21:
        write_series(tmp_path / "run.xdmf", *rod, times, u)
        assert len(written_times(tmp_path / "run.xdmf")) == count


@pytest.mark.parametrize("ending", ["xdmf", "pvd"])
def test_a_path_that_cannot_be_written_is_named(tmp_path, ending):
    path = tmp_path / "nowhere" / f"run.{ending}"
    with pytest.raises(FileNotFoundError, match="path cannot be written.*nowhere/run"):
        write_series(path, *SQUARES, TIMES, np.zeros((3, 12)))
