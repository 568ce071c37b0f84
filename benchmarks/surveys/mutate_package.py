"""Mutates the Python package a line at a time, and names the mutants that the given tests miss.

    python benchmarks/surveys/mutate_package.py 20 --only structures tests/test_structures.py

Operators, found by `ast`: comparisons, + and -, * and /, numbers, truth values, calls and results
that are dropped. The same number, seed and text give the same mutants of the same package, so two
versions of the tests are compared by the same list. Works in a copy. Not a test, and no part of
the gate: a mutant takes as long as the tests need to find it.
"""

import argparse
import ast
from functools import partial

from mutate import ROOT, Mutant, killed_by_pytest, survey

COPIED = ["pmalpha", "tests", "docs", "README.md", "pyproject.toml"]
SWAPS = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.In: (" in ", " not in "),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
# of these neither the text nor what is refused changes: words for people, types, names
UNSEEN = (ast.Raise, ast.JoinedStr, ast.ImportFrom, ast.AnnAssign)


def between(left, right, words):
    """The span of an operator between two expressions on one line, and its replacement."""
    return (left.end_lineno, left.end_col_offset, right.lineno, right.col_offset, *words)


def swaps(node):
    """(first line, column, last line, column, old, new) of each change of this node."""
    if isinstance(node, ast.Compare):
        operands = [node.left, *node.comparators]
        for left, op, right in zip(operands, node.ops, operands[1:]):
            if type(op) in SWAPS:
                yield between(left, right, SWAPS[type(op)])
    elif isinstance(node, ast.BinOp) and type(node.op) in SWAPS:
        yield between(node.left, node.right, SWAPS[type(node.op)])
    elif isinstance(node, ast.BoolOp):
        yield between(*node.values[:2], SWAPS[type(node.op)])
    elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        new = not node.value if isinstance(node.value, bool) else 2 * node.value or 1
        yield (*span(node), "", repr(new))
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield (*span(node), "", "pass")
    elif isinstance(node, ast.Return) and node.value is not None:
        yield (*span(node), "", "return None")


def span(node):
    return node.lineno, node.col_offset, node.end_lineno, node.end_col_offset


def seen(node):
    """The nodes below this one whose change can be seen."""
    for child in ast.iter_child_nodes(node):
        annotation = child in (getattr(node, "annotation", None), getattr(node, "returns", None))
        if not isinstance(child, UNSEEN) and not annotation:
            yield child
            yield from seen(child)


def mutants_of(path, text):
    """All that the operators make of one file, where what changes is on one line."""
    lines = text.splitlines()
    for node in seen(ast.parse(text)):
        for first, begin, last, end, old, new in swaps(node):
            line = lines[first - 1]
            middle = line[begin:end] if line.isascii() else ""
            if first == last and middle and old in middle:
                changed = middle.replace(old, new, 1) if old else new
                yield Mutant(path, first, line, line[:begin] + changed + line[end:])


def all_mutants(only):
    for file in sorted((ROOT / "pmalpha").rglob("*.py")):
        path = file.relative_to(ROOT)
        if only in str(path):
            yield from mutants_of(path, file.read_text())


def killed(tests, folder, seconds):
    """What killed the mutant in this folder, or None."""
    return killed_by_pytest(tests, folder, folder, seconds)


def parsed():
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("number", type=int, help="of mutants")
    parser.add_argument("--seed", type=int, default=0, help="which ones")
    parser.add_argument("--only", default="", metavar="TEXT", help="in files with this in the path")
    parser.add_argument("--list", action="store_true", help="name the mutants and run nothing")
    parser.add_argument("tests", nargs="*", help="files that must catch them")
    return parser.parse_intermixed_args()


def main():
    options = parsed()
    survey(list(all_mutants(options.only)), options, COPIED, [partial(killed, options.tests)])


if __name__ == "__main__":
    main()
