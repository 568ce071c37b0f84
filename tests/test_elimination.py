"""The elimination of subdomains whose interface covers much: shared, and the same in any form."""

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures
from pmalpha.reduction.ordering import graph_of
from pmalpha.setup.factors import Eliminations, elimination


def box(faces):
    """A cube of 6 x 6 x 6 nodes and the dofs on this number of its faces."""
    s = structures.solid(5, 5, 5, 0.2, E=100.0, nu=0.3, rho=1.0)
    x = s.points
    sides = [np.abs(x[:, k // 2] - k % 2) < 1e-9 for k in range(6)]
    return s, np.sort(s.dofs(np.flatnonzero(np.logical_or.reduce(sides[:faces]))))


def test_subdomains_with_the_same_graph_and_interface_share_their_elimination():
    s, dofs = box(2)
    stiffer = structures.solid(5, 5, 5, 0.2, E=200.0, nu=0.3, rho=1.0)
    other = structures.solid(2, 7, 8, 0.2, E=100.0, nu=0.3, rho=1.0)  # as many dofs
    known, graph = Eliminations(), graph_of([s.M, s.K])
    first = known.of(s.n, graph, dofs)
    np.testing.assert_array_equal(first.order, elimination(s.n, graph, dofs).order)
    assert known.of(s.n, graph_of([stiffer.M, stiffer.K]), dofs.copy()) is first
    others = [
        known.of(s.n, graph, dofs[1:]),
        known.of(s.n, None, dofs),
        known.of(other.n, graph_of([other.M, other.K]), dofs),
    ]
    assert len({id(x) for x in (first, *others)}) == 4
    np.testing.assert_array_equal(others[0].order[1 - dofs.size :], dofs[1:])


def enclosed(**options):
    """A cube with all its surface tied to a frame of points, in double steps and with mass."""
    s, dofs = box(6)
    inner = s.subdomain(scheme=pm.GeneralizedAlpha(0.5), force=np.ones(s.n), name="inner")
    shell = pm.Subdomain(
        np.full(dofs.size, 1e-3),
        np.full(dofs.size, 1e-2),
        scheme=pm.GeneralizedAlpha(0.5, explicit=True),
        substeps=4,
        name="shell",
    )
    return pm.Coupler(
        [inner, shell],
        pm.tie(inner, dofs, shell, np.arange(dofs.size)),
        dt=0.05,
        coupling="pm",
        **options,
    )


@pytest.mark.gate
def test_a_solid_tied_on_all_sides_moves_as_with_factors_in_columns(thresholds):
    ours = enclosed().run(steps=6)
    thresholds(WIDE=10**9)
    theirs = enclosed().run(steps=6)
    for name in ("inner", "shell"):
        for x in "uva":
            mine, other = getattr(ours[name], x), getattr(theirs[name], x)
            # rounding is magnified by the condition number of Mbar and H, 1e4 here
            assert np.max(np.abs(mine - other)) <= 1e-10 * np.max(np.abs(other))


@pytest.mark.filterwarnings("ignore:.* is floating")  # two means do not hold a cube
def test_macro_coupling_on_all_sides_moves_as_with_factors_in_columns(thresholds):
    ours = enclosed_finely().run(steps=4)[0].u
    thresholds(WIDE=10**9)
    theirs = enclosed_finely().run(steps=4)[0].u
    # rounding is magnified by the condition number of Mbar and H, 1e4 here
    assert np.max(np.abs(ours - theirs)) <= 1e-10 * np.max(np.abs(theirs))


def enclosed_finely():
    """The cube has substeps and two constraints on all its surface: unit responses."""
    s, dofs = box(6)
    inner = s.subdomain(scheme=pm.GeneralizedAlpha(0.5), substeps=2, force=np.ones(s.n))
    outer = pm.Subdomain(np.ones(2), np.ones(2), scheme=pm.GeneralizedAlpha(0.5))
    mean = np.full(dofs.size, 1.0 / dofs.size)
    L = sp.csr_array((mean, (np.arange(dofs.size) % 2, dofs)), shape=(2, s.n))
    tied = pm.Constraint({inner: L, outer: -np.eye(2)})
    return pm.Coupler([inner, outer], tied, dt=0.05, coupling="macro")


@pytest.mark.gate
def test_an_enclosed_solid_runs_the_same_in_intervals_and_with_any_threads(tmp_path):
    whole = enclosed(threads=1).run(steps=6)[0].u[-1]
    pieces = enclosed(threads=2)
    pieces.step(2)
    pieces.save(tmp_path / "half.npz")
    resumed = enclosed()
    resumed.load(tmp_path / "half.npz")
    resumed.step(4)
    pieces.step(4)
    np.testing.assert_array_equal(pieces.state(0).u, whole)
    np.testing.assert_array_equal(resumed.state(0).u, whole)


@pytest.mark.filterwarnings("ignore:.* is floating")  # one sum does not hold a cube
def test_an_indefinite_matrix_in_panels_names_the_dof_of_the_user():
    s, dofs = box(6)
    K = sp.lil_array(s.K)
    K[300, 300] = -1e9
    bad = pm.Subdomain(s.M, sp.csr_array(K), scheme=pm.Newmark(), name="bad")
    L = sp.csr_array((np.ones(dofs.size), (np.zeros(dofs.size), dofs)), shape=(1, s.n))
    with pytest.raises(pm.FactorizationError, match="'bad'.*dof 300; pivots: 1 negative") as caught:
        pm.Coupler([bad], pm.Constraint({bad: L}), dt=0.1)
    assert caught.value.dof == 300
