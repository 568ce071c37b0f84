"""Problems of tests/newton_problems.py for the package: one description, two programs."""

import numpy as np
import scipy.sparse as sp
from agreement import assert_close, assert_motion_agrees, largest
from newton_reference import run, run_macro

import pmalpha as pm

# Form of the tangents that the package is given; the reference has dense ones.
FORMS = {"dense": np.asarray, "sparse": sp.csr_array, "diagonal": np.diagonal}


def scheme_of(s):
    return pm.Scheme(s.am, s.af, s.beta, s.gamma, s.explicit)


def internal_of(s, form="dense"):
    """The internal force of a subdomain of the reference, or None."""
    if getattr(s, "internal", None) is None:
        return None

    def evaluate(t, u, v, q):
        f, K_t, C_t, q1 = s.internal(t, u, v, q)
        return f, FORMS[form](K_t), FORMS[form](C_t), q1

    return pm.InternalForce(evaluate, history=s.history)


def package(s, form="dense", **changes):
    """A subdomain of the reference as one of the package."""
    values = dict(
        scheme=scheme_of(s),
        substeps=s.substeps,
        double_step=s.double,
        force=s.force,
        restoring=s.restoring,
        internal=internal_of(s, form),
        symmetric=not getattr(getattr(s, "internal", None), "is_unsymmetric", False),
        u0=s.u0,
        v0=s.v0,
    )
    M, K, C = s.M, s.K, s.C
    values |= changes
    return pm.Subdomain(M, K if K.any() else None, C=C if C.any() else None, **values)


def coupler(subdomains, L, dt, coupling, *, form="dense", **options):
    """A Coupler of subdomains of the reference, named "0", "1", ..."""
    ours = [package(s, form, name=str(i)) for i, s in enumerate(subdomains)]
    tied = {s: Li for s, Li in zip(ours, L) if Li.any()}
    constraints = pm.Constraint(tied) if len(L[0]) else None
    return pm.Coupler(ours, constraints, dt=dt, coupling=coupling, **options)


def oracle(coupling):
    """`run` or `run_macro` of the reference."""
    return run_macro if coupling == "macro" else run


def assert_agrees(history, result, within):
    """u, v, a, q and the multipliers are those of the reference, each relative to its largest."""
    assert_motion_agrees(history, result, within)
    expected = result.multipliers
    named = {"times": history.multiplier_times, "column": "constraint", "size": largest(expected)}
    assert_close(history.multipliers, expected, within, "multiplier", **named)
    for i, (ours, theirs) in enumerate(zip(history, result.subdomains, strict=True)):
        if theirs.q.size:
            named = {"times": ours.t, "column": "number", "size": largest(theirs.q)}
            assert_close(ours.q, theirs.q, within, f"history of subdomain {i}", **named)


def same_bits(one, other):
    """Whether two histories are bitwise equal, all that they recorded included."""
    np.testing.assert_array_equal(one.multipliers, other.multipliers)
    for x, y in zip(one, other, strict=True):
        for name in ("t", "u", "v", "a", "q", "iterations", "deformation", "force"):
            left, right = getattr(x, name), getattr(y, name)
            assert (left is None) == (right is None), name
            if left is not None:
                np.testing.assert_array_equal(left, right, err_msg=name)


# ---- a problem with everything: history, tangents of u and v, double steps, a linear subdomain ---

VARIANTS = {
    "gc": {"coupling": "gc"},
    "pm": {"coupling": "pm", "double": True},
    "macro": {"coupling": "macro"},
    "macro, double step": {"coupling": "macro", "double": True},
}


class Law:
    """A cubic dashpot and bilinear springs along a chain, to the ground at its first dof.

    `calls` counts the evaluations. The one with the number `at` is not made, but `action(t, u, v,
    q)` returns its value.
    """

    def __init__(self, n, k=2e3, yield_at=0.01):
        self.n, self.k, self.yield_at = n, k, yield_at
        self.B = np.eye(n) - np.eye(n, k=-1)
        self.pattern = sp.csr_array(self.B.T @ self.B)
        self.stored = self.pattern.nonzero()
        self.calls, self.at, self.action = 0, None, None

    def __call__(self, t, u, v, q):
        self.calls += 1
        if self.calls == self.at:
            return self.action(t, u, v, q)
        d = self.B @ u
        p = np.minimum(np.maximum(q, d - self.yield_at), d + self.yield_at)
        k = np.where(p == q, self.k, 0.05 * self.k)
        f = self.B.T @ (0.05 * self.k * d + 0.95 * self.k * (d - p)) + 0.2 * v**3
        tangent = self.pattern.copy()  # some times cheaper than an array from a dense one
        tangent.data = (self.B.T @ (k[:, None] * self.B))[self.stored]
        return f, tangent, 0.6 * v**2, p


def plastic_pair(
    variant, *, laws=None, wave=True, newton=None, threads=None, dt=0.02, linear=True, n=5
):
    """Two plastic chains with 1 and 4 substeps, and a linear explicit one with 8, in a row."""
    values = VARIANTS[variant]
    laws = laws or (Law(n), Law(n, k=3e3))
    rng = np.random.default_rng(5)
    names, ss = "abc", (1, 4, 8)
    subdomains = []
    for i in range(3 if linear else 2):
        scheme = pm.GeneralizedAlpha(0.5, explicit=i == 2)
        how = dict(scheme=scheme, substeps=ss[i], name=names[i])
        how |= dict(double_step=bool(values.get("double")) and i == 0)
        how |= dict(v0=np.append(0.0, rng.normal(size=n - 2)).tolist() + [0.0])
        if wave:
            how |= dict(force=lambda t, i=i: (20.0 + i) * np.sin(15.0 * t) * np.ones(n))
        if i < 2:
            how |= dict(internal=pm.InternalForce(laws[i], history=np.zeros(n)))
        K = None if i < 2 else 500.0 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
        subdomains.append(pm.Subdomain(np.ones(n), K, **how))
    ties = [pm.tie(x, [n - 1], y, [0]) for x, y in zip(subdomains, subdomains[1:])]
    return pm.Coupler(
        subdomains,
        ties,
        dt=dt,
        coupling=values["coupling"],
        newton=newton or pm.Newton(),
        threads=threads,
    )


def state_of(c):
    """The state of a coupler as bytes, for comparisons.

    Without the interface velocity that is stored for an iterated subdomain: every substep replaces
    it by L v - G Lam before it is read, (N13).
    """
    states = []
    for part in c._session.members:
        levels = part.core.levels()
        if part.subdomain.iterates:
            levels = {name: x for name, x in levels.items() if not name.endswith("vf")}
        states.append([x.tobytes() for x in levels.values()])
    return c.step_count, c.multipliers.tobytes(), c._session.core.prescribed.tobytes(), states
