"""How often AccuracyWarning is right about substeps: cut bars and chains against exact motions.

    python tests/interface_survey.py 200 [--first 0] [--each]

Even numbers are bars of two materials, explicit and implicit, with a pulse that crosses the cut,
low modes, or a harmonic load; odd ones are chains of masses and springs with any numbers of
substeps. Both are cut in two or three, with macro steps from far too long to fine, most of them
under "macro". The error is the largest displacement error, divided
by the largest distance of a displacement from its mean. Beside the verdict is the measure (D4), and
(D3), which sees the errors of the steps and not those of the interface.
"""

import argparse
import warnings
from collections import Counter

import accuracy_survey
import numpy as np
import scipy.linalg

import pmalpha as pm
from pmalpha import structures
from pmalpha.run.accuracy import COARSE, estimated_error
from pmalpha.run.drift import drift_shares

RHOS = (0.3, 0.5, 0.8, 0.9, 1.0)
COUPLINGS = ("macro", "macro", "macro", "pm", "gc")
# Substeps times macro steps of a case that would take long.
MOST = 15_000


class Bar:
    """Two rods end to end, the first one from -length to 0; free, or held by a spring at the left.

    The exact motion is that of the discretized bar, by its modes.
    """

    def __init__(self, rng):
        self.c, Z = 1.0, 10.0 ** rng.uniform(-0.7, 0.7)
        c = 10.0 ** rng.uniform(-0.7, 0.7)
        self.counts = [int(x) for x in rng.integers(20, 90, 2)]
        self.length = rng.uniform(0.5, 2.0)
        lengths = [self.length, c * rng.uniform(0.5, 2.0)]
        self.rods = [
            structures.rod(
                self.counts[0], lengths[0], EA=1.0, rhoA=1.0, mass="lumped", origin=-lengths[0]
            ),
            structures.rod(self.counts[1], lengths[1], EA=Z * c, rhoA=Z / c, mass="lumped"),
        ]
        self.times = [lengths[0] / self.counts[0], lengths[1] / self.counts[1] / c]  # h / c
        self.K = [rod.K.toarray() for rod in self.rods]
        self.K[0][0, 0] += rng.choice([0.0, 1.0]) / self.times[0]
        self.masses = [rod.M.diagonal() for rod in self.rods]
        n = sum(self.counts) + 1
        self.dofs = [np.arange(self.counts[0] + 1), np.arange(self.counts[0], n)]
        K, self.m = np.zeros((n, n)), np.zeros(n)
        for dofs, own, m in zip(self.dofs, self.K, self.masses):
            K[np.ix_(dofs, dofs)] += own
            self.m[dofs] += m
        omega2, self.modes = scipy.linalg.eigh(K, np.diag(self.m))
        self.omega = np.sqrt(np.maximum(omega2, 1e-14 * omega2[-1]))
        self.u0, self.v0, self.p, self.Omega = np.zeros(n), np.zeros(n), np.zeros(n), 0.0
        self.kind = str(rng.choice(["pulse", "pulse", "modes", "harmonic"]))
        getattr(self, f"_{self.kind}")(rng)

    def _pulse(self, rng):
        """Of width `tau`, travelling to the right from the middle of the first rod."""
        self.tau = rng.uniform(0.15, 0.6) * self.length
        s = (self.rods[0].points[:, 0] + 0.5 * self.length) / self.tau
        inside = np.abs(s) < 0.5
        cos, sin = np.cos(np.pi * s) * inside, np.sin(np.pi * s)
        self.u0[self.dofs[0]], self.v0[self.dofs[0]] = cos**4, 4 * np.pi / self.tau * cos**3 * sin
        self.duration = (rng.uniform(0.7, 2.5) + rng.choice([0.0, 3.0])) * self.length

    def _modes(self, rng):
        first = int(self.omega[0] < 1e-3 * self.omega[1])  # not the rigid one
        shares = rng.normal(size=4) / (1.0 + np.arange(4)) ** 2
        chosen = slice(first, first + 4)
        self.u0 = self.modes[:, chosen] @ (shares / self.omega[chosen])
        self.tau = np.pi / self.omega[first]
        self.duration = 2.0 * self.tau * 10.0 ** rng.uniform(0.3, 1.3)

    def _harmonic(self, rng):
        self.p[int(rng.integers(self.m.size))] = 1.0
        self.Omega = rng.uniform(0.2, 2.0) * self.omega[1]
        self.tau = np.pi / self.omega[1]
        self.duration = 2.0 * self.tau * 10.0 ** rng.uniform(0.3, 1.3)

    def exact(self, h, count):
        """(count + 1, n) displacements at 0, h, ..."""
        t, omega = h * np.arange(count + 1)[:, None], self.omega
        q0, q1, P = ((x @ self.modes) for x in (self.m * self.u0, self.m * self.v0, self.p))
        q = q0 * np.cos(omega * t) + q1 / omega * np.sin(omega * t)
        q += P / (omega**2 - self.Omega**2) * (np.cos(self.Omega * t) - np.cos(omega * t))
        return q @ self.modes.T

    def subdomains(self, rng, dt, coupling):
        """Each at most at its critical step; the numbers of substeps divide unless "macro"."""
        schemes = [
            pm.GeneralizedAlpha(float(rng.choice([0.5, 0.8, 1.0])), explicit=bool(x))
            for x in rng.random(2) < 0.6
        ]
        substeps = []
        for scheme, h in zip(schemes, self.times):
            least = dt / (0.9 * h * 10.0 ** rng.uniform(-1.0, 0.0))
            share = rng.uniform(0.2, 1.0) if not scheme.explicit else 1.0
            substeps.append(max(1, int(np.ceil(share * least))))
        if coupling != "macro":
            few, many = np.argsort(substeps)
            substeps[many] = substeps[few] * int(np.ceil(substeps[many] / substeps[few]))
        made = []
        for i, (dofs, K, m) in enumerate(zip(self.dofs, self.K, self.masses)):
            p = self.p[dofs] if i == 0 else self.p[dofs] * (dofs > self.dofs[0][-1])
            made.append(
                pm.Subdomain(
                    m,
                    K,
                    scheme=schemes[i],
                    substeps=substeps[i],
                    u0=self.u0[dofs],
                    v0=self.v0[dofs],
                    force=(lambda t, p=p: p * np.cos(self.Omega * t)) if p.any() else None,
                    name=f"s{i}",
                )
            )
        return made, [pm.tie(made[0], self.counts[0], made[1], 0)], self.dofs


class Chain:
    """A fixed-free chain, its load p cos(Omega t), and its exact motion."""

    def __init__(self, rng):
        self.n = int(rng.integers(2, 25))
        self.m = 10.0 ** rng.uniform(-0.5, 0.5, self.n)
        self.k = 10.0 ** rng.uniform(-0.7, 0.7, self.n)
        self.K = np.diag(self.k + np.append(self.k[1:], 0.0))
        self.K -= np.diag(self.k[1:], 1) + np.diag(self.k[1:], -1)
        omega2, modes = scipy.linalg.eigh(self.K, np.diag(self.m))
        self.omega = np.sqrt(omega2)
        self.c = rng.choice([0.0, 0.0, 0.02, 0.1]) * self.omega[0]  # C = c M
        self.u0, self.p, self.Omega = np.zeros(self.n), np.zeros(self.n), 0.0
        self.kind = str(rng.choice(["free", "free", "constant", "harmonic"]))
        if self.kind == "free":
            kept = min(self.n, 4)
            shares = rng.normal(size=kept) / (1.0 + np.arange(kept)) ** 2
            self.u0 = modes[:, :kept] @ (shares / self.omega[:kept])
        else:
            self.p[int(rng.integers(self.n))] = 1.0
            self.Omega = rng.uniform(0.2, 2.0) * self.omega[0] if self.kind == "harmonic" else 0.0

    def exact(self, h, count):
        """(count + 1, n) displacements at 0, h, ..., with cos and sin as two more unknowns."""
        n = self.n
        A = np.zeros((2 * n + 2, 2 * n + 2))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, :n] = -self.K / self.m[:, None]
        A[n : 2 * n, n : 2 * n] = -self.c * np.eye(n)
        A[n : 2 * n, 2 * n] = self.p / self.m
        A[2 * n, 2 * n + 1], A[2 * n + 1, 2 * n] = -self.Omega, self.Omega
        G = scipy.linalg.expm(h * A)
        x = np.zeros(2 * n + 2)
        x[:n], x[2 * n] = self.u0, 1.0
        out = [x]
        for _ in range(count):
            out.append(G @ out[-1])
        return np.array(out)[:, :n]


def cut(chain, rng, coupling):
    """(subdomains, constraints, dofs of each): neighbours share a dof, half of its mass each."""
    pieces = int(rng.integers(1, min(4, chain.n)))
    ends = np.sort(rng.choice(np.arange(1, chain.n), pieces - 1, replace=False))
    fine = int(rng.choice([1, 2, 5, 20]))
    bounds = [(-1 if i == 0 else int(ends[i - 1])) for i in range(pieces)]
    subdomains, all_dofs = [], []
    for i, begin in enumerate(bounds):
        end = int(ends[i]) if i < pieces - 1 else chain.n - 1
        dofs = np.arange(max(begin, 0), end + 1)
        shared = np.array([sum(a <= d <= b for a, b in spans(chain.n, ends)) for d in dofs])
        m = chain.m[dofs] / shared
        K = np.zeros((dofs.size, dofs.size))
        for s in range(begin + 1, end + 1):  # spring s is between dofs s - 1 and s
            where = [d - dofs[0] for d in (s - 1, s) if d >= 0]
            K[np.ix_(where, where)] += (
                chain.k[s] * np.array([[1, -1], [-1, 1]])[-len(where) :][:, -len(where) :]
            )
        explicit = bool(rng.random() < 0.4)
        family = int(rng.integers(3))
        rho = float(rng.choice(RHOS))
        scheme = pm.GeneralizedAlpha(rho, explicit=explicit)
        if family == 0:
            scheme = pm.CentralDifference() if explicit else pm.Newmark()
        p, Omega = chain.p[dofs] / shared, chain.Omega
        subdomains.append(
            pm.Subdomain(
                m,
                K,
                chain.c * m if chain.c else None,
                scheme=scheme,
                substeps=fine if i == pieces - 1 else 1,
                force=(lambda t, p=p, Omega=Omega: p * np.cos(Omega * t)) if p.any() else None,
                u0=chain.u0[dofs],
                name=f"s{i}",
            )
        )
        all_dofs.append(dofs)
    pairs = zip(subdomains, subdomains[1:])
    ties = [pm.tie(a, [a.n - 1], b, [0]) for a, b in pairs]
    return subdomains, ties, all_dofs


def spans(n, ends):
    return zip([0, *ends], [*ends, n - 1])


def chain_case(rng, coupling):
    """(exact, subdomains, ties, dofs, dt, duration, words) of a cut chain."""
    chain = Chain(rng)
    made, ties, dofs = cut(chain, rng, coupling)
    if coupling == "macro":
        made = [
            pm.Subdomain(
                s.M,
                np.zeros(s.n) if s.K is None else s.K,
                s.C,
                scheme=s.scheme,
                substeps=int(10.0 ** rng.uniform(0.0, 2.0)),
                force=s.force,
                u0=s.u0,
                name=s.name,
            )
            for s in made
        ]
        ties = [pm.tie(a, a.n - 1, b, 0) for a, b in zip(made, made[1:])]
    period = 2.0 * np.pi / chain.omega[0]
    dt = period / 10.0 ** rng.uniform(0.3, 2.7)
    duration = 10.0 ** rng.uniform(0.3, 1.7) * period
    return chain.exact, made, ties, dofs, dt, duration, f"chain {chain.kind}"


def bar_case(rng, coupling):
    bar = Bar(rng)
    dt = bar.tau * 10.0 ** rng.uniform(-2.3, 0.3)
    made, ties, dofs = bar.subdomains(rng, dt, coupling)
    return bar.exact, made, ties, dofs, dt, bar.duration, f"bar {bar.kind}"


def case(seed):
    """(relative error, warned, (D4), (D3), words), None if there is no such problem."""
    rng = np.random.default_rng([seed, 11])
    coupling = str(rng.choice(COUPLINGS))
    make = chain_case if seed % 2 else bar_case
    exact, made, ties, dofs, dt, duration, words = make(rng, coupling)
    most = max(s.substeps for s in made)
    steps = max(int(np.ceil(duration / dt)), 3)
    if most == 1 or len(made) == 1 or steps * most > MOST:
        return None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            coupler = pm.Coupler(made, ties, dt=dt, coupling=coupling)
        except (pm.FactorizationError, ValueError):  # macro coupling far above a critical step
            return None
        if any(issubclass(w.category, pm.StabilityWarning) for w in caught):
            return None
        history = coupler.run(steps=steps)
    warned = any(issubclass(w.category, pm.AccuracyWarning) for w in caught)
    x = exact(dt, steps)
    error = max(
        np.max(np.abs(own.u[:: s.substeps] - x[:, d]))
        for own, s, d in zip(history.subdomains, made, dofs)
    )
    drift = np.sum(drift_shares(history, coupler._session.members, coupler._session.rows, []))
    found = estimated_error(history.subdomains, coupler._session.members, coupler._session.rows, [])
    coarse = 0.0 if found is None else found.size
    words += f" {coupling} {steps} steps, substeps {[s.substeps for s in made]}"
    return error / np.max(np.abs(x - x.mean(axis=0))), warned, drift, coarse, words


def main():
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("number", type=int, nargs="?", default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--each", action="store_true")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.number)
    cases = {seed: found for seed in seeds if (found := case(seed)) is not None}
    classes = Counter()
    for seed, (error, warned, drift, coarse, words) in cases.items():
        word = accuracy_survey.verdict(error, warned)
        if options.each or word in ("missed", "false alarm"):
            print(f"{seed} {words} error {error:.3g} (D4) {drift:.3g} (D3) {coarse:.3g} {word}")
        size = "error > 10 %" if error > 0.1 else "error < 1 %" if error < 0.01 else "between"
        before = ", by (D3)" if coarse > COARSE else ""
        classes[size, f"warned{before}" if warned else "silent"] += 1
    for (size, what), count in sorted(classes.items()):
        print(f"{count:5} {size}, {what}")


if __name__ == "__main__":
    main()
