"""Instructions and allocations of a fine step inside the core, counted by valgrind.

Only instructions inside pma_coupler_advance are counted, in a run of the four-dof example with
everything recorded. Takes some minutes, because all of Python runs under valgrind. Needs valgrind.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from timing import run

RUN = """
import pmalpha as pm
model = pm.models.four_dof(rho=0.5)
model.coupler(1.0 / 40.0 / 0.47, coupling="pm").run(steps={steps})
"""
STEPS, SS = 100, 20
ALLOCATORS = "malloc", "calloc", "realloc", "free"


def counted(steps):
    """Instructions inside the core, and the names of the allocators it called."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "callgrind.out"
        command = [
            "valgrind",
            "--tool=callgrind",
            "--toggle-collect=pma_coupler_advance",
            f"--callgrind-out-file={out}",
            sys.executable,
            "-c",
            RUN.format(steps=steps),
        ]
        subprocess.run(command, check=True, capture_output=True)
        text = out.read_text()
    total = int(re.search(r"^summary: (\d+)", text, re.MULTILINE).group(1))
    names = set(re.findall(r"^c?fn=\(\d+\) (\S+)", text, re.MULTILINE))
    return total, sorted(names & set(ALLOCATORS))


def rows(quick):
    if shutil.which("valgrind") is None:
        print("valgrind is not installed: nothing is measured")
        return []
    steps = 2 if quick else STEPS
    few, _ = counted(steps)
    many, allocators = counted(2 * steps)
    return [
        {
            "fine steps": steps * SS,
            "instructions a fine step": (many - few) / (steps * SS),
            "allocators called": " ".join(allocators) or "none",
        }
    ]


if __name__ == "__main__":
    run("instructions", rows, about=__doc__)
