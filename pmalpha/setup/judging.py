"""Warnings of subdomains that move or grow by themselves: loose ones, and those of indefinite K."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp

from .._cached import Once
from .._checks import counted, listing, numbered
from ..errors import ConstraintWarning, StabilityWarning, warn
from ..memory import one_thread
from ..problem.loads import BaseAcceleration, Force, terms_of
from ..problem.matrices import Matrix, dense, diagonal, is_symmetric, sparse
from ..problem.subdomain import Subdomain, dense_whole
from ..reduction.modes import FLOATING, scales_to_one, softest
from .link import Link
from .member import Member
from .rows import rows_of_size_one
from .schedule import Rows

# Dofs of a node for which translations are tried: a translation moves every d-th dof by one.
DOFS_OF_A_NODE = (6, 3, 2, 1)
# Force of a translation relative to that of its single entries: the digits of exported matrices.
ROUNDING = 1e-9
# Up to this number of dofs a sparse matrix takes more time than the same one dense.
SMALL = 200
# A translation is tried on this number of rows before it is tried on all of them.
SAMPLE = 64
# Largest number of entries of K + L^T L that is factored only for a warning: some hundredths of a
# second.
MOST = 100_000
# Up to this number of dofs the eigenvalues of dense matrices are computed: some milliseconds.
FEW = 200
# Up to this number of dofs a subdomain that grows is judged with its ties.
TIED = 400
# A negative eigenvalue of K scaled to a unit diagonal that is not rounding of exported matrices.
NEGATIVE = 1e-6


def warn_of_loose(
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], contacts: Container[int] = ()
) -> None:
    """ConstraintWarning for subdomains beside others without a constraint, and for loose ones.

    A subdomain is loose if it is floating and a rigid-body motion satisfies its constraints.
    Translations are found for any size; rotations where K + L^T L has up to `MOST` entries, and
    only of subdomains that no support holds against translation. Subdomains with a restoring
    function without `restoring_stiffness` are left out, since their stiffness is not known, as are
    those without any stiffness: single masses.

    contacts: subdomains that have contacts, which may be loose.
    """
    reached = [L.values.size > 0 for L in links]
    alone = [not is_tied and i not in contacts for i, is_tied in enumerate(reached)]
    if len(keys) > 1 and any(alone):
        names = [repr(name) for (name, _), is_alone in zip(keys, alone) if is_alone]
        warn(
            f"no constraint reaches {'subdomain' if len(names) == 1 else 'subdomains'} "
            f"{listing(names)}: no force is exchanged with the others; a `tie` is missing, or the "
            "subdomain can be run alone by `solve`",
            ConstraintWarning,
        )
    loose, once = {}, Once()
    for i, ((name, s), L, is_tied) in enumerate(zip(keys, links, reached)):
        if is_tied and i not in contacts and _is_loose(s, L, once):
            loose[name] = counted(L.rows.size, "constraint")
    if len(loose) == 1:
        ((name, count),) = loose.items()
        verb = "does" if count.startswith("1 ") else "do"
        text = f"subdomain {name!r} is floating, and its {count} {verb} not hold it: it can move"
    elif loose:
        labels = [f"{name!r} ({count})" for name, count in loose.items()]
        text = (
            f"subdomains {listing(labels)} are floating, and their constraints do not hold them: "
            "each can move"
        )
    else:
        return
    warn(
        f"{text} as a rigid body while all constraints are satisfied; further dofs are to be "
        "tied, or a support is missing in K",
        ConstraintWarning,
    )


def _is_loose(s: Subdomain, L: Link, once: Once) -> bool:
    """Whether a rigid-body motion satisfies the constraints."""
    if s.has_unknown_stiffness or s.has_feedback:  # which may hold it
        return False
    K = s.largest_tangent
    if K is None:
        return False
    places = L.ptr.tobytes(), L.local.tobytes(), L.values.tobytes()
    return once(lambda: _leaves_motion(K, L), (K,), *places)


def _leaves_motion(K: Matrix, L: Link) -> bool:
    """Whether a rigid-body motion without force in K satisfies the constraints."""
    if K.ndim == 1:
        return bool(np.any((K == 0.0) & (np.diff(L.ptr) == 0)))
    n = K.shape[0]
    if not isinstance(K, np.ndarray) and n <= SMALL:
        K = K.toarray()
    translations = _translations(K, n)
    if not translations.shape[1]:
        return False
    entries = K.size if isinstance(K, np.ndarray) else K.nnz
    entries += float(np.sum(np.bincount(L.local).astype(float) ** 2))
    rows = L.dense() if isinstance(K, np.ndarray) and entries <= MOST else L.sparse()
    if np.linalg.matrix_rank(_rows_of_size_one(rows) @ translations) < translations.shape[1]:
        return True
    return entries <= MOST and _is_singular(K, rows)


def _rows_of_size_one(L: np.ndarray | sp.csr_array) -> np.ndarray | sp.csr_array:
    if isinstance(L, np.ndarray):
        return L / np.max(np.abs(L), axis=1, keepdims=True)
    return rows_of_size_one(L)


def _translations(K: Matrix, n: int) -> np.ndarray:
    """(n, t): translations without force in K, for the dofs per node with the largest number."""
    best, size = np.empty((n, 0)), abs(K)
    tried = [(K, size)] if n <= SAMPLE else [(K[:SAMPLE], size[:SAMPLE]), (K, size)]
    for d in DOFS_OF_A_NODE:
        if n % d or d <= best.shape[1]:
            continue
        shapes = np.eye(d)[np.arange(n) % d]
        for rows in tried:
            if shapes.shape[1]:  # K x is rounding, in rows of K
                some, sizes = rows
                free = np.abs(some @ shapes) <= ROUNDING * (sizes @ shapes)
                shapes = shapes[:, np.all(free, axis=0)]
        best = shapes if shapes.shape[1] > best.shape[1] else best
    return best


def _is_singular(K: Matrix, L: np.ndarray | sp.csr_array) -> bool:
    """Whether K + L^T L, the constraints replaced by springs, has a motion without stiffness."""
    scale = scales_to_one(K.diagonal())
    if isinstance(K, np.ndarray) and is_symmetric(K):
        springs = _rows_of_size_one(L * scale)
        return bool(softest(scale[:, None] * K * scale + springs.T @ springs) <= FLOATING)
    by = sp.diags_array(scale)
    springs = rows_of_size_one(sp.csr_array(sp.csr_array(L) @ by))
    G = sp.csc_array(by @ sp.csc_array(K) @ by + springs.T @ springs)
    return bool(softest(G) <= FLOATING)


def warn_of_growing(
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], *, complete: bool
) -> None:
    """StabilityWarning for linear subdomains with indefinite K, and its rate of growth.

    Decided by the eigenvalues up to `FEW` dofs, beyond by the signs of the minors of order 1 and
    2, which take a pass over the entries: most sign errors. Where the subdomains have up to `TIED`
    dofs together, the structure with its ties decides.

    complete: whether these are all subdomains, and not those of one process of several.
    """
    once = Once()
    computed = ((name, _rate(s, once)) for name, s in keys)
    rates = {name: rate for name, rate in computed if rate > 0.0}
    if not rates:
        return
    tied = any(L.values.size > 0 for L in links)
    subdomains = [s for _, s in keys]
    fastest, doubt = max(rates.values()), ", unless its constraints hold it" if tied else ""
    if tied and complete and all(_is_linear(s, once) for s in subdomains):
        if sum(s.n for s in subdomains) <= TIED:
            fastest, doubt = _rate_with_ties(subdomains, links), ""
    if not fastest > 0.0:
        return
    kind = "subdomain" if len(rates) == 1 else "subdomains"
    grows = (
        f"grows as exp({fastest:.3g} t), a factor of ten in {np.log(10.0) / fastest:.3g}"
        if np.isfinite(fastest)
        else "grows at once, since no mass resists it"
    )
    warn(
        f"K of {kind} {listing([repr(name) for name in rates])} is not positive semidefinite: the "
        f"motion itself {grows}{doubt}; a sign or an entry is wrong, or it is meant to buckle",
        StabilityWarning,
    )


def warn_of_feeding(
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], *, complete: bool
) -> None:
    """StabilityWarning for linear subdomains with a C that adds energy: its symmetric part has a
    negative eigenvalue. Decided as for K, and not of what `warn_of_growing` has named."""
    once = Once()
    computed = ((name, _rate_of_damping(s, once)) for name, s in keys if not _rate(s, once) > 0.0)
    rates = {name: rate for name, rate in computed if rate > 0.0}
    if not rates:
        return
    tied = any(L.values.size > 0 for L in links)
    subdomains = [s for _, s in keys]
    fastest, doubt = max(rates.values()), ", unless others that are tied to it take it" * tied
    if tied and complete and sum(s.n for s in subdomains) <= TIED:
        fastest, doubt = _rate_with_ties(subdomains, links, "C"), ""
    if not fastest > 0.0:
        return
    kind = "subdomain" if len(rates) == 1 else "subdomains"
    grows = f"up to exp({fastest**2:.3g} t)" if np.isfinite(fastest) else "at once"
    warn(
        f"C of {kind} {listing([repr(name) for name in rates])} is not positive semidefinite: it "
        f"adds energy to the motion, which grows {grows}{doubt}; a sign or an entry is wrong",
        StabilityWarning,
    )


def _rate_of_damping(s: Subdomain, once: Once) -> float:
    """The root of the rate at which C alone lets a free subdomain grow, 0 if it does not."""
    if s.C is None or s.M is None:
        return 0.0
    return once(lambda: _rate_of_matrices(_symmetric_part(s.C), s.M), (s.C, s.M), "damping")


def _symmetric_part(C: Matrix) -> Matrix:
    return C if is_symmetric(C) else 0.5 * (C + C.T)


def _is_linear(s: Subdomain, once: Once) -> bool:
    if s.restoring is not None or s.internal is not None:
        return False
    return once(lambda: is_symmetric(s.K), (s.K,), "symmetric")


def _rate(s: Subdomain, once: Once) -> float:
    """The rate of growth of a free subdomain, 0 if none; nearly, of many dofs."""
    if s.K is None or s.M is None or not _is_linear(s, once):
        return 0.0
    return once(lambda: _rate_of_matrices(s.K, s.M), (s.K, s.M), "rate")


def _rate_of_matrices(K: Matrix, M: Matrix) -> float:
    if K.shape[0] <= FEW:
        with one_thread():
            return _dense_rate(dense(K), dense(M))
    x = _negative_direction(K)
    return 0.0 if x is None else _quotient(x, K, M)


def _quotient(x: sp.csr_array, K: Matrix, M: Matrix) -> float:
    """The rate of growth in the direction x (n, 1)."""
    k, m = (float((x.T @ (sparse(A, x.size) @ x)).toarray()[0, 0]) for A in (K, M))
    return float(np.sqrt(-k / m)) if m > 0.0 else np.inf


def _negative_direction(K: Matrix) -> sp.csr_array | None:
    """A vector (n, 1) of at most two entries with x . K x < 0, or None where there is none."""
    from scipy.linalg import eigh

    d, n = diagonal(K), K.shape[0]
    i = int(np.argmin(d))
    if d[i] < 0.0:
        return sp.csr_array(([1.0], ([i], [0])), shape=(n, 1))
    if K.ndim == 1:
        return None
    A = sp.coo_array(K)
    excess = np.abs(A.data) - (1.0 + NEGATIVE) * np.sqrt(d[A.row] * d[A.col])
    if not excess.size or not excess.max() > NEGATIVE * d.max():
        return None
    k = int(np.argmax(excess))
    i, j = A.row[k], A.col[k]
    # the eigenvector of the block of i and j
    block = np.array([[d[i], A.data[k]], [A.data[k], d[j]]])
    return sp.csr_array((eigh(block)[1][:, 0], ([i, j], [0, 0])), shape=(n, 1))


def _dense_rate(K: np.ndarray, M: np.ndarray) -> float:
    """sqrt(-omega^2) of the lowest omega^2; inf without mass in its way, 0 where none grows."""
    from scipy.linalg import eigh

    size = np.abs(np.diag(K))
    size = np.where(size > 0.0, size, np.max(np.abs(K), axis=1))
    root = 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0))
    values, x = eigh(root[:, None] * K * root, subset_by_index=[0, 0])
    if values[0] > -NEGATIVE:
        return 0.0
    try:
        lowest = eigh(K, M, eigvals_only=True, subset_by_index=[0, 0])[0]
    except np.linalg.LinAlgError:  # dofs without mass
        y = root * x[:, 0]
        m = y @ M @ y
        return float(np.sqrt(-(y @ K @ y) / m)) if m > 0.0 else np.inf
    return float(np.sqrt(max(-lowest, 0.0)))


def _rate_with_ties(
    subdomains: Sequence[Subdomain], links: Sequence[Link], stiffness: str = "K"
) -> float:
    """The rate of growth of the structure, with the displacements that its constraints allow."""
    from scipy.linalg import null_space

    rows = np.hstack([L.matrix.toarray() for L in links])
    K, M = (dense_whole(subdomains, name) for name in (stiffness, "M"))
    K = np.asarray(_symmetric_part(K))
    with one_thread():
        Z = null_space(rows)
        return _dense_rate(Z.T @ K @ Z, Z.T @ M @ Z) if Z.shape[1] else 0.0


# ---- light --------------------------------------------------------------------------------------
# Masses that are too small for the step: their accelerations lose the digits of displacements.

EPS = float(np.finfo(float).eps)


def warn_of_light(members: Iterable[Member]) -> None:
    """StabilityWarning for dofs of implicit schemes with 0 < m < eps h^2 k, k at t = 0.

    A displacement u is out of balance by k u, hence the acceleration k u / m, and the predictor
    adds h^2 times that: beyond u / eps nothing of u is left in the sum.
    """
    once = Once()
    for member in members:
        name, s, h = member.name, member.subdomain, member.step
        if s.scheme.explicit or s.M is None:
            continue
        stiffnesses = (s.tangent, None if member.internal is None else member.internal.K)
        light, m, k = once(partial(_light, s.M, stiffnesses, h), (s.M, *stiffnesses), h)
        if light.size:
            worst = light[np.argmax(k[light] / m[light])]
            ratio = h * h * k[worst] / m[worst]
            warn(
                f"the mass at {numbered('dof', light)} of subdomain {name!r} is smaller than "
                f"2.2e-16 h^2 K, down to {m[worst]:g} with h^2 K / M = {ratio:.3g}: accelerations "
                "out of balance move the displacements by more than the digits they have; give M "
                "a zero there, for a dof without mass, with a scheme that damps at infinite "
                "frequency",
                StabilityWarning,
            )


def _light(
    M: Matrix, stiffnesses: Sequence[Matrix | None], h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The dofs with 0 < m < eps h^2 k, m and k."""
    m, k = diagonal(M), np.abs(sum(diagonal(A) for A in stiffnesses if A is not None))
    return np.flatnonzero((m > 0.0) & (m < EPS * h * h * k)), m, k


# ---- ground motion ------------------------------------------------------------------------------
# Ground motions of subdomains that are tied: displacements relative to the ground in all.


def warn_of_ground(
    members: Sequence[Member], forces: Sequence[Force], constraints: Sequence[Rows], first: int = 0
) -> None:
    """One ConstraintWarning for the subdomains with mass that are tied to one with a ground motion
    and have none.

    first: number of the first member among the subdomains of the constraints.
    """
    moves = [any(isinstance(x, BaseAcceleration) for x in terms_of(force)) for force in forces]
    if all(moves) or not any(moves):
        return
    neighbours: dict[str, str] = {}
    for rows in constraints:
        indices = [i - first for i in rows.matrices if 0 <= i - first < len(members)]
        moved = [i for i in indices if moves[i]]
        for i in indices:
            member = members[i]
            if moved and not moves[i] and member.subdomain.massless.size < member.n:
                neighbours.setdefault(member.name, members[moved[0]].name)
    if not neighbours:
        return
    pairs = [
        f"{at!r} has none, tied to {other!r}, which has one" for at, other in neighbours.items()
    ]
    warn(
        "a ground motion must act on all tied subdomains with mass, since displacements are "
        f"relative to the ground: {'; '.join(pairs)}. The same BaseAcceleration(record) can be "
        "the force of each: it takes the mass of its subdomain",
        ConstraintWarning,
    )
