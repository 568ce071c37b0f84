"""Random coupled problems of all couplings, and the spectral radius of their macro steps."""

import numpy as np

import pmalpha as pm
from pmalpha import analysis

ALPHA, CD = pm.GeneralizedAlpha, pm.CentralDifference()


def radius(coupler):
    return analysis.spectral_radius(analysis.amplification_matrix(coupler))


def limit(m, k, scheme):
    """Critical step; for implicit schemes that of central difference."""
    return (
        2.0
        * np.sqrt(m / k)
        * (
            analysis.critical_step(pm.Subdomain([1.0], [4.0], scheme=scheme))
            if scheme.explicit
            else 1.0
        )
    )


def oscillator(b1, schemes, substeps, share, double=False, far=1.0, **options):
    """Masses with mA/mB = b1 and springs with kB/kA = b1; dt is this share of the critical step."""
    mB = kA = 1.0 / (1.0 + b1)
    mA, kB = b1 * mB, b1 * kA
    dt = share * far * substeps * limit(mB, kB, schemes[1])
    if schemes[0].explicit:
        dt = min(dt, share * limit(mA, kA, schemes[0]) * (0.5 if double else 1.0))
    A = pm.Subdomain([mA], [kA], scheme=schemes[0], double_step=double or None, name="A")
    B = pm.Subdomain([mB], [kB], scheme=schemes[1], substeps=substeps, name="B")
    return pm.Coupler([A, B], pm.tie(A, 0, B, 0), dt=dt, **options)


def loop(seed, schemes, double=False, common=True, **options):
    """Three random subdomains of four dofs in a loop of ties."""
    rng = np.random.default_rng(seed)
    sets = (
        [(1, 1, 1), (1, 2, 4), (1, 3, 6), (2, 2, 6), (1, 5, 20)]
        if common
        else [(1, 1, 1), (1, 3, 7), (2, 3, 7), (1, 2, 5), (1, 5, 20)]
    )
    substeps = (1, 1, 3) if double else sets[seed % 5]
    subdomains, steps = [], []
    for i, (s, scheme) in enumerate(zip(substeps, schemes)):
        A = rng.normal(size=(4, 4))
        own = pm.Subdomain(
            rng.uniform(0.3, 3.0, 4),
            A @ A.T + 0.1 * np.eye(4),
            scheme=scheme,
            substeps=s,
            double_step=True if double and i == 0 else None,
            name=str(i),
        )
        subdomains.append(own)
        whole = s * analysis.critical_step(own)
        steps.append(0.5 * whole if double and i == 0 else whole)
    a, b, c = subdomains
    ties = [pm.tie(a, 3, b, 0), pm.tie(b, 3, c, 0), pm.tie(c, 3, a, 0)]
    dt = rng.uniform(0.05, 0.97) * min(*steps, 10.0 ** rng.uniform(-1.0, 1.5))
    return pm.Coupler(subdomains, ties, dt=dt, **options)


def mean_problems(seed, count, double):
    """Random split oscillators under mean coupling, of all schemes that it takes."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        explicit = rng.random() < 0.5
        implicit = [ALPHA(rng.uniform(0.0, 1.0)), ALPHA(1.0), pm.Newmark(), pm.HHT(0.2)]
        A = implicit[rng.integers(4)]
        B = [ALPHA(rng.uniform(0.5, 1.0), explicit=True), CD][rng.integers(2)]
        B = B if explicit else implicit[rng.integers(4)]
        far = 1.0 if explicit else 10.0 ** rng.uniform(-1.0, 2.0)
        substeps = int(rng.choice([1, 2, 3, 5, 7, 20]))
        b1, share = 10.0 ** rng.uniform(-2.0, 2.0), rng.uniform(0.02, 0.97)
        yield oscillator(b1, (A, B), substeps, share, double, far, coupling="mean")


COUPLINGS = ("gc", "pm", "macro", "mean")


def random_coupler(seed):
    """A chain of up to 12 masses in one to three subdomains, some with lagged damping, with steps
    of 0.05 to 1.2 of the critical one where there is one."""
    rng = np.random.default_rng([seed, 26])
    coupling = COUPLINGS[int(rng.integers(len(COUPLINGS)))]
    cuts = int(rng.integers(0, 3))
    subdomains, limits = [], []
    for i in range(cuts + 1):
        n = int(rng.integers(2, 5))
        k = 10.0 ** rng.uniform(-1.0, 2.0, n)
        K = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
        explicit = bool(rng.random() < 0.5)
        rho = float(rng.uniform(0.5 if explicit and coupling == "mean" else 0.0, 1.0))
        scheme = [ALPHA(rho, explicit=explicit), CD if explicit else pm.Newmark()]
        C = K * 10.0 ** rng.uniform(-3.0, -1.0) if rng.random() < 0.5 else None
        own = pm.Subdomain(
            10.0 ** rng.uniform(-1.0, 1.0, n),
            K,
            C=C,
            scheme=scheme[int(rng.integers(2))],
            substeps=int(rng.choice([1, 2, 6])) if i else 1,
            damping="lagged" if explicit and C is not None and rng.random() < 0.5 else "implicit",
            name=f"s{i}",
        )
        subdomains.append(own)
        limits.append(own.substeps * analysis.critical_step(own))
    if coupling == "pm":  # coarse implicit ones take double steps
        limits = [0.5 * x if s.substeps == 1 else x for x, s in zip(limits, subdomains)]
    longest = min(*limits, 10.0 ** rng.uniform(-1.0, 1.0))
    ties = [pm.tie(a, a.n - 1, b, 0) for a, b in zip(subdomains, subdomains[1:])]
    return pm.Coupler(subdomains, ties, dt=rng.uniform(0.05, 1.2) * longest, coupling=coupling)
