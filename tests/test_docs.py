"""The code in the documents runs and prints what is shown."""

import contextlib
import doctest
import importlib
import io
import os
import pkgutil
import re
import runpy
import shutil
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
import waits

import pmalpha as pm

ROOT = Path(__file__).parent.parent
README = " ".join((ROOT / "README.md").read_text().split())
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(pm.__path__, "pmalpha.")
    if module.name != "pmalpha.__main__"
)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_in_docstrings_run(name):
    module, public = importlib.import_module(name), {x: getattr(pm, x) for x in pm.__all__}
    # testmod would also run the docstrings without examples, which takes most of its time
    finder = doctest.DocTestFinder(exclude_empty=True)
    runner = doctest.DocTestRunner()
    for test in finder.find(module, name, extraglobs=public | {"np": np}):
        if test.examples:
            runner.run(test)
    assert runner.failures == 0


def test_docstrings_of_public_names_have_examples():
    classes_and_functions = [getattr(pm, name) for name in pm.__all__]
    shown = [x for x in classes_and_functions if ">>>" in (x.__doc__ or "")]
    assert {pm.Subdomain, pm.Coupler, pm.tie, pm.Constraint, pm.solve} <= set(shown)


def stated(code):
    """What the comments behind calls of print state: up to a colon or two spaces."""
    return [re.split(r":| {2}", x)[0].strip() for x in re.findall(r"print\(.*?\) +# (.*)", code)]


@pytest.mark.gate
@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        "docs/budget.md",
        "docs/contact.md",
        "docs/diverges.md",
        "docs/runs.md",
        "docs/gradients.md",
        "docs/index.md",
        "docs/layers.md",
        "docs/model.md",
        "docs/moving.md",
        "docs/own-element.md",
        "docs/right.md",
        "docs/actuators.md",
        "docs/laboratory.md",
        "docs/rig.md",
        "docs/tutorial.md",
    ],
)
def test_code_on_a_page_runs_and_prints_what_its_comments_state(page, tmp_path, monkeypatch):
    if "record_to" in (shown := (ROOT / page).read_text()):
        pytest.importorskip("h5py")
    if "import meshlane" in shown:
        pytest.importorskip("meshlane")
    monkeypatch.chdir(tmp_path)
    code = "".join(re.findall(r"```python\n(.*?)```", shown, re.DOTALL))  # one program
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, page, "exec"), {})
    expected = stated(code)
    assert expected and printed.getvalue().split("\n")[:-1] == expected


def test_the_study_of_many_earthquakes_runs_in_processes(tmp_path):
    pytest.importorskip("h5py")
    shown = re.findall(
        r"```python\n(# (\w+\.py).*?)```", (ROOT / "docs/many.md").read_text(), re.DOTALL
    )
    for code, name in shown:
        (tmp_path / name).write_text(code)
    done = waits.program(f"""
        import os, runpy, sys
        os.chdir({str(tmp_path)!r})
        sys.path.insert(0, "")
        runpy.run_path("study.py", run_name="__main__")
    """)
    expected = stated((tmp_path / "study.py").read_text())
    assert expected and done.stdout.split("\n")[:-1] == expected, done.stderr
    assert (tmp_path / "peaks.h5").exists()


def test_every_page_with_a_program_is_executed_by_a_test():
    """By the tests of this file, or by those that name the page."""
    pages = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("docs/method/*.md")]
    tests = "\n".join(path.read_text() for path in ROOT.glob("tests/*.py"))
    shown = {page.name for page in pages if "```python" in page.read_text()}
    assert len(shown) > 10 and not [name for name in shown if f'{name}"' not in tests]


def test_the_error_that_the_readme_states_is_that_of_its_example():
    draw = runpy.run_path(str(ROOT / "docs" / "pictures" / "draw.py"))
    names = draw["example"]()
    tower, rig, run = names["tower"], names["base"], names["history"]["tower"]
    reference = draw["exact"](*draw["uncut"](tower, rig), tower.u0, run.t[1], len(run.t) - 1)
    error = f"{100 * draw['error'](run.u, reference):.1f} %"
    assert [error] == re.findall(r"error in 20 s is (.*?%)", README)


def test_links_between_the_documents_have_targets():
    for page in [ROOT / "README.md", *ROOT.glob("docs/**/*.md"), ROOT / "CONTRIBUTING.md"]:
        links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
        missing = [link for link in links if not (page.parent / link).exists()]
        assert not missing, page.name


def test_the_version_is_in_one_file():
    assert f'version = "{pm.__version__}"' in (ROOT / "pyproject.toml").read_text()


def test_the_list_of_files_has_a_line_for_each_and_pages_for_developers_name_files_that_there_are():
    files = runpy.run_path(str(ROOT / "docs" / "files.py"))
    assert not re.findall(r"\| `(\S+)` \|  \|", files["page"]())
    pages = [ROOT / "docs" / "architecture.md", ROOT / "docs" / "adding.md"]
    text = "\n".join(page.read_text() for page in pages)
    named = set(re.findall(r"([\w/]+\.(?:py|[ch]))\b", text))
    there = [
        f"/{path.relative_to(ROOT)}"
        for folder in ("pmalpha", "csrc", "tests", "docs")
        for path in (ROOT / folder).rglob("*.*[pych]")
    ]
    assert named and not [name for name in named if not any(x.endswith(f"/{name}") for x in there)]


def number_of_words(path):
    """Words of prose, without programs and tables; a formula or an address counts as one."""
    text = re.sub(r"(?ms)^ *```.*?^ *```", "", path.read_text())
    text = re.sub(r"(?m)^ *\|.*$", "", text)
    text = re.sub(r"(?ms)^\$\$.*?\$\$", " x ", text)
    text = re.sub(r"\$[^$\n]*\$", " x ", text)
    text = re.sub(r"\]\([^)]*\)|<[^>]*>", "", text)
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def test_pages_are_short_enough_to_be_read():
    """README and the pages of users, of developers without the changelog, and of the method."""
    docs = set((ROOT / "docs").glob("*.md")) - {ROOT / "docs" / "combinations.md"}  # a table
    names = "adding architecture bindings decisions developers measurements reproduction versions"
    own = {ROOT / "docs" / f"{name}.md" for name in names.split()}
    method = {ROOT / "docs" / "method.md", *ROOT.glob("docs/method/*.md")}
    users = {ROOT / "README.md", *docs} - own - method
    developers = own | {ROOT / "benchmarks" / "README.md", ROOT / "CONTRIBUTING.md"}
    assert sum(map(number_of_words, users)) <= 19_300
    assert sum(map(number_of_words, developers)) <= 9_050
    assert number_of_words(ROOT / "docs" / "adding.md") <= 860
    assert number_of_words(ROOT / "docs" / "architecture.md") <= 1500
    assert sum(map(number_of_words, method)) <= 11_400


def test_every_equation_that_is_cited_is_in_the_method():
    """Ours have a letter and a number, (F2), the paper's a number; no number is used twice."""
    pages = "\n".join(path.read_text() for path in (ROOT / "docs" / "method").glob("*.md"))
    tags = re.findall(r"\\tag\{([A-Z]?\d+)\}", pages)
    assert len(tags) == len(set(tags))
    letters = "".join({tag[0] for tag in tags if tag[0].isalpha()})
    cited = {
        number
        for pattern in ["csrc/**/*.[ch]", "pmalpha/**/*.py", "tests/*.py", "docs/method*/**/*.md"]
        for path in [ROOT / "docs" / "method.md", *ROOT.glob(pattern)]
        for number in re.findall(rf"\(([{letters}][1-9]\d?)\)", path.read_text())
    }
    assert len(cited) > 80 and not cited - set(tags)


def test_every_test_that_the_page_on_the_paper_cites_exists():
    cited = set(re.findall(r"`(test_\w+)`", (ROOT / "docs" / "reproduction.md").read_text()))
    written = "\n".join(path.read_text() for path in ROOT.glob("tests/*.py"))
    assert cited and not [name for name in cited if f"def {name}(" not in written]


def test_what_the_reference_leaves_out_and_explains_exists():
    names = runpy.run_path(str(ROOT / "docs" / "reference_names.py"))
    for name, attributes in names["INTERNAL"].items():
        for attribute in attributes.split():
            attrgetter(f"{name}.{attribute}")(pm)
    for name, pages in names["EXPLAINED"].items():
        attrgetter(name)(pm)
        assert all((ROOT / "docs" / f"{page}.md").exists() for page in pages.split()), name


def test_the_check_of_the_site_finds_what_a_page_would_load_from_elsewhere(tmp_path):
    check = runpy.run_path(str(ROOT / "docs" / "check.py"))
    (tmp_path / "own.html").write_text(
        '<script src="own.js"></script><a href="https://x.org">x</a>'
    )
    assert not list(check["addresses_outside"](tmp_path))
    (tmp_path / "page.html").write_text('<link rel="stylesheet"\nhref="https://x.org/a.css">')
    (tmp_path / "style.css").write_text("a { background: url(//x.org/b.png) }")
    found = [address for _, address in check["addresses_outside"](tmp_path)]
    assert found == ["https://x.org/a.css", "//x.org/b.png"]


def test_the_check_of_the_site_finds_formulas_that_are_not_drawn(tmp_path):
    check = runpy.run_path(str(ROOT / "docs" / "check.py"))
    (tmp_path / "page.html").write_text("<p>\\(\\bar M w\\)</p><pre>\\alpha</pre>")
    assert [str(page) for page, _ in check["formulas_not_drawn"](tmp_path)] == ["page.html"]
    for sign in ("&", "&amp;", "\\foo\\"):
        (tmp_path / "page.html").write_text(f"<math><mi>x</mi><mi>{sign}</mi><mo>&lt;</mo></math>")
        assert [str(page) for page, _ in check["formulas_not_drawn"](tmp_path)] == ["page.html"]
    (tmp_path / "page.html").write_text("<math><mi>x</mi><mo>&lt;</mo><mo>&#x0003D;</mo></math>")
    assert not list(check["formulas_not_drawn"](tmp_path))


def only_browser(folder, monkeypatch, name, program):
    """Let `name` be the one browser on the path, a script that runs `program`."""
    (folder / name).write_text(f'#!/bin/sh\n{program} "$@"\n')
    (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))


def site_of_one_formula(folder, css, formula):
    (folder / "docs").mkdir(exist_ok=True)
    (folder / "docs" / "page.html").write_text(
        f"<!doctype html><meta name=viewport content='width=device-width'><style>{css}</style>"
        f'<div class="math"><math display="block">{formula}</math>'
        '<span class="eqno">(R3)</span></div>'
    )
    return folder


BROWSERS = runpy.run_path(str(ROOT / "docs" / "check.py"))["BROWSERS"]
LITERAL = "a formula has & as it is written"


def test_without_a_browser_the_look_at_the_site_is_skipped(tmp_path, monkeypatch, capsys):
    check = runpy.run_path(str(ROOT / "docs" / "check.py"))
    monkeypatch.setenv("PATH", str(tmp_path))
    site = site_of_one_formula(tmp_path, "", "<mi>&amp;</mi>")
    assert list(check["faults_as_drawn"](site)) == []
    assert capsys.readouterr().out == "no browser: the pages are not looked at\n"


@pytest.mark.parametrize("name", BROWSERS)
def test_a_browser_that_cannot_start_is_named_with_its_words(name, tmp_path, monkeypatch, capsys):
    check = runpy.run_path(str(ROOT / "docs" / "check.py"))
    only_browser(tmp_path, monkeypatch, name, "echo Missing X server >&2; exit 1 #")
    site = site_of_one_formula(tmp_path, "", "<mi>&amp;</mi>")
    assert list(check["faults_as_drawn"](site)) == []
    assert capsys.readouterr().out == (
        f"{tmp_path / name} cannot start: Missing X server (exit status 1)\n"
        "no browser: the pages are not looked at\n"
    )


@pytest.mark.gate
@pytest.mark.parametrize("name", BROWSERS)
def test_each_browser_looks_at_the_site(name, tmp_path, monkeypatch, capsys):
    """That of this name; where it is not installed, a script of that name runs another one."""
    installed = [path for x in (name, *BROWSERS) if (path := shutil.which(x))]
    if not installed:
        pytest.skip("no browser")
    check = runpy.run_path(str(ROOT / "docs" / "check.py"))
    path = os.environ["PATH"]
    only_browser(tmp_path, monkeypatch, name, f"PATH='{path}' exec '{installed[0]}'")
    site = site_of_one_formula(tmp_path, "", "<mi>&amp;</mi>")
    found = list(check["faults_as_drawn"](site))
    assert found == [("docs/page.html", width, LITERAL) for width in ("1400", "390")]
    assert capsys.readouterr().out == ""


@pytest.mark.gate
def test_the_check_of_the_site_finds_a_number_that_is_drawn_on_its_formula(tmp_path):
    """With the style of the site they are in one line, or below each other on a telephone."""
    check = runpy.run_path(str(ROOT / "docs" / "check.py"))
    if not any(map(shutil.which, BROWSERS)):
        pytest.skip("no browser")
    style = (ROOT / "docs" / "_static" / "site.css").read_text()
    formula = "<mrow>" + 12 * "<mi>w</mi><mo>+</mo>" + "<mi>b</mi></mrow>"
    theme = "div.math { position: relative; overflow-x: auto }"
    theme += "div.math span.eqno { position: absolute; right: 0; top: 50%; "
    theme += "transform: translateY(-50%) }"

    def faults(css, formula):
        return list(check["faults_as_drawn"](site_of_one_formula(tmp_path, css, formula)))

    on_it = "the number (R3) is drawn on its formula"
    assert faults(theme, formula) == [("docs/page.html", "390", on_it)]
    assert faults(theme + style, formula) == []
    found = faults(theme + style, "<mi>x</mi><mi>&amp;</mi>")
    assert found == [("docs/page.html", width, LITERAL) for width in ("1400", "390")]
