"""Checks of the built site: `python docs/check.py build/docs/html`.

Every public name has a page, formulas are drawn, and no page, style or script loads anything from
another address: the site reads the same without a network. A browser, where one is installed and
starts, draws the pages with formulas at the widths of a desk and of a telephone: nothing is on
something else or cut off. The search of the site, run by node where that is installed, has the page
that answers each question among its first three results.
"""

import html
import inspect
import json
import re
import shutil
import subprocess
import sys
import tempfile
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
    """Pages with TeX left in their text or in a formula."""
    for path in sorted(site.rglob("*.html")):
        text = re.sub(r"(?s)<(pre|script|code|annotation).*?</\1>", "", path.read_text())
        written = r"\\(?:frac|bar|tilde|alpha|Lambda|\[|\()|<m(?:i|o|n|text)>[^<]*?(&(?:amp;)?|\\)<"
        if found := re.search(written, text):
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


BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")
# --headless: the shell is so by itself, all others want a screen without it. Not --single-process:
# under load 20 of 420 such browsers crashed, of others none of 420.
DRAWING = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")


def page_as_drawn(name, address, folder):
    """What the browser `name` prints of a page after its scripts, and what it says in errors."""
    options = [*DRAWING, "--allow-file-access-from-files", "--dump-dom"]
    command = [name, *options, f"--user-data-dir={folder}", address]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=600)
    return done.stdout, f"{done.stderr.strip() or 'no word'} (exit status {done.returncode})"


def browser(folder):
    """The path of the first browser that draws a page without a screen, or None."""
    for path in filter(None, map(shutil.which, BROWSERS)):
        try:
            drawn, words = page_as_drawn(path, "data:text/html,<p>drawn</p>", folder)
        except OSError as error:
            drawn, words = "", str(error)
        if "<p>drawn</p>" in drawn:
            return path
        print(f"{path} cannot start: {words[-400:]}")
    print("no browser: the pages are not looked at")
    return None


def faults_as_drawn(site, widths=(1400, 390)):
    """(page, width of the window, fault) of the pages with formulas, as a browser draws them."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path = browser(folder)
        if path is not None:
            yield from faults_by(path, site, widths, Path(folder))


def faults_by(browser, site, widths, folder):
    """The same, by this browser."""
    pages = [
        path
        for path in sorted((site / "docs").rglob("*.html"))
        if path.parent.name != "api" and 'class="math"' in path.read_text()
    ]
    frames = "".join(
        f'<iframe title="{path.relative_to(site)}" src="{path.resolve().as_uri()}" width="{width}" '
        'height="900"></iframe>'
        for path in pages
        for width in widths
    )
    script = Path(__file__).with_name("measure.js").read_text()
    whole = folder / "pages.html"
    whole.write_text(f"<!doctype html><meta charset=utf-8><script>{script}</script><body>{frames}")
    drawn, words = page_as_drawn(browser, whole.as_uri(), folder)
    match = re.search(r"<body>(\[.*\])</body>", drawn, re.S)
    if not match:
        raise RuntimeError(f"{browser} has not drawn the pages: {words[-400:]}")
    measured = json.loads(html.unescape(match[1]))
    if len(measured) != len(pages) * len(widths) or not all(count for _, _, count, _ in measured):
        raise RuntimeError(f"the browser has not drawn all pages: {measured}")
    for page, width, _, faults in measured:
        yield from ((page, width, fault) for fault in faults)


if __name__ == "__main__":
    site = Path(sys.argv[1])
    faults = [
        *(f"{page} loads {address}" for page, address in addresses_outside(site)),
        *(f"{name} has no page" for name in names_without_a_page(site)),
        *(f"{page} shows {tex} as it is written" for page, tex in formulas_not_drawn(site)),
        *(f"{x} in {width} pixels: {fault}" for x, width, fault in faults_as_drawn(site)),
        *(f"the search for {x!r} finds {pages}" for x, pages in questions_without_answer(site)),
    ]
    print("\n".join(faults) or f"{len(list(site.rglob('*.html')))} pages, complete by themselves")
    sys.exit(bool(faults))
