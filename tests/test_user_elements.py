"""Element matrices of Abaqus, fixed rows, expanded nodes, and what is not a matrix."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import readers

ELEMENT = """**
** ELEMENT NUMBER {0} STEP NUMBER 2 INCREMENT NUMBER 1
*USER ELEMENT, NODES= 2, LINEAR
** ELEMENT NODES
** {0}, {1}
1
*MATRIX,TYPE=STIFFNESS
 {2}D+00 ,
-{2} , {2}
"""
MASS = "*MATRIX,TYPE=MASS\n 2.0 ,\n 0.0 , 1.0\n"


def written(tmp_path, text, name="job.mtx"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_elements_of_a_file_are_those_of_the_structure(tmp_path):
    text = ELEMENT.format(1, 2, 4.0) + MASS + ELEMENT.format(2, 3, 9.0) + MASS
    found = readers.read_abaqus(written(tmp_path, text))
    assert found.labels.tolist() == [[[1, 1], [2, 1]], [[2, 1], [3, 1]]]
    assert found.C is None
    dofs = found.dofs([[2, 1], [3, 1]])  # node 1 is fixed
    elements = pm.Elements(dofs, M=found.M, K=found.K)
    whole = pm.cut(elements, [0, 0]).subdomains[0]
    np.testing.assert_array_equal(whole.K.toarray(), [[13.0, -9.0], [-9.0, 9.0]])
    assert whole.M.tolist() == [3.0, 1.0]  # a diagonal


def test_an_element_without_mass_beside_one_with_it_has_none(tmp_path):
    text = ELEMENT.format(1, 2, 4.0) + ELEMENT.format(2, 3, 9.0) + MASS
    M = readers.read_abaqus(written(tmp_path, text)).M
    assert M.tolist() == [[[0, 0], [0, 0]], [[2, 0], [0, 1]]]


def test_nodes_may_have_other_components_from_one_on(tmp_path):
    text = ELEMENT.format(5, 6, 1.0).replace("\n1\n", "\n1, 2\n2, 6\n")
    text = text.partition("*MATRIX")[0] + "*MATRIX, TYPE=STIFFNESS\n1.,\n0., 1.,\n0., 0., 1.\n"
    found = readers.read_abaqus(written(tmp_path, text))
    assert found.labels.tolist() == [[[5, 1], [5, 2], [6, 6]]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("-4.0 , 4.0", "-4.0"), "line 7: must have 3 finite values, .* of 2 rows, got 2"),
        (("-4.0 , 4.0", "-4.0 , x"), "line 9: must hold numbers"),
        (("STIFFNESS", "HEAT"), "TYPE must be one of STIFFNESS, MASS, DAMPING, got 'HEAT'"),
        (("** 1, 2", "** 1"), r"must have 2 nodes, got \[1\]"),
        (("*MATRIX", "*UEL PROPERTY"), "must be .USER ELEMENT or .MATRIX"),
        (("** ELEMENT NODES", "**"), "nodes after a comment"),
    ],
)
def test_a_wrong_element_is_refused_by_its_line(tmp_path, change, message):
    text = ELEMENT.format(1, 2, 4.0).replace(*change)
    with pytest.raises(ValueError, match=message):
        readers.read_abaqus(written(tmp_path, text))


def test_rows_with_boundary_values_are_named(tmp_path):
    path = written(tmp_path, "1,1, 1,1, 1e36\n2,1, 2,1, 1.0\n2,1,1,1,-1.\n")
    with pytest.warns(UserWarning, match=r"job.mtx: rows 0 have 1e36 on the diagonal"):
        K = readers.read_abaqus(path)
    assert K.constrained.tolist() == [0]


def test_nodes_that_calculix_expands_have_several_rows(tmp_path):
    path = written(tmp_path, "1 1 2.0\n1 2 -1.0\n2 2 3.0\n3 3 2.0\n", "job.sti")
    K = readers.read_abaqus(path, labels=[[1, 1], [1, 2], [1, 1]])
    assert K.n == 3 and K.rows(1, 1).tolist() == [0, 2]
    with pytest.raises(ValueError, match=r"labels must be different, got \(1, 1\) more than once"):
        K.arranged([[1, 1], [1, 2]])


def test_a_punch_file_may_end_with_its_last_word(tmp_path):
    text = "DMIG    K       0       6       1       0\nDMIG    K       1       1               1"
    text += "       1       2.0\nENDDATA"
    assert readers.read_dmig(written(tmp_path, text, "job.pch")).matrix.toarray().tolist() == [
        [2.0]
    ]


@pytest.mark.parametrize("read", [readers.read_dmig, readers.read_abaqus])
def test_output4_is_refused_by_name(tmp_path, read):
    with pytest.raises(
        ValueError, match="OUTPUT4 are not read; their matrices can be given as arrays"
    ):
        read(written(tmp_path, "binary", "job.op4"))
