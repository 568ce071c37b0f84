"""A step against a lower bound for this machine, measured in the same run.

Chains: multiply-subtract recurrences forward and backward from both ends at once, the minimum for
two triangular sweeps of a tridiagonal factor without fill, and one pass that reads a state and
writes another. Solids: reading the numbers of the factor twice. The lower bounds are a few lines of
C, compiled by this script with all optimizations for this processor; without a compiler there is no
comparison.
"""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from timing import in_turn, run
from uncoupled import DT, RHO, Loop, chain, solid

import pmalpha as pm

LIMITS = """
#include <stddef.h>

/* Forward and backward through a chain of an even number of dofs, in the order 0, n-1, 1, n-2, ...:
 * x_j+2 -= r_j x_j, x_j = x_j d_j - r_j x_j+2, both ends meeting in the last two. */
void recur(size_t times, size_t n, const double *r, const double *d, double *x)
{
    for (size_t k = 0; k < times; k++) {
        double one = x[0], other = x[1];
        for (size_t j = 0; j + 2 < n; j += 2) {
            x[j + 2] = one = x[j + 2] - r[j] * one;
            x[j + 3] = other = x[j + 3] - r[j + 1] * other;
        }
        x[n - 1] = other = (other - r[n - 2] * one) * d[n - 1];
        x[n - 2] = one = one * d[n - 2] - r[n - 2] * other;
        for (size_t j = n - 2; j > 0; j -= 2) {
            x[j - 1] = other = x[j - 1] * d[j - 1] - r[j - 1] * other;
            x[j - 2] = one = x[j - 2] * d[j - 2] - r[j - 2] * one;
        }
    }
}

/* four arrays of n from four others: the predictors of a step */
void pass(size_t times, size_t n, const double *from, double *to)
{
    for (size_t k = 0; k < times; k++) {
        for (size_t i = 0; i < n; i++) {
            const double u = from[i], v = from[n + i], w = from[2 * n + i], a = from[3 * n + i];
            to[i] = u + 0.1 * v + 0.01 * a + 0.01 * w;
            to[n + i] = v + 0.1 * a + 0.1 * w;
            to[2 * n + i] = 0.0;
            to[3 * n + i] = 0.5 * a + 0.5 * w;
        }
    }
}

double read_all(size_t times, size_t n, const double *x)
{
    double sum[32] = {0.0}, total = 0.0;
    for (size_t k = 0; k < times; k++) {
        for (size_t i = 0; i + 32 <= n; i += 32) {
            for (size_t l = 0; l < 32; l++)
                sum[l] += x[i + l];
        }
    }
    for (size_t l = 0; l < 32; l++)
        total += sum[l];
    return total;
}
"""


def compiled(folder):
    """The functions of LIMITS, or None if there is no compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    source, library = Path(folder) / "limits.c", Path(folder) / "limits.so"
    source.write_text(LIMITS)
    options = ["-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([compiler, *options, source, "-o", library], check=True)
    functions = ctypes.CDLL(str(library))
    size, vector = ctypes.c_size_t, np.ctypeslib.ndpointer(np.float64, flags="C")
    functions.recur.argtypes = [size, size, vector, vector, vector]
    functions.pass_ = functions["pass"]
    functions.pass_.argtypes = [size, size, vector, vector]
    functions.read_all.argtypes = [size, size, vector]
    functions.read_all.restype = ctypes.c_double
    return functions


def chain_limit(functions, n, steps):
    r, d, x = np.full(n, 0.5), np.full(n, 0.9), np.ones(n)
    states = np.ones((2, 4 * n))

    def limit():
        functions.recur(steps, n, r, d, x)
        functions.pass_(steps, n, states[0], states[1])

    return limit


def solid_limit(functions, coupler, steps):
    """Reads the same data as the coupler: the numbers of its factor, in panels."""
    (only,) = coupler._session.members
    values = only.factors[0][1][4]
    return lambda: functions.read_all(2 * steps, values.size, values)


def measure(functions, name, M, K, steps, seconds):
    n, scheme = K.shape[0], pm.GeneralizedAlpha(RHO)
    u0 = np.sin(np.pi * np.arange(1, n + 1) / (n + 1))
    coupler = pm.Coupler([pm.Subdomain(M, K, scheme=scheme, u0=u0)], dt=DT, threads=1)
    loop = Loop(M, K, scheme, u0)
    if name == "chain":
        limit, target = chain_limit(functions, n, steps), 1.5
    else:
        limit, target = solid_limit(functions, coupler, steps), 1.0
    ours, theirs, least = in_turn(
        lambda: coupler.step(steps), lambda: loop.step(steps), limit, rounds=3, seconds=seconds
    )
    return {
        "problem": name,
        "n": n,
        "us a step": ours / steps * 1e6,
        "us of the limit": least / steps * 1e6,
        "step over limit": ours / least,
        "target": target,
        "us a step of the loop": theirs / steps * 1e6,
        "loop over ours": theirs / ours,
    }


def rows(quick):
    with tempfile.TemporaryDirectory() as folder:
        functions = compiled(folder)
        if functions is None:
            print("there is no C compiler: nothing is measured")
            return []
        if quick:
            return [
                measure(functions, "chain", np.ones(2), chain(2), 10, 0.0),
                measure(functions, "solid", *solid(5, 5, 5), 2, 0.0),
            ]
        found = [
            measure(functions, "chain", np.ones(n), chain(n), steps, 4.0)
            for n, steps in ((2, 50_000), (1000, 200), (100_000, 4))
        ]
        for counts in ((15, 14, 14), (21, 20, 21)):
            found.append(measure(functions, "solid", *solid(*counts), 20, 8.0))
        return found


if __name__ == "__main__":
    run("limits", rows, about=__doc__)
