"""Runs whose true error is known: random chains, and cases with names. For tests and surveys."""

from collections import deque
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import pmalpha as pm


@dataclass
class Case:
    """A coupler, its run, and the true displacements of each subdomain at given times."""

    coupler: pm.Coupler
    steps: int
    true: object

    def estimate(self, halvings):
        return self.coupler.estimate_error(steps=self.steps, halvings=halvings)

    def error(self, history):
        """The true error of a run, relative to the largest displacement."""
        pairs = [(s.u, self.true(i, s.t)) for i, s in enumerate(history.subdomains)]
        return max(np.abs(u - x).max() for u, x in pairs) / max(np.abs(x).max() for _, x in pairs)


def chain(rng):
    """Masses and springs of a chain that is held at its beginning, and the dofs of its subdomains,
    which share one."""
    sizes = rng.integers(2, 5, int(rng.integers(2, 4)))
    begins = np.concatenate([[0], np.cumsum(sizes - 1)])
    n = int(begins[-1]) + 1
    k = 100.0 * 10.0 ** rng.uniform(-0.5, 0.5, n)
    m = 10.0 ** rng.uniform(-0.3, 0.3, n)
    return m, k, [np.arange(a, a + size) for a, size in zip(begins, sizes)]


def stiffness(k, n):
    """Of springs k[i] between mass i - 1 and mass i."""
    K = np.diag(k[:n] + np.append(k[1:n], 0.0))
    return K - np.diag(k[1:n], 1) - np.diag(k[1:n], -1)


def subdomain_of(rng, m, k, dofs, is_last, v, cubic, dt, coupling, name):
    """Masses at borders are halved; cubic springs of a border belong to the subdomain before it."""
    size = dofs.size
    own = m[dofs].copy()
    own[0] *= 1.0 if dofs[0] == 0 else 0.5
    own[-1] *= 1.0 if is_last else 0.5
    springs = k[dofs].copy()
    springs[0] = springs[0] if dofs[0] == 0 else 0.0
    K = stiffness(springs, size)
    explicit = bool(rng.random() < 0.5)
    scheme = pm.GeneralizedAlpha(float(rng.choice([0.5, 0.8, 1.0])), explicit=explicit)
    options = {"scheme": scheme, "v0": v[dofs], "name": name}
    if cubic:
        held = np.arange(0 if dofs[0] == 0 else 1, size)
        laws = [pm.CubicSpring([int(i)], 0.0, cubic) for i in held]
        iterated = coupling == "mean" or (not explicit and rng.random() < 0.5)
        options["internal" if iterated else "restoring"] = laws
    stable = pm.analysis.critical_step(pm.Subdomain(own, K, scheme=scheme)) if explicit else dt
    # cubic springs are stiffer by the motion that they allow
    needed = int(np.ceil(dt / (stable * (0.4 if cubic else 0.8)))) if explicit else 1
    substeps = max(needed, int(rng.choice([1, 2, 5])))
    return pm.Subdomain(own, K, substeps=substeps, **options)


def random_chain(seed, coupling, *, nonlinear):
    rng = np.random.default_rng([seed, 43, nonlinear])
    m, k, parts = chain(rng)
    K = stiffness(k, m.size)
    w2, modes = eigh(K, np.diag(m))
    omega = np.sqrt(w2)
    share = rng.uniform(0.2, 1.0)
    v = modes[:, :2] @ np.array([1.0, share])
    cubic = 0.0
    if nonlinear:  # a force of the size of the linear one
        cubic = float(w2[0] * m.mean() / (np.abs(v).max() / omega[0]) ** 2 * rng.uniform(0.3, 2.0))
    dt = 2.0 * np.pi / omega[1] / 8.0 / 10.0 ** rng.uniform(0.0, 1.0)
    made = [
        subdomain_of(rng, m, k, d, d is parts[-1], v, cubic, dt, coupling, f"s{i}")
        for i, d in enumerate(parts)
    ]
    finest = max(s.substeps for s in made)
    if coupling in ("gc", "pm"):  # numbers of substeps that divide the largest
        for i, s in enumerate(made):
            if s.substeps > 1:
                own = {x: getattr(s, x) for x in ("scheme", "v0", "name", "restoring", "internal")}
                made[i] = pm.Subdomain(s.M, s.K, substeps=finest, **own)
    ties = [pm.tie(a, a.n - 1, b, 0) for a, b in zip(made, made[1:])]
    steps = int(rng.uniform(5.0, 12.0) * 2.0 * np.pi / omega[0] / dt)
    coupler = pm.Coupler(made, ties, dt=dt, coupling=coupling, threads=1)
    true = partial(motion_by_modes, parts, omega, modes, modes.T @ (m * v))
    if nonlinear:
        true = motion_by_integration(parts, m, K, cubic, v, steps * dt)
    return Case(coupler, steps, true)


def motion_by_modes(parts, omega, modes, rates, i, t):
    """u = sum phi sin(omega t) rate / omega"""
    return (np.sin(np.outer(t, omega)) * (rates / omega)) @ modes[parts[i]].T


def motion_by_integration(parts, m, K, cubic, v, end):
    """The function of a subdomain and times; all subdomains share one integration."""
    n = m.size

    def slope(_, y):
        u = y[:n]
        return np.concatenate([y[n:], -(K @ u + cubic * u**3) / m])

    @cache
    def motion():
        start = np.concatenate([np.zeros(n), v])
        # a time level may be above the end by rounding
        span = (0.0, end * (1.0 + 1e-9))
        how = dict(rtol=1e-9, atol=1e-12, dense_output=True)
        return solve_ivp(slope, span, start, "DOP853", **how).sol

    return lambda i, t: motion()(t)[parts[i]].T


# ---- named cases --------------------------------------------------------------------------------


def oscillator(dt, steps, slope, *, longest=0.005, **options):
    """`longest`: step of the integration, so that no event is stepped over."""
    s = pm.Subdomain([1.0], options.pop("K", None), name="m", scheme=pm.Newmark(), **options)
    start = np.concatenate([s.u0, s.v0])

    def true(_, t):
        span = (0.0, t[-1])
        how = dict(rtol=1e-10, atol=1e-13, max_step=longest)
        return solve_ivp(slope, span, start, "DOP853", t, **how).y[:1].T

    return Case(pm.Coupler([s], dt=dt), steps, true)


def cubic(_, y):
    return [y[1], -10.0 * y[0] - 150.0 * y[0] ** 3]


def named_cases():
    spring = pm.CubicSpring([0], 10, 150)
    yield (
        "CubicSpring, restoring, 29 steps a period",
        oscillator(0.036, 490, cubic, restoring=spring, u0=[0.5], longest=np.inf),
    )
    yield (
        "CubicSpring, internal",
        oscillator(0.036, 490, cubic, internal=spring, u0=[0.5], longest=np.inf),
    )
    yield (
        "function of a stop that is never reached, K_r = 1e5",
        oscillator(
            0.01,
            1000,
            lambda t, y: [y[1], -40.0 * y[0]],
            K=[40.0],
            restoring=lambda t, u, v: 1e5 * np.maximum(u - 5.0, 0.0),
            restoring_stiffness=[1e5],
            v0=[1.0],
        ),
    )

    def half_sine(t):
        return np.sin(np.pi * t / 0.01) if t < 0.01 else 0.0

    yield (
        "half sine of 10 ms, period 1 s, dt = 1 ms",
        oscillator(
            1e-3,
            3000,
            lambda t, y: [y[1], half_sine(t) - (2 * np.pi) ** 2 * y[0]],
            K=[(2 * np.pi) ** 2],
            force=lambda t: [half_sine(t)],
        ),
    )
    yield (
        "stop of 1e4, dt = 1e-4",
        oscillator(
            1e-4,
            5000,
            lambda t, y: [y[1], -1e4 * max(y[0] - 0.01, 0.0)],
            K=[0.0],
            restoring=pm.Gap([0], 1e4, 0.01),
            v0=[1.0],
        ),
    )


# ---- cases of which runs warn -------------------------------------------------------------------

STOP, GAP = 1e5, 0.05  # Omega = 3.16 at dt = 0.01


def stopped(_, y):
    return [y[1], -40.0 * y[0] - STOP * max(y[0] - GAP, 0.0)]


def stop(t, u, v):
    return STOP * np.maximum(u - GAP, 0.0)


def watched_cases():
    """A mass at a stop that its steps do not resolve, forces that are wrong, and a mass at rest."""
    forms = {
        "stop, function": {"restoring": stop},
        "stop, function with K_r": {"restoring": stop, "restoring_stiffness": [STOP]},
        "stop, Gap": {"restoring": pm.Gap([0], STOP, GAP)},
        "stop, Gap iterated": {"internal": pm.Gap([0], STOP, GAP)},
        "stop, function iterated": {
            "internal": lambda t, u, v, q: (stop(t, u, v), STOP * np.diag(1.0 * (u > GAP)))
        },
    }
    for name, forces in forms.items():
        yield name, oscillator(0.01, 200, stopped, K=[40.0], v0=[1.0], **forces)
    yield (
        "stop, Gap, dt = 1e-3",
        oscillator(1e-3, 2000, stopped, K=[40.0], v0=[1.0], restoring=pm.Gap([0], STOP, GAP)),
    )
    yield (
        "wrong sign",
        oscillator(
            0.01,
            850,
            lambda t, y: [y[1], -100.0 * y[0]],
            restoring=lambda t, u, v: -100.0 * u,
            u0=[1e-3],
        ),
    )
    past = deque([0.0] * 2, maxlen=2)

    def late(t, u, v):
        past.append(u[0])
        return np.array([100.0 * past[0]])

    yield (
        "delay of one step",
        oscillator(0.005, 1600, lambda t, y: [y[1], -100.0 * y[0]], restoring=late, v0=[1.0]),
    )
    yield (
        "at rest beside a stop, u0 = 3e-20",
        oscillator(0.1, 200, lambda t, y: [y[1], -3.0 * y[0]], K=[3.0], restoring=stop, u0=[3e-20]),
    )
