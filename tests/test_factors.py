"""Factors and their sweeps, compared with dense solutions and with each other."""

import ctypes
import pickle
import sys

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from drawn_matrices import definite_matrix
from reference_problems import random_problem

import pmalpha as pm
from pmalpha import _core, structures
from pmalpha.problem import forms
from pmalpha.problem.matrices import core_sparse, permuted
from pmalpha.problem.schemes import StepConstants
from pmalpha.reduction import ordering
from pmalpha.reduction.ordering import _nested_dissection as dissection
from pmalpha.reduction.ordering import (
    elimination_order,
    fill,
    graph_of,
    node_graph,
    node_size,
    with_full_nodes,
)
from pmalpha.setup import factors
from pmalpha.setup.factors import inertia
from pmalpha.setup.link import Link, compliance

DEFINITE = pm.FactorizationError


def ordered(A, nb):
    """A in the order in which it is factored, with the last nb dofs last."""
    n = A.shape[0]
    return permuted(A, elimination_order(n, graph_of([A]), np.arange(n - nb, n)))


def solve(factor, b, nb):
    """A^-1 b by a step of the core: with al2 = 1 and no stiffness, w1 = A^-1 F."""
    n, none = b.size, np.empty(0)
    link = forms.Columns(0, np.zeros(nb + 1, dtype=np.int64), np.empty(0, dtype=np.int32), none)
    single = forms.StepOperator(StepConstants(1.0, 0.0, 1.0, *[0.0] * 6, 1.0), *factor)
    s = _core.Subdomain({"n": n, "nb": nb, "substeps": 1, "single": single, "link": link})
    unit = forms.Factor(none, None)
    of_coupler = {"p": 0, "H_start": unit, "H": unit, "motions": (), "schedule": "fine"}
    coupler = _core.Coupler((s,), of_coupler | {"options": {"dt": 1.0}})
    zero = np.zeros(n)
    s.start(zero, zero, zero, none)
    s.set_load(b)
    coupler.start(0, none, none)
    assert coupler.advance(1, None) is None
    return s.state()[2]


def names(n, what="A"):
    return factors.Names(what, np.arange(n), "tower")


def by_panels(A, nb, what="A"):
    panels = forms.Supernodes(*_core.supernodes(*core_sparse(A)[:2], nb))
    structure = factors.Structure(A.nnz, panels)
    return factors.supernodal(A, names(A.shape[0], what), nb, structure)


def by_columns(A, nb, what="A"):
    return factors.supernodal(A, names(A.shape[0], what), nb, factors.Structure(A.nnz, None))


def dense(A, nb):
    return factors.factorize(A.toarray(), names(A.shape[0]), nb=nb)


FORMS = by_panels, by_columns, dense


def all_factors(A, nb):
    return [form(A, nb) for form in FORMS]


@pytest.mark.parametrize("seed", range(20))
def test_every_form_of_factor_solves_with_its_matrix(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 70))
    nb = int(rng.integers(0, n + 1))
    A = ordered(definite_matrix(rng, n, rng.choice([0.01, 0.05, 0.3])), nb)
    x = rng.normal(size=n)
    for factor in all_factors(A, nb):
        # the matrices have a condition number below 1e4
        np.testing.assert_allclose(solve(factor, A @ x, nb), x, rtol=0, atol=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_our_factors_solve_as_superlu_and_dense_cholesky_do(seed):
    rng = np.random.default_rng(seed)
    n, nb = int(rng.integers(400, 900)), int(rng.integers(0, 60))
    pieces = [definite_matrix(rng, m, 4.0 / m) for m in (n // 3, n - n // 3)]
    A = ordered(sp.csr_array(sp.block_diag(pieces)), nb)  # two blocks that are not connected
    b = rng.normal(size=n)
    by_superlu = sp.linalg.splu(sp.csc_array(A)).solve(b)
    by_cholesky = scipy.linalg.cho_solve(scipy.linalg.cho_factor(A.toarray()), b)
    for factor in (*all_factors(A, nb)[:2], factors.factorize(A, names(n), nb=nb)):
        x = solve(factor, b, nb)
        # rounding times a condition number below 1e5
        np.testing.assert_allclose(x, by_superlu, rtol=0, atol=1e-10 * np.max(np.abs(x)))
        np.testing.assert_allclose(x, by_cholesky, rtol=0, atol=1e-10 * np.max(np.abs(x)))


@pytest.mark.parametrize("seed", range(4))
def test_a_quasi_definite_matrix_is_refused_and_has_the_inertia_of_its_blocks(seed):
    # [[A, B], [B^T, -C]] with A, C positive definite has as many negative pivots as C has rows, in
    # every order (Vanderbei 1995)
    rng = np.random.default_rng(seed)
    m, k = int(rng.integers(1, 150)), int(rng.integers(1, 100))
    B = sp.random_array((m, k), density=0.05, rng=rng)
    A, C = definite_matrix(rng, m, 0.05), definite_matrix(rng, k, 0.05)
    whole = ordered(sp.csr_array(sp.block_array([[A, B], [B.T, -C]])), 0)
    for form in FORMS:
        with pytest.raises(DEFINITE, match="indefinite") as caught:
            form(whole, 0)
        assert caught.value.inertia == (k, 0, m)


def test_zeros_that_are_stored_on_one_side_and_double_entries_change_nothing():
    box = structures.solid(4, 4, 4, 0.25, E=1.0, nu=0.3, rho=1.0)
    K = sp.coo_array(box.K)
    rng = np.random.default_rng(0)
    rows, columns = rng.integers(0, box.n, (2, 3000))
    odd = sp.coo_array(
        (
            np.concatenate([0.5 * K.data, np.zeros(3000), 0.5 * K.data]),
            (
                np.concatenate([K.row, rows, K.row]),
                np.concatenate([K.col, columns, K.col]),
            ),
        ),
        shape=K.shape,
    )
    runs = []
    for stiffness in (box.K, odd, sp.csc_array(odd)):
        s = pm.Subdomain(box.M, stiffness, scheme=pm.Newmark(), force=np.ones(box.n))
        runs.append(pm.solve(s, dt=0.1, t_end=0.5).u)
    np.testing.assert_array_equal(runs[1], runs[0])
    np.testing.assert_array_equal(runs[2], runs[0])


@pytest.mark.parametrize("nb", [0, 36, 216])
def test_a_solid_has_the_same_solution_by_panels_and_by_columns(nb):
    A = ordered(cube(6), nb)
    b = np.cos(np.arange(216))
    *sparse, dense = (solve(f, b, nb) for f in all_factors(A, nb))
    for solution in sparse:
        np.testing.assert_allclose(
            solution, dense, atol=1e-14
        )  # rounding: condition number 20, size 1


@pytest.mark.parametrize("width", [1, 47, 48, 49, 255, 256, 257, 300])
def test_dense_panels_of_every_width_are_factored(width):
    # a full matrix is one supernode up to the widest, then two: the blocks of the dense columns
    rng = np.random.default_rng(width)
    A = rng.normal(size=(width, width))
    A = sp.csr_array(A @ A.T / width + np.eye(width))
    x = rng.normal(size=width)
    solution = solve(by_panels(A, 0), A @ x, 0)
    np.testing.assert_allclose(solution, x, atol=1e-12)


@pytest.mark.parametrize("seed", range(120, 126))
def test_random_coupled_problems_agree_with_the_reference_by_panels_too(seed, thresholds):
    thresholds(WIDE=0)
    problem = random_problem(seed)
    coupler = problem.coupler()
    expected = problem.reference(9, [part.double for part in coupler._session.members])
    history = coupler.run(steps=9)
    scale = max(np.max(np.abs(part.u)) for part in expected.subdomains)
    for i, part in enumerate(expected.subdomains):
        # as in test_against_reference
        assert np.max(np.abs(history[i].u - part.u)) <= 1e-9 * scale


@pytest.mark.parametrize("seed", range(10))
def test_the_interface_matrix_from_the_factors_is_that_of_the_core_for_unit_multipliers(seed):
    problem = random_problem(seed)
    coupler = problem.coupler()
    for part in coupler._session.members:
        rows = part.L.rows
        if part.is_diagonal or not rows.size:
            continue
        al2 = part.subdomain.scheme.coefficients(part.h)[1]
        ours = al2 * compliance(part.factors[0], part.L, part.nb, part.name).values
        theirs = part.core.compliance(False, rows)
        # the same sums in another order
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13)


def indefinite(n, where):
    """Positive definite but for one negative direction at a dof."""
    A = sp.lil_array(definite_matrix(np.random.default_rng(0), n, 0.1))
    A[where, where] = -3.0
    return sp.csr_array(A)


@pytest.mark.parametrize("where", [0, 17, 39])
def test_an_indefinite_matrix_is_refused_in_every_form(where):
    for form in FORMS:
        with pytest.raises(DEFINITE, match=f"^A is not positive definite.*dof {where}"):
            form(indefinite(40, where), 0)


def test_a_floating_matrix_is_refused_in_every_form():
    n = 30
    B = sp.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(n - 1, n))
    A = sp.csr_array(B.T @ B)  # by hand: the pivots are 1, ..., 1, 0
    for form in FORMS:
        with pytest.raises(DEFINITE, match="A is"):
            form(A, 0)


def test_the_count_of_entries_is_that_of_a_dense_elimination():
    rng = np.random.default_rng(3)
    for n in (1, 2, 9, 33):
        A = definite_matrix(rng, n, 0.1)
        ptr, index, _ = core_sparse(A)
        pattern = A.toarray() != 0.0
        for k in range(n):  # symbolic elimination, by hand
            below = np.flatnonzero(pattern[k + 1 :, k]) + k + 1
            pattern[np.ix_(below, below)] = True
        counts = [int(pattern[k + 1 :, k].sum()) for k in range(n)]
        np.testing.assert_array_equal(_core.count_factor(ptr, index), counts)
        assert fill(graph_of([A]), np.arange(n)) == n + sum(counts)


def test_an_order_has_the_interface_last_and_every_dof_once():
    rng = np.random.default_rng(5)
    for n in (1, 5, 40, 200):
        A = definite_matrix(rng, n, 0.03)
        last = np.sort(rng.choice(n, n // 3, replace=False))
        order = elimination_order(n, graph_of([A]), last)
        np.testing.assert_array_equal(np.sort(order), np.arange(n))
        np.testing.assert_array_equal(order[n - last.size :], last)


def test_a_factor_that_cannot_fit_is_refused_before_it_is_begun(monkeypatch, thresholds):
    monkeypatch.setattr("pmalpha.memory.available", lambda: 1000)
    thresholds(ALLOCATION=0)
    A = definite_matrix(np.random.default_rng(0), 400, 0.2)
    for attempt in (
        lambda: by_panels(A, 0, "Mbar"),
        lambda: by_columns(A, 0, "Mbar"),
    ):
        with pytest.raises(MemoryError, match="the factor of Mbar .400 dofs.*available"):
            attempt()


def test_a_structure_that_is_not_of_the_matrix_is_refused():
    A = definite_matrix(np.random.default_rng(1), 20, 0.2)
    ptr, index, values = core_sparse(A)
    eye = sp.eye_array(20, format="csr")
    structure = forms.Supernodes(*_core.supernodes(*core_sparse(eye)[:2], 0))
    panel_values, inverse = np.empty(structure.start[-1]), np.empty(20)
    with pytest.raises(ValueError, match="out of range"):
        pattern = forms.Numeric(ptr, index, structure, None, None, False)
        _core.factor_panels(pattern, values, panel_values, inverse, 0.0, 1e8, 2)


# ---- threads -------------------------------------------------------------------------------------


def factor_in_threads(A, threads, *, symmetric=True):
    return factors.factorize(
        A, names(A.shape[0]), nb=20, symmetric=symmetric, threads=threads, structure=None
    )


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_factor_is_bitwise_identical_for_any_number_of_threads(thresholds, symmetric):
    thresholds(FACTOR_SHARE=1.0)  # multiplications: all factors are shared
    A = sp.csr_array(cube(12))
    if not symmetric:
        A = sp.csr_array(A + 0.01 * sp.triu(A, k=1))
    inverse, panels = factor_in_threads(A, 1, symmetric=symmetric)
    assert len(panels) == 5
    for threads in (2, 3, 7):
        other, others = factor_in_threads(A, threads, symmetric=symmetric)
        np.testing.assert_array_equal(other, inverse)
        np.testing.assert_array_equal(others[4], panels[4])


def test_the_message_of_an_indefinite_matrix_is_that_of_one_thread(thresholds):
    thresholds(FACTOR_SHARE=1.0)
    A = sp.lil_array(cube(10))
    for dof in (900, 700, 800):
        A[dof, dof] = -1.0
    messages = set()
    for threads in (1, 2, 3):
        with pytest.raises(pm.FactorizationError, match="(dof|constraint) 700;") as error:
            factor_in_threads(sp.csr_array(A), threads)
        messages.add(str(error.value))
    assert len(messages) == 1


# ---- ordering ------------------------------------------------------------------------------------


def cube(nodes):
    """Graph Laplacian of a cube of nodes, 7 neighbours in all, shifted."""
    one, T = (
        sp.eye_array(nodes),
        sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(nodes,) * 2),
    )
    K = sp.kron(sp.kron(T, one), one) + sp.kron(sp.kron(one, T), one)
    return sp.csr_array(K + sp.kron(sp.kron(one, one), T))


def without_pymetis(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymetis", None)  # import raises ImportError


def test_a_graph_has_the_entries_of_all_matrices_and_of_their_transposes():
    rng = np.random.default_rng(8)
    for n in (1, 2, 7, 40):
        matrices = [sp.random_array((n, n), density=0.1, format="csr", rng=rng) for _ in range(3)]
        entries = sum((A != 0).toarray().astype(int) for A in matrices)
        adjacent = (entries + entries.T > 0) & ~np.eye(n, dtype=bool)
        assert rows_as_lists(graph_of(matrices)) == [list(np.flatnonzero(row)) for row in adjacent]


def test_the_graph_of_the_nodes_has_an_edge_where_dofs_of_two_nodes_have_one():
    A = sp.csr_array(sp.kron(cube(4), np.ones((3, 3))))
    nodes = node_graph(graph_of([A]), np.arange(189, 192))  # the last node is the interface
    assert rows_as_lists(nodes.graph) == rows_as_lists(graph_of([cube(4)]))
    np.testing.assert_array_equal(nodes.dofs, np.arange(192))
    np.testing.assert_array_equal(nodes.start, np.arange(0, 193, 3))
    assert nodes.border == 1


def rows_as_lists(graph):
    return [list(graph.index[i:j]) for i, j in zip(graph.ptr[:-1], graph.ptr[1:])]


def test_groups_outside_their_range_are_refused():
    ptr, index = np.array([0, 1]), np.zeros(1, np.int32)
    for group in (-1, 1):
        with pytest.raises(ValueError, match="group must lie in 0..groups-1"):
            _core.graph_of_groups(ptr, index, np.array([group], np.int32), 1)


@pytest.mark.parametrize("size", [1, 2, 3, 6])
@pytest.mark.parametrize("mesh", ["line", "square", "cube"])
def test_the_dofs_of_a_node_are_found_from_the_pattern(size, mesh):
    T = sp.diags_array([-1.0, 4.0, -1.0], offsets=[-1, 0, 1], shape=(12, 12))
    graph = {"line": T, "square": sp.kron(T, T), "cube": sp.kron(sp.kron(T, T), T)}[mesh]
    block = np.ones((size, size))
    assert node_size(graph_of([sp.csr_array(sp.kron(graph, block))])) == size


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_the_nodes_of_finite_elements_are_found_although_couplings_vanish(mass):
    material = dict(E=1.0, nu=0.3, rho=1.0, mass=mass)
    box = structures.solid(5, 6, 7, 0.1, **material)
    sheet = structures.plate(11, 7, 0.1, **material)  # 96 nodes: 2 and 3 and 6 divide its dofs
    assert node_size(graph_of([box.K])) == 3
    assert node_size(graph_of([sheet.K])) == 2


def test_the_dofs_of_a_node_share_supernodes_although_their_couplings_vanish():
    K = pm.structures.plate(40, 20, 1.0, E=1.0, nu=0.3, rho=1.0).K
    graph, last = graph_of([K]), np.arange(40)
    full = with_full_nodes(graph, last)
    A, edges = sp.csr_array(K != 0.0).toarray(), np.zeros((K.shape[0],) * 2, dtype=bool)
    edges[np.repeat(np.arange(full.n), np.diff(full.ptr)), full.index] = True
    twin = np.arange(full.n) ^ 1  # the other dof of the node
    np.fill_diagonal(A, False)
    assert not A[np.arange(40, full.n), twin[40:]].all()
    A[np.arange(full.n), twin] = True
    assert np.array_equal(edges, A)
    order = elimination_order(graph.n, graph, last)
    first = _core.supernodes(*ordering.rows_of(full, order), last.size)[0]
    assert np.median(np.diff(first)) >= 2.0
    # interface dofs stay apart from the others of their node
    odd = with_full_nodes(graph, np.arange(1, 40, 2))
    assert odd.index.size < full.index.size


def test_dofs_of_a_node_are_adjacent_and_in_order():
    rng = np.random.default_rng(7)
    A = sp.csr_array(sp.kron(cube(6), np.ones((3, 3))))
    last = np.sort(rng.choice(648, 50, replace=False))  # some nodes are cut by the interface
    order = elimination_order(648, graph_of([A]), last)
    interior, border = order[:-50], order[-50:]
    np.testing.assert_array_equal(np.sort(order), np.arange(648))
    np.testing.assert_array_equal(border, last)
    node = interior // 3
    visits = np.flatnonzero(np.diff(node, prepend=-1))
    assert np.unique(node[visits]).size == visits.size
    assert np.all(np.diff(interior)[np.diff(node) == 0] > 0)


@pytest.mark.parametrize("nodes_of_interface", [0, 81, 200])
def test_the_chosen_order_has_the_least_fill_of_all_candidates(nodes_of_interface):
    pytest.importorskip("pymetis")
    A = cube(9)
    n, nb = 729, nodes_of_interface
    last = np.arange(n - nb, n)
    pattern = graph_of([A])
    inner = ordering._leading(pattern, n - nb)
    fills = [
        fill(pattern, np.concatenate([order, last]))
        for order in (np.arange(n - nb), ordering._minimum_degree(inner), dissection(inner))
    ]
    # a postorder changes no fill
    assert fill(pattern, elimination_order(n, graph_of([A]), last)) == min(fills)


@pytest.mark.gate
def test_nested_dissection_halves_the_factor_of_a_solid(monkeypatch):
    pytest.importorskip("pymetis")
    box = structures.solid(11, 11, 11, 0.1, E=1.0, nu=0.3, rho=1.0)
    face = box.dofs(box.nodes(lambda x, y, z: x < 1e-9))
    with_metis = fill(graph_of([box.K]), elimination_order(box.n, graph_of([box.K]), face))
    without_pymetis(monkeypatch)
    without = fill(graph_of([box.K]), elimination_order(box.n, graph_of([box.K]), face))
    # 2/3 of minimum degree, and that 2/3 of the natural order, when this was written
    assert with_metis < 0.9 * without
    assert without < 0.9 * fill(graph_of([box.K]), np.concatenate([np.arange(432, box.n), face]))


def test_without_pymetis_the_order_is_that_of_minimum_degree(monkeypatch):
    without_pymetis(monkeypatch)
    A = cube(9)
    assert dissection(graph_of([A])) is None
    degree = ordering._minimum_degree(graph_of([A]))
    order = elimination_order(729, graph_of([A]), np.arange(0))
    assert fill(graph_of([A]), order) == fill(graph_of([A]), degree)


def test_the_order_is_the_same_every_time_whatever_the_random_state():
    A = cube(10)
    first = elimination_order(1000, graph_of([A]), np.arange(0))
    ctypes.CDLL(None).srand(12345)  # METIS draws from the C library
    np.testing.assert_array_equal(elimination_order(1000, graph_of([A]), np.arange(0)), first)


def test_nothing_is_ordered_without_an_error():
    assert elimination_order(0, graph_of([sp.csr_array((0, 0))]), np.arange(0)).size == 0


def test_a_chain_keeps_its_natural_order():
    T = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(500, 500))
    np.testing.assert_array_equal(
        elimination_order(500, graph_of([sp.csr_array(T)]), np.array([499])), np.arange(500)
    )


@pytest.mark.parametrize(
    "last",
    [np.arange(0), np.arange(300), np.arange(1, 300), np.arange(0, 300, 2)],
    ids=["none", "all", "all but one", "every second"],
)
def test_interiors_empty_small_or_in_pieces_are_ordered(last):
    rng = np.random.default_rng(2)
    ring = sp.csr_array(sp.eye_array(300) + sp.eye_array(300, k=1) + sp.eye_array(300, k=-1))
    for A in (definite_matrix(rng, 300, 0.05), ring, sp.csr_array(np.ones((300, 300)))):
        order = elimination_order(300, graph_of([A]), last)
        np.testing.assert_array_equal(np.sort(order), np.arange(300))
        np.testing.assert_array_equal(order[300 - last.size :], last)


def test_an_order_needs_no_symmetric_pattern_and_no_diagonal():
    # a graph on which METIS would neither return (unsymmetric) nor survive (loops)
    upper = sp.csr_array(sp.triu(cube(9), k=1))
    loops = sp.csr_array(cube(9) + sp.eye_array(729))
    expected = elimination_order(729, graph_of([cube(9)]), np.arange(0))
    for A in (upper, loops, sp.csr_array(upper.T)):
        np.testing.assert_array_equal(elimination_order(729, graph_of([A]), np.arange(0)), expected)


# ---- what is refused, with its inertia -----------------------------------------------------------


def with_signs(rng, signs, density):
    """A matrix of known inertia: L D L^T with the signs on D, by Sylvester's law."""
    n = signs.size
    lower = sp.tril(sp.random_array((n, n), density=density, rng=rng), k=-1) + sp.eye_array(n)
    return sp.csr_array(lower @ sp.diags_array(signs * rng.uniform(0.5, 2.0, n)) @ lower.T)


@pytest.mark.parametrize(
    "seed, n, density",
    [(0, 1, 0.0), (1, 1, 0.0), *((k, 30, 0.2) for k in range(4)), (0, 199, 0.02), (1, 400, 0.003)],
)
def test_the_inertia_is_that_of_the_signs_the_matrix_was_made_with(seed, n, density):
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 0.0, 1.0], n)
    expected = tuple(int(np.sum(signs == s)) for s in (-1.0, 0.0, 1.0))
    A = with_signs(rng, signs, density)
    scale = sp.diags_array(10.0 ** rng.uniform(-4, 4, n))  # other units change no sign
    assert inertia(A, n) == expected
    assert inertia(sp.csr_array(scale @ A @ scale), n) == expected
    assert inertia(A.toarray(), n) == expected


def test_the_inertia_of_diagonal_and_empty_matrices_is_counted_directly():
    assert inertia(np.array([-1e-300, 0.0, 0.0, 1e300, 2.0]), 5) == (1, 2, 2)
    assert inertia(None, 4) == (0, 4, 0)


def test_an_inertia_that_would_take_a_large_factor_is_not_counted(thresholds):
    thresholds(FACTOR_ENTRIES=45_000)
    few, wide = (sp.csr_array(np.ones((n, n))) for n in (299, 300))  # 44 850, 45 150 entries
    assert inertia(few, 299) is not None
    assert inertia(wide, 300) is None
    thresholds(FEW_DENSE=299)
    assert inertia(np.ones((299, 299)), 299) is not None
    assert inertia(np.ones((300, 300)), 300) is None
    error = names(300, "Mbar").not_definite(wide, 7)
    assert "singular or indefinite" in str(error) and "would take too long" in str(error)
    assert (error.subdomain, error.dof, error.inertia) == ("tower", 7, None)


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse", "panels"])
def test_the_error_for_an_indefinite_subdomain_has_dof_and_inertia(form, thresholds):
    thresholds(WIDE=0 if form == "panels" else 24)
    K = sp.lil_array(4.0 * sp.eye_array(40) - sp.eye_array(40, k=1) - sp.eye_array(40, k=-1))
    if form == "diagonal":
        K = sp.lil_array(sp.eye_array(40))
    K[30, 30] = K[7, 7] = -5e4
    K = {"diagonal": K.diagonal(), "dense": K.toarray()}.get(form, sp.csr_array(K))
    good = pm.Subdomain(np.ones(2), np.ones(2), scheme=pm.Newmark())
    bad = pm.Subdomain(np.ones(40), K, scheme=pm.Newmark(), name="bad")
    with pytest.raises(DEFINITE, match="'bad'.*indefinite.*pivots: 2 neg.*0 zero, 38") as caught:
        pm.Coupler([good, bad], pm.tie(good, [0], bad, [20]), dt=0.1, coupling="pm")
    error = caught.value
    assert error.subdomain == "bad" and error.dof in (7, 30) and error.inertia == (2, 0, 38)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) and again.inertia == error.inertia


def test_a_floating_subdomain_is_reported_as_singular_with_one_zero_pivot():
    K = sp.csr_array(sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(50, 50)))
    K[[0, 49], [0, 49]] = 1.0
    bad = pm.Subdomain(np.zeros(50), K, scheme=pm.GeneralizedAlpha(0.5), name="bad")
    with pytest.raises(DEFINITE, match="singular, first seen at dof.*0 neg.*1 zero, 49 pos"):
        pm.Coupler([bad], dt=0.1)


def test_the_factor_of_the_mass_is_released_after_the_start_and_kept_after_a_reset():
    box = structures.plate(6, 6, 0.1, E=1.0, nu=0.3, rho=1.0)
    s = box.subdomain(scheme=pm.Newmark(), force=np.ones(box.n))
    coupler = pm.Coupler([s], dt=0.01)
    first = coupler.run(steps=3)[0].u
    assert coupler._session.accelerations is None
    for _ in range(2):
        coupler.reset()
        assert coupler._session.accelerations is not None
        np.testing.assert_array_equal(coupler.run(steps=3)[0].u, first)


def test_mbar_of_both_steps_and_the_mass_share_one_structure():
    a, b = (structures.solid(5, 5, 5, 0.2, E=1.0, nu=0.3, rho=1.0) for _ in range(2))
    face = a.dofs(a.nodes(lambda x, y, z: x < 1e-9))
    first = a.subdomain(scheme=pm.GeneralizedAlpha(0.5))
    second = b.subdomain(scheme=pm.GeneralizedAlpha(0.5), substeps=2)
    coupler = pm.Coupler([first, second], pm.tie(first, face, second, face), dt=0.1, coupling="pm")
    part = coupler._session.members[0]
    single, twice = (factor[1] for factor in part.factors)
    for k in range(4):  # first, row_ptr, rows, start
        assert single[k] is twice[k] is part.elimination.structure.panels[k]


@pytest.mark.parametrize("rows", [1, 5, 12, 30])
def test_the_compliance_is_that_of_the_dense_inverse_for_few_and_many_constraints(rows):
    rng = np.random.default_rng(rows)
    n, nb = 60, 20  # up to a third of nb by solutions, beyond by S^-1 as a whole
    A = ordered(definite_matrix(rng, n, 0.05), nb)
    L = np.zeros((rows, n))
    L[:, n - nb :] = rng.normal(size=(rows, nb))
    exact = L @ np.linalg.inv(A.toarray()) @ L.T
    for factor in all_factors(A, nb):
        ours = compliance(factor, Link.of(sp.csc_array(L)), nb, "tower")
        # the matrices have a condition number below 1e4
        np.testing.assert_allclose(ours.values, exact, rtol=0, atol=1e-11 * np.max(np.abs(exact)))


def test_an_interface_of_implicit_subdomains_that_does_not_fit_is_refused_with_the_figure(
    monkeypatch,
    thresholds,
):
    boxes = [structures.solid(1, 12, 12, 0.1, E=1.0, nu=0.3, rho=1.0) for _ in range(2)]
    face = boxes[0].dofs(boxes[0].nodes(lambda x, y, z: x < 1e-9))  # p = 507
    a, b = (s.subdomain(scheme=pm.GeneralizedAlpha(0.5)) for s in boxes)
    coupling = pm.tie(a, face, b, face)
    monkeypatch.setattr("pmalpha.memory.available", lambda: 7_000_000)
    thresholds(ALLOCATION=0)
    with pytest.raises(MemoryError, match="interface matrix of 507 constraints.*MB.*available"):
        pm.Coupler([a, b], coupling, dt=0.1, coupling="pm")


@pytest.mark.parametrize("rows", [[2, 0, 3, 1], [2, 0, 2, 1], [0, 0, 0, 0]])
def test_constraints_of_one_entry_are_multiplied_like_any(rows):
    rng = np.random.default_rng(len(set(rows)))
    values = np.array([1.0, -1.0, 0.5, 2.0])
    L = Link.of(sp.csc_array((values, (2 * np.array(rows), [3, 4, 5, 6])), shape=(8, 7)))
    X = rng.normal(size=(4, 3)) * [1.0, 0.0, -0.0]  # of the last four dofs
    expected = L.sparse(4) @ X
    assert L.times(X).tobytes() == expected.tobytes()
    np.testing.assert_allclose(expected, L.dense(4) @ X, rtol=1e-15, atol=1e-15)
