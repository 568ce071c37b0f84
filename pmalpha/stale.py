"""Whether an extension that was built in place is of the sources that lie beside it.

The build writes the check sum of the sources to build/core.stamp; setup.py loads this file for it,
so it imports nothing of the package. An installed package has no sources beside it.
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parent.parent
STAMP = Path("build", "core.stamp")


def sources(root: Path) -> list[Path]:
    """The files of which the extension is made."""
    folders = root / "csrc" / "core", root / "csrc" / "binding"
    return sorted(path for folder in folders for path in folder.rglob("*.[ch]"))


def check_sum(root: Path) -> str:
    """Of the names and contents of the sources."""
    from hashlib import sha256

    total = sha256()
    for path in sources(root):
        content = path.read_bytes()
        total.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode() + content)
    return total.hexdigest()


def write_stamp(root: Path) -> None:
    """Say that the extension is of the present sources."""
    stamp = root / STAMP
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(check_sum(root))


def require_present_build(root: Path = ROOT) -> None:
    """ImportError if the sources have changed since the extension was built in place."""
    stamp = root / STAMP
    if not (root / "csrc").is_dir() or not stamp.is_file():
        return
    built = stamp.stat().st_mtime_ns
    if all(path.stat().st_mtime_ns <= built for path in sources(root)):
        return
    if check_sum(root) != stamp.read_text():
        raise ImportError(
            f"the extension of pmalpha was built of other sources than those in {root / 'csrc'}: "
            "build it again, by `make test` or `pip install --editable .`"
        )
