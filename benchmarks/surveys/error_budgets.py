"""The figures of docs/budget.md and of (A5): random chains against their exact motion.

python benchmarks/surveys/error_budgets.py chains 1000 40      first seed, number
python benchmarks/surveys/error_budgets.py refined 1000 20
python benchmarks/surveys/error_budgets.py order 1000 10       macro or mean at fixed own steps
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sl

import pmalpha as pm


@dataclass
class Chain:
    """Masses in a row, cut in two or three subdomains that share the masses at the cuts."""

    masses: list[np.ndarray]
    springs: list[np.ndarray]
    substeps: list[int]
    explicit: list[bool]
    rho: float
    factor: float  # of the damping, C = factor K
    load: int  # subdomain whose middle dof has the burst
    goal: int
    steps: int
    t_end: float = 0.0
    coupling: str = "macro"

    def stiffness(self, i: int) -> np.ndarray:
        """Of a subdomain; the first spring of the first one is to the ground."""
        k = self.springs[i]
        n = len(self.masses[i])
        K = np.zeros((n, n))
        if i == 0:
            K[0, 0] += k[0]
            k = k[1:]
        for j, x in enumerate(k):
            K[j : j + 2, j : j + 2] += x * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return K

    def whole(self) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """M, K and the dofs of each subdomain in the uncut chain."""
        dofs, first = [], 0
        for m in self.masses:
            dofs.append(np.arange(first, first + len(m)))
            first += len(m) - 1
        M, K = np.zeros(first + 1), np.zeros((first + 1, first + 1))
        for i, d in enumerate(dofs):
            np.add.at(M, d, self.masses[i])
            K[np.ix_(d, d)] += self.stiffness(i)
        return M, K, dofs

    def burst(self, t: np.ndarray) -> np.ndarray:
        """A sine of the second frequency, over a third of the run, with a smooth envelope."""
        x = np.clip(t / (self.t_end / 3.0), 0.0, 1.0)
        return np.sin(np.pi * x) ** 4 * np.sin(12.0 * np.pi * t / self.t_end)

    def coupler(self, factors: list[int] | None = None, steps: int | None = None) -> pm.Coupler:
        """With `factors` times the substeps, in this number of macro steps."""
        subdomains = []
        for i, m in enumerate(self.masses):
            K = self.stiffness(i)
            scheme = (
                pm.Newmark()
                if self.coupling == "mean"
                else pm.GeneralizedAlpha(self.rho, explicit=self.explicit[i])
            )
            unit = np.zeros(len(m))
            unit[len(m) // 2] = 1.0
            force = (lambda t, e=unit: self.burst(t) * e) if i == self.load else None
            substeps = self.substeps[i] * (1 if factors is None else factors[i])
            subdomains.append(
                pm.Subdomain(
                    m,
                    K,
                    C=self.factor * K,
                    scheme=scheme,
                    substeps=substeps,
                    force=force,
                    name=f"part {i}",
                )
            )
        ties = [pm.tie(a, [a.n - 1], b, [0]) for a, b in zip(subdomains, subdomains[1:])]
        dt = self.t_end / (self.steps if steps is None else steps)
        return pm.Coupler(subdomains, ties, dt=dt, coupling=self.coupling)

    def aim(self) -> pm.Goal:
        return pm.Goal(f"part {self.goal}", len(self.masses[self.goal]) // 2, at=self.t_end)

    def exact(self, points: int = 4000) -> float:
        """The goal, by modes-free quadrature of the variation of constants."""
        M, K, dofs = self.whole()
        n = len(M)
        A = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-K / M[:, None], -self.factor * K / M[:, None]]]
        )
        b = np.zeros(2 * n)
        dof = dofs[self.load][len(self.masses[self.load]) // 2]
        b[n + dof] = 1.0 / M[dof]
        out = dofs[self.goal][len(self.masses[self.goal]) // 2]
        h = self.t_end / points
        x, weights = np.polynomial.legendre.leggauss(4)
        # J = sum of h w c exp(A (T - t)) b f(t): one vector, propagated step by step
        step = sl.expm(A.T * h)
        inner = [sl.expm(A.T * h * 0.5 * (1.0 - p)) for p in x]
        row = np.zeros(2 * n)
        row[out] = 1.0
        total = 0.0
        for k in range(points - 1, -1, -1):
            t = h * (k + 0.5 * (1.0 + x))
            total += sum(
                0.5 * h * w * (E @ row) @ b * f for w, E, f in zip(weights, inner, self.burst(t))
            )
            row = step @ row
        return float(total)


def chain(seed: int, coupling: str = "macro") -> Chain:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 4))
    sizes = rng.integers(2, 5, count)
    masses = [rng.uniform(0.5, 2.0, n) for n in sizes]
    springs = [rng.uniform(0.5, 2.0, n - 1 + (i == 0)) for i, n in enumerate(sizes)]
    if rng.random() < 0.5:
        stiff = int(rng.integers(count))
        springs[stiff] = springs[stiff] * rng.uniform(3.0, 30.0)
    explicit = [bool(x) for x in rng.random(count) < 0.5]
    c = Chain(
        masses,
        springs,
        [int(x) for x in rng.integers(1, 21, count)],
        explicit,
        float(rng.choice([0.5, 0.8, 1.0])),
        0.0,
        int(rng.integers(count)),
        int(rng.integers(count)),
        int(rng.choice([80, 160, 320])),
        coupling=coupling,
    )
    if coupling == "mean":
        c.explicit = [False] * count
    M, K, _ = c.whole()
    omega = np.sqrt(sl.eigvalsh(K, np.diag(M)))
    c.t_end = float(4.0 * 2.0 * np.pi / omega[0])
    c.factor = float(rng.uniform(0.0, 0.04) / omega[0])
    # explicit subdomains below their critical steps
    for i, s in enumerate(c.coupler(steps=100000).subdomains):
        limit = pm.analysis.critical_step(s)
        least = int(np.ceil(c.t_end / c.steps / (0.8 * limit))) if np.isfinite(limit) else 1
        c.substeps[i] = max(c.substeps[i], least)
    return c


def chains(first: int, count: int) -> None:
    rows = []
    for seed in range(first, first + count):
        c = chain(seed)
        if max(c.substeps) > 60:
            continue
        b = c.coupler().error_budget(c.aim(), c.t_end)
        true = c.exact() - b.value
        rows.append((c.steps, b.total / true, abs(b.total - true) / b.bound, abs(true) / b.bound))
    x = np.array(rows)
    print(f"{len(x)} chains")
    for what, part in (("all", x), ("80", x[x[:, 0] == 80]), ("160, 320", x[x[:, 0] > 80])):
        if not len(part):
            continue
        q = np.quantile(part[:, 1], [0.1, 0.5, 0.9])
        print(
            f"{what}: effectivity median {q[1]:.3f}, 10 .. 90 % {q[0]:.2f} .. {q[2]:.2f}; "
            f"|estimate - true| / sum median {np.median(part[:, 2]):.3f}, 90 % "
            f"{np.quantile(part[:, 2], 0.9):.3f}; true / sum at most {part[:, 3].max():.2f}"
        )


def refined(first: int, count: int) -> None:
    """Each subdomain alone with a quarter of its steps: the goal moves by 15/16 of its share."""
    errors, ratios = [], []
    for seed in range(first, first + count):
        c = chain(seed)
        if max(c.substeps) > 40:
            continue
        b = c.coupler().error_budget(c.aim(), c.t_end)
        for i, x in enumerate(b.own.values()):
            factors = [4 if j == i else 1 for j in range(len(c.masses))]
            finer = c.aim()(c.coupler(factors).run(c.t_end))[0]
            errors.append(abs(finer - b.value - 15.0 / 16.0 * x) / b.bound)
            if abs(x) > 0.1 * b.bound:
                ratios.append(15.0 / 16.0 * x / (finer - b.value))
    q = np.quantile(ratios, [0.1, 0.5, 0.9])
    print(
        f"{len(errors)} subdomains: |predicted - seen| / sum median {np.median(errors):.3f}, 90 % "
        f"{np.quantile(errors, 0.9):.3f}; {len(ratios)} large ones: predicted / seen "
        f"{q[1]:.3f}, {q[0]:.2f} .. {q[2]:.2f}"
    )


def order(first: int, count: int, coupling: str = "macro") -> None:
    """Errors at fixed own steps, 6400 in the run, by the number of macro steps."""
    orders = []
    for seed in range(first, first + count):
        c = chain(seed, coupling)
        values = []
        for steps in (20, 40, 80):
            d = replace(c, substeps=[6400 // steps] * len(c.masses), t_end=c.t_end / 2.0)
            values.append(d.aim()(d.coupler(steps=steps).run(d.t_end))[0] - d.exact())
        e = np.abs(values)
        orders.append(np.log2(e[:-1] / e[1:]))
    x = np.array(orders)
    print(f"{coupling}: order 20 -> 40, 40 -> 80 (median) {np.median(x, axis=0)}")


def resolution(first: int, count: int) -> None:
    """Error of the coupling alone by D: the same own steps in 640 macro steps are the reference."""
    rows = []
    for seed in range(first, first + count):
        c = chain(seed)

        def run(steps: int, c: Chain = c) -> pm.History:
            return (
                replace(c, substeps=[6400 // steps] * len(c.masses))
                .coupler(steps=steps)
                .run(c.t_end)
            )

        exact = run(640)
        largest = max(np.abs(x.u).max() for x in exact.subdomains)
        for steps in (20, 40, 80, 160):
            history = run(steps)
            own = 6400 // steps
            error = max(
                np.abs(x.u[::own] - y.u[::own]).max()
                for x, y in zip(history.subdomains, exact.subdomains)
            )
            rows.append((history.resolution().largest, error / largest))
    x = np.array(rows)
    limits = (0.0, 0.003, 0.01, 0.03, 0.1, np.inf)
    for low, high in zip(limits, limits[1:]):
        part = x[(x[:, 0] >= low) & (x[:, 0] < high), 1]
        if part.size:
            print(
                f"D {low:g} .. {high:g}: {part.size} runs, error median {np.median(part):.1e}, "
                f"90 % {np.quantile(part, 0.9):.1e}, largest {part.max():.1e}"
            )


if __name__ == "__main__":
    warnings.simplefilter("ignore", pm.AccuracyWarning)
    globals()[sys.argv[1]](*map(int, sys.argv[2:4]), *sys.argv[4:])
