"""Matrices of other programs: small files written by hand, whose matrix is known.

The example is a bar of three nodes, 5, 9 and 2 in this order, in displacement along it: springs 2
between 5 and 9, 1 between 9 and 2, and node 5 held by another 1.
"""

import inspect
import io

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import readers
from pmalpha.readers import (
    ExportedMatrix,
    asymmetry,
    read_abaqus,
    read_dmig,
    read_harwell_boeing,
    symmetrized,
)

BAR = np.array([[3.0, -2.0, 0.0], [-2.0, 3.0, -1.0], [0.0, -1.0, 1.0]])  # nodes 5, 9, 2
SORTED = np.array([[1.0, 0.0, -1.0], [0.0, 3.0, -2.0], [-1.0, -2.0, 3.0]])  # nodes 2, 5, 9
LABELS = [[2, 1], [5, 1], [9, 1]]


@pytest.fixture
def written(tmp_path):
    def write(text, name="job_STIF1.mtx"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def refused(path, read, *parts, **options):
    with pytest.raises(ValueError) as error:
        read(path, **options)
    for part in (str(path), *parts):
        assert part in str(error.value)


# ---- Abaqus, coordinates ----------------------------------------------------------------------

FULL = """1 1  3.000000000000000e+00
1 2  -2.000000000000000e+00
2 1  -2.000000000000000e+00
2 2  3.000000000000000e+00
2 3  -1.000000000000000e+00
3 2  -1.000000000000000e+00
3 3  1.000000000000000e+00
"""
UPPER = "1 1 3.\n1 2 -2.\n2 2 3.\n2 3 -1.\n3 3 1.\n"
LOWER = "1 1 3.\n2 1 -2.\n2 2 3.\n3 2 -1.\n3 3 1.\n"


@pytest.mark.parametrize("text", [FULL, UPPER, LOWER, UPPER.replace(" ", ", "), "\ufeff" + UPPER])
def test_a_coordinate_list_may_hold_the_whole_matrix_or_a_triangle(written, text):
    K = read_abaqus(written(text))
    np.testing.assert_array_equal(K.matrix.toarray(), BAR)
    assert isinstance(K.matrix, sp.csr_array)
    assert K.labels.tolist() == [[1, 0], [2, 0], [3, 0]]
    assert (K.name, K.n) == ("job_STIF1.mtx", 3)


def test_labels_name_the_rows_of_a_coordinate_list(written):
    K = read_abaqus(written(UPPER), labels=[[5, 1], [9, 1], [2, 1]])
    assert K.rows([2, 5]).tolist() == [2, 0]


def test_a_triangle_in_another_order_of_rows_is_a_triangle(written):
    # (2, 1) below and (2, 3) above the diagonal, neither with its mirror image
    K = read_abaqus(written("1 1 3.\n2 1 -2.\n2 2 3.\n2 3 -1.\n3 3 1.\n"))
    np.testing.assert_array_equal(K.matrix.toarray(), BAR)


def test_a_diagonal_mass_matrix_stays_diagonal(written):
    M = read_abaqus(written("1 1 2.\n2 2 3.0D+00\n3 3 4e0\n"))
    np.testing.assert_array_equal(M.matrix.toarray(), np.diag([2.0, 3.0, 4.0]))


def test_an_unsymmetric_matrix_is_returned_as_it_is_and_refused_by_subdomain(written):
    K = read_abaqus(written(FULL.replace("2 1  -2.0", "2 1  -2.5")))
    assert K.matrix[1, 0] == -2.5 and K.matrix[0, 1] == -2.0
    with pytest.raises(ValueError, match="symmetric"):
        pm.Subdomain([1.0, 1.0, 1.0], K.matrix, scheme=pm.Newmark())


def test_what_was_read_runs(written):
    K = read_abaqus(written(FULL))
    part = pm.Subdomain([1.0, 1.0, 1.0], K.matrix, scheme=pm.Newmark(), u0=[0.0, 0.0, 1.0])
    assert pm.solve(part, 0.1, 1.0).u.shape == (11, 3)


# ---- Abaqus, matrix input ---------------------------------------------------------------------

INPUT = "5,1, 5,1, 3.0\n5,1, 9,1, -2.0\n9,1, 9,1, 3.0\n9,1, 2,1, -1.0\n2,1, 2,1, 1.0\n"


@pytest.mark.parametrize("head", ["", "** a comment\n", "*MATRIX INPUT, NAME=K, TYPE=SYMMETRIC\n"])
def test_lines_with_nodes_give_rows_in_the_order_of_the_nodes(written, head):
    K = read_abaqus(written(head + INPUT))
    np.testing.assert_array_equal(K.matrix.toarray(), SORTED)
    assert K.labels.tolist() == LABELS


def test_both_triangles_may_be_there_with_nodes_too(written):
    K = read_abaqus(written(INPUT + "9,1, 5,1, -2.0\n2,1, 9,1, -1.0\n"))
    np.testing.assert_array_equal(K.matrix.toarray(), SORTED)


def test_a_triangle_of_type_unsymmetric_is_not_completed(written):
    K = read_abaqus(written("*Matrix Input, name=K, type=unsymmetric\n" + INPUT))
    assert K.matrix[0, 2] == 0.0 and K.matrix[2, 0] == -1.0


def test_internal_nodes_come_after_all_others(written):
    K = read_abaqus(written("-2,1, -2,1, 4.\n-1,1, -1,1, 3.\n7,2, 7,2, 2.\n7,1, 7,1, 1.\n"))
    assert K.labels.tolist() == [[7, 1], [7, 2], [-1, 1], [-2, 1]]
    assert K.matrix.diagonal().tolist() == [1.0, 2.0, 3.0, 4.0]


def test_labels_are_not_given_where_the_file_has_them(written):
    with pytest.raises(ValueError, match="labels must be None"):
        read_abaqus(written(INPUT), labels=LABELS)


# ---- damaged files of Abaqus ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (FULL[:-8], ["line 7", "cut off", "'3 3  1.0000"]),  # within the last number
        ("1 1 3.\n1 2\n", ["line 2", "3 fields", "got 2", "'1 2'"]),
        ("1 1 3.\n1 x 2.\n", ["line 2", "must hold numbers", "'1 x 2.'"]),
        ("1 1 3.\n1.5 2 2.\n", ["line 2", "whole numbers", "'1.5 2 2.'"]),
        ("1 1 3.\ninf 2 2.\n", ["line 2", "whole numbers", "'inf 2 2.'"]),
        ("1 1 3.\n1 2 nan\n", ["line 2", "finite", "'1 2 nan'"]),
        ("1 1 3.\n\n1 2 1e999\n", ["line 3", "finite"]),
        ("1 1 3.\n0 2 1.\n", ["line 2", "1..2", "got 0, 2"]),
        ("1 1 3.\n1 2000000000 1.\n", ["line 2", "1..20", "got 1, 2000000000"]),
        ("-1 -1 3.\n", ["line 1", "from 1", "got -1, -1"]),
        ("1 1 3.\n2 2 1.\n1 1 4.\n", ["line 3", "once", "1, 1 again after line 1"]),
        ("5,1, 5,1, 3.\n5,1, 5,1, 3.\n", ["line 2", "(5, 1), (5, 1) again after line 1"]),
        ("1 1 3. 0.\n", ["line 1", "3 fields", "or 5", "got 4"]),
        ("", ["must hold lines"]),
        ("** nothing\n", ["must hold lines"]),
        ("*USER ELEMENT, NODES=3\n1, 2\n", ["line 1", "must have NODES=, and nodes"]),
        ("*User Element, nodes=2, Linear, Unsymm\n1\n", ["line 1", "symmetric", "UNSYMM"]),
        ("*MATRIX INPUT, NAME=K\n" + INPUT + "*MATRIX INPUT, NAME=M\n", ["line 7", "only matrix"]),
        ("*MATRIX INPUT, NAME=K, SCALE FACTOR=2.\n" + INPUT, ["line 1", "SCALE FACTOR"]),
        ("%%MatrixMarket matrix coordinate real general\n", ["line 1", "scipy.io.mmread"]),
        ("1 1 3.\n\0\0\n", ["line 2", "binary"]),
    ],
)
def test_a_damaged_list_is_refused_with_file_line_rule_and_value(written, text, parts):
    refused(written(text), read_abaqus, *parts)


def test_indices_must_be_within_the_labels(written):
    refused(written(FULL), read_abaqus, "line 5", "1..2", "2, 3", labels=[[5, 1], [9, 1]])


@pytest.mark.parametrize("read", [read_abaqus, read_dmig])
def test_an_invalid_or_missing_path_is_an_error(read, tmp_path):
    with pytest.raises(TypeError, match="path"):
        read(3.5)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "missing.mtx")


# ---- Nastran ----------------------------------------------------------------------------------

# the columns of Nastran: 8, then fields of 16
WIDE = """$ punch file
DMIG    KAAX           0       6       2       0
DMIG*   KAAX                           5               1
*                      5               1 3.000000000D+00
DMIG*   KAAX                           9               1
*                      5               1-2.000000000D+00
*                      9               1 3.000000000D+00
*                      2               1-1.000000000D+00
DMIG*   KAAX                           2               1
*                      2               1 1.000000000D+00
"""
# fields of 8: four rows of a column take three lines
NARROW = """DMIG    KAAX    0       6       1       0
DMIG    KAAX    5       1               5       1       3.0
DMIG    KAAX    9       1               5       1       -2.0            +A
+A      9       1       3.0             2       1       -10.0-1
DMIG    KAAX    2       1               2       1       .1+1
"""
FREE = """DMIG,KAAX,0,6,1,0
DMIG,KAAX,5,1,,5,1,3.
DMIG,KAAX,9,1,,5,1,-2.,,+
+,9,1,3.,,2,1,-1.
DMIG,KAAX,2,1,,2,1,1.
"""
HEADER = WIDE.splitlines(keepends=True)[1]


@pytest.mark.parametrize("text", [WIDE, NARROW, FREE], ids=["wide", "narrow", "free"])
def test_dmig_is_read_with_fields_of_any_width(written, text):
    K = read_dmig(written(text))
    np.testing.assert_array_equal(K.matrix.toarray(), SORTED)
    assert (K.labels.tolist(), K.name) == (LABELS, "KAAX")


@pytest.mark.parametrize("form", ["1", "2"])
def test_the_square_forms_are_read_unchanged(written, form):
    text = FREE.replace("0,6,1", f"0,{form},1")
    K = read_dmig(written(text))
    np.testing.assert_array_equal(K.matrix.toarray(), [[1, 0, -1], [0, 3, -2], [0, 0, 3]])
    full = read_dmig(written(text.replace("5,1,,5,1,3.", "5,1,,5,1,3.,,+\n+,9,1,-2.")))
    assert full.matrix[2, 1] == full.matrix[1, 2] == -2.0


def test_other_entries_of_the_punch_file_are_skipped(written):
    around = "GRID           5              0.0     0.0     0.0\n+       1\n"
    text = around + WIDE + around + WIDE.replace("KAAX", "MAAX") + "SPOINT,7\n"
    K = read_dmig(written(text), "kaax")
    np.testing.assert_array_equal(K.matrix.toarray(), SORTED)
    with pytest.raises(ValueError, match="name must be given.*'KAAX', 'MAAX'"):
        read_dmig(written(text))
    with pytest.raises(ValueError, match="'KAAX', 'MAAX', got 'BAAX'"):
        read_dmig(written(text), "BAAX")


def test_scalar_points_have_component_0(written):
    K = read_dmig(written("DMIG,K,0,6,1\nDMIG,K,7,0,,7,,2.\n"))
    assert (K.labels.tolist(), K.matrix.toarray().tolist()) == ([[7, 0]], [[2.0]])


@pytest.mark.parametrize(
    ("text", "value"),
    [("3.+5", 3e5), ("-1.25D-3", -1.25e-3), (".5", 0.5), ("2.5+10", 2.5e10), ("1.e2", 100.0)],
)
def test_real_numbers_are_those_of_nastran(written, text, value):
    K = read_dmig(written(f"DMIG,K,0,6,1\nDMIG,K,7,1,,7,1,{text}\n"))
    assert K.matrix[0, 0] == value


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (WIDE.replace("6       2", "6       4"), ["line 2", "real", "complex type 4"]),
        (WIDE.replace("6       2", "6       3"), ["line 2", "real", "complex type 3"]),
        (WIDE.replace("6       2", "6       7"), ["line 2", "type 1 or 2", "got 7"]),
        (WIDE.replace("0       6", "0       9"), ["line 2", "form 6", "got 9"]),
        (WIDE.replace(HEADER, ""), ["line 2", "after the header of KAAX", "'5'"]),
        (WIDE + HEADER, ["line 11", "second header"]),
        (HEADER, ["line 1", "columns of KAAX"]),
        (WIDE[:-12], ["line 10", "cut off"]),
        (WIDE[: WIDE.rindex(" 1.0000")] + "\n", ["line 10", "a value", "cut off"]),
        (WIDE[: WIDE.rindex("*  ")], ["line 9", "rows for column (2, 1)", "cut off"]),
        (WIDE.replace("-2.0000", "-2,0000"), ["line 6"]),
        (FREE.replace("1,-2.", "1,two"), ["line 3", "finite number", "'two'"]),
        (FREE.replace("1,-2.", "1,1.+999"), ["line 3", "finite number", "'1.+999'"]),
        (FREE.replace("DMIG,KAAX,9,1", "DMIG,KAAX,9,8"), ["line 3", "component", "0..6", "got 8"]),
        (FREE.replace("DMIG,KAAX,9,1", "DMIG,KAAX,-9,1"), ["line 3", "point", "got -9"]),
        (FREE.replace("DMIG,KAAX,9,1", "DMIG,KAAX,9.,1"), ["line 3", "whole number", "'9.'"]),
        (FREE.replace("-2.,,", "-2.,1.,"), ["line 3", "imaginary", "'1.'"]),
        (
            FREE.replace("5,1,3.", "5,1,3.,,+\n+,9,1,-2."),
            ["line 4", "once", "after line 3", "other side"],
        ),
        (FREE + "DMIG,KAAX,2,1,,2,1,1.\n", ["line 6", "(2, 1), (2, 1) again after line 5"]),
        (FREE.replace("5,1,3.", "5,1,3.,,9,1,-2."), ["line 2", "at most 10 fields, got 12"]),
        ("include 'more.pch'\n" + WIDE, ["line 1", "INCLUDE is not read"]),
        ("GRID,1\n", ["must have DMIG"]),
    ],
)
def test_damaged_dmig_is_refused_with_file_line_rule_and_value(written, text, parts):
    refused(written(text), read_dmig, *parts)


# ---- labels -----------------------------------------------------------------------------------


def test_a_mass_matrix_without_its_empty_rows_is_arranged_like_the_stiffness(written):
    K = read_abaqus(written(INPUT))
    M = read_abaqus(written("9,1, 9,1, 4.\n2,1, 2,1, 6.\n", "job_MASS1.mtx")).arranged(K.labels)
    np.testing.assert_array_equal(M.matrix.toarray(), np.diag([6.0, 0.0, 4.0]))
    np.testing.assert_array_equal(M.labels, K.labels)
    with pytest.raises(ValueError, match=r"labels must have all.*\(5, 1\)"):
        K.arranged([[2, 1], [9, 1]])


def test_rows_are_found_by_node_and_component():
    labels = [[3, 1], [3, 2], [1, 1], [1, 2], [8, 2]]
    A = ExportedMatrix(sp.eye_array(5, format="csr"), labels)
    assert A.rows([1, 3]).tolist() == [2, 3, 0, 1]
    assert A.rows([8, 1], 2).tolist() == [4, 3]
    assert A.rows(np.array([], dtype=int)).tolist() == []
    with pytest.raises(ValueError, match="component 1, got 8 without"):
        A.rows([8, 1], 1)
    with pytest.raises(ValueError, match="got 4 without"):
        A.rows(4)
    with pytest.raises(TypeError, match="whole numbers"):
        A.rows(1.5)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ([[1, 1], [2, 1]], "as many"),
        ([[1, 1], [2, 1], [1, 1]], r"different, got \(1, 1\)"),
        ([1, 2, 3], "pairs"),
    ],
)
def test_labels_fit_the_matrix_and_differ(labels, message):
    with pytest.raises(ValueError, match=message):
        ExportedMatrix(sp.csr_array(BAR), labels)


# ---- symmetry ---------------------------------------------------------------------------------


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array, sp.coo_array])
def test_asymmetry_is_measured_against_the_diagonal_and_so_without_units(form):
    A = np.array([[100.0, 2.0, 0.0], [1.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
    assert asymmetry(form(A)) == pytest.approx(1.0 / np.sqrt(100.0 * 4.0), rel=1e-15)
    assert asymmetry(form(BAR)) == 0.0
    scale = np.diag([1e6, 1e-3, 1.0])  # other units
    assert asymmetry(form(scale @ A @ scale)) == pytest.approx(0.05, rel=1e-14)
    # without a diagonal: the largest of row and column, here 2 and 4
    B = np.array([[0.0, 2.0, 0.0], [1.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
    assert asymmetry(form(B)) == pytest.approx(1.0 / np.sqrt(2.0 * 4.0), rel=1e-15)


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array])
def test_symmetrizing_takes_the_mean_within_the_tolerance_given(form):
    A = BAR.copy()
    A[1, 0] = -2.003  # 0.003 / 3
    mean = symmetrized(form(A), tol=1.1e-3)
    whole = mean.toarray() if sp.issparse(mean) else mean
    np.testing.assert_array_equal(whole, (A + A.T) / 2)
    assert pm.Subdomain([1.0, 1.0, 1.0], mean, scheme=pm.Newmark()).n == 3
    with pytest.raises(ValueError, match=r"tol = 0.0009, got 0.001: -2 at \[0, 1\] and -2.003"):
        symmetrized(form(A), tol=9e-4)


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array, sp.coo_matrix])
@pytest.mark.parametrize("seed", range(5))
def test_a_triangle_is_refused_by_name_and_completed(form, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4))
    K = A @ A.T
    triangle = form((np.tril, np.triu)[seed % 2](K))
    with pytest.raises(ValueError, match="one triangle of a symmetric matrix, readers.completed.K"):
        pm.Subdomain(np.ones(4), triangle, scheme=pm.Newmark())
    whole = readers.completed(triangle)
    np.testing.assert_array_equal(whole.toarray() if sp.issparse(whole) else whole, K)
    with pytest.raises(ValueError, match="one side of the diagonal only, got some on both"):
        readers.completed(form(K))


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array])
def test_an_asymmetry_of_few_digits_is_shown_and_its_remedy_works(form):
    # equal in the six digits that are printed: the message has the difference, relative to
    # sqrt(K_00 K_11) = 4
    K = np.array([[2.0, 1.0 + 1.2e-9], [1.0, 8.0]])
    with pytest.raises(ValueError, match=r"differ by 3e-10 of it; .* readers.symmetrized\(K, tol"):
        pm.Subdomain(np.ones(2), form(K), scheme=pm.Newmark())
    assert asymmetry(form(K)) == pytest.approx(3e-10, rel=1e-6)
    assert pm.Subdomain(np.ones(2), symmetrized(form(K), 1e-9), scheme=pm.Newmark()).n == 2
    K[0, 1] = -2.0  # not by rounding
    with pytest.raises(ValueError, match="got -2 at .* take symmetric=False"):
        pm.Subdomain(np.ones(2), form(K), scheme=pm.Newmark())


@pytest.mark.parametrize("A", [np.ones((2, 3)), [[np.nan]], sp.csr_array([[np.inf]])])
def test_only_square_matrices_of_finite_numbers_are_measured(A):
    with pytest.raises(ValueError, match="A must be"):
        asymmetry(A)


# ---- the recipes that need no reader ----------------------------------------------------------


def as_sparse_array(read, source):
    """What a reader of SciPy returns; where it can be chosen, an array."""
    arrays = {"spmatrix": False} if "spmatrix" in inspect.signature(read).parameters else {}
    return sp.csr_array(read(source, **arrays))


def test_matrix_market_is_read_by_scipy_which_completes_a_triangle(tmp_path):
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.coo_array(BAR), symmetry="symmetric")
    K = as_sparse_array(scipy.io.mmread, tmp_path / "K.mtx")
    np.testing.assert_array_equal(K.toarray(), BAR)


# three header lines, formats, then columns of the lower triangle: pointers, rows, values
HARWELL_BOEING = f"""{"a bar of three nodes":<72}key
{3:14}{1:14}{1:14}{1:14}
RSA           {3:14}{3:14}{5:14}{0:14}
(4I4)           (5I4)           (5E14.6)
   1   3   5   6
   1   2   2   3   3
  3.000000E+00 -2.000000E+00  3.000000E+00 -1.000000E+00  1.000000E+00
"""


def test_a_harwell_boeing_file_is_read_as_scipy_reads_the_same_as_unsymmetric(written):
    text = HARWELL_BOEING.replace("\nRSA", "\nRUA", 1)
    half = as_sparse_array(scipy.io.hb_read, io.StringIO(text))
    np.testing.assert_array_equal(
        read_harwell_boeing(written(text)).tocsr().toarray(), half.toarray()
    )
    K = read_harwell_boeing(written(HARWELL_BOEING))
    np.testing.assert_array_equal(K.matrix.toarray(), BAR)
    assert K.labels.tolist() == [[1, 0], [2, 0], [3, 0]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("RSA", "RSE", "line 3: the type must be one of RSA"),
        ("(4I4)", "(4E4)", "line 4: the format of pointers must be"),
        ("(4I4)", "(3I4)", "line 2: 4 pointers must be in 1 line of up to 3"),
        ("(5E14.6)", "", "line 4: must have formats of pointers, rows and values"),
        ("   1   3   5   6", "   1   3   5   7", "line 5: pointers must go from 1 to .* 6, "),
        ("   1   3   5   6", "   1   5   3   6", "line 5: pointers .* never down"),
        ("   1   3   5   6", "   1   3   x   6", "line 5: must have whole numbers"),
        ("   1   2   2   3   3", "   1   2   2   4   3", "line 6: rows must be 1 to 3, got 4"),
        ("   1   2   2   3   3", "   1   2   1   3   3", "on the other side of the diagonal"),
        ("   1   2   2   3   3", "   1   2   2   3", "line 6: must have 5 rows of width 4, got 4"),
        ("1.000000E+00\n", "1.000000E+00", "line 7: must end with a new line, or is cut off"),
        ("-2.000000E+00", "          inf", "line 7: must have finite numbers"),
        ("-2.000000E+00", "           -2", "line 7: must have a point or an exponent"),
        (f"{3:14}{3:14}{5:14}", f"{3:14}{4:14}{5:14}", "square, got 3 rows and 4 columns"),
    ],
)
def test_a_harwell_boeing_file_that_is_not_as_its_header_says_is_refused(written, old, new, words):
    text = HARWELL_BOEING.replace(old, new, 1)
    assert text != HARWELL_BOEING
    with pytest.raises(ValueError, match=words):
        read_harwell_boeing(written(text))


MAPPING = "  Matrix Eqn      Node   DOF\n  1   7  UX\n  3   9  ROTZ\n  2   7  uy\n"


def test_a_mapping_file_gives_node_and_component_of_rows_in_any_order(written):
    path = written(HARWELL_BOEING)
    K = read_harwell_boeing(path, written(MAPPING, "stiff.mapping"))
    assert K.labels.tolist() == [[7, 1], [7, 2], [9, 6]]
    for old, new, words in (
        ("ROTZ", "TEMP", "line 3: dof must be of UX, .* got 'TEMP'"),
        ("  3   9", "  4   9", "line 3: rows must be 1 to 3, each once, got 4"),
        ("  3   9", "  1   9", "line 3: rows must be 1 to 3, each once, got 1"),
        ("  2   7  uy\n", "", "must have 3 rows of the matrix, got 2"),
        ("9  ROTZ", "9", "line 3: must have row, node and dof"),
    ):
        with pytest.raises(ValueError, match=words):
            read_harwell_boeing(path, written(MAPPING.replace(old, new), "stiff.mapping"))


def test_the_dof_file_of_calculix_gives_the_labels(written):
    lines = written("5.1\n9.1\n2.1\n", "job.dof").read_text().splitlines()
    labels = [[int(part) for part in line.strip().split(".")] for line in lines]
    K = read_abaqus(written(LOWER, "job.sti"), labels=labels)
    np.testing.assert_array_equal(K.arranged(LABELS).matrix.toarray(), SORTED)


# ---- taken where a matrix is -------------------------------------------------------------------


def test_what_a_reader_returns_is_taken_as_a_matrix(written):
    K = read_abaqus(written("5,1, 5,1, 2.0\n5,1, 9,1, -1.0\n9,1, 9,1, 1.0\n"))
    M = read_abaqus(written("5,1, 5,1, 3.0\n9,1, 9,1, 4.0\n", "job_MASS1.mtx"))
    s = pm.Subdomain(M, K, C=K, scheme=pm.Newmark())
    assert s.M.tolist() == [3.0, 4.0]
    for A in (s.K, s.C, pm.reduce(M, K, fixed=[]).K, symmetrized(K, 0.0)):
        assert A.toarray().tolist() == [[2.0, -1.0], [-1.0, 1.0]]
    omega = pm.structures.modes(K=K, M=M, k=2)[0]
    np.testing.assert_allclose(omega, pm.structures.modes(M.matrix, K.matrix, 2)[0], rtol=1e-12)
    quake = pm.BaseAcceleration([0.0, 1.0], [1.0, 1.0], M, dt=0.1)
    assert quake(0.1).tolist() == [-3.0, -4.0]


def test_matrices_of_readers_with_other_rows_are_refused(written):
    K = read_abaqus(written("5,1, 5,1, 2.0\n5,1, 9,1, -1.0\n9,1, 9,1, 1.0\n"))
    M = read_abaqus(written("2,1, 2,1, 3.0\n9,1, 9,1, 4.0\n", "job_MASS1.mtx"))
    match = "K must have the labels of M, row by row, got 2 rows and 2; K.arranged"
    for use in (
        lambda: pm.Subdomain(M, K, scheme=pm.Newmark()),
        lambda: pm.reduce(M, K, fixed=[]),
        lambda: pm.structures.modes(M, K, 1),
    ):
        with pytest.raises(ValueError, match=match):
            use()


@pytest.mark.parametrize("kind", ["RSA", "RUA"])
@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize("exponent", ["d", "D", "E"])
def test_matrices_are_read_as_ansys_writes_them(tmp_path, kind, columns, exponent):
    A = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1e-3], [0.0, -1e-3, -4e5]])
    half = sp.csc_array(np.tril(A) if kind == "RSA" else A)
    numbers = [half.indptr + 1, half.indices + 1, half.data]
    texts = [[f"{x:14d}" for x in numbers[0]], [f"{x:14d}" for x in numbers[1]]]
    texts.append([f"{x:25.15e}".replace("e", exponent) for x in numbers[2]])
    blocks = [["".join(x[i : i + columns]) for i in range(0, len(x), columns)] for x in texts]
    counts = [sum(map(len, blocks)), *map(len, blocks), 0]
    times = columns if columns > 1 else ""
    form = [f"({times}I14)", f"({times}I14)", f"({times}{exponent}25.15)"]
    head = [
        "STIFFNESS".ljust(80),
        "".join(f"{x:14d}" for x in counts),
        kind + " " * 11 + f"{3:14d}{3:14d}{half.nnz:14d}{0:14d}",
        "".join(x.ljust(16) for x in form[:2]) + form[2].ljust(20) + form[2].ljust(20),
    ]
    path = tmp_path / "stiff.matrix"
    path.write_text("\n".join(head + sum(blocks, [])) + "\n")
    np.testing.assert_array_equal(read_harwell_boeing(path).matrix.toarray(), A)
