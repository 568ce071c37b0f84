"""The gallery of the site: the list of gallery.md as cards, with pictures from the notebooks."""

import base64
import io
import json
import re
from pathlib import Path

from PIL import Image

ENTRY = re.compile(
    r"^- \[(?P<title>.*?)\]\(\.\./notebooks/(?P<name>\w+)\.ipynb\): (?P<line>.*)"
    r" \((?P<time>\d+ s), picture (?P<picture>\d+)\)\n",
    re.MULTILINE,
)
CARD = """:::{{grid-item-card}} {title}
:img-top: thumbnails/{name}.png
:link: ../notebooks/{name}
:link-type: doc
:link-alt: {title}

{line} ({time}, {{download}}`download <../notebooks/{name}.ipynb>`)
:::
"""
SIZE = (480, 300)


def pictures(notebook):
    """The pictures among the stored outputs, in their order."""
    for cell in json.loads(notebook.read_text())["cells"]:
        for output in cell.get("outputs", []):
            if png := output.get("data", {}).get("image/png"):
                yield Image.open(io.BytesIO(base64.b64decode("".join(png))))


def thumbnail(notebook, number, path):
    picture = list(pictures(notebook))[number - 1].convert("RGB")
    picture.thumbnail(SIZE)
    card = Image.new("RGB", SIZE, "white")  # all of one size, so that cards are
    card.paste(picture, [(a - b) // 2 for a, b in zip(SIZE, picture.size)])
    card.save(path)


def picture_first(notebook, number, path):
    """The picture of the gallery below the introduction, in the copied notebook."""
    list(pictures(notebook))[number - 1].save(path)
    contents = json.loads(notebook.read_text())
    shown = {
        "cell_type": "markdown",
        "metadata": {},
        "source": f"![](../docs/thumbnails/{path.name})",
    }
    if "id" in contents["cells"][0]:
        shown["id"] = "picture-first"
    contents["cells"].insert(1, shown)
    notebook.write_text(json.dumps(contents))


def write(sources):
    """The page with cards in place of the list, thumbnails, and notebooks whose picture comes
    first, in the copied sources."""
    page = Path(sources, "docs", "gallery.md")
    text = page.read_text()
    folder = page.with_name("thumbnails")
    folder.mkdir(exist_ok=True)
    for entry in ENTRY.finditer(text):
        notebook = Path(sources, "notebooks", f"{entry['name']}.ipynb")
        number = int(entry["picture"])
        thumbnail(notebook, number, folder / f"{entry['name']}.png")
        picture_first(notebook, number, folder / f"{entry['name']}-whole.png")
    listed = re.sub(r"\?P<\w+>", "?:", f"(?:{ENTRY.pattern})+")
    page.write_text(re.sub(listed, cards, text, flags=re.MULTILINE))


def cards(listed):
    """The entries of one group, and their place in the menu."""
    entries = [entry.groupdict() for entry in ENTRY.finditer(listed[0])]
    shown = "".join(CARD.format(**entry) for entry in entries)
    menu = "".join(f"{e['title']} <../notebooks/{e['name']}>\n" for e in entries)
    return (
        f"::::{{grid}} 1 2 3 3\n:gutter: 2\n\n{shown}::::\n\n"
        f"```{{toctree}}\n:hidden:\n\n{menu}```\n"
    )
