"""Internal forces and springs outside of a step: values, tangents, and patterns for the core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy import LowLevelCallable

import pmalpha._core as _core

from ..memory import gemm_and_trsm, require
from ..problem import forms
from ..problem.arguments import evaluate_compiled
from ..problem.forms import Numeric, Supernodes
from ..problem.internal import InternalForce
from ..problem.matrices import (
    Matrix,
    canonical,
    combination,
    core_matrix,
    core_sparse,
    row_of_entries,
    sparse,
)
from ..problem.springs import assembled, core_springs, stiffness
from ..problem.subdomain import Subdomain
from ..problem.tangents import (
    CheckedInternal,
    Slots,
    entries_of,
    first_tangent,
    histories,
    keys_of,
    symmetric_union,
)
from ..reduction.ordering import Graph, elimination_order, graph_of, rows_of
from .factors import Structure, structure_of

# The core factors tangents as a band up to this half width, if that has at most this many times the
# entries of the panels (numeric.c); calls of BLAS for a few columns each take longer.
NARROW = 32
WORTH_A_BAND = 2
Group = Sequence[tuple[InternalForce, str]]


@dataclass(frozen=True)
class InternalForces:
    """The internal forces of a subdomain, in the user's order of dofs."""

    # each function for the core, the numbers in its history, and the pattern of its tangents
    functions: tuple[tuple[Any, int, sp.csr_array], ...]
    initial: np.ndarray  # (m,) array, the histories at t = 0, of one function after the other
    pattern: sp.csr_array  # of Mbar with all tangents: symmetric, with the diagonal, all values 1
    # K, C: the tangents at t = 0
    K: Matrix | None
    C: Matrix | None


def internal_forces(s: Subdomain, name: str) -> InternalForces | None:
    """The internal forces of a subdomain, each evaluated once, at t = 0."""
    if s.internal is None:
        return None
    pairs = list(zip(s.internal.forces, s.internal.labels))
    # Python functions are one function of the core; beside compiled ones each is one, in its place
    groups = [[pair] for pair in pairs] if any(_is_compiled(f) for f, _ in pairs) else [pairs]
    groups = [group for group in groups if group]
    evaluated = [_tangents(group, s, name) for group in groups]
    functions = tuple(
        _function(group, name, pattern, C is not None, s.symmetric)
        for group, (pattern, _, C) in zip(groups, evaluated)
    )
    springs = None
    if s.internal.springs:
        K_s = stiffness(s.internal.springs, "initial_tangent", s.n)
        springs = canonical(K_s, "springs", s.n)[0]
    matrices = (s.M, s.implicit_damping, s.implicit_stiffness)
    patterns = [entries_of(A, s.n) for A in matrices if A is not None]
    patterns += [pattern for pattern, _, _ in evaluated] + _pairs(s)
    return InternalForces(
        functions,
        np.concatenate([np.zeros(0), *(histories(_forces(group))[0] for group in groups)]),
        symmetric_union(patterns, s.n),
        combination([(1.0, springs), *((1.0, _matrix(p, K)) for p, K, _ in evaluated)]),
        combination([(1.0, _matrix(p, C)) for p, _, C in evaluated if C is not None]),
    )


def _is_compiled(force: InternalForce) -> bool:
    return isinstance(force.evaluate, LowLevelCallable)


def _forces(group: Group) -> list[InternalForce]:
    return [force for force, _ in group]


def _tangents(group: Group, s: Subdomain, name: str) -> tuple[Any, ...]:
    forces, labels = _forces(group), [label for _, label in group]
    q0 = histories(forces)[0]
    return first_tangent(forces, s.n, s.u0, s.v0, q0, name, labels, symmetric=s.symmetric)


def _function(
    group: Group, name: str, pattern: sp.csr_array, damped: bool, symmetric: bool
) -> tuple[Any, int, sp.csr_array]:
    """The function of the core for a compiled force, or for Python ones together."""
    forces = _forces(group)
    if _is_compiled(forces[0]):
        assert forces[0].pattern is not None
        return forces[0].evaluate, forces[0].history.size, forces[0].pattern
    labels = [label for _, label in group]
    checked = CheckedInternal(forces, name, pattern, damped, labels, symmetric=symmetric)
    return checked, checked.history.size, pattern


def _matrix(pattern: sp.csr_array, values: np.ndarray) -> sp.csr_array:
    return sp.csr_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)


def _pairs(s: Subdomain) -> list[sp.csr_array]:
    """The entries of springs, also of those without an initial stiffness."""
    assert s.internal is not None
    pairs = np.concatenate([np.zeros((0, 2), int), *(x.dofs for x in s.internal.springs)])
    both = pairs[(pairs >= 0).all(axis=1)]
    return [sp.csr_array((np.ones(len(both)), both.T), shape=(s.n, s.n))]


# ---- the elimination of a tangent --------------------------------------------------------------


@dataclass(frozen=True)
class TangentPattern:
    """The pattern of Mbar with all tangents in elimination order, with its structure."""

    order: np.ndarray  # (n,) array of int, dof at each position; the interface dofs last
    pattern: sp.csr_array  # in elimination order, all values 1
    nb: int  # number of interface dofs
    # the panels of the factor; None where the pattern is the diagonal
    structure: Supernodes | None

    @property
    def symbolic(self) -> Structure:
        """The structure for the factor of M."""
        return structure_of(*core_sparse(self.pattern)[:2], self.nb)

    @property
    def entries(self) -> int:
        """Entries of the factor, with the diagonal."""
        return self.order.size if self.structure is None else int(self.structure[3][-1])

    def core(self, name: str, symmetric: bool, scratch: float) -> Numeric:
        """Pattern and structure in the form of the core, where their memory is there, and bytes of
        scratch."""
        what = f"the tangent of {name!r}"
        return numeric(self.pattern, self.structure, what, symmetric, scratch)

    def values(self, A: Matrix | None) -> np.ndarray:
        """The values on the pattern of a matrix in elimination order."""
        values = np.zeros(self.pattern.nnz)
        if A is None:
            return values
        A = sparse(A, A.shape[0])
        where, _ = Slots(self.pattern).of(keys_of(A))
        values[where] = A.data
        return values

    def places(self, pattern: sp.csr_array) -> np.ndarray:
        """The index in the values of each entry of a pattern in the user's order."""
        position = np.argsort(self.order)
        rows = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
        n = self.order.size
        keys = position[rows].astype(np.int64) * n + position[pattern.indices]
        return Slots(self.pattern).of(keys)[0].astype(np.int64)


def tangent_pattern(pattern: sp.csr_array, last: np.ndarray) -> TangentPattern:
    """The elimination of a pattern in the user's order, with the interface dofs last."""
    n = pattern.shape[0]
    order = elimination_order(n, graph_of([pattern]) if pattern.nnz > n else None, last)
    elimination = _in_order(pattern, order, last.size)
    if elimination.structure is None:
        return elimination
    order, width = narrow_order(pattern, last)
    few = n * (width + 1) <= WORTH_A_BAND * elimination.structure[3][-1]
    return _in_order(pattern, order, last.size) if width <= NARROW and few else elimination


def _in_order(pattern: sp.csr_array, order: np.ndarray, nb: int) -> TangentPattern:
    ptr, index = rows_of(Graph(*core_sparse(pattern)[:2]), order)
    ordered = sp.csr_array((np.ones(index.size), index, ptr), shape=pattern.shape)
    ordered.sort_indices()
    return TangentPattern(order, ordered, nb, structure(ordered, nb))


def narrow_order(pattern: sp.csr_array, last: np.ndarray) -> tuple[np.ndarray, int]:
    """The order in the narrowest band found, with the interface dofs last, and its half width.

    Among the natural order, that of Cuthill and McKee, and both reversed.
    """
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = pattern.shape[0]
    entries = pattern.tocoo()
    border = np.zeros(n, dtype=bool)
    border[last] = True
    natural, other = np.arange(n), reverse_cuthill_mckee(sp.csr_matrix(pattern), True)
    best, least = natural, n
    for order in (natural, natural[::-1], other.astype(np.int64), other[::-1].astype(np.int64)):
        order = np.concatenate([order[~border[order]], last])
        position = np.argsort(order)
        width = int(np.max(np.abs(position[entries.row] - position[entries.col])))
        if width < least:
            best, least = order, width
    return best, least


def structure(pattern: sp.csr_array, nb: int) -> Supernodes | None:
    """The panels of the factor of a pattern in elimination order; None for a diagonal."""
    if pattern.nnz == pattern.shape[0]:
        return None
    return Supernodes(*_core.supernodes(*core_sparse(pattern)[:2], nb))


def numeric(
    pattern: sp.csr_array,
    panels: Supernodes | None,
    what: str,
    symmetric: bool,
    scratch: float = 0.0,
) -> Numeric:
    """What the core factors again and again."""
    panel = 8.0 if symmetric else 16.0
    size = 8.0 * pattern.nnz + (0.0 if panels is None else panel * float(panels[3][-1])) + scratch
    require(size, f"the factor of {what} ({pattern.shape[0]} rows)")
    ptr, index, _ = core_sparse(pattern)
    return Numeric(ptr, index, panels, *gemm_and_trsm(), not symmetric)


def core_internal(
    forces: InternalForces, order: np.ndarray, tangent: TangentPattern | None, symmetric: bool
) -> forms.Internal:
    """The forces for the core; without tangents in an explicit subdomain.

    If the tangents have to be `symmetric`, the core checks those of compiled functions;
    `CheckedInternal` checks the others.
    """
    functions = tuple(
        forms.InternalForce(
            function,
            history,
            None if tangent is None else tangent.places(pattern),
            across(pattern) if symmetric and isinstance(function, LowLevelCallable) else None,
            function.potential if isinstance(function, CheckedInternal) else None,
        )
        for function, history, pattern in forces.functions
    )
    return forms.Internal(order.astype(np.int64), forces.initial, functions)


def across(pattern: sp.csr_array) -> np.ndarray:
    """The index of the entry (j, i) for each entry (i, j) of a pattern, or -1 if there is none."""
    keys = keys_of(pattern)
    order = np.argsort(keys)
    wanted = pattern.indices.astype(np.int64) * pattern.shape[0] + row_of_entries(pattern)
    places = np.minimum(np.searchsorted(keys, wanted, sorter=order), keys.size - 1)
    candidates = order[places]
    return np.where(keys[candidates] == wanted, candidates, -1).astype(np.int64)


def core_size(M: Matrix | None, symmetric: bool = True) -> Any:
    """The size of the entries of M, in the form of the core."""
    return core_matrix(None if M is None else abs(M), symmetric=symmetric)


class Evaluation(NamedTuple):
    """f (n,), df/du and df/dv at one state, in the user's order of dofs."""

    f: np.ndarray
    K: Matrix | None
    C: Matrix | None


def internal_at(
    internal: InternalForces | None,
    n: int,
    t: float,
    u: np.ndarray,
    v: np.ndarray,
    q: np.ndarray,
    *,
    tangent: bool = True,
) -> Evaluation:
    """The functions among the internal forces, at the end of a path from the histories q. Without
    `tangent` K and C are None. What is not finite stays so."""
    f, at = np.zeros(n), 0
    stiff: list[tuple[float, Matrix]] = []
    damped: list[tuple[float, Matrix]] = []
    for function, history, A in () if internal is None else internal.functions:
        q0 = q[at : at + history]
        at += history
        if isinstance(function, LowLevelCallable):
            force, K, C, _ = evaluate_compiled(function, t, u, v, q0, A.nnz)
        else:
            force, K, C, _ = function(t, u, v, q0, tangent)
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
    t: float,
    u: np.ndarray,
    v: np.ndarray,
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
    K = internal_at(internal, s.n, t, u, v, q).K
    if closed:
        K = combination([(1.0, K), (1.0, _closing_of_functions(s, t, u, v))])
    if not s.internal.springs:
        return K
    _, tangents = springs_at(s, u, remembered)
    least = [x.largest_tangent if closed else x.initial_tangent for x in s.springs]
    larger = [np.maximum(x, k) for x, k in zip(least, tangents)]
    return combination([(1.0, K), (1.0, matrix_of_springs(s, larger))])


def matrices_at(
    s: Subdomain,
    internal: InternalForces | None,
    t: float,
    u: np.ndarray,
    v: np.ndarray,
    q: np.ndarray,
    remembered: np.ndarray,
) -> tuple[Matrix | None, Matrix | None]:
    """C and K of a subdomain for small motions about a state, estimates of functions included.

    Springs have their tangents there, whatever estimate was given of them; that of functions is
    what K_r is beyond the initial tangents of springs beside them. Springs with a memory count as
    in `present_tangent`: in small motions one that yields unloads.
    """
    forces = internal_at(internal, s.n, t, u, v, q)
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
    K = _closing_of_functions(s, 0.0, s.u0, s.v0)
    rises = [x.largest_tangent - x.initial_tangent for x in s.internal.springs]
    if not any(np.any(rise > 0.0) for rise in rises):
        return K
    return combination([(1.0, K), (1.0, matrix_of_springs(s, rises))])


def _closing_of_functions(s: Subdomain, t: float, u: np.ndarray, v: np.ndarray) -> Matrix | None:
    """The largest tangents of the forces that know them, less the present ones."""
    assert s.internal is not None
    terms: list[tuple[float, Matrix]] = []
    for force in s.internal.forces:
        largest = None if force.largest_tangent is None else force.largest_tangent()
        if largest is not None:
            present = force(t, u.copy(), v.copy(), force.history.copy())[1]
            terms += [(1.0, canonical(largest, "largest_tangent", s.n)[0])]
            terms += [(-1.0, canonical(present, "K_t", s.n)[0])]
    return combination(terms)


def matrix_of_springs(s: Subdomain, tangents: Sequence[np.ndarray]) -> Matrix:
    """The stiffness of all springs of a subdomain with these tangents."""
    return canonical(assembled(s.springs, tangents, s.n), "springs", s.n)[0]
