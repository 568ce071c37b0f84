"""Meshes and motions as objects of pyvista, which is optional."""

import sys

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import structures


def cut_box():
    box = structures.solid(3, 1, 1, 0.5, E=1.0, nu=0.3, rho=1.0)
    v0 = np.tile([0.0, 0.0, 1.0], len(box.points))
    parts = pm.cut(box, [3, 3, 7], v0=v0)
    return box, parts, parts.coupler(dt=0.1, coupling="gc").run(steps=4)


def test_without_pyvista_the_error_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    box, parts, history = cut_box()
    for make in (
        box.to_pyvista,
        parts.to_pyvista,
        lambda: history.to_pyvista(parts),
        lambda: parts.gather(history).to_pyvista(box),
    ):
        with pytest.raises(ImportError, match="to_pyvista needs pyvista: pip install pyvista"):
            make()


def test_the_grid_has_the_mesh_and_the_motion():
    pyvista = pytest.importorskip("pyvista")
    box, parts, history = cut_box()
    motion = parts.gather(history)
    rest = box.to_pyvista()
    assert isinstance(rest, pyvista.UnstructuredGrid)
    assert rest.n_cells == 3 and rest.volume == pytest.approx(3 * 0.5**3)
    assert not rest.point_data.keys()
    # a body that moves as a whole: u = t in z
    for grid in (motion.to_pyvista(box, 0.21), history.to_pyvista(parts, 0.21)):
        np.testing.assert_allclose(grid.point_data["displacement"][:, 2], 0.2, atol=1e-13)
        np.testing.assert_array_equal(grid.points, box.points)
        assert grid.field_data["time"][0] == motion.t[2]
    assert parts.to_pyvista().cell_data["part"].tolist() == [0, 0, 1]
    moved = box.to_pyvista(motion.u[-1]).warp_by_vector("displacement")
    np.testing.assert_allclose(moved.points[:, 2] - box.points[:, 2], 0.4, atol=1e-13)
    with pytest.raises(ValueError, match=r"t must lie in \[0, 0.4\], got 1.0"):
        motion.to_pyvista(box, 1.0)


def test_supports_of_a_structure_are_at_rest():
    pytest.importorskip("pyvista")
    box = structures.solid(1, 1, 1, 0.5, E=1.0, nu=0.3, rho=1.0)
    held = box.subdomain(scheme=pm.Newmark(), fixed=box.dofs([0, 1]), v0=np.ones(18))
    motion = pm.solve(held, dt=0.01, t_end=0.05)
    grid = motion.to_pyvista(box)
    expected = np.concatenate([np.zeros(6), motion.u[-1]])
    np.testing.assert_array_equal(grid.point_data["displacement"].ravel(), expected)


def test_kinds_of_one_structure_are_cells_of_their_own():
    pyvista = pytest.importorskip("pyvista")
    frame = structures.beam_frame([[0, 0], [0, 3]], [[0, 1]], EA=1.0, EI=1.0, rhoA=1.0)
    grid = frame.to_pyvista(np.arange(float(frame.n)))
    assert set(grid.celltypes) == {pyvista.CellType.LINE}
    np.testing.assert_array_equal(grid.point_data["displacement"][1], [3.0, 4.0, 0.0])
