"""A fine step of two explicit solids with contact rows between them: none, a tenth, all closed.

The solids are cubes of springs of 100 000 dofs, one pressed against the other; with the first step
in which rows close, where W in these rows is factored.
"""

import warnings

import numpy as np
import scipy.sparse as sp
from timing import in_turn, once, run

import pmalpha as pm


def line(n):
    values = [-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)]
    return sp.diags_array(values, offsets=[-1, 0, 1])


def solid(n):
    """Stiffness of n^3 masses on springs in three directions."""
    one, stiff = sp.eye_array(n), line(n)
    sides = (stiff, one, one), (one, stiff, one), (one, one, stiff)
    return sp.csr_array(sum(sp.kron(sp.kron(x, y), z) for x, y, z in sides))


def coupler(K, n, rows, closed):
    """`closed` of the rows have no gap and are pressed together; without contacts for rows = 0."""
    push = np.zeros(n**3)
    top, bottom = np.arange(n**2) * n + n - 1, np.arange(n**2) * n
    push[top[:closed]] = 0.5
    explicit = {"scheme": pm.CentralDifference()}
    a = pm.Subdomain(np.ones(n**3), K, force=push, name="a", **explicit)
    b = pm.Subdomain(np.ones(n**3), K, name="b", **explicit)
    gap = np.where(np.arange(rows) < closed, 0.0, 1e6)
    joint = pm.contact(a, top[:rows], b, bottom[:rows], gap=gap) if rows else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.ConstraintWarning)  # apart, for comparison
        return pm.Coupler([a, b], joint, dt=0.5, coupling="gc", threads=1)


def rows(quick):
    n, count, seconds = (6, 30, 0.0) if quick else (46, 2000, 3.0)
    K = solid(n)
    cases = [("without contacts", 0, 0), ("none", count, 0)]
    cases += [("a tenth", count, count // 10), ("all", count, count)]
    couplers = [coupler(K, n, q, closed) for _, q, closed in cases]
    first = [once(lambda c=c: c.step(1))[0] for c in couplers]
    steps = in_turn(*(lambda c=c: c.step(1) for c in couplers), seconds=seconds)
    return [
        {
            "closed": name,
            "dofs": 2 * n**3,
            "rows": q,
            "first step ms": 1e3 * begin,
            "step ms": 1e3 * step,
            "over none": step / steps[1],
        }
        for (name, q, _), begin, step in zip(cases, first, steps)
    ]


if __name__ == "__main__":
    run("contact", rows, about=__doc__)
