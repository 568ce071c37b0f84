"""Fixed dofs: the reduced matrices, and the map between free dofs and all dofs."""

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import reduce
from pmalpha.reduction.fixed_dofs import Reduction

RANDOM = np.random.default_rng(0)
HALF = RANDOM.normal(size=(6, 6))
FULL = HALF + HALF.T + 12.0 * np.eye(6)  # diagonally dominant enough to be definite
FREE, FIXED = [0, 2, 5], [1, 3, 4]
LEFT = np.ix_(FREE, FREE)


def whole_of(A):
    return A.toarray() if sp.issparse(A) else np.diag(A) if A.ndim == 1 else A


# ---- the matrices -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form", [np.asarray, np.ndarray.tolist, sp.csr_array, sp.csc_matrix, sp.coo_array, sp.lil_array]
)
def test_rows_and_columns_of_fixed_dofs_are_left_out_in_every_format(form):
    reduced = reduce(np.arange(1.0, 7.0), form(FULL), form(2.0 * FULL), fixed=FIXED)
    np.testing.assert_array_equal(reduced.M.toarray(), np.diag([1.0, 3.0, 6.0]))
    np.testing.assert_array_equal(whole_of(reduced.K), FULL[LEFT])
    np.testing.assert_array_equal(whole_of(reduced.C), 2.0 * FULL[LEFT])
    assert sp.issparse(reduced.K) == sp.issparse(form(FULL))
    assert pm.Subdomain(reduced.M, reduced.K, C=reduced.C, scheme=pm.Newmark()).n == 3


@pytest.mark.parametrize(
    "fixed",
    [
        [1, 3, 4],
        (4, 1, 3),
        [4, 1, 1, 3, 4],  # two edges that share a corner
        np.array([1, 3, 4], dtype=np.uint8),
        [False, True, False, True, True, False],
    ],
)
def test_fixed_dofs_are_numbers_in_any_order_or_a_mask(fixed):
    reduced = reduce(FULL, FULL, fixed=fixed)
    assert (reduced.n, reduced.free.tolist(), reduced.fixed.tolist()) == (6, FREE, FIXED)
    np.testing.assert_array_equal(reduced.M, FULL[LEFT])


@pytest.mark.parametrize("fixed", [[], np.zeros(6, dtype=bool)])
def test_nothing_fixed_leaves_all_as_it_was(fixed):
    reduced = reduce(FULL, FULL, fixed=fixed)
    assert reduced.free.tolist() == list(range(6)) and reduced.fixed.size == 0
    np.testing.assert_array_equal(reduced.K, FULL)
    np.testing.assert_array_equal(reduced.expand(np.arange(6.0)), np.arange(6.0))


def test_the_last_dofs_can_be_fixed():
    reduced = reduce(FULL, sp.csr_array(FULL), fixed=[3, 4, 5])
    np.testing.assert_array_equal(reduced.M, FULL[:3, :3])
    np.testing.assert_array_equal(reduced.K.toarray(), FULL[:3, :3])


def test_a_matrix_of_zeros_stays_a_matrix_and_none_stays_none():
    reduced = reduce(np.ones(3), np.zeros((3, 3)), sp.csr_array((3, 3)), fixed=[0])
    assert reduced.K.shape == reduced.C.shape == (2, 2) and reduced.K.nnz == reduced.C.nnz == 0
    reduced = reduce(np.ones(3), None, fixed=[0])
    assert reduced.K is None and reduced.C is None


def test_the_input_is_neither_changed_nor_shared():
    M, K = np.ones(3), sp.csr_array(np.diag([1.0, 2.0, 3.0]))
    reduced = reduce(M, K, fixed=[])
    M[0], K.data[0] = 7.0, 7.0
    assert reduced.M.diagonal().tolist() == [1.0, 1.0, 1.0]
    assert reduced.K.diagonal().tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="read-only"):
        reduced.free[0] = 1
    with pytest.raises(AttributeError):
        reduced.M = M


# ---- the map ----------------------------------------------------------------------------------


def of_six():
    return reduce(np.ones(6), np.ones(6), fixed=FIXED)


@pytest.mark.parametrize("shape", [(), (4,), (2, 4), (0,)])
def test_expand_puts_zeros_at_the_fixed_dofs_of_any_stack(shape):
    u = RANDOM.normal(size=(*shape, 3))
    whole = of_six().expand(u)
    assert whole.shape == (*shape, 6)
    np.testing.assert_array_equal(whole[..., FREE], u)
    assert not whole[..., FIXED].any()


def test_expand_keeps_complex_modes_and_makes_floats_of_whole_numbers():
    assert of_six().expand([1j, 2.0, 0.0])[0] == 1j
    assert of_six().expand([1, 2, 3]).dtype == np.float64


def test_reduce_motion_is_expand_backwards():
    u = RANDOM.normal(size=(4, 3))
    np.testing.assert_array_equal(of_six().reduce_motion(of_six().expand(u)), u)


def test_a_motion_of_a_fixed_dof_is_refused_and_its_rounding_is_not():
    u = np.array([1.0, 0.0, 1.0, 0.0, 1e-15, 1.0])
    assert of_six().reduce_motion(u).tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(ValueError, match="zero at the fixed dofs, got up to 0.5 at dofs 3, 4"):
        of_six().reduce_motion([u, u + [0.0, 0.0, 0.0, 0.5, -0.1, 0.0]])
    with pytest.raises(ValueError, match=r"u must be finite, got nan at \[3\]"):
        of_six().reduce_motion([0.0, 0.0, 0.0, np.nan, 0.0, 0.0])


def test_reduce_load_leaves_out_what_goes_into_the_supports():
    np.testing.assert_array_equal(of_six().reduce_load(np.arange(12).reshape(2, 6))[1], [6, 8, 11])


def test_place_finds_dofs_of_the_whole_among_the_free_ones():
    reduced = of_six()
    assert reduced.place([5, 0, 2, 0]).tolist() == [2, 0, 1, 0]
    assert reduced.place(5) == 2
    assert reduced.place([[0, 2], [2, 5]]).tolist() == [[0, 1], [1, 2]]
    assert reduced.place([]).dtype.kind == "i" and reduced.place([]).size == 0
    np.testing.assert_array_equal(reduced.free[reduced.place(FREE)], FREE)


@pytest.mark.parametrize(
    "dofs, message",
    [
        ([0, 4, 1], "dofs must be free, got the fixed ones 1, 4"),
        ([6], r"dofs must lie in 0\.\.5, got 6"),
        ([-7], r"dofs must lie in -6\.\.5, got -7"),
    ],
)
def test_place_refuses_dofs_that_are_fixed_or_do_not_exist(dofs, message):
    with pytest.raises(ValueError, match=message):
        of_six().place(dofs)


@pytest.mark.parametrize("dofs", [[0.0], [[True] * 6], ["a"]])
def test_place_accepts_whole_numbers_only(dofs):
    with pytest.raises(TypeError, match="dofs must be a 1-D array of whole numbers"):
        of_six().place(dofs)


@pytest.mark.parametrize("name, size", [("expand", 3), ("reduce_load", 6), ("reduce_motion", 6)])
def test_arrays_of_another_length_are_refused(name, size):
    call = getattr(of_six(), name)
    for wrong in (np.ones(5), np.ones((size, 5)), 1.0):
        with pytest.raises(ValueError, match=f"must have {size} in the last dimension"):
            call(wrong)
    with pytest.raises(TypeError, match="must hold numbers, got dtype"):
        call(["a"] * size)
    with pytest.raises(TypeError, match="masked"):
        call(np.ma.ones(size))


# ---- in a run ---------------------------------------------------------------------------------


def test_a_reduced_run_is_that_of_the_whole_with_the_dof_held_by_a_constraint():
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    M, load = np.array([1.0, 2.0, 3.0]), np.array([4.0, 0.0, 1.0])
    whole = pm.Subdomain(M, K, scheme=pm.GeneralizedAlpha(0.5), force=load, name="whole")
    held = pm.Constraint({whole: [[1.0, 0.0, 0.0]]})
    expected = pm.Coupler([whole], held, dt=0.1).run(steps=50)["whole"]

    reduced = reduce(M, K, fixed=[0])
    short = pm.Subdomain(
        reduced.M, reduced.K, scheme=pm.GeneralizedAlpha(0.5), force=reduced.reduce_load(load)
    )
    history = pm.solve(short, dt=0.1, t_end=5.0)
    for name in "uva":
        # the same equations, solved otherwise: 50 steps of rounding, values up to 5
        np.testing.assert_allclose(
            reduced.expand(getattr(history, name)), getattr(expected, name), rtol=0.0, atol=1e-13
        )
    assert np.abs(expected.u[:, 1:]).max() > 1.0


# ---- errors -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fixed, message",
    [
        ([6], r"fixed must lie in 0\.\.5, got 6"),
        ([-7], r"fixed must lie in -6\.\.5, got -7"),
        ([True, False], r"fixed must be a mask of shape \(6,\), got shape \(2,\)"),
        (range(6), "fixed must leave a dof free, got all 6"),
        (np.ones(6, dtype=bool), "fixed must leave a dof free, got all 6"),
    ],
)
def test_invalid_fixed_dofs_are_refused(fixed, message):
    with pytest.raises(ValueError, match=message):
        reduce(np.ones(6), np.ones(6), fixed=fixed)


@pytest.mark.parametrize("fixed", [[1.0], 1.0, [[1, 2]], "left", None, np.ones((6, 1), dtype=bool)])
def test_fixed_dofs_of_the_wrong_kind_are_refused(fixed):
    with pytest.raises(TypeError, match="fixed must be a 1-D array of whole numbers"):
        reduce(np.ones(6), np.ones(6), fixed=fixed)


def test_matrices_are_checked_with_the_dofs_of_the_whole():
    skew = FULL.copy()
    skew[5, 2] += 1.0
    with pytest.raises(ValueError, match=r"K must be symmetric, got .* at \[2, 5\]"):
        reduce(np.ones(6), skew, fixed=[0, 1])
    with pytest.raises(ValueError, match="C must be of size 6 like M"):
        reduce(np.ones(6), np.ones(6), np.ones(5), fixed=[0])
    with pytest.raises(ValueError, match=r"M must be finite, got nan at \[0\]"):
        reduce([np.nan, 1.0], np.ones(2), fixed=[0])
    with pytest.raises(TypeError, match="M must hold real numbers"):
        reduce(None, np.ones(2), fixed=[0])


def test_the_repr_of_a_reduction_has_both_sizes():
    assert repr(of_six()) == "<Reduction of 6 dofs to 3>"
    assert isinstance(of_six(), Reduction)


def test_a_consistent_mass_on_moving_ground_needs_the_load_of_the_whole_matrix():
    # a rod of one element, its left end driven with acceleration t: once with the end in the model
    # and its velocity prescribed, once relative to the ground with the end left out
    M, K = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0, np.array([[1.0, -1.0], [-1.0, 1.0]])
    scheme = pm.GeneralizedAlpha(0.9)
    driven = pm.Subdomain(M, K, scheme=scheme, name="rod")
    motion = pm.Constraint({driven: [[1.0, 0.0]]}, velocity=lambda t: [t * t / 2.0])
    absolute = pm.Coupler([driven], motion, dt=0.01).run(2.0)["rod"].u

    reduction = reduce(M, K, fixed=[0])
    ramp = np.arange(201) * 0.01
    load = pm.SampledForce(ramp, 0.01, shape=-reduction.reduce_load(M @ np.ones(2)))
    relative = pm.Subdomain(reduction.M, reduction.K, scheme=scheme, force=load)
    u = pm.solve(relative, 0.01, 2.0).u[:, 0]
    # both are of order 2: omega dt = 0.017, and u is of size 1; without the coupling term the load
    # is 2/6 instead of 3/6
    np.testing.assert_allclose(u, absolute[:, 1] - absolute[:, 0], rtol=0, atol=1e-4)
    short = pm.BaseAcceleration(ramp, [1.0], reduction.M, dt=0.01)
    wrong = pm.Subdomain(reduction.M, reduction.K, scheme=scheme, force=short)
    assert np.max(np.abs(pm.solve(wrong, 0.01, 2.0).u[:, 0] - u)) > 0.1
