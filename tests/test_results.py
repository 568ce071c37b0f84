"""Figures that show themselves, and results as files and objects of other libraries."""

import sys

import numpy as np
import pytest
import waits
from agreement import assert_identical

import pmalpha as pm
from pmalpha import models
from pmalpha.results.subdomain import OneSubdomain

UNITS = {"length": "mm", "time": "s", "force": "kN"}


@pytest.fixture
def pyplot():
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.close("all")
    yield plt
    plt.close("all")


def oscillation():
    joint = pm.Bilinear([0], k=4.0, fy=1.0)
    s = pm.Subdomain([1.0, 1.0], [1.0, 2.0], scheme=pm.Newmark(), restoring=joint, v0=[3.0, 1.0])
    return pm.solve(s, 0.1, 2.0, record_springs={0: None})


def test_a_plot_is_a_figure_of_pyplot_so_that_show_shows_it(pyplot):
    history = models.four_dof().coupler(0.05, coupling="pm").run(steps=40)
    figures = [x.figure for x in (history.plot(), history["A"].plot(), oscillation().plot([1]))]
    assert [pyplot.figure(i) for i in pyplot.get_fignums()] == figures
    assert [len(figure.axes) for figure in figures] == [3, 1, 1]  # dofs, gap, multiplier


def test_many_plots_do_not_warn(pyplot):
    motion = oscillation()
    with pyplot.rc_context({"figure.max_open_warning": 2}):
        assert len({id(motion.plot()) for _ in range(4)}) == 4  # warnings are errors


@pytest.mark.gate  # a kernel of Jupyter
def test_a_plot_is_shown_once_in_a_fresh_notebook(tmp_path, pyplot):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    make = (
        "import pmalpha as pm\nh = pm.models.four_dof().coupler(0.05, coupling='pm').run(steps=9)"
    )
    cells = [make, "h.plot()", "ax = h.plot()", "ax.figure", "h['A'].plot(); h.plot()"]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(x) for x in cells])
    nbclient.NotebookClient(notebook, timeout=int(waits.LIMIT), kernel_name="python3").execute()
    pictures = [
        sum("image/png" in x.get("data", {}) for x in cell.outputs) for cell in notebook.cells
    ]
    assert pictures == [0, 1, 1, 1, 2]


@pytest.mark.gate
def test_units_are_in_the_labels(pyplot):
    history = models.four_dof().coupler(0.05, coupling="pm").run(steps=40)
    labels = [ax.get_ylabel().replace("\n", " ") for ax in history.plot(units=UNITS).figure.axes]
    assert labels[0] == "displacement (mm)" and labels[2] == "multiplier (kN)"
    assert labels[1] == "displacement jump (mm)"
    # without recorded velocities the jump has nothing to be small against, and is drawn
    jumps = models.four_dof().coupler(0.05, coupling="pm").run(steps=40, record={})
    label = jumps.plot(units=UNITS).figure.axes[0].get_ylabel().replace("\n", " ")
    assert label.startswith("velocity jump (") and label.endswith("mm/s)")
    figure = history["A"].plot(quantity="a", units=UNITS).figure
    assert figure.axes[0].get_ylabel().endswith("mm/s$^2$)")
    assert figure.axes[0].get_xlabel() == "time $t$ (s)"
    partial = history.plot(quantity="v", units={"length": "m"}).figure.axes
    assert partial[0].get_ylabel() == "velocity" and partial[2].get_ylabel() == "multiplier"
    for units, error in (({"mass": "kg"}, ValueError), ("m", TypeError), ({"time": 1}, TypeError)):
        with pytest.raises(error, match="units must be"):
            history.plot(units=units)


@pytest.mark.parametrize("name", ["run.npz", "run.h5"])
def test_what_solve_returns_is_saved_and_loaded(tmp_path, name):
    if name.endswith("h5"):
        pytest.importorskip("h5py")
    motion = oscillation()
    motion.save(tmp_path / name)
    loaded = pm.History.load(tmp_path / name)
    assert [key for key, _ in loaded.keys] == [motion.name] and loaded.multipliers.shape == (21, 0)
    assert_identical(loaded, OneSubdomain(motion))
    for x in ("deformation", "force", "springs"):
        assert np.array_equal(getattr(loaded[0], x), getattr(motion, x))


def test_what_solve_returns_becomes_a_dataset():
    pytest.importorskip("xarray")
    motion = oscillation()
    data = motion.to_xarray()
    for name in ("u", "v", "a", "deformation", "force"):
        assert np.array_equal(data[name].values, getattr(motion, name))
    assert float(data.u.sel(dof=1, time=motion.t[7])) == motion.u[7, 1]
    assert data.force.dims == ("time", "spring") and data.attrs == {"name": motion.name}
    history = models.four_dof().coupler(0.05, coupling="pm").run(steps=5)
    assert history.to_xarray()["substeps"].shape == (6, 2)


def test_a_history_becomes_data_frames():
    pytest.importorskip("pandas")
    history = (
        models.four_dof()
        .coupler(0.05, coupling="pm")
        .run(steps=10, record={"A": [2, 0], "B": None})
    )
    frames = history.to_pandas()
    assert list(frames) == ["A", "B", "interface"]
    a = frames["A"]
    assert np.array_equal(a["u"].to_numpy(), history["A"].u) and list(a["v"].columns) == [2, 0]
    assert np.array_equal(a.index, history["A"].t) and a.index.name == "time"
    assert np.array_equal(a["a", 2].to_numpy(), history["A"].a[:, 0])
    jumps = frames["interface"]["velocity_jump"].to_numpy()
    assert np.array_equal(jumps, history.velocity_jump)
    springs = oscillation().to_pandas()
    assert np.array_equal(springs["force"].to_numpy(), oscillation().force)


def test_without_pandas_the_package_to_install_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'pmalpha\[pandas\]'"):
        oscillation().to_pandas()
