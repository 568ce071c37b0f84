"""Writes the table of coverage in CONTRIBUTING.md: ``make coverage`` measures, and calls this.

``python benchmarks/surveys/covered.py build/covered``: the folder has what gcovr found of the C
tests (c.json) and of the Python tests (python.json), and what coverage.py found of the package
(package.json). With the first alone the columns of the Python tests have dashes.
"""

import json
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "CONTRIBUTING.md"
BEGIN, END = "<!-- written by make coverage -->\n", "<!-- end of it -->\n"
HEAD = """\
| folder | lines | by the C tests | by the Python tests | by either | branches | by the C tests | \
by the Python tests | by either |
|---|---|---|---|---|---|---|---|---|
"""


def of_gcovr(folder, *traces):
    """Counts by folder of the lines and branches that one of these traces reached."""
    out = folder / "summary.json"
    command = [sys.executable, "-m", "gcovr", "--root", ROOT, "--json-summary", out]
    for trace in traces:
        command += ["--add-tracefile", folder / trace]
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
    found = {}
    for file in json.loads(out.read_text())["files"]:
        own = found.setdefault(str(Path(file["filename"]).parent), Counter())
        for what in ("line", "branch"):
            own[what] += file[f"{what}_total"]
            own[f"{what} reached"] += file[f"{what}_covered"]
    return found


def of_package(folder):
    """The same of the package, from coverage.py."""
    found = {}
    if not (folder / "package.json").exists():
        return found
    for name, file in json.loads((folder / "package.json").read_text())["files"].items():
        inside = Path(*Path(name).parts[Path(name).parts.index("pmalpha") :])
        own, summary = found.setdefault(str(inside.parent), Counter()), file["summary"]
        own["line"] += summary["num_statements"]
        own["line reached"] += summary["covered_lines"]
        own["branch"] += summary["num_branches"]
        own["branch reached"] += summary["covered_branches"]
    return found


def total(found, name):
    """All folders below this one together."""
    return sum((own for place, own in found.items() if place.startswith(name)), Counter())


def share(own, what):
    """In per cent, rounded down, so that 100 is all."""
    return f"{1000 * own[f'{what} reached'] // own[what] / 10:g}" if own[what] else "-"


def row(name, by_c, by_python, either):
    shown = either if by_python else Counter()
    cells = [f"`{name}`"]
    for what in ("line", "branch"):
        cells += [f"{either[what]}", *(share(own, what) for own in (by_c, by_python, shown))]
    return f"| {' | '.join(cells)} |\n"


def table(folder):
    traces = [name for name in ("c.json", "python.json") if (folder / name).exists()]
    by_c, either, package = (
        of_gcovr(folder, "c.json"),
        of_gcovr(folder, *traces),
        of_package(folder),
    )
    by_python = of_gcovr(folder, "python.json") if len(traces) == 2 else {}
    rows = []
    for name in sorted(either):
        none = Counter()
        rows.append(row(name, by_c.get(name, none), by_python.get(name, none), either[name]))
    whole = [total(found, "csrc") for found in (by_c, by_python, either)]
    rows.append(row("csrc, whole", *whole))
    for name, own in sorted(package.items()):
        rows.append(row(name, Counter(), own, own))
    if package:
        own = total(package, "pmalpha")
        rows.append(row("pmalpha, whole", Counter(), own, own))
    return HEAD + "".join(rows)


def main(folder):
    text = PAGE.read_text()
    written = BEGIN + table(folder) + END
    new, count = re.subn(f"{BEGIN}.*?{END}", lambda _: written, text, flags=re.DOTALL)
    if count != 1:
        sys.exit(f"{PAGE} must have one place between {BEGIN!r} and {END!r}")
    PAGE.write_text(new)
    print(written)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
