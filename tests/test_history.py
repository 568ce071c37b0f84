"""History: files, and conversion to xarray."""

import dataclasses
import json
import os
import sys
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from agreement import assert_identical
from pairwise import in_turn

import pmalpha as pm
from pmalpha import models
from pmalpha.results.quantities import OF_INTERFACE, OF_SUBDOMAIN


def oscillator(**options):
    return pm.Subdomain([1.0, 2.0], [4.0, 9.0], scheme=pm.Newmark(), v0=[1.0, 0.5], **options)


def three_subdomains():
    """Three subdomains of different steps, the last one not recorded, from the middle of a run."""
    a, b, c = (
        oscillator(name="Größe 塔"),
        oscillator(name="b\0", substeps=3),
        oscillator(name="left out"),
    )
    coupler = pm.Coupler(
        [a, b, c], [pm.tie(a, [0], b, [0]), pm.tie(b, [1], c, [1])], dt=0.1, coupling="pm"
    )
    coupler.step(2)
    return coupler.run(1.0, record={a: None, b: [1]}), a


# ---- save and load --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [str, Path])
def test_a_loaded_history_is_bitwise_identical_to_the_saved_one(tmp_path, kind):
    history, _ = three_subdomains()
    history.velocity_jump[0] = [-0.0, np.nan]
    path = kind(tmp_path / "gespeichert ✓.npz")
    history.save(path)
    assert_identical(pm.History.load(path), history)


def test_coupling_and_warnings_of_a_run_are_in_its_file(tmp_path):
    wrong = pm.Subdomain(
        [1.0], None, scheme=pm.Newmark(), u0=[1.0], restoring=lambda t, u, v: -u, name="wrong"
    )
    coupler = pm.Coupler([oscillator(), wrong], (), dt=0.1, coupling="gc")
    with pytest.warns(pm.StabilityWarning, match="'wrong' have added energy"):
        history = coupler.run(steps=30)
    history.save(tmp_path / "h.npz")
    loaded = pm.History.load(tmp_path / "h.npz")
    assert loaded.coupling == "gc"
    assert len(history.warnings) == 1
    assert loaded.warnings == history.warnings


def test_a_history_without_constraints_and_with_one_time_level_can_be_saved(tmp_path):
    history = pm.Coupler([oscillator()], dt=0.1).run(steps=0)
    history.save(tmp_path / "h")
    loaded = pm.History.load(tmp_path / "h")
    assert_identical(loaded, history)
    assert loaded.multipliers.shape == (1, 0)
    assert loaded["subdomain 0"].u.shape == (1, 2)


def test_a_history_from_a_file_can_be_saved_again(tmp_path):
    history, _ = three_subdomains()
    history.save(tmp_path / "first")
    pm.History.load(tmp_path / "first").save(tmp_path / "second")
    assert_identical(pm.History.load(tmp_path / "second"), history)


def test_subdomains_of_a_file_are_found_by_name_and_number(tmp_path):
    history, tower = three_subdomains()
    history.save(tmp_path / "h.npz")
    loaded = pm.History.load(tmp_path / "h.npz")
    np.testing.assert_array_equal(loaded["Größe 塔"].u, history[tower].u)
    np.testing.assert_array_equal(loaded[0].u, history[tower].u)
    np.testing.assert_array_equal(loaded[-2].u, history["b\0"].u)
    assert repr(loaded) == repr(history)
    with pytest.raises(KeyError, match="names and indices only.*use 'Größe 塔'"):
        loaded[tower]
    with pytest.raises(KeyError, match="no subdomain None"):
        loaded[None]
    with pytest.raises(KeyError, match="'left out' was not recorded"):
        loaded[2]


def test_the_file_opens_in_numpy_without_pickle(tmp_path):
    history, _ = three_subdomains()
    history.save(tmp_path / "h.npz")
    with np.load(tmp_path / "h.npz", allow_pickle=False) as file:
        header = json.loads(file["header"].item())
        np.testing.assert_array_equal(file["1.u"], history[1].u)
        np.testing.assert_array_equal(file["multipliers"], history.multipliers)
    assert header["format"] == "pmalpha History"
    assert header["version"] == 1
    assert header["names"][0] == "Größe 塔"


def test_the_path_is_taken_as_it_is(tmp_path):
    history, _ = three_subdomains()
    history.save(tmp_path / "run")
    assert [file.name for file in tmp_path.iterdir()] == ["run"]


class Interrupted(BaseException):
    """An exception like KeyboardInterrupt that pytest does not handle."""


@pytest.mark.parametrize("error", [Interrupted(), OSError(28, "No space left on device")])
def test_an_interrupted_save_leaves_the_existing_file(tmp_path, monkeypatch, error):
    history, _ = three_subdomains()
    path = tmp_path / "h.npz"
    history.save(path)

    def savez(file, **arrays):
        file.write(b"PK half a file")
        raise error

    good = path.read_bytes()
    monkeypatch.setattr(np, "savez", savez)
    with pytest.raises(type(error)) as caught:
        history.save(path)
    assert path.read_bytes() == good
    assert [file.name for file in tmp_path.iterdir()] == ["h.npz"]
    if isinstance(error, OSError):
        assert str(caught.value) == (
            f"[Errno 28] path cannot be written: No space left on device: '{path}'"
        )


def test_a_link_is_kept_and_its_target_is_replaced(tmp_path):
    history, _ = three_subdomains()
    (tmp_path / "folder").mkdir()
    target, link = tmp_path / "folder" / "h.npz", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    history.save(link)
    assert link.is_symlink()
    assert_identical(pm.History.load(target), history)


def test_a_saved_file_has_the_permissions_of_any_new_file(tmp_path):
    history, _ = three_subdomains()
    history.save(tmp_path / "h.npz")
    (tmp_path / "other").write_text("")
    assert (tmp_path / "h.npz").stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    history, _ = three_subdomains()
    with pytest.raises(FileNotFoundError, match="path cannot be written.*nowhere/h.npz'"):
        history.save(tmp_path / "nowhere" / "h.npz")
    with pytest.raises(OSError, match="path cannot be written: a folder or a device"):
        history.save(tmp_path)
    with pytest.raises(OSError, match="path cannot be written: a folder or a device"):
        history.save(os.devnull)
    with pytest.raises(TypeError, match="path must be a str or a path, got 3"):
        history.save(3)
    assert not list(tmp_path.iterdir())


def test_a_path_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere.npz"):
        pm.History.load(tmp_path / "nowhere.npz")
    with pytest.raises(IsADirectoryError):
        pm.History.load(tmp_path)
    with pytest.raises(TypeError, match="path must be a str or a path, got None"):
        pm.History.load(None)


def with_header(path, header):
    np.savez(path, header=np.array(json.dumps(header)))


FOREIGN = {
    "is no npz file": lambda path: path.write_text("t,u\n0,1\n"),
    "is no npz file, or is cut off": lambda path: path.write_bytes(b""),
    "has no header with a format": lambda path: np.savez(path, u=np.zeros(3)),
    "is of format 'pmalpha checkpoint'": lambda path: with_header(
        path, {"format": "pmalpha checkpoint", "version": 1}
    ),
    "is of version 2 of it, not 1": lambda path: with_header(
        path, {"format": "pmalpha History", "version": 2}
    ),
    "is damaged: Object arrays cannot be loaded": lambda path: np.savez(
        path, header=np.array([{"format": "pmalpha History"}], dtype=object)
    ),
    "lacks 'names'": lambda path: with_header(path, {"format": "pmalpha History", "version": 1}),
    "lacks 'multiplier": lambda path: with_header(
        path, {"format": "pmalpha History", "version": 1, "names": ["a"], "recorded": []}
    ),
}


@pytest.mark.parametrize("reason", FOREIGN)
def test_another_file_is_refused_with_the_reason(tmp_path, reason):
    path = tmp_path / "other.npz"
    FOREIGN[reason](path)
    with pytest.raises(ValueError, match="path must lead to") as caught:
        pm.History.load(path)
    assert reason in str(caught.value)
    assert repr(str(path)) in str(caught.value)


def test_an_array_alone_is_refused(tmp_path):
    np.save(tmp_path / "u.npy", np.zeros(3))
    with pytest.raises(ValueError, match="is no npz file"):
        pm.History.load(tmp_path / "u.npy")


def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path):
    history, _ = three_subdomains()
    path = tmp_path / "h.npz"
    history.save(path)
    whole = path.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 20).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="is no npz file, or is cut off"):
            pm.History.load(path)


@pytest.mark.gate
def test_a_file_with_a_flipped_bit_is_refused_or_read_as_it_was(tmp_path):
    history, _ = three_subdomains()
    history.velocity_jump[:] = 1.0  # no NaN, so that only the damage differs
    path = tmp_path / "h.npz"
    history.save(path)
    whole = path.read_bytes()
    refused = 0
    for position in np.linspace(0, len(whole) - 1, 80).astype(int):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << (position % 8)
        path.write_bytes(damaged)
        try:
            assert_identical(pm.History.load(path), history)  # an unused bit of the container
        except ValueError:
            refused += 1
    assert refused > 64  # most of the file is numbers, under check sums


def forged(path, **changes):
    """Replace arrays of a file, or entries of its header."""
    with np.load(path) as file:
        arrays = dict(file)
    header = json.loads(arrays["header"].item())
    for name, value in changes.items():
        if name in header:
            header[name] = value
        else:
            arrays[name] = value
    np.savez(path, **arrays | {"header": np.array(json.dumps(header))})


@pytest.mark.parametrize(
    ("name", "value"),
    in_turn(["0.t", "0.u", "1.v", "1.a", "1.q", "multipliers", "macro_times"], np.nan, np.inf),
)
def test_states_that_no_run_has_are_refused_by_file_and_array(tmp_path, name, value):
    spring = pm.InternalForce(
        lambda t, u, v, q: (u**3, np.diag(3.0 * u**2), None, q), history=[1.0]
    )
    a = oscillator(name="a")
    b = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), internal=spring, v0=[1.0], name="b")
    path = tmp_path / "h.npz"
    pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="gc").run(steps=3).save(path)
    with np.load(path) as file:
        x = file[name].copy()
    x.flat[-1] = value
    forged(path, **{name: x})
    with pytest.raises(ValueError, match=f"lacks finite numbers in {name}$") as caught:
        pm.History.load(path)
    assert repr(str(path)) in str(caught.value)


def test_energies_and_jumps_beyond_the_range_of_numbers_are_read(tmp_path):
    path = tmp_path / "h.npz"
    coupler = pm.Coupler([pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), v0=[1e200])], dt=0.1)
    history = coupler.run(steps=2, energy=True)
    assert not np.isfinite(history.energy.kinetic).any()  # 1e200 squared
    history = replace(history, displacement_jump=np.full((3, 1), np.inf))
    history.save(path)
    loaded = pm.History.load(path)
    np.testing.assert_array_equal(loaded.energy.kinetic, history.energy.kinetic)
    np.testing.assert_array_equal(loaded.displacement_jump, history.displacement_jump)


def test_a_history_that_could_not_be_loaded_is_not_saved(tmp_path):
    history, a = three_subdomains()
    history[a].v[1, 0] = np.nan
    with pytest.raises(ValueError, match=r"finite states to be saved, 0\.v has others"):
        history.save(tmp_path / "h.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("forgery", "reason"),
    [
        ({"steps": [[np.nan, None], [1, None], None]}, "finite steps of subdomain 0, got nan"),
        ({"steps": [[0.1, "x"], [1, None], None]}, "finite steps of subdomain 0, got 'x'"),
        ({"steps": [[0.1, 10**400], [1, None], None]}, "finite steps of subdomain 0, got 1000"),
        ({"substeps": np.tile([1.0, 3.0, np.inf], (9, 1))}, "whole numbers in substeps"),
        ({"substeps": np.tile([1.0, 3.0, 1.5], (9, 1))}, "whole numbers in substeps"),
        ({"substeps": np.tile([1.0, 3.0, 1e300], (9, 1))}, "whole numbers in substeps"),
    ],
)
def test_steps_that_no_run_has_are_refused(tmp_path, forgery, reason):
    path = tmp_path / "h.npz"
    three_subdomains()[0].save(path)
    forged(path, **forgery)
    with pytest.raises(ValueError, match=f"lacks {reason}"):
        pm.History.load(path)


@pytest.mark.gate
def test_neither_saving_nor_loading_copies_a_large_history(tmp_path):
    n, k = 500, 6000
    subdomain = pm.SubdomainHistory(
        "a", np.arange(k), *(np.zeros((k, n)) for _ in range(3)), dofs=np.arange(n)
    )
    empty = np.zeros((k, 0))
    history = pm.History(
        (subdomain,), empty, subdomain.t, empty, empty, subdomain.t, (("a", None),)
    )
    size = 3 * 8 * n * k
    path = tmp_path / "h.npz"
    # NumPy writes pieces of 16 MiB
    assert peak_memory(history.save, path) < 17e6 < size / 4
    # the arrays themselves, and a buffer
    assert size < peak_memory(pm.History.load, path) < 1.1 * size


def peak_memory(call, *arguments):
    """Peak of the bytes allocated by NumPy and Python."""
    tracemalloc.start()
    try:
        call(*arguments)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_the_container_is_a_zip_file_that_is_not_packed(tmp_path):
    history, _ = three_subdomains()
    history.save(tmp_path / "h.npz")
    with zipfile.ZipFile(tmp_path / "h.npz") as file:
        assert file.testzip() is None
        assert {member.compress_type for member in file.infolist()} == {zipfile.ZIP_STORED}


# ---- xarray ---------------------------------------------------------------------------------


def test_a_dataset_has_the_arrays_of_the_history_with_names():
    pytest.importorskip("xarray")
    history, _ = three_subdomains()
    data = history.to_xarray()
    b = history["b\0"]
    assert data["b\0_v"].dims == ("b\0_time", "b\0_dof")
    np.testing.assert_array_equal(data["b\0_time"], b.t)
    np.testing.assert_array_equal(data["b\0_v"].sel({"b\0_dof": 1}), b.v[:, 0])
    for name in ("multipliers", "velocity_jump", "displacement_jump"):
        np.testing.assert_array_equal(data[name], getattr(history, name))
    assert data["displacement_jump"].dims == ("macro_times", "constraint")
    np.testing.assert_array_equal(data["multiplier_times"], history.multiplier_times)
    assert not [name for name in data.variables if name.startswith("left out")]


@pytest.mark.parametrize("ending", [".npz", ".h5"])
def test_a_history_of_a_file_makes_the_dataset_of_the_one_that_was_saved(tmp_path, ending):
    xarray = pytest.importorskip("xarray")
    if ending == ".h5":
        pytest.importorskip("h5py")
    spring = pm.Bilinear([0], k=4.0, fy=0.1)
    a = oscillator(name="a", restoring=spring)
    b = oscillator(name="b", substeps=2, internal=spring)
    coupler = pm.Coupler([a, b], pm.tie(a, [1], b, [1]), dt=0.1, coupling="gc")
    record = {"record_springs": {"a": None}, "outputs": {"b": {"drift": [[1.0, -1.0]]}}}
    before = coupler.run(steps=5, energy=True, **record)
    before.save(tmp_path / f"run{ending}")
    after = pm.History.load(tmp_path / f"run{ending}").to_xarray()
    xarray.testing.assert_identical(after, before.to_xarray())
    assert {"a_force", "a_deformation", "b_iterations", "b_drift", "energy_kinetic"} <= set(after)


def test_a_dataset_shares_its_memory_with_the_history():
    pytest.importorskip("xarray")
    history, tower = three_subdomains()
    data = history.to_xarray()
    assert np.shares_memory(data["Größe 塔_u"].values, history[tower].u)
    assert np.shares_memory(data["multipliers"].values, history.multipliers)


def test_names_of_subdomains_never_meet_those_of_the_interface():
    pytest.importorskip("xarray")
    names = ["macro", "multiplier", "a", "a_u", "constraint"]
    subdomains = [oscillator(name=name) for name in names]
    history = pm.Coupler(subdomains, dt=0.1, coupling="pm").run(steps=2)
    data = history.to_xarray()
    for name in names:
        np.testing.assert_array_equal(data[f"{name}_u"], history[name].u)


def test_a_dataset_of_one_subdomain_has_no_constraints():
    pytest.importorskip("xarray")
    data = pm.Coupler([oscillator()], dt=0.1).run(steps=2).to_xarray()
    assert data.sizes["constraint"] == 0
    assert data["subdomain 0_u"].shape == (3, 2)


def test_without_xarray_the_error_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    history = models.split_oscillator(10.0).coupler(0.05, coupling="pm").run(steps=1)
    with pytest.raises(ImportError, match=r"pip install 'pmalpha\[xarray\]'"):
        history.to_xarray()


def test_the_arrays_of_a_history_are_those_of_the_table_of_quantities():
    others = {"name", "substep", "double_after", "outputs", "subdomains", "keys", "energy"}
    others |= {"n", "dof_names", "pacing", "coupling", "warnings", "contact_layout", "dt"}
    others |= {"constraint_rows"}
    for kind, table in ((pm.SubdomainHistory, OF_SUBDOMAIN), (pm.History, OF_INTERFACE)):
        assert {field.name for field in dataclasses.fields(kind)} - others == set(table)


def test_iterations_and_histories_of_internal_forces_are_converted_too():
    pytest.importorskip("xarray")
    spring = pm.Bilinear([0], k=4.0, fy=0.1)
    mass = pm.Subdomain([1.0], None, scheme=pm.Newmark(), internal=spring, v0=[1.0], name="m")
    history = pm.Coupler([mass], dt=0.1).run(steps=4)
    whole = history.to_xarray()
    assert whole["m_iterations"].values.tolist() == history["m"].iterations.tolist()
    assert whole["m_iterations"].dims == ("m_time",)


def test_unknown_suffixes_are_refused_everywhere(tmp_path):
    pytest.importorskip("h5py")
    coupler = pm.Coupler([pm.Subdomain([1.0], [1.0], scheme=pm.Newmark())], dt=0.1)
    history = coupler.run(steps=1)
    numpy, hdf5 = "must end in .npz", "must end in .h5 or .hdf5, got '.*x.csv'"
    case = {"u0": {0: [1.0]}}
    for write, message in (
        (history.save, "path must end in .npz or .h5 or .hdf5, got '.*x.csv'"),
        (history[0].save, "path must end in .npz or .h5 or .hdf5"),
        (coupler.save, f"path {numpy}"),
        (lambda path: coupler.run(steps=1, record_to=path), f"record_to {hdf5}"),
        (lambda path: coupler.run_each([case], steps=1, record_to=[path]), f"record_to {hdf5}"),
        (lambda path: pm.Study(lambda: coupler, 0.1).run([case], save_to=path), "save_to"),
    ):
        with pytest.raises(ValueError, match=message):
            write(tmp_path / "x.csv")
    assert not list(tmp_path.iterdir())
    for name in ("x", "x.NPZ", "x.H5"):
        history.save(tmp_path / name)
        assert pm.History.load(tmp_path / name)[0].u.tolist() == history[0].u.tolist()
