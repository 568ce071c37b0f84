"""Configuration of the site; `make docs` copies the sources of the pages to build/docs/source."""

from pathlib import Path

import pmalpha

project = "pmalpha"
author = copyright = "the pmalpha authors"
release = pmalpha.__version__

extensions = ["sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "myst_nb"]
root_doc = "docs/index"
include_patterns = ["docs/**", "notebooks/**", "benchmarks/*.md", "CHANGELOG.md", "CONTRIBUTING.md"]
exclude_patterns = ["docs/_templates"]
templates_path = [str(Path(__file__).with_name("_templates"))]

# Pages are read by GitHub too: its anchors, its fences for mathematics
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]
nb_execution_mode = "off"  # the tests execute the notebooks
nb_merge_streams = True

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
html_title = f"pmalpha {release}"
html_show_copyright = False
html_show_sphinx = False


def display(_app, doctree):
    """Equations as they are: Sphinx would set them in an environment that refuses a \\tag."""
    from docutils.nodes import math_block

    for node in doctree.findall(math_block):
        if "\\begin{equation" not in node.astext():
            node.children[:] = [type(node.children[0])(f"\\[{node.astext()}\\]")]
        node["nowrap"] = node["no-wrap"] = True


def redirect(app, failed):
    """The root of the site leads to the first page."""
    if not failed:
        page = '<!doctype html><meta http-equiv="refresh" content="0; url=docs/index.html">\n'
        Path(app.outdir, "index.html").write_text(page)


def setup(app):
    app.connect("doctree-read", display)
    app.connect("build-finished", redirect)
