"""Mutates the C core a line at a time, and names the mutants that no test kills.

    python benchmarks/surveys/mutate.py 40 --seed 3                      # by the C tests
    python benchmarks/surveys/mutate.py 40 --python tests/test_macro.py  # then by Python tests

A survivor is a line that no test sees, or one that has no effect (a mutant can be equivalent, or
touch speed alone). Works in a copy; the tree is not changed. Not a test, and no part of the gate:
a mutant takes about as long as building and running the C tests, a survivor a wheel and the chosen
Python tests more.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COPIED = ["Makefile", "csrc", "pmalpha", "tests", "setup.py", "pyproject.toml"]
COPIED += ["README.md", "LICENSE", "MANIFEST.in"]
# pattern, what takes its place
SWAPS = [
    (r" < ", " <= "),
    (r" <= ", " < "),
    (r" > ", " >= "),
    (r" >= ", " > "),
    (r" == ", " != "),
    (r" != ", " == "),
    (r" \+ ", " - "),
    (r" - ", " + "),
    (r" \+= ", " -= "),
    (r" -= ", " += "),
    (r"\b0\.5\b", "2.0"),
    (r"\b1\.0\b", "0.5"),
    (r"\b2\.0\b", "1.0"),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r" && ", " || "),
    (r" \|\| ", " && "),
    (r"!(?=[A-Za-z_(])", ""),
]
CALL = re.compile(r"\s+[a-z]\w*\(.*\);$")
ASSIGNMENT = re.compile(r"\s+\*?[A-Za-z_][\w.>-]*(\[[^\]]*\])?[\w.>-]* [-+*/|]?= .*;$")
# statements without an effect that a test could see: a leak, a check that is compiled away
UNSEEN = re.compile(r"\s+(free|assert)\(")


@dataclass(frozen=True)
class Mutant:
    """One line of one file, and what it becomes."""

    path: Path
    line: int  # from 1
    old: str
    new: str

    def __str__(self):
        return f"{self.path}:{self.line}  {self.old.strip()}  ->  {self.new.strip()}"

    def write(self, folder):
        """Returns the text of the whole file before, to restore it."""
        file = folder / self.path
        text = file.read_text()
        lines = text.splitlines(keepends=True)
        lines[self.line - 1] = self.new + "\n"
        file.write_text("".join(lines))
        return text


def code_of(text):
    """The lines of a C file with comments and preprocessor lines blanked: same lengths."""
    blank = re.sub(r"/\*.*?\*/", lambda m: re.sub(r"[^\n]", " ", m[0]), text, flags=re.DOTALL)
    return ["" if line.startswith("#") else line.rstrip() for line in blank.splitlines()]


def mutants_of(path, text):
    """All that the operators make of one file."""
    lines = text.splitlines()
    for number, code in enumerate(code_of(text), start=1):
        old = lines[number - 1]
        if code.lstrip().startswith(("static const", "assert(")) or '"' in code:
            continue
        for pattern, other in SWAPS:
            for found in re.finditer(pattern, code):
                new = old[: found.start()] + other + old[found.end() :]
                yield Mutant(path, number, old, new)
        if (CALL.match(code) or ASSIGNMENT.match(code)) and not UNSEEN.match(code):
            whole = number == 1 or not lines[number - 2].rstrip().endswith((",", "=", "(", "+"))
            if whole:
                yield Mutant(path, number, old, code[: len(code) - len(code.lstrip())] + ";")


def all_mutants(folder):
    """Of every C file of the core, wherever below csrc/core it is."""
    for file in sorted((folder / "csrc" / "core").rglob("*.c")):
        yield from mutants_of(file.relative_to(folder), file.read_text())


# ---- tests -------------------------------------------------------------------------------------


def run(command, folder, seconds, **environment):
    """True, False or None: ended well, ended badly, did not end in time."""
    silent = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    env = {**os.environ, **environment}
    try:
        done = subprocess.run(command, cwd=folder, timeout=seconds, env=env, **silent)
    except subprocess.TimeoutExpired:
        return None
    return done.returncode == 0


def killed_by_c(folder, seconds):
    """What killed the mutant in this folder, or None; built as the Makefile says, no sanitizers."""
    if not run(["make", "SANITIZE=", "build/test_core_asan"], folder, 300.0):
        return "compiler"
    done = run(["build/test_core_asan"], folder, seconds)
    return {True: None, False: "C tests", None: "time"}[done]


def killed_by_pytest(tests, folder, package, seconds):
    """The same of these Python tests, run in the folder with the package in the other one."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    done = run(command, folder, seconds, PYTHONPATH=str(package))
    return {True: None, False: "Python tests", None: "time"}[done]


def killed_by_python(tests, folder, seconds):
    """The same, with a package that is built of the copy and installed beside it."""
    site, elsewhere = folder / "site", folder / "elsewhere"
    shutil.rmtree(site, ignore_errors=True)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    if not run([*pip, "--target", str(site), str(folder)], folder, 600.0):
        return "compiler"
    if not elsewhere.exists():  # not where the sources of the package would be found first
        elsewhere.mkdir()
        for name in ("tests", "pyproject.toml"):
            (elsewhere / name).symlink_to(folder / name)
    return killed_by_pytest(tests, elsewhere, site, seconds)


# ---- the command -------------------------------------------------------------------------------


def parsed():
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("number", type=int, nargs="?", default=20, help="of mutants")
    parser.add_argument("--seed", type=int, default=0, help="which ones")
    parser.add_argument("--only", default="", metavar="TEXT", help="in files with this in the path")
    parser.add_argument("--list", action="store_true", help="name the mutants and run nothing")
    rest = argparse.REMAINDER
    parser.add_argument("--python", nargs=rest, metavar="...", help="last: arguments of pytest")
    return parser.parse_args()


def main():
    options = parsed()
    suites = [killed_by_c]
    suites += [partial(killed_by_python, options.python)] if options.python else []
    survey([m for m in all_mutants(ROOT) if options.only in str(m.path)], options, COPIED, suites)


def survey(mutants, options, entries, suites):
    """Names what of some of the mutants survives the suites, in a copy of these entries."""
    chosen = random.Random(options.seed).sample(mutants, min(options.number, len(mutants)))
    print(f"{len(chosen)} of {len(mutants)} mutants", flush=True)
    if options.list:
        print(*chosen, sep="\n")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for entry in entries:
            copy = shutil.copytree if (ROOT / entry).is_dir() else shutil.copy
            copy(ROOT / entry, folder / entry)
        limits = []
        for suite in suites:
            begin = time.monotonic()
            killer = suite(folder, 3600.0)
            if killer is not None:
                sys.exit(f"without any mutation: killed by {killer}")
            limits.append(20.0 + 3.0 * (time.monotonic() - begin))
        survivors = report(folder, chosen, suites, limits)
    print(f"{survivors} of {len(chosen)} survived")


def report(folder, chosen, suites, limits):
    """A line for each mutant; returns how many survived."""
    survivors = 0
    for mutant in sorted(chosen, key=lambda m: (str(m.path), m.line)):
        text, killer = mutant.write(folder), None
        for suite, limit in zip(suites, limits):
            killer = killer or suite(folder, limit)
        (folder / mutant.path).write_text(text)
        survivors += killer is None
        print(f"{'SURVIVED' if killer is None else 'killed by ' + killer:22} {mutant}", flush=True)
    return survivors


if __name__ == "__main__":
    main()
