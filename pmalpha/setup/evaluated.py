"""Springs and internal forces of a subdomain with their tangents, evaluated outside of a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

from .. import _core
from ..problem.compiled import evaluate_compiled
from ..problem.matrices import Matrix, canonical, combination
from ..problem.springs import assembled, core_springs
from ..problem.subdomain import Subdomain
from .tangent_pattern import InternalForces


class Evaluation(NamedTuple):
    """f (n,), df/du and df/dv at one state, in the user's order of dofs."""

    f: np.ndarray
    K: Matrix | None
    C: Matrix | None


def internal_at(
    internal: InternalForces | None,
    n: int,
    u: np.ndarray,
    v: np.ndarray,
    t: float,
    q: np.ndarray,
    *,
    tangent: bool = True,
) -> Evaluation:
    """The functions among the internal forces, at the end of a path from the histories q.

    Without `tangent` K and C are None. What is not finite stays so.

    Raises
    ------
    PmalphaError, and any exception of a function
    """
    f, at = np.zeros(n), 0
    stiff: list[tuple[float, Matrix]] = []
    damped: list[tuple[float, Matrix]] = []
    for function, history, A in () if internal is None else internal.functions:
        own = q[at : at + history]
        at += history
        if isinstance(function, LowLevelCallable):
            force, K, C, _ = evaluate_compiled(function, u, v, t, own, A.nnz)
        else:
            force, K, C, _ = function(u, v, t, own, tangent)
        f += force
        for terms, values in ((stiff, K), (damped, C)):
            if tangent and values is not None:
                terms.append((1.0, sp.csr_array((values, A.indices, A.indptr), shape=A.shape)))
    return Evaluation(f, combination(stiff), combination(damped))


def springs_at(
    s: Subdomain, u: np.ndarray, remembered: np.ndarray | None = None
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Force (n,) of all springs of a subdomain that go to u, and the tangents of each object.

    `remembered`, (fields, springs), is what they remember; None for springs never loaded before.
    """
    ends = np.cumsum([len(spring) for spring in s.springs])
    _, slopes, f = _core.follow_springs(core_springs(s.springs, np.arange(s.n)), u, remembered)
    return f, np.split(slopes, ends[:-1])


def present_tangent(
    s: Subdomain,
    internal: InternalForces | None,
    u: np.ndarray,
    v: np.ndarray,
    t: float,
    q: np.ndarray,
    remembered: np.ndarray | None = None,
    *,
    closed: bool = False,
) -> Matrix | None:
    """K_t of the internal forces of an explicit subdomain, for its critical step.

    Springs count with their initial stiffness or the present one, whichever is larger: one that
    yields will unload. With `closed` it is the largest one, and all contact is closed.
    """
    if s.internal is None:
        return None
    K = internal_at(internal, s.n, u, v, t, q).K
    if closed:
        K = combination([(1.0, K), (1.0, _closing_of_functions(s, u, v, t))])
    if not s.internal.springs:
        return K
    _, tangents = springs_at(s, u, remembered)
    least = [x.largest_tangent if closed else x.initial_tangent for x in s.springs]
    larger = [np.maximum(x, k) for x, k in zip(least, tangents)]
    return combination([(1.0, K), (1.0, matrix_of_springs(s, larger))])


def matrices_at(
    s: Subdomain,
    internal: InternalForces | None,
    u: np.ndarray,
    v: np.ndarray,
    t: float,
    q: np.ndarray,
    remembered: np.ndarray,
) -> tuple[Matrix | None, Matrix | None]:
    """C and K of a subdomain for small motions about a state, estimates of functions included.

    Springs have their tangents there, whatever estimate was given of them; that of functions is
    what K_r is beyond the initial tangents of springs beside them. Springs with a memory count as
    in `present_tangent`: in small motions one that yields unloads.
    """
    forces = internal_at(internal, s.n, u, v, t, q)
    C = [s.C, s.restoring_damping, forces.C]
    K: list[tuple[float, Matrix | None]] = [(1.0, s.K), (1.0, forces.K)]
    if s.has_functions or not s.springs:
        K.append((1.0, s.restoring_stiffness))
    if s.springs:
        tangents = [
            np.maximum(spring.initial_tangent, k) if spring.has_memory else k
            for spring, k in zip(s.springs, springs_at(s, u, remembered)[1])
        ]
        K.append((1.0, matrix_of_springs(s, tangents)))
    if s.has_functions and s.restoring_springs:
        K.append((-1.0, matrix_of_springs(s, [x.initial_tangent for x in s.springs])))
    return combination([(1.0, A) for A in C]), combination(K)


def closing_tangent(s: Subdomain) -> Matrix | None:
    """What springs and contact add to the initial tangent of an explicit subdomain, at most."""
    if s.internal is None or not s.scheme.explicit:
        return None
    K = _closing_of_functions(s, s.u0, s.v0, 0.0)
    rises = [x.largest_tangent - x.initial_tangent for x in s.internal.springs]
    if not any(np.any(rise > 0.0) for rise in rises):
        return K
    return combination([(1.0, K), (1.0, matrix_of_springs(s, rises))])


def _closing_of_functions(s: Subdomain, u: np.ndarray, v: np.ndarray, t: float) -> Matrix | None:
    """The largest tangents of the forces that know them, less the present ones."""
    assert s.internal is not None
    terms: list[tuple[float, Matrix]] = []
    for force in s.internal.forces:
        largest = None if force.largest_tangent is None else force.largest_tangent()
        if largest is not None:
            present = force(u.copy(), v.copy(), t, force.history.copy())[1]
            terms += [(1.0, canonical(largest, "largest_tangent", s.n)[0])]
            terms += [(-1.0, canonical(present, "K_t", s.n)[0])]
    return combination(terms)


def matrix_of_springs(s: Subdomain, tangents: Sequence[np.ndarray]) -> Matrix:
    """The stiffness of all springs of a subdomain with these tangents."""
    return canonical(assembled(s.springs, tangents, s.n), "springs", s.n)[0]
