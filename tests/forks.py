"""Work in forks of one process, which has imported once what all of them need."""

import contextlib
import faulthandler
import json
import os
import subprocess
import sys

import waits


def error_in_fork(work, *arguments):
    """What the work returns in another process, which is as new for each; or how that ended."""
    there, here = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(there)
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        faulthandler.dump_traceback_later(waits.LIMIT, exit=True)
        with open(here, "w") as pipe:
            pipe.write(work(*arguments))
        sys.exit()
    os.close(here)
    with open(there) as pipe:
        error = pipe.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return error or (f"the process ended with {status}" if status else "")


def serve(work):
    """Reads arguments in JSON, a line each, and prints their error, or an empty text."""
    for line in sys.stdin:
        print(json.dumps(error_in_fork(work, *json.loads(line))), flush=True)


@contextlib.contextmanager
def server(script, **options):
    """A function that gives arguments to a script that serves, and returns the error."""
    with subprocess.Popen(
        [sys.executable, script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        **options,
    ) as process:

        def error_of(*arguments):
            print(json.dumps([str(x) for x in arguments]), file=process.stdin, flush=True)
            return json.loads(process.stdout.readline())

        yield error_of
        process.stdin.close()
