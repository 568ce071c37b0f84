"""Time of a fine step of a frozen model in the C library, beside that of `Coupler.step`.

python benchmarks/surveys/frozen_steps.py [largest number of dofs]; the minimum of five repetitions,
of processor time.
A chain or a square of masses, implicit, with a mass of four substeps at its end, under "pm". And of
a loop in C with a specimen outside (programs/frozen_loop.c), at the last mass of the chain.
"""

import ctypes
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import scipy.sparse as sp

import pmalpha as pm

LOOP = Path(__file__).parents[1] / "programs" / "frozen_loop.c"
SIDES = (3, 39, 17, 50, 300)


def chain(n, k):
    return sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)) * k


def problem(side, restoring=None):
    """The side of a square, or the number of masses of a chain where that is less than 40."""
    square = side in (17, 50, 300)
    n = side * side if square else side
    K = chain(side, 100.0)
    if square:
        one = sp.eye_array(side)
        K = sp.csr_array(sp.kron(one, K) + sp.kron(K, one))
    else:
        K = K.toarray()
    scheme = pm.GeneralizedAlpha
    a = pm.Subdomain(np.ones(n), K, scheme=scheme(0.8), v0=np.sin(np.arange(n)), name="a")
    fast = scheme(0.8, explicit=True)
    b = pm.Subdomain(
        [0.5], [300.0], scheme=fast, substeps=4, v0=a.v0[-1:], restoring=restoring, name="b"
    )
    return n + 1, pm.Coupler([a, b], pm.tie(a, [n - 1], b, [0]), dt=0.01, coupling="pm", threads=1)


def least(call, steps):
    times = []
    for _ in range(5):
        begin = process_time()
        call(steps)
        times.append((process_time() - begin) / steps)
    return min(times)


def of_loop(folder):
    """ns of a sample of the loop in C with the specimen outside."""
    n, coupler = problem(3, lambda u, v, t: 50.0 * u)
    path, program = Path(folder, "model.pma"), Path(folder, "loop")
    coupler.freeze(path, {"column": ("specimen", "b", 0)}, {"u": ("u", "a", 0)})
    archive = pm.c_library() / "libpmalpha.a"
    flags = ["-O2", "-I", archive.parent, "-o", program]
    subprocess.run(["cc", *flags, LOOP, archive, "-lm", "-pthread"], check=True)
    command = [program, path, "200000"]
    return n, subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def main(most):
    library = ctypes.CDLL(str(pm.c_library() / "libpmalpha.so"))
    library.pmalpha_advance.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
    with tempfile.TemporaryDirectory() as folder:
        print("dofs, ns of a sample of the loop with a specimen:", *of_loop(folder))
    print("dofs, file in bytes, opened in ms, ns of a fine step in C, in Python")
    for side in SIDES:
        n, coupler = problem(side)
        if n > most:
            continue
        with tempfile.TemporaryDirectory() as folder:
            path, model = Path(folder, "model.pma"), ctypes.c_void_p()
            coupler.freeze(path, outputs={"u": ("u", "a", 0)})
            begin = perf_counter()
            assert library.pmalpha_open(str(path).encode(), None, ctypes.byref(model)) == 0
            opened, size = perf_counter() - begin, path.stat().st_size
        macro = int(max(20, min(20_000, 4e7 / n**1.2)))

        def advance(steps, model=model):
            assert library.pmalpha_advance(model, steps) == 0

        in_c, in_python = least(advance, 4 * macro), least(coupler.step, macro) / 4
        print(f"{n}, {size}, {1e3 * opened:.2f}, {1e9 * in_c:.0f}, {1e9 * in_python:.0f}")
        library.pmalpha_close(model)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else np.inf)
