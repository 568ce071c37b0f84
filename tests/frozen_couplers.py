"""Couplers that are frozen, by name: each coupling, with and without springs."""

import numpy as np
import scipy.sparse as sp

import pmalpha as pm

COUPLINGS = ("gc", "pm", "macro", "mean")
SPRINGS = {
    "none": None,
    "bilinear": lambda: pm.Bilinear([(0, 1), (-1, 2)], k=40.0, fy=2.0, hardening=0.1),
    "cubic": lambda: pm.CubicSpring([0, 2], k=10.0, k3=500.0),
    "gap": lambda: pm.Gap([(-1, 1), (1, 2)], k=300.0, gap=0.02),
    "damped cubic": lambda: pm.CubicSpring([(-1, 1), (1, 2)], k=30.0, k3=50.0, c=0.5),
    "damped gap": lambda: pm.Gap([(-1, 1), (1, 2)], k=300.0, gap=0.02, c=5.0),
}


def chain(n, k):
    return (
        sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]) * k
    )


def plate(n):
    """A square of masses with springs between neighbours, n of them, sparse."""
    side = round(n**0.5)
    one, K = sp.eye_array(side), chain(side, 300.0)
    return sp.csr_array(sp.kron(one, K) + sp.kron(K, one))


def frame(coupling, springs="none", *, force=None, restoring=None, velocity=None, dt=0.02, **rest):
    """A frame of three masses, "a", and a shaft of two, "b", of more substeps, 3 or `fine`.

    force: of "a"; restoring: further functions of "a"; velocity: of its first dof, prescribed.
    """
    K = chain(3, 200.0).toarray()
    fine = rest.pop("fine", 3)
    forces = [SPRINGS[springs]()] if SPRINGS[springs] else []
    forces += restoring if isinstance(restoring, list) else [] if restoring is None else [restoring]
    a = pm.Subdomain(
        np.array([1.0, 2.0, 1.5]),
        K,
        C=0.002 * K,
        scheme=pm.GeneralizedAlpha(1.0 if coupling == "mean" else 0.8),
        u0=[0.05 if velocity is None else 0.0, -0.02, 0.03],
        v0=[0.0, 1.0, -0.5],
        restoring=forces or None,
        force=force,
        substeps=rest.pop("substeps", 1),
        name="a",
        **rest,
    )
    b = pm.Subdomain(
        np.array([0.5, 0.7]),
        chain(2, 900.0).toarray(),
        scheme=pm.GeneralizedAlpha(0.9, explicit=coupling in ("gc", "pm")),
        u0=[0.03, 0.0],
        v0=[-0.5, 0.2],
        substeps=fine,
        name="b",
    )
    constraints = [pm.tie(a, [2], b, [0])]
    if velocity is not None:
        constraints.append(pm.Constraint({a: [[1.0, 0.0, 0.0]]}, velocity=velocity))
    return pm.Coupler([a, b], constraints, dt=dt, coupling=coupling)


def bouncing():
    """A mass that falls on a stop, and comes back with half of its velocity."""
    a = pm.Subdomain([1.0], [40.0], scheme=pm.GeneralizedAlpha(0.8), u0=[0.1], name="a")
    return pm.Coupler([a], pm.contact(a, 0, gap=0.02, restitution=0.5), dt=0.01)


def iterated(coupling, n=3, substeps=1, **options):
    """A chain with yielding springs that Newton's method solves for, tied to a mass."""
    K = chain(n, 60.0)
    springs = pm.Bilinear(np.arange(0, n, 2), k=40.0, fy=0.1)
    a = pm.Subdomain(
        np.ones(n),
        K.toarray() if n < 20 else plate(n),
        scheme=pm.GeneralizedAlpha(0.8),
        internal=springs,
        v0=np.cos(np.arange(n)),
        substeps=substeps,
        name="a",
    )
    b = pm.Subdomain([1.0], [30.0], scheme=pm.GeneralizedAlpha(0.8), v0=a.v0[-1:], name="b")
    ties = pm.tie(a, [n - 1], b, [0])
    return pm.Coupler([a, b], ties, dt=0.04, coupling=coupling, **options)


def full(coupling, n, ties):
    """Masses with cubic springs between all pairs, full matrices, on the first dofs of a frame.

    Their tangents are factored in a panel: no band holds them for n > 33.
    """
    rng = np.random.default_rng(n)
    pairs = [(i, j) for i in range(n) for j in range(i)]
    springs = pm.CubicSpring(
        pairs, k=1.0 + rng.random(len(pairs)), k3=200.0 * rng.random(len(pairs))
    )
    v0 = np.round(np.cos(np.arange(n)), 3)
    mass, stiffness = 2.0 + 1.0 / (1.0 + np.arange(n)), 20.0 * np.eye(n) + 0.3
    a = pm.Subdomain(
        np.diag(mass) + 0.1,
        stiffness,
        scheme=pm.GeneralizedAlpha(0.8),
        internal=springs,
        v0=v0,
        name="a",
    )
    b = pm.Subdomain(
        np.eye(ties + 1) + 0.01,
        30.0 * np.eye(ties + 1) + 0.7,
        scheme=pm.GeneralizedAlpha(0.8),
        v0=np.append(v0[:ties], 0.0),
        name="b",
    )
    dofs = np.arange(ties)
    return pm.Coupler([a, b], pm.tie(a, dofs, b, dofs), dt=0.02, coupling=coupling)


def all_outputs(coupler):
    """u, v, a of all dofs, and the multipliers, in the order of `recorded`."""
    ports = {}
    for name, s in coupler._session.keys:
        for what in "uva":
            ports |= {f"{name}.{what}.d{i}": (what, name, i) for i in range(s.n)}
    ports |= {f"multiplier{i}": ("multiplier", i) for i in range(coupler._session.rows.p)}
    return ports


def recorded(coupler, history, fine):
    """What a run has recorded at fine steps, in the order of `all_outputs`, held in between."""
    columns = []
    for name, _ in coupler._session.keys:
        for what in "uva":
            columns.append(held(getattr(history[name], what), fine))
    columns.append(held(history.multipliers, fine))
    return np.concatenate(columns, axis=1)


def held(levels, fine):
    """Values of time levels at `fine` steps: of the last level, if these are fewer, or of each."""
    count = len(levels) - 1
    return levels[np.arange(fine + 1) * count // fine]
