"""What the benchmarks share: timing in turn, and a table that names the machine."""

import csv
import platform
import statistics
import time
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def in_turn(*calls, rounds=7):
    """Median seconds of each call, all measured in turn so that drift hits all alike."""
    seconds = [[] for _ in calls]
    for call in calls:
        call()
    for _ in range(rounds):
        for times, call in zip(seconds, calls):
            begin = time.perf_counter()
            call()
            times.append(time.perf_counter() - begin)
    return [statistics.median(times) for times in seconds]


def machine():
    """Processor, system and Python, without the name of the host."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")]
        model = names[0].split(":")[1].strip() if names else model
    return f"{model}, {platform.system()} {platform.machine()}, Python {platform.python_version()}"


def report(name, rows):
    """Print a list of dicts as a table and write it to results/name.csv."""
    columns = list(rows[0])
    cells = [
        [str(row[c]) if not isinstance(row[c], float) else f"{row[c]:.4g}" for c in columns]
        for row in rows
    ]
    widths = [max(len(c), *(len(r[i]) for r in cells)) for i, c in enumerate(columns)]
    print(machine())
    for line in [columns, *cells]:
        print("  ".join(x.rjust(w) for x, w in zip(line, widths)))
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / f"{name}.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*columns, "machine"])
        writer.writerows([*line, machine()] for line in cells)
