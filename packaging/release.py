"""The files of a release in build/release, checked and listed: python packaging/release.py

All wheels and the source distribution are made twice, the second time without what zig remembers,
and have to be the same to the byte. Nothing is uploaded.
"""

from __future__ import annotations

import filecmp
import hashlib
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
OUT = ROOT / "build" / "release"


def run(*command: str | Path, **options: object) -> str:
    """What the command prints."""
    words = [str(word) for word in command]
    return subprocess.run(words, check=True, cwd=ROOT, text=True, stdout=-1, **options).stdout


def released() -> tuple[str, str]:
    """The version with its date, and its section of the changelog; they are the same everywhere."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    changes = (ROOT / "CHANGELOG.md").read_text()
    found = re.search(r"^## \[?([\d.]+)\]? - (\d{4}-\d\d-\d\d)\n(.*?)^## ", changes, re.M | re.S)
    if found is None or found[1] != version:
        sys.exit(f"CHANGELOG.md must begin with {version} and its date")
    return f"{version} of {found[2]}", found[3].strip()


def make(out: Path) -> None:
    run(sys.executable, HERE / "wheels.py", out)
    run(sys.executable, HERE / "check_wheels.py", out)


def require_same(first: Path, second: Path) -> None:
    names = sorted(path.name for path in first.iterdir())
    _, differ, missing = filecmp.cmpfiles(first, second, names, shallow=False)
    if differ or missing or len(names) != len(list(second.iterdir())):
        sys.exit(f"a second build differs: {differ + missing}")


def main() -> None:
    if run("git", "status", "--porcelain"):
        sys.exit("commit first: git status is not empty")
    title, section = released()
    make(OUT)
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["ZIG_GLOBAL_CACHE_DIR"] = os.environ["ZIG_LOCAL_CACHE_DIR"] = f"{scratch}/zig"
        make(Path(scratch, "again"))
        require_same(OUT, Path(scratch, "again"))
    files = sorted(OUT.iterdir())
    print(run(sys.executable, "-m", "twine", "check", "--strict", *files))
    print(f"{title}, commit {run('git', 'rev-parse', 'HEAD')}\n{section}\n\nWould be uploaded:\n")
    for path in files:
        content = path.read_bytes()
        print(f"{hashlib.sha256(content).hexdigest()}  {len(content):9}  {path.name}")


if __name__ == "__main__":
    main()
