"""What is read of input files of Abaqus and Nastran is right, and the rest is named."""

import types
import warnings

import numpy as np
import pytest
from scipy.io import netcdf_file

from pmalpha import structures

SOLID = {"E": 1.0, "nu": 0.3, "rho": 1.0}
BAR = {"EA": 1.0, "rhoA": 1.0}
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


def nodes(points=CORNERS, first=1):
    return "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(points, first))


CUBE = f"*NODE\n{nodes()}*ELEMENT, TYPE=C3D8, ELSET=E1\n1, 1,2,3,4,5,6,7,8\n"
LINE = [(float(k), 0.0, 0.0) for k in range(12)]


def read(tmp_path, text, material=SOLID, name="job.inp", **options):
    """The structure and the text of its warning, of which there is at most one."""
    path = tmp_path / name
    path.write_text(text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        structure = structures.from_mesh(path, material, **options)
    assert len(caught) < 2
    return structure, str(caught[0].message) if caught else ""


def mass(structure):
    x = structure.dofs(np.arange(len(structure.points)), "ux")
    return structure.M.tocsr()[x][:, x].sum()


# ---- Abaqus and CalculiX ---------------------------------------------------------------------


def cylindrical(system):
    """A wedge of a tube, radii 1 and 2, 90 degrees, height 1, with flat sides: volume 1.5."""
    points = [(r, a, z) for z in (0, 1) for r, a in ((1, 0), (2, 0), (2, 90), (1, 90))]
    return system + nodes(points) + "*ELEMENT, TYPE=C3D8R\n1, 1,2,3,4,5,6,7,8\n"


@pytest.mark.parametrize(
    ("text", "volume"),
    [
        (CUBE, 1.0),
        (cylindrical("*NODE, SYSTEM=C\n"), 1.5),
        (CUBE.replace("0, 0, 0", "0.D+00, 0, 0").replace("1, 1, 1\n", "1., 1.+0, 1.0d0\n"), 1.0),
        ("*SYSTEM\n5., 5., 5., 5., 6., 5.\n4., 5., 5.\n" + CUBE, 1.0),
        ("*SYSTEM\n1., 2., 3.\n" + CUBE, 1.0),
        (CUBE.replace("4,5,6", "4,\n5,6"), 1.0),
        (CUBE + "*SUBMODEL, TYPE=NODE, INPUT=not_there.frd\n*ENDSTEP\n*El  Print\n*\n", 1.0),
        (CUBE + "*NSET, NSET=A, INSTANCE=Part-1-1\n1\n", 1.0),
        (CUBE.partition("*ELEMENT")[2].join(["*ELEMENT", CUBE.partition("*ELEMENT")[0]]), 1.0),
        ("\ufeff" + CUBE, 1.0),
        (CUBE.replace("C3D8, ", "C3D8,\n** a comment\n\n"), 1.0),
        (CUBE.replace("*NODE\n", "*NODE,\n"), 1.0),
        (CUBE.replace("4,5,6", "4,\n** a comment\n\n5,6"), 1.0),
        (CUBE.replace(", ", ",\t").replace("\n", "\r"), 1.0),
        (CUBE.rstrip(), 1.0),
    ],
)
def test_a_solid_has_its_volume_however_its_nodes_are_given(tmp_path, text, volume):
    structure, warning = read(tmp_path, text)
    assert mass(structure) == pytest.approx(volume, rel=1e-14)
    assert warning == ""


def test_the_axes_of_a_system_are_those_of_its_three_points(tmp_path):
    text = "*SYSTEM\n5., 5., 5., 5., 6., 5.\n4., 5., 5.\n" + CUBE
    points = read(tmp_path, text)[0].points
    # x' = y, y' = -x, so z' = z
    np.testing.assert_allclose(points, [(5 - y, 5 + x, 5 + z) for x, y, z in CORNERS], atol=1e-15)


@pytest.mark.parametrize(
    ("elements", "count"),
    [
        ("1, 1, 2\n*ELGEN, ELSET=ALL\n1, 10\n", 10),
        ("1, 1, 2\n*ELGEN, ELSET=ALL\n1, 5, 2, 3\n", 5),
        ("1, 1, 2\n*ELGEN, ELSET=ALL\n1, 2, 1, 1, 5, 2, 2\n", 10),
        ("1, 1, 2\n2, 2, 3\n", 2),
    ],
)
def test_bars_are_generated(tmp_path, elements, count):
    text = f"*NODE\n{nodes(LINE)}*ELEMENT, TYPE=T3D2\n{elements}"
    structure, warning = read(tmp_path, text, BAR)
    assert mass(structure) == pytest.approx(count, rel=1e-14) and warning == ""
    assert sum(map(len, structure.elements.values())) == count
    assert all(len(x) == count for x in structure.groups.values())


def test_nodes_are_generated_between_two(tmp_path):
    text = "*NODE\n1, 0., 0., 0.\n11, 10., 0., 0.\n*NGEN, NSET=LINE\n1, 11, 2\n"
    text += "*ELEMENT, TYPE=T3D2\n1, 1, 3\n2, 9, 11\n*NSET, NSET=SOME, GENERATE\n1, 20\n"
    structure, _ = read(tmp_path, text, BAR)
    # those of *NODE come first
    assert structure.points.tolist() == [[0, 0], [10, 0], [2, 0], [8, 0]]
    assert structure.sets["LINE"].tolist() == structure.sets["SOME"].tolist() == [0, 1, 2, 3]


def test_the_node_that_gives_the_direction_of_a_beam_is_no_end(tmp_path):
    text = f"*NODE\n{nodes(LINE)}99, 0., 5., 0.\n*ELEMENT, TYPE=B31, ELSET=BEAMS\n"
    text += "1, 1, 2, 99\n2, 2, 3, 99\n3, 3, 4\n"
    structure, _ = read(tmp_path, text, BAR)
    assert structure.elements["line"].tolist() == [[0, 1], [1, 2], [2, 3]]
    with pytest.raises(ValueError, match=r"line 15, \*ELEMENT: .* T3D2 must have 2 nodes, got 3"):
        read(tmp_path, text.replace("B31", "T3D2"), BAR)


def assembly(*moves):
    text = f"*PART, NAME=P\n{CUBE}*NSET, NSET=TOP\n5, 6, 7, 8\n*END PART\n*ASSEMBLY, NAME=A\n"
    for k, move in enumerate(moves, 1):
        text += f"*INSTANCE, NAME=P-{k}, PART=P\n{move}*END INSTANCE\n"
    return text + "*NSET, NSET=FIX, INSTANCE=P-1\n1, 2\n*END ASSEMBLY\n"


def test_an_instance_is_where_it_was_moved_and_turned_to(tmp_path):
    # the shift first, then 90 degrees around an axis through (2, 0, 0) along z
    text = assembly("1., 0., 0.\n2., 0., 0., 2., 0., 7., 90.\n")
    structure, warning = read(tmp_path, text)
    expected = [(2 - y, (x + 1) - 2, z) for x, y, z in CORNERS]
    np.testing.assert_allclose(structure.points, expected, rtol=0, atol=1e-15)
    assert {name: len(x) for name, x in structure.sets.items()} == {"E1": 8, "TOP": 4, "FIX": 2}
    assert warning == ""


def test_several_instances_are_one_mesh_with_names_of_each(tmp_path):
    structure, _ = read(tmp_path, assembly("", "3., 0., 0.\n"))
    assert mass(structure) == pytest.approx(2.0, rel=1e-14)
    assert structure.groups["P-2.E1"].tolist() == structure.groups["P-2"].tolist() == [1]
    assert structure.sets["P-1.TOP"].tolist() == [4, 5, 6, 7]
    assert structure.sets["P-2.TOP"].tolist() == [12, 13, 14, 15]
    assert structure.sets["FIX"].tolist() == [0, 1]


def test_a_name_of_part_and_assembly_is_two_sets(tmp_path):
    structure, _ = read(tmp_path, assembly("").replace("NSET=FIX", "NSET=top"))
    assert structure.sets["top"].tolist() == [0, 1]
    assert structure.sets["P-1.TOP"].tolist() == [4, 5, 6, 7]


def test_sets_name_what_there_is(tmp_path):
    text = "*NSET, NSET=EARLY\n1, 2\n" + CUBE + "*NSET, NSET=S, GENERATE\n1, 20\n"
    text += "*ELEMENT, TYPE=B32, ELSET=EB\n2, 1, 2, 3\n*ELSET, ELSET=EALL\nE1, EB\n"
    text += "*NSET, NSET=OF_EB, ELSET=EB\n"
    structure, warning = read(tmp_path, text)
    assert structure.sets["EARLY"].tolist() == [0, 1] and len(structure.sets["S"]) == 8
    assert structure.groups["EALL"].tolist() == [0]
    assert structure.sets["OF_EB"].tolist() == [0, 1, 2]
    assert "elements of type B32 are left out (1)" in warning


def test_rows_may_be_in_an_included_file(tmp_path):
    (tmp_path / "nodes.txt").write_text(nodes())
    (tmp_path / "set.txt").write_text("1, 2\n")
    text = CUBE.replace(nodes(), "*INCLUDE, INPUT=nodes.txt\n")
    text += "*NSET, NSET=S\n*INCLUDE, INPUT=set.txt\n3\n"
    structure, _ = read(tmp_path, text)
    assert mass(structure) == pytest.approx(1.0, rel=1e-14)
    assert structure.sets["S"].tolist() == [0, 1, 2]


def test_data_may_be_in_another_file(tmp_path):
    (tmp_path / "elements.txt").write_text("1, 1,2,3,4,\n5,6,7,8\n")
    text = f"*NODE\n{nodes()}*ELEMENT, TYPE=C3D8, INPUT=elements.txt\n"
    assert mass(read(tmp_path, text)[0]) == pytest.approx(1.0, rel=1e-14)


PLATE = f"*NODE\n{nodes(CORNERS[:4])}*ELEMENT, TYPE=S4R, ELSET=P\n1, 1,2,3,4\n"
SHELL_ON_SOLID = CUBE + "*ELEMENT, TYPE=S4R, ELSET=P\n9, 1,2,3,4\n"
SPRINGS = CUBE + "*ELEMENT, TYPE=SPRING1, ELSET=K\n8, 1\n9, 2\n*SPRING, ELSET=K\n1\n5.\n"


@pytest.mark.parametrize(
    ("text", "words", "names"),
    [
        (PLATE, "S4R are taken as plane, without bending (1)", ("S4R", "SHELL")),
        (PLATE.replace("S4R", "CAX4"), "CAX4 are taken as plane (1)", ("CAX4", "AXISYMMETRIC")),
        (
            PLATE.replace("S4R", "CPE4"),
            'CPE4 are of plane strain, but plane is "stress" (1)',
            ("CPE4",),
        ),
        (SHELL_ON_SOLID, "elements of type S4R are left out (1)", ("S4R", "SHELL")),
        (SPRINGS, "elements of type SPRING1 are left out (2)", ("SPRING1", "SPRING")),
        (
            CUBE + "*CONTACT PAIR\nA, B\n" * 3,
            "keywords CONTACT PAIR are not read (3)",
            ("*contact pair", "CONNECTION"),
        ),
        (
            CUBE.rstrip("\n") + ",3,4,\n",
            "nodes beyond those of an element C3D8 are not read (1)",
            ("C3D8",),
        ),
        (CUBE + "*TIE, NAME=T\nA, B\n", "keywords TIE are not read (1)", ("TIE", "CONNECTION")),
        (CUBE + "*Equation\n2\n1, 1, 1., 2, 1, -1.\n", "EQUATION are not", ("EQUATION",)),
        (CUBE + "*MPC\nTIE, 1, 2\n", "keywords MPC are not read (1)", ("MPC",)),
        (CUBE + "*RIGIDBODY, ELSET=E1, REF NODE=1\n", "RIGID BODY are not", ("CONNECTION",)),
        (CUBE + "*NONSTRUCTURAL MASS\n", "NONSTRUCTURAL MASS", ("MASS",)),
        (
            CUBE + "*NEVER HEARD OF\n1, 2\n",
            "keywords NEVER HEARD OF are not read (1)",
            ("UNKNOWN",),
        ),
    ],
)
def test_what_is_left_out_is_named_unless_ignored(tmp_path, text, words, names):
    structure, warning = read(tmp_path, text)
    assert warning.startswith("job.inp: ") and words in warning
    for name in names:
        silent, warning = read(tmp_path, text, ignore=[name])
        assert warning == "" and abs(silent.K - structure.K).max() == 0.0


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("*NCOPY, OLD SET=A, CHANGE NUMBER=10, SHIFT\n", "NCOPY"),
        ("*NFILL\nA, B, 3\n", "NFILL"),
        ("*ELCOPY, OLD SET=A\n", "ELCOPY"),
        ("*NMAP, TYPE=RECTANGULAR\n", "NMAP"),
        ("*IMPERFECTION, FILE=x\n", "IMPERFECTION"),
        ("*NGEN, LINE=C\n1, 5\n", "NGEN"),
        ("*MODEL CHANGE, REMOVE\n", "MODEL CHANGE"),
    ],
)
def test_what_moves_or_makes_nodes_or_elements_is_refused_unless_ignored(tmp_path, text, where):
    with pytest.raises(ValueError, match=rf"job.inp, line 12, \*{where}: it .*ignore=\('{where}',"):
        read(tmp_path, CUBE + text)
    assert mass(read(tmp_path, CUBE + text, ignore=(where,))[0]) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            CUBE + "*NODE, SYSTEM=S\n9, 1, 2, 3\n",
            r"line 12, \*NODE: SYSTEM must be R or C, got 'S'",
        ),
        (CUBE + "*ELEMENT, TYPE=C3D8\n1, 1,2,3,4,5,6,7,8\n", "element 1 is given twice"),
        (CUBE + "*ELGEN\n7, 2\n", r"\*ELGEN: element 7 does not exist"),
        (CUBE + "*NGEN\n1, 2, 3\n", r"\*NGEN: numbers must lead from 1 to 2, got steps of \[3\]"),
        (assembly("").replace("INSTANCE=P-1", "INSTANCE=I"), "instance 'I' does not exist"),
        (CUBE + "*NSET, NSET=S, GENERATE\n8, 1\n", "numbers must lead from 8 to 1"),
        (CUBE.rsplit(",", 1)[0] + "\n", "C3D8 must have 8 nodes, got 7 in element 1"),
        (assembly("0., 0., 0., 1., 0., 0., 90.\n"), "a shift of three numbers and a turn of seven"),
        (assembly("0.\n0., 0., 0., 1., 0., 0.\n"), "a shift of three numbers and a turn of seven"),
        (CUBE + "*SYSTEM\n1., 2.\n", "must have one point or three in space, got 2 numbers"),
        (CUBE + "*INCLUDE, INPUT=job.inp\n", "'job.inp' includes itself"),
    ],
)
def test_what_is_wrong_is_refused_by_line_and_keyword(tmp_path, text, message):
    with pytest.raises(
        ValueError, match=rf"^job.inp, line \d+, \*[A-Z ]+: .*{message.split(': ')[-1]}"
    ):
        read(tmp_path, text)


def test_rows_before_a_keyword_are_refused(tmp_path):
    with pytest.raises(ValueError, match="job.inp: must begin with a keyword, got '1,0,0,0'"):
        read(tmp_path, CUBE.removeprefix("*NODE\n"))


EQUAL = "*ELEMENT, TYPE=C3D8, ELSET=E2\n2, 2,3,4,1,6,7,8,5\n"


def test_elements_with_the_nodes_of_another_one_are_counted_or_refused(tmp_path):
    structure, warning = read(tmp_path, CUBE + EQUAL)
    assert mass(structure) == pytest.approx(1.0, rel=1e-14)
    assert structure.groups["E2"].tolist() == structure.groups["E1"].tolist() == [0]
    assert "elements C3D8 that have the nodes of another one are left out (1)" in warning
    text = grids() + HEXA + card("CHEXA", 2, 8, 2, 3, 4, 1, 6, 7, 8, 5)
    warning = read(tmp_path, text, name="job.bdf")[1]
    assert "CHEXA that have the nodes of another one are left out (1)" in warning
    text = f"*NODE\n{nodes()}*ELEMENT, TYPE=C3D4\n1, 1,2,4,5\n*ELEMENT, TYPE=S4\n2, 1,2,4,5\n"
    with pytest.raises(ValueError, match="must not have tetra and quad with the same nodes"):
        read(tmp_path, text)


@pytest.mark.gate
def test_an_include_that_doubles_has_an_end(tmp_path):
    for k in range(12):
        (tmp_path / f"{k}.txt").write_text(f"*INCLUDE, INPUT={k + 1}.txt\n" * 2)
    (tmp_path / "12.txt").write_text("** nothing\n")
    with pytest.raises(ValueError, match="all files together must be read at most 16 times"):
        read(tmp_path, "*INCLUDE, INPUT=0.txt\n")


@pytest.mark.parametrize("ignore", ["TIE", [3], [""]])
def test_names_to_ignore_are_a_sequence_of_names(tmp_path, ignore):
    with pytest.raises(TypeError, match="ignore must be a sequence of names"):
        read(tmp_path, CUBE, ignore=ignore)


# ---- Nastran ---------------------------------------------------------------------------------


def card(*fields):
    """A card in columns of 8, with continuations."""
    first, rest = fields[:9], fields[9:]
    lines = ["".join(f"{x!s:<8}" for x in first)]
    while rest:
        lines.append(" " * 8 + "".join(f"{x!s:<8}" for x in rest[:8]))
        rest = rest[8:]
    return "\n".join(lines) + "\n"


def grids(points=CORNERS, system=""):
    return "".join(
        card("GRID", i, system, *map(float, point)) for i, point in enumerate(points, start=1)
    )


HEXA = card("CHEXA", 1, 7, *range(1, 9))
BULK = "BEGIN BULK\n" + grids() + HEXA + "ENDDATA\n"


def free(text):
    return "\n".join(
        ",".join(line[8 * k : 8 * k + 8].strip() for k in range(9)) for line in text.splitlines()
    )


def wide(text):
    """Fields of 16 columns, two lines for one."""
    lines = []
    for line in text.splitlines():
        fields = [line[8 * k : 8 * k + 8].strip() for k in range(9)]
        begin = f"{fields[0]}*" if fields[0] else "*"
        lines.append(f"{begin:<8}" + "".join(f"{x:<16}" for x in fields[1:5]))
        lines.append(f"{'*':<8}" + "".join(f"{x:<16}" for x in fields[5:]))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        BULK,
        BULK.replace("ENDDATA\n", ""),
        BULK.lower(),
        grids() + HEXA,
        "SOL 103\nCEND\nTITLE = a cube\n" + BULK,
        free(grids() + HEXA),
        free(grids() + HEXA).replace("\n,", "\n+,"),
        wide(grids() + HEXA),
        BULK.replace("5       6       ", "5       6       +A1     ").replace(
            "\n        7", "\n+A1     7"
        ),
        free(grids() + HEXA).replace(",", "\t"),
        BULK.replace("1.0     1.0     1.0", "1.+0    10.-1   .1E1").replace("CHEXA", "$ no\nCHEXA"),
        grids().replace("\n", " $ comment\n", 1) + "GRDSET\n" + HEXA,
        "\ufeff" + grids() + grids(CORNERS[:2]) + HEXA,
        (grids() + HEXA).replace("\n", "\r\n"),
    ],
)
def test_a_cube_is_read_however_its_fields_are_written(tmp_path, text):
    structure, warning = read(tmp_path, text, name="job.bdf")
    np.testing.assert_array_equal(structure.points, CORNERS)
    assert structure.elements["hexahedron"].tolist() == [[0, 1, 2, 3, 4, 5, 6, 7]]
    assert structure.groups["7"].tolist() == [0] and warning == ""


def test_grid_points_are_in_their_systems(tmp_path):
    # a system at (1, 0, 0) whose z is the basic x; in it a cylindrical one with its z along z
    systems = card("CORD2R", 4, 0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 1.0, 0.0)
    systems += card("CORD2C", 5, 4, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0)
    systems += card("CORD2S", 6, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0)
    text = systems + card("GRID", 1, 5, 2.0, 90.0, 3.0) + card("GRID", 2, 6, 2.0, 90.0, 90.0)
    text += card("GRID", 3, 4, 1.0, 2.0, 3.0) + card("CROD", 1, 1, 1, 2) + card("CROD", 2, 1, 2, 3)
    points = read(tmp_path, text, BAR, name="job.bdf")[0].points
    # x' = y and y' = z of the basic system
    expected = [[1 + 3, 0, 2], [0, 2, 0], [1 + 3, 1, 2]]
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-15)


def test_a_system_of_grid_points_is_that_of_their_places(tmp_path):
    frame = [(1.0, 1.0, 0.0), (1.0, 1.0, 5.0), (1.0, 3.0, 0.0)]
    text = "".join(card("GRID", 90 + i, "", *x) for i, x in enumerate(frame))
    text += card("CORD1R", 3, 90, 91, 92) + grids(system=3) + HEXA
    points = read(tmp_path, text, name="job.nas")[0].points
    np.testing.assert_allclose(points, [(1 - y, 1 + x, z) for x, y, z in CORNERS], atol=1e-15)
    with pytest.raises(ValueError, match="systems must not depend on themselves"):
        read(
            tmp_path,
            text.replace(card("GRID", 90, "", *frame[0]), card("GRID", 90, 3)),
            name="a.bdf",
        )


def test_groups_are_those_of_the_properties(tmp_path):
    points = [(x + k, y, z) for k in (0, 1) for x, y, z in CORNERS[:4] + CORNERS[4:]]
    text = grids(points) + HEXA + card("CHEXA", 2, 8, *range(9, 17))
    structure, _ = read(tmp_path, text, {"7": SOLID, "8": {**SOLID, "rho": 3.0}}, name="a.bdf")
    assert mass(structure) == pytest.approx(4.0, rel=1e-14)
    assert {name: x.tolist() for name, x in structure.groups.items()} == {"7": [0], "8": [1]}


QUAD = grids(CORNERS[:4]) + card("CQUAD4", 1, 7, 1, 2, 3, 4, 45.0, 0.1)


@pytest.mark.parametrize(
    ("text", "material", "words", "names"),
    [
        (QUAD, SOLID, "CQUAD4 are taken as plane, without bending (1)", ("CQUAD4", "SHELL")),
        (
            BULK.replace("ENDDATA", card("CQUAD4", 2, 8, 1, 2, 3, 4)),
            SOLID,
            "CQUAD4 are left out (1)",
            ("SHELL",),
        ),
        (
            BULK.replace("ENDDATA", card("RBE2", 9, 1, 123, 2, 3) * 2),
            SOLID,
            "RBE2 are not read (2)",
            ("RBE2", "CONNECTION"),
        ),
        (BULK.replace("ENDDATA", card("CONM2", 9, 1, "", 5.0)), SOLID, "CONM2", ("MASS",)),
        (BULK.replace("ENDDATA", card("CELAS2", 9, 5.0, 1, 1)), SOLID, "CELAS2", ("SPRING",)),
        (BULK.replace("ENDDATA", card("CDAMP2", 9, 5.0, 1, 1)), SOLID, "CDAMP2", ("DAMPER",)),
        (BULK.replace("ENDDATA", card("CHELLO", 9, 5.0)), SOLID, "CHELLO", ("UNKNOWN",)),
        (
            grids(CORNERS[:2]) + card("CROD", 1, 1, 1, 2) + card("CBUSH", 2, 1, 1, 2),
            BAR,
            "CBUSH",
            ("SPRING",),
        ),
    ],
)
def test_cards_that_are_left_out_are_named_unless_ignored(tmp_path, text, material, words, names):
    structure, warning = read(tmp_path, text, material, name="job.bdf")
    assert warning.startswith("job.bdf: ") and words in warning
    assert mass(structure) == pytest.approx(1.0, rel=1e-14)
    for name in names:
        assert read(tmp_path, text, material, name="job.bdf", ignore=[name])[1] == ""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            BULK.replace("CHEXA   1", "CHEXA   x"),
            "line 10, CHEXA: field 2 must be a whole number, got 'x'",
        ),
        (
            BULK.replace("1.0     1.0     1.0", "1.0     1.0.0   1.0"),
            "GRID: field 5 must be a number",
        ),
        (grids() + card("CHEXA", 1, 7, *range(1, 8)), "CHEXA: must have 8 or 20 grid points"),
        (
            free(grids()) + "\nCHEXA,1,7,1,2,3,4,5,6,7,8\n",
            "line 9: must have at most 10 fields, got 11",
        ),
        (grids(system=5) + HEXA, "line 1, GRID: coordinate system 5 does not exist"),
        (grids(CORNERS[:7]) + HEXA, "CHEXA 1: grid point 8 does not exist"),
        (grids() + HEXA + HEXA, "line 11, CHEXA: element 1 is given twice"),
        (grids() + grids(CORNERS[1:2]) + HEXA, "line 9, GRID: 1 is given twice, differently"),
        (
            grids() + card("CBAR", 1, 7, 1, 2, 0.0, 0.0, 1.0, "", 456),
            r"line 9, CBAR: pins and offsets .* ignore=\('CBAR',",
        ),
        (
            grids() + card("CBEAM", 1, 7, 1, 2, 0.0, 0.0, 1.0, "", "", "", 0.0, 0.5),
            "line 9, CBEAM: pins and offsets",
        ),
        (BULK.replace("ENDDATA", "CSUPER  1"), "line 12, CSUPER: it has superelements"),
        ("INCLUDE '../x.bdf'\n", "line 1, INCLUDE: must name a file in the folder"),
        (
            card("CORD2R", 5, 0, *9 * [0.0]) + grids(system=5) + HEXA,
            "must have three points that are not on",
        ),
        ("$ nothing\n", "mesh must have elements of line, .* got none"),
    ],
)
def test_cards_that_are_wrong_are_refused_by_line_and_name(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        read(tmp_path, text, name="job.bdf")


def test_an_included_file_is_read_in_its_place(tmp_path):
    (tmp_path / "grids.inc").write_text(grids())
    structure, _ = read(tmp_path, "INCLUDE 'grids.inc'\n" + HEXA, name="job.bdf")
    assert mass(structure) == pytest.approx(1.0, rel=1e-14)


def test_middles_of_edges_are_where_the_manual_has_them(tmp_path):
    # CHEXA: edges of the bottom, upright ones, those of the top
    edges = "01 12 23 30 04 15 26 37 45 56 67 74"
    x = np.array(CORNERS, dtype=float)
    ends = [[int(k) for k in edge] for edge in edges.split()]
    points = np.concatenate([x, x[ends].mean(axis=1)])
    text = grids(points) + card("CHEXA", 1, 7, *range(1, 21))
    structure, _ = read(tmp_path, text, name="job.bdf")
    own = structure.points[structure.elements["hexahedron20"][0]]
    from pmalpha.meshes.mesh import KINDS

    middles = np.array(KINDS["hexahedron20"].edges)
    np.testing.assert_allclose(own[8:], own[middles].mean(axis=1), rtol=0, atol=1e-15)


def test_a_model_of_pynastran_is_taken_as_it_is():
    # the attributes of pyNastran 1.4 that are used, which cannot be installed with NumPy 2
    node = types.SimpleNamespace
    points = {i: node(get_position=lambda x=x: np.array(x)) for i, x in enumerate(CORNERS, 11)}
    elements = {
        3: node(type="CHEXA", nodes=[*range(11, 19), *12 * [None]], pid=7),
        4: node(type="CBUSH", nodes=[11, 12], pid=9),
    }
    model = node(
        nodes=points, elements=elements, card_count={"GRID": 8, "CHEXA": 1, "CBUSH": 1, "MAT1": 1}
    )
    with pytest.warns(UserWarning, match=r"mesh: cards CBUSH are not read \(1\)"):
        structure = structures.from_mesh(model, {"7": SOLID})
    assert mass(structure) == pytest.approx(1.0, rel=1e-14)


# ---- any mesh --------------------------------------------------------------------------------

QUADS = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
PLANE = np.array([(x, y, 0.0) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)])


@pytest.fixture
def Mesh():
    return pytest.importorskip("meshio").Mesh


@pytest.mark.parametrize("kind", ["triangle", "quad", "triangle6", "quad8", "quad9"])
def test_clockwise_surfaces_are_turned_and_counted(Mesh, kind):
    from meshes import distorted

    points, elements = distorted(kind, 2)
    flat = np.pad(points, ((0, 0), (0, 1)))
    expected = structures.from_mesh(Mesh(flat, [(kind, elements)]), SOLID)
    mirrored = flat * [1.0, -1.0, 1.0]
    with pytest.warns(
        UserWarning, match=rf"surfaces {kind} are clockwise, and turned \({len(elements)}\)"
    ):
        turned = structures.from_mesh(Mesh(mirrored, [(kind, elements)]), SOLID)
    # the mirror image has the same stiffness with the sign of uy changed
    sign = np.tile([1.0, -1.0], len(points))
    difference = turned.K.toarray() * np.outer(sign, sign) - expected.K.toarray()
    assert abs(difference).max() < 1e-13 * abs(expected.K).max()


def test_a_cell_of_several_groups_is_one(Mesh):
    # as MSH 2.2 has it: the second quad once for each of its groups, in blocks of their own
    tags = [np.array([1, 1]), np.array([2])]
    mesh = Mesh(PLANE, [("quad", QUADS), ("quad", QUADS[1:])], cell_data={"gmsh:physical": tags})
    structure = structures.from_mesh(mesh, SOLID)
    assert mass(structure) == pytest.approx(2.0, rel=1e-14)
    assert {name: x.tolist() for name, x in structure.groups.items()} == {"1": [0, 1], "2": [1]}


def test_a_negative_number_of_gmsh_is_the_group_of_a_reversed_entity(Mesh):
    tags = [np.array([1, -1])]
    structure = structures.from_mesh(
        Mesh(PLANE, [("quad", QUADS)], cell_data={"gmsh:physical": tags}), SOLID
    )
    assert structure.groups["1"].tolist() == [0, 1] and list(structure.groups) == ["1"]


def test_a_complete_second_order_of_gmsh_names_its_option(Mesh):
    with pytest.raises(ValueError, match="with Mesh.SecondOrderIncomplete=1"):
        structures.from_mesh(Mesh(np.zeros((27, 3)), [("hexahedron27", [list(range(27))])]), SOLID)


def test_numbers_of_vtk_that_are_called_ids_are_read(tmp_path):
    pytest.importorskip("meshio")
    points = " ".join(f"{x} {y} {z}" for x, y, z in CORNERS)
    text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n"
    text += f"{points}\nCELLS 1 9\n8 0 1 2 3 4 5 6 7\nCELL_TYPES 1\n12\n"
    text += "CELL_DATA 1\nFIELD FieldData 1\nCellId 1 1 vtkIdType\n7\n"
    structure, _ = read(tmp_path, text, name="mesh.vtk")
    assert mass(structure) == pytest.approx(1.0, rel=1e-14)


def test_bodies_and_points_that_are_not_joined_are_counted(Mesh):
    # two squares that share no node; the second touches the first along a side, or is apart
    points = np.array(
        [(x, y, 0.0) for x0 in (0.0, 1.0) for x, y in [(x0, 0), (x0 + 1, 0), (x0 + 1, 1), (x0, 1)]]
    )
    quads = [[0, 1, 2, 3], [4, 5, 6, 7]]
    both = structures.from_mesh(Mesh(points, [("quad", quads)]), SOLID)
    assert (both.bodies, both.coincident) == (2, 2)
    assert repr(both).endswith(
        "2 bodies that no element connects, 6 rigid modes, 2 points at the place of another one>"
    )
    apart = structures.from_mesh(
        Mesh(
            points + [0.0, 0.0, 0.0] + (np.arange(8) > 3)[:, None] * [5.0, 0, 0], [("quad", quads)]
        ),
        SOLID,
    )
    assert (apart.bodies, apart.coincident) == (2, 0)
    frequencies = structures.modes(both.M, both.K, 8)[0]
    assert np.count_nonzero(frequencies < 1e-5) == 6
    one = structures.from_mesh(Mesh(PLANE, [("quad", QUADS)]), SOLID)
    assert (one.bodies, one.coincident) == (1, 0) and repr(
        one
    ) == "<Structure 6 points, 2 quad, 12 dofs>"


GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
1 1 "edge"
1 2 "both"
2 3 "plate"
$EndPhysicalNames
$Entities
0 3 1 0
1 0 0 0 1 0 0 1 1 0
2 1 0 0 1 1 0 2 2 -1 0
3 0 1 0 1 1 0 0 0
1 0 0 0 1 1 0 1 3 0
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
4 5 1 5
1 1 1 1
1 1 2
1 2 1 1
2 2 3
1 3 1 1
5 3 4
2 1 2 2
3 1 2 3
4 1 3 4
$EndElements
"""


def test_an_entity_of_gmsh_is_in_all_of_its_groups_or_in_none(tmp_path, mesh_library):
    # the second curve is in "both" and, reversed, in "edge"; the third is in no group
    structure, warning = read(tmp_path, GMSH, name="mesh.msh")
    assert {name: x.tolist() for name, x in structure.sets.items()} == {
        "edge": [0, 1, 2],
        "both": [1, 2],
        "plate": [0, 1, 2, 3],
    }
    assert structure.groups["plate"].tolist() == [0, 1] and warning == ""
    for text in (GMSH[:300] + "$EndEntities\n", GMSH + "$PartitionedEntities\n"):
        with pytest.raises(ValueError, match="mesh must be"):
            read(tmp_path, text, name="mesh.msh")


def test_binary_entities_of_gmsh_have_their_groups():
    from pmalpha.readers.mesh_files import without_entities

    def curve(tag, groups):
        sizes = [np.array(len(x), dtype="u8").tobytes() for x in (groups, [])]
        head = np.array(tag, dtype="i4").tobytes() + np.zeros(6).tobytes()
        return head + sizes[0] + np.array(groups, dtype="i4").tobytes() + sizes[1]

    body = np.array([0, 2, 1, 0], dtype="u8").tobytes()
    body += curve(1, [1]) + curve(2, [2, -1]) + curve(1, [])
    content = b"$MeshFormat\n4.1 1 8\n\1\0\0\0\n$EndMeshFormat\n"
    rest, groups = without_entities(
        content + b"$Entities\n" + body + b"\n$EndEntities\n" + b"$Nodes"
    )
    assert rest == content + b"$Nodes"
    assert groups == {(1, 1): {1}, (1, 2): {1, 2}, (2, 1): set()}


HEAD = "# vtk DataFile Version 5.1\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"


def test_cells_of_vtk_that_a_library_leaves_out_are_refused(tmp_path, mesh_library):
    points = " ".join(f"{x} {y} {z}" for x, y, z in 2 * CORNERS)
    text = f"{HEAD}POINTS 16 float\n{points}\nCELLS 3 16\nOFFSETS vtktypeint64\n0 8 16\n"
    text += "CONNECTIVITY vtktypeint64\n0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15\nCELL_TYPES 2\n"
    for number, name in ((11, "voxels"), (8, "pixels"), (6, "triangle strips"), (42, "polyhedra")):
        with pytest.raises(ValueError, match=rf"{name} \(cell type {number} of VTK, 1 of them"):
            read(tmp_path, text + f"12\n{number}\n", name="mesh.vtk")
    assert mass(read(tmp_path, text + "12\n12\n", name="mesh.vtk")[0]) == pytest.approx(2.0)


FLUENT = """(0 "a square")\n(2 2)\n(10 (0 1 4 0 2))\n(10 (1 1 4 1 2)(\n0 0\n1 0\n1 1\n0 1\n))
(12 (0 1 1 0))\n(13 (0 1 4 0))\n(13 (3 1 4 3 2)(\n1 2 1 0\n2 3 1 0\n3 4 1 0\n4 1 1 0\n))\n"""


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.msh", FLUENT, "a mesh of Fluent lists the faces between cells"),
        ("a.msh", "\ufeff\n" + FLUENT, "a mesh of Fluent lists the faces between cells"),
        ("a.msh", "$NOD\n1\n", "it has no .MeshFormat, .* but .NOD of its first version"),
        ("a.msh", "no mesh\n", "it has no .MeshFormat, with which files of gmsh begin$"),
        ("a.UNV", "    -1\n  2411\n", "I-DEAS files are read by neither .* Gmsh opens them"),
    ],
)
def test_files_that_are_not_read_are_named_with_a_way(tmp_path, name, text, words):
    with pytest.raises(ValueError, match=words):
        read(tmp_path, text, name=name)


def test_numbers_of_vtk_with_one_component_name_groups(tmp_path, mesh_library):
    text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n"
    text += "0 0 0 1 0 0 1 1 0 0 1 0\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n9\n"
    text += "CELL_DATA 1\nSCALARS part int 1\nLOOKUP_TABLE default\n5\n"
    structure, _ = read(tmp_path, text, {"5": SOLID}, name="mesh.vtk", names="part")
    assert structure.groups["5"].tolist() == [0]


def test_what_a_library_prints_on_a_file_is_a_warning(tmp_path, mesh_library, capsys):
    text = "MeshVersionFormatted 2\nDimension 2\nVertices\n3\n0 0 0\n1 0 0\n0 1 0\n"
    text += "Triangles\n1\n1 2 3 7\nRidges\n1\n1\nEnd\n"
    _, warning = read(tmp_path, text, name="mesh.mesh")
    assert f"{mesh_library.__name__} reports: " in warning and "Ridges" in warning
    assert capsys.readouterr().err == ""


def test_a_mesh_of_ansys_has_its_components_and_what_is_no_block_is_refused(tmp_path):
    library = pytest.importorskip("meshlane")
    path = tmp_path / "job.cdb"
    cube = [("hexahedron", [list(range(8))])]
    sets = {"point_sets": {"top": np.array([4, 5, 6, 7])}, "cell_sets": {"body": [np.array([0])]}}
    library.ansysInp.write(path, library.Mesh(np.array(CORNERS, dtype=float), cube, **sets))
    text = path.read_text()
    structure, warning = read(tmp_path, text, {"body": SOLID}, name="job.cdb")
    assert mass(structure) == pytest.approx(1.0, rel=1e-14) and warning == ""
    assert structure.sets["top"].tolist() == [4, 5, 6, 7]
    with pytest.raises(ValueError, match=r"job.cdb, line \d+, CP: .* ignore=\('CP',"):
        read(tmp_path, text + "CP,1,UX,1,2\n", name="job.cdb")
    more = text.replace("EBLOCK,19,SOLID,1,1", "EBLOCK,19,SOLID,3,3")
    assert "elements of contact are left out (2)" in read(tmp_path, more, name="job.cdb")[1]
    flat = library.Mesh(np.array(CORNERS[:4], dtype=float), [("quad", [[0, 1, 2, 3]])])
    library.ansysInp.write(path, flat)
    assert "without bending (1)" in read(tmp_path, path.read_text(), name="job.cdb")[1]


# ---- Exodus ----------------------------------------------------------------------------------

EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7)]
MIDDLES = [np.mean([CORNERS[i], CORNERS[j]], axis=0) for i, j in [*EDGES, (7, 4)]]
TWO = [*CORNERS, (2, 0, 0), (2, 1, 0)]  # a wedge beside the cube
BLOCKS = [("HEX8", [range(8)]), ("WEDGE", [[1, 5, 8, 2, 6, 9]])]


def exodus(path, points=TWO, blocks=BLOCKS, names=(), netcdf4=False):
    """A file as Cubit writes it: blocks 10, 20, ..., a set of nodes 7, a set of sides 8."""
    words = np.array([[x.encode().ljust(33, b"\0")[k : k + 1] for k in range(33)] for x in names])
    arrays = {f"coord{x}": np.array(points, dtype=float)[:, k] for k, x in enumerate("xyz")}
    arrays |= {"eb_prop1": 10 * np.arange(1, len(blocks) + 1), "ns_prop1": np.array([7])}
    arrays |= {"ss_prop1": np.array([8]), "elem_ss1": np.array([1]), "side_ss1": np.array([5])}
    arrays |= {"node_ns1": np.array([2, 1])} | ({"eb_names": words} if names else {})
    arrays |= {f"connect{k}": np.array(nodes) + 1 for k, (_, nodes) in enumerate(blocks, 1)}
    types = {f"connect{k}": word for k, (word, _) in enumerate(blocks, 1)}
    if netcdf4:
        with pytest.importorskip("h5py").File(path, "w") as root:
            for name, x in arrays.items():
                root[name] = x
                if name in types:
                    root[name].attrs["elem_type"] = np.bytes_(types[name])
        return path
    with netcdf_file(path, "w", version=2) as file:
        for name, x in arrays.items():
            sizes = [f"{name}_{k}" for k in range(x.ndim)]
            for size, length in zip(sizes, x.shape):
                file.createDimension(size, length)
            kind = {"f": "d", "i": "i", "S": "c"}[x.dtype.kind]
            variable = file.createVariable(name, kind, sizes)
            variable[:] = x
            if name in types:
                variable.elem_type = types[name]
    return path


@pytest.mark.parametrize("netcdf4", [False, True])
def test_blocks_of_exodus_are_groups_by_name_or_number(tmp_path, netcdf4):
    path = exodus(tmp_path / "job.exo", names=("steel", ""), netcdf4=netcdf4)
    with pytest.warns(UserWarning, match=r"sets of sides 8 are left out"):
        structure = structures.from_mesh(path, {"steel": SOLID, "20": {**SOLID, "rho": 10.0}})
    assert {name: x.tolist() for name, x in structure.groups.items()} == {"steel": [0], "20": [1]}
    assert structure.sets["7"].tolist() == [0, 1]
    assert mass(structure) == pytest.approx(1.0 + 10.0 * 0.5, rel=1e-14)


def test_nodes_in_the_middles_of_edges_of_exodus_are_in_their_order(tmp_path):
    """Those of the edges between both ends come first; in another order M has another sum."""
    path = exodus(tmp_path / "job.e", [*CORNERS, *MIDDLES], [("HEX20", [range(20)])])
    structure = structures.from_mesh(path, SOLID, ignore=("8",))
    assert mass(structure) == pytest.approx(1.0, rel=1e-13)


def test_elements_of_exodus_without_a_kind_and_damaged_files_are_refused(tmp_path):
    sphere = [("HEX8", [range(8)]), ("SPHERE", [[8]])]
    path = exodus(tmp_path / "job.g", blocks=sphere)
    with pytest.raises(ValueError, match=r"job.g, block .20.: elements SPHERE of 1 nodes"):
        structures.from_mesh(path, SOLID)
    structure = structures.from_mesh(path, SOLID, ignore=("SPHERE", "8"))
    assert list(structure.groups) == ["10"]
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(ValueError, match=r"mesh must be a whole file of Exodus, but .*job.g"):
        structures.from_mesh(path, SOLID)
    path.write_bytes(b"CDF\x05" + bytes(40))
    with pytest.raises(ValueError, match=r"it must be netCDF: classic"):
        structures.from_mesh(path, SOLID)
