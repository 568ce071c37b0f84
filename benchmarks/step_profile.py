"""Distribution of the time of a step over the functions of the core, sampled by perf.

A separate process for each problem creates the Coupler, prints "ready", and steps while perf
samples it. Needs perf and the permission to use it (Linux); an inlined function counts for its
caller.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from coupling_cost import structures, subdomains
from plate import coupled, problem
from timing import run
from uncoupled import chain, solid

import pmalpha as pm

SECONDS = 4.0
# Functions below this share of the samples are reported together.
LITTLE = 0.02


def chain_alone(n):
    alone = pm.Subdomain(np.ones(n), chain(n), scheme=pm.GeneralizedAlpha(0.8), u0=np.ones(n))
    return pm.Coupler([alone], dt=0.1, threads=1)


def solid_alone(*counts):
    M, K = solid(*counts)
    alone = pm.Subdomain(M, K, scheme=pm.GeneralizedAlpha(0.8), u0=np.ones(M.shape[0]))
    return pm.Coupler([alone], dt=0.1, threads=1)


def solids(*counts):
    meshes = structures(counts, 1)
    members = subdomains(meshes, 10)
    points = {s: mesh.points for s, mesh in zip(members, meshes)}
    tie = pm.tie_coincident(points, components=3)
    return pm.Coupler(members, tie, dt=0.1, threads=1, coupling="pm")


PROBLEMS = {
    "four dofs, ss = 20": lambda: pm.models.four_dof(rho=0.5).coupler(
        1.0 / 40.0 / 0.47, coupling="pm"
    ),
    "chain, n = 1000": lambda: chain_alone(1000),
    "chain, n = 100 000": lambda: chain_alone(100_000),
    "hex8, n = 29 106": lambda: solid_alone(21, 20, 21),
    "plates 49x9": lambda: coupled(problem(49, 9)),
    "plates 99x99": lambda: coupled(problem(99, 99)),
    "hex8 + explicit, one face": lambda: solids(41, 8, 8),
}


def step_until_killed(name):
    """In a separate process: step until killed."""
    coupler = PROBLEMS[name]()
    begin = time.perf_counter()
    coupler.step(5)
    steps = max(1, int(0.5 / (time.perf_counter() - begin)))
    print("ready", flush=True)
    while True:
        coupler.step(steps)


def samples(name, seconds):
    """Share of each function in the samples of a process that steps."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "perf.data"
        command = [sys.executable, __file__, "--one", name]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            try:
                child.stdout.readline()
                record = ["perf", "record", "-q", "-o", data, "-p", str(child.pid)]
                subprocess.run([*record, "--", "sleep", str(seconds)], check=True)
            finally:
                child.kill()
        report = ["perf", "report", "-i", data, "--stdio", "-q", "--no-children", "-F"]
        text = subprocess.run(
            [*report, "overhead,dso,symbol"], check=True, capture_output=True, text=True
        ).stdout
    found = re.findall(r"^\s*([\d.]+)%\s+(\S+)\s+\[.\]\s+(\S+)", text, re.MULTILINE)
    core = [(float(x) / 100.0, symbol) for x, dso, symbol in found if dso.startswith("_core")]
    return sorted(core, reverse=True)


def measure(name, seconds):
    found = samples(name, seconds)
    total = sum(share for share, _ in found)
    rows = [
        {"problem": name, "function": symbol.partition(".")[0], "share": share / total}
        for share, symbol in found
        if share >= LITTLE * total
    ]
    rest = 1.0 - sum(row["share"] for row in rows)
    return [*rows, {"problem": name, "function": "others", "share": rest}]


def rows(quick):
    if shutil.which("perf") is None:
        print("perf is not installed: nothing is measured")
        return []
    names, seconds = (["four dofs, ss = 20"], 0.3) if quick else (PROBLEMS, SECONDS)
    return [row for name in names for row in measure(name, seconds)]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        step_until_killed(sys.argv[2])
    else:
        run("step_profile", rows, about=__doc__)
