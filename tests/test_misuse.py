"""What may be done with couplers, arrays and loads without harm, and what is an error."""

import copy
import math
import pickle
import sys

import numpy as np
import pytest
import scipy.sparse as sp
from refusals import (
    EXPLICIT,
    PAIR,
    as_bytes,
    coupled,
    moved,
    refused,
    single,
    subdomain,
    two_subdomains,
)

import pmalpha as pm


@pytest.mark.parametrize("dt", [1e300, 1e160])
def test_a_step_whose_square_overflows_is_an_error_that_names_the_step_or_the_matrix(dt):
    for form in (np.asarray, sp.csr_array):
        with pytest.raises((ValueError, pm.FactorizationError)) as caught:
            pm.Coupler([subdomain(K=form(PAIR), name="a")], dt=dt)
        assert "dt" in str(caught.value) or "'a'" in str(caught.value)


@pytest.mark.parametrize("dt", [1e-160, 1e-300])
def test_tiny_steps_cause_no_motion_and_no_error(dt):
    coupler = pm.Coupler([subdomain(K=PAIR, u0=[1.0, 0.5])], dt=dt)
    history = coupler.run(steps=10)[0]
    assert np.all(history.u == [1.0, 0.5]) and np.all(np.isfinite(history.a))


def test_a_step_that_is_subnormal_is_an_error_and_no_infinity():
    # h / substeps underflows or H does: there is no way to solve for the multipliers
    a, b = single(), single(substeps=2)
    with pytest.raises((ValueError, pm.FactorizationError)):
        pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=5e-324, coupling="pm")


def test_a_million_substeps_in_a_macro_step_are_computed():
    coupler = pm.Coupler([single(scheme=EXPLICIT, substeps=10**6, u0=[1.0])], dt=1.0)
    coupler.step()
    # cos(1) by a second-order scheme with omega h = 1e-6: 1e6 roundings of 1e-16 remain
    assert coupler.state(0).u[0] == pytest.approx(math.cos(1.0), abs=1e-9)


def test_arrays_of_subdomains_and_loads_are_read_only_copies():
    # K in the right-hand side and another K in the factor would be silently wrong
    names = "u0", "v0", "force", "values", "shape"
    given = dict.fromkeys(names, np.ones(2)) | {"values": np.ones((3, 1)), "shape": np.ones((2, 1))}
    u0, v0, force, values, shape = given.values()
    s = subdomain(K=PAIR, C=0.1 * PAIR, force=force, u0=u0, v0=v0)
    loads = pm.SampledForce(values, 0.1, shape=shape), pm.SampledForce(values, 0.1)
    kept = [getattr(s, name) for name in ("M", "K", "C", "u0", "v0", "force")]
    kept += [loads[0].values, loads[0].shape, loads[1].values]
    for array in given.values():
        array[...] = 9.0
    for array in kept:
        assert not np.any(array == 9.0)
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 9.0


def test_states_and_histories_are_copies():
    coupler = moved(coupled())
    expected = as_bytes(moved(coupled()))
    history = coupler.run(steps=0)
    for x in "uva":
        getattr(coupler.state("a"), x)[:] = getattr(history["a"], x)[:] = 9.0
    coupler.multipliers[:] = history.multipliers[:] = 9.0
    history.velocity_jump[:] = history.displacement_jump[:] = 9.0
    assert as_bytes(coupler) == expected


def test_a_load_that_makes_couplers_without_end_is_a_recursion_error():
    def load(t):
        return pm.Coupler([single(force=load)], dt=0.1).state(0).u

    limit_before = sys.getrecursionlimit()
    sys.setrecursionlimit(400)
    try:
        with pytest.raises(RecursionError):
            load(0.0)
    finally:
        sys.setrecursionlimit(limit_before)


def test_a_shallow_copy_of_a_coupler_does_not_share_its_state():
    # it may be refused, as a deep one and pickling are
    coupler = coupled()
    try:
        other = copy.copy(coupler)
    except TypeError:
        return
    other.step()
    assert coupler.step_count == 0


def test_pickling_a_coupler_is_a_type_error():
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="pickle"):
            copied(coupled())


def test_subdomains_schemes_and_histories_can_be_copied_and_pickled():
    for again in (copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))):
        a, b, tie = again(two_subdomains())
        coupler = pm.Coupler([a, b], tie, dt=0.1, coupling="pm")
        assert again(a.scheme) == a.scheme and repr(again(b.scheme)) == repr(b.scheme)
        history = coupler.run(steps=4)
        np.testing.assert_array_equal(again(history)["b"].u, history["b"].u)
        coupler.reset()
        assert as_bytes(coupler) == as_bytes(coupled())


class Loud(np.ndarray):
    """An array whose own methods return wrong values."""

    def __array_ufunc__(self, ufunc, method, *inputs, **options):
        return np.array(True)

    def copy(self, order="C"):
        raise AssertionError("copied")


def test_subclasses_of_ndarray_are_read_as_numbers():
    values = {"M": np.ones(2), "K": PAIR, "u0": np.array([1.0, 0.5])}
    ours = subdomain(**{name: x.view(Loud) for name, x in values.items()})
    theirs = subdomain(**values)
    assert as_bytes(pm.Coupler([ours], dt=0.1)) == as_bytes(pm.Coupler([theirs], dt=0.1))
    bad = np.array([1.0, np.nan]).view(Loud)
    refused(ValueError, lambda: subdomain(u0=bad), "u0", "finite")


def test_one_dof_and_no_constraints_is_the_smallest_problem():
    coupler = pm.Coupler([single(u0=[1.0])], dt=0.1)
    history = coupler.run(steps=3)
    assert history.multipliers.shape == history.velocity_jump.shape == (4, 0)
    assert coupler.multipliers.shape == (0,)
    assert pm.Coupler([single()], [], dt=0.1).run(steps=1)[0].u.shape == (2, 1)


def test_nothing_may_be_recorded():
    history = coupled().run(steps=2, record={})
    assert history.multipliers.shape == (7, 1)
    history = coupled().run(steps=2, record={"a": []})
    assert history["a"].u.shape == (3, 0)
    refused(MemoryError, lambda: coupled().run(steps=10**15, record={}), "History")
