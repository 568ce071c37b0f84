"""Configuration of the site; `make docs` copies the sources of the pages to build/docs/source."""

import re
import sys
from pathlib import Path

import latex2mathml.converter
from docutils.nodes import SkipNode, Text, emphasis, paragraph, raw, reference, strong

import pmalpha

sys.path.insert(0, str(Path(__file__).parent))
import files  # noqa: E402
import gallery  # noqa: E402
import questions  # noqa: E402
import reference_names  # noqa: E402

project = "pmalpha"
author = copyright = "the pmalpha authors"
release = pmalpha.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_nb",
    "sphinx_design",
]
root_doc = "docs/index"
include_patterns = ["docs/**", "notebooks/**", "benchmarks/*.md", "CHANGELOG.md", "CONTRIBUTING.md"]
exclude_patterns = ["docs/_templates"]
templates_path = [str(Path(__file__).with_name("_templates"))]

# Pages are read by GitHub too: its anchors, its fences for mathematics
myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]
nb_execution_mode = "off"  # the tests execute the notebooks
nb_merge_streams = True

autosummary_context = {
    "internal": {
        name: ", ".join(names.split()) for name, names in reference_names.INTERNAL.items()
    },
    "explained": {name: pages.split() for name, pages in reference_names.EXPLAINED.items()},
}

default_role = "py:obj"  # `Coupler` in a docstring is a link
autosummary_imported_members = True
autosummary_ignore_module_all = False  # a page for each name in __all__, and no other
autodoc_typehints = "none"  # the docstrings say types and shapes
numpydoc_show_class_members = False  # the template of a class lists them
numpydoc_xref_param_type = False
# all checks but these
numpydoc_validation_checks = {
    "all",
    "ES01",  # an extended summary: many functions are said in a line
    "EX01",  # an example: of attributes and results there are examples where they come from
    "PR01",  # parameters of classes that only the program makes; tests/test_docstrings.py has it
    "SA01",  # see also: other names are links in the sentences
    "SS05",  # a verb first: a function that returns a value is named by it, "Masses in a row"
}

html_theme = "furo"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/favicon.svg"
html_title = f"pmalpha {release}"
html_show_copyright = False
html_show_sphinx = False


# what the formulas of docstrings are written with, so that `help` reads well
WORDS = {
    **{
        name: rf"\{name} "
        for name in "alpha beta gamma delta lambda mu nu omega rho sigma tau xi".split()
    },
    **{name: rf"\{name} " for name in "Omega ln exp det sin max min sum".split()},
    **{"lam": r"\lambda ", "Lam": r"\Lambda ", "Mbar": r"\bar M ", "inf": r"\infty "},
    **{"am": r"\alpha_m ", "af": r"\alpha_f ", "al1": r"\alpha_1 ", "al2": r"\alpha_2 "},
    **{"<=": r"\le ", ">=": r"\ge ", "->": r"\to ", "~": r"\sim "},
}


def tex(formula):
    """A formula of a docstring, ``omega = sqrt(k/m)``, in TeX."""
    formula = re.sub(
        r"sqrt(\((?:[^()]|\([^()]*\))*\))", lambda m: rf"\sqrt{{{m[1][1:-1]}}}", formula
    )
    formula = re.sub(r"(?<=[_^])-?\w+", lambda m: f"{{{m[0]}}}", formula)
    formula = re.sub(r"(?<=[_^])\(([^()]*)\)", r"{\1}", formula)
    return re.sub(
        r"\\sqrt|(?<![A-Za-z])(?:[A-Za-z]{2,}\d?|<=|>=|->|~)",
        lambda m: WORDS.get(m[0], m[0] if m[0][0] == "\\" else rf"\mathrm{{{m[0]}}}"),
        formula,
    )


def mathml(formula, display):
    """A formula as MathML, which browsers draw without a script, a font or a network."""
    formula, tag, _ = (*re.split(r"\\tag\{(.*?)\}", formula), "", "")[:3]
    formula = formula.replace("{aligned}", "{align*}")  # of which latex2mathml makes a table
    drawn = latex2mathml.converter.convert(formula, display="block" if display else "inline")
    if unknown := re.findall(r"<m[io]>(\\\w*|&(?:amp;)?)<", drawn):
        raise ValueError(f"{unknown[0]} in {formula!r} has no MathML")
    return drawn, tag


def inline(writer, node):
    formula = node.astext()
    if writer.builder.current_docname.startswith("docs/api"):
        formula = tex(formula)
    writer.body.append(mathml(formula, display=False)[0])
    raise SkipNode


def block(writer, node):
    drawn, tag = mathml(node.astext(), display=True)
    number = f'<span class="eqno" id="equation-{tag}">({tag})</span>' if tag else ""
    writer.body.append(f'<div class="math">{drawn}{number}</div>\n')
    raise SkipNode


def find_equations(app):
    """The page of each equation of the method, by its number."""
    pages = sorted(Path(app.srcdir, "docs", "method").glob("*.md"))
    app.equations = {
        tag: f"docs/method/{page.stem}"
        for page in pages
        for tag in re.findall(r"\\tag\{(\w+)\}", page.read_text())
    }


# ours are cited as (F2), those of the paper as "equation (18)" or "problem (1)"
CITED = re.compile(r"\((?P<ours>[A-Z]\d\d?)\)|(?:(?<=equation )|(?<=problem ))\((?P<paper>\d\d?)\)")


def link_equations(app, doctree, docname):
    """Numbers of equations in sentences lead to the equations."""
    for text in list(doctree.findall(Text)):
        if not isinstance(text.parent, (paragraph, emphasis, strong)):
            continue
        parts, end = [], 0
        for cited in CITED.finditer(text):
            tag = cited["ours"] or cited["paper"]
            if tag in app.equations:
                address = app.builder.get_relative_uri(docname, app.equations[tag])
                link = reference("", cited[0], internal=True, refuri=f"{address}#equation-{tag}")
                parts += [Text(text[end : cited.start()]), link]
                end = cited.end()
        if parts:
            text.parent.replace(text, [*parts, Text(text[end:])])


# of developers: found by their titles, not by their words
FOR_DEVELOPERS = [
    *("CHANGELOG", "CONTRIBUTING", "benchmarks/README", "docs/architecture", "docs/decisions"),
    *("docs/adding", "docs/developers", "docs/list-of-files", "docs/reproduction", "docs/versions"),
]


def leave_out_of_search(app, _env):
    """The words of pages for developers are not those that a user looks for."""
    for name in FOR_DEVELOPERS:
        app.env.metadata[name]["nosearch"] = True


def without_addresses(_app, doctree):
    """The signs on the buttons of animations, of matplotlib from elsewhere, are in site.css."""
    for node in doctree.findall(raw):
        if "font-awesome" in (text := node.astext()):
            node.children[:] = [Text(re.sub(r"<link [^>]*font-awesome[^>]*>", "", text))]


def redirect(app, failed):
    """The root of the site leads to the first page."""
    if not failed:
        page = '<!doctype html><meta http-equiv="refresh" content="0; url=docs/index.html">\n'
        Path(app.outdir, "index.html").write_text(page)


def setup(app):
    app.connect("builder-inited", lambda app: gallery.write(app.srcdir))
    app.connect("builder-inited", lambda app: files.write(app.srcdir))
    app.connect("builder-inited", lambda app: questions.write(app.srcdir))
    app.connect("builder-inited", find_equations)
    app.connect("doctree-read", without_addresses)
    app.connect("env-updated", leave_out_of_search)
    app.connect("doctree-resolved", link_equations)
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.connect("build-finished", redirect)
