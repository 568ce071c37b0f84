"""What describes a problem cannot be changed after its checks; springs show what they connect."""

import copy
import pickle

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm

SCHEMES = [
    pm.GeneralizedAlpha(0.5),
    pm.Newmark(),
    pm.CentralDifference(),
    pm.HHT(0.1),
    pm.WBZ(0.1),
]


def subdomain():
    return pm.Subdomain([1.0, 2.0], [3.0, 4.0], scheme=SCHEMES[0], name="s")


def made():
    s = subdomain()
    load = pm.SampledForce([0.0, 1.0], 0.1, shape=[1.0, 0.0])
    quake = pm.BaseAcceleration([0.0, 1.0], [1.0, 1.0], [1.0, 2.0], dt=0.1)
    constraint = pm.Constraint({s: [[1.0, 0.0]]})
    return [*SCHEMES, s, load, quake, constraint, pm.Gap([0], k=1.0, gap=0.1)]


@pytest.mark.parametrize("thing", made(), ids=lambda x: type(x).__name__)
def test_no_attribute_can_be_assigned_added_or_deleted(thing):
    before = dict(vars(thing))
    names = [name for name in before if not name.startswith("_")]
    assert names
    for name in names:
        with pytest.raises(AttributeError, match=name):
            setattr(thing, name, 0.9)
        with pytest.raises(AttributeError, match=name):
            delattr(thing, name)
    with pytest.raises(AttributeError, match="ro of a "):  # a typing error
        thing.ro = 0.9
    assert vars(thing).keys() == before.keys()
    assert all(vars(thing)[name] is before[name] for name in before)


def test_the_message_says_what_to_do():
    scheme = pm.GeneralizedAlpha(0.5)
    with pytest.raises(AttributeError, match="rho of a GeneralizedAlpha must not be changed .*new"):
        scheme.rho = 0.9
    assert scheme.rho == 0.5 and scheme == pm.GeneralizedAlpha(0.5)
    with pytest.raises(
        AttributeError, match="M of a Subdomain must not be changed .*new Subdomain"
    ):
        subdomain().M = np.ones(2)


def test_the_arrays_of_a_subdomain_are_read_only():
    s = pm.Subdomain(
        np.array([[2.0, 1.0], [1.0, 2.0]]),
        sp.csr_array([[2.0, -1.0], [-1.0, 2.0]]),
        scheme=SCHEMES[0],
    )
    for array in (s.M, s.K.data, s.K.indices, s.K.indptr, s.u0, s.v0):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda x: type(x).__name__)
def test_schemes_can_be_copied_pickled_compared_and_hashed(scheme):
    for other in (copy.copy(scheme), copy.deepcopy(scheme), pickle.loads(pickle.dumps(scheme))):
        assert other == scheme and hash(other) == hash(scheme) and vars(other) == vars(scheme)
        with pytest.raises(AttributeError):
            other.beta = 0.3


def test_a_subdomain_can_be_copied_and_the_copy_is_frozen_too():
    for other in (copy.copy(subdomain()), pickle.loads(pickle.dumps(subdomain()))):
        assert other.M.tolist() == [1.0, 2.0]
        with pytest.raises(AttributeError):
            other.K = None


# ---- springs --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "dofs, text",
    [
        ([0, 1], "2 springs to the ground"),
        ([(0, 1)], "1 spring between two dofs"),
        (3, "1 spring to the ground"),
        ([(0, 1), (1, 2)], "2 springs between two dofs"),
        ([(0, -1), (-1, 0), (0, 1)], "2 springs to the ground, 1 spring between two dofs"),
        (np.array([0, 1]), "2 springs to the ground"),
    ],
)
def test_the_repr_of_springs_shows_what_they_connect(dofs, text):
    assert repr(pm.BoucWen(dofs, k=1.0, fy=1.0)) == f"<BoucWen: {text}>"
    assert repr(pm.Gap(dofs, k=1.0, gap=1.0)) == f"<Gap: {text}>"


@pytest.mark.parametrize("dofs, force", [([0, 1], [1.0, 2.0]), ([(0, 1)], [-1.0, 1.0])])
def test_a_list_and_a_list_of_pairs_are_different_springs(dofs, force):
    spring = pm.CubicSpring(dofs, k=1.0, k3=0.0)
    s = pm.Subdomain(
        [1.0, 1.0], None, scheme=pm.CentralDifference(), restoring=spring, u0=[1.0, 2.0]
    )
    # M w = -r at t = 0, with r = u to the ground, u_0 - u_1 on the first and its negative between
    np.testing.assert_array_equal(pm.solve(s, dt=0.01, t_end=0.01).a[0], -np.array(force))


def test_a_pair_that_is_not_in_a_list_is_refused_with_both_spellings():
    words = r"dofs must be \[\(0, 1\)\] for one spring between two dofs, or \[0, 1\] for two"
    with pytest.raises(ValueError, match=words):
        pm.BoucWen((0, 1), k=1.0, fy=1.0)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_arrays_of_copies_and_pickles_are_read_only_too(again):
    """Dofs of springs, and the indices of sparse matrices, are read by couplers made later."""
    spring = again(pm.CubicSpring([(0, 1)], k=1.0, k3=2.0))
    ones = np.ones(40)
    K = sp.diags_array([-ones[1:], 3.0 * ones, -ones[1:]], offsets=[-1, 0, 1]).tocsr()
    a = again(pm.Subdomain(ones, K, scheme=pm.Newmark(), restoring=spring))
    tie = again(pm.Constraint({a: sp.csr_array(np.eye(1, 40))}))
    (L,) = tie.matrices.values()
    for array in (spring.dofs, spring.k, a.K.indices, a.K.indptr, L.indices, L.data):
        assert not array.flags.writeable


def test_steps_that_times_cannot_tell_apart_are_refused():
    a = pm.Subdomain([1.0], [1e-30], scheme=pm.Newmark(), name="a")
    c = pm.Coupler([a], dt=1e12)
    c.step(10)
    with pytest.raises(ValueError, match=r"dt must be at least 2 at t = 1e\+13, .* got 1e-05"):
        c.change_steps(dt=1e-5)
    c.step(1)
    assert c.time == 1.1e13
