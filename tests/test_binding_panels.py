"""Patterns and panels that the C extension refuses: an exception, never a crash."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import numpy as np
from core_objects import (
    SPD,
    TWO_BLOCKS,
    check_refused,
    factor,
    i32,
    i64,
    in_a_process,
    panels_of,
    read_only,
)

from pmalpha import _core


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
for blas in ((None, BLAS[1]), (5, 5), (BLAS[0], None), (other, BLAS[1]), (BLAS[0], other)):
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
