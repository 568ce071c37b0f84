"""The interface anywhere in the elimination order: the same results, and the choice of order."""

import numpy as np
import pytest
import scipy.sparse as sp
from drawn_matrices import compliance_problem, definite_matrix
from problems import random_problem

import pmalpha as pm
from pmalpha import structures
from pmalpha.problem.matrices import permuted
from pmalpha.problem.ordering import elimination_order, graph_of, rows_of
from pmalpha.setup import factors
from pmalpha.setup.elimination import Elimination, Eliminations, elimination, ordinary
from pmalpha.setup.factors import structure_of
from pmalpha.setup.paths import compliance_along_paths


def always_ordinary(n, graph, last):
    taken = None if graph is None else ordinary(graph, last)
    return elimination(n, graph, last) if taken is None else taken


def always_last(n, graph, last):
    order = elimination_order(n, graph, last)
    structure = None if graph is None else structure_of(*rows_of(graph, order), last.size)
    return Elimination(order, last.size, structure)


@pytest.mark.parametrize("seed", range(60))
def test_random_coupled_problems_agree_with_the_reference_along_paths(seed, monkeypatch):
    monkeypatch.setattr(factors, "WIDE", 0)
    monkeypatch.setattr("pmalpha.setup.elimination.elimination", always_ordinary)
    problem = random_problem(seed)
    coupler = problem.coupler()
    expected = problem.reference(9, [part.double for part in coupler._session.parts])
    history = coupler.run(steps=9)
    scale = max(np.max(np.abs(part.u)) for part in expected.subdomains)
    for i, part in enumerate(expected.subdomains):
        # as in test_against_reference
        assert np.max(np.abs(history[i].u - part.u)) <= 1e-9 * scale
    force = np.max(np.abs(expected.multipliers))
    inertia = max(
        np.max(np.abs(x.w @ p.M)) for x, p in zip(expected.subdomains, problem.subdomains)
    )
    difference = np.max(np.abs(history.multipliers - expected.multipliers))
    assert difference <= 1e-9 * max(force, inertia)


def test_random_problems_do_take_paths(monkeypatch):
    monkeypatch.setattr(factors, "WIDE", 0)
    monkeypatch.setattr("pmalpha.setup.elimination.elimination", always_ordinary)
    parts = [part for seed in range(60) for part in random_problem(seed).coupler()._session.parts]
    # two thirds of the matrices are drawn sparse or diagonal, most subdomains have an interface
    assert sum(part.elimination.paths is not None for part in parts) > 30


@pytest.mark.parametrize("seed", range(30))
def test_the_compliance_along_paths_is_that_of_the_dense_inverse(seed, monkeypatch):
    monkeypatch.setattr(factors, "WIDE", 0)
    monkeypatch.setattr("pmalpha.setup.paths.BLOCK", 7)
    rng = np.random.default_rng(seed)
    A, last, L, exact = compliance_problem(rng, definite_matrix, [0.005, 0.02, 0.1])
    chosen = ordinary(graph_of([A]), last)
    if chosen is None:
        pytest.skip("the matrix came out diagonal")
    np.testing.assert_array_equal(chosen.order[-last.size :], last)
    names = factors.Names("A", chosen.order)
    factor = chosen.factor(permuted(A, chosen.order), names)
    ours = compliance_along_paths(factor, sp.csr_array(L))
    # the matrices have a condition number below 1e4
    np.testing.assert_allclose(ours, exact, rtol=0, atol=1e-11 * np.max(np.abs(exact)))


def box(faces):
    """A cube of 9 x 9 x 9 nodes and the dofs on this number of its faces."""
    s = structures.solid(8, 8, 8, 0.125, E=100.0, nu=0.3, rho=1.0)
    x = s.points
    sides = [np.abs(x[:, k // 2] - k % 2) < 1e-9 for k in range(6)]
    return s, np.sort(s.dofs(np.flatnonzero(np.logical_or.reduce(sides[:faces]))))


@pytest.mark.parametrize("faces, paths", [(1, False), (2, False), (6, True)])
def test_the_order_that_sweeps_fewer_entries_is_used(faces, paths):
    s, dofs = box(faces)
    graph = graph_of([s.M, s.K])
    chosen = elimination(s.n, graph, dofs)
    assert (chosen.paths is not None) == paths
    assert chosen.swept <= ordinary(graph, dofs).swept
    assert chosen.swept <= always_last(s.n, graph, dofs).swept
    np.testing.assert_array_equal(chosen.order[-dofs.size :], dofs)
    again = elimination(s.n, graph, dofs)  # a function of the problem alone
    np.testing.assert_array_equal(chosen.order, again.order)


def test_subdomains_with_the_same_graph_and_interface_share_their_elimination():
    s, dofs = box(2)
    stiffer = structures.solid(8, 8, 8, 0.125, E=200.0, nu=0.3, rho=1.0)
    other = structures.solid(2, 8, 26, 0.125, E=100.0, nu=0.3, rho=1.0)  # as many dofs
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


def enclosed(threads=None):
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
        threads=threads,
    )


def test_a_solid_tied_on_all_sides_moves_as_with_the_interface_last(monkeypatch):
    ours = enclosed()
    assert ours._session.parts[0].elimination.paths is not None
    history = ours.run(steps=6)
    monkeypatch.setattr("pmalpha.setup.elimination.elimination", always_last)
    theirs = enclosed()
    assert theirs._session.parts[0].elimination.paths is None
    expected = theirs.run(steps=6)
    for name in ("inner", "shell"):
        for x in "uva":
            mine, other = getattr(history[name], x), getattr(expected[name], x)
            # rounding is magnified by the condition number of Mbar and H, 1e4 here
            assert np.max(np.abs(mine - other)) <= 1e-10 * np.max(np.abs(other))
    # and as with SuperLU, which has neither panels nor paths
    monkeypatch.setattr(factors, "WIDE", 10**9)
    superlu = enclosed().run(steps=6)
    assert np.max(np.abs(history[0].u - superlu[0].u)) <= 1e-10 * np.max(np.abs(superlu[0].u))


@pytest.mark.filterwarnings("ignore:.* is floating")  # two means do not hold a cube
def test_macro_coupling_along_paths_moves_as_with_the_interface_last(monkeypatch):
    whole = enclosed_finely()
    assert whole._session.parts[0].elimination.paths is not None
    ours = whole.run(steps=4)[0].u
    monkeypatch.setattr("pmalpha.setup.elimination.elimination", always_last)
    theirs = enclosed_finely().run(steps=4)[0].u
    # rounding is magnified by the condition number of Mbar and H, 1e4 here
    assert np.max(np.abs(ours - theirs)) <= 1e-10 * np.max(np.abs(theirs))


def enclosed_finely():
    """The cube has substeps and two constraints on all its surface: unit responses along paths."""
    s, dofs = box(6)
    inner = s.subdomain(scheme=pm.GeneralizedAlpha(0.5), substeps=2, force=np.ones(s.n))
    outer = pm.Subdomain(np.ones(2), np.ones(2), scheme=pm.GeneralizedAlpha(0.5))
    mean = np.full(dofs.size, 1.0 / dofs.size)
    L = sp.csr_array((mean, (np.arange(dofs.size) % 2, dofs)), shape=(2, s.n))
    tied = pm.Constraint({inner: L, outer: -np.eye(2)})
    return pm.Coupler([inner, outer], tied, dt=0.05, coupling="macro")


def test_a_run_along_paths_is_the_same_in_intervals_and_for_any_number_of_threads(tmp_path):
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
def test_an_indefinite_matrix_along_paths_names_the_dof_of_the_user():
    s, dofs = box(6)
    K = sp.lil_array(s.K)
    K[700, 700] = -1e9
    bad = pm.Subdomain(s.M, sp.csr_array(K), scheme=pm.Newmark(), name="bad")
    L = sp.csr_array((np.ones(dofs.size), (np.zeros(dofs.size), dofs)), shape=(1, s.n))
    with pytest.raises(pm.FactorizationError, match="'bad'.*dof 700; pivots: 1 negative") as caught:
        pm.Coupler([bad], pm.Constraint({bad: L}), dt=0.1)
    assert caught.value.dof == 700
