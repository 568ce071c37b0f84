"""The list of files of the site: every file of the package and the core with its first line."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = (
    ("pmalpha", "*.py", "The package"),
    ("csrc/core", "*.h", "The core: headers, and sources that have none"),
    ("csrc/binding", "*.c", "The binding"),
)


def first_line(path):
    """What a file is, by its docstring or its first comment up to the first full stop."""
    text = path.read_text()
    if path.suffix == ".py":
        return (ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0].replace("\n", " ")
    comment = re.match(r"/\*\s*(.*?)\*/", text, re.DOTALL)
    said = re.split(r"\n \*\s*\n", comment[1] if comment else "")[0]
    said = re.sub(r"\s*\n?\s*\*?\s+", " ", said).strip()
    return said.removeprefix(f"{path.name} - ")


def listed(folder, pattern):
    files = [p for p in (ROOT / folder).rglob(pattern) if p.name != "__init__.py"]
    if pattern == "*.h":
        files += [p for p in (ROOT / folder).rglob("*.c") if not p.with_suffix(".h").exists()]
    return sorted(files, key=lambda p: (p.parent, p.name))


def page():
    parts = ["# List of files", "Every file with its first line."]
    for folder, pattern, title in FOLDERS:
        said = [
            (path.relative_to(ROOT / folder), first_line(path)) for path in listed(folder, pattern)
        ]
        rows = ["| `{}` | {} |".format(path, line.replace("|", r"\|")) for path, line in said]
        parts += [f"## {title}", "\n".join(["| file | what |", "|---|---|", *rows])]
    return "\n\n".join(parts) + "\n"


def write(sources):
    """The page, in the copied sources."""
    Path(sources, "docs", "list-of-files.md").write_text(page())
