"""All warnings of set-up, called once with the orders and the factors that were made.

Nothing here is needed for a step: a judgement reads what set-up has, and factors nothing large.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

import pmalpha._core as _core

from .._cached import Once
from .._checks import counted, listing, numbered
from ..devices.linear import LinearActuator
from ..errors import (
    AccuracyWarning,
    ConstraintWarning,
    PerformanceWarning,
    StabilityWarning,
    warn,
)
from ..memory import one_thread
from ..problem.device import Device
from ..problem.forms import Factor
from ..problem.loads import loads_of
from ..problem.matrices import (
    Matrix,
    absolute,
    dense,
    diagonal,
    is_symmetric,
    product,
    row_of_entries,
    sparse,
    with_entries,
)
from ..problem.restoring import items_of, wheels_of
from ..problem.subdomain import Subdomain, dense_whole
from ..reduction.ordering import (
    FLOATING,
    has_nested_dissection,
    is_definite,
    scales_to_one,
    softest,
)
from .amplification import (
    GROWS,
    cheap_radius,
    growth_of_loop,
    growth_of_structure,
    is_growing,
    methods_of,
)
from .contact_rows import Contacts, is_undamped
from .factors import solve
from .interface import interface_matrix
from .internal_forces import closing_tangent
from .link import Link
from .member import STEP_NUMBERS, Member, Ordered
from .ranks import Ranks, joined
from .rows import CoreRows, rows_of_size_one
from .schedule import Layout, Rows
from .skew import doubts_of_skew, is_unsymmetric
from .stability import StepRatio, step_ratio

# How contact can be given so that the step does not have to resolve it.
INSTEAD = "contact as internal= of an implicit scheme, or as a constraint, pmalpha.contact"
# Dofs of a node for which translations are tried: a translation moves every d-th dof by one.
DOFS_OF_A_NODE = (6, 3, 2, 1)
# Force of a translation relative to that of its single entries: the digits of exported matrices.
ROUNDING = 1e-9
# Up to this number of dofs a sparse matrix takes more time than the same one dense.
SMALL = 200
# A translation is tried on this number of rows before it is tried on all of them.
SAMPLE = 64
# Largest number of entries of K + L^T L that is factored only for a warning: a millisecond.
MOST = 10_000
# Up to this number of dofs the eigenvalues of dense matrices are computed: some milliseconds.
FEW = 200
# Smallest eigenvalue of K + L^T L, scaled to a unit diagonal, of a subdomain that no test finds
# loose; number of dofs up to which it is tried, and ratio of the scales.
HELD, HELD_DOFS, HELD_SCALES = 1e-6, 64, 1e4
# Up to this number of dofs a subdomain that grows is judged with its ties.
TIED = 400
# A negative eigenvalue of K scaled to a unit diagonal that is not rounding of exported matrices.
NEGATIVE = 1e-6
# Velocity at the end of a macro step over its mean: below, a subdomain resonates with the step.
RESONANT = 0.05
# 2 beta / gamma from which damping feeds the velocity jump; the trapezoidal rule has 1 to rounding.
ABOVE = 1.0 + 1e-9
# Rates of growth up to this multiple of that of the structure are its own, with the errors of steps
# that resolve it.
OWN = 1.1
# Numbers of a state up to which the amplification matrix of any coupled problem is made: as long as
# the rest of the set-up takes. And where there is a reason to, up to a tenth of a second.
ALWAYS, CHEAP = 100, 300


@dataclass(frozen=True)
class Made:
    """What set-up has made for steps of one layout, to be judged."""

    members: Sequence[Member]
    core: _core.Coupler
    coupling: str
    layout: Layout
    rows: CoreRows
    parts: dict[str, Any]  # what the core is made of
    ranks: Ranks | None
    contacts: Contacts | None


def judge(
    made: Made, keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], groups: Sequence[Rows]
) -> None:
    """All warnings of a new coupled problem.

    links: L_i, independent rows, in the user's order.
    groups: the constraints of the user, of the subdomains of all processes.
    """
    members, contacts, is_complete = made.members, made.contacts, made.ranks is None
    first = 0 if made.ranks is None else made.ranks.part.start
    once = Once()
    warn_of_loose(keys, links, once, () if contacts is None else contacts.dofs)
    warn_of_factors(members)
    judge_steps(made, members)
    _warn_of_falling(members)
    if contacts is not None:
        warn_of_touching_ties(members, contacts)
    warn_of_growing(keys, links, once, complete=is_complete)
    warn_of_feeding(keys, links, once, complete=is_complete)
    warn_of_ground(members, groups, first)


def judge_steps(made: Made, new: Sequence[Member]) -> None:
    """The warnings that depend on the steps: of the couplings, and of the subdomains in `new`."""
    members, ranks = made.members, made.ranks
    if made.coupling == "macro":
        _warn_of_restoring(new)
        _warn_of_massless_ties(new)
        warn_of_resonance(made.parts["H"], members, made.rows.position, ranks)
    for member in new:
        internal = None if member.internal is None else member.internal.K
        closing = None if member.internal is None else closing_tangent(member.subdomain)
        member.step_ratio = step_ratio(member.subdomain, member.step, internal, closing)
    warn_of_couplings(made)
    if ranks is None:
        warn_of_loops(made)
    warn_of_light(new)


def _warn_of_falling(members: Sequence[Member]) -> None:
    """AccuracyWarning for springs with an end that is off its path when a run begins."""
    for member in members:
        paths = [path for item in wheels_of(member.subdomain.restoring) for path in item.paths]
        off = next((path for path in paths if not path.is_on(0.0)), None)
        if off is not None:
            warn(
                f"springs of subdomain {member.name!r} start off their path, at {off.start:g} of "
                f"its length {off.length:g}: they have no force there, and what they carry falls; "
                "a path that begins earlier holds it",
                AccuracyWarning,
            )


# ---- rigid motions ------------------------------------------------------------------------------


def warn_of_loose(
    keys: Sequence[tuple[str, Subdomain]],
    links: Sequence[Link],
    once: Once,
    contacts: Container[int] = (),
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
    loose = {}
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
    if n <= HELD_DOFS and _is_held(K, L.dense()):
        return False
    translations = _translations(K, n)
    if not translations.shape[1]:
        return False
    entries = K.size if isinstance(K, np.ndarray) else K.nnz
    entries += float(np.sum(np.bincount(L.local).astype(float) ** 2))
    rows = L.dense() if isinstance(K, np.ndarray) and entries <= MOST else L.sparse()
    if np.linalg.matrix_rank(_rows_of_size_one(rows) @ translations) < translations.shape[1]:
        return True
    return entries <= MOST and _is_singular(K, rows)


def _is_held(K: np.ndarray, L: np.ndarray) -> bool:
    """Whether K + L^T L is certainly definite, by a margin far above the rounding of all tests.

    A translation t with K t = 0 and L t = 0 to their tolerances has t . (K + L^T L) t of at most
    1e-9 n times the largest entry of K, all scaled.
    """
    d = K.diagonal()
    if not d.min() > 0.0 or not is_symmetric(K):
        return False
    scale = scales_to_one(d)
    if scale.max() > HELD_SCALES * scale.min():
        return False
    springs = _rows_of_size_one(L * scale)
    stiffness = scale[:, None] * K * scale
    A = stiffness + springs.T @ springs
    A.flat[:: len(A) + 1] -= HELD * np.max(np.abs(stiffness))
    return is_definite(A)


def _rows_of_size_one(L: np.ndarray | sp.csr_array) -> np.ndarray | sp.csr_array:
    if isinstance(L, np.ndarray):
        return L / np.max(np.abs(L), axis=1, keepdims=True)
    return rows_of_size_one(L)


def _translations(K: Matrix, n: int) -> np.ndarray:
    """(n, t): translations without force in K, for the dofs per node with the largest number."""
    best = np.empty((n, 0))
    tried = [K] if n <= SAMPLE else [K[:SAMPLE], K]
    for d in DOFS_OF_A_NODE:
        if n % d or d <= best.shape[1]:
            continue
        shapes = np.eye(d)[np.arange(n) % d]
        for rows in tried:
            if shapes.shape[1]:  # K x is rounding, in rows of K
                free = np.abs(rows @ shapes) <= ROUNDING * (absolute(rows) @ shapes)
                shapes = shapes[:, np.all(free, axis=0)]
        best = shapes if shapes.shape[1] > best.shape[1] else best
    return best


def _is_singular(K: Matrix, L: np.ndarray | sp.csr_array) -> bool:
    """Whether K + L^T L, the constraints replaced by springs, has a motion without stiffness."""
    scale = scales_to_one(K.diagonal())
    if isinstance(K, np.ndarray) and is_symmetric(K):
        springs = _rows_of_size_one(L * scale)
        return bool(softest(scale[:, None] * K * scale + springs.T @ springs) <= FLOATING)
    A, rows = sp.csr_array(K), sp.csr_array(L)
    A = with_entries(A, A.data * scale[row_of_entries(A)] * scale[A.indices])
    springs = rows_of_size_one(with_entries(rows, rows.data * scale[rows.indices]))
    return bool(softest(sp.csc_array(A + springs.T @ springs)) <= FLOATING)


# ---- growth of a subdomain alone ----------------------------------------------------------------


def warn_of_growing(
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], once: Once, *, complete: bool
) -> None:
    """StabilityWarning for linear subdomains with indefinite K, and its rate of growth.

    Decided by the eigenvalues up to `FEW` dofs, beyond by the signs of the minors of order 1 and
    2, which take a pass over the entries: most sign errors. Where the subdomains have up to `TIED`
    dofs together, the structure with its ties decides.

    complete: whether these are all subdomains, and not those of one process of several.
    """
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
    keys: Sequence[tuple[str, Subdomain]], links: Sequence[Link], once: Once, *, complete: bool
) -> None:
    """StabilityWarning for linear subdomains with a C that adds energy: its symmetric part has a
    negative eigenvalue. Decided as for K, and not of what `warn_of_growing` has named."""
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
    return s.symmetric or once(lambda: is_symmetric(s.K), (s.K,), "symmetric")


def _rate(s: Subdomain, once: Once) -> float:
    """The rate of growth of a free subdomain, 0 if none; nearly, of many dofs."""
    if s.K is None or s.M is None or not _is_linear(s, once):
        return 0.0
    return once(lambda: _rate_of_matrices(s.K, s.M), (s.K, s.M), "rate")


def _rate_of_matrices(K: Matrix, M: Matrix) -> float:
    if K.ndim == 1 and K.min() >= 0.0:
        return 0.0
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
    A, root = sparse(K, n), np.sqrt(d)
    rows = row_of_entries(A)
    excess = np.abs(A.data) - (1.0 + NEGATIVE) * root[rows] * root[A.indices]
    if not excess.size or not excess.max() > NEGATIVE * d.max():
        return None
    k = int(np.argmax(excess))
    i, j = rows[k], A.indices[k]
    # the eigenvector of the block of i and j
    block = np.array([[d[i], A.data[k]], [A.data[k], d[j]]])
    return sp.csr_array((eigh(block)[1][:, 0], ([i, j], [0, 0])), shape=(n, 1))


def _dense_rate(K: np.ndarray, M: np.ndarray) -> float:
    """sqrt(-omega^2) of the lowest omega^2; inf without mass in its way, 0 where none grows."""
    from scipy.linalg import eigh

    size = np.abs(np.diag(K))
    size = np.where(size > 0.0, size, np.max(np.abs(K), axis=1))
    root = 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0))
    scaled = root[:, None] * K * root
    shifted = scaled.copy()
    shifted.flat[:: len(K) + 1] += 0.5 * NEGATIVE
    if is_definite(shifted):  # less than the eigenvalue takes, and nearly always enough
        return 0.0
    values, x = eigh(scaled, subset_by_index=[0, 0])
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


# ---- steps ---------------------------------------------------------------------------------------
# Steps above the critical ones, and couplings that grow.


def warn_of_couplings(made: Made) -> None:
    """StabilityWarning for steps above the critical ones and for couplings that grow.

    Of small problems whose subdomains are all linear the spectral radius decides on both: a tie to
    a heavy subdomain raises the critical step, and other substeps elsewhere may lower it again.
    """
    if made.layout.spans_change:
        return  # one macro step; the regular steps after it were assembled before, and judged
    members, coupling, ranks, p = made.members, made.coupling, made.ranks, made.rows.p
    doubts = doubts_of_damping(members, ranks) if coupling == "mean" else []
    doubtful = [x for x in members if not x.subdomain.symmetric] if ranks is None else []
    skew = [x for x in doubtful if is_unsymmetric(x)]
    if skew:
        doubts += doubts_of_skew(skew, members, coupling)
    above = [
        (member, ratio)
        for member in members
        if (ratio := member.step_ratio) is not None and ratio.is_above
    ]
    radius = None
    if (above or p) and ranks is None and made.contacts is None:
        is_damped = coupling == "mean" and any(member.is_damped for member in members)
        most = CHEAP if above or is_damped or skew else ALWAYS
        radius = cheap_radius(members, made.core, coupling, made.rows, most)
    raised = radius is not None and not is_growing(radius)
    if not raised:  # not once more of those that have been warned of
        unknown = [(member, ratio) for member, ratio in above if ratio.raised is not False]
        warn_of_steps((m.name, m.subdomain, m.step, ratio) for m, ratio in unknown)
    for member, ratio in above:
        member.step_ratio = replace(ratio, raised=raised)
    if p:
        otherwise = None if above else growing(coupling)
        warn_of_growth(doubts, otherwise, members, radius, made.layout.dt)


def warn_of_steps(steps: Iterable[tuple[str, Subdomain, float, StepRatio]]) -> None:
    """One StabilityWarning for all steps that are above the critical one."""
    above = [
        (name, subdomain, step, ratio) for name, subdomain, step, ratio in steps if ratio.is_above
    ]
    if not above:
        return
    limits = [f"{name!r} ({step:g} above {_limit(step, ratio)})" for name, _, step, ratio in above]
    text = f"the steps of these subdomains are above their critical steps: {listing(limits)}"
    if len(above) == 1:
        ((name, _, step, ratio),) = above
        text = f"the step {step:g} of subdomain {name!r} is above its critical step "
        text += _limit(step, ratio)
    implicit = any(s.C is not None and s.damping == "implicit" for _, s, _, _ in above)
    damping = " (damping, which may raise it, is left out)" if implicit else ""
    closed = all(ratio.when_closed for _, _, _, ratio in above)
    # tied to a heavier one it may be stable
    grows = "alone it grows without bound" if len(above) == 1 else "alone they grow without bound"
    effect = "contact will add energy" if closed else grows
    once = any(ratio.when_closed or s.restoring_springs for _, s, _, ratio in above)
    remedy = f", or give springs and {INSTEAD}" if once else ""
    warn(f"{text}{damping}: {effect}; take smaller steps{remedy}", StabilityWarning)


def _limit(step: float, ratio: StepRatio) -> str:
    return f"{step / ratio.value:.6g}{' when contact is closed' if ratio.when_closed else ''}"


def warn_of_growth(
    doubts: Sequence[str],
    otherwise: str | None,
    members: Sequence[Member],
    radius: float | None,
    dt: float,
) -> None:
    """StabilityWarning for each of the doubts, unless no step grows more than the structure does.

    doubts: why a coupling of these schemes can grow.
    otherwise: what to say if it grows and there are none; None where that is said elsewhere.
    """
    amount, texts = "", list(doubts)
    if radius is not None:
        if not is_growing(radius):
            return
        growth = growth_of_structure(members) * dt
        if np.log(radius) <= OWN * growth + GROWS:
            return
        amount = f": here by a factor of {_factor(radius)} in a macro step"
        if growth > 0.0:
            amount += f", of which {_factor(np.exp(growth))} is the growth of the structure itself"
        texts = texts or ([] if otherwise is None else [otherwise])
    for text in texts:
        warn(text + amount, StabilityWarning)


def _factor(radius: float) -> str:
    """A factor with three digits of what it adds."""
    return f"{1.0 + float(f'{radius - 1.0:.3g}'):.12g}"


def doubts_of_damping(members: Sequence[Member], ranks: Ranks | None = None) -> list[str]:
    """Why the velocity jump can grow with damping, (K8)."""
    local_names = []
    for member in members:
        scheme, damped = member.subdomain.scheme, member.is_damped and member.substeps == 1
        if damped and 2.0 * scheme.beta > ABOVE * scheme.gamma:
            local_names.append(member.name)
    names = [repr(name) for name in joined(ranks, local_names)]
    if not names:
        return []
    return [
        'coupling="mean" grows with damping in subdomains with one substep and rho < 1 '
        f"({listing(names)}): the velocity jump at the interface does; take there the "
        'trapezoidal rule or central difference, or coupling="macro"'
    ]


def growing(coupling: str) -> str:
    """What is said of a coupled step that grows, for no other reason that is known."""
    if coupling == "mean":
        return (
            'coupling="mean" grows with these dampings and substeps: the velocity jump at the '
            'interface does; take other steps, or coupling="macro"'
        )
    return f'coupling="{coupling}" grows with these schemes and steps; take smaller steps'


# ---- macro coupling, contacts, rigs -------------------------------------------------------------


def _names(members: Sequence[Member]) -> str:
    """``subdomain 'a'``, ``subdomains 'a', 'b'``"""
    return numbered("subdomain", [repr(member.name) for member in members])


def _warn_of_restoring(members: Sequence[Member]) -> None:
    """StabilityWarning for restoring forces, which are evaluated in the free macro run."""
    restored = [
        p for p in members if p.has_responses and p.nb and p.subdomain.restoring is not None
    ]
    if not restored:
        return
    warn(
        f"the restoring forces of {_names(restored)} are combined with substeps under "
        'coupling="macro": the run can grow unless restoring_stiffness is within a few per cent of '
        'the tangent stiffness, or the forces vary little in dt; else take coupling="pm" or "gc"',
        StabilityWarning,
    )


def _warn_of_massless_ties(members: Sequence[Member]) -> None:
    """ConstraintWarning for massless dofs, whose velocity between macro time levels is not tied."""
    tied = {
        member.name: np.intersect1d(member.order[member.n - member.nb :], member.subdomain.massless)
        for member in members
        if member.subdomain.massless.size
        and (member.has_responses or (member.internal is not None and member.substeps > 1))
    }
    places = [f"{numbered('dof', dofs)} of {name!r}" for name, dofs in tied.items() if dofs.size]
    if not places:
        return
    warn(
        f'interface dofs without mass: {listing(places)}; with substeps coupling="macro" is of '
        'order 1 there; give them mass, or take "pm" or "gc"',
        ConstraintWarning,
    )


def warn_of_resonance(
    factor: Factor, members: Sequence[Member], position: np.ndarray, ranks: Ranks | None = None
) -> None:
    """StabilityWarning when some multipliers hardly move the velocities at the end of a macro step.

    factor: of H, (M4).
    position: (p,) array of int, position of each constraint in the core's order.

    The smallest eigenvalue of H x = lam P x by inverse iteration, where P is formed like H with
    the mean velocities in the macro step; of unsymmetric matrices, by size.
    """
    blocks = [(p.name, p.response_blocks[1]) for p in members if p.response_blocks is not None]
    means = dict(joined(ranks, blocks))
    if not means:
        return
    mean = interface_matrix(members, position.size, start=False, mean=True, ranks=ranks)
    x = np.cos(np.arange(position.size))
    for _ in range(8):
        before, Px = x, product(mean, x)
        x = solve(factor, Px)
        size = np.max(np.abs(x))
        x, Hx = x / size, Px / size
        if np.array_equal(x, before):  # as with a single constraint: all further ones are the same
            break
    Px = product(mean, x)
    ratio = float(x @ Hx) / float(x @ Px)
    if not all(member.symmetric for member in members):
        ratio = float(np.linalg.norm(Hx) / np.linalg.norm(Px))
    if ratio >= RESONANT:
        return
    shares = {}
    for name, block in means.items():
        values, i, j = block.entries()
        shares[name] = float(x[i] @ (values * x[j]))
    names = [repr(n) for n, share in shares.items() if share > 0.1 * max(shares.values())]
    verb = "resonate" if len(names) > 1 else "resonates"
    row = int(np.flatnonzero(position == np.argmax(np.abs(x)))[0])
    warn(
        f"{' and '.join(names)} {verb} with the macro step: the effect of the "
        f"multipliers on the velocity in constraint {row} at its end is {ratio:.1e} times the mean "
        "effect in it, so that multipliers will be large and inaccurate; change dt a little, add "
        'damping or take rho < 1, or coupling="gc"',
        StabilityWarning,
    )


def warn_of_touching_ties(members: Sequence[Member], contacts: Contacts) -> None:
    """StabilityWarning for tied dofs that are in contact, where a scheme does not damp."""
    for i in contacts.N:
        member = members[i]
        both = np.intersect1d(member.order[member.L.dofs], contacts.dofs[i])
        if both.size and is_undamped(member.subdomain.scheme):
            verb = "is" if both.size == 1 else "are"
            warn(
                f"{numbered('dof', np.sort(both))} of {member.name!r} {verb} both tied and in "
                "contact, and its scheme has no algorithmic damping: the multipliers of ties "
                "alternate from step to step while the contact is closed; take rho <= 0.9",
                StabilityWarning,
            )


def warn_of_loops(made: Made) -> None:
    """StabilityWarning where the loop with linear rigs grows; nothing where that is not known."""
    rigs = [
        (member, item)
        for member in made.members
        for item in items_of(member.subdomain.restoring)
        if isinstance(item, Device) and isinstance(item.innermost, LinearActuator)
    ]
    too_long = any(m.step_ratio is not None and m.step_ratio.is_above for m in made.members)
    if not rigs or too_long or made.contacts is not None or made.layout.spans_change:
        return
    growth = growth_of_loop(made.members, made.parts, made.coupling, made.rows, made.layout.dt)
    if growth is None:
        return
    names = ", ".join(repr(member.name) for member, _ in rigs)
    means = ", ".join(" before ".join(methods_of(item)) or "none" for _, item in rigs)
    actuator = rigs[0][1].innermost
    at = actuator.response(growth.frequency)
    plant = ""
    if actuator.n == 1:
        turn = np.degrees(np.angle(at))
        plant = f", where the actuator has the amplitude {abs(at):.3g} and the phase {turn:.3g} deg"
    warn(
        f"the loop of subdomain {names} with its rig grows as exp({growth.rate:.4g} t) at "
        f"{growth.frequency:.3g} cycles per unit of t{plant}: the spectral radius of a macro step "
        f"is {1.0 + float(f'{growth.radius - 1.0:.3g}'):.12g}; compensation: {means}. "
        'rig.Compensated(..., method="model") follows the commands with the inverse of a model',
        StabilityWarning,
    )


# ---- factors ------------------------------------------------------------------------------------

# Below this number of entries (0.8 MB) a factor stays in the caches, and its sweeps are cheap.
NOTABLE_FACTOR = 100_000

# Below this number of multiplications, some ten seconds, the elimination order is not warned of.
NOTABLE_FACTORIZATION = 1e11


def warn_of_factors(members: Sequence[Member]) -> None:
    """PerformanceWarning when the sweeps of factors take most of explicit steps."""
    swept = {member.name: _costly_factor(member) for member in members}
    costly = {name: factor for name, factor in swept.items() if factor is not None}
    if not costly:
        return
    sizes = [
        f"{' and '.join(full)} of {name!r} ({entries} entries, {8e-6 * entries:.3g} MB)"
        for name, (full, entries) in costly.items()
    ]
    full = sorted({A for full, _ in costly.values() for A in full}, reverse=True)
    advice = {"M": "lump the mass, M as a 1-D array", "C": 'take damping="lagged"'}
    warn(
        f"matrices of explicit subdomains are not diagonal: {listing(sizes)}; every step sweeps "
        "factors of this size, more than half of its work; "
        f"{' and '.join(advice[A] for A in full)}",
        PerformanceWarning,
    )


def _costly_factor(member: Member) -> tuple[list[str], int] | None:
    """The matrices that an explicit subdomain has a large factor for, and its entries, or None."""
    solved = {"M": member.M, "C": member.damping}
    full = [name for name, A in solved.items() if A is not None and A.ndim == 2]
    if not member.subdomain.scheme.explicit or not full:
        return None
    structure = member.elimination.structure
    entries = member.n * (member.n + 1) // 2 if structure is None else member.elimination.swept // 2
    K = member.K
    product = 0 if K is None else K.size if isinstance(K, np.ndarray) else K.nnz
    rest = STEP_NUMBERS * member.n + product
    return None if entries < NOTABLE_FACTOR or 2 * entries <= rest else (full, entries)


def warn_of_order(members: Sequence[Ordered]) -> None:
    """PerformanceWarning for long factorizations in an order without nested dissection."""
    if has_nested_dissection():
        return
    structures = {
        member.name: member.elimination.structure
        for member in members
        if member.elimination.structure is not None
        and member.elimination.structure.operations >= NOTABLE_FACTORIZATION
    }
    if not structures:
        return
    operations = sum(structure.operations for structure in structures.values())
    entries = sum(structure.entries for structure in structures.values())
    warn(
        f"pymetis is not installed: the factors of {', '.join(map(repr, structures))} have "
        f"{entries:.2g} entries ({8e-9 * entries:.2g} GB) and take {operations:.2g} "
        "multiplications each time they are made; nested dissection makes this less for solids "
        "(a cube of 98 000 dofs: set up in 9 s and 1.2 GB instead of 33 s and 3 GB): pip install "
        "pymetis",
        PerformanceWarning,
    )


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


def warn_of_ground(members: Sequence[Member], constraints: Sequence[Rows], first: int = 0) -> None:
    """One ConstraintWarning for the subdomains with mass that are tied to one with a ground motion
    and have none.

    first: number of the first member among the subdomains of the constraints.
    """
    moves = [any(x._is_ground for x in loads_of(member.subdomain.force)) for member in members]
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
