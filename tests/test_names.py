"""Constraints that give their subdomains by name."""

import copy
import pickle

import numpy as np
import pytest

import pmalpha as pm

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


def chain(n, name, u0=None):
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return pm.Subdomain(np.ones(n), K, scheme=pm.GeneralizedAlpha(0.5), u0=u0, name=name)


def two():
    return chain(3, "a", [0.3, -0.2, 0.1]), chain(4, "b", [0.1, 0, 0, 0.1])


def run(constraints, subdomains=None):
    """The motion of two chains whose last and first dofs are tied, all numbers of it."""
    c = pm.Coupler(subdomains or two(), constraints, dt=0.1, coupling="pm")
    history = c.run(steps=20)
    return np.hstack([history["a"].u.ravel(), history["b"].v.ravel(), history.multipliers.ravel()])


@pytest.mark.parametrize("names", [("a", "b"), ("a", None), (None, "b")])
def test_a_tie_in_names_is_that_of_the_subdomains(names):
    both = two()
    first, second = (name or s for name, s in zip(names, both))
    expected = run(pm.tie(both[0], [2], both[1], [0]), both)
    np.testing.assert_array_equal(run(pm.tie(first, [2], second, [0]), both), expected)


def test_general_constraints_and_masks_in_names():
    matrices = {"a": [[0, 0, 1.0]], "b": [[-1.0, 0, 0, 0]]}
    masks = np.arange(3) == 2, np.arange(4) == 0
    expected = run(pm.tie("a", 2, "b", 0))
    np.testing.assert_array_equal(run(pm.Constraint(matrices)), expected)
    np.testing.assert_array_equal(run(pm.tie("a", masks[0], "b", masks[1])), expected)
    assert np.any(run(pm.tie("a", 2, "b", 3)) != expected)


def test_a_name_that_the_coupler_gave_is_one_too():
    parts = [pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), u0=[1.0]) for _ in range(2)]
    coupler = pm.Coupler(parts, pm.tie("subdomain 0", 0, "subdomain 1", 0), dt=0.1, coupling="pm")
    by_name = coupler.run(steps=3).multipliers
    again = pm.Coupler(parts, pm.tie(parts[0], 0, parts[1], 0), dt=0.1, coupling="pm")
    np.testing.assert_array_equal(by_name, again.run(steps=3).multipliers)


def test_meshes_are_tied_in_names():
    a, b = (pm.Subdomain(np.ones(8), np.ones(8), scheme=pm.Newmark(), name=k) for k in "ab")
    shifted = POINTS + [1.0, 0.0]
    one, other = (
        pm.tie_coincident({x: POINTS, y: shifted}, components=2) for x, y in ((a, b), "ab")
    )
    assert_same_matrices(one, other, (a, b))
    one, other = (
        pm.interpolate(x, POINTS, y, shifted, [[0, 2]], components=2) for x, y in ((a, b), "ab")
    )
    assert_same_matrices(one, other, (a, b))


def assert_same_matrices(by_subdomain, by_name, subdomains):
    for s in subdomains:
        one, other = by_subdomain.matrices[s], by_name.matrices[s.name]
        np.testing.assert_array_equal(one.toarray(), other.toarray())


def test_fixed_dofs_are_left_out_in_names_too():
    reduced = pm.reduce(np.ones(8), np.eye(8), fixed=[2, 3])
    a = pm.Subdomain(reduced.M, reduced.K, scheme=pm.Newmark(), name="a")
    b = pm.Subdomain(np.ones(8), np.ones(8), scheme=pm.Newmark(), name="b")
    one, other = (
        pm.tie_coincident({x: POINTS, y: POINTS + [1.0, 0.0]}, components=2, reduced={x: reduced})
        for x, y in ((a, b), "ab")
    )
    assert_same_matrices(one, other, (a, b))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
def test_a_copied_constraint_needs_none_of_its_subdomains(copied):
    a, b = chain(3, "a"), chain(4, "b")
    np.testing.assert_array_equal(run(copied(pm.tie(a, 2, b, 0))), run(pm.tie("a", 2, "b", 0)))
    large = chain(300, "a")
    one, many = (len(pickle.dumps(pm.tie(s, [2], b, [0]))) for s in (a, large))
    assert many < one + 100  # not the 720 kB of K


def test_without_names_subdomains_and_constraint_are_pickled_together():
    parts = [pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), u0=[1.0]) for _ in range(2)]
    tied = pm.tie(parts[0], 0, parts[1], 0)
    again, constraint = pickle.loads(pickle.dumps((parts, tied)))
    assert pm.Coupler(again, constraint, dt=0.1, coupling="pm").run(steps=3).multipliers.shape == (
        4,
        1,
    )
    with pytest.raises(ValueError, match="constraint 0 must hold subdomains of this coupler"):
        pm.Coupler(parts, pickle.loads(pickle.dumps(tied)), dt=0.1, coupling="pm")


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: pm.tie("a", 0, "tower", 0), "must name subdomains of this coupler, 'a', 'b', got"),
        (lambda: pm.tie("a", 3, "b", 0), "constraint 0: dofs_a must lie in 0..2, got 3 of 'a'"),
        (lambda: pm.Constraint({"a": [[1.0, 0.0]]}), "must fit 'a' of 3 dofs, got 2 columns"),
        (lambda: pm.Constraint({"a": np.eye(1, 5)}), "must fit 'a' of 3 dofs, got 5 columns"),
        (lambda: pm.tie("a", -4, "b", 0), "constraint 0: dofs_a must lie in -3..2, got -4 of 'a'"),
        (lambda: pm.tie("a", 0, "a", 1), "a and b must be two different subdomains"),
        (lambda: pm.tie(chain(3, "a"), 0, "a", 1), "a and b must have different names"),
        (
            lambda: pm.Constraint({chain(3, "a"): np.eye(1, 3), "a": np.eye(1, 3)}),
            "matrices must not name a subdomain twice",
        ),
    ],
)
def test_what_does_not_fit_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        pm.Coupler([chain(3, "a"), chain(4, "b")], make(), dt=0.1, coupling="pm")


def test_a_default_name_and_the_subdomain_are_one():
    parts = [pm.Subdomain([1.0], [4.0], scheme=pm.Newmark()) for _ in range(2)]
    both = pm.Constraint({parts[0]: [[1.0]], "subdomain 0": [[1.0]]})
    with pytest.raises(ValueError, match="constraint 0 must not hold 'subdomain 0' twice"):
        pm.Coupler(parts, both, dt=0.1, coupling="pm")
