"""Damaged and forged files: checkpoints, histories, records, matrices, meshes.

Bytes are cut off, flipped, repeated; in npz and HDF5 files also headers and arrays are replaced by
others. Each reading works or raises one of the documented exceptions, whose message names the file;
a coupler that refuses a checkpoint stays as it was. The readings are made in a child process, as in
campaign_input.py.
"""

import copy
import json
import shutil
import tempfile
import warnings
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import campaign_input
import numpy as np
from entries import one, sides
from odd_values import odd, odd_array

import pmalpha as pm
from pmalpha import files
from pmalpha.readers import mesh_files
from pmalpha.results import history_file
from pmalpha.run import checkpoint as checkpoints

HDF5 = find_spec("h5py") is not None
DOCUMENTED = (ValueError, OSError, MemoryError)


def coupler(kind="pm", steps=3):
    if kind == "newton":
        a, b, tie = sides(internal=pm.CubicSpring([0], k=1.0, k3=2.0))
    else:
        a, b, tie = sides()
    made = pm.Coupler([a, b], tie, dt=0.05, coupling="gc" if kind == "newton" else kind)
    if steps:
        made.step(steps)
    return made


def state(made):
    names = [s.name for s in made.subdomains]
    return np.concatenate([getattr(made.state(s), x) for s in names for x in "uva"])


# ---- good files --------------------------------------------------------------------------------


def checkpoint(path, kind):
    made = coupler(kind)
    made.step()
    if kind == "gc":
        made.change_steps(dt=0.02)
    made.save(path)


def history(path):
    coupler().run(steps=3, energy=True).save(path)


def recorded(path, steps=3):
    coupler(steps=steps).run(steps=3, record_to=path)


def master(path):
    for rank in range(2):
        own = path.with_name(f"{rank}.h5")
        coupler().run(steps=3, record_to=own)
        own.rename(path.with_name(f"{path.name}.{rank}"))
    names = [f"{path.name}.{rank}" for rank in range(2)]
    history_file.write_master(path, names, [0, 2, 4], ["a", "b", "c", "d"])


def of_ranks(path):
    """A checkpoint as two processes write it."""
    coupler().save(path)
    header, arrays = files.read_npz(path, checkpoints.FORMAT, checkpoints.VERSION)
    names = [f"{path.name}.{rank}" for rank in range(2)]
    for rank, name in enumerate(names):
        own = {key: x for key, x in arrays.items() if key[0] in (str(rank), *"mp")}
        files.write_npz(path.with_name(name), header, own)
    checkpoints.write_master(path, names, [0, 1, 2])


def at2(path):
    path.write_text(
        "PEER NGA\nQuake\nACCELERATION TIME SERIES IN UNITS OF G\n"
        "NPTS=   7, DT=   .0100 SEC\n" + 3 * "  .1E-03  .2E-03\n" + "  .1E-03\n"
    )


def abaqus(path):
    path.write_text("** matrix\n*MATRIX INPUT\n1,1, 1,1, 4.0\n1,1, 2,1, -1.0\n2,1, 2,1, 4.0\n")


def dmig(path):
    path.write_text(
        "DMIG    KAAX           0       6       2       0\n"
        "DMIG*   KAAX                           1               1\n"
        "*                      1               1  4.000000000D+00\n"
    )


def inp(path):
    path.with_name("more.txt").write_text("*NSET, NSET=left\n1, 4\n")
    path.write_text(
        "*NODE\n1, 0., 0.\n2, 1., 0.\n3, 1., 1.\n4, 0., 1.\n*ELEMENT, TYPE=CPS4, ELSET=all\n"
        "1, 1, 2, 3, 4\n*ELSET, ELSET=some, GENERATE\n1, 1, 1\n*INCLUDE, INPUT=more.txt\n"
    )


def mesh(path):
    library = mesh_files.mesh_library("a good file")
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    cells = [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))]
    kind = {"msh": "gmsh22", "new.msh": "gmsh", "ansys.msh": "ansys"}.get(
        path.name.partition(".")[2]
    )
    if path.suffix == ".cgns":  # of which only these are read
        points[3, 2] = 1.0
        cells = [("tetra", np.array([[0, 1, 2, 3]]))]
    library.write(path, library.Mesh(points, cells), kind)


# ---- how they are read -------------------------------------------------------------------------


@cache
def reader(kind):
    """A coupler that refuses or loads checkpoints."""
    return coupler(kind)


def load(path, kind):
    made = reader(kind)
    kept, before = made.snapshot(), state(made)
    try:
        made.load(path)
    except BaseException:
        np.testing.assert_array_equal(state(made), before)
        raise
    found = state(made)
    made.restore(kept)
    return found


def use(history):
    """What is finite in a History, read from its file; energies may be beyond the range."""
    motions = [(own.t, own.u, own.v, own.a) for own in filter(None, history.subdomains)]
    return [np.array(x) for x in (history.multipliers, *sum(motions, ()))]


def append(path):
    made = reader("pm")
    kept = made.snapshot()
    try:
        return use(made.run(steps=1, record_to=path, append=True))
    finally:
        made.restore(kept)


def structure(path):
    material = {"E": 1.0, "nu": 0.3, "rho": 1.0}
    plane = {} if path.suffix == ".cgns" else {"plane": "strain"}
    return pm.structures.from_mesh(path, material, **plane).M.data


KINDS = {
    "pm.npz": (lambda path: checkpoint(path, "pm"), lambda path: load(path, "pm")),
    "gc.npz": (lambda path: checkpoint(path, "gc"), lambda path: load(path, "gc")),
    "newton.npz": (lambda path: checkpoint(path, "newton"), lambda path: load(path, "newton")),
    "ranks.npz": (of_ranks, lambda path: load(path, "pm")),
    "history.npz": (history, lambda path: use(pm.History.load(path))),
    "record.at2": (at2, pm.readers.read_at2),
    "matrix.mtx": (abaqus, lambda path: pm.readers.read_abaqus(path).matrix.data),
    "matrix.pch": (dmig, lambda path: pm.readers.read_dmig(path).matrix.data),
    "mesh.inp": (inp, structure),
}
OF_HDF5 = {
    "history.h5": (history, lambda path: use(pm.History.load(path))),
    "record.h5": (recorded, lambda path: use(pm.History.load(path))),
    "append.h5": (lambda path: recorded(path, 0), append),
    "master.h5": (master, lambda path: use(pm.History.load(path))),
}
# The formats in which meshlane writes these elements, and reads them by libraries at hand
SUFFIXES = [x for x in mesh_files.FORMATS if HDF5 or x not in (".med", ".cgns", ".h5m")]
SUFFIXES = [x for x in SUFFIXES if find_spec("meshlane") or x != ".cdb"]
MESHES = {f"mesh{suffix}": (mesh, structure) for suffix in (".new.msh", ".ansys.msh", *SUFFIXES)}
FOUND = (
    KINDS
    | (OF_HDF5 if HDF5 else {})
    | (MESHES if find_spec("meshlane") or find_spec("meshio") else {})
)


@cache
def good(name):
    """A folder with a good file; it lives as long as the process."""
    folder = tempfile.TemporaryDirectory()
    FOUND[name][0](Path(folder.name, name))
    return folder


# ---- damage ------------------------------------------------------------------------------------


def damaged(rng, path):
    """Change bytes of a file."""
    data = bytearray(path.read_bytes())
    for _ in range(int(rng.choice([1, 1, 2, 8]))):
        i = int(rng.integers(len(data))) if len(data) else 0
        kind = int(rng.integers(6))
        if kind == 0:
            del data[i:]
        elif kind == 1:
            data[i:i] = data[: int(rng.integers(1, 64))]
        elif kind == 2:
            data[i : i + 8] = rng.bytes(8)
        elif kind == 3:
            data[i : i + 8] = one(rng, b"\0", b"\xff", b"9", b"-", b"\n", b",") * 8
        elif kind == 4:
            del data[i : i + int(rng.integers(1, 64))]
        elif data:
            data[i % len(data)] ^= 1 << int(rng.integers(8))
    path.write_bytes(bytes(data))


def odd_json(rng, value):
    """A header with one of its values changed, at any depth."""
    inner = value if isinstance(value, list | dict) and value and rng.random() < 0.7 else None
    if inner is None:
        new = odd(rng, value)
        try:
            json.dumps(new)
        except (TypeError, ValueError):
            return one(rng, None, -1, 2**70, "x", [], {}, 1e308)
        return new
    new = copy.deepcopy(value)
    key = one(rng, *(value if isinstance(value, dict) else range(len(value))))
    new[key] = odd_json(rng, value[key])
    return new


def odd_plain_array(rng, x):
    """An array that a file can hold."""
    with np.errstate(all="ignore"):
        y = odd_array(rng, np.atleast_1d(x))
    return (
        y if isinstance(y, np.ndarray) and y.size < 10**6 and y.ndim < 9 else np.atleast_1d(x)[:-1]
    )


def forged_npz(rng, path):
    """Another header or array in an npz file, or a file that claims more than it holds."""
    with np.load(path) as file:
        arrays = dict(file)
    name = one(rng, "header", "header", *arrays)
    if name == "header":
        header = odd_json(rng, json.loads(arrays["header"].item()))
        arrays["header"] = np.array(json.dumps(header))
    else:
        arrays[name] = odd_plain_array(rng, arrays[name])
    with path.open("wb") as file:
        (np.savez if rng.random() < 0.9 else np.savez_compressed)(file, **arrays)


def forged_hdf5(rng, path):
    """The same of an HDF5 file, and links and storage elsewhere."""
    import h5py

    with h5py.File(path, "r+", locking=False) as whole:
        names = []
        if "files" not in whole["header"][()].decode():
            whole.visititems(lambda name, x: names.append(name) if hasattr(x, "shape") else None)
        name = one(rng, "header", *names)
        value = whole[name][()]
        del whole[name]
        kind = int(rng.integers(6))
        if kind == 0:
            whole[name] = h5py.ExternalLink(one(rng, "/etc/passwd", "../other.h5"), "/u")
        elif kind == 1:
            whole[name] = h5py.SoftLink("/header")
        elif kind == 2:
            whole.create_dataset(name, (2**40,), "f8", chunks=(1024,))
        elif kind == 3:
            whole.create_dataset(name, (1024,), "f8", external=[("/etc/passwd", 0, 8192)])
        elif name == "header":
            text = json.dumps(odd_json(rng, json.loads(value)))
            whole[name] = one(rng, text, *4 * [np.bytes_(text)])
        else:
            x = odd_plain_array(rng, np.atleast_1d(value))
            whole[name] = x if x.dtype.kind in "biuf" else np.zeros(3)


def fault_of(path, read, checked):
    """(what came out, the fault or None); states in `checked` files are finite."""
    try:
        found = read(path)
    except (KeyboardInterrupt, AssertionError):
        raise
    except DOCUMENTED as error:
        text = str(error)
        words = (
            path.name,
            "append",
            "mesh",
            "elements",
            "material",
            "INPUT",
            "points",
            "No such file",
        )
        if isinstance(error, MemoryError) or any(word in text for word in words):
            return type(error).__name__, None
        return type(error).__name__, f"the message names no file: {type(error).__name__}: {error}"
    except BaseException as error:
        return type(error).__name__, f"{type(error).__name__}: {error}"
    arrays = [x for x in campaign_input.arrays_in(found) if x.dtype.kind == "f"]
    finite = not checked or all(np.isfinite(x).all() for x in arrays)
    return "works", None if finite else "a result is not finite"


def attempt(seed, counts):
    """One reading; the fault that was found, or None."""
    rng = np.random.default_rng([seed, 13])
    name = one(rng, *FOUND)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)
        shutil.copytree(good(name).name, folder, dirs_exist_ok=True)
        path = Path(folder, name)
        how = damaged
        if rng.random() < 0.5:
            how = {".npz": forged_npz, ".h5": forged_hdf5}.get(path.suffix, damaged)
        how(rng, path)
        what, fault = fault_of(path, FOUND[name][1], path.suffix == ".npz")
    counts["calls"] += 1
    counts[what] += 1
    return None if fault is None else f"{name}, {how.__name__}: {fault}"


campaign = partial(campaign_input.campaign, script=__file__)

if __name__ == "__main__":
    campaign_input.main(__doc__, attempt, __file__)
