"""Common functions of the benchmarks: alternating measurement, options, tables."""

import argparse
import csv
import datetime
import importlib.metadata
import platform
import time
from pathlib import Path

from threadpoolctl import threadpool_limits

RESULTS = Path(__file__).parent / "results"


def in_turn(*calls, rounds=7, seconds=0.0, clock=time.thread_time):
    """Least seconds of each call, measured alternately so that a slow period affects all alike.

    The least, because other load on the machine can only increase a time. Rounds are repeated until
    at least `rounds` of them have taken at least `seconds`. The clock is the processor time of this
    thread, which excludes other programs; calls that use several threads need
    `time.perf_counter`.
    """
    least = [float("inf")] * len(calls)
    for call in calls:
        call()
    done, start = 0, time.perf_counter()
    while done < rounds or time.perf_counter() - start < seconds:
        for i, call in enumerate(calls):
            begin = clock()
            call()
            least[i] = min(least[i], clock() - begin)
        done += 1
    return least


def once(call, clock=time.process_time):
    """Seconds of a single call, and its return value; the time of all threads counts."""
    begin = clock()
    value = call()
    return clock() - begin, value


def machine():
    """Processor, system and Python version, without the host name."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")]
        model = names[0].split(":")[1].strip() if names else model
    return f"{model}, {platform.system()} {platform.machine()}, Python {platform.python_version()}"


def versions():
    """Versions of the measured packages."""
    packages = "pmalpha", "numpy", "scipy"
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in packages)


def run(name, measure, *, about):
    """Parse the command line, measure, report.

    Parameters
    ----------
    name : str
        Of the CSV file.
    measure : callable
        ``measure(quick)`` returns the rows, a list of dicts with the same keys. An empty list means
        that it cannot measure here; existing results are then kept. With `quick` it uses small
        sizes and takes a few seconds, which only shows that the script runs.
    about : str
        The docstring of the script.
    """
    parser = argparse.ArgumentParser(description=about.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="small sizes, as a check")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the CSV file")
    given = parser.parse_args()
    with threadpool_limits(1):  # BLAS: one thread against one thread
        rows = measure(given.quick)
    if rows:
        report(name, rows, given.results)


def report(name, rows, folder=RESULTS):
    """Print a list of dicts as a table and write it to folder/name.csv."""
    columns = list(rows[0])
    cells = [
        [str(row[c]) if not isinstance(row[c], float) else f"{row[c]:.4g}" for c in columns]
        for row in rows
    ]
    widths = [max(len(c), *(len(r[i]) for r in cells)) for i, c in enumerate(columns)]
    print(machine())
    for line in [columns, *cells]:
        print("  ".join(x.rjust(w) for x, w in zip(line, widths)))
    folder.mkdir(exist_ok=True, parents=True)
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    with open(folder / f"{name}.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*columns, "machine", "versions", "date"])
        writer.writerows([*line, machine(), versions(), today] for line in cells)
