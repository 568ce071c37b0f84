"""Warnings of subdomains that no constraint reaches, or that their constraints leave loose."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures
from pmalpha.setup import judging
from pmalpha.setup.link import Link

SCHEME = pm.GeneralizedAlpha(0.8)
PLATE = dict(E=1.0, nu=0.3, rho=1.0, t=1.0)


def mass(name, k=1.0):
    return pm.Subdomain([1.0], [k], scheme=SCHEME, name=name)


def plate(name, nx=3, floor=0.0, x=0.0):
    """A floating plate of nx x 2 elements, its mesh, and its left and right edge."""
    mesh = structures.plate(nx, 2, 1.0, **PLATE, origin=(x, 0.0))
    K = mesh.K + floor * sp.eye_array(mesh.n)
    return pm.Subdomain(mesh.M, K, scheme=SCHEME, name=name), mesh


def messages(subdomains, constraints):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        pm.Coupler(subdomains, constraints, dt=0.01, coupling="pm")
    assert all(w.category is pm.ConstraintWarning and w.filename == __file__ for w in caught)
    return [str(w.message) for w in caught]


def test_a_subdomain_that_no_constraint_reaches_beside_others_is_named():
    a, b, c, d = (mass(name) for name in "abcd")
    (message,) = messages([a, b, c], pm.tie(a, [0], b, [0]))
    assert message.startswith("no constraint reaches subdomain 'c': ")
    (message,) = messages([a, b, c, d], pm.tie(a, [0], c, [0]))
    assert message.startswith("no constraint reaches subdomains 'b', 'd': ")
    (message,) = messages([a, b], None)
    assert "'a', 'b'" in message


def test_tied_subdomains_and_a_single_one_are_not_warned_of():
    a, b = mass("a"), mass("b")
    assert messages([a, b], pm.tie(a, [0], b, [0])) == []
    assert messages([a], None) == []
    free = pm.Subdomain([1.0], [0.0], scheme=SCHEME, name="free")
    assert messages([free], None) == []  # a structure in free flight
    assert messages([free, a], pm.tie(free, [0], a, [0])) == []


@pytest.mark.parametrize("nx", [3, 60])  # K has 500 and 6000 entries
def test_a_floating_plate_needs_three_ties_that_hold_translation_and_rotation(nx):
    a, mesh = plate("a", nx)
    b, right = plate("b", nx, floor=0.01, x=float(nx))
    edge, other = mesh.nodes_at(x=float(nx)), right.nodes_at(x=float(nx))

    def tied(component, nodes=slice(None)):
        return pm.tie(a, mesh.dofs(edge[nodes], component), b, right.dofs(other[nodes], component))

    assert messages([a, b], tied(None)) == []
    assert messages([a, b], [tied("ux"), tied("uy", slice(1))]) == []
    (message,) = messages([a, b], tied("ux"))  # free along y
    assert message.startswith("subdomain 'a' is floating, and its 3 constraints do not hold it")
    (message,) = messages([a, b], tied(None, slice(1)))  # one node: a hinge, free to rotate
    assert "its 2 constraints do not hold it" in message
    (message,) = messages([a, b], tied("uy"))  # along one line: free along x
    assert "'a'" in message


def test_two_floating_plates_that_are_tied_along_an_edge_may_fly_together():
    a, mesh = plate("a")
    b, right = plate("b", x=3.0)
    edges = mesh.dofs(mesh.nodes_at(x=3.0)), right.dofs(right.nodes_at(x=3.0))
    assert messages([a, b], pm.tie(a, edges[0], b, edges[1])) == []


def test_a_floating_frame_with_rotations_is_held_by_a_clamp_and_not_by_a_hinge():
    def member(name, start, held):
        mesh = structures.beam_frame(
            [[start, 0], [start + 1, 0]], [[0, 1]], EA=1e3, EI=1.0, rhoA=1.0
        )
        K = mesh.K + sp.diags_array(np.tile([held, held, 0.0], 2))
        return pm.Subdomain(mesh.M, K, scheme=SCHEME, name=name)

    a, b = member("a", 0, 0.0), member("b", 1, 5.0)
    assert messages([a, b], pm.tie(a, [3, 4, 5], b, [0, 1, 2])) == []
    (message,) = messages([a, b], pm.tie(a, [3, 4], b, [0, 1]))
    assert "subdomain 'a' is floating, and its 2 constraints" in message


def test_springs_and_estimates_hold_a_subdomain_and_an_unknown_restoring_force_may():
    K = sp.csr_array(np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2)))  # along x and y, floating
    other = mass("other")

    def loose(**options):
        s = pm.Subdomain(np.ones(4), K, scheme=SCHEME, name="s", **options)
        return len(messages([s, other], pm.tie(s, [0], other, [0])))

    assert loose() == 1  # free along y
    assert loose(restoring=pm.CubicSpring([1], k=1.0, k3=0.0)) == 0
    assert loose(restoring=pm.Gap([1], k=1.0, gap=1.0)) == 0
    assert loose(restoring=pm.CubicSpring([0], k=1.0, k3=0.0)) == 1  # along x
    assert loose(restoring=lambda t, u, v: 0.0 * u) == 0  # its stiffness is not known
    assert loose(restoring=lambda t, u, v: 0.0 * u, restoring_stiffness=[0, 0, 0, 1.0]) == 0
    assert loose(restoring=lambda t, u, v: 0.0 * u, restoring_stiffness=[1.0, 0, 0, 0]) == 1


def test_a_diagonal_stiffness_leaves_its_zero_dofs_loose_unless_tied():
    s = pm.Subdomain(np.ones(3), [1.0, 0.0, 0.0], scheme=SCHEME, name="s")
    other = pm.Subdomain(np.ones(3), np.ones(3), scheme=SCHEME, name="other")
    (message,) = messages([s, other], pm.tie(s, [1], other, [1]))
    assert "its 1 constraint does not hold it" in message
    assert messages([s, other], pm.tie(s, [1, 2], other, [1, 2])) == []


def test_exported_digits_do_not_hide_that_a_plate_is_floating():
    a, mesh = plate("a")
    K = sp.csr_array(mesh.K + mesh.K.T) * 0.5
    K.data = np.array([float(f"{x:.9e}") for x in K.data])  # ten digits
    rounded = pm.Subdomain(mesh.M, K, scheme=SCHEME, name="a")
    b, right = plate("b", floor=0.01, x=3.0)
    tie = pm.tie(rounded, mesh.dofs(mesh.nodes_at(x=3.0), "ux"), b, right.dofs([0, 4, 8], "ux"))
    assert len(messages([rounded, b], tie)) == 1


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize("coupling", ["pm", "gc", "macro", "mean"])
def test_a_linear_subdomain_that_no_constraint_reaches_is_on_its_own_beside_iterated_ones(coupling):
    def iterated(name):
        spring = pm.CubicSpring([0], 1.0, 5.0)
        return pm.Subdomain([1.0], None, scheme=SCHEME, internal=spring, v0=[1.0], name=name)

    a, b = iterated("a"), iterated("b")
    alone = pm.Subdomain([1.0, 2.0], [3.0, 4.0], scheme=SCHEME, v0=[1.0, 2.0], name="alone")
    history = pm.Coupler([a, b, alone], pm.tie(a, 0, b, 0), dt=0.1, coupling=coupling).run(1.0)
    np.testing.assert_array_equal(history["alone"].u, pm.solve(alone, 0.1, 1.0).u)


def test_what_is_definite_by_a_margin_is_judged_as_by_translations_and_eigenvalues(monkeypatch):
    """Springs of eight decades between drawn pairs of dofs, some indefinite, and drawn ties."""
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(60):
        n = int(rng.integers(2, 9))
        pairs = np.eye(n)[rng.integers(n, size=n + 2)] - np.eye(n)[rng.integers(n, size=n + 2)]
        K = pairs.T @ np.diag(10.0 ** rng.uniform(-4.0, 4.0, n + 2)) @ pairs
        K += np.abs(K).max() * rng.choice([0.0, 0.0, 1e-8, -1e-5]) * np.eye(n)
        L = np.eye(n)[: rng.integers(1, 3)] - rng.choice([0.0, 1.0]) * np.eye(n, k=1)[0]
        drawn.append((K, Link.of(sp.csc_array(L))))

    def verdicts():
        with np.errstate(divide="ignore"):
            return [
                (judging._leaves_motion(K, L), judging._dense_rate(K, np.eye(len(K))))
                for K, L in drawn
            ]

    fast = verdicts()
    monkeypatch.setattr(judging, "_is_held", lambda K, L: False)
    monkeypatch.setattr(judging, "is_definite", lambda A: False)
    assert fast == verdicts()
    loose, rates = zip(*fast)
    assert {True, False} == set(loose) and min(rates) == 0.0 < max(rates)
