"""csrc/ keeps its shape: folders include downward, files and functions stay short."""

import re
from pathlib import Path

import pytest

CSRC = Path(__file__).parents[1] / "csrc"
CORE = CSRC / "core"
FILES = sorted(path.relative_to(CORE) for path in CORE.rglob("*.[ch]"))
SOURCES = sorted(CSRC.rglob("*.c"))

# What a folder may include, besides its own files and status.h.
BELOW = {
    "": set(),
    "algebra": set(),
    "member": {"algebra"},
    "workers": set(),
    "coupling": {"algebra", "member", "workers"},
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


@pytest.mark.parametrize("path", FILES, ids=str)
def test_a_folder_of_the_core_includes_what_is_below_it(path):
    folder = str(path.parent) if path.parent.name else ""
    allowed = BELOW[folder] | {folder, ""}
    for name in included(path):
        assert (CORE / name).exists(), name
        assert (name.split("/")[0] if "/" in name else "") in allowed, name


def test_the_core_includes_no_header_of_python():
    for path in FILES:
        assert "Python.h" not in (CORE / path).read_text()


@pytest.mark.parametrize("path", sorted(CSRC.rglob("*.[ch]")), ids=lambda p: str(p.name))
def test_files_in_c_have_at_most_600_lines(path):
    assert len(path.read_text().splitlines()) <= 600


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.name))
def test_functions_in_c_have_at_most_60_lines(path):
    for begin, lines in functions(path.read_text()):
        assert lines <= 60, f"line {begin}"


def test_a_long_function_would_be_seen():
    text = "static void f(void)\n{\n" + 60 * "    g();\n" + "}\n"
    assert list(functions(text)) == [(2, 62)]
