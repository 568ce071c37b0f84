"""The private types of the C extension: misuse is an exception, never a crash; signals and threads.

Tests that might crash the interpreter run in another process.
"""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import ast
import contextlib
import copy
import gc
import importlib
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import waits
from scipy.linalg import cython_blas

import pmalpha as pm
from pmalpha import _core

# ---- valid arguments, to be replaced one by one by invalid ones -------------------------------


def i64(*x):
    return np.array(x, dtype=np.int64)


def i32(*x):
    return np.array(x, dtype=np.int32)


def f64(*x):
    return np.array(x, dtype=np.float64)


def operator(n=2, h=0.1):
    """(h, inverse, R) of a unit matrix."""
    return h, np.ones(n), None


def subdomain_arguments(**others):
    """Two masses, the last one in the only constraint; trapezoidal rule."""
    parts = {"n": 2, "nb": 1, "substeps": 1, "K": f64(4.0, 9.0), "C": None}
    h = 0.1 / max(others.get("substeps", 1), 1)  # of a macro step of 0.1
    parts |= {"scheme": (0.0, 0.0, 0.25, 0.5), "single": operator(h=h), "twice": None}
    parts |= {"link": (1, i64(0, 1), i32(0), f64(1.0))}
    return parts | others


def subdomain(**others):
    return _core.Subdomain(**subdomain_arguments(**others))


ONE = (np.ones(1), None)  # the factor of a 1 x 1 unit matrix
NONE = (np.empty(0), None)


def coupler_arguments(**others):
    parts = {"subdomains": (subdomain(),), "p": 1, "H_start": ONE, "H": ONE}
    return parts | {"dt": 0.1, "rebased": True, "motions": ()} | others


def coupler(**others):
    return _core.Coupler(**coupler_arguments(**others))


def started(motions=(), subdomains=None, **of_subdomain):
    """A coupler of one subdomain that moves, and the subdomain."""
    s = subdomain(**of_subdomain) if subdomains is None else subdomains[0]
    c = coupler(subdomains=(s,) if subdomains is None else subdomains, motions=motions)
    s.start(f64(1.0, 0.5), f64(0.0, 0.25), f64(-4.0, -4.5), np.zeros(1))
    c.start(0, np.zeros(1), np.zeros(1))
    return c, s


def record(rows=11, *, macro_rows=None, begin=0, every=0, parts=1, p=1, position=(0, 1), **others):
    """(begin, every, nodes, multipliers, velocity jump, displacement jump)"""
    columns = len(position)

    def nodes():
        given = {x: np.zeros((rows, columns)) for x in "uvw"} | {"position": i64(*position)}
        given |= others
        return tuple(given[x] for x in ("position", "u", "v", "w"))

    macro = rows if macro_rows is None else macro_rows
    jumps = np.zeros((rows, p)), np.zeros((rows, p)), np.zeros((macro, p))
    return (begin, every, tuple(nodes() for _ in range(parts)), *jumps)


def in_a_process(code):
    """The output of another Python process with these helpers; its death by a signal fails."""
    head = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
    head += "from test_binding import *\nfrom pmalpha import _core\n"
    done = subprocess.run(
        [sys.executable, "-c", head + code], capture_output=True, text=True, timeout=waits.LIMIT
    )
    assert done.returncode >= 0, f"died by signal {-done.returncode}: {done.stderr[-500:]}"
    return done.stdout + done.stderr


# ---- names ----------------------------------------------------------------------------------


def test_the_stub_names_what_the_module_has():
    tree = ast.parse(Path(_core.__file__).with_name("_core.pyi").read_text())
    stub = {node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
    stub |= {node.target.id for node in tree.body if isinstance(node, ast.AnnAssign)}
    assert stub == {name for name in dir(_core) if not name.startswith("__")}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            members = {m.name for m in node.body if isinstance(m, ast.FunctionDef)}
            members |= {m.target.id for m in node.body if isinstance(m, ast.AnnAssign)}
            members = {name for name in members if not name.startswith("__")}
            there = {name for name in vars(getattr(_core, node.name)) if not name.startswith("__")}
            assert members == there


def test_the_library_exports_its_init_function_and_nothing_else():
    nm = shutil.which("nm")
    if nm is None or sys.platform != "linux":
        pytest.skip("needs nm of a Linux toolchain")
    lines = subprocess.run([nm, "-D", "--defined-only", _core.__file__], capture_output=True)
    names = {line.split()[-1] for line in lines.stdout.decode().splitlines()}
    assert names - {"_init", "_fini"} == {"PyInit__core"}


@pytest.mark.parametrize("name", ["Subdomain", "Coupler"])
def test_the_types_belong_to_the_module_and_cannot_be_changed(name):
    cls = getattr(_core, name)
    assert cls.__module__ == "pmalpha._core" and cls.__doc__
    with pytest.raises(TypeError, match="immutable"):
        cls.extra = 1
    with pytest.raises(TypeError, match="not an acceptable base type"):
        type("Sub", (cls,), {})
    with pytest.raises(AttributeError):
        (subdomain() if name == "Subdomain" else coupler()).extra = 1


@pytest.mark.parametrize("cls", [_core.Subdomain, _core.Coupler])
def test_objects_cannot_be_made_without_their_arguments(cls):
    for make in (cls, lambda: cls.__new__(cls), lambda: object.__new__(cls), lambda: cls(None)):
        with pytest.raises(TypeError):
            make()
    with pytest.raises(TypeError):
        cls(**(subdomain_arguments() | coupler_arguments()))


def test_objects_cannot_be_copied_or_pickled():
    for made in (subdomain(), coupler()):
        for copied in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match="pickle"):
                copied(made)


def test_methods_refuse_objects_of_another_type():
    s, c = subdomain(), coupler()
    for call in (
        lambda: _core.Subdomain.state(c),
        lambda: _core.Subdomain.start(5, 1, 2, 3, 4),
        lambda: _core.Coupler.advance(s, 1, None),
        lambda: _core.Coupler.step_count.__get__(s),
    ):
        with pytest.raises(TypeError):
            call()
    for name in ("step_count", "multipliers", "prescribed"):
        with pytest.raises(AttributeError):
            setattr(c, name, 1)
        with pytest.raises(AttributeError):
            delattr(c, name)


def test_calling_init_again_does_nothing():
    c, s = started()
    before = s.state()
    s.__init__()
    c.__init__()
    for x, y in zip(before, s.state(), strict=True):
        np.testing.assert_array_equal(x, y)


def test_the_module_can_be_loaded_again():
    again = importlib.reload(_core)
    assert again.Subdomain is not None
    c, _ = started()
    assert c.advance(3, None) is None


# ---- wrong arrays ---------------------------------------------------------------------------

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
REFUSED = (TypeError, ValueError, OverflowError)  # never SystemError, which is a bug of the binding


def check_refused(call):
    with pytest.raises(REFUSED):
        call()


@pytest.mark.parametrize("kind", BAD_VECTORS)
def test_arrays_of_another_kind_are_refused_everywhere(kind):
    bad, (c, s) = BAD_VECTORS[kind], started()
    two, one = np.ones(2), np.ones(1)
    for call in (
        lambda: subdomain(K=bad),
        lambda: subdomain(C=bad),
        lambda: subdomain(single=(0.1, bad, None)),
        lambda: subdomain(twice=(0.2, bad, None)),
        lambda: s.set_load(bad),
        lambda: s.start(bad, two, two, one),
        lambda: s.start(two, bad, two, one),
        lambda: s.start(two, two, bad, one),
        lambda: s.set_levels((bad, two, two, two, one)),
        lambda: s.set_levels((two, two, two, bad, one)),
        lambda: s.set_levels(bad),
        lambda: s.set_load((bad, None, 0.1, True)),
        lambda: s.set_load((bad, 0)),
    ):
        check_refused(call)
    if kind != "short":  # one is right for the only constraint
        check_refused(lambda: s.start(two, two, two, bad))
        check_refused(lambda: s.set_levels((two, two, two, two, bad)))
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
    check_refused(lambda: subdomain(single=(0.1, np.ones(2), K)))


def compressed(ptr=(0, 1, 2), index=(0, 1), values=(1.0, 1.0)):
    return i64(*ptr), i32(*index), f64(*values)


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
    "no starts": (i64(), i32(), f64()),
    "few indices": compressed(index=(0,)),
    "few values": compressed(values=(1.0,)),
    "two parts": compressed()[:2],
    "four parts": (*compressed(), None),
    "int32 starts": (i32(0, 1, 2), i32(0, 1), f64(1.0, 1.0)),
    "int64 indices": (i64(0, 1, 2), i64(0, 1), f64(1.0, 1.0)),
    "float starts": (f64(0, 1, 2), i32(0, 1), f64(1.0, 1.0)),
    "Nones": (None, None, None),
}


@pytest.mark.parametrize("kind", BAD_COMPRESSED)
def test_compressed_matrices_that_are_wrong_in_themselves_are_refused(kind):
    bad = BAD_COMPRESSED[kind]
    check_refused(lambda: subdomain(K=bad))
    check_refused(lambda: subdomain(C=bad))
    check_refused(lambda: subdomain(single=(0.1, np.ones(2), bad)))
    check_refused(lambda: subdomain(twice=(0.2, np.ones(2), bad)))


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
        check_refused(lambda band=band: subdomain(single=(0.1, np.ones(2), (band,))))
    subdomain(single=(0.1, np.ones(2), (np.zeros((2, 1)),)))


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
        check_refused(lambda others=others: subdomain(single=(0.1, np.ones(2), strips(**others))))


def test_strips_are_made_of_a_matrix_by_rows_that_is_right_in_itself():
    for bad in (*BAD_COMPRESSED.values(), None, (), np.zeros((2, 2)), strips()):
        if bad is not BAD_COMPRESSED["few starts"] and bad is not BAD_COMPRESSED["many starts"]:
            check_refused(lambda bad=bad: _core.strips(bad))
            check_refused(lambda bad=bad: _core.permuted(bad, i64(0, 1)))
        check_refused(lambda bad=bad: _core.columns_of(bad, compressed()))
        check_refused(lambda bad=bad: _core.columns_of(compressed(), bad))
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


def test_a_recursion_needs_a_square_matrix_of_its_size():
    P, x = np.array([[2.0]]), np.array([[1.0], [10.0], [100.0]])
    assert _core.follow_recursion(P, x).ravel().tolist() == [1.0, 12.0, 124.0]
    assert x[1, 0] == 10.0
    for bad in ((P, x[:, 0]), (np.ones((1, 2)), x), (np.ones((2, 2)), x), (P, None), (x, P)):
        check_refused(lambda bad=bad: _core.follow_recursion(*bad))


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
    late = (np.array([2**63 - 1]), one, np.inf, np.zeros((0, 0)), none, none, one, 0.0, 0.0, 0)
    adaptive = (0.01, np.zeros((4, 3)), 0.05, 1, 2**62, np.zeros((1, 5)))
    for own, message in ((late, "lag is out of range"), (adaptive, "not too large")):
        with pytest.raises(ValueError, match=message):
            _core.follow_specimen(((own,), (), None, 0), np.zeros(9), *np.zeros((2, 9, 1)))


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
        check_refused(lambda R=R: subdomain(single=(0.1, np.ones(2), R)))
    subdomain(single=(0.1, np.ones(2), compressed(ptr=(0, 1, 1), index=(1,), values=(0.5,))))


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
    "short scheme": {"scheme": (0.0, 0.0)},
    "scheme of text": {"scheme": "abcd"},
    "no scheme": {"scheme": None},
    "no operator": {"single": None},
    "half an operator": {"single": (0.1, np.ones(2))},
    "operator of text": {"single": ("h", np.ones(2), None)},
    "operator as list": {"single": [0.1, np.ones(2), None]},
    "number for a double operator": {"twice": 5},
}


@pytest.mark.parametrize("kind", BAD_SIZES)
def test_sizes_and_operators_that_are_wrong_are_refused(kind):
    check_refused(lambda: subdomain(**BAD_SIZES[kind]))


BAD_COUPLERS = {
    "no schedule": {"schedule": "often"},
    "a schedule that iterates nothing": {"schedule": "iterated"},
    "a schedule of no contacts": {"schedule": "contact"},
    "a schedule of no second multipliers": {"schedule": "tied"},
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
    "dt of text": {"dt": "0.1"},
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


# ---- loads and motions ------------------------------------------------------------------------

BAD_LOADS = {
    "samples without rows": (np.ones((0, 2)), None, 0.1, True),
    "samples with negative dt": (np.ones((3, 2)), None, -0.1, True),
    "samples with dt = 0": (np.ones((3, 2)), None, 0.0, True),
    "samples with dt = NaN": (np.ones((3, 2)), None, np.nan, True),
    "samples of another width": (np.ones((3, 1)), None, 0.1, True),
    "shape of another width": (np.ones((3, 1)), np.ones((1, 3)), 0.1, True),
    "shape of another height": (np.ones((3, 1)), np.ones((2, 2)), 0.1, True),
    "samples of one axis": (np.ones(3), None, 0.1, True),
    "table of another width": (np.ones((3, 3)), 0),
    "table of one axis": (np.ones(3), 0),
    "table from half a step": (np.ones((3, 2)), 0.5),
    "table from beyond": (np.ones((3, 2)), 2**70),
    "three parts": (1, 2, 3),
    "five parts": (1, 2, 3, 4, 5),
    "one part": (np.ones((3, 2)),),
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
            s.set_load((np.ones((rows, 2)), first))
        else:
            c.set_motion(0, (np.ones((rows, 1)), first))
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
    for load in (f64(1.0, 2.0), [1.0], 5, (np.ones((3, 2)), 0)):
        check_refused(lambda load=load: c.set_motion(0, load))


# ---- records ----------------------------------------------------------------------------------


def read_only(*shape):
    array = np.zeros(shape)
    array.flags.writeable = False
    return array


BAD_RECORDS = {
    "number": 5,
    "list": list(record()),
    "Nones": (None,) * 6,
    "three parts": (0, 0, ()),
    "too short": record(rows=10),
    "no rows": record(rows=0),
    "u shorter than the others": record(u=np.zeros((10, 2))),
    "w longer than the others": record(w=np.zeros((12, 2))),
    "read-only": record(v=read_only(11, 2)),
    "three columns": record(v=np.zeros((11, 3))),
    "one column": record(w=np.zeros((11, 1))),
    "float32": record(u=np.zeros((11, 2), np.float32)),
    "Fortran order": record(u=np.asfortranarray(np.zeros((11, 2)))),
    "one axis": record(u=np.zeros(22)),
    "negative dof": record(position=(-1,)),
    "dof too far": record(position=(2,)),
    "positions as int32": record(position=(), **{"u": np.zeros((11, 2))}),
    "of two subdomains": record(parts=2),
    "of no subdomain": record(parts=0),
    "nodes as list": (0, 0, [None], *record()[3:]),
    "number for nodes": (0, 0, (5,), *record()[3:]),
    "short nodes": (0, 0, ((i64(0),),), *record()[3:]),
    "two constraints": record(p=2),
    "no constraints": record(p=0),
    "rows of macro steps too short": record(macro_rows=10),
    "no rows of macro steps": record(macro_rows=0),
    "begins tomorrow": record(begin=1),
    "begins before zero": record(begin=-1),
    "begins beyond": (2**70, *record()[1:]),
    "negative every": record(every=-1),
    "every third and too short": record(rows=3, every=3),
    "read-only jump": (*record()[:4], read_only(11, 1), np.zeros((11, 1))),
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
    check_refused(lambda: c.advance(10, (*record(), room)))  # not begun
    mass, two, one = np.ones(2), np.zeros(2), np.zeros(1)
    for bad in (
        (np.ones(3), None, two, one),
        (mass, np.ones(3), two, one),
        (mass, None, one, one),
        (mass, None, two, two),
        (mass, None, two),
        (3, 3, 3, 3),
    ):
        check_refused(lambda bad=bad: s.begin_energy(*bad))
    pattern = np.array([0, 1, 2]), np.array([0, 2], dtype=np.int32), np.ones(2)
    check_refused(lambda: s.begin_energy(pattern, None, two, one))
    check_refused(lambda: s.begin_energy(mass, pattern, two, one))
    s.begin_energy(mass, None, two, one)
    s.begin_energy(mass, None, two, one)  # the record begins at the present step
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
        check_refused(lambda bad=bad: c.advance(10, (*record(), bad)))
    c.record_present((*record(), room))
    assert c.advance(10, (*record(), room)) is None
    u, v, _ = s.state()
    assert room[10, 0, 0] == 0.5 * (v[0] * v[0] + v[1] * v[1]) and room[10, 0, 1] > 0.0
    s.end_energy()
    s.end_energy()
    check_refused(lambda: c.advance(1, (*record(begin=10), room)))


def test_a_record_of_nothing_is_a_record():
    c, _ = started()
    assert c.advance(10, (0, 0, (None,), *record()[3:])) is None
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


# ---- order of calls -----------------------------------------------------------------------------


def test_nothing_runs_before_a_start():
    c = coupler()
    for call in (lambda: c.advance(1, None), lambda: c.advance(0, None)):
        with pytest.raises(RuntimeError, match="no initial state"):
            call()
    assert c.step_count == 0


def test_counts_of_steps_are_whole_and_not_negative():
    c, _ = started()
    for steps in (-1, 1.0, None, "1", 2**63, 2**70):
        check_refused(lambda steps=steps: c.advance(steps, None))
    for begin in (-1, 1.0, None, 2**63):
        check_refused(lambda begin=begin: c.start(begin, np.zeros(1), np.zeros(1)))
    for args in ((), (1,), (1, None, 3), (1, None, None, None)):
        check_refused(lambda args=args: c.advance(*args))


def test_a_count_of_steps_that_overflows_is_refused():
    c, _ = started()
    check_refused(lambda: c.start(2**63 - 1, np.zeros(1), np.zeros(1)))
    assert c.step_count == 0
    c.start(2**53, np.zeros(1), np.zeros(1))
    check_refused(lambda: c.advance(1, None))
    assert c.step_count == 2**53


def test_a_count_of_substeps_that_overflows_is_refused():
    # 2^53 substeps can be counted: 2^41 macro steps of 2^12
    c, _ = started(substeps=2**12)
    check_refused(lambda: c.start(2**41 + 1, np.zeros(1), np.zeros(1)))
    assert c.step_count == 0
    c.start(2**41 - 1, np.zeros(1), np.zeros(1))
    check_refused(lambda: c.advance(2, None))
    assert c.advance(1, None) is None
    assert c.step_count == 2**41


def test_compliance_is_computed_for_existing_constraints_only():
    s = subdomain()
    for rows in (i64(1), i64(-1), i64(0, 5), i32(0), [0], None, f64(0), i64(0).reshape(1, 1)):
        check_refused(lambda rows=rows: s.compliance(False, rows))
    check_refused(lambda: s.compliance(True, i64(0)))  # it takes no double steps
    assert s.compliance(False, i64()).shape == (0, 0)
    # al2 = h / 2, all the rest is one
    np.testing.assert_array_equal(s.compliance(False, i64(0, 0)), np.full((2, 2), 0.05))
    huge = subdomain(link=(2**62, i64(0, 1), i32(0), f64(1.0)))
    with pytest.raises(MemoryError):
        huge.compliance(False, i64(0))


def test_saved_states_are_restored_as_they_were():
    for twice, count in ((None, 7), (operator(h=0.2), 14)):
        c, s = started(twice=twice)
        c.advance(3, None)
        nodes = s.levels()
        assert len(nodes) == count
        c.advance(2, None)
        after = s.levels()
        s.set_levels(nodes)
        c.start(3, c.multipliers, np.zeros(1))
        c.advance(2, None)
        for x, y in zip(s.levels()[:6], after[:6], strict=True):
            np.testing.assert_array_equal(x, y)
        for bad in (nodes[:-1], (*nodes, nodes[0]), list(nodes), None, ()):
            check_refused(lambda bad=bad: s.set_levels(bad))


def test_lengths_of_steps_that_do_not_agree_are_refused():
    # the double step is twice as long, to the last bit; h substeps = dt to two roundings
    h = 0.1 / 3
    coupler(subdomains=(subdomain(substeps=3, single=operator(h=h), twice=operator(h=2 * h)),))
    with pytest.raises(ValueError, match="lengths of steps do not agree"):
        subdomain(substeps=3, single=operator(h=h), twice=operator(h=2 * h * (1 + 1e-12)))
    for wrong in (0.1, h * (1 + 1e-12), np.nan):
        with pytest.raises(ValueError, match="lengths of steps do not agree"):
            coupler(subdomains=(subdomain(substeps=3, single=operator(h=wrong)),))


def test_arrays_that_cannot_be_written_are_refused_for_unit_responses():
    s = subdomain(substeps=2, responds=True)
    arrays = {"end": np.zeros((1, 1)), "mean": np.zeros((1, 1)), "states": np.zeros((1, 4, 2))}
    assert s.unit_responses(i64(0), *arrays.values())
    kept = {name: array.copy() for name, array in arrays.items()}
    for name, array in arrays.items():
        array.flags.writeable = False
        with pytest.raises(ValueError, match=f"{name} must be writeable"):
            s.unit_responses(i64(0), *arrays.values())
        array.flags.writeable = True
        np.testing.assert_array_equal(array, kept[name])
    for threads in (0, -1, 1025):
        with pytest.raises(ValueError, match="threads must lie in 1..1024"):
            s.unit_responses(i64(0), *arrays.values(), False, threads)


def test_the_number_of_steps_is_not_read_while_they_are_made():
    seen = []

    def report(count):
        seen.append(count)
        with pytest.raises(RuntimeError, match="being stepped"):
            _ = c.step_count

    c, _ = started()
    c.advance(1_000_000, None, report)
    assert seen and c.step_count == 1_000_000


def test_the_same_subdomain_twice_in_a_coupler_is_refused():
    out = in_a_process("""
s = subdomain(substeps=3, twice=operator(h=2 * (0.1 / 3)))
try:
    started(subdomains=(s, s))
except RuntimeError:
    print("refused")
_ = s.state()  # it is free again
""")
    assert "refused" in out


def test_a_coupler_of_no_subdomains_can_be_interrupted():
    # an empty loop of 2^62 steps must check for signals or not begin
    code = """
none = np.empty(0)
try:
    c = _core.Coupler((), 0, NONE, NONE, 0.1, True, ())
    c.start(0, none, none)
    with waits.ctrl_c_when(lambda: True, after=0.2):
        c.advance(2**62, None)
except (KeyboardInterrupt, TypeError, ValueError):
    print("stopped")
"""
    assert "stopped" in in_a_process(code)


# ---- patterns and panels ------------------------------------------------------------------------


def test_patterns_that_are_wrong_in_themselves_are_refused():
    for call in (
        lambda ptr, index: _core.count_factor(ptr, index),
        lambda ptr, index: _core.postorder(ptr, index, 0),
        lambda ptr, index: _core.supernodes(ptr, index, 0),
    ):
        for ptr, index in (
            (i64(), i32()),
            (i64(0, 3), i32(0)),
            (i64(0, -1), i32()),
            (i64(1, 1), i32(0)),
            (i64(0, 1), i32(1)),
            (i64(0, 1), i32(-1)),
            (i64(0, 2, 1), i32(0)),
            (i64(0, 10**9, 1), i32(0)),
            (i32(0, 1), i32(0)),
            (i64(0, 1), i64(0)),
            (None, None),
            (i64(0, 1), None),
        ):
            check_refused(lambda call=call, ptr=ptr, index=index: call(ptr, index))
    ptr, index = i64(0, 1, 2), i32(1, 0)
    for nb in (-1, 3, 2**62, 1.0, None):
        check_refused(lambda nb=nb: _core.postorder(ptr, index, nb))
        check_refused(lambda nb=nb: _core.supernodes(ptr, index, nb))


def test_an_empty_pattern_has_an_empty_factor():
    assert _core.count_factor(i64(0), i32()).size == 0
    assert _core.postorder(i64(0), i32(), 0).size == 0


def test_a_pattern_that_is_not_symmetric_is_no_crash():
    # two full blocks, and entries of one triangle between them
    code = """
b = 60
A = np.kron(np.eye(2), np.ones((b, b)))
for corner in (np.s_[:b, b:], np.s_[b:, :b]):
    B = A.copy()
    B[corner] = 1.0
    S = sp.csr_array(B)
    for nb in (0, 1, b, 2 * b):
        for call in (_core.postorder, _core.supernodes):
            try:
                call(S.indptr.astype(np.int64), S.indices.astype(np.int32), nb)
            except ValueError:
                pass
gc.collect()
print("alive")
"""
    assert "alive" in in_a_process(code)


def panels_of(A, nb=0):
    """A matrix and the arguments of factor_panels for it."""
    S = sp.csr_array(A)
    matrix = S.indptr.astype(np.int64), S.indices.astype(np.int32), S.data
    structure = _core.supernodes(*matrix[:2], nb)
    return matrix, structure, np.zeros(structure[3][-1]), np.zeros(S.shape[0])


BLAS = tuple(cython_blas.__pyx_capi__[name] for name in ("dgemm", "dtrsm"))
SPD = 4.0 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)
# two full blocks, coupled by their last dofs: two supernodes, the first with rows below
TWO_BLOCKS = np.kron(np.eye(2), np.ones((60, 60))) + 200.0 * np.eye(120)
TWO_BLOCKS[50:60, 110:] = TWO_BLOCKS[110:, 50:60] = 1.0


def factor(matrix, structure, values, inverse, lost=1e-14, blas=BLAS, threads=2):
    return _core.factor_panels(matrix, structure, values, inverse, lost, 1e8, *blas, threads)


def test_panels_of_arrays_that_do_not_fit_are_refused():
    matrix, structure, values, inverse = panels_of(TWO_BLOCKS)
    assert factor(matrix, structure, values, inverse) is None
    first, row_ptr, rows, start, owner = structure
    assert rows.size
    for spoiled in (
        structure[:4],
        (np.zeros_like(first), row_ptr, rows, start, owner),
        (first[:-1], row_ptr, rows, start, owner),
        (first, row_ptr[::-1].copy(), rows, start, owner),
        (first, np.zeros_like(row_ptr), rows, start, owner),
        (first, row_ptr, rows - 1000, start, owner),
        (first, row_ptr, rows + 1000, start, owner),
        (first, row_ptr, rows[::-1].copy(), start, owner),
        (first, row_ptr, rows[:-1], start, owner),
        (first, row_ptr, rows, np.zeros_like(start), owner),
        (first, row_ptr, rows, start, owner + 99),
        (first, row_ptr, rows, start, owner - 99),
        (first, row_ptr, rows, start, owner[::-1].copy()),
        (first, row_ptr, rows, start, owner[:-1]),
        (None,) * 5,
        None,
    ):
        check_refused(lambda spoiled=spoiled: factor(matrix, spoiled, values, inverse))
    for call in (
        lambda: factor(None, structure, values, inverse),
        lambda: factor(matrix[:2], structure, values, inverse),
        lambda: factor(matrix, structure, values[:-1], inverse),
        lambda: factor(matrix, structure, values.astype(np.float32), inverse),
        lambda: factor(matrix, structure, read_only(values.size), inverse),
        lambda: factor(matrix, structure, values, inverse[:-1]),
        lambda: factor(matrix, structure, values, read_only(inverse.size)),
        lambda: factor(matrix, structure, values, inverse, lost="x"),
        lambda: factor(matrix, structure, values, inverse, threads=0),
        lambda: factor(matrix, structure, values, inverse, threads=1025),
        lambda: factor(matrix, structure, values, inverse, threads=2**62),
        lambda: factor(matrix, structure, values, inverse, threads=None),
    ):
        check_refused(call)


def test_a_matrix_that_is_not_definite_is_reported_with_its_column():
    A = SPD.copy()
    A[4, 4] = -4.0
    assert factor(*panels_of(A)) == 4


def test_panels_made_for_another_pattern_are_refused():
    A = TWO_BLOCKS.copy()
    A[55, 70] = A[70, 55] = 1.0
    matrix = panels_of(A)[0]
    check_refused(lambda: factor(matrix, *panels_of(TWO_BLOCKS)[1:]))


def test_anything_but_a_blas_routine_is_refused():
    # any capsule has a pointer; its name is the signature of the function
    code = """
other = cython_blas.__pyx_capi__["drotg"]
for blas in ((None, None), (5, 5), (BLAS[0], None), (other, BLAS[1]), (BLAS[0], other)):
    try:
        factor(*panels_of(TWO_BLOCKS), blas=blas)
        print("taken")
    except (TypeError, ValueError):
        print("refused")
"""
    out = in_a_process(code)
    assert "taken" not in out and out.count("refused") == 5


def test_panels_that_are_not_closed_under_elimination_are_no_crash():
    # rows 1000.. of the first column are not rows of the second, which it updates
    code = """
n = 3000
first, owner = np.arange(n + 1), np.arange(n)
rows = np.arange(1, n, dtype=np.int32)
row_ptr = np.full(n + 1, n - 1); row_ptr[0] = 0
start = np.concatenate([[0], n + np.arange(n)])
A = sp.lil_array(sp.eye_array(n))
A[0, :] = 0.001
A[:, [0]] = 0.001 * np.ones((n, 1))
A[0, 0] = 1.0
S = sp.csr_array(A)
matrix = S.indptr.astype(np.int64), S.indices.astype(np.int32), S.data
for _ in range(5):
    try:
        factor(matrix, (first, row_ptr, rows, start, owner), np.zeros(start[-1]), np.zeros(n))
    except ValueError:
        pass
gc.collect()
print("alive")
"""
    assert "alive" in in_a_process(code)


# ---- ownership ----------------------------------------------------------------------------------


class Watched(np.ndarray):
    """An array that can be watched."""


def watched(array):
    """The array, and a list that gets an entry when the array is freed."""
    array, gone = array.view(Watched), []
    weakref.finalize(array, gone.append, True)
    return array, gone


def test_arrays_live_as_long_as_the_core_points_into_them():
    K, gone = watched(f64(4.0, 9.0))
    load, load_gone = watched(f64(1.0, 2.0))
    c, s = started(K=K)
    expected, t = started()
    for x in (s, t):
        x.set_load(load if x is s else f64(1.0, 2.0))
    del K, load, x
    gc.collect()
    junk = [np.full(2, np.nan) for _ in range(1000)]  # would be allocated at the same address
    assert not gone and not load_gone
    c.advance(50, None)
    expected.advance(50, None)
    np.testing.assert_array_equal(s.state()[0], t.state()[0])
    s.set_load(None)
    assert load_gone and not gone
    del s
    gc.collect()
    assert not gone  # the coupler holds the subdomain
    del c
    gc.collect()
    assert gone
    del junk


def test_arrays_of_a_refused_object_are_released():
    K, gone = watched(f64(4.0, 9.0))
    with pytest.raises(ValueError):
        subdomain(K=K, link=(1, i64(0, 1), i32(7), f64(1.0)))
    del K
    gc.collect()
    assert gone


def test_a_cycle_through_an_array_is_collected():
    K, gone = watched(f64(4.0, 9.0))
    s = subdomain(K=K)
    K.owner = s
    del K, s
    gc.collect()
    assert gone


def test_reference_counts_are_what_they_were():
    K, u, two = f64(4.0, 9.0), np.ones(2), operator()
    twice = (0.2, two[1], None)
    link = (1, i64(0, 1), i32(0), f64(1.0))
    objects = [K, u, two, two[1], link, *link[1:], ONE, ONE[0], None, _core.Subdomain]
    objects += [_core.Coupler, record, BLAS[0]]

    def use():
        s = subdomain(K=K, single=two, twice=twice, link=link)
        c = coupler(subdomains=(s,), motions=(link[1][:1],))
        s.set_load(u)
        s.set_load((np.ones((3, 2)), 0))
        s.start(u, u, u, ONE[0])
        c.start(0, ONE[0], ONE[0])
        c.set_motion(0, ONE[0])
        c.advance(2, record(rows=3))
        s.set_levels(s.levels())
        s.compliance(True, i64(0))
        factor(*panels_of(SPD))
        for call in (
            lambda: subdomain(K=K, single=two, link=None),
            lambda: subdomain(K=K, single=two, link=(1, i64(0, 1), i32(7), f64(1.0))),
            lambda: coupler(H=(u, None)),
            lambda: coupler(motions=(i64(5),)),
            lambda: c.advance(1, 5),
            lambda: c.advance(1, record(rows=1)),
            lambda: s.set_load((u, None, 0.1, True)),
            lambda: s.set_levels((u,)),
            lambda: s.start(u, u, u, u),
            lambda: factor(None, None, u, u),
        ):
            with contextlib.suppress(TypeError, ValueError, SystemError):
                call()

    use()
    gc.collect()
    # the count of an immortal object, None from Python 3.12 on, has no meaning
    objects = [x for x in objects if sys.getrefcount(x) < 2**30]
    assert len(objects) > 8
    before = [sys.getrefcount(x) for x in objects]
    for _ in range(300):
        use()
    gc.collect()
    after = [sys.getrefcount(x) for x in objects]
    # one reference lost or kept in each of 300 rounds would be 300; None and the types are used by
    # whatever else runs
    assert max(abs(x - y) for x, y in zip(before, after, strict=True)) < 100


def resident():
    """Bytes of memory of this process."""
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is read")
def test_memory_of_the_core_is_freed():
    n = 20_000
    parts = {"n": n, "nb": 0, "K": np.ones(n), "single": operator(n, 0.05), "twice": operator(n)}
    parts |= {"link": (0, i64(0), i32(), f64()), "substeps": 2}

    def make():
        s = subdomain(**parts)
        c = coupler(subdomains=(s,), p=0, H=NONE, H_start=NONE)
        zero, none = np.zeros(n), np.empty(0)
        s.start(zero, zero, zero, none)
        c.start(0, none, none)
        s.levels()
        with contextlib.suppress(ValueError):
            subdomain(**parts | {"nb": 1, "link": (1, i64(0, 1), i32(9), f64(1.0))})

    for _ in range(10):
        make()
    before = resident()
    for _ in range(300):
        make()
    # four states of four vectors are 2.6 MB: 300 of them would be 770 MB; malloc keeps a few
    assert resident() - before < 50e6


# ---- threads --------------------------------------------------------------------------------


def long_run(n=1000, force=None):
    """A coupler that needs minutes for its steps, and their number."""
    K = sp.diags_array(
        [np.full(n, 2.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], offsets=[0, 1, -1]
    )
    a = pm.Subdomain(
        np.ones(n), sp.csr_array(K), scheme=pm.GeneralizedAlpha(0.5), u0=np.sin(np.arange(n)),
        substeps=2, force=force, name="a",
    )  # fmt: skip
    b = pm.Subdomain([1.0], [1.0], scheme=pm.GeneralizedAlpha(0.5), u0=[0.0], name="b")
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm"), 10_000_000


def test_one_of_two_threads_in_the_same_core_object_gets_a_runtime_error():
    c, s = started()
    errors, go = [], threading.Event()

    def meddle():
        go.wait()
        time.sleep(0.05)  # the other thread is in the core, for half a second
        none = np.zeros(1)
        for call in (
            lambda: c.advance(1, None),
            lambda: c.multipliers,
            lambda: c.prescribed,
            lambda: c.start(0, none, none),
            lambda: c.record_present(record(rows=1)),
            lambda: s.state(),
            lambda: s.levels(),
            lambda: s.set_levels(s.levels()),
            lambda: s.set_load(None),
            lambda: s.start(np.zeros(2), np.zeros(2), np.zeros(2), none),
            lambda: s.compliance(False, i64(0)),
            lambda: coupler(subdomains=(s,)).start(0, none, none),
        ):
            try:
                call()
            except Exception as error:
                errors.append(error)

    thread = threading.Thread(target=meddle)
    thread.start()
    go.set()
    begin = time.perf_counter()
    steps = 0
    while thread.is_alive() and time.perf_counter() - begin < 20.0:
        c.advance(2_000_000, None)
        steps += 2_000_000
    thread.join()
    assert steps == c.step_count
    assert [type(error) for error in errors] == [RuntimeError] * 12
    assert all("being stepped" in str(error) for error in errors)
    assert c.advance(1, None) is None


def test_many_threads_at_one_coupler_leave_it_as_one_would():
    c, _ = long_run(n=20)
    counts = {"done": 0, "refused": 0}
    other, _ = long_run(n=20)
    end = time.monotonic() + waits.LIMIT

    def work():
        while min(counts.values()) < 100 and time.monotonic() < end:
            for call in (lambda: c.run(steps=3), lambda: c.step(2), lambda: c.state("a")):
                try:
                    call()
                    counts["done"] += 1
                except RuntimeError:
                    counts["refused"] += 1

    switch = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(switch)
    assert min(counts.values()) >= 100
    other.step(c.step_count)
    for name in "ab":
        np.testing.assert_array_equal(c.state(name).u, other.state(name).u)


def test_couplers_of_the_same_subdomains_run_in_threads_at_once():
    first, _ = long_run(n=50)
    subdomains = [first.run(steps=0).keys[i][1] for i in range(2)]
    tie = pm.tie(subdomains[0], [0], subdomains[1], [0])
    couplers = [pm.Coupler(subdomains, tie, dt=0.1, coupling="pm") for _ in range(4)]
    threads = [threading.Thread(target=c.step, args=(2000,)) for c in couplers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    first.step(2000)
    for c in couplers:
        np.testing.assert_array_equal(c.state("a").u, first.state("a").u)


# ---- signals --------------------------------------------------------------------------------


def check_same_state(c, other):
    assert c.step_count == other.step_count
    np.testing.assert_array_equal(c.multipliers, other.multipliers)
    for name in "ab":
        for x in "uva":
            ours, theirs = getattr(c.state(name), x), getattr(other.state(name), x)
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("n", [1, 3, 1000])
def test_ctrl_c_ends_a_run_at_a_whole_macro_step(n):
    c, steps = long_run(n) if n > 1 else (one_dof(), 10**9)
    waits.interrupted_run(c, steps, every=1_000_000)
    done = c.step_count
    assert 0 < done < steps
    assert c.time == done * 0.1
    history = c.last_history
    assert history is not None and history[0].u.shape[0] == 1 + done // 1_000_000
    other = long_run(n)[0] if n > 1 else one_dof()
    other.step(done)
    np.testing.assert_array_equal(c.state(0).u, other.state(0).u)
    c.step(5)
    other.step(5)
    np.testing.assert_array_equal(c.state(0).u, other.state(0).u)
    np.testing.assert_array_equal(c.multipliers, other.multipliers)


def one_dof():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), u0=[1.0])
    return pm.Coupler([a], dt=0.1)


def test_ctrl_c_ends_a_single_macro_step_of_many_substeps():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.CentralDifference(), u0=[1.0], substeps=2**31)
    c = pm.Coupler([a], dt=0.1)
    with pytest.raises(KeyboardInterrupt), waits.ctrl_c_when(lambda: waits.is_stepped(c), 0.1):
        c.step()
    assert c.step_count == 0 and c.state(0).u[0] == 1.0


def test_the_history_of_an_interrupted_run_is_that_of_a_short_one():
    c, steps = long_run(100)
    options = {"record": {"a": [0, 99]}, "every": 10}
    waits.interrupted_run(c, steps, **options)
    history, done = c.last_history, c.step_count
    assert 0 < done < steps
    other, _ = long_run(100)
    expected = other.run(steps=done, **options)
    for x in ("t", "u", "v", "a"):
        np.testing.assert_array_equal(getattr(history["a"], x), getattr(expected["a"], x))
    for x in ("multipliers", "multiplier_times", "velocity_jump", "displacement_jump"):
        np.testing.assert_array_equal(getattr(history, x), getattr(expected, x))
    check_same_state(c, other)
    after, whole = c.run(steps=7), other.run(steps=7)
    np.testing.assert_array_equal(after["a"].u, whole["a"].u)


def test_ctrl_c_under_a_callable_load_evaluates_only_the_interrupted_time_twice():
    times_of_load = []

    def force(t):
        times_of_load.append(t)
        return np.full(20, np.sin(t))

    c, steps = long_run(20, force=force)
    other, _ = long_run(20, force=lambda t: np.full(20, np.sin(t)))
    times = 40  # the signal comes in the load, around it, or in the core
    for k in range(times):
        with pytest.raises(KeyboardInterrupt):
            with waits.ctrl_c_when(lambda: waits.is_stepped(c), 0.01 + 1e-4 * k):
                c.run(steps=steps, every=1_000_000)
    other.step(c.step_count)
    check_same_state(c, other)
    c.step(3)
    other.step(3)
    check_same_state(c, other)
    assert times_of_load == sorted(times_of_load)
    assert len(times_of_load) - len(set(times_of_load)) <= times


def test_few_steps_are_evaluated_ahead_under_a_slow_load_for_which_ctrl_c_waits():
    # a chunk is 32 macro steps, however long they take
    times, ahead = [], []

    def force(t):
        time.sleep(0.002)
        times.append(t)
        ahead.append(round(t / 0.1) - c._session.core.step_count)
        return [np.sin(t)]

    a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), force=force)
    c = pm.Coupler([a], dt=0.1)
    c.run(steps=100)
    assert len(times) == 101 and max(ahead) <= 32


def test_a_handler_that_does_not_raise_does_not_stop_the_run():
    seen = []
    c, _ = long_run(10)
    old = signal.signal(signal.SIGALRM, lambda *args: seen.append(args))
    signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)
    try:
        c.step(300_000)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, old)
    other, _ = long_run(10)
    other.step(300_000)
    check_same_state(c, other)
    assert seen


def test_a_handler_may_not_call_the_coupler_that_is_being_stepped():
    c, steps = long_run(10)

    def call(*args):
        c.state("a")

    with waits.ctrl_c_when(lambda: waits.is_stepped(c)):
        signal.signal(signal.SIGINT, call)  # restored by the context
        with pytest.raises(RuntimeError, match="being stepped"):
            c.step(steps)
    other, _ = long_run(10)
    other.step(c.step_count)
    check_same_state(c, other)


@pytest.mark.parametrize(
    "force", [None, lambda t: np.full(5, np.sin(t))], ids=["plain", "callable"]
)
@pytest.mark.parametrize("call", ["run", "step", "reset", "state", "load"])
@pytest.mark.parametrize("stride", [13, pytest.param(1, marks=pytest.mark.gate)])
def test_an_interrupt_on_entering_a_function_of_the_package_leaves_all_or_nothing(
    tmp_path, call, force, stride
):
    # CPython checks for signals when a Python function is entered: one in `stride` entries in turn
    calls = {
        "run": lambda c: c.run(steps=4),
        "step": lambda c: c.step(4),
        "reset": lambda c: c.reset(u0={"b": [0.0]}),
        "state": lambda c: c.state("a"),
        "load": lambda c: c.load(tmp_path / "state"),
    }
    states = reference_states(force)
    saved, _ = long_run(5, force=force)
    saved.step(6)
    saved.save(tmp_path / "state")
    k, finished = 0, False
    while not finished:
        c, _ = long_run(5, force=force)
        if call != "state":
            c.step(2)
        finished = interrupt_at_entry(k, lambda c=c: calls[call](c))
        done = c.step_count
        possible = {"run": range(2, 7), "step": range(2, 7), "reset": (0, 2), "state": (0,)}
        assert done in (possible | {"load": (2, 6)})[call]
        for ahead in (0, 3):
            c.step(ahead)
            assert c.step_count == done + ahead, f"interrupted at entry {k}"
            for x in "uva":
                np.testing.assert_array_equal(
                    getattr(c.state("a"), x), getattr(states[done + ahead], x), f"entry {k}"
                )
        k += stride
    assert k > 3  # functions of the package that the shortest call enters


def reference_states(force):
    c, _ = long_run(5, force=force)
    states = []
    for _ in range(12):
        states.append(c.state("a"))
        c.step()
    return states


def interrupt_at_entry(k, call):
    """KeyboardInterrupt at the k-th entry of a function of the package; False if it came."""
    package, count = str(Path(pm.__file__).parent), 0

    def trace(frame, event, argument):
        nonlocal count
        if event == "call" and frame.f_code.co_filename.startswith(package):
            count += 1
            if count == k + 1:
                sys.settrace(None)
                raise KeyboardInterrupt
        return None

    old = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return False
    finally:
        sys.settrace(old)
    return True
