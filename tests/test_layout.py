"""The package is arranged as in docs/architecture.md: folders, layers, small files."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import pmalpha as pm
from pmalpha import _rooms

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "pmalpha"
MODULES = sorted(path.relative_to(ROOT) for path in PACKAGE.rglob("*.py"))

# From bottom to top. A module imports from its own folder and from lower layers.
LAYERS = (
    ("_core",),
    ("_cached", "_checks", "_rooms", "_tables", "errors", "memory", "stale"),
    ("files",),
    ("problem",),
    ("devices",),
    ("reduction",),
    ("meshes",),
    ("setup",),
    ("results",),
    ("gradients",),
    ("frozen",),
    ("run",),
    ("readers",),
    ("structures",),
    ("rig",),
    ("export",),
    ("models",),
    ("analysis",),
    ("plot",),
    ("cutting",),
    ("__init__",),
    ("__main__",),
)
LEVEL = {unit: level for level, units in enumerate(LAYERS) for unit in units}
# Rooms that know no outer one, which import of them what `_rooms.INNER` lists.
INNER = ("problem", "devices", "reduction", "setup", "results", "gradients", "frozen", "run")
OUTER = (
    *("meshes", "readers", "structures", "rig", "export"),
    *("models", "analysis", "plot", "cutting"),
)

# A class is in one file: these have the reference of all methods, whose lines do not count.
OF_ONE_CLASS = {Path("pmalpha/run/coupler.py"), Path("pmalpha/structures/structure.py")}

PUBLIC_PACKAGES = ("analysis", "plot", "readers", "rig", "structures")


def name_of(path):
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {name_of(path) for path in MODULES} | {"pmalpha._core"}


def unit_of(module):
    """An entry of pmalpha/: a folder or a file."""
    return (*module.split("."), "__init__")[1]


def statements_of(source):
    """All statements of a source, inside others too; far fewer than the nodes of `ast.walk`."""
    found, last = list(ast.parse(source).body), 0
    while last < len(found):
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            found += getattr(found[last], name, [])
        last += 1
    return found


def imports_in(statements, path):
    """Modules of the package that are imported, anywhere in a source."""
    package = path.with_suffix("").parts[:-1]
    found = set()
    for node in statements:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            whole = ".".join(filter(None, (base, node.module)))
            inner = {f"{whole}.{alias.name}" for alias in node.names}
            found |= (inner & NAMES) | ({whole} if inner - NAMES else set())
    return {name for name in found if name.split(".")[0] == "pmalpha"}


def lengths_in(statements):
    """Lines of each function by name, without its docstring, and those of all docstrings."""
    found, docstrings = {}, 0
    for node in statements:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            lines = node.end_lineno - node.lineno + 1
            if ast.get_docstring(node) is not None:
                docstring = node.body[0].end_lineno - node.body[0].lineno + 1
                lines -= docstring
                docstrings += docstring
            found[node.name] = max(lines, found.get(node.name, 0))
    return found, docstrings


@cache
def read(path):
    """Source, imports, lengths of functions and lines of docstrings of a module of the package."""
    source = (ROOT / path).read_text()
    statements = statements_of(source)
    return source, imports_in(statements, path), *lengths_in(statements)


def graph_of_imports():
    return {name_of(path): set(read(path)[1]) for path in MODULES}


def upward(graph):
    """Imports that lead to another unit of the same layer or of a higher one."""
    return {
        (module, other)
        for module, others in graph.items()
        for other in others
        if unit_of(module) != unit_of(other) and LEVEL[unit_of(other)] >= LEVEL[unit_of(module)]
    }


def cycle_in(graph):
    """Modules that import each other; None if there are none."""
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return error.args[1]
    return None


def test_imports_are_read_at_the_top_inside_functions_and_for_types():
    source = """
import numpy
import pmalpha.plot
from .. import _core
from ..errors import PmalphaError
from . import motion, session
def f():
    from .coupler import Coupler
if TYPE_CHECKING:
    from ..plot.histories import time_histories
"""
    found = imports_in(statements_of(source), Path("pmalpha/run/new.py"))
    names = "_core errors plot plot.histories run.coupler run.motion run.session"
    assert found == {f"pmalpha.{name}" for name in names.split()}


def test_every_module_has_a_layer():
    assert {unit_of(name) for name in NAMES} == set(LEVEL)


def test_nothing_is_imported_upward():
    assert upward(graph_of_imports()) == set()


def names_of_inner(source, path):
    """(module, name) of what a module of an outer room imports of inner ones."""
    package = path.with_suffix("").parts[:-1]
    for node in statements_of(source):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            whole = ".".join((*base, *filter(None, (node.module,))))
            for alias in node.names:
                names = f"{whole}.{alias.name}", "all of it"
                module, name = names if names[0] in NAMES else (whole, alias.name)
                if unit_of(module) in INNER:
                    yield module.removeprefix("pmalpha."), name


def test_outer_rooms_import_of_inner_ones_what_one_page_lists():
    outer = [path for path in MODULES if unit_of(name_of(path)) in OUTER]
    seen = {pair for path in outer for pair in names_of_inner(read(path)[0], path)}
    listed = {(m, name) for m, names in _rooms.INNER.items() for name in names.split()}
    assert seen == listed


def test_an_import_that_the_page_does_not_list_would_be_detected():
    source = "from ..setup import member\nfrom ..run.session import begin\nfrom .cut import cut\n"
    found = set(names_of_inner(source, Path("pmalpha/cutting/new.py")))
    assert found == {("setup.member", "all of it"), ("run.session", "begin")}


@pytest.mark.parametrize("name", _rooms.OUTER)
def test_what_is_called_of_a_higher_room_is_there(name):
    assert callable(_rooms.outer(name))


def test_there_are_no_cycles_of_imports():
    assert cycle_in(graph_of_imports()) is None


def test_an_upward_import_and_a_cycle_would_be_detected():
    graph = graph_of_imports()
    arrow = ("pmalpha.problem.subdomain", "pmalpha.setup.member")
    graph[arrow[0]].add(arrow[1])
    assert upward(graph) == {arrow}
    assert set(arrow) <= set(cycle_in(graph))
    inside = graph_of_imports()
    inside["pmalpha.setup.factors"].add("pmalpha.setup.member")  # which imports factors
    assert upward(inside) == set() and cycle_in(inside) is not None


def test_at_most_a_dozen_modules_are_directly_in_the_package():
    assert len([path for path in MODULES if len(path.parts) == 2]) <= 12


def test_folders_are_not_nested():
    assert max(len(path.parts) for path in MODULES) == 3


# Lines that there may be: a commit that removes some lowers the figure, one that raises it says why
# in docs/decisions.md.
MOST_LINES = {
    ("csrc/core", "[ch]"): 24_751,
    ("csrc/binding", "[ch]"): 4_700,
    ("csrc/library", "[ch]"): 1_900,
    ("csrc/fmu", "[ch]"): 1_300,
    ("csrc/tests", "[ch]"): 16_030,
    ("pmalpha", "py"): 55_850,
    ("tests", "py"): 72_330,
    ("docs", "md"): 7_820,
}


@pytest.mark.parametrize(("folder", "ending"), MOST_LINES)
def test_there_are_no_more_lines_than_were_allowed(folder, ending):
    files = (ROOT / folder).rglob(f"*.{ending}")
    lines = sum(path.read_text().count("\n") for path in files)
    assert 0 < lines <= MOST_LINES[folder, ending]


def test_files_have_a_docstring_and_up_to_900_lines_and_functions_up_to_90():
    for path in MODULES:
        source, _, lengths, docstrings = read(path)
        assert source.count("\n") <= 900 + (docstrings if path in OF_ONE_CLASS else 0), path
        assert {name: n for name, n in lengths.items() if n > 90} == {}, path
        assert source.startswith('"""'), path  # its docstring


def test_lines_of_functions_are_counted_without_their_docstring():
    def lengths(source):
        return lengths_in(statements_of(source))

    body = "    x = 1\n" * 59
    docstring = '    """One.\n\n    Two.\n    """\n'
    assert lengths(f"def f():\n{body}") == ({"f": 60}, 0)
    assert lengths(f"def f():\n{docstring}{body}") == ({"f": 60}, 4)
    assert lengths("class A:\n    def f(self):\n        pass\n") == ({"f": 2}, 0)
    assert lengths(f"async def f(\n    a,\n):\n{body}") == ({"f": 62}, 0)


# Pronouns and participles, which say of a variable where it comes from and not what it is
NO_NOUNS = frozenset(("own", "whole", "found", "given", "kept", "others", "each", "more"))


def names_without_noun(source):
    """Variables, arguments, attributes and keywords that are no nouns."""
    for node in ast.walk(ast.parse(source)):
        name = getattr(node, {ast.Name: "id", ast.Attribute: "attr"}.get(type(node), "arg"), None)
        if name in NO_NOUNS:
            yield name


def test_names_of_variables_are_nouns():
    seen = {(path, name) for path in MODULES for name in names_without_noun(read(path)[0])}
    public = {("tangents.py", "given"), ("error_budget.py", "own")}
    assert {(path.name, name) for path, name in seen} == public


def test_a_name_without_noun_would_be_detected():
    source = "def f(given, *, each=1):\n    own = given.kept\n    return g(more=own)\n"
    assert sorted(names_without_noun(source)) == "each given given kept more own own".split()


def test_dir_shows_public_names_only():
    assert dir(pm) == sorted(pm.__all__)
    assert all(hasattr(pm, name) for name in pm.__all__)
    hidden = {
        "problem",
        "reduction",
        "meshes",
        "setup",
        "results",
        "run",
        "errors",
        "files",
        "memory",
    }
    assert hidden.isdisjoint(dir(pm))
    for name in (*PUBLIC_PACKAGES, "export", "models"):
        package = importlib.import_module(f"pmalpha.{name}")
        assert package is getattr(pm, name)
        assert dir(package) == sorted(package.__all__)
        assert all(hasattr(package, public) for public in package.__all__)


def test_a_public_name_is_at_one_place():
    public = [getattr(pm, name) for name in pm.__all__]
    packages = [x for x in public if inspect.ismodule(x)]
    names = [*pm.__all__, *(name for package in packages for name in package.__all__)]
    assert not {name for name in names if names.count(name) > 1}


@pytest.mark.parametrize("name", ["Coupled", "Energy", "Plan", "State", "remote"])
def test_an_unknown_name_is_refused_and_so_is_one_that_is_only_returned(name):
    with pytest.raises(AttributeError, match=f"module 'pmalpha' has no attribute '{name}'"):
        getattr(pm, name)


def test_type_checkers_see_what_is_loaded_when_it_is_first_used():
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.name: node.module for node in imports for alias in node.names}
    assert seen == dict.fromkeys(pm._MODULES) | pm._LATER


def test_parts_of_scipy_and_of_the_package_are_loaded_when_they_are_used():
    def loaded_by(name):
        code = f"import sys, {name}; print(*sys.modules)"
        run = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        return set(run.stdout.split())

    loaded = loaded_by("pmalpha")
    assert "scipy.sparse" in loaded and "pmalpha.run.coupler" in loaded
    parts = {"linalg", "sparse.linalg", "sparse.csgraph", "interpolate", "optimize", "signal"}
    later = {"analysis", "cutting", "frozen", "gradients", "meshes", "models", "plot"}
    later |= {"structures", "run.cases", "run.freeze", "run.tolerance", "run.whole_structure"}
    # older versions of scipy.sparse load some of them
    assert not (loaded - loaded_by("scipy.sparse")) & {f"scipy.{part}" for part in parts}
    assert not loaded & {f"pmalpha.{name}" for name in later}


def test_properties_that_are_kept_have_no_lock():
    # that of functools in Python 3.11 hangs a process forked off while a thread computes one
    locked = [str(path) for path in MODULES if "functools import cached_prop" in read(path)[0]]
    assert locked == []


def test_every_folder_is_packaged():
    listed = re.search(r"^packages = \[(.*?)\]", (ROOT / "pyproject.toml").read_text(), re.M | re.S)
    folders = {".".join(path.parts[:-1]) for path in MODULES}
    assert sorted(re.findall(r'"(.*?)"', listed[1])) == sorted(folders)
