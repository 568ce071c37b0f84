"""Executes programs, each in a fork of one process that has imported what they import.

Each line of the input is in JSON: the code, a folder for the files `stdout` and `stderr`, and a
limit of time in seconds. The line of the output is the exit code, negative for a signal.
"""

import faulthandler
import json
import os
import sys

import core_objects  # noqa: F401
import waits  # noqa: F401


def become(code, folder, limit):
    """This process goes on as the program, and ends as a program does."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        file = os.open(os.path.join(folder, name), os.O_WRONLY | os.O_CREAT)
        os.dup2(file, number)
        os.close(file)
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    faulthandler.dump_traceback_later(limit, exit=True)
    exec(compile(code, "<program>", "exec"), {"__name__": "__main__"})


for line in sys.stdin:
    child = os.fork()
    if child == 0:
        become(*json.loads(line))
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
