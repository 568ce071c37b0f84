"""What the campaigns with odd input and files have found: each is refused by name now."""

import json
import re
import zipfile
from fractions import Fraction
from importlib.util import find_spec

import numpy as np
import pytest
import scipy.sparse as sp
from test_bad_input import refused, single

import pmalpha as pm
from pmalpha.run import checkpoint

MASSES, K = np.ones(3), np.diag([4.0, 4.0, 2.0])
BLOCK = pm.structures.plate(1, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
BETA = pm.Newmark()
MOTION = [[0.0], [1.0]], [[0, 1]], [0.0], [[0.0, 0.0]]
PLANE = {"nodes": [0], "point": [0.0, 0.0], "stiffness": 1.0}
HUGE = np.array([[0.0, 0.0], [1e308, 0.0], [1e308, 1e308], [0.0, 1e308]])


def damaged_blocks():
    A = sp.bsr_array(np.eye(3))
    A.indices = np.concatenate([A.indices, A.indices])
    return A


def with_objects():
    A = sp.csr_array(np.eye(3))
    A.data = A.data.astype(object)
    return A


REFUSED = {
    "a plane on no structure": (
        lambda: pm.structures.plane_contact(np.eye(3), normal=[0.0, 1.0], **PLANE),
        TypeError,
        "structure must be a Structure",
    ),
    "a normal of infinite length": (
        lambda: pm.structures.plane_contact(BLOCK, normal=[1e308, 1.5e308], **PLANE),
        ValueError,
        "normal must",
    ),
    "too many divisions": (
        lambda: pm.structures.subdivide([[0, 0], [1, 0]], [[0, 1]], 2**63),
        ValueError,
        "divisions must be at most",
    ),
    "points out of range": (
        lambda: pm.structures.plate_on(HUGE, [[0, 1, 2, 3]], E=1.0, nu=0.3, rho=1.0),
        ValueError,
        "points must not exceed",
    ),
    "points to interpolate between out of range": (
        lambda: pm.interpolate("a", [[0.5, 0.5]], "b", HUGE, [[0, 1, 2, 3]]),
        ValueError,
        "points of 'b' must not exceed",
    ),
    "masses that are an iterator": (
        lambda: pm.models.shear_frame(iter([1.0]), [1.0]),
        TypeError,
        "masses must hold real numbers",
    ),
    "three frequencies": (
        lambda: pm.models.rayleigh([1.0, 2.0, 3.0], [0.1, 0.1]),
        ValueError,
        "omegas must have shape (2,)",
    ),
    "lists of ratios": (
        lambda: pm.models.rayleigh([1.0, 2.0], [0.1, [0.1]]),
        ValueError,
        "ratios must be a regular array",
    ),
    "a complex displacement": (
        lambda: pm.models.split_oscillator(10.0, u0=1j),
        TypeError,
        "u0 must be a real number",
    ),
    "a tolerance in words": (
        lambda: pm.analysis.spectral_radius(K, tol="x"),
        TypeError,
        "tol must be a real number",
    ),
    "eigenvalues in words": (
        lambda: pm.analysis.spectral_radius(K, drop=["x"]),
        TypeError,
        "drop must be a sequence of numbers",
    ),
    "an order of no function": (
        lambda: pm.analysis.observed_order({}, [0.1, 0.2]),
        TypeError,
        "run must be callable",
    ),
    "steps that are one flag": (
        lambda: pm.analysis.observed_order(abs, True),
        TypeError,
        "steps must hold real numbers",
    ),
    "a flag that is a matrix": (
        lambda: pm.analysis.response_spectrum(
            MASSES, 0.1, [1.0], free_vibration=sp.dia_array(np.eye(3))
        ),
        TypeError,
        "free_vibration must be True or False",
    ),
    "a step with an infinite square": (
        lambda: pm.analysis.response_spectrum(MASSES, 1e308, [1.0]),
        ValueError,
        "dt must have a finite square",
    ),
    "frequencies out of range": (
        lambda: pm.analysis.period_and_damping(pm.Newmark(), [1e307]),
        ValueError,
        "Omega must not exceed",
    ),
    "parameters out of range": (lambda: pm.Newmark(5e-324), ValueError, "beta must be 0 or"),
    "a parameter out of range": (lambda: pm.Newmark(0.25, 1e308), ValueError, "gamma must"),
    "constraints that are an array": (
        lambda: pm.Coupler([single()], np.array(1.0), dt=0.1),
        TypeError,
        "constraints must be Constraints",
    ),
    "cases that are an array": (
        lambda: pm.Coupler([single()], dt=0.1).run_each(np.array(1.0), steps=1),
        TypeError,
        "cases must be a list of dicts",
    ),
    "a ragged step": (
        lambda: pm.Coupler([single()], dt=[[1.0, 2.0], [3.0]]),
        ValueError,
        "dt must be a regular array",
    ),
    "a ragged velocity": (
        lambda: pm.Constraint({"a": [[1.0]]}, velocity=[[1.0, 2.0], [3.0]]),
        ValueError,
        "velocity must be a regular array",
    ),
    "a dof out of range": (
        lambda: pm.tie("a", [2**63 - 1], "b", [0]),
        ValueError,
        "dofs_a must be below",
    ),
    "a record with a row for each sample": (
        lambda: pm.BaseAcceleration([[1.0, 2.0]], 0.1, [1.0, 1.0], [1.0, 1.0]),
        ValueError,
        "direction must have a column for each of the 2 series of record",
    ),
    "a load out of range": (
        lambda: pm.SampledForce([1e200], 0.1, shape=[1e200]),
        ValueError,
        "values times shape must be finite",
    ),
    "a mass times a direction out of range": (
        lambda: pm.BaseAcceleration([1.0], 0.1, [1e200], [1e200]),
        ValueError,
        "M times direction must be finite",
    ),
    "a motion out of range": (
        lambda: pm.SupportMotion([0.0, 1e308], 0.1, "acceleration"),
        ValueError,
        "record must not exceed",
    ),
    "a damaged matrix of blocks": (
        lambda: pm.Subdomain(damaged_blocks(), K, scheme=pm.Newmark()),
        ValueError,
        "M must have as many indices as blocks",
    ),
    "a pattern of objects": (
        lambda: pm.InternalForce(lambda *_: None, pattern=with_objects()),
        TypeError,
        "pattern must hold real numbers",
    ),
    "subdomains that are a sparse matrix": (
        lambda: pm.Coupler(sp.dia_array(np.eye(3)), dt=0.1),
        TypeError,
        "subdomains must be a list of Subdomains",
    ),
    "a damping whose differences overflow": (
        lambda: pm.Subdomain(MASSES, K, 1e308 * (np.eye(3, k=1) - np.eye(3, k=-1)), scheme=BETA),
        ValueError,
        "C must be symmetric",
    ),
    "a damping of whole numbers without a sign": (
        lambda: pm.Subdomain(
            MASSES, K, np.array([[0, 1, 0], [2**64 - 1, 0, 0], [0, 0, 0]], "u8"), scheme=BETA
        ),
        ValueError,
        "C must be symmetric",
    ),
    "modes of a mass that is nearly zero": (
        lambda: pm.models.modal_damping([1.0, 1.0, 5e-324], K, [0.02]),
        ValueError,
        "M must be so large that K_ii / M_ii is finite, which it is not at 2",
    ),
    "modal damping of negative masses": (
        lambda: pm.models.modal_damping(-MASSES, K, [0.02]),
        ValueError,
        "ratios must be at most 0, one for each dof with mass",
    ),
    "a spectrum with periods far below the step": (
        lambda: pm.analysis.response_spectrum(MASSES, 2.0**70, [1.0]),
        ValueError,
        "periods must be 0 or at least dt / 1e+06",
    ),
    "a prestress out of range": (
        lambda: pm.structures.truss([[0, 0], [1, 0]], [[0, 1]], EA=1.0, rhoA=1.0, prestress=1e155),
        ValueError,
        "prestress must not exceed",
    ),
    "fields that are no dict": (
        lambda: pm.export.write_series("x.xdmf", *MOTION, data=[("T", [[0.0, 1.0]])]),
        TypeError,
        "data must be a dict",
    ),
    "numbers of elements that are no dict": (
        lambda: pm.export.write_series("x.xdmf", *MOTION, cells=[1.0]),
        TypeError,
        "cells must be a dict",
    ),
    "a study of no cases": (
        lambda: pm.Study(list, steps=1).run(np.array(1.0)),
        TypeError,
        "cases must be dicts of what reset takes",
    ),
    "a map that returns nothing": (
        lambda: pm.Study(list, steps=1).run([{}], map=lambda *_: None),
        TypeError,
        "map must return an iterable of results, got None",
    ),
    "a picture of no scheme": (
        lambda: pm.plot.scheme_radius(5),
        TypeError,
        "schemes must be pmalpha schemes, got 5",
    ),
    "a picture of a list of quantities": (
        lambda: pm.Coupler([single()], dt=0.1).run(steps=1).plot(quantity=["u"]),
        ValueError,
        "quantity must be 'u', 'v' or 'a', got",
    ),
    "fixed dofs of several kinds": (
        lambda: pm.cut(BLOCK, [0], fixed=[0, print]),
        TypeError,
        "fixed must be",
    ),
    "a scheme that is a matrix": (
        lambda: pm.cut(BLOCK, [0], dt=0.1, scheme=sp.dia_array(np.eye(3))),
        TypeError,
        "scheme must be a Scheme",
    ),
}


if not find_spec("matplotlib"):
    REFUSED = {what: x for what, x in REFUSED.items() if not what.startswith("a picture")}


@pytest.mark.parametrize("what", REFUSED)
def test_odd_input_is_refused_by_name(what):
    call, error, words = REFUSED[what]
    refused(error, call, words)


def test_parameters_of_schemes_are_floats_whatever_was_given():
    scheme = pm.Scheme(Fraction(0), Fraction(1, 4), Fraction(2, 5), np.float32(0.75))
    numbers = [scheme.am, scheme.af, scheme.beta, scheme.gamma]
    assert [type(x) for x in numbers] == 4 * [float]
    assert 0.0 < scheme.radius_at_infinity() < 1.0


def test_a_mass_so_small_that_frequencies_overflow_ends_as_instability():
    s = pm.Subdomain(1e-308 * MASSES, K + 0.1, scheme=pm.CentralDifference(), u0=MASSES)
    with pytest.warns(pm.StabilityWarning), pytest.raises(pm.InstabilityError):
        pm.Coupler([s], dt=0.1)


def test_masses_whose_squares_overflow_raise_no_warning():
    C = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    pm.Subdomain(np.array([1e308, 1.0, 1.0]), K, C, symmetric=False, scheme=pm.Newmark())


# ---- files from strangers ------------------------------------------------------------------------


def saved(folder, name="run.npz"):
    path = folder / name
    pm.models.split_oscillator(10.0).coupler(0.05).run(steps=3).save(path)
    return path


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


def test_a_compressed_file_is_refused_since_it_may_hold_any_amount(tmp_path):
    path = saved(tmp_path)
    with np.load(path) as file:
        np.savez_compressed(tmp_path / "small.npz", **file)
    refused(ValueError, lambda: pm.History.load(tmp_path / "small.npz"), "is compressed")


def forged_hdf5(tmp_path, change):
    h5py = pytest.importorskip("h5py")
    saved(tmp_path, "other.h5")
    path = saved(tmp_path, "run.h5")
    with h5py.File(path, "r+") as whole:
        del whole["0/u"]
        change(h5py, whole)
    return path


ELSEWHERE = {
    "a link to another file": lambda h5py, whole: whole.__setitem__(
        "0/u", h5py.ExternalLink("other.h5", "/0/u")
    ),
    "a link in the file": lambda h5py, whole: whole.__setitem__("0/u", h5py.SoftLink("/1/u")),
    "storage in another file": lambda h5py, whole: whole.create_dataset(
        "0/u", (4, 1), "f8", external=[("other.h5", 0, 32)]
    ),
}


@pytest.mark.parametrize("where", ELSEWHERE)
def test_a_history_reads_no_other_file_than_its_own(tmp_path, where):
    path = forged_hdf5(tmp_path, ELSEWHERE[where])
    refused(ValueError, lambda: pm.History.load(path), "run.h5", "0/u")


def test_an_array_that_was_never_written_is_refused_before_memory_is_taken(tmp_path):
    path = forged_hdf5(
        tmp_path, lambda h5py, whole: whole.create_dataset("0/u", (2**40,), "f4", chunks=(1024,))
    )
    refused(ValueError, lambda: pm.History.load(path), "0/u must have 4398046511104 bytes")


@pytest.mark.parametrize("files", [["../run.h5"], ["/etc/passwd"], [".."]])
def test_a_master_leads_to_histories_in_its_folder_only(tmp_path, files):
    h5py = pytest.importorskip("h5py")
    path = saved(tmp_path, "run.h5")
    with h5py.File(path, "r+") as whole:
        header = json.loads(whole["header"][()])
        del whole["header"]
        whole["header"] = np.bytes_(json.dumps(header | {"files": files}))
    refused(ValueError, lambda: pm.History.load(path), "path must lead to")


INPUT = "*NODE\n1, 0., 0.\n2, 1., 0.\n3, 1., 1.\n4, 0., 1.\n*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n"


@pytest.mark.parametrize(
    "name", ["no\0thing", "../more.txt", "/etc/passwd", "mesh.inp", "sub/../../more.txt"]
)
def test_a_mesh_includes_files_in_its_folder_only(tmp_path, name):
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "more.txt").write_text("** outside\n")
    path = folder / "mesh.inp"
    path.write_text(f"{INPUT}*INCLUDE, INPUT={name}\n")
    message = refused(
        ValueError, lambda: pm.structures.from_mesh(path, {"E": 1.0, "nu": 0.3, "rho": 1.0})
    )
    assert re.search(r"\*INCLUDE", message)


def test_a_mesh_may_include_files_below_its_folder(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "nodes.txt").write_text(INPUT)
    path = tmp_path / "mesh.inp"
    path.write_text("*INCLUDE, INPUT=parts/nodes.txt\n")
    plate = pm.structures.from_mesh(path, {"E": 1.0, "nu": 0.3, "rho": 1.0})
    assert plate.n == 8


def test_a_damaged_mesh_ends_no_program(tmp_path):
    pytest.importorskip("meshio")
    path = tmp_path / "mesh.vtu"
    path.write_text("<VTKFile")
    refused(
        ValueError,
        lambda: pm.structures.from_mesh(path, {"E": 1.0, "nu": 0.3, "rho": 1.0}),
        "mesh must be a whole file",
    )


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
    with np.load(path) as file:
        arrays = dict(file)
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
        {"files": [], "first": [0]},
    ],
)
def test_a_checkpoint_of_several_processes_leads_to_files_in_its_folder_only(tmp_path, facts):
    coupler = pm.models.split_oscillator(10.0).coupler(0.05)
    path = tmp_path / "whole.npz"
    checkpoint.write_master(path, ["x.npz"], [0, 2])
    (tmp_path / "x.npz").write_bytes(b"none")
    rewrite(path, lambda header: header.update(facts))
    refused(ValueError, lambda: coupler.load(path), "path must lead to", ".npz")


def test_a_history_with_arrays_that_do_not_fit_is_refused(tmp_path):
    path = saved(tmp_path)
    with np.load(path) as file:
        arrays = dict(file)
    for name, wrong in {"0.u": arrays["0.u"][:-1], "0.t": arrays["0.t"].astype("M8[s]")}.items():
        np.savez(tmp_path / "wrong.npz", **(arrays | {name: wrong}))
        refused(ValueError, lambda: pm.History.load(tmp_path / "wrong.npz"), "wrong.npz", name)


# ---- meshes of meshio ----------------------------------------------------------------------------

STEEL = {"E": 1.0, "nu": 0.3, "rho": 1.0}
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
        ({"points": CORNERS.ravel()}, "mesh must have points of shape (N, dim)"),
        ({"cell_sets": {"a": [[0, 2]]}}, "mesh must have elements of group 'a' in 0..1, got 2"),
        ({"point_sets": {"a": [0, 9]}}, "mesh must have points of set 'a' in 0..3, got 9"),
    ],
)
def test_a_mesh_has_the_nodes_and_members_that_it_names(change, words):
    refused(ValueError, lambda: pm.structures.from_mesh(meshio_mesh(**change)[1], STEEL), words)


# what the campaign was left with after damage: each made meshio read on for ever
ENDLESS = {
    "ansys.msh": '(1 "meshio")\n(2 2)\n(10 (0 1 4 0))\n(10 (1 1 4 1 2)(\n0 0\n1 0\n',
    "nastran.bdf": "BEGIN BULK\n",
}


@pytest.mark.parametrize("name", ENDLESS)
def test_a_mesh_that_is_cut_off_ends(tmp_path, name):
    meshio_mesh()
    path = tmp_path / name
    path.write_text(ENDLESS[name])
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), name, "it ends too early")


def test_formats_whose_readers_may_read_other_files_are_read_by_meshio_itself(tmp_path):
    meshio, mesh = meshio_mesh()
    path = tmp_path / "mesh.ply"
    meshio.write(path, mesh)
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), "mesh.ply", "meshio.read")
    assert pm.structures.from_mesh(meshio.read(path), STEEL).n == 8


@pytest.mark.parametrize("name", ["mesh.msh", "mesh.bdf", "mesh.med"])
def test_a_mesh_is_read_whatever_it_is_read_by(tmp_path, name):
    meshio, mesh = meshio_mesh()
    if name.endswith("med"):
        pytest.importorskip("h5py")
    meshio.write(tmp_path / name, mesh, "ansys" if name.endswith("msh") else None)
    expected = pm.structures.from_mesh(mesh, STEEL).K.toarray()
    np.testing.assert_array_equal(
        pm.structures.from_mesh(tmp_path / name, STEEL).K.toarray(), expected
    )


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
def test_a_mesh_in_hdf5_has_all_of_it_in_its_file(tmp_path, words):
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
    refused(ValueError, lambda: pm.structures.from_mesh(path, STEEL), "mesh.inp, *ELEMENT")


def test_a_header_of_variable_length_is_refused(tmp_path):
    # HDF5 1.14 does not return from reading some damaged ones, and cannot be interrupted
    h5py = pytest.importorskip("h5py")
    path = saved(tmp_path, "run.h5")
    with h5py.File(path, "r+") as whole:
        text = whole["header"][()].decode()
        del whole["header"]
        whole["header"] = text
    refused(ValueError, lambda: pm.History.load(path), "run.h5", "header must be of fixed length")
