"""What the campaign with damaged and forged files has found: each is refused by name now."""

import json
import warnings
import zipfile
from pathlib import Path

import campaign_files
import numpy as np
import pytest
from refusals import refused

import pmalpha as pm
from pmalpha.run import checkpoint

STEEL = {"E": 1.0, "nu": 0.3, "rho": 1.0}


def saved(folder, name="run.npz"):
    path = folder / name
    pm.models.split_oscillator(10.0).coupler(0.05, coupling="pm").run(steps=3).save(path)
    return path


def arrays_in(path):
    with np.load(path) as file:
        return dict(file)


def test_an_array_that_claims_more_than_the_file_holds_is_refused_before_memory_is_taken(tmp_path):
    path, claim = saved(tmp_path), b"'shape': (4000000000000000,)"
    rewritten = tmp_path / "forged.npz"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(rewritten, "w") as new:
        for name in old.namelist():
            member = old.read(name)
            k = member.find(b"'shape': (4,)")
            if k >= 0:
                stop = member.index(b"\n", k)
                text = member[k:stop].replace(b"'shape': (4,)", claim).rstrip()
                assert len(text) <= stop - k
                member = member[:k] + text.ljust(stop - k) + member[stop:]
            new.writestr(name, member)
    refused(ValueError, lambda: pm.History.load(rewritten), "bytes as its header gives, it has")


@pytest.mark.parametrize("number", [0x110000, 0xFFFFFFFF, 0xD800])
def test_a_header_with_numbers_that_are_no_characters_is_refused(tmp_path, number):
    path = saved(tmp_path)
    arrays = arrays_in(path)
    names = arrays["header"].reshape(1).view(np.uint32)
    names[arrays["header"].item().index("names") + 10] = number
    np.savez(path, **arrays)
    refused(ValueError, lambda: pm.History.load(path), "is damaged")


def test_a_name_of_a_file_with_a_number_that_is_no_character_is_refused(tmp_path):
    path = tmp_path / "ranks.npz"
    campaign_files.of_ranks(path)
    header = arrays_in(path)["header"]
    header.reshape(1).view(np.uint32)[header.item().index("ranks.npz.0") + 10] = 0x110000
    np.savez(path, header=header)
    refused(ValueError, lambda: campaign_files.load(path, "pm"), "is damaged")


def test_a_header_is_read_whatever_the_order_of_its_bytes(tmp_path):
    path = saved(tmp_path)
    arrays = arrays_in(path)
    arrays["header"] = arrays["header"].astype(arrays["header"].dtype.newbyteorder(">"))
    other = tmp_path / "other.npz"
    np.savez(other, **arrays)
    first, second = pm.History.load(path), pm.History.load(other)
    assert [s.name for s in first.subdomains] == [s.name for s in second.subdomains]


def test_a_compressed_file_is_refused_since_it_may_hold_any_amount(tmp_path):
    np.savez_compressed(tmp_path / "small.npz", **arrays_in(saved(tmp_path)))
    refused(ValueError, lambda: pm.History.load(tmp_path / "small.npz"), "is compressed")


def replace_header(path, change):
    """In an HDF5 file, by what the function makes of the facts in it."""
    with pytest.importorskip("h5py").File(path, "r+") as whole:
        header = change(json.loads(whole["header"][()]))
        del whole["header"]
        whole["header"] = header


def forged_hdf5(tmp_path, change):
    h5py = pytest.importorskip("h5py")
    saved(tmp_path, "other.h5")
    path = saved(tmp_path, "run.h5")
    with h5py.File(path, "r+") as whole:
        del whole["A/u"]
        change(h5py, whole)
    return path


ELSEWHERE = {
    "a link to another file": lambda h5py, whole: whole.__setitem__(
        "A/u", h5py.ExternalLink("other.h5", "/A/u")
    ),
    "a link in the file": lambda h5py, whole: whole.__setitem__("A/u", h5py.SoftLink("/B/u")),
    "storage in another file": lambda h5py, whole: whole.create_dataset(
        "A/u", (4, 1), "f8", external=[("other.h5", 0, 32)]
    ),
}


@pytest.mark.parametrize("where", ELSEWHERE)
def test_a_history_reads_no_other_file_than_its_own(tmp_path, where):
    path = forged_hdf5(tmp_path, ELSEWHERE[where])
    refused(ValueError, lambda: pm.History.load(path), "run.h5", "A/u")


def test_an_array_that_was_never_written_is_refused_before_memory_is_taken(tmp_path):
    path = forged_hdf5(
        tmp_path, lambda h5py, whole: whole.create_dataset("A/u", (2**40,), "f4", chunks=(1024,))
    )
    refused(ValueError, lambda: pm.History.load(path), "A/u must have 4398046511104 bytes")


@pytest.mark.parametrize("files", [["../run.h5"], ["/etc/passwd"], [".."]])
def test_a_master_leads_to_histories_in_its_folder_only(tmp_path, files):
    pytest.importorskip("h5py")
    path = saved(tmp_path, "run.h5")
    replace_header(path, lambda header: np.bytes_(json.dumps(header | {"files": files})))
    refused(ValueError, lambda: pm.History.load(path), "path must lead to")


INPUT = "*NODE\n1, 0., 0.\n2, 1., 0.\n3, 1., 1.\n4, 0., 1.\n*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n"


@pytest.mark.parametrize(
    "name",
    ["no\0thing", "../more.txt", "/etc/passwd", "mesh.inp", "sub/../../more.txt", "1" * 300],
)
def test_a_mesh_includes_files_in_its_folder_only(tmp_path, name):
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "more.txt").write_text("** outside\n")
    path = folder / "mesh.inp"
    path.write_text(f"{INPUT}*INCLUDE, INPUT={name}\n")
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), "*INCLUDE")


def test_a_mesh_may_include_files_below_its_folder(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "nodes.txt").write_text(INPUT)
    path = tmp_path / "mesh.inp"
    path.write_text("*INCLUDE, INPUT=parts/nodes.txt\n")
    plate = pm.structures.from_mesh(path, STEEL)
    assert plate.n == 8


def test_a_damaged_mesh_ends_no_program(tmp_path, mesh_library):
    path = tmp_path / "mesh.vtu"
    for text, *words in (
        (
            "<VTKFile",
            f"a file that {mesh_library.__name__} reads",
            "the reader of vtu gives no reason",
        ),
        ("<a/>", f"mesh must be a file that {mesh_library.__name__} reads", "'VTKFile'"),
    ):
        path.write_text(text)
        refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), *words)


def test_a_grid_of_three_numbers_takes_no_memory_that_is_not_there(tmp_path, mesh_library):
    path = tmp_path / "mesh.vtk"
    head = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\n"
    rest = "ORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 0\n"
    path.write_text(f"{head}DIMENSIONS 3 2 1\n{rest}")
    assert campaign_files.structure(path).size > 0
    path.write_text(f"{head}DIMENSIONS 40000 40000 10000\n{rest}")
    with pytest.raises(MemoryError, match="the grid of 'mesh.vtk' needs about"):
        campaign_files.structure(path)


@pytest.mark.parametrize("kind", ["numbers elsewhere", "texts"])
def test_the_history_of_a_mesh_of_moab_is_not_read_by_another_name(tmp_path, kind):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "mesh.h5m"
    campaign_files.mesh(path)
    (tmp_path / "other").write_bytes(bytes(96))
    with h5py.File(path, "r+") as whole:
        del whole["tstt/nodes/coordinates"]
        if kind != "texts":
            del whole["tstt/history"]
            elsewhere = [(str(tmp_path / "other"), 0, 96)]
            whole.create_dataset("tstt/history", (4, 3), "f8", external=elsewhere)
        whole["tstt/nodes/coordinates"] = whole["tstt/history"]
    refused(ValueError, lambda: campaign_files.structure(path), "tstt/history")


@pytest.mark.parametrize("name", campaign_files.FOUND)
@pytest.mark.filterwarnings("ignore")  # of libraries
def test_what_the_campaign_damages_is_read_as_long_as_it_is_whole(name):
    read = campaign_files.FOUND[name][1]
    found = read(Path(campaign_files.good(name).name, name))
    assert any(np.any(x) for x in campaign_files.campaign_input.arrays_in(found))


@pytest.mark.parametrize("value", [None, "x", -1.0, 1e400])
def test_the_steps_of_a_checkpoint_are_checked(tmp_path, value):
    b = of_changed_steps(tmp_path, lambda header: header["steps"].update(dt=value))
    refused(ValueError, lambda: b.load(tmp_path / "state.npz"), "state.npz")


def of_changed_steps(folder, change):
    """Writes a checkpoint of changed steps, changes its header, and makes a coupler to load it."""
    model = pm.models.split_oscillator(10.0, substeps=2)
    a, b = (model.coupler(0.05, coupling="gc") for _ in range(2))
    a.step(2)
    a.change_steps(dt=0.02)
    a.save(folder / "state.npz")
    rewrite(folder / "state.npz", change)
    return b


def rewrite(path, change):
    """Change the header of an npz file."""
    arrays = arrays_in(path)
    header = json.loads(arrays["header"].item())
    change(header)
    arrays["header"] = np.array(json.dumps(header))
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda header: header.update(step_count=1), "step_count must be in 2.."),
        (lambda header: header.update(step_count=2**53 - 1), "step_count must be in 2.."),
        (lambda header: header["steps"].update(first=[[1.0], None]), "first must"),
        (
            lambda header: header["steps"].update(substeps=[3, 2]),
            "substeps must divide the largest",
        ),
        (lambda header: header["steps"].update(first=[None]), "first of 2 subdomains, got 1"),
    ],
)
def test_a_checkpoint_of_a_step_that_its_steps_do_not_have_changes_nothing(tmp_path, change, words):
    b = of_changed_steps(tmp_path, change)
    b.step(3)
    before = b.state("B").u
    refused(ValueError, lambda: b.load(tmp_path / "state.npz"), "state.npz", words)
    assert b.step_count == 3 and b.dt == 0.05
    np.testing.assert_array_equal(b.state("B").u, before)


@pytest.mark.parametrize(
    "facts",
    [
        {"first": [0, 2**62]},
        {"first": [0.5, 2]},
        {"first": None},
        {"files": "x"},
        {"files": [["x"]]},
        {"files": [""]},
        {"files": ["../other.npz"]},
        {"files": ["no\0thing"]},
        {"files": ["\ud800"]},
        {"files": [256 * "x"]},
        {"files": [], "first": [0]},
    ],
)
def test_a_checkpoint_of_several_processes_leads_to_files_in_its_folder_only(tmp_path, facts):
    coupler = pm.models.split_oscillator(10.0).coupler(0.05, coupling="pm")
    path = tmp_path / "whole.npz"
    checkpoint.write_master(path, ["x.npz"], [0, 2])
    (tmp_path / "x.npz").write_bytes(b"none")
    rewrite(path, lambda header: header.update(facts))
    refused(ValueError, lambda: coupler.load(path), "path must lead to", ".npz")


def test_a_history_with_arrays_that_do_not_fit_is_refused(tmp_path):
    path = saved(tmp_path)
    arrays = arrays_in(path)
    for name, wrong in {"0.u": arrays["0.u"][:-1], "0.t": arrays["0.t"].astype("M8[s]")}.items():
        np.savez(tmp_path / "wrong.npz", **(arrays | {name: wrong}))
        refused(ValueError, lambda: pm.History.load(tmp_path / "wrong.npz"), "wrong.npz", name)


def test_dofs_of_bytes_without_a_number_of_them_below_zero_are_read(tmp_path):
    path = saved(tmp_path)
    arrays = arrays_in(path)
    dofs = arrays["0.dofs"].astype(np.uint8)
    np.savez(path, **(arrays | {"0.dofs": dofs}))
    assert pm.History.load(path)[0].dofs.tolist() == dofs.tolist()


@pytest.mark.parametrize("steps", [True, [0.1, None], [[0.1], None], [None]])
def test_a_run_does_not_continue_a_file_with_other_steps_than_pairs(tmp_path, steps):
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    coupler = pm.models.split_oscillator(10.0).coupler(0.05, coupling="pm")
    coupler.run(steps=3, record_to=path)
    replace_header(path, lambda header: np.bytes_(json.dumps(header | {"steps": steps})))
    refused(
        ValueError,
        lambda: coupler.run(steps=1, record_to=path, append=True),
        "run.h5",
        "steps of",
    )


# ---- meshes that meshlane or meshio reads --------------------------------------------------------

TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])


def meshio_mesh(points=CORNERS, cells=TRIANGLES, **others):
    meshio = pytest.importorskip("meshio")
    return meshio, meshio.Mesh(points, [("triangle", cells)], **others)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cells": TRIANGLES + 2}, "mesh must have nodes of 'triangle' in 0..3, got 4"),
        ({"cells": TRIANGLES - 1}, "mesh must have nodes of 'triangle' in 0..3, got -1"),
        ({"cells": TRIANGLES[:, :2]}, "mesh must have the numbers of 3 nodes for each 'triangle'"),
        ({"cells": TRIANGLES * 1.0}, "mesh must have the numbers of 3 nodes for each 'triangle'"),
        ({"points": np.nan * CORNERS}, "points of 'triangle' in the mesh must be finite"),
        ({"points": 1e200 * CORNERS}, "points of 'triangle' in the mesh must not exceed"),
        ({"points": CORNERS.ravel()}, "mesh must have points of shape (N, 2) or (N, 3)"),
        ({"points": CORNERS[:, :1]}, "points of shape (N, 2) or (N, 3), got (4, 1)"),
        ({"cell_sets": {"a": [[0, 2]]}}, "mesh must have elements of group 'a' in 0..1, got 2"),
        ({"point_sets": {"a": [0, 9]}}, "mesh must have points of set 'a' in 0..3, got 9"),
    ],
)
def test_a_mesh_has_the_nodes_and_members_that_it_names(change, words):
    refused(ValueError, lambda: pm.structures.from_mesh(meshio_mesh(**change)[1], STEEL), words)


def test_polygons_of_different_sizes_are_refused_by_name():
    meshlane = pytest.importorskip("meshlane")
    mesh = meshlane.Mesh(CORNERS, [("polygon", [[0, 1, 2], [0, 1, 2, 3]])])
    words = "mesh must have cells of one size in each block, got 'polygon'"
    refused(ValueError, lambda: pm.structures.from_mesh(mesh, STEEL), words)


# what the campaign was left with after damage: it made both libraries read on for ever
ENDLESS = '(1 "meshio")\n(2 2)\n(10 (0 1 4 0))\n(10 (1 1 4 1 2)(\n0 0\n1 0\n'


def test_a_mesh_that_is_cut_off_ends(tmp_path, mesh_library):
    path = tmp_path / "ansys.msh"
    path.write_text(ENDLESS)
    words = "ansys.msh", "must be a whole file", "it ends too early"
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), *words)


def test_formats_whose_readers_may_read_other_files_are_read_by_their_library_itself(
    tmp_path, mesh_library
):
    meshio, mesh = meshio_mesh()
    path = tmp_path / "mesh.ply"
    meshio.write(path, mesh)
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), "mesh.ply", "meshio.read")
    assert pm.structures.from_mesh(mesh_library.read(path), STEEL).n == 8


@pytest.mark.parametrize("name", ["mesh.msh", "mesh.bdf", "mesh.med"])
def test_a_mesh_is_read_whatever_it_is_read_by(tmp_path, mesh_library, name):
    meshio, mesh = meshio_mesh()
    if name.endswith("med"):
        pytest.importorskip("h5py")
    meshio.write(tmp_path / name, mesh, "ansys" if name.endswith("msh") else None)
    expected = pm.structures.from_mesh(mesh, STEEL).K.toarray()
    # surfaces of Nastran have bending
    read = pm.structures.from_mesh(tmp_path / name, STEEL, ignore=["SHELL"])
    np.testing.assert_array_equal(read.K.toarray(), expected)


IN_HDF5 = {
    "leads to another file": lambda h5py, whole: whole.__setitem__(
        "FAS/x", h5py.ExternalLink("other.med", "/FAS")
    ),
    "FAS/x is no array of this file": lambda h5py, whole: whole.create_dataset(
        "FAS/x", (4,), "f8", external=[("other.med", 0, 32)]
    ),
    "FAS/x must have 8796093022208 bytes": lambda h5py, whole: whole.create_dataset(
        "FAS/x", (2**40,), "f8", chunks=(1024,)
    ),
    "attribute x of / must be of fixed length": lambda h5py, whole: whole.attrs.update(x="text"),
    "FAS/x must be of fixed length": lambda h5py, whole: whole.__setitem__("FAS/x", "text"),
}


@pytest.mark.parametrize("words", IN_HDF5)
def test_a_mesh_in_hdf5_has_all_of_it_in_its_file(tmp_path, mesh_library, words):
    h5py = pytest.importorskip("h5py")
    meshio, mesh = meshio_mesh()
    path = tmp_path / "mesh.med"
    meshio.write(path, mesh)
    with h5py.File(path, "r+") as whole:
        IN_HDF5[words](h5py, whole)
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), "mesh.med", words)


def test_sets_of_sets_hold_each_node_once(tmp_path):
    # 16 names of the set before in each: 16^12 nodes if they were listed, more than any memory
    sets = ["*NSET, NSET=s0\n1, 2, 3, 4\n"]
    sets += [f"*NSET, NSET=s{k + 1}\n{', '.join(16 * [f's{k}'])}\n" for k in range(12)]
    path = tmp_path / "mesh.inp"
    path.write_text(INPUT + "".join(sets))
    plate = pm.structures.from_mesh(path, STEEL)
    assert plate.sets["s12"].tolist() == [0, 1, 2, 3]


def test_a_number_that_no_integer_holds_is_refused(tmp_path):
    path = tmp_path / "mesh.inp"
    path.write_text(INPUT.replace("1, 1, 2, 3, 4", "1, 1, 2, 3, 99999999999999999999"))
    words = "mesh.inp, line 6, *ELEMENT"
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), words)


def test_coordinates_too_large_for_a_volume_are_refused_without_another_warning(tmp_path):
    path = tmp_path / "mesh.inp"
    path.write_text(INPUT.replace("3, 1., 1.", "3, 1e200, 1."))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), "must not exceed 1e+50")


def test_a_header_of_variable_length_is_refused(tmp_path):
    # HDF5 1.14 does not return from reading some damaged ones, and cannot be interrupted
    pytest.importorskip("h5py")
    path = saved(tmp_path, "run.h5")
    replace_header(path, json.dumps)
    refused(ValueError, lambda: pm.History.load(path), "run.h5", "header must be of fixed length")
