"""Executes notebooks, each in a fork of one process that has imported what most of them import.

    python tests/executed.py

reads lines, a list of the path of a notebook in JSON each, and prints for each a line, in JSON too:
the error of the first cell that fails, or an empty text. The cells run in the present folder as in
a kernel of Jupyter, and what they draw is drawn; what they print goes to the standard error.
"""

import json
import os
import traceback

os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"

import forks
from IPython.core.interactiveshell import InteractiveShell
from traitlets.config import Config


class Shell(InteractiveShell):
    def enable_gui(self, gui=None):
        """There is none, for `%matplotlib inline` neither."""


# before the backend is imported, which draws after each cell of it; no thread that writes a history
SHELL = Shell.instance(config=Config({"HistoryManager": {"enabled": False}}))

import matplotlib.pyplot  # noqa: E402, F401
import scipy.integrate  # noqa: E402, F401
import scipy.optimize  # noqa: E402, F401
import scipy.signal  # noqa: E402, F401
import scipy.sparse.linalg  # noqa: E402, F401
import scipy.stats  # noqa: E402, F401

import pmalpha.plot  # noqa: E402
import pmalpha.structures  # noqa: E402, F401


def error_of(path):
    """The traceback of the first cell that fails, or nothing."""
    with open(path, encoding="utf-8") as file:
        cells = [c["source"] for c in json.load(file)["cells"] if c["cell_type"] == "code"]
    for source in cells:
        result = SHELL.run_cell("".join(source), store_history=True)
        error = result.error_before_exec or result.error_in_exec
        if error is not None:
            return "".join(traceback.format_exception(error))
    return ""


if __name__ == "__main__":
    forks.serve(error_of)
