"""Small problems: the first example of the README, two subdomains of two dofs, rows of up to
10 000 of ten dofs, the import.

Each over what one would do oneself or cannot avoid: the factors and the interface matrix by SciPy,
a row of a tenth of the subdomains, the import of NumPy and scipy.sparse. Of the example what
judging takes, over its set-up. A run of one step over that step. Of rows set-up and a macro step,
for each subdomain.
"""

import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from itertools import pairwise
from unittest import mock

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from timing import in_turn, once, run
from uncoupled import chain

import pmalpha as pm
from pmalpha.setup import assembly

SCHEME = pm.GeneralizedAlpha(0.5)
DT = 0.05
K = np.array([[2.0, -1.0], [-1.0, 2.0]])
IMPORTS = ("import numpy, scipy.sparse", "import pmalpha")


def pair():
    """Two tied subdomains, described and set up."""
    a = pm.Subdomain(np.ones(2), K, scheme=SCHEME, v0=[1.0, 0.0], name="a")
    b = pm.Subdomain(np.ones(2), K, scheme=SCHEME, substeps=2, name="b")
    return pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=DT, coupling="gc", threads=1)


def example():
    """The subdomains and ties of the first example of the README."""
    stiffness = np.array([[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]])
    of_tower = {"scheme": pm.GeneralizedAlpha(0.8), "substeps": 12, "u0": [0.0, 0.0, 0.1]}
    tower = pm.Subdomain([1.0, 2.0, 1.0], stiffness, **of_tower, name="tower")
    explicit = pm.GeneralizedAlpha(0.8, explicit=True)
    base = pm.Subdomain([1.0], [400e3], scheme=explicit, substeps=18, name="base")
    return [tower, base], pm.tie(tower, [0], base, [0])


def judged(seconds):
    """The least seconds that the set-up of the example takes, and its judging for warnings."""
    judge, least, inside = assembly.judge, [np.inf, np.inf], [0.0]

    def timed(*arguments):
        begin = time.thread_time()
        judge(*arguments)
        inside[0] = time.thread_time() - begin

    pm.Coupler(*example(), dt=DT, coupling="macro")  # libraries are loaded
    with mock.patch.object(assembly, "judge", timed):
        start = time.perf_counter()
        while time.perf_counter() - start < seconds or least[0] == np.inf:
            problem = example()
            begin = time.thread_time()
            pm.Coupler(*problem, dt=DT, coupling="macro")
            least = np.minimum(least, (time.thread_time() - begin, inside[0]))
    return least


def pair_by_hand():
    """What their steps need: factors of Mbar, H, and the initial accelerations."""
    H, L = 0.0, [np.array([[0.0, 1.0]]), np.array([[-1.0, 0.0]])]
    for h, row in zip((DT, DT / 2.0), L):
        factor = scipy.linalg.cho_factor(np.eye(2) + 0.25 * h * h * K)
        H = H + row @ scipy.linalg.cho_solve(factor, row.T)
        scipy.linalg.cho_solve(scipy.linalg.cho_factor(np.eye(2)), -K @ np.zeros(2))
    return scipy.linalg.cho_factor(H)


def row(count):
    """Chains of ten dofs, each tied to the next, every second one with two substeps."""
    A = sp.csr_array(chain(10))
    subdomains = [
        pm.Subdomain(np.ones(10), A, scheme=SCHEME, substeps=1 + i % 2, name=f"s{i}")
        for i in range(count)
    ]
    ties = [pm.tie(a, [9], b, [0]) for a, b in zip(subdomains, subdomains[1:])]
    return pm.Coupler(subdomains, ties, dt=DT, coupling="gc", threads=1)


def imported(statement, times):
    """Least processor seconds of a statement in interpreters of their own, from compiled files."""
    code = f"import time; t = time.process_time(); {statement}; print(time.process_time() - t)"
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"PYTHONPYCACHEPREFIX": folder, "PYTHONDONTWRITEBYTECODE": ""}
        call = partial(subprocess.run, [sys.executable, "-c", code], env=environment)
        done = [call(capture_output=True, check=True) for _ in range(1 + times)]
    return min(float(x.stdout) for x in done[1:])


def rows_of_chains(counts):
    """For each number of subdomains the seconds of set-up and of a macro step."""
    seconds = {}
    for count in counts:
        setup, coupler = once(lambda n=count: row(n))
        steps = max(1, 20_000 // count)
        (step,) = in_turn(lambda c=coupler, n=steps: c.step(n))
        seconds[count] = setup, step / steps
    return seconds


def line(what, seconds, over, other):
    return {"what": what, "ms": 1e3 * seconds, "over": over, "ratio": seconds / other}


def rows(quick):
    seconds, counts = (0.0, (2, 20)) if quick else (3.0, (100, 1000, 10_000))
    own, hand = in_turn(pair, pair_by_hand, seconds=seconds)
    setup, judging = judged(seconds)
    coupler = pair()
    one, step = in_turn(lambda: coupler.run(steps=1), coupler.step, seconds=seconds)
    of_rows = rows_of_chains(counts)
    chains = []
    for few, many in pairwise(counts):
        for k, what in enumerate(("set-up", "macro step")):
            each, of_few = of_rows[many][k] / many, of_rows[few][k] / few
            chains.append(line(f"{what} of {many} in a row, each", each, f"of {few}", of_few))
    times = [imported(x, 1 if quick else 5) for x in IMPORTS]
    return [
        line("two of 2 dofs", own, "SciPy by hand", hand),
        line("judging the example of the README", judging, "its set-up", setup),
        line("run(steps=1)", one, "step()", step),
        *chains,
        line("import pmalpha", times[1], "NumPy, scipy.sparse", times[0]),
    ]


if __name__ == "__main__":
    run("setting_up", rows, about=__doc__)
