"""Problems of tests/newton_problems.py for the package: one description, two programs."""

import numpy as np
import scipy.sparse as sp
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

    def evaluate(u, v, t, q):
        f, K_t, C_t, q1 = s.internal(u, v, t, q)
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
        u0=s.u0,
        v0=s.v0,
    )
    M, K, C = s.M, s.K, s.C
    values |= changes
    return pm.Subdomain(M, K if K.any() else None, C if C.any() else None, **values)


def coupler(subdomains, L, dt, coupling, *, form="dense", **options):
    """A Coupler of subdomains of the reference, named "0", "1", ..."""
    ours = [package(s, form, name=str(i)) for i, s in enumerate(subdomains)]
    tied = {s: Li for s, Li in zip(ours, L) if Li.any()}
    constraints = pm.Constraint(tied) if len(L[0]) else None
    return pm.Coupler(ours, constraints, dt=dt, coupling=coupling, **options)


def oracle(coupling):
    """`run` or `run_macro` of the reference."""
    return run_macro if coupling == "macro" else run


def differences(history, result):
    """Largest differences of u, v, w, q and the multipliers, relative to their largest values."""
    both = [(history.multipliers, result.multipliers)]
    for ours, theirs in zip(history, result.subdomains, strict=True):
        both += [(ours.u, theirs.u), (ours.v, theirs.v), (ours.a, theirs.w)]
        if theirs.q.size:
            both.append((ours.q, theirs.q))
    return max(abs(x - y).max() / abs(y).max() for x, y in both if y.any())


def same_bits(one, other):
    """Whether two histories are bitwise equal, all that they recorded included."""
    np.testing.assert_array_equal(one.multipliers, other.multipliers)
    for x, y in zip(one, other, strict=True):
        for name in ("t", "u", "v", "a", "q", "iterations", "deformation", "force"):
            left, right = getattr(x, name), getattr(y, name)
            assert (left is None) == (right is None), name
            if left is not None:
                np.testing.assert_array_equal(left, right, err_msg=name)
