"""csrc/ keeps its shape: folders include downward, files and functions stay short."""

import re
from pathlib import Path

CSRC = Path(__file__).parents[1] / "csrc"
CORE = CSRC / "core"
FILES = sorted(path.relative_to(CORE) for path in CORE.rglob("*.[ch]"))
SOURCES = sorted(CSRC.rglob("*.c"))

# The folders from the ground up. A folder includes files of its own, those of none, and
# of those before it what stands here.
BELOW = {
    "": set(),
    "algebra": set(),
    "factor": {"algebra"},
    "workers": set(),
    "solve": {"algebra", "factor"},
    "forces": {"algebra"},
    "observe": {"algebra", "forces"},
    "rig": {"forces", "workers"},
    "subdomain": {"algebra", "factor", "solve", "forces", "observe", "rig"},
    "couple": {
        "algebra",
        "factor",
        "workers",
        "solve",
        "forces",
        "observe",
        "rig",
        "subdomain",
    },
    "describe": {
        "algebra",
        "factor",
        "solve",
        "forces",
        "observe",
        "rig",
        "subdomain",
        "couple",
    },
}


def included(path):
    return re.findall(r'^#include "(.+)"$', (CORE / path).read_text(), re.MULTILINE)


def functions(text):
    """(first line, lines) of each body: a brace alone in column 0 up to the next closing one."""
    begin = None
    for number, line in enumerate(text.splitlines(), 1):
        if line == "{":
            begin = number
        elif line == "}" and begin is not None:
            yield begin, number - begin + 1
            begin = None


def test_a_folder_of_the_core_includes_what_is_below_it():
    for path in FILES:
        folder = str(path.parent) if path.parent.name else ""
        allowed = BELOW[folder] | {folder, ""}
        for name in included(path):
            assert (CORE / name).exists(), f"{path}: {name}"
            assert (name.split("/")[0] if "/" in name else "") in allowed, f"{path}: {name}"


def test_folders_of_the_core_are_listed_after_those_that_they_include():
    assert {path.parent.name for path in FILES} == BELOW.keys()
    listed = list(BELOW)
    for folder, below in BELOW.items():
        assert below <= set(listed[: listed.index(folder)]), folder


def test_the_core_includes_no_header_of_python():
    for path in FILES:
        assert "Python.h" not in (CORE / path).read_text()


def test_files_in_c_have_at_most_900_lines_and_lines_100_columns():
    for path in sorted(CSRC.rglob("*.[ch]")):
        lines = path.read_text().splitlines()
        assert len(lines) <= 900, path.name
        for number, line in enumerate(lines, 1):
            assert len(line) <= 100, f"{path.name}, line {number}"


def test_functions_in_c_have_at_most_90_lines():
    for path in SOURCES:
        for begin, lines in functions(path.read_text()):
            assert lines <= 90, f"{path.name}, line {begin}"


def test_a_long_function_would_be_seen():
    text = "static void f(void)\n{\n" + 90 * "    g();\n" + "}\n"
    assert list(functions(text)) == [(2, 92)]


DEFINED = re.compile(
    r"^(?!static)[A-Za-z_][\w *]*?\**(pma_\w+)(?:\([^;{}]*\)\s*\{|\s*=|\[\w*\]\s*=)", re.MULTILINE
)


def code(path):
    return re.sub(r'/\*.*?\*/|"(?:\\.|[^"\\])*"', " ", path.read_text(), flags=re.DOTALL)


def uses_of_sources(texts):
    """Which others a source uses: those that define a function or a constant which it names."""
    home = {name: path for path, text in texts.items() for name in DEFINED.findall(text)}
    return {
        path: {home[name] for name in re.findall(r"\bpma_\w+", text) if name in home} - {path}
        for path, text in texts.items()
    }


def circle(uses):
    """The files that are in a circle, or that only files in one use."""
    left = dict(uses)
    while True:
        free = [path for path, used in left.items() if not used & left.keys()]
        if not free:
            return sorted(map(str, left))
        for path in free:
            del left[path]


def test_no_source_uses_one_that_uses_it():
    uses = uses_of_sources({path: code(path) for path in SOURCES if path.parent.name != "tests"})
    assert sum(map(len, uses.values())) > 300
    assert circle(uses) == []


def test_no_header_includes_one_that_includes_it():
    headers = [path for path in FILES if path.suffix == ".h"]
    assert circle({str(path): set(included(path)) for path in headers}) == []


def test_a_circle_would_be_seen():
    texts = {
        "a": "int pma_a(void)\n{\n    return pma_b();\n}\n",
        "b": "const int *pma_b = pma_c;\n",
    }
    assert circle(uses_of_sources(texts)) == []
    assert circle(uses_of_sources({**texts, "c": "void pma_c(int x)\n{\n    pma_a();\n}\n"})) == [
        "a",
        "b",
        "c",
    ]
