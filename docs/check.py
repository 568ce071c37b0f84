"""Checks of the built site: `python docs/check.py build/docs/html`.

Every public name has a page, formulas are drawn, and no page, style or script loads anything from
another address: the site reads the same without a network. Its search, run by node where that is
installed, has the page that answers each question among its first three results.
"""

import inspect
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pmalpha

sys.path.insert(0, str(Path(__file__).parent))
from questions import QUESTIONS  # noqa: E402

LOADED = re.compile(
    r"""<(?:script|img|iframe|source|link(?![^>]*rel="(?:canonical|license)"))[^>]*?"""
    r"""(?:src|href)\s*=\s*"((?:https?:)?//[^"]*)"|url\(["']?((?:https?:)?//[^)"']*)|@import\s+([^;]*)"""
)


def addresses_outside(site):
    """(page, address) of all that the files of the site would load from elsewhere."""
    for path in sorted([*site.rglob("*.html"), *site.rglob("*.css")]):
        for found in LOADED.finditer(path.read_text()):
            yield path.relative_to(site), next(filter(None, found.groups()))


def names_without_a_page(site):
    pages = {path.stem for path in (site / "docs" / "api").glob("*.html")}
    public = [getattr(pmalpha, name) for name in pmalpha.__all__]
    modules = [pmalpha, *filter(inspect.ismodule, public)]
    names = {x.__name__ for x in modules}
    names |= {f"{x.__name__}.{n}" for x in modules for n in x.__all__ if callable(getattr(x, n))}
    return sorted(names - pages)


def formulas_not_drawn(site):
    """Pages with TeX left in their text."""
    for path in sorted(site.rglob("*.html")):
        text = re.sub(r"(?s)<(pre|script|code|annotation).*?</\1>", "", path.read_text())
        if found := re.search(r"\\(?:frac|bar|tilde|alpha|Lambda|\[|\()", text):
            yield path.relative_to(site), found[0]


def answers(site, questions):
    """Pages with anchors that the site's own search finds, best first, by question."""
    command = ["node", Path(__file__).with_name("search.js"), site, *questions]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def questions_without_answer(site):
    if not shutil.which("node"):
        print("no node: the search is not tried")
        return
    for question, found in answers(site, QUESTIONS).items():
        pages = list(dict.fromkeys(page.split("#")[0] for page in found[:3]))
        if f"docs/{QUESTIONS[question]}" not in pages:
            yield question, pages


if __name__ == "__main__":
    site = Path(sys.argv[1])
    faults = [
        *(f"{page} loads {address}" for page, address in addresses_outside(site)),
        *(f"{name} has no page" for name in names_without_a_page(site)),
        *(f"{page} shows {tex} as it is written" for page, tex in formulas_not_drawn(site)),
        *(f"the search for {x!r} finds {pages}" for x, pages in questions_without_answer(site)),
    ]
    print("\n".join(faults) or f"{len(list(site.rglob('*.html')))} pages, complete by themselves")
    sys.exit(bool(faults))
