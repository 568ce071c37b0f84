"""Runs for what a run warns of: sound ones, realistic ones, and masses that forces throw away.

`sound` and `realistic` are random problems whose steps resolve what is excited, of all couplings,
laws and kinds of load. `thrown` is a chain with a force that its steps may not resolve, or that is
wrong, and how much faster it becomes than its energy allows.
"""

import warnings
from collections import deque
from dataclasses import dataclass

import numpy as np
from error_cases import chain, stiffness
from scipy.linalg import eigh
from scipy.signal import lfilter

import pmalpha as pm
from pmalpha import models, structures

COUPLINGS = ("gc", "pm", "macro", "mean")
LOADS = ("free", "impact", "ramp", "pulse", "sine", "record", "earthquake")


@dataclass
class Run:
    """What is made, for how many macro steps it runs, and the kind of problem."""

    make: object
    steps: int
    kind: str

    def warned(self):
        """The warnings of its set-up and of the run itself, (category, text) each."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            coupler = self.make()
            before = len(caught)
            coupler.run(steps=self.steps)
        words = [(x.category, str(x.message)) for x in caught]
        return words[:before], words[before:]


# ---- loads ---------------------------------------------------------------------------------------


def load_of(rng, kind, m, dt, period, size):
    """A load s(t) of that size on one mass, or the motion of the ground, in the order of dofs:
    a function that returns p and s, or None and samples of a ground acceleration."""
    p = np.zeros(m.size)
    p[int(rng.integers(m.size))] = size
    if kind == "ramp":  # a step moves tied displacements apart
        return p, lambda t: np.minimum(t / (0.2 * period), 1.0)
    if kind == "pulse":
        end = dt * int(rng.integers(8, max(9, int(2.0 * period / dt))))
        return p, lambda t: np.where(t < end, np.sin(np.pi * np.minimum(t, end) / end), 0.0)
    if kind == "sine":
        Omega = 2.0 * np.pi / period * 10.0 ** rng.uniform(-0.7, 0.3)
        return p, lambda t: np.sin(Omega * t)
    samples = lfilter([1.0], [1.0, -1.6, 0.8], rng.normal(size=5000)) / 10.0
    samples *= np.minimum(1.0, np.arange(samples.size) * dt / period)
    return (p, samples) if kind == "record" else (None, samples * size / m.mean())


def force_of(load, dofs, share, dt, M):
    """That load on the dofs of a subdomain, which has this share of it."""
    p, s = load
    if p is None:
        return pm.BaseAcceleration(s, np.ones(dofs.size), np.diag(M), dt=dt)
    own = p[dofs] * share
    if not own.any():
        return None
    return pm.SampledForce(s, dt, own) if isinstance(s, np.ndarray) else lambda t: own * s(t)


# ---- sound runs ----------------------------------------------------------------------------------

LAWS = ("linear", "cubic", "bilinear", "Bouc-Wen", "gap", "dashpot", "clipped", "function")


def law_of(name, dofs, k, u, h, m, iterated):
    """Forces to the ground of masses m on springs k that move by u, for steps h."""
    if name == "cubic":
        return pm.CubicSpring(dofs, 0.0, 0.5 * k / u**2)
    if name == "bilinear":
        return pm.Bilinear(dofs, 0.5 * k, 0.2 * k * u, 0.05)
    if name == "Bouc-Wen":
        return pm.BoucWen(dofs, 0.5 * k, 0.2 * k * u)
    if name == "gap":
        return pm.Gap(dofs, 0.1 * m.min() / h**2, 0.5 * u)  # Omega = 0.3
    k = 0.5 * k

    def force(t, u_, v):
        if name == "dashpot":
            return 0.02 * np.sqrt(k * m) * v
        if name == "clipped":
            return np.clip(k * u_, -0.3 * k * u, 0.3 * k * u)
        return k * u_ * (1.0 + (u_ / u) ** 2)

    if not iterated:
        return force

    def with_tangent(t, u_, v, q):
        if name == "clipped":
            return force(t, u_, v), np.diag(np.where(np.abs(u_) < 0.3 * u, k, 0.0))
        return force(t, u_, v), np.diag(k * (1.0 + 3.0 * (u_ / u) ** 2))

    return with_tangent


def sound(seed):
    rng = np.random.default_rng([seed, 430])
    m, k, parts = chain(rng)
    if rng.random() < 0.3:
        parts = [np.arange(m.size)]
    coupling, law = str(rng.choice(COUPLINGS)), str(rng.choice(LAWS))
    w2, modes = eigh(stiffness(k, m.size), np.diag(m))
    period = 2.0 * np.pi / np.sqrt(w2[0])
    dt = 2.0 * np.pi / np.sqrt(w2[1]) / 10.0 ** rng.uniform(1.3, 2.0)
    kind = str(rng.choice(LOADS))
    shape = modes[:, :2] @ np.array([1.0, rng.uniform(0.0, 0.5)])
    v = shape if kind == "free" else np.zeros(m.size)
    if kind == "impact":
        v[int(rng.integers(m.size))] = 1.0
    u = 1.0 / np.sqrt(w2[0] * m.mean())
    load = None
    if kind not in ("free", "impact"):
        load = load_of(rng, kind, m, dt, period, k.mean() * u)
    fine = int(rng.choice([2, 5]))
    made = [
        sound_subdomain(
            rng, m, k, parts, i, dt, coupling, law, (u, w2[0] * m.mean()), v, load, fine
        )
        for i in range(len(parts))
    ]
    ties = [pm.tie(a, a.n - 1, b, 0) for a, b in zip(made, made[1:])]
    options = {"coupling": coupling, "threads": 1} if len(made) > 1 else {"threads": 1}
    steps = min(300, int(rng.uniform(2.0, 5.0) * period / dt))
    words = f"{coupling} {len(made)} {law} {kind}"
    return Run(lambda: pm.Coupler(made, ties, dt=dt, **options), steps, words)


def sound_subdomain(rng, m, k, parts, i, dt, coupling, law, scales, v, load, fine):
    """Masses at borders are halved; the law of a border belongs to the subdomain before it."""
    dofs, (u, stiff) = parts[i], scales
    own, share = m[dofs].copy(), np.ones(dofs.size)
    if i > 0:
        share[0] = 0.5
    if i < len(parts) - 1:
        share[-1] = 0.5
    own *= share
    springs = k[dofs].copy()
    springs[0] *= i == 0
    K = stiffness(springs, dofs.size)
    explicit = bool(rng.random() < 0.4)
    rho = 1.0 if coupling == "mean" else float(rng.choice([0.5, 0.8, 1.0]))
    scheme = pm.GeneralizedAlpha(rho, explicit=explicit)
    substeps = int(rng.choice([1, fine]))
    if explicit:  # with the springs of the law, of up to half the stiffness and more as they harden
        stable = pm.analysis.critical_step(
            pm.Subdomain(own, K + stiff * np.eye(dofs.size), scheme=scheme)
        )
        needed = int(np.ceil(dt / (0.4 * stable)))
        if needed > 1 and coupling in ("gc", "pm"):  # numbers that divide the largest
            substeps = fine
            scheme = scheme if needed <= fine else pm.GeneralizedAlpha(rho)
        elif needed > 1:
            substeps = needed
    options = {"scheme": scheme, "v0": v[dofs], "name": f"s{i}", "substeps": substeps}
    if load is not None:
        options["force"] = force_of(load, dofs, share, dt, own)
    # evaluated once they would be combined with substeps under "macro"
    iterated = coupling in ("macro", "mean") or (not scheme.explicit and rng.random() < 0.5)
    springs_on = [int(d) for d in (range(dofs.size) if i == 0 else range(1, dofs.size))]
    if law == "linear":
        return pm.Subdomain(own, K, C=0.01 * K / np.sqrt(k.mean()), **options)
    if law in ("dashpot", "clipped", "function"):
        springs_on = list(range(dofs.size))
        iterated = iterated and law != "dashpot"
        if law == "dashpot" and coupling in ("macro", "mean"):
            return pm.Subdomain(own, K, **options)
    forces = law_of(law, springs_on, stiff, u, dt / substeps, own, iterated)
    return pm.Subdomain(own, K, **options, **{"internal" if iterated else "restoring": forces})


# ---- realistic runs ------------------------------------------------------------------------------


def cantilever(rng):
    beam = structures.beam_frame(
        [[0.0, 0.0], [4.0, 0.0]],
        [[0, 1]],
        EA=210e9 * 0.01,
        EI=210e9 * 1e-5,
        rhoA=78.5,
        divisions=int(rng.integers(4, 16)),
        mass=str(rng.choice(["consistent", "lumped"])),
    )
    return beam, beam.nodes_at(x=0.0), ("ux", "uy")


def portal(rng):
    storeys = int(rng.integers(1, 4))
    points = [[x, 3.5 * y] for y in range(storeys + 1) for x in (0.0, 6.0)]
    columns = [[2 * y + x, 2 * y + x + 2] for y in range(storeys) for x in (0, 1)]
    girders = [[2 * y, 2 * y + 1] for y in range(1, storeys + 1)]
    frame = structures.beam_frame(
        points,
        columns + girders,
        EA=3e9,
        EI=3e7 * 10.0 ** rng.uniform(-0.5, 1.0),
        rhoA=np.append(np.full(len(columns), 150.0), np.full(storeys, 5000.0)),
        divisions=int(rng.integers(1, 4)),
        mass=str(rng.choice(["consistent", "lumped"])),
    )
    return frame, frame.nodes_at(y=0.0), ("ux", "uy")


def plate(rng):
    wall = structures.plate(int(rng.integers(3, 7)), 2, 0.5, E=30e9, nu=0.2, rho=2500.0, t=0.2)
    return wall, wall.nodes_at(x=0.0), ("ux", "uy")


def solid(rng):
    block = structures.solid(int(rng.integers(3, 6)), 1, 1, 0.5, E=30e9, nu=0.2, rho=2500.0)
    return block, block.nodes_at(x=0.0), ("ux", "uz")


def rod(rng):
    bar = structures.rod(int(rng.integers(20, 60)), 10.0, EA=2e9, rhoA=80.0, mass="lumped")
    return bar, bar.nodes_at(x=0.0), ("ux",)


def realistic(seed):
    """A structure of finite elements, whole or cut in two, at 20 to 200 steps a period."""
    rng = np.random.default_rng([seed, 431])
    make = (cantilever, portal, plate, solid, rod)[seed % 5]
    structure, held, components = make(rng)
    fixed = structure.dofs(held)
    free = np.setdiff1d(np.arange(structure.n), fixed)
    M, K = (A.toarray()[np.ix_(free, free)] for A in (structure.M, structure.K))
    w2, modes = eigh(K, M)
    omega = np.sqrt(w2[[0, min(3, free.size - 1)]])
    period = 2.0 * np.pi / omega[0]
    dt = period / 10.0 ** rng.uniform(1.3, 2.3)
    ratio = float(rng.choice([0.0, 0.01, 0.05]))
    kind = str(rng.choice(LOADS))
    u0, v0, r = np.zeros(structure.n), np.zeros(structure.n), np.zeros(structure.n)
    r[structure.dofs(np.arange(len(structure.points)), components[0])] = 1.0
    r[fixed] = 0.0
    if kind == "free":
        u0[free] = modes[:, :3] @ np.array([1.0, 0.3, 0.1]) if free.size > 3 else modes[:, 0]
    if kind == "impact":
        v0[int(rng.choice(free))] = 1.0
    force = None
    if kind not in ("free", "impact"):
        p, s = load_of(rng, kind, np.ones(free.size), dt, period, 1e4)
        shape = -(structure.M @ r) if p is None else np.zeros(structure.n)
        if p is not None:
            shape[free] = p
        force = (
            pm.SampledForce(s, dt, shape) if isinstance(s, np.ndarray) else lambda t: shape * s(t)
        )
    centres = np.concatenate(
        [structure.points[e].mean(axis=1) for e in structure.elements.values()]
    )
    coupling = str(rng.choice(COUPLINGS))
    rho = 1.0 if coupling == "mean" else 0.8  # others can grow there with damping
    labels, schemes = np.zeros(len(centres), dtype=int), [pm.GeneralizedAlpha(rho)]
    if rng.random() < 0.6:
        labels[np.argsort(centres.sum(axis=1))[len(centres) // 2 :]] = 1
        lumped = structure.M.nnz == np.count_nonzero(structure.M.diagonal())
        explicit = lumped and rng.random() < 0.6
        schemes.append(pm.CentralDifference() if explicit else pm.GeneralizedAlpha(rho))
    parts = pm.cut(
        structure,
        labels,
        dt=dt,
        scheme=schemes,
        force=force,
        u0=u0,
        v0=v0,
        rayleigh=models.rayleigh(list(omega), [ratio, ratio]) if ratio else None,
        fixed=fixed,
    )
    steps = min(1000, int(rng.uniform(2.0, 6.0) * period / dt))
    words = f"{make.__name__} {coupling} {len(schemes)} {kind}"
    return Run(lambda: parts.coupler(coupling=coupling), steps, words)


# ---- energy that forces add ----------------------------------------------------------------------

THROWN = (
    "function",
    "function with K_r",
    "Gap",
    "iterated Gap",
    "iterated function",
    "cubic function",
    "wrong sign",
    "delay",
)


def forces_of(name, n, k, gap, late):
    """Forces on the last of n masses, stops of stiffness k and others."""
    last = np.zeros(n)
    last[-1] = 1.0

    def stop(t, u, v):
        return k * np.maximum(u - gap, 0.0) * last

    if name == "function":
        return {"restoring": stop}
    if name == "function with K_r":
        return {"restoring": stop, "restoring_stiffness": np.diag(k * last)}
    if name == "Gap":
        return {"restoring": pm.Gap([n - 1], k, gap)}
    if name == "iterated Gap":
        return {"internal": pm.Gap([n - 1], k, gap)}
    if name == "iterated function":
        return {"internal": lambda t, u, v, q: (stop(t, u, v), np.diag(k * last * (u > gap)))}
    if name == "cubic function":
        return {"restoring": lambda t, u, v: k * u * (u / gap) ** 2 * last}
    if name == "wrong sign":
        return {"restoring": lambda t, u, v: -k * u * last}
    past = deque([0.0] * (late + 1), maxlen=late + 1)

    def delayed(t, u, v):
        past.append(u[-1])
        return k * past[0] * last

    return {"restoring": delayed}


def thrown(seed):
    """A run, and from its History how much its largest kinetic energy is above the energy at the
    start, over the largest energy of motion and linear springs.

    Energies of the forces are not negative, but for the wrong sign, and zero at the start.
    """
    rng = np.random.default_rng([seed, 432])
    name, n = THROWN[seed % len(THROWN)], int(rng.integers(1, 5))
    K = stiffness(10.0 ** rng.uniform(-0.3, 0.3, n), n)
    w2, modes = eigh(K)
    explicit = bool(rng.random() < 0.4) and "K_r" not in name
    rho = float(rng.choice([0.0, 0.5, 0.8, 1.0]))
    scheme = pm.Newmark() if rng.random() < 0.3 else pm.GeneralizedAlpha(rho, explicit=explicit)
    # all modes are resolved
    h = 2.0 * np.pi / np.sqrt(w2[-1]) / 10.0 ** rng.uniform(1.3, 2.0)
    size = 1.0 / np.sqrt(w2[0])
    weak = name in ("wrong sign", "delay")
    k = (
        w2[0] * 10.0 ** rng.uniform(-0.5, 0.5)
        if weak
        else (10.0 ** rng.uniform(-0.7, 1.0) / h) ** 2
    )
    gap = size * abs(modes[-1, 0]) * rng.uniform(0.05, 0.9)
    v0 = modes[:, 0] * (1.0 if modes[-1, 0] > 0.0 else -1.0)

    def make():
        forces = forces_of(name, n, k, gap, int(rng.integers(1, 4)))
        part = pm.Subdomain(np.ones(n), K, scheme=scheme, v0=v0, name="ball", **forces)
        with warnings.catch_warnings():  # of critical steps
            warnings.simplefilter("ignore", pm.StabilityWarning)
            return pm.Coupler([part], dt=h)

    steps = min(1000, int(3.0 * 2.0 * np.pi / np.sqrt(w2[0]) / h))
    words = f"{name} {scheme!r} Omega={np.sqrt(k) * h:.2f}"
    return Run(make, steps, words), lambda x: gain_of(x, K)


def gain_of(history, K):
    x = history["ball"]
    T = 0.5 * np.sum(x.v**2, axis=1)
    U = 0.5 * np.sum(x.u * (x.u @ K), axis=1)
    fastest = np.maximum.accumulate(T) <= T
    return float((T.max() - T[0] - U[0]) / (T + U)[fastest].max())


# ---- forces that are too stiff, cut structures, double steps -------------------------------------

TOO_STIFF = ("function", "dashpot", "low estimate", "controller", "damping controller", "spring")


def too_stiff(name, n, k, h):
    """Forces on the last of n masses of stiffness k, or of a dashpot with as much of the step h."""
    last, c = np.eye(n)[-1], 0.5 * k * h
    if name == "function":
        return {"restoring": lambda *x: k * _motion(x)[0] * last}
    if name == "dashpot":
        return {"restoring": lambda *x: c * _motion(x)[1] * last}
    if name == "low estimate":
        stiff = {"restoring": lambda *x: (k + 4.0 / h**2) * _motion(x)[0] * last}
        return stiff | {"restoring_stiffness": np.diag(last) * 4.0 / h**2}
    if name == "controller":
        return {"force": lambda t, u, v: -k * u * last}
    if name == "damping controller":
        return {"force": lambda t, u, v: -c * v * last}
    return {"restoring": pm.CubicSpring([n - 1], k, 0.0)}


def _motion(x):
    """u and v of the arguments of a restoring function."""
    return x[-2:] if np.ndim(x[0]) == 0 else x[:2]


def grown(seed):
    """Two chains that are tied, with a force that is too stiff or thrown on the first; and the gain
    of energy of both, from their History, with the steps of the force over what it allows.

    Under "pm" the first takes double steps where it is implicit.
    """
    rng = np.random.default_rng([seed, 433])
    n, coupling = int(rng.integers(1, 4)), str(rng.choice(["gc", "pm", "pm", "alone"]))
    names = TOO_STIFF + THROWN[:6]
    name = names[seed % len(names)]
    K = stiffness(10.0 ** rng.uniform(-0.3, 0.3, n), n)
    w2, modes = eigh(K)
    explicit = bool(rng.random() < 0.4) and name not in ("low estimate", "function with K_r")
    rho = float(rng.choice([0.5, 0.8, 1.0]))
    scheme = pm.Newmark() if rng.random() < 0.3 else pm.GeneralizedAlpha(rho, explicit=explicit)
    h = 2.0 * np.pi / np.sqrt(w2[-1]) / 10.0 ** rng.uniform(1.3, 2.0)
    Omega = 10.0 ** rng.uniform(0.0, 0.9)
    gap = abs(modes[-1, 0]) / np.sqrt(w2[0]) * rng.uniform(0.05, 0.9)
    v0 = modes[:, 0] * (1.0 if modes[-1, 0] > 0.0 else -1.0)
    substeps = int(rng.choice([1, 2, 4]))

    def make():
        k = (Omega / h) ** 2
        forces = too_stiff(name, n, k, h) if name in TOO_STIFF else forces_of(name, n, k, gap, 1)
        options = {"scheme": scheme, "v0": v0, "name": "a"}
        with warnings.catch_warnings():  # of critical steps
            warnings.simplefilter("ignore", pm.StabilityWarning)
            a = pm.Subdomain(np.ones(n), K, **options, **forces)
            if coupling == "alone":
                return pm.Coupler([a], dt=h)
            b = pm.Subdomain(
                [0.5, 1.0],
                np.array([[1.0, -1.0], [-1.0, 2.0]]),
                scheme=pm.GeneralizedAlpha(0.8),
                v0=[v0[0], 0.0],
                substeps=substeps,
                name="b",
            )
            return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=h, coupling=coupling)

    steps = min(400, int(3.0 * 2.0 * np.pi / np.sqrt(w2[0]) / h))
    return Run(make, steps, f"{coupling} {name} {scheme!r} Omega={Omega:.2f}"), gain_of_both


def gain_of_both(history):
    """As gain_of, of all subdomains at macro time levels."""
    T = U = 0.0
    for x, s in zip(history.subdomains, (s for _, s in history.keys)):
        every = (len(x.t) - 1) // (len(history.macro_times) - 1)
        K = s.K if s.K.ndim == 2 else np.diag(s.K)
        T = T + 0.5 * np.sum(x.v[::every] ** 2 * s.M, axis=1)
        U = U + 0.5 * np.sum(x.u[::every] * (x.u[::every] @ K), axis=1)
    fastest = np.maximum.accumulate(T) <= T
    return float((T.max() - T[0] - U[0]) / (T + U)[fastest].max())
