"""Arrays, loads and records that the C extension refuses: an exception, never a crash."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import numpy as np
import pytest
from core_objects import (
    NONE,
    check_refused,
    coupler,
    f64,
    i32,
    i64,
    in_a_process,
    read_only,
    record,
    started,
    step,
    subdomain,
)

import pmalpha as pm
from pmalpha import _core
from pmalpha.problem import forms

# ---- wrong arrays -------------------------------------------------------------------------------


BAD_VECTORS = {  # in place of a float64 array of shape (2,)
    "float32": np.ones(2, np.float32),
    "int64": np.ones(2, np.int64),
    "complex": np.ones(2, complex),
    "big-endian": np.ones(2, ">f8"),
    "objects": np.ones(2, object),
    "not contiguous": np.ones(4)[::2],
    "backwards": np.ones(2)[::-1],
    "unaligned": np.zeros(17, np.uint8)[1:].view(np.float64),
    "short": np.ones(1),
    "long": np.ones(3),
    "empty": np.empty(0),
    "no axes": np.array(1.0),
    "three axes": np.ones((2, 1, 1)),
    "list": [1.0, 1.0],
    "number": 1.0,
    "text": "11",
    "bytes": b"1111111111111111",
    "memoryview": memoryview(np.ones(2)),
    "empty tuple": (),
}


@pytest.mark.parametrize("kind", BAD_VECTORS)
def test_arrays_of_another_kind_are_refused_everywhere(kind):
    bad, (c, s) = BAD_VECTORS[kind], started()
    two, one = np.ones(2), np.ones(1)
    for call in (
        lambda: subdomain(K=bad),
        lambda: subdomain(C=bad),
        lambda: subdomain(single=(step(), bad, None)),
        lambda: subdomain(twice=(step(0.2), bad, None)),
        lambda: s.set_load(bad),
        lambda: s.start(bad, two, two, one),
        lambda: s.start(two, bad, two, one),
        lambda: s.start(two, two, bad, one),
        lambda: s.set_levels(s.levels() | {"u": bad}),
        lambda: s.set_levels(s.levels() | {"a": bad}),
        lambda: s.set_levels(bad),
        lambda: s.set_load(forms.Sampled(bad, None, 0.1, True, 0.0)),
        lambda: s.set_load(forms.Table(bad, 0)),
    ):
        check_refused(call)
    if kind != "short":  # one is right for the only constraint
        check_refused(lambda: s.start(two, two, two, bad))
        check_refused(lambda: s.set_levels(s.levels() | {"vf": bad}))
        check_refused(lambda: c.start(0, bad, one))
        check_refused(lambda: c.start(0, one, bad))
        check_refused(lambda: coupler(H=(bad, None)))
        check_refused(lambda: coupler(H_start=(bad, None)))
    assert c.advance(1, None) is None  # none of these calls changed anything


@pytest.mark.parametrize(
    "K",
    {
        "wide": np.ones((2, 3)),
        "Fortran": np.asfortranarray(np.arange(4.0).reshape(2, 2)),
        "float32": np.ones((2, 2), np.float32),
        "3 x 3": np.ones((3, 3)),
        "strided": np.ones((4, 4))[::2, ::2],
    }.values(),
)
def test_dense_matrices_of_another_kind_are_refused(K):
    check_refused(lambda: subdomain(K=K))
    check_refused(lambda: subdomain(single=(step(), np.ones(2), K)))


def compressed(ptr=(0, 1, 2), index=(0, 1), values=(1.0, 1.0)):
    return forms.Compressed(i64(*ptr), i32(*index), f64(*values))


BAD_COMPRESSED = {
    "a column too far": compressed(index=(0, 2)),
    "a negative column": compressed(index=(0, -1)),
    "the smallest column": compressed(index=(0, -(2**31))),
    "the largest column": compressed(index=(0, 2**31 - 1)),
    "descending starts": compressed(ptr=(0, 2, 1), index=(0,), values=(1.0,)),
    "a start far beyond": compressed(ptr=(0, 10**9, 2)),
    "a start far before": compressed(ptr=(0, -(10**9), 2)),
    "first start not zero": compressed(ptr=(1, 1, 2)),
    "negative first start": compressed(ptr=(-1, 1, 2)),
    "negative end": compressed(ptr=(0, 1, -2)),
    "end too large": compressed(ptr=(0, 1, 2**62)),
    "few starts": compressed(ptr=(0, 2)),
    "many starts": compressed(ptr=(0, 1, 2, 2)),
    "no starts": forms.Compressed(i64(), i32(), f64()),
    "few indices": compressed(index=(0,)),
    "few values": compressed(values=(1.0,)),
    "two parts": compressed()[:2],
    "four parts": (*compressed(), None),
    "int32 starts": forms.Compressed(i32(0, 1, 2), i32(0, 1), f64(1.0, 1.0)),
    "int64 indices": forms.Compressed(i64(0, 1, 2), i64(0, 1), f64(1.0, 1.0)),
    "float starts": forms.Compressed(f64(0, 1, 2), i32(0, 1), f64(1.0, 1.0)),
    "Nones": forms.Compressed(None, None, None),
}


@pytest.mark.parametrize("kind", BAD_COMPRESSED)
def test_compressed_matrices_that_are_wrong_in_themselves_are_refused(kind):
    bad = BAD_COMPRESSED[kind]
    check_refused(lambda: subdomain(K=bad))
    check_refused(lambda: subdomain(C=bad))
    check_refused(lambda: subdomain(single=(step(), np.ones(2), bad)))
    check_refused(lambda: subdomain(twice=(step(0.2), np.ones(2), bad)))


def test_bands_that_do_not_fit_are_refused():
    two = np.zeros((2, 2))
    for band in (
        np.zeros((3, 2)),  # wider than the matrix
        np.zeros((0, 2)),
        np.zeros((2, 3)),
        np.zeros(2),
        np.zeros((2, 2, 1)),
        two.astype(np.float32),
        two.T[::-1],
        [[1.0, 1.0], [0.0, 0.0]],
        None,
    ):
        check_refused(lambda band=band: subdomain(K=(band,)))
    subdomain(K=(two,))
    for band in (two, np.zeros((2, 0)), np.zeros((3, 1)), np.zeros(2), None):
        check_refused(lambda band=band: subdomain(single=(step(), np.ones(2), (band,))))
    subdomain(single=(step(), np.ones(2), (np.zeros((2, 1)),)))


def strips(**others):
    """Two rows that share the columns 0, 1, 1, 1."""
    parts = {"first": i64(0, 2), "ptr": i64(0, 4), "index": i32(0, 1, 1, 1)}
    parts |= {"start": i64(0, 8), "values": np.zeros(8)}
    return tuple((parts | others).values())


def test_strips_that_are_wrong_in_themselves_are_refused():
    subdomain(K=strips())
    for others in (
        {"first": i64(0, 3)},
        {"first": i64(0, 1)},
        {"first": i64(1, 2)},
        {"first": i64()},
        {"first": i64(0, 0, 2)},
        {"ptr": i64(0, 3), "index": i32(0, 1, 1), "start": i64(0, 6), "values": np.zeros(6)},
        {"ptr": i64(0, -4)},
        {"ptr": i64(0, 2**62)},
        {"index": i32(0, 1, 1, 2)},
        {"index": i32(0, 1, 1, -1)},
        {"index": i64(0, 1, 1, 1)},
        {"index": i32(0, 1, 1)},
        {"start": i64(0, 4), "values": np.zeros(4)},
        {"start": i64(4, 12), "values": np.zeros(12)},
        {"start": i64(0, -8)},
        {"values": np.zeros(7)},
        {"values": None},
    ):
        check_refused(lambda others=others: subdomain(K=strips(**others)))
        check_refused(
            lambda others=others: subdomain(single=(step(), np.ones(2), strips(**others)))
        )


def test_a_factor_is_solved_with_if_it_is_right_in_itself():
    b = np.array([2.0, 3.0])
    lower = forms.Factor(np.array([1.0, 0.5]), compressed(ptr=(0, 1, 1), index=(1,), values=(4.0,)))
    # by hand: R = (1, 0; 4, 1), D = (1, 2): R y = b is y = (2, -5), then R^T x = (2, -2.5)
    np.testing.assert_array_equal(_core.solve(lower, b), [12.0, -2.5])
    for bad in (None, (), (b,), forms.Factor(b, compressed(ptr=(0, 1, 1), index=(0,)))):
        check_refused(lambda bad=bad: _core.solve(bad, b))
    check_refused(lambda: _core.solve(lower, np.ones(3)))


def test_strips_are_made_of_a_matrix_by_rows_that_is_right_in_itself():
    for bad in (*BAD_COMPRESSED.values(), None, (), np.zeros((2, 2)), strips()):
        if bad is not BAD_COMPRESSED["few starts"] and bad is not BAD_COMPRESSED["many starts"]:
            check_refused(lambda bad=bad: _core.strips(bad))
            check_refused(lambda bad=bad: _core.permuted(bad, i64(0, 1)))
    first, ptr, index, start, values = _core.strips(compressed(index=(0, 1), values=(2.0, 3.0)))
    assert (first[-1], ptr[-1], index.size, start[-1], values.size) == (2, 4, 4, 8, 8)
    assert values.tolist() == [2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0]


def estimated(**others):
    parts = {"motion": (np.zeros((3, 2)),) * 3, "begin": i64(0, 1), "end": i64(1, 2), "h": 0.1}
    return _core.step_errors(*(parts | others).values())


def test_steps_whose_errors_are_estimated_must_be_recorded():
    three, short = np.zeros((3, 2)), np.zeros((2, 2))
    assert estimated().shape == (2, 2)
    for others in (
        {"motion": ()},
        {"motion": None},
        {"motion": (None,) * 3},
        {"motion": (three, three)},
        {"motion": (three, three, short)},
        {"motion": (np.zeros(3),) * 3},
        {"begin": i64(-1, 1)},
        {"begin": i32(0, 1)},
        {"begin": i64(0)},
        {"end": i64(1, 3)},
        {"h": None},
    ):
        check_refused(lambda others=others: estimated(**others))


def test_a_matrix_is_permuted_by_a_permutation_of_its_size():
    A = compressed(ptr=(0, 2, 3), index=(1, 0, 1), values=(2.0, 3.0, 4.0))
    for bad in (i64(0), i64(0, 1, 2), i64(0, 0), i64(0, 2), i64(0, -1), i32(0, 1), None, f64(0, 1)):
        check_refused(lambda bad=bad: _core.permuted(A, bad))
    ptr, index, values = _core.permuted(A, i64(1, 0))
    assert (ptr.tolist(), index.tolist(), values.tolist()) == (
        [0, 1, 3],
        [0, 0, 1],
        [4.0, 2.0, 3.0],
    )


def test_filters_that_remember_too_much_are_refused():
    """Their numbers would overflow to few: what is beyond them was written."""
    none, one = np.zeros(0), np.ones(1)
    phi = np.zeros((0, 0))
    late = forms.Actuator(np.array([2**63 - 1]), one, np.inf, phi, none, none, one, 0.0, 0.0, 0)
    adaptive = forms.Adaptive(0.01, np.zeros((4, 3)), 0.05, 1, 2**62, np.zeros((1, 5)))
    for own, message in ((late, "lag is out of range"), (adaptive, "too large")):
        with pytest.raises(ValueError, match=message):
            _core.follow_specimen(
                forms.Specimen((own,), None, (), None, None, 0, 0, 0.0),
                np.zeros(9),
                *np.zeros((3, 9, 1)),
            )


def test_lanes_are_split_into_arrays_of_their_shape():
    lanes = np.arange(6.0 * _core.LANES).reshape(2, 3 * _core.LANES)
    vectors = tuple(np.zeros((2, 3)) for _ in range(2))
    _core.split_lanes(lanes, vectors)
    assert all(np.array_equal(x, lanes[:, k :: _core.LANES]) for k, x in enumerate(vectors))
    frozen = np.zeros((2, 3))
    frozen.setflags(write=False)
    for bad in ((None,), (np.zeros((3, 2)),), (frozen,), (vectors[0],) * 9, None):
        check_refused(lambda bad=bad: _core.split_lanes(lanes, bad))
    check_refused(lambda: _core.split_lanes(np.zeros((2, 3)), vectors))


def test_factors_may_have_entries_below_the_diagonal_only_and_ascending():
    for R in (
        compressed(ptr=(0, 1, 1), index=(0,), values=(1.0,)),  # on the diagonal
        compressed(ptr=(0, 0, 1), index=(0,), values=(1.0,)),  # above it
        compressed(ptr=(0, 0, 1), index=(2,), values=(1.0,)),  # outside
        compressed(ptr=(0, 2, 2), index=(1, 1), values=(1.0, 1.0)),  # twice
    ):
        check_refused(lambda R=R: subdomain(single=(step(), np.ones(2), R)))
    subdomain(single=(step(), np.ones(2), compressed(ptr=(0, 1, 1), index=(1,), values=(0.5,))))


BAD_LINKS = {
    "None": None,
    "number": 5,
    "empty": (),
    "one part": (1,),
    "list": [1, i64(0, 1), i32(0), f64(1.0)],
    "negative p": (-1, i64(0, 1), i32(0), f64(1.0)),
    "p as float": (1.0, i64(0, 1), i32(0), f64(1.0)),
    "p beyond": (2**70, i64(0, 1), i32(0), f64(1.0)),
    "row too far": (1, i64(0, 1), i32(1), f64(1.0)),
    "negative row": (1, i64(0, 1), i32(-1), f64(1.0)),
    "negative end": (1, i64(0, -1), i32(0), f64(1.0)),
    "end too large": (1, i64(0, 2**62), i32(0), f64(1.0)),
    "few starts": (1, i64(0), i32(), f64()),
    "many starts": (1, i64(0, 1, 1), i32(0), f64(1.0)),
    "few values": (1, i64(0, 1), i32(0), f64()),
    "other p than the coupler": (2, i64(0, 1), i32(0), f64(1.0)),
}


@pytest.mark.parametrize("kind", BAD_LINKS)
def test_links_that_are_wrong_are_refused(kind):
    check_refused(lambda: coupler(subdomains=(subdomain(link=BAD_LINKS[kind]),)))


BAD_SIZES = {
    "no dofs": {"n": 0},
    "negative dofs": {"n": -1},
    "too many dofs": {"n": 2**62},
    "dofs beyond ssize_t": {"n": 2**63},
    "dofs as float": {"n": 2.0},
    "dofs as text": {"n": "2"},
    "dofs as None": {"n": None},
    "more interface than dofs": {"nb": 3},
    "negative interface": {"nb": -1},
    "no substeps": {"substeps": 0},
    "negative substeps": {"substeps": -1},
    "nine constants": {"single": (step()[:9], np.ones(2), None)},
    "a length for constants": {"single": (0.1, np.ones(2), None)},
    "constants of text": {"single": ("abcdefghij", np.ones(2), None)},
    "no constants": {"single": (None, np.ones(2), None)},
    "no operator": {"single": None},
    "half an operator": {"single": (step(), np.ones(2))},
    "operator of text": {"single": ("h", np.ones(2), None)},
    "operator as list": {"single": [step(), np.ones(2), None]},
    "number for a double operator": {"twice": 5},
}


@pytest.mark.parametrize("kind", BAD_SIZES)
def test_sizes_and_operators_that_are_wrong_are_refused(kind):
    check_refused(lambda: subdomain(**BAD_SIZES[kind]))


BAD_COUPLERS = {
    "no schedule": {"schedule": "often"},
    "a schedule that iterates nothing": {"schedule": "iterated"},
    "a schedule of no contacts": {"schedule": "contact"},
    "a schedule of an earlier version": {"schedule": "tied"},
    "list of subdomains": {"subdomains": []},
    "None among subdomains": {"subdomains": (None,)},
    "the public class": {"subdomains": (pm.Subdomain([1.0], [1.0], scheme=pm.Newmark()),)},
    "no subdomains": {"subdomains": (), "p": 0, "H": NONE, "H_start": NONE},
    "other p": {"p": 2, "H": (np.ones(2), None), "H_start": (np.ones(2), None)},
    "negative p": {"p": -1},
    "huge p": {"p": 2**62},
    "no H": {"H": None},
    "half an H": {"H": (np.ones(1),)},
    "H too large": {"H": (np.ones(2), None)},
    "H_start too small": {"H_start": NONE},
    "H not square": {"H": (np.ones(1), np.ones((1, 2)))},
    "H with an entry on the diagonal": {"H": (np.ones(1), (i64(0, 1), i32(0), f64(1.0)))},
    "dt of text": {"options": {"dt": "0.1"}},
    "no dt": {"options": {}},
    "a number of threads below zero": {"options": {"dt": 0.1, "threads": -1}},
    "an option that the core has not": {"options": {"dt": 0.1, "drift": "kept"}},
    "an option without a name": {"options": {1: 0.1}},
    "options as list": {"options": [("dt", 0.1)]},
    "motions as list": {"motions": [i64(0)]},
    "a motion of a row too far": {"motions": (i64(1),)},
    "a motion of a negative row": {"motions": (i64(-1),)},
    "a motion of more rows than there are": {"motions": (i64(0, 0),)},
    "a motion of int32": {"motions": (i32(0),)},
    "None for a motion": {"motions": (None,)},
}


@pytest.mark.parametrize("kind", BAD_COUPLERS)
def test_couplers_of_arguments_that_do_not_fit_are_refused(kind):
    check_refused(lambda: coupler(**BAD_COUPLERS[kind]))


def test_substeps_that_do_not_divide_are_refused():
    check_refused(lambda: coupler(subdomains=(subdomain(substeps=2), subdomain(substeps=3))))


# ---- loads and motions --------------------------------------------------------------------------


def sampled(values, shape=None, dt=0.1):
    return forms.Sampled(values, shape, dt, True, 0.0)


BAD_LOADS = {
    "samples without rows": sampled(np.ones((0, 2))),
    "samples with negative dt": sampled(np.ones((3, 2)), dt=-0.1),
    "samples with dt = 0": sampled(np.ones((3, 2)), dt=0.0),
    "samples with dt = NaN": sampled(np.ones((3, 2)), dt=np.nan),
    "samples of another width": sampled(np.ones((3, 1))),
    "shape of another width": sampled(np.ones((3, 1)), np.ones((1, 3))),
    "shape of another height": sampled(np.ones((3, 1)), np.ones((2, 2))),
    "samples of one axis": sampled(np.ones(3)),
    "samples without a beginning": {"values": np.ones((3, 2)), "dt": 0.1},
    "table of another width": forms.Table(np.ones((3, 3)), 0),
    "table of one axis": forms.Table(np.ones(3), 0),
    "table from half a step": forms.Table(np.ones((3, 2)), 0.5),
    "table from beyond": forms.Table(np.ones((3, 2)), 2**70),
    "function of Python": forms.Called(abs, i64(0, 1)),
    "function without an order": {"function": abs},
    "sum of numbers": (1, 2, 3),
    "sum with a sum": (f64(1.0, 2.0), (f64(1.0, 2.0),)),
    "list": [f64(1.0, 2.0)],
    "other fields": {"f": f64(1.0, 2.0)},
}


@pytest.mark.parametrize("kind", BAD_LOADS)
def test_loads_that_do_not_fit_are_refused_and_the_old_one_is_kept(kind):
    c, s = started()
    s.set_load(f64(1.0, 2.0))
    check_refused(lambda: s.set_load(BAD_LOADS[kind]))
    other, t = started()
    t.set_load(f64(1.0, 2.0))
    assert c.advance(3, None) is None and other.advance(3, None) is None
    np.testing.assert_array_equal(s.state()[0], t.state()[0])


@pytest.mark.parametrize("first, rows, steps, fits", [
    (0, 30, 10, True), (-5, 35, 10, True), (0, 31, 10, True), (0, 29, 10, False),
    (1, 30, 10, False), (0, 0, 1, False), (0, 0, 0, True), (-(2**62), 30, 10, False),
    (2**63 - 1, 30, 10, False), (-(2**63), 30, 10, False), (2**62, 30, 10, False),
])  # fmt: skip
def test_a_table_must_cover_the_steps(first, rows, steps, fits):
    # three substeps in a macro step
    for what in ("load", "motion"):
        c, s = started(motions=(i64(0),), substeps=3)
        if what == "load":
            s.set_load(forms.Table(np.ones((rows, 2)), first))
        else:
            c.set_motion(0, forms.Table(np.ones((rows, 1)), first))
        if fits:
            assert c.advance(steps, None) is None
        else:
            with pytest.raises(ValueError, match="table"):
                c.advance(steps, None)
            assert c.step_count == 0


def test_missing_motions_are_refused():
    c, _ = started(motions=(i64(0),))
    for i in (1, -1, 2**62, 2**70, None, 0.0):
        check_refused(lambda i=i: c.set_motion(i, f64(1.0)))
    for load in (f64(1.0, 2.0), [1.0], 5, forms.Table(np.ones((3, 2)), 0)):
        check_refused(lambda load=load: c.set_motion(0, load))


# ---- records ------------------------------------------------------------------------------------


BAD_RECORDS = {
    "number": 5,
    "list": list(record()),
    "plain tuple": tuple(record()),
    "no fields": {},
    "three fields": {"begin": 0, "every": 0, "selections": ()},
    "too short": record(rows=10),
    "no rows": record(rows=0),
    "u shorter than the others": record(u=np.zeros((10, 2))),
    "a longer than the others": record(a=np.zeros((12, 2))),
    "read-only": record(v=read_only(11, 2)),
    "three columns": record(v=np.zeros((11, 3))),
    "one column": record(a=np.zeros((11, 1))),
    "float32": record(u=np.zeros((11, 2), np.float32)),
    "Fortran order": record(u=np.asfortranarray(np.zeros((11, 2)))),
    "one axis": record(u=np.zeros(22)),
    "negative dof": record(position=(-1,)),
    "dof too far": record(position=(2,)),
    "positions as int32": record(position=(), **{"u": np.zeros((11, 2))}),
    "of two subdomains": record(parts=2),
    "of no subdomain": record(parts=0),
    "nodes as list": record()._replace(selections=[None]),
    "number for nodes": record()._replace(selections=(5,)),
    "short nodes": record()._replace(selections=({"position": i64(0)},)),
    "two constraints": record(p=2),
    "no constraints": record(p=0),
    "rows of macro steps too short": record(macro_rows=10),
    "no rows of macro steps": record(macro_rows=0),
    "begins tomorrow": record(begin=1),
    "begins before zero": record(begin=-1),
    "begins beyond": record(begin=2**70),
    "negative every": record(every=-1),
    "every third and too short": record(rows=3, every=3),
    "read-only jump": record()._replace(velocity_jump=read_only(11, 1)),
}


@pytest.mark.parametrize("kind", BAD_RECORDS)
def test_records_that_do_not_fit_are_refused_before_the_first_step(kind):
    c, _ = started()
    check_refused(lambda: c.advance(10, BAD_RECORDS[kind]))
    assert c.step_count == 0
    assert c.advance(10, record()) is None  # and the coupler is not left busy


def test_records_that_do_not_fit_the_present_time_are_refused():
    c, _ = started()
    for bad in (5, None, record(rows=0), record(position=(2,)), record(parts=2), record(begin=1)):
        check_refused(lambda bad=bad: c.record_present(bad))
    c.record_present(record(rows=1))


def test_energies_are_recorded_only_where_works_are_summed_up():
    c, s = started()
    room = np.zeros((11, 1, 7))
    check_refused(lambda: c.advance(10, record()._replace(energy=room)))  # not begun
    mass, two, one = np.ones(2), np.zeros(2), np.zeros(1)
    for bad in (
        (np.ones(3), None, two, one, None),
        (mass, np.ones(3), two, one, None),
        (mass, None, one, one, None),
        (mass, None, two, two, None),
        (mass, None, two, one),
        (mass, None, two, one, two),
        (3, 3, 3, 3, 3),
    ):
        check_refused(lambda bad=bad: s.begin_energy(*bad))
    pattern = np.array([0, 1, 2]), np.array([0, 2], dtype=np.int32), np.ones(2)
    check_refused(lambda: s.begin_energy(pattern, None, two, one, None))
    check_refused(lambda: s.begin_energy(mass, pattern, two, one, None))
    s.begin_energy(mass, None, two, one, None)
    s.begin_energy(mass, None, two, one, None)  # the record begins at the present step
    locked = room.copy()
    locked.setflags(write=False)
    for bad in (
        room[:10],
        np.zeros((11, 2, 7)),
        np.zeros((11, 1, 5)),
        np.zeros((11, 7)),
        locked,
        3,
    ):
        check_refused(lambda bad=bad: c.advance(10, record()._replace(energy=bad)))
    c.record_present(record()._replace(energy=room))
    assert c.advance(10, record()._replace(energy=room)) is None
    u, v, _ = s.state()
    assert room[10, 0, 0] == 0.5 * (v[0] * v[0] + v[1] * v[1]) and room[10, 0, 1] > 0.0
    s.end_energy()
    s.end_energy()
    check_refused(lambda: c.advance(1, record(begin=10)._replace(energy=room)))


def test_a_record_of_nothing_is_a_record():
    c, _ = started()
    assert c.advance(10, record()._replace(selections=(None,))) is None
    assert c.advance(2**10, record(rows=1 + (10 + 2**10) // 1000, every=1000)) is None


def test_a_record_is_not_written_beyond_its_rows_when_their_number_overflows():
    # 2^53 macro steps of 2^31 substeps are 2^84, which is 0 in size_t: eleven rows are not enough
    code = """
c, s = started(substeps=2**31)
try:
    c.advance(2**53, record(rows=11))
except (ValueError, OverflowError) as error:
    print("refused")
"""
    assert "refused" in in_a_process(code)
