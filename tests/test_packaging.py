"""What an installation brings, and what is said where pymetis is missing."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.reduction.ordering import elimination_order, graph_of, rows_of
from pmalpha.setup.factors import structure_of

ROOT = Path(__file__).parent.parent
PYPROJECT = ROOT / "pyproject.toml"
WORKFLOW = ROOT / ".github" / "workflows" / "wheels.yml"


def environment(system, machine, python, implementation="CPython"):
    return {
        "sys_platform": system,
        "platform_machine": machine,
        "python_version": python,
        "platform_python_implementation": implementation,
    }


# the wheels of pymetis 2025.2.2 on PyPI
WHEELS = [
    environment(system, machine, python)
    for system, machine in (("linux", "x86_64"), ("darwin", "x86_64"), ("darwin", "arm64"))
    for python in ("3.11", "3.12", "3.13", "3.14")
]
NO_WHEELS = [
    environment("linux", "aarch64", "3.12"),
    environment("linux", "ppc64le", "3.12"),
    environment("linux", "x86_64", "3.15"),
    environment("linux", "x86_64", "3.11", "PyPy"),
]


@pytest.mark.parametrize(
    ("there", "wanted"),
    [*((e, True) for e in WHEELS), *((e, False) for e in NO_WHEELS)],
    ids=lambda x: "-".join(x.values()) if isinstance(x, dict) else str(x),
)
def test_pymetis_is_a_dependency_where_it_has_wheels(there, wanted):
    requirements = pytest.importorskip("packaging.requirements")
    listed = tomllib.loads(PYPROJECT.read_text())["project"]["dependencies"]
    found = [requirements.Requirement(line) for line in listed]
    (metis,) = (r for r in found if r.name == "pymetis")
    assert metis.marker.evaluate(there) is wanted


def cube(m):
    box = pm.structures.solid(m, m, m, 0.1, E=1.0, nu=0.3, rho=1.0)
    return pm.Subdomain(box.M, box.K, scheme=pm.GeneralizedAlpha(0.8), name="cube")


def test_a_long_factorization_without_pymetis_is_warned_of_once(monkeypatch, thresholds):
    monkeypatch.setitem(sys.modules, "pymetis", None)  # import raises ImportError
    thresholds(NOTABLE_FACTORIZATION=1e6)
    with pytest.warns(pm.PerformanceWarning, match="pip install pymetis") as caught:
        pm.Coupler([cube(5)], dt=0.1)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    message = str(caught[0].message)
    assert "'cube'" in message and "33 s and 3 GB" in message


def test_a_short_factorization_is_not_warned_of(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymetis", None)
    pm.Coupler([cube(5)], dt=0.1)  # warnings are errors


def test_with_pymetis_there_is_no_warning(thresholds):
    pytest.importorskip("pymetis")
    thresholds(NOTABLE_FACTORIZATION=1e6)
    pm.Coupler([cube(5)], dt=0.1)


def test_the_multiplications_are_the_squared_lengths_of_the_columns():
    K = cube(6).K
    graph = graph_of([K])
    order = elimination_order(K.shape[0], graph, np.arange(0))
    A = K.toarray()[np.ix_(order, order)] + np.eye(len(order))
    L = np.linalg.cholesky(A)
    exact = np.sum(np.count_nonzero(abs(L) > 1e-14, axis=0) ** 2.0)
    counted = structure_of(*rows_of(graph, order), 0).operations
    # relaxed supernodes store zeros too; a cholesky factor has a few that cancel
    assert 0.95 * exact < counted < 1.5 * exact


def test_the_dependencies_are_named_once():
    text = PYPROJECT.read_text()
    assert len(set(re.findall(r"pymetis>=([\d.]+)", text))) == 1


def header_of(path):
    with np.load(path) as file:
        return json.loads(file["header"].item())


def test_files_name_the_version_that_wrote_them(tmp_path):
    coupler = pm.models.split_oscillator(10.0).coupler(0.05, coupling="pm")
    history = coupler.run(steps=2)
    history.save(tmp_path / "run.npz")
    coupler.save(tmp_path / "state.npz")
    for name in ("run.npz", "state.npz"):
        assert header_of(tmp_path / name)["pmalpha_version"] == pm.__version__
    pm.export.write_series(tmp_path / "bar.pvd", [[0.0], [1.0]], [[0, 1]], [0.0], [[0.0, 0.2]])
    for path in (tmp_path / "bar.pvd", tmp_path / "bar" / "000000.vtu"):
        assert f"<!-- pmalpha {pm.__version__} -->" in path.read_text()
    h5py = pytest.importorskip("h5py")
    history.save(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["pmalpha_version"] == pm.__version__


def test_recipe_citation_and_changelog_have_the_version_and_the_requirements_of_the_package():
    recipe, project = (ROOT / "conda" / "recipe.yaml").read_text(), PYPROJECT.read_text()
    version = re.search(r'^version = "(.*?)"', project, re.MULTILINE)[1]
    assert f'version: "{version}"' in recipe
    changes = (ROOT / "CHANGELOG.md").read_text()
    date = re.search(rf"^## \[{version}\] - (\d{{4}}-\d\d-\d\d)$", changes, re.M)
    assert date or f"\n## {version} (unreleased)\n" in changes
    cited = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {version}\n" in cited
    assert re.findall(r"^date-released: (.*)$", cited, re.M) == ([date[1]] if date else [])
    listed = set(re.findall(r"\b(numpy|scipy|threadpoolctl|pymetis)>=([\d.]+)", project))
    for name, lowest in listed - {("numpy", "2")}:
        assert f"    - {name} >={lowest}\n" in recipe, name


def test_the_workflow_pins_its_actions_and_what_it_installs():
    text, pins = WORKFLOW.read_text(), (ROOT / "packaging" / "tests.txt").read_text()
    actions = re.findall(r"uses: (\S+)@([0-9a-f]{40})  # v([\d.]+)\n", text)
    assert len(actions) == text.count("uses: ") > 0
    (version,) = {v for name, _, v in actions if name == "pypa/gh-action-pypi-publish"}
    # its twine accepts Metadata-Version 2.4, which a package with a License-Expression has
    assert tuple(map(int, version.split("."))) >= (1, 12, 3)
    installs = re.findall(r"pip install ((?:.*\\\n)*.*)", text)
    assert all(line.startswith("--constraint packaging/tests.txt ") for line in installs)
    pinned = dict(re.findall(r"^([\w-]+)==([\d.]+)$", pins, re.M))
    assert len(pinned) == pins.count("\n") - 1  # but for its first line, a comment
    project = tomllib.loads(PYPROJECT.read_text())["project"]
    extras = [project["optional-dependencies"][x] for x in ("hdf5", "mesh", "plot", "progress")]
    needed = [*project["dependencies"], *sum(extras, []), *re.findall(r"[\w-]+", installs[0])[-6:]]
    assert {re.match(r"[\w-]+", line)[0] for line in needed} <= set(pinned)


def has_setuptools():
    """Whether this environment has the version that a build of the package asks for."""
    (lowest,) = re.findall(r'"setuptools>=(\d+)"', PYPROJECT.read_text().split("[project]")[0])
    with suppress(metadata.PackageNotFoundError):
        return int(metadata.version("setuptools").split(".")[0]) >= int(lowest)
    return False


@pytest.mark.gate
@pytest.mark.skipif(not has_setuptools(), reason="needs setuptools as pyproject.toml asks for it")
def test_a_build_without_a_compiler_ends_with_where_to_read_on(tmp_path):
    out = ("--build-lib", tmp_path, "--build-temp", tmp_path)
    done = subprocess.run(
        [sys.executable, "setup.py", "build_ext", *out],
        cwd=ROOT,
        env={**os.environ, "CC": "false"},
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0
    assert done.stderr.splitlines()[-1].endswith("see docs/install.md#without-a-compiler")
    assert "\n## Without a compiler\n" in (ROOT / "docs" / "install.md").read_text()


# ---- builds --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def installed_tree(tmp_path_factory):
    """A copy of the sources from which pip has installed, and the environment of its builds."""
    pytest.importorskip("setuptools", "77")
    tree = tmp_path_factory.mktemp("tree")
    names = ["setup.py", "pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"]
    for name in names:
        shutil.copy(ROOT / name, tree)
    shutil.copytree(ROOT / "csrc", tree / "csrc")
    without = shutil.ignore_patterns("__pycache__", "*.so", "c")
    shutil.copytree(ROOT / "pmalpha", tree / "pmalpha", ignore=without)
    compiler = tree / "cc"  # without optimization, which takes most of the time
    compiler.write_text('#!/bin/sh\nexec cc "$@" -O0\n')
    compiler.chmod(0o755)
    words = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-compile"]
    environment = dict(os.environ, CC=str(compiler))
    subprocess.run(
        [sys.executable, *words, "--target", tree / "installed", "."],
        check=True, cwd=tree, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    return tree, environment


def build_in_place(tree, environment):
    words = [sys.executable, "setup.py", "build_ext", "--inplace"]
    options = {"cwd": tree, "env": environment, "capture_output": True, "text": True}
    done = subprocess.run(words, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


LIBRARY_FILES = ["fmu2.so", "fmu3.so", "libpmalpha.a", "libpmalpha.so"]


@pytest.mark.gate
@pytest.mark.skipif(sys.platform != "linux", reason="names of libraries")
def test_after_an_installation_the_same_tree_is_built_in_place(installed_tree):
    tree, environment = installed_tree
    build_in_place(tree, environment)
    library = tree / "pmalpha" / "c"
    assert {*LIBRARY_FILES} <= {path.name for path in library.iterdir()}
    assert (tree / "pmalpha" / "_core.abi3.so").exists()

    # no file has the path in which it was made
    for made in (*library.iterdir(), tree / "pmalpha" / "_core.abi3.so"):
        assert str(tree).encode() not in made.read_bytes(), made.name
    # nothing changed: nothing is compiled
    assert "-O0" not in build_in_place(tree, environment)
    before = (library / "libpmalpha.so").read_bytes()
    # a source of the library alone changed
    with (tree / "csrc" / "library" / "pmalpha.c").open("a") as file:
        file.write("PMALPHA_API int pmalpha_of_this_test(void);\n")
        file.write("int pmalpha_of_this_test(void)\n{\n    return 1;\n}\n")
    build_in_place(tree, environment)
    after = (library / "libpmalpha.so").read_bytes()
    assert b"pmalpha_of_this_test" in after and b"pmalpha_of_this_test" not in before

    # a build that was interrupted before the library was there is completed
    for path in tree.glob("build/lib*/pmalpha/c/fmu3.so"):
        path.unlink()
    (library / "fmu3.so").unlink()
    build_in_place(tree, environment)
    assert (library / "fmu3.so").exists()
