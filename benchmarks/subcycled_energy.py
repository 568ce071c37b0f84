"""Energy of a bar of two meshes while a pulse crosses from the fine one to the coarse one.

125 elements of 1 mm, 250 of 0.5 mm; a half sine of velocity of 0.01 ms at the fine end, which is
then held. The couplings against nodal subcycling, a plain loop here in which the force of the
coarse elements is kept over their step. Central difference everywhere, the coarse step 0.9 of the
critical one. Energies are E - h^2/8 a.Ma of central difference, relative to the moment at which the
pulse is in.
"""

import numpy as np
from timing import run

import pmalpha as pm
from pmalpha import structures

COARSE, FINE, E, RHO = 125, 250, 210e3, 7.8e-9
C = np.sqrt(E / RHO)
DT = 0.9 * 1.0 / C
PULSE, END = 1e-5, 4.4e-5


def velocity(t):
    return np.sin(np.pi * t / PULSE) if t < PULSE else 0.0


def bars():
    """M, K of the coarse bar, tied at its last node, and of the fine one, driven at its last."""
    made = [structures.rod(COARSE, float(COARSE), EA=E, rhoA=RHO, mass="lumped")]
    made.append(structures.rod(FINE, 0.5 * FINE, EA=E, rhoA=RHO, mass="lumped"))
    return [(x.M.diagonal(), x.K.toarray()) for x in made]


def staggered(M, K, u, v, a, h):
    """E - h^2/8 a.Ma (levels,) of a subdomain."""
    potential = 0.5 * np.einsum("ij,ij->i", u, u @ K)
    return potential + 0.5 * (v**2) @ M - h**2 / 8.0 * (a**2) @ M


def coupled(coupling, ratio):
    """Times and energies of a coupled run, at macro levels."""
    (Ma, Ka), (Mb, Kb) = bars()
    CD = pm.CentralDifference()
    a = pm.Subdomain(Ma, Ka, scheme=CD, name="coarse")
    b = pm.Subdomain(Mb, Kb, scheme=CD, substeps=ratio, name="fine")
    push = np.zeros((1, FINE + 1))
    push[0, -1] = 1.0
    driven = pm.Constraint({b: push}, velocity=lambda t: [velocity(t)])
    coupler = pm.Coupler([a, b], [pm.tie(a, [COARSE], b, [0]), driven], dt=DT, coupling=coupling)
    history = coupler.run(steps=int(END / DT))
    x, y = history["coarse"], history["fine"]
    total = staggered(Ma, Ka, x.u, x.v, x.a, DT)
    every = slice(None, None, ratio)
    total = total + staggered(Mb, Kb, y.u[every], y.v[every], y.a[every], DT / ratio)
    return x.t, total


def nodal(ratio):
    """Nodal subcycling: leapfrog of the fine step, the force of the coarse elements is that of the
    beginning of their step; the interface node belongs to the fine mesh."""
    (Ma, Ka), (Mb, Kb) = bars()
    n, h = COARSE + FINE + 1, DT / ratio
    M, coarse, fine = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    left, right = slice(0, COARSE + 1), slice(COARSE, n)
    M[left] += Ma
    M[right] += Mb
    coarse[left, left], fine[right, right] = Ka, Kb
    u, v = np.zeros(n), np.zeros(n)  # v at half steps
    times, energies = [], []
    v_coarse = np.zeros(COARSE)
    for step in range(int(END / DT)):
        force = coarse @ u
        a = -(force + fine @ u) / M
        half = v.copy()
        half[:COARSE] = v_coarse + 0.5 * DT * a[:COARSE]
        half[COARSE:] = v[COARSE:] + 0.5 * h * a[COARSE:]
        half[-1] = velocity(step * DT)
        times.append(step * DT)
        inertia = np.where(np.arange(n) < COARSE, DT, h) ** 2 / 8.0 * M * a**2
        energy = 0.5 * u @ (coarse + fine) @ u + 0.5 * half**2 @ M - inertia[:-1].sum()
        energies.append(energy)
        v_coarse += DT * a[:COARSE]
        for k in range(ratio):
            a = -(force + fine @ u)[COARSE:] / M[COARSE:]
            v[COARSE:] += h * a
            v[-1] = velocity(step * DT + (k + 0.5) * h)
            u[COARSE:] += h * v[COARSE:]
        u[:COARSE] += DT * v_coarse
    return np.array(times), np.array(energies)


def rows(quick):
    """Relative changes of the energy since 1.2 pulses, by macro level and method."""
    made = []
    for ratio in (2,) if quick else (2, 10):
        runs = {coupling: coupled(coupling, ratio) for coupling in ("gc", "pm", "macro", "mean")}
        runs["nodal"] = nodal(ratio)
        count = min(len(t) for t, _ in runs.values())
        begin = int(np.searchsorted(runs["gc"][0], 1.2 * PULSE))
        for k in range(begin, count):
            changes = {
                name: float(energy[k] / energy[begin] - 1.0) for name, (_, energy) in runs.items()
            }
            made.append({"ratio": ratio, "t us": 1e6 * DT * k, **changes})
    return made


if __name__ == "__main__":
    run("subcycled_energy", rows, about=__doc__)
