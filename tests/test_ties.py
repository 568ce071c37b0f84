"""Ties found from the coordinates of nodes: complete, independent, and exact for linear fields."""

import time

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import interpolate, reduce, tie_coincident

SCHEME = pm.GeneralizedAlpha(0.5)
MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}


def masses(n, name=None):
    """A subdomain of n unit masses on unit springs: ties need only its dofs."""
    return pm.Subdomain(np.ones(n), np.ones(n), scheme=SCHEME, name=name)


def grid(*axes):
    """Points of a grid, the first axis running slowest."""
    return np.stack(np.meshgrid(*map(np.asarray, axes), indexing="ij"), axis=-1).reshape(
        -1, len(axes)
    )


def quads(nx, ny):
    """Elements, numbered around, of a grid of nx x ny nodes."""
    i = np.arange(nx * ny).reshape(nx, ny)
    return np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)


def line(n):
    return np.column_stack([np.arange(n - 1), np.arange(1, n)])


def dense(constraint, *subdomains):
    return np.hstack([constraint.matrices[s].toarray() for s in subdomains])


def require_full_rank(constraint, *subdomains):
    """By the singular values, and by the Coupler, which refuses dependent rows."""
    assert np.linalg.matrix_rank(dense(constraint, *subdomains)) == constraint.p
    pm.Coupler(subdomains, constraint, dt=0.1, coupling="pm")


# ---- matching interfaces: the ties ------------------------------------------------------------


def test_the_rows_are_those_of_a_tie_by_hand():
    a, b = masses(8, "a"), masses(6, "b")
    left = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    right = [[2.0, 1.0], [1.0, 1.0], [1.0, 0.0]]
    by_place = tie_coincident({a: left, b: right}, components=2)
    # node 1 of a meets node 2 of b, node 3 node 1
    by_hand = pm.tie(a, [2, 3, 6, 7], b, [4, 5, 2, 3])
    for s in (a, b):
        np.testing.assert_array_equal(by_place.matrices[s].toarray(), by_hand.matrices[s].toarray())


def test_four_squares_are_tied_without_redundancy_at_their_common_corner():
    x = np.linspace(0.0, 1.0, 4)
    subdomains = {masses(32, f"{i}{j}"): grid(x + i, x + j) for i in range(2) for j in range(2)}
    tied = tie_coincident(subdomains, components=2)
    # four edges of three nodes of two squares each, and the corner of four: 3 rows; 2 components
    assert tied.p == 2 * (4 * 3 + 3)
    require_full_rank(tied, *subdomains)
    # 7 x 7 different places: the constraints leave as many free motions as the whole has dofs
    assert 4 * 32 - tied.p == 2 * 49
    whole = np.concatenate(
        [np.sin(points @ [[2.0, 1.0], [1.0, 3.0]]).ravel() for points in subdomains.values()]
    )
    # one subtraction of sines whose arguments differ in the last bits
    assert np.abs(dense(tied, *subdomains) @ whole).max() < 1e-14


def test_rows_go_by_the_earlier_subdomain_then_its_node_then_the_later_one():
    a, b, c = masses(4, "a"), masses(4, "b"), masses(2, "c")
    # b and c meet at 5; a, b and c at 9; a and b at 7
    points = {a: [9.0, 7.0, 0.0, 1.0], b: [5.0, 7.0, 9.0, 20.0], c: [9.0, 5.0]}
    tied = tie_coincident(points)
    expected = np.zeros((4, 10))
    for row, (plus, minus) in enumerate([(0, 4 + 2), (0, 8 + 0), (1, 4 + 1), (4 + 0, 8 + 1)]):
        expected[row, plus], expected[row, minus] = 1.0, -1.0
    np.testing.assert_array_equal(dense(tied, a, b, c), expected)


def test_the_first_subdomain_is_on_the_plus_side():
    a, b = masses(2), masses(2)
    points = {b: [1.0, 2.0], a: [0.0, 1.0]}
    assert dense(tie_coincident(points), b, a).tolist() == [[1.0, 0.0, 0.0, -1.0]]


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_points_of_every_dimension_are_accepted(dimension):
    a, b = masses(2), masses(2)
    points = np.zeros((3, dimension))
    points[:, -1] = [0.0, 1.0, 2.0]
    assert tie_coincident({a: points[:2], b: points[1:]}).p == 1


def test_points_on_a_line_may_be_1d():
    a, b = masses(2), masses(2)
    assert tie_coincident({a: [0.0, 1.0], b: [[1.0], [2.0]]}).p == 1


def test_a_frame_and_a_plate_share_the_components_both_have():
    frame, plate = masses(3 * 2, "frame"), masses(2 * 3, "plate")
    points = {frame: [[0.0, 1.0], [0.0, 0.0]], plate: [[1.0, 0.0], [0.0, 0.0], [1.0, 1.0]]}
    tied = tie_coincident(points, components=2, dofs_per_node={frame: 3, plate: 2})
    # node 1 of the frame: dofs 3, 4; node 1 of the plate: dofs 2, 3
    assert tied.matrices[frame].nonzero()[1].tolist() == [3, 4]
    assert tied.matrices[plate].nonzero()[1].tolist() == [2, 3]


def test_only_the_first_components_are_tied():
    a, b = masses(9), masses(9)
    tied = tie_coincident({a: [0.0, 1.0, 2.0], b: [2.0, 3.0, 4.0]}, components=1, dofs_per_node=3)
    assert tied.matrices[a].nonzero()[1].tolist() == [6]
    assert tied.matrices[b].nonzero()[1].tolist() == [0]


# ---- matching interfaces: the tolerance -------------------------------------------------------


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_the_default_tolerance_is_independent_of_units(unit):
    points = grid(np.linspace(0.0, 1.0, 5), [0.0, 0.5])
    noise = np.random.default_rng(1).uniform(-1.0, 1.0, points.shape)
    for size, tied in ((0.006, 10), (0.03, 0)):  # of 0.25: a tolerance of 0.0025
        a, b = masses(10), masses(10)
        # noise / |noise|: each node off by exactly size * 0.25
        off = 0.25 * size * noise / np.linalg.norm(noise, axis=1, keepdims=True)
        sides = {a: unit * points, b: unit * (points + off)}
        if tied:
            assert tie_coincident(sides).p == tied
        else:
            with pytest.raises(ValueError, match="smallest distance to another is"):
                tie_coincident(sides)


def test_nodes_at_distance_tol_are_tied_and_beyond_are_not():
    a, b = masses(2), masses(2)
    points = {a: [0.0, 1.0], b: [1.25, 2.0]}
    assert tie_coincident(points, tol=0.25).p == 1
    with pytest.raises(ValueError, match="smallest distance to another is 0.25"):
        tie_coincident(points, tol=0.2499)


def test_nodes_that_nearly_coincide_are_warned_of():
    a, b = masses(3), masses(3)
    points = {a: [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]], b: [[0.0, 0.0], [0.05, 1.0], [0.0, 2.5]]}
    with pytest.warns(pm.ConstraintWarning, match="1 nodes or pairs .* 0.01 but no further than"):
        assert tie_coincident(points).p == 1
    assert tie_coincident(points, tol=0.01).p == 1  # given: no warning
    assert tie_coincident(points, tol=0.05).p == 2


def test_double_nodes_of_a_crack_away_from_the_interface_are_not_tied():
    a, b = masses(4), masses(2)
    cracked = [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    # the spacing is 1, not that of the crack: 0.005 off is within 0.01
    assert tie_coincident({a: cracked, b: [[2.0, 0.005], [3.0, 0.0]]}).p == 1
    with pytest.raises(ValueError, match="nodes 0 and 1 of <Subdomain 4 dofs.* lie 0 apart"):
        tie_coincident({a: cracked, b: [[0.0, 0.0], [0.0, 1.0]]})


def test_single_nodes_are_tied_where_they_are_equal():
    a, b = masses(1), masses(1)
    assert tie_coincident({a: [[0.5, 0.5]], b: [[0.5, 0.5]]}).p == 1
    with pytest.raises(ValueError, match="up to 0, got none"):
        tie_coincident({a: [0.3], b: [0.1 + 0.2]})


@pytest.mark.parametrize("tol", [1.0, 1.5, 1e3])
def test_a_tolerance_that_merges_nodes_of_one_side_is_refused(tol):
    a, b = masses(9, "a"), masses(9, "b")
    points = grid(np.arange(3.0), np.arange(3.0))
    assert tie_coincident({a: points, b: points + [2.0, 0.0]}, tol=0.99).p == 3
    with pytest.raises(ValueError, match="tol must not merge.* of <Subdomain 'a'.* lie 1 apart"):
        tie_coincident({a: points, b: points + [2.0, 0.0]}, tol=tol)


def test_a_merger_through_a_third_subdomain_is_refused():
    # 0 and 0.8 of b are 0.4 from 0.4 of c, and 0.8 apart
    a, b, c = masses(2, "a"), masses(2, "b"), masses(1, "c")
    points = {a: [0.0, -5.0], b: [0.0, 0.8], c: [0.4]}
    with pytest.raises(ValueError, match="nodes 0 and 1 of <Subdomain 'b'.* lie 0.8 apart"):
        tie_coincident(points, tol=0.5)


def test_a_tied_node_with_another_of_its_side_in_reach_is_refused():
    # 0.9 is in reach of 0 of its own side, but of no node of the other
    a, b = masses(2, "a"), masses(1, "b")
    with pytest.raises(ValueError, match="nodes 0 and 1 of <Subdomain 'a'.* lie 0.9 apart"):
        tie_coincident({a: [0.0, 0.9], b: [-0.5]}, tol=1.0)


# ---- matching interfaces: fixed dofs ----------------------------------------------------------


def fixed_chain(fixed, n=3):
    chain = reduce(np.ones(n), np.ones(n), fixed=fixed)
    return pm.Subdomain(chain.M, chain.K, scheme=SCHEME), chain


def test_dofs_that_are_fixed_on_both_sides_have_no_constraint():
    points = [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]]
    (a, whole_a), (b, whole_b) = fixed_chain([0]), fixed_chain([0])
    tied = tie_coincident({a: points, b: points}, reduced={a: whole_a, b: whole_b})
    # nodes 1 and 2 are dofs 0 and 1 of the reduced matrices
    assert dense(tied, a, b).tolist() == [[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]]


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_dof_that_is_fixed_in_one_subdomain_holds_those_of_the_others(place):
    subdomains = [
        fixed_chain([0] if i == place else [], n=1 if i != place else 2) for i in range(3)
    ]
    points = {s: ([0.0, 1.0 + i] if i == place else [0.0]) for i, (s, _) in enumerate(subdomains)}
    tied = tie_coincident(points, reduced=dict(subdomains))
    L = dense(tied, *points)
    require_full_rank(tied, *points)
    # two free dofs at the point, two constraints: the point does not move, the far dof is free
    rest = np.flatnonzero(~L.any(axis=0))
    assert tied.p == 2 and rest.tolist() == [place]
    assert np.all(np.abs(L).sum(axis=1) == 1.0)


def test_interfaces_with_fixed_dofs_only_are_refused():
    (a, whole_a), (b, whole_b) = fixed_chain([0]), fixed_chain([0])
    points = {a: [0.0, 1.0, 2.0], b: [0.0, -1.0, -2.0]}
    with pytest.raises(ValueError, match="reduced must leave a dof to tie"):
        tie_coincident(points, reduced={a: whole_a, b: whole_b})


def test_fixed_components_are_left_out_one_by_one():
    chain = reduce(np.ones(4), np.ones(4), fixed=[3])  # node 1, component 1
    a, b = pm.Subdomain(chain.M, chain.K, scheme=SCHEME), masses(4)
    tied = tie_coincident({a: [0.0, 1.0], b: [1.0, 2.0]}, components=2, reduced={a: chain})
    expected = [[0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0]]
    assert dense(tied, a, b).tolist() == expected


# ---- matching interfaces: size, and the assembled structure -----------------------------------


def test_a_hundred_thousand_nodes_are_tied_in_about_a_second():
    points = grid(np.linspace(0.0, 1.0, 400), np.linspace(0.0, 1.0, 250), [2.0])
    a, b = masses(100_000), masses(100_000)
    order = np.random.default_rng(0).permutation(100_000)
    begin = time.process_time()
    tied = tie_coincident({a: points, b: points[order]})
    # 0.4 s of CPU when it was written; a slow machine gets three times the second
    assert time.process_time() - begin < 3.0
    assert tied.p == 100_000
    np.testing.assert_array_equal(order[tied.matrices[b].indices], tied.matrices[a].indices)


# ---- matching interfaces: errors --------------------------------------------------------------

POINTS = np.array([[0.0, 0.0], [1.0, 0.0]])


@pytest.mark.parametrize(
    "second, options, message",
    [
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], {}, "points must have one dimension, got 2 of"),
        ([[0.0] * 4] * 2, {}, r"must have shape \(N,\) or \(N, d\)"),
        ([[[0.0]], [[1.0]]], {}, "must be a 1-D or 2-D array"),
        (np.zeros((0, 2)), {}, r"must have shape \(N,\) or \(N, d\)"),
        ([[0.0, np.nan], [1.0, 0.0]], {}, r"must be finite, got nan at \[0, 1\]"),
        (POINTS[:1], {}, "got 1 x 1 for 2, which is 2 per node"),
        (np.zeros((3, 2)), {}, "got 3 x 1 for 2; if dofs were fixed by reduce"),
        (POINTS, {"components": 2}, "got 2 x 2 for 2, which is 1 per node"),
        (POINTS, {"components": 2, "dofs_per_node": 1}, "components must be at most dofs_per_node"),
        (POINTS, {"components": 0}, "components must be at least 1"),
        (POINTS, {"dofs_per_node": {}}, "dofs_per_node must name the subdomains"),
        (POINTS, {"tol": -1.0}, "tol must be finite and at least 0"),
        (POINTS, {"tol": np.nan}, "tol must be finite"),
        (POINTS + [3.0, 0.0], {}, "smallest distance to another is 2"),
        (POINTS + [3.0, 0.0], {"tol": 1.9}, "up to 1.9, got none.* is 2"),
    ],
)
def test_invalid_values_are_refused(second, options, message):
    with pytest.raises(ValueError, match=message):
        tie_coincident({masses(2): POINTS, masses(2): second}, **options)


def test_a_subdomain_that_meets_no_other_is_named():
    points = {masses(2): [0.0, 1.0], masses(2): [1.0, 2.0], masses(2, "far"): [5.0, 6.0]}
    with pytest.raises(ValueError, match="got none of <Subdomain 'far'.* distance .* is 3"):
        tie_coincident(points)


@pytest.mark.parametrize(
    "points, options, message",
    [
        ([(masses(1), [0.0])], {}, "points must be a dict"),
        ({3: [0.0]}, {}, "points must be of Subdomains or names of them, got 3"),
        ({masses(1): ["x"]}, {}, "must hold real numbers"),
        ({masses(1): [0.0]}, {"components": 1.0}, "components must be a whole number"),
        ({masses(1): [0.0]}, {"dofs_per_node": 1.0}, "dofs_per_node must be a whole number"),
        ({masses(1): [0.0], masses(1): [0.0]}, {"tol": "fine"}, "tol must be a real number"),
        ({masses(1): [0.0]}, {"reduced": [1]}, "reduced must be a dict of Reductions"),
    ],
)
def test_arguments_of_the_wrong_kind_are_refused(points, options, message):
    with pytest.raises(TypeError, match=message):
        tie_coincident(points, **options)


def test_fewer_than_two_subdomains_are_refused():
    with pytest.raises(ValueError, match="two or more subdomains, got 1"):
        tie_coincident({masses(1): [0.0]})


def test_a_reduction_must_belong_to_its_subdomain():
    a, b = masses(2), masses(3)
    points = {a: [0.0, 1.0, 2.0], b: [0.0, 1.0, 2.0]}
    with pytest.raises(ValueError, match="reduced must hold the Reduction of <Subdomain 2 dofs"):
        tie_coincident(points, reduced={a: fixed_chain([0, 1])[1]})
    with pytest.raises(ValueError, match="reduced must be of subdomains with points"):
        tie_coincident(points, reduced={masses(2): fixed_chain([0])[1]})
    with pytest.raises(TypeError, match="reduced must hold Reductions, got 1"):
        tie_coincident(points, reduced={a: 1})


# ---- interfaces that do not match: patch test -------------------------------------------------


def rotation(dimension, seed=3):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(dimension, dimension)))[0]


def shaken(points, size, inner):
    """Points moved at random where inner is True, so that elements are no rectangles."""
    return points + size * inner * np.random.default_rng(5).uniform(-1.0, 1.0, points.shape)


def inner(points):
    """True at the coordinates that are not at the ends of their range."""
    return (points > points.min(axis=0)) & (points < points.max(axis=0))


def surface(n):
    """Shaken quads in the plane z = 0.3, or the same cut into triangles."""
    flat = grid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n))
    flat = shaken(flat, 0.3 / n, inner(flat))
    elements = quads(n, n)
    triangles = np.concatenate([elements[:, [0, 1, 2]], elements[:, [0, 2, 3]]])
    return np.column_stack([flat, np.full(len(flat), 0.3)]), elements, triangles


def cube(n):
    """Shaken hexahedra, or the same cut into six tetrahedra each."""
    points = grid(*[np.linspace(0.0, 1.0, n)] * 3)
    i = np.arange(n**3).reshape(n, n, n)
    ends = [slice(None, -1), slice(1, None)]
    corner = {
        (x, y, z): i[ends[x], ends[y], ends[z]].ravel()
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
    }
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    hexahedra = np.column_stack([corner[x, y, z] for z in (0, 1) for x, y in around])
    paths = [(0, a, b, 6) for a, b in [(1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1)]]
    tetrahedra = np.concatenate([hexahedra[:, path] for path in paths])
    return shaken(points, 0.2 / n, inner(points)), hexahedra, tetrahedra


def interface(kind):
    """Points and elements of b, and points of a spread over them."""
    random = np.random.default_rng(2).uniform(0.0, 1.0, (200, 3))
    if kind.startswith("line"):
        b, elements = np.linspace(0.0, 1.0, 6)[:, None] ** 2, line(6)
        return b, elements, random[:, :1]
    if kind.startswith("flat"):
        b, elements, triangles = surface(5)
        return b[:, :2], elements if "quad" in kind else triangles, random[:, :2]
    if kind.startswith("face"):
        b, elements, triangles = surface(5)
        return b, elements if "quad" in kind else triangles, random * [1.0, 1.0, 0.0] + [0, 0, 0.3]
    b, hexahedra, tetrahedra = cube(4)
    return b, hexahedra if "hexahedron" in kind else tetrahedra, random


KINDS = ["line", "line in the plane", "line in space", "flat triangle", "flat quad"]
KINDS += ["face triangle", "face quad", "tetra", "hexahedron"]


def turned(kind):
    """The interface, turned and moved out of the axes, and its `cell`."""
    b, elements, a = interface(kind)
    if kind == "line in the plane":
        a, b = a * [3.0, 4.0], b * [3.0, 4.0]
    elif kind == "line in space":
        a, b = a * [1.0, 2.0, 2.0], b * [1.0, 2.0, 2.0]
    turn, shift = rotation(b.shape[1]), 7.0
    return b @ turn + shift, elements, a @ turn + shift, kind.split()[-1]


def tied_to(b_points, elements, a_points, components=1, **options):
    a, b = masses(components * len(a_points), "a"), masses(components * len(b_points), "b")
    return interpolate(a, a_points, b, b_points, elements, components=components, **options), a, b


def linear(points):
    """Three components, each a constant and a linear term."""
    slopes = np.array([[1.0, -2.0, 0.5], [3.0, 0.3, -1.0], [-0.7, 2.0, 1.5]])
    return (np.array([2.0, -1.0, 0.25]) + points @ slopes[: points.shape[1]]).ravel()


@pytest.mark.parametrize("kind", KINDS)
def test_a_linear_field_passes_exactly(kind):
    b_points, elements, a_points, cell = turned(kind)
    cell = cell if cell in ("quad", "tetra") else None
    tied, a, b = tied_to(b_points, elements, a_points, 3, cell=cell, nodes_a=np.arange(200))
    assert tied.p == 600
    gap = tied.matrices[a] @ linear(a_points) + tied.matrices[b] @ linear(b_points)
    # some ten operations on fields up to 70, after weights from coordinates up to 10
    assert np.abs(gap).max() < 1e-12
    # a field that is not linear has a gap
    bent = tied.matrices[a] @ linear(a_points) ** 2 + tied.matrices[b] @ linear(b_points) ** 2
    assert np.abs(bent).max() > 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_weights_are_between_zero_and_one_and_sum_to_one(kind):
    b_points, elements, a_points, cell = turned(kind)
    cell = cell if cell in ("quad", "tetra") else None
    tied, a, b = tied_to(b_points, elements, a_points, cell=cell)
    weights = -tied.matrices[b].toarray()
    np.testing.assert_array_equal(tied.matrices[a].toarray(), np.eye(200))
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=4e-16 * elements.shape[1])
    # each row reaches the nodes of one element and no others
    corners = [set(e) for e in elements.tolist()]
    for row in weights:
        assert any(set(np.flatnonzero(row)) <= c for c in corners)


def test_bilinear_weights_are_those_of_the_known_reference_coordinates():
    rng = np.random.default_rng(4)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for _ in range(20):
        quad = corners + rng.uniform(-0.24, 0.24, (4, 2))  # convex
        x, y = rng.uniform(size=(2, 50, 1))
        weights = np.hstack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y])
        tied, _, b = tied_to(quad, [[0, 1, 2, 3]], weights @ quad, cell="quad")
        # the map's inverse has slopes up to 10
        np.testing.assert_allclose(-tied.matrices[b].toarray(), weights, rtol=0.0, atol=1e-13)


def test_slender_elements_pass_too():
    b_points = grid(np.linspace(0.0, 1.0, 3), np.linspace(0.0, 1e-5, 3))
    a_points = np.random.default_rng(0).uniform(size=(50, 2)) * [1.0, 1e-5]
    tied, a, b = tied_to(b_points, quads(3, 3), a_points, 3, tol=1e-9)
    assert tied.p == 150
    gap = tied.matrices[a] @ linear(a_points) + tied.matrices[b] @ linear(b_points)
    assert np.abs(gap).max() < 1e-13  # fields up to 5; the short side adds nothing to the error


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_weights_are_independent_of_units(unit):
    b_points, elements, a_points, _ = turned("face quad")
    ours, _, b = tied_to(b_points, elements, a_points, cell="quad")
    other, _, other_b = tied_to(unit * b_points, elements, unit * a_points, cell="quad")
    # coordinates up to 8 are rounded anew, elements are 0.1 wide
    np.testing.assert_allclose(
        other.matrices[other_b].toarray(), ours.matrices[b].toarray(), rtol=0.0, atol=1e-12
    )


def test_a_mesh_far_from_the_origin_has_the_same_weights():
    b_points, elements, a_points = interface("flat quad")
    # multiples of 2^-10 are whole after 2^20 is added: the same mesh, bitwise identical
    b_points, a_points = (np.round(1024.0 * x) / 1024.0 for x in (b_points, a_points))
    near, _, b = tied_to(b_points, elements, a_points)
    far, _, far_b = tied_to(b_points + 2.0**20, elements, a_points + 2.0**20)
    np.testing.assert_allclose(
        far.matrices[far_b].toarray(), near.matrices[b].toarray(), rtol=0.0, atol=1e-14
    )


def test_nodes_that_coincide_have_one_weight_of_one():
    b_points, elements, _, _ = turned("face quad")
    order = np.random.default_rng(0).permutation(len(b_points))
    tied, a, b = tied_to(b_points, elements, b_points[order], cell="quad")
    by_place = tie_coincident({a: b_points[order], b: b_points})
    for s in (a, b):
        np.testing.assert_array_equal(tied.matrices[s].toarray(), by_place.matrices[s].toarray())


def test_a_node_on_a_border_follows_the_element_of_the_lowest_number():
    # two edges that overlap on [1, 2], with separate nodes
    b_points = np.array([0.0, 2.0, 1.0, 3.0])
    for elements in ([[0, 1], [2, 3]], [[2, 3], [0, 1]]):
        tied, _, b = tied_to(b_points, elements, [0.5, 1.5, 2.5], tol=1e-6)
        first = np.flatnonzero(tied.matrices[b].toarray()[1])
        assert set(first) == set(elements[0])


def test_the_nearest_element_wins_over_a_lower_number_within_the_tolerance():
    b_points = [[0.0, 0.01], [1.0, 0.01], [0.0, 0.0], [1.0, 0.0]]
    tied, _, b = tied_to(b_points, [[0, 1], [2, 3]], [[0.25, 0.002], [0.75, 0.009]], tol=0.02)
    expected = [[0.0, 0.0, -0.75, -0.25], [-0.25, -0.75, 0.0, 0.0]]
    np.testing.assert_allclose(tied.matrices[b].toarray(), expected, rtol=0.0, atol=1e-15)


def test_nodes_off_the_elements_are_left_out_or_refused_as_requested():
    edge, nodes = np.array([[0.0, 0.0], [1.0, 0.0]]), [[0.5, 0.0], [0.5, 0.3], [0.2, 0.0]]
    tied, a, _ = tied_to(edge, line(2), nodes)
    assert tied.matrices[a].indices.tolist() == [0, 2]
    with pytest.raises(ValueError, match=r"nodes_a must lie .* got nodes 1 outside.* is 0.583"):
        tied_to(edge, line(2), nodes, nodes_a=[2, 1])  # hypot(0.5, 0.3)
    tied, a, b = tied_to(edge, line(2), nodes, nodes_a=[2, 0])
    assert tied.matrices[a].indices.tolist() == [2, 0]
    assert dense(tied, b)[0].tolist() == pytest.approx([-0.8, -0.2], abs=1e-15)
    tied, a, b = tied_to(edge, line(2), nodes, tol=0.3, nodes_a=[1])
    assert dense(tied, b).tolist() == [[-0.5, -0.5]]


def test_nodes_that_are_nearly_in_an_element_are_warned_of():
    edge, nodes = [[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.5, 0.03], [1.0, 0.0]]
    # half the edge is the smallest distance between nodes, 0.5 and a little: 0.005 and 0.05
    with pytest.warns(pm.ConstraintWarning, match="1 nodes .* further apart than .* 0.005"):
        tied, _, _ = tied_to(edge, line(2), nodes)
    assert tied.p == 2
    assert tied_to(edge, line(2), nodes, tol=0.005)[0].p == 2  # given: no warning


def test_fixed_dofs_have_no_entries_and_no_rows_of_their_own():
    fine, coarse = [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]], [[0.0, 0.0], [0.0, 2.0]]
    (a, whole_a), (b, whole_b) = fixed_chain([0]), fixed_chain([0], n=2)
    tied = interpolate(a, fine, b, coarse, [[0, 1]], reduced={a: whole_a, b: whole_b})
    # node 0 of both is on the ground; v_a(1) = v_b(1) / 2, v_a(2) = v_b(1)
    assert dense(tied, a, b).tolist() == [[1.0, 0.0, -0.5], [0.0, 1.0, -1.0]]
    tied = interpolate(a, fine, c := masses(2), coarse, [[0, 1]], reduced={a: whole_a})
    assert dense(tied, a, c).tolist() == [
        [0.0, 0.0, -1.0, 0.0],
        [1.0, 0.0, -0.5, -0.5],
        [0.0, 1.0, 0.0, -1.0],
    ]


def test_components_of_a_node_are_adjacent():
    frame, plate = masses(3), masses(4)
    points = [[0.0, 0.0], [0.0, 4.0]]
    tied = interpolate(
        frame,
        [[0.0, 1.0]],
        plate,
        points,
        [[0, 1]],
        components=2,
        dofs_per_node={frame: 3, plate: 2},
    )
    assert dense(tied, frame, plate).tolist() == [
        [1.0, 0.0, 0.0, -0.75, 0.0, -0.25, 0.0],
        [0.0, 1.0, 0.0, 0.0, -0.75, 0.0, -0.25],
    ]


def test_ten_thousand_nodes_are_interpolated_in_a_second():
    y = np.linspace(0.0, 1.0, 100)
    z = np.linspace(0.0, 1.0, 34)
    fine, coarse = grid(y, y, [0.0]), grid(z, z, [0.0])
    begin = time.process_time()
    tied, a, b = tied_to(coarse, quads(34, 34), fine, 3, cell="quad")
    assert time.process_time() - begin < 1.0  # 0.1 s when it was written
    gap = tied.matrices[a] @ linear(fine) + tied.matrices[b] @ linear(coarse)
    assert tied.p == 30_000 and np.abs(gap).max() < 1e-14  # fields up to 7


# ---- interfaces that do not match: in a run ---------------------------------------------------


class CutPlate:
    """A plate [0, 2] x [0, 1] cut at x = 1: fine (explicit, a) left, coarse (implicit, b) right."""

    def __init__(self, fine, coarse, **load):
        self.points, self.subdomains, tables = {}, {}, {}
        for name, left, n in (("a", 0.0, fine), ("b", 1.0, coarse)):
            y = np.linspace(0.0, 1.0, n + 1)
            flat = grid(left + np.linspace(0.0, 1.0, n + 1), y)
            # nodes of the border are not moved, so that the meshes nest where n does
            self.points[name] = shaken(flat, 0.2 / n, inner(flat).all(axis=1, keepdims=True))
            tables[name] = quads(n + 1, n + 1)
        self.edges = {
            "a": np.arange((fine + 1) * fine, (fine + 1) ** 2),
            "b": np.arange(coarse + 1),
        }
        for name, explicit, substeps in (("a", True, 8), ("b", False, 1)):
            plate = pm.structures.plate_on(self.points[name], tables[name], **MATERIAL)
            self.subdomains[name] = plate.subdomain(
                scheme=pm.GeneralizedAlpha(0.5, explicit=explicit),
                substeps=substeps,
                name=name,
                **{key: value(self.points[name], tables[name]) for key, value in load.items()},
            )
        a, b = self.subdomains["a"], self.subdomains["b"]
        elements = np.column_stack([self.edges["b"][:-1], self.edges["b"][1:]])
        self.tied = interpolate(a, self.points["a"], b, self.points["b"], elements, components=2)

    def run(self, steps=20):
        return pm.Coupler(list(self.subdomains.values()), self.tied, dt=0.05, coupling="pm").run(
            steps=steps
        )


STRESS = np.array([[2.0, 0.5], [0.5, -1.0]])


def uniform_strain(points, _=None, E=1.0, nu=0.3):
    """Displacements under the constant STRESS, with the strains of plane stress."""
    strain = ((1.0 + nu) * STRESS - nu * np.trace(STRESS) * np.eye(2)) / E
    return (points @ strain).ravel()


def tractions(points, elements):
    """Nodal forces of STRESS on the edges of the subdomain, except at x = 1."""
    force = np.zeros(points.shape)
    sides = np.concatenate([elements[:, [i, (i + 1) % 4]] for i in range(4)])
    _, first, count = np.unique(np.sort(sides), axis=0, return_index=True, return_counts=True)
    for i, j in sides[first[count == 1]]:
        x, y = points[j] - points[i]
        if not np.all(points[[i, j], 0] == 1.0):
            force[[i, j]] += 0.5 * STRESS @ [y, -x]  # normal times length, outwards
    return force.ravel()


def test_a_uniform_strain_stays_and_the_multipliers_are_its_tractions():
    plate = CutPlate(6, 2, u0=uniform_strain, force=tractions)  # a refines b
    history = plate.run()
    for name, points in plate.points.items():
        # 160 steps of forces that balance up to 1e-15, masses from 1/144
        np.testing.assert_allclose(
            history[name].u, np.tile(uniform_strain(points), (len(history[name].t), 1)), atol=1e-12
        )
    # on a at x = 1: stress times the length that belongs to a node, 1/6, half at the ends
    lengths = np.array([0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5]) / 6.0
    expected = (lengths[:, None] * STRESS[:, 0]).ravel()
    assert history.multipliers.shape[1] == 14
    np.testing.assert_allclose(
        history.multipliers, np.tile(expected, (len(history.multipliers), 1)), rtol=0.0, atol=1e-12
    )


def static_error(fine, coarse):
    """Energy norm of the error of a cut plate under uniform stress, over that of the solution."""
    plate = CutPlate(fine, coarse)
    exact = [uniform_strain(plate.points[name]) for name in "ab"]
    load, blocks = [], []
    for name in "ab":
        n = int(np.sqrt(len(plate.points[name])))
        load.append(tractions(plate.points[name], quads(n, n)))
        blocks.append(plate.subdomains[name].K)
    K = sp.block_diag(blocks).toarray()
    L = dense(plate.tied, *plate.subdomains.values())
    # K u - L^T Lam = f, L u = 0; rigid motions are left open
    system = np.block([[K, -L.T], [L, np.zeros((len(L), len(L)))]])
    right = np.concatenate([*load, np.zeros(len(L))])
    u = np.linalg.lstsq(system, right, rcond=1e-12)[0][: len(K)]
    exact = np.concatenate(exact)
    # rounding may leave a negative zero above
    return np.sqrt(abs((u - exact) @ K @ (u - exact)) / (exact @ K @ exact))


def test_a_uniform_stress_is_exact_on_nested_meshes_and_converges_on_others():
    assert static_error(6, 3) < 1e-7  # the square root of rounding
    errors = [static_error(3 * n, 2 * n) for n in (1, 2, 4)]
    # wrong by a fixed fraction in one layer of elements at the interface: the energy falls with h
    assert errors[0] < 0.2
    assert errors[1] < 0.8 * errors[0] and errors[2] < 0.8 * errors[1]


def test_the_rows_of_an_interpolation_are_independent():
    plate = CutPlate(7, 3)
    require_full_rank(plate.tied, *plate.subdomains.values())


# ---- interfaces that do not match: errors -----------------------------------------------------

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SPATIAL = np.column_stack([SQUARE, np.zeros(4)])


@pytest.mark.parametrize(
    "b_points, elements, options, message",
    [
        (SQUARE, [[0, 4]], {}, r"elements_b must lie in 0\.\.3, got 4"),
        (SQUARE, [[0, -1]], {}, r"elements_b must lie in 0\.\.3, got -1"),
        (SQUARE, [[0, 0]], {}, "not flat, got elements 0"),
        (SQUARE, [[0, 1, 2], [0, 1, 1]], {}, "not flat, got elements 1"),
        (SQUARE, [[0, 1, 3, 2]], {}, "numbered around .* got elements 0"),
        (SPATIAL, [[0, 1, 3, 2]], {"cell": "quad"}, "numbered around .* got elements 0"),
        (SPATIAL, [[0, 1, 2, 3]], {"cell": "tetra"}, "not flat, got elements 0"),
        (SPATIAL, [[0, 1, 2, 3]], {}, "cell must be quad or tetra"),
        (SQUARE, [[0, 1, 2, 3]], {"cell": "tetra"}, "cell must fit elements_b"),
        (SQUARE, [[0, 1]], {"cell": "edge"}, "cell must be one of 'line', .* got 'edge'"),
        (SQUARE, [[0, 1, 2, 3, 0]], {}, "with corner nodes only, in 2-D, got shape"),
        (SQUARE, np.zeros((0, 2), dtype=int), {}, r"got shape \(0, 2\)"),
        (SQUARE, [[0, 1]], {"nodes_a": [9]}, r"nodes_a must lie in 0\.\.3"),
        (SQUARE, [[0, 1]], {"nodes_a": []}, "nodes_a must not be empty"),
        (SQUARE, [[0, 1]], {"tol": 2.0}, "tol must be less than the size of the elements"),
        (SQUARE + [0.0, 3.0], [[0, 1]], {}, "got none; the smallest distance .* is 2"),
        (SQUARE[:, 0], [[0, 1]], {}, "points must have one dimension"),
        (SQUARE, [[0, 1]], {"components": 2}, "got 4 x 2 for 4"),
    ],
)
def test_invalid_interpolations_are_refused(b_points, elements, options, message):
    a_points = SPATIAL if np.shape(b_points)[-1] == 3 else SQUARE
    a, b = masses(4, "a"), masses(4, "b")
    with pytest.raises(ValueError, match=message):
        interpolate(a, a_points, b, b_points, elements, **options)


def test_a_quad_that_is_not_convex_is_refused():
    arrow = [[0.0, 0.0], [2.0, 0.0], [0.4, 0.4], [0.0, 2.0]]
    with pytest.raises(ValueError, match="must be convex"):
        tied_to(arrow, [[0, 1, 2, 3]], [[0.1, 0.1]])
    assert tied_to(arrow, [[0, 1, 2], [0, 2, 3]], [[0.1, 0.1]])[0].p == 1


def test_a_subdomain_is_not_tied_to_itself():
    a = masses(4)
    with pytest.raises(ValueError, match="two different subdomains"):
        interpolate(a, SQUARE, a, SQUARE, [[0, 1]])


def test_elements_must_be_whole_numbers():
    with pytest.raises(TypeError, match="elements_b must be a 2-D array of whole numbers"):
        tied_to(SQUARE, [[0.0, 1.0]], SQUARE)
