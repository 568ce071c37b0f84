"""Runs scripts, each in a fork of one process that has imported what most of them import.

    python tests/benchmarked.py

reads lines, a list of path and arguments of a script in JSON each, and prints for each a line, in
JSON too: the traceback of an error, or an empty text.
"""

import os
import runpy
import sys
import traceback

import forks
import scipy.integrate  # noqa: F401
import scipy.linalg  # noqa: F401
import scipy.sparse.linalg  # noqa: F401

import pmalpha.structures  # noqa: F401


def error_of(path, *arguments):
    sys.argv = [path, *arguments]
    sys.path[0] = os.path.dirname(path)
    try:
        runpy.run_path(path, run_name="__main__")
    except BaseException:
        return traceback.format_exc()
    return ""


if __name__ == "__main__":
    forks.serve(error_of)
