"""The gallery of the site: the list of gallery.md as cards, with pictures from the notebooks.

`python docs/gallery.py` renews the picture in the first cell of each notebook, a copy of one of its
stored outputs; `make notebooks` calls it.
"""

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
LINKED = r"\(\.\./notebooks/(\w+)\.ipynb\)"
CHOSEN = re.compile(rf"(?:^- \[.*?\]{LINKED}\n)+", re.MULTILINE)
CARD = """:::{{grid-item-card}} {title}
:img-top: thumbnails/{name}.png
:link: ../notebooks/{name}
:link-type: doc
:link-alt: {title}

{line} ({time}, {{download}}`download <../notebooks/{name}.ipynb>`)
:::
"""
SIZE = (480, 300)
ATTACHED = "result.png"


def decoded(png):
    return Image.open(io.BytesIO(base64.b64decode("".join(png))))


def pictures(notebook):
    """The pictures among the stored outputs, in their order."""
    for cell in json.loads(notebook.read_text())["cells"]:
        for output in cell.get("outputs", []):
            if png := output.get("data", {}).get("image/png"):
                yield decoded(png)


def entries(page):
    """(notebook, number of its picture) for each entry of the gallery."""
    for entry in ENTRY.finditer(page.read_text()):
        yield page.parents[1] / "notebooks" / f"{entry['name']}.ipynb", int(entry["picture"])


def small(picture):
    """The picture in 64 colours and at most 720 points wide."""
    picture = picture.convert("RGB")
    picture.thumbnail((720, 720))
    return picture.quantize(64, dither=Image.Dither.NONE)


def show_first(notebook, number):
    """Write the picture into the first cell of a notebook, as its attachment."""
    png = io.BytesIO()
    small(list(pictures(notebook))[number - 1]).save(png, "PNG", optimize=True)
    contents = json.loads(notebook.read_text())
    first = contents["cells"][0]
    assert f"](attachment:{ATTACHED})" in "".join(first["source"]), notebook
    encoded = base64.b64encode(png.getvalue()).decode()
    first["attachments"] = {ATTACHED: {"image/png": encoded}}
    notebook.write_text(json.dumps(contents, indent=1, ensure_ascii=False, sort_keys=True) + "\n")


def thumbnail(notebook, number, path):
    picture = list(pictures(notebook))[number - 1].convert("RGB")
    picture.thumbnail(SIZE)
    card = Image.new("RGB", SIZE, "white")  # all of one size, so that cards are
    card.paste(picture, [(a - b) // 2 for a, b in zip(SIZE, picture.size)])
    card.save(path)


def picture_of_the_page(notebook, number, path):
    """The whole picture in place of the attachment, in the copied notebook."""
    list(pictures(notebook))[number - 1].save(path)
    contents = json.loads(notebook.read_text())
    first = contents["cells"][0]
    del first["attachments"]
    source = "".join(first["source"])
    first["source"] = source.replace(f"attachment:{ATTACHED}", f"../docs/thumbnails/{path.name}")
    notebook.write_text(json.dumps(contents))


def write(sources):
    """The page with cards in place of the list, some of them on the front page, thumbnails, and
    notebooks with whole pictures, in the copied sources."""
    page = Path(sources, "docs", "gallery.md")
    text = page.read_text()
    folder = page.with_name("thumbnails")
    folder.mkdir(exist_ok=True)
    for notebook, number in entries(page):
        thumbnail(notebook, number, folder / f"{notebook.stem}.png")
        picture_of_the_page(notebook, number, folder / f"{notebook.stem}-whole.png")
    listed = re.sub(r"\?P<\w+>", "?:", f"(?:{ENTRY.pattern})+")
    page.write_text(re.sub(listed, group, text, flags=re.MULTILINE))

    front = page.with_name("index.md")
    by_name = {entry["name"]: entry.groupdict() for entry in ENTRY.finditer(text)}
    front.write_text(
        CHOSEN.sub(
            lambda chosen: cards([by_name[name] for name in re.findall(LINKED, chosen[0])]),
            front.read_text(),
        )
    )


def cards(found):
    shown = "".join(
        CARD.format(**entry | {"line": entry["line"][0].upper() + entry["line"][1:]})
        for entry in found
    )
    return f"::::{{grid}} 1 2 3 3\n:gutter: 2\n\n{shown}::::\n"


def group(listed):
    """The entries of one group, and their place in the menu."""
    found = [entry.groupdict() for entry in ENTRY.finditer(listed[0])]
    menu = "".join(f"{e['title']} <../notebooks/{e['name']}>\n" for e in found)
    return f"{cards(found)}\n```{{toctree}}\n:hidden:\n\n{menu}```\n"


if __name__ == "__main__":
    for notebook, number in entries(Path(__file__).with_name("gallery.md")):
        show_first(notebook, number)
